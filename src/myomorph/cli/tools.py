"""`run-tool`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.cli.options import Threads, use_threads
from myomorph.cli.output import said, warn


def run_tool_command(
    setup: Annotated[Path, Parameter(help="OpenSim setup file (.xml) of one of the four tools.")],
    /,
    *,
    threads: Threads = None,
) -> int:
    """Run an OpenSim setup file: ScaleTool, InverseKinematicsTool, InverseDynamicsTool or AnalyzeTool."""
    from myomorph.opensim_tools.run import run_tool

    use_threads(threads)
    result = run_tool(setup)
    warn(result.warnings)
    for line in result.lines:
        said(f"{result.tool}: {line}")
    for path in result.written:
        said(f"wrote {path}")
    return 0
