"""`run-tool` against OpenSim's own tools.

Each runs from the same setup file in a copy of the same folder.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import opensim
from scipy.optimize import least_squares

import myomorph as mm
from benchmarks.opensim_tools import read_table
from myomorph.core.io.osim.setup_parts import read_ik_tasks
from myomorph.exchange.opensim.run import run_tool

opensim.Logger.setLevelString("Off")

SCALER = """<OpenSimDocument Version="40000"><ScaleTool name="walker"><mass>74.5</mass>\
<GenericModelMaker>
<model_file>Rajagopal2016.osim</model_file><marker_set_file>markerset_walk_preScale.xml</marker_set_file>
</GenericModelMaker><ModelScaler><apply>true</apply>\
<scaling_order>manualScale measurements</scaling_order>
<MeasurementSet><objects>{measurements}</objects></MeasurementSet>
<ScaleSet><objects><Scale><scales>1.21 1.178 1.21</scales><segment>torso</segment>\
<apply>true</apply></Scale></objects>
</ScaleSet><marker_file>static_walk_2.trc</marker_file><time_range>0.02 0.113</time_range>
<preserve_mass_distribution>false</preserve_mass_distribution>
<output_model_file>walker_scaled.osim</output_model_file><output_scale_file>walker_factors.xml</output_scale_file>
</ModelScaler><MarkerPlacer><apply>true</apply><IKTaskSet><objects>{tasks}</objects></IKTaskSet>
<marker_file>static_walk_2.trc</marker_file><time_range>0.02 0.113</time_range>
<output_model_file>walker_placed.osim</output_model_file><output_motion_file>walker_pose.mot</output_motion_file>
</MarkerPlacer></ScaleTool></OpenSimDocument>
"""
MEASUREMENT = """<Measurement name="{name}"><apply>true</apply><MarkerPairSet>\
<objects>{pairs}</objects></MarkerPairSet>
<BodyScaleSet><objects>{bodies}</objects></BodyScaleSet></Measurement>"""
PAIR = "<MarkerPair><markers>{} {}</markers></MarkerPair>"
BODY = '<BodyScale name="{}"><axes>{}</axes></BodyScale>'
TASK = '<IKMarkerTask name="{}"><apply>true</apply><weight>{}</weight></IKMarkerTask>'
LENGTHS = (
    ("pelvis width", ("R.ASIS L.ASIS",), ("pelvis",), "Z"),
    ("pelvis depth", ("R.ASIS R.PSIS", "L.ASIS L.PSIS"), ("pelvis",), "X Y"),
    (
        "thigh",
        ("R.ASIS R.Knee", "L.ASIS L.Knee"),
        ("femur_r", "femur_l", "patella_r", "patella_l"),
        "X Y Z",
    ),
    ("shank", ("R.Knee R.Ankle", "L.Knee L.Ankle"), ("tibia_r", "tibia_l"), "Y"),
    (
        "foot",
        ("R.Heel R.Toe", "L.Heel L.Toe"),
        ("talus_r", "calcn_r", "toes_r", "talus_l", "calcn_l", "toes_l"),
        "X",
    ),
    (
        "upper arm",
        ("R.Shoulder R.Elbow", "L.Shoulder L.Elbow"),
        ("humerus_r", "humerus_l"),
        "X Y Z",
    ),
    ("not recorded", ("Head R.Shoulder",), ("torso",), "Y"),
)


@dataclass(frozen=True)
class ScaleCase:
    """Files of the data collection, copied into one folder, and the setup that is run there.

    `outputs`: names of the scaled model, the model with placed markers, and the pose; `tasks`:
    where the benchmark writes the setup itself, the file whose weights it takes; `edits`: changes
    of the setup, so that both steps and the pose are written.
    """

    name: str
    setup: str
    files: tuple[str, ...]
    outputs: tuple[str, str, str]
    tasks: str = ""
    edits: tuple[tuple[str, str], ...] = ()


GAIT = "opensim-gait-subject01/"
SUBJECT01 = ("subject01_scaledOnly.osim", "subject01_simbody.osim", "subject01_static_output.mot")
RAJAGOPAL = tuple(
    f"rajagopal-walk-emg/raw/{name}"
    for name in ("Rajagopal2016.osim", "markerset_walk_preScale.xml", "static_walk_2.trc")
)


def rajagopal_setup(weights: Mapping[str, float]) -> str:
    """Return a setup with what the others lack.

    Those are separate axes, both orders, a measurement that cannot be used, and mass by volume.
    """
    measurements = (
        MEASUREMENT.format(
            name=name,
            pairs="".join(PAIR.format(*pair.split()) for pair in pairs),
            bodies="".join(BODY.format(body, axes) for body in bodies),
        )
        for name, pairs, bodies, axes in LENGTHS
    )
    tasks = (TASK.format(name, weight) for name, weight in weights.items())
    return SCALER.format(measurements="".join(measurements), tasks="".join(tasks))


CASES = (
    ScaleCase(
        name="gait2354, OpenSim's own example",
        setup="subject01_Setup_Scale.xml",
        files=(
            f"{GAIT}ref_scale/subject01_Setup_Scale.xml",
            f"{GAIT}ref_scale/gait2354_simbody.osim",
            f"{GAIT}ref_scale/gait2354_Scale_MarkerSet.xml",
            f"{GAIT}experiment/subject01_static.trc",
        ),
        outputs=SUBJECT01,
    ),
    ScaleCase(
        name="gait2354, tutorial's setup",
        setup="gait2354_Setup_Scale.xml",
        files=tuple(
            f"{GAIT}experiment/{name}"
            for name in (
                "gait2354_Setup_Scale.xml",
                "gait2354_simbody.osim",
                "gait2354_Scale_MarkerSet.xml",
                "subject01_static.trc",
            )
        ),
        outputs=SUBJECT01,
    ),
    ScaleCase(
        name="full body, 25 bodies, a laboratory's own setup",
        setup="wholebody.xml",
        files=(
            "c3d-functional-joints/models/wholebody.xml",
            "c3d-functional-joints/models/wholebody.osim",
            "c3d-functional-joints/static.trc",
        ),
        outputs=("scaled_only.osim", "scaled.osim", "pose.mot"),
        edits=(
            ("<output_model_file>scaled.osim", "<output_model_file>scaled_only.osim"),
            ("<output_motion_file>Unassigned", "<output_motion_file>pose.mot"),
        ),
    ),
    ScaleCase(
        name="Rajagopal2016, setup of this benchmark",
        setup="walker_Setup_Scale.xml",
        files=RAJAGOPAL,
        outputs=("walker_scaled.osim", "walker_placed.osim", "walker_pose.mot"),
        tasks="rajagopal-walk-emg/raw/scale_setup_walk.xml",
    ),
)


@contextmanager
def inside(folder: Path) -> Iterator[None]:
    """Work in a folder, as OpenSim's tools want it."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def prepare(data: Path, case: ScaleCase, folder: Path) -> Path:
    """Copy a case's files into a folder; returns the setup."""
    folder.mkdir()
    for name in case.files:
        shutil.copy(data / name, folder)
    setup = folder / case.setup
    if case.tasks:
        setup.write_text(rajagopal_setup(read_ik_tasks(data / case.tasks).marker_weights))
    for before, after in case.edits:
        # The copy keeps the read-only mode of the collection.
        setup.chmod(0o644)
        setup.write_text(setup.read_text().replace(before, after, 1))
    return setup


def largest(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Return the largest difference of the members of any pair.

    Parameters
    ----------
    pairs : arrays of one shape each

    Returns
    -------
    0 where there is none
    """
    return max(
        (float(np.max(np.abs(np.asarray(a) - np.asarray(b)), initial=0.0)) for a, b in pairs),
        default=0.0,
    )


def compare_models(ours: mm.Model, theirs: mm.Model) -> dict[str, float]:
    """Return the largest differences of two models.

    They are of joints [m], masses relative to the whole, inertias relative to the body's, and
    fibers.
    """
    mine = {joint.child: joint for joint in ours.joints}
    other = {joint.child: joint for joint in theirs.joints}
    places = [
        (getattr(mine[name], frame).translation, getattr(other[name], frame).translation)
        for name in mine
        for frame in ("parent_frame", "child_frame")
    ]
    bodies = [(body, theirs.body(body.name)) for body in ours.bodies if body.mass > 0.0]
    fibers = [
        (
            np.array([one.optimal_fiber_length, one.tendon_slack_length]),
            np.array(
                [
                    theirs.muscle(one.name).optimal_fiber_length,
                    theirs.muscle(one.name).tendon_slack_length,
                ]
            ),
        )
        for one in ours.muscles
    ]
    return {
        "joints [m]": largest(places),
        "masses / body mass": max(abs(a.mass - b.mass) for a, b in bodies) / theirs.mass,
        "mass centers [m]": largest([(a.mass_center, b.mass_center) for a, b in bodies]),
        "inertias, relative": max(
            largest([(a.inertia, b.inertia)]) / np.abs(b.inertia).max() for a, b in bodies
        ),
        "fibers and tendons [m]": largest(fibers),
    }


def marker_distances(ours: mm.Model, theirs: mm.Model) -> np.ndarray:
    """Return the distance of each marker in its body.

    Parameters
    ----------
    ours, theirs : models with the same markers

    Returns
    -------
    (markers,) in the order of ours [m]

    Raises
    ------
    ValueError
        where the sets of markers differ, or a marker is on another body
    """
    if set(ours.marker_names) != set(theirs.marker_names):
        raise ValueError(f"other markers: {set(ours.marker_names) ^ set(theirs.marker_names)}")
    pairs = [(one, theirs.marker(one.name)) for one in ours.markers]
    if any(a.body != b.body for a, b in pairs):
        raise ValueError("a marker is on another body")
    return np.array([np.linalg.norm(a.location - b.location) for a, b in pairs])


def minimum_of_opensim(
    setup: Path, scaled: Path, start_pose: dict[str, float]
) -> dict[str, np.ndarray]:
    """Return markers at the pose that minimizes the placer's cost.

    The cost is, over OpenSim's own kinematics, by SciPy from OpenSim's result,

        sum_m w_m |x_m(q) - y_m|^2 / sum_m w_m + sum_j v_j (q_j - default_j)^2

    Parameters
    ----------
    setup : file of the ScaleTool
    scaled : model with scaled segments, in the same folder
    start_pose : coordinates by name [rad or m]

    Returns
    -------
    (3,) location in its body [m], by marker
    """
    with inside(setup.parent):
        tool = opensim.ScaleTool(setup.name)
        placer = tool.getMarkerPlacer()
        model = opensim.Model(scaled.name)
        seen = _mean_markers(placer)
        used = _task_weights(placer)
    state = model.initSystem()
    markers = {one.getName(): one for one in model.getMarkerSet() if one.getName() in seen}
    weights = {name: weight for name, weight in used.items() if name in markers}
    total = sum(weights.values())
    shares = {name: np.sqrt(weight / total) for name, weight in weights.items()}
    coordinates = _free_coordinates(model, state)
    aims = [
        (i, np.sqrt(used[one.getName()]), one.getDefaultValue())
        for i, one in enumerate(coordinates)
        if one.getName() in used
    ]

    def residuals(q: np.ndarray) -> np.ndarray:
        for one, value in zip(coordinates, q, strict=True):
            one.setValue(state, float(value), False)
        model.realizePosition(state)
        places = {name: markers[name].getLocationInGround(state).to_numpy() for name in shares}
        parts = [share * (places[name] - seen[name]) for name, share in shares.items()]
        return np.concatenate([*parts, [weight * (q[i] - rest) for i, weight, rest in aims]])

    first = np.array([start_pose[one.getName()] for one in coordinates])
    residuals(_minimum(residuals, first, _bounds(coordinates, state)))
    return {name: _in_body(model, state, marker, seen[name]) for name, marker in markers.items()}


def _free_coordinates(model: opensim.Model, state: opensim.State) -> list[opensim.Coordinate]:
    """Return the coordinates that are neither locked nor dependent."""
    return [
        one
        for one in model.getCoordinateSet()
        if not one.getLocked(state) and not one.isDependent(state)
    ]


def _mean_markers(placer: opensim.MarkerPlacer) -> dict[str, np.ndarray]:
    """Return the mean position (3,) of each marker in the placer's time range [m]."""
    start = placer.getTimeRange().get(0)
    end = placer.getTimeRange().get(1)
    table = opensim.TimeSeriesTableVec3(placer.getMarkerFileName())
    times = table.getIndependentColumn()
    row = table.averageRow(max(start, times[0]), min(end, times[-1]))
    size = {"mm": 0.001, "m": 1.0}[table.getTableMetaDataString("Units")]
    return {name: row[i].to_numpy() * size for i, name in enumerate(table.getColumnLabels())}


def _task_weights(placer: opensim.MarkerPlacer) -> dict[str, float]:
    """Return the weights of the tasks that are applied, by marker or coordinate."""
    tasks = [placer.getIKTaskSet().get(i) for i in range(placer.getIKTaskSet().getSize())]
    return {
        one.getName(): one.getWeight() for one in tasks if one.getApply() and one.getWeight() > 0.0
    }


def _bounds(
    coordinates: list[opensim.Coordinate], state: opensim.State
) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper bounds of coordinates, infinite where they are not clamped."""
    clamped = np.array([one.getClamped(state) for one in coordinates])
    low = np.where(clamped, [one.getRangeMin() for one in coordinates], -np.inf)
    high = np.where(clamped, [one.getRangeMax() for one in coordinates], np.inf)
    return low, high


def _minimum(
    residuals: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    low, high = bounds
    return least_squares(
        residuals,
        np.clip(start, low + 1e-9, high - 1e-9),
        "3-point",
        (low, high),
        ftol=1e-15,
        xtol=1e-13,
        gtol=1e-13,
        max_nfev=400,
    ).x


def _in_body(
    model: opensim.Model, state: opensim.State, marker: opensim.Marker, place: np.ndarray
) -> np.ndarray:
    """Return where a position (3,) in ground is in the body of a marker [m]."""
    station = opensim.Vec3(*place)
    body = marker.getParentFrame().findBaseFrame()
    return model.getGround().findStationLocationInAnotherFrame(state, station, body).to_numpy()


def pose_of(path: Path) -> dict[str, float]:
    """Coordinates of a file of states."""
    _, names, values = read_table(path)
    return {
        name.split("/")[-2]: float(value)
        for name, value in zip(names, values[0], strict=True)
        if "/value" in name
    }


def measure_case(data: Path, case: ScaleCase) -> dict[str, object]:
    """Compare the models of both programs.

    The differences of both from the minimum of the cost that they share are in the row too.
    """
    with tempfile.TemporaryDirectory() as work:
        mine = prepare(data, case, Path(work) / "ours")
        other = prepare(data, case, Path(work) / "theirs")
        with inside(other.parent):
            opensim.ScaleTool(other.name).run()
        run_tool(mine)
        scaled, placed, pose = case.outputs
        differences = compare_models(
            mm.read_model(mine.parent / scaled), mm.read_model(other.parent / scaled)
        )
        ours = mm.read_model(mine.parent / placed)
        theirs = mm.read_model(other.parent / placed)
        best = minimum_of_opensim(other, other.parent / scaled, pose_of(other.parent / pose))
        free = [one.name for one in ours.markers if not one.fixed]
        row: dict[str, object] = {
            "case": case.name,
            **differences,
            "markers scaled": largest_distance(
                mm.read_model(mine.parent / scaled), mm.read_model(other.parent / scaled)
            ),
            "markers placed, from OpenSim's [mm]": 1000.0 * largest_distance(ours, theirs),
        }
        for name, model in (("ours", ours), ("OpenSim's", theirs)):
            apart = [
                np.linalg.norm(model.marker(one).location - best[one])
                for one in free
                if np.isfinite(best[one]).all()
            ]
            row[f"{name} from the minimum [mm]"] = 1000.0 * float(np.max(apart))
    return row


def largest_distance(ours: mm.Model, theirs: mm.Model) -> float:
    """Largest distance of a marker in its body [m]."""
    return float(marker_distances(ours, theirs).max())


@dataclass(frozen=True)
class ToolCase:
    """A setup file run in a copy of its folder, and the table of another version of OpenSim.

    `files`: beside those of its folder; `outputs`: ours, relative to the setup's folder, and the
    expected tables of the collection; `tag`: what the setup calls its tool, where that has to be
    corrected.
    """

    name: str
    setup: str
    outputs: tuple[tuple[str, str], ...]
    files: tuple[str, ...] = ()
    tag: tuple[str, str] = ("", "")


SMALL = "opensim-reference-small/"
TOOL_CASES = (
    ToolCase(
        "InverseKinematicsTool, gait2354, simulated markers [degrees, m]",
        f"{GAIT}ref_ik/subject01_Setup_InverseKinematics.xml",
        (("subject01_walk1_ik_test.mot", f"{GAIT}ref_ik/std_subject01_walk1_ik.mot"),),
        tag=("InverseKinemtaticsTool", "InverseKinematicsTool"),
    ),
    ToolCase(
        name="AnalyzeTool, StaticOptimization, 18 muscles [1, N, N m]",
        setup=f"{GAIT}ref_so_10dof18musc/staticoptimization_spring_Setup.xml",
        outputs=tuple(
            (f"ResultsSO_spring/{stem}", f"{GAIT}ref_so_10dof18musc/std_{stem}")
            for stem in (
                "walk_subject01_ankle_spring_StaticOptimization_activation.sto",
                "walk_subject01_ankle_spring_StaticOptimization_force.sto",
            )
        ),
        files=(f"{GAIT}ref_rra/subject01_walk1_grf.mot",),
    ),
)
"""Inverse dynamics is compared with a run of OpenSim: the table in the collection is of another
time range.
"""


def measure_tools(data: Path) -> Iterator[dict[str, object]]:
    """Rows of `TOOL_CASES`, and inverse dynamics against OpenSim 4.6 on the same setup."""
    for case in TOOL_CASES:
        with tempfile.TemporaryDirectory() as work:
            setup = copy_folder(data, case.setup, case.files, Path(work) / "ours")
            setup.write_text(
                setup.read_text().replace(*case.tag) if case.tag[0] else setup.read_text()
            )
            run_tool(setup)
            for ours, expected in case.outputs:
                yield {"case": case.name, **compare_tables(setup.parent / ours, data / expected)}
    with tempfile.TemporaryDirectory() as work:
        name = f"{GAIT}ref_id/subject01_Setup_InverseDynamics.xml"
        mine = copy_folder(data, name, (), Path(work) / "ours")
        other = copy_folder(data, name, (), Path(work) / "theirs")
        run_tool(mine)
        with inside(other.parent):
            opensim.InverseDynamicsTool(other.name).run()
        tables = (
            setup.parent / "Results" / "subject01_InverseDynamics.sto" for setup in (mine, other)
        )
        yield {
            "case": "InverseDynamicsTool, gait2354, filtered at 6 Hz [N m, N]",
            **compare_tables(*tables),
        }


def copy_folder(data: Path, setup: str, files: tuple[str, ...], folder: Path) -> Path:
    """Copy a setup's folder with further files, and return the setup."""
    shutil.copytree(data / Path(setup).parent, folder)
    for name in files:
        shutil.copy(data / name, folder)
    return folder / Path(setup).name


def compare_tables(ours: Path, theirs: Path) -> dict[str, object]:
    """Root mean square and largest difference over the columns that both have, frame by frame."""
    time, names, values = read_table(ours)
    their_time, their_names, their_values = read_table(theirs)
    if len(time) != len(their_time) or np.abs(time - their_time).max() > 1e-3:
        raise ValueError(f"{ours} and {theirs} are of other frames")
    shared = [name for name in names if name in their_names]
    apart = (
        values[:, [names.index(one) for one in shared]]
        - their_values[:, [their_names.index(one) for one in shared]]
    )
    frame, column = np.unravel_index(int(np.abs(apart).argmax()), apart.shape)
    return {
        "table": ours.name,
        "frames": len(time),
        "columns": len(shared),
        "RMS": float(np.sqrt(np.mean(apart**2))),
        "largest": float(np.abs(apart[frame, column])),
        "where": shared[column],
    }


def measure(data: Path) -> Iterator[dict[str, object]]:
    """Rows of all cases."""
    for case in CASES:
        yield measure_case(data, case)
