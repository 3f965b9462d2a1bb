"""Files that do not follow a rule yet: one list a wing, which only gets shorter.

A line is a path and the rules: `src/myomorph/core/motion/ik.py: D205 dense`.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path

from tests.page.rules import Finding
from tests.page.sources import wing_of

FOLDER = Path(__file__).with_name("exceptions")
LINE = re.compile(r"^(?P<path>\S+\.py): (?P<rules>.+)$", re.MULTILINE)

Exceptions = dict[str, set[str]]
"""Rules by path."""


def listed(folder: Path = FOLDER) -> Exceptions:
    """Read the lists of all wings as one; of a list in conflict, what stands on either side."""
    rules: defaultdict[str, set[str]] = defaultdict(set)
    for path in sorted(folder.glob("*.txt")):
        for line in LINE.finditer(path.read_text(encoding="utf-8")):
            rules[line["path"]] |= set(line["rules"].split())
    return dict(rules)


def by_file(findings: Iterable[Finding]) -> Exceptions:
    """Collect the rules that each file does not follow."""
    rules: defaultdict[str, set[str]] = defaultdict(set)
    for finding in findings:
        rules[finding.path].add(finding.rule)
    return dict(rules)


def still(exceptions: Mapping[str, set[str]], found: Mapping[str, set[str]]) -> Exceptions:
    """Keep what is listed and still found."""
    both = {path: rules & found.get(path, set()) for path, rules in exceptions.items()}
    return {path: rules for path, rules in both.items() if rules}


def write(exceptions: Mapping[str, set[str]], folder: Path = FOLDER) -> None:
    """Write the lists; a wing that follows all rules has none."""
    lines: defaultdict[str, list[str]] = defaultdict(list)
    for path, rules in sorted(exceptions.items()):
        lines[wing_of(path)].append(f"{path}: {' '.join(sorted(rules))}\n")
    for old in folder.glob("*.txt"):
        if old.stem not in lines:
            old.unlink()
    folder.mkdir(exist_ok=True)
    for wing, entries in lines.items():
        (folder / f"{wing}.txt").write_text("".join(entries), encoding="utf-8")
