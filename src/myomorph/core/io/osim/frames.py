"""Poses of OpenSim's frames, offset frames and stations in the bodies that they are fixed to."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from lxml import etree

from myomorph.core.io.osim.document import Node, child, joined, legal, put
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import UnknownName
from myomorph.core.model.model import GROUND, Frame
from myomorph.core.model.spatial import Transform, euler_xyz_from_rotation

OFFSET_KINDS = ("PhysicalOffsetFrame", "OffsetFrame_PhysicalFrame_", "StationDefinedFrame")
STATION_KINDS = ("Station", "Marker")
AXES = {"x": 0, "y": 1, "z": 2}


class Frames:
    """All frames of a file by their component path, placed in bodies when they are asked for.

    Parameters
    ----------
    model : node of the model
    """

    def __init__(self, model: Node):
        self._document = model.document
        self._placed: dict[str, tuple[str, Transform]] = {"/ground": (GROUND, Transform.identity())}
        self._offsets: dict[str, Node] = {}
        self._stations: dict[str, Node] = {}
        self._asked: list[str] = []
        for body in model.items("BodySet"):
            if body.kind == "Body" and body.name != GROUND:
                self._placed[f"/bodyset/{body.name}"] = (body.name, Transform.identity())
        self._collect(model)

    def _collect(self, node: Node) -> None:
        """Collect the offset frames and stations inside a node by their paths, at any depth."""
        for element in node.element:
            if not isinstance(element.tag, str):
                continue
            # Most elements hold numbers alone.
            if not len(element) and node.node(element).kind not in (*OFFSET_KINDS, *STATION_KINDS):
                continue
            listed = (
                node.items(element.tag)
                if element.get("name") is None or element.find("objects") is not None
                else []
            )
            for item in listed or [node.node(element)]:
                if item.kind in OFFSET_KINDS:
                    self._offsets.setdefault(item.path, item)
                elif item.kind in STATION_KINDS:
                    self._stations.setdefault(item.path, item)
                if len(item.element):
                    self._collect(item)

    def place(self, text: str, user: Node) -> tuple[str, Transform]:
        """Find the frame that an object names.

        Parameters
        ----------
        text : path of the frame, absolute or relative to the object, or its bare name
        user : the object

        Returns
        -------
        name of the body, and the frame's pose in it

        Raises
        ------
        BadFile : the frame is its own parent
        UnknownName : there is no such frame
        """
        return self._at(self._find(text, user, {**self._placed, **self._offsets}, "frame"))

    def station(self, text: str, user: Node) -> tuple[str, Array]:
        """Find the station that an object names.

        Parameters
        ----------
        text : path of the station, absolute or relative to the object, or its bare name
        user : the object

        Returns
        -------
        name of the body, and the location (3,) in it [m]

        Raises
        ------
        UnknownName : there is no such station, or its frame does not exist
        """
        node = self._stations[self._find(text, user, self._stations, "station")]
        body, pose = self.place(node.socket("parent_frame", "body"), node)
        return body, pose.apply(node.vector("location"))

    def stations(self) -> list[tuple[str, str, Array]]:
        """List every station and marker that has a name.

        Returns
        -------
        name, body and location (3,) in the body [m] of each
        """
        named = {path: node for path, node in self._stations.items() if node.name}
        return [(node.name, *self.station(path, node)) for path, node in named.items()]

    def _find(self, text: str, user: Node, where: Mapping[str, object], kind: str) -> str:
        """Find the path that an object means by a text.

        A path that exists counts first, then a component of that name inside the object, on a body,
        and anywhere.

        Parameters
        ----------
        text : path or bare name
        user : the object
        where : components by their paths
        kind : of component, for the message

        Returns
        -------
        absolute path of the component

        Raises
        ------
        UnknownName : none has that name
        """
        path = joined(user.path, text)
        if path in where:
            return path
        name = text.rstrip("/").rsplit("/", 1)[-1]
        if self._document.version < 30500:
            name = "".join(name.split())
        named = [path for path in where if path.rsplit("/", 1)[-1] == name]
        near = [path for path in named if path.startswith(f"{user.path}/")]
        for choice in (
            near,
            [path for path in named if path.startswith(("/ground", "/bodyset/"))],
            named,
        ):
            if choice:
                return choice[0]
        names = [path.rsplit("/", 1)[-1] for path in where]
        owner = f"{user.kind} '{user.name}' of the model" if user.name else "the model"
        raise UnknownName(kind, text, existing=names, where=f"{self._document.path}: {owner}")

    def _at(self, path: str) -> tuple[str, Transform]:
        """Return body and pose of the frame at a path; `BadFile` where it is its own parent."""
        if path in self._placed:
            return self._placed[path]
        node = self._offsets[path]
        if path in self._asked:
            raise node.bad("is its own parent frame")
        self._asked.append(path)
        self._placed[path] = (
            self._from_stations(node) if node.kind == "StationDefinedFrame" else self._offset(node)
        )
        self._asked.remove(path)
        return self._placed[path]

    def _offset(self, node: Node) -> tuple[str, Transform]:
        """Return body and pose of an offset frame, by its parent and its own pose in that."""
        body, pose = self.place(node.socket("parent"), node)
        return body, pose @ node.pose("orientation", "translation")

    def _from_stations(self, node: Node) -> tuple[str, Transform]:
        """Return body and pose of a frame that four stations define.

        Its axes point along b - a, along (b - a) x (c - a), and across both; its origin is the
        fourth.

        Raises
        ------
        BadFile : the stations are on several bodies or in one line, or an axis is none
        """
        bodies, points = zip(
            *(
                self.station(node.socket(name), node)
                for name in ("point_a", "point_b", "point_c", "origin_point")
            ),
            strict=True,
        )
        if len(set(bodies)) > 1:
            raise node.bad(f"its stations are on several bodies: {', '.join(sorted(set(bodies)))}")
        a, b, c, origin = points
        normal = np.cross(b - a, c - a)
        if not normal.any():
            raise node.bad("its stations are in one line")
        first = (b - a) / np.linalg.norm(b - a)
        second = normal / np.linalg.norm(normal)
        along = self._signed_axis(node, "ab_axis", "+x")
        across = self._signed_axis(node, "ab_x_ac_axis", "+y")
        if along[0] == across[0]:
            node.document.warn(
                f"frame '{node.name}': its two axes are the same: the second is taken for the"
                " next one"
            )
            across = (along[0] + 1) % 3, 1.0
        rotation = np.zeros((3, 3))
        rotation[:, along[0]] = along[1] * first
        rotation[:, across[0]] = across[1] * second
        third = 3 - along[0] - across[0]
        rotation[:, third] = np.cross(rotation[:, (third + 1) % 3], rotation[:, (third + 2) % 3])
        return bodies[0], Transform(rotation, origin)

    @staticmethod
    def _signed_axis(node: Node, tag: str, default: str) -> tuple[int, float]:
        """Read an axis such as "-y" as its index and its sign; `BadFile` for another text."""
        text = node.text(default, tag).lower()
        if text.lstrip("+-") not in AXES:
            raise node.bad(f"'{tag}' is '{text}'", "expected one of +x, -x, +y, -y, +z, -z")
        return AXES[text.lstrip("+-")], -1.0 if text.startswith("-") else 1.0

    def all(self) -> tuple[Frame, ...]:
        """List every named offset frame but those of the joints, placed in its body.

        Returns
        -------
        the frames in the file's order; of those with one name the first
        """
        frames: dict[str, Frame] = {}
        for path, node in self._offsets.items():
            if node.name and node.name not in frames and not path.startswith("/jointset/"):
                body, pose = self._at(path)
                frames[node.name] = Frame(node.name, body, pose)
        return tuple(frames.values())


def body_path(body: str) -> str:
    """Return the component path of a body.

    Parameters
    ----------
    body : name of the body, or of the ground
    """
    return "/ground" if body == GROUND else f"/bodyset/{legal(body)}"


def is_still(pose: Transform) -> bool:
    """Return whether a pose is exactly the identity.

    Parameters
    ----------
    pose : in a body
    """
    return bool(np.array_equal(pose.rotation, np.eye(3)) and not pose.translation.any())


def write_offset_frame(
    parent: etree._Element, name: str, base: str, pose: Transform
) -> etree._Element:
    """Write a PhysicalOffsetFrame.

    Parameters
    ----------
    parent : element that gets it
    name : of the new frame
    base : component path of the frame that it is fixed to
    pose : in that frame

    Returns
    -------
    the new element
    """
    frame = child(parent, "PhysicalOffsetFrame", name=name)
    put(frame, socket_parent=base, translation=pose.translation, orientation=euler(pose.rotation))
    return frame


def euler(rotation: Array) -> Array:
    """Return the body-fixed X, Y, Z angles of a rotation, without negative zeros.

    Parameters
    ----------
    rotation : (3, 3)

    Returns
    -------
    (3,) [rad]
    """
    return euler_xyz_from_rotation(rotation) + 0.0
