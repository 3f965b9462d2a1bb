"""OpenSim's ConstraintSet: couplers, loops, and the constraints that are kept but not modelled."""

from __future__ import annotations

from myomorph.io.osim.document import Node
from myomorph.io.osim.frames import Frames
from myomorph.io.osim.functions import read_function
from myomorph.io.osim.kept import keep
from myomorph.model.errors import UnknownName
from myomorph.model.model import Coupler, Kept, Loop
from myomorph.model.spatial import Transform


def read_constraints(
    model: Node, frames: Frames, coordinates: tuple[str, ...]
) -> tuple[tuple[Coupler, ...], tuple[Loop, ...], tuple[Kept, ...]]:
    """Couplers, loops and the rest; a constraint that is not enforced is only kept."""
    couplers, loops, kept = [], [], []
    for node in model.items("ConstraintSet"):
        if not node.flag("isEnforced", not node.flag("isDisabled", False)):
            kept.append(keep(node, "ConstraintSet", "switched off in the file"))
        elif node.kind == "CoordinateCouplerConstraint":
            couplers.append(_coupler(node, coordinates))
        elif node.kind in ("PointConstraint", "WeldConstraint"):
            loops.append(_loop(node, frames))
        else:
            kept.append(keep(node, "ConstraintSet", "the motion it forbids is allowed"))
    return tuple(couplers), tuple(loops), tuple(kept)


def _coupler(node: Node, coordinates: tuple[str, ...]) -> Coupler:
    function = node.inner("coupled_coordinates_function")
    if function is None:
        raise node.bad("has no coupled_coordinates_function")
    names = node.words("independent_coordinate_names")
    dependent = node.text("", "dependent_coordinate_name")
    for name in (*names, dependent):
        if name not in coordinates:
            raise UnknownName(
                "coordinate", name, coordinates, f"{node.document.path}: coupler '{node.name}': the model"
            )
    factor = node.number("scale_factor", 1.0)
    return Coupler(node.name, dependent, read_function(function, node).scaled(factor), tuple(names))


def _loop(node: Node, frames: Frames) -> Loop:
    if node.kind == "PointConstraint":
        ends = []
        for i in "12":
            body, _ = frames.place(node.socket(f"body_{i}"), node)
            ends.append((body, Transform.from_euler_xyz((0, 0, 0), node.vector(f"location_body_{i}", (0.0, 0.0, 0.0)))))
    else:
        ends = [tied_frame(node, frames, i) for i in "12"]
    (body_1, pose_1), (body_2, pose_2) = ends
    return Loop(node.name, node.kind, body_1, body_2, pose_1, pose_2)


def tied_frame(node: Node, frames: Frames, i: str) -> tuple[str, Transform]:
    """Body and pose of the first ("1") or second ("2") frame of what links two, in any version's layout."""
    text = node.socket(f"frame{i}", f"body_{i}")
    body, pose = frames.place(text, node)
    place = node.vector(f"location_body_{i}", (0.0, 0.0, 0.0))
    turn = node.vector(f"orientation_body_{i}", (0.0, 0.0, 0.0))
    return body, pose @ Transform.from_euler_xyz(turn, place)
