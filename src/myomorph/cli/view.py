"""`view`."""

from __future__ import annotations

import threading
import webbrowser
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.cli.output import said


def view_command(
    folders: Annotated[
        list[Path], Parameter(help="Folder of results; several are shown in one scene, with one clock.")
    ],
    /,
    *,
    port: Annotated[int | None, Parameter(help="Port of the page; any free one by default.")] = None,
    browser: Annotated[bool, Parameter(help="Open the page in the browser.")] = True,
) -> int:
    """Show results in a web page: the body moves, with its muscles, forces, markers and curves."""
    from myomorph.demo.jump import demo_model
    from myomorph.study.trial.viewing import open_replay

    def served(opened: int) -> None:
        address = f"http://127.0.0.1:{opened}"
        said(f"{address} (for this machine only; Ctrl-C ends)")
        if browser:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    try:
        replay = open_replay(folders, port, served, demo_model)
        try:
            replay.wait()
        finally:
            replay.close()
    except KeyboardInterrupt:
        pass
    return 0
