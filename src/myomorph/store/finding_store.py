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
    writer.fact(name, findings_text(findings))


def get_findings(stored: Stored, name: str) -> tuple[Finding, ...]:
    """What `put_findings` wrote; none where an older version wrote the file."""
    return findings_of(stored.facts.get(name, "[]"))


def findings_text(findings: Sequence[Finding]) -> str:
    """Findings as JSON."""
    return json.dumps([asdict(finding) for finding in findings])


def findings_of(text: str) -> tuple[Finding, ...]:
    """What `findings_text` wrote."""
    records = json.loads(text)
    return tuple(Finding(**{**record, "times": tuple((a, b) for a, b in record["times"])}) for record in records)
