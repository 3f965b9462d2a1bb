"""What `personalize` prints of its result: what was held out, how much the recordings show, where fibers work."""

from __future__ import annotations

import numpy as np

from myomorph.model.errors import few
from myomorph.report.trial.muscle_summary import FIBER_RANGE
from myomorph.report.trial.summary_lines import reserve_unit
from myomorph.tension.personal.personalize import Personalized


def personal_lines(personalized: Personalized) -> list[str]:
    """What was fitted to, whether it explains what was held out, and what the recordings show."""
    lines = []
    if personalized.mapped is not None:
        before, after = (float(np.nanmax(values)) for values in (personalized.mapped.before, personalized.mapped.after))
        lines.append(
            f"{len(personalized.mapped.muscles)} muscles mapped from the generic model: normalized fiber "
            f"lengths differ by at "
            f"most {after:.3f} (root mean square over poses; {before:.3f} before)"
        )
    if personalized.recordings:
        lines.append(
            f"{', '.join(personalized.recordings)}: {personalized.frames[1]} frames that count "
            f"as {personalized.frames[0]:.0f} independent ones, torques of {len(personalized.coordinates)} coordinates"
        )
    if personalized.held_out is not None:
        held_out = personalized.held_out
        generic, fitted = (float(np.sqrt(np.nanmean(left**2))) for left in (held_out.left_generic, held_out.left))
        better = "better" if held_out.score < held_out.score_generic else "NO better"
        if better == "better" and fitted > generic:
            better = "better by the score, which includes EMG and the prior, but with larger torque residuals"
        lines.append(
            f"{', '.join(held_out.recordings)}, held out: {better} than generic muscles (score {held_out.score:.2f}, "
            f"generic {held_out.score_generic:.2f}; torque left {fitted:.2f}, generic {generic:.2f} N m)"
        )
    elif personalized.recordings:
        lines.append("nothing was held out: whether these muscles are better than generic ones is not known")
    lines += [
        line for line in (_torque_line(personalized), _parameter_line(personalized), _fiber_line(personalized)) if line
    ]
    return lines


def _torque_line(personalized: Personalized) -> str:
    """The coordinate whose torques are known worst."""
    errors = np.asarray(personalized.torque_errors, float)
    if not len(errors) or not np.isfinite(errors).any():
        return ""
    worst = int(np.nanargmax(errors))
    unit = reserve_unit(personalized.model, personalized.coordinates[worst])
    middle = f"{float(np.nanmedian(errors)):.2g}"
    where = f"{personalized.coordinates[worst]} {errors[worst]:.2g} {unit}"
    return f"torques fitted to {middle} N m (median SD), worst {where}"


def _parameter_line(personalized: Personalized) -> str:
    """How many parameters the recordings show, and which end at what is physiological."""
    if not personalized.recordings:
        return ""
    counts = {
        kind: sum(estimate.identifiable == kind for estimate in personalized.estimates)
        for kind in ("yes", "partly", "no")
    }
    bound = [
        f"{estimate.of} {estimate.parameter.replace('_', ' ')}" for estimate in personalized.estimates if estimate.bound
    ]
    ends = "none at a physiological limit"
    if bound:
        ends = f"{len(bound)} at a physiological limit ({few(bound, 2)})"
    return (
        f"of {len(personalized.estimates)} parameters {counts['yes']} identifiable, {counts['partly']} partly, "
        f"{counts['no']} as assumed before; {ends}"
    )


def _fiber_line(personalized: Personalized) -> str:
    """Where fibers work in the recordings, against the range in which they pull."""
    after = np.asarray(personalized.after, float)
    if not after.size or not np.isfinite(after).any():
        return ""
    names, (low, high) = personalized.model.muscle_names, FIBER_RANGE
    shortest, longest = int(np.nanargmin(after[:, 0])), int(np.nanargmax(after[:, 1]))
    with np.errstate(invalid="ignore"):
        outside = int(((after[:, 0] < low) | (after[:, 1] > high)).sum())
    verdict = f"within {low:g} to {high:g}" if not outside else f"{outside} muscles outside {low:g} to {high:g}"
    return (
        f"fibers work from {after[shortest, 0]:.2f} ({names[shortest]}) to {after[longest, 1]:.2f} optimal lengths "
        f"({names[longest]}): {verdict} (Zajac 1989)"
    )
