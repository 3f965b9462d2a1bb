"""The chain while frames arrive, against the chain that has them all."""

import json
import socket
import sys
import threading
import time as clock
import urllib.error
import urllib.request
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

from myomorph.identify.online import total_wrench
from myomorph.io.sto import read_sto
from myomorph.model.errors import BadData, BadFile
from myomorph.model.model import Model
from myomorph.model.series import ForcePlate, Markers, Motion, Trial, Wrenches
from myomorph.motion.ik import inverse_kinematics
from myomorph.motion.sync import cut
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.study.inputs import open_model
from myomorph.study.live_chain import HELD, NO_FORCE, SETTLING, SOLVED, ChainFrame, ChainOptions, LiveChain
from myomorph.study.live_delays import Delays, Spread
from myomorph.study.live_run import LiveFiles, LiveOutputs, LiveStreams, open_played, plates_of_table, run_live_chain
from myomorph.study.live_session import follow_chain
from myomorph.study.live_sources import LabStreams, Replay
from myomorph.study.viewing import recordings
from myomorph.tension.solve import solve_tension

WALK = "rajagopal-walk-emg"


class Kept:
    """An output that remembers."""

    def __init__(self) -> None:
        self.frames: list[ChainFrame] = []

    def put(self, frame: ChainFrame, markers: np.ndarray) -> None:
        self.frames.append(frame)

    def close(self) -> None:
        pass

    def all(self, name: str) -> np.ndarray:
        return np.array([getattr(one, name) for one in self.frames])


@pytest.fixture(scope="module")
def walk(data: Callable[[str], Path]) -> tuple[Model, Markers, Wrenches]:
    model = open_model(data(f"{WALK}/subject_walk_scaled.osim"))
    markers, wrenches = open_played(model, data(f"{WALK}/markers_walk.trc"), data(f"{WALK}/grf_walk.xml"))
    assert isinstance(markers, Markers)
    assert wrenches is not None
    return model, cut(markers, 0.5, 1.4), wrenches


def played(model: Model, markers: Markers | Motion, wrenches: Wrenches | None) -> Kept:
    kept, source = Kept(), Replay(markers, wrenches, 0.0)
    follow_chain(LiveChain(model, source), source, [kept])
    return kept


def test_it_is_the_offline_chain_with_the_same_filter(walk: tuple[Model, Markers, Wrenches]) -> None:
    """Poses, torques and activations are those of the steps that have the whole recording."""
    model, markers, wrenches = walk
    kept = played(model, markers, wrenches)
    filter = LiveChain(model, Replay(markers, wrenches)).filter
    motion = filter.motion(inverse_kinematics(model, markers).motion)
    parts = (one[:, :, None] for one in (wrenches.forces, wrenches.points, wrenches.torques))
    from_then = np.searchsorted(wrenches.time, markers.time[0] - 1.0)
    each = filter.values(wrenches.time[from_then:], total_wrench(*parts)[from_then:], markers.time)
    known = np.isfinite(motion.values).all(axis=1)
    assert known.sum() > 70
    motion = Motion(
        *(motion.time[known], motion.names),
        *(one[known] for one in (motion.values, motion.velocities, motion.accelerations)),
    )
    zero = np.zeros_like(each[known, :, :3])
    external = Wrenches(motion.time, wrenches.names, wrenches.bodies, each[known, :, 3:], zero, each[known, :, :3])
    torques = inverse_dynamics(model, motion, external)
    tension = solve_tension(model, motion, torques)
    states = kept.all("state")
    assert set(states[known]) == {SOLVED}
    assert set(states[~known]) == {SETTLING}
    np.testing.assert_allclose(kept.all("coordinates")[known], motion.values, atol=3e-5)
    size = np.abs(torques.values).max(axis=0) + 1.0
    np.testing.assert_allclose(kept.all("torques")[known] / size, torques.values / size, atol=2e-3)
    activations = np.array([one.tension.activations for one in kept.frames])[known]
    np.testing.assert_allclose(activations, tension.activations, atol=2e-3)


def test_results_are_of_the_time_less_the_delay(walk: tuple[Model, Markers, Wrenches]) -> None:
    """Shifted by the filter's delay, angles are those of the markers: within a degree and a half in a walk."""
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
    # No coordinate moves faster on its way back than over the whole walk's range in a fifth of a second.
    turning = [j for j, one in enumerate(model.coordinates) if one.motion == "rotational"]
    steps = np.abs(np.diff(coordinates[25:, turning], axis=0)).max()
    assert (
        steps < 1.5 * np.abs(np.diff(played(model, markers, wrenches).all("coordinates")[25:, turning], axis=0)).max()
    )


def test_forces_that_stop_are_missed(walk: tuple[Model, Markers, Wrenches]) -> None:
    model, markers, wrenches = walk
    early = wrenches.time < 0.95
    parts = {name: getattr(wrenches, name)[early] for name in ("time", "forces", "points", "torques")}
    kept = played(model, markers, replace(wrenches, **parts))
    late = kept.all("time") > 1.06
    assert (kept.all("state")[late] == NO_FORCE).all()
    assert np.isfinite(kept.all("coordinates")[late]).all()
    assert np.isnan(kept.all("torques")[late]).all()


def test_plates_of_a_table_find_their_feet(data: Callable[[str], Path], walk: tuple[Model, Markers, Wrenches]) -> None:
    """A table of plates without bodies leads to the same torques as the loads file that names them."""
    model, markers, wrenches = walk
    table = data(f"{WALK}/grf_walk.mot")
    assert dict(plates_of_table(table)) == {"ground_force_l_": "", "ground_force_r_": ""}
    _, unnamed = open_played(model, data(f"{WALK}/markers_walk.trc"), table)
    named, found = played(model, markers, wrenches), played(model, markers, unnamed)
    solved = named.all("state") == SOLVED
    assert (found.all("state") == named.all("state")).all()
    apart = np.abs(found.all("torques") - named.all("torques"))[solved].max()
    # A plate is a foot's from 20 N on: what comes before is left out.
    assert apart < 5.0
    with pytest.raises(BadFile, match="holds no plate"):
        plates_of_table(data(f"{WALK}/id_walk.sto"))


def test_plates_of_the_recording_itself_find_their_feet(
    walk: tuple[Model, Markers, Wrenches], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that holds markers and plates, as C3D does, needs no other; centers of pressure may be unknown."""
    model, markers, wrenches = walk
    corners = np.array([[1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, 0.0, -1.0], [1.0, 0.0, -1.0]])
    idle = np.linalg.norm(wrenches.forces, axis=2, keepdims=True) == 0.0
    points = np.where(idle, np.nan, wrenches.points)
    plates = tuple(
        ForcePlate(name, 2, corners, wrenches.forces[:, i], points[:, i], wrenches.torques[:, i])
        for i, name in enumerate(wrenches.names)
    )
    trial = Trial(markers=markers, plates=plates, plate_time=wrenches.time, source="walk.c3d")
    monkeypatch.setattr("myomorph.study.inputs.open_trial", lambda path: trial)
    series, found = open_played(model, Path("walk.c3d"), None)
    assert found is not None
    assert found.bodies == ("", "")
    own, named = played(model, series, found), played(model, markers, wrenches)
    solved = named.all("state") == SOLVED
    assert np.abs(own.all("torques") - named.all("torques"))[solved].max() < 5.0


@pytest.mark.parametrize("speed", ["run200", "run500"])
def test_a_runner_on_two_belts_keeps_the_feet_apart(data: Callable[[str], Path], speed: str) -> None:
    """Touchdowns at full speed, centers of pressure that wander: the plates named right and left stay what they are."""
    folder = data("hamner-run-subject04")
    model = open_model(folder / "unscaled_generic.osim")
    markers, wrenches = open_played(model, folder / speed / "markers.trc", folder / speed / "grf.mot")
    assert wrenches is not None
    sides = tuple({"L": "calcn_l", "R": "calcn_r"}[name[0]] for name in wrenches.names)
    found, named = played(model, markers, wrenches), played(model, markers, replace(wrenches, bodies=sides))
    solved = named.all("state") == SOLVED
    assert solved.sum() > 150
    assert np.abs(found.all("torques") - named.all("torques"))[solved].max() < 5.0


def test_a_long_recording_keeps_its_forces(walk: tuple[Model, Markers, Wrenches]) -> None:
    """Played as fast as it goes, forces wait for their frames, however many come."""
    model, markers, wrenches = walk
    lasting = Markers(np.arange(900) / 100.0, markers.names, np.tile(markers.values[:1], (900, 1, 1)))
    ticks = np.arange(9000) / 1000.0
    parts = {
        name: np.tile(getattr(wrenches, name)[1500:1501], (9000, 1, 1)) for name in ("forces", "points", "torques")
    }
    kept = played(model, lasting, replace(wrenches, time=ticks, **parts))
    assert (kept.all("state")[20:] == SOLVED).all()


def test_coordinates_can_be_played(data: Callable[[str], Path], walk: tuple[Model, Markers, Wrenches]) -> None:
    model, _, _ = walk
    motion, wrenches = open_played(model, data(f"{WALK}/coordinates.sto"), data(f"{WALK}/grf_walk.xml"))
    motion = cut(motion, 0.5, 0.9)
    kept = played(model, motion, wrenches)
    assert (kept.all("state")[200:] == SOLVED).all()
    assert np.isnan(kept.all("error")).all()


def test_without_forces_a_floating_body_is_told(walk: tuple[Model, Markers, Wrenches]) -> None:
    model, markers, _ = walk
    source = Replay(markers, None, 0.0)
    session = follow_chain(LiveChain(model, source), source)
    assert any("no external forces" in one for one in session.notes)
    assert session.delays.states()[SOLVED] > 60


def test_nothing_is_compiled_while_frames_come(walk: tuple[Model, Markers, Wrenches]) -> None:
    """After the rehearsal no kernel gets another form, not even where markers and forces are lost and found."""
    model, markers, wrenches = walk
    values = np.array(markers.values)
    values[30:40, :5] = np.nan
    values[60:63] = np.nan
    unnamed = replace(wrenches, bodies=("", ""))
    source = Replay(replace(markers, values=values), unnamed, 0.0)
    chain = LiveChain(model, source)
    chain.rehearse()
    before = kernel_forms()
    assert len(before) > 100
    session = follow_chain(chain, source)
    assert session.delays.states()[SOLVED] > 30
    assert {name: forms for name, forms in kernel_forms().items() if forms != before.get(name, 0)} == {}


def kernel_forms() -> dict[str, int]:
    """How many forms each kernel has been compiled for, or loaded from the cache in."""
    return {
        f"{module}.{name}": len(kernel.signatures)
        for module, loaded in list(sys.modules.items())
        if module.startswith("myomorph")
        for name, kernel in vars(loaded).items()
        if isinstance(kernel, Dispatcher)
    }


class Slow:
    """An output that takes its time."""

    def __init__(self, seconds: float, frames: int):
        self.seconds, self.frames, self.times = seconds, frames, []

    def put(self, frame: ChainFrame, markers: np.ndarray) -> None:
        self.times.append(frame.time)
        if len(self.times) <= self.frames:
            clock.sleep(self.seconds)


def test_what_cannot_keep_up_drops_the_oldest_frames(walk: tuple[Model, Markers, Wrenches]) -> None:
    """At 100 Hz with 30 ms a frame most are dropped, and the order stays."""
    model, markers, wrenches = walk
    source, slow = Replay(markers, wrenches, 1.0), Slow(0.03, 1000)
    session = follow_chain(LiveChain(model, source), source, [slow])
    assert session.delays.dropped + len(slow.times) == len(markers)
    assert session.delays.dropped > 30
    assert slow.times == sorted(slow.times)
    assert f"{session.delays.dropped} dropped" in session.summary()[0]


def test_delays_are_counted() -> None:
    delays = Delays()
    for k in range(100):
        delays.add(0.01 * k, 0.0, 0.001 * (k + 1), 0.0005, 0 if k else SETTLING)
    assert delays.end_to_end.median == pytest.approx(0.0505)
    assert delays.end_to_end.worst == pytest.approx(0.1)
    assert delays.recent(10).median == pytest.approx(0.0955)
    assert delays.states() == {SOLVED: 99, SETTLING: 1}
    assert delays.table.shape == (100, 5)
    assert np.isnan(Spread.of(np.array([np.nan])).median)


def test_a_folder_holds_everything(
    data: Callable[[str], Path], tmp_path: Path, walk: tuple[Model, Markers, Wrenches]
) -> None:
    """Tables on the results' own clock, delays of every frame, and a result that `view` opens."""
    out = tmp_path / "gelöst am Tag"
    files = LiveFiles(data(f"{WALK}/markers_walk.trc"), data(f"{WALK}/grf_walk.xml"), 0.0)
    session = run_live_chain(data(f"{WALK}/subject_walk_scaled.osim"), files, LiveOutputs(folder=out))
    assert sorted(one.name for one in out.iterdir()) == [
        "activations.sto", "coordinates.mot", "delays.csv", "live.nc", "muscle_forces.sto", "session.json",
        "torques.sto",
    ]  # fmt: skip
    told = json.loads((out / "session.json").read_text(encoding="utf-8"))
    assert told["frames"] == len(session.delays) == 238
    assert told["dropped"] == 0
    assert told["from_frame_to_result_ms"]["median"] is None
    assert told["computation_ms"]["median"] > 0.0
    delays = (out / "delays.csv").read_text(encoding="utf-8").splitlines()
    assert len(delays) == 239
    torques = read_sto(out / "torques.sto")
    first = session.filter_delay + torques.time[0]
    assert first == pytest.approx(0.17, abs=0.011)
    assert len(read_sto(out / "activations.sto").names) == 80
    opened = next(iter(recordings(out).values()))()
    assert opened.tension is not None
    assert opened.motion is not None


def test_what_cannot_be_is_told_before_anything_is_written(data: Callable[[str], Path], tmp_path: Path) -> None:
    model, markers = data(f"{WALK}/subject_walk_scaled.osim"), data(f"{WALK}/markers_walk.trc")
    out = tmp_path / "out"
    for options, told in ((ChainOptions, "cutoff"), (ChainOptions, "late"), (ChainOptions, "blend")):
        with pytest.raises(BadData, match=told):
            options(**{told: 0.0})
    with pytest.raises(BadData, match="--up x"):
        run_live_chain(model, LiveStreams("a", "b", "x"), LiveOutputs(folder=out))
    with pytest.raises(BadData, match="speed -1"):
        run_live_chain(model, LiveFiles(markers, None, -1.0), LiveOutputs(folder=out))
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_the_page_shows_the_newest_frame(walk: tuple[Model, Markers, Wrenches]) -> None:
    """A process of its own answers on the port, takes frames and ends with the session; a taken port is told."""
    pytest.importorskip("viser")
    from myomorph.study.live_page import LivePage

    model, markers, wrenches = walk
    source = Replay(markers, wrenches, 0.0)
    chain = LiveChain(model, source)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    delays = Delays()
    page = LivePage(model, chain, None, port, delays)
    try:
        assert page.port == port
        assert b"<html" in urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=20).read()
        follow_chain(chain, source, late=[page], delays=delays)
        with pytest.raises(BadData, match=f"port {port}"):
            LivePage(model, chain, None, port, delays)
    finally:
        page.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5)


def test_the_table_of_the_page(walk: tuple[Model, Markers, Wrenches]) -> None:
    """Rows stay for a while; what is unknown is a dash."""
    from myomorph.report.live_chain import Rows, Shown, force_ends, live_text

    model = walk[0]
    count, muscles = len(model.coordinates), len(model.muscles)
    forces = np.linspace(0.0, 1000.0, muscles)
    shown = Shown(
        np.zeros(count), np.full(muscles, 0.5), forces, np.linspace(0.0, 100.0, count), np.zeros((1, 6)),
        np.zeros((0, 3)), "", {"Time": "1.00 s"},
    )  # fmt: skip
    rows = Rows(model)
    chosen = rows.of(shown, 10.0)
    assert chosen[0] == list(range(muscles - 8, muscles))
    assert rows.of(replace(shown, forces=forces[::-1]), 10.5) == chosen
    assert rows.of(replace(shown, forces=2.0 * forces[::-1]), 12.5)[0] == list(range(8))
    text = live_text(model, shown, chosen)
    assert f"| {model.muscle_names[-1]} | 0.50 | 1000 N |" in text
    unknown = replace(shown, forces=np.full(muscles, np.nan), activations=np.full(muscles, np.nan), state="no force")
    assert f"| {model.muscle_names[-1]} | — | — |" in live_text(model, unknown, chosen)
    assert "Torques unknown: no force" in live_text(model, unknown, chosen)
    # Half a body weight at (0.3, 0, 0.1), straight up: an arrow of half the length from there.
    up = np.array([0.0, 1.0, 0.0])
    wrench = np.r_[np.cross([0.3, 0.0, 0.1], 400.0 * up), 400.0 * up][None]
    np.testing.assert_allclose(force_ends(wrench, up, 800.0, 1.0)[0], [[0.3, 0.0, 0.1], [0.3, 0.5, 0.1]])
    assert np.isnan(force_ends(0.0 * wrench, up, 800.0, 1.0)).all()


@pytest.mark.long
def test_streams_in_and_out_through_the_real_library(walk: tuple[Model, Markers, Wrenches]) -> None:
    """Markers and plates sent over the loopback, results received from it: every frame, in order, on the right time."""
    pylsl = pytest.importorskip("pylsl")
    from myomorph.study.live_outlet import LabOutlet

    model, markers, wrenches = walk
    name = f"myomorph-chain-{clock.time_ns()}"
    each = total_wrench(*(one[:, :, None] for one in (wrenches.forces, wrenches.points, wrenches.torques)))
    from_then = (wrenches.time >= markers.time[0] - 0.3) & (wrenches.time <= markers.time[-1])
    force_time, rows = wrenches.time[from_then], each[from_then][:, :, [3, 4, 5, 0, 1, 2]].reshape(-1, 12)
    labels = [f"{plate}_{a}{b}" for plate in ("one", "two") for a in "FM" for b in "xyz"]
    outlets = [
        sending(pylsl, f"{name}-markers", 100.0, [f"{one}_{axis}" for one in markers.names for axis in "xyz"]),
        sending(pylsl, f"{name}-plates", 2000.0, labels),
    ]
    if not pylsl.resolve_byprop("name", f"{name}-markers", timeout=5.0):
        pytest.skip("streams are not found on this machine's network")
    source = LabStreams(f"{name}-markers", f"{name}-plates")
    chain = LiveChain(model, source)
    chain.rehearse()
    out = LabOutlet(f"{name}-results", chain, source)
    found = pylsl.resolve_byprop("name", f"{name}-results", timeout=5.0)
    inlet = pylsl.StreamInlet(found[0])
    inlet.open_stream(timeout=5.0)
    began: list[float] = []

    def send() -> None:
        for outlet in outlets:
            while not outlet.have_consumers():
                clock.sleep(0.01)
        first = float(markers.time[0])
        began.append(pylsl.local_clock() + 0.4)
        sample = 0
        for time, row in zip(markers.time, markers.values, strict=True):
            while sample < len(force_time) and force_time[sample] <= time:
                outlets[1].push_sample(rows[sample].tolist(), began[0] + force_time[sample] - first)
                sample += 1
            while pylsl.local_clock() < began[0] + time - first:
                clock.sleep(0.0005)
            outlets[0].push_sample(row.ravel().tolist(), began[0] + float(time) - first)

    sender = threading.Thread(target=send)
    sender.start()
    kept = Kept()
    session = follow_chain(chain, source, [out, kept])
    sender.join()
    samples, stamps = inlet.pull_chunk(timeout=1.0, max_samples=1000)
    out.close()
    assert len(session.delays) + session.delays.dropped == len(markers)
    assert len(samples) == len(session.delays)
    solved = kept.all("state") == SOLVED
    assert solved.any()
    n = len(model.coordinates)
    np.testing.assert_array_equal(np.array(samples)[:, :n], kept.all("coordinates"))
    np.testing.assert_array_equal(np.array(samples)[:, n : 2 * n], kept.all("torques"))
    np.testing.assert_allclose(np.array(stamps), kept.all("time") - chain.filter.delay, atol=1e-9)
    assert session.delays.end_to_end.median > 0.0
    # What was sent is what was computed from: the same as when the recording is played.
    if not session.delays.dropped:
        file = played(model, markers, wrenches)
        both = solved & (file.all("state") == SOLVED)
        np.testing.assert_allclose(kept.all("coordinates")[both], file.all("coordinates")[both], atol=2e-3)


def sending(pylsl: Any, name: str, rate: float, labels: list[str]) -> Any:
    info = pylsl.StreamInfo(name, "Mocap", len(labels), rate, "double64", name)
    channels = info.desc().append_child("channels")
    for label in labels:
        channels.append_child("channel").append_child_value("label", label)
    return pylsl.StreamOutlet(info)
