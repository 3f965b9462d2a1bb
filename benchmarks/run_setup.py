"""OpenSim on a setup file, in a process of its own: `python benchmarks/run_setup.py SETUP TOOL`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

SECONDS = 300


def run_in_opensim(setup: Path, tool: str) -> str:
    """Run OpenSim's tool on a setup file; what it said where it failed, "" where not."""
    command = [sys.executable, __file__, str(setup), tool]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    if done.returncode == 0:
        return ""
    if done.returncode < 0:
        return f"ends by signal {-done.returncode}"
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return next(
        (line for line in lines if line.startswith(("RuntimeError", "AttributeError"))),
        (lines or ["?"])[-1],
    )


if __name__ == "__main__":
    import opensim

    opensim.Logger.setLevelString("Off")
    path = Path(sys.argv[1])
    os.chdir(path.parent)
    tool = getattr(opensim, sys.argv[2])(path.name)
    sys.exit(0 if tool.run() else 3)
