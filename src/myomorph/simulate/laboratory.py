"""What a virtual laboratory measures besides swings: its plate with a rod, and a CT of a specimen's bones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from myomorph.io.c3d.ezc3d import write_c3d
from myomorph.io.mesh import read_mesh
from myomorph.model.arrays import Array
from myomorph.model.errors import BadModel
from myomorph.model.series import Markers, PlateRecording, Wrenches
from myomorph.model.spatial import Transform
from myomorph.model.surface import Surface
from myomorph.simulate.recording import FORCE_RATE, MARKER_RATE, Noise, VirtualTrial
from myomorph.viscosity.specimen import Specimen

SIZE = (0.4, 0.6)
"""Of an AMTI BP400600 [m]."""
DEPTH = 0.035
"""Of its sensors' origin under the top surface [m]."""
PLACES = ((0.12, 0.2), (-0.12, 0.2), (-0.12, -0.2), (0.12, -0.2), (0.0, 0.0))
"""Where the rod is pushed onto the plate, in its axes [m]."""
ROD = {"rod_1": 0.12, "rod_2": 0.62}
"""Distance of its markers from its tip [m]."""
PUSH, REST = 4.0, 1.0
"""Length of a push and of the pause after it [s]."""
BALL = 0.009
"""Diameter of a marker [m]."""
BONES = {"scapula_r": "scapula.stl", "humerus_r": "humerus.stl", "ulna_r": "ulna.stl", "radius_r": "radius.stl",
         "thirdmc_r": "3mc.stl"}  # fmt: skip


class VirtualPlate:
    """A plate that lies elsewhere than its file says.

    Parameters
    ----------
    true : its axes and the center of its top surface, in ground
    random : by how much the file is wrong, some millimeters and a degree or two
    """

    def __init__(self, true: Transform, random: np.random.Generator) -> None:
        self.true = true
        turn = Rotation.from_rotvec(np.deg2rad(random.uniform(-1.5, 1.5, 3))).as_matrix()
        self.nominal = Transform(turn @ true.rotation, true.translation + random.uniform(-8e-3, 8e-3, 3))

    def recording(self, force: Array, moment: Array) -> PlateRecording:
        """What the plate stores of forces (samples, 3) and moments about its center, both in ground [N, N m]."""
        origin = np.array([0.0, 0.0, -DEPTH])
        own = force @ self.true.rotation
        channels = np.hstack([own, moment @ self.true.rotation - np.cross(own, origin)])
        half = 0.5 * np.array([*SIZE, 0.0])
        corners = self.nominal.apply(half * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]))
        return PlateRecording("plate", 2, corners, origin, channels)


def write_swing_c3d(trial: VirtualTrial, plate: VirtualPlate, path: Path) -> None:
    """A swing's markers and plate in one C3D file, from the first to the last frame that both clocks count."""
    markers, wrenches = trial.markers, trial.wrenches
    every = int(FORCE_RATE / MARKER_RATE)
    begin, end = (round(float(wrenches.time[k]) * FORCE_RATE) for k in (0, -1))
    frames = np.arange(len(markers)) * every
    both = (frames >= begin) & (frames + every - 1 <= end)
    first = int(frames[both][0]) - begin
    samples = slice(first, first + every * int(both.sum()))
    force, moment = at_center(wrenches, plate.true.translation)
    seen = Markers(markers.time[both], markers.names, markers.values[both])
    write_c3d(path, seen, plate.recording(force[samples], moment[samples]))


def at_center(wrenches: Wrenches, center: Array) -> tuple[Array, Array]:
    """Force and moment about a point (3,), (samples, 3) each."""
    force = wrenches.forces[:, 0]
    return force, wrenches.torques[:, 0] + np.cross(wrenches.points[:, 0] - center, force)


def write_rod(plate: VirtualPlate, noise: Noise, random: np.random.Generator, path: Path) -> None:
    """A rod with two markers pushed onto the plate at `PLACES`, in directions that go round, with pauses."""
    every = int(FORCE_RATE / MARKER_RATE)
    frames = round(len(PLACES) * (PUSH + REST) * MARKER_RATE)
    time = np.arange(frames * every) / FORCE_RATE
    number = np.minimum((time / (PUSH + REST)).astype(int), len(PLACES) - 1)
    phase = np.clip((time - number * (PUSH + REST)) / PUSH, 0.0, 1.0)
    tips = np.column_stack([np.array(PLACES)[number], np.zeros(len(time))])
    tilt, azimuth = np.deg2rad(22.0), 2.0 * np.pi * phase + number
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


def write_scans(specimen: Specimen, folder: Path, random: np.random.Generator) -> str:
    """A CT of every bone with its cluster, in a frame of its own; the entries of a study file's `ct`.

    Of each bone: the model's surface `<bone>_model.stl` [m], the scan `<bone>.stl` (refined, turned, shifted, 0.2 mm of
    noise), the cluster `<bone>_cluster.stl` of three balls [mm], and five picked points, 0.5 mm off.
    """
    entries = []
    for bone in specimen.model.body_names:
        own = bone_of(specimen, bone)
        markers = {one.name: one.location for one in specimen.model.markers if one.body == bone}
        pose = Transform(Rotation.random(random_state=random).as_matrix(), random.uniform(-0.2, 0.2, 3))
        fine = trimesh.Trimesh(own.vertices, own.faces).subdivide()
        scan = pose.apply(fine.vertices) + 2e-4 * random.standard_normal(fine.vertices.shape)
        balls = trimesh.util.concatenate(
            [trimesh.creation.icosphere(3, 0.5 * BALL).apply_translation(pose.apply(one)) for one in markers.values()]
        )
        _write_stl(own.vertices, own.faces, folder / f"{bone}_model.stl")
        _write_stl(1e3 * scan, fine.faces, folder / f"{bone}.stl")
        _write_stl(1e3 * np.asarray(balls.vertices), balls.faces, folder / f"{bone}_cluster.stl")
        picked = 1e3 * (pose.apply(ends := _ends(own)) + 5e-4 * random.standard_normal((5, 3)))
        lines = [
            f"point {i + 1}," + ",".join(f"{one:.6f}" for one in (*seen, *place))
            for i, (seen, place) in enumerate(zip(picked, ends, strict=True))
        ]
        head = "name,x,y,z,bone_x,bone_y,bone_z"
        (folder / f"{bone}_points.csv").write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
        names = ", ".join(f'"{name}"' for name in markers)
        files = f'surface = "{folder.name}/{bone}.stl", cluster = "{folder.name}/{bone}_cluster.stl"'
        model = f'mesh = "{folder.name}/{bone}_model.stl", picked = "{folder.name}/{bone}_points.csv"'
        entries.append(f'  {{ bone = "{bone}", {files}, markers = [{names}], {model}, unit = "mm" }}')
    return "[\n" + ",\n".join(entries) + ",\n]"


def bone_of(specimen: Specimen, bone: str) -> Surface:
    """The surface of a bone in its body's frame [m], from the package of the model."""
    for mesh in specimen.model.body(bone).meshes:
        if mesh.file.endswith(f"/{BONES[bone]}"):
            found = read_mesh(Path(specimen.model.source).parent / mesh.file)
            whole = trimesh.Trimesh(mesh.pose.apply(mesh.scale * found.vertices), found.faces)
            return Surface(np.asarray(whole.vertices), np.asarray(whole.faces))
    raise BadModel(f"model '{specimen.model.name}': body '{bone}' has no mesh '{BONES[bone]}'")


def _ends(bone: Surface) -> Array:
    """(5, 3) vertices that lie farthest out along the bone's principal axes."""
    away = bone.vertices - bone.vertices.mean(axis=0)
    axes = np.linalg.svd(away, full_matrices=False)[2]
    along = away @ axes.T
    rows = [
        along[:, 0].argmax(),
        along[:, 0].argmin(),
        along[:, 1].argmax(),
        along[:, 1].argmin(),
        along[:, 2].argmax(),
    ]
    return bone.vertices[rows]


def _write_stl(vertices: Array, faces: np.ndarray, path: Path) -> None:
    trimesh.Trimesh(vertices, faces, process=False).export(str(path))
