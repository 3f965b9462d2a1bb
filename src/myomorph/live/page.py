"""The page of a live session, in a process of its own: drawing never holds up a frame."""

from __future__ import annotations

import contextlib
import multiprocessing
import time as clock
from collections.abc import Mapping
from multiprocessing.connection import Connection

import numpy as np
import psutil

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.model import Model
from myomorph.core.model.surface import Surface
from myomorph.live.chain import ChainFrame, LiveChain
from myomorph.live.live_page import ChainViewer, Shown
from myomorph.live.loop import SOLVED, STATES, Delays

DRAWN = 30.0  # Frames a second that the page is sent [Hz].
# Longest time that the page may take to start, compilation on a new machine included [s].
START = 120.0
LOOK = 200  # Frames that the delay on the page is of.


class LivePage:
    """A page that shows the newest frame and its delays."""

    def __init__(
        self,
        model: Model,
        chain: LiveChain,
        surfaces: Mapping[str, Surface] | None,
        port: int,
        delays: Delays,
    ):
        self._delays = delays
        self._filter_delay = chain.filter.delay
        self._markers = len(chain.poses.marker_names)
        self._pipe: Connection
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        arguments = other, model, dict(surfaces or {}), port, len(chain.bodies)
        self._process = context.Process(target=_serve, args=arguments, daemon=True)
        self._process.start()
        other.close()
        answer = self._answer(START)
        if not isinstance(answer, tuple):
            self._process.join()
            raise answer
        self.port, self.address = answer
        self._ready = True
        self._drawn = 0.0

    def _answer(self, timeout: float) -> tuple[int, str] | MyomorphError:
        try:
            if self._pipe.poll(timeout):
                return self._pipe.recv()
        except (EOFError, OSError):
            pass
        self._process.terminate()
        return MyomorphError(
            f"the page's process did not start (exit status {self._process.exitcode})"
        )

    def put(self, frame: ChainFrame, markers: Array) -> None:
        """Send a frame, unless the page still draws another; a page that is gone is left.

        Parameters
        ----------
        frame : the result
        markers : (markers, 3) as recorded [m]
        """
        now = clock.perf_counter()
        if now - self._drawn < 1.0 / DRAWN:
            return
        try:
            while not self._ready and self._pipe.poll():
                self._pipe.recv()
                self._ready = True
            if self._ready:
                self._pipe.send(self._shown(frame, markers))
                self._ready = False
                self._drawn = now
        except (EOFError, OSError):
            self._drawn = np.inf

    def _shown(self, frame: ChainFrame, markers: Array) -> Shown:
        late = self._delays.recent(LOOK)
        facts = {
            "Time": f"{frame.time:.2f} s",
            "Delay": f"{1e3 * late.median:.1f} ms (99 %: {1e3 * late.late:.1f} ms)",
            "Torques and tensions are older by": f"{1e3 * self._filter_delay:.0f} ms (filter)",
            "Frames dropped": f"{self._delays.dropped}",
        }
        if self._markers:
            facts["Markers"] = f"{frame.seen} of {self._markers}, {1e3 * frame.error:.0f} mm"
        places = np.array(markers) if self._markers else np.zeros((0, 3))
        state = "" if frame.state == SOLVED else STATES[frame.state]
        shared = frame.tension
        limits = frame.limits
        return Shown(
            coordinates=frame.pose,
            activations=shared.activations,
            forces=shared.forces,
            torques=frame.torques,
            wrenches=frame.wrenches,
            markers=places,
            state=state,
            facts=facts,
            torque_limits=None if limits is None else limits.torques[:2],
            force_limits=None if limits is None else limits.forces[:2],
        )

    def close(self) -> None:
        """Take the page down."""
        try:
            self._pipe.send(None)
            self._process.join(5.0)
        except OSError:
            pass
        if self._process.is_alive():
            self._process.terminate()
            self._process.join()
        self._pipe.close()


def _serve(
    pipe: Connection, model: Model, surfaces: Mapping[str, Surface], port: int, wrenches: int
) -> None:
    """Run the page's process: draw what comes, until nothing more does."""
    # The process that computes goes first where both want the same core.
    with contextlib.suppress(psutil.Error, OSError):
        psutil.Process().nice(getattr(psutil, "BELOW_NORMAL_PRIORITY_CLASS", 10))
    try:
        viewer = ChainViewer(model=model, surfaces=surfaces, port=port, wrenches=wrenches)
    except MyomorphError as error:
        pipe.send(error)
        return
    try:
        pipe.send((viewer.port, viewer.address))
        while (shown := pipe.recv()) is not None:
            viewer.show(shown)
            pipe.send(True)
    except (EOFError, OSError, KeyboardInterrupt):
        # The session has ended, or was ended.
        pass
    finally:
        viewer.close()
