"""Known mechanical joints on a bench, from files to the command's result.

A hinge with a level axis or a ball hangs from a fixture that was tared; MuJoCo swings it, with a
damper and with dry friction of its own. Half of the hinges lie along an axis of the limb's frame.
"""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.core.model.interval import Interval
from myomorph.lab.cli.program import main
from myomorph.swings.simulate.laboratory import Noise
from myomorph.swings.viscosity.study.specimen_step import read_specimen
from truths.bench_joint import write_bench
from truths.mechanical_joint import JointExperiment, mechanical_joint

Row = dict[str, object]

FIRST = 45_000
"""Seed of the first joint; nothing was chosen on these."""
JOINTS = 10
SECONDS = 12.0
FRICTION = 0.02
WORKERS = 2
ACCUSED = ("no limb below", "constant moment", "constant force")
"""Words of notes that call the plate's zero wrong, or its base loaded."""


class Kind(NamedTuple):
    """What joints are like.

    Attributes
    ----------
    joint : hinge or ball
    friction : dry, of every axis [N m]
    spin : of the limb about its length as it is released, over the usual one
    trials : how many are recorded
    """

    joint: Literal["hinge", "ball"]
    friction: float = 0.0
    spin: float = 1.0
    trials: int = 2


KINDS: Mapping[str, Kind] = {
    "hinge": Kind("hinge"),
    f"hinge, dry friction of {FRICTION:g} N m": Kind("hinge", friction=FRICTION),
    f"hinge, dry friction of {FRICTION:g} N m, one recording": Kind(
        "hinge", friction=FRICTION, trials=1
    ),
    "ball": Kind("ball"),
    "ball, released without spin": Kind("ball", spin=0.0),
    f"ball, dry friction of {FRICTION:g} N m": Kind("ball", friction=FRICTION),
}


class BenchRun(NamedTuple):
    """One joint and what the command found of it.

    Attributes
    ----------
    damping, mass : truth [N m s/rad], [kg]
    found : by quantity; without what was withheld
    law : as the first line names it, "" for viscosity alone
    accused : whether a note calls the plate's zero wrong
    """

    damping: float
    mass: float
    found: Mapping[str, Interval]
    law: str
    accused: bool


def bench_run(kind: Kind, seed: int) -> BenchRun:
    """Write the files of a joint, run the command on them, and read what it found.

    Parameters
    ----------
    kind : of the joint
    seed : of its limb, damping, releases and noise
    """
    threadpool_limits(1, "blas")
    random = np.random.default_rng(seed)
    damping = float(np.exp(random.uniform(np.log(0.03), np.log(0.1))))
    axis = np.eye(3)[seed // 2 % 2] if seed % 2 else None
    joint = mechanical_joint(
        kind.joint,
        damping,
        0.0,
        seed,
        experiment=JointExperiment(
            seconds=SECONDS,
            trials=kind.trials,
            noise=Noise(offset=float(random.uniform(-0.02, 0.02))),
            spin=kind.spin,
            friction=kind.friction,
            axis=axis,
        ),
    )
    with tempfile.TemporaryDirectory() as folder:
        study = write_bench(joint, Path(folder) / "bench", seed)
        out = Path(folder) / "results"
        main(["viscosity", str(study), "--out", str(out), "--workers", "1"])
        report = read_specimen(out / "01")
    return BenchRun(
        damping=damping,
        mass=joint.truth.mass,
        found=dict(report.row),
        law=report.law,
        accused=any(word in note for note in report.notes for word in ACCUSED),
    )


def measure() -> Iterable[Row]:
    """Describe each kind of joint by a row."""
    work = [(kind, FIRST + number) for kind in KINDS.values() for number in range(JOINTS)]
    with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
        runs = pool.starmap(bench_run, work, chunksize=1)
    for number, name in enumerate(KINDS):
        yield _row(name, runs[number * JOINTS : (number + 1) * JOINTS])


def _row(name: str, runs: list[BenchRun]) -> Row:
    """Judge joints of a kind."""
    known = [run for run in runs if "joint_viscosity" in run.found]
    pairs = [(run.found["joint_viscosity"], run.damping) for run in known]
    errors = np.array([100.0 * (found.value / truth - 1.0) for found, truth in pairs])
    widths = np.array([50.0 * (found.high - found.low) / truth for found, truth in pairs])
    return {
        "joint": name,
        "joints": len(runs),
        "with a value": len(known),
        "d_J: error RMS [%]": f"{np.sqrt(np.mean(errors**2)):.2f}",
        "d_J: largest error [%]": f"{np.abs(errors).max():.2f}",
        "d_J: median half-width [%]": f"{np.median(widths):.2f}",
        "d_J: 95 % intervals that hold": sum(found.holds(truth) for found, truth in pairs),
        "dry friction named": sum("with dry friction" in run.law for run in runs),
        "not excluded": sum("not excluded" in run.law for run in runs),
        "plate called wrong": sum(run.accused for run in runs),
        "masses in their range": sum(
            run.found["mass_muscles_removed"].holds(run.mass)
            for run in runs
            if "mass_muscles_removed" in run.found
        ),
    }
