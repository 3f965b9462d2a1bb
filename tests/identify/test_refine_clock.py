"""Refinement with the clock of the forces as an unknown, and with an unknown that a page adds.

The truths move by an engine that shares nothing with the estimator.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from myomorph.body.refine import kinds
from myomorph.body.refine.fit import refine
from myomorph.body.refine.options import RefineOptions
from myomorph.body.refine.refinement import Refinement
from myomorph.body.refine.subject_trial import SubjectTrial
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.model.errors import UnknownName
from myomorph.core.model.inertia import pseudo_inertias
from myomorph.core.model.model import Marker
from truths.simulated_bodies import TETRAHEDRON
from truths.simulated_engines import TreeEngine
from truths.simulated_subject import (
    Instruments,
    Movement,
    SubjectOptions,
    exciting_curves,
    middles_and_reaches,
    random_subject,
    record,
)
from truths.small_person import person

PAGE = Path(__file__).resolve().parents[2] / "docs" / "adding.md"
OPTIONS = RefineOptions(cutoff=5.0, check=False, soft_tissue="never")
LATE = 0.012
"""How late the clock of the forces is [s]: so much is to be added to their times."""


class Laboratory:
    """A person on a plate, whose masses differ from the model's, with skin that moves by 2 mm."""

    def __init__(self) -> None:
        compiled = person()
        model = model_from_mujoco(compiled, name="person")
        markers = [
            Marker(f"{one.name}_{i}", one.name, one.mass_center + 0.06 * offset)
            for one in model.bodies
            for i, offset in enumerate(TETRAHEDRON)
        ]
        size = SubjectOptions(length=0.01, marker_shift=0.003, mass=0.15, seed=8)
        self.subject = random_subject(model.with_markers(tuple(markers)), size)
        self.engine = TreeEngine(compiled, self.subject.person)

    def trial(self, name: str, seed: int, share: float = 1.0, late: float = 0.0) -> SubjectTrial:
        """Record the person for four seconds.

        Parameters
        ----------
        name : of the recording
        seed : of the movement and the noise
        share : of how far coordinates go; nearly 0 is standing still
        late : what the times of the forces lack [s]
        """
        names, middles, reaches = middles_and_reaches(self.subject.person)
        curves = exciting_curves(middles, share * reaches, seed=seed, band=(0.2, 1.4))
        tools = Instruments(rate=50.0, seed=seed)
        found = record(
            self.subject, self.engine, Movement(names=names, curves=curves, duration=4.0), tools
        )
        time = found.markers.time
        skin = np.random.default_rng(seed).standard_normal((3, *found.markers.values.shape[1:]))
        waves = np.sin(np.outer(time, (2.0, 5.0, 9.0)) + np.arange(3.0))
        moving = 0.002 * np.sqrt(2.0 / 3.0) * np.einsum("fk,kmi->fmi", waves, skin)
        markers = replace(found.markers, values=found.markers.values + moving)
        wrenches = replace(found.wrenches, time=found.wrenches.time - late)
        return SubjectTrial(name, markers, wrenches)

    def refined(self, trials, options: RefineOptions) -> Refinement:
        """Refine the generic model at the person's mass."""
        return refine(self.subject.generic, trials, self.subject.person.mass, options)


@pytest.fixture(scope="module")
def laboratory():
    return Laboratory()


def test_a_late_clock_is_found_beside_body_and_masses(laboratory):
    trials = [laboratory.trial("a", 3, late=LATE), laboratory.trial("b", 4)]
    options = replace(OPTIONS, fit=("lengths", "markers", "masses", "clock"))
    found = laboratory.refined(trials, options)
    late, right = found.clocks
    assert (late.recording, right.recording) == ("a", "b")
    assert late.shown
    assert right.shown
    assert late.offset.value == pytest.approx(LATE, abs=0.004)
    assert late.offset.holds(LATE)
    assert not late.offset.holds(0.0)
    assert right.offset.holds(0.0)
    assert found.fit == ("lengths", "markers", "masses", "clock")
    # What it was without the clock's correction is worse by far.
    wrong = laboratory.refined(trials, OPTIONS)
    truth = laboratory.subject.person
    names = [body.name for body in truth.bodies if body.mass > 1.0]

    def off(result):
        return np.linalg.norm(
            [result.model.body(name).mass - truth.body(name).mass for name in names]
        )

    assert off(found) < off(wrong)
    assert found.after.moment < wrong.after.moment


def test_one_clock_of_all_recordings(laboratory):
    trials = [laboratory.trial("a", 3, late=LATE), laboratory.trial("b", 4, late=LATE)]
    options = replace(OPTIONS, fit=("clock",), shared_clock=True)
    found = laboratory.refined(trials, options)
    assert found.estimate.unknowns.names == ("clock of all recordings",)
    first, second = found.clocks
    assert first.offset == second.offset
    assert first.offset.holds(LATE)


def test_held_out_recordings_are_predicted_with_their_own_clock(laboratory):
    """Forces of what is held out are moved for the refined body as for the given one."""
    trials = [laboratory.trial("a", 3, late=4.0 * LATE), laboratory.trial("b", 4)]
    options = replace(OPTIONS, fit=("masses", "clock"), check=True, iterations=5)
    found = laboratory.refined(trials, options)
    assert not found.kept
    assert found.estimate.verdict.better
    late = found.predictions[0]
    assert late.name == "a"
    assert late.refined.moment < late.given.moment
    # As recorded, they are off by far more.
    assert late.given.moment < 0.5 * found.trials[0].before.moment


def test_forces_that_are_too_late_are_named(laboratory):
    options = replace(OPTIONS, fit=("clock",), cutoff=6.0)
    found = laboratory.refined([laboratory.trial("a", 3, late=0.16)], options)
    (clock,) = found.clocks
    assert clock.at_bound
    assert any(note.startswith("a: its forces are 125 ms off or more") for note in found.notes)


def test_a_clock_that_nothing_shows_is_said_so(laboratory):
    still = laboratory.trial("still", 5, share=1e-4)
    options = replace(OPTIONS, fit=("clock",))
    found = laboratory.refined([still], options)
    (clock,) = found.clocks
    assert not clock.shown
    bound = 0.75 / options.cutoff
    assert clock.offset.low >= -bound
    assert clock.offset.high <= bound
    assert clock.offset.holds(0.0)
    assert any(
        note.startswith("still: the clock of its forces is not determined") for note in found.notes
    )


@pytest.mark.parametrize("fit", [(), ("motions",), ("lengths",), ("markers",), ("masses",)])
def test_what_is_not_fitted_is_as_given(laboratory, fit):
    model = laboratory.subject.generic
    options = replace(OPTIONS, fit=fit, iterations=2)
    found = laboratory.refined([laboratory.trial("a", 3)], options)
    assert found.fit == tuple(name for name in fit if name != "motions")
    assert ("lengths" in fit) == bool((found.factors != 1.0).any())
    assert ("lengths" in fit) == bool((found.factors_sd > 0.0).any())
    assert ("masses" in fit) == bool((found.mass_sd > 0.0).any())
    stretched = np.array([one.location for one in found.model.markers])
    given = np.array([one.location for one in model.markers])
    assert (stretched != pytest.approx(given, abs=1e-9)) == bool(set(fit) & {"lengths", "markers"})
    assert found.estimate.unknowns.slices.keys() == set(found.fit)


def test_the_estimate_has_parameters_in_their_units(laboratory):
    found = laboratory.refined([laboratory.trial("a", 3)], OPTIONS)
    estimate = found.estimate
    row = found.model.body_names.index("femur_r")
    interval = estimate.posterior.interval("femur_r m")
    assert interval.value == pytest.approx(found.parameters[row, 0])
    half = 0.5 * (interval.high - interval.low)
    assert half == pytest.approx(1.6449 * found.mass_sd[row], rel=1e-3)
    # Whatever is drawn, every link is some body's.
    own = estimate.unknowns.slices["masses"]
    for drawn in estimate.posterior.draws(20):
        bodies = pseudo_inertias(drawn[own].reshape(-1, 10))
        assert np.linalg.eigvalsh(bodies)[:, 0].min() > -1e-9
    assert [one.name for one in estimate.explained] == ["markers and plates", "body as given"]


def test_an_unknown_name_is_refused_with_those_that_there_are(laboratory):
    options = replace(OPTIONS, fit=("length",))
    with pytest.raises(UnknownName, match=r"'length'.*'lengths'"):
        laboratory.refined([laboratory.trial("a", 3)], options)


@pytest.fixture
def gain(monkeypatch):
    """Put the page's unknown into the table of kinds."""
    section = PAGE.read_text(encoding="utf-8").split("## An unknown of `refine`")[1]
    code, line = re.findall(r"^```(?:python|text)\n(.*?)^```", section, re.MULTILINE | re.DOTALL)[
        :2
    ]
    names: dict[str, object] = {}
    exec(code, names)
    ((name, make),) = eval(f"{{{line.strip()}}}", names).items()
    monkeypatch.setitem(kinds.KINDS, name, make)
    return name


def test_an_unknown_that_a_page_adds_is_estimated(laboratory, gain):
    trial = laboratory.trial("a", 3)
    weak = 1.0 / 1.02
    wrenches = replace(
        trial.wrenches, forces=weak * trial.wrenches.forces, torques=weak * trial.wrenches.torques
    )
    options = replace(OPTIONS, fit=(gain, "masses", "clock"))
    found = laboratory.refined([replace(trial, wrenches=wrenches)], options)
    assert found.fit == ("masses", "clock", gain)
    assert found.estimate.values[gain][0] == pytest.approx(1.02, abs=2e-3)
    assert found.estimate.posterior.shown[-2:].all()
    assert found.clocks[0].offset.holds(0.0)
