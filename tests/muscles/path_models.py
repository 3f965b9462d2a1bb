"""Small models made by OpenSim: two free points, and every kind of surface between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

QUADRANTS = ("all", "+x", "-x", "+y", "-y", "+z", "-z")
SIZES = {
    "cylinder": (0.12, 0.5),
    "sphere": (0.12,),
    "ellipsoid": (0.08, 0.12, 0.16),
    "torus": (0.05, 0.15),
}


@dataclass(frozen=True)
class Surface:
    """A surface fixed to the ground."""

    kind: str
    quadrant: str = "all"
    method: str = "hybrid"
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    active: bool = True
    range: tuple[int, int] = (-1, -1)


@dataclass(frozen=True)
class Way:
    """A path from point a to point b, through points of the ground, past surfaces."""

    name: str
    surfaces: tuple[Surface, ...]
    via: tuple[tuple[float, float, float], ...] = field(default=())


def opensim_model(opensim, ways: tuple[Way, ...], folder: Path):
    """Make an OpenSim model with a muscle for each path, its state and its file."""
    opensim.Logger.setLevelString("Error")
    model = opensim.Model()
    bodies = []
    for name in "ab":
        body = opensim.Body(name, 1.0, opensim.Vec3(0), opensim.Inertia(1, 1, 1))
        joint = opensim.FreeJoint(f"{name}_joint", model.getGround(), body)
        for i in range(6):
            joint.upd_coordinates(i).setName(f"{name}{'ABCxyz'[i]}")
            joint.upd_coordinates(i).setRangeMin(-3.0)
            joint.upd_coordinates(i).setRangeMax(3.0)
        model.addBody(body)
        model.addJoint(joint)
        bodies.append(body)
    for way in ways:
        muscle = opensim.Thelen2003Muscle(way.name, 100.0, 0.1, 0.2, 0.0)
        muscle.addNewPathPoint("start", bodies[0], opensim.Vec3(0))
        for k, place in enumerate(way.via):
            muscle.addNewPathPoint(f"via_{k}", model.getGround(), opensim.Vec3(*place))
        muscle.addNewPathPoint("end", bodies[1], opensim.Vec3(0))
        for k, surface in enumerate(way.surfaces):
            wrap = _wrap(opensim, surface, f"{way.name}_{k}")
            model.updGround().addWrapObject(wrap)
            muscle.updGeometryPath().addPathWrap(wrap)
            used = muscle.updGeometryPath().updWrapSet().get(k)
            used.setMethod({"hybrid": 0, "midpoint": 1, "axial": 2}[surface.method])
        model.addForce(muscle)
    path = folder / "paths.osim"
    model.finalizeConnections()
    model.printToXML(str(path))
    document = ElementTree.parse(path)
    ranges = {way.name: [surface.range for surface in way.surfaces] for way in ways}
    for muscle in document.iter("Thelen2003Muscle"):
        for used, (first, last) in zip(
            muscle.iter("PathWrap"), ranges.get(muscle.get("name", ""), ()), strict=False
        ):
            for old in used.findall("range"):
                used.remove(old)
            ElementTree.SubElement(used, "range").text = f"{first} {last}"
    document.write(path)
    model = opensim.Model(str(path))
    return model, model.initSystem(), path


def _wrap(opensim, surface: Surface, name: str):
    kinds = {
        "cylinder": opensim.WrapCylinder,
        "sphere": opensim.WrapSphere,
        "ellipsoid": opensim.WrapEllipsoid,
        "torus": opensim.WrapTorus,
    }
    wrap = kinds[surface.kind]()
    wrap.setName(name)
    size = SIZES[surface.kind]
    if surface.kind == "cylinder":
        wrap.set_radius(size[0])
        wrap.set_length(size[1])
    elif surface.kind == "sphere":
        wrap.set_radius(size[0])
    elif surface.kind == "ellipsoid":
        wrap.set_dimensions(opensim.Vec3(*size))
    else:
        wrap.set_inner_radius(size[0])
        wrap.set_outer_radius(size[1])
    wrap.set_quadrant(surface.quadrant)
    wrap.set_translation(opensim.Vec3(*surface.place))
    wrap.set_xyz_body_rotation(opensim.Vec3(*surface.turn))
    wrap.set_active(surface.active)
    return wrap


def opensim_lengths(model, state, names, coordinates, values):
    """Return OpenSim's lengths (frames, muscles) at values (frames, coordinates)."""
    paths = _paths(model, names)
    return np.array(
        [
            [path.getLength(state) for path in paths]
            for _ in _posed(model, state, coordinates, values)
        ]
    )


def opensim_moment_arms(model, state, names, coordinates, values):
    """Return OpenSim's moment arms (frames, muscles, coordinates)."""
    paths = _paths(model, names)
    axes = _axes(model, coordinates)
    return np.array(
        [
            [[path.computeMomentArm(state, axis) for axis in axes] for path in paths]
            for _ in _posed(model, state, coordinates, values)
        ]
    )


def _paths(model, names):
    return [model.getMuscles().get(name).getGeometryPath() for name in names]


def _axes(model, coordinates):
    return [model.getCoordinateSet().get(name) for name in coordinates]


def _posed(model, state, coordinates, values):
    """Put the state into each pose in turn, and yield it."""
    axes = _axes(model, coordinates)
    for row in values:
        for axis, value in zip(axes, row, strict=True):
            axis.setValue(state, float(value), False)
        model.realizePosition(state)
        yield state
