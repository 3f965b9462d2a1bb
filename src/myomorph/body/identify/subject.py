"""The whole identification, [D] 3.2.1.

Forces, motion and the shape of a body in, a model of that body out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Literal

import numpy as np

from myomorph.body.causes import HELD_OUT, MASSES, SEARCH
from myomorph.body.identify.base import BaseFit, BaseOptions, fit_base
from myomorph.body.identify.base_parameters import base_parameters, held_in
from myomorph.body.identify.determined import Determined, MeasuredRows, determined
from myomorph.body.identify.estimate import mass_problem
from myomorph.body.identify.fitted import Fitted
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.link_prior import prior_covariance
from myomorph.body.identify.mass_points import MassPointFit, MassPointOptions, solve_mass_points
from myomorph.body.identify.motion_noise import MOTION_SD, MotionNoise, motion_noise, with_noise
from myomorph.body.identify.parts import Parts, parts_of
from myomorph.body.identify.pseudo_inertia import (
    PseudoInertiaFit,
    PseudoInertiaOptions,
    possible_reference,
    solve_pseudo_inertia,
)
from myomorph.body.identify.recordings import RecordingOptions, Usable, all_left_out, check_excited
from myomorph.body.identify.shown_masses import (
    Evidence,
    HeldMasses,
    mass_evidence,
    shown_masses,
)
from myomorph.body.identify.sides import SIDE_SD, Sides, sides_of
from myomorph.body.identify.skin_errors import SKIN_SD, skin_errors
from myomorph.body.identify.soft_tissue import Use, with_soft_tissue
from myomorph.body.identify.tissue_evidence import TissueEvidence
from myomorph.body.identify.unseen import (
    KINDS,
    ChosenPrior,
    Paper,
    Strength,
    thinned,
    unseen_parts,
)
from myomorph.body.identify.validation import Consistency, Inside, consistency
from myomorph.body.shape.points import MassPoints
from myomorph.core.fit.correlation import correlation_times
from myomorph.core.fit.estimation import Estimate, estimate_of
from myomorph.core.fit.interval_rule import LEVEL, half_width
from myomorph.core.fit.solver import CONVERGED, NO_LOWER, Search, Solution
from myomorph.core.fit.verdict import Verdict
from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import PARAMETERS, inertial_parameters, with_inertial_parameters
from myomorph.core.model.interval import Interval
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.soft_tissue import SoftTissue

GENERIC = "generic, scaled"
SHAPE = "shape only"
CONIC = "identified, pseudo-inertia"
BY_POINTS = "identified, "
"""Names of ways to identify: of masses of points, the name of their weight map follows."""
MAX_MASS_CHANGE = 0.6
MIN_MASS_SHARE = 0.003
"""Change of a link's mass, of itself, that is reported; and the share of the body under which a
link does not count.
"""


WORDS: Mapping[str, tuple[str, ...]] = {
    "prior": ("relative", "paper"),
    "if_worse": ("generic", "identified"),
    "masses": ("shown", "expected"),
    "soft_tissue": ("auto", "always", "never"),
}
"""Options of identification that are one of some words."""


@dataclass(frozen=True)
class IdentificationOptions:
    """Options of identification.

    Attributes
    ----------
    method : parameters that are fitted; "points": the masses of a grid of points; "pseudo-inertia":
        physically consistent parameters without points
    mass_sd : relative standard deviation of a link's mass in the prior, which limits how much the
        data change the shape's masses; by default the one that predicts held-out parts of the
        recordings best
    prior : weights of data and prior; "relative": data by their noise, each link's mass by
        `mass_sd`; "paper": those of [D], `weight_phi` and `weight_rho` in its units, for points
    weight_phi, weight_rho : weights W_phi of base parameters and W_rho of point masses with prior
        "paper" ([D] eq. 3.10)
    point_floor : minimum mass of a point with prior "paper", relative to the mean; [D] requires a
        positive one
    keep_mass : with prior "paper", keep the body mass exactly, which [D] does not require
    compare : also solve by the other method and the other weight maps, for the tables
    motion_sd : standard deviation of the noise that the filter leaves in a coordinate, which widens
        intervals [rad or m]; 0 for a motion without noise; by default that of markers with 2 mm of
        noise
    skin_sd : root mean square error of the motion that recurs with every posture, from skin that
        moves with adjacent joints and from joint centers [m]; neither time nor held-out parts
        reveal it. It applies to models with markers
    side_sd : relative standard deviation of the difference between left and right bodies
    if_worse : masses of the model if the identified ones predict held-out recordings worse than the
        generic ones; "generic": the generic masses; "identified": the identified masses, with a
        warning
    masses : estimate of each link's mass; "shown": changed only as far as the data make a gain in
        accuracy nearly certain (`shown_masses`); "expected": as fitted, which is more accurate on
        average, but less where the prior mass was accurate by chance
    soft_tissue : model the motion of markers relative to the body's mass; "auto": if measured
        forces show it and held-out parts of the recordings are predicted better; "always" or
        "never"; never with prior "paper"
    """

    method: Literal["points", "pseudo-inertia"] = "points"
    mass_sd: float | None = None
    prior: Literal["relative", "paper"] = "relative"
    weight_phi: float = 1.0
    weight_rho: float = 1.0
    point_floor: float = 1e-3
    keep_mass: bool = True
    compare: bool = True
    motion_sd: float = MOTION_SD
    skin_sd: float = SKIN_SD
    side_sd: float = SIDE_SD
    if_worse: Literal["generic", "identified"] = "generic"
    masses: Literal["shown", "expected"] = "shown"
    soft_tissue: Use = "auto"

    def __post_init__(self) -> None:
        if self.mass_sd is not None and not self.mass_sd > 0.0:
            raise BadData(f"mass_sd is {self.mass_sd:g}: expected above 0")
        for name, words in WORDS.items():
            _check_word(name, getattr(self, name), words)
        weighed = (self.weight_phi, self.weight_rho, self.point_floor, self.keep_mass)
        if self.prior != "paper" and weighed != (1.0, 1.0, 1e-3, True):
            raise BadData(
                "weight_phi, weight_rho, point_floor and keep_mass are of prior 'paper': give it"
                " with them"
            )
        if self.prior == "paper" and (self.method != "points" or self.mass_sd is not None):
            raise BadData(
                "prior 'paper' is of mass points and has no mass_sd: give it with method 'points'"
                " alone"
            )
        if not 0.0 <= self.motion_sd < 0.2:
            raise BadData(
                f"motion_sd is {self.motion_sd:g}: expected radians and metres, 0 to below 0.2"
            )
        if not 0.0 <= self.skin_sd < 0.2:
            raise BadData(f"skin_sd is {self.skin_sd:g}: expected metres, 0 to below 0.2")
        if not self.side_sd > 0.0:
            raise BadData(f"side_sd is {self.side_sd:g}: expected above 0")


def _check_word(name: str, word: str, words: tuple[str, ...]) -> None:
    """Refuse a word that an option does not know.

    Raises
    ------
    BadData : it is none of the words
    """
    if word not in words:
        others = ", ".join(f"'{one}'" for one in words[:-1])
        raise BadData(f"{name} is '{word}': expected {others} or '{words[-1]}'")


@read_only
class Identification:
    """A model of one body, and how far to trust it.

    Attributes
    ----------
    model : with the identified inertial parameters
    chosen : name among `parameters` of those that the model has
    identified : name of those that were identified, which the model has unless they predict unseen
        motion worse
    parameters : (bodies, 10) by name: each way of identifying, the shape alone, the generic model
        at its mass
    residuals : (2,) root mean square of the base wrench's misfit of each in the frames used, moment
        [N m] and force [N]
    estimate : the expected parameters as unknowns "femur_r m", ... with their intervals. Its
        verdict is on what was not used: recordings given apart, else each recording or part in
        turn, with the strength of the prior chosen without it
    tried : relative standard deviation of the prior -> held-out misfit (2,)
    mass_sd : the one that was used
    noise : (2,) misfit that a moment and a force are taken to have without any fault of the masses
        [N m], [N]
    base : the base parameters, with what the data say of each
    points : the mass points of the chosen way
    known : which parameters the data determine, and how far each may be off
    consistency : of every link, for each way
    recordings : what was used of each, and why not more
    soft_tissue : that was taken from the motion before masses were fitted, which the masses are
        for; None for none
    tissue_evidence : what measured forces show of soft tissue; None where nobody asked
    notes : what looks wrong, one line each
    """

    model: Model
    chosen: str
    identified: str
    parameters: Mapping[str, Array]
    residuals: Mapping[str, Array]
    estimate: Estimate
    tried: Mapping[float, Array]
    mass_sd: float
    noise: Array
    base: BaseFit
    points: MassPoints
    known: Determined
    consistency: Mapping[str, Consistency]
    recordings: tuple[Usable, ...]
    soft_tissue: SoftTissue | None = None
    tissue_evidence: TissueEvidence | None = None
    notes: tuple[Message, ...] = field(default=())

    @property
    def unseen(self) -> Verdict:
        """Misfit of identified and generic masses on what was not used, moment and force."""
        verdict = self.estimate.verdict
        if verdict is None:
            return _verdict_on((), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, int))
        return verdict

    def mass_interval(self, body: str, level: float = LEVEL) -> Interval:
        """Find the interval that holds the mass of one of the model's bodies.

        Parameters
        ----------
        body : its name
        level : probability

        Returns
        -------
        mass and its limits [kg]
        """
        index = index_of("body", body, self.model.body_names)
        mass = float(self.model.bodies[index].mass)
        middle = float(self.expected[index, 0])
        half = float(half_width(self.sd[index, 0], level))
        low = max(middle - half, 0.0)
        return Interval(value=mass, low=min(low, mass), high=max(middle + half, mass))

    @property
    def expected(self) -> Array:
        """(bodies, 10) parameters in the middle of their intervals [kg, kg m, kg m^2]."""
        if self.chosen != self.identified:
            return self.parameters[self.chosen]
        return self.known.posterior.x.reshape(-1, 10)

    @property
    def mass_evidence(self) -> Mapping[str, Evidence]:
        """Body to whether the data show that its mass is another one than its shape's."""
        before = self.parameters[SHAPE][:, 0]
        found = mass_evidence(before, self.expected[:, 0], self.sd[:, 0])
        return FrozenMap(dict(zip(self.model.body_names, found, strict=True)))

    @property
    def from_shape(self) -> Mapping[str, tuple[str, ...]]:
        """Body to its parameters that the data do not determine, but the body's shape."""
        return FrozenMap(
            {
                name: tuple(PARAMETERS[j] for j in np.flatnonzero(~row))
                for name, row in zip(self.model.body_names, self.known.data, strict=True)
                if not row.all()
            }
        )

    @property
    def sd(self) -> Array:
        """(bodies, 10) standard deviation of the expected parameters [kg, kg m, kg m^2]."""
        return self.known.sd if self.chosen == self.identified else self.known.prior_sd

    @property
    def model_error(self) -> Array:
        """(bodies, 10) root mean square error of the model's parameters, beside the expected ones.

        [kg, kg m, kg m^2]
        """
        return np.hypot(self.sd, self.parameters[self.chosen] - self.expected)

    @property
    def from_data(self) -> np.ndarray:
        """(bodies, 10) which of the model's parameters the data determine."""
        return self.known.data & (self.chosen == self.identified)

    @property
    def link_shares(self) -> Array:
        """(bodies,) share of what is known of each link that comes from the data, 0 to 1.

        The rest comes from the shape.
        """
        return np.asarray(self.known.shares.mean(axis=1))

    @property
    def masses(self) -> Mapping[str, Array]:
        """(bodies,) masses by the name of the way that gives them [kg]."""
        return {name: table[:, 0] for name, table in self.parameters.items()}

    @property
    def left_out(self) -> Mapping[str, int]:
        """Reason -> frames of all recordings left out for it."""
        return FrozenMap(dict(all_left_out(self.recordings)))


def identify(  # page: recordings and a body's shape, and what is known of them, optional
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
    """Find inertial parameters that explain measured forces and that a body can have.

    Noise of moments and forces is at first the misfit of the scaled model, then what the fit leaves
    of parts of the recordings that it did not see, as long as that falls: the residual of the fit
    itself would be too small, since faults of kinematics do not shrink with more frames. The same
    parts choose how far the data may move the masses away from the shape (`mass_sd`).

    Before that, each recording, or each part of a single one, is predicted by masses identified
    without it. Where these predict worse than the generic model, the generic masses are kept
    (`if_worse`) and the first note says so.

    Where markers move more than the body's mass, coordinates are filtered by 1 / (1 + alpha w^2)
    before accelerations count, if measured forces show it beside noise of the motion and that
    predicts held-out parts better (`soft_tissue`): masses then explain forces that soft tissue does
    not.

    Source: [D], chapter 3; Ayusawa, Venture and Nakamura 2014; Lee, Wensing and Park 2020; see
    docs/identification.md.

    Parameters
    ----------
    model : scaled to the body; its inertial parameters are the generic ones
    recordings : of `recordings.usable`
    points : mass points of the body by the name of their weight map, the one to use first
    mass : of the whole body, kept exactly [kg]; the model's by default
    inside : tells whether points are inside the skin, in the pose of the mass points
    options : method, noise and how far masses may move; see `IdentificationOptions`
    recording : as the recordings were made usable; specifies the least time that is asked of them
    unseen : recordings that masses are not identified from; where given, they alone decide whether
        identified masses predict worse than the generic model
    advance : called with the number of ways solved, as they are

    Returns
    -------
    the model with the parameters found, all alternatives beside them, residuals of moments [N m]
        and forces [N], and what of each link the data showed

    Raises
    ------
    BadData : too little can be used, nothing moves, or there are no mass points

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> model, time = mm.read_model("arm.osim"), np.arange(0.0, 2.0, 0.01)
    >>> angles = np.column_stack([np.sin(3.0 * time), 1.0 + 0.8 * np.sin(5.0 * time)])
    >>> motion = mm.Motion(time, model.coordinate_names, angles)
    >>> moved = mm.differentiate(motion)
    >>> at = mm.joint_reactions(model, moved, None, joints=["shoulder"], frame="ground")
    >>> wrenches = mm.Wrenches(time, ("shoulder",), ("upper",), at.forces, at.points, at.moments)
    >>> coarse = mm.BodyOptions(spacing=0.05)
    >>> points, _, _ = mm.body_points(model, mm.BodyShape(), model.mass, coarse)
    >>> options = mm.IdentificationOptions(compare=False)
    >>> found = mm.identify(model, [mm.usable(model, motion, wrenches)], points, options=options)
    >>> [round(float(body.mass), 1) for body in found.model.bodies]
    [2.0, 2.0]
    """
    options = options or IdentificationOptions()
    if not points:
        raise BadData("identification needs mass points: give those of at least one weight map")
    check_excited(model, tuple(recordings), recording)
    body = _Body.of(model, points, model.mass if mass is None else mass)
    strength = body.strength(options)
    equations = _equations(body, recordings, strength, options)

    # Every way to identify, beside the shape alone and the generic model.
    solved = _solved(body, equations, strength, options, advance)
    way = body.way(options)
    known = _known(body, equations, solved[way].parameters, strength)
    found = _shown(body, equations, strength, way, known)

    # Masses that predict worse than the generic model's are not used.
    if unseen:
        verdict = _on_other_recordings(body, equations, unseen, found)
    else:
        names = tuple(values.name for values in recordings)
        verdict = unseen_parts(equations.parts, strength, names, equations.markers)
    kept = verdict.worse and options.if_worse == "generic"
    ways = _Ways(
        solved=FrozenMap(solved),
        parameters=FrozenMap(_parameters(body, solved, way) | {way: found}),
        identified=way,
        chosen=GENERIC if kept else way,
        inside=inside,
    )
    judged = _Judged(known=known, sides=strength.sides, verdict=verdict)
    notes = _notes(model, equations, ways, verdict) + _not_shown(equations, options)
    notes += tuple(chain.from_iterable(one.notes for one in recordings))
    return replace(_identification(body, equations, ways, judged, tuple(recordings)), notes=notes)


@read_only
class _Body:
    """The body to be identified, as it is before anything is measured.

    Attributes
    ----------
    generic : the scaled model at the body's mass
    maps : mass points by the name of their weight map, the one to use first
    few : points that stand for those of the first map
    mass : of the whole body [kg]
    """

    generic: Model
    maps: Mapping[str, MassPoints]
    few: MassPoints
    mass: float

    @classmethod
    def of(cls, model: Model, maps: Mapping[str, MassPoints], mass: float) -> _Body:
        """Bring a scaled model to the mass of the body."""
        scaled = inertial_parameters(model) * (mass / model.mass)
        return cls(
            generic=with_inertial_parameters(model, scaled),
            maps=FrozenMap(dict(maps)),
            few=thinned(next(iter(maps.values()))),
            mass=mass,
        )

    @property
    def first_map(self) -> str:
        """Name of the weight map that is used."""
        return next(iter(self.maps))

    @property
    def first_way(self) -> str:
        """Name of the way to identify by its points."""
        return f"{BY_POINTS}{self.first_map}"

    @property
    def points(self) -> MassPoints:
        """Mass points of the first map."""
        return self.maps[self.first_map]

    def way(self, options: IdentificationOptions) -> str:
        """Return the name of the way to identify that is used."""
        return self.first_way if options.method == "points" else CONIC

    def strength(self, options: IdentificationOptions) -> Strength:
        """State the problem of choosing how far data may move masses."""
        return Strength(
            points=self.few,
            generic=inertial_parameters(self.generic),
            method=options.method,
            mass_sd=options.mass_sd,
            sides=self.sides(options),
            paper=_paper(self.generic, options, self.mass),
            only_shown=options.masses == "shown" and options.prior != "paper",
        )

    def sides(self, options: IdentificationOptions) -> Sides | None:
        """State that both sides are alike; [D] has no such rows."""
        if options.prior == "paper":
            return None
        return sides_of(self.generic, self.few.parameters(self.few.reference), options.side_sd)


@read_only
class _Equations:
    """Equations of the motion, and what was chosen on them.

    Attributes
    ----------
    markers : parts of the motion as markers show it
    fitted : without soft tissue, where forces show it and that predicts better
    evidence : what forces show of soft tissue; None where nobody asked
    noise : of the motion; None where there is none
    parts : without soft tissue and, on the mean, without noise of the motion
    choice : noise and strength of the prior on these parts
    """

    markers: Parts
    fitted: Fitted
    evidence: TissueEvidence | None
    noise: MotionNoise | None
    parts: Parts
    choice: ChosenPrior

    @property
    def rows(self) -> tuple[Array, Array]:
        """(rows, 10 bodies) A and (rows,) b of the parameters, in units of noise."""
        return self.parts.rows(self.choice.noise)


def _equations(
    body: _Body,
    recordings: Sequence[Usable],
    strength: Strength,
    options: IdentificationOptions,
) -> _Equations:
    """Condense recordings: as markers show them, without soft tissue, without noise of the motion.

    Parameters
    ----------
    body : before anything is measured
    recordings : with frames that can be used
    strength : problem of choosing how far data may move masses
    options : of identification
    """
    model = body.generic
    used = [one.recording for one in recordings]
    by_paper = strength.paper is not None
    exact = by_paper or not options.motion_sd
    if not exact:
        used = [with_noise(one, options.motion_sd) for one in used]
    base = base_parameters(model, held=held_in(model, [one.motion for one in used]))
    markers = parts_of(model, used, base)
    if not by_paper and options.skin_sd:
        markers = replace(markers, skin=skin_errors(model, used, markers, options.skin_sd))
    fitted = Fitted(
        recordings=tuple(used), parts=markers, tissue=None, choice=strength.choose(markers)
    )
    use: Use = "never" if by_paper else options.soft_tissue
    fitted, evidence = with_soft_tissue(model, fitted, strength, use)
    if exact:
        return _Equations(
            markers=markers,
            fitted=fitted,
            evidence=evidence,
            noise=None,
            parts=fitted.parts,
            choice=fitted.choice,
        )
    noise = _noise_of_motion(model, fitted, strength)
    return _Equations(
        markers=markers,
        fitted=fitted,
        evidence=evidence,
        noise=noise,
        parts=noise.corrected,
        choice=strength.choose(noise.corrected),
    )


def _parameters(
    body: _Body, solved: Mapping[str, MassPointFit | PseudoInertiaFit], identified: str
) -> dict[str, Array]:
    """List parameters (bodies, 10) of all ways, the one that is used first."""
    parameters = {name: solved[name].parameters for name in dict.fromkeys((identified, *solved))}
    parameters[SHAPE] = body.points.parameters(body.points.reference)
    parameters[GENERIC] = inertial_parameters(body.generic)
    return parameters


def _misfits(equations: _Equations, parameters: Mapping[str, Array]) -> Mapping[str, Array]:
    """Compute misfits (2,) of all ways in the frames used; the generic masses move as markers."""
    misfits = {name: equations.parts.rms(masses) for name, masses in parameters.items()}
    misfits[GENERIC] = equations.markers.rms(parameters[GENERIC])
    return FrozenMap(misfits)


def _consistency(body: _Body, ways: _Ways) -> Mapping[str, Consistency]:
    """Check the links of all ways."""
    names = body.generic.body_names
    return FrozenMap(
        {
            name: consistency(names, masses, inside=ways.inside, points=body.points)
            for name, masses in ways.parameters.items()
        }
    )


@read_only
class _Ways:
    """Ways to identify, and which of them the model gets its masses from.

    Attributes
    ----------
    solved : by name, with what certifies each
    parameters : (bodies, 10) by name, with the shape alone and the generic model
    identified : name of the one that was asked for
    chosen : of those that the model has
    inside : tells whether points are inside the skin; None where nobody knows
    """

    solved: Mapping[str, MassPointFit | PseudoInertiaFit]
    parameters: Mapping[str, Array]
    identified: str
    chosen: str
    inside: Inside | None


@read_only
class _Judged:
    """What is known of identified masses beside their equations.

    Attributes
    ----------
    known : which parameters the data determine, with the posterior
    sides : left and right alike; None where nothing ties them
    verdict : on what was not used
    """

    known: Determined
    sides: Sides | None
    verdict: Verdict


def _identification(
    body: _Body,
    equations: _Equations,
    ways: _Ways,
    judged: _Judged,
    recordings: tuple[Usable, ...],
) -> Identification:
    """Put together what was found, without notes.

    Parameters
    ----------
    body : before anything is measured
    equations : that were solved
    ways : their solutions
    judged : posterior, and verdict on what was not used
    recordings : that were used
    """
    choice = equations.choice
    solved = ways.solved[ways.identified]
    parameters = {name: frozen_array(values) for name, values in ways.parameters.items()}
    return Identification(
        model=with_inertial_parameters(body.generic, ways.parameters[ways.chosen]),
        chosen=ways.chosen,
        identified=ways.identified,
        parameters=FrozenMap(parameters),
        residuals=_misfits(equations, ways.parameters),
        estimate=_estimate(body, equations, judged, solved),
        tried=FrozenMap(choice.misfits),
        mass_sd=choice.mass_sd,
        noise=choice.noise,
        base=_base_fit(body, equations),
        points=body.points,
        known=judged.known,
        consistency=_consistency(body, ways),
        recordings=recordings,
        soft_tissue=equations.fitted.tissue if ways.chosen == ways.identified else None,
        tissue_evidence=equations.evidence,
    )


def _notes(
    model: Model, equations: _Equations, ways: _Ways, verdict: Verdict
) -> tuple[Message, ...]:
    """List what looks wrong with masses, first of all whether they may be believed."""
    masses = ways.parameters[ways.chosen][:, 0]
    shape = ways.parameters[SHAPE][:, 0]
    return (
        *_verdict(verdict, ways.chosen == ways.identified),
        *_not_converged(ways.solved),
        *_far_from_shape(model, masses, shape, equations.choice.mass_sd),
    )


def _estimate(
    body: _Body,
    equations: _Equations,
    judged: _Judged,
    solved: MassPointFit | PseudoInertiaFit,
) -> Estimate:
    """State the identified masses with all that certifies them.

    Parameters
    ----------
    body : before anything is measured
    equations : that were solved
    judged : posterior, and verdict on what was not used
    solved : the way that is used
    """
    few = body.few
    posterior = judged.known.posterior
    unknowns = posterior.unknowns
    problem = mass_problem(
        unknowns,
        equations.rows,
        few.parameters(few.reference),
        prior_covariance(few, equations.choice.mass_sd),
        judged.sides,
    )
    at = problem.at(solved.parameters.ravel())
    search = Search(
        status=CONVERGED if solved.converged else NO_LOWER,
        costs=(problem.at(few.parameters(few.reference).ravel()).cost, at.cost),
        change=0.0,
    )
    solution = Solution(x=at.x, free=unknowns.free(), at=at, search=search)
    return estimate_of(solution, posterior=posterior, verdict=judged.verdict)


def _paper(generic: Model, options: IdentificationOptions, mass: float) -> Paper | None:
    """Set up the problem with [D]'s own weights; None where data are weighed by their noise."""
    if options.prior != "paper":
        return None
    weights = MassPointOptions(
        prior="paper",
        W_phi=options.weight_phi,
        W_rho=options.weight_rho,
        floor=options.point_floor,
    )
    return Paper(model=generic, options=weights, mass=mass if options.keep_mass else None)


def _noise_of_motion(generic: Model, fitted: Fitted, strength: Strength) -> MotionNoise:
    """Compute what noise of the motion adds to the equations.

    Parameters
    ----------
    generic : the scaled model at the body's mass
    fitted : recordings with the noise of their coordinates, and their parts
    strength : problem of choosing how far data may move masses
    """
    noise, misfits, mass_sd = fitted.choice
    added = motion_noise(generic, fitted.recordings, fitted.parts)
    # What parts that were not fitted leave is as much as noise can have made.
    return added.at_most(misfits[mass_sd], strength.fit(fitted.parts, noise, mass_sd))


def _base_fit(body: _Body, equations: _Equations) -> BaseFit:
    """Estimate base parameters, with the noise that the misfit of held-out parts shows."""
    moment, force = equations.choice.misfits[equations.choice.mass_sd]
    # Of one component: misfits are those of vectors.
    options = BaseOptions(
        moment_noise=moment / np.sqrt(3.0), force_noise=force / np.sqrt(3.0), motion_sd=0.0
    )
    recordings = equations.fitted.recordings
    base = equations.parts.base
    return fit_base(body.generic, recordings, base, options, motion=equations.noise)


def _not_shown(equations: _Equations, options: IdentificationOptions) -> tuple[Message, ...]:
    """Report soft tissue that was taken because it was asked for, and that forces do not show."""
    evidence = equations.evidence
    if options.soft_tissue != "always" or evidence is None or evidence.shown:
        return ()
    return (MASSES.message(f'{evidence.sentence}; used because soft_tissue = "always"'),)


def _not_converged(solved: Mapping[str, MassPointFit | PseudoInertiaFit]) -> list[Message]:
    return [
        SEARCH.message(f"{name}: not proven to be the optimum")
        for name, solution in solved.items()
        if not solution.converged
    ]


def _used(recording: Recording, model: Model, parameters: Array) -> Array:
    """Compute what parameters leave of a recording's wrench.

    Parameters
    ----------
    parameters : (bodies, 10)

    Returns
    -------
    (frames, 6) [N m], [N]; NaN where the recording is not used
    """
    left = recording.missing(model, parameters)
    if recording.use is not None:
        left[~recording.use] = np.nan
    return left


def _known(body: _Body, equations: _Equations, parameters: Array, strength: Strength) -> Determined:
    """Judge what the data determine, with noise of the motion apart from other misfit.

    Parameters
    ----------
    body : before anything is measured
    equations : that were solved
    parameters : (bodies, 10) that were identified
    strength : what is known beforehand
    """
    parts = equations.parts
    sides = strength.sides
    recordings = equations.fitted.recordings
    misfits = [_used(one, body.generic, parameters) for one in recordings]
    # Frames that make one independent sample, beyond those that count as one already.
    samples = max(1.0, float(np.mean(correlation_times(misfits))) / parts.alike)
    noise = equations.choice.noise
    mass_sd = equations.choice.mass_sd
    rows, _ = equations.rows
    motion = equations.noise
    if motion is None:
        measured = MeasuredRows(A=rows, samples=samples, sides=sides, shifts=strength.shifts)
        return determined(body.few, measured, body.mass, mass_sd, parameters)
    # Variances add up: what noise of the motion did not make of the misfit is noise of forces.
    share = np.square(motion.misfit(parameters) / noise)
    force_noise = noise / np.maximum(np.sqrt(np.clip(1.0 - share, 0.0, 1.0)), 1e-9)
    force_rows, _ = motion.parts.rows(force_noise)
    measured = MeasuredRows(
        A=rows,
        samples=samples,
        forces=force_rows,
        scores=motion.scores(noise, parameters),
        sides=sides,
        shifts=strength.shifts,
    )
    return determined(body.few, measured, body.mass, mass_sd, parameters)


def _shown(
    body: _Body, equations: _Equations, strength: Strength, way: str, known: Determined
) -> Array:
    """Identify parameters whose masses change no more than is shown, where that was requested.

    Parameters
    ----------
    body : before anything is measured
    equations : to be solved
    strength : what is known beforehand
    way : to identify
    known : what is expected, and how far it may be off

    Returns
    -------
    (bodies, 10)
    """
    expected = known.posterior.x.reshape(-1, 10)
    if not strength.only_shown:
        return expected
    before = body.points.parameters(body.points.reference)[:, 0]
    masses = shown_masses(before, expected[:, 0], known.sd[:, 0])
    rows = HeldMasses.of(masses).beside(equations.rows)
    return _solve_way(body, equations, strength, way, rows).parameters


def _on_other_recordings(
    body: _Body, equations: _Equations, recordings: Sequence[Usable], identified: Array
) -> Verdict:
    """Compute the misfit of identified and generic masses on held-out recordings.

    Identified masses move as soft tissue leaves them, the generic ones as markers do.

    Parameters
    ----------
    body : before anything is measured
    equations : with base parameters and soft tissue
    recordings : that masses were not identified from
    identified : (bodies, 10) parameters
    """
    model = body.generic
    base = equations.parts.base
    tissue = equations.fitted.tissue
    generic = inertial_parameters(model)
    used = [recording for recording in recordings if recording.use.any()]
    markers = [parts_of(model, [values.recording], base, least=1) for values in used]
    parts = markers
    if tissue is not None:
        softened = [values.recording.moved(tissue.of) for values in used]
        parts = [parts_of(model, [values], base, least=1) for values in softened]
    return _verdict_on(
        names=tuple(values.name for values in used),
        identified=np.reshape([part.rms(identified) for part in parts], (-1, 2)),
        generic=np.reshape([part.rms(generic) for part in markers], (-1, 2)),
        frames=np.array([part.frames.sum() for part in parts], int),
    )


def _verdict_on(
    names: tuple[str, ...], identified: Array, generic: Array, frames: np.ndarray
) -> Verdict:
    """Make the verdict on recordings that were not used.

    Parameters
    ----------
    names : of the recordings
    identified, generic : (recordings, 2) misfits of moment and force [N m], [N]
    frames : (recordings,) of each
    """
    return Verdict(
        kinds=KINDS,
        parts=names,
        estimate=identified,
        generic=generic,
        weights=frames,
        what="recordings that were not used",
    )


def _verdict(unseen: Verdict, taken: bool) -> tuple[Message, ...]:
    """Report where identified masses do not predict what was not used, first of all notes."""
    if not unseen.known:
        return (
            HELD_OUT.message(
                "the recording is too short to hold parts of it out: whether the masses predict"
                " held-out motion is unknown"
            ),
        )
    where = f"on {unseen.what}: {unseen.numbers}"
    cause = "the motion is too short or too uniform, or forces and motion do not belong together"
    if unseen.worse and taken:
        return (
            HELD_OUT.message(
                f"identified masses predict no better than the generic model {where}; {cause}; used"
                " because of if_worse"
            ),
        )
    if unseen.worse:
        return (
            HELD_OUT.message(
                "the generic model's masses are kept, identified ones predict no better than the"
                f" generic model {where}; "
                f'{cause}; if_worse = "identified" takes them'
            ),
        )
    if not unseen.losses:
        return ()
    losses = ", the ".join(unseen.losses[:3])
    return (
        HELD_OUT.message(f"identified masses predict worse than the generic model in the {losses}"),
    )


def _solved(
    body: _Body,
    equations: _Equations,
    strength: Strength,
    options: IdentificationOptions,
    advance: Callable[[int], None],
) -> dict[str, MassPointFit | PseudoInertiaFit]:
    """Fit the equations by the requested way, and by the others to compare.

    Parameters
    ----------
    body : before anything is measured
    equations : to be solved
    strength : with the paper's weights, where these were requested
    options : of identification
    advance : called with the number of ways solved, as they are
    """
    solved: dict[str, MassPointFit | PseudoInertiaFit] = {}
    for name in body.maps:
        if options.compare or (name == body.first_map and options.method == "points"):
            way = f"{BY_POINTS}{name}"
            solved[way] = _solve_way(body, equations, strength, way, equations.rows)
            advance(1)
    if options.compare or options.method == "pseudo-inertia":
        solved[CONIC] = _solve_way(body, equations, strength, CONIC, equations.rows)
        advance(1)
    if strength.paper is not None:
        noise = equations.choice.noise
        solved[body.first_way] = strength.paper.solve(body.points, equations.parts, noise)
    return solved


def _solve_way(
    body: _Body,
    equations: _Equations,
    strength: Strength,
    way: str,
    rows: tuple[Array, Array],
) -> MassPointFit | PseudoInertiaFit:
    """Fit rows by one way.

    Parameters
    ----------
    body : before anything is measured
    equations : with the strength of the prior
    strength : what is known beforehand
    way : to identify
    rows : (rows, 10 bodies) A and (rows,) b of unit noise
    """
    A, b = rows if strength.sides is None else strength.sides.beside(rows)
    mass_sd = equations.choice.mass_sd
    if way == CONIC:
        shape = possible_reference(body.points.parameters(body.points.reference))
        of_cones = PseudoInertiaOptions(mass_sd=mass_sd)
        return solve_pseudo_inertia(A, b, shape, mass=body.mass, options=of_cones)
    points = body.maps[way.removeprefix(BY_POINTS)]
    of_points = MassPointOptions(mass_sd=mass_sd)
    return solve_mass_points(points, A, b, mass=body.mass, options=of_points)


def _far_from_shape(
    model: Model, masses: Array, shape: Array, mass_sd: float
) -> tuple[Message, ...]:
    """Report links whose mass is hard to believe, and the motion that would show it.

    Parameters
    ----------
    masses, shape : (bodies,) identified, and by the shape alone [kg]
    mass_sd : relative standard deviation of a link's mass that was used
    """
    names = model.body_names
    far = np.flatnonzero(
        (shape > MIN_MASS_SHARE * shape.sum()) & (np.abs(masses - shape) > MAX_MASS_CHANGE * shape)
    )
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
        (
            MASSES.message(
                f"{len(far)} of {len(names)} links have masses far from those of their shape:"
                f" {listed};"
                " faults of the motion that return with every step may be in them: record the"
                f" movements named, or hold masses with a mass_sd below {mass_sd:g}"
            )
        ),
    )
