"""Groups of subjects in a study file, by name, pattern or measured column.

The file also says how their strides are found.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

from pydantic import Field, FiniteFloat

from myomorph.core.model.errors import listing
from myomorph.core.model.frozen_map import grouped
from myomorph.lab.store.named_files import is_pattern
from myomorph.lab.store.study_file import Strict
from myomorph.lab.study.plan.measures import Measures
from myomorph.lab.study.trial.trial_strides import StridePlan


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
    strides : how strides are found
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
    """Read the tables `[groups]` and `[strides]` as a plan; what is wrong is added to the problems.

    `groups`: subjects by group; `trials`: names of trials by subject, of all subjects of the study.
    """
    if not groups:
        return None
    if len(groups) != 2:
        problems.append(
            f"groups: expected two groups of subjects, but there are {len(groups)}:"
            f" {', '.join(groups)}"
        )
        return None
    problems += _wrong_members(groups, tuple(trials))
    (first_name, first), (second_name, second) = groups.items()
    for subject in sorted(set(first) & set(second)):
        problems.append(f"groups: subject '{subject}' is in both groups")
    return GroupPlan(
        first=(first_name, tuple(first)),
        second=(second_name, tuple(second)),
        trials={subject: tuple(trial) for subject, trial in trials.items()},
        strides=_stride_plan(strides, problems),
    )


def _wrong_members(groups: Mapping[str, Sequence[str]], existing: tuple[str, ...]) -> Iterator[str]:
    """Yield a line on each group without subjects, unknown subject and subject that is repeated."""
    for name, subjects in groups.items():
        if not subjects:
            yield f"groups: '{name}' has no subjects"
        for subject in subjects:
            if subject not in existing:
                yield (
                    f"groups: '{name}' names subject '{subject}': there are"
                    f" {listing(subject, existing)}"
                )
        if len(set(subjects)) != len(subjects):
            yield f"groups: '{name}' names a subject twice"


def _stride_plan(strides: StridesTable, problems: list[str]) -> StridePlan:
    """Read how strides are found; what is wrong is added to the problems."""
    limbs = {
        name: (bodies,) if isinstance(bodies, str) else tuple(bodies)
        for name, bodies in strides.limbs.items()
    }
    for name, bodies in limbs.items():
        if not 1 <= len(bodies) <= 2:
            problems.append(
                f"strides: limb '{name}' names {len(bodies)} bodies: expected one, or one for"
                " strikes and one for lifts"
            )
    if strides.direction is not None and not any(strides.direction):
        problems.append("strides: direction = [0, 0, 0]: expected a vector with a length")
    return StridePlan(
        trunk=strides.trunk, limbs=limbs, direction=strides.direction, belt=strides.belt
    )


def group_members(
    groups: Mapping[str, Sequence[str]],
    subjects: Sequence[str],
    left_out: Sequence[str],
    problems: list[str],
) -> dict[str, list[str]]:
    """Return subjects by group, without those that the study leaves out.

    Patterns stand for the subjects that they match.
    """
    result: dict[str, list[str]] = {}
    for name, members in groups.items():
        own: list[str] = []
        for member in members:
            if not is_pattern(member):
                own += [member] if member in subjects or member not in left_out else []
                continue
            fit = [one for one in (*subjects, *left_out) if fnmatchcase(one, member)]
            if not fit:
                problems.append(
                    f"groups: '{name}': no subject matches '{member}': there are"
                    f" {listing(member, subjects)}"
                )
            own += [one for one in fit if one in subjects and one not in own]
        result[name] = own
    return result


def measured_groups(
    measures: Mapping[str, Measures],
    subjects: Sequence[str],
    compare: Sequence[str],
    problems: list[str],
    remarks: list[str],
) -> dict[str, list[str]]:
    """Return the two groups of the column `group` that are to be compared.

    There are none where none are requested. `compare`: which two; () for none, since a comparison
    needs strides, which not every study has.
    """
    of_group = [(measures[subject].group, subject) for subject in subjects if subject in measures]
    found = grouped((group, subject) for group, subject in of_group if group)
    if not compare and len(found) > 1:
        quoted = ", ".join(f'"{name}"' for name in list(found)[:2])
        remarks.append(
            f"groups {', '.join(found)} are not compared: 'compare = [{quoted}]' under [study]"
            " does it"
        )
    return _chosen_groups(found, compare, problems) if compare else {}


def _chosen_groups(
    groups: dict[str, list[str]], compare: Sequence[str], problems: list[str]
) -> dict[str, list[str]]:
    """Return two groups by name; none where these are not two groups that exist."""
    if len(compare) != 2 or compare[0] == compare[1]:
        problems.append(f"study: compare names {len(compare)} groups: expected two that differ")
    unknown = [name for name in compare if name not in groups]
    problems += [
        f"study: compare: no group '{name}': there are {listing(name, tuple(groups))}"
        for name in unknown
    ]
    if unknown or len(set(compare)) != 2:
        return {}
    return {name: groups[name] for name in compare}
