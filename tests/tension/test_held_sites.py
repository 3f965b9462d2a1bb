"""Sites against an object are in contact while they stay where they are on it.

Their height over the floor does not matter.
"""

import numpy as np
import pytest

from myomorph.core.contact.plan import ContactPlan
from myomorph.core.model.contacts import Cone, Site
from myomorph.core.model.inertia import free_object
from myomorph.core.model.join import join_models, join_motions
from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate
from myomorph.core.tension.contact_setting import Measurements, set_contacts
from myomorph.core.tension.terms.contacts import ContactOptions


def test_a_palm_on_a_box_that_rises():
    """A palm comes down to a box at 0.5 s and lifts it from 1 s on.

    It holds it from 0.5 s, a meter over the floor. What stands on the floor does so all the while.
    """
    time = np.arange(0.0, 2.0, 0.01)
    rise = 0.25 * np.clip(time - 1.0, 0.0, None) ** 2
    heights = {
        "box": 1.0 + rise,
        "arm": 1.2 + rise + np.clip(0.5 - time, 0.0, None),
        "stand": 0.1 + 0.0 * time,
    }
    parts = {}
    motions = {}
    for name, height in heights.items():
        parts[name] = free_object("body", 2.0, (0.2, 0.2, 0.2))
        values = np.zeros((len(time), 6))
        values[:, 1] = height
        motions[name] = differentiate(Motion(time, parts[name].coordinate_names, values))
    site = Site(
        name="palm",
        body="arm_body",
        points=np.zeros((1, 3)),
        cone=Cone(direction=None),
        against="box_body",
    )
    sole = Site("sole", "stand_body", np.array([[0.0, -0.1, 0.0]]))
    plan = ContactPlan(feet=False, sites=(site, sole))
    motion = join_motions(motions)
    setting = set_contacts(plan, join_models(parts), motion, Measurements(motion), ContactOptions())
    (touch,) = setting.contacts.of("palm")
    (stood,) = setting.contacts.of("sole")
    assert (stood.start, stood.stop) == pytest.approx((0.0, time[-1]))
    assert touch.start == pytest.approx(0.5, abs=0.05)
    assert touch.stop == pytest.approx(time[-1])
    assert setting.task.activations["palm"][time > 0.6] == pytest.approx(1.0)
