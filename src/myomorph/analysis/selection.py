"""Which coordinates and muscles a page shows, and what they are called in print."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.model.model import GROUND, Model
from myomorph.model.sides import split_side

Indices = NDArray[np.int64]
SIDES = ("right", "left", "")

MAJOR_MUSCLES: tuple[tuple[str, str], ...] = (
    ("Gluteus maximus", r"gl(ut(eus)?)?_?max(imus)?[\d_]*"),
    ("Gluteus medius", r"gl(ut(eus)?)?_?med(ius)?[\d_]*"),
    ("Iliacus", r"(iliacus|iliopsoas)"),
    ("Psoas", r"psoas"),
    ("Adductor magnus", r"add_?mag(dist|isch|mid|prox)?[\d_]*"),
    ("Rectus femoris", r"(rec(t(us)?)?_?fem(oris)?\d*|rf)"),
    ("Vastus medialis", r"(vas(tus)?_?med(ialis|ius)?\d*|vm)"),
    ("Vastus lateralis", r"(vas(tus)?_?lat(eralis)?\d*|vasti|vl)"),
    ("Biceps femoris, long head", r"(bi?f_?(em)?_?lh|bicfem|bifemlh|bflh|hamstrings|biceps_?fem(oris)?(_?lh)?)\d*"),
    ("Semitendinosus", r"semi_?ten(dinosus)?"),
    ("Semimembranosus", r"semi_?mem(branosus)?"),
    ("Gastrocnemius, medial", r"(gas_?med|med_?gas|gastroc(nemius)?)\d*"),
    ("Gastrocnemius, lateral", r"(gas_?lat|lat_?gas)\d*"),
    ("Soleus", r"sol(eus)?"),
    ("Tibialis anterior", r"(tib(ialis)?_?ant(erior)?|ta)"),
    ("Peroneus longus", r"(per(oneus)?|fib(ularis)?)_?long(us)?"),
)
"""Muscles shown first, with the spellings of the Rajagopal, gait2392 and MyoSim families, hip to ankle."""

OTHER_LEG_MUSCLES: tuple[str, ...] = (
    r"gl(ut)?_?min\w*",
    r"tfl",
    r"sar(t)?",
    r"piri|peri|gem|quad_?fem",
    r"add_?(brev|long)|pect|grac",
    r"bi?f(em)?_?sh\d*",
    r"vas_?int",
    r"tib_?post",
    r"per_?(brev|tert)",
    r"(edl|ehl|fdl|fhl|ext_?(dig|hal)|flex_?(dig|hal))",
)

COORDINATE_ORDER: tuple[str, ...] = (
    "hip_flexion",
    "hip_adduction",
    "hip_rotation",
    "knee_angle",
    "knee_flexion",
    "ankle_angle",
    "ankle_flexion",
    "subtalar_angle",
    "lumbar_extension",
    "lumbar_bending",
    "lumbar_rotation",
    "arm_flex",
    "arm_add",
    "arm_rot",
    "elv_angle",
    "shoulder_elv",
    "shoulder_rot",
    "elbow_flex",
    "elbow_flexion",
    "pro_sup",
)
"""Coordinates shown first where a model has them; the others follow by how far they move."""


@dataclass(frozen=True)
class Pair:
    """One thing on the two sides of the body, or in the middle.

    Attributes
    ----------
    label : what it is called in print
    members : side ("right", "left" or "") to the names that make it up
    """

    label: str
    members: Mapping[str, tuple[str, ...]]

    @property
    def names(self) -> tuple[str, ...]:
        """All names, right before left."""
        return tuple(name for side in SIDES for name in self.members.get(side, ()))


def pairs(names: Iterable[str]) -> tuple[Pair, ...]:
    """Names paired over the sides, in order of first appearance.

    A name without a side is the right one where only a left one answers it (`DELT1`, `DELT1_l`).
    """
    found: dict[str, dict[str, tuple[str, ...]]] = {}
    for name in names:
        base, side = split_side(name)
        found.setdefault(base, {}).setdefault(side, (name,))
    for members in found.values():
        if "left" in members and "" in members and "right" not in members:
            members["right"] = members.pop("")
    return tuple(Pair(printed(base), members) for base, members in found.items())


def printed(name: str) -> str:
    """A name as a label: `hip_flexion` becomes `Hip flexion`, `soleus` stays `Soleus`."""
    # MuJoCo prefixes the names of an included model with its own and two underscores.
    text = name.rsplit("__", 1)[-1].replace("_", " ").strip()
    return text[:1].upper() + text[1:]


def root_coordinates(model: Model) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Coordinates between the ground and the body that carries the rest: translations, rotations.

    They carry no muscle: what inverse dynamics finds there is what the recording leaves unexplained.
    Both are empty where no joint to the ground translates, as in an arm fixed at the shoulder.
    """
    translations: list[str] = []
    rotations: list[str] = []
    free_bodies: set[str] = set()
    fixed = {coordinate.name for coordinate in model.coordinates if coordinate.locked}
    for joint in model.joints:
        # A massless link on the way from the ground belongs to the root joint too.
        if joint.parent != GROUND and joint.parent not in free_bodies:
            continue
        axes = [axis for axis in joint.axes if axis.function.arity]
        if any(axis.kind == "translation" for axis in axes) or (axes and joint.parent in free_bodies):
            for axis in axes:
                target = translations if axis.kind == "translation" else rotations
                target += [name for name in axis.coordinates if name not in fixed and name not in target]
        if joint.parent == GROUND and model.body(joint.child).mass < 1e-6 * max(model.mass, 1e-12):
            free_bodies.add(joint.child)
    return (tuple(translations), tuple(rotations)) if translations else ((), ())


def coordinate_pairs(model: Model, ranges: Mapping[str, float], most: int = 12) -> tuple[Pair, ...]:
    """Coordinates worth a figure, paired over the sides.

    Left out are the root's, locked ones, those that follow others and those that do not move. The
    usual ones come first, then the others by how far they move.

    Parameters
    ----------
    ranges : how far each coordinate moved [rad or m]
    most : figures at most
    """
    root = {name for group in root_coordinates(model) for name in group}
    following = set(model.dependent_coordinates)
    moving = [
        coordinate.name
        for coordinate in model.coordinates
        if coordinate.name not in root
        and coordinate.name not in following
        and not coordinate.locked
        and coordinate.motion == "rotational"
        and ranges.get(coordinate.name, 0.0) > np.deg2rad(1.0)
    ]

    def rank(pair: Pair) -> tuple[int, float]:
        base = split_side(pair.names[0])[0].lower()
        usual = COORDINATE_ORDER.index(base) if base in COORDINATE_ORDER else len(COORDINATE_ORDER)
        return usual, -max(ranges[name] for name in pair.names)

    chosen = sorted(pairs(moving), key=rank)[:most]
    return tuple(chosen)


def major_muscles(names: Sequence[str], mean_force: Array | None = None, most: int = 16) -> tuple[Pair, ...]:
    """The muscles to show one by one, right and left together.

    Known leg muscles where at least six are found or most are known (the parts of one muscle together);
    otherwise, or to fill up, the muscles that pull hardest on average.

    Parameters
    ----------
    names : of the muscles
    mean_force : (muscles,) mean tension [N], or None
    """
    chosen: list[Pair] = []
    for label, pattern in MAJOR_MUSCLES:
        members: dict[str, tuple[str, ...]] = {}
        for name in names:
            base, side = split_side(name)
            if re.fullmatch(pattern, base, re.IGNORECASE):
                members[side] = members.get(side, ()) + (name,)
        if members:
            chosen.append(Pair(label, members))
    taken = {name for pair in chosen for name in pair.names}
    if len(chosen) < 6 and 2 * len(taken) < len(names):
        chosen, taken = [], set()
    rest = [pair for pair in pairs(names) if not taken & set(pair.names)]
    if mean_force is not None:
        strength = dict(zip(names, np.nan_to_num(mean_force), strict=True))
        rest.sort(key=lambda pair: -max(strength[name] for name in pair.names))
    if len(chosen) < 12:
        chosen += rest[: most - len(chosen)]
    return tuple(chosen[:most])


def muscle_rows(names: Sequence[str]) -> tuple[tuple[str, Indices], ...]:
    """Muscles as blocks of a picture: side, and the columns in it, from hip to ankle."""
    order = [pattern for _, pattern in MAJOR_MUSCLES] + list(OTHER_LEG_MUSCLES)
    # A second muscle of the same region stands beside the first: glutei together, then the rest.
    region = {pattern: float(i) for i, pattern in enumerate(order[: len(MAJOR_MUSCLES)])}
    region |= dict(zip(OTHER_LEG_MUSCLES, (1.3, 1.5, 4.1, 1.7, 4.5, 8.5, 7.5, 14.5, 15.5, 16.0), strict=True))

    def rank(name: str) -> float:
        base = split_side(name)[0]
        return next((region[one] for one in order if re.fullmatch(one, base, re.IGNORECASE)), 99.0)

    side_of = {name: side for pair in pairs(names) for side, members in pair.members.items() for name in members}
    blocks = []
    for side in SIDES:
        columns = [i for i, name in enumerate(names) if side_of.get(name, split_side(name)[1]) == side]
        if columns:
            columns.sort(key=lambda i: rank(names[i]))
            blocks.append((side, np.array(columns, dtype=np.int64)))
    return tuple(blocks)
