"""Bones of a virtual specimen from clusters of three markers.

Measured are noise, and faults of markers and wires.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

Row = dict[str, object]

ARMS = (0.03, 0.04, 0.05)
CUTOFF = 8.0
NOISE = 3e-4
SECONDS = 12.0
SLIP = {"elbow_flexion_r": np.deg2rad(5.0)}


@lru_cache(maxsize=1)
def _virtual() -> Any:
    """Specimen 1 of [S]: three releases without muscles, an exact plate on the markers' clock."""
    from myomorph.swings.simulate.laboratory import Noise
    from myomorph.swings.simulate.shoulder import Setup, virtual_specimen

    return virtual_specimen(1, seconds=SECONDS, setup=Setup(noise=Noise(0.0, 0.0, 0.0)))


def _trials(
    arm: float, noise: float, slip: Mapping[str, float] | None = None
) -> tuple[Any, list[Any], list[Any]]:
    """Return the specimen with clusters of an arm [m], and its trials with noise [m].

    The truth of each trial is returned too. `slip` is added to what the wires hold [rad].
    """
    from myomorph.swings.simulate.laboratory import Instruments, Noise, measured_markers
    from myomorph.swings.simulate.limb import HeldLimb, with_clusters
    from myomorph.swings.simulate.shoulder import HELD
    from myomorph.swings.viscosity.specimen.model import SwingTrial

    virtual = _virtual()
    random = np.random.default_rng(7)
    specimen = with_clusters(virtual.specimen, arm)
    held = HELD | {name: HELD.get(name, 0.0) + more for name, more in (slip or {}).items()}
    on_base, on_limb = HeldLimb(specimen, held).markers()
    stand = specimen.stand
    center = specimen.center_in_ground
    at_base = {name: center + stand.rotation @ place for name, place in on_base.items()}
    trials = [
        SwingTrial(
            one.name,
            measured_markers(
                one.exact, center, at_base, on_limb, Instruments(Noise(marker=noise), random)
            ),
            one.wrenches,
        )
        for one in virtual.without.trials
    ]
    return specimen, trials, [one.exact for one in virtual.without.trials]


def _errors(tracked: Any, exact: list[Any], cutoff: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Return errors of the humerus' rotation [degrees] and of its rates [rad/s], along its axes.

    Each has the shape (frames, 3).
    """
    from myomorph.swings.viscosity.tracking.tracked import swing_recordings

    turns = []
    rates = []
    for one, truth in zip(swing_recordings(tracked, cutoff, muscles=False), exact, strict=True):
        true = truth.every(round((one.time[1] - one.time[0]) / (truth.time[1] - truth.time[0])))
        use = one.used
        apart = np.einsum("fji,fjk->fik", true.rotations[use], one.rotations[use])
        turns.append(np.degrees(Rotation.from_matrix(apart).as_rotvec()))
        rates.append((one.rates - true.rates)[use])
    return np.concatenate(turns), np.concatenate(rates)


def measure_noise() -> Iterable[Row]:
    """Yield a row for each size of cluster.

    It has errors of a frame by itself and through the filter, as root mean squares.
    """
    from myomorph.swings.simulate.shoulder import HELD
    from myomorph.swings.viscosity.tracking.track import track
    from myomorph.swings.viscosity.tracking.tracked import TrackingOptions

    for arm in ARMS:
        specimen, trials, exact = _trials(arm, NOISE)
        tracked = track(specimen, trials, TrackingOptions(clock=False))
        row: Row = {"longest arm of the clusters": f"{1000 * arm:.0f} mm"}
        # The humerus' second axis is its length.
        for word, cutoff in (("a frame", None), (f"at {CUTOFF:.0f} Hz", CUTOFF)):
            turn, rate = _errors(tracked, exact, cutoff)
            turn = np.sqrt(np.mean(turn**2, axis=0))
            rate = np.sqrt(np.mean(rate**2, axis=0))
            row[f"twist, {word} [deg]"] = float(turn[1])
            row[f"other axes, {word} [deg]"] = float(turn[[0, 2]].max())
        row["rates at 8 Hz: twist [rad/s]"] = float(rate[1])
        row["others [rad/s]"] = float(rate[[0, 2]].max())
        held = [tracked.held[name] - HELD.get(name, 0.0) for name in tracked.held]
        row["held angles, largest [deg]"] = float(np.degrees(np.abs(held).max()))
        center = tracked.specimen.center_in_ground - specimen.center_in_ground
        row["joint's center [mm]"] = 1000 * float(np.linalg.norm(center))
        yield row


def _hidden(values: np.ndarray, column: dict[str, int], time: np.ndarray) -> None:
    values[(time > 3.0) & (time < 9.0), column["humerus_r_2"]] = np.nan


def _lost(values: np.ndarray, column: dict[str, int], time: np.ndarray) -> None:
    for i in (1, 2, 3):
        values[(time > 3.0) & (time < 9.0), column[f"humerus_r_{i}"]] = np.nan


def _exchange(one: str, other: str) -> Callable[[np.ndarray, dict[str, int], np.ndarray], None]:
    def change(values: np.ndarray, column: dict[str, int], time: np.ndarray) -> None:
        part = time > 5.0
        pair = [column[one], column[other]]
        values[np.ix_(part, pair)] = values[np.ix_(part, pair[::-1])]

    return change


def _knocked(values: np.ndarray, column: dict[str, int], time: np.ndarray) -> None:
    values[time > 6.0, column["radius_r_1"]] += 0.02


def _base(values: np.ndarray, column: dict[str, int], time: np.ndarray) -> None:
    values[time > 6.0] += [0.0, 0.003, 0.0]


FAULTS: dict[str, Callable[[np.ndarray, dict[str, int], np.ndarray], None] | None] = {
    "none": None,
    "a marker of the humerus unseen for 6 s": _hidden,
    "all of the humerus unseen for 6 s": _lost,
    "two of the humerus exchanged after 5 s": _exchange("humerus_r_1", "humerus_r_3"),
    "ulna and radius exchange one after 5 s": _exchange("ulna_r_1", "radius_r_2"),
    "one of the radius knocked by 35 mm after 6 s": _knocked,
    "the base moves by 3 mm at 6 s": _base,
}


def measure_faults() -> Iterable[Row]:
    """Worst frame's error and the warning for each fault, made in the first of three trials."""
    from myomorph.swings.viscosity.tracking.track import track
    from myomorph.swings.viscosity.tracking.tracked import TrackingOptions

    specimen, trials, exact = _trials(0.04, NOISE)
    slipped = _trials(0.04, NOISE, SLIP)[1][0].markers.values

    def slip(values: np.ndarray, column: dict[str, int], time: np.ndarray) -> None:
        values[time > 6.0] = slipped[time > 6.0]

    for fault, change in (*FAULTS.items(), ("the elbow's wire slips by 5 degrees at 6 s", slip)):
        first = trials[0]
        if change is not None:
            values = np.array(first.markers.values)
            change(
                values, {name: i for i, name in enumerate(first.markers.names)}, first.markers.time
            )
            first = replace(first, markers=replace(first.markers, values=values))
        tracked = track(specimen, [first, *trials[1:]], TrackingOptions(clock=False))
        turn, _ = _errors(tracked, exact, CUTOFF)
        yield {
            "fault": fault,
            "root mean square at 8 Hz [deg]": float(np.sqrt(np.mean(np.sum(turn**2, axis=1)))),
            "worst frame at 8 Hz [deg]": float(np.linalg.norm(turn, axis=1).max()),
            "notes": (
                "; ".join(note.split(": ", 1)[1] for note in tracked.trials[0].notes) or "nothing"
            ),
        }
