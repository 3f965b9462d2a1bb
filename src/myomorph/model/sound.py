"""What microphones recorded: channels of sound with their clock."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import index_of


@dataclass(frozen=True, eq=False)
class Sound:
    """Channels of one recording, all on one clock.

    Attributes
    ----------
    rate : samples per second [Hz]
    names : one per channel
    samples : (samples, channels) in shares of full scale, -1 to 1; single precision
    start : time of the first sample on the motion's clock [s]
    warnings : what looks wrong, one line each
    source : path of the file, "" for a sound made in memory
    """

    rate: float
    names: tuple[str, ...]
    samples: np.ndarray
    start: float = 0.0
    warnings: tuple[str, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        samples = np.array(self.samples, dtype=np.float32)
        samples.setflags(write=False)
        object.__setattr__(self, "samples", samples)
        if samples.ndim != 2 or samples.shape[1] != len(self.names):
            raise BadData(f"expected samples of shape (..., {len(self.names)}), but got {samples.shape}")
        if not (np.isfinite(self.rate) and self.rate > 0.0):
            raise BadData(f"a sound of {self.rate:g} samples per second: expected a rate above 0")

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, name: str) -> np.ndarray:
        """Channel of that name, (samples,); raises `UnknownName`."""
        channel: np.ndarray = self.samples[:, index_of("sound channel", name, self.names, "the recording")]
        return channel

    @property
    def duration(self) -> float:
        """[s]."""
        return len(self.samples) / self.rate

    @property
    def time(self) -> Array:
        """(samples,) [s]."""
        time: Array = self.start + np.arange(len(self.samples)) / self.rate
        return time

    def starting(self, start: float) -> Sound:
        """The same sound whose first sample is at `start` on the motion's clock [s]."""
        return replace(self, start=start)
