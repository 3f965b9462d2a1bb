"""Contacts that cannot carry the motion: the frame is marked, and what would do is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.contact.sites import foot_sites
from myomorph.core.contact.states import contact_activations, find_contacts
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.causes import CONTACTS
from myomorph.core.model.contacts import Cone, Site
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Series
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.frames import over_frames
from myomorph.core.tension.problem import TensionInputs, tension_problem
from myomorph.core.tension.relaxation import (
    Allowance,
    missing_words,
    relaxation_messages,
    relaxations,
    what_would_do,
)
from myomorph.core.tension.terms.contacts import ContactTask
from standing import MASS, WEIGHT, block, legs, standing_still

STRICT = {"residual": 1e-6, "moment": 1e-6}
TWO = ((-0.6, 0.0), (0.6, 0.0))


def _found(sites, touching=1.0, accelerations=None, options=STRICT, actuators=None, frames=2):
    """Relaxations of a block that stands, or accelerates as told."""
    model = block()
    motion = standing_still(frames)
    if accelerations is not None:
        motion = replace(motion, accelerations=np.tile(accelerations, (frames, 1)))
    ready = np.broadcast_to(touching, (frames, len(sites)))
    task = ContactTask(sites, Series(motion.time, tuple(one.name for one in sites), ready))
    torques = inverse_dynamics(model, motion)
    problem = tension_problem(
        TensionInputs(model, motion, torques, actuators=actuators, contacts=task)
    )
    over_frames(problem.solve, frames, None, problem.window)
    return relaxations(problem, problem.result(), **options)


def test_a_body_that_its_contacts_carry_is_not_marked():
    assert _found(legs(TWO), options={}) == ()


def test_flight_declared_as_contact_is_no_error():
    """Free fall needs no force: sites that may carry some then carry none."""
    assert _found(legs(TWO), accelerations=[0.0, -9.80665, 0.0, 0.0, 0.0, 0.0], options={}) == ()


@pytest.mark.parametrize("actuators", [None, ()])
def test_weight_that_nothing_carries_names_the_nearest_site(actuators):
    """With residuals, and without any, where the frame is infeasible."""
    low = Site("low", "block", np.array([[0.0, 0.012, 0.0]]))
    high = Site("high", "block", np.array([[0.0, 0.3, 0.0]]))
    ground = Site("ground", "block", np.array([[0.5, 0.0, 0.0]]))
    ready = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    one = _found((high, low, ground), ready, actuators=actuators)[0]
    assert one.frame == 0
    np.testing.assert_allclose(one.force, [0.0, WEIGHT, 0.0], rtol=1e-3, atol=1e-3)
    assert [(part.kind, part.where) for part in one.allowances] == [("contact", "low")]
    assert one.allowances[0].force == pytest.approx(WEIGHT, rel=1e-5)
    assert one.size == pytest.approx(1.0, rel=1e-5)
    assert (
        one.sentence
        == "0.00 s: no site may touch, but 490 N upward are needed: contact of 'low' (12 mm above"
        " its support) would do"
    )


def test_what_residuals_took_before_though_contacts_could_hides_no_later_frame():
    """Under a limit below what reserves take from legs that stand.

    Only the frame without legs is named.
    """
    assert [one.frame for one in _found(legs(TWO), np.array([[1.0, 1.0], [0.0, 0.0]]))] == [1]


def test_a_cone_that_excludes_the_needed_force_tells_the_friction_it_needs():
    """5 m/s^2 along x on legs far apart: 5 / 9.80665 of the weight across the cones."""
    one = _found(legs(TWO, friction=0.3, edges=4), accelerations=[5.0, 0.0, 0.0, 0.0, 0.0, 0.0])[0]
    assert {part.kind for part in one.allowances} == {"friction"}
    missing = 5.0 * MASS - 0.3 * WEIGHT
    assert sum(part.force for part in one.allowances) == pytest.approx(missing, rel=1e-4)
    assert "friction of" in one.sentence
    assert np.linalg.norm(one.force) < missing + 1.0


def test_a_greatest_force_that_is_too_small_is_told_by_how_much():
    one = _found(legs(TWO, friction=0.0, most=0.3 * WEIGHT))[0]
    assert {(part.kind, part.where) for part in one.allowances} == {
        ("most", "leg0"),
        ("most", "leg1"),
    }
    assert [part.force for part in one.allowances] == pytest.approx([0.2 * WEIGHT] * 2, rel=1e-4)
    assert "98 N more at 'leg0' than its greatest force" in one.sentence


def test_what_can_only_push_is_asked_to_pull():
    """Downwards by 15 m/s^2: gravity does 9.8 of it."""
    one = _found(legs([(0.0, 0.0)]), accelerations=[0.0, -15.0, 0.0, 0.0, 0.0, 0.0])[0]
    assert [(part.kind, part.where) for part in one.allowances] == [("pull", "leg0")]
    assert one.allowances[0].force == pytest.approx(15.0 * MASS - WEIGHT, rel=1e-4)
    assert "a pull of 260 N at 'leg0'" in one.sentence


def test_a_moment_that_no_contact_can_make_comes_from_nowhere():
    """A point cannot turn what stands on it about the vertical."""
    one = _found(legs([(0.0, 0.0)]), accelerations=[0.0, 0.0, 0.0, 0.0, 30.0, 0.0])[0]
    assert [(part.kind, part.where) for part in one.allowances] == [("residual", "block")]
    assert one.allowances[0].moment == pytest.approx(60.0, rel=1e-3)
    assert one.sentence.endswith("60 N m at 'block' without a support would do")


def test_a_tilted_cone_and_a_grip_are_taken_as_they_are():
    """A rope that pulls up carries the block; what hangs on it is not marked."""
    rope = Site(
        name="rope", body="block", points=np.array([[0.0, 1.5, 0.0]]), cone=Cone(friction=0.0)
    )
    assert _found((rope,), options={}) == ()
    slanted = Site(
        name="rope",
        body="block",
        points=np.array([[0.0, 1.5, 0.0]]),
        cone=Cone(np.array([1.0, 1.0, 0.0]), friction=0.0),
    )
    one = _found((slanted,))[0]
    assert any(part.kind == "friction" for part in one.allowances)


def test_all_frames_make_one_message():
    every = _found(legs([(0.0, 0.0)]), 0.0, frames=5)
    apart = (*every[:2], *every[3:])
    (message,) = relaxation_messages(apart, 5, 700.0)
    assert message.startswith(
        "contacts cannot carry the motion in 4 of 5 frames (2 stretches), worst at 0.0"
    )
    assert message.cause == CONTACTS
    assert message.times == ((0.0, 0.01), (0.03, 0.04))
    assert message.share == 0.8
    assert message.size == max(np.linalg.norm(each.force) for each in apart)
    assert relaxation_messages((), 5, 700.0) == ()


def test_what_plates_are_off_anyway_is_good_to_know():
    every = _found(legs([(0.0, 0.0)]), 0.0, frames=5)
    heavy = 30.0 * max(float(np.linalg.norm(each.force)) for each in every)
    assert relaxation_messages(every, 5, heavy)[0].severity == "good to know"
    assert relaxation_messages(every[:1], 100, 1.0)[0].severity == "good to know"


def _frames_alone(activations, groups):
    """Return the foot that stands alone in most frames, and these frames."""
    standing = {g: activations[:, groups == g].max(axis=1) > 0.5 for g in set(groups)}
    alone = {
        g: np.flatnonzero(standing[g] & ~np.any([standing[h] for h in standing if h != g], axis=0))
        for g in standing
    }
    foot = max(alone, key=lambda g: len(alone[g]))
    return foot, alone[foot]


def test_a_foot_that_is_forgotten_in_a_walk_is_found(data):
    """The stance foot's contacts are taken away in two frames.

    These are marked, and its sites named.
    """
    model = read_osim(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    whole = differentiate(
        motion_from_table(read_sto(data("rajagopal-walk-emg/coordinates.sto")), model), 6.0
    )
    motion = whole.frames(np.arange(300, 900, 50))
    sites = foot_sites(model)
    ready = contact_activations(model, motion, sites, find_contacts(model, motion, sites))
    groups = np.array([one.group for one in sites])
    foot, frames = _frames_alone(ready.values, groups)
    gone = frames[:2]
    values = np.array(ready.values)
    values[gone] = np.where(groups == foot, 0.0, values[gone])
    results = {}
    for name, given in (("whole", ready.values), ("forgotten", values)):
        task = ContactTask(sites, Series(motion.time, ready.names, given))
        problem = tension_problem(
            TensionInputs(model, motion, inverse_dynamics(model, motion), contacts=task)
        )
        over_frames(problem.solve, len(motion), None, problem.window)
        tension = problem.result()
        assert tension.optimal.all()
        results[name] = relaxations(problem, tension)
    assert not {one.frame for one in results["whole"]} & set(gone.tolist())
    for one in results["forgotten"]:
        if one.frame in gone:
            named = {part.where for part in one.allowances if part.kind == "contact"}
            assert named == {foot}
    assert set(gone.tolist()) <= {one.frame for one in results["forgotten"]}


def test_contacts_are_needed():
    model = block()
    motion = standing_still(1)
    task = ContactTask(legs(TWO), Series(motion.time, ("leg0", "leg1"), np.ones((1, 2))))
    problem = tension_problem(
        TensionInputs(model, motion, inverse_dynamics(model, motion), contacts=task)
    )
    over_frames(problem.solve, 1)
    problem.contacts = None
    with pytest.raises(BadData, match="there are no contacts"):
        relaxations(problem, problem.result())


def test_a_force_within_45_degrees_of_the_vertical_is_called_so():
    up = np.array([0.0, 1.0, 0.0])
    zero = np.zeros(3)
    for share, way in (
        (0.705, "upward"),
        (0.695, "sideways"),
        (-0.695, "sideways"),
        (-0.705, "downward"),
    ):
        force = 200.0 * np.array([np.sqrt(1.0 - share**2), share, 0.0])
        assert (
            missing_words((), force, zero, up) == f"no site may touch, but 200 N {way} are needed"
        )
    assert "a moment of 9 N m is needed beside" in missing_words(["heel"], 8.0 * up, 9.0 * up, up)


def test_each_allowance_is_named_with_its_number_and_unit():
    given = (
        Allowance("contact", "hand", 50.0, needed=0.031),
        Allowance("friction", "foot", 20.0, needed=0.84),
        Allowance("friction", "foot", 20.0, needed=np.inf),
        Allowance("most", "foot", 30.0),
        Allowance("pull", "foot", 40.0),
        Allowance(kind="residual", where="pelvis", force=7.0, moment=6.0),
        Allowance(kind="residual", where="pelvis", force=6.0, moment=7.0),
    )
    assert (
        what_would_do(given)
        == "contact of 'hand' (31 mm above its support) and friction of 0.84 at 'foot' and 20 N"
        " across the cone of 'foot' and 30 N more at 'foot' than its greatest force and a pull"
        " of 40 N at 'foot' and 7 N at 'pelvis' without a support and 7 N m at 'pelvis' without a"
        " support would do"
    )
