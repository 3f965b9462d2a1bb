"""What the page is about: files that come, a session that was found, a run, an answer."""

from __future__ import annotations

import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Literal

from myomorph import __version__
from myomorph.core.model.errors import BadData, BadFile
from myomorph.lab.store.watched import VARIABLE, announcements
from myomorph.show.app.asked import read_asked
from myomorph.show.app.bar import Bar, PlannedJob
from myomorph.show.app.drop import Drop, common_name, endings, new_drop
from myomorph.show.app.paths import free_folder, typed_path
from myomorph.show.app.tasks import ComputeTask, LookTask
from myomorph.show.app.words import in_page_words
from myomorph.show.app.worker import Event, Worker

Phase = Literal["start", "receiving", "looking", "found", "running", "done"]
BUSY = "a computation is running: cancel it first, or wait"


class Desk:
    """State of the page, which several threads change.

    Parameters
    ----------
    home : folder for recordings that are dropped
    """

    def __init__(self, home: Path) -> None:
        self.home = home
        self._lock = threading.RLock()
        self._worker: Worker | None = None
        self._drop: Drop | None = None
        self._progress: Path | None = None
        self._begun = 0.0
        self._clear()

    def _clear(self) -> None:
        self.phase: Phase = "start"
        self.error = ""
        self._reading: Event = {}
        self._found: Event = {}
        self._out = ""
        self._bar = Bar()
        self._planned: Event = {}
        self._failed: list[Event] = []
        self._done: Event = {}
        self._note = ""

    def state(self) -> dict[str, Any]:
        """State as the page shows it."""
        with self._lock:
            return {
                "version": __version__,
                "phase": self.phase,
                "error": in_page_words(self.error),
                "home": str(self.home),
                "endings": endings(),
                "reading": self._reading,
                "found": self._found if self.phase == "found" else {},
                "out": self._out,
                "bar": self._look_at_bar(),
                "note": self._note,
                "assumed": [in_page_words(text) for text in self._planned.get("assumed", ())],
                "failed": self._failed,
                "done": self._done,
            }

    def _look_at_bar(self) -> dict[str, Any]:
        """How far the run is; while kernels compile nothing shows how long it will take."""
        if self.phase != "running":
            return {}
        said = () if self._progress is None else announcements(self._progress)
        look = self._bar.look(said, time.monotonic() - self._begun)
        return look | {"left": ""} if self._note else look

    def begin_drop(self, paths: Sequence[str], sizes: Sequence[int]) -> Path:
        """Begin to take files.

        Parameters
        ----------
        paths : below what was dropped
        sizes : [bytes]

        Returns
        -------
        folder that they go to
        """
        with self._lock:
            self._check_idle()
            if not paths or len(paths) != len(sizes):
                raise BadData("nothing was dropped that holds a recording")
            self._drop = new_drop(free_folder(self.home, common_name(paths)), sizes)
            self._clear()
            self.phase = "receiving"
            return self._drop.folder

    def receive(self, relative: str, stream: IO[bytes], length: int) -> None:
        """Take one of the files."""
        with self._lock:
            drop = self._drop
        if drop is None:
            raise BadData("no files are expected: drop them again")
        drop.receive(relative, stream, length)

    def look_at_drop(self) -> None:
        """Look into the folder of the files that came."""
        with self._lock:
            if self._drop is None:
                raise BadData("nothing was dropped: drop files or a folder")
            folder = self._drop.folder
            self._drop = None
            self._look(folder)

    def look_at(self, text: str) -> None:
        """Look into a folder of this computer, or at a file, that somebody typed."""
        path = Path(typed_path(text))
        if not path.exists():
            raise BadFile(path, "does not exist", "give a folder of recordings, or one recording")
        with self._lock:
            self._check_idle()
            self._look(path)

    def _look(self, folder: Path) -> None:
        self._clear()
        self.phase = "looking"
        self._worker = Worker(LookTask(folder=folder), self._heard)

    def compute(self, raw: Mapping[str, Any]) -> None:
        """Begin to compute what the page asks for.

        Parameters
        ----------
        raw : as sent
        """
        with self._lock:
            self._check_idle()
            if not self._found:
                raise BadData("no recordings yet: drop some first")
            files = {trial["id"]: trial["path"] for trial in self._found["trials"]}
            out = str(typed_path(str(raw.get("out") or self._out)))
            asked = read_asked({**raw, "out": out}, files, self._found["models"])
            self.error = ""
            self._note = ""
            self._out = out
            self._bar = Bar()
            self._planned = {}
            self._failed = []
            self._done = {}
            self._progress = Path(tempfile.mkdtemp(prefix="myomorph"))
            self._begun = time.monotonic()
            self.phase = "running"
            watched = {VARIABLE: str(self._progress)}
            self._worker = Worker(ComputeTask(asked=asked), self._heard, watched)

    def cancel(self) -> None:
        """End what is done now, and go back."""
        with self._lock:
            worker = self._worker
            self._worker = None
            back: dict[Phase, Phase] = {"running": "found", "looking": "start"}
            self.phase = back.get(self.phase, self.phase)
        if worker is not None:
            worker.stop()
        self._forget_progress()

    def start_over(self) -> None:
        """Forget all, for other recordings."""
        self.cancel()
        with self._lock:
            if self._drop is not None:
                # What has come of it is of no use.
                shutil.rmtree(self._drop.folder, ignore_errors=True)
            self._drop = None
            self._clear()

    def change(self) -> None:
        """Go back from the answer to what was found."""
        with self._lock:
            self._check_idle()
            if self._found:
                self.phase = "found"

    @property
    def results(self) -> Path:
        """Folder of the results; raises `BadData` where there are none."""
        with self._lock:
            if not self._done:
                raise BadData("there are no results yet")
            return Path(self._out)

    def _check_idle(self) -> None:
        if self._worker is not None:
            raise BadData(BUSY)

    def _heard(self, worker: Worker, event: Event) -> None:
        """Take an event of a worker; of one that was ended nothing is taken."""
        with self._lock:
            if worker is not self._worker:
                return
            take: Callable[[Event], None] | None = {
                "reading": self._take_reading,
                "found": self._take_found,
                "planned": self._take_planned,
                "ended": self._take_ended,
                "done": self._take_done,
                "failed": self._take_failed,
                "gone": self._take_gone,
                "note": self._take_note,
            }.get(str(event.get("event")))
            if take is not None:
                take(event)

    def _take_reading(self, event: Event) -> None:
        self._reading = event

    def _take_note(self, event: Event) -> None:
        self._note = str(event["text"])

    def _take_found(self, event: Event) -> None:
        self._worker = None
        self._note = ""
        self._found = event["found"]
        self._out = event["out"]
        self.phase = "found"

    def _take_planned(self, event: Event) -> None:
        self._planned = event
        jobs = [
            PlannedJob(
                subject=job["subject"],
                trial=job["trial"],
                steps=tuple(job["steps"]),
                seconds=tuple(job["seconds"]),
            )
            for job in event["jobs"]
        ]
        self._bar = Bar(jobs=jobs, side=max(1, int(event["side"])))

    def _take_ended(self, event: Event) -> None:
        self._bar.ended.add((event["subject"], event["trial"]))
        if event["error"]:
            name = event["trial"] or event["subject"]
            self._failed.append({"name": name, "text": in_page_words(event["error"])})

    def _take_done(self, event: Event) -> None:
        self._worker = None
        self._forget_progress()
        self._done = event
        self.phase = "done"

    def _take_failed(self, event: Event) -> None:
        self._worker = None
        self._forget_progress()
        self.error = str(event["text"])
        self.phase = "found" if self._found else "start"

    def _take_gone(self, event: Event) -> None:
        """Take that the worker ended without having said how it went."""
        self._take_failed({"text": f"the computation ended early: {event['why']}"})

    def _forget_progress(self) -> None:
        with self._lock:
            folder = self._progress
            self._progress = None
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
