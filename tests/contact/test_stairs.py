"""Stairs that measure force.

Known forces on them are recovered, on the foot that stood there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.contact.feet_on_steps import feet_on_steps, shared_stairs, stair_wrenches
from myomorph.core.contact.stairs import COMPONENTS, StairOptions, Step, step_loads
from myomorph.core.model.arrays import runs
from myomorph.core.model.contacts import Site
from myomorph.core.model.errors import BadData
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.series import Analog, Motion, Series
from myomorph.core.model.spatial import Transform, axis_rotation

PAWS = ("paw_r", "paw_l")
GRAMS = 0.025
WEIGHT = GRAMS * 9.81
RATE = 1000.0
FRAMES = 1200
HERE = Transform.identity()
UP = axis_rotation((1.0, 0.0, 0.0), -np.pi / 2.0)
"""Turns a tread whose z is its normal so that this is y of ground, x kept."""


def loadings(loads):
    """Return every loading in order of time.

    Each has its step, start and stop [s], and its greatest force along the normal [N].
    """
    result = [
        (
            step.name,
            float(loads.time[a]),
            float(loads.time[b - 1]),
            float(loads.pressing[a:b, index].max()),
        )
        for index, step in enumerate(loads.steps)
        for a, b in runs(loads.loaded[:, index])
    ]
    return sorted(result, key=lambda result: result[1])


def mouse():
    """Make a free sliding trunk and two paws that slide on it.

    Their coordinates are positions.
    """
    names = ("trunk", *PAWS)
    axes = {name: tuple(f"{name}_{axis}" for axis in "xyz") for name in names}
    return Model(
        name="mouse",
        bodies=tuple(
            Body(
                name=name,
                mass=GRAMS if name == "trunk" else 0.0,
                mass_center=np.zeros(3),
                inertia=1e-6 * np.eye(3),
            )
            for name in names
        ),
        joints=tuple(
            Joint(
                name=f"to_{name}",
                kind="CustomJoint",
                parent=GROUND if name == "trunk" else "trunk",
                child=name,
                parent_frame=HERE,
                child_frame=HERE,
                axes=tuple(
                    Axis(
                        kind="translation",
                        vector=np.eye(3)[i],
                        function=linear(1.0),
                        coordinates=(one,),
                    )
                    for i, one in enumerate(axes[name])
                ),
                coordinates=axes[name],
            )
            for name in names
        ),
        coordinates=tuple(Coordinate(one, "translational") for name in names for one in axes[name]),
        gravity=np.array([0.0, -9.81, 0.0]),
    )


def steps(measures=COMPONENTS, turn=0.0, matrix=None, origin=(0.0, 0.0, -0.004)):
    made = []
    for k in range(4):
        rotation = axis_rotation((0.0, 1.0, 0.0), turn) @ UP
        place = np.array([0.02 * k, 0.01 * k, 0.0])
        channels = tuple(f"{name}{k}" for name in measures)
        made.append(
            Step(
                name=f"step{k}",
                pose=Transform(rotation, place),
                size=(0.01, 0.05),
                measures=tuple(measures),
                channels=channels,
                matrix=matrix,
                origin=origin,
            )
        )
    return made


def walk(noise=0.0, seed=0, made=None, matrix=None):
    """Simulate a walk: right paw on steps 0 and 2, left on 1 and 3, each for 0.25 s.

    Forces and their points of application are known.
    """
    made = made or steps()
    rng = np.random.default_rng(seed)
    time = np.arange(FRAMES) / RATE
    places = {paw: np.full((FRAMES, 3), (-0.05, 0.02, 0.0)) for paw in PAWS}
    truth = {paw: np.zeros((FRAMES, 3)) for paw in PAWS}
    channels = []
    for k, step in enumerate(made):
        paw = PAWS[k % 2]
        force = _push(time, *_stance(k))
        local = np.array([0.002, 0.01 - 0.005 * k, 0.0])
        places[paw][_is_near(time, *_stance(k))] = step.pose.apply(local)
        truth[paw] += force
        channels.append(
            _raw_channels(step, force, local, matrix) + _noise(step, noise, rng) + 0.3 * WEIGHT
        )
    places["trunk"] = 0.5 * (places["paw_r"] + places["paw_l"]) + (0.0, 0.03, 0.0)
    names = tuple(name for step in made for name in step.channels)
    recorded = Series(time, names, np.hstack(channels))
    model = mouse()
    relative = [places[paw] - places["trunk"] for paw in PAWS]
    motion = Motion(time, model.coordinate_names, np.hstack([places["trunk"], *relative]))
    sites = tuple(Site(f"{paw}_pad", paw, np.zeros((1, 3))) for paw in PAWS)
    return model, motion, sites, made, recorded, truth, places


def _noise(step, noise, rng):
    """Draw noise (frames, channels) of a step, of moments a hundredth of the forces'."""
    sd = np.array([1.0 if one.startswith("f") else 0.01 for one in step.measures]) * noise
    return rng.normal(0.0, 1.0, (FRAMES, len(sd))) * sd


def _stance(k):
    """Return start and stop of the stance on the k-th step [s]."""
    return 0.1 + 0.25 * k, 0.1 + 0.25 * k + 0.2


def _is_near(time, start, stop):
    """Return whether a paw is already or still over its step, (frames,)."""
    return (time > start - 0.1) & (time < stop + 0.1)


def _push(time, start, stop):
    """Return the force (frames, 3) of a paw that stands between two times [N]."""
    push = np.sin(np.pi * np.clip((time - start) / (stop - start), 0.0, 1.0))
    force = np.column_stack([0.15 * push * np.cos(6 * time), push, 0.1 * push]) * WEIGHT
    force[(time < start) | (time >= stop)] = 0.0
    return force


def _raw_channels(step, force, local, matrix):
    """Return what a step's channels measure of a force at a point of the step."""
    own = force @ step.pose.rotation
    wrench = np.hstack([own, np.cross(local - step.origin, own)])
    picked = wrench[:, [COMPONENTS.index(one) for one in step.measures]]
    return picked if matrix is None else picked @ np.linalg.inv(matrix).T


def test_six_axes_give_force_place_and_paw():
    model, motion, sites, made, channels, truth, places = walk(noise=0.001)
    loads = step_loads(made, channels, WEIGHT)
    assert [one[0] for one in loadings(loads)] == ["step0", "step1", "step2", "step3"]
    paws = feet_on_steps(model, motion, sites, loads)
    wrenches, notes = stair_wrenches(paws)
    assert not notes
    assert sorted(wrenches.names) == ["step0_paw_r", "step1_paw_l", "step2_paw_r", "step3_paw_l"]
    for paw in PAWS:
        mine = [j for j, body in enumerate(wrenches.bodies) if body == paw]
        loaded = truth[paw][:, 1] > 0.1 * WEIGHT
        error = wrenches.forces[:, mine].sum(axis=1) - truth[paw]
        assert np.sqrt((error[loaded] ** 2).mean()) < 0.002
        for j in mine:
            pressed = wrenches.forces[:, j, 1] > 0.3 * WEIGHT
            assert np.abs(wrenches.points[pressed, j] - places[paw][pressed]).max() < 0.001
            assert np.abs(wrenches.torques[pressed, j]).max() < 1e-4


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_three_axes_put_the_force_where_the_paw_is(turn):
    model, motion, sites, made, channels, truth, places = walk(
        0.0005, made=steps(("fz", "fx", "fy"), turn)
    )
    wrenches, notes = stair_wrenches(
        feet_on_steps(model, motion, sites, step_loads(made, channels, WEIGHT))
    )
    assert not notes
    for j, body in enumerate(wrenches.bodies):
        pressed = wrenches.forces[:, j, 1] > 0.3 * WEIGHT
        assert np.abs(wrenches.forces[pressed, j] - truth[body][pressed]).max() < 0.005
        assert np.abs(wrenches.points[pressed, j] - places[body][pressed]).max() < 1e-9


def test_one_axis_leaves_the_horizontal_open():
    model, motion, sites, made, channels, truth, _ = walk(0.0005, made=steps(("fz",), 0.3))
    paws = feet_on_steps(model, motion, sites, step_loads(made, channels, WEIGHT))
    nothing, notes = stair_wrenches(paws)
    assert not nothing.names
    assert len(notes) == 4
    assert all("does not measure force along x, z" in one for one in notes)
    vertical, notes = stair_wrenches(paws, "zero")
    assert all("taken for zero" in one for one in notes)
    shared = shared_stairs(paws)
    assert [one.sites for one in shared] == [
        ("paw_r_pad",),
        ("paw_l_pad",),
        ("paw_r_pad",),
        ("paw_l_pad",),
    ]
    for one in shared:
        told = np.isfinite(one.forces[:, 1])
        assert told.sum() > 150
        assert np.isnan(one.forces[told][:, [0, 2]]).all()
        assert np.isnan(one.moments).all()
        paw = one.sites[0].removesuffix("_pad")
        assert np.abs(one.forces[told, 1] - truth[paw][told, 1]).max() < 0.005
    assert np.abs(vertical.forces[..., [0, 2]]).max() == 0.0


def test_a_tilted_cell_of_one_axis_knows_no_component_of_ground():
    tilted = [
        replace(one, pose=Transform(axis_rotation((0, 0, 1), 0.3) @ UP, one.pose.translation))
        for one in steps(("fz",))
    ]
    *_, channels, _, _ = walk(made=steps(("fz",)))
    loads = step_loads(tilted, channels, WEIGHT)
    assert np.isnan(loads.forces[..., :2]).all()
    assert np.isfinite(loads.pressing).all()


def test_cross_talk_is_taken_back():
    matrix = np.eye(6) + 0.1 * np.random.default_rng(3).standard_normal((6, 6))
    made = steps(matrix=matrix)
    _, _, _, made, channels, truth, _ = walk(made=made, matrix=matrix)
    loads = step_loads(made, channels, WEIGHT)
    total = np.nansum(np.where(loads.loaded[..., None], loads.forces, 0.0), axis=1)
    known = loads.loaded.any(axis=1)
    np.testing.assert_allclose(total[known], (truth["paw_r"] + truth["paw_l"])[known], atol=1e-9)


@pytest.mark.parametrize("stated", ["file", "names", "nowhere"])
def test_channels_in_other_units_give_the_same_loads(stated):
    """Moments in N mm and forces in kN, as the file's units, the names or the sizes say."""
    _, _, _, made, channels, _, _ = walk(noise=0.001)
    expected = step_loads(made, channels, WEIGHT)
    assert not expected.notes
    moments = np.array([name.startswith("m") for name in channels.names])
    kilo = 1.0 if stated == "nowhere" else 1e-3
    values = channels.values * np.where(moments, 1e3, kilo)
    other = replace(channels, values=values)
    if stated == "file":
        units = tuple("Nmm" if moment else "kN" for moment in moments)
        other = Analog(channels.time, channels.names, values, units=units)
    if stated == "names":
        units = ["N·mm" if moment else "kN" for moment in moments]
        titles = [f"{name} [{unit}]" for name, unit in zip(channels.names, units, strict=True)]
        named = dict(zip(channels.names, titles, strict=True))
        other = replace(other, names=tuple(titles))
        made = [
            replace(step, channels=tuple(named[name] for name in step.channels)) for step in made
        ]
    loads = step_loads(made, other, WEIGHT)
    np.testing.assert_allclose(loads.forces, expected.forces, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(loads.moments, expected.moments, rtol=1e-9, atol=1e-12)
    told = [note for note in loads.notes if "taken as N mm" in note]
    assert len(told) == (len(made) if stated == "nowhere" else 0)


def test_channels_that_are_no_forces_trigger_a_warning():
    """Volts without a matrix are taken as newtons with a warning; a matrix converts them."""
    _, _, _, made, channels, _, _ = walk()
    volts = Analog(channels.time, channels.names, channels.values, units=("V",) * 24)
    told = step_loads(made, volts, WEIGHT).notes
    assert len(told) == len(made)
    assert "in 'V', taken as N and N m" in told[0]
    with_matrix = [replace(step, matrix=np.eye(6)) for step in made]
    assert not step_loads(with_matrix, volts, WEIGHT).notes


def test_loading_is_found_at_a_few_percent_of_body_weight():
    _, _, _, made, channels, _, _ = walk(noise=0.001)
    loads = step_loads(made, channels, WEIGHT)
    for k, (_, start, stop, peak) in enumerate(loadings(loads)):
        assert start == pytest.approx(0.1 + 0.25 * k, abs=0.008)
        assert stop == pytest.approx(0.3 + 0.25 * k, abs=0.008)
        assert peak == pytest.approx(WEIGHT, rel=0.05)
    np.testing.assert_allclose(loads.noise, 0.001, rtol=0.2)


def test_noise_that_hides_loads_is_told():
    *_, made, channels, _, _ = walk(noise=0.02)
    loads = step_loads(made, channels, WEIGHT)
    assert any("hides loads below" in one for one in loads.notes)


def _both_on_step_0(motion, places):
    """Put the left paw on step 0 too, as far on the other side of the center of pressure."""
    values = np.array(motion.values)
    both = (motion.time > 0.1) & (motion.time < 0.3)
    stands = (places["paw_r"] - places["trunk"])[both]
    for paw, side in (("paw_l", 1.0), ("paw_r", -1.0)):
        column = motion.names.index(f"{paw}_x")
        values[both, column : column + 3] = stands + side * np.array([0.0, 0.0, 0.01])
    return replace(motion, values=values)


def test_two_paws_on_a_step_share_by_the_center_of_pressure():
    model, motion, sites, made, channels, _, places = walk(
        made=[replace(one, size=(0.02, 0.08)) for one in steps()]
    )
    loads = step_loads(made, channels, WEIGHT)
    paws = feet_on_steps(model, _both_on_step_0(motion, places), sites, loads)
    wrenches, notes = stair_wrenches(paws)
    assert any("carries paw_r and paw_l together" in note for note in notes)
    forces = dict(zip(wrenches.names, np.moveaxis(wrenches.forces, 1, 0), strict=True))
    right = forces["step0_paw_r"]
    pressed = right[:, 1] > 0.1 * WEIGHT
    np.testing.assert_allclose(right[pressed], forces["step0_paw_l"][pressed], rtol=0.02, atol=1e-6)
    assert any(set(wrench.sites) == {"paw_r_pad", "paw_l_pad"} for wrench in shared_stairs(paws))


def test_a_load_that_nobody_bears_is_told():
    model, motion, sites, made, channels, _, _ = walk()
    paws = feet_on_steps(model, motion, sites[:1], step_loads(made, channels, WEIGHT))
    assert any("step 'step1' is loaded" in one and "on nobody" in one for one in paws.notes)
    assert set(stair_wrenches(paws)[0].bodies) == {"paw_r"}


def test_what_is_wrong_is_named():
    *_, made, channels, _, _ = walk()
    with pytest.raises(BadData, match="not fz"):
        step_loads([replace(made[0], measures=("fx",), channels=("fx0",))], channels, WEIGHT)
    with pytest.raises(BadData, match="no channel 'nothing'"):
        step_loads(
            [replace(made[0], channels=("nothing", *made[0].channels[1:]))], channels, WEIGHT
        )
    with pytest.raises(BadData, match="two steps are named"):
        step_loads([made[0], made[0]], channels, WEIGHT)
    with pytest.raises(BadData, match="expected some of fx"):
        replace(made[0], measures=("fz", "fn"))
    with pytest.raises(BadData, match="give its matrix"):
        replace(made[0], measures=("fz",))
    with pytest.raises(BadData, match="thresholds"):
        step_loads(made, channels, float("nan"), StairOptions())
    assert made[0].rotated(np.eye(3)).pose.translation == pytest.approx(made[0].pose.translation)
