"""Kinematics, tendon lengths and moment arms of MyoFullBody against MuJoCo, frame by frame on one thread."""

from __future__ import annotations

import os

import mujoco
import numpy as np

import myomorph as mm
from benchmarks.speed.timing import alternate, compared
from myomorph.io.mjcf.read import read_mjcf
from myomorph.muscles.path import compile_paths
from myomorph.rigid.tree import compile_tree

FRAMES = 400


def run() -> list[dict[str, object]]:
    """One row: lengths with Jacobian of all 416 muscles."""
    from musclemimic_models import get_xml_path

    path = get_xml_path("myofullbody")
    model = read_mjcf(path)
    theirs = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(theirs)
    rng = np.random.default_rng(0)
    poses = np.tile(theirs.qpos0, (FRAMES, 1))
    for joint in range(theirs.njnt):
        if theirs.jnt_limited[joint]:
            low, high = theirs.jnt_range[joint]
            poses[:, theirs.jnt_qposadr[joint]] = rng.uniform(low, high, FRAMES)
    tree = compile_tree(model)
    paths = compile_paths(model)
    values = np.tile(tree.defaults, (FRAMES, 1))
    for j, coordinate in enumerate(model.coordinates):
        if np.isfinite(coordinate.range).all():
            values[:, j] = rng.uniform(*coordinate.range, FRAMES)
    values = tree.coordinates_of(mm.Motion(np.arange(FRAMES) * 0.01, model.coordinate_names, values))

    def ours() -> None:
        paths.evaluate(values, None)

    def mujoco_loop() -> None:
        for pose in poses:
            data.qpos[:] = pose
            mujoco.mj_kinematics(theirs, data)
            mujoco.mj_comPos(theirs, data)
            mujoco.mj_tendon(theirs, data)

    before = os.environ.get("MYOMORPH_THREADS")
    os.environ["MYOMORPH_THREADS"] = "1"
    try:
        seconds = alternate({"ours": ours, "MuJoCo": mujoco_loop}, rounds=7)
    finally:
        if before is None:
            del os.environ["MYOMORPH_THREADS"]
        else:
            os.environ["MYOMORPH_THREADS"] = before
    name = f"MyoFullBody, {len(model.muscles)} muscles, {len(model.coordinates)} coordinates, one thread"
    return [compared("lengths and moment arms", name, FRAMES, seconds)]
