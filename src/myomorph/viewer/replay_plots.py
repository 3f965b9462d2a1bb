"""Curves on a page, with a line at the time that is shown."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from myomorph.model.arrays import Array
from myomorph.viewer import replay_charts as charts
from myomorph.viewer.replay_body import PlayedBody
from myomorph.viewer.replay_charts import Chart, Curve

MOST_POINTS = 600
HEIGHT, WIDTH = 150, 400
FONT = "10px system-ui, sans-serif"
NOW: Mapping[str, Any] = MappingProxyType(
    {"label": "now", "stroke": "#1d2329", "width": 1, "points": MappingProxyType({"show": False})}
)


class Curves:
    """The panel of curves of one body: a coordinate, muscles, forces and the center of mass.

    Parameters
    ----------
    gui : `viser`'s controls
    on : how to be told of what a user changes: `on(control, told)`
    """

    def __init__(self, gui: Any, on: Any, body: PlayedBody, now: float):
        self._gui, self._now = gui, now
        panel = gui.add_panel()
        panel.dock_left()
        panel.set_width(WIDTH)
        names = ("coordinate", "activation", "tension", "torque", "force", "center")
        tab = panel.add_tab("Curves")
        with tab:
            self._coordinate = gui.add_dropdown("Coordinate", ("",), hint="Type to search", order=0.0)
        on(self._coordinate, lambda _: self._show_coordinate())
        self._plots = {name: Plot(gui, tab, float(place)) for place, name in enumerate(names, start=1)}
        self.show_body(body)

    def show_body(self, body: PlayedBody) -> None:
        """Show the curves of another body."""
        self._body, self._choices = body, charts.coordinate_choices(body)
        self._coordinate.options = tuple(self._choices)
        self._show_coordinate()
        self.show_muscles(charts.strongest(body))
        self._show("force", charts.force_chart(body))
        self._show("center", charts.center_chart(body))

    def show_muscles(self, muscles: tuple[int, ...]) -> None:
        """Show some muscles, by their indices."""
        self._show("activation", charts.activation_chart(self._body, muscles))
        self._show("tension", charts.tension_chart(self._body, muscles))

    def move(self, now: float) -> None:
        """Put the lines at another time [s]."""
        self._now = now
        for plot in self._plots.values():
            plot.move(now)

    def _show_coordinate(self) -> None:
        label = self._coordinate.value
        names = self._choices.get(label, ())
        self._show("coordinate", charts.coordinate_chart(self._body, label, names))
        self._show("torque", charts.torque_chart(self._body, label, names))

    def _show(self, name: str, chart: Chart | None) -> None:
        self._plots[name].show(chart, self._body.time, self._now)


class Plot:
    """A chart on a page, whose line moves with the time.

    Another chart is another plot in the same place, made whole by one message: a page that draws between a message with
    other curves and one with their values looks for values that are not there.

    Parameters
    ----------
    gui : `viser`'s controls
    tab : where it stands
    place : among the tab's controls
    """

    def __init__(self, gui: Any, tab: Any, place: float):
        self._gui, self._tab, self._place = gui, tab, place
        self._handle: Any = None
        self._time: Array = np.zeros(0)
        self._lines: Array = np.zeros((0, 0))
        self._range = (0.0, 1.0)

    def show(self, chart: Chart | None, time: Array, now: float) -> None:
        """Show another chart at a body's times, or none."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
        if chart is None or len(time) < 2:
            return
        step = max(-(-len(time) // MOST_POINTS), 1)
        self._time = time[::step]
        self._lines = np.stack([one.values[::step] for one in chart.curves])
        known = self._lines[np.isfinite(self._lines)]
        low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
        room = 0.06 * max(high - low, 1e-6)
        self._range = (low - room, high + room)
        with self._tab:
            self._handle = self._gui.add_uplot(
                self._data(now),
                ({"label": "t [s]"}, *(_series(one) for one in chart.curves), _plain(NOW)),
                title=chart.title,
                scales={
                    "x": {"time": False, "range": (float(self._time[0]), float(self._time[-1]))},
                    "y": {"range": self._range},
                },
                axes=({"size": 30, "gap": 2, "font": FONT}, {"size": 46, "font": FONT}),
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
        """Times and values with the present put in twice, between which the line stands."""
        now = float(np.clip(now, self._time[0], self._time[-1]))
        at = int(np.searchsorted(self._time, now))
        time = np.insert(self._time, at, (now, now))
        values = [np.insert(one, at, (np.interp(now, self._time, one),) * 2) for one in self._lines]
        line = np.full(len(time), np.nan)
        line[at : at + 2] = self._range
        return (time, *values, line)


def _series(curve: Curve) -> dict[str, Any]:
    series: dict[str, Any] = {"label": curve.label, "stroke": curve.color, "width": 1.5, "points": {"show": False}}
    return series | {"dash": (5, 4)} if curve.dashed else series


def _plain(value: Any) -> Any:
    """Mappings as dictionaries, which is what a message can hold."""
    return {name: _plain(one) for name, one in value.items()} if isinstance(value, Mapping) else value
