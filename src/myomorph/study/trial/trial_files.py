"""The files of one recording, and what their results say they were made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from myomorph.model.frozen_map import FrozenMap
from myomorph.model.provenance import Source
from myomorph.store.results import file_source, value_source
from myomorph.store.settings import Measured, Side
from myomorph.study.inputs import reading
from myomorph.study.inputs.laboratory import AS_RECORDED, Laboratory

Settings = Mapping[str, Mapping[str, Any]]
"""The settings of each step, by step and setting."""


@dataclass(frozen=True)
class TrialFiles:
    """The files of one recording of one subject.

    Attributes
    ----------
    markers : TRC or C3D file
    motion : table of coordinates, where inverse kinematics is not asked for
    loads : external loads file, a table of forces, or a recording with force plates
    torques : table of generalized forces, in the place of loads and inverse dynamics
    bodies : prefix of the columns of each force in a table, and the body it acts on; the nearest foot by default
    plates : bodies that stand on the plates of a recording, in their order, "" for none; the nearest foot by default
    emg_muscles : EMG channel to the muscles it was measured on, where its name does not tell
    emg_mvc : recordings of maximum voluntary contractions, that EMG is scaled to
    emg_side : side of channels whose names contain none
    emg_gains : gains of the subject's channels, found over all trials; None finds them on this recording alone
    refined : coordinates that the subject's step `refine` found; no such file where the trial was not among its own
    refined_cutoff : of the low-pass filter of the forces that these agree with [Hz]
    error_sizes : tables of how far off the model may be, in the order of the steps that found it; () for those that
        a command left beside the model
    contacts : "auto", or a file of touches or contact sites; "" to estimate no contact force
    measured : what measured forces are used for where contacts are estimated; None as the file says
    contact_points : "auto", a folder of bone meshes, or a file of points that share a joint's force; "" for none
    phases : parts of the motion that the report tells apart, name to start and end [s]
    mass : of the subject [kg]
    time : start and end [s]
    labels : what the model calls markers that the recording calls otherwise, "" for those to leave out
    condition : that it was recorded in, as the study file names it
    laboratory : how its axes stand to the model's
    assumed : what was assumed of the recording, sentences for the first lines of the report
    """

    model: Path
    name: str = ""
    subject: str = ""
    markers: Path | None = None
    motion: Path | None = None
    loads: Path | None = None
    torques: Path | None = None
    bodies: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    plates: tuple[str, ...] = ()
    emg: Path | None = None
    emg_muscles: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: FrozenMap({}))
    emg_mvc: tuple[Path, ...] = ()
    emg_side: Side = ""
    emg_gains: Path | None = None
    refined: Path | None = None
    refined_cutoff: float = 6.0
    tasks: Path | None = None
    actuators: Path | None = None
    error_sizes: tuple[Path, ...] = ()
    contacts: str = ""
    measured: Measured | None = None
    contact_points: str = ""
    phases: Mapping[str, tuple[float, float]] = field(default_factory=lambda: FrozenMap({}))
    mass: float | None = None
    time: tuple[float, float] | None = None
    labels: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    condition: str = ""
    laboratory: Laboratory = AS_RECORDED
    assumed: tuple[str, ...] = ()


def contact_sources(files: TrialFiles) -> list[Source]:
    """What tells of contacts, as inputs by their hashes."""
    # Most trials start without: loaded where a trial has such input.
    from myomorph.study.inputs.contact_file import AUTO, contact_files

    source = value_source("contacts", files.contacts, files.contacts, files.measured)
    if files.contacts == AUTO:
        return [source]
    return [source, *(file_source("contacts", path) for path in contact_files(Path(files.contacts)))]


def load_tables(path: Path, markers: Path | None = None) -> list[Source]:
    """The tables that an external loads file, or a file of stairs, takes its numbers from."""
    if path.suffix.lower() == ".toml":
        # Most trials start without: loaded where a trial has such input.
        from myomorph.study.inputs.contact_file import recording_of

        return [file_source("load table", one) for one in recording_of(path, markers)]
    if path.suffix.lower() != ".xml":
        return []
    # Brings SciPy: loaded only where loads are in an XML file.
    from myomorph.io.loads import read_load_entries

    with reading.about(path):
        tables = dict.fromkeys(entry.data for entry in read_load_entries(path))
    return [file_source("load table", table) for table in tables]
