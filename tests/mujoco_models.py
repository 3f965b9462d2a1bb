"""MuJoCo models that tests hold ours against, and random states of them."""

from __future__ import annotations

import warnings
from functools import lru_cache

import numpy as np
import pytest

from myomorph.core.io.mjcf.read import WIDTHS, _layout, model_from_mujoco, read_mjcf
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import (
    axis_rotation,
    quaternion_from_rotation,
    rotation_from_euler_xyz,
)
from myomorph.core.rigid.dynamics import motion_arrays
from myomorph.core.rigid.tree import compile_tree

mujoco = pytest.importorskip("mujoco")
# MuJoCo writes its warnings into a file in the current folder, unless somebody else takes them.
mujoco.set_mju_user_warning(lambda text: None)

MYO_SIM = (
    "myolegs",
    "myolegs26",
    "myoarm_r",
    "myotorso",
    "myotorso_abdomen",
    "myofullbody",
    "myoelbow",
    "osl",
)
FILES = {
    "mouse arm": "mouse-arm-muscles/akira_muscle.xml",
    "mouse skeleton": "mouse-skeleton-keypoints/mouse_with_meshes.xml",
    "rat": "rat-keypoints/rodent.xml",
}
MODELS = (*MYO_SIM, "MyoFullBody", *FILES)
# Ball, slide and hinge joints in one body, off their origins, with a reference position and a free
# root.
MIXED = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0.3 -1 -9.7"/>
  <default><geom density="900"/></default>
  <worldbody>
    <body name="trunk" pos="0.1 0.2 0.9" quat="0.6 0.5 -0.4 0.3">
      <freejoint name="root"/>
      <geom type="box" size="0.1 0.2 0.3" pos="0.01 0.02 0.03"/>
      <body name="arm" pos="0 0.2 0.3" euler="0.3 0.2 0.1">
        <joint name="out" type="slide" axis="0.6 0 0.8" ref="0.05"/>
        <joint name="shoulder" type="ball" pos="0.02 0.01 -0.03"/>
        <geom type="capsule" size="0.04 0.2" pos="0.1 0 0.2"/>
        <body name="fore" pos="0.1 0 0.4">
          <joint name="elbow" axis="0 1 0" pos="0.03 0 0.01" ref="0.4" range="0.1 2"/>
          <joint name="turn" axis="0.36 0.48 0.8" pos="0 0.02 0"/>
          <geom type="cylinder" size="0.03 0.1" pos="0 0 0.1"/>
          <body name="tip" pos="0 0 0.25"><geom type="ellipsoid" size="0.05 0.03 0.1"/></body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@lru_cache(maxsize=4)
def compiled(name: str) -> object:
    """Return the compiled MuJoCo model of that name; files come from `load`."""
    if name == "mixed":
        return mujoco.MjModel.from_xml_string(MIXED)
    if name == "MyoFullBody":
        package = pytest.importorskip("musclemimic_models")
        return mujoco.MjModel.from_xml_path(str(package.get_xml_path("myofullbody")))
    package = pytest.importorskip("myo_sim")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return package.load_model(name)


def load(name: str, data: object) -> tuple[object, Model]:
    """MuJoCo's model and ours."""
    if name not in FILES:
        m = compiled(name)
        return m, model_from_mujoco(m)
    path = data(FILES[name])
    spec = mujoco.MjSpec.from_file(str(path))
    for geom in [g for g in spec.geoms if g.meshname and not meshes_exist(path)]:
        spec.delete(geom)
    for mesh in [one for one in spec.meshes if not meshes_exist(path)]:
        spec.delete(mesh)
    return spec.compile(), read_mjcf(path)


def meshes_exist(path: object) -> bool:
    return path.name != "akira_muscle.xml"


def random_motion(model: Model, frames: int, seed: int = 0, spread: float = 1.0) -> Motion:
    """Coordinates inside their ranges (angles within +-`spread` where there is none), any rates."""
    rng = np.random.default_rng(seed)
    low = np.array(
        [c.range[0] if np.isfinite(c.range[0]) else c.default - spread for c in model.coordinates]
    )
    high = np.array(
        [c.range[1] if np.isfinite(c.range[1]) else c.default + spread for c in model.coordinates]
    )
    n = len(model.coordinates)
    values = low + (high - low) * rng.random((frames, n))
    rates = rng.standard_normal((2, frames, n))
    return Motion(
        time=np.arange(frames) * 0.01,
        names=model.coordinate_names,
        values=values,
        velocities=rates[0],
        accelerations=rates[1],
    )


def qpos_from_coordinates(model: Model, coordinates) -> np.ndarray:
    """Return MuJoCo's `qpos` for values of all coordinates.

    Parameters
    ----------
    model : read from MuJoCo
    coordinates : (..., coordinates) in the model's order [rad or m]

    Returns
    -------
    (..., nq); the w of quaternions is not negative
    """
    c = np.asarray(coordinates, dtype=np.float64)
    rows = []
    for row in c.reshape(-1, c.shape[-1]):
        parts = [np.zeros(0)]
        for kind, _, at, start in _layout(model):
            values = row[at : at + WIDTHS[kind][1]]
            if kind in ("free", "ball"):
                turn = rotation_from_euler_xyz(values[-3:]) @ start
                values = np.concatenate([values[:-3], quaternion_from_rotation(turn)])
            parts.append(values)
        rows.append(np.concatenate(parts))
    return np.array(rows).reshape(*c.shape[:-1], -1)


class State:
    """One frame of a motion in MuJoCo's variables.

    `basis` (nv, coordinates) maps our rates to MuJoCo's: qvel = basis @ cdot, tau = basis^T qfrc.
    """

    def __init__(self, model: Model, motion: Motion, frame: int):
        c, cdot, cddot = motion_arrays(compile_tree(model), motion)
        c = c[frame]
        cdot = cdot[frame]
        cddot = cddot[frame]
        self.qpos = qpos_from_coordinates(model, c)
        n = len(c)
        blocks = []
        shifts = []
        at = 0
        for joint in model.joints:
            for kind in joint.kind.split("+"):
                if kind in ("free", "ball"):
                    if kind == "free":
                        blocks += list(np.eye(n)[at : at + 3])
                        shifts += [0.0] * 3
                        at += 3
                    x = axis_rotation((1, 0, 0), c[at])
                    xy = x @ axis_rotation((0, 1, 0), c[at + 1])
                    start = joint.child_frame.rotation.T if kind == "free" else np.eye(3)
                    turn = xy @ axis_rotation((0, 0, 1), c[at + 2]) @ start
                    w = np.column_stack([[1.0, 0, 0], x[:, 1], xy[:, 2]])
                    rates = w * cdot[at : at + 3]
                    bias = np.cross(rates[:, 0], rates[:, 1]) + np.cross(
                        rates[:, 0] + rates[:, 1], rates[:, 2]
                    )
                    rows = np.zeros((3, n))
                    rows[:, at : at + 3] = turn.T @ w
                    blocks += list(rows)
                    shifts += list(turn.T @ bias)
                    at += 3
                elif kind != "weld":
                    blocks.append(np.eye(n)[at])
                    shifts.append(0.0)
                    at += 1
        self.coordinates = c
        self.basis = np.array(blocks).reshape(-1, n)
        self.qvel = self.basis @ cdot
        self.qacc = self.basis @ cddot + np.array(shifts)
