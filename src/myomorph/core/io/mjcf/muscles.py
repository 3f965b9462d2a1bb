"""Tendons, muscles and other actuators of a compiled MuJoCo model."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from myomorph.core.io.mjcf.bodies import MjcfNames, pose_of
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Actuator, Kept
from myomorph.core.model.paths import Muscle, Path, PathPoint, TendonWrap, WrapObject

SITE = int(mujoco.mjtWrap.mjWRAP_SITE)
PULLEY = int(mujoco.mjtWrap.mjWRAP_PULLEY)
SPHERE = int(mujoco.mjtWrap.mjWRAP_SPHERE)
CYLINDER = int(mujoco.mjtWrap.mjWRAP_CYLINDER)
JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
PARAMETERS = ("range0", "range1", "force", "scale", "lmin", "lmax", "vmax", "fpmax", "fvmax")
SMALLEST = 1e-15
VERSION = 4 if int(mujoco.__version__.split(".")[0]) >= 4 else 3
"""Whose rule tendons follow around side sites: that of the MuJoCo that is installed."""


def muscles_of(
    m: Any, names: MjcfNames
) -> tuple[tuple[Muscle, ...], tuple[WrapObject, ...], list[Kept]]:
    """Convert the muscles of a compiled model that pull spatial tendons.

    Parameters
    ----------
    m : the compiled model
    names : of its parts

    Returns
    -------
    the muscles, the surfaces that their tendons wrap around, and the tendons that are left out
    """
    muscles: list[Muscle] = []
    wraps: dict[int, WrapObject] = {}
    driven: set[int] = set()
    for i in range(m.nu):
        if not is_muscle(m, i) or _tendon_of(m, i) is None:
            continue
        tendon = int(m.actuator_trnid[i, 0])
        driven.add(tendon)
        path = _path(m, names, tendon, float(m.actuator_gear[i, 0]), wraps)
        muscles.append(_muscle(m, names, i, path))
    lost = []
    for t in sorted(set(range(m.ntendon)) - driven):
        fixed = int(m.wrap_type[m.tendon_adr[t]]) == JOINT
        kind = "fixed tendon" if fixed else "tendon without muscle"
        effect = "it couples or resists joints in MuJoCo; the model moves without it"
        lost.append(Kept(kind=kind, name=names.tendons[t], effect=effect, text="", room="tendon"))
    return tuple(muscles), tuple(wraps.values()), lost


def is_muscle(m: Any, i: int) -> bool:
    """Return whether an actuator has MuJoCo's muscle gain.

    Parameters
    ----------
    m : the compiled model
    i : index of the actuator
    """
    return int(m.actuator_gaintype[i]) == int(mujoco.mjtGain.mjGAIN_MUSCLE)


def _tendon_of(m: Any, i: int) -> int | None:
    """Spatial tendon that actuator `i` pulls; None if it acts otherwise or pushes (gear <= 0)."""
    if (
        int(m.actuator_trntype[i]) != int(mujoco.mjtTrn.mjTRN_TENDON)
        or m.actuator_gear[i, 0] <= 0.0
    ):
        return None
    tendon = int(m.actuator_trnid[i, 0])
    return None if int(m.wrap_type[m.tendon_adr[tendon]]) == JOINT else tendon


def _path(m: Any, names: MjcfNames, tendon: int, gear: float, wraps: dict[int, WrapObject]) -> Path:
    """Convert a tendon: sites to points, geoms to wraps, pulleys to divisors of segments.

    Parameters
    ----------
    m : the compiled model
    names : of its parts
    tendon : its index
    gear : of the actuator, which multiplies all lengths
    wraps : surfaces by geom; gets those of this tendon

    Returns
    -------
    the path; a segment's length counts divided by its divisor, and not at all where that is 0
    """
    points: list[PathPoint] = []
    used: list[TendonWrap] = []
    divisors: list[float] = []
    divisor = 1.0
    apart = False
    start = int(m.tendon_adr[tendon])
    for index in range(start, start + int(m.tendon_num[tendon])):
        kind = int(m.wrap_type[index])
        what = int(m.wrap_objid[index])
        if kind == PULLEY:
            divisor = float(m.wrap_prm[index])
            apart = True
        elif kind == SITE:
            if points:
                divisors.append(0.0 if apart else divisor / gear)
            apart = False
            points.append(
                PathPoint(names.sites[what], names.bodies[m.site_bodyid[what]], m.site_pos[what])
            )
        else:
            if what not in wraps:
                wraps[what] = _wrap_object(m, names, what, kind)
            side = round(float(m.wrap_prm[index]))
            used.append(
                TendonWrap(
                    wrap_object=names.geoms[what],
                    after=len(points) - 1,
                    side_body=names.bodies[m.site_bodyid[side]] if side >= 0 else "",
                    side=np.array(m.site_pos[side]) if side >= 0 else None,
                    version=VERSION,
                )
            )
    if all(divisor == 1.0 for divisor in divisors):
        divisors = []
    return Path(tuple(points), tuple(used), tuple(divisors))


def _wrap_object(m: Any, names: MjcfNames, geom: int, kind: int) -> WrapObject:
    """Convert a sphere or cylinder that tendons wrap around; a cylinder has no end."""
    radius = float(m.geom_size[geom, 0])
    return WrapObject(
        name=names.geoms[geom],
        body=names.bodies[m.geom_bodyid[geom]],
        kind="sphere" if kind == SPHERE else "cylinder",
        pose=pose_of(m.geom_pos[geom], m.geom_quat[geom]),
        size=(radius,) if kind == SPHERE else (radius, np.inf),
    )


def _muscle(m: Any, names: MjcfNames, i: int, path: Path) -> Muscle:
    """Convert MuJoCo's muscle: the length range is mapped to the operating range of the fiber.

        L0 = (lengthrange1 - lengthrange0) / (range1 - range0),   LT = lengthrange0 - range0 L0

    with both lengths in meters; the peak force is `force`, or `scale` / acc0 where that is negative
    [N].

    Parameters
    ----------
    m : the compiled model
    names : of its parts
    i : index of the actuator
    path : of its tendon
    """
    gains = dict(
        zip(PARAMETERS, np.array(m.actuator_gainprm[i, :9], dtype=np.float64).tolist(), strict=True)
    )
    short, long = map(float, m.actuator_lengthrange[i])
    fiber = (long - short) / max(SMALLEST, gains["range1"] - gains["range0"])
    slack = short - gains["range0"] * fiber
    acc0 = float(m.actuator_acc0[i])
    force = gains["force"] if gains["force"] >= 0.0 else gains["scale"] / max(SMALLEST, acc0)
    parameters = {
        **gains,
        "L0": fiber,
        "LT": slack,
        "F0": force,
        "acc0": acc0,
        "lengthrange0": short,
        "lengthrange1": long,
        "timeconst0": float(m.actuator_dynprm[i, 0]),
        "timeconst1": float(m.actuator_dynprm[i, 1]),
    }
    limited = bool(m.actuator_ctrllimited[i])
    return Muscle(
        names.actuators[i],
        "mujoco",
        path,
        max_isometric_force=force,
        optimal_fiber_length=fiber,
        tendon_slack_length=slack,
        max_contraction_velocity=gains["vmax"],
        min_activation=max(0.0, float(m.actuator_ctrlrange[i, 0])) if limited else 0.0,
        max_activation=float(m.actuator_ctrlrange[i, 1]) if limited else 1.0,
        parameters=FrozenMap(parameters),
    )


def actuators_of(m: Any, names: MjcfNames) -> tuple[tuple[Actuator, ...], list[Kept]]:
    """Convert force actuators on hinge and slide joints.

    Parameters
    ----------
    m : the compiled model
    names : of its parts

    Returns
    -------
    the actuators, and servos and other transmissions that are left out
    """
    actuators: list[Actuator] = []
    lost: list[Kept] = []
    on_joint = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    one_dof = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    for i in range(m.nu):
        name = names.actuators[i]
        joint = int(m.actuator_trnid[i, 0])
        if is_muscle(m, i):
            if _tendon_of(m, i) is None:
                effect = "a muscle that does not pull a spatial tendon is not modelled"
                lost.append(Kept(kind="muscle", name=name, effect=effect, text="", room="actuator"))
            continue
        if int(m.actuator_trntype[i]) not in on_joint or int(m.jnt_type[joint]) not in one_dof:
            lost.append(
                Kept(
                    kind="actuator",
                    name=name,
                    effect="only actuators on hinge and slide joints are kept",
                    text="",
                    room="actuator",
                )
            )
            continue
        gain = int(m.actuator_gaintype[i]) == int(mujoco.mjtGain.mjGAIN_FIXED)
        if not gain or int(m.actuator_biastype[i]) != int(mujoco.mjtBias.mjBIAS_NONE):
            lost.append(
                Kept(
                    kind="actuator",
                    name=name,
                    effect="its force is not proportional to its control",
                    text="",
                    room="actuator",
                )
            )
            continue
        limited = bool(m.actuator_ctrllimited[i])
        low, high = (float(x) for x in m.actuator_ctrlrange[i]) if limited else (-np.inf, np.inf)
        strength = float(m.actuator_gainprm[i, 0] * m.actuator_gear[i, 0])
        actuators.append(
            Actuator(
                name=name,
                kind="coordinate",
                optimal_force=strength,
                min_control=low,
                max_control=high,
                coordinate=names.joints[joint],
            )
        )
    return tuple(actuators), lost
