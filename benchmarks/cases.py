"""The recordings and models that comparisons run on, all from the data collection."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path


def data_folder() -> Path:
    """The data collection: `MYOMORPH_DATA`, or the folder beside the checkout."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    return Path(os.environ.get("MYOMORPH_DATA", beside))


@dataclass(frozen=True)
class MarkerCase:
    """A model and a marker recording, with OpenSim's task set where there is one."""

    name: str
    model: str
    markers: str
    tasks: str = ""
    most_frames: int = 200


@dataclass(frozen=True)
class ForceCase:
    """A model, a motion and external loads ("" for none), cut to [start, end] seconds."""

    name: str
    model: str
    motion: str
    loads: str = ""
    forces: str = ""
    start: float = -1e9
    end: float = 1e9


MARKER_CASES = (
    MarkerCase(
        "gait2354 walk, simulated markers",
        "opensim-gait-subject01/ref_ik/subject01_simbody.osim",
        "opensim-gait-subject01/ref_ik/subject01_synthetic_marker_data.trc",
        "opensim-gait-subject01/ref_ik/gait2354_IK_Tasks_uniform.xml",
    ),
    MarkerCase(
        "gait2354 walk",
        "opensim-gait-subject01/ref_scale/std_subject01_simbody.osim",
        "opensim-gait-subject01/experiment/subject01_walk1.trc",
        "opensim-gait-subject01/ref_ik/gait2354_IK_Tasks.xml",
    ),
    MarkerCase(
        "Rajagopal walk",
        "rajagopal-walk-emg/subject_walk_scaled.osim",
        "rajagopal-walk-emg/markers_walk.trc",
        "rajagopal-walk-emg/ik_tasks_walk.xml",
    ),
    *(
        MarkerCase(
            f"OpenCap {trial}",
            "opencap-subject4-multitask/models/manually_scaled.osim",
            f"opencap-subject4-multitask/markers/{trial}.trc",
        )
        for trial in ("walking1", "STS1", "DJ1", "static1")
    ),
    *(
        MarkerCase(
            f"Hamner {run} (unscaled model)",
            "hamner-run-subject04/unscaled_generic.osim",
            f"hamner-run-subject04/{run}/markers.trc",
        )
        for run in ("run200", "run500")
    ),
    MarkerCase(
        "wholebody static",
        "c3d-functional-joints/models/wholebody.osim",
        "c3d-functional-joints/static.trc",
        most_frames=50,
    ),
    MarkerCase(
        "520 muscles, static",
        "fullbody-many-muscles/cyclistFullBodyMuscle.osim",
        "fullbody-many-muscles/s01_static.trc",
        most_frames=5,
    ),
)

FORCE_CASES = (
    ForceCase(
        "gait2354 walk",
        "opensim-gait-subject01/ref_id/subject01.osim",
        "opensim-gait-subject01/ref_id/subject01_walk1_ik.mot",
        "opensim-gait-subject01/ref_id/subject01_walk1_grf.xml",
    ),
    ForceCase(
        "Rajagopal walk",
        "rajagopal-walk-emg/subject_walk_scaled.osim",
        "rajagopal-walk-emg/coordinates.sto",
        "rajagopal-walk-emg/grf_walk.xml",
        start=0.5,
        end=1.0,
    ),
    *(
        ForceCase(
            f"OpenCap {trial}",
            "opencap-subject4-multitask/models/manually_scaled.osim",
            f"opencap-subject4-multitask/ik_manual_scaling/{trial}_ik.mot",
            f"opencap-subject4-multitask/grf/{trial}_external_forces.xml",
            end=end,
        )
        for trial, end in (("walking1", 1e9), ("STS1", 3.0), ("DJ1", 3.0))
    ),
    ForceCase(
        "walk with EMG, 80 muscles (no loads)",
        "walk-so-jointload-emg/Rajagopal_scaled_Sub1_gasAvoid.osim",
        "walk-so-jointload-emg/results_ik.sto",
        end=3.0,
    ),
    ForceCase(
        "gait2392 treadmill (no loads)", "ceinms-emg-walk/model/gait2392.osim", "ceinms-emg-walk/walk36/ik.sto", end=3.0
    ),
    ForceCase(
        "arm26",
        "opensim-reference-small/arm26_bounds.osim",
        "opensim-reference-small/arm26_InverseKinematics.mot",
    ),
    ForceCase(
        "thoracoscapular shoulder, loop ignored (no loads)",
        "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim",
        "shoulder-thoracoscapular/ik/ABD01.mot",
        end=3.0,
    ),
)
