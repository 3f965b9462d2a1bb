"""The limb of a virtual specimen: its mass, its muscle paths, and the specimen as MJCF."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.core.io.mjcf.write import text
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadModel
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Joint, Marker, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint, TendonWrap, WrapObject
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.swings.simulate.laboratory import SENSORS, inertial
from myomorph.swings.viscosity.specimen.bodies import moved_parameters
from myomorph.swings.viscosity.specimen.model import Specimen
from myomorph.swings.viscosity.tracking.limb_shape import limb_poses

SHARES = (0.3, 0.35, 0.35)
"""Of humerus, forearm and hand in the mass without muscles, before the mass center is set: [S]
leaves skin, fat and muscle at the hand alone.
"""
TISSUE_RADIUS = 0.045
TISSUE_LENGTH = 0.22  # The muscles as a cylinder about the humerus [m].
LOAD_RADIUS = 0.03  # Of what rests on the base, as a ball [m].


@dataclass(frozen=True, eq=False)
class HeldLimb:
    """A specimen whose joints beyond the first are wired: one rigid limb."""

    specimen: Specimen
    # value of each held coordinate, where it is not the model's default [rad]
    held: Mapping[str, float]

    @cached_property
    def poses(self) -> dict[str, Transform]:
        """Return the pose of every bone in the limb's frame.

        That frame has its origin at the joint's center, and the first bone's axes.
        """
        return limb_poses(self.specimen, self.held)

    def centered(self, body: str) -> Transform:
        """Return the pose of a body in the limb's frame.

        That of the base is in its own axes about the joint's center.
        """
        if body == self.specimen.base:
            return Transform(np.eye(3), -self.specimen.center)
        return self.poses[body]

    def markers(self) -> tuple[dict[str, Array], dict[str, Array]]:
        """Return the positions of the markers on base and limb.

        Returns
        -------
        (3,) by marker on the base, and (3,) by marker on the limb, in the frames of `centered` [m]
        """
        on_base: dict[str, Array] = {}
        on_limb: dict[str, Array] = {}
        for marker in self.specimen.model.markers:
            side = on_base if marker.body == self.specimen.base else on_limb
            side[marker.name] = self.centered(marker.body).apply(marker.location)
        return on_base, on_limb

    def parameters(self, mass: float, com: float) -> Array:
        """Return the inertial parameters of the limb without muscles.

        The masses of humerus, forearm and hand are those nearest to `SHARES` that give mass and
        center of mass.

        Parameters
        ----------
        mass : of the limb [kg]
        com : distance of its center of mass from the joint [m]

        Returns
        -------
        (10,) in the limb's frame, [D] order

        Raises
        ------
        BadModel : no positive masses give both
        """
        rows = dict(
            zip(
                self.specimen.model.body_names,
                inertial_parameters(self.specimen.model),
                strict=True,
            )
        )
        limb = self.specimen.limb
        parts = [limb[:1], limb[1:-1], limb[-1:]]
        lumps = np.array(
            [sum(moved_parameters(rows[name], self.poses[name]) for name in part) for part in parts]
        )
        lumps /= lumps[:, :1]
        masses = mass * np.array(SHARES)
        for _ in range(50):
            along = masses @ lumps[:, 1:4]
            along /= np.linalg.norm(along)
            rows_of = np.stack([np.ones(3), lumps[:, 1:4] @ along])
            wanted = np.array([mass, mass * com]) - rows_of @ masses
            masses = masses + np.linalg.pinv(rows_of) @ wanted
        if masses.min() <= 0.0:
            raise BadModel(
                f"a limb of {mass:g} kg cannot have its mass center {com:g} m from the joint:"
                f" {masses} kg"
            )
        return masses @ lumps

    def with_muscle_mass(self, parameters: Array, mass: float, com: float) -> Array:
        """Add a cylinder of muscles along the humerus that changes mass and center of mass.

        Parameters
        ----------
        parameters : (10,) of the limb without muscles, [D] order
        mass : of limb and muscles [kg]
        com : distance of their center of mass from the joint [m]

        Returns
        -------
        (10,) of limb and muscles, [D] order
        """
        elbow = self.poses[self.specimen.limb[1]].translation
        along = elbow / np.linalg.norm(elbow)
        added = mass - parameters[0]
        h = parameters[1:4]
        # |h + added * place * along| = mass * com, the root that lies farther down.
        b = h @ along
        place = (np.sqrt(b * b - h @ h + (mass * com) ** 2) - b) / added
        thin = TISSUE_RADIUS**2 / 2.0
        thick = TISSUE_RADIUS**2 / 4.0 + TISSUE_LENGTH**2 / 12.0 + place**2
        inertia = added * (thick * np.eye(3) + (thin - thick) * np.outer(along, along))
        off = (inertia[1, 2], inertia[2, 0], inertia[0, 1])
        return parameters + np.array([added, *(added * place * along), *np.diag(inertia), *off])


@dataclass(frozen=True)
class BaseLoad:
    """Load that rests on the base and does not swing.

    `mass` [kg]; `place` of its center in the base's frame [m].
    """

    mass: float
    place: tuple[float, float, float]

    def mjcf(self, center: Array) -> str:
        """Write its inertia on the base's body, whose origin is the joint's center.

        Parameters
        ----------
        center : (3,) of the joint in the base's frame [m]

        Returns
        -------
        element `inertial`
        """
        size = text(np.full(3, 0.4 * self.mass * LOAD_RADIUS**2))
        place = text(np.array(self.place) - center)
        return f'<inertial pos="{place}" mass="{self.mass!r}" diaginertia="{size}"/>'


def with_scaled_muscles(limb: HeldLimb, factor: float) -> Specimen:
    """Scale the specimen's muscles, with the surfaces they wrap around, about the joint's center.

    In the held pose this homothety scales lengths and moment arms about the joint exactly by the
    factor.
    """
    specimen = limb.specimen

    def moved(body: str, place: Array) -> Array:
        pose = limb.centered(body)
        return pose.inverse().apply(factor * pose.apply(place))

    def surface(wrap_object: WrapObject) -> WrapObject:
        pose = Transform(
            wrap_object.pose.rotation, moved(wrap_object.body, wrap_object.pose.translation)
        )
        return replace(
            wrap_object, pose=pose, size=tuple(factor * size for size in wrap_object.size)
        )

    muscles = []
    for muscle in specimen.model.muscles:
        points = tuple(
            replace(fixed_point, location=moved(fixed_point.body, fixed_point.location))
            for fixed_point in fixed_points(muscle)
        )
        wraps = tuple(
            wrap if wrap.side is None else replace(wrap, side=moved(wrap.side_body, wrap.side))
            for wrap in tendon_wraps(muscle)
        )
        muscles.append(replace(muscle, path=Path(points, wraps)))
    surfaces = tuple(surface(item) for item in specimen.model.wrap_objects)
    return replace(
        specimen, model=replace(specimen.model, muscles=tuple(muscles), wrap_objects=surfaces)
    )


def fixed_points(muscle: Muscle) -> tuple[PathPoint, ...]:
    """Return the points of a path that stays as it is.

    Raises `BadModel` of moving points, conditions and pulleys.
    """
    points = tuple(
        point
        for point in muscle.path.points
        if isinstance(point, PathPoint) and not point.coordinate
    )
    if len(points) != len(muscle.path.points) or muscle.path.divisors:
        raise BadModel(
            f"muscle '{muscle.name}' has moving points or pulleys: a virtual specimen has none"
        )
    return points


def tendon_wraps(muscle: Muscle) -> tuple[TendonWrap, ...]:
    """Its wraps, those of MuJoCo; raises `BadModel` of others."""
    wraps = tuple(wrap for wrap in muscle.path.wraps if isinstance(wrap, TendonWrap))
    if len(wraps) != len(muscle.path.wraps):
        raise BadModel(
            f"muscle '{muscle.name}' wraps as in OpenSim, which MuJoCo cannot: take a MuJoCo model"
        )
    return wraps


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class SwungLimb:
    """A limb that swings on a base.

    Attributes
    ----------
    limb : in its held pose
    parameters : (10,) inertial, of the limb in its frame, [D] order
    stand : pose of the base in ground
    rest : (3, 3) of the limb in ground at which the ball's angles are zero
    damping : of the ball joint, the same about every axis [N m s/rad]
    muscle : viscosity of every muscle [N s/m]; muscles are tendons where it is positive
    load : on the base
    loose : bodies on the limb that `parameters` do not include
    clamp : joints by which the base gives way against the plate, none where it is fixed
    joint : in place of the ball
    """

    limb: HeldLimb
    parameters: Array
    stand: Transform
    rest: Array
    damping: float
    muscle: float
    load: BaseLoad | None = None
    loose: str = ""
    clamp: str = ""
    joint: str = ""

    @property
    def mjcf(self) -> str:
        """The limb as MJCF."""
        specimen = self.limb.specimen
        center = self.stand.apply(specimen.center)
        inside: dict[str, list[str]] = {}
        paths: dict[str, str] = {}
        if self.muscle > 0.0:
            inside, paths = _muscles_mjcf(specimen.model, self.limb.centered)
        on_base = "".join(inside.pop(specimen.base, [])) + (
            "" if self.load is None else self.load.mjcf(specimen.center)
        )
        on_limb = "".join(part for parts in inside.values() for part in parts)
        clamped = f'<body name="clamped">{self.clamp}' if self.clamp else ""
        unclamped = "</body>" if self.clamp else ""
        ball = f'<joint name="joint" type="ball" damping="{self.damping!r}"/>'
        tendons, sensors = _tendons_mjcf(paths, self.muscle)
        return f"""<mujoco model="virtual specimen">
  <option gravity="{text(specimen.model.gravity)}"/>
  <default><geom contype="0" conaffinity="0" mass="0" group="4"/><site size="0.002" group="4"/>\
</default>
  <worldbody>
    <body name="base" pos="{text(center)}">
      <site name="plate"/>
      {clamped}
      <body name="scapula" quat="{text(quaternion(self.stand.rotation))}">{on_base}</body>
      <body name="limb" quat="{text(quaternion(self.rest))}">
        {self.joint or ball}
        {inertial(self.parameters)}
        <site name="center"/>
        {on_limb}{self.loose}
      </body>
      {unclamped}
    </body>
  </worldbody>
  {tendons}\
{sensors}
</mujoco>"""


def _tendons_mjcf(paths: Mapping[str, str], viscosity: float) -> tuple[str, str]:
    """Write muscles as tendons [N s/m], and the sensors of limb and tendons."""
    tendons = "".join(
        f'<spatial name="{name}" damping="{viscosity!r}">{path}</spatial>'
        for name, path in paths.items()
    )
    speeds = "".join(f'<tendonvel name="{name}" tendon="{name}"/>' for name in paths) + "</sensor>"
    sensors = SENSORS.format(body="limb").replace("</sensor>", speeds)
    return f"<tendon>{tendons}</tendon>" if tendons else "", sensors


def _muscles_mjcf(
    model: Model, frame: Callable[[str], Transform]
) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Write sites and surfaces by body, and each muscle's path.

    `frame`: pose of a body in what stands for it.
    """
    inside: dict[str, list[str]] = {name: [] for name in model.body_names}
    paths: dict[str, str] = {}

    def site(body: str, name: str, location: Array) -> str:
        inside[body].append(_site(name, frame(body).apply(location)))
        return name

    for item in model.wrap_objects:
        size = text(item.size[:1]) + (" 0.1" if item.kind == "cylinder" else "")
        pose = _pose(frame(item.body) @ item.pose)
        inside[item.body].append(
            f'<geom name="{item.name}" type="{item.kind}" size="{size}" {pose}/>'
        )
    for muscle in model.muscles:
        path = []
        for i, point in enumerate(fixed_points(muscle)):
            point_name = f"{muscle.name}-{i + 1}"
            path.append(f'<site site="{site(point.body, point_name, point.location)}"/>')
            for wrap in (wrap for wrap in tendon_wraps(muscle) if wrap.after == i):
                side = ""
                if wrap.side is not None:
                    side_name = f"{muscle.name}-side-{wrap.wrap_object}"
                    side = f' sidesite="{site(wrap.side_body, side_name, wrap.side)}"'
                path.append(f'<geom geom="{wrap.wrap_object}"{side}/>')
        paths[muscle.name] = "".join(path)
    return inside, paths


def _site(name: str, location: Array) -> str:
    return f'<site name="{name}" pos="{text(location)}"/>'


def _pose(pose: Transform) -> str:
    return f'pos="{text(pose.translation)}" quat="{text(quaternion(pose.rotation))}"'


def quaternion(rotation: Array) -> Array:
    """Convert a rotation to a quaternion.

    Parameters
    ----------
    rotation : (3, 3)

    Returns
    -------
    (4,) w first
    """
    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)


def specimen_mjcf(specimen: Specimen) -> str:
    """Write the specimen as an MJCF model: bones, joints, markers as sites, muscles on tendons.

    The base stands in the world; wires, positions of clusters and viscosities are not in it, as a
    laboratory would not know them.
    """
    model = specimen.model
    children: dict[str, list[str]] = {name: [] for name in ("ground", *model.body_names)}
    for joint in model.joints:
        children[joint.parent].append(joint.child)
    inside, paths = _muscles_mjcf(model, lambda body: Transform.identity())
    for marker in model.markers:
        inside[marker.body].append(_site(marker.name, marker.location))
    joints = {joint.child: joint for joint in model.joints}
    rows = dict(zip(model.body_names, inertial_parameters(model), strict=True))

    def body(name: str) -> str:
        pose, freedoms = (specimen.stand, "") if name == specimen.base else _joint(joints[name])
        parts = (
            freedoms,
            inertial(rows[name]),
            *inside[name],
            *(body(child) for child in children[name]),
        )
        return f'<body name="{name}" {_pose(pose)}>{"".join(parts)}</body>\n'

    tendons = [f'<spatial name="{name}_tendon">{path}</spatial>\n' for name, path in paths.items()]
    actuators = [
        f'<muscle name="{muscle.name}" tendon="{muscle.name}_tendon"'
        f' force="{muscle.max_isometric_force!r}" lengthrange="0.01 1"/>\n'
        for muscle in model.muscles
    ]
    return f"""<mujoco model="{model.name}">
<compiler autolimits="true"/>
<option gravity="{text(model.gravity)}"/>
<default><geom contype="0" conaffinity="0" group="4"/><site size="0.002"/></default>
<worldbody>
{body(specimen.base)}</worldbody>
<tendon>{"".join(tendons)}</tendon>
<actuator>{"".join(actuators)}</actuator>
</mujoco>
"""


def _joint(joint: Joint) -> tuple[Transform, str]:
    """Return where a body is when its joint does not turn, and the joint's axes as MuJoCo's.

    The axes follow one after another.
    """
    pose = joint.parent_frame @ joint.child_frame.inverse()
    back = joint.child_frame
    if joint.kind == "ball":
        return pose, f'<joint name="{joint.name}" type="ball" pos="{text(back.translation)}"/>'
    parts = []
    for axis in joint.axes:
        if (
            axis.kind != "rotation"
            or float(axis.function(1.0)) != 1.0
            or float(axis.function(0.0)) != 0.0
        ):
            raise BadModel(
                f"joint '{joint.name}' does more than turn: a virtual specimen has hinges only"
            )
        anchor = f'pos="{text(back.apply(axis.origin))}" axis="{text(back.rotation @ axis.vector)}"'
        parts.append(f'<joint name="{axis.coordinates[0]}" type="hinge" {anchor}/>')
    return pose, "".join(parts)


TRIANGLE = np.array([[50.0, 0.0], [10.0, 28.0], [-30.0, -25.0]]) / 50.0
"""Three markers around a pin, in units of the longest arm; no two sides are alike, so that labels
can be told.
"""

PIN = 0.06  # Distance of a cluster from its bone's line [m].


def with_clusters(specimen: Specimen, arm: float = 0.05) -> Specimen:
    """Give the specimen three made markers, "<bone>_1" to "_3", on every bone and no others.

    A cluster stands on a pin at the middle of its bone, beside the line from joint to joint; its
    markers are at 1, 0.6 and 0.8 of `arm` from the pin [m].
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
    """Return two points of a bone in its own frame [m].

    They are its joint, and the farther of next joint and center of mass.
    """
    model = specimen.model
    poses = standing_poses(model)
    if bone == specimen.base:
        start = specimen.center
    else:
        start = next(joint for joint in model.joints if joint.child == bone).child_frame.translation
    ends = [np.asarray(model.body(bone).mass_center)]
    for joint in model.joints:
        if joint.parent == bone and bone != specimen.base:
            ends.append(poses[bone].inverse().apply(poses[joint.child].translation))
    end = max(ends, key=lambda end: float(np.linalg.norm(end - start)))
    return (
        (start, end)
        if np.linalg.norm(end - start) > 1e-3
        else (start, start + np.array([0.0, 0.05, 0.0]))
    )
