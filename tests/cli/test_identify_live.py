from collections.abc import Callable
from pathlib import Path

import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.lab.cli import main


def test_a_recording_is_shown_and_identified(
    data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Played as fast as possible, with no terminal to draw on.

    The output is one line on what is identifiable, then the model.
    """
    folder = data("opensim-gait-subject01") / "ref_id"
    out = tmp_path / "identified.osim"
    status = main(
        [
            "identify",
            "--live",
            "--speed",
            "0",
            "--model",
            str(folder / "subject01.osim"),
            "--cutoff",
            "6",
        ]
        + [
            "--motion",
            str(folder / "subject01_walk1_ik.mot"),
            "--loads",
            str(folder / "subject01_walk1_grf.xml"),
        ]
        + [
            "--mass",
            "72.6",
            "--mass-sd",
            "0.2",
            "--no-compare",
            "--time",
            "0.5",
            "2.3",
            "--out",
            str(out),
        ]
    )
    told = capsys.readouterr()
    assert status == 0, told.err
    assert "subject01_walk1_ik.mot: 109 frames" in told.err
    assert "kept up with" in told.err
    assert read_osim(out).mass == pytest.approx(72.6, abs=1e-6)
    assert (tmp_path / "identified_identification" / "report.html").is_file()


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ([], "--live needs a recording"),
        (["--lsl-markers", "Cameras"], "--lsl-markers NAME and --lsl-forces NAME"),
    ],
)
def test_frames_must_come_from_somewhere(
    given: list[str],
    told: str,
    data: Callable[[str], Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    model = data("opensim-gait-subject01") / "ref_id/subject01.osim"
    status = main(
        ["identify", "--live", "--model", str(model), "--out", str(tmp_path / "no.osim"), *given]
    )
    error = capsys.readouterr().err
    assert status == 2
    assert told in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())
