"""Clusters of three markers on the bones of a specimen, for experiments that are made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Marker
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree
from myomorph.viscosity.specimen.model import Specimen

TRIANGLE = np.array([[50.0, 0.0], [10.0, 28.0], [-30.0, -25.0]]) / 50.0
"""Three markers around a pin, in units of the longest arm; no two sides are alike, so that labels can be told."""

PIN = 0.06
"""Distance of a cluster from its bone's line [m]."""


def with_clusters(specimen: Specimen, arm: float = 0.05) -> Specimen:
    """The specimen with three made markers, "<bone>_1" to "_3", on every bone and no others.

    A cluster stands on a pin at the middle of its bone, beside the line from joint to joint.

    Parameters
    ----------
    arm : distance of a cluster's farthest marker from its pin [m]; the others are at 0.6 and 0.8 of it
    """
    markers: list[Marker] = []
    for bone in specimen.model.body_names:
        start, end = _line(specimen, bone)
        along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
        aside = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
        aside /= np.linalg.norm(aside)
        pin = 0.5 * (start + end) + PIN * aside
        places = pin + arm * TRIANGLE @ np.array([along, np.cross(aside, along)])
        markers += [Marker(f"{bone}_{i + 1}", bone, place) for i, place in enumerate(places)]
    return replace(specimen, model=specimen.model.with_markers(tuple(markers)))


def _line(specimen: Specimen, bone: str) -> tuple[Array, Array]:
    """Two points of a bone in its own frame: its joint, and the farther of next joint and mass center [m]."""
    model = specimen.model
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.defaults[None])
    b = tree.body_index[bone]
    if bone == specimen.base:
        start = specimen.center
    else:
        start = next(one for one in model.joints if one.child == bone).child_frame.translation
    ends = [np.asarray(model.body(bone).mass_center)]
    for joint in model.joints:
        if joint.parent == bone and bone != specimen.base:
            place = poses.origins[0, tree.body_index[joint.child]] - poses.origins[0, b]
            ends.append(poses.rotations[0, b].T @ place)
    end = max(ends, key=lambda one: float(np.linalg.norm(one - start)))
    return (start, end) if np.linalg.norm(end - start) > 1e-3 else (start, start + np.array([0.0, 0.05, 0.0]))
