"""Two groups of subjects in a study file: who is in them, and how their strides are found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pydantic import Field, FiniteFloat

from myomorph.model.errors import listing
from myomorph.store.study_file import Strict
from myomorph.study.trial.trial_strides import StridePlan


class StridesTable(Strict):
    """The table `[strides]`: how strides are found."""

    trunk: str = ""
    limbs: dict[str, str | list[str]] = Field(default_factory=dict)
    direction: tuple[FiniteFloat, FiniteFloat, FiniteFloat] | None = None
    belt: FiniteFloat | None = None


@dataclass(frozen=True, eq=False)
class GroupPlan:
    """Which subjects are compared.

    Attributes
    ----------
    first, second : name of the group, names of its subjects
    trials : of every subject, by name
    """

    first: tuple[str, tuple[str, ...]]
    second: tuple[str, tuple[str, ...]]
    trials: Mapping[str, tuple[str, ...]]
    strides: StridePlan = field(default_factory=StridePlan)


def groups_of(
    groups: Mapping[str, Sequence[str]],
    strides: StridesTable,
    trials: Mapping[str, Sequence[str]],
    problems: list[str],
) -> GroupPlan | None:
    """The tables `[groups]` and `[strides]` as a plan; what is wrong is added to the problems.

    Parameters
    ----------
    groups : subjects by group
    trials : names of trials by subject, of all subjects of the study
    """
    if not groups:
        return None
    if len(groups) != 2:
        problems.append(f"groups: expected two groups of subjects, but there are {len(groups)}: {', '.join(groups)}")
        return None
    for name, subjects in groups.items():
        if not subjects:
            problems.append(f"groups: '{name}' has no subjects")
        for subject in subjects:
            if subject not in trials:
                problems.append(
                    f"groups: '{name}' names subject '{subject}': there are {listing(subject, tuple(trials))}"
                )
        if len(set(subjects)) != len(subjects):
            problems.append(f"groups: '{name}' names a subject twice")
    (one, first), (other, second) = groups.items()
    for subject in sorted(set(first) & set(second)):
        problems.append(f"groups: subject '{subject}' is in both groups")
    limbs = {name: (told,) if isinstance(told, str) else tuple(told) for name, told in strides.limbs.items()}
    for name, bodies in limbs.items():
        if not 1 <= len(bodies) <= 2:
            problems.append(
                f"strides: limb '{name}' names {len(bodies)} bodies: expected one, or one for strikes and one for lifts"
            )
    if strides.direction is not None and not any(strides.direction):
        problems.append("strides: direction = [0, 0, 0]: expected a vector with a length")
    return GroupPlan(
        (one, tuple(first)),
        (other, tuple(second)),
        {subject: tuple(own) for subject, own in trials.items()},
        StridePlan(strides.trunk, limbs, strides.direction, strides.belt),
    )
