"""Muscles of a specimen: those of [S] figure 1 by name, and paths on the remaining bones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from myomorph.core.model.errors import BadModel, UnknownName
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import constant
from myomorph.core.model.model import Model
from myomorph.core.model.paths import (
    MovingPathPoint,
    Muscle,
    Path,
    PathPoint,
    PathWrap,
    TendonWrap,
    WrapObject,
    refuse_path_functions,
)
from myomorph.swings.viscosity.specimen.bodies import Anatomy

FIGURE_1 = {
    "Biceps Brachii Caput Longum": ("BIC_long", "BIClong"),
    "Biceps Brachii Caput Breve": ("BIC_brevis", "BICshort"),
    "Coracobrachialis": ("Coracobrachialis", "CORB"),
    "Deltoideus Pars Acromialis": ("DeltoideusScapula_M", "DELT2"),
    "Deltoideus Pars Spinalis": ("DeltoideusScapula_P", "DELT3"),
    "Infraspinatus": ("Infraspinatus_I Infraspinatus_S", "INFSP"),
    "Subscapularis": ("Subscapularis_S Subscapularis_M Subscapularis_I", "SUBSC"),
    "Supraspinatus": ("Supraspinatus_P Supraspinatus_A", "SUPSP"),
    "Teres Major": ("TeresMajor", "TMAJ"),
    "Teres Minor": ("TeresMinor", "TMIN"),
    "Triceps Brachii Caput Longum": ("TRIlong", "TRIlong"),
}
"""The 11 muscles of [S] figure 1, as the paper writes them: their strands in the thoracoscapular
model (Seth et al. 2019), and in the arm of Saul et al. (2015) and MyoSuite.
"""


def fig1_muscles(model: Model) -> Mapping[str, tuple[str, ...]]:
    """Find the 11 muscles of [S] figure 1: strands of the model by the paper's name.

    Two families of names are known.

    Raises
    ------
    BadModel : the model has neither
    """
    known = set(model.muscle_names)
    lacking = []
    for family in zip(*FIGURE_1.values(), strict=True):
        strands = {
            muscle: tuple(words.split()) for muscle, words in zip(FIGURE_1, family, strict=True)
        }
        lacking.append([name for names in strands.values() for name in names if name not in known])
        if not lacking[-1]:
            return FrozenMap(strands)
    fewest = min(lacking, key=len)
    named = (
        "does not name the 11 muscles of the shoulder as the thoracoscapular model or MyoSuite's"
        " arm do"
    )
    advice = f"it has no '{fewest[0]}'; give the strands of each muscle by name"
    raise BadModel(f"model '{model.name}' {named}: {advice}")


class KeptMuscles(NamedTuple):
    """Muscles whose paths run on bones of a specimen alone.

    Attributes
    ----------
    muscles : strands by the muscle's name
    strands : on the bones of the specimen
    surfaces : that they wrap around
    notes : what is otherwise than in the source
    """

    muscles: dict[str, tuple[str, ...]]
    strands: tuple[Muscle, ...]
    surfaces: tuple[WrapObject, ...]
    notes: list[str]


def kept_muscles(
    source: Anatomy, names: Mapping[str, tuple[str, ...]], coordinates: frozenset[str]
) -> KeptMuscles:
    """Choose muscles whose paths run on bones alone.

    Parameters
    ----------
    source : with the muscles
    names : of those that are wanted, with their strands; empty for all between base and limb
    coordinates : that still move points

    Raises
    ------
    BadModel : a muscle that is named runs over what is no part of the specimen
    """
    model = source.model
    refuse_path_functions(model.muscles, "a specimen")
    base = source.bones[0]
    wanted = names or {
        muscle.name: (muscle.name,) for muscle in model.muscles if _crosses(source, muscle, base)
    }
    notes: list[str] = []
    strands: list[Muscle] = []
    kept: dict[str, tuple[str, ...]] = {}
    for name, strand in ((name, strand) for name, each in wanted.items() for strand in each):
        muscle = model.muscle(strand)
        outside = sorted(
            {point.body for point in muscle.path.points if point.body not in source.homes}
        )
        if not outside:
            strands.append(_moved(source, muscle, coordinates, notes))
            kept[name] = (*kept.get(name, ()), strand)
            continue
        if names:
            beyond = f"'{outside[0]}', which is no part of the specimen"
            raise BadModel(
                f"muscle '{strand}' runs over {beyond}: leave it out, or name another strand"
            )
        notes.append(f"muscle '{strand}' is left out: it runs over '{outside[0]}'")
    return KeptMuscles(
        muscles=kept, strands=tuple(strands), surfaces=_surfaces(source, strands), notes=notes
    )


def _surfaces(source: Anatomy, muscles: Sequence[Muscle]) -> tuple[WrapObject, ...]:
    """Put the surfaces that muscles wrap around on the bones of the specimen."""
    used = {wrap.wrap_object for muscle in muscles for wrap in muscle.path.wraps}
    surfaces = [surface for surface in source.model.wrap_objects if surface.name in used]
    homes = [source.homes[surface.body] for surface in surfaces]
    return tuple(
        replace(surface, body=home, pose=pose @ surface.pose)
        for surface, (home, pose) in zip(surfaces, homes, strict=True)
    )


def _crosses(source: Anatomy, muscle: Muscle, base: str) -> bool:
    """Return whether a muscle touches both base and limb."""
    homes = {
        source.homes[point.body][0] for point in muscle.path.points if point.body in source.homes
    }
    return base in homes and len(homes) > 1


def _moved(
    source: Anatomy, muscle: Muscle, coordinates: frozenset[str], notes: list[str]
) -> Muscle:
    points = tuple(
        _point(source, muscle.name, point, coordinates, notes) for point in muscle.path.points
    )
    bodies = {item.name: item.body for item in source.model.wrap_objects}
    wraps = []
    for wrap in muscle.path.wraps:
        body = bodies.get(wrap.wrap_object)
        if body is None:
            raise UnknownName("wrap object", wrap.wrap_object, tuple(bodies))
        if body in source.homes:
            wraps.append(_wrap(source, wrap))
        else:
            notes.append(
                f"muscle '{muscle.name}' no longer wraps around '{wrap.wrap_object}', which is on"
                f" '{body}'"
            )
    return replace(muscle, path=Path(points, tuple(wraps), muscle.path.divisors), groups=())


def _wrap(source: Anatomy, wrap: PathWrap | TendonWrap) -> PathWrap | TendonWrap:
    if not isinstance(wrap, TendonWrap) or wrap.side is None:
        return wrap
    home, pose = source.homes[wrap.side_body]
    return replace(wrap, side_body=home, side=pose.apply(wrap.side))


def _point(
    source: Anatomy,
    muscle: str,
    point: PathPoint | MovingPathPoint,
    coordinates: frozenset[str],
    notes: list[str],
) -> PathPoint | MovingPathPoint:
    if isinstance(point, MovingPathPoint):
        return _moving_point(source, muscle, point, coordinates, notes)
    home, pose = source.homes[point.body]
    if point.coordinate and point.coordinate not in coordinates:
        default = source.model.coordinate(point.coordinate).default
        if not point.range[0] <= default <= point.range[1]:
            where = (
                f"'{point.name}' only for some '{point.coordinate}', which the specimen does not"
                " have"
            )
            raise BadModel(f"muscle '{muscle}' goes through {where}: leave the muscle out")
        notes.append(
            f"muscle '{muscle}' always goes through '{point.name}': '{point.coordinate}' is gone"
        )
        point = PathPoint(point.name, point.body, point.location)
    return replace(point, body=home, location=pose.apply(point.location))


def _moving_point(
    source: Anatomy,
    muscle: str,
    point: MovingPathPoint,
    coordinates: frozenset[str],
    notes: list[str],
) -> PathPoint | MovingPathPoint:
    """Leave a point what still moves it, the rest at the default.

    It rests in its bone where its own body is gone.
    """
    home, pose = source.homes[point.body]
    gone = [name for name in point.coordinates if name and name not in coordinates]
    if not gone and home == point.body:
        return point
    values = [source.model.coordinate(name).default if name else 0.0 for name in point.coordinates]
    place = [
        float(function(value)) for function, value in zip(point.functions, values, strict=True)
    ]
    notes.append(
        f"muscle '{muscle}': its point '{point.name}' no longer moves with"
        f" '{(gone or [point.body])[0]}'"
    )
    if home != point.body:
        return PathPoint(point.name, home, pose.apply(place))
    functions = list(point.functions)
    moving_names = list(point.coordinates)
    for axis, name in enumerate(point.coordinates):
        if name in gone:
            functions[axis] = constant(place[axis])
            moving_names[axis] = ""
    x, y, z = functions
    x_name, y_name, z_name = moving_names
    return replace(point, functions=(x, y, z), coordinates=(x_name, y_name, z_name))
