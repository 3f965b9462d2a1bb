"""What curves are drawn beside a body that is played again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.analysis.selection import coordinate_pairs, pairs
from myomorph.model.arrays import Array
from myomorph.model.series import Wrenches
from myomorph.model.sides import split_side
from myomorph.report.trial.given import ReportInput
from myomorph.viewer.replay_body import PlayedBody

INK = {"right": "#0b66b0", "left": "#cc5211", "": "#4c5862"}
"""Colors of sides, as in the report."""

SEVERAL = ("#0b66b0", "#cc5211", "#2a8a63", "#8d6bb0", "#a8843a", "#4c5862", "#b3261e", "#5b9bd5")
"""Colors of curves without a side."""

MOST_CURVES = 8


@dataclass(frozen=True, eq=False)
class Curve:
    """One line of a plot: values at the motion's times."""

    label: str
    values: Array
    color: str
    dashed: bool = False


@dataclass(frozen=True, eq=False)
class Chart:
    """A plot: a title with its unit, and its curves."""

    title: str
    curves: tuple[Curve, ...]


def coordinate_choices(body: PlayedBody) -> dict[str, tuple[str, ...]]:
    """Coordinates that move by the names to choose them by, right and left together."""
    reach = np.ptp(body.motion.values[body.known], axis=0)
    ranges = dict(zip(body.motion.names, reach.tolist(), strict=True))
    first = coordinate_pairs(body.model, ranges)
    return {one.label: one.names for one in (*first, *pairs(body.motion.names))}


def coordinate_chart(body: PlayedBody, label: str, names: Sequence[str]) -> Chart:
    """Some coordinates, angles in degrees."""
    turns = {one.name: one.motion == "rotational" for one in body.model.coordinates}
    angle = all(turns.get(name, False) for name in names)
    scale = np.rad2deg(1.0) if angle else 1.0
    curves = tuple(Curve(name, scale * body.motion[name], _ink(name, k)) for k, name in enumerate(names))
    return Chart(f"{label} [{'°' if angle else 'm'}]", curves)


def torque_chart(body: PlayedBody, label: str, names: Sequence[str]) -> Chart | None:
    """Generalized forces of the same coordinates, where they are known."""
    torques = body.given.dynamics.torques
    if torques is None or not set(names) & set(torques.names):
        return None
    turns = {one.name: one.motion == "rotational" for one in body.model.coordinates}
    unit = "N m" if all(turns.get(name, False) for name in names) else "N"
    known = [name for name in names if name in torques.names]
    curves = tuple(
        Curve(name, at_times(body.time, torques.time, torques[name]), _ink(name, k)) for k, name in enumerate(known)
    )
    return Chart(f"{label}, {'moment' if unit == 'N m' else 'force'} [{unit}]", curves)


def activation_chart(body: PlayedBody, muscles: Sequence[int]) -> Chart | None:
    """Activations of some muscles, with EMG that was measured on them."""
    if body.given.tension is None or not len(muscles):
        return None
    chosen = muscles[:MOST_CURVES]
    curves = [Curve(body.muscles[m], body.activations[:, m], _ink(body.muscles[m], k)) for k, m in enumerate(chosen)]
    emg = body.given.recorded.emg
    if emg is not None:
        names = {body.muscles[m] for m in chosen}
        for channel in emg.names:
            if names & set(body.given.recorded.emg_muscles.get(channel, ())):
                curves.append(Curve(f"EMG {channel}", at_times(body.time, emg.time, emg[channel]), "#7a848b", True))
    return Chart("Activation", tuple(curves))


def tension_chart(body: PlayedBody, muscles: Sequence[int]) -> Chart | None:
    """Tensions of some muscles."""
    if body.given.tension is None or not len(muscles):
        return None
    chosen = muscles[:MOST_CURVES]
    curves = [Curve(body.muscles[m], body.tensions[:, m], _ink(body.muscles[m], k)) for k, m in enumerate(chosen)]
    return Chart("Tension [N]", tuple(curves))


def strongest(body: PlayedBody) -> tuple[int, ...]:
    """The muscle that pulls hardest on average, and its fellow on the other side: what is shown at first."""
    if body.given.tension is None or not len(body.muscles):
        return ()
    mean = np.nan_to_num(body.tensions).mean(axis=0)
    name = body.muscles[int(np.argmax(mean))]
    chosen = next(one for one in pairs(body.muscles) if name in one.names)
    return tuple(body.muscles.index(one) for one in chosen.names)


def force_chart(body: PlayedBody) -> Chart | None:
    """The vertical part of every external force, measured and estimated."""
    curves: list[Curve] = []
    given: ReportInput = body.given
    estimated = None if given.contacts.forces is None else given.contacts.forces.wrenches("group")
    for wrenches, dashed in ((given.dynamics.wrenches, False), (estimated, True)):
        if wrenches is not None and len(wrenches):
            curves += _vertical(body, wrenches, dashed)
    return Chart("Vertical force [N]", tuple(curves[:MOST_CURVES])) if curves else None


def _vertical(body: PlayedBody, wrenches: Wrenches, dashed: bool) -> list[Curve]:
    values = np.where(np.isfinite(wrenches.forces), wrenches.forces, 0.0) @ body.scene.up
    acts = np.abs(values).max(axis=0) > 1e-6
    found = []
    for k in np.flatnonzero(acts):
        name = wrenches.names[k]
        side = split_side(wrenches.bodies[k])[1] or split_side(name)[1]
        color = INK[side] if side else SEVERAL[k % len(SEVERAL)]
        label = f"{name}, estimated" if dashed else name
        found.append(Curve(label, at_times(body.time, wrenches.time, values[:, k]), color, dashed))
    return found


def center_chart(body: PlayedBody) -> Chart | None:
    """Where every subject's center of mass is against its mean: upwards, ahead and to the right."""
    scene, curves = body.scene, []
    ways = (("up", scene.up), ("ahead", scene.forward), ("right", scene.right))
    for k, subject in enumerate(body.subjects):
        for (label, axis), color in zip(ways, SEVERAL, strict=False):
            values = body.centers[:, k] @ axis
            if np.isfinite(values).any():
                name = f"{subject.name} {label}".strip()
                curves.append(Curve(name, 100.0 * (values - np.nanmean(values)), color, dashed=k > 0))
    return Chart("Center of mass from its mean [cm]", tuple(curves[:MOST_CURVES])) if curves else None


def at_times(time: Array, clock: Array, values: Array) -> Array:
    """Values of another clock at the motion's times, NaN outside it."""
    found: Array = np.interp(time, clock, values, left=np.nan, right=np.nan)
    return found


def _ink(name: str, k: int) -> str:
    side = split_side(name)[1]
    return INK[side] if side and k < 2 else SEVERAL[k % len(SEVERAL)]
