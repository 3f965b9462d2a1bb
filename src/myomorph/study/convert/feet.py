"""Forces of a recording on the feet of a model that is not there: by the markers on the feet."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.contact.assign import assign_bodies
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.series import Markers, Wrenches
from myomorph.model.sides import other_side, split_side

FOOT_MARKER = re.compile(r"heel|hee|calc|toe|mt_?[1-5p]|mtp|meta|foot|hallux|hal\b|ank|mall", re.IGNORECASE)
"""What markers on a foot are called."""

FEET = {"right": "calcn_r", "left": "calcn_l"}
"""Bodies that forces are given to, as OpenSim's models call the heel bones."""

LOADED = 20.0
"""Force from which a plate carries somebody [N]."""


def on_feet(wrenches: Wrenches, markers: Markers | None, bodies: Sequence[str] = ()) -> Wrenches:
    """Forces with the bodies that are given, else step by step on the foot whose markers are nearest. Forces that never
    act are left out; where no marker shows the feet, bodies stay unknown.
    """
    if bodies:
        if len(bodies) > len(wrenches.names):
            raise BadData(f"{len(bodies)} bodies are given, but the forces are {', '.join(wrenches.names)}")
        chosen = [index for index, body in enumerate(bodies) if body]
        return _some(wrenches, chosen, tuple(bodies[k] for k in chosen))
    size = np.nan_to_num(np.linalg.norm(wrenches.forces, axis=2))
    used = [index for index in range(len(wrenches.names)) if size[:, index].max(initial=0.0) > LOADED]
    idle = [name for index, name in enumerate(wrenches.names) if index not in used]
    notes = (*wrenches.notes, *((f"nobody steps on {', '.join(idle)}: left out",) if idle else ()))
    wrenches = replace(_some(wrenches, used, tuple(wrenches.bodies[k] for k in used)), notes=notes)
    places = {} if markers is None else foot_places(markers, wrenches.time)
    if all(wrenches.bodies) or len(places) < 2 or not used:
        return wrenches
    found = assign_bodies(wrenches, places)
    kept = [index for index, body in enumerate(found.wrenches.bodies) if body]
    bodies = tuple(found.wrenches.bodies[k] for k in kept)
    return replace(_some(found.wrenches, kept, bodies), notes=(*notes, *found.warnings))


def foot_places(markers: Markers, time: Array) -> dict[str, Array]:
    """Positions (frames, markers, 3) of the markers on each foot at some times, by the feet's bodies."""
    found: dict[str, list[int]] = {}
    for k, name in enumerate(markers.names):
        side = side_of(name)
        if FOOT_MARKER.search(name) and side:
            found.setdefault(FEET[side], []).append(k)
    places = {}
    for body, columns in found.items():
        parts = []
        for k in columns:
            values = markers.values[:, k]
            seen = np.isfinite(values).all(axis=1)
            if seen.sum() < 2:
                continue
            parts.append(
                np.column_stack([np.interp(time, markers.time[seen], values[seen, axis]) for axis in range(3)])
            )
        if parts:
            places[body] = np.stack(parts, axis=1)
    return places


def side_of(name: str) -> str:
    """Side of a marker by its name: "right", "left", or "" where it has none."""
    side = split_side(name)[1]
    if not side and other_side(name, capitals=True):
        side = "right" if name[:1].upper() == "R" or name.lower().startswith("right") else "left"
    if not side and re.match(r"[rl][A-Z]", name):
        side = "right" if name[0] == "r" else "left"
    return side


def _some(wrenches: Wrenches, chosen: Sequence[int], bodies: tuple[str, ...]) -> Wrenches:
    columns = list(chosen)
    parts = {name: getattr(wrenches, name)[:, columns] for name in ("forces", "points", "torques")}
    return replace(wrenches, names=tuple(wrenches.names[column] for column in columns), bodies=bodies, **parts)
