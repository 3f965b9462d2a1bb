"""The whole identification: forces, motion and the shape of a body in, a model of that body out, [D] 3.2.1."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from myomorph.identify.base import BaseFit, BaseOptions, fit_base
from myomorph.identify.base_parameters import BaseParameters, base_parameters, held_in
from myomorph.identify.body.points import MassPoints
from myomorph.identify.determined import Determined, determined
from myomorph.identify.least_squares import Recording, correlation_times
from myomorph.identify.mass_points import MassPointFit, MassPointOptions, solve_mass_points
from myomorph.identify.motion_noise import MotionNoise, motion_noise
from myomorph.identify.parts import Parts, parts_of
from myomorph.identify.pseudo_inertia import (
    PseudoInertiaFit,
    PseudoInertiaOptions,
    possible_reference,
    solve_pseudo_inertia,
)
from myomorph.identify.recordings import RecordingOptions, Usable, all_left_out, check_excited
from myomorph.identify.soft_tissue import Fitted, Use, with_soft_tissue
from myomorph.identify.unseen import Paper, Strength, Unseen, thinned, unseen_parts
from myomorph.identify.validation import Consistency, Inside, consistency
from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.errors import BadData
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.inertia import PARAMETERS, inertial_parameters, with_inertial_parameters
from myomorph.model.model import Model
from myomorph.model.soft_tissue import SoftTissue

GENERIC, SHAPE, CONIC = "generic, scaled", "shape only", "identified, pseudo-inertia"
MAX_MASS_CHANGE, MIN_MASS_SHARE = 0.6, 0.003
"""Change of a link's mass, of itself, that is reported; and the share of the body under which a link does not count."""


@dataclass(frozen=True)
class IdentificationOptions:
    """Options of identification.

    Attributes
    ----------
    method : "points" for masses of points, "pseudo-inertia" for possible parameters without points
    mass_sd : relative standard deviation of a link's mass before anything is measured, which says how
        much the data may change the shape's masses; by default what predicts unseen parts of the recordings best
    prior : "relative" weighs data by their noise and each link's mass by `mass_sd`; "paper" is [D]'s own setting,
        `weight_phi` and `weight_rho` in its units, for masses of points
    weight_phi, weight_rho : of base parameters and of points' masses with prior "paper": W_phi, W_rho of [D] eq. 3.10
    point_floor : least mass of a point with prior "paper", as a share of the mean; [D] asks for more than 0
    keep_mass : with prior "paper", whether the whole mass is kept exactly, which [D] does not ask for
    compare : also solve by the other method and the other weight maps, for the tables
    motion_sd : standard deviation of the noise that the filter leaves in a coordinate, which intervals carry
        [rad or m]; 0 for a motion without noise. By default that of markers with 2 mm of noise
    if_worse : masses of the model where identified ones predict recordings that were not used worse than the generic
        model's do: "generic" keeps those, "identified" takes the identified ones all the same and warns
    soft_tissue : whether markers move more than the body's mass: "auto" where that predicts unseen parts of the
        recordings better, "always" or "never"; never with prior "paper"
    """

    method: Literal["points", "pseudo-inertia"] = "points"
    mass_sd: float | None = None
    prior: Literal["relative", "paper"] = "relative"
    weight_phi: float = 1.0
    weight_rho: float = 1.0
    point_floor: float = 1e-3
    keep_mass: bool = True
    compare: bool = True
    motion_sd: float = 0.002
    if_worse: Literal["generic", "identified"] = "generic"
    soft_tissue: Use = "auto"

    def __post_init__(self) -> None:
        if self.mass_sd is not None and not self.mass_sd > 0.0:
            raise BadData(f"mass_sd is {self.mass_sd:g}: expected above 0")
        if self.prior not in ("relative", "paper"):
            raise BadData(f"prior is '{self.prior}': expected 'relative' or 'paper'")
        weighed = (self.weight_phi, self.weight_rho, self.point_floor, self.keep_mass)
        if self.prior != "paper" and weighed != (1.0, 1.0, 1e-3, True):
            raise BadData("weight_phi, weight_rho, point_floor and keep_mass are of prior 'paper': give it with them")
        if self.prior == "paper" and (self.method != "points" or self.mass_sd is not None):
            raise BadData("prior 'paper' is of mass points and has no mass_sd: give it with method 'points' alone")
        if not 0.0 <= self.motion_sd < 0.2:
            raise BadData(f"motion_sd is {self.motion_sd:g}: expected radians and metres, 0 to below 0.2")
        if self.if_worse not in ("generic", "identified"):
            raise BadData(f"if_worse is '{self.if_worse}': expected 'generic' or 'identified'")
        if self.soft_tissue not in ("auto", "always", "never"):
            raise BadData(f"soft_tissue is '{self.soft_tissue}': expected 'auto', 'always' or 'never'")


@read_only
class Identification:
    """A model of one body, and how far to trust it.

    Attributes
    ----------
    model : with the identified inertial parameters
    chosen : name among `parameters` of those that the model has
    identified : name of those that were identified, which the model has unless they predict unseen motion worse
    parameters : (bodies, 10) by name: each way of identifying, the shape alone, the generic model at its mass
    residuals : (2,) root mean square of the base wrench's misfit of each in the frames used, moment [N m] and force [N]
    unseen : the same of identified and generic masses on what was not used: recordings given apart, else each
        recording or part in turn, with the strength of the prior chosen without it
    tried : relative standard deviation of the prior -> held-out misfit (2,)
    mass_sd : the one that was used
    noise : (2,) misfit that a moment and a force are taken to have without any fault of the masses [N m], [N]
    base : the base parameters, with what the data say of each
    points : the mass points of the chosen way
    known : which parameters the data determine, and how far each may be off
    consistency : of every link, for each way
    recordings : what was used of each, and why not more
    soft_tissue : that was taken from the motion before masses were fitted, which the masses are for; None for none
    notes : what looks wrong, one line each
    """

    model: Model
    chosen: str
    identified: str
    parameters: Mapping[str, Array]
    residuals: Mapping[str, Array]
    unseen: Unseen
    tried: Mapping[float, Array]
    mass_sd: float
    noise: Array
    base: BaseFit
    points: MassPoints
    known: Determined
    consistency: Mapping[str, Consistency]
    recordings: tuple[Usable, ...]
    soft_tissue: SoftTissue | None = None
    notes: tuple[str, ...] = field(default=())

    @property
    def from_shape(self) -> Mapping[str, tuple[str, ...]]:
        """Body -> its parameters that the data do not determine, so that they come from the shape of the body."""
        return FrozenMap(
            {
                name: tuple(PARAMETERS[j] for j in np.flatnonzero(~row))
                for name, row in zip(self.model.body_names, self.known.data, strict=True)
                if not row.all()
            }
        )

    @property
    def sd(self) -> Array:
        """(bodies, 10) standard deviation of the error of the model's parameters [kg, kg m, kg m^2]."""
        return self.known.sd if self.chosen == self.identified else self.known.prior_sd

    @property
    def from_data(self) -> np.ndarray:
        """(bodies, 10) which of the model's parameters the data determine."""
        return self.known.data & (self.chosen == self.identified)

    @property
    def link_shares(self) -> Array:
        """(bodies,) how much of what is known of each link comes from the data rather than from the shape, 0 to 1."""
        return np.asarray(self.known.shares.mean(axis=1))

    @property
    def masses(self) -> Mapping[str, Array]:
        """(bodies,) masses by the name of the way that gives them [kg]."""
        return {name: table[:, 0] for name, table in self.parameters.items()}

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
    unseen: Sequence[Usable] = (),
    advance: Callable[[int], None] = lambda done: None,
) -> Identification:
    """Inertial parameters of every link that explain the measured forces and that a body can have.

    Noise of moments and forces is at first the misfit of the scaled model, then what the fit leaves of parts of the
    recordings that it did not see, as long as that falls: the residual of the fit itself would be too small, since
    faults of kinematics do not shrink with more frames. The same parts choose how far the data may move the
    masses away from the shape (`mass_sd`).

    Before that, each recording, or each part of a single one, is predicted by masses identified without it. Where
    these predict worse than the generic model, the generic masses are kept (`if_worse`) and the first note says so.

    Where markers move more than the body's mass, coordinates are filtered by 1 / (1 + alpha w^2) before accelerations
    count, if that predicts unseen parts better (`soft_tissue`): masses then explain forces that soft tissue does not.

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
    unseen : recordings that masses are not identified from; where given, they alone decide whether identified
        masses predict worse than the generic model
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
    >>> model, time = mm.read_model("arm.osim"), np.arange(0.0, 2.0, 0.01)
    >>> angles = np.column_stack([np.sin(3.0 * time), 1.0 + 0.8 * np.sin(5.0 * time)])
    >>> motion = mm.Motion(time, model.coordinate_names, angles)
    >>> at = mm.joint_reactions(model, mm.differentiate(motion), None, joints=["shoulder"], frame="ground")
    >>> wrenches = mm.Wrenches(time, ("shoulder",), ("upper",), at.forces, at.points, at.moments)
    >>> points, _, _ = mm.body_points(model, mm.BodyShape(), model.mass, mm.BodyOptions(spacing=0.05))
    >>> options = mm.IdentificationOptions(compare=False)
    >>> found = mm.identify(model, [mm.usable(model, motion, wrenches)], points, options=options)
    >>> [round(float(body.mass), 1) for body in found.model.bodies]
    [2.0, 2.0]
    """
    options = options or IdentificationOptions()
    mass = model.mass if mass is None else mass
    if not points:
        raise BadData("identification needs mass points: give those of at least one weight map")
    check_excited(model, tuple(recordings), recording)
    used = [values.recording for values in recordings]
    generic = with_inertial_parameters(model, inertial_parameters(model) * (mass / model.mass))
    base = base_parameters(model, held=held_in(model, [values.motion for values in used]))
    markers = parts_of(generic, used, base)
    first = next(iter(points))
    few = thinned(points[first])
    paper = None
    if options.prior == "paper":
        weights = MassPointOptions(
            "paper", W_phi=options.weight_phi, W_rho=options.weight_rho, floor=options.point_floor
        )
        paper = Paper(generic, weights, mass if options.keep_mass else None)
    strength = Strength(few, inertial_parameters(generic), options.method, options.mass_sd, paper)
    fitted = Fitted(tuple(used), markers, None, strength.choose(markers))
    cutoff = recording.cutoff if recording else None
    if paper is None:
        fitted = with_soft_tissue(generic, fitted, strength, options.soft_tissue)
    parts, (noise, tried, best) = fitted.parts, fitted.choice
    moved = None
    if options.motion_sd and paper is None:
        moved = motion_noise(generic, fitted.recordings, parts, options.motion_sd, cutoff)
        # What parts that were not fitted leave is as much as noise can have made.
        moved = moved.at_most(tried[best], strength.fit(parts, noise, best))
        parts = moved.corrected
        noise, tried, best = strength.choose(parts)
    rows = parts.rows(noise)
    solved = _solved(points, rows, mass, best, options, advance)
    if paper is not None:
        solved[f"identified, {first}"] = paper.solve(points[first], parts, noise)
    shape = points[first].parameters(points[first].reference)
    identified = f"identified, {first}" if options.method == "points" else CONIC
    parameters = {name: solved[name].parameters for name in dict.fromkeys((identified, *solved))}
    parameters |= {SHAPE: shape, GENERIC: inertial_parameters(generic)}
    if unseen:
        judged = _on_other_recordings(
            generic, unseen, base, (parameters[identified], parameters[GENERIC]), fitted.tissue
        )
    else:
        judged = unseen_parts(parts, strength, tuple(values.name for values in recordings), markers)
    chosen = GENERIC if judged.worse and options.if_worse == "generic" else identified
    floor, names = tried[best], model.body_names
    noises = BaseOptions(moment_noise=floor[0] / np.sqrt(3.0), force_noise=floor[1] / np.sqrt(3.0))
    fit = fit_base(generic, fitted.recordings, base, noises)
    left = [_used(values, generic, parameters[identified]) for values in fitted.recordings]
    # Frames that make one independent sample, beyond those that count as one already.
    samples = max(1.0, float(np.mean(correlation_times(left))) / parts.alike)
    return Identification(
        model=with_inertial_parameters(model, parameters[chosen]),
        chosen=chosen,
        identified=identified,
        parameters=FrozenMap({name: frozen_array(values) for name, values in parameters.items()}),
        residuals=FrozenMap(
            {name: (markers if name == GENERIC else parts).rms(masses) for name, masses in parameters.items()}
        ),
        unseen=judged,
        tried=FrozenMap(tried),
        mass_sd=best,
        noise=noise,
        base=fit,
        points=points[first],
        known=_known(few, parts, moved, parameters[identified], (noise, mass, best), samples),
        consistency=FrozenMap(
            {
                name: consistency(names, masses, inside=inside, points=points[first])
                for name, masses in parameters.items()
            }
        ),
        recordings=tuple(recordings),
        soft_tissue=fitted.tissue if chosen == identified else None,
        notes=(
            *_verdict(judged, chosen == identified),
            *(f"{name}: not proven to be the optimum" for name, solution in solved.items() if not solution.converged),
            *_far_from_shape(model, parameters[chosen][:, 0], shape[:, 0], best),
            *(note for recording in recordings for note in recording.notes),
        ),
    )


def _used(recording: Recording, model: Model, parameters: Array) -> Array:
    """(frames, 6) what parameters leave of a recording's wrench, NaN where it is not used."""
    left = recording.missing(model, parameters)
    if recording.use is not None:
        left[~recording.use] = np.nan
    return left


def _known(
    points: MassPoints,
    parts: Parts,
    moved: MotionNoise | None,
    parameters: Array,
    fitted: tuple[Array, float, float],
    samples: float,
) -> Determined:
    """What the data determine: noise of the motion apart from what else is left of the misfit.
    `fitted`: noise of moments and forces (2,), mass of the body [kg], strength of the prior; `samples`: frames that
    make one independent sample.
    """
    noise, mass, mass_sd = fitted
    rows, _ = parts.rows(noise)
    if moved is None:
        return determined(points, rows, mass, mass_sd, samples)
    left = np.sqrt(np.clip(1.0 - np.square(moved.misfit(parameters) / noise), 0.0, 1.0))
    forces, _ = moved.parts.rows(noise / np.maximum(left, 1e-9))
    return determined(points, rows, mass, mass_sd, samples, forces, moved.scores(noise, parameters))


def _on_other_recordings(
    model: Model,
    recordings: Sequence[Usable],
    base: BaseParameters,
    masses: tuple[Array, Array],
    tissue: SoftTissue | None,
) -> Unseen:
    """Misfit of both on recordings that took no part: identified masses with soft tissue, the generic ones without."""
    used = [recording for recording in recordings if recording.use.any()]
    markers = [parts_of(model, [values.recording], base, least=1) for values in used]
    parts = markers
    if tissue is not None:
        softened = [values.recording.moved(tissue.of) for values in used]
        parts = [parts_of(model, [values], base, least=1) for values in softened]
    return Unseen(
        np.reshape([part.rms(masses[0]) for part in parts], (-1, 2)),
        np.reshape([part.rms(masses[1]) for part in markers], (-1, 2)),
        np.array([part.frames.sum() for part in parts], int),
        "recordings that were not used",
        tuple(values.name for values in used),
    )


def _verdict(unseen: Unseen, taken: bool) -> tuple[str, ...]:
    """A line where identified masses do not predict what was not used, first of all notes."""
    if not len(unseen.frames):
        return ("the recording is too short to hold parts of it out: whether the masses predict anything is unknown",)
    where = f"on {unseen.what}: {unseen.words}"
    cause = "the motion is too short or too uniform, or forces and motion do not belong together"
    if unseen.worse and taken:
        return (f"identified masses predict no better than the generic model {where}; {cause}; taken all the same",)
    if unseen.worse:
        return (
            f"the generic model's masses are kept, identified ones predict no better than the generic model {where}; "
            f'{cause}; if_worse = "identified" takes them',
        )
    if not unseen.losses:
        return ()
    return (f"identified masses predict worse than the generic model in the {', the '.join(unseen.losses[:3])}",)


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
    for name, point in points.items():
        if options.compare or (name == first and options.method == "points"):
            solved[f"identified, {name}"] = solve_mass_points(
                point, *rows, mass=mass, options=MassPointOptions(mass_sd=mass_sd)
            )
            advance(1)
    if options.compare or options.method == "pseudo-inertia":
        shape = possible_reference(points[first].parameters(points[first].reference))
        solved[CONIC] = solve_pseudo_inertia(*rows, shape, mass=mass, options=PseudoInertiaOptions(mass_sd=mass_sd))
        advance(1)
    return solved


def _far_from_shape(model: Model, masses: Array, shape: Array, mass_sd: float) -> tuple[str, ...]:
    """Which links got a mass that is hard to believe, and the motion that would show it, as one line."""
    names = model.body_names
    far = np.flatnonzero((shape > MIN_MASS_SHARE * shape.sum()) & (np.abs(masses - shape) > MAX_MASS_CHANGE * shape))
    if not len(far):
        return ()
    turned = {joint.child: joint.coordinates for joint in model.joints}
    worst = far[np.argsort(-np.abs(masses - shape)[far])][:3]
    listed = ", ".join(
        f"'{names[i]}' {masses[i]:.2f} kg (shape {shape[i]:.2f}; record "
        f"{', '.join(turned.get(names[i], ())) or 'its joint'} moving fast while other joints rest)"
        for i in worst
    )
    return (
        f"{len(far)} of {len(names)} links weigh far from what their shape says: {listed}; faults of the motion that "
        f"return with every step may be in them: record the movements named, or hold masses with a mass_sd below "
        f"{mass_sd:g}",
    )
