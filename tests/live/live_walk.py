"""A recorded walk and what the live chain makes of it, for tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion, Wrenches
from myomorph.core.motion.sync import cut
from myomorph.lab.study.inputs.reading import open_model
from myomorph.live.chain import ChainFrame, LiveChain
from myomorph.live.loop import follow
from myomorph.live.sources import Replay, open_recording

WALK = "rajagopal-walk-emg"


class Kept:
    """An output that remembers."""

    def __init__(self) -> None:
        self.frames: list[ChainFrame] = []

    def put(self, frame: ChainFrame, markers: np.ndarray) -> None:
        """Keep a frame.

        Parameters
        ----------
        frame : of the chain
        markers : (markers, 3) in ground [m], not kept
        """
        self.frames.append(frame)

    def close(self) -> None:
        pass

    def all(self, name: str) -> np.ndarray:
        """Return a result in all frames.

        Parameters
        ----------
        name : of a field of `ChainFrame`

        Returns
        -------
        (frames, ...) its values
        """
        return np.array([getattr(one, name) for one in self.frames])


def recorded_walk(data: Callable[[str], Path]) -> tuple[Model, Markers, Wrenches]:
    model = open_model(data(f"{WALK}/subject_walk_scaled.osim"))
    markers, wrenches = open_recording(
        model, data(f"{WALK}/markers_walk.trc"), data(f"{WALK}/grf_walk.xml")
    )
    assert isinstance(markers, Markers)
    assert wrenches is not None
    return model, cut(markers, 0.5, 1.4), wrenches


def played(model: Model, markers: Markers | Motion, wrenches: Wrenches | None) -> Kept:
    kept = Kept()
    source = Replay(markers, wrenches, 0.0)
    follow(LiveChain(model, source), source, [kept])
    return kept
