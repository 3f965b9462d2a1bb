"""A man's leg, a mouse's skeleton, and the anatomist's muscles of the mouse laid on that skeleton.

The anatomist's table has no bones: its frames are aligned by joints, each segment's joints and
flexion axis on the skeleton's. Toes and pelvis take the directions of the frames and the size of
the whole leg.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.bones.morph.maps.fields import BoneMap, MapKind, MapOptions, fit_map
from myomorph.bones.morph.morphed import Architecture, Morph, MorphOptions
from myomorph.bones.morph.registration.smooth import MatchOptions
from myomorph.bones.morph.species.architecture import architectures
from myomorph.bones.morph.species.counterparts import LandmarkRule, Posed, Skeleton, SpeciesTable
from myomorph.bones.morph.species.maps import (
    SpeciesBones,
    SpeciesOptions,
    coordinate_table,
    size_over,
    species_bones,
    species_morph,
)
from myomorph.bones.morph.transfer.model import Graft, graft_muscles
from myomorph.bones.study.morph_files import source_bones
from myomorph.bones.study.species_morphing import read_species
from myomorph.core.model.paths import PathPoint
from myomorph.core.surfaces.linear_maps import AffineMap, Similarity, procrustes
from myomorph.core.surfaces.surface_points import Shape
from myomorph.swings.simulate.shoulder import arm_model
from truths.mouse_hindlimb import mouse_hindlimb_model

MAN = "rajagopal-walk-emg/subject_walk_scaled.osim"
BONES = "bones-opensim-rajagopal/Geometry"
MOUSE = "mouse-skeleton-keypoints/mouse_with_meshes.xml"
SEGMENTS = {
    "Pelvis": ("mouse", "Thigh_r", ""),
    "Torso": ("mouse", "Thigh_r", ""),
    "Thigh_r": ("mouse__RFemur", "Thigh_r", "Leg_r"),
    "Leg_r": ("mouse__RTibia", "Leg_r", "Foot_r"),
    "Foot_r": ("mouse__RTarsus", "Foot_r", "Toes_r"),
    "Toes_r": ("mouse__RBPhalange3", "Toes_r", ""),
}
"""By the anatomist's body: the skeleton's, and the bodies that hang on its proximal and distal
joints. The lumbar bodies' muscles, of which two begin in front of the pelvis, are laid on it.
"""
CHAIN = ("Thigh_r", "Leg_r", "Foot_r", "Toes_r")
HANGING = {one: SEGMENTS[one][0] for one in CHAIN}
COORDINATES = {
    "Hip_flexion_r": ("mouse__RHip_flexion", 1.0, 0.0),
    "Hip_adduction_r": ("mouse__RHip_adduction", 1.0, 0.0),
    "Hip_rotation_r": ("mouse__RHip_rotation", 1.0, 0.0),
    "Knee_extension_r": ("mouse__RKnee_flexion", 1.0, 0.0),
    "Ankle_flexion_r": ("mouse__RAnkle_flexion", 1.0, 0.0),
    "MTP_flexion_r": ("mouse__RBPhalange3_flexion", 1.0, 0.0),
}
FUSED = {
    "mouse__RTarsus": tuple(f"mouse__RMetatarsus{i}" for i in range(1, 6)),
    "mouse__RBPhalange3": tuple(f"mouse__RBPhalange{i}" for i in (1, 2, 4, 5)),
}
"""Bones of the skeleton that are one segment with another in the anatomist's table."""
ROUNDS = 100
"""Of moving a segment by the mean way of its attachments to the nearest places of its bone."""
MOUSE_AXES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""The anatomist's axes (forward, up, right) in the skeleton's (right, forward, up)."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """A model and the surfaces of its bones by body."""

    model: mm.Model
    surfaces: Mapping[str, mm.Surface]


def man(data: Path) -> Bodies:
    """Read the leg model of the data collection, with OpenSim's bones scaled as it specifies."""
    model = mm.read_model(data / MAN)
    return Bodies(model, source_bones(model, data / BONES))


def mouse(data: Path) -> Bodies:
    """Read the skeleton of stac-mjx."""
    model = mm.read_model(data / MOUSE)
    return Bodies(model, source_bones(model))


def scaling_table(table: SpeciesTable) -> SpeciesTable:
    """Return the same bones with an affine map.

    They are scaled by their extents along the directions of the anatomy.
    """
    box = (LandmarkRule("extent", "box"),)
    bones = tuple(replace(one, landmarks=box, match="landmarks", rays=()) for one in table.bones)
    return replace(table, bones=bones, relatives=(), straight=(), scaling=None)


METHODS: Mapping[str, tuple[MapKind, str]] = {
    "scaling": ("affine", "box"),
    "SSD": ("ssd", "dense"),
    "RBF": ("rbf", "dense"),
    "SSD, landmarks": ("ssd", "landmarks"),
}
"""Map, and what it is made from: extents, landmarks, landmarks with dense correspondence."""


@cache
def bones_of_man(data: Path, features: str) -> SpeciesBones:
    """Return the mouse's bones and the man's, with what corresponds on them."""
    source = man(data)
    target = mouse(data)
    table = read_species("human-mouse")
    options = SpeciesOptions(
        map=MapOptions("affine") if features == "box" else None,
        match=MatchOptions(features="landmarks" if features == "landmarks" else "dense"),
    )
    return species_bones(
        Skeleton(source.model, source.surfaces),
        Skeleton(target.model, target.surfaces),
        scaling_table(table) if features == "box" else table,
        options,
    )


@cache
def from_man(data: Path, method: str) -> Morph:
    """Transfer the man's leg muscles to the mouse's skeleton.

    Maps of one kind of features are derived from the same ones.
    """
    kind, features = METHODS[method]
    found = bones_of_man(data, features)
    table = read_species("human-mouse")
    target = mouse(data).model
    alike = {
        body
        for one in table.bones
        if one.match != "similarity"
        for body in (*one.sources, *one.transferred)
    }
    bones = {
        name: replace(one, map=fit_map(one.features, MapOptions(kind))) if name in alike else one
        for name, one in found.bones.items()
    }
    return graft_muscles(
        found.source,
        target,
        found.bones if kind == "ssd" else bones,
        graft=Graft(
            coordinates=coordinate_table(table, found.source, target),
            postures=(table.posture, table.target_posture),
            architecture=sized_architecture(man(data), mouse(data)),
        ),
    )


@cache
def from_arm(data: Path, method: str) -> Morph:
    """Transfer the man's arm muscles to the mouse's skeleton."""
    kind, features = METHODS[method]
    table = read_species("human-mouse-arm")
    target = mouse(data)
    source = arm_model()
    return species_morph(
        Skeleton(source, source_bones(source)),
        Skeleton(target.model, target.surfaces),
        scaling_table(table) if features == "box" else table,
        SpeciesOptions(map=MapOptions(kind), match=MatchOptions()),
    )


def sized_architecture(
    source: Bodies,
    target: Bodies,
    leave_out: tuple[str, ...] = (),
    only: str = "",
    bones: Mapping[str, BoneMap] | None = None,
) -> Mapping[str, Architecture]:
    """Fibers and forces of the man's muscles in the mouse by the tables of `human-mouse`.

    `leave_out`: muscles of the first table, by the anatomist's names, that it shall not have;
    `only`: a species, whose tables alone are taken; `bones`: maps; muscles on bodies that have none
    are left out.
    """
    table = read_species("human-mouse")
    given = [one for one in table.architecture if not only or one.species == only]
    if leave_out:
        given[0] = replace(
            given[0], rows=tuple(one for one in given[0].rows if one.name not in leave_out)
        )
    sizes = [size_over(one, table, target.model, target.surfaces) for one in given]
    muscles = [
        one.name
        for one in source.model.muscles
        if one.name.endswith("_r")
        and (bones is None or all(point.body in bones for point in one.path.points))
    ]
    return architectures(source.model, given, sizes, muscles)


class Alignment:
    """The anatomist's bodies laid on the skeleton's bones, both hanging straight down.

    `rule`: "joints" as above; "frames" takes the frames' directions for all segments, and for the
    size of each its own joints; "pelvis by joints" lays the pelvis by both hips and the lumbosacral
    joint; "onto bones" then moves each segment, without turning it, so that its attachments come
    nearest to the surface of its bone; `surfaces`: of the skeleton's bones, for "onto bones".
    """

    def __init__(
        self,
        anatomist: mm.Model,
        skeleton: mm.Model,
        rule: str = "joints",
        surfaces: Mapping[str, mm.Surface] | None = None,
    ):
        self._here = Posed(anatomist, {})
        self._there = Posed(skeleton, {}, surfaces or {})
        self._anatomist = anatomist
        joints = self._here.joints("Pelvis"), self._there.joints("mouse")
        self.ours = {one: joints[0][one] for one in CHAIN}
        self.theirs = {one: joints[1][HANGING[one]] for one in CHAIN}
        self.size = _reach(self.theirs) / _reach(self.ours)
        self._rule = rule
        left = self.ours["Thigh_r"] * [1.0, 1.0, -1.0]
        trunk = (joints[0]["Torso"], joints[1]["mouse__Lumbar6"])
        self._pelvis = (
            np.array([self.ours["Thigh_r"], left, trunk[0]]),
            np.array([self.theirs["Thigh_r"], joints[1]["mouse__LFemur"], trunk[1]]),
        )

    def similarity(self, body: str) -> Similarity:
        """From the anatomist's body to the skeleton's."""
        target, near, far = SEGMENTS[body]
        size = self.size
        turn = MOUSE_AXES
        if far:
            ours = self.ours[far] - self.ours[near]
            theirs = self.theirs[far] - self.theirs[near]
            size = float(np.linalg.norm(theirs) / np.linalg.norm(ours))
            if self._rule != "frames":
                turn = segment_frame(theirs, MOUSE_AXES[:, 2]).T @ segment_frame(
                    ours, np.array([0.0, 0.0, 1.0])
                )
        laid = Similarity(turn, self.theirs[near] - size * turn @ self.ours[near], size)
        if target == "mouse" and self._rule == "pelvis by joints":
            laid = procrustes(*self._pelvis, scale=True)
        seat = self._there.within("mouse", target)
        seated = Similarity(seat.rotation @ laid.rotation, seat.apply(laid.translation), laid.scale)
        if self._rule != "onto bones":
            return seated
        return replace(seated, translation=seated.translation + self.onto_bone(body, seated))

    def shape(self, body: str) -> Shape:
        """Return the skeleton's bones that a body of the anatomist's stands for."""
        target = SEGMENTS[body][0]
        return Shape(self._there.surface((target, *FUSED.get(target, ()))))

    def attachments(self, body: str) -> np.ndarray:
        """Return the ends of muscles on a body of the anatomist's.

        Parameters
        ----------
        body : of the anatomist's model

        Returns
        -------
        (n, 3) in its frame [m]
        """
        ends = [
            point
            for one in self._anatomist.muscles
            for point in (one.path.points[0], one.path.points[-1])
        ]
        return np.array(
            [one.location for one in ends if isinstance(one, PathPoint) and one.body == body]
        )

    def onto_bone(self, body: str, laid: Similarity) -> np.ndarray:
        """Return the displacement of a segment that brings its attachments nearest to its bone.

        Parameters
        ----------
        body : of the segment
        laid : alignment of the segment

        Returns
        -------
        (3,) [m]
        """
        body = "Pelvis" if body == "Torso" else body
        shape = self.shape(body)
        points = laid.apply(self.attachments(body))
        moved = np.zeros(3)
        for _ in range(ROUNDS):
            moved = moved + (shape.closest(points + moved)[0] - points - moved).mean(axis=0)
        return moved

    def residual(self) -> float:
        """Return how far three joints of the pelvis stay apart when they are laid on each other.

        It is their root mean square [m].
        """
        laid = procrustes(*self._pelvis, scale=True)
        apart = np.linalg.norm(laid.apply(self._pelvis[0]) - self._pelvis[1], axis=1)
        return float(np.sqrt(np.mean(apart**2)))


def _reach(joints: Mapping[str, np.ndarray]) -> float:
    return sum(float(np.linalg.norm(joints[a] - joints[b])) for a, b in pairwise(CHAIN))


def segment_frame(along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Return the axes of a segment: along it, across it, and at right angles to both.

    Parameters
    ----------
    along : (3,) from one joint to the other
    across : (3,) direction that the second axis comes near

    Returns
    -------
    (3, 3) unit vectors as rows
    """
    first = along / np.linalg.norm(along)
    second = across - first * (across @ first)
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)])


def given_map(body: str, target: str, whole: Similarity) -> BoneMap:
    """Return a bone that is laid on another by one similarity."""
    return BoneMap(
        body=body,
        target_body=target,
        map=AffineMap.from_similarity(whole),
        whole=whole,
        basis="given",
    )


@cache
def anatomist_on_skeleton(data: Path, rule: str = "joints") -> Morph:
    """Return the anatomist's muscles on the mouse's skeleton, with which a transfer is compared."""
    anatomist = mouse_hindlimb_model(data / "mouse-hindlimb-muscles/mouse_hindlimb.json")
    skeleton = mouse(data).model
    laid = Alignment(
        anatomist=anatomist, skeleton=skeleton, rule=rule, surfaces=mouse(data).surfaces
    )
    bones = {body: given_map(body, SEGMENTS[body][0], laid.similarity(body)) for body in SEGMENTS}
    options = MorphOptions(surface_within=0.0, clear=False, fibers="path", force="area")
    return graft_muscles(anatomist, skeleton, bones, options, Graft(coordinates=COORDINATES))


MAN_SEGMENTS = {
    "femur_r": ("Thigh_r", ("femur_r", "Thigh_r"), ("tibia_r", "Leg_r")),
    "tibia_r": ("Leg_r", ("tibia_r", "Leg_r"), ("talus_r", "Foot_r")),
    "calcn_r": ("Foot_r", ("talus_r", "Foot_r"), ("toes_r", "Toes_r")),
}
"""By body of the man, the mouse's segment, and the joints near and far of both."""
MAN_COORDINATES = {
    "hip_flexion_r": ("Hip_flexion_r", 1.0, -0.5 * np.pi),
    "hip_adduction_r": ("Hip_adduction_r", 1.0, 0.0),
    "hip_rotation_r": ("Hip_rotation_r", 1.0, 0.0),
    "knee_angle_r": ("Knee_extension_r", -1.0, 0.0),
    "ankle_angle_r": ("Ankle_flexion_r", 1.0, 0.0),
}
"""By coordinate of the man, the mouse's, its sign and offset [rad]."""


@cache
def from_man_by_joints(data: Path) -> Morph:
    """Transfer the man's leg muscles to the anatomist's own model by the joints of both.

    Nothing else is used. The pelvis is laid by both hips and the lumbosacral joint. A segment
    between two joints is laid by these and the flexion axis, the toes by their joint in the size of
    the foot.
    """
    table = read_species("human-mouse")
    source = man(data).model
    target = mouse_hindlimb_model(data / "mouse-hindlimb-muscles/mouse_hindlimb.json")
    here = Posed(source, table.posture)
    there = Posed(target, {})
    found = {"pelvis": _pelvis_by_joints(here, there)}
    found |= {body: _segment_by_joints(here, there, body) for body in MAN_SEGMENTS}
    found["toes_r"] = _toes_by_joint(here, there, found["calcn_r"].whole)
    for rider, bone in (("patella_r", "tibia_r"), ("talus_r", "calcn_r")):
        pose = here.within(rider, bone)
        whole = found[bone].whole
        moved = Similarity(
            whole.rotation @ pose.rotation, whole.apply(pose.translation), whole.scale
        )
        found[rider] = given_map(rider, found[bone].target_body, moved)
    options = MorphOptions(surface_within=0.0, clear=False)
    postures = (table.posture, {"Knee_extension_r": -0.5 * np.pi})
    graft = Graft(coordinates=MAN_COORDINATES, postures=postures)
    return graft_muscles(source, target, found, options, graft)


def _segment_by_joints(here: Posed, there: Posed, body: str) -> BoneMap:
    """Lay a segment by its two joints and the flexion axis."""
    segment, near, far = MAN_SEGMENTS[body]
    right = np.array([0.0, 0.0, 1.0])
    ours = here.joints(body)
    theirs = there.joints(segment)
    our_length = ours[far[0]] - ours[near[0]]
    their_length = theirs[far[1]] - theirs[near[1]]
    size = float(np.linalg.norm(their_length) / np.linalg.norm(our_length))
    turn = segment_frame(their_length, right).T @ segment_frame(our_length, right)
    whole = Similarity(turn, theirs[near[1]] - size * turn @ ours[near[0]], size)
    return given_map(body, segment, whole)


def _toes_by_joint(here: Posed, there: Posed, foot: Similarity) -> BoneMap:
    """Lay the toes by their joint, as the foot is rotated and scaled."""
    start = foot.scale * foot.rotation @ here.joints("toes_r")["toes_r"]
    toes = Similarity(foot.rotation, there.joints("Toes_r")["Toes_r"] - start, foot.scale)
    return given_map("toes_r", "Toes_r", toes)


def _pelvis_by_joints(here: Posed, there: Posed) -> BoneMap:
    ours = here.joints("pelvis")
    theirs = there.joints("Pelvis")
    hip = theirs["Thigh_r"]
    source = np.array([ours["femur_r"], ours["femur_l"], ours["torso"]])
    target = np.array([hip, hip * [1.0, 1.0, -1.0], theirs["Torso"]])
    return given_map("pelvis", "Pelvis", procrustes(source, target, scale=True))
