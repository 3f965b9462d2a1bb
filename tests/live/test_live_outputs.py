"""What takes the results of a live session: a folder, a page, a stream.

Also the latency that is reported.
"""

import json
import socket
import threading
import time as clock
import urllib.error
import urllib.request
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from live_walk import WALK, Kept, played, recorded_walk

from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Wrenches
from myomorph.core.motion.sync import cut
from myomorph.lab.study.trial.viewing import recordings
from myomorph.live.chain import SETTLING, SOLVED, ChainFrame, ChainOptions, LiveChain
from myomorph.live.limits import LimitOptions
from myomorph.live.loop import Delays, Spread, follow
from myomorph.live.online_identification import total_wrench
from myomorph.live.run import LiveFiles, LiveOutputs, LiveStreams, run_live_chain
from myomorph.live.sources import Replay
from myomorph.live.streams import LabStreams


@pytest.fixture(scope="module")
def walk(data: Callable[[str], Path]) -> tuple[Model, Markers, Wrenches]:
    return recorded_walk(data)


class _Slow:
    """An output that takes its time."""

    def __init__(self, seconds: float, frames: int):
        self.seconds = seconds
        self.frames = frames
        self.times = []

    def put(self, frame: ChainFrame, markers: np.ndarray) -> None:
        self.times.append(frame.time)
        if len(self.times) <= self.frames:
            clock.sleep(self.seconds)


def test_what_cannot_keep_up_drops_the_oldest_frames(walk: tuple[Model, Markers, Wrenches]) -> None:
    """At 100 Hz with 30 ms a frame most are dropped, and the order stays."""
    model, markers, wrenches = walk
    source = Replay(markers, wrenches, 1.0)
    slow = _Slow(0.03, 1000)
    session = follow(LiveChain(model, source), source, [slow])
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
    session = run_live_chain(
        data(f"{WALK}/subject_walk_scaled.osim"), files, LiveOutputs(folder=out)
    )
    assert sorted(one.name for one in out.iterdir()) == [
        "activations.sto",
        "coordinates.mot",
        "delays.csv",
        "forces.sto",
        "live.nc",
        "session.json",
        "torques.sto",
    ]
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
    assert opened.kinematics is not None


def test_the_movement_decides_the_filter_where_no_cutoff_is_stated() -> None:
    assert ChainOptions().used_cutoff == 6.0
    assert ChainOptions(movement="running").used_cutoff == 12.0
    assert ChainOptions(movement="running", cutoff=8.0).used_cutoff == 8.0
    with pytest.raises(UnknownName, match="flying"):
        ChainOptions(movement="flying")


def test_what_cannot_be_is_told_before_anything_is_written(
    data: Callable[[str], Path], tmp_path: Path
) -> None:
    model = data(f"{WALK}/subject_walk_scaled.osim")
    markers = data(f"{WALK}/markers_walk.trc")
    out = tmp_path / "out"
    for options, told in (
        (ChainOptions, "cutoff"),
        (ChainOptions, "max_age"),
        (ChainOptions, "blend"),
    ):
        with pytest.raises(BadData, match=told):
            options(**{told: 0.0})
    with pytest.raises(BadData, match="--up x"):
        run_live_chain(model, LiveStreams("a", "b", "x"), LiveOutputs(folder=out))
    with pytest.raises(BadData, match="speed -1"):
        run_live_chain(model, LiveFiles(markers, None, -1.0), LiveOutputs(folder=out))
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_the_page_shows_the_newest_frame(walk: tuple[Model, Markers, Wrenches]) -> None:
    """A process of its own answers on the port, takes frames and ends with the session.

    A port in use is reported.
    """
    pytest.importorskip("viser")
    from myomorph.live.page import LivePage

    model, markers, wrenches = walk
    source = Replay(markers, wrenches, 0.0)
    chain = LiveChain(model, source)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    delays = Delays()
    page = LivePage(model=model, chain=chain, surfaces=None, port=port, delays=delays)
    try:
        assert page.port == port
        assert b"<html" in urllib.request.urlopen(page.address, timeout=20).read()
        follow(chain, source, late=[page], delays=delays)
        with pytest.raises(BadData, match=f"port {port}"):
            LivePage(model=model, chain=chain, surfaces=None, port=port, delays=delays)
    finally:
        page.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(page.address, timeout=5)


def test_the_table_of_the_page(walk: tuple[Model, Markers, Wrenches]) -> None:
    """Rows stay for a while; what is unknown is a dash."""
    from myomorph.live.live_page import Rows, Shown, force_ends, live_text

    model = walk[0]
    count = len(model.coordinates)
    muscles = len(model.muscles)
    forces = np.linspace(0.0, 1000.0, muscles)
    shown = Shown(
        coordinates=np.zeros(count),
        activations=np.full(muscles, 0.5),
        forces=forces,
        torques=np.linspace(0.0, 100.0, count),
        wrenches=np.zeros((1, 6)),
        markers=np.zeros((0, 3)),
        state="",
        facts={"Time": "1.00 s"},
    )
    rows = Rows(model)
    chosen = rows.of(shown, 10.0)
    assert chosen[0] == list(range(muscles - 8, muscles))
    assert rows.of(replace(shown, forces=forces[::-1]), 10.5) == chosen
    assert rows.of(replace(shown, forces=2.0 * forces[::-1]), 12.5)[0] == list(range(8))
    text = live_text(model, shown, chosen)
    assert f"| {model.muscle_names[-1]} | 0.50 | 1000 N |" in text
    unknown = replace(
        shown,
        forces=np.full(muscles, np.nan),
        activations=np.full(muscles, np.nan),
        state="no force",
    )
    assert f"| {model.muscle_names[-1]} | — | — |" in live_text(model, unknown, chosen)
    assert "Torques unknown: no force" in live_text(model, unknown, chosen)
    limits = np.stack([forces - 10.0, forces + 25.0])
    text = live_text(model, replace(shown, force_limits=limits), chosen)
    assert "| Muscle | activation | tension | 90 % limits |" in text
    assert f"| {model.muscle_names[-1]} | 0.50 | 1000 N | 990 to 1025 |" in text
    assert text.count("90 % limits") == 1, "of torques none are known"
    # Half a body weight at (0.3, 0, 0.1), straight up: an arrow of half the length from there.
    up = np.array([0.0, 1.0, 0.0])
    wrench = np.r_[np.cross([0.3, 0.0, 0.1], 400.0 * up), 400.0 * up][None]
    np.testing.assert_allclose(
        force_ends(wrench, up, 800.0, 1.0)[0], [[0.3, 0.0, 0.1], [0.3, 0.5, 0.1]]
    )
    assert np.isnan(force_ends(0.0 * wrench, up, 800.0, 1.0)).all()


def test_a_stream_that_is_announced_but_silent_is_told() -> None:
    """As where the sender was killed, or a firewall stands between."""

    def silent(*_: object, **__: object) -> None:
        raise RuntimeError("the operation failed due to a timeout.")

    library = SimpleNamespace(
        proc_clocksync=1,
        proc_dejitter=4,
        proc_monotonize=8,
        resolve_byprop=lambda key, value, timeout: ["found"],
        StreamInlet=lambda found, processing_flags: SimpleNamespace(info=silent),
    )
    with pytest.raises(BadData, match="stream 'Cameras' is announced but does not respond"):
        LabStreams("Cameras", "", library=library)


def test_a_stream_has_limits_behind_its_results(walk: tuple[Model, Markers, Wrenches]) -> None:
    """All channels are repeated for lower, and again for upper bounds.

    Their units are the same and in the same order.
    """
    from myomorph.live.streams import LabOutlet

    labels = []
    rows = []
    described = SimpleNamespace(
        append_child=lambda name: described,
        append_child_value=lambda key, text: labels.append(text) if key == "label" else None,
    )
    library = SimpleNamespace(
        StreamInfo=lambda *_: SimpleNamespace(desc=lambda: described),
        StreamOutlet=lambda info: SimpleNamespace(
            push_sample=lambda row, stamp: rows.append(row.copy())
        ),
        local_clock=lambda: 0.0,
    )
    model, markers, wrenches = walk
    source = Replay(cut(markers, 0.5, 0.9), wrenches, 0.0)
    chain = LiveChain(model, source, limits=LimitOptions(4))
    follow(chain, source, [LabOutlet(name="results", chain=chain, source=source, library=library)])
    count = 2 * len(model.coordinates) + len(model.muscles)
    assert len(labels) == 3 * count == len(rows[-1])
    assert labels[count : 2 * count] == [f"{one}_low" for one in labels[:count]]
    assert np.isnan(rows[0][count:]).all()
    values, low, high = rows[-1].reshape(3, count)
    assert np.isfinite(rows[-1]).all()
    assert (low <= high).all()
    assert np.mean((low <= values) & (values <= high)) > 0.7


class _Sender(threading.Thread):
    """Markers and plates of a recording, sent over the loopback at their times."""

    def __init__(self, pylsl: Any, name: str, markers: Markers, wrenches: Wrenches) -> None:
        super().__init__()
        self._pylsl = pylsl
        self._markers = markers
        each = total_wrench(
            *(one[:, :, None] for one in (wrenches.forces, wrenches.points, wrenches.torques))
        )
        from_then = (wrenches.time >= markers.time[0] - 0.3) & (wrenches.time <= markers.time[-1])
        self._force_time = wrenches.time[from_then]
        self._rows = each[from_then][:, :, [3, 4, 5, 0, 1, 2]].reshape(-1, 12)
        axes = [f"{one}_{axis}" for one in markers.names for axis in "xyz"]
        labels = [f"{plate}_{a}{b}" for plate in ("one", "two") for a in "FM" for b in "xyz"]
        self._marker_outlet = sending(pylsl, f"{name}-markers", 100.0, axes)
        self._plate_outlet = sending(pylsl, f"{name}-plates", 2000.0, labels)

    def run(self) -> None:
        """Send all frames, each when it is due."""
        for outlet in (self._marker_outlet, self._plate_outlet):
            while not outlet.have_consumers():
                clock.sleep(0.01)
        first = float(self._markers.time[0])
        began = self._pylsl.local_clock() + 0.4
        sample = 0
        for time, row in zip(self._markers.time, self._markers.values, strict=True):
            while sample < len(self._force_time) and self._force_time[sample] <= time:
                stamp = began + self._force_time[sample] - first
                self._plate_outlet.push_sample(self._rows[sample].tolist(), stamp)
                sample += 1
            while self._pylsl.local_clock() < began + time - first:
                clock.sleep(0.0005)
            self._marker_outlet.push_sample(row.ravel().tolist(), began + float(time) - first)


@pytest.mark.long
def test_streams_in_and_out_through_the_real_library(walk: tuple[Model, Markers, Wrenches]) -> None:
    """Markers and plates sent over the loopback, results received from it.

    Every frame arrives, in order, at the right time.
    """
    pylsl = pytest.importorskip("pylsl")
    from myomorph.live.streams import LabOutlet

    model, markers, wrenches = walk
    name = f"myomorph-chain-{clock.time_ns()}"
    sender = _Sender(pylsl, name, markers, wrenches)
    if not pylsl.resolve_byprop("name", f"{name}-markers", timeout=5.0):
        pytest.skip("streams are not found on this machine's network")
    source = LabStreams(f"{name}-markers", f"{name}-plates")
    chain = LiveChain(model, source)
    chain.warm_up()
    out = LabOutlet(f"{name}-results", chain, source)
    inlet = pylsl.StreamInlet(pylsl.resolve_byprop("name", f"{name}-results", timeout=5.0)[0])
    inlet.open_stream(timeout=5.0)

    sender.start()
    kept = Kept()
    session = follow(chain, source, [out, kept])
    sender.join()
    samples, stamps = inlet.pull_chunk(timeout=1.0, max_samples=1000)
    out.close()
    assert len(session.delays) + session.delays.dropped == len(markers)
    assert len(samples) == len(session.delays)
    both = np.hstack([kept.all("coordinates"), kept.all("torques")])
    np.testing.assert_array_equal(np.array(samples)[:, : both.shape[1]], both)
    np.testing.assert_allclose(np.array(stamps), kept.all("time") - chain.filter.delay, atol=1e-9)
    assert session.delays.end_to_end.median > 0.0
    assert (kept.all("state") == SOLVED).any()
    if not session.delays.dropped:
        _check_played(kept, walk)


def _check_played(kept: Kept, walk: tuple[Model, Markers, Wrenches]) -> None:
    """Check that results are those of what was sent: the same as of the played recording."""
    file = played(*walk)
    both = (kept.all("state") == SOLVED) & (file.all("state") == SOLVED)
    np.testing.assert_allclose(
        kept.all("coordinates")[both], file.all("coordinates")[both], atol=2e-3
    )


def sending(pylsl: Any, name: str, rate: float, labels: list[str]) -> Any:
    info = pylsl.StreamInfo(name, "Mocap", len(labels), rate, "double64", name)
    channels = info.desc().append_child("channels")
    for label in labels:
        channels.append_child("channel").append_child_value("label", label)
    return pylsl.StreamOutlet(info)
