"""One command from a laboratory's raw file to a report."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.lab.cli import main
from myomorph.lab.study.inputs.reading import read_recording
from myomorph.lab.study.trial.load import load

pytest.importorskip("myo_sim")


@pytest.mark.long
def test_plug_in_gait_to_a_report(data, tmp_path, capsys) -> None:
    """Ankle moments agree with those that Plug-in Gait left in the file.

    They are compared over the stance on a plate.
    """
    path = data("c3d-gait-plugingait/HC030A/Straight/HC030A05.c3d")
    out = tmp_path / "walk"
    assert main(["analyze", str(path), "--mass", "45.8", "--out", str(out), "--workers", "1"]) == 0
    printed = capsys.readouterr().out
    assert "marker protocol Plug-in Gait" in printed
    assert "HC030A01.c3d beside the recording is the static trial" in printed
    assert (out / "HC030A05" / "report.html").is_file()
    found = load(out)["HC030A05"]
    points = read_recording(path).other_points
    reference = -1e-3 * 45.8 * points["RAnkleMoment"][:, 0]
    ours = np.interp(points.time, found.torques.time, found.torques["ankle_angle_r"])
    column = found.wrenches.bodies.index("calcn_r")
    loaded = np.interp(points.time, found.wrenches.time, found.wrenches.forces[:, column, 1]) > 30.0
    # Filtered forces begin a frame before the foot does, where the file has no moment.
    assert np.isnan(reference[loaded]).sum() <= 2
    loaded &= np.isfinite(reference)
    assert loaded.sum() > 30
    assert np.corrcoef(ours[loaded], reference[loaded])[0, 1] > 0.99
    assert found.fit.rms.mean() < 0.006


def test_markers_without_a_protocol_stop_with_one_line(data, tmp_path, capsys) -> None:
    path = data("wheelchair-pushrim/kinematics/sample_propulsion.c3d")
    assert main(["analyze", str(path), "--mass", "70", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    for word in ("those of an arm", "no known label on upper_arm", "--protocol", "--model"):
        assert word in said
