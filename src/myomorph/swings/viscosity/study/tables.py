"""The tables of a study file of swinging limbs."""

from __future__ import annotations

from pydantic import BaseModel, Field, create_model

from myomorph.lab.store import study_file
from myomorph.lab.store.settings import settings_of
from myomorph.swings.viscosity.study.limb_files import LimbTable
from myomorph.swings.viscosity.study.options import StudyOptions
from myomorph.swings.viscosity.study.specimen_files import SpecimenTable


class SwingStudyTable(study_file.StudyTable):
    """Sentences on where the recordings come from stand first in the report."""

    real: tuple[str, ...] = ()
    simulated: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()


def viscosity_tables() -> type[BaseModel]:
    """Make the type of a whole study file of swinging limbs."""
    options = study_file.options_table(
        {name: settings_of(type(value)) for name, value in vars(StudyOptions()).items()}
    )
    return create_model(
        "ViscosityFile",
        __base__=study_file.Strict,
        study=(SwingStudyTable, ...),
        specimen=(list[SpecimenTable], Field(default_factory=list)),
        limb=(list[LimbTable], Field(default_factory=list)),
        options=(options, Field(default_factory=options)),
    )
