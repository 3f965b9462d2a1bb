"""What makes a step come out otherwise is named."""

from __future__ import annotations

from dataclasses import replace

from myomorph.core.model.provenance import Provenance, Source
from myomorph.lab.study.step.job_steps import changes

BEFORE = Provenance(
    step="id",
    sources=(
        Source("model", "/a/generic.osim", "1"),
        Source("markers", "/a/walk.trc", "2"),
        Source("loads", "/a/grf.mot", "3"),
    ),
    options={"ik.tolerance": 1e-5, "id.cutoff": 6.0, "time": [0.5, 1.0]},
    version="1.0.0",
    date="2026-01-01",
)


def source(role, name, sha):
    others = tuple(one for one in BEFORE.sources if one.role != role)
    return replace(BEFORE, sources=(*others, Source(role, name, sha)))


def test_nothing():
    assert changes(BEFORE, replace(BEFORE, date="2027-01-01")) == ()
    assert changes(BEFORE, source("model", "/elsewhere/other.osim", "1")) == ()
    assert changes(BEFORE, replace(BEFORE, options=BEFORE.options | {"time": (0.5, 1.0)})) == ()


def test_files():
    assert changes(BEFORE, source("model", "/a/generic.osim", "9")) == (
        "model generic.osim has changed",
    )
    assert changes(BEFORE, source("model", "C:\\b\\scaled.osim", "9")) == (
        "model generic.osim -> scaled.osim",
    )
    assert changes(BEFORE, source("emg", "/a/walk_emg.sto", "4")) == ("emg walk_emg.sto is new",)
    fewer = replace(BEFORE, sources=BEFORE.sources[:2])
    assert changes(BEFORE, fewer) == ("loads grf.mot is no longer used",)


def test_options_and_version():
    told = replace(
        BEFORE, options=BEFORE.options | {"ik.tolerance": 1e-4, "id.net": True}, version="1.1.0"
    )
    assert changes(BEFORE, told) == (
        "version 1.0.0 -> 1.1.0",
        "id.net None -> True",
        "ik.tolerance 1e-05 -> 0.0001",
    )


def test_numbers_that_differ_little_are_told_apart():
    told = replace(BEFORE, options=BEFORE.options | {"id.cutoff": 6.0 + 1e-9})
    (line,) = changes(BEFORE, told)
    before, after = line.removeprefix("id.cutoff ").split(" -> ")
    assert float(before) != float(after)


def test_what_came_back_from_json_is_the_same():
    assert changes(Provenance.from_json(BEFORE.to_json()), BEFORE) == ()
