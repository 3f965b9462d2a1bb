"""Muscle paths of detailed models along wide motions carried to them: whose jumps they are."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.identification.transfer import LOWER, higher_models
from myomorph.body.identify.carried_paths import carried_paths
from myomorph.body.identify.carry import carry_motion

SEEDS = (4311, 4312, 4313)
"""Of the motions; none was looked at while the rule for hops and jumps was chosen."""
FRAMES = 101
WIDEST = 1.2
"""A joint moves up to so far from its default pose [rad]."""
SHARE = 0.4
"""Of its range, to either side."""


def wide_motion(model: mm.Model, seed: int) -> mm.Motion:
    """One second in which every joint swings through most of its range, each in a phase of its own.

    Parameters
    ----------
    model : whose pelvis stands still
    seed : of the phases
    """
    time = np.linspace(0.0, 1.0, FRAMES)
    rng = np.random.default_rng(seed)
    values = np.tile([one.default for one in model.coordinates], (FRAMES, 1)).astype(float)
    for column, coordinate in enumerate(model.coordinates):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        moves = not (coordinate.locked or coordinate.name in model.dependent_coordinates)
        if coordinate.motion != "rotational" or coordinate.name.startswith("pelvis") or not moves:
            continue
        near = coordinate.default - WIDEST, coordinate.default + WIDEST
        low, high = np.clip(coordinate.range, *near)
        swing = SHARE * (high - low) * np.sin(2.0 * np.pi * time + phase)
        values[:, column] = np.clip(coordinate.default + swing, low, high)
    return mm.Motion(time, model.coordinate_names, values)


def measure(data: Path) -> Iterator[dict[str, object]]:
    """Jumps of paths along wide motions of the lower model, by model and seed."""
    if not (data / LOWER).is_file():
        return
    lower = mm.read_model(data / LOWER)
    for name, path in higher_models(data).items():
        if not path.is_file():
            continue
        higher = mm.read_model(path)
        # A motion is carried only where both models stand upright alike.
        if np.cross(lower.gravity, higher.gravity).any():
            continue
        found = mm.transfer(lower, higher)
        for seed in SEEDS:
            carried = carry_motion(lower, wide_motion(lower, seed), found)
            paths = carried_paths(higher, found.model, carried.motion)
            if paths is None:
                continue
            largest = max(paths.hops, key=lambda hop: hop.size, default=None)
            yield {
                "model": name,
                "seed": seed,
                "muscle paths": len(paths.muscles),
                "jump in both models": len(paths.own),
                "jump by the transfer alone": len(paths.new),
                "in the model as given alone": int(
                    ((paths.given > 0.0) & (paths.transferred == 0.0)).sum()
                ),
                "largest by the transfer alone [mm]": 1e3
                * float(np.max(paths.transferred[paths.given == 0.0], initial=0.0)),
                "hops of the motion": len(paths.hops),
                "hops where a range ends": sum(bool(hop.bounds) for hop in paths.hops),
                "largest hop [°]": 0.0 if largest is None else float(np.degrees(largest.size)),
            }
