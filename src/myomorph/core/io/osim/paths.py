"""OpenSim's paths of points and wraps, of muscles and of ligaments, read and written."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from lxml import etree

from myomorph.core.io.osim.document import Node, child, legal, number, put
from myomorph.core.io.osim.frames import Frames, body_path
from myomorph.core.io.osim.functions import read_function, write_function
from myomorph.core.io.osim.joints import plain_name
from myomorph.core.io.osim.path_functions import KIND as FUNCTION_KIND
from myomorph.core.io.osim.path_functions import read_path_function, write_path_function
from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import BadModel, UnknownName, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import Function, constant
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Kept
from myomorph.core.model.paths import Ligament, MovingPathPoint, Path, PathPoint, PathWrap
from myomorph.core.model.spatial import Transform

SLACK: Mapping[str, str] = FrozenMap(
    {
        "Ligament": "resting_length",
        "Blankevoort1991Ligament": "slack_length",
        "PathSpring": "resting_length",
    }
)
"""The length at which each class begins to pull, by the file's name."""


class PathReader:
    """Reader of paths of points and wraps, once what they may refer to is known.

    Parameters
    ----------
    frames : of the model
    coordinates : names of its coordinates
    wraps : the model's wrap object that each name in a path means
    """

    def __init__(self, frames: Frames, coordinates: tuple[str, ...], wraps: dict[str, str]):
        self._frames = frames
        self._coordinates = coordinates
        self._wraps = wraps

    def read(self, node: Node) -> Path:
        """Read the path of a muscle, of a path actuator or of another object that has one.

        Parameters
        ----------
        node : the object

        Returns
        -------
        points in their bodies [m] and wraps, or a function of coordinates

        Raises
        ------
        BadFile : it has fewer than two points, a wrap's method is none, or a function is broken
        BadModel : a point or the path is of a class that is not supported
        UnknownName : it names a frame, coordinate or wrap object that does not exist
        """
        path = node.child("GeometryPath")
        function = node.child(FUNCTION_KIND)
        if path is None and function is not None:
            return Path((), function=read_path_function(function, node, self._coordinates))
        if path is None:
            other = next(
                (str(element.tag) for element in node.element if str(element.tag).endswith("Path")),
                "",
            )
            if other:
                raise BadModel(
                    f"{node.document.path}: {node.kind} '{node.name}' has a {other}, which is not"
                    " built"
                )
            path = node
        points = [
            self._point(item) for item in path.items("PathPointSet") or path.items("MusclePointSet")
        ]
        if len(points) < 2:
            raise node.bad(f"its path has {len(points)} points", "expected two or more")
        wraps = [
            self._wrap(item, len(points))
            for item in path.items("PathWrapSet") or path.items("MuscleWrapSet")
        ]
        return Path(tuple(points), tuple(wraps))

    def _point(self, node: Node) -> PathPoint | MovingPathPoint:
        """Read a point, located (3,) in its body [m], and the range [rad or m] it exists in."""
        body, pose = self._frames.place(node.socket("parent_frame", "body"), node)
        if node.kind == "MovingPathPoint":
            return self._moving(node, body, pose)
        place = pose.apply(node.vector("location"))
        if node.kind == "PathPoint":
            return PathPoint(node.name, body, place)
        if node.kind != "ConditionalPathPoint":
            raise BadModel(
                f"{node.document.path}: path point '{node.name}' is a {node.kind}, which is not"
                " built"
            )
        low, high = node.vector("range", (0.0, 0.0), infinite=True)
        coordinate = self._coordinate(node.socket("coordinate", "coordinate", "coordinates"), node)
        return PathPoint(
            name=node.name,
            body=body,
            location=place,
            coordinate=coordinate,
            range=(float(low), float(high)),
        )

    def _moving(self, node: Node, body: str, pose: Transform) -> MovingPathPoint:
        """Read a point that moves along the axes of its body by functions of coordinates.

        Parameters
        ----------
        node : the point
        body : name of the body
        pose : of the frame that the point is given in, in the body; it must not be rotated
        """
        if not np.array_equal(pose.rotation, np.eye(3)):
            raise BadModel(
                f"{node.document.path}: moving path point '{node.name}' is in a rotated frame,"
                " which is not supported"
            )
        functions: list[Function] = []
        coordinates: list[str] = []
        for axis, offset in zip("xyz", pose.translation, strict=True):
            inner = node.inner(f"{axis}_location")
            function = constant(0.0) if inner is None else read_function(inner, node)
            name = node.socket(f"{axis}_coordinate")
            if function.arity and not name:
                raise node.bad(f"its {axis}_location depends on a coordinate, but names none")
            functions.append(function.raised(float(offset)))
            coordinates.append(self._coordinate(name, node) if function.arity else "")
        x, y, z = functions
        x_name, y_name, z_name = coordinates
        return MovingPathPoint(
            name=node.name,
            body=body,
            functions=(x, y, z),
            coordinates=(x_name, y_name, z_name),
        )

    def _coordinate(self, text: str, node: Node) -> str:
        """Return the coordinate that a text means; `UnknownName` where there is none."""
        name = plain_name(text)
        if name not in self._coordinates:
            raise UnknownName(
                "coordinate",
                name,
                existing=self._coordinates,
                where=f"{node.document.path}: '{node.name}': the model",
            )
        return name

    def _wrap(self, node: Node, points: int) -> PathWrap:
        """Read which wrap object a path goes around, and between which of its points."""
        name = node.text("", "wrap_object")
        check_name("wrap object", name, self._wraps, f"{node.document.path}: the model")
        first, last = map(int, node.vector("range", (-1.0, -1.0)))
        method = node.text("hybrid", "method").lower()
        if method not in ("hybrid", "midpoint", "axial", "unassigned", ""):
            raise node.bad(f"its method is '{method}'", "expected hybrid, midpoint or axial")
        return PathWrap(
            wrap_object=self._wraps[name],
            method="hybrid" if method in ("unassigned", "") else method,
            first=first,
            last=last,
        )


def write_path(
    element: etree._Element, owner: str, way: Path, joints: dict[str, str], warnings: list[Message]
) -> etree._Element:
    """Write the path of a muscle or ligament.

    Parameters
    ----------
    element : gets the path
    owner : name of the muscle or ligament, which names points without a name
    way : the path
    joints : component name of the joint of each coordinate
    warnings : gets a line where wraps or pulleys cannot be written

    Returns
    -------
    the path's element
    """
    if way.function is not None:
        return write_path_function(element, owner, way.function, joints, warnings)
    path = child(element, "GeometryPath", name="path")
    points = child(child(path, "PathPointSet"), "objects")
    for i, point in enumerate(way.points):
        _write_point(points, point, point.name or f"{owner}-P{i + 1}", joints, warnings)
    wraps = child(child(path, "PathWrapSet"), "objects")
    if any(not isinstance(wrap, PathWrap) for wrap in way.wraps):
        warnings.append(
            MODEL.message(
                "wraps of MuJoCo tendons cannot be written: their muscles run straight between"
                " points",
                severity="may change results",
            )
        )
    if any(divisor != 1.0 for divisor in way.divisors):
        warnings.append(
            MODEL.message(
                "pulleys of MuJoCo tendons cannot be written: their muscles' lengths will differ",
                severity="may change results",
            )
        )
    names: set[str] = set()
    for wrap in way.wraps:
        if isinstance(wrap, PathWrap):
            written = child(wraps, "PathWrap", name=f"{legal(wrap.wrap_object)}_{len(names)}")
            names.add(wrap.wrap_object + str(len(names)))
            put(
                written,
                wrap_object=legal(wrap.wrap_object),
                method=wrap.method,
                range=f"{wrap.first} {wrap.last}",
            )
    return path


def _write_point(
    parent: etree._Element,
    point: PathPoint | MovingPathPoint,
    name: str,
    joints: dict[str, str],
    warnings: list[Message],
) -> None:
    """Write a point, with the coordinate that moves it or switches it on."""
    if isinstance(point, MovingPathPoint):
        element = child(parent, "MovingPathPoint", name=name)
        put(element, socket_parent_frame=body_path(point.body))
        # OpenSim wants a coordinate for a constant function too.
        some = next((coordinate for coordinate in point.coordinates if coordinate), "")
        for axis, function, coordinate in zip(
            "xyz", point.functions, point.coordinates, strict=True
        ):
            chosen = coordinate or some
            if chosen:
                put(
                    element,
                    **{f"socket_{axis}_coordinate": f"/jointset/{joints[chosen]}/{legal(chosen)}"},
                )
            write_function(
                child(element, f"{axis}_location"),
                function,
                f"path point '{name}' {axis}",
                warnings,
            )
        return
    element = child(parent, "ConditionalPathPoint" if point.coordinate else "PathPoint", name=name)
    put(element, socket_parent_frame=body_path(point.body), location=point.location)
    if point.coordinate:
        coordinate = f"/jointset/{joints[point.coordinate]}/{legal(point.coordinate)}"
        put(element, socket_coordinate=coordinate, range=point.range)


def read_ligaments(forces: Iterable[Node], paths: PathReader) -> tuple[Ligament, ...]:
    """Read the ligaments among forces that are stored as the file has them.

    Parameters
    ----------
    forces : nodes
    paths : reads their paths

    Returns
    -------
    ligaments with slack lengths [m], NaN where the file has none
    """
    ligaments = [
        force for force in forces if force.kind in SLACK and force.child("GeometryPath") is not None
    ]
    return tuple(
        Ligament(
            name=force.name,
            kind=force.kind,
            path=paths.read(force),
            slack_length=force.number(SLACK[force.kind], float("nan")),
        )
        for force in ligaments
    )


def put_ligament(
    part: Kept, element: etree._Element, ligaments: Iterable[Ligament], joints: dict[str, str]
) -> None:
    """Give a stored part, about to be written, path and slack length of the model's ligament.

    Parameters
    ----------
    part : stored part, which names the ligament
    element : of the part, changed in place
    ligaments : of the model; without one of that name nothing changes
    joints : component name of the joint of each coordinate
    """
    ligament = next(
        (other for other in ligaments if (other.kind, other.name) == (part.kind, part.name)), None
    )
    if ligament is None:
        return
    before = element.find("GeometryPath")
    if before is not None:
        after = write_path(element, ligament.name, ligament.path, joints, [])
        look = before.find("Appearance")
        if look is not None:
            after.append(look)
        element.replace(before, after)
    if ligament.slack_length == ligament.slack_length:
        tag = SLACK[ligament.kind]
        slack = element.find(tag)
        slack = child(element, tag) if slack is None else slack
        slack.text = number(ligament.slack_length)
