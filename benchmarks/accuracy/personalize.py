"""Muscles fitted to a person: simulated people with known muscles, held-out strides of real walks, scaled models."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

from benchmarks.accuracy.emg import WALKS, Walk
from benchmarks.simulated_muscles import (
    Errors,
    Spread,
    as_degroote,
    person,
    recorded,
    resting_torques,
    smooth_activations,
    some_gains,
    swings,
)
from myomorph.io.formats import read_model
from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.series import Motion, Series
from myomorph.motion.emg_delay import USUAL
from myomorph.tension.emg_calibration import EmgOptions, emg_targets
from myomorph.tension.personal.generic_map import map_generic
from myomorph.tension.personal.personalize import PersonalizeOptions, PersonalTrial, personalize

Row = dict[str, object]

ARM = {"r_shoulder_elev": (-0.15, 0.4), "r_elbow_flex": (0.2, 2.1)}
"""Within which no path of the model jumps."""
CAREFUL = Errors(torque=0.02, emg=0.05, floor=0.01, gain=0.05)
LENGTHS = ("optimal_fiber_length", "tendon_slack_length")
PEOPLE = 16


def measure_truth(folder: Path, people: int = PEOPLE) -> Iterator[Row]:
    """Errors and coverage over simulated people with six muscles of the arm, in two kinds of recordings."""
    model = as_degroote(read_model(folder / "opensim-reference-small/arm26_bounds.osim"))
    cases: Mapping[str, tuple[Errors, float, int, bool, float]] = {
        "two of 5 s, gains unknown": (replace(Errors(), gain=0.3), 0.3, 2, False, 5.0),
        "four of 8 s, gains known, passive torques": (CAREFUL, 0.05, 4, True, 8.0),
    }
    for name, (errors, gain_spread, count, passive, seconds) in cases.items():
        rows = [
            one
            for seed in range(people)
            for one in _one_person(model, errors, gain_spread, count, passive, seconds, np.random.default_rng(seed))
        ]
        yield from _summary(name, rows)


def _one_person(
    model: Model, errors: Errors, gain_spread: float, count: int, passive: bool, seconds: float,
    rng: np.random.Generator,
) -> Iterator[tuple[str, str, float, bool]]:  # fmt: skip
    """Parameter, whether identifiable, relative error, whether within its interval."""
    time = np.arange(0.0, seconds, 0.01)
    motions = [swings(model, ARM, time, rng) for _ in range(count)]
    muscles = len(model.muscles)
    groups = np.array([0, 0, 0, 1, 1, 1])[:muscles]
    own = person(model, motions, Spread(), rng, groups)
    gains = some_gains(model, errors, rng)
    trials = [
        recorded(model, own, motion, smooth_activations(time, muscles, rng), errors, rng, gains, f"trial {k}")
        for k, motion in enumerate(motions)
    ]
    if passive:
        trials.append(passive_trial(model, own, ARM, rng))
    found = personalize(model, trials, PersonalizeOptions(gain_spread=gain_spread, hold_out=False))
    for one in found.estimates:
        if one.parameter in LENGTHS:
            true = getattr(own.muscles[model.muscle_names.index(one.of)], one.parameter)
            yield one.parameter, one.identifiable, one.person / true - 1.0, one.low <= true <= one.high


def passive_trial(
    model: Model, own: Model, ranges: Mapping[str, tuple[float, float]], rng: np.random.Generator, error: float = 0.1
) -> PersonalTrial:
    """Poses over joints' ranges and the torques of resting muscles in equilibrium, with errors [N m]."""
    poses = 80
    values = np.tile([one.default for one in model.coordinates], (poses, 1))
    for name, (low, high) in ranges.items():
        values[:, model.coordinate_names.index(name)] = rng.uniform(low - 0.1, high + 0.1, poses)
    still = np.zeros_like(values)
    motion = Motion(np.arange(poses) * 1.0, model.coordinate_names, values, still, still)
    torques = resting_torques(own, motion) + error * rng.standard_normal(values.shape)
    return PersonalTrial("passive", motion, Series(motion.time, model.coordinate_names, torques), passive=True)


def _summary(case: str, rows: list[tuple[str, str, float, bool]]) -> Iterator[Row]:
    for parameter in LENGTHS:
        every = [row for row in rows if row[0] == parameter]
        for level in ("yes", "partly", "no", "all"):
            those = [row for row in every if level in ("all", row[1])]
            if those:
                errors = np.abs([row[2] for row in those])
                yield {
                    "recordings": case,
                    "parameter": parameter,
                    "identifiable": level,
                    "count": len(those),
                    "median_error_percent": 100.0 * float(np.median(errors)),
                    "error_of_90_percent": 100.0 * float(np.quantile(errors, 0.9)),
                    "within_interval_percent": 100.0 * float(np.mean([row[3] for row in those])),
                }


def walk_trial(walk: Walk, span: tuple[float, float], with_emg: bool = True) -> PersonalTrial:
    """A part of a real walk, EMG on or off."""
    thin = replace(walk, every=1)
    motion, torques = thin.part(span)
    target = None
    if with_emg:
        target = emg_targets(walk.emg, walk.channels, walk.model, motion.time, EmgOptions(delay=USUAL))
        values = np.array(target.activations)
        target = replace(target, activations=values / max(float(np.nanmax(values)), 1.0))
    return PersonalTrial(f"{walk.name} {span[0]:g} to {span[1]:g} s", motion, torques, target)


def measure_walks(folder: Path, seconds: float = 4.0) -> Iterator[Row]:
    """Muscles fitted to some strides of real walks explain the torques of others."""
    for make in WALKS:
        walk = make(folder)
        for with_emg in (True, False):
            first, second = walk.calibrated, walk.tested
            spans = [first] if first == second else [(one[0], one[0] + seconds) for one in (first, second)]
            trials = [walk_trial(walk, span, with_emg) for span in spans]
            started = perf_counter()
            found = personalize(walk.model, trials)
            took = perf_counter() - started
            checked = found.held_out
            assert checked is not None
            lengths = [one for one in found.estimates if one.parameter in LENGTHS]
            yield {
                "walk": walk.name,
                "emg": "with" if with_emg else "without",
                "score_generic": checked.score_generic,
                "score": checked.score,
                "left_generic": _rms(checked.left_generic),
                "left": _rms(checked.left),
                "kept": ", ".join(checked.kept) or "none",
                "lengths_identified": sum(one.identifiable == "yes" for one in lengths),
                "partly": sum(one.identifiable == "partly" for one in lengths),
                "of": len(lengths),
                "seconds": took,
            }


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def measure_map(folder: Path) -> Iterator[Row]:
    """Normalized fiber lengths of scaled models against the generic model's, before and after the map."""
    at = folder / "rajagopal-walk-emg"
    cases = {
        "Rajagopal 2016 to its walker": (at / "raw/Rajagopal2016.osim", at / "subject_walk_scaled.osim"),
        "Rajagopal 2016 to a man of 86 kg": (
            at / "raw/Rajagopal2016.osim",
            folder / "walk-so-jointload-emg/Rajagopal_scaled_Sub1_gasAvoid.osim",
        ),
    }
    for name, (generic, scaled) in cases.items():
        found = map_generic(read_model(generic), read_model(scaled))
        yield {
            "models": name,
            "muscles": len(found.muscles),
            "not_mapped": len(found.notes),
            "median_before": float(np.median(found.before)),
            "largest_before": float(np.max(found.before)),
            "median_after": float(np.median(found.after)),
            "largest_after": float(np.max(found.after)),
        }


LEGS = {
    "hip_flexion": (-0.2, 0.7),
    "hip_adduction": (-0.2, 0.2),
    "hip_rotation": (-0.25, 0.25),
    "knee_angle": (0.05, 1.0),
    "ankle_angle": (-0.35, 0.3),
}
MEASURED = ("soleus", "gasmed", "gaslat", "tibant", "vaslat", "vasmed", "recfem", "bflh", "semiten", "glmax1", "glmed1")


def measure_many(folder: Path, people: int = 2) -> Iterator[Row]:
    """The same with 80 muscles of both legs, EMG of 22 of them, three recordings of 2.4 s."""
    model = as_degroote(read_model(folder / "rajagopal-walk-emg/subject_walk_scaled.osim"))
    ranges = {f"{name}_{side}": ends for name, ends in LEGS.items() for side in "rl"}
    told = [f"{name}_{side}" for name in MEASURED for side in "rl"]
    time = np.arange(0.0, 2.4, 0.01)
    rows: list[tuple[str, str, float, bool]] = []
    seconds = []
    for seed in range(people):
        rng = np.random.default_rng(100 + seed)
        motions = [swings(model, ranges, time, rng) for _ in range(3)]
        own = person(model, motions, Spread(), rng, np.zeros(len(model.muscles), np.int64))
        gains = {name: gain for name, gain in some_gains(model, Errors(), rng).items() if name in told}
        trials = [
            recorded(
                model, own, motion, smooth_activations(time, len(model.muscles), rng, 0.4), Errors(), rng, gains, f"{k}"
            )
            for k, motion in enumerate(motions)
        ]
        started = perf_counter()
        found = personalize(model, trials)
        seconds.append(perf_counter() - started)
        for one in found.estimates:
            if one.parameter in LENGTHS:
                true = getattr(own.muscles[model.muscle_names.index(one.of)], one.parameter)
                rows.append((one.parameter, one.identifiable, one.person / true - 1.0, one.low <= true <= one.high))
    for row in _summary("80 muscles, EMG of 22, three of 2.4 s", rows):
        yield row | {"seconds_median": float(np.median(seconds))}
