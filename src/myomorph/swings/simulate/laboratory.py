"""A virtual laboratory: swings in MuJoCo as markers and a force plate measure them.

A rod is pushed onto the plate, and a CT made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import trimesh
from mujoco import rollout
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from myomorph.core.io.c3d.write import write_c3d
from myomorph.core.io.mesh import read_mesh
from myomorph.core.io.mjcf.write import text
from myomorph.core.io.sto import write_sto
from myomorph.core.io.trc import write_trc
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadModel
from myomorph.core.model.inertia import inertia_matrices
from myomorph.core.model.series import Markers, PlateRecording, Table, Wrenches
from myomorph.core.model.spatial import Transform
from myomorph.core.model.surface import Surface
from myomorph.swings.viscosity.specimen.model import Specimen

MARKER_RATE = 200.0
FORCE_RATE = 2000.0  # Of [S] section III [Hz].
SENSORS = """
  <sensor>
    <framequat name="pose" objtype="xbody" objname="{body}"/>
    <gyro name="rates" site="center"/>
    <frameangacc name="accelerations" objtype="xbody" objname="{body}"/>
    <torque name="torque" site="plate"/>
    <force name="force" site="plate"/>
  </sensor>"""
"""What a swing needs. The limb's first body `body` has a site "center" at the joint, along its
axes; the base, which weighs nothing, carries it, and has a site "plate" there along the ground's.
Speeds of tendons come after these.
"""


@dataclass(frozen=True)
class Noise:
    """How badly a swing is measured; all noise is white and normal."""

    marker: float = 3e-4  # standard deviation of each marker's coordinates [m]
    force: float = 0.3  # of each component of the plate's force [N]
    lever: float = 0.2  # of each component of its moment about the plate's origin, over `force` [m]
    # offset, drift: the plate's clock reads offset + (1 + drift) t [s], [s/s]
    offset: float = 0.0
    drift: float = 0.0


@read_only
class Sampled:
    """A simulated swing, exact but for the integrator."""

    time: Array  # (frames,) [s]
    rotations: Array  # (frames, 3, 3) of the limb's first body in ground
    # rates, accelerations: (frames, 3) angular, along the limb's axes [rad/s], [rad/s^2]
    rates: Array
    accelerations: Array
    # (frames, 6) of the base on the limb, moment about the joint's center, in ground [N m], [N]
    wrench: Array
    lengthening: Array  # (frames, tendons) speed of each tendon [m/s]

    def every(self, number: int) -> Sampled:
        """Every so many-th frame."""
        return Sampled(
            time=self.time[::number],
            rotations=self.rotations[::number],
            rates=self.rates[::number],
            accelerations=self.accelerations[::number],
            wrench=self.wrench[::number],
            lengthening=self.lengthening[::number],
        )


@dataclass(frozen=True, eq=False)
class VirtualTrial:
    """One release: what was measured of it, and what truly happened."""

    name: str
    markers: Markers  # 200 Hz, with noise
    # of the plate on the base, 2000 Hz on its own clock, with noise: force, point, torque
    wrenches: Wrenches
    exact: Sampled  # the simulation at the forces' instants, without noise, on the true clock


def simulate(compiled: Any, qpos: Array, qvel: Array, seconds: float, step: float) -> Sampled:
    """Simulate the swing of a compiled model from a state, by the Runge-Kutta method of order 4.

    That method leaves joint and tendon dampers as they are; MuJoCo's others treat them implicitly,
    by which a step of finite length alters them.

    Parameters
    ----------
    compiled : MuJoCo's model with the `SENSORS`
    qpos : (nq,) positions at the start, as MuJoCo has them
    qvel : (nv,) velocities at the start, as MuJoCo has them
    seconds : of the swing [s]
    step : of time [s]

    Returns
    -------
    the sensors' values at each step
    """
    compiled.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    compiled.opt.timestep = step
    data = mujoco.MjData(compiled)
    data.qpos[:] = qpos
    data.qvel[:] = qvel
    whole = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start = np.empty(mujoco.mj_stateSize(compiled, whole))
    mujoco.mj_getState(compiled, data, start, whole)
    steps = round(seconds / step) + 1
    _, sensed = rollout.rollout(compiled, data, start, nstep=steps)
    return sampled(compiled, np.arange(steps, dtype=np.float64) * step, sensed[0])


def sampled(compiled: Any, time: Array, sensed: Array) -> Sampled:
    """Return the sensors' values in our order and frames.

    Parameters
    ----------
    compiled : MuJoCo's model with the `SENSORS`
    time : (frames,) [s]
    sensed : (frames, sensors' values) as MuJoCo has them

    Returns
    -------
    values of each sensor
    """

    def values(name: str) -> Array:
        sensor = compiled.sensor(name)
        return sensed[:, sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]

    rotations = matrices(values("pose"))
    wrench = np.concatenate([values("torque"), values("force")], axis=1)
    accelerations = np.einsum("fji,fj->fi", rotations, values("accelerations"))
    speeds = sensed[:, sensed.shape[1] - compiled.ntendon :]
    return Sampled(
        time=time,
        rotations=rotations,
        rates=values("rates"),
        accelerations=accelerations,
        wrench=wrench,
        lengthening=speeds,
    )


def matrices(quaternions: Array) -> Array:
    """Convert unit quaternions to rotation matrices.

    Parameters
    ----------
    quaternions : (frames, 4), w first

    Returns
    -------
    (frames, 3, 3)
    """
    return Rotation.from_quat(quaternions, scalar_first=True).as_matrix()


@dataclass(frozen=True, eq=False)
class Instruments:
    """Cameras and a plate with their noise, and the generator that it is drawn from."""

    noise: Noise
    random: np.random.Generator


def measured_markers(
    exact: Sampled,
    center: Array,
    base: Mapping[str, Array],
    limb: Mapping[str, Array],
    instruments: Instruments,
) -> Markers:
    """Return markers of base and limb as cameras measure them, with noise.

    Parameters
    ----------
    exact : the swing
    center : (3,) of the joint, in ground [m]
    base : (3,) markers at rest, in ground, by name [m]
    limb : (3,) markers on the limb, from the joint's center in its axes, by name [m]
    instruments : with their noise

    Returns
    -------
    markers of base and limb
    """
    seen = exact.every(round(1.0 / (MARKER_RATE * (exact.time[1] - exact.time[0]))))
    fixed = np.broadcast_to(np.array(list(base.values())), (len(seen.time), len(base), 3))
    moving = center + np.einsum("fij,mj->fmi", seen.rotations, np.array(list(limb.values())))
    places = np.concatenate([fixed, moving], axis=1)
    errors = instruments.noise.marker * instruments.random.standard_normal(places.shape)
    return Markers(seen.time, (*base, *limb), places + errors)


def measured_wrench(
    exact: Sampled, center: Array, plate: Array, body: str, instruments: Instruments
) -> Wrenches:
    """Return the wrench on a body as the plate measures it on its own clock.

    Parameters
    ----------
    exact : the swing
    center : (3,) of the joint, in ground [m]
    plate : (3,) origin of the plate, about which the moment is taken, in ground [m]
    body : that the wrench acts on
    instruments : with their noise

    Returns
    -------
    force and moment at the plate's origin
    """
    noise = instruments.noise
    random = instruments.random
    scale = 1.0 + noise.drift
    first = noise.offset + scale * exact.time[0]
    last = noise.offset + scale * exact.time[-1]
    clock = np.arange(np.ceil(first * FORCE_RATE), np.floor(last * FORCE_RATE) + 1.0) / FORCE_RATE
    wrench = exact.wrench
    true = np.clip((clock - noise.offset) / scale, exact.time[0], exact.time[-1])
    if len(true) != len(exact.time) or not np.allclose(true, exact.time, atol=1e-9, rtol=0.0):
        wrench = CubicSpline(exact.time, wrench)(true)
    force = wrench[:, 3:] + noise.force * random.standard_normal((len(true), 3))
    moment = wrench[:, :3] + np.cross(center - plate, wrench[:, 3:])
    moment += noise.force * noise.lever * random.standard_normal(moment.shape)
    return Wrenches(
        time=clock,
        names=("plate",),
        bodies=(body,),
        forces=force[:, None],
        points=np.broadcast_to(plate, (len(true), 1, 3)),
        torques=moment[:, None],
    )


def inertial(parameters: Array) -> str:
    """Write inertial parameters as MJCF.

    Parameters
    ----------
    parameters : (10,) about the body's origin, [D] order

    Returns
    -------
    element `inertial`
    """
    center = parameters[1:4] / parameters[0]
    about = inertia_matrices(parameters) - parameters[0] * (
        center @ center * np.eye(3) - np.outer(center, center)
    )
    full = (about[0, 0], about[1, 1], about[2, 2], about[0, 1], about[0, 2], about[1, 2])
    return (
        f'<inertial pos="{text(center)}" mass="{float(parameters[0])!r}"'
        f' fullinertia="{text(full)}"/>'
    )


def write_recording(trial: VirtualTrial, stem: Path) -> None:
    """Write `<stem>.trc` with the markers and `<stem>.mot` with the load on the base.

    The load is force, point and torque, in ground.
    """
    write_trc(trial.markers, stem.with_suffix(".trc"))
    write_sto(loads_table(trial.wrenches), stem.with_suffix(".mot"))


def loads_table(wrenches: Wrenches) -> Table:
    """One wrench as OpenSim writes it, to 1 mN, 1 um and 0.1 mN m, far below the noise."""
    parts = ((wrenches.forces, 3), (wrenches.points, 6), (wrenches.torques, 4))
    columns = np.concatenate([np.round(values[:, 0], digits) for values, digits in parts], axis=1)
    names = [
        f"{what}{axis}"
        for what in ("ground_force_v", "ground_force_p", "ground_torque_")
        for axis in "xyz"
    ]
    return Table(wrenches.time, tuple(names), columns)


SIZE = (0.4, 0.6)  # Of an AMTI BP400600 [m].
DEPTH = 0.035  # Of its sensors' origin under the top surface [m].
PLACES = ((0.12, 0.2), (-0.12, 0.2), (-0.12, -0.2), (0.12, -0.2), (0.0, 0.0))
"""Where the rod is pushed onto the plate, in its axes [m]."""
ROD = {"rod_1": 0.12, "rod_2": 0.62}  # Distance of its markers from its tip [m].
PUSH = 4.0
REST = 1.0  # Length of a push and of the pause after it [s].
BALL = 0.009  # Diameter of a marker [m].
BONES = {
    "scapula_r": "scapula.stl",
    "humerus_r": "humerus.stl",
    "ulna_r": "ulna.stl",
    "radius_r": "radius.stl",
    "thirdmc_r": "3mc.stl",
}


class VirtualPlate:
    """A plate that lies elsewhere than its file states.

    It is off by some millimeters and a degree or two, at random.
    """

    def __init__(self, true: Transform, random: np.random.Generator) -> None:
        self.true = true
        turn = Rotation.from_rotvec(np.deg2rad(random.uniform(-1.5, 1.5, 3))).as_matrix()
        self.nominal = Transform(
            turn @ true.rotation, true.translation + random.uniform(-8e-3, 8e-3, 3)
        )

    def recording(self, force: Array, moment: Array) -> PlateRecording:
        """Return what the plate stores.

        Parameters
        ----------
        force : (samples, 3) in ground [N]
        moment : (samples, 3) about the plate's center, in ground [N m]

        Returns
        -------
        recording of the plate, whose corners are where its file states them
        """
        origin = np.array([0.0, 0.0, -DEPTH])
        plate_force = force @ self.true.rotation
        channels = np.hstack(
            [plate_force, moment @ self.true.rotation - np.cross(plate_force, origin)]
        )
        half = 0.5 * np.array([*SIZE, 0.0])
        corners = self.nominal.apply(
            half * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
        )
        return PlateRecording(
            name="plate", kind=2, corners=corners, origin=origin, channels=channels
        )


def write_swing_c3d(trial: VirtualTrial, plate: VirtualPlate, path: Path) -> None:
    """Write a swing's markers and plate in one C3D file.

    It runs from the first to the last frame that both clocks count.
    """
    markers = trial.markers
    wrenches = trial.wrenches
    every = int(FORCE_RATE / MARKER_RATE)
    begin = round(float(wrenches.time[0]) * FORCE_RATE)
    end = round(float(wrenches.time[(-1)]) * FORCE_RATE)
    frames = np.arange(len(markers)) * every
    both = (frames >= begin) & (frames + every - 1 <= end)
    first = int(frames[both][0]) - begin
    samples = slice(first, first + every * int(both.sum()))
    force, moment = at_center(wrenches, plate.true.translation)
    seen = Markers(markers.time[both], markers.names, markers.values[both])
    write_c3d(path, seen, plate.recording(force[samples], moment[samples]))


def at_center(wrenches: Wrenches, center: Array) -> tuple[Array, Array]:
    """Return force and moment about a point.

    Parameters
    ----------
    wrenches : of one plate
    center : (3,) point, in ground [m]

    Returns
    -------
    (samples, 3) force [N] and (samples, 3) moment [N m]
    """
    force = wrenches.forces[:, 0]
    return force, wrenches.torques[:, 0] + np.cross(wrenches.points[:, 0] - center, force)


def write_rod(plate: VirtualPlate, noise: Noise, random: np.random.Generator, path: Path) -> None:
    """Write the recording of a rod with two markers that is pushed onto the plate at `PLACES`.

    The directions go round, with pauses.
    """
    every = int(FORCE_RATE / MARKER_RATE)
    frames = round(len(PLACES) * (PUSH + REST) * MARKER_RATE)
    time = np.arange(frames * every) / FORCE_RATE
    number = np.minimum((time / (PUSH + REST)).astype(int), len(PLACES) - 1)
    phase = np.clip((time - number * (PUSH + REST)) / PUSH, 0.0, 1.0)
    tips = np.column_stack([np.array(PLACES)[number], np.zeros(len(time))])
    tilt = np.deg2rad(22.0)
    azimuth = 2.0 * np.pi * phase + number
    level = np.sin(tilt) * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    along = np.column_stack([level, np.full(len(time), np.cos(tilt))]) @ plate.true.rotation.T
    tips = plate.true.apply(tips)
    force = 80.0 * (np.sin(np.pi * phase) ** 0.5)[:, None] * along
    moment = np.cross(tips - plate.true.translation, force)
    force = force + noise.force * random.standard_normal(force.shape)
    moment = moment + noise.force * noise.lever * random.standard_normal(moment.shape)
    seen = np.stack([tips + length * along for length in ROD.values()], axis=1)[::every]
    seen = seen + noise.marker * random.standard_normal(seen.shape)
    write_c3d(path, Markers(time[::every], tuple(ROD), seen), plate.recording(force, moment))


def write_scans(
    specimen: Specimen,
    folder: Path,
    random: np.random.Generator,
    modelled: Callable[[Array], Array] | None = None,
) -> str:
    """Write a CT of every bone with its cluster, in a frame of its own.

    Of each bone: the model's surface `<bone>_model.stl` [m], the scan `<bone>.stl` (refined,
    rotated, shifted, 0.2 mm of noise), the cluster `<bone>_cluster.stl` of three balls [mm], and
    five picked points, 0.5 mm off.

    Parameters
    ----------
    specimen : with bones and markers
    folder : to write into
    random : generator of poses and noise
    modelled : maps points (..., 3) of the specimen's bones to those of the bones that the model
        has; by default they are the same [m]

    Returns
    -------
    entries of a study file's `ct`
    """
    modelled = modelled or (lambda points: points)
    entries = []
    for bone in specimen.model.body_names:
        mesh = bone_of(specimen, bone)
        markers = {
            marker.name: marker.location for marker in specimen.model.markers if marker.body == bone
        }
        pose = Transform(
            Rotation.random(random_state=random).as_matrix(), random.uniform(-0.2, 0.2, 3)
        )
        fine = trimesh.Trimesh(mesh.vertices, mesh.faces).subdivide()
        scan = pose.apply(fine.vertices) + 2e-4 * random.standard_normal(fine.vertices.shape)
        balls = trimesh.util.concatenate(
            [
                trimesh.creation.icosphere(3, 0.5 * BALL).apply_translation(pose.apply(marker))
                for marker in markers.values()
            ]
        )
        _write_stl(modelled(mesh.vertices), mesh.faces, folder / f"{bone}_model.stl")
        _write_stl(1e3 * scan, fine.faces, folder / f"{bone}.stl")
        _write_stl(1e3 * np.asarray(balls.vertices), balls.faces, folder / f"{bone}_cluster.stl")
        picked = 1e3 * (pose.apply(ends := _ends(mesh)) + 5e-4 * random.standard_normal((5, 3)))
        lines = [
            f"point {i + 1}," + ",".join(f"{value:.6f}" for value in (*seen, *place))
            for i, (seen, place) in enumerate(zip(picked, modelled(ends), strict=True))
        ]
        head = "name,x,y,z,bone_x,bone_y,bone_z"
        (folder / f"{bone}_points.csv").write_text(
            "\n".join([head, *lines]) + "\n", encoding="utf-8"
        )
        names = ", ".join(f'"{name}"' for name in markers)
        files = (
            f'surface = "{folder.name}/{bone}.stl", cluster = "{folder.name}/{bone}_cluster.stl"'
        )
        model = (
            f'mesh = "{folder.name}/{bone}_model.stl", picked = "{folder.name}/{bone}_points.csv"'
        )
        entries.append(
            f'  {{ bone = "{bone}", {files}, markers = [{names}], {model}, unit = "mm" }}'
        )
    return "[\n" + ",\n".join(entries) + ",\n]"


def bone_of(specimen: Specimen, bone: str) -> Surface:
    """Return the surface of a bone in its body's frame [m], from the package of the model."""
    for mesh in specimen.model.body(bone).meshes:
        if mesh.file.endswith(f"/{BONES[bone]}"):
            surface = read_mesh(Path(specimen.model.source).parent / mesh.file)
            whole = trimesh.Trimesh(mesh.pose.apply(mesh.scale * surface.vertices), surface.faces)
            return Surface(np.asarray(whole.vertices), np.asarray(whole.faces))
    raise BadModel(f"model '{specimen.model.name}': body '{bone}' has no mesh '{BONES[bone]}'")


def _ends(bone: Surface) -> Array:
    """(5, 3) vertices that lie farthest out along the bone's principal axes."""
    away = bone.vertices - bone.vertices.mean(axis=0)
    axes = np.linalg.svd(away, full_matrices=False)[2]
    along = away @ axes.T
    rows = np.column_stack([along.argmax(axis=0), along.argmin(axis=0)]).ravel()
    return bone.vertices[rows[:5]]


def _write_stl(vertices: Array, faces: np.ndarray, path: Path) -> None:
    trimesh.Trimesh(vertices, faces, process=False).export(str(path))
