"""On recordings: the force that plates leave for a seat, and hands that lift a box.

The hands lift at the times at which the box is lifted.
"""

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.contact.held_objects import find_holds
from myomorph.core.contact.site_motion import site_motion
from myomorph.core.contact.sites import body_sites
from myomorph.core.io.formats import read_model
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.inertia import free_object
from myomorph.core.model.join import join_models, join_motions
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import resample_wrenches
from truths.carried_bodies import needed_wrench

CHAIR = "opencap-subject4-multitask"


@pytest.fixture(scope="module")
def standing_up(data):
    """Return the expert's model, its motion and the plates of sitting and standing.

    The model has the mass that the plates weigh.
    """
    expert = read_model(data(f"{CHAIR}/models/manually_scaled.osim"))
    still = (
        read_external_loads(data(f"{CHAIR}/grf/static1_external_forces.xml"))
        .forces[:, :, 1]
        .sum(axis=1)
    )
    model = scale(expert, {}, float(np.median(still)) / 9.80665, preserve_mass_distribution=True)
    motion = motion_from_table(read_sto(data(f"{CHAIR}/ik_manual_scaling/STS1_ik.mot")), model)
    moving = differentiate(motion, 6.0)
    plates = read_external_loads(data(f"{CHAIR}/grf/STS1_external_forces.xml"))
    return model, moving, resample_wrenches(plates, moving.time, 6.0)


def test_seat_and_feet_carry_the_body(standing_up):
    """With feet off the floor the seat takes all the weight.

    In standing, at most 5 % of it is left.
    """
    model, motion, plates = standing_up
    left = needed_wrench(model, motion, "pelvis", plates).forces[:, 0]
    weight = model.mass * 9.80665
    feet = plates.forces[:, :, 1].sum(axis=1)
    standing = motion["pelvis_ty"] > np.percentile(motion["pelvis_ty"], 60.0)
    sitting = (feet < 0.05 * weight) & ~standing
    assert sitting.sum() > 100
    assert left[sitting, 1].mean() == pytest.approx(weight, rel=0.05)
    assert np.abs(left[standing].mean(axis=0)).max() < 0.05 * weight
    assert np.sqrt(np.mean(left[:, 2] ** 2)) < 0.02 * weight


def test_the_seat_is_where_the_force_passes(standing_up):
    """Its middle is within a hand's breadth of the line of the force.

    It is also in the middle of the body.
    """
    model, motion, plates = standing_up
    left = needed_wrench(model, motion, "pelvis", plates)
    sitting = motion["pelvis_ty"] < np.percentile(motion["pelvis_ty"], 20.0)
    (seat,) = body_sites(model, ("seat",))
    place = site_motion(model, motion, (seat,)).places[:, 0]
    force = left.forces[:, 0]
    moment = left.torques[:, 0] + np.cross(left.points[:, 0] - place, force)
    ahead = moment[sitting, 2] / force[sitting, 1]
    aside = -moment[sitting, 0] / force[sitting, 1]
    assert abs(np.median(ahead)) < 0.08
    assert abs(np.median(aside)) < 0.02


def test_palms_hold_a_box_that_they_carry(standing_up):
    """A box put at the palms of a real motion while it stands: held then, not before."""
    model, motion, _ = standing_up
    short = slice(60, 200)
    cut = motion.frames(short)
    hands = body_sites(model, ("hand_r", "hand_l"))
    middle = site_motion(model, cut, hands).places.mean(axis=1)
    taken = 70
    path = np.where(np.arange(len(cut))[:, None] < taken, middle[taken], middle)
    thing = free_object("body", 5.0, (0.3, 0.2, 0.3), gravity=model.gravity)
    values = np.hstack([path, np.zeros_like(path)])
    parts = {"man": cut, "box": differentiate(Motion(cut.time, thing.coordinate_names, values))}
    joined = join_models({"man": model, "box": thing})
    sites = tuple(
        replace(one, against="box_body") for one in body_sites(joined, ("hand_r", "hand_l"))
    )
    touches = find_holds(joined, join_motions(parts), sites).intervals
    assert {one.site for one in touches} == {"hand_r", "hand_l"}
    assert all(one.start == pytest.approx(cut.time[taken], abs=0.15) for one in touches)
