"""A tape and a ruler along a standing body of `StatisticalBody`, as surveys of people use them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.body.shape.statistical_body import StatisticalBody
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.surface import edges_of

NIPPLES = (8451, 1779)
"""Vertices of the body whose mean height is that of the chest's tape."""
ARMS = ("upperarm", "lowerarm", "wrist", "finger", "metacarpal")
_RIGHT = np.array([0.0, 0.0, 1.0])
_UP = np.array([0.0, 1.0, 0.0])


class Site(NamedTuple):
    """Where a tape lies around a limb, across the line between two joints.

    Attributes
    ----------
    bones : what names of the skin's bones begin with
    start, end : bones of the rig whose beginnings are the ends of the limb
    share : of the way from start to end
    """

    bones: tuple[str, ...]
    start: str
    end: str
    share: float


GIRTHS: Mapping[str, Site] = {
    "neck": Site(bones=("neck", "head", "jaw"), start="neck01", end="head", share=0.5),
    "upper arm": Site(bones=("upperarm",), start="upperarm01.R", end="lowerarm01.R", share=0.5),
    "forearm": Site(
        bones=("upperarm", "lowerarm"), start="lowerarm01.R", end="wrist.R", share=0.22
    ),
    "wrist": Site(bones=("lowerarm", "wrist"), start="lowerarm01.R", end="wrist.R", share=0.95),
    "thigh": Site(bones=("upperleg",), start="upperleg01.R", end="lowerleg01.R", share=0.27),
    "knee": Site(
        bones=("upperleg", "lowerleg"), start="upperleg01.R", end="lowerleg01.R", share=0.88
    ),
    "calf": Site(bones=("lowerleg",), start="lowerleg01.R", end="foot.R", share=0.32),
    "ankle": Site(bones=("lowerleg",), start="lowerleg01.R", end="foot.R", share=0.85),
}
"""Circumferences of limbs: at the middle of the upper arm, below the seat, above the knee cap, at
the widest forearm and calf, and at the narrowest wrist and ankle.
"""


TRUNK = ("chest", "waist", "hips")


class Level(NamedTuple):
    """A plane that a tape lies in.

    Attributes
    ----------
    origin : (3,) [m]
    axes : (3, 3) rows; the second is across the plane
    height : along the second axis from the origin [m]
    """

    origin: Array
    axes: Array
    height: float


class Tape:
    """What a survey of people measures, on the vertices of one statistical body.

    Parameters
    ----------
    body : whose vertices they are
    levels : heights of tapes around the trunk above the sole, "waist" and "hips" [m]; limbs are
        measured where they are given
    """

    def __init__(self, body: StatisticalBody, levels: Mapping[str, float] | None = None):
        self._body = body
        self._levels = levels
        self._number = {bone: i for i, bone in enumerate(body.bones)}
        self._used = np.unique(body.faces)
        self.names = ("chest",) if levels is None else (*TRUNK, *GIRTHS)

    @cached_property
    def _edges(self) -> dict[str, np.ndarray]:
        """(edges, 2) around each tape, one for two faces; of paired limbs on the right."""
        trunk = self._between(self._share(ARMS) <= 0.5)
        result = dict.fromkeys(TRUNK, trunk)
        for name, site in GIRTHS.items():
            side = ".R" if site.start.endswith(".R") else ""
            result[name] = self._between(self._share(site.bones, side) > 0.5)
        return result

    def _between(self, chosen: np.ndarray) -> np.ndarray:
        """Collect edges of faces whose corners all are chosen ones, one for two faces."""
        edges = edges_of(self._body.faces[chosen[self._body.faces].all(axis=1)])
        return edges[edges[:, 0] < edges[:, 1]]

    def _share(self, starts: tuple[str, ...], side: str = "") -> Array:
        """Sum the shares (vertices,) of the bones whose names start so."""
        columns = [
            i
            for i, bone in enumerate(self._body.bones)
            if bone.startswith(starts) and bone.endswith(side)
        ]
        return np.asarray(self._body.skinning[:, columns].sum(axis=1)).ravel()

    def read(
        self, vertices: Array, heads: Array, sections: Mapping[str, np.ndarray] | None = None
    ) -> dict[str, float]:
        """Measure around the trunk and limbs, and along limbs.

        Parameters
        ----------
        vertices : (vertices, 3) standing [m]
        heads : (bones, 3) where bones begin [m]
        sections : edges under each tape, of a body that hardly differs; by default found

        Returns
        -------
        by name [m]: "height", those of `names`, and where limbs are measured "hip height", "knee
        height" and "ankle height" above the sole, "upper arm length" and "forearm length" between
        joint centers
        """
        under = self.sections(vertices, heads) if sections is None else sections
        result = {
            name: _length(vertices, under[name], self._level(name, vertices, heads))
            for name in self.names
        }
        heights = vertices[self._used, 1]
        floor = float(heights.min())
        result["height"] = float(heights.max()) - floor
        if self._levels is None:
            return result
        for name, bone in (("hip", "upperleg01"), ("knee", "lowerleg01"), ("ankle", "foot")):
            result[f"{name} height"] = float(heads[self._number[f"{bone}.R"], 1]) - floor
        arm = [heads[self._number[f"{bone}.R"]] for bone in ("upperarm01", "lowerarm01", "wrist")]
        result["upper arm length"] = float(np.linalg.norm(arm[1] - arm[0]))
        result["forearm length"] = float(np.linalg.norm(arm[2] - arm[1]))
        return result

    def sections(self, vertices: Array, heads: Array) -> dict[str, np.ndarray]:
        """Find the edges (edges, 2) that a tape touches, by its name, in its order.

        Parameters
        ----------
        vertices, heads : as in `read` [m]

        Returns
        -------
        (edges, 2) by name
        """
        return {
            name: _touched(vertices, self._edges[name], self._level(name, vertices, heads))
            for name in self.names
        }

    def _level(self, name: str, vertices: Array, heads: Array) -> Level:
        """Find the plane of a tape [m]."""
        if name in TRUNK:
            if name == "chest":
                height = float(vertices[list(NIPPLES), 1].mean())
            else:
                height = float(vertices[self._used, 1].min()) + (self._levels or {})[name]
            return Level(origin=np.zeros(3), axes=np.eye(3), height=height)
        site = GIRTHS[name]
        start = heads[self._number[site.start]]
        along = heads[self._number[site.end]] - start
        direction = along / np.linalg.norm(along)
        side = np.cross(direction, _RIGHT if abs(direction @ _RIGHT) < 0.9 else _UP)
        side /= np.linalg.norm(side)
        axes = np.stack([side, direction, np.cross(side, direction)])
        return Level(origin=start, axes=axes, height=site.share * float(np.linalg.norm(along)))


def circumference(vertices: Array, edges: np.ndarray, height: float) -> float:
    """Compute the length of a tape around a surface: the convex hull of its section.

    Parameters
    ----------
    vertices : (vertices, 3) [m]
    edges : (edges, 2)
    height : of the section, y [m]

    Returns
    -------
    length [m]

    Raises
    ------
    BadData : fewer than three edges cross that height
    """
    level = Level(origin=np.zeros(3), axes=np.eye(3), height=height)
    return _length(vertices, _touched(vertices, edges, level), level)


def _touched(vertices: Array, edges: np.ndarray, level: Level) -> np.ndarray:
    """Find the edges (touched, 2) on the convex hull of a section, around it.

    Parameters
    ----------
    vertices : (vertices, 3) [m]
    edges : (edges, 2)

    Raises
    ------
    BadData : fewer than three edges cross the plane
    """
    above = (vertices - level.origin) @ level.axes[1] > level.height
    cut = edges[above[edges[:, 0]] != above[edges[:, 1]]]
    if len(cut) < 3:
        raise BadData(f"nothing to measure around at a height of {level.height:.4g} m")
    return np.asarray(cut[scipy.spatial.ConvexHull(_points(vertices, cut, level)).vertices])


def _points(vertices: Array, edges: np.ndarray, level: Level) -> Array:
    """Cut edges with a plane: points (edges, 2) in it [m]."""
    a = (vertices[edges[:, 0]] - level.origin) @ level.axes.T
    b = (vertices[edges[:, 1]] - level.origin) @ level.axes.T
    share = (level.height - a[:, 1]) / (b[:, 1] - a[:, 1])
    return np.asarray((a + share[:, None] * (b - a))[:, [0, 2]])


def _length(vertices: Array, edges: np.ndarray, level: Level) -> float:
    """Sum the distances around a section through edges in their order [m]."""
    points = _points(vertices, edges, level)
    return float(np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).sum())
