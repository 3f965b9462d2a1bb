"""Settings of the tension problem and its result: tensions, contact forces and reserves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import CONTACTS, PASSIVE
from myomorph.core.model.contacts import ContactForces
from myomorph.core.model.errors import BadData, check_choices, whole
from myomorph.core.model.findings import Finding
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.labelled import Labelled
from myomorph.core.model.messages import Message
from myomorph.core.model.quantity import Quantity
from myomorph.core.muscles.hill import Convention
from myomorph.core.muscles.joint_tissue import Tissue
from myomorph.core.tension.dual import MISSING, NOT_DETERMINED, OPTIMAL, STATUS_NAMES
from myomorph.core.tension.fiber_quantities import FIBERS
from myomorph.core.tension.quantities import TENSION

RESERVE = "reserve_"
RESIDUAL = "residual_"
"""With what the names of actuators begin that are added by default: of coordinates, and of a body
that floats.
"""
MAX_MISSING = 0.25
"""Share of the weight, root mean square, from which on forces from nowhere void the result."""
MAX_UNEXPLAINED = 0.1
"""Share of the weight, held from nowhere, above which a frame shows no loads of joints."""
LARGE = 0.2
"""Share of the maximum isometric force from which a muscle's passive force is named."""
FIBERS_OF_TENSION = tuple(
    quantity.replaced(attribute=f"fibers.{quantity.field}") for quantity in FIBERS
)
"""Fibers as tensions hold them."""


@dataclass(frozen=True)
class Unreachable:
    """A muscle whose fibers cannot reach, so that its tendon was taken as rigid.

    Attributes
    ----------
    frame : the first in which they cannot
    worst : normalized fiber length furthest out: below 0 where the path is shorter than the slack
        tendon
    """

    muscle: str
    frame: int
    worst: float


@dataclass(frozen=True)
class Certificate:
    """Optimality of the solution of the elastic problem, over all its windows.

    Attributes
    ----------
    residual : greatest residual of the optimality conditions
    equilibrium : greatest difference of tendon and fiber force, normalized by the maximum isometric
        force
    steps : most iterations of a window
    second_activations, second_forces : root mean square distance of activations, and of normalized
        tendon forces, of the solution from another start; NaN without one
    """

    residual: float
    equilibrium: float
    steps: int
    second_activations: float = np.nan
    second_forces: float = np.nan


@read_only
class Fibers:
    """Fibers and tendons, every array (frames, muscles), NaN where a frame was not solved.

    Attributes
    ----------
    certificate : distance of the solution from an optimum
    fiber_length : of the fibers [m]
    fiber_velocity : lengthening of the fibers [m/s]
    tendon_strain : length over slack length less 1, 0 of a rigid tendon
    fiber_power, tendon_power : positive where force does work on the outside [W]
    transient : (frames,) whether a frame is so near to the beginning or to the end that it depends
        on what was before or comes after, which nobody knows
    bridged : (frames,) whether torques or coordinates were missing, so that they were interpolated
    rigid : muscles that were solved with rigid tendons: their class has no other, the model calls
        them so, or their fibers cannot reach
    unreachable : those whose fibers cannot reach
    """

    fiber_length: Array
    fiber_velocity: Array
    tendon_strain: Array
    fiber_power: Array
    tendon_power: Array
    transient: np.ndarray
    bridged: np.ndarray
    rigid: tuple[str, ...]
    unreachable: tuple[Unreachable, ...]
    certificate: Certificate


@dataclass(frozen=True)
class TensionOptions:
    """Settings of `solve_tension`.

    Attributes
    ----------
    recruitment : criterion by which muscles share the load; "power": minimum of sum_m w_m a_m^p +
        sum_r |u_r|^p over activations a and controls u; "minmax": minimum of the largest
        activation, then of sum_m w_m a_m^2 (see docs/method.md)
    exponent : exponent p, 1.2 to 20; above 4 controls have exponent 2, and a small square of each
        activation is added
    weights : weights of muscles in the effort, with mean 1; "equal": 1; "volume": in proportion to
        F0 L0; "strength": in proportion to F0
    min_activation : lower bound of activations; "zero": 0; "model": each muscle's minimum in the
        model (usually 0.01 in OpenSim's models, for simulations with activation dynamics)
    passive : include the muscles' passive elastic forces; by default only those of fibers on
        elastic tendons, as in OpenSim's muscles. With rigid tendons they are too large, as tendon
        slack lengths are those of elastic tendons (docs/decisions/0019-tension-defaults.md);
        passive torques and bushings of the model's joints are always included
    viscous : include the muscles' viscous force, which may push; 0 in models without viscosity.
        OpenSim treats it as a separate force
    curves : force-length-velocity curves; "rigid-tendon": formulas of each muscle's class;
        "opensim": as OpenSim's static optimization evaluates them, including its errors (see
        `hill_forces`); "constant": the maximum isometric force at any length and velocity
    joint_tissue : passive joint torques of people, if the model has none (Riener and Edrich 1999);
        "hips": of the hips, which reduces the muscles' joint load at push-off; "legs": of hips,
        knees and ankles; "none": only those of the model. They include the muscles' passive forces,
        so they exclude `passive`
    reserve : optimal force of the reserves that are added to coordinates if no actuators are given
        [N m or N]; by default 1 on a body of human size, less on a smaller one (`default_reserves`)
    residual : optimal force of the residual actuators that hold a floating body if no actuators are
        given [N or N m]; by default 10 on a body of human size, less on a smaller one
    tendons : tendon model; "rigid": tendons keep their slack length, and frames are independent;
        "elastic": tendons stretch by the curves of each muscle's class, and forces of all frames
        are solved together (see docs/elastic-tendons.md)
    activation_dynamics : with elastic tendons, limit the rate of activations to what excitations
        between 0 and 1 allow with the model's time constants
    second_start : with elastic tendons, solve from a second starting point, as the problem is not
        convex; the distance of the two solutions is in `Fibers.certificate`
    """

    recruitment: Literal["power", "minmax"] = "power"
    exponent: float = 2.0
    weights: Literal["equal", "volume", "strength"] = "equal"
    min_activation: Literal["zero", "model"] = "zero"
    passive: bool | None = None
    viscous: bool = True
    curves: Literal["rigid-tendon", "opensim", "constant"] = "rigid-tendon"
    joint_tissue: Tissue = "none"
    reserve: float | None = None
    residual: float | None = None
    tendons: Literal["rigid", "elastic"] = "rigid"
    activation_dynamics: bool = True
    second_start: bool = False

    def __post_init__(self) -> None:
        if not 1.2 <= self.exponent <= 20.0:
            hint = "; its limit is recruitment 'minmax'" if self.exponent > 20.0 else ""
            raise BadData(
                f"the exponent of the effort is {self.exponent:g}: expected 1.2 to 20{hint}"
            )
        if self.recruitment == "minmax" and self.exponent != 2.0:
            raise BadData(
                f"recruitment 'minmax' with the exponent {self.exponent:g}: the greatest activation"
                " has none; leave the exponent out, or take recruitment 'power'"
            )
        if self.recruitment == "minmax" and self.tendons == "elastic":
            raise BadData(
                "recruitment 'minmax' needs rigid tendons: leave out tendons = 'elastic', or take"
                " 'power'"
            )
        if self.joint_tissue != "none" and (self.passive_on_rigid or self.passive_on_elastic):
            raise BadData(
                f"joint_tissue '{self.joint_tissue}' with passive forces of muscles: these are part"
                " of it; leave one of both out"
            )
        for name in ("reserve", "residual"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise BadData(f"the optimal force of a {name} is {value:g}: expected above 0")
        check_choices(self)

    @property
    def convention(self) -> Convention:
        """The curves' convention; "constant" has none of its own."""
        return "opensim" if self.curves == "opensim" else "rigid-tendon"

    @property
    def passive_on_rigid(self) -> bool:
        """Whether passive forces of muscles on rigid tendons take part."""
        return bool(self.passive)

    @property
    def passive_on_elastic(self) -> bool:
        """Whether passive forces of fibers on tendons that stretch take part."""
        return self.tendons == "elastic" and self.passive is not False

    @property
    def has_passive(self) -> bool:
        """Whether passive forces of any muscle take part."""
        return self.passive_on_rigid or self.passive_on_elastic


@read_only
class Tension(Labelled):
    """Muscle tensions over time, reserves, and whether each frame is an optimum.

    Attributes
    ----------
    options : of the problem
    time : (frames,) [s]
    muscles : names
    activation : (frames, muscles) NaN where the frame was not solved
    muscle_force : (frames, muscles) along the tendons, with passive and viscous force where they
        took part [N]
    reserve_names : names of reserves, residuals and the model's other actuators
    actuator_force : (frames, reserves) their forces [N] and torques [N m]
    coordinates : the free coordinates that were balanced
    balanced_torque : (frames, coordinates) what muscles and reserves had to give together: inverse
        dynamics, dependent coordinates handed on, passive torques of joints taken off [N m or N]
    equilibrium_residual : (frames,) greatest torque or force left unbalanced [N m or N]
    status : (frames,) index into `STATUS_NAMES`: optimal, infeasible, not converged, missing input,
        not determined (no muscle is left whose limb's load is known)
    iterations : (frames,)
    activation_lower, activation_upper : (muscles,) bounds of the activations
    overstretched : muscles whose passive force passes their maximum isometric force in some frame,
        where it takes part: the model's fiber and tendon lengths do not fit the pose, and forces
        mislead
    muscle_viscous_force : (frames, muscles) that part of `muscle_force` that is the muscles'
        viscosity [N], 0 where none took part
    muscle_passive_share, muscle_passive_time : (muscles,) greatest passive force over the maximum
        isometric force, and when [s]; 0 where passive force takes no part
    contacts : forces at contact sites, NaN where the frame was not solved; None where none were
        asked for
    fibers : fibers and tendons, where tendons were elastic; None with rigid ones
    """

    axes = FrozenMap(
        {
            "time": "time",
            "muscle": "muscles",
            "actuator": "reserve_names",
            "balanced_coordinate": "coordinates",
        }
    )

    time: Array
    muscles: tuple[str, ...]
    activation: Array
    muscle_force: Array
    reserve_names: tuple[str, ...]
    actuator_force: Array
    coordinates: tuple[str, ...]
    balanced_torque: Array
    equilibrium_residual: Array
    status: np.ndarray
    iterations: np.ndarray
    activation_lower: Array
    activation_upper: Array
    overstretched: tuple[str, ...]
    options: TensionOptions
    muscle_viscous_force: Array = field(default_factory=lambda: np.zeros((1, 1)))
    muscle_passive_share: Array = field(default_factory=lambda: np.zeros(1))
    muscle_passive_time: Array = field(default_factory=lambda: np.zeros(1))
    contacts: ContactForces | None = None
    fibers: Fibers | None = None

    def __post_init__(self) -> None:
        object.__setattr__(
            self,
            "muscle_viscous_force",
            np.broadcast_to(self.muscle_viscous_force, self.muscle_force.shape),
        )
        for name in ("muscle_passive_share", "muscle_passive_time"):
            object.__setattr__(
                self, name, np.broadcast_to(getattr(self, name), (len(self.muscles),))
            )

    def __len__(self) -> int:
        return len(self.time)

    @property
    def held(self) -> tuple[Quantity, ...]:
        """Activations, forces, actuators, torques, status of frames, and fibers."""
        return TENSION if self.fibers is None else (*TENSION, *FIBERS_OF_TENSION)

    @property
    def muscle_overstretched(self) -> np.ndarray:
        """(muscles,) whether a muscle is one of `overstretched`."""
        return np.array([name in self.overstretched for name in self.muscles], bool)

    @property
    def optimal(self) -> np.ndarray:
        """(frames,) whether the activations are the least effort in balance."""
        return self.status == OPTIMAL

    @property
    def asked(self) -> np.ndarray:
        """(frames,) whether a frame had all that its solution needs."""
        return ~np.isin(self.status, (MISSING, NOT_DETERMINED))

    @property
    def undetermined(self) -> np.ndarray:
        """(frames, muscles) whether a muscle has no tension: its limb's load is unmeasured."""
        return np.isnan(self.activation) & np.isin(self.status, (OPTIMAL, NOT_DETERMINED))[:, None]

    @property
    def pushing(self) -> tuple[str, ...]:
        """Muscles whose force is below zero in some frame.

        They shorten against their viscosity faster than they pull.
        """
        forces = np.where(np.isnan(self.muscle_force), 0.0, self.muscle_force)
        pushes = np.nanmin(forces, axis=0, initial=0.0) < 0.0
        return tuple(name for name, push in zip(self.muscles, pushes, strict=True) if push)

    @property
    def large_passive(self) -> tuple[tuple[str, float, float], ...]:
        """Muscles with much passive force, the largest first.

        Each by its name, the share of the maximum isometric force, and the time [s].
        """
        order = [
            i
            for i in np.argsort(-self.muscle_passive_share)
            if self.muscle_passive_share[i] > LARGE
        ]
        return tuple(
            (
                self.muscles[i],
                float(self.muscle_passive_share[i]),
                float(self.muscle_passive_time[i]),
            )
            for i in order
        )

    @property
    def residual_names(self) -> tuple[str, ...]:
        """Those of `reserve_names` that hold a floating body, added by default."""
        return tuple(name for name in self.reserve_names if name.startswith(RESIDUAL))

    def summary(self) -> dict[str, int]:
        """Count frames by status."""
        return {name: int(np.sum(self.status == index)) for index, name in enumerate(STATUS_NAMES)}


class PassivePeaks(NamedTuple):
    """Greatest passive force of each muscle.

    Attributes
    ----------
    share : (muscles,) over its maximum isometric force
    time : (muscles,) when [s]
    """

    share: Array
    time: Array


def passive_peaks(passive: Array, strength: Array, time: Array) -> PassivePeaks:
    """Greatest passive force of each muscle, over its maximum isometric force.

    Parameters
    ----------
    passive : (frames, muscles) [N]
    strength : (muscles,) maximum isometric force [N]
    time : (frames,) [s]

    Returns
    -------
    share and time of the greatest force of each muscle
    """
    share = np.nan_to_num(passive) / np.where(strength > 0.0, strength, 1.0)
    frame = share.argmax(axis=0)
    return PassivePeaks(share[frame, np.arange(len(strength))], time[frame])


def passive_notes(tension: Tension) -> tuple[Message, ...]:
    """Say what passive force does in a result; nothing where it takes no part."""
    if not tension.options.has_passive:
        return ()
    notes = []
    if tension.options.tendons == "rigid":
        notes.append(
            PASSIVE.message(
                "passive force on rigid tendons: fibers take up all that a path lengthens, so it is"
                " larger than with elastic tendons",
                severity="good to know",
            )
        )
    large = tension.large_passive
    if large:
        worst = ", ".join(
            f"{name} {100.0 * share:.0f} % at {time:.2f} s" for name, share, time in large[:3]
        )
        more = " ..." if len(large) > 3 else ""
        notes.append(
            PASSIVE.message(
                f"passive force above {100.0 * LARGE:.0f} % of the maximum isometric force in"
                f" {len(large)} of {len(tension.muscles)} muscles: {worst}{more}"
            )
        )
    return tuple(notes)


def contact_notes(tension: Tension) -> tuple[Message, ...]:
    """Say where passive forces are above what a muscle can pull with, for contact forces."""
    if not tension.overstretched:
        return ()
    count = len(tension.overstretched)
    largest = [item for item in tension.large_passive if item[0] in tension.overstretched][:3]
    worst = ", ".join(f"{name} {share:.1f} times at {time:.2f} s" for name, share, time in largest)
    more = " ..." if count > 3 else ""
    return (
        PASSIVE.message(
            f"contact forces: passive force above the maximum isometric force in {count} of"
            f" {len(tension.muscles)} muscles ({worst}{more}): fibers of the"
            " model do not fit the motion; compare with --no-contact-passive"
        ),
    )


def unexplained_frames(tension: Tension, weight: float) -> np.ndarray:
    """Find frames in which more than a tenth of the weight comes from nowhere.

    Joint loads and muscle forces of such a frame hold a body that nothing carries.

    Parameters
    ----------
    tension : result
    weight : of the body [N]

    Returns
    -------
    (frames,) bool
    """
    return np.asarray(_root_residuals(tension) > MAX_UNEXPLAINED * weight)


def _root_residuals(tension: Tension) -> Array:
    """Size of what holds the root from nowhere (frames,); a moment counts as a force at 1 m [N]."""
    columns = [tension.reserve_names.index(name) for name in tension.residual_names]
    return np.asarray(np.linalg.norm(tension.actuator_force[:, columns], axis=1))


def missing_support(
    tension: Tension,
    weight: float,
    infeasible: Sequence[Message] = (),
    estimated: NDArray[np.bool_] | None = None,
) -> tuple[Finding, ...]:
    """Warn where contacts do not carry the body and much of what moves it comes from nowhere.

    What comes from nowhere are residuals; a moment counts as a force at 1 m.

    Parameters
    ----------
    tension : result with contacts
    weight : of the body [N]
    infeasible : what was found of frames whose contacts cannot carry the motion, which is the same
        fault and becomes a part of the finding
    estimated : (frames,) in which contacts are estimated, None for all

    Returns
    -------
    one finding, or none
    """
    residuals = _root_residuals(tension)
    if estimated is not None:
        residuals = np.where(estimated, residuals, np.nan)
    known = np.isfinite(residuals).any()
    size = float(np.sqrt(np.nanmean(residuals**2))) if known else 0.0
    if size <= MAX_MISSING * weight:
        return ()
    worst = int(np.nanargmax(residuals))
    text = CONTACTS.message(
        f"contacts cannot carry the motion: forces of {whole(size)} N (root mean square;"
        f" {whole(residuals[worst])} N at {tension.time[worst]:.2f} s) have no support, compared"
        f" with a weight of {whole(weight)} N: neither contact forces nor torques and tensions are"
        " reliable (is a support missing, --contacts, or the motion too noisy, --cutoff?)",
        size=float(residuals[worst]),
    )
    times = tuple(span for message in infeasible for span in message.times)
    if infeasible:
        share = max(message.share or 0.0 for message in infeasible)
        text = text.changed(f"{text}; {'; '.join(infeasible)}", share=share)
    return (Finding(kind="missing support", place="contacts", text=text, times=times, size=size),)
