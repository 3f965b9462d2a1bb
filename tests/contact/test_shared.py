"""What plates show of several sites.

Two feet on one, one foot on several, and walks with a plate for every foot.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from measured_walk import measured_walk
from myomorph.core.contact.plan import ContactPlan
from myomorph.core.contact.plate_forces import PlateForces
from myomorph.core.contact.plates import wrenches_from_plates
from myomorph.core.contact.shared import misplaced_forces, shared_wrenches, without_measured
from myomorph.core.contact.site_motion import site_motion
from myomorph.core.contact.states import contact_activations, find_contacts
from myomorph.core.model.contacts import ContactForces, Contacts, Site, Touch
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.series import ForcePlate, Wrenches
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.tension.contact_setting import Measurements, set_contacts
from myomorph.core.tension.terms.contacts import ContactOptions
from truths.carried_bodies import assign_feet


@pytest.fixture(scope="module")
def walk(data):
    one = measured_walk(data)
    wrenches = resample_wrenches(one.loads, one.motion.time, 20.0)
    return (
        one.model,
        one.motion,
        one.sites,
        wrenches,
        find_contacts(one.model, one.motion, one.sites),
    )


def plate_of(wrenches, columns, corners, name="plate"):
    """Make a plate with an outline that measured some wrenches together, on their clock."""
    force = wrenches.forces[:, columns].sum(axis=1)
    moment = (wrenches.torques + np.cross(wrenches.points, wrenches.forces))[:, columns].sum(axis=1)
    firm = force[:, 1] > 20.0
    with np.errstate(divide="ignore", invalid="ignore"):
        point = np.column_stack([moment[:, 2], np.zeros(len(force)), -moment[:, 0]]) / force[:, 1:2]
    point = np.where(firm[:, None], point, np.nan)
    return ForcePlate(
        name=name,
        kind=2,
        corners=corners,
        forces=force,
        points=point,
        torques=moment - np.cross(np.nan_to_num(point), force),
    )


def within(plate, start, stop):
    """Clip the plate's centers of pressure between two positions along x.

    They are then as over its own outline.
    """
    points = np.array(plate.points)
    points[:, 0] = np.clip(points[:, 0], start + 1e-6, stop - 1e-6)
    return replace(plate, points=points)


def outlined(time, *plates, body=""):
    """Return the forces of plates with outlines."""
    return PlateForces(
        replace(wrenches_from_plates(plates, time), bodies=(body,) * len(plates)),
        FrozenMap({plate.name: plate.corners for plate in plates}),
    )


def box(x0, x1, z0, z1):
    return np.array([[x1, 0.0, z1], [x0, 0.0, z1], [x0, 0.0, z0], [x1, 0.0, z0]], dtype=float)


def test_two_feet_on_one_plate_share_it(walk):
    """In double support both feet's sites are on the wrench.

    In single support only those of one foot are.
    """
    model, motion, sites, wrenches, contacts = walk
    plate = plate_of(wrenches, [0, 1], box(-5.0, 5.0, -5.0, 5.0))
    found = shared_wrenches(model, motion, sites, contacts, outlined(motion.time, plate))
    states = contacts.states(motion.time).values > 0.0
    total = np.zeros(len(motion))
    for one in found:
        known = np.isfinite(one.forces).all(axis=1)
        members = [k for k, site in enumerate(sites) if site.name in one.sites]
        total[known] += 1
        assert states[np.ix_(known, members)].all()
        others = [k for k in range(len(sites)) if k not in members]
        assert not states[np.ix_(known, others)].any()
        assert_allclose(one.forces[known], plate.forces[known], atol=1e-9)
        moment = plate.torques + np.cross(np.nan_to_num(plate.points), plate.forces)
        assert_allclose(one.moments[known], moment[known], atol=1e-6)
    assert total.max() == 1
    assert {name[-1] for one in found for name in one.sites} == {"r", "l"}
    assert any({name[-1] for name in one.sites} == {"r", "l"} for one in found)


def members_of(found, frames):
    """Names of the sites that share a plate, by frame."""
    members = [set() for _ in range(frames)]
    for one in found:
        for frame in np.flatnonzero(np.isfinite(one.forces).all(axis=1)):
            members[frame] |= set(one.sites)
    return members


@pytest.mark.parametrize("body", ["", "calcn_r", "calcn_l"])
def test_a_plate_of_two_feet_is_shared_however_it_is_given(walk, body):
    """As a plate with an outline, as a table, and as external loads that put it on one foot."""
    model, motion, sites, wrenches, contacts = walk
    plate = plate_of(wrenches, [0, 1], box(-5.0, 5.0, -5.0, 5.0))
    by_outline = shared_wrenches(model, motion, sites, contacts, outlined(motion.time, plate))
    loads = Wrenches(
        time=motion.time,
        names=("plate",),
        bodies=(body,),
        forces=plate.forces[:, None],
        points=plate.points[:, None],
        torques=plate.torques[:, None],
    )
    given = shared_wrenches(model, motion, sites, contacts, PlateForces(loads))
    same = np.equal(members_of(by_outline, len(motion)), members_of(given, len(motion)))
    assert same.mean() > 0.95


def _setting_on(walk, plate):
    """Return the contacts of the walk on one plate whose force is shared."""
    model, motion = walk[:2]
    plates = outlined(motion.time, plate)
    known = Measurements(recorded=motion, wrenches=plates.wrenches, plates=plates)
    return set_contacts(ContactPlan(measured="shared"), model, motion, known, ContactOptions())


def test_a_foot_alone_on_a_shared_plate_has_what_that_measured(walk):
    """Only while two feet are on a plate its force is divided; else it acts as it was measured."""
    plate = plate_of(walk[3], [0, 1], box(-5.0, 5.0, -5.0, 5.0))
    setting = _setting_on(walk, plate)
    assert setting.alone is not None
    alone = setting.alone.forces
    assert set(alone.names) == {"foot_r", "foot_l"}
    assert set(alone.bodies) == {"calcn_r", "calcn_l"}
    carried = np.abs(alone.forces).any(axis=2)
    assert carried.any(axis=1).mean() > 0.5
    assert carried.sum(axis=1).max() == 1
    moment = plate.torques + np.cross(np.nan_to_num(plate.points), plate.forces)
    found = alone.torques + np.cross(alone.points, alone.forces)
    for column, name in enumerate(alone.names):
        frames = carried[:, column]
        assert_allclose(alone.forces[frames, column], plate.forces[frames], atol=1e-9)
        assert_allclose(found[frames, column], moment[frames], atol=1e-6)
        members = [k for k, site in enumerate(setting.task.sites) if site.group == name]
        ready = setting.task.activations.values[np.ix_(frames, members)]
        assert not ready.any(), "nothing is estimated in its place"
    for shared in setting.task.measured:
        groups = {site.group for site in setting.task.sites if site.name in shared.sites}
        assert len(groups) == 2
        assert not (np.isfinite(shared.forces).any(axis=1) & carried.any(axis=1)).any()


def test_known_forces_are_shown_at_the_foot_that_bore_them(walk):
    _, motion, _, wrenches, _ = walk
    plate = plate_of(wrenches, [0, 1], box(-5.0, 5.0, -5.0, 5.0))
    setting = _setting_on(walk, plate)
    sites = setting.task.sites
    nothing = np.zeros((len(motion), len(sites), 3))
    estimated = ContactForces(
        time=motion.time,
        sites=sites,
        contact_activation=setting.task.activations.values,
        contact_force=nothing,
        contact_point=nothing,
        contact_torque=nothing,
    )
    shown = setting.with_known(estimated).wrenches("body")
    alone = setting.alone.forces
    for column, body in enumerate(alone.bodies):
        place = shown.bodies.index(body)
        frames = alone.forces[:, column].any(axis=1)
        assert_allclose(shown.forces[:, place], alone.forces[:, column], atol=1e-9)
        assert_allclose(shown.points[frames, place], alone.points[frames, column], atol=1e-9)
        assert_allclose(shown.torques[frames, place], alone.torques[frames, column], atol=1e-6)


def test_hands_that_hold_a_box_stand_on_no_plate(walk):
    """While plates carry the whole body, a hand that touches a box is none of theirs."""
    model, motion, sites, wrenches, contacts = walk
    plate = plate_of(wrenches, [0, 1], box(-5.0, 5.0, -5.0, 5.0))
    hand = Site("hand", "hand_r", [[0.0, -0.08, 0.0]], against="torso", group="hands")
    holding = Touch(
        site="hand",
        start=float(motion.time[0]),
        stop=float(motion.time[-1]),
        surface="torso",
    )
    loads = Wrenches(
        time=motion.time,
        names=("plate",),
        bodies=("",),
        forces=plate.forces[:, None],
        points=plate.points[:, None],
        torques=plate.torques[:, None],
    )
    both = Contacts((*contacts.sites, "hand"), (*contacts.intervals, holding))
    found = shared_wrenches(model, motion, (*sites, hand), both, PlateForces(loads))
    assert found
    assert all("hand" not in one.sites for one in found)


def test_wrenches_that_name_bodies_belong_to_their_foot(walk):
    model, motion, sites, wrenches, contacts = walk
    found = shared_wrenches(model, motion, sites, contacts, PlateForces(wrenches))
    assert len({one.name for one in found}) == len(found)
    for one in found:
        side = "r" if one.name.startswith("Right") else "l"
        assert all(name.endswith(f"_{side}") for name in one.sites)


def test_a_foot_on_two_plates_belongs_to_their_sum_where_it_straddles(walk):
    """The right foot's force is split over two plates whose border it stands on.

    The parts are joined again.
    """
    model, motion, sites, wrenches, contacts = walk
    places = site_motion(model, motion, sites).places
    right = [one.group == "foot_r" for one in sites]
    loaded = wrenches.forces[:, 0, 1] > 0.3 * model.mass * 9.81
    middle = places[loaded][:, right, 0].mean()
    plates = outlined(motion.time, *_halves(wrenches, middle))
    found = shared_wrenches(model, motion, sites, contacts, plates, margin=0.3)
    both = [one.forces for one in found if one.name.startswith("rear + front")]
    assert both
    for forces in both:
        known = np.isfinite(forces).all(axis=1)
        assert_allclose(forces[known], wrenches.forces[known, 0], atol=1e-9)
    narrow = shared_wrenches(model, motion, sites, contacts, plates, margin=0.0)
    assert {one.name.split(" (")[0] for one in narrow} == {"rear", "front"}
    for one in narrow:
        known = np.isfinite(one.forces).all(axis=1)
        ahead = places[known][:, [site.name in one.sites for site in sites], 0] > middle
        assert ahead.all() if one.name.startswith("front") else not ahead.any()


def _halves(wrenches, border):
    """Split the first force over two plates with a border at x [m]."""
    halves = replace(
        wrenches,
        names=("rear", "front"),
        bodies=("", ""),
        forces=np.repeat(0.5 * wrenches.forces[:, :1], 2, axis=1),
        torques=np.repeat(0.5 * wrenches.torques[:, :1], 2, axis=1),
        points=np.repeat(wrenches.points[:, :1], 2, axis=1),
    )
    spans = (("rear", (-5.0, border)), ("front", (border, 5.0)))
    return tuple(
        within(plate_of(halves, [k], box(*span, -5.0, 5.0), name), *span)
        for k, (name, span) in enumerate(spans)
    )


def test_unloaded_plates_tell_nothing(walk):
    model, motion, sites, wrenches, contacts = walk
    empty = replace(wrenches, forces=0.0 * wrenches.forces, torques=0.0 * wrenches.torques)
    assert shared_wrenches(model, motion, sites, contacts, PlateForces(empty)) == ()


def test_a_measured_foot_is_not_estimated_too(walk):
    """It is not, while its plate carries it, whichever bone of the foot the file names.

    Next to the plate it is estimated.
    """
    model, motion, sites, wrenches, contacts = walk
    ready = contact_activations(model, motion, sites, contacts)
    right = [k for k, one in enumerate(sites) if one.group == "foot_r"]
    load = wrenches.forces[:, 0, 1] / (model.mass * 9.81)
    beside = motion.time > 1.2
    ringing = np.where(beside[:, None], 1e-3 * wrenches.forces[:, 0], wrenches.forces[:, 0])
    for bone in ("calcn_r", "talus_r", "toes_r"):
        forces = np.stack([ringing, wrenches.forces[:, 1]], axis=1)
        left_over = without_measured(
            model, ready, sites, replace(wrenches, bodies=(bone, "calcn_l"), forces=forces)
        )
        assert not left_over.values[np.ix_((load > 0.03) & ~beside, right)].any()
        assert (
            left_over.values[np.ix_(beside, right)] == ready.values[np.ix_(beside, right)]
        ).all()
        assert ready.values[np.ix_(beside, right)].any()


def test_plates_are_given_to_feet(walk):
    model, motion, sites, wrenches, _ = walk
    crossed = replace(wrenches, names=("one", "two"), bodies=("talus_r", "talus_r"))
    loaded = (crossed.forces[..., 1] > 20.0)[..., None]
    crossed = replace(crossed, forces=np.where(loaded, crossed.forces, 0.0))
    found = assign_feet(model, motion, sites, crossed)
    assert dict(zip(found.wrenches.names, found.wrenches.bodies, strict=True)) == {
        "one": "calcn_r",
        "two": "calcn_l",
    }


def test_a_force_on_the_wrong_foot_is_told(walk):
    """As in a file that puts all plates on the right talus."""
    model, motion, sites, wrenches, _ = walk
    assert misplaced_forces(model, motion, sites, wrenches) == ()
    (note,) = misplaced_forces(
        model, motion, sites, replace(wrenches, bodies=("talus_r", "talus_r"))
    )
    assert note.startswith(f"force '{wrenches.names[1]}' is put on 'talus_r'")
    assert "'foot_l'" in note


def test_a_named_plate_carries_its_own_foot_alone(walk):
    """Others that stand over its outline have no part in what it measured."""
    model, motion, sites, wrenches, contacts = walk
    plate = plate_of(wrenches, [0, 1], box(-5.0, 5.0, -5.0, 5.0))
    plates = outlined(motion.time, plate, body="calcn_r")
    found = shared_wrenches(model, motion, sites, contacts, plates)
    assert found
    assert {name[-1] for one in found for name in one.sites} == {"r"}


def test_an_outline_that_lies_elsewhere_is_not_trusted(walk):
    """Forces that were turned to the motion are shared by where they act."""
    model, motion, sites, wrenches, contacts = walk
    near = outlined(motion.time, plate_of(wrenches, [0, 1], box(-5.0, 5.0, -5.0, 5.0)))
    far = outlined(motion.time, plate_of(wrenches, [0, 1], box(20.0, 21.0, 20.0, 21.0)))
    right = members_of(shared_wrenches(model, motion, sites, contacts, near), len(motion))
    found = members_of(shared_wrenches(model, motion, sites, contacts, far), len(motion))
    assert np.equal(right, found).mean() > 0.95


def test_clocks_must_agree(walk):
    model, motion, sites, wrenches, contacts = walk
    short = PlateForces(resample_wrenches(wrenches, motion.time[:-5]))
    with pytest.raises(BadData, match="resample them"):
        shared_wrenches(model, motion, sites, contacts, short)
