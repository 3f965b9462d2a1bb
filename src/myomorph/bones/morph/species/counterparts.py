"""What corresponds between two species: bones, landmarks, coordinates and muscles ([D] chapter 6).

Bones of two animals are compared in the directions of the anatomy, not in those of their files:
proximal (for the trunk cranial, for the foot dorsal), anterior (for the trunk ventral, for the foot
towards the toes) and right. A table is a value, written once per pair of species;
`study.subject.species_morphing` reads it from a file. A bone of one may be several in the other:
their bodies are compared in postures in which the bones lie alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from myomorph.bones.morph.checks.moment_arms import CoordinatePair
from myomorph.bones.morph.maps.fields import BoneMap, PlacedMap
from myomorph.bones.morph.species.architecture import ArchitectureTable, ScalingLaw
from myomorph.bones.morph.species.attachments import RelativeBone, with_parts
from myomorph.bones.morph.species.masses import MarkerTable, SegmentShare
from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle, PathPoint
from myomorph.core.model.spatial import Transform
from myomorph.core.model.surface import Surface, joined_surfaces
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.core.surfaces.linear_maps import AffineMap, Similarity
from myomorph.core.surfaces.surface_points import Shape

DIRECTIONS = ("proximal", "anterior", "right")
RuleKind: TypeAlias = Literal["joint", "farthest", "section", "box"]
Part: TypeAlias = Literal["", "joint", "middle", "first", "second"]
Box: TypeAlias = Mapping[str, tuple[float, float]]


def _none() -> Mapping[str, Any]:
    return FrozenMap({})


@read_only
class AnatomicalFrame:
    """Directions of the anatomy in the frames of bodies."""

    axes: Array  # (3, 3) rows proximal, anterior, right: unit vectors in a body's frame

    def __post_init__(self) -> None:
        axes = frozen_array(self.axes, (3, 3))
        if not np.allclose(axes @ axes.T, np.eye(3), atol=1e-6):
            raise BadData("proximal, anterior and right must be at right angles to each other")
        if np.linalg.det(axes) > 0.0:
            raise BadData(
                "proximal, anterior and right make a mirrored body: is right really left?"
            )
        object.__setattr__(self, "axes", axes)


@dataclass(frozen=True, eq=False)
class LandmarkRule:
    """How a landmark is found on a bone of either species."""

    name: str
    # "joint" is the center of the joint by which a body hangs on its parent; "farthest" is the
    # vertex farthest in a direction; "section" is the points of a cross-section farthest in
    # directions evenly around, named after these; "box" is the eight corners of the bone's extent
    # along the anatomy, for bones that are only scaled
    rule: RuleKind
    # of "farthest", how much each direction of the anatomy counts
    toward: Mapping[str, float] = field(default_factory=_none)
    # the region looked at, by direction, in shares of the part's extent from 0 to 1
    within: Box = field(default_factory=_none)
    # source_within, target_within: the same of one species only
    source_within: Box = field(default_factory=_none)
    target_within: Box = field(default_factory=_none)
    # of "section", where along a direction, in shares of the part's extent
    at: tuple[float, ...] = ()
    along: Literal["proximal", "anterior"] = "proximal"  # that direction
    # of "section", how many directions, the first anterior, in sections along anterior proximal
    around: int = 4
    # source_joint, target_joint: of "joint", the body
    source_joint: str = ""
    target_joint: str = ""
    # which connected parts count: "joint" the one nearest to the bone's first joint landmark,
    # "middle" the others that straddle the midline, "first" and "second" by area, "" all
    part: Part = ""

    def __post_init__(self) -> None:
        for part in (self.toward, self.within, self.source_within, self.target_within):
            for name in part:
                if name not in DIRECTIONS:
                    raise BadData(
                        f"landmark '{self.name}': no direction '{name}': there are"
                        f" {', '.join(DIRECTIONS)}"
                    )
        if self.rule not in get_args(RuleKind):
            raise BadData(
                f"landmark '{self.name}': no rule '{self.rule}': there are"
                f" {', '.join(get_args(RuleKind))}"
            )
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
            raise BadData(
                f"landmark '{self.name}': the rule '{self.rule}' needs {wants[self.rule]}"
            )


@dataclass(frozen=True)
class Ray:
    """A digit of the target, and the muscles whose tendons go to it."""

    # toe, metatarsal: bodies of the target
    toe: str
    metatarsal: str
    # extensors, flexors: muscles of the source, dorsal and plantar of the joint between the two
    extensors: tuple[str, ...] = ()
    flexors: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        both = set(self.extensors) & set(self.flexors)
        if both or not (self.extensors or self.flexors):
            raise BadData(
                f"ray {self.toe}: expected extensors or flexors, none both:"
                f" {', '.join(sorted(both))}"
            )


@dataclass(frozen=True, eq=False)
class BoneHomology:
    """Bones that correspond."""

    # bodies of the source; several are fused in the target, and lie in the frame of the first as in
    # the source's posture
    sources: tuple[str, ...]
    # bodies of the target; several are fused in the source, and lie in the frame of the first as in
    # the target's posture
    targets: tuple[str, ...]
    landmarks: tuple[LandmarkRule, ...]
    # source_frame, target_frame: where they differ from the species'
    source_frame: AnatomicalFrame | None = None
    target_frame: AnatomicalFrame | None = None
    # bodies of the source that have no bone of their own in the target and ride on this one
    transferred: tuple[str, ...] = ()
    # muscle points go to the nearest of the targets, with `rays` all of a muscle's to the same;
    # otherwise all to the first
    spread: bool = False
    half: bool = False  # only what lies to the right of the body's origin counts
    # "dense" finds corresponding points all over the surfaces, beside the landmarks; "landmarks"
    # maps by them alone; "similarity" lays the bones on each other by them and no more, where too
    # little is alike
    match: Literal["dense", "landmarks", "similarity"] = "dense"
    # digits of the target and their muscles, which go there whatever is nearest
    rays: tuple[Ray, ...] = ()

    def __post_init__(self) -> None:
        if not self.sources or not self.targets:
            raise BadData(
                "a pair of bones needs at least one body of the source and one of the target"
            )


@dataclass(frozen=True)
class MuscleHomology:
    """Muscles that correspond, by the names of the models that were compared."""

    # sources, targets: parts of one muscle in one species may be several in the other
    sources: tuple[str, ...]
    targets: tuple[str, ...]
    why: str = ""  # where it is not evident


@dataclass(frozen=True, eq=False)
class SpeciesTable:
    """Everything that corresponds between two species."""

    name: str
    # source_frame, target_frame: directions of the anatomy in the bodies' frames, unless a bone
    # says otherwise
    source_frame: AnatomicalFrame
    target_frame: AnatomicalFrame
    bones: tuple[BoneHomology, ...]
    coordinates: tuple[CoordinatePair, ...] = ()
    muscles: tuple[MuscleHomology, ...] = ()
    # coordinates of the source that bring its bones together as the target's are at
    # `target_posture`
    posture: Mapping[str, float] = field(default_factory=_none)
    target_posture: Mapping[str, float] = field(default_factory=_none)
    # bodies of the source without a counterpart, and why
    missing: Mapping[str, str] = field(default_factory=_none)
    # bodies of the target without a counterpart, and why
    extra: Mapping[str, str] = field(default_factory=_none)
    # fiber lengths and strengths of muscles, of the target species first, then of its relatives
    architecture: tuple[ArchitectureTable, ...] = ()
    # how fibers and forces follow the source's where there is no table of them
    scaling: ScalingLaw | None = None
    masses: tuple[SegmentShare, ...] = ()  # shares of segments of the target in its mass
    # tables of labels of recordings of the target, see `MarkerTable`
    markers: tuple[MarkerTable, ...] = ()
    # where muscles begin or end on bones of relatives of the target, see `RelativeBone`
    relatives: tuple[RelativeBone, ...] = ()
    # muscles of the source whose paths run from end to end in the target, without points or wraps
    # between
    straight: tuple[str, ...] = ()
    # where muscles of other orders attach, 90 % lie within this share of the bone's length; 0 where
    # nothing is known of that
    unlike: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.unlike <= 1.0:
            raise BadData(
                f"species table '{self.name}': unlike is {self.unlike:g}: expected a share from 0"
                " to 1"
            )
        named = [body for bone in self.bones for body in (*bone.sources, *bone.transferred)]
        twice = next((body for body in named if named.count(body) > 1), "")
        if twice:
            raise BadData(
                f"species table '{self.name}': '{twice}' becomes two bones: use one entry with"
                " several targets"
            )

    def frames(self, bone: BoneHomology) -> tuple[AnatomicalFrame, AnatomicalFrame]:
        """Directions in the source's and in the target's body."""
        return bone.source_frame or self.source_frame, bone.target_frame or self.target_frame

    def homologous(self, muscle: str) -> tuple[str, ...]:
        """Names of a source muscle's counterparts in the target, () where it has none."""
        return tuple(
            name
            for homology in self.muscles
            if muscle in homology.sources
            for name in homology.targets
        )


Surfaces = Mapping[str, Surface]


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A model with the surfaces of its bones, by body and in the bodies' frames [m]."""

    model: Model
    surfaces: Surfaces


class Posed:
    """A model in one posture: where bodies, joints and bones' surfaces are."""

    def __init__(
        self, model: Model, posture: Mapping[str, float], surfaces: Surfaces | None = None
    ):
        self.model = model
        self._pose = standing_poses(model, posture)
        self.surfaces = surfaces or {}

    def within(self, body: str, other: str) -> Transform:
        """Pose of one body in another's frame."""
        for name in (body, other):
            if name not in self._pose:
                raise UnknownName("body", name, self.model.body_names)
        return self._pose[other].inverse() @ self._pose[body]

    def joints(self, body: str) -> dict[str, Array]:
        """Return the centers of all joints, by the body that hangs on them.

        Parameters
        ----------
        body : in whose frame they are expressed

        Returns
        -------
        (3,) center of each joint [m], by child body
        """
        return {
            joint.child: self.within(joint.child, body).apply(joint.child_frame.translation)
            for joint in self.model.joints
        }

    def surface(self, bodies: tuple[str, ...], frame: str = "") -> Surface:
        """Surfaces of several bodies as one, in the frame of a body, by default of the first."""
        known = [body for body in bodies if body in self.surfaces]
        if not known:
            raise BadData(f"no surface of {' or '.join(bodies)}: give the bone's mesh")
        places = ((self.within(body, frame or bodies[0]), self.surfaces[body]) for body in known)
        return joined_surfaces(
            [Surface(pose.apply(surface.vertices), surface.faces) for pose, surface in places]
        )


def riders(bone: BoneMap, pair: BoneHomology, here: Posed) -> dict[str, BoneMap]:
    """Map of the first body, and of the bodies that are one bone with it or move with it."""
    result = {bone.body: bone}
    for name in (*pair.sources[1:], *pair.transferred):
        if name in here.model.body_names:
            result[name] = _placed(
                bone, name, bone.target_body, before=here.within(name, bone.body)
            )
    return result


def _placed(
    bone: BoneMap,
    body: str,
    target_body: str,
    before: Transform | None = None,
    after: Transform | None = None,
) -> BoneMap:
    """Return the map of what is fixed at a pose of a bone's source body.

    It goes to the body in which the target has a pose.
    """
    before = before or Transform.identity()
    after = after or Transform.identity()
    whole = bone.whole
    marks = bone.features
    back = before.inverse()
    origin = after.apply(whole.apply(before.translation))
    return replace(
        bone,
        body=body,
        target_body=target_body,
        map=PlacedMap(
            AffineMap(before.rotation, before.translation),
            bone.map,
            AffineMap(after.rotation, after.translation),
        ),
        whole=Similarity(after.rotation @ whole.rotation @ before.rotation, origin, whole.scale),
        source=(
            None
            if bone.source is None
            else Surface(back.apply(bone.source.vertices), bone.source.faces)
        ),
        target=(
            None
            if bone.target is None
            else Surface(after.apply(bone.target.vertices), bone.target.faces)
        ),
        features=(
            None
            if marks is None
            else replace(marks, source=back.apply(marks.source), target=after.apply(marks.target))
        ),
    )


def part_name(body: str, target: str) -> str:
    """Name of the part of a source body whose points go to one of several targets."""
    return f"{body}@{target}"


def seated(bone: BoneMap, body: str, pair: BoneHomology, number: int, there: Posed) -> BoneMap:
    """Return the map of a source body to another of its targets."""
    name = pair.targets[number]
    return _placed(bone, part_name(body, name), name, after=there.within(pair.targets[0], name))


def spread_over_targets(
    source: Model,
    parts: Mapping[str, tuple[str, ...]],
    bones: Mapping[str, BoneMap],
    there: Posed,
    digits: frozenset[str] = frozenset(),
) -> Model:
    """Add a body to the source for every target that a body's muscle points go to.

    `digits`: bodies whose targets lie side by side: all of a muscle's points there go to the same.
    """
    shapes = {
        (targets[0], name): Shape(there.surface((name,), targets[0]))
        for targets in parts.values()
        for name in targets
        if name in there.surfaces
    }

    def nearest(body: str, places: list[Array]) -> str:
        """Return the target nearest to points of a muscle on a body."""
        targets = parts[body]
        mapped = bones[body].map.apply(np.array(places))
        known = [name for name in targets if (targets[0], name) in shapes]
        apart = [_sum_of_distances(shapes[targets[0], name], mapped) for name in known]
        best = known[int(np.argmin(apart))]
        return body if best == targets[0] else part_name(body, best)

    new = [(part_name(body, name), body) for body, targets in parts.items() for name in targets[1:]]
    spread = [_on_targets(muscle, parts, digits, nearest) for muscle in source.muscles]
    return with_parts(source, new, spread)


def _sum_of_distances(shape: Shape, points: Array) -> float:
    """Sum the distances of points (n, 3) from a surface [m]."""
    return float(np.linalg.norm(shape.nearest(points, True).points - points, axis=1).sum())


def _on_targets(
    muscle: Muscle,
    parts: Mapping[str, tuple[str, ...]],
    digits: frozenset[str],
    nearest: Callable[[str, list[Array]], str],
) -> Muscle:
    """Fix a muscle's points on bodies with several targets to the bodies of the nearest.

    `digits`: bodies of which all points go to the same; `nearest`: from a body and points on it to
    the body of the target.
    """
    fixed = [
        point
        for point in muscle.path.points
        if isinstance(point, PathPoint) and point.body in parts
    ]
    goes: dict[int, str] = {}
    for point in fixed:
        places = [point.location]
        if point.body in digits:
            places = [each.location for each in fixed if each.body == point.body]
        goes[id(point)] = nearest(point.body, places)
    points = tuple(
        replace(point, body=goes[id(point)]) if id(point) in goes else point
        for point in muscle.path.points
    )
    return replace(muscle, path=replace(muscle.path, points=points))
