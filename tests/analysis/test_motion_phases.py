import itertools

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Event, Series
from myomorph.lab.analysis.motion_phases import MAX_STAGES, Cuttable, cut, measure, together
from myomorph.lab.analysis.phases import Phase

TIME = np.arange(1001) / 100.0
SPAN = (0.0, 10.0)


def test_variance_and_range_over_phases() -> None:
    """A wave of its own amplitude in each phase: mean, range and variance a^2 / 2 are its own."""
    rows = np.zeros((len(TIME), 3))
    first = TIME < 4.0
    rows[:, 0] = np.where(first, 0.9, 0.86) + np.where(first, 0.01, 0.05) * np.sin(2 * np.pi * TIME)
    cutting = cut(Cuttable(SPAN, TIME), (), (Phase("low", 4.0, 10.0), Phase("rest", 0.0, 4.0)))
    assert cutting.by == "given"
    assert [one.name for one in cutting.stages] == ["rest", "low"]
    rest, low = cutting.stages
    rest = measure(rest, Series(TIME, ("y", "x", "z"), rows), None, TIME, None)
    low = measure(low, Series(TIME, ("y", "x", "z"), rows), None, TIME, None)
    assert (rest.mean[0], low.mean[0]) == pytest.approx((0.9, 0.86), abs=1e-6)
    assert (rest.range[0], low.range[0]) == pytest.approx((0.02, 0.1), rel=0.01)
    assert (rest.variance[0], low.variance[0]) == pytest.approx(
        (0.01**2 / 2, 0.05**2 / 2), rel=0.01
    )


def test_phases_of_one_stage_are_measured_one_by_one() -> None:
    """Steps of equal length that lead forward: the range is within a step, not the whole way."""
    touching = (TIME % 2.0 < 1.0)[:, None]
    cutting = cut(
        Cuttable(span=SPAN, time=TIME, events=(), contact_names=("right foot",), touching=touching),
        ("contacts",),
    )
    assert cutting.by == "contacts"
    assert [one.name for one in cutting.stages] == ["right foot", "no contact"]
    # Names alone tell no contacts, nor do contacts that never come.
    for none in (None, np.zeros_like(touching)):
        assert (
            cut(
                Cuttable(
                    span=SPAN, time=TIME, events=(), contact_names=("right foot",), touching=none
                ),
                ("contacts",),
            ).stages
            == ()
        )
    forward = Series(TIME, ("y", "x", "z"), np.stack([0 * TIME, 1.5 * TIME, 0 * TIME], axis=1))
    found = measure(cutting.stages[0], forward, None, TIME, touching)
    assert found.range[1] == pytest.approx(1.5, rel=0.03)
    assert found.variance[1] == pytest.approx(1.5**2 / 12, rel=0.05)
    assert found.contact[0] == 1.0


def test_phases_of_contacts_cover_the_recording_once() -> None:
    random = np.random.default_rng(0)
    touching = random.random((40, 2)).repeat(26, axis=0)[: len(TIME)] > 0.5
    cutting = cut(
        Cuttable(
            span=SPAN,
            time=TIME,
            events=(),
            contact_names=("right foot", "left foot"),
            touching=touching,
        ),
        ("contacts",),
    )
    phases = cutting.phases
    assert phases[0].start == 0.0
    assert phases[-1].stop == 10.0
    assert all(a.stop == b.start for a, b in itertools.pairwise(phases))
    assert {one.name for one in phases} == {"right foot", "left foot", "both feet", "no contact"}


def test_what_always_touches_is_not_named() -> None:
    touching = np.stack([TIME % 4.0 < 2.0, np.ones_like(TIME, dtype=bool)], axis=1)
    names = ("right foot", "left hand")
    assert [
        one.name
        for one in cut(
            Cuttable(span=SPAN, time=TIME, events=(), contact_names=names, touching=touching),
            ("contacts",),
        ).stages
    ] == [
        "right foot",
        "nothing else",
    ]
    assert (
        cut(
            Cuttable(
                span=SPAN,
                time=TIME,
                events=(),
                contact_names=names,
                touching=np.ones_like(touching),
            ),
            ("contacts",),
        ).stages
        == ()
    )


def test_a_flicker_is_no_phase() -> None:
    touching = np.ones((len(TIME), 1), dtype=bool)
    touching[500] = False
    assert (
        cut(
            Cuttable(
                span=SPAN, time=TIME, events=(), contact_names=("right foot",), touching=touching
            ),
            ("contacts",),
        ).stages
        == ()
    )


def test_cuts_in_order_until_one_cuts() -> None:
    events = (Event(2.0, "Onset"), Event(5.0, "Foot Strike", "Right"))
    what = Cuttable(SPAN, TIME, events, period=3.0)
    between = cut(what, ("contacts", "events", "parts"))
    assert between.by == "events"
    assert [one.name for one in between.stages] == [
        "to onset",
        "onset – R strike",
        "from R strike",
    ]
    cycles = cut(what, ("cycles",))
    assert [one.name for one in cycles.stages] == ["Cycle 1", "Cycle 2", "Cycle 3", "Remainder"]
    assert [one.duration for one in cycles.stages] == pytest.approx([3.0, 3.0, 3.0, 1.0])
    many = Cuttable(SPAN, TIME, tuple(Event(0.1 * i, "tap") for i in range(1, 3 * MAX_STAGES)))
    assert cut(many, ("events", "cycles", "parts")).by == "parts"
    assert cut(many, ("events",)).stages == ()


def test_muscles_and_borders() -> None:
    values = np.where(TIME[:, None] < 5.0, [0.2, 0.1], [0.4, 0.8])
    first, last = cut(Cuttable(SPAN, TIME), ("parts",)).stages[1:3]
    activations = Series(TIME, ("a", "b"), values)
    a = measure(first, None, activations, TIME, None)
    b = measure(last, None, activations, TIME, None)
    assert (a.activity, a.peak, a.strongest) == (pytest.approx(0.15), 0.2, 0)
    assert (b.activity, b.peak, b.strongest) == (pytest.approx(0.6), 0.8, 1)
    assert not (first.inside(TIME) & last.inside(TIME)).any()
    empty = measure(
        cut(Cuttable((20.0, 21.0), TIME), ("parts",)).stages[0], None, activations, TIME, None
    )
    assert np.isnan(empty.activity)
    assert np.isnan(empty.mean).all()


def test_words() -> None:
    assert together(["right foot", "left foot"]) == "both feet"
    assert (
        together(["left foot", "right hand", "right foot", "left hand"]) == "both feet + both hands"
    )
    assert together(["right hand", "left foot"]) == "right hand + left foot"
    assert together([], "flight") == "flight"
    with pytest.raises(BadData, match="later end"):
        Phase("none", 1.0, 1.0)
