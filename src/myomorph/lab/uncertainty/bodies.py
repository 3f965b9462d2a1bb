"""A model drawn around the given one: masses, joints, markers, muscle paths and muscles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from myomorph.core.model.arrays import Array, changed, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.latest import Latest
from myomorph.core.model.model import Body, Joint, Marker, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint, WrapObject
from myomorph.core.model.spatial import Transform, axis_rotation, rotation_from_euler_xyz
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.muscles.hill import compile_hill_as
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.muscles.model_paths import compile_paths_as
from myomorph.core.muscles.patella import PATELLA
from myomorph.core.muscles.patella_distance import patella_directions
from myomorph.core.rigid.knees import flexed, hinge_axis, knee_joints, long_axis
from myomorph.core.rigid.tree import compile_tree, compile_tree_as
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import NOTHING, ErrorSizes, Sources


@dataclass(frozen=True)
class Draw:
    """One draw of the sources of error.

    Attributes
    ----------
    normals : random numbers of all draws
    number : which of the draws
    sources : those that are not drawn have size 0
    found : sizes of single items that earlier steps found
    """

    number: int
    sources: Sources
    normals: Normals
    found: ErrorSizes = NOTHING

    def of(self, source: str, name: str, size: int = 1, item: str = "") -> Array:
        """Draw errors of a source, constant over the recording.

        Parameters
        ----------
        source : of error, a field of `Sources`
        name : whose random numbers they are
        size : how many
        item : by which sizes are found, where it is not the name

        Returns
        -------
        (size,) in the source's own unit
        """
        scale = getattr(self.sources, source)
        if not scale:
            return np.zeros(size)
        item_size = self.found.of(source, item or name)
        if item_size is not None:
            scale = item_size.size
            name = item_size.shared or name
        return np.asarray(scale * self.normals.of(self.number, source, name, size))

    def factor(self, source: str, name: str) -> float:
        """Draw a positive factor around 1 whose logarithm has the source's size."""
        return float(np.exp(self.of(source, name)[0]))


def drawn_model(model: Model, draw: Draw) -> Model:
    """Draw the model with errors of its own in all that it says of the body."""
    has = draw.sources
    parts = dict[str, Any]()
    if has.body_mass or has.segment_mass or has.mass_center or has.inertia:
        parts["bodies"] = _bodies(model, draw)
    if has.joint_center or has.joint_axis:
        parts["joints"] = _joints(model, draw)
    if has.placement:
        parts["markers"] = _markers(model, draw)
    if has.leg_alignment:
        parts |= _bowed(model, parts, draw)
    if has_drawn_paths(has) or has.strength or has.fiber_length or has.slack_length:
        parts["muscles"] = _muscles(model, draw)
    if has.wrap_radius:
        parts["wrap_objects"] = _surfaces(model, draw)
    return replace(model, **parts) if parts else model


def _joints(model: Model, draw: Draw) -> tuple[Joint, ...]:
    """Draw all joints but those of bodies that float in the laboratory: no joint holds these."""
    floating = set(floating_coordinates(model))
    return tuple(
        joint if floating.intersection(joint.coordinates) else _joint(joint, draw)
        for joint in model.joints
    )


def _markers(model: Model, draw: Draw) -> tuple[Marker, ...]:
    return tuple(
        replace(marker, location=marker.location + draw.of("placement", marker.name, 3))
        for marker in model.markers
    )


def _muscles(model: Model, draw: Draw) -> tuple[Muscle, ...]:
    moves = drawn_patellae(model, draw)
    return tuple(_muscle(muscle, moves, draw) for muscle in model.muscles)


def _surfaces(model: Model, draw: Draw) -> tuple[WrapObject, ...]:
    return tuple(_surface(item, draw) for item in model.wrap_objects)


def drawn_subject(model: Model, draw: Draw) -> Model:
    """Draw a model whose tendons are fitted to its paths and fibers, and compile it as the first.

    The model's author chose slack lengths so that fibers are as long in the default pose as they
    should be. A path with a point elsewhere, or another fiber, would have got another tendon; with
    the old one it would stretch fibers to where they tear. The source `slack_length` says how far
    off the fit itself is.

    Parameters
    ----------
    model : without errors
    draw : which errors

    Returns
    -------
    a model with other masses [kg], joints [m], [rad], marker positions [m], paths [m] and muscles

    Raises
    ------
    BadModel : the drawn model cannot be compiled

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> draw = mm.uncertainty.Draw(0, mm.uncertainty.Sources(), mm.uncertainty.Normals(10))
    >>> drawn = mm.uncertainty.drawn_subject(model, draw)
    >>> 3.5 < drawn.mass < 4.5, drawn.mass == model.mass
    (True, False)
    """
    made = drawn_model(model, draw)
    if made is model:
        return model
    # Nothing else differs: to compile it all anew would take most of the time of a draw.
    compile_tree_as(made, model)
    if not model.muscles:
        return made
    compile_paths_as(made, model)
    has = draw.sources
    if has_drawn_paths(has) or has.wrap_radius or has.fiber_length:
        made = _with_fitted_tendons(made, model)
        compile_tree_as(made, model)
        compile_paths_as(made, model)
    compile_hill_as(made, model)
    return made


def _with_fitted_tendons(made: Model, model: Model) -> Model:
    """Fit slack lengths to the fibers of the model without errors.

    Normalized fiber lengths in the default pose become those of that model.
    """
    muscles = []
    for muscle, old, length, before in zip(
        made.muscles, model.muscles, default_path_lengths(made), _lengths(model), strict=True
    ):
        stretched = max(float(before) - old.tendon_slack_length, 0.0)
        more = (
            float(length - before)
            - (muscle.optimal_fiber_length / old.optimal_fiber_length - 1.0) * stretched
        )
        least = 0.5 * old.tendon_slack_length
        muscles.append(
            changed(muscle, tendon_slack_length=max(muscle.tendon_slack_length + more, least))
        )
    return replace(made, muscles=tuple(muscles))


_lengths = Latest(default_path_lengths)


def stronger(model: Model, factor: float) -> Model:
    """Make all muscles stronger, and compile the model as the first."""
    muscles = (
        changed(muscle, max_isometric_force=factor * muscle.max_isometric_force)
        for muscle in model.muscles
    )
    made = replace(model, muscles=tuple(muscles))
    compile_tree_as(made, model)
    compile_paths_as(made, model)
    compile_hill_as(made, model)
    return made


def _bodies(model: Model, draw: Draw) -> tuple[Body, ...]:
    """Bodies whose masses sum up to the same, but for the error of the whole."""
    masses = {
        body.name: body.mass * draw.factor("segment_mass", body.name) for body in model.bodies
    }
    whole = sum(masses.values())
    scale = draw.factor("body_mass", "body") * (model.mass / whole if whole > 0.0 else 1.0)
    return tuple(_body(body, scale * masses[body.name], draw) for body in model.bodies)


def _body(body: Body, mass: float, draw: Draw) -> Body:
    if not body.mass > 0.0:
        return body
    radius = np.sqrt(max(float(np.trace(body.inertia)), 0.0) / (2.0 * body.mass))
    center = body.mass_center + radius * draw.of("mass_center", body.name, 3)
    inertia = body.inertia * (mass / body.mass) * draw.factor("inertia", body.name)
    return replace(body, mass=mass, mass_center=center, inertia=inertia)


def _joint(joint: Joint, draw: Draw) -> Joint:
    """Move the center and the axes of a joint, and leave the default pose as it was."""
    if not joint.coordinates:
        return joint
    off = Transform(
        rotation_from_euler_xyz(draw.of("joint_axis", joint.name, 3)),
        draw.of("joint_center", joint.name, 3),
    )
    return replace(
        joint, parent_frame=joint.parent_frame @ off, child_frame=joint.child_frame @ off
    )


def _bowed(model: Model, parts: Mapping[str, Any], draw: Draw) -> dict[str, Any]:
    """Joints and markers of a model whose legs are bowed otherwise."""
    joints = parts.get("joints", model.joints)
    markers = parts.get("markers", model.markers)
    for name, leg in legs_of(model).items():
        angle = float(draw.of("leg_alignment", name)[0])
        joints = tuple(
            bowed_knee(joint, leg, angle) if joint.name == name else joint for joint in joints
        )
        markers = tuple(beside_bowed_bones(marker, leg, angle) for marker in markers)
    return {"joints": joints, "markers": markers}


def has_drawn_paths(sources: Sources) -> bool:
    """Whether points of muscle paths are drawn."""
    return bool(sources.attachment or sources.patella or sources.patella_distance)


def drawn_patellae(model: Model, draw: Draw) -> Mapping[str, Array]:
    """Draw how far patellae lie elsewhere: each by itself, and both farther out or nearer.

    Parameters
    ----------
    model : with the patellae
    draw : which errors

    Returns
    -------
    by body, (3,) in its axes [m]
    """
    ways = patella_directions(model) if draw.sources.patella_distance else FrozenMap({})
    patellae = [body.name for body in model.bodies if PATELLA in body.name.lower()]
    moves = {body: draw.of("patella", body, 3) for body in patellae}
    for body, way in ways.items():
        moves[body] = moves[body] + draw.of("patella_distance", "patellae", 1, body)[0] * way
    return FrozenMap(moves)


def _muscle(muscle: Muscle, moves: Mapping[str, Array], draw: Draw) -> Muscle:
    """Draw a muscle with errors of its own; `moves` as of `drawn_patellae`."""
    name = muscle.name
    slack = muscle.tendon_slack_length + muscle.optimal_fiber_length * float(
        draw.of("slack_length", name)[0]
    )
    return changed(
        muscle,
        path=_path(muscle.path, name, moves, draw),
        max_isometric_force=muscle.max_isometric_force * draw.factor("strength", name),
        optimal_fiber_length=muscle.optimal_fiber_length * draw.factor("fiber_length", name),
        tendon_slack_length=max(slack, 0.5 * muscle.tendon_slack_length),
    )


def _path(path: Path, muscle: str, moves: Mapping[str, Array], draw: Draw) -> Path:
    """Draw a path through other points; those that coordinates move stay."""

    def moved(index: int, point: PathPoint) -> PathPoint:
        error = draw.of("attachment", f"{muscle} {index}", 3, f"{muscle}/{point.name}")
        if point.body in moves:
            error = error + moves[point.body]
        return changed(point, location=point.location + error)

    points = (
        moved(k, point) if isinstance(point, PathPoint) else point
        for k, point in enumerate(path.points)
    )
    return changed(path, points=tuple(points))


def _surface(surface: WrapObject, draw: Draw) -> WrapObject:
    factor = draw.factor("wrap_radius", surface.name)
    sizes = surface.size
    if surface.kind == "cylinder":
        return replace(surface, size=(factor * sizes[0], *sizes[1:]))
    return replace(surface, size=tuple(factor * size for size in sizes))


@read_only
class Leg:
    """A leg that is bowed about unit vectors fore-aft on thigh and shank.

    It has the centers of hip and ankle on these [m].
    """

    thigh: str
    shank: str
    on_thigh: Array
    on_shank: Array
    hip: Array
    ankle: Array


def _legs(model: Model) -> Mapping[str, Leg]:
    """Find the legs by the names of their knees.

    Those without a hip or an ankle, or whose knee does not turn, are left out.
    """
    return FrozenMap(
        {knee.name: leg for knee in knee_joints(model) if (leg := _leg(model, knee)) is not None}
    )


def _leg(model: Model, knee: Joint) -> Leg | None:
    down = long_axis(model, knee)
    poses = flexed(model, knee)
    hip = next((joint for joint in model.joints if joint.child == knee.parent), None)
    if down is None or poses is None or hip is None:
        return None
    index = compile_tree(model).body_index
    thigh = poses.rotations[0, index[knee.parent]]
    shank = poses.rotations[0, index[knee.child]]
    axis = np.cross(down, hinge_axis(model, knee, poses, down))
    below = [joint.parent_frame.translation for joint in model.joints if joint.parent == knee.child]
    ankle = max(below, key=lambda point: float((point - knee.child_frame.translation) @ down))
    return Leg(
        thigh=knee.parent,
        shank=knee.child,
        on_thigh=thigh.T @ shank @ axis,
        on_shank=axis,
        hip=hip.child_frame.translation,
        ankle=ankle,
    )


legs_of = Latest(_legs)


def bowed_knee(knee: Joint, leg: Leg, angle: float) -> Joint:
    """Turn the axes of a knee on the shank, about its center [rad].

    So the shank turns the other way.
    """
    frame = knee.child_frame
    turned = axis_rotation(leg.on_shank, angle) @ frame.rotation
    return replace(knee, child_frame=Transform(turned, frame.translation))


def beside_bowed_bones(marker: Marker, leg: Leg, angle: float) -> Marker:
    """Leave a marker where it was seen beside bowed bones.

    Hip and ankle stay and the knee moves out, by half of the angle in each bone.
    """
    if marker.body == leg.thigh:
        return _turned(marker, leg.hip, leg.on_thigh, -0.5 * angle)
    return (
        _turned(marker, leg.ankle, leg.on_shank, 0.5 * angle)
        if marker.body == leg.shank
        else marker
    )


def _turned(marker: Marker, center: Array, axis: Array, angle: float) -> Marker:
    return replace(
        marker, location=center + axis_rotation(axis, angle) @ (marker.location - center)
    )
