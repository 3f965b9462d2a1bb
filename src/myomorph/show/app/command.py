"""`app`."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from pathlib import Path

from myomorph.core.model.errors import BadData
from myomorph.lab.cli.options import documented
from myomorph.lab.cli.output import said
from myomorph.show.app.desk import Desk
from myomorph.show.app.paths import documents_folder
from myomorph.show.app.server import AppServer

LOOK = 0.5  # How often the program looks whether it shall end [s].


@documented
def app_command(
    folder: Path | None = None,
    /,
    *,
    out: Path | None = None,
    port: int | None = None,
    browser: bool = True,
) -> int:
    """Open a page on this machine: drop recordings, look over what was found, read the answer.

    Parameters
    ----------
    folder : folder of recordings that is opened at the start
    out : folder for dropped recordings and their results; by default Myomorph in your documents
        folder
    port : port of the page; a free one by default
    browser : open the page in the browser
    """
    desk = Desk((out or documents_folder()).resolve())
    server = _opened(desk, port)
    if folder is not None:
        desk.look_at(str(folder.resolve()))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    address = server.access.address
    said(f"{address} (for this machine only; Ctrl-C ends)")
    if browser:
        threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
    try:
        while not server.ended.wait(LOOK):
            pass
    except KeyboardInterrupt:
        said("ended")
    finally:
        server.shutdown()
        desk.cancel()
        server.server_close()
    return 0


def _opened(desk: Desk, port: int | None) -> AppServer:
    if port is not None and not 0 < port < 65536:
        raise BadData(f"port {port}: expected 1 to 65535")
    try:
        return AppServer(desk, port)
    except OSError as error:
        raise BadData(
            f"port {port} cannot be used ({error.strerror or error}): name another"
        ) from None


def main() -> int:
    """Open the page from an icon: there is no terminal, and nothing is printed."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    return app_command()
