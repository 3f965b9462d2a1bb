"""The chain while frames arrive, against the chain that has them all."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from live_walk import WALK, played, recorded_walk

from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import ForcePlate, Markers, Motion, Trial, Wrenches
from myomorph.core.motion.causal import CausalFilter
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.motion.sync import cut
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kernels import Kernel
from myomorph.core.tension.solve import solve_tension
from myomorph.lab.study.inputs.reading import open_model
from myomorph.live.chain import HELD, NO_FORCE, SETTLING, SOLVED, LiveChain
from myomorph.live.loop import follow
from myomorph.live.online_identification import total_wrench
from myomorph.live.sources import Replay, open_recording


@pytest.fixture(scope="module")
def walk(data: Callable[[str], Path]) -> tuple[Model, Markers, Wrenches]:
    return recorded_walk(data)


def test_it_is_the_offline_chain_with_the_same_filter(
    walk: tuple[Model, Markers, Wrenches],
) -> None:
    """Poses, torques and activations are those of the steps that have the whole recording."""
    model, markers, wrenches = walk
    kept = played(model, markers, wrenches)
    filter = LiveChain(model, Replay(markers, wrenches)).filter
    motion = filter.motion(inverse_kinematics(model, markers).motion)
    each = _filtered_wrenches(filter, wrenches, markers.time)
    known = np.isfinite(motion.values).all(axis=1)
    assert known.sum() > 70
    motion = Motion(
        time=motion.time[known],
        names=motion.names,
        values=motion.values[known],
        velocities=motion.velocities[known],
        accelerations=motion.accelerations[known],
    )
    external = Wrenches(
        time=motion.time,
        names=wrenches.names,
        bodies=wrenches.bodies,
        forces=each[known, :, 3:],
        points=np.zeros_like(each[known, :, :3]),
        torques=each[known, :, :3],
    )
    torques = inverse_dynamics(model, motion, external)
    tension = solve_tension(model, motion, torques)
    assert set(kept.all("state")[known]) == {SOLVED}
    assert set(kept.all("state")[~known]) == {SETTLING}
    np.testing.assert_allclose(kept.all("coordinates")[known], motion.values, atol=3e-5)
    size = np.abs(torques.values).max(axis=0) + 1.0
    np.testing.assert_allclose(kept.all("torques")[known] / size, torques.values / size, atol=2e-3)
    activations = np.array([one.tension.activations for one in kept.frames])[known]
    np.testing.assert_allclose(activations, tension.activation, atol=2e-3)


def _filtered_wrenches(filter: CausalFilter, wrenches: Wrenches, time: np.ndarray) -> np.ndarray:
    """Return (frames, plates, 6) moment and force about the ground's origin at times (frames,)."""
    parts = (one[:, :, None] for one in (wrenches.forces, wrenches.points, wrenches.torques))
    from_then = np.searchsorted(wrenches.time, time[0] - 1.0)
    return filter.values(wrenches.time[from_then:], total_wrench(*parts)[from_then:], time)


def test_results_are_of_the_time_less_the_delay(walk: tuple[Model, Markers, Wrenches]) -> None:
    """Shifted by the filter's delay, angles are those of the markers.

    In a walk they agree within a degree and a half.
    """
    model, markers, wrenches = walk
    kept = played(model, markers, wrenches)
    motion = inverse_kinematics(model, markers).motion
    time = kept.all("time") - LiveChain(model, Replay(markers, wrenches)).filter.delay
    known = kept.all("state") == SOLVED
    j = model.coordinate_names.index("hip_flexion_r")
    then = np.interp(time[known], motion.time, motion.values[:, j])
    assert np.abs(kept.all("coordinates")[known, j] - then).max() < np.deg2rad(1.5)
    now = np.interp(kept.all("time")[known], motion.time, motion.values[:, j])
    assert np.abs(kept.all("coordinates")[known, j] - now).max() > np.deg2rad(3.0)


def test_while_the_body_is_held_torques_are_not_told(walk: tuple[Model, Markers, Wrenches]) -> None:
    model, markers, wrenches = walk
    values = np.array(markers.values)
    values[40:45] = np.nan
    kept = played(model, replace(markers, values=values), wrenches)
    states = kept.all("state")
    settling = LiveChain(model, Replay(markers, wrenches)).filter.settling
    assert (states[40:45] == HELD).all()
    assert (states[45 : 44 + int(settling / 0.01)] == HELD).all()
    assert (states[46 + int(settling / 0.01) :] == SOLVED).all()
    assert np.isnan(kept.all("torques")[40:45]).all()
    coordinates = kept.all("coordinates")
    assert np.isfinite(coordinates[25:]).all()
    # No coordinate moves faster on its way back than over the whole walk's range in a fifth of a
    # second.
    turning = [j for j, one in enumerate(model.coordinates) if one.motion == "rotational"]
    steps = np.abs(np.diff(coordinates[25:, turning], axis=0)).max()
    assert (
        steps
        < 1.5
        * np.abs(
            np.diff(played(model, markers, wrenches).all("coordinates")[25:, turning], axis=0)
        ).max()
    )


def test_forces_that_stop_are_missed(walk: tuple[Model, Markers, Wrenches]) -> None:
    model, markers, wrenches = walk
    early = wrenches.time < 0.95
    parts = {
        name: getattr(wrenches, name)[early] for name in ("time", "forces", "points", "torques")
    }
    kept = played(model, markers, replace(wrenches, **parts))
    late = kept.all("time") > 1.06
    assert (kept.all("state")[late] == NO_FORCE).all()
    assert np.isfinite(kept.all("coordinates")[late]).all()
    assert np.isnan(kept.all("torques")[late]).all()


def test_plates_of_a_table_find_their_feet(
    data: Callable[[str], Path], walk: tuple[Model, Markers, Wrenches]
) -> None:
    """A table of plates without bodies gives the same torques as the loads file naming them."""
    model, markers, wrenches = walk
    table = data(f"{WALK}/grf_walk.mot")
    _, unnamed = open_recording(model, data(f"{WALK}/markers_walk.trc"), table)
    named = played(model, markers, wrenches)
    found = played(model, markers, unnamed)
    solved = named.all("state") == SOLVED
    assert (found.all("state") == named.all("state")).all()
    apart = np.abs(found.all("torques") - named.all("torques"))[solved].max()
    # A plate is a foot's from 20 N on: what comes before is left out.
    assert apart < 5.0
    with pytest.raises(BadData, match="no columns of a force"):
        open_recording(model, data(f"{WALK}/markers_walk.trc"), data(f"{WALK}/id_walk.sto"))


def test_plates_of_the_recording_itself_find_their_feet(
    walk: tuple[Model, Markers, Wrenches], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that holds markers and plates, as C3D does, needs no other.

    Centers of pressure may be unknown.
    """
    model, markers, wrenches = walk
    corners = np.array([[1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, 0.0, -1.0], [1.0, 0.0, -1.0]])
    idle = np.linalg.norm(wrenches.forces, axis=2, keepdims=True) == 0.0
    points = np.where(idle, np.nan, wrenches.points)
    plates = tuple(
        ForcePlate(
            name=name,
            kind=2,
            corners=corners,
            forces=wrenches.forces[:, i],
            points=points[:, i],
            torques=wrenches.torques[:, i],
        )
        for i, name in enumerate(wrenches.names)
    )
    trial = Trial(markers=markers, plates=plates, plate_time=wrenches.time, source="walk.c3d")
    monkeypatch.setattr("myomorph.lab.study.inputs.reading.read_recording", lambda path: trial)
    series, found = open_recording(model, Path("walk.c3d"), None)
    assert found is not None
    assert found.bodies == ("", "")
    own = played(model, series, found)
    named = played(model, markers, wrenches)
    solved = named.all("state") == SOLVED
    assert np.abs(own.all("torques") - named.all("torques"))[solved].max() < 5.0


@pytest.mark.parametrize("speed", ["run200", "run500"])
def test_a_runner_on_two_belts_keeps_the_feet_apart(
    data: Callable[[str], Path], speed: str
) -> None:
    """Foot strikes at full speed, and centers of pressure that wander.

    The plates named right and left stay what they are.
    """
    folder = data("hamner-run-subject04")
    model = open_model(folder / "unscaled_generic.osim")
    markers, wrenches = open_recording(
        model, folder / speed / "markers.trc", folder / speed / "grf.mot"
    )
    assert wrenches is not None
    sides = tuple({"L": "calcn_l", "R": "calcn_r"}[name[0]] for name in wrenches.names)
    found = played(model, markers, wrenches)
    named = played(model, markers, replace(wrenches, bodies=sides))
    solved = named.all("state") == SOLVED
    assert solved.sum() > 150
    assert np.abs(found.all("torques") - named.all("torques"))[solved].max() < 5.0


def test_a_long_recording_keeps_its_forces(walk: tuple[Model, Markers, Wrenches]) -> None:
    """Played as fast as it goes, forces wait for their frames, however many come."""
    model, markers, wrenches = walk
    lasting = Markers(
        np.arange(900) / 100.0, markers.names, np.tile(markers.values[:1], (900, 1, 1))
    )
    ticks = np.arange(9000) / 1000.0
    parts = {
        name: np.tile(getattr(wrenches, name)[1500:1501], (9000, 1, 1))
        for name in ("forces", "points", "torques")
    }
    kept = played(model, lasting, replace(wrenches, time=ticks, **parts))
    assert (kept.all("state")[20:] == SOLVED).all()


def test_coordinates_can_be_played(
    data: Callable[[str], Path], walk: tuple[Model, Markers, Wrenches]
) -> None:
    model, _, _ = walk
    motion, wrenches = open_recording(
        model, data(f"{WALK}/coordinates.sto"), data(f"{WALK}/grf_walk.xml")
    )
    motion = cut(motion, 0.5, 0.9)
    kept = played(model, motion, wrenches)
    assert (kept.all("state")[200:] == SOLVED).all()
    assert np.isnan(kept.all("error")).all()


def test_without_forces_a_floating_body_is_told(walk: tuple[Model, Markers, Wrenches]) -> None:
    model, markers, _ = walk
    source = Replay(markers, None, 0.0)
    session = follow(LiveChain(model, source), source)
    assert any("no external forces" in one for one in session.notes)
    assert session.delays.states()[SOLVED] > 60


def test_nothing_is_compiled_while_frames_come(walk: tuple[Model, Markers, Wrenches]) -> None:
    """After the warm-up no kernel gets another form.

    This holds even where markers and forces are lost and found.
    """
    model, markers, wrenches = walk
    values = np.array(markers.values)
    values[30:40, :5] = np.nan
    values[60:63] = np.nan
    unnamed = replace(wrenches, bodies=("", ""))
    source = Replay(replace(markers, values=values), unnamed, 0.0)
    chain = LiveChain(model, source)
    chain.warm_up()
    before = kernel_forms()
    assert len(before) > 100
    session = follow(chain, source)
    assert session.delays.states()[SOLVED] > 30
    assert {
        name: forms for name, forms in kernel_forms().items() if forms != before.get(name, 0)
    } == {}


def kernel_forms() -> dict[str, int]:
    """How many forms each kernel has been compiled for, or loaded from the cache in."""
    return {
        f"{module}.{name}": kernel.forms
        for module, loaded in list(sys.modules.items())
        if module.startswith("myomorph")
        for name, kernel in vars(loaded).items()
        if isinstance(kernel, Kernel)
    }
