"""Homologous landmarks of two species' bones, found by the rules of a species table."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.bones.morph.species.counterparts import DIRECTIONS, AnatomicalFrame, LandmarkRule
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.surface import Surface, connected, edges_of, face_crosses

# A part straddles the midline where its middle lies within this share of its width from it.
MIDDLE = 0.1
Landmarks = dict[str, Array]
Ints = NDArray[np.int64]


class Parts:
    """Connected parts of a bone's surface in the directions of the anatomy.

    `joint`: (3,) where the bone's first joint landmark is [m]; `half`: only what lies to the right
    of the body's origin counts.
    """

    def __init__(self, surface: Surface, frame: AnatomicalFrame, joint: Array | None, half: bool):
        self._points = surface.vertices @ frame.axes.T
        faces = surface.faces[_area(surface) > 0.0]
        # Number of the connected part of every vertex; vertices at one place are one.
        _, place = np.unique(surface.vertices, axis=0, return_inverse=True)
        labels = connected(int(place.max()) + 1, edges_of(place.reshape(-1)[faces]))[
            place.reshape(-1)
        ]
        if half:
            keep = self._points[:, 2] >= 0.0
            faces = faces[keep[faces].all(axis=1)]
        self._faces = faces
        self._label = labels[faces[:, 0]]
        self._names = self._named(surface, labels, frame, joint)

    def _named(
        self, surface: Surface, labels: Ints, frame: AnatomicalFrame, joint: Array | None
    ) -> Mapping[str, list[int]]:
        present = [int(label) for label in np.unique(self._label)]
        areas = {
            label: float(_area(surface)[labels[surface.faces[:, 0]] == label].sum())
            for label in present
        }
        by_area = sorted(present, key=lambda label: -areas[label])
        named = {"": present, "first": by_area[:1], "second": by_area[1:2]}
        if joint is not None:
            apart = np.linalg.norm(self._points - frame.axes @ joint, axis=1)
            near = min(present, key=lambda label: float(apart[labels == label].min()))
            across = {label: self._points[labels == label, 2] for label in present if label != near}
            named["joint"] = [near]
            named["middle"] = [
                name
                for name, x in across.items()
                if abs(x.min() + x.max()) < 2.0 * MIDDLE * np.ptp(x)
            ]
        return named

    def of(self, rule: LandmarkRule) -> tuple[Array, Ints]:
        """Return points and faces of the parts of a rule.

        Parameters
        ----------
        rule : that names a part

        Returns
        -------
        points (n, 3) along the anatomical directions [m], and faces (faces, 3), indices of these

        Raises
        ------
        BadData : the bone has no such part
        """
        wanted = self._names.get(rule.part, [])
        faces = self._faces[np.isin(self._label, wanted)]
        if not len(faces):
            raise BadData(f"landmark '{rule.name}': the bone has no part '{rule.part}'")
        used, numbers = np.unique(faces, return_inverse=True)
        return self._points[used], np.reshape(numbers, faces.shape)


def _area(surface: Surface) -> Array:
    return 0.5 * np.linalg.norm(face_crosses(surface.vertices, surface.faces), axis=1)


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class MarkedBone:
    """A bone on which landmarks are found.

    Attributes
    ----------
    surface : in its body's frame [m]
    frame : anatomical directions of the body
    joints : (3,) centers of joints by the body that hangs on them [m]
    of_source : whether the bone is the source's
    half : only what lies to the right of the body's origin counts
    """

    surface: Surface
    frame: AnatomicalFrame
    joints: Mapping[str, Array]
    of_source: bool
    half: bool = False


def landmarks_by_rules(
    rules: tuple[LandmarkRule, ...], bone: MarkedBone
) -> tuple[Landmarks, tuple[str, ...]]:
    """Find landmarks of one bone by rules.

    Parameters
    ----------
    rules : one per landmark, or pair of landmarks
    bone : on which they are

    Returns
    -------
    landmarks : by name, (3,) in the body's frame [m]
    notes : which rules found none and why, one line each

    Raises
    ------
    BadData : a rule names a joint that does not exist
    """
    landmarks: Landmarks = {}
    for rule in rules:
        if rule.rule == "joint":
            name = rule.source_joint if bone.of_source else rule.target_joint
            if name not in bone.joints:
                raise BadData(
                    f"landmark '{rule.name}': no joint of '{name}': there are"
                    f" {', '.join(sorted(bone.joints))}"
                )
            landmarks[rule.name] = np.asarray(bone.joints[name], dtype=np.float64)
    first = next(iter(landmarks.values()), None)
    parts = Parts(surface=bone.surface, frame=bone.frame, joint=first, half=bone.half)
    notes = []
    for rule in rules:
        if rule.rule == "joint":
            continue
        try:
            points, faces = parts.of(rule)
            box = {**rule.within, **(rule.source_within if bone.of_source else rule.target_within)}
            if rule.rule == "farthest":
                here = _farthest(rule, points, box)
            else:
                here = (
                    _sections(rule, points, faces)
                    if rule.rule == "section"
                    else _corners(rule, points)
                )
        except BadData as error:
            notes.append(str(error))
            continue
        landmarks |= {name: point @ bone.frame.axes for name, point in here.items()}
    return landmarks, tuple(notes)


def _farthest(
    rule: LandmarkRule, points: Array, box: Mapping[str, tuple[float, float]]
) -> Landmarks:
    low = points.min(axis=0)
    extent = np.ptp(points, axis=0)
    inside = np.ones(len(points), dtype=bool)
    for name, (least, most) in box.items():
        direction = DIRECTIONS.index(name)
        share = (points[:, direction] - low[direction]) / extent[direction]
        inside &= (share >= least) & (share <= most)
    if not inside.any():
        raise BadData(f"landmark '{rule.name}': the bone has no vertex in its region")
    # Relative to the part's extents, so that a slender and a stout bone have it at the same place.
    toward = np.array([rule.toward.get(name, 0.0) for name in DIRECTIONS]) / extent
    region = points[inside]
    return {rule.name: region[int(np.argmax(region @ toward))]}


def _corners(rule: LandmarkRule, points: Array) -> Landmarks:
    ends = np.array([points.min(axis=0), points.max(axis=0)])
    return {
        f"{rule.name} {i}{j}{third}": np.array([ends[i, 0], ends[j, 1], ends[third, 2]])
        for i, j, third in itertools.product((0, 1), repeat=3)
    }


def _sections(rule: LandmarkRule, points: Array, faces: Ints) -> Landmarks:
    # Along anterior the section is spanned by proximal and right, in that order.
    order = [0, 1, 2] if rule.along == "proximal" else [1, 0, 2]
    turned = points[:, order]
    low = float(turned[:, 0].min())
    extent = float(np.ptp(turned[:, 0]))
    landmarks: Landmarks = {}
    for share in rule.at:
        height = low + share * extent
        ends = section(turned, faces, height).reshape(-1, 2)
        if not len(ends):
            raise BadData(f"landmark '{rule.name}': no cross-section at {share:g} of the bone")
        for angle in 2.0 * np.pi * np.arange(rule.around) / rule.around:
            farthest = ends[int(np.argmax(ends @ [np.cos(angle), np.sin(angle)]))]
            landmarks[f"{rule.name} {share:g} at {np.degrees(angle):.0f}"] = np.array(
                [height, *farthest]
            )[order]
    return landmarks


def section(points: Array, faces: Ints, height: float) -> Array:
    """Cut a surface across its first axis into straight pieces.

    Parameters
    ----------
    points : (n, 3) of the surface [m]
    faces : (faces, 3) indices of points
    height : of the cut along the first axis [m]

    Returns
    -------
    (pieces, 2, 2) first and second end of each piece, in the other two axes [m]
    """
    above = points[:, 0] > height
    cut = faces[(above[faces].any(axis=1)) & ~(above[faces].all(axis=1))]
    if not len(cut):
        return np.empty((0, 2, 2))
    # The corner that is alone on its side of the plane comes first.
    side = above[cut]
    alone = np.where(side.sum(axis=1) == 1, side.argmax(axis=1), (~side).argmax(axis=1))
    tip = points[np.take_along_axis(cut, alone[:, None], axis=1)[:, 0]]
    pieces = np.empty((len(cut), 2, 2))
    for axis in (1, 2):
        other = points[np.take_along_axis(cut, (alone[:, None] + axis) % 3, axis=1)[:, 0]]
        share = (height - tip[:, :1]) / (other[:, :1] - tip[:, :1])
        pieces[:, axis - 1] = (tip + share * (other - tip))[:, 1:]
    return pieces
