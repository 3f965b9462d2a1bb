"""Curves beside a body that is played again, and plots of them with a line at the present."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series import Wrenches
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.model.sides import split_side
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.load_quantities import JOINT_CONTACT_LOAD
from myomorph.core.tension.quantities import ACTIVATION, MUSCLE_FORCE
from myomorph.lab.analysis.selection import coordinate_pairs, pairs
from myomorph.lab.report.trial.report_input import ReportInput
from myomorph.lab.viewer.replay_body import PlayedBody

INK = {"right": "#0b66b0", "left": "#cc5211", "": "#4c5862"}
"""Colors of sides, as in the report."""

SEVERAL = ("#0b66b0", "#cc5211", "#2a8a63", "#8d6bb0", "#a8843a", "#4c5862", "#b3261e", "#5b9bd5")
"""Colors of curves without a side."""

MAX_CURVES = 8
# Bands that lie over each other in more curves than these hide what they should show.
MAX_BANDS = 4
MAX_POINTS = 600
HEIGHT = 150
WIDTH = 400
FONT = "10px system-ui, sans-serif"
# The legend names curves, not ends of bands.
UNLISTED = "<style>.curve-limit { display: none; }</style>"
BAND_ALPHA = "33"  # Opacity of a band, as the last two digits of its color.


@read_only
class Curve:
    """One line of a plot: values at the motion's times.

    Interval bounds of 90 % stand around them where they are known.
    """

    label: str
    values: Array
    color: str
    dashed: bool = False
    low: Array | None = None
    high: Array | None = None


@dataclass(frozen=True, eq=False)
class Chart:
    """A plot: a title with its unit, and its curves."""

    title: str
    curves: tuple[Curve, ...]

    @property
    def banded(self) -> tuple[int, ...]:
        """Numbers of the curves whose limits are drawn."""
        known = tuple(
            i
            for i, curve in enumerate(self.curves)
            if curve.low is not None and curve.high is not None
        )
        return known if len(known) <= MAX_BANDS else ()


def coordinate_choices(body: PlayedBody) -> dict[str, tuple[str, ...]]:
    """Coordinates that move by the names to choose them by, right and left together."""
    reach = np.ptp(body.motion.values[body.known], axis=0)
    ranges = dict(zip(body.motion.names, reach.tolist(), strict=True))
    first = coordinate_pairs(body.model, ranges)
    return {pair.label: pair.names for pair in (*first, *pairs(body.motion.names))}


def coordinate_chart(body: PlayedBody, label: str, names: Sequence[str]) -> Chart:
    """Chart some coordinates, angles in degrees."""
    angle = _are_angles(body, names)
    scale = np.rad2deg(1.0) if angle else 1.0
    curves = tuple(
        _with_limits(
            body,
            COORDINATE_VALUE,
            name,
            Curve(name, scale * body.motion[name], _ink(name, index)),
            scale,
        )
        for index, name in enumerate(names)
    )
    unit = "°" if angle else "m"
    return Chart(f"{label} [{unit}]", curves)


def torque_chart(body: PlayedBody, label: str, names: Sequence[str]) -> Chart | None:
    """Generalized forces of the same coordinates, where they are known."""
    torques = body.results.dynamics.torques
    if torques is None or not set(names) & set(torques.names):
        return None
    unit = "N m" if _are_angles(body, names) else "N"
    curves = []
    for index, name in enumerate(name for name in names if name in torques.names):
        curve = Curve(name, at_times(body.time, torques.time, torques[name]), _ink(name, index))
        curves.append(_with_limits(body, GENERALIZED_FORCE, name, curve))
    what = "moment" if unit == "N m" else "force"
    return Chart(f"{label}, {what} [{unit}]", tuple(curves))


def _are_angles(body: PlayedBody, names: Sequence[str]) -> bool:
    return set(names) <= {
        coordinate.name
        for coordinate in body.model.coordinates
        if coordinate.motion == "rotational"
    }


def muscle_chart(body: PlayedBody, muscles: Sequence[int], quantity: Quantity) -> Chart | None:
    """Activations of some muscles, with EMG that was measured on them, or their tensions."""
    results = body.results
    if results.tension is None or not len(muscles):
        return None
    title, values = (
        ("Activation", body.activations)
        if quantity is ACTIVATION
        else ("Tension [N]", body.tensions)
    )
    names = [body.muscles[m] for m in muscles[:MAX_CURVES]]
    curves = [
        _with_limits(body, quantity, name, Curve(name, values[:, m], _ink(name, index)))
        for index, (name, m) in enumerate(zip(names, muscles, strict=False))
    ]
    emg = results.recorded.emg if quantity is ACTIVATION else None
    for channel in () if emg is None else emg.names:
        if emg is not None and set(names) & set(results.recorded.emg_muscles.get(channel, ())):
            curves.append(
                Curve(
                    label=f"EMG {channel}",
                    values=at_times(body.time, emg.time, emg[channel]),
                    color="#7a848b",
                    dashed=True,
                )
            )
    return Chart(title, tuple(curves))


def _with_limits(
    body: PlayedBody, quantity: Quantity, name: str, curve: Curve, scale: float = 1.0
) -> Curve:
    """Add the interval bounds that draws gave a column to its curve, where they did."""
    spread = body.results.uncertainty.spreads.get(quantity.name)
    if spread is None or name not in spread.names:
        return curve
    column = spread.names.index(name)
    low = at_times(body.time, spread.time, scale * spread.low[:, column])
    high = at_times(body.time, spread.time, scale * spread.high[:, column])
    return replace(curve, low=low, high=high)


def strongest(body: PlayedBody) -> tuple[int, ...]:
    """Find the muscle that pulls hardest on average, and its fellow on the other side.

    They are shown at first.
    """
    if body.results.tension is None or not len(body.muscles):
        return ()
    mean = np.nan_to_num(body.tensions).mean(axis=0)
    name = body.muscles[int(np.argmax(mean))]
    chosen = next(pair for pair in pairs(body.muscles) if name in pair.names)
    return tuple(body.muscles.index(name) for name in chosen.names)


def force_chart(body: PlayedBody) -> Chart | None:
    """Chart the vertical part of every external force, measured and estimated."""
    curves: list[Curve] = []
    results: ReportInput = body.results
    estimated = (
        None if results.contacts.forces is None else results.contacts.forces.wrenches("group")
    )
    for wrenches, dashed in ((results.dynamics.wrenches, False), (estimated, True)):
        if wrenches is not None and len(wrenches):
            curves += _vertical(body, wrenches, dashed)
    return Chart("Vertical force [N]", tuple(curves[:MAX_CURVES])) if curves else None


def _vertical(body: PlayedBody, wrenches: Wrenches, dashed: bool) -> list[Curve]:
    values = np.where(np.isfinite(wrenches.forces), wrenches.forces, 0.0) @ body.scene.up
    acts = np.abs(values).max(axis=0) > 1e-6
    result = []
    for act in np.flatnonzero(acts):
        name = wrenches.names[act]
        side = split_side(wrenches.bodies[act])[1] or split_side(name)[1]
        color = INK[side] if side else SEVERAL[act % len(SEVERAL)]
        label = f"{name}, estimated" if dashed else name
        result.append(
            Curve(
                label=label,
                values=at_times(body.time, wrenches.time, values[:, act]),
                color=color,
                dashed=dashed,
            )
        )
    return result


def joint_force_chart(body: PlayedBody, joints: Sequence[str] = ()) -> Chart | None:
    """Chart the norm of the force in joints with contact points, by body weight.

    All such joints are charted by default.
    """
    contacts = body.results.joint_contacts
    if contacts is None or not contacts.joints:
        return None
    curves = []
    names = (joints or contacts.joints)[:MAX_CURVES]
    scale = 1.0 / contacts.weight
    for index, name in enumerate(names):
        values = at_times(body.time, contacts.time, scale * contacts.of(name))
        column = f"total_{name}"
        curve = Curve(name, values, _ink(name, index))
        curves.append(_with_limits(body, JOINT_CONTACT_LOAD, column, curve, scale))
    kinds = {segment_joint(name) for name in names}
    what = f"{kinds.pop().capitalize()} force" if len(kinds) == 1 else "Joint force"
    return Chart(f"{what} [body weights]", tuple(curves))


def segment_joint(name: str) -> str:
    """Return the word for a joint in its name: `knee` of `walker_knee_r`."""
    return split_side(name)[0].rpartition("_")[2]


def center_chart(body: PlayedBody) -> Chart | None:
    """Where every subject's center of mass is against its mean: upwards, ahead and to the right."""
    scene = body.scene
    curves = []
    ways = (("up", scene.up), ("ahead", scene.forward), ("right", scene.right))
    for index, subject in enumerate(body.subjects):
        for (label, axis), color in zip(ways, SEVERAL, strict=False):
            values = body.centers[:, index] @ axis
            if np.isfinite(values).any():
                name = f"{subject.name} {label}".strip()
                curves.append(
                    Curve(name, 100.0 * (values - np.nanmean(values)), color, dashed=index > 0)
                )
    return (
        Chart("Center of mass from its mean [cm]", tuple(curves[:MAX_CURVES])) if curves else None
    )


def at_times(time: Array, clock: Array, values: Array) -> Array:
    """Interpolate values of another clock at the motion's times.

    Parameters
    ----------
    time : (frames,) of the motion [s]
    clock : (samples,) [s]
    values : (samples,)

    Returns
    -------
    (frames,) NaN outside the clock
    """
    return np.interp(time, clock, values, left=np.nan, right=np.nan)


def _ink(name: str, index: int) -> str:
    side = split_side(name)[1]
    return INK[side] if side and index < 2 else SEVERAL[index % len(SEVERAL)]


class Curves:
    """The panel of curves of one body: a coordinate, muscles, forces and the center of mass.

    `gui` are `viser`'s controls. `on` calls a function where a user changes a control:
    `on(control, changed)`.
    """

    def __init__(self, gui: Any, on: Any, body: PlayedBody, now: float):
        self._gui = gui
        self._now = now
        panel = gui.add_panel()
        panel.dock_left()
        panel.set_width(WIDTH)
        names = ("coordinate", "activation", "tension", "torque", "joint", "force", "center")
        tab = panel.add_tab("Curves")
        with tab:
            gui.add_html(UNLISTED, order=-1.0)
            self._coordinate = gui.add_dropdown(
                "Coordinate", ("",), hint="Type to search", order=0.0
            )
        on(self._coordinate, lambda _: self._show_coordinate())
        self._plots = {
            name: Plot(gui, tab, float(place)) for place, name in enumerate(names, start=1)
        }
        self.show_body(body)

    def show_body(self, body: PlayedBody) -> None:
        """Show the curves of another body."""
        self._body = body
        self._choices = coordinate_choices(body)
        self._coordinate.options = tuple(self._choices)
        self._show_coordinate()
        self.show_muscles(strongest(body))
        self._show("joint", joint_force_chart(body))
        self._show("force", force_chart(body))
        self._show("center", center_chart(body))

    def show_muscles(self, muscles: tuple[int, ...]) -> None:
        """Show some muscles, by their indices."""
        self._show("activation", muscle_chart(self._body, muscles, ACTIVATION))
        self._show("tension", muscle_chart(self._body, muscles, MUSCLE_FORCE))

    def move(self, now: float) -> None:
        """Put the lines at another time [s]."""
        self._now = now
        for plot in self._plots.values():
            plot.move(now)

    def _show_coordinate(self) -> None:
        label = self._coordinate.value
        names = self._choices.get(label, ())
        self._show("coordinate", coordinate_chart(self._body, label, names))
        self._show("torque", torque_chart(self._body, label, names))

    def _show(self, name: str, chart: Chart | None) -> None:
        self._plots[name].show(chart, self._body.time, self._now)


class Plot:
    """A chart on a page, whose line moves with the time.

    Another chart is another plot in the same place, made whole by one message: a page that draws
    between a message with other curves and one with their values looks for values that are not
    there.
    """

    def __init__(self, gui: Any, tab: Any, place: float):
        self._gui = gui
        self._tab = tab
        self._place = place
        self._handle: Any = None
        self._time: Array = np.zeros(0)
        self._lines: Array = np.zeros((0, 0))
        self._range = (0.0, 1.0)

    def show(self, chart: Chart | None, time: Array, now: float) -> None:
        """Show another chart at a body's times, or none.

        Parameters
        ----------
        chart : curves to show, or None
        time : (frames,) of the body [s]
        now : the present [s]
        """
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
        if chart is None or len(time) < 2:
            return
        step = max(-(-len(time) // MAX_POINTS), 1)
        self._time = time[::step]
        banded = [chart.curves[index] for index in chart.banded]
        lines = [curve.values for curve in chart.curves] + [
            end for curve in banded for end in (curve.high, curve.low)
        ]
        self._lines = np.stack([np.asarray(line)[::step] for line in lines])
        self._range = _range(self._lines)
        span = {"time": False, "range": (float(self._time[0]), float(self._time[-1]))}
        axes = {"size": 30, "gap": 2, "font": FONT}, {"size": 46, "font": FONT}
        with self._tab:
            self._handle = self._gui.add_uplot(
                self._data(now),
                _series(chart),
                title=f"{chart.title}, 90 % limits" if banded else chart.title,
                bands=_bands(chart) or None,
                axes=axes,
                scales={"x": span, "y": {"range": self._range}},
                legend={"show": True, "live": True},
                cursor={"drag": {"x": True, "y": False}},
                height=HEIGHT,
                padding=(0, 10, 0, 0),
                order=self._place,
            )

    def move(self, now: float) -> None:
        """Put the line at another time [s]."""
        if self._handle is not None:
            self._handle.data = self._data(now)

    def _data(self, now: float) -> tuple[Array, ...]:
        """Put the present into times and values twice, between which the line stands."""
        now = float(np.clip(now, self._time[0], self._time[-1]))
        at = int(np.searchsorted(self._time, now))
        time = np.insert(self._time, at, (now, now))
        values = [
            np.insert(values, at, (np.interp(now, self._time, values),) * 2)
            for values in self._lines
        ]
        line = np.full(len(time), np.nan)
        line[at : at + 2] = self._range
        return (time, *values, line)


def _range(lines: Array) -> tuple[float, float]:
    """Lowest and highest value of lines (lines, samples), with a little room."""
    known = lines[np.isfinite(lines)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    room = 0.06 * max(high - low, 1e-6)
    return low - room, high + room


def _series(chart: Chart) -> tuple[dict[str, Any], ...]:
    """Describe the lines of a plot: time, curves, ends of bands, which are not seen, and now."""
    dash: dict[str, Any] = {"dash": (5, 4)}
    drawn = [
        _line(curve.label, curve.color, 1.5) | (dash if curve.dashed else {})
        for curve in chart.curves
    ]
    limit = _line("limit", "transparent", 0.0) | {"class": "curve-limit"}
    limits = (limit,) * (2 * len(chart.banded))
    return ({"label": "t [s]"}, *drawn, *limits, _line("now", "#8a939a", 1.0))


def _bands(chart: Chart) -> tuple[dict[str, Any], ...]:
    """Describe the bands, which stand behind all curves, filled between their ends.

    The upper end comes first.
    """
    start = 1 + len(chart.curves)
    ends = range(start, start + 2 * len(chart.banded), 2)
    fills = (chart.curves[index].color + BAND_ALPHA for index in chart.banded)
    return tuple(
        {"series": (end, end + 1), "fill": fill} for end, fill in zip(ends, fills, strict=True)
    )


def _line(label: str, stroke: str, width: float) -> dict[str, Any]:
    """How a line of a plot is drawn."""
    return {"label": label, "stroke": stroke, "width": width, "points": {"show": False}}
