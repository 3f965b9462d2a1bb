"""The files of a specimen, before anything is read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import Field

from myomorph.core.model.errors import listing
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.store import named_files
from myomorph.lab.store.study_file import Strict
from myomorph.swings.viscosity.cohort import QUANTITIES
from myomorph.swings.viscosity.identification.base_load import BaseLoad
from myomorph.swings.viscosity.identification.identify import STATES
from myomorph.swings.viscosity.study.base_mass import BaseMassTable, base_load
from myomorph.swings.viscosity.study.calibration import (
    PlateFiles,
    PlateTable,
    ScanFiles,
    found_scans,
    plate_files,
)
from myomorph.swings.viscosity.study.recordings import (
    CONDITIONS,
    OPTIONS,
    RecordingTable,
    Span,
    SwingFiles,
    found_swings,
)
from myomorph.swings.viscosity.study.study_folder import StudyFolder

INSEPARABLE = "muscle viscosity cannot be separated from the joint's"
Vertical = Literal["x", "y", "z"]


class SpecimenTable(Strict):
    """A specimen in a study file."""

    name: str
    model: str
    removed: list[str | RecordingTable] = Field(default_factory=list)
    intact: list[str | RecordingTable] = Field(default_factory=list)
    measured_muscle_mass: float | None = Field(default=None, gt=0.0)
    base: str | None = None
    first_body: str | None = None
    bones: list[str] = Field(default_factory=list)
    joint: Literal["ball", "hinge"] = "ball"
    up: Vertical | None = None
    muscles: dict[str, list[str]] = Field(default_factory=dict)
    pcsa: dict[str, float] = Field(default_factory=dict)
    tare: str | None = None
    base_mass: float | BaseMassTable | None = None
    plate: PlateTable | None = None
    ct: list[ScanFiles] = Field(default_factory=list)
    time: Span | None = None
    truth: dict[str, float] = Field(default_factory=dict)
    paper: dict[str, float] = Field(default_factory=dict)


@dataclass(frozen=True)
class SpecimenFiles:
    """What is known of one specimen before anything is read.

    Attributes
    ----------
    name : of the specimen
    model : file
    joint : ball or hinge, the one that swings
    without, intact : recordings without and with muscles; either may be empty
    measured_muscle_mass : of the removed muscles on a scale [kg]
    base, first : bodies of the model, None for those called scapula and humerus
    bones : bodies that carry markers, () for those of the limb whose markers were recorded
    muscles : strands of the model by the muscle's name, empty for the 11 of [S] figure 1
    pcsa : cross-section of each muscle, empty for shares of isometric force
    tare : forces of the plate with the fixture but without limb, None where it was set to zero so
    base_load : what the base carries beyond the plate's zero
    plate : how its place among the markers is known, None where the C3D files know it
    ct : scanned bones and clusters, where the model's own markers are not to be used
    truth, paper : values of `QUANTITIES` that are known from elsewhere
    up : axis of the laboratory that points up, None for the model's
    """

    name: str
    model: Path
    without: tuple[SwingFiles, ...] = ()
    intact: tuple[SwingFiles, ...] = ()
    measured_muscle_mass: float | None = None
    base: str | None = None
    first: str | None = None
    bones: tuple[str, ...] = ()
    joint: Literal["ball", "hinge"] = "ball"
    muscles: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: FrozenMap({}))
    pcsa: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    tare: Path | None = None
    plate: PlateFiles | None = None
    ct: tuple[ScanFiles, ...] = ()
    truth: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    paper: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    up: Vertical | None = None
    base_load: BaseLoad = field(default_factory=BaseLoad)

    @property
    def recordings(self) -> dict[str, tuple[SwingFiles, ...]]:
        """By `CONDITIONS`."""
        return dict(zip(CONDITIONS, (self.without, self.intact), strict=True))


def specimen_files(table: SpecimenTable, folder: StudyFolder) -> SpecimenFiles:
    """Find the files of a specimen; what is wrong is added to the folder's problems.

    Parameters
    ----------
    table : of the study file
    folder : of the study file
    """
    where = f"specimen '{table.name}'"
    problems = folder.problems
    _check_conditions(table, where, folder)
    _check_quantities(table, where, problems)
    swings = {
        option: tuple(found_swings(entries, table.time, f"{where}: {option}", folder))
        for option, entries in zip(OPTIONS.values(), (table.removed, table.intact), strict=True)
    }
    model = named_files.existing(folder.path, table.model, f"{where}: model", problems)
    tare = named_files.existing(folder.path, table.tare, f"{where}: tare", problems)
    plate = None
    if table.plate is not None:
        plate = plate_files(table.plate, f"{where}: plate", folder)
    return SpecimenFiles(
        name=table.name,
        model=model or folder.path,
        without=swings["removed"],
        intact=swings["intact"],
        first=table.first_body,
        bones=tuple(table.bones),
        muscles=FrozenMap({name: tuple(strands) for name, strands in table.muscles.items()}),
        tare=tare,
        plate=plate,
        ct=tuple(found_scans(table.ct, f"{where}: ct", folder)),
        base_load=base_load(table.base_mass, where, folder),
        measured_muscle_mass=table.measured_muscle_mass,
        base=table.base,
        joint=table.joint,
        up=table.up,
        pcsa=FrozenMap(dict(table.pcsa)),
        truth=FrozenMap(dict(table.truth)),
        paper=FrozenMap(dict(table.paper)),
    )


def _check_conditions(table: SpecimenTable, where: str, folder: StudyFolder) -> None:
    """Note where a specimen lacks recordings of one condition, or of both."""
    if not table.removed and not table.intact:
        folder.problems.append(f"{where}: has no recordings: give 'removed', 'intact' or both")
    elif not table.removed or not table.intact:
        state = STATES["with" if table.removed else "without"]
        folder.remarks.append(f"{where}: no recordings of {state}: {INSEPARABLE}")


def _check_quantities(table: SpecimenTable, where: str, problems: list[str]) -> None:
    """Note values from elsewhere whose quantity no table has."""
    names = [quantity.name for quantity in QUANTITIES]
    for key, values in (("truth", table.truth), ("paper", table.paper)):
        problems += [
            f"{where}: unknown quantity '{name}' in '{key}': there are {listing(name, names)}"
            for name in values
            if name not in names
        ]
