"""Which steps there are, by scope: one line each. This table imports nothing, so that the command
line starts fast.
"""

from __future__ import annotations

from typing import Literal

Scope = Literal["subject", "trial", "pair", "specimen", "limb", "cohort", "study"]
"""What a step is done once for: a subject, one of its trials, trials of several subjects that are
solved as one, a specimen that swings, a relaxed limb that does, all of these of a study, a study of
subjects.
"""

STEPS: dict[Scope, dict[str, str]] = {
    "subject": {
        "morph": "myomorph.bones.study.morphing",
        "calibrate": "myomorph.lab.study.subject.calibrating",
        "transfer": "myomorph.lab.study.subject.transferring",
        "refine": "myomorph.lab.study.subject.refining",
        "identify": "myomorph.lab.study.subject.identifying",
        "personalize": "myomorph.lab.study.subject.personalizing",
        "emg": "myomorph.lab.study.subject.emg_gains_step",
    },
    "trial": {
        "ik": "myomorph.lab.study.trial.steps.ik",
        "id": "myomorph.lab.study.trial.steps.id",
        "muscles": "myomorph.lab.study.trial.steps.muscles",
        "tension": "myomorph.lab.study.trial.steps.tension",
        "uncertainty": "myomorph.lab.study.trial.steps.uncertainty",
    },
    "study": {
        "groups": "myomorph.lab.study.summary.grouping",
        "tables": "myomorph.lab.study.summary.study_tables",
    },
    "specimen": {"viscosity": "myomorph.swings.viscosity.study.specimen_step"},
    "limb": {"relaxed": "myomorph.swings.viscosity.study.limb_step"},
    "cohort": {"cohort": "myomorph.swings.viscosity.study.cohort_step"},
    "pair": {
        "id": "myomorph.lab.study.trial.steps.id",
        "tension": "myomorph.lab.study.trial.steps.tension",
    },
}
"""By scope, in the order in which they run: a step's name, and the module whose `STEP` it is,
imported when first needed. Those of a pair are steps of a trial, whose recording is joined of
several.
"""

ON_REQUEST = ("uncertainty",)  # Steps that run only where somebody names them.

# The last step of a trial; it reads what the others stored, and its page is no result.
REPORT = "report"


def usual_steps() -> tuple[str, ...]:
    """Steps of a trial that run where nobody says which, the report as the last."""
    return (*(step for step in STEPS["trial"] if step not in ON_REQUEST), REPORT)
