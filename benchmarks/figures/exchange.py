"""Figures of exchange: `python -m benchmarks.figures opensim-torques`, `mujoco-arms`."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension.knee import command
from benchmarks.figures.page import legend, page, zero_lines
from data_collection import data_folder
from myomorph.core.rigid.tree import compile_tree
from myomorph.exchange.mujoco.copy import MujocoCopy
from myomorph.exchange.mujoco.export import in_copy, mujoco_model
from myomorph.exchange.mujoco.joints import routes

INK = "#222222"
GREY = "#bbbbbb"
JOINTS = ("hip_flexion_r", "knee_angle_r", "ankle_angle_r")
MUSCLES = ("rect_fem_r", "bifemsh_r", "med_gas_r")
"""Muscles whose moment arms about the knee are drawn."""
KNEE = "knee_angle_r"
POSES = 61


def draw_torques(file: Path) -> None:
    """Torques of a leg by OpenSim's own table and by `run-tool` on the same setup file."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "ref_id"
        shutil.copytree(data_folder() / "opensim-gait-subject01" / "ref_id", folder)
        command("run-tool", folder / "subject01_Setup_InverseDynamics.xml")
        ours = mm.read_sto(folder / "Results" / "subject01_InverseDynamics.sto")
        theirs = mm.read_sto(folder / "std_subject01_InverseDynamics.sto")
    part = theirs.time >= ours.time[0]
    with page(file, 1, len(JOINTS), (9.0, 2.6), span=(0.0, 0.88)) as (figure, axes):
        for axis, joint in zip(axes, JOINTS, strict=True):
            torque = theirs[f"{joint}_moment"]
            axis.plot(theirs.time[part], torque[part], color=GREY, lw=4, label="OpenSim")
            axis.plot(ours.time, ours[f"{joint}_moment"], color=INK, lw=1, label="Myomorph")
            axis.set_title(joint, fontsize=9)
            axis.set_xlabel("time [s]")
        axes[0].set_ylabel("torque [N m]")
        zero_lines(axes)
        legend(figure, axes[0], 2)


def draw_arms(file: Path) -> None:
    """Moment arms about a knee in a model and in its copy for MuJoCo."""
    path = data_folder() / "opensim-gait-subject01" / "ref_id" / "subject01.osim"
    model = mm.read_model(path)
    angles = np.linspace(-2.0, 0.0, POSES)
    poses = np.tile(compile_tree(model).defaults, (POSES, 1))
    knee = model.coordinate_names.index(KNEE)
    poses[:, knee] = angles
    motion = mm.differentiate(mm.Motion(angles - angles[0], model.coordinate_names, poses))
    ours = mm.muscle_kinematics(model, motion)
    with tempfile.TemporaryDirectory() as name:
        copied = Path(name) / "copy.xml"
        mm.write_mjcf(model, copied)
        made, _, _ = mujoco_model(model)
        copy = MujocoCopy(copied, made)
        route = routes(model, poses, np.full(POSES, knee))
        _, arms = copy.lengths_and_arms(in_copy(made, model, poses), route)
    with page(file, 1, len(MUSCLES), (9.0, 2.6), span=(0.0, 0.88)) as (figure, axes):
        for axis, muscle in zip(axes, MUSCLES, strict=True):
            theirs = arms[:, model.muscle_names.index(muscle), copy.free.index(KNEE)]
            axis.plot(
                np.degrees(angles),
                1e3 * ours.moment_arm_of(muscle, KNEE),
                color=GREY,
                lw=4,
                label="model",
            )
            axis.plot(np.degrees(angles), 1e3 * theirs, color=INK, lw=1, label="in MuJoCo")
            axis.set_title(muscle, fontsize=9)
            axis.set_xlabel("knee angle [degrees]")
        axes[0].set_ylabel("moment arm [mm]")
        legend(figure, axes[0], 2)
