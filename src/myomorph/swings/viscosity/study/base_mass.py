"""The key `base_mass` of a specimen: what its base carries."""

from __future__ import annotations

from myomorph.core.model.errors import BadData
from myomorph.lab.store.study_file import Strict
from myomorph.swings.viscosity.identification.base_load import UNKNOWN, BaseLoad, Range
from myomorph.swings.viscosity.study.study_folder import StudyFolder


class BaseMassTable(Strict):
    """Of the base and all that rests on it beyond the plate's zero [kg].

    Each is a number, or the least and the most.
    """

    removed: float | Range = UNKNOWN
    intact: float | Range = UNKNOWN


def base_load(base_mass: float | BaseMassTable | None, where: str, folder: StudyFolder) -> BaseLoad:
    """Read what the base carries.

    Parameters
    ----------
    base_mass : the same in both conditions, or of each; None where nothing is known
    where : in the study file, for what is noted
    folder : of the study file
    """
    table = base_mass if isinstance(base_mass, BaseMassTable) else BaseMassTable()
    if isinstance(base_mass, float):
        table = BaseMassTable(removed=base_mass, intact=base_mass)
    try:
        return BaseLoad(removed=_ends(table.removed), intact=_ends(table.intact))
    except BadData as error:
        folder.problems.append(f"{where}: base_mass: {error}")
        return BaseLoad()


def _ends(mass: float | Range) -> Range:
    """Return the least and the most of a mass."""
    return (mass, mass) if isinstance(mass, float) else mass
