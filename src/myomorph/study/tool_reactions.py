"""OpenSim's JointReaction analysis: loads of joints from forces in a file, and the accelerations that they cause."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from myomorph.io.sto import read_sto
from myomorph.io.tool_setups import Analysis
from myomorph.model.errors import BadData, UnknownName
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Motion, Series, Table, Wrenches
from myomorph.model.spatial import Array
from myomorph.muscles.coupled_arms import TURNING
from myomorph.study import inputs


def joint_reaction(
    model: Model, motion: Motion, wrenches: Wrenches | None, analysis: Analysis, actuators: Sequence[Actuator]
) -> tuple[Table, str, tuple[str, ...]]:
    """The table `..._ReactionLoads.sto` of a JointReaction analysis, what was found, and warnings.

    As OpenSim, the analysis takes the accelerations that all forces together cause; those of the motion are not read.

    Raises
    ------
    BadData
        where muscles have no forces_file, or lists differ in length
    UnknownName
        where a joint, body or frame does not exist, or a muscle or actuator is not in the forces_file
    """
    from myomorph.tension.reaction import joint_reactions

    known = tuple(one.name for one in model.joints)
    names = tuple(analysis.options.get("joint_names", "").split()) or ("ALL",)
    if names[0].upper() == "ALL":
        names = known
    kept = [k for k, name in enumerate(names) if name in known]
    if not kept:
        raise UnknownName("joint", names[0], known)
    warnings = [f"'{name}' is not a joint: left out" for name in names if name not in known]
    # OpenSim takes the words for sides in any case.
    sides = _of_each(analysis, "apply_on_bodies", "child", names, kept, str.lower)
    frames = _of_each(analysis, "express_in_frame", "ground", names, kept)
    forces, told = _forces(model, motion.time, analysis.forces, actuators)
    found = joint_reactions(
        model,
        motion,
        forces,
        wrenches,
        [names[k] for k in kept],
        sides,  # type: ignore[arg-type]
        frames,
        actuators=actuators,
        accelerations="forces",
    )
    text = f"joint reactions: {len(found)} frames, {len(found.joints)} joints"
    if np.isfinite(found.forces).any():
        sizes = np.linalg.norm(found.forces, axis=2)
        worst = np.unravel_index(int(np.nanargmax(sizes)), sizes.shape)
        text += f", largest force {sizes[worst]:.0f} N ({found.joints[worst[1]]})"
    return found.table(), text, (*warnings, *told)


def _of_each(
    analysis: Analysis,
    tag: str,
    default: str,
    names: Sequence[str],
    kept: Sequence[int],
    spelt: Callable[[str], str] = str,
) -> list[str]:
    """The word of a list for each joint that is kept: one for all, or one a joint as they are listed."""
    given = [spelt(one) for one in analysis.options.get(tag, "").split()] or [default]
    if len(given) not in (1, len(names)):
        raise BadData(f"{analysis.name}: {tag} names {len(given)} for {len(names)} joints: expected 1 or as many")
    return [given[k] if len(given) > 1 else given[0] for k in kept]


def with_speeds(path: Path, model: Model, motion: Motion) -> Motion:
    """The motion with the speeds that a file of states holds; those that it lacks stay.

    OpenSim's speeds of joints that turn freely are angular velocities and no rates: theirs stay too.
    """
    assert motion.velocities is not None
    table = read_sto(path)
    turning = {name for joint in model.joints if joint.kind in TURNING for name in joint.coordinates}
    at = np.clip(np.searchsorted(table.time, motion.time - 1e-9), 0, len(table) - 1)
    velocities = motion.velocities.copy()
    for k, name in enumerate(motion.names):
        for column in table.names:
            if name not in turning and (column == f"{name}_u" or column.endswith(f"/{name}/speed")):
                rotates = model.coordinate(name).motion == "rotational"
                velocities[:, k] = table[column][at] * (np.pi / 180.0 if table.in_degrees and rotates else 1.0)
    return replace(motion, velocities=velocities)


def _forces(
    model: Model, time: Array, path: Path | None, actuators: Sequence[Actuator]
) -> tuple[Series | None, tuple[str, ...]]:
    """Forces of all muscles and actuators at the motion's times, between rows of the file along straight lines."""
    given = {one.name for one in actuators}
    helpers = [one.name for one in (*model.actuators, *actuators) if one.enabled]
    names = tuple(dict.fromkeys([one.name for one in model.muscles if one.enabled] + helpers))
    if path is None:
        if any(one.enabled for one in model.muscles):
            raise BadData(
                "JointReaction: no forces_file, but the model has muscles: forces of muscles from their states are not "
                "built; give the file of forces that StaticOptimization writes"
            )
        told = (f"no forces_file: {len(names)} actuators are taken to do nothing",) if names else ()
        return None, told
    with inputs.about(path):
        table = read_sto(path)
        values = np.empty((len(time), len(names)))
        for k, name in enumerate(names):
            if name not in table.names:
                where = "the forces_file" + (" (force_set_files added it)" if name in given else "")
                raise UnknownName("actuator", name, table.names, where)
            values[:, k] = np.interp(time, table.time, table[name])
        if time[0] < table.time[0] - 1e-6 or time[-1] > table.time[-1] + 1e-6:
            raise BadData(
                f"has forces from {table.time[0]:g} to {table.time[-1]:g} s, but the analysis runs from {time[0]:g} to "
                f"{time[-1]:g} s"
            )
    return Series(time, names, values), ()
