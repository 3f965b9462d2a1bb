"""Terms written outside the package, solved by the public call.

They are compared with an independent solver of quadratic programs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from readable import Program, frame_program, solve_program
from walking import task, walk

from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.model import Actuator, index_of
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.problem import TensionInputs, tension_problem
from myomorph.core.tension.recruitment import EFFORT_ALONE
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.terms.actuators import default_reserves
from myomorph.core.tension.terms.emg import EmgTarget
from myomorph.core.tension.terms.term import (
    Columns,
    Frames,
    Penalties,
    Rows,
    Smoothing,
    Term,
    Unknowns,
    Variables,
)

FRAMES = slice(150, 1150, 180)


@dataclass(frozen=True)
class CoContraction(Term):
    """weight (a_one - ratio a_other)^2: an antagonist works with its agonist."""

    one: str
    other: str
    ratio: float = 1.0
    weight: float = 5.0

    def rows(self, unknowns: Unknowns) -> Rows:
        """One row: the difference, which should be 0."""
        difference = unknowns.row({self.one: 1.0, self.other: -self.ratio})
        return Rows.cost(f"{self.one} with {self.other}", difference, 0.0, self.weight)


@dataclass(frozen=True)
class Slow(Term):
    """stiffness (a_k - a_(k-1))^2 of one muscle, from each frame to the next."""

    muscle: str

    def smoothing(self, unknowns: Unknowns) -> Smoothing:
        """All frames in one window."""
        first = index_of("muscle", self.muscle, unknowns.muscles)
        count = len(unknowns.time)
        return Smoothing(
            window=count,
            margin=0,
            first=first,
            scale=np.ones((count, 1)),
            stiffness=np.ones(count - 1),
            over=1.0,
            sweeps=10,
            tolerance=1e-9,
        )


@dataclass(frozen=True)
class PreferredActivation(Term):
    """weight (a - activation)^2 of one muscle."""

    muscle: str
    activation: float
    weight: float = 10.0

    def penalties(self, unknowns: Unknowns) -> Penalties:
        """Return an interval without width, in all frames."""
        column = index_of("muscle", self.muscle, unknowns.muscles)
        value = np.full((1, 1), self.activation)
        return Penalties(
            columns=[column], low=value, high=value, weight=np.full((1, 1), self.weight)
        )


@dataclass(frozen=True)
class GreatestSum(Term):
    """Activations of some muscles together stay below a limit."""

    muscles: tuple[str, ...]
    most: float

    def rows(self, unknowns: Unknowns) -> Rows:
        """One inequality."""
        return Rows.at_most(
            "greatest sum", unknowns.row(dict.fromkeys(self.muscles, 1.0)), self.most
        )


@dataclass(frozen=True)
class Held(Term):
    """Two activations have a given difference in every frame."""

    one: str
    other: str
    difference: np.ndarray

    def rows(self, unknowns: Unknowns) -> Rows:
        """One equation, whose right side changes from frame to frame."""
        return Rows.equal(
            "held", unknowns.row({self.one: 1.0, self.other: -1.0}), self.difference[:, None]
        )


@dataclass(frozen=True)
class Exosuit(Term):
    """A motor that pulls a coordinate one way: an unknown of its own with a generalized force."""

    coordinate: int
    torque: float

    def variables(self) -> Variables:
        """Return the motor's command, from 0."""
        return Variables(
            names=("exosuit",),
            weight=np.ones(1),
            exponent=np.full(1, 2.0),
            lower=np.zeros(1),
            upper=np.full(1, np.inf),
        )

    def entries(self) -> Sequence[tuple[int, int]]:
        """Its one coordinate."""
        return [(0, self.coordinate)]

    def columns(self, frames: Frames) -> Columns:
        """Return a torque that does not depend on the pose."""
        return Columns(-np.ones((len(frames), 1)), np.full((len(frames), 1), self.torque))


@pytest.fixture(scope="module")
def walker(data):
    """Frames of a walk whose plates are known."""
    model, motion, loads = walk(data, FRAMES)
    return model, motion, inverse_dynamics(model, motion, loads)


def _with_cost(program: Program, L: np.ndarray, m: float, weight: float) -> Program:
    """Return the program with weight (L x - m)^2 added, as a full H."""
    H = np.diag(program.H) if program.H.ndim == 1 else program.H
    return replace(program, H=H + 2.0 * weight * np.outer(L, L), c=program.c - 2.0 * weight * m * L)


def _unit(program: Program, **factors: float) -> np.ndarray:
    """Return a row of factors by the names of the program's variables."""
    found = np.zeros(len(program.c))
    for name, factor in factors.items():
        found[program.variables.index(name)] = factor
    return found


def test_co_contraction_of_an_antagonist_pair_is_the_optimum_of_the_whole_program(walker):
    model, motion, tau = walker
    problem = tension_problem(TensionInputs(model, motion, tau))
    free = solve_tension(model, motion, tau, recruitment=EFFORT_ALONE)
    found = solve_tension(
        model,
        motion,
        tau,
        recruitment=EFFORT_ALONE,
        terms=[CoContraction("soleus_r", "tibant_r", 2.0, weight=8.0)],
    )
    assert found.optimal.all()
    for frame in range(len(motion)):
        bare = frame_program(problem, frame)
        whole = _with_cost(bare, _unit(bare, soleus_r=1.0, tibant_r=-2.0), 0.0, 8.0)
        theirs = solve_program(whole)[: len(model.muscles)]
        np.testing.assert_allclose(found.activation[frame], theirs, atol=1e-5)
    one = model.muscle_names.index("soleus_r")
    other = model.muscle_names.index("tibant_r")
    apart = [
        np.abs(each.activation[:, one] - 2.0 * each.activation[:, other]).mean()
        for each in (found, free)
    ]
    assert apart[0] < 0.7 * apart[1]


def test_terms_add_up_with_contacts_emg_and_each_other(walker):
    model, motion, _ = walker
    tau = inverse_dynamics(model, motion)
    # Terms may speak of contacts and muscles alike: with any, one problem finds both.
    asked = task(model, motion, contact_passive=False)
    emg = EmgTarget(("soleus_r", "tibant_l"), np.full((len(motion), 2), 0.3))
    added = [
        PreferredActivation("soleus_r", 0.1, weight=20.0),
        PreferredActivation("recfem_r", 0.25),
        GreatestSum(("recfem_r", "vaslat_r"), 0.2),
        CoContraction("semimem_l", "vasmed_l"),
    ]
    found = solve_tension(model, motion, tau, contacts=asked, emg=emg, terms=added)
    assert found.optimal.all()
    problem = tension_problem(TensionInputs(model, motion, tau, contacts=asked, emg=emg))
    limited = 0
    for frame in range(len(motion)):
        bare = frame_program(problem, frame)
        whole = _with_cost(bare, _unit(bare, soleus_r=1.0), 0.1, 20.0)
        whole = _with_cost(whole, _unit(bare, recfem_r=1.0), 0.25, 10.0)
        whole = _with_cost(whole, _unit(bare, semimem_l=1.0, vasmed_l=-1.0), 0.0, 5.0)
        limit = _unit(bare, recfem_r=1.0, vaslat_r=1.0)
        whole = replace(whole, G=np.vstack([whole.G, limit]), h=np.append(whole.h, 0.2))
        theirs = solve_program(whole)
        np.testing.assert_allclose(found.activation[frame], theirs[: len(model.muscles)], atol=1e-4)
        limited += abs(limit @ theirs - 0.2) < 1e-6
    assert limited > 0


def test_an_equation_with_a_right_side_of_each_frame_holds(walker):
    model, motion, tau = walker
    difference = np.linspace(0.05, 0.2, len(motion))
    found = solve_tension(
        model, motion, tau, recruitment=EFFORT_ALONE, terms=[Held("bflh_r", "bfsh_r", difference)]
    )
    assert found.optimal.all()
    one = model.muscle_names.index("bflh_r")
    other = model.muscle_names.index("bfsh_r")
    np.testing.assert_allclose(
        found.activation[:, one] - found.activation[:, other], difference, atol=1e-7
    )


def test_a_term_with_an_unknown_of_its_own_acts_as_the_actuator_that_it_is(walker):
    model, motion, tau = walker
    name = "ankle_angle_r"
    suit = Exosuit(model.coordinate_names.index(name), 40.0)
    problem = tension_problem(TensionInputs(model, motion, tau, terms=[suit]))
    problem.solve(0, len(motion))
    found = problem.result()
    motor = Actuator(
        "motor", "coordinate", 40.0, coordinate=name, min_control=-np.inf, max_control=0.0
    )
    same = solve_tension(
        model,
        motion,
        tau,
        actuators=(*default_reserves(model), motor),
        recruitment=EFFORT_ALONE,
    )
    np.testing.assert_allclose(found.activation, same.activation, atol=1e-7)
    command = problem.x[:, problem.unknowns.of(suit)]
    np.testing.assert_allclose(-40.0 * command[:, 0], same.actuator_force[:, -1], atol=1e-5)
    assert command.max() > 0.1


def test_terms_that_do_not_fit_are_refused(walker):
    model, motion, tau = walker
    with pytest.raises(UnknownName, match="unknown 'soleus_x'"):
        solve_tension(
            model,
            motion,
            tau,
            recruitment=EFFORT_ALONE,
            terms=[CoContraction("soleus_x", "tibant_r")],
        )
    with pytest.raises(BadData, match="expected above 0"):
        solve_tension(
            model,
            motion,
            tau,
            recruitment=EFFORT_ALONE,
            terms=[CoContraction("soleus_r", "tibant_r", weight=0.0)],
        )
    with pytest.raises(BadData, match="1 rows and 2 targets"):
        Rows.cost("pair", np.ones((1, 3)), [0.0, 1.0], 1.0)
    emg = EmgTarget(("soleus_r",), np.full((len(motion), 1), 0.3), "driven")
    with pytest.raises(BadData, match="draw 'soleus_r' into intervals"):
        solve_tension(model, motion, tau, emg=emg, terms=[PreferredActivation("soleus_r", 0.1)])
    with pytest.raises(BadData, match="2 terms of the tension problem link frames: expected one"):
        solve_tension(
            model, motion, tau, recruitment=EFFORT_ALONE, terms=[Slow("soleus_r"), Slow("tibant_r")]
        )
    with pytest.raises(BadData, match="Exosuit, which is not a part"):
        tension_problem(TensionInputs(model, motion, tau)).unknowns.of(Exosuit(0, 1.0))
