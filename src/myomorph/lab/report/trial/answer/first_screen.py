"""The first screen as HTML: sentence, verdict, body, three curves, facts, and causes of doubt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.causes import FEET_BESIDE
from myomorph.core.model.errors import counted
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.message_groups import CauseGroup
from myomorph.core.model.messages import Message, Severity, Span
from myomorph.lab.report.scene.scene import Acting, make_scene
from myomorph.lab.report.trial.answer.answer import Answer
from myomorph.lab.report.trial.answer.answer_chart import answer_chart
from myomorph.lab.report.trial.answer.answer_curve import FEW
from myomorph.lab.report.trial.answer.foot_stances import foot_stances
from myomorph.lab.report.trial.answer.judgement import Use
from myomorph.lab.report.trial.answer.main_result import KeyPose, MainResult
from myomorph.lab.report.trial.answer.over_time import SECONDS
from myomorph.lab.report.trial.answer.plate_strip import plate_strip
from myomorph.lab.report.trial.answer.pose_pictures import PosePicture, pose_pictures
from myomorph.lab.report.trial.answer.sentence import with_unit
from myomorph.lab.report.trial.answer.time_strip import time_strip
from myomorph.lab.report.trial.prepared import Prepared

STYLES: Mapping[Use, str] = FrozenMap(
    {
        "everything": "usable",
        "angles and torques": "partly",
        "angles": "partly",
        "nothing": "unusable",
    }
)
"""Class of the style sheet of each verdict."""
SEVERITY_CLASSES: Mapping[Severity, str] = FrozenMap(
    {
        "changes results": "unusable",
        "may change results": "partly",
        "good to know": "usable",
    }
)
"""Class of the style sheet of each cause."""


@dataclass(frozen=True)
class ShownPose:
    """A pose with its picture and the words below it."""

    pose: KeyPose
    picture: PosePicture
    busiest: str


@dataclass(frozen=True)
class ShownCurve:
    """A chart with its heading."""

    title: str
    unit: str
    svg: str


@dataclass(frozen=True, kw_only=True)
class FirstScreen:
    """What the template of the page shows first.

    Attributes
    ----------
    answer : the answer in words
    style : class of its verdict
    poses : pictures in order of time; none without a model or a motion
    curves : at most three charts
    note : what thick and thin lines or bands are
    colored : whether the muscles have the colors of activations
    span : first and last time of the trial [s], None without frames
    plates : when each foot stood and where a plate measured it, as SVG; "" where no verdict or
        cause is about feet beside plates
    """

    answer: Answer
    style: str
    poses: tuple[ShownPose, ...]
    curves: tuple[ShownCurve, ...]
    note: str
    colored: bool
    plates: str
    span: Span | None

    @property
    def warnings(self) -> tuple[CauseGroup, ...]:
        """Causes that may change a number of the first screen by more than its error."""
        return tuple(group for group in self.answer.causes if group.is_warning)

    @property
    def known(self) -> tuple[Message, ...]:
        """Messages of causes that change none."""
        groups = (group for group in self.answer.causes if not group.is_warning)
        return tuple(message for group in groups for message in group.messages)

    @property
    def known_titles(self) -> str:
        """Causes that change nothing, with the number of their messages."""
        groups = (group for group in self.answer.causes if not group.is_warning)
        return "; ".join(f"{group.cause.title} ({len(group.messages)})" for group in groups)

    @property
    def causes_note(self) -> str:
        """Number of causes, and of what is good to know, beside the section's title."""
        serious = counted(len(self.warnings), "cause") if self.warnings else "none"
        known = f"; {len(self.known)} good to know" if self.known else ""
        return f"{serious}{known}"

    def strip(self, group: CauseGroup) -> str:
        """Draw when a cause acts over the time of the trial; "" where it acts throughout."""
        if self.span is None or not group.spans:
            return ""
        return time_strip(group.spans, self.span)

    @staticmethod
    def css_class(severity: Severity) -> str:
        """Class of the style sheet of a cause."""
        return SEVERITY_CLASSES[severity]


def first_screen(prepared: Prepared, answer: Answer) -> FirstScreen:
    """Pictures and charts of an answer."""
    result = answer.result
    curves: list[ShownCurve] = []
    if result is not None:
        for index, curve in enumerate(result.curves, 1):
            chart = answer_chart(curve, result, last=index == len(result.curves))
            curves.append(ShownCurve(curve.title, curve.unit, chart))
    return FirstScreen(
        answer=answer,
        style=STYLES[answer.judgement.use],
        poses=_poses(prepared, answer),
        curves=tuple(curves),
        note="" if result is None else _note(result),
        colored=any(answer.busiest),
        span=_span(prepared),
        plates=_plates(prepared, answer),
    )


def _plates(prepared: Prepared, answer: Answer) -> str:
    """Draw the strip of plates where a cause is about feet beside them; else ""."""
    if all(group.cause.key != FEET_BESIDE.key for group in answer.causes):
        return ""
    return plate_strip(foot_stances(prepared), prepared.span)


def _span(prepared: Prepared) -> Span | None:
    """First and last time of the motion [s]."""
    motion = prepared.results.kinematics.motion
    if motion is None or len(motion.time) < 2:
        return None
    return float(motion.time[0]), float(motion.time[-1])


def _poses(prepared: Prepared, answer: Answer) -> tuple[ShownPose, ...]:
    """Key poses with their pictures; those whose frame is not known are left out."""
    results = prepared.results
    motion = results.kinematics.motion
    if answer.result is None or results.model is None or motion is None:
        return ()
    known = np.flatnonzero(np.isfinite(motion.values).all(axis=1))
    if not len(known):
        return ()
    chosen = [
        int(known[np.argmin(np.abs(motion.time[known] - pose.time))])
        for pose in answer.result.poses
    ]
    if not chosen:
        return ()
    scene = make_scene(results.model, motion, chosen, results.surfaces, Acting(results.activations))
    drawn = pose_pictures(results.model, scene)
    return tuple(
        ShownPose(pose, picture, busiest)
        for pose, picture, busiest in zip(answer.result.poses, drawn, answer.busiest, strict=True)
    )


def _note(result: MainResult) -> str:
    """Say what the lines of the charts are."""
    counts = [len(side.cycles) for curve in result.curves for side in curve.sides]
    most = max(counts, default=0)
    lift = "" if result.lift is None else " Dotted: foot off."
    if most >= FEW:
        return f"Lines: mean; bands: 1 SD between cycles.{lift} Numbers: the poses."
    if most > 1:
        return f"Thick: mean. Thin: each cycle, as they are few.{lift} Numbers: the poses."
    first, *_ = result.curves
    start = f"{float(first.at[0]):.1f}"
    stop = with_unit(float(first.at[-1]), "s", 1)
    span = f" From {start} to {stop}." if result.axis == SECONDS else ""
    return f"A single repetition, without a spread.{span} Numbers: the poses."
