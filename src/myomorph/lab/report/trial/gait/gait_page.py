"""The page on a walk for the clinic: who, of how many strides, curves of both sides, tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.analysis.emg_strides import EmgStrides, emg_strides
from myomorph.lab.analysis.gait_curves import KEYS, SIDES, VARIABLES, GaitCurves, GaitVariable
from myomorph.lab.analysis.gait_parameters import gait_parameters
from myomorph.lab.analysis.gait_scores import LEVEL, GaitNorm, gait_scores
from myomorph.lab.analysis.muscle_names import plain_name
from myomorph.lab.analysis.stride_spread import MIN_STRIDES
from myomorph.lab.report.page.page import page_text
from myomorph.lab.report.page.parts import Grid
from myomorph.lab.report.trial.answer.answer import answer_of
from myomorph.lab.report.trial.answer.first_screen import STYLES
from myomorph.lab.report.trial.answer.judgement import Use
from myomorph.lab.report.trial.gait.gait_axis import AXES, EMG_AXIS
from myomorph.lab.report.trial.gait.gait_chart import NormBand, StrideLine, gait_chart
from myomorph.lab.report.trial.gait.gait_notes import gait_notes, score_notes
from myomorph.lab.report.trial.gait.gait_tables import extreme_grid, parameter_grid, score_grid
from myomorph.lab.report.trial.gait.gait_title import gait_title
from myomorph.lab.report.trial.prepared import Prepared

GAIT_PAGE = "gait.html"
ENVELOPE = "_activation"
"""With which some laboratories end the names of channels."""
NO_BREAK = "\u00a0"
Kind = Literal["angle", "moment", "power", "force"]
KINDS: Mapping[Use, tuple[Kind, ...]] = FrozenMap(
    {
        "nothing": (),
        # What plates measured holds whatever the torques are worth.
        "angles": ("angle", "force"),
        "angles and torques": ("angle", "moment", "power", "force"),
        "everything": ("angle", "moment", "power", "force"),
    }
)
"""Curves that a verdict allows."""


@dataclass(frozen=True)
class ChartGroup:
    """Charts under a heading."""

    title: str
    charts: tuple[str, ...]


def gait_page(prepared: Prepared, curves: GaitCurves, norm: GaitNorm | None, note: str = "") -> str:
    """Return the page as HTML text that needs nothing else.

    Parameters
    ----------
    prepared : the trial
    curves : of both sides over their strides
    norm : that they are held against, None for none
    note : why there is no norm, "" where there is one
    """
    judgement = answer_of(prepared).judgement
    variables = [each for each in VARIABLES if each.kind in KINDS[judgement.use]]
    errors = prepared.results.uncertainty.gait or None
    scored = norm is not None and norm.has_curves and bool(variables)
    scores = gait_scores(curves, norm, errors) if norm is not None and scored else None
    grids = (
        _parameters(prepared, norm) if variables else None,
        score_grid(scores, norm),
        extreme_grid(curves, variables),
    )
    return page_text(
        "gait.html.j2",
        head=prepared.results.head,
        title=gait_title(curves.strides),
        judgement=judgement,
        judgement_style=STYLES[judgement.use],
        facts=who_facts(prepared),
        groups=_groups(prepared, curves, variables, norm),
        legend=_legend(curves, norm, drawn=errors is not None),
        grids=[grid for grid in grids if grid is not None],
        notes=[
            *gait_notes(prepared, curves, norm, note, judgement.use),
            *score_notes(scores, norm),
        ],
    )


def who_facts(prepared: Prepared) -> dict[str, str]:
    """Return who was recorded, when, and how fast they walked, one line each."""
    recorded = prepared.results.recorded
    age = "" if recorded.age is None else f"{recorded.age:g}{NO_BREAK}years"
    height = "" if recorded.height is None else f"{recorded.height:.2f}{NO_BREAK}m"
    mass = "" if recorded.mass is None else f"{recorded.mass:.1f}{NO_BREAK}kg"
    who = [part for part in (recorded.subject, age, recorded.sex, height, mass) if part]
    unknown = [
        name
        for name, text in (("age", age), ("sex", recorded.sex), ("height", height), ("mass", mass))
        if not text
    ]
    facts = {
        "Person": ", ".join(who) or "not known",
        "Not stated": ", ".join(unknown),
        "Recorded": recorded.date or "day not known",
        "Computed": prepared.results.head.date[:10],
    }
    return {name: text for name, text in facts.items() if text}


def short_title(variable: GaitVariable) -> str:
    """Return the title of a variable without the direction that its axis has."""
    return variable.title.partition(",")[0].replace("plantarflexion ", "")


def foot_off(curves: GaitCurves, side: str) -> float | None:
    """Return where a foot leaves the ground in the mean of its strides [%], None if not seen."""
    duties = [stride.duty for stride in curves.strides[side] if np.isfinite(stride.duty)]
    return 100.0 * float(np.mean(duties)) if duties else None


def _groups(
    prepared: Prepared,
    curves: GaitCurves,
    variables: Sequence[GaitVariable],
    norm: GaitNorm | None,
) -> list[ChartGroup]:
    """Return the charts under their headings; those without any are left out."""
    errors = prepared.results.uncertainty.gait
    charts = {
        variable.key: _chart(variable, curves, errors, _band(norm, variable.key))
        for variable in variables
    }
    kinetic = [each.key for each in variables if each.kind != "angle"]
    groups = (
        ChartGroup("Angles", _of(charts, [each.key for each in variables if each.kind == "angle"])),
        ChartGroup(_kinetic_title(variables), _of(charts, kinetic)),
        ChartGroup("EMG envelopes", _emg(prepared, curves) if variables else ()),
    )
    return [group for group in groups if group.charts]


def _kinetic_title(variables: Sequence[GaitVariable]) -> str:
    """Return the heading of what is no angle."""
    if any(variable.kind == "moment" for variable in variables):
        return "Moments of muscles per body mass, powers, vertical force"
    return "Vertical force"


def _of(charts: Mapping[str, str], keys: Sequence[str]) -> tuple[str, ...]:
    """Return the charts of some variables that are not empty."""
    return tuple(charts[key] for key in keys if charts[key])


def _chart(
    variable: GaitVariable,
    curves: GaitCurves,
    errors: Mapping[str, Array],
    norm: NormBand | None,
) -> str:
    """Return both sides of a variable over the norm, "" where neither is known."""
    index = KEYS.index(variable.key)
    lines = []
    for side in SIDES:
        drawn = errors[side][:, :, index] if side in errors else None
        strides = curves.of(side)[:, :, index]
        line = StrideLine(
            strides=strides,
            style=side,
            label=side,
            foot_off=foot_off(curves, side),
            edges=_edges(strides, drawn),
        )
        lines.append(line)
    return gait_chart(short_title(variable), variable.unit, AXES[variable.key], lines, norm)


def _edges(strides: Array, errors: Array | None) -> tuple[Array, Array] | None:
    """Return the interval of 90 % of a mean curve by draws of errors.

    Parameters
    ----------
    strides : (strides, samples)
    errors : (draws, samples) of the mean curve, None where nothing was drawn

    Returns
    -------
    low and high (samples,), None for none
    """
    if errors is None or not np.isfinite(errors).any():
        return None
    mean = StrideLine(strides=strides, style="", label="").mean
    low, high = np.nanquantile(errors, (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL), axis=0)
    return mean + low, mean + high


def _band(norm: GaitNorm | None, key: str) -> NormBand | None:
    """Return what a norm has of a variable, None for nothing."""
    if norm is None:
        return None
    index = KEYS.index(key)
    return NormBand(mean=norm.mean[:, index], deviation=norm.deviation[:, index])


def _emg(prepared: Prepared, curves: GaitCurves) -> tuple[str, ...]:
    """Return a chart for each muscle whose EMG was recorded, both sides in one."""
    recorded = prepared.results.recorded
    if recorded.emg is None:
        return ()
    channels = emg_strides(recorded.emg, curves.strides, recorded.emg_muscles)
    muscles: dict[str, list[EmgStrides]] = {}
    for channel in channels:
        muscles.setdefault(channel.muscle, []).append(channel)
    charts = []
    for muscle, parts in muscles.items():
        lines = [
            StrideLine(
                strides=100.0 * part.values,
                style=part.side,
                label=part.side,
                foot_off=foot_off(curves, part.side),
            )
            for part in parts
        ]
        charts.append(gait_chart(muscle.removesuffix(ENVELOPE), _named(muscle), EMG_AXIS, lines))
    return tuple(chart for chart in charts if chart)


def _named(muscle: str) -> str:
    """Return the unit of an envelope and the plain name of its muscle, where it is known."""
    plain = plain_name(muscle)
    return f"%, {plain}" if plain and not muscle.lower().startswith(plain) else "%"


def _parameters(prepared: Prepared, norm: GaitNorm | None) -> Grid | None:
    """Return spatio-temporal parameters, None where strides are not known."""
    if prepared.strides is None:
        return None
    return parameter_grid(gait_parameters(prepared.strides), norm)


def _legend(curves: GaitCurves, norm: GaitNorm | None, drawn: bool) -> list[tuple[str, str]]:
    """Return styles and words of the lines and bands that are drawn."""
    counts = [len(curves.strides[side]) for side in SIDES]
    legend = [("right", "right"), ("left", "left")]
    if max(counts) >= MIN_STRIDES:
        legend.append(("spread", "band: 1 SD between strides"))
    if any(1 < count < MIN_STRIDES for count in counts):
        legend.append(("thin", "thin: single strides, as they are few"))
    if drawn:
        legend.append(("edge", "fine dots: 90 % of the draws of errors"))
    if norm is not None and norm.has_curves:
        legend.append(("norm", "norm, mean ± 1 SD"))
    return [*legend, ("off", "dotted: foot off; numbers: strides")]
