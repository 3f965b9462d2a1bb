"""Notes of the gait page: whose norm it is, what is missing and why."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from myomorph.lab.analysis.gait_curves import KEYS, SIDES, VARIABLES, GaitCurves
from myomorph.lab.analysis.gait_scores import GaitNorm, GaitScores
from myomorph.lab.report.trial.answer.judgement import Use
from myomorph.lab.report.trial.gait.gait_tables import interval_note
from myomorph.lab.report.trial.prepared import Prepared


def gait_notes(
    prepared: Prepared, curves: GaitCurves, norm: GaitNorm | None, note: str, use: Use
) -> list[str]:
    """Return the notes in the order of the page.

    Parameters
    ----------
    prepared : the trial
    curves : of both sides over their strides
    norm : that they are held against, None for none
    note : why there is no norm, "" where there is one
    use : what the verdict allows
    """
    if use == "nothing":
        text = (
            "Curves and numbers are left out: the verdict is not to use them. report.html says why."
        )
        return [text, *_of_head(prepared)]
    most = max(len(curves.strides[side]) for side in SIDES)
    return [
        interval_note(most),
        *_of_norm(norm),
        *([note] if note else []),
        *_of_moments(prepared, curves, use),
        *_of_emg(prepared),
        *_of_head(prepared),
    ]


def score_notes(scores: GaitScores | None, norm: GaitNorm | None) -> list[str]:
    """Say why there is no scaled score."""
    if scores is None or norm is None or scores.scaled:
        return []
    if not scores.offsets:
        return ["No scaled score: it needs controls with the same angles (--norms FOLDER)."]
    if norm.scale is not None:
        return ["No scaled score: the walk and the norm do not have the same angles."]
    if norm.old_scale:
        return [
            "No scaled score: that of the norm's file is of mean curves, and strides differ more."
            " Write the file again with 'myomorph norms'."
        ]
    return ["No scaled score: it needs a control group of five or more (--norms FOLDER)."]


def _of_norm(norm: GaitNorm | None) -> Iterable[str]:
    """Say whose norm it is, and what it lacks."""
    if norm is None:
        return
    persons = f"; {norm.persons} persons" if norm.persons else ""
    group = f"{norm.group}: " if norm.group else ""
    yield f"Norm: {group}{norm.source}{persons}."
    if not norm.has_curves:
        yield "No norm of curves: of this group it has parameters alone."
        return
    if not norm.same_definitions:
        yield (
            "The norm has the marker set and angles of another laboratory: offsets of pelvis and"
            " hip by ten or twenty degrees are definitions. Differences are of shape alone, and no"
            " gait profile score."
        )
    known = np.asarray(np.isfinite(norm.mean).any(axis=0)).tolist()
    absent = [variable.title for variable, has in zip(VARIABLES, known, strict=True) if not has]
    if absent:
        yield f"Missing in the norm: {'; '.join(absent)}."


def _of_moments(prepared: Prepared, curves: GaitCurves, use: Use) -> Iterable[str]:
    """Say of which strides moments are, or that the verdict leaves them out."""
    if use == "angles":
        if prepared.results.dynamics.torques is not None:
            yield "Moments and powers are left out: the verdict allows angles only."
        return
    for side in SIDES:
        whole = len(curves.strides[side])
        moments = curves.of(side)[:, :, KEYS.index("knee_moment")]
        count = int(np.isfinite(moments).any(axis=1).sum())
        if count < whole:
            part = f"moments and powers of {count} of {whole} strides"
            yield f"{side.capitalize()}: {part}, those whose foot stood on a plate."


def _of_emg(prepared: Prepared) -> Iterable[str]:
    """Say what envelopes are scaled by."""
    if prepared.results.recorded.emg is not None:
        yield "EMG: 100 % is the largest value of a channel's mean over the strides of its side."


def _of_head(prepared: Prepared) -> Iterable[str]:
    """Say what is simulated, and what the report has to say beyond this page."""
    head = prepared.results.head
    for part in head.notes:
        if part.kind == "simulated":
            yield f"Simulated: {part.text}"
    over = sum(verdict.state == "over" for verdict in prepared.verdicts)
    if over or head.warnings:
        yield (
            f"report.html has {over} quantities over their limits and {len(head.warnings)}"
            " warnings."
        )
