"""Two simulated fighters whose forces are known: contact forces and tensions together, or one after the other."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from myomorph.contact.pair import action_reaction
from myomorph.model.contacts import Site
from myomorph.model.series import Motion, Series, Wrenches
from myomorph.motion.filters import differentiate
from myomorph.motion.ik import inverse_kinematics
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.study.virtual_bout import FEET, GRIPS
from myomorph.study.virtual_mat import PARTS
from myomorph.study.virtual_pair import CHANNELS, PairOptions, VirtualPair, pair_sites, virtual_pair
from myomorph.tension.contacts import ContactOptions, ContactTask
from myomorph.tension.emg import EmgTarget
from myomorph.tension.solve import Tension, solve_tension

Row = dict[str, object]

BOUTS = tuple((kind, seed) for seed in (0, 1) for kind in ("pull", "sway", "step"))
CUTOFF = 6.0
"""Of the low-pass of kinematics, and of the true forces that estimates are compared with [Hz]."""
WORKERS = 2


@dataclass(frozen=True)
class Knowledge:
    """What an estimate is told beside the motion and which foot stands.

    Attributes
    ----------
    plates : fighters under whose feet everything is measured
    directed : whether the grips are known to pull only, and about where to
    emg : of "none", "16" channels a fighter, or "all" muscles
    """

    words: str
    plates: tuple[str, ...] = ()
    directed: bool = False
    emg: str = "none"


KNOWN = (
    Knowledge("motion and which foot stands"),
    Knowledge("and directions of the grips", directed=True),
    Knowledge("and 16 EMG channels of each", emg="16"),
    Knowledge("and directions and 16 channels", directed=True, emg="16"),
    Knowledge("and directions and EMG of all muscles", directed=True, emg="all"),
    Knowledge("plates under tori, directions, 16 channels", ("tori",), True, "16"),
    Knowledge("plates under both, 16 channels", PARTS, False, "16"),
)


@dataclass(frozen=True, eq=False)
class Errors:
    """Root mean squares over time: of feet that were not measured and of grips [N], activations [1], tensions [N]."""

    feet: float
    grips: float
    activations: float
    tensions: float


def bout(which: tuple[str, int]) -> VirtualPair:
    """Simulate one bout."""
    kind, seed = which
    return virtual_pair(PairOptions(kind, seed), CUTOFF)  # type: ignore[arg-type]


@lru_cache(maxsize=1)
def bouts() -> tuple[VirtualPair, ...]:
    """All bouts, simulated on both cores."""
    with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
        return tuple(pool.imap(bout, BOUTS))


def recorded_motion(pair: VirtualPair) -> Motion:
    """Coordinates as the markers tell them."""
    return differentiate(inverse_kinematics(pair.model, pair.markers).motion, CUTOFF)


def estimate(pair: VirtualPair, motion: Motion, known: Knowledge, formulation: str) -> Tension:
    """Contact forces and tensions from what is known."""
    measured = [pair.plates[part] for part in known.plates]
    torques = inverse_dynamics(pair.model, motion, _together(measured) if measured else None)
    sites = open_sites(pair, known)
    names = tuple(one.name for one in sites)
    columns = [pair.touching.names.index(name) for name in names]
    strengths = Series(motion.time, names, pair.touching.values[:, columns])
    options = ContactOptions(formulation=formulation)  # type: ignore[arg-type]
    task = ContactTask(sites, strengths, options=options)
    return solve_tension(pair.model, motion, torques, contacts=task, emg=emg_target(pair, known.emg))


def open_sites(pair: VirtualPair, known: Knowledge) -> tuple[Site, ...]:
    """The sites whose forces are to be found."""
    measured = tuple(f"{part}_foot" for part in known.plates)
    return tuple(one for one in pair_sites(pair.builds, known.directed) if not one.group.startswith(measured or "-"))


def emg_target(pair: VirtualPair, channels: str) -> EmgTarget | None:
    """Recorded envelopes as the estimate takes them."""
    if channels == "none":
        return None
    stems = CHANNELS if channels == "16" else ("",)
    muscles = [name for name in pair.emg.names if name.split("_", 1)[1].startswith(stems)]
    return EmgTarget(tuple(muscles), np.array([pair.emg[name] for name in muscles]).T)


def errors_of(pair: VirtualPair, found: Tension) -> Errors:
    """How far an estimate is from the truth."""
    assert found.contacts is not None
    squares: dict[str, float] = {}
    for group in dict.fromkeys(site.group for site in found.contacts.sites):
        own = [k for k, site in enumerate(found.contacts.sites) if site.group == group]
        miss = found.contacts.forces[:, own].sum(axis=1) - pair.truth.forces[group]
        squares[group] = float(np.mean(np.sum(miss**2, axis=1)))
    feet = [value for group, value in squares.items() if group in FEET]
    grips = [value for group, value in squares.items() if group in GRIPS]
    return Errors(
        float(np.sqrt(np.mean(feet))) if feet else float("nan"),
        float(np.sqrt(np.mean(grips))),
        float(np.sqrt(np.mean((found.activations - pair.truth.activations.values) ** 2))),
        float(np.sqrt(np.mean((found.forces - pair.truth.tensions.values) ** 2))),
    )


@lru_cache(maxsize=1)
def all_errors() -> dict[tuple[str, str], list[Errors]]:
    """Errors of every knowledge and formulation over the bouts."""
    found: dict[tuple[str, str], list[Errors]] = {}
    for pair in bouts():
        motion = recorded_motion(pair)
        for known in KNOWN:
            for formulation in ("sequential", "simultaneous"):
                errors = errors_of(pair, estimate(pair, motion, known, formulation))
                found.setdefault((known.words, formulation), []).append(errors)
    return found


def measure() -> Iterable[Row]:
    """One row for each knowledge: both formulations, and how much nearer the simultaneous one comes."""
    for known in KNOWN:
        first, both = (all_errors()[known.words, one] for one in ("sequential", "simultaneous"))
        row: Row = {"known": known.words}
        for what, words in (("feet", "feet [N]"), ("grips", "grips [N]")):
            before, after = (np.array([getattr(one, what) for one in errors]) for errors in (first, both))
            row[f"{words}, contacts first"] = _spread(before)
            row[f"{words}, together"] = _spread(after)
            gain = 1.0 - after.mean() / before.mean()
            row[f"{what} nearer"] = (
                "" if np.isnan(gain) else f"{100.0 * gain:+.0f} % ({int((after < before).sum())} of 6)"
            )
        for what, words, unit in (("activations", "activations", 1.0), ("tensions", "tensions [N]", 1.0)):
            means = [unit * np.mean([getattr(one, what) for one in errors]) for errors in (first, both)]
            row[f"{words}, first / together"] = " / ".join(f"{one:.3g}" for one in means)
        yield row


def measure_bouts() -> Iterable[Row]:
    """One row for each bout: what truly happened, and that its forces balance."""
    for pair, (kind, seed) in zip(bouts(), BOUTS, strict=True):
        motion = recorded_motion(pair)
        truth = pair.truth
        effort = truth.activations.values
        size = np.linalg.norm(truth.forces.values, axis=2)
        both = action_reaction(pair.model, motion, PARTS, _together([pair.plates[part] for part in PARTS]))
        passed = 0.5 * (both.passed[:, 0, 3:] - both.passed[:, 1, 3:])
        total = sum(truth.forces[name] for name in GRIPS)
        yield {
            "bout": f"{kind} {seed}",
            "seconds": round(float(motion.time[-1]), 2),
            "fighters [kg]": " and ".join(f"{model.mass:.0f}" for model in pair.models.values()),
            "lapel, mean and most [N]": f"{size[:, 4].mean():.0f}, {size[:, 4].max():.0f}",
            "sleeve [N]": f"{size[:, 5].mean():.0f}, {size[:, 5].max():.0f}",
            "a foot, least and most [N]": f"{size[:, :4].min():.0f}, {size[:, :4].max():.0f}",
            "activations, mean and most": f"{effort.mean():.3f}, {effort.max():.2f}",
            "action less reaction, plates under both [N]": round(both.force_error, 2),
            "sum of both grips from the plates, RMS error [N]": round(_rms(passed - total), 2),
        }


def measure_open() -> Iterable[Row]:
    """With plates under all feet: errors along the one direction that is open, and in what is not."""
    for formulation in ("sequential", "simultaneous"):
        true, found, rest = [], [], []
        for pair in bouts():
            motion = recorded_motion(pair)
            contacts = estimate(pair, motion, KNOWN[-1], formulation).contacts
            assert contacts is not None
            forces = np.stack([contacts.of(name) for name in GRIPS], axis=1)
            truth = np.stack([pair.truth.forces[name] for name in GRIPS], axis=1)
            hands = pair.truth.wrenches.points[:, len(FEET) : len(FEET) + 2]
            along = hands[:, 0] - hands[:, 1]
            along = along / np.linalg.norm(along, axis=1, keepdims=True)
            inner, known = (0.5 * np.sum((one[:, 0] - one[:, 1]) * along, axis=1) for one in (forces, truth))
            miss = forces - truth - (inner - known)[:, None, None] * np.stack([along, -along], axis=1)
            true.append(known.mean())
            found.append(inner.mean())
            rest.append(np.sqrt(np.mean(np.sum(miss**2, axis=2))))
        yield {
            "problem": {"sequential": "contacts first", "simultaneous": "together"}[formulation],
            "between the hands, truth [N]": _spread(np.array(true)),
            "between the hands, found [N]": _spread(np.array(found)),
            "error of the rest of a grip [N]": _spread(np.array(rest)),
        }


def _together(measured: list[Wrenches]) -> Wrenches:
    """Wrenches whose bodies have the joined model's names already."""
    force, point, torque = (
        np.concatenate([getattr(one, what) for one in measured], axis=1) for what in ("forces", "points", "torques")
    )
    names, bodies = (tuple(name for one in measured for name in getattr(one, what)) for what in ("names", "bodies"))
    return Wrenches(measured[0].time, names, bodies, force, point, torque)


def _spread(values: np.ndarray) -> str:
    if np.isnan(values).any():
        return ""
    return f"{values.mean():.0f} ({values.min():.0f} to {values.max():.0f})"


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(values**2, axis=-1))))
