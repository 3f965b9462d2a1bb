"""Joints and specimens of known truth, swung in MuJoCo, through the whole identification."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from myomorph.core.model.interval import Interval
from myomorph.swings.simulate.shoulder import Setup

Row = dict[str, object]

RUNS = 200
SECONDS = 15.0
TRIALS = 2
WORKERS = 2


class JointRun(NamedTuple):
    """One virtual joint and its estimates; the intervals are of 95 %.

    `viscosity`, `mass`, `com`: (truth, estimate, low, high) [N m s/rad], [kg], [m].
    """

    seed: int
    kind: str
    stiffness: float
    cutoff: float
    viscosity: tuple[float, float, float, float]
    mass: tuple[float, float, float, float]
    com: tuple[float, float, float, float]


def joint_run(seed: int) -> JointRun:
    """Simulate and identify a hinge (even seeds) or ball.

    Damping is 0.01 to 0.3 N m s/rad, evenly in its logarithm; spring 0 to 5 N m/rad. Every fifth
    joint has no spring. Markers 0.3 mm, force 0.3 N, moment 0.06 N m; clocks differ by up to 20 ms.
    """
    from myomorph.swings.simulate.laboratory import Noise
    from myomorph.swings.viscosity.identification.identify import (
        ViscosityOptions,
        identify_specimen,
    )
    from myomorph.swings.viscosity.specimen.model import SpecimenNames, SwingTrial, build_specimen
    from myomorph.swings.viscosity.tracking.track import track
    from myomorph.swings.viscosity.tracking.tracked import swing_recordings
    from myomorph.swings.viscosity.trust.cutoff import choose_cutoff
    from truths.mechanical_joint import JointExperiment, mechanical_joint

    random = np.random.default_rng(seed)
    kind: Literal["hinge", "ball"] = "ball" if seed % 2 else "hinge"
    damping = float(np.exp(random.uniform(np.log(0.01), np.log(0.3))))
    stiffness = 0.0 if seed % 5 == 0 else float(random.uniform(0.0, 5.0))
    noise = Noise(offset=random.uniform(-0.02, 0.02))
    joint = mechanical_joint(
        kind,
        damping,
        stiffness,
        seed,
        experiment=JointExperiment(seconds=SECONDS, trials=TRIALS, noise=noise),
    )
    specimen = build_specimen(joint.model, SpecimenNames("base", "limb", joint=kind))
    tracked = track(
        specimen, [SwingTrial(one.name, one.markers, one.wrenches) for one in joint.trials]
    )
    cutoff = choose_cutoff([tracked]).cutoff
    swings = swing_recordings(tracked, cutoff, muscles=False)
    found = identify_specimen("joint", swings, (), options=ViscosityOptions(seed=seed)).without
    assert found is not None
    return JointRun(
        seed=seed,
        kind=kind,
        stiffness=stiffness,
        cutoff=cutoff,
        viscosity=_beside(joint.truth.damping, found.viscosity),
        mass=_beside(joint.truth.mass, found.mass),
        com=_beside(joint.truth.com, found.com),
    )


def _beside(truth: float, estimate: Interval) -> tuple[float, float, float, float]:
    return (truth, estimate.value, estimate.low, estimate.high)


def joint_runs(seeds: Sequence[int]) -> list[JointRun]:
    """Run joints on both cores, a process each."""
    with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
        return list(pool.imap(joint_run, seeds, chunksize=5))


JOINT_TARGETS = {"viscosity": (0.03, "%"), "mass": (0.005, "%"), "COM": (0.002, "mm")}
"""Largest error that the project's task allows: relative, relative, [m]."""


def measure_joints(runs: int = RUNS) -> Iterable[Row]:
    """Yield a row for each kind of joint and quantity.

    It has errors over all runs, and how many intervals hold the truth.
    """
    found = joint_runs(range(runs))
    for kind in ("hinge", "ball"):
        own = [one for one in found if one.kind == kind]
        for quantity, (target, unit) in JOINT_TARGETS.items():
            table = np.array([getattr(one, quantity.lower()) for one in own])
            truth, value, low, high = table.T
            errors = value - truth if unit == "mm" else value / truth - 1.0
            scale = 1e3 if unit == "mm" else 1e2
            inside = int(np.sum(np.abs(errors) <= target))
            holds = int(np.sum((low <= truth) & (truth <= high)))
            width = np.median(0.5 * (high - low) / (1.0 if unit == "mm" else truth))
            yield {
                "joint": kind,
                "quantity": quantity,
                "runs": len(own),
                "error RMS": f"{scale * np.sqrt(np.mean(errors**2)):.3f} {unit}",
                "mean error": f"{scale * errors.mean():+.3f} {unit}",
                "largest": f"{scale * np.abs(errors).max():.3f} {unit}",
                "target": f"{scale * target:g} {unit}",
                "within target": f"{inside} of {len(own)}",
                "95 % intervals that hold the truth": (
                    f"{holds} of {len(own)} ({100.0 * holds / len(own):.1f} %)"
                ),
                "median half-width": f"{scale * width:.3f} {unit}",
            }


class SpecimenRun(NamedTuple):
    """A virtual specimen, its truth by quantity, and what was found."""

    number: int
    full_size: bool
    factor: float
    moment_arm: float
    truth: dict[str, float]
    found: dict[str, Interval]
    rank: int
    arms: dict[str, tuple[float, float]]


def specimen_run(given: tuple[int, bool]) -> SpecimenRun:
    """One virtual specimen of tables I and II through tracking, cutoff and identification."""
    from myomorph.swings.demo import truth_of
    from myomorph.swings.simulate.shoulder import virtual_specimen
    from myomorph.swings.viscosity.cohort import specimen_row
    from myomorph.swings.viscosity.identification.identify import MeasuredMuscles, identify_specimen
    from myomorph.swings.viscosity.tracking.track import track
    from myomorph.swings.viscosity.tracking.tracked import swing_recordings
    from myomorph.swings.viscosity.trust.cutoff import choose_cutoff
    from myomorph.swings.viscosity.trust.moment_arms import (
        OFFSET,
        MomentArmOptions,
        moment_arm_sensitivity,
    )

    number, full_size = given
    made = virtual_specimen(number, setup=Setup(full_size=full_size))
    specimen = made.specimen
    tracked = [track(specimen, one.swing_trials()) for one in (made.without, made.intact)]
    cutoff = choose_cutoff(tracked).cutoff
    without = swing_recordings(tracked[0], cutoff, muscles=False)
    intact = swing_recordings(tracked[1], cutoff, muscles=True)
    pcsa = dict(zip(specimen.muscles, specimen.isometric_forces.tolist(), strict=True))
    measured = MeasuredMuscles(pcsa=pcsa, mass=made.published.measured_muscle_mass)
    found = identify_specimen(made.published.name, without, intact, measured)
    assert found.without is not None
    assert found.intact is not None
    assert found.muscles is not None
    errors = MomentArmOptions(factor=0.10, offset=OFFSET * made.factor)
    arms = moment_arm_sensitivity(
        intact, found.intact.parameters, found.without.viscosity.value, errors
    )
    return SpecimenRun(
        number=number,
        full_size=full_size,
        factor=made.factor,
        moment_arm=made.moment_arm,
        truth=truth_of(made),
        found=dict(specimen_row(found)),
        rank=found.muscles.rank,
        arms={one.kind: (one.sd, one.bias) for one in arms},
    )


@lru_cache(maxsize=1)
def specimen_runs() -> tuple[SpecimenRun, ...]:
    """Run the six specimens, then the first with muscles of full size, on both cores."""
    with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
        return tuple(
            pool.imap(specimen_run, [*((number, False) for number in range(1, 7)), (1, True)])
        )


def measure_cohort() -> Iterable[Row]:
    """Yield a row for each quantity.

    It has the mean of the truth of the six, the mean found with its interval, and single specimens'
    errors.
    """
    from myomorph.swings.viscosity.cohort import cohort

    six = [one for one in specimen_runs() if not one.full_size]
    for line in cohort([one.found for one in six]):
        name = line.quantity.name
        if name not in six[0].truth:
            continue
        truth = np.array([one.truth[name] for one in six])
        single = [one.found[name] for one in six]
        errors = np.array([one.value for one in single]) / truth - 1.0
        held = sum(one.holds(value) for one, value in zip(single, truth.tolist(), strict=True))
        yield {
            "quantity": (
                f"{line.quantity.label} [{line.quantity.unit}], table {'I' * line.quantity.table}"
            ),
            "true mean": f"{truth.mean():.5g}",
            "mean found": f"{line.mean:.5g} ({line.low:.5g} to {line.high:.5g})",
            "holds": "yes" if line.low <= truth.mean() <= line.high else "no",
            "true SD": f"{truth.std():.3g}",
            "SD found": f"{line.sd:.3g}",
            "largest error of one": f"{100 * np.abs(errors).max():.2f} %",
            "intervals that hold": f"{held} of {len(six)}",
        }


def measure_muscles() -> Iterable[Row]:
    """Yield a row for each specimen.

    It has its muscles' viscosity with exact moment arms, and its spread where arms are in error.
    """
    for one in specimen_runs():
        truth = one.truth["muscle_viscosity"]
        found = one.found["muscle_viscosity"]
        yield {
            "specimen": f"{one.number:02d}" + (", muscles of full size" if one.full_size else ""),
            "muscles' size": f"{one.factor:.3f}",
            "moment arm RMS [mm]": f"{1e3 * one.moment_arm:.2f}",
            "true d_M [Ns/m]": f"{truth:.4g}",
            "d_M found": f"{found.value:.4g} ({found.low:.4g} to {found.high:.4g})",
            "error": f"{100 * (found.value / truth - 1.0):+.2f} %",
            "rank of 11": one.rank,
            **{
                f"SD, {kind} off": f"{100 * sd:.1f} % (bias {100 * bias:+.1f} %)"
                for kind, (sd, bias) in one.arms.items()
            },
        }
