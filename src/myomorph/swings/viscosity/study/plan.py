"""What a study of swinging limbs does, from its study file or from a command line.

A study file is checked as a whole before anything runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.store import study_file, toml_file
from myomorph.swings.viscosity.identification.identify import STATES
from myomorph.swings.viscosity.study.limb_files import LimbFiles, limb_files
from myomorph.swings.viscosity.study.recordings import (
    CONDITIONS,
    GivenFiles,
    Span,
    given_swings,
)
from myomorph.swings.viscosity.study.specimen_files import (
    INSEPARABLE,
    SpecimenFiles,
    specimen_files,
)
from myomorph.swings.viscosity.study.study_folder import StudyFolder
from myomorph.swings.viscosity.study.tables import viscosity_tables


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


@dataclass(frozen=True, kw_only=True)
class GivenSpecimen:
    """One specimen on a command line.

    Attributes
    ----------
    model : file, None where it was left out
    recordings : by condition
    base, first : bodies of the model, None for those called scapula and humerus
    muscle_mass : of the removed muscles on a scale [kg]
    time : the part of all recordings that is used
    """

    model: Path | None
    recordings: Mapping[str, GivenFiles]
    base: str | None = None
    first: str | None = None
    muscle_mass: float | None = None
    time: Span | None = None


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
    >>> text = \'\'\'
    ... [study]
    ... name = "swings"
    ... [[specimen]]
    ... name = "03"
    ... model = "arm.osim"
    ... base = "upper"
    ... first_body = "fore"
    ... joint = "hinge"
    ... removed = [{ markers = "reach.trc", loads = "reach_grf.xml" }]
    ... \'\'\'
    >>> _ = Path("swings.toml").write_text(text)
    >>> plan = mm.viscosity.read_viscosity_plan("swings.toml")
    >>> [specimen.name for specimen in plan.specimens]
    ['03']
    """
    path = Path(path)
    raw = toml_file.read_toml(path)
    if "subject" in raw and "specimen" not in raw:
        raise BadFile(path, "describes subjects, not specimens", "run it with 'myomorph run'")
    file, problems = study_file.checked(viscosity_tables(), raw)
    folder = StudyFolder(path=path.parent, problems=problems)
    specimens: tuple[SpecimenFiles, ...] = ()
    limbs: tuple[LimbFiles, ...] = ()
    if file is not None:
        specimens = tuple(specimen_files(table, folder) for table in file.specimen)
        limbs = tuple(limb_files(table, folder) for table in file.limb)
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
    return ViscosityPlan(
        name=file.study.name,
        path=path,
        specimens=specimens,
        settings=FrozenMap(settings),
        real=file.study.real,
        simulated=file.study.simulated,
        assumed=file.study.assumed,
        remarks=tuple(folder.remarks),
        limbs=limbs,
    )


def fixed_plan(given: GivenSpecimen, settings: Mapping[str, Any] = FrozenMap({})) -> ViscosityPlan:
    """Make the plan of one specimen by hand.

    Parameters
    ----------
    given : its files and names
    settings : of all steps

    Raises
    ------
    BadData : there is no model, or no recording
    BadFile : a file is missing
    """
    model = given.model
    if model is None:
        raise BadData("give a study file, or --model with --intact and --removed")
    if not is_named_file(model):
        raise BadFile(model, "does not exist", "give a model (.osim or .xml)")
    conditions = {
        name: tuple(given_swings(name, given.recordings.get(name, GivenFiles()), given.time))
        for name in CONDITIONS
    }
    if not any(conditions.values()):
        raise BadData("no recordings: give --intact and --removed")
    lacking = [STATES[name] for name, entries in conditions.items() if not entries]
    without, intact = conditions.values()
    specimen = SpecimenFiles(
        name=model.stem,
        model=model,
        without=without,
        intact=intact,
        measured_muscle_mass=given.muscle_mass,
        base=given.base,
        first=given.first,
    )
    tables = dict.fromkeys(("filter", "tracking", "identification"), settings) if settings else {}
    return ViscosityPlan(
        name=model.stem,
        path=None,
        specimens=(specimen,),
        settings=FrozenMap(tables),
        remarks=tuple(f"no recordings of {state}: {INSEPARABLE}" for state in lacking),
    )
