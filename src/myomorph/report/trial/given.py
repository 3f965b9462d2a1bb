"""What a report is made of: everything one trial produced, each part optional."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, Protocol

import numpy as np

from myomorph.analysis.phase import Phase
from myomorph.model.arrays import Array
from myomorph.model.contacts import ContactForces, Contacts
from myomorph.model.model import Model
from myomorph.model.series import Emg, Event, ForcePlate, Markers, Motion, Series, Wrenches
from myomorph.model.surface import Surface
from myomorph.motion.ik import KinematicsFit
from myomorph.report.page.parts import Note, PageHead, SourceFile, Step
from myomorph.report.trial.identified import IdentificationInput

Situation = Literal["", "measured", "shared", "sound", "unknown"]


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known where a capture was simulated: angles [rad], torques [N m], activations."""

    motion: Series | None = None
    torques: Series | None = None
    activations: Series | None = None


@dataclass(frozen=True)
class Uncarried:
    """A frame whose contacts could not carry the motion: its time [s], and the smallest relaxation that does."""

    time: float
    relaxation: str = ""


class ForceIntervals(Protocol):
    """What physics leaves open of contact forces, as the report reads it."""

    @property
    def time(self) -> Array:
        """(samples,) [s]."""

    @property
    def names(self) -> tuple[str, ...]:
        """Groups of sites, or sites."""

    @property
    def lower(self) -> Array:
        """(samples, names, 3) least force in ground [N], NaN where unknown."""

    @property
    def upper(self) -> Array:
        """(samples, names, 3) greatest force [N]."""


class TensionResult(Protocol):
    """What the report reads of a solved tension."""

    @property
    def time(self) -> Array:
        """(frames,) [s]."""

    @property
    def muscles(self) -> tuple[str, ...]:
        """Names."""

    @property
    def activations(self) -> Array:
        """(frames, muscles)."""

    @property
    def forces(self) -> Array:
        """(frames, muscles) along the tendon [N]."""

    @property
    def reserves(self) -> Array:
        """(frames, reserves) torques of the reserve actuators [N m or N]."""

    @property
    def reserve_coordinates(self) -> tuple[str, ...]:
        """Coordinate of each reserve."""

    @property
    def solved(self) -> np.ndarray:
        """(frames,) whether the frame is optimal."""


@dataclass(frozen=True, eq=False)
class ReportInput:
    """Everything one report may show; a section appears where its part is given.

    Attributes
    ----------
    title : of the report, e.g. "s01: walk2"
    subject, date : who, and when the report was made, as the caller wants them printed
    version : of the software
    notes : what is real, assumed or simulated, shown first
    facts : further lines of the heading, name to text
    sources : input files with their hashes
    steps : how it was made
    model : of the subject
    surfaces : meshes for the pictures, by `Mesh.file`
    markers : as recorded
    fit : of inverse kinematics
    motion : coordinates; `fit.motion` where not given
    wrenches : external forces, at any clock
    plates : outlines of the force plates
    torques : generalized forces of inverse dynamics (frames, coordinates) [N m or N]
    root_note : what the forces at the root joint are where they are not residuals (a model of the legs
        alone carries the trunk there); with it, no residual is judged
    lengths, length_rates : (frames, muscles) muscle-tendon lengths [m] and their velocities [m/s]
    driven : coordinates that at least one muscle moves; () if unknown
    tension : solved muscle tensions
    overstretched : muscles whose passive force passes their maximum isometric force somewhere
    emg : measured excitations
    emg_muscles : EMG channel to the muscles it was measured on; channels not named are shown apart
    events : known events; None lets the report find them in the forces
    truth : of a simulated capture
    preset : name of the analysis of the motion (see `presets`); "" chooses by what the recording shows
    phases : parts of the motion, as the user cuts them; () for those that events or contacts tell
    times : instants to picture, () for those of events [s]
    contacts : which site touches what; None takes what the forces tell
    contact_forces : as estimated, beside `wrenches` as measured
    intervals : of the contact forces, as far as they are known
    residuals : (frames, residuals) forces ("residual_FX", ...) and moments ("residual_MX", ...) that still hold what
        floats once contacts carry [N], [N m]
    uncarried : frames whose contacts could not carry the motion
    situation : how contact forces are known: "measured" by plates, "shared" among sites on a plate, from
        "sound", or "unknown" and solved for; "" tells it by what is given
    identification : how the body's masses and lengths were found
    warnings : what the readers and steps had to say, one line each
    """

    title: str
    subject: str = ""
    date: str = ""
    version: str = ""
    notes: tuple[Note, ...] = ()
    facts: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    sources: tuple[SourceFile, ...] = ()
    steps: tuple[Step, ...] = ()
    model: Model | None = None
    surfaces: Mapping[str, Surface] = field(default_factory=lambda: MappingProxyType({}))
    markers: Markers | None = None
    fit: KinematicsFit | None = None
    motion: Motion | None = None
    wrenches: Wrenches | None = None
    plates: tuple[ForcePlate, ...] = ()
    torques: Series | None = None
    root_note: str = ""
    lengths: Series | None = None
    length_rates: Series | None = None
    driven: tuple[str, ...] = ()
    tension: TensionResult | None = None
    overstretched: tuple[str, ...] = ()
    emg: Emg | None = None
    emg_muscles: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: MappingProxyType({}))
    events: tuple[Event, ...] | None = None
    truth: Truth | None = None
    preset: str = ""
    phases: tuple[Phase, ...] = ()
    times: tuple[float, ...] = ()
    contacts: Contacts | None = None
    contact_forces: ContactForces | None = None
    intervals: ForceIntervals | None = None
    residuals: Series | None = None
    uncarried: tuple[Uncarried, ...] = ()
    situation: Situation = ""
    identification: IdentificationInput | None = None
    warnings: tuple[str, ...] = ()

    @property
    def head(self) -> PageHead:
        """What the page says of itself."""
        return PageHead(self.title, self.date, self.version, self.notes, self.sources, self.steps, self.warnings)

    @property
    def kinematics(self) -> Motion | None:
        """Coordinates, given or fitted."""
        return self.motion if self.motion is not None else self.fit.motion if self.fit is not None else None
