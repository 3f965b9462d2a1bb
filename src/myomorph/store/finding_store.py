"""Findings of checks in result files, and back."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict

from myomorph.model.findings import Finding
from myomorph.store.results import ResultWriter, Stored


def put_findings(writer: ResultWriter, name: str, findings: Sequence[Finding]) -> None:
    """Findings as a text about the whole file.

    Parameters
    ----------
    name : of the attribute
    """
    writer.fact(name, json.dumps([asdict(one) for one in findings]))


def get_findings(stored: Stored, name: str) -> tuple[Finding, ...]:
    """What `put_findings` wrote; none where an older version wrote the file."""
    found = json.loads(stored.facts.get(name, "[]"))
    return tuple(Finding(**{**one, "times": tuple((a, b) for a, b in one["times"])}) for one in found)
