"""A walker whose muscles and coordinates have names that are markup, as a stranger may choose."""

from __future__ import annotations

from dataclasses import replace

import pytest

import walker
from myomorph.core.model.model import Model
from myomorph.lab.report.trial.report_input import ReportInput

MARKUP = (
    "<img src=x onerror=\"document.title='ran'\">",
    "<iframe srcdoc=\"<script>parent.document.title='ran'</script>\"></iframe>",
    "[see](javascript:document.title='ran')",
    "<svg onload=\"document.title='ran'\"></svg>",
)
"""Beginnings of names; each shows itself by the title of the page."""
RAN = """
document.title === "ran"
|| document.querySelector("iframe[srcdoc], img[src=x], svg[onload]") !== null
|| [...document.querySelectorAll("a")].some(link => link.href.startsWith("javascript"))
"""
"""An expression of JavaScript: whether a name was taken for markup in a page."""


def odd_model() -> Model:
    """Make a walker whose muscles and coordinates have names that are markup."""
    model = _usual_model()
    muscles = [
        replace(muscle, name=f"{MARKUP[index % 4]} {index}")
        for index, muscle in enumerate(model.muscles)
    ]
    names = {
        coordinate.name: f"{MARKUP[index % 4]} {index}"
        for index, coordinate in enumerate(model.coordinates)
    }
    joints = [
        replace(
            joint,
            axes=tuple(
                replace(axis, coordinates=tuple(names[name] for name in axis.coordinates))
                for axis in joint.axes
            ),
            coordinates=tuple(names[name] for name in joint.coordinates),
        )
        for joint in model.joints
    ]
    coordinates = [
        replace(coordinate, name=names[coordinate.name]) for coordinate in model.coordinates
    ]
    return replace(
        model, muscles=tuple(muscles), joints=tuple(joints), coordinates=tuple(coordinates)
    )


_usual_model = walker.model


def odd_report() -> ReportInput:
    """Return what a report shows of that walker."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(walker, "model", odd_model)
        return walker.having(walker.everything(100), title=MARKUP[0], subject=MARKUP[1])
