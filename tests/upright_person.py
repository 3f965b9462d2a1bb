"""A small person for tests of what no marker shows: a pelvis that floats, a trunk, two legs."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Marker, Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.spatial import Transform, axis_rotation
from myomorph.core.rigid.kinematics import marker_positions

STILL = Transform.identity()
# From axes with y up to axes with z up
Z_UP = axis_rotation((1.0, 0.0, 0.0), 0.5 * np.pi)
RATE = 100.0


def person(up="y"):
    """Pelvis on six coordinates, torso on three, thighs on three each and shanks on one.

    In the default pose x is ahead, and the person stands along y or z. The pelvis' coordinates
    belong to the person, so that both models stand alike at the same values.
    """
    turn = np.eye(3) if up == "y" else Z_UP
    x, y, z = np.eye(3)
    joints = [
        _joint("root", GROUND, "pelvis", Transform(turn, np.zeros(3)), _free("pelvis", (x, y, z)))
    ]
    lumbar = [
        _turning("lumbar_extension", z),
        _turning("lumbar_bending", x),
        _turning("lumbar_rotation", y),
    ]
    joints.append(_joint("back", "pelvis", "torso", _at(-0.05, 0.1, 0.0), lumbar))
    bodies = [_body("pelvis", 11.0, (0.0, 0.0, 0.0)), _body("torso", 35.0, (0.0, 0.3, 0.0))]
    markers = [
        *_markers("pelvis", ((0.1, 0.0, 0.12), (0.1, 0.0, -0.12), (-0.15, 0.02, 0.0))),
        *_markers("torso", ((0.0, 0.4, 0.17), (0.0, 0.4, -0.17), (0.1, 0.3, 0.0), (-0.1, 0.42, 0))),
    ]
    for side, sign in (("r", 1.0), ("l", -1.0)):
        hip = [
            _turning(f"hip_flexion_{side}", z),
            _turning(f"hip_adduction_{side}", x),
            _turning(f"hip_rotation_{side}", y),
        ]
        thigh = f"femur_{side}"
        shank = f"tibia_{side}"
        joints.append(_joint(f"hip_{side}", "pelvis", thigh, _at(0.0, -0.07, 0.08 * sign), hip))
        knee = [_turning(f"knee_angle_{side}", z)]
        joints.append(_joint(f"knee_{side}", thigh, shank, _at(0.0, -0.4, 0.0), knee))
        bodies += [_body(thigh, 8.0, (0.0, -0.2, 0.0)), _body(shank, 4.0, (0.0, -0.2, 0.0))]
        markers += _markers(
            thigh, ((0.06, -0.2, 0.0), (0.0, -0.2, 0.07 * sign), (0.0, -0.38, 0.05 * sign))
        )
        markers += _markers(
            shank, ((0.05, -0.2, 0.0), (0.0, -0.15, 0.05 * sign), (0.0, -0.4, 0.04 * sign))
        )
    names = [name for joint in joints for name in joint.coordinates]
    return Model(
        name="person",
        bodies=tuple(bodies),
        joints=tuple(joints),
        coordinates=tuple(
            Coordinate(
                name, "translational" if name.endswith(("_tx", "_ty", "_tz")) else "rotational"
            )
            for name in names
        ),
        gravity=turn @ np.array([0.0, -9.81, 0.0]),
        markers=tuple(markers),
    )


def _body(name, mass, center):
    return Body(name=name, mass=mass, mass_center=np.array(center), inertia=0.02 * mass * np.eye(3))


def _at(*place):
    return Transform(np.eye(3), np.array(place))


def _turning(name, axis):
    return Axis(kind="rotation", vector=axis, function=linear(1.0), coordinates=(name,))


def _free(name, axes):
    x, y, z = axes
    turns = [_turning(f"{name}_{end}", v) for end, v in (("tilt", z), ("list", x), ("rotation", y))]
    slides = [
        Axis(kind="translation", vector=v, function=linear(1.0), coordinates=(f"{name}_{end}",))
        for end, v in (("tx", x), ("ty", y), ("tz", z))
    ]
    return [*slides, *turns]


def _joint(name, parent, child, frame, axes):
    return Joint(
        name=name,
        kind="CustomJoint",
        parent=parent,
        child=child,
        parent_frame=frame,
        child_frame=STILL,
        axes=tuple(axes),
        coordinates=tuple(name for axis in axes for name in axis.coordinates),
    )


def _markers(body, places):
    return [Marker(f"{body}_{i}", body, np.array(place)) for i, place in enumerate(places)]


def walk(model, seconds=4.0, pace=1.0):
    """Swing the legs, let the pelvis go ahead, list and turn, and the trunk lean and sway."""
    time = np.arange(round(seconds * RATE)) / RATE
    phase = 2.0 * np.pi * pace * time
    values = np.zeros((len(time), len(model.coordinates)))

    def put(name, column):
        values[:, model.coordinate_names.index(name)] = column

    put("pelvis_tx", 1.2 * time)
    put("pelvis_ty", 0.95 + 0.02 * np.cos(2.0 * phase))
    put("pelvis_tilt", 0.03 + 0.02 * np.sin(2.0 * phase))
    put("pelvis_list", 0.08 * np.sin(phase))
    put("pelvis_rotation", 0.10 * np.cos(phase))
    put("lumbar_extension", -0.2 - 0.02 * np.sin(2.0 * phase))
    put("lumbar_bending", -0.07 * np.sin(phase))
    put("lumbar_rotation", -0.12 * np.cos(phase))
    for side, shift in (("r", 0.0), ("l", np.pi)):
        put(f"hip_flexion_{side}", 0.1 + 0.4 * np.sin(phase + shift))
        put(f"hip_adduction_{side}", 0.06 * np.sin(phase + shift + 1.0))
        put(f"hip_rotation_{side}", 0.08 * np.sin(phase + shift + 2.0))
        put(f"knee_angle_{side}", -0.5 + 0.4 * np.sin(phase + shift + 0.7))
    return Motion(time, model.coordinate_names, values)


def seen(model, motion, hidden=()):
    """Markers of a motion but for those of some bodies."""
    markers = marker_positions(model, motion)
    bodies = {marker.name: marker.body for marker in model.markers}
    kept = [i for i, name in enumerate(markers.names) if bodies[name] not in hidden]
    return markers.columns(kept)


def without(markers, names, span):
    """Markers with some hidden during a span of time."""
    values = np.array(markers.values)
    frames = (markers.time >= span[0]) & (markers.time < span[1])
    for name in names:
        values[frames, markers.names.index(name)] = np.nan
    return Markers(markers.time, markers.names, values)
