"""Several subjects and objects solved as one.

The forces that they exchange obey Newton's law, and files report them.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.core.io.contact_events import read_events
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadFile
from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.store.contact_store import get_contact_forces
from myomorph.lab.store.results import read_result
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.trial.reporting import report_folder
from myomorph.show.demo.arm import table_text

HAND = np.array([0.0, -0.28, 0.0])
MASS = 1.5

STUDY = """
[study]
name = "holding"
[[subject]]
name = "s01"
model = "arm.osim"
trials = ["reach.trc"]
steps = ["ik", "tension"]
[[together]]
name = "held"
trials = {{ s01 = "{trial}" }}
contacts = "contacts.toml"
{extra}
"""
BALL = """[[together.object]]
name = "ball"
mass = 1.5
size = [0.1, 0.1, 0.1]
motion = "ball.mot"
"""
CONTACTS = """
feet = false
[[site]]
name = "grip"
body = "ball_ball"
against = "s01_fore"
points = [[0.0, 0.0, 0.0]]
direction = "any"
grip = 0.05
intervals = "always"
"""


@pytest.fixture
def held(arm):
    """Return a ball that goes where the hand goes, without rotating.

    Its acceleration is true, filtered at the cutoff.
    """
    model = read_osim(arm.model)
    tree = compile_tree(model)
    table = read_sto(arm.motion)
    motion = Motion(table.time, table.names, table.values)
    body = np.array([tree.body_index["fore"]])
    places = forward_kinematics(tree, tree.coordinates_of(motion)).points(body, HAND[None])[:, 0]
    still = {name: np.zeros(len(table)) for name in ("rx", "ry", "rz")}
    columns = {"time": table.time, **dict(zip(("tx", "ty", "tz"), places.T, strict=True)), **still}
    (arm.folder / "ball.mot").write_text(table_text(columns))
    (arm.folder / "contacts.toml").write_text(CONTACTS)
    acceleration = differentiate(Motion(table.time, ("x", "y", "z"), places), None).accelerations
    return SimpleNamespace(
        folder=arm.folder, motion=arm.motion, out=arm.out, acceleration=acceleration
    )


def study(held, extra=BALL, trial="reach"):
    path = held.folder / "study.toml"
    path.write_text(STUDY.format(extra=extra, trial=trial))
    return read_plan(path)


def test_a_held_ball_takes_the_force_that_its_motion_needs(held):
    alone, both = run_study(study(held), held.out)
    assert (alone.error, both.error) == ("", "")
    assert both.done == ("id", "tension", "report")
    home = held.out / "held"
    force = get_contact_forces(read_result(home / "held.nc")).of("grip")
    needed = MASS * (held.acceleration + [0.0, 9.80665, 0.0])
    inside = slice(5, -5)
    np.testing.assert_allclose(
        force[inside], needed[inside], atol=0.02 * np.linalg.norm(needed[inside], axis=1).max()
    )
    loads = read_external_loads(home / "contact_forces.xml")
    on = {body: loads.forces[:, k] for k, body in enumerate(loads.bodies)}
    np.testing.assert_allclose(on["ball_ball"], force, atol=1e-6)
    # The force that was measured on the forearm (10 N down) is there beside the ball's.
    np.testing.assert_allclose(on["s01_fore"], [0.0, -10.0, 0.0] - force, atol=1e-6)
    # A touch that always lasts is told as long as the motion.
    (touch,) = read_events(home / "contacts.csv").intervals
    recorded = read_sto(held.motion).time
    assert (touch.start, touch.stop) == pytest.approx((recorded[0], recorded[-1]), abs=0.05)
    # The page can be made again from the results alone, the joined model with it.
    assert report_folder(home) == [home / "report.html"]


def test_what_does_not_fit_is_named_before_anything_runs(held):
    with pytest.raises(BadFile, match="has one trial and no object"):
        study(held, extra="")
    with pytest.raises(BadFile, match="'s01' has no trial 'raech': there are 'reach'"):
        study(held, trial="raech")
    with pytest.raises(BadFile, match=r"motion of 'ball' file 'ball\.mto' does not exist"):
        study(held, BALL.replace("ball.mot", "ball.mto"))
    with pytest.raises(BadFile, match="neither a size nor an inertia"):
        study(held, BALL.replace("size = [0.1, 0.1, 0.1]", ""))
    with pytest.raises(BadFile, match="two parts are named 's01'"):
        study(held, BALL.replace('name = "ball"', 'name = "s01"'))
    with pytest.raises(BadFile, match=r"'options\.report\.preset' = 'judoka'"):
        study(held, BALL + '[options.report]\npreset = "judoka"\n')


def test_a_site_on_no_body_stops_only_what_is_solved_together(held):
    (held.folder / "contacts.toml").write_text(CONTACTS.replace("s01_fore", "s01_hand"))
    alone, both = run_study(study(held), held.out)
    assert alone.error == ""
    assert "unknown body 's01_hand'" in both.error
    assert (both.subject, both.trial) == ("held", "held")
    assert not both.fault
