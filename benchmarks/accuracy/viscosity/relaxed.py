"""Relaxed limbs that are dropped.

They are simulated ones whose joint is known, and a child whose swing is public. The child's swing
lies in the folder that the environment variable MYOMORPH_PENDULUM names: `DataPendulum.mat` of
VDB-Bram/Tutorial-Direct-Collocation (KU Leuven). Without it the simulated limbs remain.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.io import loadmat
from tests.truths.relaxed_limbs import RelaxedLeg, write_leg

import myomorph as mm
from myomorph.core.model.arrays import Array
from myomorph.swings.viscosity.relaxed.drops import Drop, find_drops
from myomorph.swings.viscosity.relaxed.identify import (
    SPRUNG,
    LimbOptions,
    LimbResult,
)
from myomorph.swings.viscosity.relaxed.swing_equation import swing_equation
from myomorph.swings.viscosity.relaxed.swing_fit import SwingFit, fit_swings, guess, state_at
from myomorph.swings.viscosity.study.limb_step import study_limb

Row = dict[str, object]
FOLDER = "MYOMORPH_PENDULUM"
RECORDING = "DataPendulum.mat"
LIMBS = 8
DROPS = 3
WORKERS = 2
QUANTITIES = {"viscosity": "d", "stiffness": "k", "coulomb": "dry friction"}
PLACES = {"viscosity": 0, "stiffness": 1, "coulomb": 3}
"""Of the quantities among a law's coefficients."""


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What is wrong with simulated limbs.

    Attributes
    ----------
    changes : of `RelaxedLeg`
    mass_errors : random errors of mass, center and inertia, in the standard deviations that
        `LimbOptions` assumes
    noise : of the markers, over what is drawn
    emg : whether there is EMG
    """

    changes: Mapping[str, object] = field(default_factory=dict)
    mass_errors: float = 0.0
    noise: float = 1.0
    emg: bool = True


KINDS: dict[str, Kind] = {
    "nothing wrong": Kind(),
    "masses 5 % too large": Kind(changes={"wrong": (1.05, 1.0, 1.05)}),
    "masses off at random as assumed": Kind(mass_errors=1.0),
    "thigh gives way": Kind(changes={"giving": 400.0}),
    "reflex in two drops, with EMG": Kind(changes={"bursts": (0, 2)}),
    "reflex in two drops, without EMG": Kind(changes={"bursts": (0, 2)}, emg=False),
}


class LimbRun(NamedTuple):
    """One simulated limb.

    It has truth, result, the law by inverse dynamics alone, and what was named of each drop.
    """

    leg: RelaxedLeg
    result: LimbResult
    regression: Array
    named: tuple[str, ...]


def measure_simulated() -> Iterator[Row]:
    """Errors, coverage and what is named, over simulated limbs by what is wrong with them."""
    work = [(kind, seed) for kind in KINDS.values() for seed in range(LIMBS)]
    with get_context("spawn").Pool(WORKERS) as pool:
        runs = pool.starmap(simulated_run, work, chunksize=1)
    for number, kind in enumerate(KINDS):
        yield from _rows(kind, runs[number * LIMBS : (number + 1) * LIMBS])


def simulated_run(kind: Kind, seed: int) -> LimbRun:
    """Simulate a limb of a kind and identify it from files, as a study does.

    Parameters
    ----------
    kind : what is wrong with it
    seed : of its joint, its markers and errors

    Returns
    -------
    truth and result
    """
    random = np.random.default_rng(seed)
    leg = RelaxedLeg(
        damping=float(random.uniform(0.05, 0.4)),
        stiffness=float(random.uniform(0.5, 6.0)),
        rest=float(random.uniform(-0.4, 0.6)),
        friction=float(random.uniform(0.03, 0.2)) if seed % 2 else 0.0,
        noise=float(random.uniform(3e-4, 1e-3)),
        burst=float(random.uniform(2.0, 6.0)),
    )
    options = LimbOptions()
    if kind.mass_errors:
        gyration = np.sqrt(leg.inertia / leg.mass) / leg.distance
        sizes = np.array([options.mass_sd, options.center_sd * gyration, options.inertia_sd])
        mass, distance, inertia = 1.0 + kind.mass_errors * sizes * random.standard_normal(3)
        leg = replace(leg, wrong=(float(mass), float(distance), float(mass * inertia)))
    leg = replace(leg, noise=kind.noise * leg.noise, **kind.changes)  # type: ignore[arg-type]
    with tempfile.TemporaryDirectory() as folder:
        files = write_leg(leg, Path(folder), DROPS, seed, kind.emg)
        result, notes = study_limb(files, options)
    regression = guess(result.drops, result.fit.terms).coefficients
    return LimbRun(
        leg=leg,
        result=result,
        regression=regression,
        named=tuple(note for note in notes if "half swing" in note),
    )


def _rows(kind: str, runs: list[LimbRun]) -> Iterator[Row]:
    """Yield a row of each quantity; what is named stands in the first."""
    for place, (name, label) in enumerate(QUANTITIES.items()):
        known = [run for run in runs if name in run.leg.truth and name in run.result.estimates]
        truths = np.array([run.leg.truth[name] for run in known])
        estimates = [run.result.estimates[name] for run in known]
        errors = np.array([estimate.value for estimate in estimates]) - truths
        others = np.array([run.regression[PLACES[name]] for run in known]) - truths
        held = sum(estimate.holds(truth) for estimate, truth in zip(estimates, truths, strict=True))
        alone = np.abs(errors) <= 1.96 * np.array(
            [run.result.shares["swings"][name] for run in known]
        )
        row = {
            "what is wrong": kind,
            "value": label,
            "limbs": len(known),
            "median error [%]": 100.0 * float(np.median(np.abs(errors / truths))),
            "largest error [%]": 100.0 * float(np.max(np.abs(errors / truths))),
            "by inverse dynamics, median error [%]": (
                100.0 * float(np.median(np.abs(others / truths)))
            ),
            "95 % intervals that hold": held,
            "of the swings alone": int(alone.sum()),
            "law right": "",
            "reflexes named": "",
            "false alarms": "",
        }
        yield row if place else row | _named(runs)


def _named(runs: list[LimbRun]) -> Row:
    right = sum(("coulomb" in run.result.fit.terms) == bool(run.leg.friction) for run in runs)
    bursts = [(run, f"drop{number + 1}") for run in runs for number in run.leg.bursts]
    found = sum(any(note.startswith(drop) for note in run.named) for run, drop in bursts)
    false = sum(
        not any(note.startswith(f"drop{number + 1}") for number in run.leg.bursts)
        for run in runs
        for note in run.named
    )
    named = f"{found} of {len(bursts)}" if bursts else ""
    return {"law right": f"{right} of {len(runs)}", "reflexes named": named, "false alarms": false}


MASS = 2.3351
DISTANCE = 0.2367
GYRATION = 0.416
"""Shank and foot of the child, as Part1_Input.m of the tutorial has them [kg], [m], and as a share
of the distance.
"""
THEIRS = (2.07279, 0.172916)
"""Constant torque [N m] and damping [N m s/rad] that the tutorial's direct collocation found
(Collocation_opti.mat).
"""
FIRST_PART = 3.0
"""Of the swing, from which the rest is predicted [s]."""
CHILD = """<mujoco model="child"><option gravity="0 0 -9.81"/><worldbody><body name="thigh">
  <inertial pos="-0.1 0 0" mass="3" diaginertia="0.03 0.03 0.03"/>
  <body name="shank"><joint name="knee" axis="0 -1 0"/>
  <inertial pos="{distance} 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/></body>\
</body></worldbody>
  </mujoco>"""
"""The knee's angle is 0 where the shank is level, as in the recording."""


def child_drop(folder: Path) -> Drop:
    """Read the recorded swing of the child, with the masses that come with it."""
    time, degrees = loadmat(folder / RECORDING)["data"].T
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "child.xml"
        inertia = MASS * (GYRATION * DISTANCE) ** 2
        path.write_text(CHILD.format(mass=MASS, distance=DISTANCE, inertia=inertia))
        model = mm.read_model(path)
    angles = np.deg2rad(degrees)
    smooth = mm.differentiate(mm.Motion(time, ("knee",), angles[:, None]), LimbOptions().cutoff)
    assert smooth.velocities is not None
    equation = swing_equation(model, "knee", smooth)
    (drop,) = find_drops("child", equation, angles, smooth.values[:, 0], smooth.velocities[:, 0])
    return drop


class _Coefficients(NamedTuple):
    """Of a law: viscosity, stiffness, torque at angle 0, and friction."""

    d: float
    k: float
    s: float
    c: float


THEIR_LAW = _Coefficients(d=THEIRS[1], k=0.0, s=THEIRS[0], c=0.0)


def measure_child() -> Iterator[Row]:
    """Fit the child's first half swings and predict the rest.

    The tutorial's law, which saw all, stands next to them.
    """
    home = os.environ.get(FOLDER)
    if home is None or not (Path(home) / RECORDING).is_file():
        return
    drop = child_drop(Path(home))
    yield from _predicted_rows(drop)
    yield from _fitted_rows(drop)


def _predicted_rows(drop: Drop) -> Iterator[Row]:
    """Compare laws on the swings after the first half swings, from the state at their start."""
    time = drop.equation.time
    turns = drop.turns
    split = int(np.searchsorted(time[turns], time[turns[0]] + FIRST_PART))
    seen = replace(drop, used=np.arange(len(drop.used)) < split)
    rest = slice(int(turns[split]), int(turns[-1]))
    state = state_at(drop, rest.start)
    for terms in (SPRUNG, (*SPRUNG, "coulomb")):
        fit = fit_swings([seen], terms)
        predicted = drop.equation.swing(rest.start, rest.stop, state[0], state[1], fit.law)
        name = f"law of {' + '.join(terms)}, from the first {FIRST_PART:g} s"
        yield _child_row(name, _coefficients(fit), drop, rest, predicted)
    tone, damping = THEIRS
    predicted = _their_swing(time[rest], state, tone, damping)
    yield _child_row("the tutorial's, from all", THEIR_LAW, drop, rest, predicted)


def _fitted_rows(drop: Drop) -> Iterator[Row]:
    """Compare laws on all swings that they were fitted to."""
    time = drop.equation.time
    whole = slice(int(drop.turns[0]), int(drop.turns[-1]))
    every = fit_swings([drop], SPRUNG)
    swung = drop.equation.swing(whole.start, whole.stop, *every.states[0], every.law)
    name = "law of viscosity + stiffness, from all"
    yield _child_row(name, _coefficients(every), drop, whole, swung)
    tone, damping = THEIRS
    steps = _euler_swing(time, float(drop.measured[0]), tone, damping)
    name = "the tutorial's, from all, by its own steps"
    yield _child_row(name, THEIR_LAW, drop, whole, np.interp(time[whole], *steps))


def _coefficients(fit: SwingFit) -> _Coefficients:
    d, k, s, c = fit.law.coefficients[:4]
    return _Coefficients(d=float(d), k=float(k), s=float(s), c=float(c))


def _child_row(name: str, law: _Coefficients, drop: Drop, part: slice, swung: Array) -> Row:
    errors = np.rad2deg(swung - drop.measured[part])
    time = drop.equation.time - drop.equation.time[0]
    return {
        "law": name,
        "d [N m s/rad]": law.d,
        "k [N m/rad]": law.k,
        "torque at angle 0 [N m]": law.s,
        "friction [N m]": law.c,
        "predicted [s]": f"{time[part.start]:.2f} to {time[part.stop - 1]:.2f}",
        "error, RMS [deg]": float(np.sqrt(np.mean(errors**2))),
        "error, largest [deg]": float(np.abs(errors).max()),
    }


def _acceleration(angle: float, rate: float, tone: float, damping: float) -> float:
    """Evaluate the tutorial's equation of motion [rad/s^2]."""
    weight = MASS * 9.81 * DISTANCE
    inertia = MASS * DISTANCE**2 * (1.0 + GYRATION**2)
    return (-weight * np.cos(angle) + tone - damping * rate) / inertia


def _their_swing(time: Array, state: tuple[float, float], tone: float, damping: float) -> Array:
    """Integrate the tutorial's law with small errors from a state (frames,) [rad]."""

    def slope(_: float, x: Array) -> tuple[float, float]:
        return float(x[1]), _acceleration(x[0], x[1], tone, damping)

    return solve_ivp(slope, (time[0], time[-1]), state, t_eval=time, rtol=1e-9, atol=1e-9).y[0]


def _euler_swing(time: Array, angle: float, tone: float, damping: float) -> tuple[Array, Array]:
    """Integrate the same by explicit steps of 5 ms, as the tutorial does: times and angles.

    It starts from rest at the first frame.
    """
    clock = np.arange(time[0], time[-1], 0.005)
    angles = np.empty(len(clock))
    rate = 0.0
    for i in range(len(clock)):
        angles[i] = angle
        angle, rate = angle + 0.005 * rate, rate + 0.005 * _acceleration(angle, rate, tone, damping)
    return clock, angles
