"""The page on a calibrated body."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from myomorph import __version__
from myomorph.report.page.parts import Note, PageHead, SourceFile
from myomorph.report.trial.given import ReportInput
from myomorph.report.trial.identified import IdentificationInput, calibrated_body
from myomorph.report.trial.trial_page import report_page
from myomorph.study.trial.reporting import surfaces_of

if TYPE_CHECKING:
    from myomorph.study.subject.calibrated import Calibrated


def calibration_page(calibrated: Calibrated) -> str:
    """Lengths and markers before and after as HTML text, see `report_page`."""
    found, made = calibrated.found, calibrated.provenance
    surfaces = surfaces_of(found.model)
    return report_page(
        ReportInput(
            PageHead(
                title=f"{found.model.name}: calibrated body",
                date=made.date,
                version=__version__,
                notes=(Note("real", f"Recordings: {', '.join(calibrated.recordings)}."),),
                sources=tuple(SourceFile(one.role, Path(one.name).name, one.sha256) for one in made.sources),
                warnings=calibrated.warnings,
            ),
            model=found.model,
            surfaces=surfaces,
            identification=IdentificationInput(
                found.model, calibration=calibrated_body(found, calibrated.recordings), surfaces=surfaces
            ),
        )
    )
