"""Files of contacts (.toml, .csv), read into a `ContactPlan`.

They hold sites, contact intervals, stairs of load cells and sound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from pydantic import Field, FiniteFloat

from myomorph.core.contact.feet_on_steps import Stairs, Unmeasured
from myomorph.core.contact.heard import Impulse, SoundPlan
from myomorph.core.contact.plan import ContactPlan, When
from myomorph.core.contact.sites import body_sites, foot_sites
from myomorph.core.contact.sound import Instrument, speed_of_sound
from myomorph.core.contact.stairs import StairOptions, Step, step_loads
from myomorph.core.io.channels import read_channels
from myomorph.core.io.contact_events import read_events
from myomorph.core.io.wav import read_wav
from myomorph.core.model.arrays import Array
from myomorph.core.model.contacts import FOREVER, Cone, Contacts, Site, Touch, contact_law
from myomorph.core.model.errors import (
    BadData,
    BadFile,
    MyomorphError,
    UnknownName,
    check_name,
    listing,
)
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.provenance import Source
from myomorph.core.model.series import Z_UP_TO_Y_UP
from myomorph.core.model.spatial import Transform
from myomorph.core.tension.terms.contacts import ContactOptions
from myomorph.lab.store.named_files import existing
from myomorph.lab.store.results import file_source, value_source
from myomorph.lab.store.settings import Measured
from myomorph.lab.store.study_file import Strict, checked
from myomorph.lab.store.toml_file import read_toml, refuse
from myomorph.lab.study.inputs.contacts import NONE, ContactsFile, NothingTouches
from myomorph.lab.study.inputs.input import Opened, Opening
from myomorph.lab.study.inputs.loads import LoadsFile
from myomorph.lab.study.inputs.motion import MotionFile

AUTO = "auto"
Vector: TypeAlias = tuple[float, float, float]
FiniteVector: TypeAlias = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
WORDS = ("stairs", "steps", "cells", "ladder")
"""With which the name of a table of load cells ends that lies beside a trial's markers."""


class _Camera(Strict):
    rate: float | None = Field(default=None, gt=0.0, allow_inf_nan=False)
    start: FiniteFloat = 0.0


class _Site(Strict):
    name: str = Field(min_length=1)
    body: str
    points: list[Vector] = Field(min_length=1)
    against: str = GROUND
    group: str = ""
    direction: Vector | Literal["up", "any"] = "up"
    frame: str = GROUND
    friction: float = 0.8
    torsion: float = 0.0
    grip: float = 0.0
    cone_generators: int = 6
    max_force: float = float("inf")
    law: str = "pyramid"
    law_options: dict[str, FiniteFloat] = Field(default_factory=dict)
    intervals: When | list[tuple[float, float]] = "motion"
    rests: Literal["floor", "lowest"] | FiniteFloat = "floor"


class _Instrument(Strict):
    """The table `[[instrument]]` of a contact file."""

    name: str
    channel: str = "1"
    distance: float = Field(default=0.0, ge=0.0)
    sites: list[str] = Field(min_length=1)
    direction: tuple[float, float, float] | None = None
    known: list[tuple[float, float]] = Field(default_factory=list)


class _Sound(Strict):
    """The table `[sound]` of a contact file."""

    file: str
    start: float | Literal["auto"] = 0.0
    celsius: float = 20.0
    impulse: Impulse = "known"
    pulse: float = Field(default=0.008, gt=0.0)


class _ContactFile(Strict):
    feet: bool = True
    measured: Measured = "exact"
    intervals: str | None = None
    camera: _Camera = Field(default_factory=_Camera)
    site: list[_Site] = Field(default_factory=list)
    sites: list[str] = Field(default_factory=list)
    stairs: str | None = None
    sound: _Sound | None = None
    instrument: list[_Instrument] = Field(default_factory=list)


class _Stairs(Strict):
    recording: str | None = None
    up: Literal["model", "z"] = "model"
    force_on: Literal["animal", "step"] = "animal"
    unmeasured: Unmeasured = "unknown"
    tare: Literal["quiet", "none"] = "quiet"
    loaded: float = Field(default=0.04, gt=0.0, lt=1.0)
    unloaded: float = Field(default=0.02, gt=0.0, lt=1.0)
    search_range: float = Field(default=0.25, gt=0.0)


class _Step(Strict):
    name: str = Field(min_length=1)
    position: FiniteVector
    orientation: FiniteVector = (0.0, 0.0, 0.0)
    size: tuple[float, float]
    measures: list[str] = Field(min_length=1)
    channels: list[str] = Field(min_length=1)
    matrix: list[list[FiniteFloat]] | None = None
    origin: FiniteVector = (0.0, 0.0, 0.0)


class _Paw(Strict):
    body: str
    point: Vector = (0.0, 0.0, 0.0)
    name: str = ""
    friction: float = 0.8


class _StairsFile(Strict):
    stairs: _Stairs = Field(default_factory=_Stairs)
    step: list[_Step] = Field(min_length=1)
    paw: list[_Paw] = Field(default_factory=list)


def opened(settings: ContactsFile, opening: Opening) -> Opened:
    """Read what is known of the contacts of a trial."""
    if not settings.contacts:
        return Opened()
    if settings.contacts == NONE:
        return Opened((NothingTouches(),), contact_sources(settings))
    loads = opening.settings.or_default(LoadsFile).loads
    if (
        settings.measured == "shared"
        and loads is None
        and opening.settings.get(MotionFile) is not None
    ):
        raise BadData("--measured shared without --loads: give the forces that the contacts share")
    plan = read_contacts(settings.contacts, opening.model, settings.measured)
    # Options of contacts count wherever a recording has contacts.
    return Opened((plan,), contact_sources(settings), options=(opening.options[ContactOptions],))


def contact_sources(settings: ContactsFile) -> tuple[Source, ...]:
    """List the sources of contacts as inputs by their hashes."""
    source = value_source("contacts", settings.contacts, settings.contacts, settings.measured)
    if settings.contacts in (AUTO, NONE):
        return (source,)
    return source, *(
        file_source("contacts", path) for path in contact_files(Path(settings.contacts))
    )


def read_contacts(
    source: str | Path, model: Model, measured: Measured | None = None
) -> ContactPlan:
    """Read the contacts that a user specifies.

    Parameters
    ----------
    source : "auto", a table of contact intervals (.csv) or a contact file (.toml)
    model : whose bodies the sites are on
    measured : in the place of what the file specifies; None for that

    Returns
    -------
    sites, contact intervals, sound and stairs

    Raises
    ------
    BadFile : the file cannot be used; with a list of all that is wrong
    """
    if str(source) == AUTO:
        return ContactPlan(measured=measured or "exact")
    path = Path(source)
    if path.suffix.lower() == ".csv":
        return ContactPlan(reported=read_events(path), measured=measured or "exact")
    if path.suffix.lower() != ".toml":
        raise BadFile(
            path,
            f"is no file of contacts: its name ends in '{path.suffix}'",
            "expected auto, none, .csv or .toml",
        )
    found, problems = checked(_ContactFile, read_toml(path))
    if found is None:
        refuse(path, problems)
    table = existing(path.parent, found.intervals, "intervals", problems)
    steps = existing(path.parent, found.stairs, "stairs", problems)
    sound = _sound(found, path.parent, model.up, problems)
    sites = _sites(found, model, problems)
    refuse(path, problems)
    marked = None if table is None else read_events(table, found.camera.rate, found.camera.start)
    return ContactPlan(
        feet=found.feet,
        sites=tuple(sites),
        when=FrozenMap({site.name: _when(site) for site in found.site}),
        surfaces=FrozenMap(_surfaces(found)),
        reported=_all_reported(found.site, marked),
        sound=sound,
        measured=measured or found.measured,
        stairs=None if steps is None else read_stairs(steps, model),
    )


def contact_files(path: Path) -> tuple[Path, ...]:
    """List a contact file that `read_contacts` reads, and the files that it names.

    These are its table of contact intervals, its sound, its stairs and their recording. Raises
    `BadFile` where the contact file does not exist.
    """
    if not path.is_file():
        near = [one.name for one in path.parent.glob("*") if one.suffix in (".csv", ".toml")]
        beside = listing(path.name, near) if near else "none of these"
        raise BadFile(
            path, "is no file", f"expected auto, none, .csv or .toml; {path.parent} has {beside}"
        )
    if path.suffix.lower() != ".toml":
        return (path,)
    table = _ContactFile.model_validate(read_toml(path))
    named = (table.intervals, None if table.sound is None else table.sound.file, table.stairs)
    recording = () if table.stairs is None else recording_of(path.parent / table.stairs)
    return (path, *(path.parent / name for name in named if name is not None), *recording)


def _sound(
    contact_file: _ContactFile, folder: Path, up: Array, problems: list[str]
) -> SoundPlan | None:
    if contact_file.sound is None:
        return None
    file = existing(folder, contact_file.sound.file, "sound", problems)
    try:
        return (
            None
            if file is None
            else _sound_plan(contact_file.sound, contact_file.instrument, file, up)
        )
    except BadData as error:
        problems.append(str(error))
        return None


def _sites(contact_file: _ContactFile, model: Model, problems: list[str]) -> list[Site]:
    """Read the sites of a contact file, those found by name last."""
    sites: list[Site] = []
    for table in contact_file.site:
        try:
            sites.append(_site(table, model))
            _check_intervals(table)
        except MyomorphError as error:
            problems.append(f"site '{table.name}': {error}")
    try:
        sites += body_sites(model, contact_file.sites)
    except MyomorphError as error:
        problems.append(f"sites: {error}")
    return sites


def _check_intervals(site: _Site) -> None:
    """Raise `BadData` where an interval ends before it starts."""
    for start, stop in () if isinstance(site.intervals, str) else site.intervals:
        if not start <= stop:
            raise BadData(
                f"intervals = [[{start:g}, {stop:g}]]: expected a start before an end [s]"
            )


def _when(site: _Site) -> When:
    return "file" if isinstance(site.intervals, list) else site.intervals


def _site(site: _Site, model: Model) -> Site:
    for body in (site.body, site.against, site.frame):
        if body != GROUND and body not in model.body_names:
            raise UnknownName("body", body, (GROUND, *model.body_names))
    direction = model.up if site.direction == "up" else None
    if not isinstance(site.direction, str):
        direction = np.array(site.direction)
    law = contact_law(site.law)
    of_the_law = {part.name for part in fields(law)} - {part.name for part in fields(Cone)}
    options: dict[str, Any] = dict(site.law_options)
    for option in options:
        check_name("option", option, tuple(sorted(of_the_law)), f"the contact law '{site.law}'")
    numbers = (
        site.frame,
        site.friction,
        site.torsion,
        site.grip,
        site.cone_generators,
        site.max_force,
    )
    cone = law(direction, *numbers, **options)
    return Site(
        name=site.name,
        body=site.body,
        points=np.array(site.points),
        cone=cone,
        against=site.against,
        group=site.group,
    )


def _surfaces(contact_file: _ContactFile) -> dict[str, float | None]:
    """Return heights of surfaces other than the floor, by site [m]; None for the lowest position.

    Sites found by name, such as the seat, rest on a surface of their own.
    """
    raised: dict[str, float | None] = dict.fromkeys(contact_file.sites)
    for one in contact_file.site:
        if one.rests != "floor":
            raised[one.name] = None if isinstance(one.rests, str) else one.rests
    return raised


def _all_reported(sites: Sequence[_Site], read: Contacts | None) -> Contacts | None:
    """Join the contact intervals of a table and those of the sites; None where there are none."""
    touches: list[Touch] = [] if read is None else list(read.intervals)
    names = dict.fromkeys(() if read is None else read.sites)
    for site in sites:
        if site.intervals == "always":
            touches.append(
                Touch(
                    site=site.name,
                    start=-FOREVER,
                    stop=FOREVER,
                    surface=site.against,
                    source="file",
                )
            )
        elif not isinstance(site.intervals, str):
            touches += [
                Touch(site=site.name, start=start, stop=stop, surface=site.against, source="file")
                for start, stop in site.intervals
            ]
        else:
            continue
        names[site.name] = None
    warnings = () if read is None else read.warnings
    return Contacts(tuple(names), tuple(touches), warnings) if names else None


def _sound_plan(
    table: _Sound, instruments: Sequence[_Instrument], path: Path, up: Array
) -> SoundPlan:
    """Read the recording and the instruments of a contact file.

    Instruments have impacts of known impulse where impulses follow from loudness.
    """
    if not instruments:
        raise BadData(
            "a sound needs [[instrument]] tables: name, channel, distance and the sites that"
            " strike it"
        )
    for instrument in instruments:
        if table.impulse == "known" and not instrument.known:
            raise BadData(
                f"instrument '{instrument.name}' has no impacts of known impulse: give known ="
                " [[time, N s], ...], or impulse = 'motion' to take effective mass times change of"
                " velocity"
            )
    return SoundPlan(
        sound=read_wav(path, 0.0 if isinstance(table.start, str) else table.start),
        instruments=tuple(
            Instrument(
                name=one.name, channel=one.channel, distance=one.distance, sites=tuple(one.sites)
            )
            for one in instruments
        ),
        speed=speed_of_sound(table.celsius),
        find_clock=table.start == "auto",
        known={
            one.name: [(float(time), float(impulse)) for time, impulse in one.known]
            for one in instruments
        },
        directions={
            one.name: up if one.direction is None else np.array(one.direction)
            for one in instruments
        },
        impulse=table.impulse,
        pulse=table.pulse,
    )


def read_stairs(path: str | Path, model: Model, trial: Path | None = None) -> Stairs:
    """Read stairs from a file, with the loads that were recorded.

    Parameters
    ----------
    path : of the file (.toml)
    model : whose bodies the paws are
    trial : file of the markers; with it, `recording` may leave the file out (channels in a C3D file
        of markers, or a table `STEM_stairs.csv` beside it), and `{trial}` in it stands for the stem

    Returns
    -------
    steps, paws and loads

    Raises
    ------
    BadFile : with a list of all that is wrong
    """
    path = Path(path)
    found, problems = checked(_StairsFile, read_toml(path))
    if found is None:
        refuse(path, problems)
    steps: list[Step] = []
    paws: list[Site] = []
    for one in found.step:
        try:
            steps.append(_step(one, found.stairs))
        except MyomorphError as error:
            problems.append(str(error))
    for one in found.paw:
        if one.body not in model.body_names:
            problems.append(str(UnknownName("body", one.body, model.body_names)))
        else:
            cone = Cone(direction=np.array(model.up), friction=one.friction)
            paws.append(
                Site(
                    name=one.name or one.body,
                    body=one.body,
                    points=np.array([one.point]),
                    cone=cone,
                )
            )
    recording = _recording(found.stairs.recording, path, trial, problems)
    refuse(path, problems)
    assert recording is not None
    table = found.stairs
    hint = ""
    try:
        options = StairOptions(
            table.loaded, table.unloaded, search_range=table.search_range, tare=table.tare
        )
        loads = step_loads(steps, read_channels(recording), model.weight, options)
        hint = "name paws ([[paw]] body, point)"
        sites = tuple(paws) or foot_sites(model)
    except BadFile:
        raise
    except MyomorphError as error:
        raise BadFile(path, str(error), hint) from None
    return Stairs(
        path=path,
        loads=loads,
        paws=sites,
        recording=recording,
        options=options,
        unmeasured=table.unmeasured,
    )


def _step(one: _Step, stairs: _Stairs) -> Step:
    pose = Transform.from_euler_xyz(np.radians(one.orientation), one.position)
    if one.matrix is not None and len({len(row) for row in one.matrix}) != 1:
        raise BadData(f"the matrix of step '{one.name}' has rows of several lengths")
    step = Step(
        name=one.name,
        pose=pose,
        size=one.size,
        measures=tuple(name.lower() for name in one.measures),
        channels=tuple(one.channels),
        matrix=None if one.matrix is None else np.array(one.matrix, dtype=np.float64),
        origin=np.array(one.origin),
        sense=1 if stairs.force_on == "animal" else -1,
    )
    return step.rotated(Z_UP_TO_Y_UP) if stairs.up == "z" else step


def _recording(
    given: str | None, path: Path, trial: Path | None, problems: list[str]
) -> Path | None:
    if given is not None:
        if "{trial}" in given and trial is None:
            problems.append(f"stairs: recording = '{given}': '{{trial}}' needs a trial of a study")
            return None
        stem = "" if trial is None else trial.stem
        return existing(path.parent, given.replace("{trial}", stem), "stairs: recording", problems)
    if trial is not None:
        beside = [
            trial.with_name(f"{trial.stem}_{word}{ending}")
            for word in WORDS
            for ending in (".csv", ".mot", ".sto")
        ]
        result = next(
            (one for one in beside if one.is_file()),
            trial if trial.suffix.lower() == ".c3d" else None,
        )
        if result is not None:
            return result
    problems.append(
        "stairs: 'recording' is missing: the file of the load cells' channels (.c3d, .csv, .mot,"
        " .sto)"
    )
    return None


def recording_of(path: Path, trial: Path | None = None) -> tuple[Path, ...]:
    """Return the file of channels that a file of stairs names, () where it names none."""
    table = read_toml(path).get("stairs")
    given = table.get("recording") if isinstance(table, dict) else None
    found = _recording(given if isinstance(given, str) else None, path, trial, [])
    return () if found is None else (found,)
