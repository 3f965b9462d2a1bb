"""`report`: pages of results, of two sessions compared, and as PDF files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.core.model.errors import BadData
from myomorph.lab.cli.options import documented
from myomorph.lab.cli.output import said
from myomorph.lab.study.trial.result_folders import demo_model, folder_reader


@documented
@dataclass(frozen=True, kw_only=True)
class PageFlags:
    """How results are shown.

    Attributes
    ----------
    preset : kind of motion, which determines the panels shown: taichi, tap, drum, judo, gait, lift
        or motion; by default the one that fits the recording
    times : times at which the body is pictured [s]; by default those of events
    norms : reference data of gait.html: result folders of a control group, a file of 'myomorph
        norms', adults, or none; by default adults, if age and walking speed are within their range
    """

    preset: str = ""
    times: tuple[float, ...] = ()
    norms: tuple[str, ...] = ()


PageOptions = Annotated[PageFlags, Parameter(name="*")]
AS_IT_FITS = PageFlags()


@documented
def report_command(
    folders: tuple[Path, ...],
    /,
    *,
    shown: PageOptions = AS_IT_FITS,
    out: Path | None = None,
    pdf: bool = False,
) -> int:
    """Make report.html of results and of a walk gait.html; of two folders a page that compares.

    Parameters
    ----------
    folders : folder of results; two folders are two sessions of one person, whose walks are
        compared
    shown : how results are shown
    out : page that compares two folders; compare.html by default
    pdf : also write the pages as PDF files, which needs an installed Chrome, Edge or Chromium
    """
    from myomorph.lab.report.page.printed import Browser

    # That none is installed is said before anything is computed.
    browser = Browser.found() if pdf else None
    if len(folders) == 2:
        pages = _compared(folders, out or Path("compare.html"))
    elif len(folders) == 1 and out is None:
        pages = _reports(folders[0], shown)
    elif len(folders) == 1:
        raise BadData(f"--out {out}: a report is written into its folder; --out needs two folders")
    else:
        raise BadData(f"{len(folders)} folders: give one, or two whose walks are to be compared")
    for page in pages:
        said(f"wrote {page}")
    if browser is not None:
        for page in pages:
            said(f"wrote {browser.print_pdf(page)}")
    return 0


def _reports(folder: Path, shown: PageFlags) -> list[Path]:
    """Make the pages of one folder, and name those on gait too."""
    reader = folder_reader(folder, lambda extension: extension.reports)
    if reader is not None:
        return [reader.read(folder)]
    from myomorph.lab.report.trial.gait.gait_page import GAIT_PAGE
    from myomorph.lab.study.trial.reporting import report_folder

    reports = report_folder(
        folder,
        preset=shown.preset,
        times=shown.times,
        demo_model=demo_model,
        norms=shown.norms,
    )
    places = (place for report in reports for place in (report, report.with_name(GAIT_PAGE)))
    return [place for place in places if place.is_file()]


def _compared(folders: Sequence[Path], out: Path) -> list[Path]:
    """Make the page of two folders."""
    from myomorph.lab.study.trial.comparing import compare_folders

    first, second = folders
    return [compare_folders(first, second, out, demo_model)]
