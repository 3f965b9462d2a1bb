"""One trial as the steps take it, and what they found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Actuator, Model
from myomorph.model.provenance import Source
from myomorph.model.series import Emg, Event, ForcePlate, Markers, Motion, Series, Wrenches
from myomorph.motion.crossings import CrossingOptions
from myomorph.motion.ik import InverseKinematicsOptions, KinematicsFit
from myomorph.store.settings import Differentiation, EmgUse, ReportOptions, TensionTables, TorqueTable

if TYPE_CHECKING:
    from myomorph.model.contacts import Contacts
    from myomorph.study.trial.contact_file import ContactPlan
    from myomorph.tension.emg_calibration import EmgOptions
    from myomorph.tension.solve import Tension, TensionOptions
    from myomorph.tension.terms.contacts import ContactOptions

CHAIN = ("ik", "id", "muscles", "tension")
"""Steps in the order in which they run."""


@dataclass(frozen=True, eq=False)
class Take:
    """One recording of one subject with all that the steps need, whatever files or programs it came from.

    Attributes
    ----------
    loads : external forces of a motion, or None where there are none
    mass : of the subject [kg], None where only the model tells
    time : start and end of what is used [s], None for all
    kinematics, crossings, derivatives, torque_table, tension, contact_options, emg_options, emg_use, tables : what the
        steps are told
    contacts : what is known of contacts whose forces are to be estimated, None to estimate none
    actuators : beside the model's own; None adds a weak reserve for every coordinate
    plates : force plates, for pictures and for feet that share one
    plate_time : clock of their forces (samples,) [s]
    emg_muscles : EMG channel to the muscles it was measured on
    root_note : what the forces at the root are where they are not residuals, see `ReportInput`
    real, assumed, simulated : sentences for the first lines of the report
    truth : where the recording was simulated, what is known of it: "motion", "torques", "activations"
    sources : inputs by their hashes
    report : how the report looks at the motion
    phases : parts of the motion that the report tells apart, name to start and end [s]
    parts : of a recording that joins those of several subjects and objects: each part's name, and the file of its
        model or what makes the model of an object
    """

    name: str
    subject: str
    model: Model
    markers: Markers | None = None
    loads: Callable[[Motion], Wrenches] | None = None
    emg: Emg | None = None
    events: tuple[Event, ...] = ()
    mass: float | None = None
    time: tuple[float, float] | None = None
    kinematics: InverseKinematicsOptions = field(default_factory=InverseKinematicsOptions)
    crossings: CrossingOptions = field(default_factory=CrossingOptions)
    derivatives: Differentiation = field(default_factory=Differentiation)
    torque_table: TorqueTable = field(default_factory=TorqueTable)
    tension: TensionOptions | None = None
    contacts: ContactPlan | None = None
    contact_options: ContactOptions | None = None
    emg_options: EmgOptions | None = None
    emg_use: EmgUse = field(default_factory=EmgUse)
    tables: TensionTables = field(default_factory=TensionTables)
    actuators: tuple[Actuator, ...] | None = None
    plates: tuple[ForcePlate, ...] = ()
    plate_time: Array = field(default_factory=lambda: np.zeros(0))
    emg_muscles: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: MappingProxyType({}))
    root_note: str = ""
    real: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    simulated: tuple[str, ...] = ()
    truth: Mapping[str, Series] = field(default_factory=lambda: MappingProxyType({}))
    sources: tuple[Source, ...] = ()
    warnings: tuple[str, ...] = ()
    report: ReportOptions = field(default_factory=ReportOptions)
    phases: Mapping[str, tuple[float, float]] = field(default_factory=lambda: MappingProxyType({}))
    parts: Mapping[str, str | dict[str, object]] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True, eq=False)
class Found:
    """What the steps have found so far.

    Attributes
    ----------
    fit : of inverse kinematics
    recorded : coordinates as inverse kinematics or a file gave them
    motion : coordinates that forces belong to (filtered where asked for), with derivatives
    wrenches : external forces at the motion's times, as measured
    loads : every external force, those of estimated contacts included
    carried : generalized forces of the motion under all of them
    contacts : which site touches what
    notes : what was done about doubtful input, one line each
    """

    fit: KinematicsFit | None = None
    recorded: Motion | None = None
    motion: Motion | None = None
    wrenches: Wrenches | None = None
    torques: Series | None = None
    tension: Tension | None = None
    loads: Wrenches | None = None
    carried: Series | None = None
    contacts: Contacts | None = None
    notes: tuple[str, ...] = ()
