"""How severe a message is: by the largest change that its cause can make to a first screen.

The numbers of a first screen are angles, torques and forces. Each has an error that nobody can
avoid; a cause that changes it by less is good to know, by up to `SEVERE` times as much may change
results, and by more changes them. What concerns few frames changes the curves of few frames, and no
number but by chance: `MOST_FRAMES`, as of the verdict.

Sources: Hicks et al. 2015 (residual forces up to 5 % of the greatest external force), McGinley et
al. 2009 (errors of up to 2 degrees between sessions of gait analysis are acceptable).
"""

from __future__ import annotations

from myomorph.core.model.messages import Severity

FORCE_ERROR = 0.05
"""Of an external force, of a mass and so of torques: share of the greatest."""
ANGLE_ERROR = 2.0
"""Of a joint angle [deg]."""
SEVERE = 3.0
"""A change of so many errors changes results."""
MOST_FRAMES = 0.05
"""Share of the frames that may be missing without a number being so."""


def severity_of(change: float, error: float) -> Severity:
    """Severity of a change of a number against the error that it has anyway, in the same unit."""
    if abs(change) <= error:
        return "good to know"
    return "may change results" if abs(change) <= SEVERE * error else "changes results"


def severity_of_share(share: float, severity: Severity) -> Severity:
    """Severity of what concerns a share of the frames: that of its cause, or good to know."""
    return "good to know" if share <= MOST_FRAMES else severity
