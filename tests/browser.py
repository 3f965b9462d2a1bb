"""A real browser without a window, driven through its DevTools.

It opens a page, types, clicks, and takes pictures.
"""

from __future__ import annotations

import base64
import io
import json
import os
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--hide-scrollbars",
    "--use-gl=swiftshader",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-background-timer-throttling",
    "--disable-renderer-backgrounding",
)
GONE = "Inspected target navigated"
LATE_UPDATE = "Tried to update non-existent component"
"""How `viser`'s page complains where one drawing of it gets both a change of a control and its
removal: it takes the removal first, and leaves out the change. Nothing is lost, and which messages
share a drawing is chance.
"""


def browser_program() -> str | None:
    """Path of a Chromium: `MYOMORPH_BROWSER`, or the first on the path; None if there is none."""
    named = os.environ.get("MYOMORPH_BROWSER")
    return named or next((found for name in NAMES if (found := shutil.which(name))), None)


class Browser:
    """One page in a browser.

    Parameters
    ----------
    folder : for its profile
    options : of the command line, beside the usual ones
    """

    def __init__(
        self,
        program: str,
        folder: Path,
        width: int = 1440,
        height: int = 900,
        options: Sequence[str] = (),
    ):
        from websockets.sync.client import connect

        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        command = [
            program,
            *OPTIONS,
            *options,
            f"--user-data-dir={folder}",
            f"--window-size={width},{height}",
        ]
        command += [f"--remote-debugging-port={port}", "about:blank"]
        self._process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self._count = 0
        self.errors: list[str] = []
        try:
            address = _page_address(port)
            self._socket = connect(address, max_size=None)
            for domain in ("Page", "Runtime", "Log"):
                self.call(f"{domain}.enable")
            size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
            self.call("Emulation.setDeviceMetricsOverride", **size)
        except BaseException:
            self._process.kill()
            raise

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._process.terminate()
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and wait for its answer; the page's complaints are kept in `errors`."""
        self._count += 1
        self._socket.send(json.dumps({"id": self._count, "method": method, "params": parameters}))
        while True:
            told = json.loads(self._socket.recv(timeout=60))
            if told.get("id") == self._count:
                if "error" in told:
                    raise RuntimeError(f"{method}: {told['error']}")
                return told.get("result", {})
            self._listen(told)

    def _listen(self, told: dict[str, Any]) -> None:
        given = told.get("params", {})
        if told.get("method") == "Runtime.exceptionThrown":
            self.errors.append(_told(given["exceptionDetails"]))
        elif told.get("method") == "Log.entryAdded" and given["entry"]["level"] == "error":
            self.errors.append(f"{given['entry']['text']} {given['entry'].get('url', '')}")
        elif told.get("method") == "Runtime.consoleAPICalled" and given["type"] in (
            "error",
            "assert",
        ):
            text = " ".join(str(one.get("value", one.get("description"))) for one in given["args"])
            if not text.startswith(LATE_UPDATE):
                self.errors.append(text)

    def open(self, address: str) -> None:
        """Go to an address."""
        self.call("Page.navigate", url=address)

    def run(self, script: str) -> Any:
        """Return the value of a JavaScript expression in the page."""
        told = self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in told:
            raise RuntimeError(_told(told["exceptionDetails"]))
        return told["result"].get("value")

    def until(self, script: str, seconds: float = 30.0) -> Any:
        """Wait until an expression is true and return its value; it may fail while loading."""
        guarded = f"(() => {{ try {{ return ({script}); }} catch (error) {{ return false; }} }})()"

        def told() -> Any:
            try:
                return self.run(guarded)
            except RuntimeError as error:
                # Between two pages nothing is true yet.
                if GONE not in str(error):
                    raise
                return False

        return wait(told, seconds, script)

    def press(self, key: str) -> None:
        """Press a key by its name, as "ArrowRight" or "Enter"."""
        code = {
            "ArrowRight": 39,
            "ArrowLeft": 37,
            "ArrowDown": 40,
            "Enter": 13,
            "End": 35,
            "Home": 36,
            "Backspace": 8,
        }[key]
        for kind in ("keyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code
            )

    def type(self, text: str) -> None:
        """Type a text into what has the focus."""
        for one in text:
            self.call("Input.dispatchKeyEvent", type="char", text=one)

    def click(self, x: float, y: float) -> None:
        """Press and release the left button of the mouse at a place of the page [pixels]."""
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def picture(self, path: Path | None = None) -> np.ndarray:
        """Return a picture of the window.

        Parameters
        ----------
        path : of a PNG file that is written too, None for none

        Returns
        -------
        (height, width, 3) red, green and blue in 0..255
        """
        image = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        if path is not None:
            path.write_bytes(image)
        from PIL import Image

        return np.asarray(Image.open(io.BytesIO(image)).convert("RGB"))


def wait(told: Callable[[], Any], seconds: float, what: str) -> Any:
    """Ask until the answer is true."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := told():
            return found
        time.sleep(0.05)
    raise TimeoutError(f"not within {seconds:g} s: {what}")


def _told(details: dict[str, Any]) -> str:
    """Return the message of an exception and where it was thrown, the message first."""
    said = details.get("exception", {})
    message = said.get("description") or said.get("value") or details.get("text")
    return f"{message} {json.dumps(details)}"[:2000]


def _page_address(port: int) -> str:
    def ask() -> str:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=2) as answer:
                pages = [one for one in json.load(answer) if one["type"] == "page"]
            return pages[0]["webSocketDebuggerUrl"] if pages else ""
        except (urllib.error.URLError, ConnectionError, TimeoutError):
            return ""

    return str(wait(ask, 30.0, "the browser's DevTools"))
