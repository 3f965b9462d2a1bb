"""What fixes the zero of angles.

Laws of the gauge, the symmetry of the mean posture, static trials, and unequal legs.
"""

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.calibrate.angle_slopes import angle_slopes
from myomorph.body.calibrate.calibrate import calibrate
from myomorph.body.calibrate.calibration import STATIC, CalibrationOptions
from myomorph.body.calibrate.frame_sums import reduce, settle
from myomorph.body.calibrate.mean_posture import symmetric_posture
from myomorph.body.calibrate.shared_problem import BLOCKS, FrameSet, SharedProblem
from myomorph.body.calibrate.sliding_skin import Slide, sliding
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.fit.residuals import LinearPrior
from myomorph.core.model.model import Model
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import axis_rotation
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics, pose_problem
from myomorph.core.motion.lengths import factors_of, lengths_of
from myomorph.core.motion.stretch import stretch_of
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from stick_figure import stick_figure

TURN = np.radians(12.0)


def walk(model: Model, frames: int = 40, noise: float = 2e-3) -> Markers:
    """Of two periods; the left does what the right did half a period ago."""
    tree = compile_tree(model)
    names = [one.name for one in model.coordinates]
    phase = np.linspace(0.0, 4.0 * np.pi, frames, endpoint=False)
    q = np.zeros((frames, len(names)))
    for j, name in enumerate(names):
        late = np.pi if "_l_" in name else 0.0
        if name.startswith("tibia"):
            q[:, j] = -0.6 + 0.4 * np.sin(phase + late)
        elif name.startswith(("femur", "foot")):
            q[:, j] = (0.35 if name.endswith("r0") else 0.1) * np.sin(
                phase + late + len(name) + j % 2 * 0.3
            )
        elif name.startswith("torso"):
            q[:, j] = 0.1 * np.sin(phase)
    left = [names.index(name.replace("_r_", "_l_")) for name in names if "_r_" in name]
    right = [names.index(name) for name in names if "_r_" in name]
    q[:, left] = np.roll(q[:, right], frames // 4, axis=0)
    poses = forward_kinematics(tree, q)
    bodies = np.array([tree.body_index[one.body] for one in model.markers])
    places = poses.points(bodies, np.array([one.location for one in model.markers]))
    rng = np.random.default_rng(1)
    return Markers(
        np.arange(frames) / 50.0, model.marker_names, places + noise * rng.normal(size=places.shape)
    )


def with_turned_foot(model: Model, angle: float, axis: int = 2) -> Model:
    """Rotate the right foot's markers about its flexion axis, or another one."""
    turn = axis_rotation(np.eye(3)[axis], angle)
    return model.with_markers(
        tuple(
            replace(one, location=turn @ one.location) if one.body == "foot_r" else one
            for one in model.markers
        )
    )


def with_unequal_legs(model: Model, longer: float) -> Model:
    lengths = lengths_of(model)
    long = {"femur_r", "tibia_r"}
    values = np.array([1.0 + longer * (one.along and one.segment in long) for one in lengths])
    return scale(model, factors_of(lengths, values))


def test_turned_markers_turn_the_angle_and_leave_the_error():
    """The gauge: no recording of markers alone can tell a turned foot from a turned zero."""
    model = stick_figure()
    markers = walk(model)
    # about the last axis of the ankle, so that no other angle changes
    turned = with_turned_foot(model, TURN, axis=0)
    fits = [inverse_kinematics(one, markers, InverseKinematicsOptions()) for one in (model, turned)]
    # IK settles to a micrometer
    np.testing.assert_allclose(fits[1].marker_error, fits[0].marker_error, atol=1e-5)
    j = fits[0].motion.names.index("foot_r_r1")
    np.testing.assert_allclose(
        fits[1].motion.values[:, j], fits[0].motion.values[:, j] - TURN, atol=1e-4
    )


def test_symmetry_of_the_mean_posture_picks_among_them():
    """A person whose right foot's markers are rotated against the model.

    Symmetry shows it where marker positions do not.
    """
    generic = stick_figure()
    markers = walk(with_turned_foot(generic, TURN))
    apart = []
    for sd in (0.02, 1e6):
        found = calibrate(generic, [markers], CalibrationOptions(posture_sd=sd))
        mean = inverse_kinematics(found.model, markers, InverseKinematicsOptions()).motion
        both = [mean.values[:, mean.names.index(f"foot_{side}_r0")].mean() for side in "rl"]
        apart.append(abs(both[0] - both[1]))
    assert apart[0] < 0.5 * apart[1]


def test_uneven_recordings_have_no_row():
    """Half a step shows one knee bent and the other straight: that is no offset."""
    model = stick_figure()
    tree = compile_tree(model)
    free = np.arange(len(tree.defaults))
    names = [one.name for one in model.coordinates]
    even = inverse_kinematics(model, walk(model), InverseKinematicsOptions()).motion.values
    rows = symmetric_posture(tree, free, [even], 0.07)
    assert "tibia_r_r0 - tibia_l_r0" in rows.names
    # Mirrored, adduction and rotation change their sign in this model, whose axes are the same on
    # both sides.
    assert "femur_r_r1 + femur_l_r1" in rows.names
    assert {"torso_r1", "torso_r2"} <= set(rows.names)
    assert "torso_r0" not in rows.names
    uneven = even.copy()
    uneven[:-3, names.index("tibia_r_r0")] = -2.0
    assert "tibia_r_r0 - tibia_l_r0" not in symmetric_posture(tree, free, [uneven], 0.07).names


def _shared(model: Model, markers: Markers) -> tuple[SharedProblem, np.ndarray, np.ndarray]:
    """Return the problem of these frames, its unknowns on the model, and the frames' angles."""
    lengths = lengths_of(model)
    names = model.marker_names
    tree = compile_tree(model)
    fit = inverse_kinematics(model, markers, InverseKinematicsOptions())
    unknowns = len(lengths) + 3 * len(names) + 1
    still = np.zeros(len(tree.defaults))
    problem = SharedProblem(
        model=model,
        lengths=lengths,
        marker_names=names,
        stretch=stretch_of(model, lengths, names),
        pose=pose_problem(tree, names, np.ones(len(names)), InverseKinematicsOptions()),
        sets=(FrameSet(markers.values, np.tile(still, (len(markers), 1)), still),),
        prior=LinearPrior(
            name="prior", blocks=BLOCKS, rows=np.eye(unknowns), right=np.zeros(unknowns)
        ),
        posture=tree.defaults,
        posture_weight=1e-10,
    )
    x = np.zeros(unknowns)
    x[: len(lengths)] = 1.0
    return problem, x, fit.motion.values


def test_slopes_of_mean_angles_are_differences():
    model = stick_figure()
    lengths = lengths_of(model)
    names = model.marker_names
    problem, x, angles = _shared(model, walk(model, frames=8))
    rng = np.random.default_rng(2)
    way = np.concatenate(
        [0.01 * rng.normal(size=len(lengths)), 1e-3 * rng.normal(size=3 * len(names)), [0.0]]
    )
    ends = [settle(problem, x + h * way, [angles], 1e-4) for h in (-0.5, 0.5)]
    means = [end.angles[0].mean(axis=0) for end in ends]
    # Residuals of 2 mm over 0.1 m bend the minimum by a few percent: the slopes leave their second
    # derivatives out.
    slopes = angle_slopes(problem, settle(problem, x, [angles], 1e-4)).mean @ way
    np.testing.assert_allclose(slopes, means[1] - means[0], atol=0.03 * np.abs(slopes).max())


def test_sliding_skin_adds_the_spread_of_its_gradients():
    """One frame: each slide of each segment is put into the markers.

    It moves gradient and angles by the stated amount.
    """
    model = stick_figure()
    markers = walk(model, frames=1, noise=0.0)
    problem, x, angles = _shared(model, markers)
    at = settle(problem, x, [angles], 1e-4)
    slide = Slide(shift=1e-4, turn=1e-3)
    before = reduce(problem, at).g
    moves = []
    for observed in _slid(problem, x, at, slide):
        slid = replace(problem, sets=(replace(problem.sets[0], observed=observed),))
        there = settle(slid, x, [at.angles[0]], 1e-4)
        turned = (there.angles[0] - at.angles[0])[0]
        moves.append(np.concatenate([reduce(slid, there).g - before, turned]))
    expected = np.array(moves).T @ np.array(moves)
    found = sliding(problem, at, slide, 1)
    for part in (slice(None, len(x)), slice(len(x), None)):
        np.testing.assert_allclose(
            found[part, part], expected[part, part], atol=0.03 * expected[part, part].max()
        )


def _slid(problem, x, at, slide):
    """Yield markers (1, markers, 3) after each slide of each segment."""
    poses = forward_kinematics(compile_tree(problem.model), at.angles[0])
    bodies = problem.pose.markers.body
    places = problem.placed(x)
    for body in np.unique(bodies):
        of = np.flatnonzero(bodies == body)
        apart = places[of] - places[of].mean(axis=0)
        for axis in np.eye(3):
            shift = np.tile(slide.shift * axis, (len(of), 1))
            for move in (shift, slide.turn * np.cross(axis, apart)):
                observed = np.array(problem.sets[0].observed)
                observed[0, of] += move @ poses.rotations[0, body].T
                yield observed


def test_intervals_without_skin_have_no_slides():
    model = stick_figure()
    found = [
        calibrate(model, [walk(model)], CalibrationOptions(frames=12, slide_sd=sd)).lengths
        for sd in (None, 0.005, 0.0)
    ]
    sd = np.array([[one.sd for one in lengths] for lengths in found])
    np.testing.assert_array_equal(sd[0], sd[1])
    assert (sd[1] >= sd[2]).all()
    assert sd[1].mean() > 1.02 * sd[2].mean()
    assert [one.factor for one in found[0]] == [one.factor for one in found[2]]


def test_a_static_trial_comes_first():
    model = stick_figure()
    still = Markers(np.zeros(1), model.marker_names, walk(model).values[:1])
    pose = {"foot_r_r0": 0.0, "foot_l_r0": 0.0}
    alone = calibrate(model, [walk(model)], CalibrationOptions(frames=12))
    known = calibrate(
        model,
        [walk(model)],
        CalibrationOptions(frames=12, static=still, static_pose=pose, static_sd=0.01),
    )
    before = {one.coordinate: one for one in alone.zero_angles}
    after = {one.coordinate: one for one in known.zero_angles}
    for name in pose:
        assert before[name].source != STATIC
        assert after[name].source == STATIC
        assert after[name].sd < before[name].sd
        assert sum(after[name].shares.values()) == pytest.approx(1.0)
    assert alone.steps >= 1
    assert alone.converged
    assert alone.last_change < 0.1


@pytest.mark.parametrize(("longer", "differs"), [(0.0, False), (0.09, True)])
def test_unequal_legs_are_found_and_named(longer, differs):
    """Right thigh and shank 9 % longer, skin noise of 5 mm.

    Lengths are within 6 mm, and one line names the difference.
    """
    model = stick_figure()
    person = with_unequal_legs(model, longer)
    found = calibrate(model, [walk(person, noise=5e-3)])
    assert any("sides differ" in note for note in found.notes) == differs
    for one in found.lengths:
        if one.length.along and one.length.segment.startswith(("femur", "tibia")):
            true = 1.0 + longer * one.length.segment.endswith("_r")
            assert one.factor * one.length.extent == pytest.approx(
                true * one.length.extent, abs=6e-3
            )


def test_segments_with_few_markers_and_unknown_names_are_said():
    model = stick_figure()
    markers = walk(model)
    renamed = tuple("strange" if name == "foot_r2" else name for name in markers.names)
    found = calibrate(model, [replace(markers, names=renamed)], CalibrationOptions(frames=8))
    note = next(note for note in found.notes if "fewer than 3" in note)
    assert all(part in note for part in ("foot_r (foot_r0, foot_r1)", "foot_r2", "strange"))
    assert not any(
        "fewer than 3" in note
        for note in calibrate(model, [markers], CalibrationOptions(frames=8)).notes
    )


def test_a_static_trial_takes_the_place_of_motion_that_would_put_zeros_where_no_bones_have_them(
    monkeypatch,
):
    model = stick_figure()
    moving = walk(model)
    still = Markers(moving.time[:5], moving.names, np.repeat(moving.values[:1], 5, axis=0))
    options = CalibrationOptions(static=still, static_pose={})
    monkeypatch.setattr("myomorph.body.calibrate.calibrate.STANDING", ("tibia", "foot"))
    assert not calibrate(model, [moving], options).warnings
    monkeypatch.setattr("myomorph.body.calibrate.zero_angles.FAR", -10.0)
    assert not calibrate(model, [moving], options).warnings[0].repaired
    monkeypatch.setattr("myomorph.body.calibrate.zero_angles.REFUTED", -10.0)
    repaired = calibrate(model, [moving], options)
    alone = calibrate(model, [], options)
    assert repaired.factors["tibia_r"] == pytest.approx(alone.factors["tibia_r"], abs=1e-12)
    assert repaired.warnings[0].repaired
    (warning,) = calibrate(model, [moving], replace(options, static=None)).warnings
    assert not warning.repaired
    assert warning.place in model.coordinate_names


def test_a_zero_that_the_static_trial_confirms_is_far_from_the_generic_models_in_silence(
    monkeypatch,
):
    """Markers that lie turned on the generic foot are no fault of who stands as people stand."""
    model = stick_figure()
    monkeypatch.setattr("myomorph.body.calibrate.calibrate.STANDING", ("foot",))
    still = Markers(np.zeros(1), model.marker_names, walk(model).values[:1])
    stands = inverse_kinematics(model, still).motion
    pose = {name: float(stands[name][0]) for name in stands.names if name.startswith("foot")}
    options = CalibrationOptions(frames=12, static=still, static_pose=pose)
    turned = with_turned_foot(model, np.radians(38.0))
    confirmed = calibrate(turned, [walk(model)], options)
    zero = next(one for one in confirmed.zero_angles if one.coordinate == "foot_r_r0")
    assert np.radians(16.0) < abs(zero.offset) - half_width(zero.sd) < np.radians(25.0)
    assert not confirmed.warnings
    monkeypatch.setattr("myomorph.body.calibrate.zero_angles.STANDS", 0.0)
    assert calibrate(turned, [walk(model)], options).warnings[0].place == "foot_r_r0"
