"""External forces beside the motion they are said to belong to, while one check follows another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.contact.foot_poses import FootPoses
from myomorph.contact.force_samples import Change, ForceSamples, changed_wrenches, sampled
from myomorph.model.arrays import Array, runs
from myomorph.model.findings import Finding
from myomorph.model.series import Wrenches

LOADED = 0.05
"""Share of the weight from which a force counts as load."""

SHORTEST = 0.05
"""A load that is shorter is not judged [s]."""


class Inspection:
    """Forces beside the motion they are said to belong to, while one check follows another.

    Attributes
    ----------
    feet : where the feet are
    wrenches : with what was put right so far
    numbers : of the wrenches that act on a foot, or on a body that is not known yet
    findings : so far
    kept_as_measured : names of forces that are no foot's as they are, so that no foot is looked for
    """

    def __init__(self, wrenches: Wrenches, feet: FootPoses, mend: bool):
        self.wrenches, self.feet, self.mend = wrenches, feet, mend
        self.findings: list[Finding] = []
        self.kept_as_measured: set[str] = set()
        self._sample()

    def _sample(self) -> None:
        """Sample the wrenches anew."""
        self.numbers = np.array(
            [index for index, body in enumerate(self.wrenches.bodies) if not body or body in self.feet.owners], np.int64
        )
        samples = sampled(self.wrenches, self.feet.time, LOADED * self.feet.model.weight)
        known = np.asarray(np.isfinite(self.feet.center).all(axis=1))
        self.samples = replace(samples, loaded=samples.loaded & known[:, None])

    def weights(self, number: int) -> Array:
        """Size of a force where it is loaded, else 0 (frames,) [N]."""
        size = np.linalg.norm(self.samples.forces[:, number], axis=1)
        return np.asarray(np.where(self.samples.loaded[:, number], size, 0.0))

    def misfit(self, number: int, samples: ForceSamples | None = None) -> float:
        """Mean distance of a force's center of pressure to the nearest foot, weighted by the force [m]."""
        weights = self.weights(number)
        centers = (samples or self.samples).centers(self.feet.up)[:, [number]]
        distances = np.nan_to_num(self.feet.distances(centers)[:, 0].min(axis=1), nan=0.0)
        return float(np.average(distances, weights=weights)) if weights.any() else 0.0

    def episodes(self, number: int) -> list[slice]:
        """Frames of each stretch of time in which a force is loaded and nearest to one foot."""
        results = []
        time = self.feet.time
        distances = self.feet.distances(self.samples.centers(self.feet.up)[:, [number]])[:, 0]
        nearest = np.argmin(np.nan_to_num(distances, nan=9.0), axis=1)
        for foot in range(len(self.feet.feet)):
            for start, stop in runs(self.samples.loaded[:, number] & (nearest == foot)):
                if time[stop - 1] - time[start] >= SHORTEST:
                    results.append(slice(start, stop))
        return sorted(results, key=lambda result: result.start)

    def name(self, number: int) -> str:
        """Name of a force."""
        return self.wrenches.names[number]

    def change(self, number: int, change: Change) -> None:
        """Put one force right, where that is wanted; the checks that follow see it put right in any case."""
        self.samples = self.samples.changed(number, change)
        self.wrenches = changed_wrenches(self.wrenches, number, change)

    def put(self, wrenches: Wrenches) -> None:
        """Take other wrenches in the place of those so far."""
        self.wrenches = wrenches
        self._sample()

    def found(
        self, kind: str, place: str, text: str, mended: str = "", advice: str = "", times: tuple[slice, ...] = ()
    ) -> None:
        """Note a finding; `mended` is what was done about it, `advice` what helps where nothing was."""
        done = bool(mended) and self.mend
        time = self.feet.time
        spans = tuple((float(time[span.start]), float(time[span.stop - 1])) for span in times)
        helps = mended if done else advice
        self.findings.append(Finding(kind, place, f"{text}: {helps}" if helps else text, spans, done))
