"""External forces of a trial: of a file, or of the plates in its recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Self
from weakref import WeakKeyDictionary

from myomorph.core.contact.plate_forces import PlateForces
from myomorph.core.io.force_table import holds_forces
from myomorph.core.io.parsing.door import content_of
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.series import Motion, Trial, Wrenches
from myomorph.lab.study.inputs.beside import TABLE_ENDINGS, companion, is_alone, plain_stem
from myomorph.lab.study.inputs.input import Beside, Input, Opened, Opening, later
from myomorph.lab.study.inputs.keys import File, Names, Pairs
from myomorph.lab.study.inputs.markers import Recording

WORDS = (
    "grf",
    "GRF",
    "external_loads",
    "external_forces",
    "externalforces",
    "ExternalLoads",
    "loads",
    "forces",
)
"""In the name of a file of forces that belongs to a recording."""
TABLES = (".mot", ".sto", ".csv", ".txt")  # Endings of tables of forces.
FOLDERS = ("grf", "grfs", "forces", "force", "forcedata", "loads", "forceplates")
"""Names of folders of forces, in small letters without underscores."""


@dataclass(frozen=True)
class LoadsFile:
    """External forces.

    Attributes
    ----------
    loads : external forces: an OpenSim external loads file (.xml), a table of forces (.mot, .sto,
        .csv), or a recording with force plates (.c3d)
    bodies : PREFIX=BODY ...: body on which each force of a table acts, by the prefix of its column
        names; by default the foot nearest to its center of pressure
    plates : BODY,BODY,...: bodies on the force plates of a recording, in the order of the plates,
        none to leave a plate out; by default the foot nearest to the center of pressure at each
        step
    """

    loads: Annotated[Path | None, File(per="trial")] = None
    bodies: Annotated[
        Mapping[str, str], Pairs(of="body", shown="prefix=body, as ground_force_r_=calcn_r")
    ] = field(default_factory=lambda: FrozenMap({}))
    plates: Annotated[tuple[str, ...], Names(of="body")] = ()


@dataclass(frozen=True, eq=False)
class ExternalLoads:
    """External forces of a motion, which is needed to find the bodies they act on.

    Attributes
    ----------
    measured : reads the forces and holds them against the motion; bodies as far as they are named
    on_bodies : gives forces without a body to the feet; None where all have one
    nearest : nobody named the bodies, so each force is put on the foot nearest to its center of
        pressure
    """

    measured: Callable[[Motion], PlateForces]
    on_bodies: Callable[[Wrenches, Motion], Wrenches] | None = None
    nearest: bool = False
    _measured: WeakKeyDictionary[Motion, PlateForces] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )
    _acting: WeakKeyDictionary[Motion, Wrenches] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )

    @classmethod
    def on_known_bodies(cls, find: Callable[[Motion], Wrenches]) -> Self:
        """Take forces whose bodies are known."""
        return cls(lambda motion: PlateForces(find(motion)))

    def as_measured(self, motion: Motion) -> PlateForces:
        """Return external forces of a motion before they are put on bodies.

        They are found once as long as the motion exists: reading and checks take most of the time
        of inverse dynamics.
        """
        if motion not in self._measured:
            self._measured[motion] = self.measured(motion)
        return self._measured[motion]

    def of(self, motion: Motion) -> Wrenches:
        """External forces of a motion on bodies, found once as long as the motion exists."""
        if motion not in self._acting:
            wrenches = self.as_measured(motion).wrenches
            given = self.on_bodies
            self._acting[motion] = wrenches if given is None else given(wrenches, motion)
        return self._acting[motion]


def loads_by_name(recording: Path) -> Path | None:
    """Find the forces that belong to a recording by the rule of names, None where there are none.

    A model may have the recording's name.
    """
    path = companion(recording, WORDS, (".xml", *TABLE_ENDINGS), alone=True)
    model = path is not None and path.suffix == ".xml" and b"<mujoco" in content_of(path, "XML")
    return companion(recording, WORDS, TABLE_ENDINGS, alone=True) if model else path


def _beside(recording: Path, values: Mapping[str, Any]) -> Beside:
    """Find them where nothing else holds what they do, and a table has columns of forces."""
    path = None if values.get("torques") is not None else loads_by_name(recording)
    # Of sensors alone the recording is a table itself.
    if path == recording:
        return Beside(None)
    if (
        path is None
        or values.get("bodies")
        or path.suffix.lower() not in TABLE_ENDINGS
        or holds_forces(path)
    ):
        return Beside(path)
    return Beside(None, f"{path.name} is not used: no columns of forces are found in it")


def _near(recording: Path, trial: Trial) -> Path | None:
    """Find the forces of a recording without plates.

    They are found by its name, beside it or in a folder of forces, else as the only ones.
    """
    if trial.plates:
        return None
    for folder in (recording.parent, *_force_folders(recording)):
        path = loads_by_name(folder / recording.name)
        if path is not None and _has_forces(path):
            return path
    files = sorted(recording.parent.iterdir())
    tables = [file for file in files if file.suffix.lower() in TABLES and file != recording]
    stem = plain_stem(recording).lower()
    named = _only([table for table in tables if table.stem.lower().startswith(stem)])
    if named is not None:
        return named
    return _only(tables) if is_alone(recording) else None


def _force_folders(recording: Path) -> list[Path]:
    """List the folders of forces beside a recording, and beside its folder."""
    homes = [home for home in (recording.parent, recording.parent.parent) if home.is_dir()]
    folders = [folder for home in homes for folder in sorted(home.iterdir()) if folder.is_dir()]
    return [folder for folder in folders if folder.name.lower().replace("_", "") in FOLDERS]


def _only(tables: list[Path]) -> Path | None:
    """Return the table that has forces, None where several or none have."""
    forces = [table for table in tables if _has_forces(table)]
    return forces[0] if len(forces) == 1 else None


def _has_forces(path: Path) -> bool:
    return path.suffix.lower() not in TABLES or holds_forces(path)


def _open(settings: LoadsFile, opening: Opening) -> Opened:
    """Open the external forces; what they take is not imported where there cannot be any."""
    recording = opening.values.get(Recording)
    is_stated = settings.loads is not None or settings.bodies or settings.plates
    if not is_stated and (recording is None or not recording.trial.plates):
        return Opened()
    return later("myomorph.lab.study.inputs.external_forces:opened")(settings, opening)


INPUT = Input(
    name="loads",
    settings=LoadsFile,
    open=_open,
    main="loads",
    beside=_beside,
    near=_near,
)
