"""Two bodies or one: on simulated truth, and on recordings of people who are known."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.model.known import Known
from myomorph.lab.info.inspect import inspect
from myomorph.lab.session.body_measures import (
    LENGTH_OF_NAME,
    MASS,
    WEIGHED,
    BodyMeasures,
    Measured,
)
from myomorph.lab.session.body_odds import BUILD, PLACED, PLACED_WIDELY, STATURE, body_odds
from myomorph.lab.session.evidence import Evidence
from myomorph.lab.session.names import SubjectCode, first_word
from myomorph.lab.session.people import DECISIVE, people_of
from myomorph.lab.session.read import evidence_of, read_session, trial_of
from myomorph.lab.session.recordings import look_at

MEANS = {
    "shank": 0.4,
    "foot": 0.2,
    "leg": 0.88,
    "knee": 0.1,
    "ankle": 0.075,
    "upper arm": 0.32,
    "forearm": 0.25,
    "pelvis width": 0.25,
    "pelvis width behind": 0.1,
}
SEEN = {name for name in LENGTH_OF_NAME if ".knee to" not in name and "elbow to" not in name}
PAIRS = 120
SLIDES = 0.6  # Skin of recordings that are known slides by so much of the deviation, or less.


class MadeBody:
    """A body drawn from adults, which markers can be placed on again and again."""

    def __init__(self, rng: np.random.Generator):
        self.rng = rng
        size = np.exp(STATURE * rng.standard_normal())
        own = {
            length.bone: np.exp(length.variation * rng.standard_normal())
            for length in LENGTH_OF_NAME.values()
        }
        self.lengths = {
            name: MEANS[length.bone] * size * own[length.bone]
            for name, length in LENGTH_OF_NAME.items()
            if name in SEEN
        }
        self.mass = 70.0 * size**2 * np.exp(BUILD * rng.standard_normal())

    def placed(self) -> dict[str, float]:
        """Lengths between markers that are placed anew, by name [m]."""
        errors: dict[tuple[str, str, str], float] = {}
        lengths = {}
        for name, true in self.lengths.items():
            length = LENGTH_OF_NAME[name]
            error = 0.0
            for key, side in length.named_ends()[name]:
                sd = PLACED_WIDELY.get(key, PLACED)
                error += errors.setdefault((length.bone, key, side), sd * self.draw())
            lengths[name] = true + error
        return lengths

    def draw(self) -> float:
        """Draw from the normal distribution."""
        return float(self.rng.standard_normal())

    def recorded(self, placed: dict[str, float]) -> BodyMeasures:
        """Measures in one recording of a placement."""
        lengths = {}
        for name, length in placed.items():
            sd = LENGTH_OF_NAME[name].skin
            lengths[name] = Measured(mean=length + SLIDES * sd * self.draw(), sd=sd)
        mass = self.mass * (1.0 + WEIGHED * self.draw())
        return BodyMeasures(lengths=lengths, mass=Measured(mean=mass, sd=WEIGHED * mass))


def evidence(measures: BodyMeasures, name: str, **facts: object) -> Evidence:
    """Make a recording that says no more than its measures, and what is given."""
    nothing = Evidence(
        path=Path("folder") / f"{name}.trc",
        header=Known(),
        code=SubjectCode(),
        measures=measures,
        labels=frozenset("abcdef"),
    )
    return replace(nothing, **facts)  # type: ignore[arg-type]


def two_recordings(body: MadeBody, name: str) -> list[Evidence]:
    """Two recordings of one placement."""
    placed = body.placed()
    return [evidence(body.recorded(placed), f"{name}{number}") for number in range(2)]


def test_odds_hold_what_they_say() -> None:
    """Of one body that is marked twice, odds of 100 to 1 for two come once in 100 times at most."""
    rng = np.random.default_rng(1)
    odds = []
    for _ in range(PAIRS):
        body = MadeBody(rng)
        odds.append(body_odds(body.recorded(body.placed()), body.recorded(body.placed())))
    decisive = sum(one.evidence >= DECISIVE for one in odds)
    assert decisive <= 0.01 * PAIRS
    assert np.mean([one.one_placement() for one in odds]) < 0.05


def test_recordings_of_one_session_are_of_one_placement() -> None:
    rng = np.random.default_rng(2)
    same = []
    for _ in range(PAIRS):
        body = MadeBody(rng)
        placed = body.placed()
        same.append(body_odds(body.recorded(placed), body.recorded(placed)).one_placement())
    assert np.mean(same) > 0.97


def test_two_adults_are_told_apart_or_said_not_to_be() -> None:
    """Few pairs are taken as one without a word, and few groups are mixed."""
    rng = np.random.default_rng(3)
    results = []
    for _ in range(PAIRS):
        first = two_recordings(MadeBody(rng), "a")
        groups = people_of([*first, *two_recordings(MadeBody(rng), "b")])
        members = [set(group.members) for group in groups]
        told = any("assumed to be one" in text for group in groups for text in group.unresolved)
        if members == [{0, 1}, {2, 3}]:
            results.append("right")
        elif members == [{0, 1, 2, 3}] and told:
            results.append("said")
        else:
            results.append("wrong")
    assert results.count("right") > 0.5 * PAIRS
    assert results.count("wrong") <= 0.02 * PAIRS


def test_one_adult_who_is_marked_twice_is_not_split() -> None:
    rng = np.random.default_rng(4)
    split = 0
    for _ in range(PAIRS):
        body = MadeBody(rng)
        split += len(people_of([*two_recordings(body, "a"), *two_recordings(body, "b")])) > 1
    assert split <= 0.01 * PAIRS


def test_two_of_one_build_are_taken_as_one_and_it_is_said() -> None:
    rng = np.random.default_rng(5)
    first = MadeBody(rng)
    second = MadeBody(rng)
    second.lengths = first.lengths
    second.mass = first.mass
    (group,) = people_of([*two_recordings(first, "a"), *two_recordings(second, "b")])
    assert len(group.unresolved) == 1
    assert "cannot be distinguished, assumed to be one" in group.unresolved[0]


def test_a_name_ties_two_placements() -> None:
    rng = np.random.default_rng(6)
    body = MadeBody(rng)
    header = Known(value="Anna", origin="file header")
    both = [
        replace(one, header=header)
        for one in (*two_recordings(body, "a"), *two_recordings(body, "b"))
    ]
    (group,) = people_of(both)
    assert group.unresolved == ()


def test_a_wrong_marker_does_not_make_two_people() -> None:
    """The bone that says most is left out."""
    rng = np.random.default_rng(7)
    body = MadeBody(rng)
    placed = body.placed()
    measures = body.recorded(placed)
    moved = {
        name: replace(one, mean=one.mean + (0.12 if "foot" in name else 0.0))
        for name, one in body.recorded(placed).lengths.items()
    }
    groups = people_of([evidence(measures, "a"), evidence(replace(measures, lengths=moved), "b")])
    assert len(groups) == 1


def nearly_decisive() -> tuple[BodyMeasures, BodyMeasures]:
    """Two bodies whose lengths speak for two people, but for a little."""
    one = MadeBody(np.random.default_rng(8)).placed()
    other = MadeBody(np.random.default_rng(14)).placed()
    for share in np.linspace(0.0, 1.0, 60):
        between = {name: one[name] + share * (other[name] - one[name]) for name in one}
        first, second = map(measured, (one, between))
        odds = body_odds(first, second)
        if DECISIVE - 0.4 < odds.evidence < DECISIVE:
            assert odds.robust > 0.6
            return first, second
    raise AssertionError("none")


def measured(lengths: dict[str, float]) -> BodyMeasures:
    """Measures of lengths in which nothing slides."""
    return BodyMeasures(
        lengths={
            name: Measured(mean=length, sd=LENGTH_OF_NAME[name].skin)
            for name, length in lengths.items()
        }
    )


@pytest.mark.parametrize(
    ("facts", "people"),
    [
        (({"day": date(2026, 3, 5)}, {"day": date(2026, 3, 5)}), 2),
        (({"day": date(2026, 3, 5)}, {"day": date(2026, 5, 6)}), 1),
        (({"word": "anna"}, {"word": "ben"}), 2),
    ],
)
def test_days_and_words_weigh_where_bodies_are_nearly_decisive(facts, people: int) -> None:
    one, other = nearly_decisive()
    groups = people_of([evidence(one, "a", **facts[0]), evidence(other, "b", **facts[1])])
    assert len(groups) == people


@pytest.mark.parametrize(
    ("name", "word"),
    [("anna_walk1", "anna"), ("walk1", ""), ("pre_walk", ""), ("static_01", ""), ("0123", "")],
)
def test_first_words_of_names(name: str, word: str) -> None:
    assert first_word(Path(f"{name}.c3d")) == word


def test_the_weight_counts_among_the_measures() -> None:
    rng = np.random.default_rng(9)
    body = MadeBody(rng)
    placed = body.placed()
    light = body.recorded(placed)
    assert light.mass is not None
    heavy = replace(light, mass=Measured(mean=2.0 * light.mass.mean, sd=light.mass.sd))
    odds = body_odds(light, heavy)
    assert odds.farthest.startswith("weight")
    assert odds.evidence > DECISIVE > odds.robust
    assert MASS not in light.lengths


def evidence_in(folder: Path, *files: str) -> list[Evidence]:
    """Read what recordings of a folder say, without their names."""
    found = []
    for file in files:
        recording = look_at(folder / file)
        own = evidence_of(recording, trial_of(recording))
        found.append(
            replace(own, header=Known(), code=SubjectCode(), word="", day=None, path=Path("x/y"))
        )
    return found


def test_two_adults_of_like_build_in_one_folder_are_reported(data) -> None:
    """The static trial of the full body is another man's than that of the functional trials."""
    folder = data("c3d-functional-joints")
    session = read_session(folder)
    (person,) = session.people
    assert "assumed to be one" in person.unresolved[0]
    assert "static_lower_body" in person.unresolved[0]
    text = "\n".join(inspect(folder).lines())
    assert "cannot be distinguished, assumed to be one" in text


def test_adults_of_two_builds_are_told_apart_without_names(data) -> None:
    groups = people_of(
        [
            *evidence_in(data("lifting-box-15kg"), "neutral.c3d", "stoop1.c3d"),
            *evidence_in(
                data("c3d-vendor-samples") / "C3DSamples" / "PiG",
                "PiG_Calibration-FlatFoot-Full.c3d",
                "PiG_Motion-FlatFoot-Full.c3d",
            ),
        ]
    )
    assert [group.members for group in groups] == [(0, 1), (2, 3)]
    assert not any(group.unresolved for group in groups)


@pytest.mark.parametrize(
    ("folder", "files"),
    [
        ("knee-implant-walk", ("static.trc", "walk1.c3d", "walk1.trc", "walk3.c3d", "walk3.trc")),
        ("c3d-opensim-walking", ("walking2.c3d", "std_walking2_markers.trc", "walking5.c3d")),
        ("rajagopal-walk-emg", ("markers_walk.trc", "raw/static_walk_1.trc")),
    ],
)
def test_one_person_with_another_marker_set_raises_no_alarm(folder: str, files, data) -> None:
    (group,) = people_of(evidence_in(data(folder), *files))
    assert group.unresolved == ()
