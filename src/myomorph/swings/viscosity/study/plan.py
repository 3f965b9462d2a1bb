"""A study file of swinging limbs: specimens with and without muscles, checked as a whole before
anything runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, Field, create_model

from myomorph.core.contact.plate_placements import MarkedWeight
from myomorph.core.model.errors import BadData, BadFile, listing
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.store import named_files, study_file, toml_file
from myomorph.lab.store.settings import plain_settings, settings_of, with_settings
from myomorph.lab.study.inputs.beside import plain_stem
from myomorph.lab.study.inputs.loads import loads_by_name
from myomorph.swings.viscosity.cohort import QUANTITIES
from myomorph.swings.viscosity.identification.base_load import UNKNOWN, BaseLoad
from myomorph.swings.viscosity.identification.budget import ErrorOptions
from myomorph.swings.viscosity.identification.identify import STATES, ViscosityOptions
from myomorph.swings.viscosity.relaxed.identify import LimbOptions
from myomorph.swings.viscosity.study.calibration import PlateFiles, ScanFiles
from myomorph.swings.viscosity.study.limb_files import LimbFiles, LimbTable, limb_files
from myomorph.swings.viscosity.tracking.tracked import TrackingOptions
from myomorph.swings.viscosity.trust.cutoff import FilterOptions
from myomorph.swings.viscosity.trust.models import PassiveOptions
from myomorph.swings.viscosity.trust.moment_arms import MomentArmOptions

INSEPARABLE = "muscle viscosity cannot be separated from the joint's"
CONDITIONS = ("without", "with")
OPTIONS = dict(zip(CONDITIONS, ("removed", "intact"), strict=True))
"""What the two conditions are called in study files and on the command line."""


@dataclass(frozen=True)
class StudyOptions:
    """All that a study of swinging limbs may be told, each part in its own table."""

    filter: FilterOptions = field(default_factory=FilterOptions)
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    identification: ViscosityOptions = field(default_factory=ViscosityOptions)
    laws: PassiveOptions = field(default_factory=PassiveOptions)
    moment_arms: MomentArmOptions = field(default_factory=MomentArmOptions)
    errors: ErrorOptions = field(default_factory=ErrorOptions)
    limb: LimbOptions = field(default_factory=LimbOptions)

    @staticmethod
    def of(settings: Mapping[str, Mapping[str, Any]]) -> StudyOptions:
        """Options from the tables of a study file, or from a command line."""
        plain = StudyOptions()
        return replace(
            plain,
            **{name: with_settings(getattr(plain, name), told) for name, told in settings.items()},
        )

    @property
    def plain(self) -> dict[str, dict[str, object]]:
        """The settings as plain values, by table."""
        return {name: plain_settings(getattr(self, name)) for name in self.__dataclass_fields__}


class _Recording(study_file.Strict):
    """A trial given by a table, where its files do not follow the rule of names."""

    markers: str
    loads: str | None = None
    name: str = ""
    time: tuple[float, float] | None = None


class _Study(study_file.StudyTable):
    """Sentences on where the recordings come from stand first in the report."""

    real: tuple[str, ...] = ()
    simulated: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()


class _Plate(study_file.Strict):
    """C3D recordings of a marked weight on the plate, from which its place is calibrated."""

    placements: list[str] = Field(min_length=1)
    markers: list[str] = Field(min_length=1)
    shares: list[float] | None = None
    mass: float | None = Field(default=None, gt=0.0)
    axis: tuple[str, str] | None = None
    tip: float | None = None
    name: str = ""


class _BaseMass(study_file.Strict):
    """Of the base and all that rests on it beyond the plate's zero [kg]: a number, or the least and
    the most.
    """

    removed: float | tuple[float, float] = UNKNOWN
    intact: float | tuple[float, float] = UNKNOWN


class _Specimen(study_file.Strict):
    name: str
    model: str
    removed: list[str | _Recording] = Field(default_factory=list)
    intact: list[str | _Recording] = Field(default_factory=list)
    measured_muscle_mass: float | None = Field(default=None, gt=0.0)
    base: str | None = None
    first_body: str | None = None
    bones: list[str] = Field(default_factory=list)
    joint: Literal["ball", "hinge"] = "ball"
    up: Literal["x", "y", "z"] | None = None
    muscles: dict[str, list[str]] = Field(default_factory=dict)
    pcsa: dict[str, float] = Field(default_factory=dict)
    tare: str | None = None
    base_mass: float | _BaseMass | None = None
    plate: _Plate | None = None
    ct: list[ScanFiles] = Field(default_factory=list)
    time: tuple[float, float] | None = None
    truth: dict[str, float] = Field(default_factory=dict)
    paper: dict[str, float] = Field(default_factory=dict)


@dataclass(frozen=True)
class SwingFiles:
    """One recording of a swing; `loads` is `markers` where one C3D file holds both."""

    name: str
    markers: Path
    loads: Path
    time: tuple[float, float] | None = None


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
    up: Literal["x", "y", "z"] | None = None
    base_load: BaseLoad = field(default_factory=BaseLoad)

    @property
    def recordings(self) -> dict[str, tuple[SwingFiles, ...]]:
        """By `CONDITIONS`."""
        return dict(zip(CONDITIONS, (self.without, self.intact), strict=True))


@dataclass(frozen=True)
class ViscosityPlan:
    """What a study of swinging limbs does.

    Attributes
    ----------
    name : of the study
    specimens, limbs : in the order of the file; limbs are relaxed and living
    path : of the study file, None where there is none
    settings : by step, only what was given
    real, simulated, assumed : sentences of the report's head
    remarks : old names, which files were found by the rule of names, and what is lacking
    """

    name: str
    path: Path | None
    specimens: tuple[SpecimenFiles, ...]
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: FrozenMap({}))
    real: tuple[str, ...] = ()
    simulated: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    limbs: tuple[LimbFiles, ...] = ()


def viscosity_tables() -> type[BaseModel]:
    """All tables of a study file of swinging limbs."""
    options = study_file.options_table(
        {name: settings_of(type(value)) for name, value in vars(StudyOptions()).items()}
    )
    return create_model(
        "ViscosityFile",
        __base__=study_file.Strict,
        study=(_Study, ...),
        specimen=(list[_Specimen], Field(default_factory=list)),
        limb=(list[LimbTable], Field(default_factory=list)),
        options=(options, Field(default_factory=options)),
    )


def read_viscosity_plan(path: str | Path) -> ViscosityPlan:
    """Read a study file of swinging limbs; paths in it are relative to its folder.

    Parameters
    ----------
    path : of the study file

    Returns
    -------
    names of specimens, their files and settings; nothing is read yet

    Raises
    ------
    BadFile
        where it is no TOML, or with one list of all that is wrong: unknown keys and quantities,
        values of the wrong kind, files that do not exist, a specimen without any recording

    Examples
    --------
    >>> from pathlib import Path
    >>> import myomorph as mm
    >>> text = '''
    ... [study]
    ... name = "swings"
    ... [[specimen]]
    ... name = "03"
    ... model = "arm.osim"
    ... base = "upper"
    ... first_body = "fore"
    ... joint = "hinge"
    ... removed = [{ markers = "reach.trc", loads = "reach_grf.xml" }]
    ... '''
    >>> _ = Path("swings.toml").write_text(text)
    >>> plan = mm.viscosity.read_viscosity_plan("swings.toml")
    >>> [specimen.name for specimen in plan.specimens]
    ['03']
    """
    path = Path(path)
    raw = toml_file.read_toml(path)
    remarks = list[str]()
    if "subject" in raw and "specimen" not in raw:
        raise BadFile(path, "describes subjects, not specimens", "run it with 'myomorph run'")
    file, problems = study_file.checked(viscosity_tables(), raw)
    specimens: list[SpecimenFiles] = []
    limbs: list[LimbFiles] = []
    if file is not None:
        specimens += [_specimen(table, path.parent, problems, remarks) for table in file.specimen]
        limbs += [limb_files(table, path.parent, problems, remarks) for table in file.limb]
        names = [*(specimen.name for specimen in specimens), *(limb.name for limb in limbs)]
        problems += [
            f"two specimens or limbs are named '{name}': give one another name"
            for name in dict.fromkeys(names)
            if names.count(name) > 1
        ]
        if not names:
            problems.append(
                "it has no [[specimen]] and no [[limb]]: give one, as 'myomorph viscosity"
                " --template' shows"
            )
    toml_file.refuse(path, problems)
    assert file is not None
    settings = {
        step: chosen
        for step, chosen in file.options.model_dump(exclude_unset=True).items()
        if chosen
    }
    study = file.study
    return ViscosityPlan(
        name=study.name,
        path=path,
        specimens=tuple(specimens),
        settings=FrozenMap(settings),
        real=study.real,
        simulated=study.simulated,
        assumed=study.assumed,
        remarks=tuple(remarks),
        limbs=tuple(limbs),
    )


def _specimen(
    specimen: _Specimen, folder: Path, problems: list[str], remarks: list[str]
) -> SpecimenFiles:
    where = f"specimen '{specimen.name}'"
    if not specimen.removed and not specimen.intact:
        problems.append(f"{where}: has no recordings: give 'removed', 'intact' or both")
    elif not specimen.removed or not specimen.intact:
        state = STATES["with" if specimen.removed else "without"]
        remarks.append(f"{where}: no recordings of {state}: {INSEPARABLE}")
    names = [quantity.name for quantity in QUANTITIES]
    for table in ("truth", "paper"):
        for name in getattr(specimen, table):
            if name not in names:
                problems.append(
                    f"{where}: unknown quantity '{name}' in '{table}': there are"
                    f" {listing(name, names)}"
                )
    recordings = {}
    for key, entries in zip(OPTIONS.values(), (specimen.removed, specimen.intact), strict=True):
        state = f"{where}: {key}"
        recordings[key] = tuple(
            _recordings(entries, specimen.time, folder, state, problems, remarks)
        )
    without, intact = recordings.values()
    model = named_files.existing(folder, specimen.model, f"{where}: model", problems)
    return SpecimenFiles(
        name=specimen.name,
        model=model or folder,
        without=without,
        intact=intact,
        first=specimen.first_body,
        bones=tuple(specimen.bones),
        muscles=FrozenMap({name: tuple(strands) for name, strands in specimen.muscles.items()}),
        tare=named_files.existing(folder, specimen.tare, f"{where}: tare", problems),
        plate=(
            None
            if specimen.plate is None
            else _plate(specimen.plate, folder, f"{where}: plate", problems)
        ),
        ct=tuple(_scans(specimen.ct, folder, f"{where}: ct", problems)),
        base_load=_base_load(specimen.base_mass, where, problems),
        measured_muscle_mass=specimen.measured_muscle_mass,
        base=specimen.base,
        joint=specimen.joint,
        up=specimen.up,
        pcsa=FrozenMap(dict(specimen.pcsa)),
        truth=FrozenMap(dict(specimen.truth)),
        paper=FrozenMap(dict(specimen.paper)),
    )


def _ends(mass: float | tuple[float, float]) -> tuple[float, float]:
    """The least and the most of a mass."""
    return (mass, mass) if isinstance(mass, float) else mass


def _base_load(base_mass: float | _BaseMass | None, where: str, problems: list[str]) -> BaseLoad:
    table = base_mass if isinstance(base_mass, _BaseMass) else _BaseMass()
    if isinstance(base_mass, float):
        table = _BaseMass(removed=base_mass, intact=base_mass)
    try:
        return BaseLoad(removed=_ends(table.removed), intact=_ends(table.intact))
    except BadData as error:
        problems.append(f"{where}: base_mass: {error}")
        return BaseLoad()


def _plate(plate: _Plate, folder: Path, where: str, problems: list[str]) -> PlateFiles | None:
    placements = [
        path
        for name in plate.placements
        for path in named_files.matching(folder, name, where, problems)
    ]
    problems += [
        f"{where}: '{path.name}' is no C3D recording"
        for path in placements
        if path.suffix.lower() != ".c3d"
    ]
    shares = None if plate.shares is None else tuple(plate.shares)
    try:
        weight = MarkedWeight(
            name="weight",
            markers=tuple(plate.markers),
            shares=shares,
            mass=plate.mass,
            axis=plate.axis,
            tip=plate.tip,
        )
    except BadData as error:
        problems.append(f"{where}: {error}")
        return None
    return PlateFiles(tuple(placements), weight, plate.name)


def _scans(
    scan_files: Sequence[ScanFiles], folder: Path, where: str, problems: list[str]
) -> Iterator[ScanFiles]:
    for table in scan_files:
        for path in (table.surface, table.cluster, table.picked, table.mesh):
            named_files.existing(
                folder, None if path is None else str(path), f"{where} of '{table.bone}'", problems
            )
        try:
            yield table.within(folder)
        except BadData as error:
            problems.append(f"{where}: {error}")


def _recordings(
    entries: list[str | _Recording],
    time: tuple[float, float] | None,
    folder: Path,
    where: str,
    problems: list[str],
    remarks: list[str],
) -> Iterator[SwingFiles]:
    seen: set[str] = set()
    for entry in entries:
        recording = _Recording(markers=entry) if isinstance(entry, str) else entry
        named_files.check_time(recording.time or time, f"{where}: time", problems)
        for markers in named_files.matching(folder, recording.markers, where, problems):
            if recording.loads is not None:
                loads = named_files.existing(folder, recording.loads, f"{where}: loads", problems)
            elif (loads := swing_loads(markers)) is None:
                problems.append(
                    f"{where}: no forces belong to {markers.name}: give 'loads', a table or C3D"
                    " file"
                )
            elif loads != markers:
                remarks.append(f"{markers.name}: loads from {loads.name}")
            name = recording.name or plain_stem(markers)
            if name in seen:
                problems.append(f"{where}: two recordings are named '{name}': give one a 'name'")
            seen.add(name)
            if loads is not None:
                yield SwingFiles(
                    name=name, markers=markers, loads=loads, time=recording.time or time
                )


def fixed_plan(
    model: Path | None,
    files: Mapping[str, tuple[Sequence[Path], Sequence[Path]]],
    base: str | None = None,
    first: str | None = None,
    muscle_mass: float | None = None,
    time: tuple[float, float] | None = None,
    settings: Mapping[str, Any] = FrozenMap({}),
) -> ViscosityPlan:
    """The plan of one specimen by hand: recordings and their forces of each of `CONDITIONS`,
    settings of all steps.
    """
    if model is None:
        raise BadData("give a study file, or --model with --intact and --removed")
    if not model.is_file():
        raise BadFile(model, "does not exist", "give a model (.osim or .xml)")
    conditions = {
        name: tuple(_given(name, *files.get(name, ((), ())), time)) for name in CONDITIONS
    }
    if not any(conditions.values()):
        raise BadData("no recordings: give --intact and --removed")
    lacking = (STATES[name] for name, entries in conditions.items() if not entries)
    remarks = tuple(f"no recordings of {state}: {INSEPARABLE}" for state in lacking)
    without, intact = conditions.values()
    specimen = SpecimenFiles(
        name=model.stem,
        model=model,
        without=without,
        intact=intact,
        measured_muscle_mass=muscle_mass,
        base=base,
        first=first,
    )
    tables = dict.fromkeys(("filter", "tracking", "identification"), settings) if settings else {}
    return ViscosityPlan(
        name=model.stem,
        path=None,
        specimens=(specimen,),
        settings=FrozenMap(tables),
        remarks=remarks,
    )


def _given(
    name: str, recordings: Sequence[Path], loads: Sequence[Path], time: tuple[float, float] | None
) -> Iterator[SwingFiles]:
    if loads and len(loads) != len(recordings):
        raise BadData(
            f"{len(recordings)} recordings but {len(loads)} files of forces for --{OPTIONS[name]}:"
            " give one of each"
        )
    for i, markers in enumerate(recordings):
        recording_loads = loads[i] if loads else swing_loads(markers)
        for path in (markers, recording_loads):
            if path is not None and not path.is_file():
                raise BadFile(path, "does not exist")
        if recording_loads is None:
            raise BadFile(markers, "has no forces beside it", f"give --{OPTIONS[name]}-loads")
        yield SwingFiles(
            name=plain_stem(markers), markers=markers, loads=recording_loads, time=time
        )


def swing_loads(markers: Path) -> Path | None:
    """The forces that belong to a recording: in it where it is a C3D file, else beside it by its
    stem, or None.
    """
    return markers if markers.suffix.lower() == ".c3d" else loads_by_name(markers)
