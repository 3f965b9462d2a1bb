"""Figure of inertial sensors: `python -m benchmarks.figures inertial-angles`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from tests.truths.simulated_sensors import SensorErrors, simulated_sensors

import myomorph as mm
from benchmarks.accuracy.kinematics.inertial import BODIES, WALK
from benchmarks.figures.page import legend, page
from benchmarks.recordings import RECORDINGS
from data_collection import data_folder
from myomorph.body.sensors.sensor_kinematics import sensor_kinematics
from myomorph.body.sensors.sensor_recording import SensorRecording
from myomorph.core.motion.sync import cut
from myomorph.core.rigid.tree import compile_tree

SECONDS = 30.0
SHOWN = 4.0
"""Of the recording, and of it in the figure [s]."""
JOINTS = {"hip_flexion_r": "hip flexion", "knee_angle_r": "knee", "ankle_angle_r": "ankle"}
SEED = 1


def draw(file: Path) -> None:
    """Angles of a leg: the recorded walk, and from eight sensors simulated on it."""
    files = RECORDINGS[WALK]
    model = mm.read_model(data_folder() / files.model)
    recorded = mm.read_motion(data_folder() / files.motion, model)
    coordinates = compile_tree(model).coordinates_of(recorded)
    whole = mm.Motion(recorded.time, model.coordinate_names, coordinates)
    truth = cut(whole, whole.time[0], whole.time[0] + SECONDS)
    made = simulated_sensors(model, truth, BODIES, SensorErrors(), SEED)
    estimate = sensor_kinematics(model, SensorRecording(made.sensors, pose=made.pose)).fit.motion
    part = (truth.time >= truth.time[0] + SHOWN) & (truth.time < truth.time[0] + 2.0 * SHOWN)
    with page(file, 1, len(JOINTS), (9.0, 2.6), span=(0.0, 0.88)) as (figure, axes):
        for axis, (joint, words) in zip(axes, JOINTS.items(), strict=True):
            time = truth.time[part] - truth.time[part][0]
            axis.plot(
                time, np.degrees(truth[joint][part]), color="#bbbbbb", lw=4, label="recorded walk"
            )
            axis.plot(
                time,
                np.degrees(estimate[joint][part]),
                color="#222222",
                lw=1,
                label="from simulated sensors",
            )
            axis.set_title(words, fontsize=9)
            axis.set_xlabel("time [s]")
        axes[0].set_ylabel("angle [degrees]")
        legend(figure, axes[0], 2)
