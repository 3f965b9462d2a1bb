"""What a user says of contacts: `auto`, a table of touches (.csv), or a contact file (.toml) with sites and sources."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from pydantic import Field, FiniteFloat

from myomorph.contact.sites import body_sites
from myomorph.model.arrays import Array
from myomorph.model.contacts import Cone, Contacts, Site, Touch
from myomorph.model.errors import BadData, BadFile, MyomorphError, UnknownName, listing
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import GROUND, Model
from myomorph.report.trial.given import Situation
from myomorph.store.settings import Measured
from myomorph.store.study_file import Strict, checked, existing, read_tables, refuse
from myomorph.study.trial.sound_plan import InstrumentTable, SoundPlan, SoundTable, sound_plan
from myomorph.study.trial.stairs_file import Stairs, old_stairs_names, read_stairs, recording_of

AUTO = "auto"
Vector: TypeAlias = tuple[float, float, float]
When: TypeAlias = Literal["always", "motion", "file"]

FOREVER = 1e9
"""End of a touch that always lasts [s]."""


@dataclass(frozen=True, eq=False)
class ContactPlan:
    """What is known of the contacts of a recording before anything is computed.

    Attributes
    ----------
    feet : whether the soles of the model's feet are sites
    sites : beside the soles
    when : of each of `sites` what tells when it touches: "always", the "motion", or the "file" of its intervals
    surfaces : height of what a site rests on where that is not the floor [m], None for the lowest that it gets
    reported : contact intervals of a file; of the soles too where it names them
    sound : strokes that microphones recorded, whose forces are known by their loudness or motion
    stairs : load cells of steps that tell who stands on them and, together, what force they carry
    measured : what measured loads are used for: "exact": they act as measured, and contacts are estimated where
        none was measured; "shared": each is known for the sites on it together; "hidden": not at all
    """

    feet: bool = True
    sites: tuple[Site, ...] = ()
    when: Mapping[str, When] = field(default_factory=lambda: FrozenMap({}))
    surfaces: Mapping[str, float | None] = field(default_factory=lambda: FrozenMap({}))
    reported: Contacts | None = None
    sound: SoundPlan | None = None
    measured: Measured = "exact"
    stairs: Stairs | None = None

    @property
    def situation(self) -> Situation:
        """Which of the situations of [D] chapter 4 it is."""
        if self.sound is not None:
            return "sound"
        return "shared" if self.measured == "shared" else "unknown"


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
    intervals: When | list[tuple[float, float]] = "motion"
    rests: Literal["floor", "lowest"] | FiniteFloat = "floor"


class _File(Strict):
    feet: bool = True
    measured: Measured = "exact"
    intervals: str | None = None
    camera: _Camera = Field(default_factory=_Camera)
    site: list[_Site] = Field(default_factory=list)
    sites: list[str] = Field(default_factory=list)
    stairs: str | None = None
    sound: SoundTable | None = None
    instrument: list[InstrumentTable] = Field(default_factory=list)


def read_contacts(source: str | Path, model: Model, measured: Measured | None = None) -> ContactPlan:
    """The contacts that a user asks for.

    Parameters
    ----------
    source : "auto", a table of touches (.csv) or a contact file (.toml)
    measured : what measured loads are used for, where it is not what the file says

    Raises
    ------
    BadFile
        where the file cannot be read, with a list of all that is wrong with it
    UnknownName
        where a site is on a body that the model does not have
    """
    if str(source) == AUTO:
        return ContactPlan(measured=measured or "exact")
    path = Path(source)
    if path.suffix.lower() == ".csv":
        return ContactPlan(reported=_touches(path, _Camera()), measured=measured or "exact")
    if path.suffix.lower() != ".toml":
        raise BadFile(path, f"is no file of contacts: its name ends in '{path.suffix}'", "expected auto, .csv or .toml")
    raw, _, twice = read_tables(path, "contact file")
    found, problems = checked(_File, raw)
    problems = [*twice, *problems]
    table = None if found is None else existing(path.parent, found.intervals, "intervals", problems)
    steps = None if found is None else existing(path.parent, found.stairs, "stairs", problems)
    sound = None if found is None else _sound(found, path.parent, model.up, problems)
    sites: list[Site] = []
    for one in () if found is None else found.site:
        try:
            sites.append(_site(one, model))
            _check_spans(one)
        except MyomorphError as error:
            problems.append(f"site '{one.name}': {error}")
    try:
        sites += () if found is None else body_sites(model, found.sites)
    except MyomorphError as error:
        problems.append(f"sites: {error}")
    refuse(path, problems)
    assert found is not None
    told = _all_reported(found.site, None if table is None else _touches(table, found.camera))
    return ContactPlan(
        found.feet,
        tuple(sites),
        FrozenMap({one.name: _when(one) for one in found.site}),
        FrozenMap(_surfaces(found)),
        told,
        sound,
        measured or found.measured,
        None if steps is None else read_stairs(steps, model),
    )


def contact_files(path: Path) -> tuple[Path, ...]:
    """A contact file, and the table of touches, the sound and the stairs that it names.

    Raises
    ------
    BadFile
        where the contact file is not there
    """
    if not path.is_file():
        near = [one.name for one in path.parent.glob("*") if one.suffix in (".csv", ".toml")]
        beside = listing(path.name, near) if near else "none of these"
        raise BadFile(path, "is no file", f"expected auto, .csv or .toml; {path.parent} has {beside}")
    if path.suffix.lower() != ".toml":
        return (path,)
    raw = read_tables(path, "contact file")[0]
    sound = raw.get("sound")
    named = (raw.get("intervals"), sound.get("file") if isinstance(sound, dict) else None)
    files = [path.parent / one for one in named if isinstance(one, str)]
    if isinstance(raw.get("stairs"), str):
        steps = path.parent / raw["stairs"]
        files += (steps, *recording_of(steps)) if steps.is_file() else ()
    return (path, *(one for one in files if one.is_file()))


def old_names(path: Path) -> list[str]:
    """Notices of the old names in a file of contacts or stairs and in the files that it names; () for other kinds."""
    if path.suffix.lower() != ".toml" or not path.is_file():
        return []
    try:
        raw, notices, _ = read_tables(path, "contact file")
    except BadFile:
        # It is refused where it is used.
        return []
    stairs = raw.get("stairs")
    if isinstance(stairs, str):
        return [*notices, *old_stairs_names(path.parent / stairs)]
    return old_stairs_names(path) if isinstance(stairs, dict) else notices


def _sound(found: _File, folder: Path, up: Array, problems: list[str]) -> SoundPlan | None:
    if found.sound is None:
        return None
    file = existing(folder, found.sound.file, "sound", problems)
    try:
        return None if file is None else sound_plan(found.sound, found.instrument, file, up)
    except BadData as error:
        problems.append(str(error))
        return None


def _site(given: _Site, model: Model) -> Site:
    for body in (given.body, given.against, given.frame):
        if body != GROUND and body not in model.body_names:
            raise UnknownName("body", body, (GROUND, *model.body_names))
    direction = model.up if given.direction == "up" else None
    if not isinstance(given.direction, str):
        direction = np.array(given.direction)
    cone = Cone(
        direction, given.frame, given.friction, given.torsion, given.grip, given.cone_generators, given.max_force
    )
    return Site(given.name, given.body, np.array(given.points), cone, given.against, given.group)


def _check_spans(given: _Site) -> None:
    for start, stop in () if isinstance(given.intervals, str) else given.intervals:
        if not start <= stop:
            raise BadData(f"intervals = [[{start:g}, {stop:g}]]: expected a start before an end [s]")


def _surfaces(found: _File) -> dict[str, float | None]:
    """Heights of surfaces other than the floor; sites found by name, as the seat, rest on one of their own."""
    raised: dict[str, float | None] = dict.fromkeys(found.sites)
    for one in found.site:
        if one.rests != "floor":
            raised[one.name] = None if isinstance(one.rests, str) else one.rests
    return raised


def _when(given: _Site) -> When:
    return given.intervals if isinstance(given.intervals, str) else "file"


def _touches(path: Path, camera: _Camera) -> Contacts:
    from myomorph.io.contact_events import read_events

    return read_events(path, rate=camera.rate, start=camera.start)


def _all_reported(sites: Sequence[_Site], read: Contacts | None) -> Contacts | None:
    """The touches of a table, and those written beside the sites; None where neither tells anything."""
    touches: list[Touch] = [] if read is None else list(read.intervals)
    names = dict.fromkeys(() if read is None else read.sites)
    for one in sites:
        if one.intervals == "always":
            touches.append(Touch(one.name, -FOREVER, FOREVER, one.against, source="file"))
        elif not isinstance(one.intervals, str):
            touches += [Touch(one.name, *span, one.against, source="file") for span in one.intervals]
        else:
            continue
        names[one.name] = None
    warnings = () if read is None else read.warnings
    return Contacts(tuple(names), tuple(touches), warnings) if names else None
