"""What bringing paths out of bones changes: points, lengths and moment arms, by the least move or the least change."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.morph.demo import demo_morph
from benchmarks.accuracy.morph.real_bones import persons
from myomorph.morph.checks.clearance import WEIGHT, Clearance, clear_paths
from myomorph.morph.checks.moment_arms import compared_coordinates
from myomorph.morph.checks.path_changes import path_changes
from myomorph.morph.checks.path_moves import Ground
from myomorph.morph.checks.warnings import CheckOptions
from myomorph.morph.morphed import Morph, MorphOptions

Row = dict[str, object]

WAYS = {"least move": 0.0, "least change": WEIGHT}


def measure(folder: Path) -> Iterator[Row]:
    """A row for each leg and way."""
    legs = [("demo, known deformation", demo_morph(), False)]
    legs += [(one.name, one.morph, True) for one in persons(folder)]
    for name, morph, together in legs:
        mapped = mm.morph_model(
            morph.source, morph.bones, MorphOptions(clear=False, fibers="keep", force="keep"), together=together
        )
        pairs = compared_coordinates(mapped.source, mapped.model)
        ground = Ground.of(mapped.source, mapped.model, mapped.bones.values(), pairs, CheckOptions())
        if ground is None:
            continue
        for way, weight in WAYS.items():
            yield {"leg": name, "way": way} | changes(clear_paths(mapped.model, ground, weight), ground, mapped)


def changes(found: Clearance, ground: Ground, mapped: Morph) -> Row:
    """What was too deep before and after, what was moved, and what this changed; moves beyond intervals."""
    changed = path_changes(found.start, found.model, ground.poses)
    # A wrap object that grows changes only some of the muscles that run around it.
    odd = {name: one for name, one in changed.items() if max(one.length, one.arm) > 1e-6}
    within = {(one.owner, one.name): one.within for one in mapped.points}
    shifts = found.shifts
    worst = max(odd, key=lambda name: odd[name].arm, default="")
    lengths, arms = (1e3 * np.array([getattr(one, what) for one in odd.values()]) for what in ("length", "arm"))
    return {
        "muscles too deep": len(found.before),
        "after": len(found.after),
        "sum of depths [mm]": 1e3 * sum(found.before.values()),
        "after [mm]": 1e3 * sum(found.after.values()),
        "points moved": len(shifts),
        "furthest [mm]": 1e3 * max(shifts.values(), default=0.0),
        "beyond their interval": sum(shift > within[name] for name, shift in shifts.items()),
        "wrap objects grown": len(found.grown),
        "lengths changed, rms [mm]": _rms(lengths),
        "most [mm]": float(lengths.max(initial=0.0)),
        "moment arms changed, rms [mm]": _rms(arms),
        "at most [mm]": float(arms.max(initial=0.0)),
        "of": worst,
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
