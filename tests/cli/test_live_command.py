from collections.abc import Callable
from pathlib import Path

import pytest

from myomorph.lab.cli import main

WALK = "rajagopal-walk-emg"


def test_a_recording_is_followed_and_its_delays_told(
    data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = data(WALK)
    out = tmp_path / "live"
    files = ["--markers", str(folder / "markers_walk.trc"), "--loads", str(folder / "grf_walk.xml")]
    model = ["--model", str(folder / "subject_walk_scaled.osim")]
    status = main(["live", *model, *files, "--speed", "4", "--cutoff", "8", "--out", str(out)])
    told = capsys.readouterr()
    assert status == 0, told.err
    assert "from frame to result: median" in told.out
    assert "the filter's delay of 0.0421 s apart" in told.out
    assert f"wrote {out}" in told.out
    assert (out / "torques.sto").is_file()


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ([], "either a recording (--markers FILE, --imu FILE ...) or a stream"),
        (["--markers", "walk.trc", "--lsl-markers", "Cameras"], "either a recording"),
        (["--lsl-markers", "Cameras", "--loads", "grf.xml"], "give --lsl-forces NAME"),
        (["--markers", "walk.trc", "--lsl-forces", "Plates"], "give --loads FILE"),
        (["--markers", "walk.trc", "--lsl-imu", "Sensors"], "either a recording"),
        (["--imu", "walk.mvnx"], "--imu-pose FILE"),
        (["--markers", "nowhere.trc"], "nowhere.trc"),
        (["--markers", "MARKERS", "--loads", "TABLE"], "no columns of a force"),
        (["--markers", "MARKERS", "--cutoff", "-1"], "cutoff -1"),
        (["--markers", "MARKERS", "--speed", "-1"], "speed -1"),
        (["--markers", "MARKERS", "--speed", "0", "--web", "0"], "port 0"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    given: list[str],
    told: str,
    data: Callable[[str], Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = data(WALK)
    places = {"MARKERS": str(folder / "markers_walk.trc"), "TABLE": str(folder / "id_walk.sto")}
    options = [places.get(one, one) for one in given]
    model = ["--model", str(folder / "subject_walk_scaled.osim")]
    status = main(["live", *model, *options, "--out", str(tmp_path / "out")])
    error = capsys.readouterr().err
    assert status == 2
    assert told in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())
