"""Muscles of one species on the skeleton of another ([D] chapter 6): maps between bones first, then the muscles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.morph.fields import MapOptions
from myomorph.morph.morphed import Morph, MorphOptions
from myomorph.morph.nonrigid import MatchOptions
from myomorph.morph.postures import CoordinateTable
from myomorph.morph.species import SpeciesTable
from myomorph.morph.species_maps import species_bones
from myomorph.morph.species_parts import Surfaces
from myomorph.morph.transfer import graft_muscles


def species_morph(
    source: Model,
    source_surfaces: Surfaces,
    target: Model,
    target_surfaces: Surfaces,
    table: SpeciesTable,
    options: MorphOptions | None = None,
    map_options: MapOptions | None = None,
    match: MatchOptions | None = None,
    *,
    beside: bool = False,
    name: str = "",
    progress: Callable[[str], None] | None = None,
) -> Morph:
    """The target's skeleton, with its own joints and masses, and the source's muscles on it.

    Parameters
    ----------
    source_surfaces, target_surfaces : of bones by body, in the bodies' frames [m]
    options : what becomes of points on surfaces and of the muscles' parameters
    map_options, match : how bones are mapped, and matched where the table wants dense correspondence
    beside : keep the target's own muscles too
    name : of the new model; by default the target's
    progress : called with a bone's name before it is mapped, and with "muscles" before they are carried

    Returns
    -------
    its `source` is that model with parts of bodies as bodies of their own where the table spreads one over several

    Raises
    ------
    BadData : no bone of the table is in both models, a bone lacks its surface or has too few landmarks in common
    UnknownName : a coordinate or joint that a model lacks
    """
    bones = species_bones(source, source_surfaces, target, target_surfaces, table, map_options, match, progress)
    if not bones.bones:
        wanted = ", ".join(f"'{one.sources[0]}' and '{one.targets[0]}'" for one in table.bones[:3])
        raise BadData(f"species table '{table.name}': no pair of its bodies is in the models: it wants {wanted}, ...")
    if progress is not None:
        progress("muscles")
    morph = graft_muscles(
        bones.source,
        target,
        bones.bones,
        options,
        coordinates=coordinate_table(table, source, target),
        postures=(table.posture, table.target_posture),
        beside=beside,
        name=name,
    )
    return replace(morph, notes=(*bones.notes, *morph.notes))


def coordinate_table(table: SpeciesTable, source: Model, target: Model) -> CoordinateTable:
    """Coordinates of a species table that both models have."""
    return {
        one.source: (one.target, one.factor, one.offset)
        for one in table.coordinates
        if one.source in source.coordinate_names and one.target in target.coordinate_names
    }
