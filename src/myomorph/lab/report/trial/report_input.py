"""The input of a report: the results of the steps of one trial.

Each is a part of its own and optional.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import ContactForces, Contacts
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.known import Known
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.movement import Movement
from myomorph.core.model.series import Emg, Event, ForcePlate, Markers, Motion, Series, Wrenches
from myomorph.core.model.surface import Surface
from myomorph.lab.report.page.parts import PageHead, Section
from myomorph.lab.uncertainty.spread import Uncertainty

if TYPE_CHECKING:
    from myomorph.body.calibrate.calibration import Calibration
    from myomorph.body.identify.subject import Identification
    from myomorph.body.identify.validation import CrossValidation
    from myomorph.core.motion.ik import KinematicsFit
    from myomorph.core.tension.emg_conflicts import EmgConflict
    from myomorph.core.tension.joint_contact import JointContactForces
    from myomorph.core.tension.tension import Tension
    from myomorph.lab.analysis.phases import Phase

Situation = Literal["", "measured", "shared", "sound", "unknown"]


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known where a capture was simulated: angles [rad], torques [N m], activations."""

    motion: Series | None = None
    torques: Series | None = None
    activations: Series | None = None


@dataclass(frozen=True)
class InfeasibleContact:
    """An infeasible contact frame: its time [s] and the smallest relaxation.

    With that relaxation its contacts can carry the motion.
    """

    time: float
    relaxation: str = ""


@read_only
class ForceIntervals:
    """What the data leave open of contact forces at some instants."""

    time: Array  # (samples,) [s]
    names: tuple[str, ...]  # groups of sites, or sites
    # lower, upper: (samples, names, 3) least and greatest force in ground [N], NaN where unknown
    lower: Array
    upper: Array


@read_only
class PlateForce:
    """What plates measured of the contacts on them, together."""

    name: str  # of the plates
    sites: tuple[str, ...]  # names of the contact sites on them
    forces: Array  # (frames, 3) on the body in ground [N], NaN while other sites are on them


@dataclass(frozen=True)
class HeardImpact:
    """An impact that was heard, and the site that made it."""

    time: float  # when it begins [s]
    site: str
    instrument: str
    impulse: float  # [N s]
    low: float  # limits of 90 % of it [N s], NaN where nothing shows them
    high: float
    confidence: float  # probability of this site, 0 to 1


@dataclass(frozen=True, eq=False)
class Recorded:
    """What was recorded, and of whom."""

    subject: str = ""  # name, as printed
    mass: float | None = None  # as it was given or weighed [kg]
    age: float | None = None  # [years]
    sex: str = ""  # "female" or "male", "" where it is not known
    height: float | None = None  # as it was stated [m]
    # further lines of the heading, name to text
    facts: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    emg: Emg | None = None  # measured excitations
    # EMG channel to the muscles it was measured on; channels not named are shown apart
    emg_muscles: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: FrozenMap({}))
    plates: tuple[ForcePlate, ...] = ()  # outlines of the force plates
    # known events; None lets the report find them in the forces
    events: tuple[Event, ...] | None = None
    truth: Truth | None = None  # of a simulated capture
    movement: Known[Movement] = field(default_factory=Known)  # which movement it is of
    date: str = ""  # day of the recording, as 2026-03-05


@dataclass(frozen=True, eq=False)
class Kinematics:
    """How the body moved."""

    markers: Markers | None = None  # as inverse kinematics used them
    fit: KinematicsFit | None = None  # of inverse kinematics
    coordinates: Motion | None = None  # where there is no fit

    @property
    def motion(self) -> Motion | None:
        """Coordinates, given or fitted."""
        if self.coordinates is not None:
            return self.coordinates
        return None if self.fit is None else self.fit.motion


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Forces of the whole body."""

    # generalized forces of inverse dynamics (frames, coordinates) [N m or N]
    torques: Series | None = None
    wrenches: Wrenches | None = None  # external forces, at any clock
    # what the forces at the root joint are where they are not residuals (a model of the legs alone
    # carries the trunk there); with it, no residual is judged
    root_note: str = ""
    motion: Motion | None = None  # coordinates that the torques are of, with velocities
    # times at which accelerations are less sure: ends, and beside long gaps [s]
    less_sure: tuple[tuple[float, float], ...] = ()
    measured: Series | None = None  # vertical force on bodies as measured (samples, bodies) [N]
    joint_force: Series | None = None  # size of the force in joints (frames, joints) [N]


@dataclass(frozen=True, eq=False)
class MusclePaths:
    """Muscle-tendon paths."""

    # lengths, velocities: (frames, muscles) lengths [m] and their velocities [m/s]
    lengths: Series | None = None
    velocities: Series | None = None
    driven: tuple[str, ...] = ()  # coordinates that at least one muscle moves; () if unknown


@dataclass(frozen=True, eq=False)
class EstimatedContacts:
    """Contacts, and their forces as far as they are unmeasured."""

    touches: Contacts | None = None  # which site touches what; None takes what the forces tell
    forces: ContactForces | None = None  # as estimated, beside the external forces as measured
    intervals: ForceIntervals | None = None  # of the contact forces, as far as they are known
    # (frames, residuals) forces ("residual_FX", ...) and moments ("residual_MX", ...) that still
    # hold what floats once contacts carry [N], [N m]
    residuals: Series | None = None
    infeasible: tuple[InfeasibleContact, ...] = ()  # frames whose contacts cannot carry the motion
    # how contact forces are known: "measured" by plates, "shared" among sites on a plate, from
    # "sound", or "unknown" and solved for; "" where what is given tells it
    situation: Situation = ""
    # what plates measured of the contacts on them, at the times of `forces`
    on_plates: tuple[PlateForce, ...] = ()
    impacts: tuple[HeardImpact, ...] = ()  # by microphones, in the order of time


@dataclass(frozen=True)
class AnalysisChoice:
    """How to look at the motion."""

    # name of the analysis of the motion (see `presets`); "" chooses by what the recording shows
    preset: str = ""
    # parts of the motion, as the user cuts them; () for those that events or contacts tell
    phases: tuple[Phase, ...] = ()
    times: tuple[float, ...] = ()  # instants to picture, () for those of events [s]
    muscles: tuple[str, ...] = ()  # names of `MUSCLES` or of the model, () for those of the preset


@dataclass(frozen=True, eq=False)
class IdentificationInput:
    """A body whose masses were identified, or whose lengths were calibrated.

    A part appears where it is there.
    """

    model: Model  # with the identified parameters
    identification: Identification | None = None  # of its masses
    # on motions that were not used, by their names
    validation: Mapping[str, CrossValidation] = field(default_factory=lambda: FrozenMap({}))
    calibration: Calibration | None = None  # of its lengths and markers
    # names of those that the calibration used, in their order, the static one last
    recordings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ReportInput:
    """What one report may show: the results of the steps.

    A section appears where its result is there.
    """

    head: PageHead  # title, notes, sources, steps and warnings
    model: Model | None = None  # of the subject
    # meshes for the pictures, by `Mesh.file`
    surfaces: Mapping[str, Surface] = field(default_factory=lambda: FrozenMap({}))
    recorded: Recorded = field(default_factory=Recorded)
    kinematics: Kinematics = field(default_factory=Kinematics)
    dynamics: Dynamics = field(default_factory=Dynamics)
    muscles: MusclePaths = field(default_factory=MusclePaths)
    tension: Tension | None = None
    reserve_coordinates: tuple[str, ...] = ()  # coordinate of each reserve of the tension
    contacts: EstimatedContacts = field(default_factory=EstimatedContacts)
    joint_contacts: JointContactForces | None = None  # forces at contact points of joints
    # least and greatest forces of joints that statics allow (frames, joints) [N]
    static_loads: tuple[Series, Series] | None = None
    # where EMG and joint torques contradict each other, None where EMG took no part
    emg_conflicts: tuple[EmgConflict, ...] | None = None
    analysis: AnalysisChoice = field(default_factory=AnalysisChoice)  # how to look at the motion
    # between what limits results lie, and what contributes to that
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    # how the body's masses and lengths were found
    identification: IdentificationInput | None = None
    more: tuple[Section, ...] = ()  # sections of steps that this page does not know

    def with_warnings(self, texts: Iterable[Message]) -> ReportInput:
        """Return a copy with more lines among the warnings of its head."""
        return replace(self, head=replace(self.head, warnings=(*self.head.warnings, *texts)))

    @property
    def activations(self) -> Series | None:
        """(frames, muscles) as a series, None without a solved frame."""
        tension = self.tension
        if tension is None or not len(tension.time):
            return None
        return Series(tension.time, tension.muscles, tension.activation)

    @property
    def strengths(self) -> Mapping[str, float]:
        """Maximum isometric force of every muscle [N]; none without a model."""
        return (
            {}
            if self.model is None
            else {muscle.name: muscle.max_isometric_force for muscle in self.model.muscles}
        )
