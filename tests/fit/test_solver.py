"""The solver against scipy's and against closed forms: bounds, elimination, convergence."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from myomorph.core.fit import (
    Block,
    LinearPrior,
    Measured,
    Method,
    NormalEquations,
    Problem,
    Unknown,
    Unknowns,
    estimate,
    turned,
)
from myomorph.core.fit.bounds import bounded_step
from myomorph.core.fit.elimination import eliminated
from myomorph.core.fit.solver import minimize
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.spatial import rotation_from_vector

CLOSE = Method(iterations=300, tolerance=1e-12, min_gain=0.0)


def block(name, start, low=-np.inf, high=np.inf, sd=None):
    start = np.asarray(start, float)
    low = np.broadcast_to(low, start.shape)
    high = np.broadcast_to(high, start.shape)
    unknowns = [
        Unknown(name=f"{name} {i}", start=value, low=least, high=most, sd=sd)
        for i, (value, least, most) in enumerate(zip(start, low, high, strict=True))
    ]
    return Block(name=name, unknowns=tuple(unknowns))


def curved(seed, rows=12, count=4):
    """Residuals of a smooth random function, and their slopes."""
    random = np.random.default_rng(seed)
    A = random.normal(size=(rows, count))
    B = 0.3 * random.normal(size=(rows, count))
    b = random.normal(size=rows)

    def function(values):
        x = values["x"]
        return A @ x + np.sin(B @ x) - b

    def slopes(values):
        return {"x": A + np.cos(B @ values["x"])[:, None] * B}

    return function, slopes


@pytest.mark.parametrize("seed", range(8))
def test_the_minimum_within_bounds_is_that_of_scipy(seed):
    function, slopes = curved(seed)
    random = np.random.default_rng(100 + seed)
    low = -random.uniform(0.0, 0.4, 4)
    high = random.uniform(0.0, 0.4, 4)
    unknowns = Unknowns((block("x", np.zeros(4), low, high),))
    measured = Measured(name="curve", blocks=("x",), function=function, slopes=slopes)
    found = minimize(Problem(unknowns, (measured,)), method=CLOSE)
    reference = scipy.optimize.least_squares(
        lambda x: function({"x": x}),
        np.zeros(4),
        lambda x: slopes({"x": x})["x"],
        bounds=(low - 1e-14, high + 1e-14),
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    assert found.search.converged
    np.testing.assert_allclose(found.search.cost, 2.0 * reference.cost, rtol=1e-9)
    np.testing.assert_allclose(found.x, reference.x, atol=1e-6)
    assert ((found.x >= low) & (found.x <= high)).all()
    assert found.gradient < 1e-6


@pytest.mark.parametrize("seed", range(20))
def test_a_step_within_bounds_meets_the_conditions_of_its_minimum(seed):
    random = np.random.default_rng(seed)
    A = random.normal(size=(9, 6))
    H = A.T @ A
    g = random.normal(size=6)
    low = -random.uniform(0.0, 0.1, 6)
    high = random.uniform(0.0, 0.1, 6)
    high[0] = low[0] = 0.0
    step = bounded_step(H, g, low, high)
    slope = H @ step + g
    assert ((step >= low) & (step <= high)).all()
    inside = (step > low) & (step < high)
    np.testing.assert_allclose(slope[inside], 0.0, atol=1e-9)
    assert (slope[(step == low) & (low < high)] >= -1e-9).all()
    assert (slope[(step == high) & (low < high)] <= 1e-9).all()


def test_slopes_are_those_of_finite_differences():
    function, slopes = curved(3)
    unknowns = Unknowns((block("x", [0.1, -0.2, 0.3, 0.4]),))
    given = Measured(name="curve", blocks=("x",), function=function, slopes=slopes)
    without = Measured(name="curve", blocks=("x",), function=function)
    exact = Problem(unknowns, (given,)).at().equations.data
    differences = Problem(unknowns, (without,)).at().equations.data
    np.testing.assert_allclose(differences.H, exact.H, atol=1e-7)
    np.testing.assert_allclose(differences.g, exact.g, atol=1e-7)


def test_the_minimum_is_the_same_from_differences():
    function, slopes = curved(5)
    unknowns = Unknowns((block("x", np.zeros(4)),))
    found = [
        minimize(Problem(unknowns, (one,)), method=CLOSE).x
        for one in (
            Measured(name="curve", blocks=("x",), function=function, slopes=slopes),
            Measured(name="curve", blocks=("x",), function=function),
        )
    ]
    np.testing.assert_allclose(*found, atol=1e-6)


def test_rotations_are_found_by_turns():
    truth = np.array([2.0, -1.5, 0.7])
    points = np.random.default_rng(0).normal(size=(6, 3))
    seen = points @ rotation_from_vector(truth).T
    axes = [Unknown(name=f"turn {axis}", unit="rad", sd=10.0) for axis in "xyz"]
    unknowns = Unknowns((Block(name="mounting", unknowns=tuple(axes), chart=turned),))
    measured = Measured(
        name="points",
        blocks=("mounting",),
        function=lambda values: (
            points @ rotation_from_vector(values["mounting"]).T - seen
        ).ravel(),
        sd=1e-3,
    )
    found = minimize(Problem(unknowns, (measured,)), method=CLOSE)
    np.testing.assert_allclose(
        rotation_from_vector(found.x), rotation_from_vector(truth), atol=1e-6
    )


@pytest.mark.parametrize("seed", range(5))
def test_eliminated_frames_leave_the_equations_of_the_full_problem(seed):
    random = np.random.default_rng(seed)
    frames = [
        (random.normal(size=(7, 3)), random.normal(size=(7, 4)), random.normal(size=7))
        for _ in range(5)
    ]
    whole = np.zeros((35, 19))
    right = np.zeros(35)
    H = np.zeros((4, 4))
    g = np.zeros(4)
    cost = 0.0
    for number, (own, shared, residuals) in enumerate(frames):
        rows = slice(7 * number, 7 * number + 7)
        whole[rows, :4] = shared
        whole[rows, 4 + 3 * number : 7 + 3 * number] = own
        right[rows] = residuals
        frame = eliminated(own, shared, residuals)
        H += frame.equations.H
        g += frame.equations.g
        cost += frame.cost
    full = np.linalg.lstsq(whole, -right)[0]
    step = -np.linalg.solve(H, g)
    np.testing.assert_allclose(step, full[:4], atol=1e-10)
    np.testing.assert_allclose(
        cost + 2.0 * g @ step + step @ H @ step, np.sum((whole @ full + right) ** 2), atol=1e-9
    )
    # The frames' own unknowns follow.
    last = eliminated(*frames[-1])
    np.testing.assert_allclose(last.moved + last.follows @ step, full[-3:], atol=1e-10)


class Kernel:
    """Hands over equations instead of rows, as a compiled kernel does."""

    name = "kernel"
    blocks = ("x",)
    prior = False

    def __init__(self, rows, right):
        self.rows = rows
        self.right = right

    def at(self, values, before):
        return KernelAt(self, values["x"])


class KernelAt:
    def __init__(self, kernel, x):
        self.kernel = kernel
        self.x = x
        self.count = len(kernel.right)
        self.cost = float(np.sum((kernel.rows @ x - kernel.right) ** 2))

    def normal(self):
        rows = self.kernel.rows
        return NormalEquations(H=rows.T @ rows, g=rows.T @ (rows @ self.x - self.kernel.right))


def test_kernels_and_rows_are_one_problem():
    random = np.random.default_rng(1)
    A = random.normal(size=(8, 3))
    B = random.normal(size=(5, 3))
    b = random.normal(size=13)
    unknowns = Unknowns((block("x", np.zeros(3)),))
    rows = Measured(name="rows", blocks=("x",), function=lambda values: B @ values["x"] - b[8:])
    found = minimize(Problem(unknowns, (Kernel(A, b[:8]), rows)), method=CLOSE)
    np.testing.assert_allclose(found.x, np.linalg.lstsq(np.vstack([A, B]), b)[0], atol=1e-8)


def test_any_subset_of_blocks_is_estimated_together():
    random = np.random.default_rng(2)
    A = random.normal(size=(20, 5))
    b = random.normal(size=20)
    lengths = block("lengths", [0.5, 0.5, 0.5])
    clock = block("clock", [0.1, -0.1])

    def function(values):
        return A[:, :3] @ values["lengths"] + A[:, 3:] @ values["clock"] - b

    measured = Measured(name="markers", blocks=("lengths", "clock"), function=function)
    problem = Problem(Unknowns((clock, lengths)), (measured,))
    alone = estimate(problem, fit=["lengths"], method=CLOSE)
    expected = np.linalg.lstsq(A[:, :3], b - A[:, 3:] @ [0.1, -0.1])[0]
    np.testing.assert_allclose(alone.values["lengths"], expected, atol=1e-7)
    np.testing.assert_array_equal(alone.values["clock"], [0.1, -0.1])
    assert alone.fitted == ("lengths 0", "lengths 1", "lengths 2")
    both = estimate(problem, fit=["lengths", "clock"], method=CLOSE)
    everything = np.linalg.lstsq(A, b)[0]
    np.testing.assert_allclose(both.values["lengths"], everything[:3], atol=1e-7)
    np.testing.assert_allclose(both.values["clock"], everything[3:], atol=1e-7)
    with pytest.raises(UnknownName, match="masses"):
        estimate(problem, fit=["masses"])


def test_problems_that_share_unknowns_add_up():
    shared = block("shared", [0.0], sd=1.0)
    own = block("own", [0.0], sd=1.0)
    first = Problem(
        Unknowns((shared,)),
        (Measured(name="a", blocks=("shared",), function=lambda v: v["shared"] - 1.0),),
    )
    second = Problem(
        Unknowns((shared, own)),
        (
            Measured(
                name="b", blocks=("own", "shared"), function=lambda v: v["own"] + v["shared"] - 3.0
            ),
        ),
    )
    both = first + second
    assert both.unknowns.names == ("shared 0", "own 0")
    found = estimate(both, method=CLOSE)
    # Priors of unknowns count once: minimum of s^2 + o^2 + (s - 1)^2 + (o + s - 3)^2.
    np.testing.assert_allclose(found.posterior.x, [1.0, 1.0], atol=1e-9)
    with pytest.raises(BadData, match="declared twice"):
        first + Problem(Unknowns((block("shared", [0.5]),)), ())


def test_what_is_eliminated_may_begin_where_the_search_came_from():
    begun = []

    class Frames(Kernel):
        def at(self, values, before):
            begun.append(None if before is None else before.x.copy())
            return super().at(values, before)

    A = np.random.default_rng(0).normal(size=(6, 2))
    unknowns = Unknowns((block("x", np.zeros(2)),))
    minimize(Problem(unknowns, (Frames(A, np.ones(6)),)))
    assert begun[0] is None
    np.testing.assert_array_equal(begun[1], [0.0, 0.0])


def test_a_search_that_ends_early_says_so():
    unknowns = Unknowns((block("x", [3.0]),))
    measured = Measured(name="far", blocks=("x",), function=lambda values: np.exp(values["x"]))
    found = minimize(Problem(unknowns, (measured,)), method=Method(iterations=2))
    assert not found.search.converged
    assert found.search.status == "iteration limit"
    assert found.search.steps == 2


def test_reweighted_steps_find_the_median_by_absolute_errors():
    values = np.array([0.0, 0.1, 0.2, 0.25, 9.0])

    class Absolute(Kernel):
        def at(self, values_, before):
            weight = 1.0 / np.sqrt(np.sqrt((values_["x"][0] - values) ** 2 + 1e-8))
            kernel = Kernel(weight[:, None], weight * values)
            return KernelAt(kernel, values_["x"])

    unknowns = Unknowns((block("x", [2.0]),))
    method = Method(reweighted=True, iterations=500, tolerance=1e-9)
    found = minimize(Problem(unknowns, (Absolute(None, None),)), method=method)
    assert found.search.converged
    np.testing.assert_allclose(found.x, 0.2, atol=1e-3)


class Turning(Kernel):
    """Residuals of an unknown whose slope is thought half of what it is: steps go twice too far."""

    def at(self, values_, before):
        kernel = Kernel(np.array([[0.48]]), np.zeros(1))
        return KernelAt(kernel, values_["x"] / 0.48)


@pytest.mark.parametrize(("stiffness", "converged"), [(0.0, False), (0.5, True)])
def test_reweighted_steps_that_go_back_and_forth_are_held(stiffness, converged):
    unknowns = Unknowns((block("x", [1.0]),))
    problem = Problem(unknowns, (Turning(None, None),))
    method = Method(
        reweighted=True, stiffness=stiffness, iterations=30, tolerance=1e-6, max_step=100.0
    )
    assert minimize(problem, method=method).search.converged == converged


def test_reweighted_steps_are_shortened_and_end_in_standard_deviations():
    far = Unknowns((block("x", [0.0]),))
    rows = Measured(name="first", blocks=("x",), function=lambda values: values["x"] - 2.0, sd=0.1)
    method = Method(
        reweighted=True,
        changes_in="standard deviations",
        min_iterations=6,
        calm_steps=3,
        max_step=0.5,
        tolerance=0.02,
    )
    found = minimize(Problem(far, (rows,)), method=method)
    assert found.search.converged
    # Four steps of 0.5, then three that are short.
    assert found.search.steps == 6
    np.testing.assert_allclose(found.x, [2.0], atol=1e-9)


def test_values_of_a_block_stay_within_what_another_allows():
    first = block("first", [0.0])
    second = replace(
        block("second", [0.0]), limit=lambda at: np.minimum(at["second"], 1.0 - at["first"])
    )
    rows = tuple(
        Measured(name=name, blocks=(name,), function=lambda values, name=name: values[name] - 0.8)
        for name in ("first", "second")
    )
    found = minimize(Problem(Unknowns((first, second)), rows), method=Method(reweighted=True))
    assert found.search.converged
    np.testing.assert_allclose(found.x, [0.8, 0.2], atol=1e-9)


def test_priors_of_sums_hold_what_no_row_shows():
    unknowns = Unknowns((block("x", [0.0, 0.0]),))
    rows = Measured(name="first", blocks=("x",), function=lambda values: values["x"][:1] - 2.0)
    alike = LinearPrior(
        name="alike", blocks=("x",), rows=np.array([[1.0, -1.0]]), right=np.zeros(1)
    )
    found = minimize(Problem(unknowns, (rows, alike)), method=CLOSE)
    np.testing.assert_allclose(found.x, [2.0, 2.0], atol=1e-7)


def test_residuals_of_unknowns_that_nobody_declared_are_refused():
    with pytest.raises(UnknownName, match="clock"):
        Problem(
            Unknowns((block("x", [0.0]),)),
            (Measured(name="late", blocks=("clock",), function=lambda values: values["clock"]),),
        )


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"start": 2.0, "high": 1.0}, "starts at 2"),
        ({"sd": 0.0}, "None for no prior"),
        ({"scale": -1.0}, "scale"),
    ],
)
def test_unknowns_that_cannot_be_are_refused(changed, match):
    with pytest.raises(BadData, match=match):
        replace(Unknown(name="length"), **changed)


@pytest.mark.parametrize("seed", range(4))
def test_directions_with_a_large_sd_stay_where_they_are(seed):
    """The others have the values of a search within their plane alone."""
    random = np.random.default_rng(seed)
    directions = np.linalg.qr(random.normal(size=(3, 3)))[0]
    rows = np.diag([10.0, 5.0, 0.5]) @ directions.T
    scale = np.array([1.0, 0.1, 3.0])
    start = random.normal(size=3)
    right = random.normal(size=3)
    unknowns = tuple(
        Unknown(name=f"x {i}", start=value, scale=size)
        for i, (value, size) in enumerate(zip(start, scale, strict=True))
    )
    measured = Measured(
        name="rows",
        blocks=("x",),
        function=lambda values: rows @ (values["x"] / scale) - right,
        slopes=lambda values: {"x": rows / scale},
    )
    problem = Problem(Unknowns((Block(name="x", unknowns=unknowns),)), (measured,))
    found = minimize(problem, method=Method(tolerance=1e-12, min_gain=0.0, hidden_sd=1.0))
    moved = directions.T @ ((found.x - start) / scale)
    expected = right / [10.0, 5.0, 0.5] - directions.T @ (start / scale)
    assert found.search.converged
    assert moved[2] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(moved[:2], expected[:2], atol=1e-9)
