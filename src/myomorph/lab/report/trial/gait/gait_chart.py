"""Strides of both sides, or of two sessions, as SVG: mean and spread, or each stride."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.lab.analysis.gait_curves import known_mean
from myomorph.lab.analysis.stride_spread import MIN_STRIDES
from myomorph.lab.report.charts import marks as svg
from myomorph.lab.report.trial.gait.gait_axis import GaitAxis

WIDTH = 330.0
HEIGHT = 150.0
LEFT = 34.0
RIGHT = 6.0
TOP = 22.0
BOTTOM = 18.0


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class StrideLine:
    """Strides that are drawn in one style.

    Attributes
    ----------
    strides : (strides, samples) in the chart's unit, NaN where not known
    style : class of the style sheet: "right", "left" or "first", with others behind it
    label : what the reading under the pointer calls it
    count_label : before the number of strides, "" for the label
    foot_off : where the foot leaves the ground [%], None where it was not seen
    edges : low and high (samples,) of the interval of the mean by draws of errors, None for none
    """

    strides: Array
    style: str
    label: str
    count_label: str = ""
    foot_off: float | None = None
    edges: tuple[Array, Array] | None = None

    @property
    def known(self) -> Array:
        """(strides, samples) of which something is known."""
        return self.strides[np.isfinite(self.strides).any(axis=1)]

    @property
    def mean(self) -> Array:
        """(samples,) over the strides that are known."""
        return known_mean(self.strides)

    @property
    def shown(self) -> Array:
        """Every value that is drawn, in one row."""
        parts = [self.known.ravel(), *(self.edges or ())]
        return np.concatenate(parts)


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class NormBand:
    """What healthy people do: mean and standard deviation between people.

    Attributes
    ----------
    mean, deviation : (samples,) in the chart's unit
    """

    mean: Array
    deviation: Array


def gait_chart(
    title: str, unit: str, axis: GaitAxis, lines: Sequence[StrideLine], norm: NormBand | None = None
) -> str:
    """Return a chart over the stride, "" where nothing is known of any line.

    Parameters
    ----------
    title, unit : of the curves
    axis : upright one
    lines : in front last
    norm : behind them, None for none
    """
    lines = [line for line in lines if len(line.known)]
    if not lines:
        return ""
    axis = axis.holding(np.concatenate([line.shown for line in lines]))
    limits = (axis.low, axis.high)
    area = svg.frame((LEFT, TOP), (WIDTH - RIGHT, HEIGHT - BOTTOM), (0.0, 100.0), limits)
    parts = [svg.grid_up(area), svg.grid_along(area, 4, lines=False, drop=13.0)]
    if norm is not None:
        parts.append(_norm(area, norm))
    parts += [_foot_off(area, line) for line in lines]
    parts += [_drawn(area, line) for line in lines]
    parts += [_words(area, axis), _counts(lines)]
    attributes = f'{area.data} data-clock="%"'
    return svg.drawing(
        "time gait", title, (WIDTH, HEIGHT), *parts, unit=unit, attributes=attributes
    )


def _percent(values: Array) -> Array:
    """Return the percent of the stride (samples,) at which values (samples,) stand."""
    return np.linspace(0.0, 100.0, len(values))


def _norm(area: svg.Frame, norm: NormBand) -> str:
    """Return mean and standard deviation of healthy people."""
    if not np.isfinite(norm.mean).any():
        return ""
    percent = _percent(norm.mean)
    low = norm.mean - norm.deviation
    high = norm.mean + norm.deviation
    band = svg.band(area, percent, low, high, "norm")
    return band + svg.line(area, percent, norm.mean, "norm", "norm")


def _foot_off(area: svg.Frame, line: StrideLine) -> str:
    """Return an upright line where the foot leaves the ground."""
    if line.foot_off is None:
        return ""
    path = f"M{float(area.x.at(line.foot_off)):.1f} {area.y.stop:.1f}V{area.y.start:.1f}"
    return svg.mark("path", f"off {line.style}", f"{line.label}: foot off", d=path)


def _drawn(area: svg.Frame, line: StrideLine) -> str:
    """Return one stride as it is, few with their mean in front, many as mean and spread."""
    known = line.known
    percent = _percent(line.mean)
    parts = [svg.line(area, percent, edge, f"edge {line.style}") for edge in line.edges or ()]
    if len(known) == 1:
        parts.append(svg.line(area, percent, line.mean, f"single {line.style}", line.label))
        return "".join(parts)
    if len(known) >= MIN_STRIDES:
        parts.append(_spread(area, line))
    else:
        parts += [svg.line(area, percent, stride, f"thin {line.style}") for stride in known]
    parts.append(svg.line(area, percent, line.mean, line.style, line.label))
    return "".join(parts)


def _spread(area: svg.Frame, line: StrideLine) -> str:
    """Return a band of one standard deviation between strides."""
    with np.errstate(invalid="ignore"):
        squares = known_mean((line.known - line.mean) ** 2)
        count = np.isfinite(line.known).sum(axis=0)
        sd = np.sqrt(squares * count / np.where(count > 1, count - 1, np.nan))
    return svg.band(area, _percent(line.mean), line.mean - sd, line.mean + sd, line.style)


def _words(area: svg.Frame, axis: GaitAxis) -> str:
    """Return the words of the directions at the ends of the axis."""
    x = area.x.start + 4.0
    above = svg.text(x, area.y.stop + 9.5, axis.up, "way") if axis.up else ""
    below = svg.text(x, area.y.start - 4.0, axis.down, "way") if axis.down else ""
    longer = svg.text(area.x.stop, area.y.stop + 9.5, "longer axis", "way end")
    return above + below + (longer if axis.longer else "")


def _counts(lines: Sequence[StrideLine]) -> str:
    """Return the number of strides of each line at the top right."""
    parts = []
    x = WIDTH - RIGHT
    for line in reversed(lines):
        words = f"{line.count_label or line.label}\u00a0{len(line.known)}"
        parts.append(svg.text(x, 12.0, words, f"count {line.style}"))
        x -= 5.2 * len(words) + 8.0
    return "".join(parts)
