"""Several subjects and objects as one model on one ground, and the results of each."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadModel, UnknownName
from myomorph.core.model.messages import located
from myomorph.core.model.model import GROUND, Kept, Model
from myomorph.core.model.paths import PathFunction
from myomorph.core.model.series import Motion, Series, Wrenches

SIDES = ("r", "l", "right", "left")
ADDED = (
    "reserve_",
    "residual_FX_",
    "residual_FY_",
    "residual_FZ_",
    "residual_MX_",
    "residual_MY_",
    "residual_MZ_",
)
"""Prefixes before a part's name in names that the tension problem makes."""
NAMED = (
    "bodies",
    "joints",
    "coordinates",
    "markers",
    "muscles",
    "wrap_objects",
    "actuators",
    "couplers",
    "loops",
    "bushings",
    "ligaments",
    "frames",
    "passive_torques",
)
"""Tables of a model whose parts have names."""
ONE_NAME = frozenset(
    (
        "name",
        "parent",
        "child",
        "parent_frame_name",
        "child_frame_name",
        "body",
        "other_body",
        "body_1",
        "body_2",
        "coordinate",
        "dependent",
        "wrap_object",
        "side_body",
    )
)
SEVERAL_NAMES = frozenset(("coordinates", "independents", "groups"))
PARTS = frozenset(("axes", "points", "wraps"))
"""Fields of these that hold a name (`ONE_NAME`), several names, or parts that have such fields."""

Timed = TypeVar("Timed", Series, Wrenches)


def join_models(parts: Mapping[str, Model], name: str = "") -> Model:
    """Put models side by side on one ground, as one tree that shares nothing else.

    Every name gains its part's name and a line: `femur_r` of the part `tori` becomes
    `tori_femur_r`. Coordinates keep their meaning, so motions and torques of the parts are columns
    of those of the whole. Names of mesh files stay, to be looked up next to every part's own file.

    Parameters
    ----------
    parts : models by the names of their parts, each a word of letters, digits and lines
    name : of the whole; the parts' names with lines between by default

    Raises
    ------
    BadData : a name that cannot be one of a part
    BadModel : the parts have different gravity
    """
    _check_parts(tuple(parts))
    renamed = [_renamed(model, part) for part, model in parts.items()]
    first = renamed[0]
    for part, model in zip(parts, renamed, strict=True):
        if not np.allclose(model.gravity, first.gravity, rtol=0.0, atol=1e-3):
            raise BadModel(
                f"gravity of '{part}' is {model.gravity.tolist()} m/s^2, that of"
                f" '{next(iter(parts))}' {first.gravity.tolist()}: rotate one of them into the"
                " other's ground"
            )

    tables: dict[str, Any] = {
        table: tuple(item for model in renamed for item in getattr(model, table))
        for table in (*NAMED, "warnings")
    }
    return replace(first, name=name or "_".join(parts), kept=_kept(renamed), **tables)


def join_motions(parts: Mapping[str, Motion]) -> Motion:
    """Join motions of the parts to one of the joined model.

    Velocities and accelerations are there where every part has them.

    Raises
    ------
    BadData : their times differ
    """
    check_clocks(parts)
    motions = list(parts.values())
    return Motion(
        time=motions[0].time,
        names=joined_names(parts),
        values=np.hstack([motion.values for motion in motions]),
        velocities=_side_by_side([motion.velocities for motion in motions]),
        accelerations=_side_by_side([motion.accelerations for motion in motions]),
    )


def _side_by_side(rates: Sequence[Array | None]) -> Array | None:
    """Rates (frames, coordinates) of all parts; None where one has none."""
    known = [part for part in rates if part is not None]
    return np.hstack(known) if len(known) == len(rates) else None


def join_series(parts: Mapping[str, Series]) -> Series:
    """Join columns of the parts (torques, activations) side by side.

    Raises
    ------
    BadData : their times differ
    """
    check_clocks(parts)
    series = list(parts.values())
    return Series(
        series[0].time,
        joined_names(parts),
        np.concatenate([table.values for table in series], axis=1),
    )


def join_wrenches(parts: Mapping[str, Wrenches]) -> Wrenches:
    """Join external forces on the parts to those on the joined model.

    Raises
    ------
    BadData : their times differ
    """
    check_clocks(parts)
    wrenches = list(parts.values())
    bodies = tuple(_prefixed(part, body) for part, loads in parts.items() for body in loads.bodies)
    return Wrenches(
        time=wrenches[0].time,
        names=joined_names(parts),
        bodies=bodies,
        forces=np.concatenate([loads.forces for loads in wrenches], axis=1),
        points=np.concatenate([loads.points for loads in wrenches], axis=1),
        torques=np.concatenate([loads.torques for loads in wrenches], axis=1),
    )


def joined_names(parts: Mapping[str, Series] | Mapping[str, Wrenches]) -> tuple[str, ...]:
    """List names of all columns, with their parts' names before them."""
    return tuple(f"{part}_{name}" for part, series in parts.items() for name in series.names)


def part_of(whole: Timed, part: str) -> Timed:
    """Take the columns of one part, by their own names.

    Of a motion, torques, markers, forces or activations of a joined model. Reserves and residuals
    (`reserve_tori_knee_angle_r`) belong to the part that they name.

    Parameters
    ----------
    whole : columns of the joined model
    part : its name

    Raises
    ------
    UnknownName : no column belongs to the part
    """
    short = {
        column: own
        for column, name in enumerate(whole.names)
        if (own := own_name(name, part)) is not None
    }
    if not short:
        begins = tuple(dict.fromkeys(name.partition("_")[0] for name in whole.names))
        raise UnknownName("part", part, begins, where="the columns' names begin with what it")
    columns = list(short)
    names = tuple(short.values())
    if isinstance(whole, Series):
        return replace(whole.columns(columns), names=names)
    bodies = tuple(
        own_name(whole.bodies[column], part) or whole.bodies[column] for column in columns
    )
    return replace(whole.columns(columns), names=names, bodies=bodies)


def own_name(name: str, part: str) -> str | None:
    """Write a joined model's name as its part has it; None where it is another part's."""
    for before in ("", *ADDED):
        if name.startswith(f"{before}{part}_"):
            return before + name[len(before) + len(part) + 1 :]
    return None


def check_clocks(parts: Mapping[str, Series] | Mapping[str, Wrenches]) -> None:
    """Check that times are the same within a hundredth of a frame.

    Raises
    ------
    BadData : they are not; the error names the two parts
    """
    _check_parts(tuple(parts))
    difference = clock_difference(parts)
    if difference:
        raise BadData(f"{difference}; bring both to common times (`on_one_clock`)")


def clock_difference(parts: Mapping[str, Series] | Mapping[str, Wrenches]) -> str:
    """Describe the difference in times of the first two parts that do not agree.

    Returns
    -------
    "" where all have the same times
    """
    for name, series in parts.items():
        if not len(series):
            raise BadData(f"'{name}' has no frames")
    (first, series), *others = parts.items()
    slack = 0.01 * float(np.median(np.diff(series.time))) if len(series) > 1 else 1e-6
    for name, other in others:
        if len(other) == len(series) and np.max(np.abs(other.time - series.time)) <= slack:
            continue
        if other.time[0] > series.time[-1] or series.time[0] > other.time[-1]:
            what = "they have no time in common"
        elif len(other) == len(series):
            what = "their clocks differ"
        else:
            what = "they differ in rate or length"
        return f"'{first}' has {_times(series.time)}, '{name}' {_times(other.time)}: {what}"
    return ""


def _times(time: Array) -> str:
    """Describe times (frames,) [s]."""
    return f"{len(time)} frames from {time[0]:g} to {time[-1]:g} s"


def _check_parts(parts: tuple[str, ...]) -> None:
    """Raise `BadData` where names of parts cannot stand before other names."""
    if not parts:
        raise BadData("no parts to join")
    for part in parts:
        if not re.fullmatch(r"[^\W_](\w*[^\W_])?", part) or part.lower() in (*SIDES, GROUND):
            raise BadData(
                f"'{part}' cannot name a part: expected letters, digits and '_', no side of the"
                " body"
            )
        longer = next((other for other in parts if other.startswith(f"{part}_")), "")
        if longer:
            raise BadData(
                f"the part '{longer}' begins as the names of '{part}' will: give one of them"
                " another name"
            )


def _prefixed(part: str, name: str) -> str:
    """Put a part's name before a name, but for the ground and no name."""
    return name if name in ("", GROUND) else f"{part}_{name}"


def _renamed(model: Model, part: str) -> Model:
    """Put a part's name before every name of a model."""
    warnings = located(part, model.warnings)
    return replace(renamed_model(model, lambda name: _prefixed(part, name)), warnings=warnings)


def renamed_model(model: Model, new_name: Callable[[str], str]) -> Model:
    """Rename bodies, joints, coordinates, muscles and all that refers to them.

    Parameters
    ----------
    model : to change
    new_name : from an old name to the new one; an old name may be that of parts of different kinds,
        which then go together
    """

    def renamed(item: Any) -> Any:
        """Rename what a part of the model holds."""
        changes: dict[str, Any] = {}
        for field in {part.name for part in fields(item)} & (
            ONE_NAME | SEVERAL_NAMES | PARTS | {"path", "function"}
        ):
            value = getattr(item, field)
            if field in ONE_NAME:
                changes[field] = new_name(value)
            elif field == "path":
                changes[field] = renamed(value)
            elif field == "function":
                # That of an axis or a coupler holds no name.
                if isinstance(value, PathFunction):
                    changes[field] = renamed(value)
            else:
                changes[field] = tuple(map(new_name if field in SEVERAL_NAMES else renamed, value))
        return replace(item, **changes)

    tables: dict[str, Any] = {table: tuple(map(renamed, getattr(model, table))) for table in NAMED}
    kept = tuple(_kept_part(item, model, new_name) for item in model.kept)
    return replace(model, kept=kept, **tables)


def _kept_part(part: Kept, model: Model, prefixed: Callable[[str], str]) -> Kept:
    """Rename what a part of a file holds: whole words of its texts, and names of its elements."""
    if part.room == "Model":
        return part
    names = {item.name for table in (*NAMED, "kept") for item in getattr(model, table)}
    ends = {
        name for joint in model.joints for name in (joint.parent_frame_name, joint.child_frame_name)
    }
    known = names | ends - {"", GROUND}
    words = re.compile(r"[^\s/<>\"'|]+")

    def text(match: re.Match[str]) -> str:
        """Rename the known words of a text."""
        return words.sub(lambda word: prefixed(word[0]) if word[0] in known else word[0], match[0])

    renamed = re.sub(r">[^<]+<", text, part.text)
    if part.name:
        renamed = renamed.replace(f'name="{part.name}"', f'name="{prefixed(part.name)}"', 1)
    root, _, body = part.room.rpartition("/")
    room = f"{root}/{prefixed(body)}" if root else part.room
    return replace(part, name=prefixed(part.name), text=renamed, room=room)


def _kept(models: Iterable[Model]) -> tuple[Kept, ...]:
    """Gather what files hold in addition to models.

    Of what a file has once, as credits and units, the first is taken.
    """
    kepts: list[Kept] = []
    once: set[str] = set()
    for part in (kept for model in models for kept in model.kept):
        if part.room == "Model":
            if part.kind in once:
                continue
            once.add(part.kind)
        kepts.append(part)
    return tuple(kepts)
