"""OpenSim's JointReaction analysis: loads of joints from forces in a file, and the accelerations that they cause."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from myomorph.io.osim.tool_setups import Analysis
from myomorph.io.sto import read_sto
from myomorph.model.errors import BadData, UnknownName
from myomorph.model.series import Series, Table
from myomorph.opensim_tools.states import Analyzed
from myomorph.study.trial import inputs


def joint_reaction(here: Analyzed, analysis: Analysis) -> tuple[Table, str, tuple[str, ...]]:
    """The table `..._ReactionLoads.sto` of a JointReaction analysis, what was found, and warnings.

    As OpenSim, the analysis takes the accelerations that all forces together cause; those of the motion are not read.
    Without a forces_file, forces of muscles are those of their states.

    Raises
    ------
    BadData
        where lists differ in length, or muscles without a forces_file are of a class whose fibers are not built
    UnknownName
        where a joint, body or frame does not exist, or a muscle or actuator is not in the forces_file
    """
    from myomorph.tension.reaction import joint_reactions

    model, motion, actuators = here.model, here.motion, here.actuators
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
    forces, told = _forces(here, analysis.forces)
    found = joint_reactions(
        model,
        motion,
        forces,
        here.wrenches,
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


def _forces(here: Analyzed, path: Path | None) -> tuple[Series | None, tuple[str, ...]]:
    """Forces of all muscles and actuators at the motion's times, between rows of the file along straight lines."""
    model, time, actuators = here.model, here.motion.time, here.actuators
    given = {one.name for one in actuators}
    helpers = [one.name for one in (*model.actuators, *actuators) if one.enabled]
    names = tuple(dict.fromkeys([one.name for one in model.muscles if one.enabled] + helpers))
    if path is None:
        told = (f"no forces_file: {len(helpers)} actuators are taken to do nothing",) if helpers else ()
        return here.forces, told
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
