"""`python -m tests.page`: take off the lists what is done, and print what no list excuses.

The lists never get longer. After a merge they may be in conflict: run this.
"""

from __future__ import annotations

import sys

from tests.page.exceptions import by_file, listed, still, write
from tests.page.linter import ruff_findings
from tests.page.rules import findings
from tests.page.sources import sources


def main() -> int:
    """Return the exit status: 1 where a file does not follow a rule and is not listed for it."""
    files = {source.path: source for source in sources()}
    found = [finding for source in files.values() for finding in findings(source)]
    found += ruff_findings(files)
    exceptions = still(listed(), by_file(found))
    write(exceptions)
    unlisted = [
        finding for finding in found if finding.rule not in exceptions.get(finding.path, ())
    ]
    for finding in unlisted:
        print(finding)
    return int(bool(unlisted))


if __name__ == "__main__":
    sys.exit(main())
