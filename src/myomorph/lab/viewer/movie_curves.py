"""Which curves a movie shows: chosen by name, or those that say most."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.sides import split_side
from myomorph.core.tension.quantities import ACTIVATION
from myomorph.lab.analysis.muscle_names import plain_name
from myomorph.lab.analysis.selection import pairs, printed
from myomorph.lab.viewer.replay_body import PlayedBody
from myomorph.lab.viewer.replay_charts import (
    Chart,
    coordinate_chart,
    coordinate_choices,
    force_chart,
    joint_force_chart,
    muscle_chart,
    strongest,
    torque_chart,
)

MAX_CHARTS = 3
FORCES = "forces"
"""Name of the chart of vertical external forces."""

Choices = Mapping[str, Callable[[], Chart | None]]


def movie_charts(body: PlayedBody, names: Sequence[str] = ()) -> tuple[Chart, ...]:
    """Charts of a movie.

    Parameters
    ----------
    body : that is played
    names : of coordinates, moments (`knee_angle_r_moment`), muscles, joints with contact forces, or
        `forces`, with their side or without; by default forces, the joint that moves most, and the
        muscles that pull hardest

    Raises
    ------
    BadData : there are too many, or one of them is not known in these results
    UnknownName : results have no curve of that name
    """
    if not names:
        return tuple(chart for chart in _usual(body) if chart is not None)
    if len(names) > MAX_CHARTS:
        raise BadData(f"{len(names)} curves: a movie has room for {MAX_CHARTS}")
    choices = curve_choices(body)
    charts = []
    for name in names:
        check_name("curve", name, choices, "these results")
        chart = choices[name]()
        if chart is None:
            raise BadData(f"curve '{name}': these results do not contain it")
        charts.append(_named_by_side(chart))
    return tuple(charts)


def curve_choices(body: PlayedBody) -> Choices:
    """List all curves that can be chosen, each made when it is called."""
    choices: dict[str, Callable[[], Chart | None]] = {FORCES: partial(force_chart, body)}
    for label, names in coordinate_choices(body).items():
        for key, members in _with_sides(names).items():
            choices[key] = partial(coordinate_chart, body, label, members)
            choices[f"{key}_moment"] = partial(torque_chart, body, label, members)
    for pair in pairs(body.muscles):
        for key, members in _with_sides(pair.names).items():
            choices.setdefault(key, partial(_activation_chart, body, members))
    contacts = body.results.joint_contacts
    for pair in pairs(() if contacts is None else contacts.joints):
        for key, members in _with_sides(pair.names).items():
            choices.setdefault(key, partial(joint_force_chart, body, members))
    return choices


def _usual(body: PlayedBody) -> tuple[Chart | None, ...]:
    """Return forces in the most loaded joints or under the feet, an angle and activations."""
    loads = _most_loaded(body) or force_chart(body)
    angles = next(
        (coordinate_chart(body, *choice) for choice in coordinate_choices(body).items()), None
    )
    pulling = tuple(body.muscles[muscle] for muscle in strongest(body))
    activations = _activation_chart(body, pulling) if pulling else None
    charts = (loads, angles, activations)
    return tuple(None if chart is None else _named_by_side(chart) for chart in charts)


def _most_loaded(body: PlayedBody) -> Chart | None:
    """Return forces of the joint, on both sides, that carries most."""
    contacts = body.results.joint_contacts
    if contacts is None or not contacts.joints:
        return None
    peaks = dict(zip(contacts.joints, np.nanmax(contacts.joint_contact_total, axis=0), strict=True))
    heaviest = max(pairs(contacts.joints), key=lambda pair: max(peaks[name] for name in pair.names))
    return joint_force_chart(body, heaviest.names)


def _activation_chart(body: PlayedBody, names: Sequence[str]) -> Chart | None:
    """Return activations of some muscles, with the muscle's name in the title."""
    chart = muscle_chart(body, [body.muscles.index(name) for name in names], ACTIVATION)
    if chart is None:
        return None
    name = plain_name(names[0]).capitalize() or printed(split_side(names[0])[0])
    return replace(chart, title=f"{name}: activation")


def _with_sides(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Names that a pair can be chosen by: its base for all sides, and each member."""
    members = {name: (name,) for name in names}
    return {split_side(names[0])[0]: tuple(names), **members}


def _named_by_side(chart: Chart) -> Chart:
    """Return a chart whose curves are called by their sides, where these tell them apart."""
    drawn = [curve.label for curve in chart.curves if not curve.dashed]
    sides = [split_side(label)[1] for label in drawn]
    bases = {split_side(label)[0] for label in drawn}
    if len(bases) != 1 or len(set(sides)) != len(sides) or "" in sides:
        return chart
    curves = tuple(
        curve if curve.dashed else replace(curve, label=split_side(curve.label)[1])
        for curve in chart.curves
    )
    return replace(chart, curves=curves)
