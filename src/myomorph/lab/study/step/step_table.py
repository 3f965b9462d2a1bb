"""Steps by scope, one line each, and those of extensions.

This table imports none of them, so that the command line starts fast.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from myomorph.core.model.errors import BadData
from myomorph.core.model.extension import StepEntry
from myomorph.core.model.registry import extensions, providers, remark

Scope = Literal["subject", "trial", "pair", "specimen", "limb", "cohort", "study"]
"""What a step is done once for: a subject, one of its trials, trials of several subjects that are
solved as one, a specimen that swings, a relaxed limb that does, all of these of a study, a study of
subjects.
"""

OWN_STEPS: dict[Scope, dict[str, str]] = {
    "subject": {
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
    "specimen": {},
    "limb": {},
    "cohort": {},
    "pair": {
        "id": "myomorph.lab.study.trial.steps.id",
        "tension": "myomorph.lab.study.trial.steps.tension",
    },
}
"""By scope, in the order in which they run: a step's name, and the module whose `STEP` it is,
imported when first needed. Those of a pair are steps of a trial, whose recording is joined of
several. Wings add theirs to scopes that have none here.
"""

LAST_BEFORE_IK = "transfer"
"""The last step of a subject that makes the model whose coordinates the others use."""
REPORT = "report"
"""The last step of a trial; it reads what the others stored, and its page is no result."""


def _with_extensions(own: Mapping[Scope, Mapping[str, str]]) -> dict[Scope, dict[str, str]]:
    """Return the package's own steps and those of extensions, each where it says that it runs."""
    steps: dict[Scope, dict[str, str]] = {scope: dict(steps) for scope, steps in own.items()}
    for provider in providers():
        for entry in provider.extension.steps:
            try:
                scope = _checked_scope(entry, steps)
            except BadData as error:
                remark(f"{provider.name}: its step '{entry.name}' is left out: {error}")
            else:
                steps[scope] = _inserted(entry, steps[scope])
    return steps


def _checked_scope(entry: StepEntry, steps: Mapping[Scope, Mapping[str, str]]) -> Scope:
    """Return the scope of a step of an extension; raise `BadData` where there is no room for it."""
    scope = next((scope for scope in steps if scope == entry.scope), None)
    if scope is None:
        raise BadData(f"unknown scope '{entry.scope}': there are {', '.join(steps)}")
    if entry.name == REPORT or any(entry.name in names for names in steps.values()):
        raise BadData("there is a step of this name already")
    if entry.before and entry.before not in steps[scope]:
        raise BadData(f"there is no step '{entry.before}' that it could run before")
    return scope


def _inserted(entry: StepEntry, steps: Mapping[str, str]) -> dict[str, str]:
    names = list(steps)
    position = names.index(entry.before) if entry.before else len(names)
    names.insert(position, entry.name)
    return {name: steps.get(name, entry.place) for name in names}


STEPS = _with_extensions(OWN_STEPS)
"""By scope, in the order in which they run: a step's name, and the place of its `Step`."""

ON_REQUEST = (
    "uncertainty",
    *(entry.name for extension in extensions() for entry in extension.steps),
)
"""Steps that run only where somebody names them: nobody's results depend on what is installed."""


def usual_steps() -> tuple[str, ...]:
    """List steps of a trial that run where none are specified, the report as the last."""
    return (*(step for step in STEPS["trial"] if step not in ON_REQUEST), REPORT)
