"""What corresponds between two species: bones, landmarks, coordinates and muscles ([D] chapter 6), as a value.

Bones of two animals are compared in the directions of the anatomy, not in those of their files: proximal (for the
trunk cranial, for the foot dorsal), anterior (for the trunk ventral, for the foot towards the toes) and right.
A table is written once per pair of species; `study.species_table` reads it from a file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData

DIRECTIONS = ("proximal", "anterior", "right")
RuleKind: TypeAlias = Literal["joint", "farthest", "section", "box"]
Part: TypeAlias = Literal["", "joint", "middle", "first", "second"]
Box: TypeAlias = Mapping[str, tuple[float, float]]


def _none() -> Mapping[str, Any]:
    return MappingProxyType({})


@dataclass(frozen=True, eq=False)
class AnatomicalFrame:
    """Directions of the anatomy in the frames of bodies.

    Attributes
    ----------
    axes : (3, 3) rows proximal, anterior, right: unit vectors in a body's frame
    """

    axes: Array

    def __post_init__(self) -> None:
        axes = frozen_array(self.axes, (3, 3))
        if not np.allclose(axes @ axes.T, np.eye(3), atol=1e-6):
            raise BadData("proximal, anterior and right must be at right angles to each other")
        if np.linalg.det(axes) > 0.0:
            raise BadData("proximal, anterior and right make a mirrored body: is right really left?")
        object.__setattr__(self, "axes", axes)


@dataclass(frozen=True, eq=False)
class LandmarkRule:
    """How a landmark is found on a bone of either species.

    Attributes
    ----------
    rule : "joint" is the center of the joint by which a body hangs on its parent; "farthest" is the vertex farthest in
        a direction; "section" is the points of a cross-section farthest in directions evenly around, named after
        these; "box" is the eight corners of the bone's extent along the anatomy, for bones that are only scaled
    toward : of "farthest", how much each direction of the anatomy counts
    within : the region looked at, by direction, in shares of the part's extent from 0 to 1
    source_within, target_within : the same of one species only
    at : of "section", where along a direction, in shares of the part's extent
    along : that direction
    around : of "section", how many directions, the first anterior, in sections along anterior proximal
    source_joint, target_joint : of "joint", the body
    part : which connected parts count: "joint" the one nearest to the bone's first joint landmark, "middle" the
        others that straddle the midline, "first" and "second" by area, "" all
    """

    name: str
    rule: RuleKind
    toward: Mapping[str, float] = field(default_factory=_none)
    within: Box = field(default_factory=_none)
    source_within: Box = field(default_factory=_none)
    target_within: Box = field(default_factory=_none)
    at: tuple[float, ...] = ()
    along: Literal["proximal", "anterior"] = "proximal"
    around: int = 4
    source_joint: str = ""
    target_joint: str = ""
    part: Part = ""

    def __post_init__(self) -> None:
        for given in (self.toward, self.within, self.source_within, self.target_within):
            for name in given:
                if name not in DIRECTIONS:
                    raise BadData(f"landmark '{self.name}': no direction '{name}': there are {', '.join(DIRECTIONS)}")
        if self.rule not in get_args(RuleKind):
            raise BadData(f"landmark '{self.name}': no rule '{self.rule}': there are {', '.join(get_args(RuleKind))}")
        lacking = {
            "joint": not (self.source_joint and self.target_joint),
            "farthest": not self.toward,
            "section": not self.at or self.around < 3,
        }
        if lacking.get(self.rule):
            wants = {
                "joint": "source_joint and target_joint",
                "farthest": "toward",
                "section": "at, 3 or more around",
            }
            raise BadData(f"landmark '{self.name}': the rule '{self.rule}' needs {wants[self.rule]}")


@dataclass(frozen=True, eq=False)
class BoneHomology:
    """Bones that correspond.

    Attributes
    ----------
    sources : bodies of the source; several are fused in the target, and lie in the frame of the first as in the
        source's posture
    targets : bodies of the target; several are fused in the source, and lie in the frame of the first as in the
        target's posture
    source_frame, target_frame : where they differ from the species'
    carried : bodies of the source that have no bone of their own in the target and ride on this one
    spread : muscle points go to the nearest of the targets; otherwise all to the first
    half : only what lies to the right of the body's origin counts
    match : "dense" finds corresponding points all over the surfaces, beside the landmarks; "landmarks" maps by them
        alone; "similarity" lays the bones on each other by them and no more, where too little is alike
    """

    sources: tuple[str, ...]
    targets: tuple[str, ...]
    landmarks: tuple[LandmarkRule, ...]
    source_frame: AnatomicalFrame | None = None
    target_frame: AnatomicalFrame | None = None
    carried: tuple[str, ...] = ()
    spread: bool = False
    half: bool = False
    match: Literal["dense", "landmarks", "similarity"] = "dense"

    def __post_init__(self) -> None:
        if not self.sources or not self.targets:
            raise BadData("a pair of bones needs at least one body of the source and one of the target")


@dataclass(frozen=True)
class CoordinateHomology:
    """target = factor source + offset, of coordinates that mean the same movement [rad or m]."""

    source: str
    target: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class MuscleHomology:
    """Muscles that correspond, by the names of the models that were compared.

    Attributes
    ----------
    sources, targets : parts of one muscle in one species may be several in the other
    why : where it is not evident
    """

    sources: tuple[str, ...]
    targets: tuple[str, ...]
    why: str = ""


@dataclass(frozen=True, eq=False)
class SpeciesTable:
    """Everything that corresponds between two species.

    Attributes
    ----------
    source_frame, target_frame : directions of the anatomy in the bodies' frames, unless a bone says otherwise
    posture : coordinates of the source that bring its bones together as the target's are at `target_posture`
    missing : bodies of the source without a counterpart, and why
    extra : bodies of the target without a counterpart, and why
    """

    name: str
    source_frame: AnatomicalFrame
    target_frame: AnatomicalFrame
    bones: tuple[BoneHomology, ...]
    coordinates: tuple[CoordinateHomology, ...] = ()
    muscles: tuple[MuscleHomology, ...] = ()
    posture: Mapping[str, float] = field(default_factory=_none)
    target_posture: Mapping[str, float] = field(default_factory=_none)
    missing: Mapping[str, str] = field(default_factory=_none)
    extra: Mapping[str, str] = field(default_factory=_none)

    def __post_init__(self) -> None:
        named = [body for bone in self.bones for body in (*bone.sources, *bone.carried)]
        twice = next((body for body in named if named.count(body) > 1), "")
        if twice:
            raise BadData(
                f"species table '{self.name}': body '{twice}' of the source becomes two bones: use one entry "
                "with several targets"
            )

    def frames(self, bone: BoneHomology) -> tuple[AnatomicalFrame, AnatomicalFrame]:
        """Directions in the source's and in the target's body."""
        return bone.source_frame or self.source_frame, bone.target_frame or self.target_frame

    def homologous(self, muscle: str) -> tuple[str, ...]:
        """Names of a source muscle's counterparts in the target, () where it has none."""
        return tuple(name for one in self.muscles if muscle in one.sources for name in one.targets)
