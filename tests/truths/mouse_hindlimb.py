"""The anatomist's mouse hindlimb as a model.

It is `data/mouse-hindlimb-muscles`, a table of an OpenSim 4 model. The muscles are those of
Charles, Cappellari, Spence, Wells and Hutchinson (2016, J Anat 229:514). The table names bone
meshes but has none, so the bodies are drawn by their points.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import myomorph as mm
from data_collection import data_folder
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import constant, linear
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Marker
from myomorph.core.model.paths import Muscle, PathPoint, PathWrap, WrapObject
from myomorph.core.model.paths import Path as MusclePath
from myomorph.core.model.spatial import Transform

FILE = "mouse-hindlimb-muscles/mouse_hindlimb.json"
SPATIAL = ("translation1", "translation2", "translation3", "rotation1", "rotation2", "rotation3")
"""Axes of a custom joint in the order in which they act."""
CURVES = {
    "active_force_length": "ActiveForceLengthCurve",
    "force_velocity": "ForceVelocityCurve",
    "fiber_force_length": "FiberForceLengthCurve",
    "tendon_force_length": "TendonForceLengthCurve",
}
NOT_PARAMETERS = frozenset({"optimal_force"})
KINDS = {
    "WrapCylinder": ("cylinder", ("radius", "length")),
    "WrapSphere": ("sphere", ("radius",)),
}
Table = Mapping[str, Any]


def mouse_hindlimb_model(file: Path | None = None) -> mm.Model:
    """Return the right hindlimb of a mouse in its real size.

    It has six bodies, 42 muscles and 22 wrap objects.

    Parameters
    ----------
    file : the table; that of the data collection by default

    Raises
    ------
    FileNotFoundError : where the data set is absent
    """
    path = data_folder() / FILE if file is None else file
    table = json.loads(path.read_text(), parse_int=float)
    joints = _in_tree_order([_joint(one) for one in table["joints"]])
    masses = {one["name"]: one for one in table["bodies"]}
    groups = {
        name: tuple(group for group, members in table["muscle_groups"].items() if name in members)
        for name in (one["name"] for one in table["muscles"])
    }
    return mm.Model(
        table["model"]["name"],
        tuple(_body(masses[joint.child]) for joint in joints),
        joints,
        tuple(
            _coordinate(row, table)
            for joint in joints
            for row in table["coordinates"]
            if row["joint"] == joint.name
        ),
        np.array(table["model"]["gravity"], dtype=np.float64),
        tuple(
            Marker(
                name=one["name"],
                body=one["body"],
                location=one["location"],
                fixed=one.get("fixed", False),
            )
            for one in table["markers"]
        ),
        tuple(
            _muscle(one, table["muscle_curve_sets"], groups[one["name"]])
            for one in table["muscles"]
        ),
        tuple(_wrap_object(one) for one in table["wrap_objects"]),
        source=str(path),
        warnings=_odd(table),
    )


def _in_tree_order(joints: list[Joint]) -> tuple[Joint, ...]:
    placed = {"ground"}
    ordered = []
    while len(ordered) < len(joints):
        joint = next(one for one in joints if one.child not in placed and one.parent in placed)
        placed.add(joint.child)
        ordered.append(joint)
    return tuple(ordered)


def _body(row: Table) -> Body:
    xx, yy, zz, xy, xz, yz = row["inertia"]
    return Body(
        name=row["name"],
        mass=row["mass"],
        mass_center=row["mass_center"],
        inertia=np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
    )


def _joint(row: Table) -> Joint:
    axes = []
    for name in SPATIAL:
        axis = row["axes"][name]
        given = axis["function"]
        function = (
            constant(given["value"])
            if given["type"] == "Constant"
            else linear(*given["coefficients"])
        )
        kind = "rotation" if name.startswith("rotation") else "translation"
        axes.append(
            Axis(
                kind=kind,
                vector=axis["axis"],
                function=function,
                coordinates=tuple(axis["coordinates"]),
            )
        )
    return Joint(
        name=row["name"],
        kind=row["type"],
        parent=row["parent"],
        child=row["child"],
        parent_frame=Transform.from_euler_xyz(
            row["orientation_in_parent"], row["location_in_parent"]
        ),
        child_frame=Transform.from_euler_xyz(row["orientation"], row["location"]),
        axes=tuple(axes),
        coordinates=tuple(
            dict.fromkeys(name for axis in axes[3:] + axes[:3] for name in axis.coordinates)
        ),
    )


def _coordinate(row: Table, table: Table) -> Coordinate:
    joint = next(one for one in table["joints"] if one["name"] == row["joint"])
    turns = any(
        row["name"] in axis["coordinates"]
        for name, axis in joint["axes"].items()
        if name.startswith("rot")
    )
    return Coordinate(
        name=row["name"],
        motion="rotational" if turns else "translational",
        default=row["default_value"],
        range=(row["range"][0], row["range"][1]),
        clamped=row["clamped"],
        locked=row["locked"],
    )


def _wrap_object(row: Table) -> WrapObject:
    pose = Transform.from_euler_xyz(row["xyz_body_rotation"], row["translation"])
    if row["type"] == "WrapEllipsoid":
        kind = "ellipsoid"
        size = tuple(row["dimensions"])
    else:
        kind, fields = KINDS[row["type"]]
        size = tuple(row[field] for field in fields)
    quadrant = {"all": "", "x": "+x", "y": "+y", "z": "+z"}.get(row["quadrant"], row["quadrant"])
    return WrapObject(
        name=row["name"],
        body=row["body"],
        kind=kind,
        pose=pose,
        size=size,
        quadrant=quadrant,
        active=row["active"],
    )  # type: ignore[arg-type]


def _path_wrap(row: Table) -> PathWrap:
    first, last = row["range"]
    return PathWrap(wrap_object=row["wrap"], method=row["method"], first=int(first), last=int(last))


def _muscle(row: Table, curve_sets: Table, groups: tuple[str, ...]) -> Muscle:
    points = tuple(
        PathPoint(f"{row['name']}-P{i + 1}", one[1], one[2:]) for i, one in enumerate(row["points"])
    )
    wraps = tuple(map(_path_wrap, row["wraps"]))
    parameters = {
        name: float(value) for name, value in row["other"].items() if name not in NOT_PARAMETERS
    }
    for curve, values in curve_sets[row["curve_set"]].items():
        parameters |= {f"{CURVES[curve]}/{name}": float(value) for name, value in values.items()}
    return Muscle(
        name=row["name"],
        kind=row["type"],
        path=MusclePath(points, wraps),
        max_isometric_force=row["max_isometric_force"],
        optimal_fiber_length=row["optimal_fiber_length"],
        tendon_slack_length=row["tendon_slack_length"],
        pennation_at_optimal=row["pennation_angle"],
        parameters=FrozenMap(parameters),
        groups=groups,
    )


def _odd(table: Table) -> tuple[str, ...]:
    """Return what a user of the masses should know, found in the numbers themselves."""
    found = []
    for row in table["bodies"]:
        least = float(np.linalg.eigvalsh(_body(row).inertia)[0])
        if least <= 0.0:
            found.append(
                f"inertia of body '{row['name']}' is not positive definite (least {least:.2g} kg"
                " m^2)"
            )
    return tuple(found)
