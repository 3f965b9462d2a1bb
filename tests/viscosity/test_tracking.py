"""Bones from clusters: the truth is recovered, in any laboratory.

What is wrong with markers is named.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from swung_specimen import HELD, Release, Swung, arm_model, arm_specimen, markers_of, swing

from myomorph.core.io.formats import read_model
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Markers
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.swings.simulate.limb import with_clusters
from myomorph.swings.viscosity.specimen.model import SpecimenNames, SwingTrial, build_specimen
from myomorph.swings.viscosity.specimen.muscles import fig1_muscles
from myomorph.swings.viscosity.tracking.track import track
from myomorph.swings.viscosity.tracking.tracked import TrackedSpecimen, TrackingOptions

MARKERS_ONLY = TrackingOptions(clock=False, find_contact=False, center="model")
SPECIMEN = arm_specimen()


@lru_cache(maxsize=1)
def swung() -> Swung:
    return swing(SPECIMEN, Release(seconds=3.0))


def with_markers(trial: SwingTrial, change) -> SwingTrial:
    """Return the trial with its marker values changed: `change(values, column of a name)`."""
    values = np.array(trial.markers.values)
    change(values, {name: i for i, name in enumerate(trial.markers.names)})
    return replace(trial, markers=replace(trial.markers, values=values))


def _rotations(tracked: TrackedSpecimen, trial: int = 0) -> Array:
    """(frames, 3, 3) of the humerus in ground."""
    pendulum = compile_tree(tracked.specimen.pendulum)
    return forward_kinematics(
        pendulum, pendulum.coordinates_of(tracked.trials[trial].motion)
    ).rotations[:, 1]


def _apart(one: Array, other: Array) -> Array:
    """(frames,) angles between rotations [degrees]."""
    return np.degrees(2.0 * np.arcsin(np.linalg.norm(one - other, axis=(1, 2)) / np.sqrt(8.0)))


def test_exact_markers_give_the_exact_motion_base_and_held_angles():
    truth = swung()
    tracked = track(SPECIMEN, [truth.trial], MARKERS_ONLY)
    assert _apart(_rotations(tracked), truth.rotations).max() < 1e-5
    assert tracked.held == pytest.approx(HELD, abs=1e-7)
    np.testing.assert_allclose(
        tracked.specimen.center_in_ground, SPECIMEN.center_in_ground, atol=1e-8
    )
    assert tracked.trials[0].rms.max() < 1e-8
    assert not tracked.slips
    assert not tracked.trials[0].notes


def test_noise_of_a_third_of_a_millimeter():
    """Clusters with arms of 30 to 50 mm; the limb's twelve markers together, frame by frame."""
    truth = swung()
    rng = np.random.default_rng(3)
    noisy = with_markers(
        truth.trial,
        lambda values, _: np.add(values, 3e-4 * rng.normal(size=values.shape), out=values),
    )
    tracked = track(SPECIMEN, [noisy], MARKERS_ONLY)
    error = np.degrees(
        Rotation.from_matrix(
            np.einsum("fji,fjk->fik", truth.rotations, _rotations(tracked))
        ).as_rotvec()
    )
    # About the humerus' length the clusters' width counts, about the others the limb's length.
    assert np.sqrt(np.mean(error**2, axis=0)) == pytest.approx([0.017, 0.105, 0.013], rel=0.25)
    assert np.degrees(max(abs(tracked.held[name] - HELD[name]) for name in HELD)) < 0.03
    assert np.linalg.norm(tracked.specimen.center_in_ground - SPECIMEN.center_in_ground) < 2e-5


def test_a_turned_laboratory_changes_nothing():
    truth = swung()
    turn = Rotation.from_rotvec([0.4, -1.9, 0.8]).as_matrix()
    trial = truth.trial
    wrenches = replace(
        trial.wrenches,
        **{
            name: getattr(trial.wrenches, name) @ turn.T for name in ("forces", "points", "torques")
        },
    )
    turned = replace(trial, markers=trial.markers.rotated(turn), wrenches=wrenches)
    here = track(SPECIMEN, [trial], MARKERS_ONLY)
    there = track(SPECIMEN.turned(turn), [turned], MARKERS_ONLY)
    np.testing.assert_allclose(
        there.trials[0].motion.values, here.trials[0].motion.values, atol=1e-7
    )
    np.testing.assert_allclose(_rotations(there), turn @ _rotations(here), atol=1e-7)
    moved = here.trials[0].wrench.reshape(-1, 2, 3) @ turn.T
    np.testing.assert_allclose(there.trials[0].wrench.reshape(-1, 2, 3), moved, atol=1e-6)


def test_a_base_whose_angles_would_be_singular_is_tracked_as_any_other():
    for angles in ((0.0, np.pi / 2, 0.0), (3.0, -np.pi / 2, 1.0)):
        turn = Rotation.from_euler("XYZ", angles).as_matrix()
        truth = swung()
        turned = replace(truth.trial, markers=truth.trial.markers.rotated(turn))
        tracked = track(SPECIMEN, [turned], MARKERS_ONLY)
        assert _apart(_rotations(tracked), turn @ truth.rotations).max() < 1e-5


@pytest.mark.parametrize("part", [slice(None), slice(200, 420)])
@pytest.mark.parametrize(
    ("one", "other"), [("humerus_1", "humerus_3"), ("ulna_2", "radius_2"), ("scapula_1", "hand_3")]
)
def test_swapped_markers_are_put_right(one, other, part):
    truth = swung()

    def exchange(values, column):
        first = values[part, column[one]].copy()
        values[part, column[one]] = values[part, column[other]]
        values[part, column[other]] = first

    tracked = track(SPECIMEN, [with_markers(truth.trial, exchange)], MARKERS_ONLY)
    assert _apart(_rotations(tracked), truth.rotations).max() < 1e-5
    (note,) = tracked.trials[0].notes
    assert f"'{one}' and '{other}'" in note
    assert "corrected" in note
    assert ("throughout" if part == slice(None) else "between 1.00 and 2.10 s") in note


def test_two_clusters_with_swapped_markers_at_once():
    truth = swung()

    def exchange(values, column):
        for one, other in (("humerus_1", "humerus_2"), ("hand_1", "hand_3")):
            a = column[one]
            b = column[other]
            values[:, a], values[:, b] = values[:, b].copy(), values[:, a].copy()

    tracked = track(SPECIMEN, [with_markers(truth.trial, exchange)], MARKERS_ONLY)
    assert _apart(_rotations(tracked), truth.rotations).max() < 1e-5
    assert len(tracked.trials[0].notes) == 2


def test_a_lost_marker_leaves_the_bone_solved():
    truth = swung()

    def hide(values, column):
        values[100:400, column["humerus_2"]] = np.nan
        values[300:350, column["scapula_1"]] = np.nan

    tracked = track(SPECIMEN, [with_markers(truth.trial, hide)], MARKERS_ONLY)
    assert _apart(_rotations(tracked), truth.rotations).max() < 1e-5
    notes = " ".join(tracked.trials[0].notes)
    assert (
        "'humerus_2' is hidden in 300 frames between 0.50 and 2.00 s; 'humerus' has 2 left" in notes
    )


def test_a_whole_cluster_lost_follows_the_bones_beside_it():
    truth = swung()

    def hide(values, column):
        for i in (1, 2, 3):
            values[200:400, column[f"humerus_{i}"]] = np.nan

    tracked = track(SPECIMEN, [with_markers(truth.trial, hide)], MARKERS_ONLY)
    assert _apart(_rotations(tracked), truth.rotations).max() < 1e-5
    assert any("'humerus' has 0 left" in note for note in tracked.trials[0].notes)
    assert not tracked.slips


def test_nothing_of_the_limb_seen_is_no_pose():
    truth = swung()

    def hide(values, column):
        for name, i in column.items():
            if not name.startswith("scapula"):
                values[200:260, i] = np.nan

    tracked = track(SPECIMEN, [with_markers(truth.trial, hide)], MARKERS_ONLY)
    lost = ~np.isfinite(tracked.trials[0].motion.values).all(axis=1)
    assert lost[200:260].all()
    assert not lost[:200].any()
    assert not lost[260:].any()


def test_a_marker_that_is_not_on_its_bone_is_left_out():
    truth = swung()
    tracked = track(
        SPECIMEN,
        [
            with_markers(
                truth.trial,
                lambda values, column: values[150:250, column["radius_1"]].__iadd__(0.03),
            )
        ],
        MARKERS_ONLY,
    )
    assert _apart(_rotations(tracked), truth.rotations).max() < 1e-5
    assert any(
        "'radius_1' is off its cluster in 100 frames" in note for note in tracked.trials[0].notes
    )


def test_another_cluster_than_the_models_is_refused():
    truth = swung()

    def grow(values, column):
        own = [column[f"ulna_{i}"] for i in (1, 2, 3)]
        middle = values[:, own].mean(axis=1, keepdims=True)
        values[:, own] = middle + 1.3 * (values[:, own] - middle)

    with pytest.raises(BadData, match="the markers of 'ulna' are not the model's cluster"):
        track(SPECIMEN, [with_markers(truth.trial, grow)], MARKERS_ONLY)


@pytest.mark.parametrize(("joint", "by"), [("elbow", 0.12), ("wrist_a", -0.2)])
def test_a_wire_that_slips_is_named_and_followed(joint, by):
    truth = swung()
    time = truth.trial.markers.time
    after = markers_of(SPECIMEN, time, truth.rotations, HELD | {joint: HELD[joint] + by})
    values = np.where((time > 1.8)[:, None, None], after.values, truth.trial.markers.values)
    slipped = replace(truth.trial, markers=Markers(time, after.names, values))
    whole = replace(truth.trial, name="whole")
    tracked = track(SPECIMEN, [slipped, whole], MARKERS_ONLY)
    (slip,) = tracked.slips
    assert (slip.trial, slip.what, slip.lasting) == ("swing", joint, True)
    assert slip.time == pytest.approx(1.8, abs=0.05)
    assert slip.amount == pytest.approx(abs(by), rel=0.05)
    assert _apart(_rotations(tracked), truth.rotations).max() < 1e-3
    assert any("a wire slipped" in note for note in tracked.trials[0].notes)
    assert not tracked.trials[1].notes


@pytest.mark.parametrize("bone", ["scapula", "humerus", "ulna", "radius", "hand"])
def test_a_cluster_that_slips_is_named_by_its_bone_and_put_back(bone):
    truth = swung()
    by = np.array([3e-3, -4e-3, 0.0])

    turn = (
        np.broadcast_to(SPECIMEN.stand.rotation, truth.rotations.shape)
        if bone == "scapula"
        else truth.rotations
    )

    def slip(first: int, values: Array, column: dict[str, int]) -> None:
        own = [i for name, i in column.items() if name.startswith(bone)]
        values[first:, own] += (turn[first:] @ by)[:, None]

    trials = [truth.trial, replace(truth.trial, name="later")]
    slipped = [
        with_markers(trial, partial(slip, first))
        for trial, first in zip(trials, (330, 0), strict=True)
    ]
    tracked = track(SPECIMEN, slipped, MARKERS_ONLY)
    (found,) = tracked.slips
    assert (found.trial, found.what, found.cluster) == ("swing", bone, True)
    assert found.amount == pytest.approx(5e-3, rel=0.15)
    assert found.time == pytest.approx(1.65, abs=0.01)
    for number in range(2):
        assert _apart(_rotations(tracked, number), truth.rotations).max() < 0.02
    assert f"the cluster of '{bone}' slips on its bone by" in tracked.trials[0].notes[0]


def test_a_base_that_moves_on_its_plate_is_named_and_followed():
    truth = swung()
    moved = with_markers(truth.trial, lambda values, _: values[350:].__iadd__([0.0, 0.0, 0.006]))
    tracked = track(SPECIMEN, [moved], MARKERS_ONLY)
    (slip,) = tracked.slips
    assert (slip.what, slip.unit) == ("base", "m")
    assert slip.amount == pytest.approx(0.006, rel=0.01)
    assert "the base moves by 6.0 mm, most at 1.75 s" in tracked.trials[0].notes[0]
    assert _apart(_rotations(tracked), truth.rotations).max() < 1e-3


def test_what_moves_between_two_trials_is_named_and_followed():
    truth = swung()
    time = truth.trial.markers.time
    other = markers_of(SPECIMEN, time, truth.rotations, HELD | {"elbow": HELD["elbow"] + 0.1})
    values = other.values + np.array([0.01, 0.0, 0.0])
    later = replace(truth.trial, name="later", markers=Markers(time, other.names, values))
    tracked = track(
        SPECIMEN, [truth.trial, replace(truth.trial, name="again"), later], MARKERS_ONLY
    )
    found = {(slip.trial, slip.what, slip.before) for slip in tracked.slips}
    assert found >= {("later", "elbow", True), ("later", "base", True)}
    assert _apart(_rotations(tracked, 2), truth.rotations).max() < 1e-3
    assert any(
        "'elbow' is 3.8 degrees away from its position in the other" in one
        for one in tracked.trials[2].notes
    )


def test_markers_that_the_model_does_not_name():
    truth = swung()
    other = replace(truth.trial.markers, names=tuple(f"m{i}" for i in range(15)))
    with pytest.raises(
        BadData, match="0 markers of the base 'scapula' are recorded, of which three are needed"
    ):
        track(SPECIMEN, [replace(truth.trial, markers=other)], MARKERS_ONLY)
    with pytest.raises(BadData, match="no trial"):
        track(SPECIMEN, [])


def test_the_wrench_is_moved_to_the_center_and_to_the_markers_clock():
    truth = swung()
    tracked = track(SPECIMEN, [truth.trial], MARKERS_ONLY)
    wrench = tracked.trials[0].wrench
    joint = np.einsum("fij,fj->fi", truth.rotations, -truth.damping * truth.rates)
    inside = slice(20, -20)
    np.testing.assert_allclose(wrench[inside, :3], joint[inside], atol=2e-4)
    # The same wrench by another point of application.
    given = truth.trial.wrenches
    shift = np.array([0.3, -0.2, 0.1])
    elsewhere = replace(
        given, points=given.points + shift, torques=given.torques - np.cross(shift, given.forces)
    )
    again = track(SPECIMEN, [replace(truth.trial, wrenches=elsewhere)], MARKERS_ONLY)
    np.testing.assert_allclose(again.trials[0].wrench, wrench, atol=1e-9)


def test_the_fixture_is_taken_off_as_tare():
    truth = swung()
    given = truth.trial.wrenches
    fixture = np.array([3.0, 40.0, -2.0]), np.array([0.3, 0.0, 1.2]), np.array([0.4, -0.1, 0.9])

    def added(forces: Array, points: Array, torques: Array):
        force = forces + fixture[0]
        moment = torques + np.cross(points, forces)
        total = moment + fixture[1] + np.cross(fixture[2], fixture[0])
        return replace(given, forces=force, points=np.zeros_like(points), torques=total)

    loaded = added(given.forces, given.points, given.torques)
    tare = added(0.0 * given.forces, given.points, 0.0 * given.torques)
    plain = track(SPECIMEN, [truth.trial], MARKERS_ONLY).trials[0].wrench
    tared = (
        track(SPECIMEN, [replace(truth.trial, wrenches=loaded, tare=tare)], MARKERS_ONLY)
        .trials[0]
        .wrench
    )
    np.testing.assert_allclose(tared, plain, atol=1e-8)


def test_a_plate_that_recorded_at_another_time_is_refused():
    truth = swung()
    late = replace(truth.trial.wrenches, time=truth.trial.wrenches.time + 100.0)
    with pytest.raises(BadData, match="have no time in common"):
        track(SPECIMEN, [replace(truth.trial, wrenches=late)], MARKERS_ONLY)


def test_a_center_beside_the_model_is_told_and_can_be_used():
    truth = swung()
    shift = np.array([0.004, -0.006, 0.003])
    wrong = SPECIMEN.centered(SPECIMEN.center + shift, SPECIMEN.center_in_limb)
    told = track(wrong, [truth.trial], MARKERS_ONLY)
    assert (
        "7.8 mm from the joint's center of the model (set center to 'motion' to use it)"
        in told.notes[0]
    )
    np.testing.assert_allclose(told.specimen.center, wrong.center)
    used = track(wrong, [truth.trial], replace(MARKERS_ONLY, center="motion"))
    np.testing.assert_allclose(used.specimen.center, SPECIMEN.center, atol=1e-8)
    np.testing.assert_allclose(used.specimen.center_in_limb, SPECIMEN.center_in_limb, atol=1e-8)
    assert _apart(_rotations(used), truth.rotations).max() < 1e-5


def test_a_hinge_is_tracked_through_whole_turns():
    specimen = with_clusters(
        build_specimen(
            arm_model(), SpecimenNames("humerus", "ulna", ("radius", "hand"), joint="hinge")
        )
    )
    tree = compile_tree(specimen.model)
    time = 0.005 * np.arange(600)
    values = np.tile(tree.defaults, (600, 1))
    angle = 1.5 + 2.0 * np.sin(3.0 * time)
    values[:, specimen.model.coordinate_names.index("ulna_angle")] = angle
    poses = forward_kinematics(tree, values)
    bodies = np.array([tree.body_index[one.body] for one in specimen.model.markers])
    places = poses.points(bodies, np.array([one.location for one in specimen.model.markers]))
    trial = replace(swung().trial, markers=Markers(time, specimen.model.marker_names, places))
    tracked = track(specimen, [trial], MARKERS_ONLY)
    np.testing.assert_allclose(tracked.trials[0].motion["ulna_angle"], angle, atol=1e-7)


@pytest.mark.parametrize(
    ("bone", "part"),
    [("scapula", slice(None)), ("humerus", slice(None)), ("radius", slice(200, 420))],
)
def test_markers_swapped_in_a_cluster_of_two_like_sides_are_put_right(bone, part):
    """Distances are the same then; the bone seems turned over, away from its joints."""
    like = np.array([[0.05, 0.0], [-0.03, 0.03], [-0.03, -0.03]])
    middles = {
        one.name[:-2]: one.location for one in SPECIMEN.model.markers if one.name.endswith("_1")
    }
    specimen = SPECIMEN.with_markers(
        tuple(
            replace(one, location=middles[one.body] + [*like[int(one.name[-1]) - 1], 0.0])
            for one in SPECIMEN.model.markers
        )
    )
    truth = swung()
    markers = markers_of(specimen, truth.trial.markers.time, truth.rotations, HELD)
    trial = replace(truth.trial, markers=markers)

    def exchange(values, column):
        two = column[f"{bone}_2"]
        three = column[f"{bone}_3"]
        values[part, two], values[part, three] = (
            values[part, three].copy(),
            values[part, two].copy(),
        )

    tracked = track(specimen, [with_markers(trial, exchange)], MARKERS_ONLY)
    assert _apart(_rotations(tracked), truth.rotations).max() < 1e-5
    (note,) = tracked.trials[0].notes
    assert f"'{bone}_2' and '{bone}_3' are exchanged" in note


def test_two_trials_of_one_name_are_two_trials():
    truth = swung()
    time = truth.trial.markers.time
    after = markers_of(SPECIMEN, time, truth.rotations, HELD | {"elbow": HELD["elbow"] + 0.12})
    values = np.where((time > 1.8)[:, None, None], after.values, truth.trial.markers.values)
    slipped = replace(truth.trial, markers=Markers(time, after.names, values))
    tracked = track(SPECIMEN, [slipped, truth.trial], MARKERS_ONLY)
    assert len(tracked.slips) == 1
    assert tracked.trials[0].notes
    assert not tracked.trials[1].notes


def test_markers_that_blink_are_told_in_one_line():
    truth = swung()
    rng = np.random.default_rng(2)

    def blink(values, column):
        values[rng.random(values.shape[:2]) < 0.03] = np.nan

    tracked = track(SPECIMEN, [with_markers(truth.trial, blink)], MARKERS_ONLY)
    assert _apart(_rotations(tracked), truth.rotations).max() < 1e-5
    assert not tracked.slips
    (note,) = tracked.trials[0].notes
    assert "15 markers are hidden now and then" in note


def test_the_thoracoscapular_shoulder_with_a_hand_that_its_model_welds(data):
    model = read_model(data("shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim"))
    names = SpecimenNames(
        base="scapula",
        first="humerus",
        bones=("ulna", "radius", "hand"),
        muscles=fig1_muscles(model),
    )
    specimen = with_clusters(build_specimen(model, names))
    held = {"elbow_flexion": 0.3, "pro_sup": 0.9, "hand_rx": 0.4, "hand_ry": -0.3, "hand_rz": 0.2}
    time = 0.005 * np.arange(600)
    sway = np.stack(
        [0.5 * np.sin(5.0 * time), 0.3 * np.sin(2.0 * time), 0.4 * np.cos(4.6 * time)], axis=1
    )
    turned = (
        Rotation.from_rotvec(sway).as_matrix()
        @ Rotation.from_euler("XYZ", [0.2, 0.8, 0.1]).as_matrix()
    )
    markers = markers_of(specimen, time, turned, held)
    tracked = track(specimen, [replace(swung().trial, markers=markers)], MARKERS_ONLY)
    assert tracked.held == pytest.approx(held, abs=1e-7)
    assert _apart(_rotations(tracked), turned).max() < 1e-5


def test_places_of_markers_and_the_center_come_from_the_motion_where_the_model_has_them_wrong():
    truth = swung()
    random = np.random.default_rng(1)
    off = {one.name: one.location + 1e-3 * random.normal(size=3) for one in SPECIMEN.model.markers}
    limb = set(SPECIMEN.limb)
    markers = tuple(
        replace(one, location=off[one.name]) if one.body in limb else one
        for one in SPECIMEN.model.markers
    )
    wrong = SPECIMEN.with_markers(markers)
    wrong = wrong.centered(wrong.center + [0.002, -0.001, 0.001], wrong.center_in_limb)
    kept = track(wrong, [truth.trial], replace(MARKERS_ONLY, center="model"))
    used = track(wrong, [truth.trial], replace(MARKERS_ONLY, center="motion"))
    assert np.nanmax(kept.trials[0].rms) > 1e-3
    assert np.nanmax(used.trials[0].rms) < 2e-5
    np.testing.assert_allclose(used.specimen.center_in_ground, SPECIMEN.center_in_ground, atol=2e-5)
