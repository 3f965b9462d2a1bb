"""What checks of forces and markers found.

A study prints it, it is counted in outcomes, and the report shows it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from myomorph.core.model.causes import PLATES
from myomorph.core.model.findings import Finding
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.lab.cli.running import print_outcome
from myomorph.lab.report.page.parts import PageHead
from myomorph.lab.report.trial.report_input import ReportInput
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.results import new_result, put_findings, read_result
from myomorph.lab.store.stored import put_torques
from myomorph.lab.study.step.step import step_of
from myomorph.lab.study.trial.steps.id import FINDINGS, Torques

TIME = np.arange(4) / 10.0
FOUND = (
    Finding(
        kind="wrong foot",
        place="F1",
        text=PLATES.message("force 'F1' acts under calcn_l: put there"),
        times=(),
        repaired=True,
    ),
)


def test_findings_reach_the_report(tmp_path) -> None:
    with new_result(tmp_path / "x.nc") as writer:
        writer.time(TIME)
        put_torques(writer, Series(TIME, ("a",), np.zeros((4, 1))), None)
        put_findings(writer, FINDINGS, FOUND)
    given = ReportInput(PageHead(title="", date="", version="", warnings=("of a file",)))
    shown = step_of("id").show(given, read_result(tmp_path / "x.nc"))
    assert shown.head.warnings == ("of a file", FOUND[0].text)


def test_findings_are_printed_with_their_trial(capsys) -> None:
    three = np.zeros((4, 0, 3))
    wrenches = Wrenches(
        time=TIME, names=(), bodies=(), forces=three, points=three, torques=three, findings=FOUND
    )
    torques = Torques(
        Motion(TIME, ("a",), np.zeros((4, 1))), Series(TIME, ("a",), np.zeros((4, 1))), wrenches
    )
    outcome = step_of("id").outcome(Outcome("s01", "walk", Path("x"), frames=4), torques)
    assert outcome.findings == (FOUND[0].text,)
    print_outcome(outcome)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("s01/walk: 4 frames")
    assert lines[1] == f"  {PLATES.severity}: {PLATES.title} (F1)"
    assert lines[2] == f"    {FOUND[0].text}"
    assert lines[3] == f"    {PLATES.effect} {PLATES.remedy}"
