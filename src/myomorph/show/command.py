"""`demo`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from myomorph.core.model.errors import check_extra
from myomorph.core.model.extension import DemoEntry, load
from myomorph.core.model.registry import with_extensions
from myomorph.lab.cli.options import Threads, documented, use_threads
from myomorph.lab.cli.output import said
from myomorph.lab.cli.running import AS_USUAL, BAD_INPUT, OUR_FAULT
from myomorph.lab.cli.study import run_plan
from myomorph.show.extension import EXTENSION

USUAL = "simulated"


def _help(demos: dict[str, DemoEntry]) -> str:
    return "; ".join(f"{name}: {demo.help}" for name, demo in demos.items()) + "."


DEMOS: dict[str, DemoEntry] = {
    **EXTENSION.demos,
    **with_extensions({}, "demo", lambda extension: extension.demos),
}
"""All demonstrations, those of this wing first."""
StudyName: Any = Annotated[Literal[tuple(DEMOS)], Parameter(help=_help(DEMOS))]


@documented
def demo_command(
    *, out: Path = Path("demo"), study: StudyName = USUAL, threads: Threads = None
) -> int:
    """Run the main job on data that come with the installation, from markers to a report.

    Parameters
    ----------
    out : folder for the results
    study : the demonstration
    threads : number of threads; all cores by default
    """
    use_threads(threads)
    demo = DEMOS[study]
    for module, package in demo.needs.items():
        check_extra(demo.extra, module, package)
    status: int = load(demo.run)(study, out)
    return status


def run_recorded(name: str, out: Path) -> int:
    """Run the steps of a trial on a demonstration's recording; the exit status."""
    from myomorph.lab.study.trial.reporting import REPORT
    from myomorph.show.demo.demos import run_demo

    outcome = run_demo(name, out)
    if outcome.error:
        sys.stderr.write(f"error: {outcome.error}\n")
        return OUR_FAULT if outcome.fault else BAD_INPUT
    said(
        f"{outcome.frames} frames through {', '.join(outcome.done)}; markers' root mean square"
        f" error {100 * outcome.rms:.2f} cm"
    )
    said(f"report: {(out / REPORT).resolve()}")
    return 0


def run_performed(name: str, out: Path) -> int:
    """Simulate a performance as files and run its study; the exit status.

    Errors of the contact forces against the true ones are written beside the results.
    """
    from myomorph.lab.study.plan.plan import read_plan
    from myomorph.lab.study.trial.reporting import REPORT
    from myomorph.show.demo.performances import ERRORS, write_errors, write_performance

    written = write_performance(name, out)
    said(f"simulated; to run it again: myomorph run {written.study} --out {out / 'results'}")
    results = out / "results"
    status = run_plan(read_plan(written.study), results, AS_USUAL)
    if status == 0:
        skills = write_errors(written, results, out / ERRORS)
        said(f"skill of contact forces against a constant guess of each: {skills}")
        said(f"errors of contact forces against the true ones: {out / ERRORS}")
        said(f"report: {(results / written.results / REPORT).resolve()}")
    return status
