"""Accuracy of what comes before identification.

Measured are force plate, clocks, scanned bones, and a real instrumented handle.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.core.contact.plate_placements import MarkedWeight, Placement, find_placements
from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.model.arrays import Array
from myomorph.core.model.series import PlateRecording
from myomorph.core.model.spatial import axis_rotation, rotation_from_euler_xyz, vector_from_rotation
from myomorph.core.motion.splines import natural_spline
from myomorph.core.surfaces.clusters import surface_parts
from myomorph.core.surfaces.linear_maps import Similarity
from myomorph.core.surfaces.rigid_registration import register_surface
from myomorph.swings.plate_calibration import calibrate_plate, nominal_pose
from myomorph.swings.plate_pose import LineResiduals, Misfits
from myomorph.swings.viscosity.swings.plate import wrench_clock
from truths.handle_sensor import HandleForce, fit_handle, grip_point, object_motion
from truths.plate_checks import check_plate, pose_deviations

Row = dict[str, object]

RUNS = 25
GRAVITY = np.array([0.0, 0.0, -9.80665])
NINE = [(x, y) for x in (-0.15, 0.0, 0.15) for y in (-0.25, 0.0, 0.25)]
AXES = axis_rotation((0, 0, 1), 0.7) @ rotation_from_euler_xyz((np.pi + 0.01, 0.005, 0.0))
CENTER = np.array([0.4, -0.2, 0.01])


def measure_plates() -> Iterator[Row]:
    """Plate poses from simulated placements, and the worth of their deviations and their check."""
    for name, pushed, places in (
        ("20 kg weight, 9 places", False, NINE),
        ("20 kg weight, 4 places", False, [NINE[k] for k in (0, 2, 6, 8)]),
        ("5 kg weight, 9 places", False, NINE),
        ("rod, 9 pushes", True, NINE),
        ("rod, 27 pushes", True, 3 * NINE),
    ):
        mass = 5.0 if name.startswith("5") else 20.0
        found = [calibrate_plate(placements_of(places, seed, mass, pushed)) for seed in range(RUNS)]
        turns = np.array([vector_from_rotation(one.rotation @ AXES.T) for one in found])
        shifts = np.array([one.center - CENTER for one in found])
        shown = np.isfinite(pose_deviations(found[0])[3:])
        stated = np.array([pose_deviations(one) for one in found])[:, [True, True, True, *shown]]
        errors = np.hstack([turns, shifts[:, shown]])
        yield {
            "placements (simulated)": name,
            "place in the plane, rms [mm]": 1e3 * float(np.sqrt(np.mean(shifts[:, :2] ** 2))),
            "height, rms [mm]": (
                1e3 * float(np.sqrt(np.mean(shifts[:, 2] ** 2))) if shown[2] else "not shown"
            ),
            "axes, rms [°]": float(np.degrees(np.sqrt(np.mean(turns**2)))),
            "residual [mm]": 1e3 * float(np.mean([one.distance_rms for one in found])),
            "left out [mm]": (
                1e3 * float(np.mean([np.sqrt(np.mean(one.left_out_distances**2)) for one in found]))
            ),
            "error over estimated SD": float(
                np.sqrt(np.mean(np.mean(errors**2, axis=0) / np.mean(stated**2, axis=0)))
            ),
            "5 mm found significant": f"{_found_off(places, mass, pushed)} of {RUNS}",
            "right one called off": f"{_found_off(places, mass, pushed, off=False)} of {RUNS}",
        }


def _found_off(
    places: list[tuple[float, float]], mass: float, pushed: bool, off: bool = True
) -> int:
    corners = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) * [0.2, 0.3, 0.0]
    shift = np.array([0.005, 0.0, 0.0]) if off else np.zeros(3)
    plate = PlateRecording(
        name="plate",
        kind=2,
        corners=corners @ AXES.T + CENTER + shift,
        origin=np.zeros(3),
        channels=np.zeros((1, 6)),
    )
    return sum(
        check_plate(plate, placements_of(places, 100 + seed, mass, pushed)).significant
        for seed in range(RUNS)
    )


def placements_of(
    places: list[tuple[float, float]], seed: int, mass: float, pushed: bool
) -> list[Placement]:
    """Noise of a placement's means: 0.3 N, 0.05 N m, 0.5 mm, and 1 mrad of a rod's direction."""
    random = np.random.default_rng(seed)
    found = []
    for number, place in enumerate(places):
        foot = CENTER + AXES @ np.array([*place, 0.0])
        up = np.array([0.0, 0.0, 1.0])
        size = mass * 9.80665
        if pushed:
            tilt = random.uniform(0.2, 0.5)
            turn = random.uniform(0, 2 * np.pi)
            up = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
            size = random.uniform(100, 300)
        force = size * AXES.T @ up
        moment = np.cross(AXES.T @ (foot - CENTER), force)
        found.append(
            Placement(
                name=f"{number}",
                force=force + 0.3 * random.normal(size=3),
                moment=moment + 0.05 * random.normal(size=3),
                point=foot + 0.1 * up + 0.0005 * random.normal(size=3),
                direction=up + (1e-3 * random.normal(size=3) if pushed else 0.0),
                pushed=pushed,
            )
        )
    return found


def measure_standing(folder: Path) -> Iterator[Row]:
    """Calibrate a plate by a person who stands still on it as a marked weight.

    Plug-in Gait's center of mass, and gravity, are the reference.
    """
    for person, name in (("HC030A", "HC030A01"), ("HC002D", "HC002D02")):
        path = folder / f"c3d-gait-plugingait/{person}/Static/{name}.c3d"
        if not path.is_file():
            continue
        trial = read_c3d(path)
        plate = trial.plate_recordings[0]
        mass = float(trial.facts["body mass"].split()[0])
        weight = MarkedWeight("person", ("CentreOfMass",), mass=mass)
        whole = [(float(trial.markers.time[0]), float(trial.markers.time[-1]))]
        one = find_placements(plate, trial.plate_time, trial.markers, weight, whole)[0]
        misfits = Misfits.of(LineResiduals.of([one]).unweighted(nominal_pose(plate)))
        yield {
            "recording (real)": path.stem,
            "seconds": whole[0][1] - whole[0][0],
            "force [N]": one.size,
            "body weight [N]": one.expected,
            "line of action past the center of mass [mm]": 1e3 * float(misfits.distances[0]),
            "force against the vertical [°]": float(np.degrees(misfits.angles[0])),
            "sway of the center of mass [mm]": 1e3 * one.moved,
        }


def measure_clocks() -> Iterator[Row]:
    """Find offset and drift of a plate under a spherical pendulum by its regressor.

    MuJoCo swings the pendulum.
    """
    time, rotations = _swing()
    phi = _parameters()
    wrench = _base_rows(time, rotations) @ phi
    spline = natural_spline(time, wrench, degree=3)
    for name, force, angle, offset, drift in (
        ("no noise", 0.0, 0.0, 0.0123, 40e-6),
        ("0.3 N, 0.3 mrad", 0.3, 3e-4, 0.0123, 40e-6),
        ("0.3 N, 0.3 mrad", 0.3, 3e-4, -0.4, -150e-6),
        ("1 N, 1 mrad", 1.0, 1e-3, 0.0123, 40e-6),
    ):
        errors = []
        stated = []
        for seed in range(10):
            clock = wrench_clock(*_recorded(rotations, spline, offset, drift, seed, force, angle))
            errors.append((clock.offset - offset - drift * clock.epoch, clock.drift - drift))
            stated.append((clock.offset_sd, clock.drift_sd))
        rms = np.sqrt(np.mean(np.square(errors), axis=0))
        usual = np.mean(stated, axis=0)
        bound = _bound(time, wrench, force)
        yield {
            "noise (simulated)": name,
            "offset [ms]": 1e3 * offset,
            "drift [ppm]": 1e6 * drift,
            "offset, rms error [ms]": 1e3 * float(rms[0]),
            "estimated SD [ms]": 1e3 * float(usual[0]),
            "Cramér-Rao bound [ms]": 1e3 * bound[0],
            "drift, rms error [ppm]": 1e6 * float(rms[1]),
            "estimated SD [ppm]": 1e6 * float(usual[1]),
            "Cramér-Rao bound [ppm]": 1e6 * bound[1],
        }


def _bound(time: Array, wrench: Array, force: float) -> tuple[float, float]:
    """Return deviations that the plate's white noise alone sets (Cramer-Rao).

    The motion is known exactly.
    """
    slopes = np.gradient(wrench, time[1], axis=0)[1000:61000]
    slopes = slopes / np.repeat([max(0.1 * force, 1e-12), max(force, 1e-12)], 3)
    away = (time[1000:61000] - 15.5)[:, None]
    return float(np.sum(slopes**2) ** -0.5), float(np.sum((slopes * away) ** 2) ** -0.5)


def _swing() -> tuple[Array, Array]:
    """Orientations (steps, 3, 3) of a ball pendulum every half millisecond, 31 s."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.0005" integrator="RK4"/><worldbody><body><joint type="ball"'
        ' damping="0.05"/><inertial pos="0.01 0.02 -0.4" mass="2.5" diaginertia="0.06 0.065'
        ' 0.01"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qpos[:] = [np.cos(0.5), 0.8 * np.sin(0.5), 0.6 * np.sin(0.5), 0.0]
    data.qvel[:] = [0.3, -0.6, 0.5]
    rotations = np.empty((62000, 3, 3))
    for rotation in rotations:
        mujoco.mj_step(model, data)
        mujoco.mju_quat2Mat(rotation.reshape(-1), data.qpos)
    return 0.0005 * np.arange(len(rotations)), rotations


PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))


def _parameters() -> Array:
    """Mass, first and second moments of mass of the pendulum about its pivot."""
    middle = np.array([0.01, 0.02, -0.4])
    mass = 2.5
    second = np.diag(0.0675 - np.array([0.06, 0.065, 0.01])) + mass * np.outer(middle, middle)
    return np.concatenate([[mass], mass * middle, [second[i, j] for i, j in PAIRS]])


def _base_rows(time: Array, rotations: Array) -> Array:
    """Moment and force (frames, 6, 10) on the pivot: every mass dm at x pulls with g - R'' x."""
    bent = (
        natural_spline(time, rotations.reshape(len(time), 9)).derivative(2)(time).reshape(-1, 3, 3)
    )
    gravity = np.array([0.0, 0.0, -9.81])
    rows = np.zeros((len(time), 6, 10))
    rows[:, 3:, 0] = gravity
    for k in range(3):
        rows[:, 3:, 1 + k] = -bent[:, :, k]
        rows[:, :3, 1 + k] = np.cross(rotations[:, :, k], gravity)
    for column, (i, j) in enumerate(PAIRS):
        moment = np.cross(rotations[:, :, i], bent[:, :, j])
        rows[:, :3, 4 + column] = -(
            moment if i == j else moment + np.cross(rotations[:, :, j], bent[:, :, i])
        )
    return rows


def _recorded(
    rotations: Array,
    spline: object,
    offset: float,
    drift: float,
    seed: int,
    force: float,
    angle: float,
) -> tuple[Array, Array, Array, Array]:
    """30 s of frames at 200 Hz and of wrenches at 2000 Hz on their own clock."""
    random = np.random.default_rng(seed)
    own = np.arange(0, 30, 0.0005)
    there = spline(0.5 + own + offset + drift * own)  # type: ignore[operator]
    there = there + random.normal(size=there.shape) * np.repeat([0.1 * force, force], 3)
    frames = rotations[1000:61000:10]
    turns = angle * random.normal(size=(len(frames), 3))
    cross = np.zeros((len(frames), 3, 3))
    cross[:, 0, 1] = -turns[:, 2]
    cross[:, 0, 2] = turns[:, 1]
    cross[:, 1, 2] = -turns[:, 0]
    time = 0.005 * np.arange(len(frames))
    return time, _base_rows(time, frames + (cross - np.swapaxes(cross, 1, 2)) @ frames), own, there


def measure_scans(folder: Path) -> Iterator[Row]:
    """Lay scans made of real bone meshes on the models' bones, without picked points."""
    for name, path in _bones(folder):
        bone = mm.read_mesh(path)
        for part, cut, mirrored in (
            ("whole", 0.0, False),
            ("without 40 %", 0.4, False),
            ("of the other side", 0.0, True),
        ):
            places = []
            angles = []
            scales = []
            rms = []
            named = 0
            for seed in range(2 if not mirrored else 1):
                scan, truth = _scan(bone, seed, cut, mirrored)
                found = register_surface(scan, bone)
                named += any("mirrored" in line for line in found.notes)
                apart = found.similarity.apply(scan.vertices) - truth.apply(scan.vertices)
                places.append(np.sqrt(np.mean(np.sum(apart**2, axis=1))))
                angles.append(
                    np.linalg.norm(
                        vector_from_rotation(found.similarity.rotation @ truth.rotation.T)
                    )
                )
                scales.append(abs(found.similarity.scale / truth.scale - 1))
                rms.append(found.rms)
            yield {
                "bone": name,
                "scan (made)": part,
                "place, worst rms [mm]": "" if mirrored else 1e3 * float(max(places)),
                "angle, worst [°]": "" if mirrored else float(np.degrees(max(angles))),
                "size, worst [%]": "" if mirrored else 100 * float(max(scales)),
                "residual [mm]": 1e3 * float(np.mean(rms)),
                "called mirrored": "yes" if named else "no",
            }


def measure_persons(folder: Path) -> Iterator[Row]:
    """Lay bones of two persons from MRI on those of a generic model.

    They are of the same side and of the other.
    """
    for person in ("ICL_MRI", "MC22"):
        for bone in ("femur", "tibia"):
            path = folder / f"bones-mri-two-adults/{person}/{bone}_r.ply"
            if not path.is_file():
                continue
            # The scanner's tibia comes with its fibula, the model's without.
            whole = surface_parts(mm.read_mesh(path))[0]
            scan = mm.Surface(0.001 * whole.vertices, whole.faces)
            for side, word in (("r", "right"), ("l", "left")):
                found = register_surface(
                    scan,
                    mm.read_mesh(folder / f"bones-opensim-rajagopal/Geometry/{side}_{bone}.vtp"),
                )
                yield {
                    "scan (real)": f"{person} right {bone}",
                    "model's bone": f"{word} {bone}",
                    "residual, rms [mm]": 1e3 * found.rms,
                    "half of it within [mm]": 1e3 * found.percentile(50),
                    "95 % of it within [mm]": 1e3 * found.percentile(95),
                    "model over scan": found.similarity.scale,
                    "called mirrored": (
                        "yes" if any("mirrored" in line for line in found.notes) else "no"
                    ),
                }


def _bones(folder: Path) -> Iterator[tuple[str, Path]]:
    geometry = folder / "shoulder-thoracoscapular/model_cmc/Geometry"
    for name in ("rhumerus", "rscapula", "rulna"):
        if (geometry / f"{name}.vtp").is_file():
            yield f"thoracoscapular {name[1:]}", geometry / f"{name}.vtp"
    try:
        import myo_sim
    except ImportError:
        return
    for name in ("humerus",):
        yield f"myo-sim {name}", Path(myo_sim.MODELS_DIR) / "meshes" / f"{name}.stl"


def _scan(bone: mm.Surface, seed: int, cut: float, mirrored: bool) -> tuple[mm.Surface, Similarity]:
    """Make a scan of a bone.

    It is rotated anywhere, 2 % smaller, with 0.3 mm of noise and four times the triangles, perhaps
    cut off or mirrored.
    """
    import trimesh

    random = np.random.default_rng(seed)
    mesh = trimesh.Trimesh(bone.vertices, bone.faces, process=True).subdivide()
    vertices = np.array(mesh.vertices)
    faces = np.array(mesh.faces)
    if mirrored:
        vertices = vertices * [-1.0, 1.0, 1.0]
        faces = faces[:, ::-1]
    if cut:
        along = (
            vertices @ np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)[2][0]
        )
        kept = along < np.quantile(along, 1 - cut)
        used, index = np.unique(faces[kept[faces].all(axis=1)], return_inverse=True)
        vertices = vertices[used]
        faces = index.reshape(-1, 3)
    vertices = vertices + 3e-4 * random.normal(size=vertices.shape)
    back = Similarity(
        rotation_from_euler_xyz(random.uniform(-3, 3, 3)), random.uniform(-0.3, 0.3, 3), 1 / 1.02
    )
    return mm.Surface(back.apply(vertices), faces), back.inverse()


def measure_handle(folder: Path) -> Iterator[Row]:
    """Calibrate the six-axis handle of a lifted box at several cutoffs.

    Measured are voltages, tare, orientation on the box, and clock.
    """
    place = folder / "c3d-shoulder-emg-handle"
    if not (place / "markers_analogs.c3d").is_file():
        return
    trial = read_c3d(place / "markers_analogs.c3d")
    wrench = (
        trial.analog.values[:, :6]
        @ np.loadtxt(place / "forces_calibration_matrix.csv", delimiter=",").T
    )
    markers = trial.markers
    own = trial.analog.time
    tare = wrench[own < 1.0].mean(axis=0)
    wrench = wrench - tare
    names = markers.names[:8]
    corners = np.stack([markers[name][0] for name in names])
    line = corners[2:4].mean(axis=0) - corners[0:2].mean(axis=0)
    held = (markers.time > 2.05) & (markers.time < 3.65)
    lifted = (own > 2.05) & (own < 3.65)
    _, couple = grip_point(wrench[lifted, :3], wrench[lifted, 3:])
    for hands, cutoff, each in (
        ("two", 4.0, line),
        ("two", 6.0, line),
        ("two", 10.0, line),
        ("one", 6.0, None),
    ):
        motion = object_motion(markers, names, cutoff)
        found = fit_handle(motion, held, HandleForce(time=own, values=wrench[:, :3]), GRAVITY, each)
        yield {
            "hands": hands,
            "cut-off [Hz]": cutoff,
            "box rigid within [mm]": 1e3 * float(np.median(motion.residual)),
            "tare, change over the trial [N]": float(
                np.linalg.norm(wrench[own > 4.3, :3].mean(axis=0))
            ),
            "force, rms [N]": float(np.sqrt(np.mean(np.sum(wrench[lifted, :3] ** 2, axis=1)))),
            "unexplained, rms [N]": found.rms,
            "mass carried [kg]": f"{found.share:.2f} ± {found.share_sd:.2f}",
            "sensor's x off the handles' line [°]": float(
                np.degrees(
                    np.arccos(min(1.0, abs(found.rotation[:, 0] @ line) / np.linalg.norm(line)))
                )
            ),
            "orientation ± [°]": float(np.degrees(np.max(found.rotation_sd))),
            "clock offset [ms]": f"{1e3 * found.offset:.0f} ± {1e3 * found.offset_sd:.0f}",
            "couple of the grip, rms [N m]": couple,
        }
