"""Strides of stored results, and what a comparison of groups takes from them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.cycle_samples import SAMPLES
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import Series, Wrenches
from myomorph.core.model.sides import split_side
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analysis.cycles import Cycles, over_cycles
from myomorph.lab.analysis.foot_events import Limb
from myomorph.lab.analysis.groups import Animal
from myomorph.lab.analysis.stood_strides import limbs_on_plates
from myomorph.lab.analysis.stride_spread import stride_spread
from myomorph.lab.analysis.strides import Stride, Strides, find_strides
from myomorph.lab.analysis.walking import (
    facing_of,
    feet_move,
    ground_speed,
    running_events,
    walking_limbs,
    walking_points,
)
from myomorph.lab.causes import STRIDES
from myomorph.lab.store import stored as store
from myomorph.lab.store.results import Stored
from myomorph.lab.store.stored_fit import get_fit
from myomorph.lab.study.trial.trial_inputs import Value

ANGLES = "joint angle [°]"
TORQUES = "joint torque [N·m]"
LENGTHS = "muscle length [mm]"
TENSIONS = "muscle tension [N]"
PHASE = "phase, "  # With which the names of parameters begin that are shares of a turn.

LONGEST_HIDDEN = 0.25  # A recording in which the body is not seen for longer is cut there [s].
SHORTEST_PART = 16  # Frames of a part from which strides are looked for.
PARAMETERS: tuple[tuple[str, str, str], ...] = (
    ("stride duration", "s", "duration"),
    ("stride length", "m", "length"),
    ("speed", "m/s", "speed"),
    ("duty factor", "", "duty"),
    ("step width", "m", "width"),
)
"""Name, unit ("" for none) and attribute of a stride."""


@dataclass(frozen=True, eq=False)
class TrialStrides:
    """Strides of one trial.

    They have its parts in order of time, the limbs they are of, and what was left out.
    """

    trial: str
    limbs: tuple[str, ...]
    parts: tuple[Strides, ...]
    notes: tuple[Message, ...] = ()
    # by limb, whether the foot of each stride stood on plates; {} where none did, or limbs are no
    # feet
    stood: Mapping[str, tuple[bool, ...]] = field(default_factory=lambda: FrozenMap({}))

    @staticmethod
    def whole(trial: str, strides: Strides | None) -> TrialStrides | None:
        """Those of a trial in one part, None where it is no walk."""
        return (
            None
            if strides is None
            else TrialStrides(
                trial=trial, limbs=tuple(strides.strikes), parts=(strides,), notes=strides.notes
            )
        )

    def on_plates(
        self, model: Model, wrenches: Wrenches | None, measured: Series | None = None
    ) -> TrialStrides:
        """Find which strides stood on plates; arguments are those of `limbs_on_plates`."""
        own = {limb: self.of(limb) for limb in self.limbs}
        stood = limbs_on_plates(model, own, wrenches, measured)
        flags = {limb: tuple(map(bool, values)) for limb, values in stood.items()}
        return replace(self, stood=FrozenMap(flags))

    def of(self, limb: str) -> tuple[Stride, ...]:
        """Strides of one limb in all parts."""
        return tuple(stride for part in self.parts for stride in part.of(limb))

    @property
    def count(self) -> int:
        """Of the limb that has most."""
        return max((len(self.of(limb)) for limb in self.limbs), default=0)

    def numbers(self, step: str) -> Iterator[Value]:
        """Yield the number of strides of each limb and the means of their parameters, by a step."""
        for limb in self.limbs:
            strides = self.of(limb)
            yield Value(step=step, quantity=f"strides, {limb}", value=float(len(strides)), unit="1")
            for name, unit, attribute in PARAMETERS:
                values = np.array([getattr(stride, attribute) for stride in strides])
                if np.isfinite(values).any():
                    yield Value(
                        step=step,
                        quantity=f"{name}, {limb}",
                        value=float(np.nanmean(values)),
                        unit=unit or "1",
                        strides=stride_spread(values),
                    )


def limbs_of(model: Model, plan: StridePlan) -> tuple[tuple[Limb, ...], str]:
    """Limbs and trunk of a model, as points named by bodies."""
    children = {joint.parent: joint.child for joint in reversed(model.joints)}
    limbs_bodies = dict(plan.limbs) or {
        foot: (foot, children.get(foot, foot)) for foot in feet_of(model)
    }
    if not limbs_bodies:
        raise BadData(
            f"model '{model.name}' has no body named as a foot: name 'limbs' in the table 'strides'"
        )
    for name in (
        *(body for bodies in limbs_bodies.values() for body in bodies),
        *((plan.trunk,) if plan.trunk else ()),
    ):
        check_name("body", name, model.body_names)
    trunk = plan.trunk or _common_ancestor(model, [bodies[0] for bodies in limbs_bodies.values()])
    tree = compile_tree(model)
    limbs = []
    for name, bodies in limbs_bodies.items():
        hanging = itertools.compress(model.body_names, tree.hanging(bodies[0])[1:])
        limbs.append(Limb(name, (bodies[0],), bodies[1:2], bodies=tuple(hanging)))
    return tuple(limbs), trunk


def _common_ancestor(model: Model, bodies: Sequence[str]) -> str:
    parents = {joint.child: joint.parent for joint in model.joints}
    chains = []
    for body in bodies:
        chain = [body]
        while chain[-1] in parents and parents[chain[-1]] != GROUND:
            chain.append(parents[chain[-1]])
        chains.append(chain[1:] or chain)
    shared = [body for body in chains[0] if all(body in chain for chain in chains)]
    if not shared:
        raise BadData(
            f"no body of model '{model.name}' carries all of {', '.join(bodies)}: name the 'trunk'"
            " of 'strides'"
        )
    return shared[0]


def trial_strides(stored: Stored, model: Model, plan: StridePlan) -> TrialStrides:
    """Find strides of a result in every stretch of time in which the body was recorded.

    They are found by plates, else events, else motion. They are as `walking_strides` finds them,
    but for what the plan names, and for a body that is out of sight in between.
    """
    limbs, points, trunk = _points(stored, model, plan)
    names = tuple(limb.name for limb in limbs)
    trial = stored.facts.get("trial", stored.path.stem)
    by_feet = _by_feet(model, plan)
    if by_feet and not feet_move(points):
        note = STRIDES.message(
            "the feet stand while the body moves; 'limbs' in [strides] names other limbs"
        )
        return TrialStrides(trial=trial, limbs=names, parts=(), notes=(note,))
    wrenches = _wrenches_on(stored, limbs)
    motion = store.get_motion(stored)
    running = running_events(model, motion, limbs) if by_feet else ()
    facing = facing_of(model, motion, limbs) if by_feet else None
    parts: list[Strides] = []
    notes: list[Message] = []
    for part in _parts(points, trunk):
        try:
            parts.append(
                find_strides(
                    part,
                    limbs,
                    (trunk,),
                    np.asarray(model.up),
                    direction=None if plan.direction is None else np.array(plan.direction),
                    ground_speed=ground_speed(part) if plan.belt is None and by_feet else plan.belt,
                    wrenches=wrenches,
                    weight=None if wrenches is None else model.weight,
                    events=store.get_events(stored),
                    running=running,
                    facing=facing,
                )
            )
        except BadData as error:
            notes.append(STRIDES.message(f"{part.time[0]:.2f} to {part.time[-1]:.2f} s: {error}"))
    notes += [note for part in parts for note in part.notes]
    found = TrialStrides(
        trial=trial, limbs=names, parts=tuple(parts), notes=tuple(dict.fromkeys(notes))
    )
    return found.on_plates(model, wrenches) if by_feet else found


def _wrenches_on(stored: Stored, limbs: Sequence[Limb]) -> Wrenches | None:
    """Return external forces of a result, None where none acts on a limb."""
    wrenches = store.get_wrenches(stored)
    bodies = {body for limb in limbs for body in limb.bodies}
    return None if wrenches is None or bodies.isdisjoint(wrenches.bodies) else wrenches


def _by_feet(model: Model, plan: StridePlan) -> bool:
    """Whether limbs are the bodies named as feet, because the study names no others."""
    return not plan.limbs and not plan.trunk and bool(walking_limbs(model))


def _points(stored: Stored, model: Model, plan: StridePlan) -> tuple[tuple[Limb, ...], Series, str]:
    """Limbs, the places of their points and of the trunk, and what the trunk is called."""
    motion = store.get_motion(stored)
    if _by_feet(model, plan):
        points = walking_points(model, motion, get_fit(stored))
        return walking_limbs(model), points, points.names[-1]
    limbs, trunk = limbs_of(model, plan)
    bodies = list(
        dict.fromkeys([trunk, *(name for limb in limbs for name in (*limb.points, *limb.lifting))])
    )
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    places = poses.origins[:, [tree.body_index[name] for name in bodies]]
    return limbs, Series(motion.time, tuple(bodies), places), trunk


def _parts(points: Series, trunk: str) -> list[Series]:
    """Stretches of time in which the trunk is seen, but for short gaps."""
    seen = np.flatnonzero(np.isfinite(points[trunk]).all(axis=1))
    if not len(seen):
        return []
    cuts = np.flatnonzero(np.diff(points.time[seen]) > LONGEST_HIDDEN) + 1
    runs = np.split(seen, cuts)
    return [
        Series(points.time[run[0] : run[-1] + 1], points.names, points.values[run[0] : run[-1] + 1])
        for run in runs
        if len(run) >= SHORTEST_PART
    ]


def animal_of(name: str, results: Sequence[tuple[Stored, Model, TrialStrides]]) -> Animal:
    """Return all strides of a subject's trials.

    They are parameters of every limb, and curves over the cycle. What belongs to a side is cut at
    the foot strikes of that side's limb, everything else at those of the first limb.
    """
    scalars: dict[str, list[Array]] = {}
    curves: dict[str, list[Cycles]] = {}
    count = 0
    for stored, model, strides in results:
        count += strides.count
        for limb in strides.limbs:
            of_limb = strides.of(limb)
            for parameter, unit, attribute in PARAMETERS:
                values = np.array([getattr(stride, attribute) for stride in of_limb])
                if np.isfinite(values).any():
                    label = f"{parameter}, {limb}" + (f" [{unit}]" if unit else "")
                    scalars.setdefault(label, []).append(values)
            if limb != strides.limbs[0]:
                phase = np.concatenate(
                    [part.phases.get(limb, np.zeros(0)) for part in strides.parts] or [np.zeros(0)]
                )
                if np.isfinite(phase).any():
                    scalars.setdefault(f"{PHASE}{limb} after {strides.limbs[0]}", []).append(phase)
        for family, series in _signals(stored, model).items():
            cycles = by_side(series, strides, of_plates=family == TORQUES)
            if cycles is not None:
                curves.setdefault(family, []).append(cycles)
    return Animal(
        name=name,
        scalars={label: np.concatenate(parts) for label, parts in scalars.items()},
        curves={family: _joined(parts) for family, parts in curves.items()},
        strides=count,
    )


def in_one_turn(animals: Sequence[Animal]) -> tuple[Animal, ...]:
    """Return the animals with every phase in the turn in which it is nearest to the others.

    0.02 and 0.98 are 0.04 apart. The middle of all animals, each by the direction of its own mean,
    is put between -0.25 and 0.75; the phases of an animal are within half a turn of its own mean,
    and that within half a turn of the middle.
    """
    tables = [dict(animal.scalars) for animal in animals]
    for name in dict.fromkeys(name for table in tables for name in table if name.startswith(PHASE)):
        means = {
            index: _direction(np.exp(2j * np.pi * table[name]))
            for index, table in enumerate(tables)
            if name in table
        }
        middle = (
            _direction(np.exp(2j * np.pi * np.array(list(means.values())))) + 0.25
        ) % 1.0 - 0.25
        for index, mean in means.items():
            nearest = mean - np.round(mean - middle)
            tables[index][name] = tables[index][name] - np.round(tables[index][name] - nearest)
    return tuple(
        replace(animal, scalars=table) for animal, table in zip(animals, tables, strict=True)
    )


def _direction(turns: np.ndarray) -> float:
    """Of the mean of unit numbers, in turns; NaN where none is known."""
    known = turns[np.isfinite(turns)]
    return float(np.angle(known.mean()) / (2.0 * np.pi)) if len(known) else float("nan")


def _signals(stored: Stored, model: Model) -> dict[str, Series]:
    """Return what a result has over time, by family, in the units of its name."""
    motion = store.get_motion(stored)
    turning = [
        index
        for index, name in enumerate(motion.names)
        if model.coordinate(name).motion == "rotational"
    ]
    angles = motion.columns(turning)
    signals = {ANGLES: Series(motion.time, angles.names, np.degrees(angles.values))}
    torques = store.get_torques(stored)
    if torques is not None:
        columns = [index for index, name in enumerate(torques.names) if name in angles.names]
        signals[TORQUES] = torques.columns(columns)
    if "muscle_length" in stored.values:
        signals[LENGTHS] = Series(
            stored.time, stored.names["muscle"], 1000.0 * stored.values["muscle_length"]
        )
    if "muscle_force" in stored.values:
        signals[TENSIONS] = Series(
            stored.time, stored.names["muscle"], stored.values["muscle_force"]
        )
    moving = {family: _moving(series) for family, series in signals.items()}
    return {family: series for family, series in moving.items() if len(series.names)}


def _moving(series: Series) -> Series:
    """Columns that are known and change."""
    count = len(series.names) if len(series) else 0
    return series.columns(
        [index for index in range(count) if np.nanstd(series.values[:, index]) > 1e-9]
    )


def by_side(series: Series, strides: TrialStrides, of_plates: bool = False) -> Cycles | None:
    """Cut each signal into the cycles of its limb.

    Parameters
    ----------
    series : (samples, names)
    strides : of a trial
    of_plates : whether signals of a side follow from the force under its foot: cycles of a foot
        that did not stand on plates are then not known, where others did

    Returns
    -------
    as many rows as the limb with most cycles, the others NaN; None without cycles
    """
    spans = {
        limb: [(stride.start, stride.stop) for stride in strides.of(limb)] for limb in strides.limbs
    }
    most = max((len(span) for span in spans.values()), default=0)
    if not most:
        return None
    limbs = _limbs_by_side(series, strides)
    values = np.full((most, SAMPLES, len(series.names)), np.nan)
    for limb in dict.fromkeys(limbs):
        indices = [index for index, other in enumerate(limbs) if other == limb]
        values[: len(spans[limb]), :, indices] = over_cycles(
            series.columns(indices), spans[limb]
        ).values
        sided = [index for index in indices if split_side(series.names[index])[1]]
        if of_plates and strides.stood:
            for row in np.flatnonzero(~np.array(strides.stood[limb], bool)):
                values[row, :, sided] = np.nan
    return Cycles(series.names, values)


def maxima_by_side(series: Series, strides: TrialStrides) -> Array:
    """Find the largest sample of each signal in every stride of its limb.

    Parameters
    ----------
    series : (samples, names)
    strides : of a trial

    Returns
    -------
    (strides, names), as many rows as the limb with most strides, NaN where nothing is known
    """
    limbs = _limbs_by_side(series, strides)
    most = max((len(strides.of(limb)) for limb in strides.limbs), default=0)
    maxima = np.full((most, len(series.names)), np.nan)
    for column, limb in enumerate(limbs):
        for row, stride in enumerate(strides.of(limb)):
            inside = (series.time >= stride.start) & (series.time <= stride.stop)
            known = series.values[inside, column]
            known = known[np.isfinite(known)]
            maxima[row, column] = known.max() if len(known) else np.nan
    return maxima


def _limbs_by_side(series: Series, strides: TrialStrides) -> list[str]:
    """Return the limb whose strides each signal is cut at: that of its side, else the first."""
    sides = {split_side(limb)[1]: limb for limb in reversed(strides.limbs)}
    return [sides.get(split_side(name)[1], strides.limbs[0]) for name in series.names]


def _joined(parts: Sequence[Cycles]) -> Cycles:
    """Cycles of several trials; signals that not all have are left out."""
    names = tuple(name for name in parts[0].names if all(name in part.names for part in parts))
    rows = [part.values[:, :, [part.names.index(name) for name in names]] for part in parts]
    return Cycles(names, np.concatenate(rows))


@dataclass(frozen=True)
class StridePlan:
    """How strides of a trial are found where neither plates nor events show them.

    Attributes
    ----------
    trunk : the body that feet are seen from, "" for the last that carries all feet
    limbs : by limb, the body that shows foot strikes and, where given, the one that shows foot
        offs; () for the model's feet
    direction : of travel in ground, None to find it
    belt : speed of a treadmill [m/s], None to find it
    """

    trunk: str = ""
    limbs: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: FrozenMap({}))
    direction: tuple[float, float, float] | None = None
    belt: float | None = None
