"""Which coordinates, muscles and subjects a page shows, and what they are called in print."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import GROUND, Axis, Model
from myomorph.core.model.paths import Muscle
from myomorph.core.model.series import DEFAULT_POSE, Motion, Series
from myomorph.core.model.sides import split_side
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analysis.center_of_mass import centroid

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
    (
        "Biceps femoris, long head",
        r"(bi?f_?(em)?_?lh|bicfem|bifemlh|bflh|hamstrings|biceps_?fem(oris)?(_?lh)?)\d*",
    ),
    ("Semitendinosus", r"semi_?ten(dinosus)?"),
    ("Semimembranosus", r"semi_?mem(branosus)?"),
    ("Gastrocnemius, medial", r"(gas_?med|med_?gas|gastroc(nemius)?)\d*"),
    ("Gastrocnemius, lateral", r"(gas_?lat|lat_?gas)\d*"),
    ("Soleus", r"sol(eus)?"),
    ("Tibialis anterior", r"(tib(ialis)?_?ant(erior)?|ta)"),
    ("Peroneus longus", r"(per(oneus)?|fib(ularis)?)_?long(us)?"),
)
"""Muscles shown first, with the spellings of the Rajagopal, gait2392 and MyoSim families, hip to
ankle.
"""
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
    """One thing on the two sides of the body, or in the middle."""

    label: str  # what it is called in print
    # side ("right", "left" or "") to the names that make it up
    members: Mapping[str, tuple[str, ...]]

    @property
    def names(self) -> tuple[str, ...]:
        """All names, right before left."""
        return tuple(name for side in SIDES for name in self.members.get(side, ()))


def pairs(names: Iterable[str]) -> tuple[Pair, ...]:
    """Pair names over the sides, in order.

    A name without a side is the right of a left that answers (`DELT1_l`).
    """
    by_base: dict[str, dict[str, tuple[str, ...]]] = {}
    for name in names:
        base, side = split_side(name)
        by_base.setdefault(base, {}).setdefault(side, (name,))
    return tuple(Pair(printed(base), with_right(members)) for base, members in by_base.items())


def with_right(members: dict[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Names by side; those without a side are the right ones where only left ones answer them."""
    if "left" in members and "" in members and "right" not in members:
        members["right"] = members.pop("")
    return members


def spelled(bare: Mapping[str, tuple[str, str]], pattern: str) -> dict[str, tuple[str, ...]]:
    """Names by side whose bases, of `bare` names to bases and sides, a pattern fully matches."""
    members: dict[str, tuple[str, ...]] = {}
    for name, (base, side) in bare.items():
        if re.fullmatch(pattern, base, re.IGNORECASE):
            members[side] = (*members.get(side, ()), name)
    return members


def printed(name: str) -> str:
    """Write a name as a label: `hip_flexion` becomes `Hip flexion`, `soleus` stays `Soleus`."""
    # MuJoCo prefixes the names of an included model with its own and two underscores.
    text = name.rsplit("__", 1)[-1].replace("_", " ").strip()
    return text[:1].upper() + text[1:]


def root_coordinates(model: Model) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Find the coordinates between the ground and the root body: translations, rotations.

    The root body carries the rest. Its coordinates carry no muscle: what inverse dynamics finds
    there is what the recording leaves unexplained. Both are empty where no joint to the ground
    translates, as in an arm fixed at the shoulder.
    """
    coordinates: dict[str, list[str]] = {"translation": [], "rotation": []}
    fixed = {coordinate.name for coordinate in model.coordinates if coordinate.locked}
    for axis in _root_axes(model):
        target = coordinates["translation" if axis.kind == "translation" else "rotation"]
        target += [name for name in axis.coordinates if name not in fixed and name not in target]
    if not coordinates["translation"]:
        return (), ()
    return tuple(coordinates["translation"]), tuple(coordinates["rotation"])


def _root_axes(model: Model) -> Iterator[Axis]:
    """Yield the axes of joints from the ground that translate, and of those that go on from them.

    A massless link on the way from the ground belongs to the root joint too.
    """
    free_bodies: set[str] = set()
    for joint in model.joints:
        if joint.parent != GROUND and joint.parent not in free_bodies:
            continue
        axes = [axis for axis in joint.axes if axis.function.arity]
        translates = any(axis.kind == "translation" for axis in axes)
        if translates or joint.parent in free_bodies:
            yield from axes
        if joint.parent == GROUND and model.body(joint.child).mass < 1e-6 * max(model.mass, 1e-12):
            free_bodies.add(joint.child)


def coordinate_pairs(model: Model, ranges: Mapping[str, float], most: int = 12) -> tuple[Pair, ...]:
    """Choose the coordinates worth a figure, paired over the sides.

    Left out are the root's, locked ones, dependent ones and those that do not move. The usual ones
    come first, then the others by how far they move.

    Parameters
    ----------
    model : with the coordinates
    ranges : how far each coordinate moved [rad or m]
    most : figures at most
    """
    left_out = {
        *(name for group in root_coordinates(model) for name in group),
        *model.dependent_coordinates,
    }
    free = [
        each.name for each in model.coordinates if each.motion == "rotational" and not each.locked
    ]
    moving = [
        name for name in free if name not in left_out and ranges.get(name, 0.0) > np.deg2rad(1.0)
    ]

    def rank(pair: Pair) -> tuple[int, float]:
        base = split_side(pair.names[0])[0].lower()
        usual = COORDINATE_ORDER.index(base) if base in COORDINATE_ORDER else len(COORDINATE_ORDER)
        return usual, -max(ranges[name] for name in pair.names)

    return tuple(sorted(pairs(moving), key=rank)[:most])


def major_muscles(
    names: Sequence[str], mean_force: Array | None = None, most: int = 16
) -> tuple[Pair, ...]:
    """Choose the muscles to show one by one, right and left together.

    These are known leg muscles where at least six are found or most are known (the parts of one
    muscle together). Otherwise, or to fill up, they are the muscles that pull hardest on average.

    Parameters
    ----------
    names : of the muscles
    mean_force : (muscles,) mean tension [N], or None
    most : pairs at most

    Returns
    -------
    Pairs to show, the known ones first
    """
    bare = {name: split_side(name) for name in names}
    known = ((label, spelled(bare, pattern)) for label, pattern in MAJOR_MUSCLES)
    chosen = [Pair(label, members) for label, members in known if members]
    taken = {name for pair in chosen for name in pair.names}
    if len(chosen) < 6 and 2 * len(taken) < len(names):
        chosen = []
        taken = set()
    rest = [pair for pair in pairs(names) if not taken & set(pair.names)]
    if mean_force is not None:
        strength = dict(zip(names, np.nan_to_num(mean_force), strict=True))
        rest.sort(key=lambda pair: -max(strength[name] for name in pair.names))
    if len(chosen) < 12:
        chosen += rest[: most - len(chosen)]
    return tuple(chosen[:most])


def muscle_rows(names: Sequence[str]) -> tuple[tuple[str, Indices], ...]:
    """Arrange muscles as blocks of a picture: one per side, from hip to ankle.

    Parameters
    ----------
    names : of the muscles

    Returns
    -------
    Side and the columns of its muscles in their order, for each side that has muscles
    """
    order = [pattern for _, pattern in MAJOR_MUSCLES] + list(OTHER_LEG_MUSCLES)
    # A second muscle of the same region stands beside the first: glutei together, then the rest.
    region = {pattern: float(i) for i, pattern in enumerate(order[: len(MAJOR_MUSCLES)])}
    region |= dict(
        zip(OTHER_LEG_MUSCLES, (1.3, 1.5, 4.1, 1.7, 4.5, 8.5, 7.5, 14.5, 15.5, 16.0), strict=True)
    )

    def rank(name: str) -> float:
        base = split_side(name)[0]
        return next(
            (region[pattern] for pattern in order if re.fullmatch(pattern, base, re.IGNORECASE)),
            99.0,
        )

    side_of = {
        name: side
        for pair in pairs(names)
        for side, members in pair.members.items()
        for name in members
    }
    blocks = []
    for side in SIDES:
        columns = [
            i for i, name in enumerate(names) if side_of.get(name, split_side(name)[1]) == side
        ]
        if columns:
            columns.sort(key=lambda i: rank(names[i]))
            blocks.append((side, np.array(columns, dtype=np.int64)))
    return tuple(blocks)


_CHUNK = 1024
MIN_SHARE = 1e-3


@dataclass(frozen=True)
class Subject:
    """One body or object of a model."""

    name: str  # as printed, "" for the only one
    prefix: str  # what its names begin with in a model of several
    bodies: tuple[str, ...]  # names
    muscles: tuple[str, ...]  # names of the muscles on its bodies


def subjects(model: Model) -> tuple[Subject, ...]:
    """Find the subjects and objects of a model, those with muscles first.

    What weighs next to nothing is left out.
    """
    home: dict[str, str] = {}
    for joint in model.joints:
        home[joint.child] = (
            joint.child if joint.parent == GROUND else home.get(joint.parent, joint.parent)
        )
    roots = tuple(dict.fromkeys(home[body] for body in model.body_names if body in home))
    result = []
    for root in roots:
        bodies = tuple(body for body in model.body_names if home.get(body) == root)
        muscles = tuple(muscle.name for muscle in model.muscles if _home_of(muscle, home) == root)
        if sum(model.body(name).mass for name in bodies) > MIN_SHARE * model.mass:
            prefix = _prefix((*bodies, *muscles)) if len(roots) > 1 else ""
            name = prefix.rstrip("_") or root
            result.append(Subject(name=name, prefix=prefix, bodies=bodies, muscles=muscles))
    result.sort(key=lambda subject: not subject.muscles)
    if len(result) == 1:
        return (replace(result[0], name=""),)
    return tuple(result)


def _home_of(muscle: Muscle, home: Mapping[str, str]) -> str:
    """Return the root body of the first point of a muscle's path that has one, else ""."""
    return next((home[point.body] for point in muscle.path.points if point.body in home), "")


def _prefix(names: tuple[str, ...]) -> str:
    """Find what all names begin with, to the last line in it; of one name to the first."""
    first = min(names)
    last = max(names)
    if first == last:
        return first.partition("_")[0] + "_" if "_" in first else ""
    alike = next(
        (i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b),
        min(len(first), len(last)),
    )
    return first[: first.rfind("_", 0, alike) + 1]


def centroids(model: Model, motion: Motion, who: tuple[Subject, ...]) -> tuple[Series, ...]:
    """Center of mass of every subject in ground, each a series of (frames, 3) [m]."""
    return tuple(centroid(model, motion, subject.bodies if len(who) > 1 else ()) for subject in who)


def standing_height(model: Model, who: Subject, up: Array) -> float:
    """Compute the height of the center of mass over the lowest joint in the default pose.

    Parameters
    ----------
    model : with the subject
    who : the subject
    up : (3,) unit vector against gravity

    Returns
    -------
    The height [m]
    """
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(DEFAULT_POSE))
    bodies = [tree.body_index[body] for body in who.bodies]
    mass = tree.arrays.mass[bodies]
    centers = poses.points(np.array(bodies), tree.arrays.mass_center[bodies])[0] @ up
    return float(mass @ centers / mass.sum() - np.min(poses.origins[0, bodies] @ up))


def lowest_joint(model: Model, motion: Motion, who: Subject, up: Array) -> float:
    """Find the least height of a body's origin over the motion.

    Parameters
    ----------
    model : with the subject
    motion : of the model
    who : the subject
    up : (3,) unit vector against gravity

    Returns
    -------
    The height along `up` [m]
    """
    tree = compile_tree(model)
    bodies = [tree.body_index[body] for body in who.bodies]
    step = max(1, len(motion) // _CHUNK)
    part = tree.coordinates_of(motion)[::step]
    heights = forward_kinematics(tree, np.ascontiguousarray(part)).origins[:, bodies] @ up
    return float(np.nanmin(heights))
