"""Numbers in the prose of results, which pages must not hold.

Measured numbers stand in tables that commands write. `python -m docs_build.prose PAGE ...` prints
the numbers of pages that are not allowed there. What is allowed:

- a number of a table by its name, `{{ table | row | column }}` (`docs_build/tables.py`), and what
    stands in code;
- paragraphs and list items that begin with a label in bold: what was set (**Setup:**), what was
    wanted (**Target:**), what others have published (**Published:**); also from such a label
    within a paragraph to that paragraph's end;
- numbers that are names: versions, years, decisions, equations, figures, tables and sections of
    sources.

Shares in words count as numbers: "half of the frames", "twice as fast", "a third less".
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

LABEL = re.compile(r"\*\*(?:Setup|Target|Published):\*\*.*", re.DOTALL)
LEFT_OUT = re.compile(
    r"```.*?```|`[^`]*`|\{\{.*?\}\}|<!--.*?-->|\$\$.*?\$\$|\$[^$]{1,200}?\$|(?<=\])\([^)]*\)|https?://\S+",
    re.DOTALL,
)
POINTER = re.compile(r"\]\([^)]*(?:validation/|performance\.md)")
NAMES = re.compile(
    r"(?:OpenSim|MuJoCo|Pinocchio|Python|SciPy|Document version) \d+(?:\.\d+)*"
    r"|(?:[Dd]ecision|eqs?\.|[Ff]igure|[Tt]able|[Ss]ection|[Cc]hapter|[Ss]tep) [\d.]+(?:(?: to |"
    r" and |, |-)[\d.]+)*"
    r"|\b(?:19|20)\d\d[a-z]?\b"
)
NUMBERS = re.compile(
    r"(?<![\w.^_-])[-+]?\d[\d,.]*(?:[eE]-?\d+)?(?![A-Za-z_])"
    r"|\b(?:an?|one|two|three|four|by|some)"
    r" (?:third|quarter|fifth|sixth|seventh|eighth|ninth|tenth|hundredth)s?\b"
    r"|\bhalf (?:of|the|a|as)\b|\btwice (?:as|the)\b|\b\w+ times"
    r" (?:as|the|ours|theirs|more|less|faster)\b|\b\w+fold\b"
)


def numbers_of(markdown: str) -> list[str]:
    """Numbers of a page's prose that are not allowed, each with the words before it."""
    found = []
    for paragraph in re.split(r"\n\s*\n|\n(?=[-*|] |#)", LEFT_OUT.sub("`code`", markdown)):
        text = NAMES.sub("NAME", LABEL.sub("", " ".join(paragraph.split())))
        found += [
            text[max(0, number.start() - 40) : number.end() + 10]
            for number in NUMBERS.finditer(text)
        ]
    return found


def numbers_beside_results(markdown: str) -> list[str]:
    """List sentences of any page that hold a number and point to the pages of results.

    The tables of those pages have the number.
    """
    found = []
    for paragraph in re.split(
        r"\n\s*\n|\n(?=[-*|] |#)", re.sub(r"```.*?```", "", markdown, flags=re.DOTALL)
    ):
        for sentence in re.split(r"(?<=[.:;]) (?=[A-Z`*(])", " ".join(paragraph.split())):
            if POINTER.search(sentence) and numbers_of(sentence):
                found.append(sentence)
    return found


if __name__ == "__main__":
    for name in sys.argv[1:]:
        for words in numbers_of(Path(name).read_text(encoding="utf-8")):
            sys.stdout.write(f"{name}: {words}\n")
