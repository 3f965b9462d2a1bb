"""Which steps a trial has: one line each. This table imports nothing, so that the command line starts fast."""

from __future__ import annotations

STEPS: dict[str, str] = {
    "ik": "myomorph.study.trial.steps.ik",
    "id": "myomorph.study.trial.steps.id",
    "muscles": "myomorph.study.trial.steps.muscles",
    "tension": "myomorph.study.trial.steps.tension",
    "uncertainty": "myomorph.study.trial.steps.uncertainty",
}
"""In the order in which they run: a step's name, and the module whose `STEP` it is, imported when first needed."""

ON_REQUEST = ("uncertainty",)
"""Steps that run only where somebody names them."""

REPORT = "report"
"""The last step of a trial; it reads what the others stored, and its page is no result."""


def usual_steps() -> tuple[str, ...]:
    """Steps that run where nobody says which, the report as the last."""
    return (*(step for step in STEPS if step not in ON_REQUEST), REPORT)
