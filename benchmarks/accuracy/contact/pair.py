"""Two simulated fighters whose forces are known.

Contact forces and tensions are estimated together, or one after the other.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import myomorph as mm
from benchmarks.errors import rms_of_vectors
from myomorph.body.tension.emg_calibration import calibrate_emg
from myomorph.body.tension.emg_held_out import EmgTrial
from myomorph.core.contact.pair import action_reaction
from myomorph.core.model.contacts import Site
from myomorph.core.tension.emg_targets import emg_targets
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask
from myomorph.core.tension.terms.emg import EmgTarget
from myomorph.show.simulate.bout import FEET, GRIPS
from myomorph.show.simulate.fighter import PARTS
from myomorph.show.simulate.pair import CHANNELS, PairOptions, VirtualPair, pair_sites, virtual_pair
from myomorph.show.simulate.plan import Kind

Row = dict[str, object]

KINDS: tuple[Kind, ...] = ("pull", "sway", "step")
BOUTS = tuple((kind, seed) for seed in (0, 1) for kind in KINDS)
SHOWN_BY: tuple[tuple[Kind, int], ...] = (("sway", 4301), ("pull", 4302))
"""Bouts that no other table has: what would show the feet."""
CUTOFF = 6.0
"""Of the low-pass of kinematics, and of the true forces that estimates are compared with [Hz]."""
WORKERS = 2


@dataclass(frozen=True)
class Knowledge:
    """What an estimate is told beside the motion and which foot stands.

    `plates`: fighters, or single feet, under which everything is measured; `directed`: whether the
    grips are known to pull only, and about where to; `emg`: of "none", "16" channels a fighter, or
    "all" muscles; `gains`: of EMG: "given", as envelopes are activations but for their errors, or
    "default", as the library finds them.
    """

    words: str
    plates: tuple[str, ...] = ()
    directed: bool = False
    emg: str = "none"
    gains: str = "given"


KNOWN = (
    Knowledge("motion and which foot stands"),
    Knowledge("and directions of the grips", directed=True),
    Knowledge("and 16 EMG channels of each", emg="16"),
    Knowledge("and directions and 16 channels", directed=True, emg="16"),
    Knowledge("and directions and EMG of all muscles", directed=True, emg="all"),
    Knowledge(
        words="plates under tori, directions, 16 channels",
        plates=("tori",),
        directed=True,
        emg="16",
    ),
    Knowledge(words="plates under both, 16 channels", plates=PARTS, directed=False, emg="16"),
)


@dataclass(frozen=True, eq=False)
class Errors:
    """Root mean squares over time.

    They are of feet that were not measured and of grips [N], activations [1], tensions [N].
    """

    feet: float
    grips: float
    activations: float
    tensions: float


def bout(options: PairOptions) -> VirtualPair:
    """Simulate one bout (a name that other processes find)."""
    return virtual_pair(options, CUTOFF)


_MADE: dict[PairOptions, VirtualPair] = {}


def simulated(*options: PairOptions) -> tuple[VirtualPair, ...]:
    """Bouts, simulated on both cores, each once."""
    missing = [one for one in options if one not in _MADE]
    if missing:
        with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
            _MADE.update(zip(missing, pool.imap(bout, missing), strict=True))
    return tuple(_MADE[one] for one in options)


def bouts() -> tuple[VirtualPair, ...]:
    """All bouts of the main comparison."""
    return simulated(*(PairOptions(kind, seed) for kind, seed in BOUTS))


def recorded_motion(pair: VirtualPair) -> mm.Motion:
    """Coordinates as the markers tell them."""
    return mm.differentiate(mm.inverse_kinematics(pair.model, pair.markers).motion, CUTOFF)


def estimate(
    pair: VirtualPair,
    motion: mm.Motion,
    known: Knowledge,
    formulation: str,
    compliance: float = ContactOptions().compliance,
) -> Tension:
    """Contact forces and tensions from what is known."""
    measured = [_plate(pair, name) for name in known.plates]
    torques = mm.inverse_dynamics(pair.model, motion, _together(measured) if measured else None)
    sites = open_sites(pair, known)
    names = tuple(one.name for one in sites)
    columns = [pair.touching.names.index(name) for name in names]
    activations = mm.Series(motion.time, names, pair.touching.values[:, columns])
    options = ContactOptions(formulation=formulation, compliance=compliance)  # type: ignore[arg-type]
    task = ContactTask(sites, activations, options=options)
    # The truth's muscles, of MuJoCo, have passive force and no tendon.
    options = mm.TensionOptions(passive=True)
    emg = emg_target(pair, known.emg)
    if emg is not None and known.gains == "default":
        emg = calibrated(
            pair,
            EmgTrial(motion=motion, torques=torques, emg=pair.emg, contacts=task),
            emg.muscles,
            options,
        )
    return mm.solve_tension(pair.model, motion, torques, options, contacts=task, emg=emg)


def _plate(pair: VirtualPair, name: str) -> mm.Wrenches:
    """Return what plates under a fighter measure, or the one under a foot."""
    if name in PARTS:
        return pair.plates[name]
    whole = pair.plates[name.split("_", 1)[0]]
    return whole.columns([whole.names.index(name)])


def open_sites(pair: VirtualPair, known: Knowledge) -> tuple[Site, ...]:
    """Return the sites whose forces are unknown."""
    measured = tuple(f"{part}_foot" if part in PARTS else part for part in known.plates)
    return tuple(
        one
        for one in pair_sites(pair.builds, known.directed)
        if not one.group.startswith(measured or "-")
    )


def emg_target(pair: VirtualPair, channels: str) -> EmgTarget | None:
    """Return recorded envelopes in the form that the estimate takes."""
    if channels == "none":
        return None
    stems = CHANNELS if channels == "16" else ("",)
    muscles = [name for name in pair.emg.names if name.split("_", 1)[1].startswith(stems)]
    return EmgTarget(tuple(muscles), np.array([pair.emg[name] for name in muscles]).T)


def calibrated(
    pair: VirtualPair, trial: EmgTrial, muscles: Sequence[str], options: mm.TensionOptions
) -> EmgTarget:
    """Envelopes with gains, delay and weight as the library finds them by default."""
    channels = {name: (name,) for name in muscles}
    found = calibrate_emg(pair.model, [trial], channels, None, options)
    return emg_targets(pair.emg, channels, pair.model, trial.motion.time, None, found)


def errors_of(pair: VirtualPair, found: Tension) -> Errors:
    """How far an estimate is from the truth."""
    assert found.contacts is not None
    squares: dict[str, float] = {}
    for group in dict.fromkeys(site.group for site in found.contacts.sites):
        own = [k for k, site in enumerate(found.contacts.sites) if site.group == group]
        miss = found.contacts.contact_force[:, own].sum(axis=1) - pair.truth.forces[group]
        squares[group] = float(np.mean(np.sum(miss**2, axis=1)))
    feet = [value for group, value in squares.items() if group in FEET]
    grips = [value for group, value in squares.items() if group in GRIPS]
    return Errors(
        feet=float(np.sqrt(np.mean(feet))) if feet else float("nan"),
        grips=float(np.sqrt(np.mean(grips))),
        activations=float(
            np.sqrt(np.mean((found.activation - pair.truth.activations.values) ** 2))
        ),
        tensions=float(np.sqrt(np.mean((found.muscle_force - pair.truth.tensions.values) ** 2))),
    )


def errors_over(
    pairs: Iterable[VirtualPair],
    wanted: Sequence[Knowledge],
    compliance: float = ContactOptions().compliance,
) -> dict[tuple[str, str], list[Errors]]:
    """Errors of every knowledge and formulation over some bouts."""
    found: dict[tuple[str, str], list[Errors]] = {}
    for pair in pairs:
        motion = recorded_motion(pair)
        for known in wanted:
            for formulation in ("sequential", "simultaneous"):
                errors = errors_of(pair, estimate(pair, motion, known, formulation, compliance))
                found.setdefault((known.words, formulation), []).append(errors)
    return found


def measure() -> Iterable[Row]:
    """Yield one row for each knowledge, with both formulations.

    It has the ratio of their errors too: how much nearer the simultaneous one comes.
    """
    errors = errors_over(bouts(), KNOWN)
    for known in KNOWN:
        first = errors[known.words, "sequential"]
        both = errors[known.words, "simultaneous"]
        row: Row = {"known": known.words}
        for what in ("feet", "grips"):
            before = np.array([getattr(one, what) for one in first])
            after = np.array([getattr(one, what) for one in both])
            row[f"{what} [N], contacts first"] = _spread(before)
            row[f"{what} [N], together"] = _spread(after)
            row[f"{what} nearer"] = _gain(before, after)
        for what, words in (("activations", "activations"), ("tensions", "tensions [N]")):
            means = [np.mean([getattr(one, what) for one in some]) for some in (first, both)]
            row[f"{words}, first / together"] = " / ".join(f"{one:.3g}" for one in means)
        yield row


def measure_plates(bouts_of: Sequence[tuple[Kind, int]] = SHOWN_BY) -> Iterable[Row]:
    """Yield one row for each further measurement that could determine the forces of the feet."""
    pairs = simulated(*(PairOptions(kind, seed) for kind, seed in bouts_of))
    wanted = {
        "motion alone": [Knowledge("")],
        "16 EMG channels of each": [Knowledge("", emg="16")],
        "a plate under one of four feet": [Knowledge("", plates=(foot,)) for foot in FEET],
        "and 16 EMG channels": [Knowledge("", plates=(foot,), emg="16") for foot in FEET],
        "plates under one fighter": [Knowledge("", plates=(part,)) for part in PARTS],
        "EMG of all muscles": [Knowledge("", emg="all")],
    }
    truth = [_constant(pair, names) for pair in pairs for names in (FEET, GRIPS)]
    yield {
        "measured": "nothing: the true mean of each",
        "feet without plates [N]": _spread(np.array(truth[::2])),
        "grips [N]": _spread(np.array(truth[1::2])),
    }
    for words, ways in wanted.items():
        found = []
        for pair in pairs:
            motion = recorded_motion(pair)
            found += [errors_of(pair, estimate(pair, motion, way, "simultaneous")) for way in ways]
        yield {
            "measured": words,
            "feet without plates [N]": _spread(np.array([each.feet for each in found])),
            "grips [N]": _spread(np.array([each.grips for each in found])),
        }


def _constant(pair: VirtualPair, names: Sequence[str]) -> float:
    """Root mean square error [N] of who guesses the true mean of each force at all times."""
    off = [pair.truth.forces[name] - pair.truth.forces[name].mean(axis=0) for name in names]
    return float(np.sqrt(np.mean([np.sum(each**2, axis=1).mean() for each in off])))


TRUTHS: dict[str, dict[str, Any]] = {
    "as above": {},
    "half the pull": {"vigor": 0.5},
    "no tone, all muscles weighted alike": {"tone": (0.0, 0.0), "weight_spread": 0.0},
    "activations and EMG known exactly": {"strength_error": 0.0, "emg_gain": 0.0, "emg_noise": 0.0},
}
TOLD = {"motion alone": KNOWN[0], "directions, 16 channels": KNOWN[3]}


def measure_emg(count: int = 1) -> Iterable[Row]:
    """Yield one row for each knowledge with EMG.

    It has errors with gains that are known, and with those that are estimated. `count`: of bouts.
    """
    pairs = simulated(*(PairOptions(kind, seed) for kind, seed in BOUTS[:count]))
    for known in (KNOWN[2], KNOWN[3], KNOWN[4], KNOWN[6]):
        means = {}
        for gains in ("given", "default"):
            told = replace(known, gains=gains)
            errors = [
                errors_of(one, estimate(one, recorded_motion(one), told, "simultaneous"))
                for one in pairs
            ]
            means[gains] = {what: np.mean([getattr(one, what) for one in errors]) for what in WHAT}
        row: Row = {"known": known.words}
        for what, words in WHAT.items():
            given = means["given"][what]
            found = means["default"][what]
            told = f"{given:.3g} / {found:.3g}"
            row[f"{words}, given / found"] = "" if np.isnan(given) else told
            row[f"{what}, found to given"] = (
                "" if np.isnan(given) else f"{found / given - 1.0:+.0%}"
            )
        yield row


WHAT = {
    "feet": "feet [N]",
    "grips": "grips [N]",
    "activations": "activations",
    "tensions": "tensions [N]",
}


def measure_truths() -> Iterable[Row]:
    """Compare conclusions with each other truth or better measurement, one row each."""
    for words, changes in TRUTHS.items():
        pairs = _three(**changes)
        effort = np.mean([one.truth.activations.values.mean() for one in pairs])
        yield {
            "truth": words,
            "mean activation": round(float(effort), 3),
            **_beside(errors_over(pairs, [*TOLD.values()])),
        }


def measure_compliance() -> Iterable[Row]:
    """One row for each cost of contact forces against muscles, at both activations of pull."""
    for words in ("as above", "half the pull"):
        for compliance in (0.1, 1.0, 10.0):
            errors = errors_over(_three(**TRUTHS[words]), [*TOLD.values()], compliance)
            yield {"truth": words, "compliance": compliance, **_beside(errors)}


def _three(**changes: Any) -> tuple[VirtualPair, ...]:
    """One bout of each kind."""
    return simulated(*(replace(PairOptions(kind, 0), **changes) for kind in KINDS))


def _beside(errors: dict[tuple[str, str], list[Errors]]) -> Row:
    """Means of both formulations, and how much nearer the simultaneous one comes."""
    row: Row = {}
    for words, known in TOLD.items():
        first = errors[known.words, "sequential"]
        both = errors[known.words, "simultaneous"]
        for what in ("feet", "grips"):
            before = np.array([getattr(one, what) for one in first])
            after = np.array([getattr(one, what) for one in both])
            row[f"{words}: {what} [N], first / together"] = (
                f"{before.mean():.0f} / {after.mean():.0f}"
            )
            row[f"{words}: {what} nearer"] = _gain(before, after)
    return row


def measure_bouts() -> Iterable[Row]:
    """One row for each bout: what truly happened, and that its forces balance."""
    for pair, (kind, seed) in zip(bouts(), BOUTS, strict=True):
        motion = recorded_motion(pair)
        truth = pair.truth
        effort = truth.activations.values
        size = np.linalg.norm(truth.forces.values, axis=2)
        both = action_reaction(
            pair.model, motion, PARTS, _together([pair.plates[part] for part in PARTS])
        )
        passed = 0.5 * (both.passed[:, 0, 3:] - both.passed[:, 1, 3:])
        total = sum(truth.forces[name] for name in GRIPS)
        yield {
            "bout": f"{kind} {seed}",
            "seconds": round(float(motion.time[-1]), 2),
            "fighters [kg]": " and ".join(f"{model.mass:.0f}" for model in pair.models.values()),
            "lapel, mean and maximum [N]": f"{size[:, 4].mean():.0f}, {size[:, 4].max():.0f}",
            "sleeve [N]": f"{size[:, 5].mean():.0f}, {size[:, 5].max():.0f}",
            "a foot, minimum and maximum [N]": f"{size[:, :4].min():.0f}, {size[:, :4].max():.0f}",
            "activations, mean and maximum": f"{effort.mean():.3f}, {effort.max():.2f}",
            "action less reaction, plates under both [N]": round(both.force_error, 2),
            "sum of both grips from the plates, RMS error [N]": round(
                rms_of_vectors(passed - total), 2
            ),
        }


def measure_open() -> Iterable[Row]:
    """Errors with plates under all feet, along the one open direction and in the rest."""
    for formulation in ("sequential", "simultaneous"):
        true = []
        found = []
        rest = []
        for pair in bouts():
            motion = recorded_motion(pair)
            contacts = estimate(pair, motion, KNOWN[-1], formulation).contacts
            assert contacts is not None
            forces = np.stack([contacts.of(name) for name in GRIPS], axis=1)
            truth = np.stack([pair.truth.forces[name] for name in GRIPS], axis=1)
            hands = pair.truth.wrenches.points[:, len(FEET) : len(FEET) + 2]
            along = hands[:, 0] - hands[:, 1]
            along = along / np.linalg.norm(along, axis=1, keepdims=True)
            inner = 0.5 * np.sum((forces[:, 0] - forces[:, 1]) * along, axis=1)
            known = 0.5 * np.sum((truth[:, 0] - truth[:, 1]) * along, axis=1)
            miss = (
                forces - truth - (inner - known)[:, None, None] * np.stack([along, -along], axis=1)
            )
            true.append(known.mean())
            found.append(inner.mean())
            rest.append(np.sqrt(np.mean(np.sum(miss**2, axis=2))))
        yield {
            "problem": {"sequential": "contacts first", "simultaneous": "together"}[formulation],
            "between the hands, truth [N]": _spread(np.array(true)),
            "between the hands, found [N]": _spread(np.array(found)),
            "error of the rest of a grip [N]": _spread(np.array(rest)),
        }


def _together(measured: list[mm.Wrenches]) -> mm.Wrenches:
    """Wrenches whose bodies have the joined model's names already."""
    force = np.concatenate([one.forces for one in measured], axis=1)
    point = np.concatenate([one.points for one in measured], axis=1)
    torque = np.concatenate([one.torques for one in measured], axis=1)
    names = tuple(name for one in measured for name in one.names)
    bodies = tuple(name for one in measured for name in one.bodies)
    return mm.Wrenches(measured[0].time, names, bodies, force, point, torque)


def _gain(before: np.ndarray, after: np.ndarray) -> str:
    gain = 1.0 - after.mean() / before.mean()
    return (
        ""
        if np.isnan(gain)
        else f"{100.0 * gain:+.0f} % ({int((after < before).sum())} of {len(before)})"
    )


def _spread(values: np.ndarray) -> str:
    if np.isnan(values).any():
        return ""
    return f"{values.mean():.0f} ({values.min():.0f} to {values.max():.0f})"
