"""Many variants of a simulation in one process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.rigid.bushings import bushing_arrays
from myomorph.core.rigid.frames import over_frames
from myomorph.core.rigid.tree import compile_tree_as
from myomorph.forward.arrays import System
from myomorph.forward.body import SimulatedBody, spring_arrays
from myomorph.forward.changes import NO_CHANGES, Changes
from myomorph.forward.drives import NO_DRIVES, Drives
from myomorph.forward.integrator import RUNNING
from myomorph.forward.simulate import USUAL, Run, SimulationOptions


@dataclass(frozen=True, eq=False, kw_only=True)
class Variant:
    """What is different in one of many simulations.

    Attributes
    ----------
    start : where it begins, None for the start of all
    changes : of the model
    """

    start: Motion | None = None
    changes: Changes = NO_CHANGES


@read_only
class Variants:
    """Motions of many variants.

    Attributes
    ----------
    time : (frames,) [s]
    names : of the coordinates
    values, velocities : (variants, frames, coordinates) [rad or m, per s]; NaN of a variant that
        could not go on
    energy_share : (variants,) largest energy without a cause, by the energy exchanged
    """

    time: Array
    names: tuple[str, ...]
    values: Array
    velocities: Array
    energy_share: Array


def simulate_variants(
    model: Model,
    variants: Sequence[Variant],
    drives: Drives = NO_DRIVES,
    options: SimulationOptions = USUAL,
    progress: Callable[[int], None] | None = None,
) -> Variants:
    """Simulate many variants of a model, on all cores.

    The model is compiled once. A variant changes numbers in its arrays: masses, strengths,
    viscosity, and where it begins.

    Parameters
    ----------
    model : of all
    variants : at least one
    drives : of all
    options : of all; `certify` is not read
    progress : called with the number of variants just done

    Returns
    -------
    motions, in the order of the variants
    """
    body = SimulatedBody(
        model=model,
        drives=drives,
        elastic=options.tendons == "elastic",
        passive=options.passive is not False,
    )
    usual = Run(body=body, start=variants[0].start, options=options)
    times = usual.times
    compiled = usual.system
    shape = (len(variants), len(times), len(model.coordinates))
    values = np.full(shape, np.nan)
    velocities = np.full(shape, np.nan)
    shares = np.full(len(variants), np.nan)

    def simulate_some(first: int, last: int) -> None:
        for number in range(first, last):
            variant = variants[number]
            run = replace(usual, start=variant.start)
            held = compiled._replace(held=run.first_coordinates[0])
            system = changed_system(held, model, variant.changes)
            done = run.integrated(system)
            if done.counts[0] != RUNNING:
                continue
            values[number] = done.observed.coordinates
            velocities[number] = done.observed.velocities
            shares[number] = run.balance(system, done).largest_share

    over_frames(simulate_some, len(variants), progress, chunk=1)
    return Variants(
        time=times,
        names=model.coordinate_names,
        values=values,
        velocities=velocities,
        energy_share=shares,
    )


def changed_system(system: System, model: Model, changes: Changes) -> System:
    """Change numbers in the arrays of a body, as `Changes.applied` changes its model.

    Parameters
    ----------
    system : of the model as it is
    model : that was compiled
    changes : of it

    Returns
    -------
    arrays of the changed model
    """
    if not changes:
        return system
    changed = changes.applied(model)
    factors = [changes.strength.get(name, 1.0) for name in model.muscle_names]
    hill = system.muscles.hill
    muscles = system.muscles._replace(
        hill=hill._replace(force=hill.force * np.array(factors)),
        viscosity=changes.viscosity * system.muscles.viscosity,
    )
    tree = compile_tree_as(changed, model)
    tissue = len(system.springs.coordinate) > 0
    held = len(system.bushings.body_1) > 0
    return system._replace(
        tree=tree.arrays,
        muscles=muscles,
        springs=spring_arrays(changed if tissue else None, changed),
        bushings=bushing_arrays(tree, changed.bushings if held else ()),
    )
