"""The step of a study of swinging limbs that is done once for a specimen.

It leads from recordings to viscosities.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.interval import Interval
from myomorph.core.model.provenance import Provenance
from myomorph.lab.store.progress import progress
from myomorph.lab.store.results import file_source, provenance_of
from myomorph.lab.study.step.folder_steps import FolderOutput, ScopeInputs
from myomorph.lab.study.step.step import Step
from myomorph.swings.viscosity.report.specimen_report import SpecimenReport
from myomorph.swings.viscosity.study.into_model import write_identified
from myomorph.swings.viscosity.study.options import StudyOptions
from myomorph.swings.viscosity.study.results import read_value, write_swings, write_value
from myomorph.swings.viscosity.study.specimen import input_sources, study_specimen
from myomorph.swings.viscosity.study.specimen_files import SpecimenFiles
from myomorph.swings.viscosity.study.viewing import write_view

SPECIMEN = "specimen.json"
IDENTIFIED = "identified.osim"
MJCF = Path("identified.xml")


@dataclass(frozen=True)
class SpecimenInputs(ScopeInputs):
    """One specimen and the options of the study."""

    files: SpecimenFiles
    options: StudyOptions


def specimen_provenance(specimen: SpecimenInputs) -> Provenance:
    """List what the result of a specimen is derived from.

    What it is held against, its truth, changes nothing.
    """
    files = specimen.files
    sources = list(input_sources(files))
    for scan in files.ct:
        sources += [
            file_source("CT", path) for path in (scan.picked, scan.mesh) if path is not None
        ]
    names = ("measured_muscle_mass", "base", "first", "bones", "joint", "muscles", "pcsa", "up")
    known: dict[str, object] = {name: getattr(files, name) for name in names}
    known |= {name: dict(value) for name, value in known.items() if isinstance(value, FrozenMap)}
    for condition, recordings in (("removed", files.without), ("intact", files.intact)):
        known[condition] = [(recording.name, recording.time) for recording in recordings]
    known["ct"] = [
        scan.model_dump(exclude={"surface", "cluster", "picked", "mesh"}) for scan in files.ct
    ]
    known["plate"] = None if files.plate is None else (repr(files.plate.weight), files.plate.plate)
    tables: dict[str, dict[str, object]] = {"specimen": known, **specimen.options.plain}
    options = {
        f"{table}.{name}": value
        for table, settings in tables.items()
        for name, value in settings.items()
    }
    return provenance_of("viscosity", sources, options)


def read_specimen(home: Path) -> SpecimenReport:
    """Read what is shown of a specimen, from the folder of its results."""
    return read_value(home / SPECIMEN, SpecimenReport)


def read_estimates(folder: str | Path) -> Mapping[str, Interval]:
    """Read the numbers of a specimen with their intervals, by quantity, as in `specimens.csv`.

    Parameters
    ----------
    folder : of the specimen, in that of the results

    Returns
    -------
    masses [kg], distances of mass centers [m], viscosities [N m s/rad] and [N s/m]; what is lacking
    is absent

    Raises
    ------
    BadFile
        where there is no such result

    Examples
    --------
    >>> from dataclasses import replace
    >>> from pathlib import Path
    >>> import myomorph as mm
    >>> short = mm.viscosity.ShoulderStudyOptions(seconds=6.0, trials=1, raw=())
    >>> study = mm.write_shoulder_study(Path("shoulder"), (3,), short)
    >>> plan = mm.viscosity.read_viscosity_plan(study)
    >>> plan = replace(plan, settings={"identification": {"draws": 20}})
    >>> _ = mm.viscosity.run_viscosity(plan, Path("swung"))
    >>> joint = mm.viscosity.read_estimates("swung/03")["joint_viscosity"]
    >>> 0.04 < joint.value < 0.08, joint.low < joint.value < joint.high
    (True, True)
    """
    return read_specimen(Path(folder)).row


def _run(specimen: SpecimenInputs, output: FolderOutput) -> SpecimenReport:
    with progress(f"specimen {specimen.files.name}", 1, "specimens") as advance:
        studied = study_specimen(specimen.files, specimen.options, advance)
    with output.whole() as folder:
        write_swings(studied.found, folder)
        if studied.tracked:
            write_view(studied.tracked, folder)
        lost = () if studied.model is None else write_osim(studied.model, folder / IDENTIFIED)
        notes = (*studied.report.notes, *(f"{IDENTIFIED}: {line}" for line in lost))
        if (
            specimen.files.model.suffix.lower() == MJCF.suffix
            and "joint_viscosity" in studied.report.row
        ):
            files = specimen.files
            try:
                lines = write_identified(
                    files.model, studied.report, folder / MJCF, files.base, files.first
                )
                notes += tuple(f"{MJCF}: {line}" for line in lines if " miss " in line)
            except MyomorphError as error:
                notes += (f"no {MJCF}: {error}",)
        report = replace(studied.report, notes=notes)
        write_value(report, folder / SPECIMEN)
    return report


STEP = Step(
    name="viscosity",
    title="viscosities of a swinging limb",
    scope="specimen",
    options=tuple(type(options) for options in vars(StudyOptions()).values()),
    leaves=FrozenMap({"report": SPECIMEN}),
    run=_run,
    made_from=specimen_provenance,
)
