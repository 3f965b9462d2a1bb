"""Groups of subjects in a study file: by name and pattern, or by a column of the table of measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase

from myomorph.model.errors import listing
from myomorph.store.study_file import is_pattern
from myomorph.study.plan.measures import Measures


def group_members(
    groups: Mapping[str, Sequence[str]], subjects: Sequence[str], left_out: Sequence[str], problems: list[str]
) -> dict[str, list[str]]:
    """Subjects by group, patterns as the subjects they match, without those that the study leaves out."""
    found: dict[str, list[str]] = {}
    for name, members in groups.items():
        own: list[str] = []
        for member in members:
            if not is_pattern(member):
                own += [member] if member in subjects or member not in left_out else []
                continue
            fit = [one for one in (*subjects, *left_out) if fnmatchcase(one, member)]
            if not fit:
                problems.append(
                    f"groups: '{name}': no subject matches '{member}': there are {listing(member, subjects)}"
                )
            own += [one for one in fit if one in subjects and one not in own]
        found[name] = own
    return found


def measured_groups(
    measures: Mapping[str, Measures],
    subjects: Sequence[str],
    compare: Sequence[str],
    problems: list[str],
    remarks: list[str],
) -> dict[str, list[str]]:
    """The two groups of the column `group` that are to be compared; none where nobody asks for it.

    Parameters
    ----------
    compare : which two; () for none, since a comparison needs strides, which not every study has
    """
    found: dict[str, list[str]] = {}
    for subject in subjects:
        group = measures[subject].group if subject in measures else ""
        if group:
            found.setdefault(group, []).append(subject)
    if not compare:
        if len(found) > 1:
            told = ", ".join(f'"{one}"' for one in list(found)[:2])
            remarks.append(f"groups {', '.join(found)} are not compared: 'compare = [{told}]' under [study] does it")
        return {}
    if len(compare) != 2 or compare[0] == compare[1]:
        problems.append(f"study: compare names {len(compare)} groups: expected two that differ")
    unknown = [one for one in compare if one not in found]
    problems += [f"study: compare: no group '{one}': there are {listing(one, tuple(found))}" for one in unknown]
    return {} if unknown or len(set(compare)) != 2 else {one: found[one] for one in compare}
