"""External forces of a motion from files of every kind.

They are external loads, a table, a recording's plates, or stairs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from myomorph.core.contact.force_checks import BODY_CHECKS, CHECKS, checked_forces
from myomorph.core.contact.force_inspection import LOAD
from myomorph.core.contact.plan import ContactPlan
from myomorph.core.contact.plate_forces import PlateForces
from myomorph.core.contact.unloaded import ZERO, zero_messages
from myomorph.core.io.force_table import force_layout, read_forces
from myomorph.core.io.formats import trial_format
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import CLOCKS, READING
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.model.findings import Finding, messages_of_findings
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Source
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import Z_UP_TO_Y_UP, Motion, Trial, Wrenches
from myomorph.core.motion.sync import clock_shift
from myomorph.lab.store.results import file_source, value_source
from myomorph.lab.store.settings import ForceOptions
from myomorph.lab.study.inputs.contacts import ContactsFile
from myomorph.lab.study.inputs.input import Opened, Opening
from myomorph.lab.study.inputs.laboratory import AS_RECORDED, Laboratory
from myomorph.lab.study.inputs.loads import TABLES, ExternalLoads, LoadsFile
from myomorph.lab.study.inputs.markers import MarkersFile, Recording
from myomorph.lab.study.inputs.plate_wrenches import nearest_feet, recorded_wrenches
from myomorph.lab.study.inputs.reading import PosesBy, about, faces_z, read_recording
from myomorph.lab.study.inputs.torques import TorquesFile

NOBODY = ("", "-", "none")  # What stands for a plate on which nobody steps.


def opened(settings: LoadsFile, opening: Opening) -> Opened:
    """Read the external forces of a trial from a file, or from the plates in its recording.

    Raises `BadData` where bodies are named, but there are no forces.
    """
    sources: tuple[Source, ...] = ()
    if settings.bodies or settings.plates:
        bodies = sorted(settings.bodies.items())
        sources = (value_source("bodies", "bodies of the forces", bodies, settings.plates),)
    if settings.loads is not None:
        return _opened_file(settings, settings.loads, opening, sources)
    recording = opening.values.get(Recording)
    if recording is None:
        if sources:
            raise BadData(
                "bodies of forces without forces: give --loads FILE with --plates or --bodies"
            )
        return Opened()
    if not _uses_plates(settings, recording.trial, opening):
        return Opened(sources=sources)
    return _opened_plates(settings, recording.trial, opening, sources)


def _opened_file(
    settings: LoadsFile, path: Path, opening: Opening, sources: tuple[Source, ...]
) -> Opened:
    """Return the external forces of a file, which are read when they are used."""
    model = opening.model
    markers = opening.settings.or_default(MarkersFile).markers
    options = opening.options[ForceOptions]
    shared = _are_shared(opening)
    file = ForceFile(
        path=path,
        bodies=settings.bodies,
        markers=markers,
        plates=settings.plates,
        laboratory=opening.settings.or_default(Laboratory),
        options=options,
    )
    loads = ExternalLoads(
        measured=partial(_of_file, file, model, shared=shared),
        on_bodies=partial(given_to_feet, model=model, options=options, shared=shared),
        nearest=not settings.bodies and not settings.plates and names_no_body(path),
    )
    sources = (*sources, file_source("loads", path), *load_tables(path, markers))
    return Opened((loads,), sources, real=f"external forces from {path.name}")


def _uses_plates(settings: LoadsFile, trial: Trial, opening: Opening) -> bool:
    """Return whether the plates in a recording are the external forces."""
    torques = opening.settings.get(TorquesFile)
    # Torques of a file hold whatever acts from outside.
    if torques is not None and torques.torques is not None:
        return False
    if settings.plates:
        return any(map(_body_on_plate, settings.plates))
    return bool(trial.plates and feet_of(opening.model))


def _opened_plates(
    settings: LoadsFile, trial: Trial, opening: Opening, sources: tuple[Source, ...]
) -> Opened:
    """Return the external forces of a recording's plates."""
    model = opening.model
    options = opening.options[ForceOptions]
    shared = _are_shared(opening)
    loads = ExternalLoads(
        measured=partial(
            _of_recording, trial, settings.plates, model, options=options, shared=shared
        ),
        on_bodies=partial(given_to_feet, model=model, options=options, shared=shared),
        nearest=not settings.plates,
    )
    contacts = opening.values.get(ContactPlan)
    assumed: tuple[str, ...] = ()
    if not settings.plates and (contacts is None or contacts.measured != "shared"):
        assumed = (
            "The force of each plate acts on the foot that is nearest to its center of pressure.",
        )
    return Opened((loads,), sources, real="external forces of the plates", assumed=assumed)


def names_no_body(path: Path) -> bool:
    """Return whether files of a kind say nothing of the bodies that forces act on."""
    return path.suffix.lower() in TABLES or trial_format(path) is not None


def _are_shared(opening: Opening) -> bool:
    """Return whether contacts share the external forces, so that they are not on one body each.

    Only what needs no foot of a force is then checked and corrected.
    """
    contacts = opening.settings.get(ContactsFile)
    if contacts is None or not contacts.estimated:
        return False
    return opening.values[ContactPlan].measured == "shared"


def load_tables(path: Path, markers: Path | None = None) -> list[Source]:
    """List the tables that an external loads file, or a file of stairs, takes its numbers from."""
    if path.suffix.lower() == ".toml":
        from myomorph.lab.study.inputs.contact_file import recording_of

        return [file_source("load table", table) for table in recording_of(path, markers)]
    if path.suffix.lower() != ".xml":
        return []
    from myomorph.core.io.loads import read_load_entries

    with about(path):
        tables = dict.fromkeys(entry.data for entry in read_load_entries(path))
    return [file_source("load table", table) for table in tables]


def read_loads(  # page: what is known of files of several kinds, most of it optional
    path: str | Path,
    model: Model,
    motion: Motion,
    bodies: Mapping[str, str] | None = None,
    trial: Path | None = None,
    plates: Sequence[str] = (),
    laboratory: Laboratory = AS_RECORDED,
    options: ForceOptions | None = None,
) -> Wrenches:
    """Read external forces from a file.

    It is an OpenSim external loads file, a table of forces, a recording with force plates, or a
    file of stairs.

    Forces of a table or of plates whose bodies are not given go to the foot that is nearest to
    their center of pressure, step by step: feet that step on one plate in turn each get their part.

    Source: Seth et al. 2018, `ExternalLoads`; Motion Lab Systems, the C3D file format.

    Parameters
    ----------
    path : of the file; an XML names its table
    model : whose bodies the forces act on
    motion : coordinates (frames, coordinates) [rad or m], to find bodies and for loads in a body's
        frame
    bodies : for a table: what the names of the columns of each force begin with, and the body it
        acts on
    trial : for stairs: the file of the markers, which specifies the one of the load cells
    plates : for a recording: bodies on its plates in their order, "" for a plate that is left out
    laboratory : how the axes that the forces are along stand to the model's
    options : whether they are checked against the motion and corrected, with a note of each
        finding; and their clock

    Returns
    -------
    forces [N], points [m] and free torques [N m] in ground, (samples, forces, 3) each

    Raises
    ------
    BadFile, BadData, BadModel, UnknownName
        where a file is not what it should be, or names what the table or the model does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> loads = mm.read_loads("reach_grf.xml", model, mm.read_motion("reach.mot", model))
    >>> loads.bodies, loads.forces[0, 0].tolist()
    (('fore',), [0.0, -10.0, 0.0])
    """
    file = ForceFile(
        path=Path(path),
        bodies=bodies or FrozenMap({}),
        markers=trial,
        plates=plates,
        laboratory=laboratory,
        options=options or ForceOptions(),
    )
    measured = raw_loads(file, model, motion)
    with about(path):
        return on_feet(measured.wrenches, model, motion, options)


@dataclass(frozen=True, kw_only=True)
class ForceFile:
    """A file of external forces, and what a user specifies of it; see `read_loads`.

    Attributes
    ----------
    path : of the file; an XML names its table
    bodies : of a table: body of each prefix of a force's columns
    markers : for stairs: the file of the markers
    plates : of a recording: bodies on its plates in their order
    laboratory : how the axes that the forces are along stand to the model's
    options : columns, rate, origins and clock of the forces, and how they are checked
    """

    path: Path
    bodies: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    markers: Path | None = None
    plates: Sequence[str] = ()
    laboratory: Laboratory = AS_RECORDED
    options: ForceOptions = field(default_factory=ForceOptions)


def _of_file(file: ForceFile, model: Model, motion: Motion, *, shared: bool) -> PlateForces:
    """Check external forces of a file against the motion; bodies as far as they are named."""
    measured = raw_loads(file, model, motion)
    with about(file.path):
        checked = checked_loads(measured.wrenches, model, motion, file.options, shared)
    return replace(measured, wrenches=checked)


def _of_recording(
    trial: Trial,
    plates: Sequence[str],
    model: Model,
    motion: Motion,
    *,
    options: ForceOptions,
    shared: bool,
) -> PlateForces:
    """Check forces of a recording's plates against the motion; bodies as far as they are named."""
    wrenches = checked_loads(plate_wrenches(trial, plates), model, motion, options, shared)
    return PlateForces(wrenches, outlines_of(trial))


def outlines_of(trial: Trial) -> FrozenMap[str, Array]:
    """Return the corners of a recording's plates.

    Parameters
    ----------
    trial : recording with plates

    Returns
    -------
    (4, 3) [m] by the name of the plate
    """
    return FrozenMap({plate.name: plate.corners for plate in trial.plates})


def on_feet(
    wrenches: Wrenches,
    model: Model,
    motion: Motion,
    options: ForceOptions | None = None,
    shared: bool = False,
) -> Wrenches:
    """Check forces against the motion and put each on a body.

    What is wrong is corrected and noted, or noted only.

    Parameters
    ----------
    wrenches : external forces; "" for a body that is not known
    model : whose bodies they act on
    motion : of the same recording
    options : of the checks; None for the defaults
    shared : contacts share the forces, so that the foot of a force is not checked

    Returns
    -------
    forces that all have a body

    Raises
    ------
    BadData : a body is not known and the model has no foot
    """
    checked = checked_loads(wrenches, model, motion, options, shared)
    return given_to_feet(checked, motion, model=model, options=options, shared=shared)


def checked_loads(
    wrenches: Wrenches,
    model: Model,
    motion: Motion,
    options: ForceOptions | None = None,
    shared: bool = False,
) -> Wrenches:
    """Check forces against the motion, on the bodies that are named, as far as any are.

    Arguments are those of `on_feet`.
    """
    options = options or ForceOptions()
    findings: tuple[Finding, ...] = ()
    repair = options.force_checks == "repair"
    if options.force_shift:
        wrenches = replace(wrenches, time=wrenches.time + options.force_shift)
    else:
        wrenches = on_clock(wrenches, motion.time, repair)
    # Of frames that are still to arrive there is no motion to hold forces against.
    if options.force_checks != "none" and len(motion) > 1:
        checks = BODY_CHECKS if shared else CHECKS
        found = checked_forces(wrenches, model, motion, repair, checks)
        findings = found.findings
        wrenches = _without_loads(found.wrenches, findings)
    texts = messages_of_findings(findings)
    others = (text for text in wrenches.notes if text not in texts)
    return replace(wrenches, notes=(*texts, *others), findings=(*wrenches.findings, *findings))


def given_to_feet(
    wrenches: Wrenches,
    motion: Motion,
    *,
    model: Model,
    options: ForceOptions | None = None,
    shared: bool = False,
) -> Wrenches:
    """Put checked forces without a body on the feet that are nearest.

    Arguments and errors are those of `on_feet`.
    """
    if all(wrenches.bodies):
        return wrenches
    checked = (options or ForceOptions()).force_checks != "none"
    explained = [item.place for item in wrenches.findings if item.kind != ZERO]
    found = nearest_feet(wrenches, model, motion, checked and not shared)
    places = tuple(f"{place} may carry" for place in explained)
    return replace(found, notes=tuple(note for note in found.notes if not note.startswith(places)))


def _without_loads(wrenches: Wrenches, findings: Sequence[Finding]) -> Wrenches:
    """Leave out forces without a body that no foot carries.

    None of them is then put on the nearest foot.
    """
    loads = {finding.place for finding in findings if finding.kind == LOAD}
    names = zip(wrenches.names, wrenches.bodies, strict=True)
    kept = [index for index, (name, body) in enumerate(names) if body or name not in loads]
    return wrenches if len(kept) == len(wrenches.names) else wrenches.columns(kept)


def on_clock(wrenches: Wrenches, time: Array, repair: bool = True) -> Wrenches:
    """Move forces to the motion's clock where theirs begins at another zero.

    The shift is noted.

    Parameters
    ----------
    wrenches : external forces
    time : of the motion (frames,) [s]
    repair : move them where the shift is certain; else it is only noted

    Returns
    -------
    the forces on the motion's clock

    Raises
    ------
    BadData : they have no time in common with the motion, and nothing shows how far to move them
    """
    if not len(wrenches) or not len(time):
        return wrenches
    shift = clock_shift(time, wrenches.time)
    if shift == 0.0:
        return wrenches
    spans = (
        f"the forces run from {wrenches.time[0]:g} to {wrenches.time[-1]:g} s, the motion from"
        f" {time[0]:g} to {time[-1]:g} s"
    )
    apart = min(time[-1], wrenches.time[-1]) < max(time[0], wrenches.time[0])
    if shift is None or (apart and not repair):
        begin = time[0] - wrenches.time[0]
        raise BadData(
            f"{spans}: no time in common; state what is to be added to the forces' times"
            f" (--force-shift SECONDS; {begin:.4g} lets both begin together)"
        )
    done = f"moved by {shift:.4g} s" if repair else f"not moved; --force-shift {shift:.4g} does"
    text = CLOCKS.message(
        f"{spans}: both last equally long, so their clocks have different zeros: {done}",
        size=1e3 * abs(shift),
    )
    moved = replace(wrenches, time=wrenches.time + shift) if repair else wrenches
    findings = (
        Finding(
            kind="clock zero", place=", ".join(wrenches.names), text=text, times=(), repaired=repair
        ),
        *wrenches.findings,
    )
    return replace(moved, notes=(text, *wrenches.notes), findings=findings)


def raw_loads(file: ForceFile, model: Model, motion: Motion) -> PlateForces:
    """Read external forces as a file has them, unchecked, with the outlines of plates.

    A body that neither the file nor the user names is "". Errors are those of `read_loads`.
    """
    path = file.path
    ending = path.suffix.lower()
    outlines: Mapping[str, Array] = FrozenMap({})
    _refuse_wrong_kind(path, ending, file.bodies, file.plates)
    if ending in TABLES:
        with about(path):
            wrenches = file.laboratory.wrenches(force_table(path, file.bodies, file.options))
    elif ending == ".xml":
        from myomorph.core.io.loads import read_external_loads

        with about(path):
            loads = read_external_loads(path, poses=PosesBy(model, motion))
            wrenches = file.laboratory.wrenches(loads)
    elif ending == ".toml":
        from myomorph.core.contact.feet_on_steps import stairs_wrenches
        from myomorph.lab.study.inputs.contact_file import read_stairs

        wrenches = stairs_wrenches(read_stairs(path, model, file.markers), model, motion)
    elif trial_format(path) is not None:
        with about(path):
            recording = upright(file.laboratory.trial(read_recording(path)), model)
            wrenches = plate_wrenches(recording, file.plates)
            outlines = outlines_of(recording)
    else:
        raise BadFile(
            path,
            f"holds no external loads: its name ends in '{ending}'",
            "expected .xml, a table of forces (.mot, .sto, .csv), a recording with force plates"
            " (.c3d), or .toml of force-measuring stairs",
        )
    for body in wrenches.bodies:
        if body and body not in model.body_names and body != "ground":
            raise BadData(f"{path}: {UnknownName('body', body, model.body_names)}")
    if ending not in (*TABLES, ".xml"):
        return PlateForces(wrenches, outlines)
    weight = model.weight if model.mass > 0.0 else 0.0
    zeros = zero_messages(wrenches, np.asarray(model.up), weight)
    findings = (Finding(kind=ZERO, place=zero.place, text=zero) for zero in zeros)
    noted = replace(
        wrenches, notes=(*wrenches.notes, *zeros), findings=(*wrenches.findings, *findings)
    )
    return PlateForces(noted)


def _refuse_wrong_kind(
    path: Path, ending: str, bodies: Mapping[str, str], plates: Sequence[str]
) -> None:
    """Raise `BadData` where bodies are named in the way of another kind of file."""
    recording = trial_format(path) is not None
    if plates and not recording:
        raise BadData(
            f"{path}: bodies on plates (--plates) belong to a recording (.c3d): name forces by"
            " prefix=body"
        )
    if bodies and recording:
        raise BadData(
            f"{path}: a recording's plates have no column names: name their bodies in order"
            " (--plates)"
        )
    if bodies and ending in (".xml", ".toml"):
        raise BadData(f"{path}: names the bodies itself: leave out prefix=body")


def force_table(
    path: str | Path, bodies: Mapping[str, str] | None = None, options: ForceOptions | None = None
) -> Wrenches:
    """Read forces of a table by the names of its columns.

    Parameters
    ----------
    path : of the table
    bodies : body of each prefix of a force's columns ("ground_force_", "1_ground_force_",
        "ground_force_r_"); a body that is not named is ""
    options : columns, rate and origins that the table does not specify

    Returns
    -------
    external forces
    """
    told = options or ForceOptions()
    return read_forces(
        Path(path), bodies, force_layout(told.force_columns, told.force_rate, told.force_origins)
    )


def plate_wrenches(trial: Trial, plates: Sequence[str] = ()) -> Wrenches:
    """Return forces of a recording's plates on the bodies that are named, "" where none is."""
    if not trial.plates:
        why = f" ({'; '.join(trial.warnings)})" if trial.warnings else ""
        raise BadData(f"{trial.source}: holds no force plate that can be read{why}")
    return recorded_wrenches(trial, [_body_on_plate(plate) for plate in plates] if plates else None)


def upright(trial: Trial, model: Model) -> Trial:
    """Turn a recording of plates to the model's vertical.

    One whose plates lie level with z is turned to y up.
    """
    if model.gravity[1] < 0.0 and trial.plates and all(map(faces_z, trial.plates)):
        return replace(
            trial.rotated(Z_UP_TO_Y_UP),
            warnings=(
                *trial.warnings,
                READING.message(
                    "the plates lie level with z: the recording was turned to the model's y axis"
                ),
            ),
        )
    return trial


def _body_on_plate(text: str) -> str:
    return "" if text.strip().lower() in NOBODY else text.strip()
