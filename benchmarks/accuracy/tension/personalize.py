"""Muscles fitted to a person.

The persons are simulated people with known muscles, held-out strides of real walks, and scaled
models.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
from scipy.io import loadmat

import myomorph as mm
from benchmarks.accuracy.intervals.covered import Covered
from benchmarks.accuracy.tension.emg import WALKS, Walk
from benchmarks.errors import rms
from myomorph.body.personalize.generic_map import map_generic
from myomorph.core.motion.emg_activation import USUAL
from myomorph.core.tension.emg_targets import EmgOptions, emg_targets
from truths.simulated_muscles import (
    Errors,
    Laboratory,
    Spread,
    all_recorded,
    as_degroote,
    person,
    resting_torques,
    smooth_activations,
    some_gains,
    swings,
    with_other_muscles,
)

Row = dict[str, object]

ARM = {"r_shoulder_elev": (-0.15, 0.4), "r_elbow_flex": (0.2, 2.1)}
"""Within which no path of the model jumps."""
CAREFUL = Errors(torque=0.02, emg=0.05, floor=0.01, gain=0.05)
LENGTHS = ("optimal_fiber_length", "tendon_slack_length")
PEOPLE = 20
FRESH = 1000
"""Simulated people of each case, and the first one's seed: constants were chosen on seeds below
100.
"""
WALKER = "opensim-gait-subject01/ref_so_10dof18musc"
PLANAR = {
    f"{name}_{side}": ends
    for side in "rl"
    for name, ends in (
        ("hip_flexion", (-0.35, 0.9)),
        ("knee_angle", (-1.2, -0.05)),
        ("ankle_angle", (-0.35, 0.3)),
    )
}


@dataclass(frozen=True)
class Case:
    """People and what is recorded of them.

    `model`: file; `ranges`: of the swings, by coordinate; `errors`, `gain_spread`: of the
    recordings, and what `personalize` is told of gains; `count`, `seconds`: of the recordings;
    `passive`: whether passive torques are measured; `most`: of activations; `measured`: muscles
    with EMG, None for all; `other_muscles`: whether people differ in what is not estimated as well.
    """

    model: str
    ranges: Mapping[str, tuple[float, float]]
    errors: Errors
    gain_spread: float
    count: int
    seconds: float
    passive: bool = False
    most: float = 0.7
    measured: tuple[str, ...] | None = None
    other_muscles: bool = False


def cases() -> dict[str, Case]:
    """Of `measure_truth`."""
    arm = "opensim-reference-small/arm26_bounds.osim"
    walker = f"{WALKER}/subject01_adjusted_spring.osim"
    unknown = replace(Errors(), gain=0.3)
    return {
        "arm, two of 5 s, gains unknown": Case(
            model=arm, ranges=ARM, errors=unknown, gain_spread=0.3, count=2, seconds=5.0
        ),
        "arm, four of 8 s, gains known, passive torques": Case(
            model=arm,
            ranges=ARM,
            errors=CAREFUL,
            gain_spread=0.05,
            count=4,
            seconds=8.0,
            passive=True,
        ),
        "legs, three of 4 s, gains unknown": Case(
            model=walker,
            ranges=PLANAR,
            errors=unknown,
            gain_spread=0.3,
            count=3,
            seconds=4.0,
            most=0.5,
        ),
        "legs, other tendons and pennation too": Case(
            model=walker,
            ranges=PLANAR,
            errors=unknown,
            gain_spread=0.3,
            count=3,
            seconds=4.0,
            most=0.5,
            other_muscles=True,
        ),
    }


def measure_truth(folder: Path, people: int = PEOPLE, first: int = FRESH) -> Iterator[Row]:
    """Errors and coverage over simulated people, whose seeds no constant was chosen on."""
    for name, case in cases().items():
        found = [
            one
            for seed in range(first, first + people)
            for one in simulated_person(folder, case, seed)[0]
        ]
        yield from _summary(name, found)


Found = tuple[str, str, float, bool]


def simulated_person(folder: Path, case: Case, seed: int) -> tuple[list[Found], float]:
    """Return what was found of each length, and seconds.

    It has parameter, whether identifiable, relative error, and whether within its interval.
    """
    model = as_degroote(mm.read_model(folder / case.model))
    person = recorded_person(model, case, np.random.default_rng(seed))
    started = perf_counter()
    found = _personalized(model, person, case)
    seconds = perf_counter() - started
    rows = []
    for one in found.estimates:
        if one.parameter in LENGTHS:
            true = person.truth(model, one, found.strength_groups)
            within = bool(one.low <= true <= one.high)
            rows.append((one.parameter, one.identifiable, float(one.person / true - 1.0), within))
    return rows, seconds


def simulated_intervals(folder: Path, case: Case, seed: int) -> dict[str, Covered]:
    """Intervals of a simulated person beside the truth, by parameter.

    Passive strains are left out: people do not differ in them here. The interval before the
    recordings is wider by the root of the ratio of variances.
    """
    model = as_degroote(mm.read_model(folder / case.model))
    person = recorded_person(model, case, np.random.default_rng(seed))
    found = _personalized(model, person, case)
    covered = {}
    for parameter in (*LENGTHS, "strength", "emg_gain"):
        those = [one for one in found.estimates if one.parameter == parameter]
        truth = np.array([person.truth(model, one, found.strength_groups) for one in those])
        low = np.array([one.low for one in those])
        high = np.array([one.high for one in those])
        ratio = np.array([one.variance_ratio for one in those])
        covered[parameter] = Covered.of_limits(truth, low, high, (high - low) / np.sqrt(ratio))
    return covered


def _personalized(model: mm.Model, person: RecordedPerson, case: Case) -> mm.Personalized:
    options = mm.PersonalizeOptions(gain_spread=case.gain_spread, hold_out=False)
    return mm.personalize(model, person.trials, options)


class RecordedPerson(NamedTuple):
    """A simulated person and what is recorded: the own muscles, recordings, gains of EMG."""

    own: mm.Model
    trials: list[mm.PersonalTrial]
    gains: Mapping[str, float]

    def truth(
        self, model: mm.Model, one: mm.tension.MuscleEstimate, groups: Sequence[str]
    ) -> float:
        """Return the true value of a parameter; `groups` are those of each muscle's strength."""
        if one.parameter == "emg_gain":
            return self.gains[one.of]
        if one.parameter == "strength":
            m = groups.index(one.of)
            own = self.own.muscles[m].max_isometric_force
            return own / model.muscles[m].max_isometric_force
        return float(getattr(self.own.muscles[model.muscle_names.index(one.of)], one.parameter))


def recorded_person(model: mm.Model, case: Case, rng: np.random.Generator) -> RecordedPerson:
    """Return a person and what is recorded."""
    time = np.arange(0.0, case.seconds, 0.01)
    muscles = len(model.muscles)
    motions = [swings(model, dict(case.ranges), time, rng) for _ in range(case.count)]
    # The arm's flexors and extensors have strengths of their own.
    groups = np.array([0, 0, 0, 1, 1, 1]) if muscles == 6 else np.zeros(muscles, np.int64)
    own = person(model, motions, Spread(), rng, groups)
    if case.other_muscles:
        own = with_other_muscles(own, rng)
    gains = some_gains(model, case.errors, rng)
    if case.measured is not None:
        gains = {name: gain for name, gain in gains.items() if name in case.measured}
    activations = [smooth_activations(time, muscles, rng, case.most) for _ in motions]
    laboratory = Laboratory(errors=case.errors, gains=gains, rng=rng)
    trials = all_recorded(model, own, motions, activations, laboratory)
    if case.passive:
        trials.append(passive_trial(model, own, case.ranges, rng))
    return RecordedPerson(own, trials, gains)


def passive_trial(
    model: mm.Model,
    own: mm.Model,
    ranges: Mapping[str, tuple[float, float]],
    rng: np.random.Generator,
    error: float = 0.1,
) -> mm.PersonalTrial:
    """Return poses over joints' ranges and the torques of resting muscles in equilibrium.

    The torques have errors [N m].
    """
    poses = 80
    values = np.tile([one.default for one in model.coordinates], (poses, 1))
    for name, (low, high) in ranges.items():
        values[:, model.coordinate_names.index(name)] = rng.uniform(low - 0.1, high + 0.1, poses)
    still = np.zeros_like(values)
    motion = mm.Motion(np.arange(poses) * 1.0, model.coordinate_names, values, still, still)
    torques = resting_torques(own, motion) + error * rng.standard_normal(values.shape)
    return mm.PersonalTrial(
        "passive", motion, mm.Series(motion.time, model.coordinate_names, torques), passive=True
    )


def _summary(case: str, rows: Sequence[Found]) -> Iterator[Row]:
    for parameter in LENGTHS:
        every = [row for row in rows if row[0] == parameter]
        for level in ("yes", "partly", "no", "all"):
            those = [row for row in every if level in ("all", row[1])]
            if those:
                errors = np.abs([row[2] for row in those])
                yield {
                    "recordings": case,
                    "parameter": parameter.replace("_", " "),
                    "identifiable": level,
                    "count": len(those),
                    "median error [%]": 100.0 * float(np.median(errors)),
                    "error, 90 % of them below [%]": 100.0 * float(np.quantile(errors, 0.9)),
                    "within the 90 % interval [%]": 100.0
                    * float(np.mean([row[3] for row in those])),
                }


def walk_trial(walk: Walk, span: tuple[float, float], with_emg: bool = True) -> mm.PersonalTrial:
    """Return a part of a real walk, EMG on or off."""
    thin = replace(walk, every=1)
    motion, torques = thin.part(span)
    target = None
    if with_emg:
        target = emg_targets(
            walk.emg, walk.channels, walk.model, motion.time, EmgOptions(delay=USUAL)
        )
        values = np.array(target.activations)
        target = replace(target, activations=values / max(float(np.nanmax(values)), 1.0))
    return mm.PersonalTrial(f"{walk.name} {span[0]:g} to {span[1]:g} s", motion, torques, target)


def measure_walks(folder: Path, seconds: float = 4.0) -> Iterator[Row]:
    """Muscles fitted to some strides of real walks explain the torques of others."""
    for make in WALKS:
        walk = make(folder)
        for with_emg in (True, False):
            first = walk.calibrated
            second = walk.tested
            spans = (
                [first]
                if first == second
                else [(one[0], one[0] + seconds) for one in (first, second)]
            )
            trials = [walk_trial(walk, span, with_emg) for span in spans]
            started = perf_counter()
            found = mm.personalize(walk.model, trials)
            took = perf_counter() - started
            checked = found.held_out
            assert checked is not None
            lengths = [one for one in found.estimates if one.parameter in LENGTHS]
            yield {
                "walk": walk.name,
                "emg": "with" if with_emg else "without",
                "score, generic": checked.score_generic,
                "score": checked.score,
                "left, generic [N m]": rms(checked.left_generic),
                "left [N m]": rms(checked.left),
                "groups kept": ", ".join(checked.kept) or "none",
                "lengths identified": sum(one.identifiable == "yes" for one in lengths),
                "partly": sum(one.identifiable == "partly" for one in lengths),
                "of lengths": len(lengths),
                "seconds": took,
            }


def measure_map(folder: Path) -> Iterator[Row]:
    """Compare normalized fiber lengths of scaled models with the generic model's.

    They are from before and after the map.
    """
    at = folder / "rajagopal-walk-emg"
    cases = {
        "Rajagopal 2016 to its walker": (
            at / "raw/Rajagopal2016.osim",
            at / "subject_walk_scaled.osim",
        ),
        "Rajagopal 2016 to a man of 86 kg": (
            at / "raw/Rajagopal2016.osim",
            folder / "walk-so-jointload-emg/Rajagopal_scaled_Sub1_gasAvoid.osim",
        ),
    }
    for name, (generic, scaled) in cases.items():
        found = map_generic(mm.read_model(generic), mm.read_model(scaled))
        yield {
            "models": name,
            "muscles": len(found.muscles),
            "not mapped": len(found.notes),
            "median before": float(np.median(found.before)),
            "largest before": float(np.max(found.before)),
            "median after": float(np.median(found.after)),
            "largest after": float(np.max(found.after)),
        }


PUBLISHED = "muscle-parameter-map/manuscript_material"
"""The models and results that Modenese et al. 2016 published,
github.com/modenaxe/MuscleParamOptimizer (Apache-2.0).
"""


def measure_published(folder: Path) -> Iterator[Row]:
    """Compare our map with the models that its source's authors published.

    They are of the same generic and scaled models.
    """
    at = folder / PUBLISHED
    if not at.is_dir():
        return
    examples = {
        "running model, scaled": ("Example1", "Reference_Hamner_L", "Target_Hamner_scaled_L"),
        "hip from images": ("Example2", "Reference_Arnold_R", "Target_LHDL_Schutte_R"),
    }
    for name, (example, generic, target) in examples.items():
        models = [
            mm.read_model(at / example / "MSK_Models" / f"{one}.osim") for one in (generic, target)
        ]
        theirs = mm.read_model(at / example / "OptimModels" / f"{target}_opt_N10.osim")
        results = loadmat(
            at / example / "Results/Results_MusMapMetrics_N10_NError10.mat", squeeze_me=True
        )
        published = np.asarray(results["Results_MusMapMetrics"]["RMSE"].item(), dtype=np.float64)
        found = map_generic(*models)
        # A muscle that our map leaves alone cannot be compared.
        mapped = [m for m in found.muscles if not any(f"'{m}'" in note for note in found.notes)]
        kept = [found.muscles.index(m) for m in mapped]
        yield {
            "models": name,
            "muscles": len(found.muscles),
            "mapped": len(mapped),
            **_length_differences(found.model, theirs, mapped),
            "largest RMS of fiber lengths": float(found.after[kept].max()),
            "published": float(published.max()),
        }


def _length_differences(ours: mm.Model, theirs: mm.Model, names: Sequence[str]) -> Row:
    """Return median and largest difference of each length of some muscles [mm]."""
    row: Row = {}
    for parameter in LENGTHS:
        a = np.array([getattr(ours.muscle(name), parameter) for name in names])
        b = np.array([getattr(theirs.muscle(name), parameter) for name in names])
        apart = 1e3 * np.abs(a - b)
        word = parameter.replace("_", " ")
        row[f"{word}: median [mm]"] = float(np.median(apart))
        row[f"{word}: largest [mm]"] = float(apart.max())
    return row


LEGS = {
    "hip_flexion": (-0.2, 0.7),
    "hip_adduction": (-0.2, 0.2),
    "hip_rotation": (-0.25, 0.25),
    "knee_angle": (0.05, 1.0),
    "ankle_angle": (-0.35, 0.3),
}
MEASURED = (
    "soleus",
    "gasmed",
    "gaslat",
    "tibant",
    "vaslat",
    "vasmed",
    "recfem",
    "bflh",
    "semiten",
    "glmax1",
    "glmed1",
)


def measure_many(folder: Path, people: int = 8, first: int = FRESH) -> Iterator[Row]:
    """Measure the same with 80 muscles of both legs, EMG of 22 of them."""
    ranges = {f"{name}_{side}": ends for name, ends in LEGS.items() for side in "rl"}
    measured = tuple(f"{name}_{side}" for name in MEASURED for side in "rl")
    model = "rajagopal-walk-emg/subject_walk_scaled.osim"
    for name, count, seconds in (("three of 2.4 s", 3, 2.4),):
        case = Case(
            model=model,
            ranges=ranges,
            errors=Errors(),
            gain_spread=0.3,
            count=count,
            seconds=seconds,
            most=0.4,
            measured=measured,
        )
        made = [simulated_person(folder, case, seed) for seed in range(first, first + people)]
        rows = [row for person_rows, _ in made for row in person_rows]
        for row in _summary(f"80 muscles, EMG of 22, {name}", rows):
            yield row | {"seconds, median": float(np.median([took for _, took in made]))}
