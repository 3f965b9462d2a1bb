"""What EMG and torques cannot both have: in the result file, and as a table of the report."""

from __future__ import annotations

import pytest

from myomorph.core.tension.emg_conflicts import EmgConflict
from myomorph.lab.store.results import new_result, read_result
from myomorph.lab.store.stored_tension import get_conflicts, put_conflicts


@pytest.mark.parametrize("count", [0, 2])
def test_conflicts_come_back_from_a_result_file(tmp_path, count):
    given = (
        EmgConflict(
            muscle="soleus_r", coordinate="", start=0.1, stop=0.3, worst=0.2, emg=0.8, found=0.45
        ),
        EmgConflict(
            muscle="",
            coordinate="knee_angle_r",
            start=0.5,
            stop=0.6,
            worst=0.55,
            emg=40.0,
            found=-6.0,
        ),
    )[:count]
    with new_result(tmp_path / "one.nc", "tension") as writer:
        put_conflicts(writer, given)
    assert get_conflicts(read_result(tmp_path / "one.nc")) == given


def test_the_report_has_a_section_on_conflicts(arm, command):
    """The flexor's EMG is silent in a part in which the torque needs it."""
    lines = arm.emg.read_text().splitlines()
    head = lines.index("endheader") + 2
    silent = [row.split("\t") for row in lines[head:]]
    rows = ["\t".join([row[0], "0.0" if k > 30 else row[1]]) for k, row in enumerate(silent)]
    arm.emg.write_text("\n".join([*lines[:head], *rows]) + "\n")
    told = (
        "tension",
        "--model",
        arm.model,
        "--motion",
        arm.motion,
        "--loads",
        arm.loads,
        "--emg",
        arm.emg,
    )
    options = ("--emg-weight", 10, "--emg-gains", "normalized", "--emg-delay", 0.0)
    found = command(*told, *options, "--out", arm.out)
    assert found.status == 0, found.err
    assert command("report", arm.out).status == 0
    page = next(arm.out.glob("*.html")).read_text()
    assert "EMG against joint torques" in page
