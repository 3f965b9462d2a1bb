"""Decays found again, and the formulas of hanging bodies."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.io import loadmat

from myomorph.core.model.errors import BadData, UnknownName
from truths.decays import compare_decays, compound_inertia, fit_decay, torsional_inertia

TIME = np.arange(0.0, 20.0, 0.02)
INERTIA = 0.9
WEIGHT = 14.0
"""About the axis [kg m^2], and m g l [N m]."""
TORQUES = {
    ("viscous",): lambda w: 0.05 * w,
    ("coulomb",): lambda w: 0.03 * np.tanh(w / 1e-3),
    ("quadratic",): lambda w: 0.06 * np.abs(w) * w,
    ("viscous", "coulomb"): lambda w: 0.02 * w + 0.02 * np.tanh(w / 1e-3),
}


def _pendulum(torque, start: float = 0.35) -> np.ndarray:
    """Rate of a pendulum let go from an angle [rad/s]."""

    def slope(_time, state):
        return [state[1], -(WEIGHT * np.sin(state[0]) + torque(state[1])) / INERTIA]

    return solve_ivp(
        slope, TIME[[0, -1]], [start, 0.0], "LSODA", t_eval=TIME, rtol=1e-8, atol=1e-9
    ).y[1]


@pytest.mark.parametrize("terms", TORQUES)
def test_the_damping_that_acted_is_chosen(terms):
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(TIME))
    fits = compare_decays(TIME, 0.2 + _pendulum(TORQUES[terms]) + noise)
    best = min(fits, key=lambda one: one.bic)
    assert best.terms == terms
    assert best.period == pytest.approx(2.0 * np.pi * np.sqrt(INERTIA / WEIGHT), rel=4e-4)
    assert best.offset == pytest.approx(0.2, abs=2e-3)


def test_coefficients_are_those_of_the_torque():
    fit = fit_decay(TIME, _pendulum(TORQUES["viscous", "coulomb"], 0.2), ("viscous", "coulomb"))
    assert fit.viscosity(INERTIA) == pytest.approx(0.02, rel=0.02)
    assert fit.friction(WEIGHT) == pytest.approx(0.02, rel=0.03)
    assert fit.signal_per_radian() == pytest.approx(np.sqrt(WEIGHT / INERTIA), rel=0.02)
    ratio = fit_decay(TIME, _pendulum(TORQUES[("viscous",)])).damping_ratio
    assert ratio == pytest.approx(0.05 / (2.0 * np.sqrt(WEIGHT * INERTIA)), rel=0.01)


def test_errors_of_independent_noise_are_those_of_the_textbook():
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(TIME))
    clean = 1.3 * np.exp(-0.03 * TIME) * np.cos(4.0 * TIME + 0.3)
    fit = fit_decay(TIME, clean + noise, bend=False)
    assert fit.residual == pytest.approx(0.02, rel=0.1)
    assert fit.period == pytest.approx(0.5 * np.pi, abs=4.0 * fit.period_sd)
    assert fit.period_sd == pytest.approx(fit.period_sd_white, rel=0.6)
    assert fit.decrement(1.0) == pytest.approx(0.03 * fit.period, rel=0.1)


def test_a_hanging_body_has_the_inertia_of_the_textbook():
    mass = 1.7
    length = 0.8
    g = 9.81
    period = 2.0 * np.pi * np.sqrt(2.0 * length / (3.0 * g))
    assert compound_inertia(mass, g, 0.5 * length, period) == pytest.approx(mass * length**2 / 12.0)
    assert torsional_inertia(0.5, 1.2, 2.4) == pytest.approx(2.0)


def test_what_cannot_be_fitted_is_refused():
    with pytest.raises(BadData, match="three periods"):
        fit_decay(TIME[:100], np.cos(4.0 * TIME[:100]))
    with pytest.raises(UnknownName, match=r"'dry'.*'coulomb'"):
        fit_decay(TIME, np.cos(4.0 * TIME), ("dry",))


def test_the_measured_fork_rubs_rather_than_flows(data):
    held = loadmat(data("pendulum-swing-inertia/BrowserForkCompoundFirst1.mat"), squeeze_me=True)
    signal = np.asarray(held["data"], dtype=float)[::10]
    time = 10.0 * np.arange(len(signal)) / float(held["ActualRate"])
    fits = {one.terms: one for one in compare_decays(time, signal)}
    best = min(fits.values(), key=lambda one: one.bic)
    assert best.terms == ("viscous", "coulomb")
    assert fits[("viscous",)].residual > 1.9 * best.residual
    assert best.decrement(0.4) > 1.9 * best.decrement(1.0)
    plain = fit_decay(time, signal, bend=False)
    assert plain.period == pytest.approx(1.5903, abs=2e-4)
    assert best.period < plain.period
