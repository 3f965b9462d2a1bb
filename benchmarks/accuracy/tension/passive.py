"""Effect of identified joint and muscle viscosity on muscle tensions.

The model is the shoulder of the data collection. The values are the means of [S] tables I and II.
They belong to limbs of cadavers that swung; here they are put into the model of a living subject
who lifts an arm, so what is shown is how much they matter, not that they are right.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.core.model.passive_dynamics import line_viscosity, with_passive_dynamics
from myomorph.core.rigid.dynamics import values_and_rates
from myomorph.core.rigid.loops import closed_motion
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.actuators import default_reserves
from myomorph.swings.viscosity.cohort import MEAN
from myomorph.swings.viscosity.identified_model import joint_bushing, joint_jacobian
from myomorph.swings.viscosity.specimen.muscles import fig1_muscles
from truths.coordinate_dampers import coordinate_damping

FOLDER = "shoulder-thoracoscapular"
TRIALS = (("ABD01", "no"), ("ABD21", "2kg"), ("FLX01", "no"), ("FLX21", "2kg"))
CUTOFF = 3.0
"""Low-pass filter of the coordinates [Hz]: the recordings end, filtered so, without steps of
acceleration.
"""

TRUNK = 100.0
"""Optimal force of what holds the trunk [N m], which no muscle of the model does."""

JOINT = ("scapula", "humerus")


@dataclass(frozen=True, eq=False)
class Lift:
    """A trial: the model that fits it, its motion on the loop and the torques."""

    name: str
    model: mm.Model
    motion: mm.Motion


def open_lift(folder: Path, trial: str, weight: str) -> Lift:
    """Read a trial of the shoulder."""
    model = mm.read_model(folder / FOLDER / f"model_cmc/TSM_subject_CMC_{weight}Weight.osim")
    recorded = mm.read_motion(folder / FOLDER / f"ik/{trial}.mot", model)
    motion, _ = closed_motion(model, mm.differentiate(recorded, CUTOFF))
    return Lift(trial, model, motion)


def tension_of(lift: Lift, model: mm.Model) -> Tension:
    """Muscle tensions with the defaults, but a strong hold of the trunk."""
    torques = mm.inverse_dynamics(model, lift.motion)
    reserves = [
        (
            one
            if "ground" not in one.name
            else type(one)(one.name, "coordinate", TRUNK, coordinate=one.coordinate)
        )
        for one in default_reserves(model, 1.0, 10.0)
    ]
    return mm.solve_tension(model, lift.motion, torques, actuators=reserves)


def matching_viscosity(lift: Lift, strands: Mapping[str, tuple[str, ...]]) -> float:
    """Return the d_M whose dampers of muscles take as much as d_{M+J} - d_J takes in [S] [N s/m].

    It is over this motion.
    """
    tree = compile_tree(lift.model)
    coordinates, rates = values_and_rates(tree, lift.motion)
    E, _, moving = joint_jacobian(tree, *JOINT, coordinates)
    omega = np.einsum("fak,fk->fa", E, rates[:, moving])
    shares = line_viscosity(dict.fromkeys(strands, 1.0), strands)
    lengthening = mm.muscle_kinematics(lift.model, lift.motion, moment_arms=False).muscle_velocity
    assert lengthening is not None
    each = np.array([shares.get(name, 0.0) for name in lift.model.muscle_names])
    whole = (MEAN.total_viscosity - MEAN.joint_viscosity) * float((omega**2).sum())
    return whole / float((each * lengthening**2).sum())


def variants(lift: Lift) -> Iterator[tuple[str, mm.Model]]:
    """Yield the model with the joint's damping alone, and with viscous muscles.

    The muscles have the printed and the matching d_M.
    """
    strands = fig1_muscles(lift.model)
    bushings = joint_bushing(lift.model, *JOINT, MEAN.joint_viscosity, lift.motion).bushings
    yield f"d_J {MEAN.joint_viscosity:g}", with_passive_dynamics(lift.model, bushings=bushings)
    for value in (matching_viscosity(lift, strands), MEAN.muscle_viscosity):
        shared = line_viscosity(dict.fromkeys(strands, value), strands)
        made = with_passive_dynamics(lift.model, viscosity=shared, bushings=bushings)
        yield f"d_J {MEAN.joint_viscosity:g}, d_M {value:.3g}", made


@lru_cache(maxsize=len(TRIALS))
def solved(
    folder: Path, trial: str, weight: str
) -> tuple[Tension, tuple[tuple[str, Tension], ...]]:
    """Tensions of a trial without passive dynamics, and with each variant of them."""
    lift = open_lift(folder, trial, weight)
    return tension_of(lift, lift.model), tuple(
        (name, tension_of(lift, model)) for name, model in variants(lift)
    )


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """Difference of tensions with and without passive dynamics, one row per trial and variant."""
    if not (folder / FOLDER).exists():
        return
    for trial, weight in TRIALS:
        plain, thick = solved(folder, trial, weight)
        for name, tension in thick:
            yield {"trial": trial, "put in": name, **_difference(plain, tension)}


def measure_muscles(folder: Path) -> Iterator[dict[str, object]]:
    """Change of tension of the muscles that change most, over all trials together."""
    if not (folder / FOLDER).exists():
        return
    plain: list[np.ndarray] = []
    changes: dict[str, list[np.ndarray]] = {}
    names: tuple[str, ...] = ()
    for trial, weight in TRIALS:
        before, thick = solved(folder, trial, weight)
        names = before.muscles
        plain.append(before.muscle_force)
        kinds = ("d_J", "d_J and fitting d_M", "d_J and printed d_M")
        for kind, (_, tension) in zip(kinds, thick, strict=True):
            changes.setdefault(kind, []).append(np.abs(tension.muscle_force - before.muscle_force))
    pooled = {kind: np.vstack(parts) for kind, parts in changes.items()}
    forces = np.vstack(plain)
    order = np.argsort(pooled["d_J and printed d_M"].mean(axis=0))[::-1][:12]
    for i in order:
        row: dict[str, object] = {
            "muscle": names[i],
            "mean tension [N]": float(forces[:, i].mean()),
        }
        for kind, change in pooled.items():
            row[f"{kind}: mean, greatest change [N]"] = (
                f"{change[:, i].mean():.2g}, {change[:, i].max():.2g}"
            )
        yield row


def _difference(plain: Tension, thick: Tension) -> dict[str, object]:
    change = np.abs(thick.muscle_force - plain.muscle_force)
    frame, muscle = np.unravel_index(int(np.argmax(change)), change.shape)
    by_muscle = change.mean(axis=0)
    most = np.argsort(by_muscle)[::-1][:3]
    pushing = (thick.muscle_force < 0.0).any(axis=1)
    return {
        "mean tension [N]": float(plain.muscle_force.mean()),
        "mean change [N]": float(change.mean()),
        "greatest change [N]": (
            f"{change[frame, muscle]:.3g} ({plain.muscles[muscle]}, {plain.time[frame]:.2f} s)"
        ),
        "greatest mean change [N]": ", ".join(
            f"{plain.muscles[i]} {by_muscle[i]:.3g}" for i in most
        ),
        "change of effort [%]": (
            100.0 * float((thick.activation**2).sum() / (plain.activation**2).sum() - 1.0)
        ),
        "frames in which a muscle pushes [%]": 100.0 * float(pushing.mean()),
        "not optimal": int((~thick.optimal).sum() + (~plain.optimal).sum()),
    }


def measure_forms(folder: Path) -> Iterator[dict[str, object]]:
    """Measure how much of a ball joint's damping OpenSim's forms express.

    The forms are dampers of coordinates, and one bushing.
    """
    if not (folder / FOLDER).exists():
        return
    for trial, weight in (*TRIALS, ("SHRUG01", "no")):
        lift = open_lift(folder, trial, weight)
        dampers = coordinate_damping(lift.model, *JOINT, MEAN.joint_viscosity, lift.motion)
        bushing = joint_bushing(lift.model, *JOINT, MEAN.joint_viscosity, lift.motion)
        values = ", ".join(f"{name} {value:.4f}" for name, value in dampers.values.items())
        yield {
            "trial": trial,
            "dampers of coordinates [N m s/rad]": values,
            "torque they lose [%]": 100.0 * dampers.residual,
            "torque a bushing loses [%]": 100.0 * bushing.residual,
            "its greatest middle angle [deg]": float(np.degrees(bushing.middle)),
        }
