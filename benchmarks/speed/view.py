"""Seconds from the command to the first pose in a browser.

Frames a second while the demo's jump plays are measured too. The browser has no window and no
graphics card. Without a browser its rows are left out.
"""

from __future__ import annotations

import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path

from tests.browser import Browser, browser_program

from myomorph.lab.study.trial.viewing import open_replay
from myomorph.lab.viewer.replay import Replay

ROUNDS = 5
SECONDS = 10.0
DRAWS = 8
"""Things drawn in one frame from which on the body is there, not the floor alone."""

WATCH = """
window.bodyFrames = 0; let draws = 0;
for (const name of ['drawElements', 'drawElementsInstanced', 'drawArrays', 'drawArraysInstanced']) {
    const draw = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function (...given) {
        draws += 1;
        return draw.apply(this, given);
    };
}
(function count() {
    if (draws >= DRAWS) window.bodyFrames += 1;
    draws = 0; requestAnimationFrame(count);
})();
""".replace("DRAWS", str(DRAWS))

Row = dict[str, object]


def run() -> list[Row]:
    """Rows of what was waited for, and of what plays."""
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "demo"
        command = [
            sys.executable,
            "-m",
            "myomorph",
            "demo",
            "--study",
            "jump",
            "--out",
            str(result),
        ]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        program = browser_program()
        if program is None:
            return [*started(result, None), played(result, None)]
        with Browser(program, Path(folder) / "profile") as browser:
            browser.call("Page.addScriptToEvaluateOnNewDocument", source=WATCH)
            browser.call("Performance.enable")
            return [*started(result, browser), played(result, browser)]


def started(result: Path, browser: Browser | None) -> list[Row]:
    """Measure seconds from a fresh process to its address, to its page, and to the body.

    The browser is open already.
    """
    waits: dict[str, list[float]] = {}
    for _ in range(ROUNDS):
        began = time.perf_counter()
        command = [sys.executable, "-m", "myomorph", "view", str(result), "--no-browser"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            address = re.findall(r"http://\S+", process.stdout.readline())[0]
            waits.setdefault("address printed", []).append(time.perf_counter() - began)
            urllib.request.urlopen(address).read()
            waits.setdefault("page served", []).append(time.perf_counter() - began)
            if browser is not None:
                browser.open(address)
                browser.until("window.bodyFrames > 0", 60)
                waits.setdefault("first pose in the browser", []).append(
                    time.perf_counter() - began
                )
            process.terminate()
    return [{"what": name, "seconds": statistics.median(found)} for name, found in waits.items()]


def played(result: Path, browser: Browser | None) -> Row:
    """Frames a second that are sent, what each costs, and how many the browser draws."""
    replay = open_replay([result])
    address = f"http://127.0.0.1:{replay.port}"
    try:
        if browser is not None:
            browser.open(address)
            browser.until("window.bodyFrames > 0", 60)
            time.sleep(2.0)
        replay.play(True)
        time.sleep(1.0)
        before = _state(browser)
        sent = replay.drawn
        used = time.process_time()
        began = time.perf_counter()
        time.sleep(SECONDS)
        passed, used, sent = (
            time.perf_counter() - began,
            time.process_time() - used,
            replay.drawn - sent,
        )
        after = _state(browser)
        row: Row = {
            "what": "playback at full speed",
            "muscles": len(replay.bodies[0].muscles),
            "tubes": len(replay.bodies[0].tube_muscles),
            "frames sent a second": sent / passed,
            "processor of the program [ms/frame]": 1e3 * used / max(sent, 1),
        }
        if browser is not None:
            drawn = max(after["frames"] - before["frames"], 1.0)
            row |= {
                "frames drawn a second, without a graphics card": drawn / passed,
                "page's own thread [ms/frame drawn]": (
                    1e3 * (after["busy"] - before["busy"]) / drawn
                ),
            }
        row |= _traffic(replay)
        return row | {"cores": os.cpu_count() or 0, "load": os.getloadavg()[0]}
    finally:
        replay.close()


def _state(browser: Browser | None) -> dict[str, float]:
    """Frames drawn so far, and seconds of processor that the page's own thread took."""
    if browser is None:
        return {}
    told = {one["name"]: one["value"] for one in browser.call("Performance.getMetrics")["metrics"]}
    return {"frames": float(browser.run("window.bodyFrames")), "busy": told["ThreadTime"]}


def _traffic(replay: Replay) -> Row:
    """Bytes and packets a frame, as a second page receives them."""
    import viser
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    counts = {"bytes": 0, "packets": 0}
    over = threading.Event()
    address = f"ws://127.0.0.1:{replay.port}"
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    with connect(address, subprotocols=[protocol], max_size=None) as page:

        def listen() -> None:
            while not over.is_set():
                try:
                    told = page.recv(timeout=0.2)
                except TimeoutError:
                    continue
                counts["bytes"] += len(told)
                counts["packets"] += 1

        thread = threading.Thread(target=listen, daemon=True)
        thread.start()
        time.sleep(2.0)
        before = dict(counts)
        drawn = replay.drawn
        time.sleep(4.0)
        after = dict(counts)
        frames = replay.drawn - drawn
        over.set()
        thread.join()
    each = {name: (after[name] - before[name]) / max(frames, 1) for name in counts}
    return {"kB a frame": each["bytes"] / 1e3, "packets a frame": each["packets"]}
