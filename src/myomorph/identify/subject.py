"""The whole identification: forces, motion and the shape of a body in, a model of that body out, [D] 3.2.1."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy import sparse

from myomorph.identify.base import BaseFit, BaseOptions, fit_base
from myomorph.identify.base_parameters import base_parameters, held_in
from myomorph.identify.body.points import MassPoints, point_moments
from myomorph.identify.mass_points import MassPointFit, MassPointOptions, prior_variances, solve_mass_points
from myomorph.identify.pseudo_inertia import (
    PseudoInertiaFit,
    PseudoInertiaOptions,
    possible_reference,
    solve_pseudo_inertia,
)
from myomorph.identify.recordings import RecordingOptions, Usable, all_left_out, check_excited
from myomorph.identify.validation import Consistency, Inside, Parts, consistency, held_out, parts_of
from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.errors import BadData
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.inertia import PARAMETERS, inertial_parameters, with_inertial_parameters
from myomorph.model.model import Model

GENERIC, SHAPE, CONIC = "generic, scaled", "shape only", "identified, pseudo-inertia"
STRENGTHS = (0.02, 0.05, 0.1, 0.2, 0.5)
"""Relative standard deviations of a link's mass to choose from where none is given.

Looser ones predict more of the same motion and give masses that nobody has: faults of kinematics that come back
every step are then blamed on hands and forearms.
"""

POINTS_PER_LINK = 60
"""Points a link that stand for all of them while strengths are tried."""

MAX_MASS_CHANGE, MIN_MASS_SHARE = 0.6, 0.003
"""Change of a link's mass, of itself, that is reported; and the share of the body under which a link does not count."""

ROUNDS = 5
"""Times that the noise is taken anew from what the fit leaves of unseen parts."""

IDENTIFIABLE = 0.5
"""Share of a parameter's prior variance that the data must take away to count as shown by them."""


@dataclass(frozen=True)
class IdentificationOptions:
    """Options of identification.

    Attributes
    ----------
    method : "points" for masses of points, "pseudo-inertia" for possible parameters without points
    mass_sd : relative standard deviation of a link's mass before anything is measured, which says how
        much the data may change the shape's masses; by default what predicts unseen parts of the recordings best
    compare : also solve by the other method and the other weight maps, for the tables
    """

    method: Literal["points", "pseudo-inertia"] = "points"
    mass_sd: float | None = None
    compare: bool = True

    def __post_init__(self) -> None:
        if self.mass_sd is not None and not self.mass_sd > 0.0:
            raise BadData(f"mass_sd is {self.mass_sd:g}: expected above 0")


@read_only
@dataclass(frozen=True, eq=False)
class Identification:
    """A model of one body, and how far to trust it.

    Attributes
    ----------
    model : with the identified inertial parameters
    chosen : name among `parameters` of those that the model has
    parameters : (bodies, 10) by name: each way of identifying, the shape alone, the generic model at its mass
    residuals : (2,) root mean square of the base wrench's misfit of each in the frames used, moment [N m]
        and force [N]
    held_out : (2,) the same of the chosen way in parts of the recordings that it was not fitted to
    tried : relative standard deviation of the prior -> held-out misfit (2,)
    mass_sd : the one that was used
    noise : (2,) misfit that a moment and a force are taken to have without any fault of the masses [N m], [N]
    base : the base parameters, with what the data say of each
    points : the mass points of the chosen way
    shares : (bodies, 10) share of what was not known before that the data told, of each parameter, 0..1;
        what is below `IDENTIFIABLE` comes from the shape of the body
    consistency : of every link, for each way
    recordings : what was used of each, and why not more
    notes : what looks wrong, one line each
    """

    model: Model
    chosen: str
    parameters: Mapping[str, Array]
    residuals: Mapping[str, Array]
    held_out: Array
    tried: Mapping[float, Array]
    mass_sd: float
    noise: Array
    base: BaseFit
    points: MassPoints
    shares: Array
    consistency: Mapping[str, Consistency]
    recordings: tuple[Usable, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def from_shape(self) -> Mapping[str, tuple[str, ...]]:
        """Body -> its parameters that the data do not show, so that they come from the shape of the body."""
        return FrozenMap(
            {
                name: tuple(PARAMETERS[j] for j in np.flatnonzero(row < IDENTIFIABLE))
                for name, row in zip(self.model.body_names, self.shares, strict=True)
                if (row < IDENTIFIABLE).any()
            }
        )

    @property
    def left_out(self) -> Mapping[str, int]:
        """Reason -> frames of all recordings left out for it."""
        return FrozenMap(dict(all_left_out(self.recordings)))


def identify(
    model: Model,
    recordings: Sequence[Usable],
    points: Mapping[str, MassPoints],
    *,
    mass: float | None = None,
    inside: Inside | None = None,
    options: IdentificationOptions | None = None,
    recording: RecordingOptions | None = None,
    advance: Callable[[int], None] = lambda done: None,
) -> Identification:
    """Inertial parameters of every link that explain the measured forces and that a body can have.

    Noise of moments and forces is at first the misfit of the scaled model, then what the fit leaves of parts of the
    recordings that it did not see, as long as that falls: the residual of the fit itself would be too small, since
    faults of kinematics do not shrink with more frames. The same parts choose how far the data may move the
    masses away from the shape (`mass_sd`).

    Source: [D], chapter 3; Ayusawa, Venture and Nakamura 2014; Lee, Wensing and Park 2020; see docs/identification.md.

    Parameters
    ----------
    model : scaled to the body; its inertial parameters are the generic ones
    recordings : of `recordings.usable`
    points : mass points of the body by the name of their weight map, the one to use first
    mass : of the whole body, kept exactly [kg]; the model's by default
    inside : tells whether points are inside the skin, in the pose of the mass points
    options : method, noise and how far masses may move; see `IdentificationOptions`
    recording : as the recordings were made usable; tells the least time that is asked of them
    advance : called with the number of ways solved, as they are

    Returns
    -------
    the model with the parameters found, all alternatives beside them, residuals of moments [N m] and forces [N], and
    what of each link the data showed

    Raises
    ------
    BadData : too little can be used, or nothing moves

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> from myomorph.identify.recordings import usable
    >>> from myomorph.identify.subject import IdentificationOptions
    >>> from myomorph.study.subject.body_points import body_points
    >>> from myomorph.study.subject.subject_files import BodyOptions, BodyShape
    >>> model, time = mm.read_model("arm.osim"), np.arange(0.0, 2.0, 0.01)
    >>> angles = np.column_stack([np.sin(3.0 * time), 1.0 + 0.8 * np.sin(5.0 * time)])
    >>> motion = mm.Motion(time, model.coordinate_names, angles)
    >>> at = mm.joint_reactions(model, mm.differentiate(motion), None, joints=["shoulder"], frame="ground")
    >>> wrenches = mm.Wrenches(time, ("shoulder",), ("upper",), at.forces, at.points, at.moments)
    >>> points, _, _ = body_points(model, BodyShape(), model.mass, BodyOptions(spacing=0.05))
    >>> options = IdentificationOptions(compare=False)
    >>> found = mm.identify(model, [usable(model, motion, wrenches)], points, options=options)
    >>> [round(float(body.mass), 1) for body in found.model.bodies]
    [2.0, 2.0]
    """
    options = options or IdentificationOptions()
    mass = model.mass if mass is None else mass
    if not points:
        raise BadData("identification needs mass points: give those of at least one weight map")
    check_excited(model, tuple(recordings), recording)
    used = [one.recording for one in recordings]
    generic = with_inertial_parameters(model, inertial_parameters(model) * (mass / model.mass))
    base = base_parameters(model, held=held_in(model, [one.motion for one in used]))
    parts = parts_of(generic, used, base)
    first = next(iter(points))
    noise, tried, best = _noise_and_strength(parts, points[first], inertial_parameters(generic), options)
    rows = parts.rows(noise)
    solved = _solved(points, rows, mass, best, options, advance)
    shape = points[first].parameters(points[first].reference)
    chosen = f"identified, {first}" if options.method == "points" else CONIC
    found = {name: solved[name].parameters for name in dict.fromkeys((chosen, *solved))}
    found |= {SHAPE: shape, GENERIC: inertial_parameters(generic)}
    floor, names = tried[best], model.body_names
    return Identification(
        model=with_inertial_parameters(model, found[chosen]),
        chosen=chosen,
        parameters=FrozenMap({name: frozen_array(one) for name, one in found.items()}),
        residuals=FrozenMap({name: parts.rms(one) for name, one in found.items()}),
        held_out=floor,
        tried=FrozenMap(tried),
        mass_sd=best,
        noise=noise,
        base=fit_base(
            generic, used, base, BaseOptions(moment_noise=floor[0] / np.sqrt(3.0), force_noise=floor[1] / np.sqrt(3.0))
        ),
        points=points[first],
        shares=shares_of_data(_thinned(points[first]), rows[0], mass, best),
        consistency=FrozenMap(
            {name: consistency(names, one, inside=inside, points=points[first]) for name, one in found.items()}
        ),
        recordings=tuple(recordings),
        notes=(
            *(f"{name}: not proven to be the optimum" for name, one in solved.items() if not one.converged),
            *_far_from_shape(names, found[chosen][:, 0], shape[:, 0], best),
            *_no_gain(floor, parts.rms(found[GENERIC])),
            *(note for one in recordings for note in one.notes),
        ),
    )


def _solved(
    points: Mapping[str, MassPoints],
    rows: tuple[Array, Array],
    mass: float,
    mass_sd: float,
    options: IdentificationOptions,
    advance: Callable[[int], None],
) -> dict[str, MassPointFit | PseudoInertiaFit]:
    """The way asked for, and to compare the others, fitted to rows A x = b of unit noise; by name."""
    first = next(iter(points))
    solved: dict[str, MassPointFit | PseudoInertiaFit] = {}
    for name, one in points.items():
        if options.compare or (name == first and options.method == "points"):
            solved[f"identified, {name}"] = solve_mass_points(
                one, *rows, mass=mass, options=MassPointOptions(mass_sd=mass_sd)
            )
            advance(1)
    if options.compare or options.method == "pseudo-inertia":
        shape = possible_reference(points[first].parameters(points[first].reference))
        solved[CONIC] = solve_pseudo_inertia(*rows, shape, mass=mass, options=PseudoInertiaOptions(mass_sd=mass_sd))
        advance(1)
    return solved


def _no_gain(held_out: Array, generic: Array) -> tuple[str, ...]:
    """A line where what was identified from parts of the recordings explains the others no better than before."""
    if float(np.mean(np.square(held_out / generic))) < 1.0:
        return ()
    return (
        f"masses identified from parts of the recordings explain the others no better than the generic model "
        f"({held_out[1]:.1f} N, {held_out[0]:.1f} N m against {generic[1]:.1f} N, {generic[0]:.1f} N m): the motion is "
        "too short or too uniform, or forces and motion do not belong together",
    )


def _far_from_shape(names: Sequence[str], masses: Array, shape: Array, mass_sd: float) -> tuple[str, ...]:
    """Which links got a mass that is hard to believe, as one line."""
    far = np.flatnonzero((shape > MIN_MASS_SHARE * shape.sum()) & (np.abs(masses - shape) > MAX_MASS_CHANGE * shape))
    if not len(far):
        return ()
    worst = far[np.argsort(-np.abs(masses - shape)[far])][:3]
    listed = ", ".join(f"'{names[i]}' {masses[i]:.2f} kg (shape {shape[i]:.2f})" for i in worst)
    return (
        f"{len(far)} of {len(names)} links weigh far from what their shape says: {listed}; faults of the motion that "
        f"return with every step may be in them: move more, or hold masses with a mass_sd below {mass_sd:g}",
    )


def _noise_and_strength(
    parts: Parts, points: MassPoints, generic: Array, options: IdentificationOptions
) -> tuple[Array, dict[float, Array], float]:
    """Noise (2,) of moments and forces, held-out misfit by strength of the prior with it, and the strength to use."""
    noise = parts.rms(generic)
    tried, best = _tried(parts, noise, points, generic, options)
    for _ in range(ROUNDS):
        better = float(np.sqrt(np.mean(np.square(tried[best] / noise))))
        if better > 0.8:
            break
        noise = noise * better
        tried, best = _tried(parts, noise, points, generic, options)
    return noise, tried, best


def _tried(
    parts: Parts, noise: Array, points: MassPoints, generic: Array, options: IdentificationOptions
) -> tuple[dict[float, Array], float]:
    """Held-out misfit by strength of the prior, with few points that stand for all, and the strength with the least."""
    few, mass = _thinned(points), float(generic[:, 0].sum())
    shape = possible_reference(few.parameters(few.reference))

    def fit_with(sd: float) -> Callable[[Sequence[int]], Array]:
        def fit(others: Sequence[int]) -> Array:
            A, b = parts.rows(noise, others)
            if options.method == "points":
                return solve_mass_points(few, A, b, mass=mass, options=MassPointOptions(mass_sd=sd)).parameters
            return solve_pseudo_inertia(A, b, shape, mass=mass, options=PseudoInertiaOptions(mass_sd=sd)).parameters

        return fit

    before = held_out(parts, lambda _: generic)
    found: dict[float, Array] = {}

    def score(sd: float) -> float:
        if sd not in found:
            found[sd] = held_out(parts, fit_with(sd))
        # Every part counts alike, as its misfit relative to the scaled model's.
        return float((found[sd] / before).mean())

    if options.mass_sd is not None:
        best = options.mass_sd
        score(best)
    else:
        # The misfit falls, then rises with the strength: walk down from the middle.
        at = len(STRENGTHS) // 2
        step = 1 if score(STRENGTHS[at + 1]) < score(STRENGTHS[at]) else -1
        while 0 <= at + step < len(STRENGTHS) and score(STRENGTHS[at + step]) < score(STRENGTHS[at]):
            at += step
        best = STRENGTHS[at]
    weights = parts.frames / parts.frames.sum()
    return {sd: np.sqrt(weights @ found[sd]) for sd in sorted(found)}, best


def _thinned(points: MassPoints, most: int = POINTS_PER_LINK) -> MassPoints:
    """Fewer points with the same mass in every link, spread evenly over the given ones."""
    links = len(points.links.names)
    step = max(1, len(points.points) // (most * links))
    if step == 1:
        return points
    owner = np.asarray(points.weights.argmax(axis=1)).ravel()
    kept = []
    for link in range(links):
        own = np.flatnonzero(owner == link)
        if len(own):
            kept.append(own[np.linspace(0, len(own) - 1, min(len(own), most)).astype(int)])
    index = np.sort(np.concatenate(kept))
    mass = np.bincount(owner, points.reference, links)
    left = np.bincount(owner[index], points.reference[index], links)
    reference = points.reference[index] * (mass / np.maximum(left, 1e-300))[owner[index]]
    weights = sparse.csr_array(points.weights[index])
    return replace(points, points=points.points[index], reference=reference, weights=weights)


def shares_of_data(points: MassPoints, A: Array, mass: float, mass_sd: float) -> Array:
    """(links, 10) share of each parameter's variance before the measurement that the measurement takes away.

    Masses of points are taken as normal with the variances of the mass-point problem, with their sum known;
    1 - var(phi_j | data) / var(phi_j), 0 where a link has no mass.
    """
    links = len(points.links.names)
    variances = prior_variances(points, MassPointOptions(mass_sd=mass_sd))
    moments = point_moments(points.points)
    # Parameters of unit masses times the points' standard deviations.
    columns = np.empty((links, 10, len(moments)))
    for i in range(links):
        columns[i] = (points.places[i] @ moments.T) * (points.weights[:, [i]].toarray().ravel() * np.sqrt(variances))
    flat = columns.reshape(10 * links, -1)
    covariance = flat @ flat.T
    known = np.zeros((1, 10 * links))
    known[0, ::10] = 1.0 / (1e-6 * mass)
    prior = _conditioned(covariance, known)
    posterior = _conditioned(prior, A)
    before, after = np.diag(prior), np.diag(posterior)
    result: Array = 1.0 - np.divide(after, before, out=np.ones_like(before), where=before > 1e-12 * np.diag(covariance))
    return np.clip(result, 0.0, 1.0).reshape(links, 10)


def _conditioned(covariance: Array, rows: Array) -> Array:
    """Covariance after measuring `rows` x with unit noise."""
    crossed = rows @ covariance
    return covariance - crossed.T @ np.linalg.solve(crossed @ rows.T + np.eye(len(rows)), crossed)
