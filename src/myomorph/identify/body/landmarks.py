"""Anatomical landmarks on the skin of a standing body, and the marker names that laboratories give them."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from myomorph.model.arrays import Array

FORWARD, UP, RIGHT = np.eye(3)

_SIDED = (
    ("ASIS", r"asis?|asi"),
    ("PSIS", r"psis?|psi"),
    ("acromion", r"acr(omi(on|um))?|ac|sho|shoulder|sh"),
    ("lateral elbow", r"lel|lelb|elb(ow)?(_?lat(eral)?)?|lhe|humlatepi|elblat"),
    ("medial elbow", r"mel|melb|elb(ow)?_?med(ial)?|mhe"),
    ("lateral knee", r"kne|knee(_?lat(eral)?)?|lfc|lknee|lfe|latknee"),
    ("medial knee", r"knee?_?med(ial)?|mfc|mknee|mfe|kneemed"),
    ("lateral ankle", r"ank|ankle(_?lat(eral)?)?|lmal|lankle|latmal"),
    ("medial ankle", r"ank(le)?_?med(ial)?|mmal|mankle|anklemed"),
    ("heel", r"hee(l)?|cal(c)?(aneus)?"),
    ("toe tip", r"toe_?tip|hallux"),
)
_MIDDLE = (
    ("C7", r"c7"),
    ("head top", r"top[._ ]?head|head[._ ]?top|vertex"),
    ("sternum", r"sternum|clav|jugular|ij|sjn"),
)


def landmark_of_marker(marker: str) -> str:
    """Name of the landmark that a marker's name tells, "" where it tells none: "right ASIS" for `R.ASIS`."""
    name = marker.strip().lower()
    for landmark, pattern in _MIDDLE:
        if re.fullmatch(pattern, name):
            return landmark
    for form in (r"(?P<side>r|l|right|left)[._ -]?(?P<base>.+)", r"(?P<base>.+?)[._ -](?P<side>r|l|right|left)"):
        found = re.fullmatch(form, name)
        if found is None:
            continue
        base = re.sub(r"[. -]", "_", found["base"])
        for landmark, pattern in _SIDED:
            if re.fullmatch(pattern, base):
                return f"{'right' if found['side'][0] == 'r' else 'left'} {landmark}"
    return ""


def landmark_vertices(vertices: Array, faces: np.ndarray, places: Mapping[str, Array]) -> dict[str, int]:
    """Vertex of each landmark of a standing body, x forward, y up, z right.

    Landmarks are where a ray from a joint center, along an axis of the body or of a joint, leaves the skin; the
    pelvis's stand to the hip joint centers as Bell, Pedersen and Brand 1990 found: 14, 19 and 30 % of the
    distance of the ASIS medial, behind and below them.

    Parameters
    ----------
    places : (3,) where each bone of the rig begins [m]
    """
    used = np.unique(faces)

    def leaving(start: Array, direction: Array) -> int:
        point = _exit(vertices, faces, start, direction / np.linalg.norm(direction))
        return int(used[np.argmin(np.linalg.norm(vertices[used] - point, axis=1))])

    hips = {side: places[f"upperleg01.{side}"] for side in "RL"}
    width = float(np.linalg.norm(hips["R"] - hips["L"])) / 0.72
    found = {
        "C7": leaving(places["neck01"], -FORWARD),
        "sternum": leaving(0.5 * (places["clavicle.R"] + places["clavicle.L"]), FORWARD),
        "head top": int(used[np.argmax(vertices[used, 1])]),
    }
    for letter, side, out in (("R", "right", RIGHT), ("L", "left", -RIGHT)):
        shoulder, elbow, wrist = (places[f"{bone}.{letter}"] for bone in ("upperarm01", "lowerarm01", "wrist"))
        knee, ankle = places[f"lowerleg01.{letter}"], places[f"foot.{letter}"]
        # The elbow bends about the normal of upper arm and forearm, which points outward on the right.
        hinge = np.cross(elbow - shoulder, wrist - elbow)
        hinge *= np.sign(hinge @ out) or 1.0
        level = hips[letter] + 0.30 * width * UP
        foot = [v for v in used if np.linalg.norm(vertices[v] - ankle) < 0.25 and vertices[v, 1] < ankle[1]]
        forward = vertices[foot, 0]
        found |= {
            f"{side} ASIS": leaving(level + 0.14 * width * out, FORWARD),
            f"{side} PSIS": leaving(level - 0.18 * width * out, -FORWARD),
            f"{side} acromion": leaving(shoulder, UP),
            f"{side} lateral elbow": leaving(elbow, hinge),
            f"{side} medial elbow": leaving(elbow, -hinge),
            f"{side} lateral knee": leaving(knee, out),
            f"{side} medial knee": leaving(knee, -out),
            f"{side} lateral ankle": leaving(ankle, out),
            f"{side} medial ankle": leaving(ankle, -out),
            f"{side} heel": int(foot[int(np.argmin(forward))]),
            f"{side} toe tip": int(foot[int(np.argmax(forward))]),
        }
    return found


def _exit(vertices: Array, faces: np.ndarray, start: Array, direction: Array) -> Array:
    """Where a ray from inside first leaves a surface; its start where it meets nothing."""
    import igl

    hits = igl.ray_mesh_intersect(np.array(start), np.array(direction), vertices, faces.astype(np.int64))
    if not hits:
        return start
    result: Array = start + hits[0][1] * direction
    return result
