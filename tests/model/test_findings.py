"""Findings: what repairs change, what is reported, and what files keep."""

from __future__ import annotations

from myomorph.core.model.causes import MARKERS, PLATES
from myomorph.core.model.findings import Finding, Repair, repaired
from myomorph.core.model.messages import OTHER
from myomorph.lab.store.results import findings_of, findings_text

FINDINGS = (
    Finding(
        kind="unit",
        place="a",
        text=MARKERS.message("a is small", size=3.0),
        times=((0.0, 1.0),),
        repair=Repair(lambda value: value + 1, "one was added", "add one"),
    ),
    Finding("name", "b", MARKERS.message("b has no name")),
    Finding(
        "sign",
        "c",
        PLATES.message("c is negative"),
        repair=Repair(lambda value: -value, "it was reversed"),
    ),
)


def test_repairs_are_applied_one_after_the_other_and_said():
    value, reported = repaired(3, FINDINGS)
    assert value == -4
    assert [str(finding) for finding in reported] == [
        "a is small: one was added",
        "b has no name",
        "c is negative: it was reversed",
    ]
    assert [finding.repaired for finding in reported] == [True, False, True]


def test_without_repairs_nothing_changes_and_texts_say_what_helps():
    value, reported = repaired(3, FINDINGS, apply=False)
    assert value == 3
    assert [str(finding) for finding in reported] == [
        "a is small: add one",
        "b has no name",
        "c is negative",
    ]
    assert not any(finding.repaired for finding in reported)


def test_what_is_reported_is_kept_in_files_and_repaired_no_more():
    _, reported = repaired(3, FINDINGS)
    assert findings_of(findings_text(reported)) == reported
    assert repaired(3, reported) == (3, reported)


def test_what_was_put_right_is_good_to_know():
    _, reported = repaired(3, FINDINGS)
    assert [finding.message.severity for finding in reported] == [
        "good to know",
        MARKERS.severity,
        "good to know",
    ]
    _, left = repaired(3, FINDINGS, apply=False)
    assert {finding.message.severity for finding in left} == {MARKERS.severity}


def test_causes_are_kept_in_files_and_older_files_have_none():
    read = findings_of(findings_text(FINDINGS[:1]))[0].message
    assert read.cause == MARKERS
    assert read.size == 3.0
    assert read.times == ((0.0, 1.0),)
    old = '[{"kind": "unit", "place": "a", "text": "a is small", "times": [], "mended": false}]'
    assert findings_of(old)[0].message.cause == OTHER
