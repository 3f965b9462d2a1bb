import time as clock
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from threadpoolctl import threadpool_info, threadpool_limits

from myomorph.body.identify.base import BaseOptions, fit_base
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.recordings import NO_FORCE
from myomorph.core.model.errors import BadData, MyomorphError, UnknownName
from myomorph.core.model.model import Model
from myomorph.core.model.segments import segments_of
from myomorph.core.model.series import Markers, Motion, Wrenches
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.viewer.web_page import BodyView, half_blocks, open_server
from myomorph.live.identification import LiveOptions, identify_frames, source_of
from myomorph.live.identification_page import Clock, live_markdown, live_panel, move_next
from myomorph.live.online_identification import (
    OnlineIdentification,
    OnlineOptions,
    OnlineState,
    total_wrench,
)
from myomorph.live.sequential import SequentialFit
from myomorph.live.sources import LiveRecording, Replay, open_recording
from myomorph.live.streams import LabStreams, force_channels, marker_channels

FRAMES = 120
OPTIONS = OnlineOptions(cutoff=6.0, missing=1e9)


@pytest.fixture(scope="module")
def walk(data: Callable[[str], Path]) -> tuple[Model, LiveRecording]:
    folder = data("opensim-gait-subject01") / "ref_id"
    model = open_model(folder / "subject01.osim")
    return model, open_recording(
        model, folder / "subject01_walk1_ik.mot", folder / "subject01_walk1_grf.xml", (0.5, 2.5)
    )


@pytest.fixture(scope="module")
def marked(walk: tuple[Model, LiveRecording]) -> tuple[Model, Markers, Wrenches]:
    """Return the walk as markers would show it: the positions of the model's own markers."""
    from myomorph.core.model.model import Marker

    model, recording = walk
    # The file has no markers of its own: three a body keep every coordinate in sight.
    places = np.vstack([np.zeros(3), 0.1 * np.eye(3)])
    made = tuple(
        Marker(f"{body}-{i}", body, place)
        for body in model.body_names
        for i, place in enumerate(places)
    )
    model = model.with_markers(made)
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(recording.motion))  # type: ignore[arg-type]
    bodies = np.array([tree.body_index[marker.body] for marker in made])
    points = poses.points(bodies, np.array([marker.location for marker in made]))
    return model, Markers(recording.motion.time, model.marker_names, points), recording.wrenches


class _Seen:
    """A display that remembers."""

    def __init__(self) -> None:
        self.states: list[OnlineState] = []
        self.clocks: list[Clock] = []
        self.poses = 0
        self.closed = False

    def pose(self, coordinates: np.ndarray, markers: np.ndarray | None) -> None:
        self.poses += 1

    def show(self, state: OnlineState, at: Clock) -> None:
        self.states.append(state)
        self.clocks.append(at)

    def close(self) -> None:
        self.closed = True


def test_the_end_is_the_batch(walk: tuple[Model, LiveRecording]) -> None:
    """A live session ends with what the batch finds from all of it, to 1e-8.

    Both use the same filter.
    """
    model, recording = walk
    result = identify_frames(
        model, Replay(recording.motion, recording.wrenches, 0.0), online=OPTIONS
    )
    online = result.identification
    filtered = online.filter.motion(result.motion)
    forces = _filtered_forces(online, recording.wrenches, filtered.time, model.body_names[0])
    use = np.isin(np.round(filtered.time, 6), np.round(online.used, 6))
    assert use.sum() == len(online.used) > 90
    options = BaseOptions(
        correlated=False,
        moment_noise=float(online.sigma[0]),
        force_noise=float(online.sigma[3]),
    )
    batch = fit_base(
        model,
        [Recording(filtered, forces, use)],
        online.base,
        options,
    )
    size = np.maximum(np.abs(batch.estimate), batch.size)
    np.testing.assert_allclose(result.state.fit.estimate / size, batch.estimate / size, atol=1e-8)


def _filtered_forces(
    online: OnlineIdentification, wrenches: Wrenches, time: np.ndarray, body: str
) -> Wrenches:
    """Return the total wrench on a body at times (frames,), filtered as the stream's."""
    total = total_wrench(wrenches.forces, wrenches.points, wrenches.torques)
    half = online.force_filter.half
    smooth = online.force_filter.values(total)
    clock = wrenches.time[half:-half]
    at = np.stack([np.interp(time, clock, column) for column in smooth.T], axis=1)
    return Wrenches(
        time=time,
        names=("all",),
        bodies=(body,),
        forces=at[:, None, 3:],
        points=np.zeros((len(at), 1, 3)),
        torques=at[:, None, :3],
    )


def test_what_came_is_kept(walk: tuple[Model, LiveRecording]) -> None:
    model, recording = walk
    result = identify_frames(
        model, Replay(recording.motion, recording.wrenches, 0.0), online=OPTIONS
    )
    np.testing.assert_array_equal(result.motion.time, recording.motion.time)
    for name in recording.motion.names:
        np.testing.assert_array_equal(result.motion[name], recording.motion[name])
    whole = total_wrench(
        recording.wrenches.forces, recording.wrenches.points, recording.wrenches.torques
    )
    kept = total_wrench(result.wrenches.forces, result.wrenches.points, result.wrenches.torques)
    np.testing.assert_allclose(kept, whole[-len(kept) :], atol=1e-9)
    assert "least '" in result.summary()


def test_matrices_of_one_frame_wake_no_threads(
    walk: tuple[Model, LiveRecording], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The number of threads is checked before, in and after the loop.

    Warming up with more threads took several times as long as all frames.
    """
    threads: list[int] = []
    propose = SequentialFit.propose

    def counted(self: SequentialFit, *args: Any, **options: Any) -> Any:
        threads.extend(one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas")
        return propose(self, *args, **options)

    monkeypatch.setattr(SequentialFit, "propose", counted)
    model, recording = walk
    with threadpool_limits(limits=2, user_api="blas"):
        identify_frames(model, Replay(recording.motion, recording.wrenches, 0.0))
    assert threads
    assert set(threads) == {1}


def test_markers_lead_to_the_same_as_coordinates(
    walk: tuple[Model, LiveRecording], marked: tuple[Model, Markers, Wrenches]
) -> None:
    model, markers, wrenches = marked
    by_markers = identify_frames(model, Replay(markers, wrenches, 0.0), online=OPTIONS)
    by_coordinates = identify_frames(model, Replay(walk[1].motion, wrenches, 0.0), online=OPTIONS)
    assert by_markers.marker_rms < 1e-5
    assert by_markers.state.fit.frames == by_coordinates.state.fit.frames
    np.testing.assert_allclose(by_markers.state.levels, by_coordinates.state.levels, atol=2e-3)


def test_a_recording_plays_in_its_own_time(walk: tuple[Model, LiveRecording]) -> None:
    _, recording = walk
    now = [100.0]
    source = Replay(
        motion=recording.motion, wrenches=recording.wrenches, speed=2.0, now=lambda: now[0]
    )
    assert len(source.take().motion_time) == 1
    now[0] += 0.5
    arrived = source.take()
    np.testing.assert_allclose(
        arrived.motion_time[-1], recording.motion.time[0] + 1.0, atol=1.0 / 60.0
    )
    assert arrived.force_time[-1] <= recording.motion.time[0] + 1.0 + 1e-9
    assert not source.done
    now[0] += 5.0
    source.take()
    assert source.done


def test_displays_see_the_body_take_color(walk: tuple[Model, LiveRecording]) -> None:
    """At ten times the recording's speed the display shows what is identifiable.

    It never shows less than before.
    """
    model, recording = walk
    seen = _Seen()
    result = identify_frames(
        model, Replay(recording.motion, recording.wrenches, 4.0), online=OPTIONS, displays=[seen]
    )
    assert len(seen.states) >= 2
    progress = [one.fit.progress for one in seen.states]
    assert progress == sorted(progress)
    assert seen.clocks[-1].now == pytest.approx(2.0, abs=0.05)
    assert seen.poses > 5
    assert result.state.fit.frames == seen.states[-1].fit.frames


def test_the_terminal_tells_segments_and_what_to_move(walk: tuple[Model, LiveRecording]) -> None:
    model, recording = walk
    state = identify_frames(
        model, Replay(recording.motion, recording.wrenches, 0.0), online=OPTIONS
    ).state
    segments = segments_of(model)
    view = BodyView(model)
    body = half_blocks(view.pixels(state.pose, state.levels, 40, 50))
    console = Console(width=140, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(live_panel(state, model.body_names, segments, Clock(2.0, 2.0), body))
    text = console.export_text()
    assert move_next(state, segments) in text
    assert "Upper trunk" in text
    assert f"{state.fit.frames} used of {state.frames}" in text
    assert text.count("right") >= 3
    assert "▀" in text
    assert (
        f"| upper trunk | {100 * state.levels[model.body_names.index('torso')]:.0f} % |"
        in live_markdown(state, model.body_names, segments, Clock(2.0))
    )


def test_the_picture_shows_levels(walk: tuple[Model, LiveRecording]) -> None:
    """Blue where everything is identifiable, red where nothing is.

    The picture follows the body through the room.
    """
    model, _ = walk
    view = BodyView(model)
    count = len(model.bodies)
    rest = np.array([coordinate.default for coordinate in model.coordinates])
    known = view.pixels(rest, np.full(count, 1.0), 40, 60)
    unknown = view.pixels(rest, np.full(count, 0.0), 40, 60)
    inside = known[..., 3] > 200
    assert 0.05 < inside.mean() < 0.6
    assert (known[inside][:, 2] > known[inside][:, 0]).all()
    assert (unknown[inside][:, 0] > unknown[inside][:, 2]).all()
    away = rest.copy()
    away[model.coordinate_names.index("pelvis_tx")] += 7.0
    np.testing.assert_array_equal(view.pixels(away, np.ones(count), 40, 60)[..., 3], known[..., 3])


def test_sources_that_cannot_be() -> None:
    time = np.arange(10) / 100.0
    motion = Motion(time, ("a",), np.zeros((10, 1)))
    zero = np.zeros((10, 1, 3))
    with pytest.raises(BadData, match="need both"):
        source_of(None, LiveOptions(lsl_markers="Cameras"))
    with pytest.raises(BadData, match="needs a recording"):
        source_of(None, LiveOptions())
    with pytest.raises(BadData, match="speed -1"):
        Replay(
            motion,
            Wrenches(
                time=time, names=("p",), bodies=("a",), forces=zero, points=zero, torques=zero
            ),
            -1.0,
        )
    with pytest.raises(BadData, match="no time in common"):
        Replay(
            motion,
            Wrenches(
                time=time + 9.0, names=("p",), bodies=("a",), forces=zero, points=zero, torques=zero
            ),
        )


def test_without_any_force_nothing_is_pretended(walk: tuple[Model, LiveRecording]) -> None:
    model, recording = walk
    wrenches = recording.wrenches
    nothing = np.full_like(wrenches.forces, np.nan)
    lost = Wrenches(
        time=wrenches.time,
        names=wrenches.names,
        bodies=wrenches.bodies,
        forces=nothing,
        points=wrenches.points,
        torques=wrenches.torques,
    )
    with pytest.raises(BadData, match=f"none of the .* {NO_FORCE}"):
        identify_frames(
            model, source_of(LiveRecording(recording.motion, lost), LiveOptions(speed=0.0))
        )


def test_channels_of_markers() -> None:
    labels = ["LASI_x", "LASI_y", "LASI_z", "RASI:X", "RASI:Y", "RASI:Z", "frame"]
    names, columns, scale = marker_channels(labels, ["mm"] * 6 + [""])
    assert names == ("LASI", "RASI")
    assert columns.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert scale == 1e-3
    for bad, told in (
        (["LASI_x", "LASI_y"], "only x, y"),
        (["one", "two"], "expected NAME_x"),
    ):
        with pytest.raises(BadData, match=told):
            marker_channels(bad, ["m"] * len(bad))
    with pytest.raises(BadData, match="'furlong'"):
        marker_channels(labels[:3], ["furlong"] * 3)


def test_channels_of_forces_mean_the_same_wrench() -> None:
    """One wrench in two forms of channels.

    The forms are force, point and free torque, and force and moment about the origin.
    """
    rng = np.random.default_rng(0)
    forces, points, torques = rng.standard_normal((3, 5, 1, 3)) * [
        [[[400.0]]],
        [[[1.0]]],
        [[[3.0]]],
    ]
    total = total_wrench(forces, points, torques)
    names, nine = force_channels(
        [f"one_{a}{b}" for a in "FPT" for b in "xyz"], [""] * 3 + ["mm"] * 3 + [""] * 3
    )
    np.testing.assert_allclose(
        nine(np.hstack([forces[:, 0], 1e3 * points[:, 0], torques[:, 0]]))[:, 0], total
    )
    assert names == ("one",)
    _, six = force_channels([f"{a}{b}" for a in "FM" for b in "xyz"], [""] * 6)
    np.testing.assert_allclose(six(np.hstack([total[:, 3:], total[:, :3]]))[:, 0], total)
    with pytest.raises(BadData, match="plate 'one'"):
        force_channels(["one_Fx", "one_Fy"], ["", ""])
    with pytest.raises(BadData, match="expected NAME_Fx"):
        force_channels(["time"], [""])


class FakeInlet:
    """What a stream has sent so far, at once."""

    def __init__(self, info: Any, processing_flags: int = 0):
        self._info = info
        self.sent = False

    def info(self, timeout: float) -> Any:
        return self._info

    def open_stream(self, timeout: float) -> None:
        pass

    def time_correction(self, timeout: float) -> float:
        return 0.0

    def pull_sample(self, timeout: float) -> tuple[None, None]:
        clock.sleep(timeout)
        return None, None

    def pull_chunk(self, timeout: float, max_samples: int) -> tuple[list[list[float]], list[float]]:
        if self.sent:
            return [], []
        self.sent = True
        return self._info.rows.tolist(), self._info.time.tolist()


class FakeChannel:
    def __init__(self, labels: list[str], at: int = 0):
        self.labels = labels
        self.at = at

    def child(self, name: str) -> "FakeChannel":
        return self

    def child_value(self, name: str) -> str:
        return self.labels[self.at] if name == "label" else ""

    def next_sibling(self, name: str) -> "FakeChannel":
        return FakeChannel(self.labels, self.at + 1)


def _stream(
    name: str, rate: float, labels: list[str], time: np.ndarray, rows: np.ndarray
) -> SimpleNamespace:
    return SimpleNamespace(
        name=lambda: name,
        time=time,
        rows=rows,
        desc=lambda: FakeChannel(labels),
        channel_count=lambda: len(labels),
        nominal_srate=lambda: rate,
    )


def network(*streams: SimpleNamespace) -> SimpleNamespace:
    return SimpleNamespace(
        proc_clocksync=1,
        proc_dejitter=4,
        proc_monotonize=8,
        StreamInlet=FakeInlet,
        local_clock=clock.monotonic,
        resolve_byprop=lambda key, value, timeout: [one for one in streams if one.name() == value],
        resolve_streams=lambda wait: list(streams),
    )


def laboratory(markers: Markers, wrenches: Wrenches) -> tuple[SimpleNamespace, SimpleNamespace]:
    places = [f"{name}_{axis}" for name in markers.names for axis in "xyz"]
    total = total_wrench(wrenches.forces, wrenches.points, wrenches.torques)
    plates = [f"all_{a}{b}" for a in "FM" for b in "xyz"]
    rows = np.hstack([total[:, 3:], total[:, :3]])
    return (
        _stream(
            "Cameras", markers.rate, places, markers.time, markers.values.reshape(len(markers), -1)
        ),
        _stream("Plates", Replay(markers, wrenches).force_rate, plates, wrenches.time, rows),
    )


def test_streams_give_what_a_file_gives(
    marked: tuple[Model, Markers, Wrenches], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("myomorph.live.streams.SILENCE", 0.3)
    model, markers, wrenches = marked
    source = LabStreams("Cameras", "Plates", library=network(*laboratory(markers, wrenches)))
    result = identify_frames(model, source, online=OPTIONS)
    played = identify_frames(model, Replay(markers, wrenches, 0.0), online=OPTIONS)
    assert result.state.fit.frames == played.state.fit.frames
    np.testing.assert_allclose(
        result.state.fit.estimate, played.state.fit.estimate, rtol=1e-6, atol=1e-6
    )


def test_a_stream_that_is_not_there_is_told(marked: tuple[Model, Markers, Wrenches]) -> None:
    _, markers, wrenches = marked
    with pytest.raises(UnknownName, match="'Cameras'"):
        LabStreams("Camera", "Plates", wait=0.1, library=network(*laboratory(markers, wrenches)))


def test_a_stream_that_lies_about_its_rate_is_told(marked: tuple[Model, Markers, Wrenches]) -> None:
    cameras, plates = laboratory(*marked[1:])
    plates.nominal_srate = lambda: 2000.0
    with pytest.raises(BadData, match="'Plates' states 2000 samples a second, but sends 600"):
        LabStreams("Cameras", "Plates", library=network(cameras, plates)).take()


@pytest.mark.long
def test_streams_through_the_real_library(
    marked: tuple[Model, Markers, Wrenches], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An outlet in this process, over the loopback: the same frames arrive as were sent."""
    import threading
    import time

    pylsl = pytest.importorskip("pylsl")
    model, markers, wrenches = marked
    monkeypatch.setattr("myomorph.live.streams.SILENCE", 2.0)
    outlets = []
    for one in laboratory(markers, wrenches):
        labels = one.desc().labels
        info = pylsl.StreamInfo(
            f"myomorph-test-{one.name()}",
            "Mocap",
            len(labels),
            one.nominal_srate(),
            "double64",
            "x",
        )
        channels = info.desc().append_child("channels")
        for label in labels:
            channels.append_child("channel").append_child_value("label", label)
        outlets.append((pylsl.StreamOutlet(info), one))
    if not pylsl.resolve_byprop("name", "myomorph-test-Cameras", timeout=5.0):
        pytest.skip("streams are not found on this machine's network")
    source = LabStreams("myomorph-test-Cameras", "myomorph-test-Plates")

    def send() -> None:
        for outlet, _ in outlets:
            while not outlet.have_consumers():
                time.sleep(0.01)
        began = pylsl.local_clock() + 0.3
        first = float(markers.time[0])
        # At the pace of a laboratory: sent at once, forces and markers would overtake each other.
        samples = [
            (moment, i, row)
            for i, (_, one) in enumerate(outlets)
            for moment, row in zip(one.time, one.rows, strict=True)
        ]
        for moment, i, row in sorted(samples, key=lambda sample: sample[:2]):
            if moment >= first - 0.3:
                due = began + moment - first
                time.sleep(max(0.0, due - pylsl.local_clock()))
                outlets[i][0].push_sample(row.tolist(), due)

    sender = threading.Thread(target=send)
    sender.start()
    result = identify_frames(model, source, online=OPTIONS)
    sender.join()
    assert result.frames == len(markers)
    assert result.marker_rms < 1e-5
    assert result.state.fit.frames > 0.8 * len(markers)


def test_the_page_of_the_viewer(walk: tuple[Model, LiveRecording]) -> None:
    """The page answers, and takes poses, markers and colors."""
    import socket
    import urllib.request

    pytest.importorskip("viser")
    from myomorph.live.identification_page import WebDisplay

    model, recording = walk
    state = identify_frames(
        model, Replay(recording.motion, recording.wrenches, 0.0), online=OPTIONS
    ).state
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    viewer = WebDisplay(model=model, segments={}, surfaces=None, port=port)
    try:
        assert b"<html" in urllib.request.urlopen(viewer.address, timeout=10).read()
        viewer.pose(np.zeros(len(model.coordinates)), np.array([[0.0, 1.0, 0.0], [np.nan] * 3]))
        viewer.show(state, Clock(1.0, 2.0))
    finally:
        viewer.close()
    with pytest.raises(BadData, match="1 to 65535"):
        WebDisplay(model=model, segments={}, surfaces=None, port=0)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    import builtins

    real = builtins.__import__

    def without(name: str, *rest: Any, **named: Any) -> Any:
        if name in ("viser", "pylsl"):
            raise ImportError(f"No module named '{name}'")
        return real(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MyomorphError, match=r"pip install 'myomorph\[live\]'"):
        LabStreams("a", "b")
    with pytest.raises(MyomorphError, match=r"pip install 'myomorph\[view\]'"):
        open_server(None, "")
