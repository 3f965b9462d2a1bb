"""Laws of the three steps on limbs whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from made_swings import MUSCLES, Made, eleven, inertia_columns, skew, swing, three_releases
from scipy.spatial.transform import Rotation

from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.inertia import pseudo_inertias
from myomorph.swings.viscosity.identification.condition import Influences, solve_condition
from myomorph.swings.viscosity.identification.identify import (
    MeasuredMuscles,
    ViscosityOptions,
    identify_specimen,
)
from myomorph.swings.viscosity.identification.inertia import InertiaOptions, limb_inertia
from myomorph.swings.viscosity.identification.torque import (
    joint_viscosity,
    muscle_problem,
    torque_problem,
)
from myomorph.swings.viscosity.swings import sums as swing_prediction
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.swings.sums import PLATE, swing_sums

BARE = Made(damping=0.05, stiffness=2.0)
WHOLE = replace(BARE, mass=2.5, **eleven(np.random.default_rng(0)))
HINGE = replace(BARE, axis=np.array([0.0, 0.6, 0.8]))
OPTIONS = ViscosityOptions(draws=50)


@pytest.fixture(scope="module")
def bare() -> tuple[SwingRecording, ...]:
    return three_releases(BARE)


@pytest.fixture(scope="module")
def whole() -> tuple[SwingRecording, ...]:
    return three_releases(WHOLE)


@pytest.fixture(scope="module")
def hinge() -> tuple[SwingRecording, ...]:
    return three_releases(HINGE)


def remade(one: SwingRecording, **changed: object) -> SwingRecording:
    arrays = {
        name: np.array(value) for name, value in vars(one).items() if isinstance(value, np.ndarray)
    }
    return replace(one, **{**arrays, **changed})


def test_truth_is_recovered_where_nothing_is_noisy(bare, whole):
    found = identify_specimen("exact", bare, whole, options=OPTIONS)
    for condition, truth in ((found.without, BARE), (found.intact, WHOLE)):
        assert condition.parameters == pytest.approx(truth.parameters, abs=1e-9)
        assert condition.mass.value == pytest.approx(truth.mass, rel=1e-9)
    assert found.without.viscosity.value == pytest.approx(0.05, rel=1e-9)
    assert [axis.value for axis in found.without.axis_viscosity] == pytest.approx(
        [0.05] * 3, rel=1e-8
    )
    assert found.without.plate_viscosity.value == pytest.approx(0.05, rel=1e-9)
    assert found.without.excited == (True, True, True)
    assert found.muscle_mass.value == pytest.approx(0.5, rel=1e-9)
    assert found.muscles.common.value == pytest.approx(120.0, rel=1e-8)
    assert [one.value for one in found.muscles.by_muscle] == pytest.approx([120.0] * 11, rel=1e-6)
    assert found.intact.viscosity.value > found.without.viscosity.value
    assert found.notes == ()


def test_a_hinge_shows_its_own_viscosity_and_mass(hinge):
    found = identify_specimen("hinge", hinge, (), options=OPTIONS).without
    assert found.viscosity.value == pytest.approx(0.05, rel=1e-6)
    assert found.mass.value == pytest.approx(2.0, rel=1e-6)
    across = np.cross(HINGE.axis, HINGE.parameters[1:4])
    assert found.com.value == pytest.approx(np.linalg.norm(across) / 2.0, rel=1e-6)
    tared = replace(OPTIONS, tare="known")
    known = identify_specimen("hinge", hinge, (), options=tared).without
    assert known.com.value == pytest.approx(np.linalg.norm(HINGE.parameters[1:4]) / 2.0, rel=1e-6)


def test_values_by_pcsa_are_the_shares_times_their_factor():
    shares = np.linspace(0.4, 1.6, 11)
    made = replace(WHOLE, viscosity=90.0 * shares / shares.mean())
    found = identify_specimen(
        "shares",
        three_releases(BARE, 4.0),
        three_releases(made, 4.0),
        MeasuredMuscles(pcsa=dict(zip(MUSCLES, shares, strict=True)), mass=0.7),
        OPTIONS,
    )
    assert found.muscles.by_pcsa.value == pytest.approx(90.0, rel=1e-8)
    assert found.muscles.pcsa.mean() == pytest.approx(1.0)
    assert [one.value for one in found.muscles.by_muscle] == pytest.approx(made.viscosity, rel=1e-4)
    assert found.measured_muscle_mass == 0.7


def test_turning_the_laboratory_changes_nothing(bare):
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    six = np.kron(np.eye(2), turn)
    turned = [
        remade(
            one,
            wrench_rows=six @ one.wrench_rows,
            wrench=one.wrench @ six.T,
            rotations=turn @ one.rotations,
            gravity=turn @ one.gravity,
        )
        for one in bare
    ]
    first = identify_specimen("turned", bare, (), options=OPTIONS).without
    second = identify_specimen("turned", turned, (), options=OPTIONS).without
    assert second.parameters == pytest.approx(first.parameters, abs=1e-9)
    assert second.viscosity.value == pytest.approx(first.viscosity.value, rel=1e-9)
    assert second.plate_viscosity.value == pytest.approx(first.plate_viscosity.value, rel=1e-9)


def noisy(given, size: float, seed: int = 0):
    random = np.random.default_rng(seed)
    return [
        remade(one, wrench=one.wrench + size * random.standard_normal(one.wrench.shape))
        for one in given
    ]


def test_sums_over_blocks_are_the_direct_solution(whole):
    given = noisy(whole, 0.1)
    sums = swing_sums(given, least=0.0)
    use = [one.used for one in given]
    assert sums.frames.sum() == pytest.approx(sum(one.sum() for one in use))
    whole_sums = sums.torque_total(np.ones(len(sums)))
    phi = WHOLE.parameters * 1.01
    found = joint_viscosity(torque_problem(whole_sums, phi), sums.frames.sum())
    rates = np.concatenate([one.rates[u] for one, u in zip(given, use, strict=True)])
    angles = np.concatenate([one.angles[u] for one, u in zip(given, use, strict=True)])
    torque = np.concatenate([one.torque_rows[u] @ phi for one, u in zip(given, use, strict=True)])
    for axis in range(3):
        A = np.column_stack([rates[:, axis], angles[:, axis], np.ones(len(rates))])
        assert found.axes[axis] == pytest.approx(
            -np.linalg.lstsq(A, torque[:, axis], rcond=None)[0][0], rel=1e-8
        )
    plain = joint_viscosity(torque_problem(whole_sums, phi, stiffness=False), sums.frames.sum())
    assert plain.one == pytest.approx(-np.sum(rates * torque) / np.sum(rates**2), rel=1e-9)
    moment = np.concatenate(
        [
            np.einsum("fji,fj->fi", one.rotations[u], one.wrench[u, :3])
            for one, u in zip(given, use, strict=True)
        ]
    )
    assert whole_sums[:, PLATE, PLATE] == pytest.approx(np.sum(moment**2, axis=0))


def test_a_spring_that_is_left_out_biases_what_resists(bare):
    without = identify_specimen(
        "spring", bare, (), options=replace(OPTIONS, stiffness=False)
    ).without
    fitted = identify_specimen("spring", bare, (), options=OPTIONS).without
    assert abs(without.viscosity.value / 0.05 - 1.0) > 0.02
    assert fitted.viscosity.value == pytest.approx(0.05, rel=1e-9)


def test_angles_counted_from_another_rest_change_nothing(bare):
    turn = Rotation.from_rotvec([0.03, -0.05, 0.02])
    moved = [
        remade(one, angles=(turn * Rotation.from_rotvec(one.angles.copy())).as_rotvec())
        for one in bare
    ]
    sums = swing_sums(moved)
    left = joint_viscosity(
        torque_problem(sums.torque_total(np.ones(len(sums))), BARE.parameters), sums.frames.sum()
    )
    found = identify_specimen("moved", moved, (), options=OPTIONS).without
    assert abs(left.one / 0.05 - 1.0) > 2e-3
    assert found.viscosity.value == pytest.approx(0.05, rel=1e-4)


def test_unknown_zero_of_the_plate_hides_the_mass_and_nothing_else(bare):
    tared = [remade(one, wrench=one.wrench - one.wrench[k]) for k, one in enumerate(bare)]
    found = identify_specimen("tared", tared, (), options=replace(OPTIONS, tare="unknown"))
    assert np.isnan(found.without.mass.value)
    assert np.isnan(found.without.com.low)
    assert found.without.parameters[1:] == pytest.approx(BARE.parameters[1:], abs=1e-8)
    assert found.without.viscosity.value == pytest.approx(0.05, rel=1e-8)
    assert any("mass is not identifiable" in note for note in found.notes)


def test_rank_is_that_of_a_symmetric_matrix_where_moment_arms_are_constant():

    for axis, rank in ((None, 6), (np.array([0.0, 0.0, 1.0]), 1)):
        made = Made(arms=WHOLE.arms, viscosity=WHOLE.viscosity, bend=0.0, axis=axis)
        sums = swing_sums(three_releases(made, 2.0))
        problem = muscle_problem(
            torque_problem(sums.torque_total(np.ones(len(sums))), WHOLE.parameters), np.zeros(1)
        )
        assert problem.rank == rank
    sums = swing_sums(three_releases(WHOLE, 4.0))
    assert (
        muscle_problem(
            torque_problem(sums.torque_total(np.ones(len(sums))), WHOLE.parameters), np.zeros(3)
        ).rank
        == 11
    )


def shaken(recordings, random: np.random.Generator, size: float) -> list[SwingRecording]:
    """With noise [rad/s^2] in the accelerations of the rows, as of markers differentiated twice."""
    made = []
    for one in recordings:
        noise = size * random.standard_normal((len(one), 3))
        rows = np.array(one.wrench_rows)
        rows[:, :3, 4:] += one.rotations @ inertia_columns(noise)
        rows[:, 3:, 1:4] += one.rotations @ skew(noise)
        made.append(remade(one, wrench_rows=rows))
    return made


def test_instruments_keep_noise_of_the_acceleration_from_shrinking_the_limb(bare):
    sums = swing_sums(shaken(bare, np.random.default_rng(3), 2.0))
    truth = np.linalg.norm(BARE.parameters[1:4])
    error = abs(
        np.linalg.norm(limb_inertia(sums, None, InertiaOptions(instruments=True)).parameters[1:4])
        / truth
        - 1.0
    )
    plain = abs(
        np.linalg.norm(limb_inertia(sums, None, InertiaOptions(instruments=False)).parameters[1:4])
        / truth
        - 1.0
    )
    assert error < 0.01
    assert plain > 5.0 * error


@dataclass(frozen=True)
class Straight(Made):
    """A straight limb, which swings in one plane on a ball if it is let go so."""

    @property
    def parameters(self) -> np.ndarray:
        return np.array([2.0, 0.0, -0.84, 0.0, 0.46, 0.0016, 0.46, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("cutoff", [None, 20.0])
def test_axes_that_do_not_turn_do_not_shrink_the_others(monkeypatch, cutoff):
    """Noise makes their inertia appear small.

    Of a possible body no inertia is larger than the other two together.
    """
    limb = Straight()
    random = np.random.default_rng(0)
    exact = swing(limb, np.outer([0.7, -0.9], [1.0, 0.0, 0.0]), np.zeros((2, 3)), 6.0)
    plate = [
        remade(one, wrench=one.wrench + 0.03 * random.standard_normal(one.wrench.shape))
        for one in exact
    ]
    swings = [replace(each, cutoff=cutoff) for each in shaken(plate, random, 1.0)]
    errors = []
    for share in (swing_prediction.SPEED_THRESHOLD, 0.0):
        monkeypatch.setattr(swing_prediction, "SPEED_THRESHOLD", share)
        parameters = limb_inertia(swing_sums(swings), None, InertiaOptions("known")).parameters
        errors.append(np.abs(parameters[[2, 4]] / limb.parameters[[2, 4]] - 1.0).max())
    assert errors[0] < 0.005
    assert errors[1] > 20.0 * errors[0]


def test_a_body_that_cannot_be_is_not_returned(bare):
    broken = [
        remade(one, wrench=one.wrench * np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0])) for one in bare
    ]
    sums = swing_sums(broken)
    found = limb_inertia(sums)
    assert not found.possible
    assert np.linalg.eigvalsh(pseudo_inertias(found.parameters)).min() > 0.0


def test_intervals_of_independent_blocks_hold_the_truth_as_often_as_they_say():
    random = np.random.default_rng(0)
    trial = np.repeat(np.arange(4), 6)
    held = 0
    for _ in range(300):
        blocks = (
            random.standard_normal((24, 1))
            * np.linspace(2.0, 0.5, 6)[np.tile(np.arange(6), 4), None]
        )
        draws = Influences(np.array([blocks.sum()]), blocks, trial).draws(300, random)
        low, high = np.quantile(draws, [0.025, 0.975])
        held += low <= 0.0 <= high
    assert 0.90 < held / 300 < 0.985


def test_trials_that_differ_are_drawn_as_trials():
    random = np.random.default_rng(1)
    trial = np.repeat(np.arange(4), 12)
    blocks = 0.05 * random.standard_normal((48, 2))
    blocks[:, 1] += np.array([1.0, -1.0, 0.8, -0.8])[trial]
    assert Influences(np.zeros(2), blocks, trial).by_trial.tolist() == [False, True]


def test_a_trial_that_died_away_tells_nothing_and_biases_nothing(bare):
    dead = remade(bare[0], rates=1e-3 * bare[0].rates, name="dead")
    sums = swing_sums([*bare, dead])
    assert sums.still == dead.used.sum()
    assert (sums.trial < 3).all()


def test_one_condition_is_enough_and_the_other_is_named(bare):
    found = identify_specimen("half", bare, (), options=OPTIONS)
    assert found.intact is None
    assert found.muscles is None
    assert found.notes[0].startswith("muscles intact: no recording")
    with pytest.raises(BadData, match="no recording"):
        identify_specimen("none", (), (), options=OPTIONS)


def test_bad_input_is_named(bare, whole):
    with pytest.raises(UnknownName, match="muscle 0"):
        identify_specimen("pcsa", bare, whole, MeasuredMuscles(pcsa={"other": 1.0}), OPTIONS)
    with pytest.raises(BadData, match="mass is"):
        limb_inertia(swing_sums([remade(one, wrench=-one.wrench) for one in bare]))
    lost = np.array(bare[0].rates)
    lost[5] = np.nan
    with pytest.raises(BadData, match="rates is not finite"):
        swing_sums([remade(bare[0], rates=lost)])
    with pytest.raises(BadData, match="free swing"):
        swing_sums([remade(bare[0], swing=np.full(len(bare[0]), -1))])
    with pytest.raises(BadData, match="at least three"):
        solve_condition(swing_sums(bare[:1], swings=100), InertiaOptions(), True)
    with pytest.raises(BadData, match="draws"):
        ViscosityOptions(draws=0)
