"""A run as a page shows it, from a simulation or from its folder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.tension.quantities import ACTIVATION, MUSCLE_FORCE
from myomorph.forward.quantities import ELASTIC_FIBER_LENGTH, ENERGY, FEEDBACK_FORCE
from myomorph.forward.shown import ShownRun
from myomorph.forward.simulation import Simulation

KINETIC = "kinetic"
POTENTIAL = "potential"
RESIDUAL = "residual"
WORK = "work of "


@dataclass(frozen=True, eq=False, kw_only=True)
class PageRun:
    """A run as its page shows it.

    Attributes
    ----------
    shown : the body in motion
    forces : of muscles (frames, muscles) [N]
    energy : (frames, parts) [J]
    feedback : (frames, free coordinates) [N m or N]
    fibers : (frames, elastic muscles) [m]
    notes : what to look at
    facts : of the run, by name
    """

    shown: ShownRun
    forces: Series
    energy: Series
    feedback: Series
    fibers: Series
    notes: tuple[Message, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()

    @property
    def tables(self) -> tuple[Series, ...]:
        """All that is written as a table beside the coordinates; what has no column is not."""
        return tuple(
            series
            for series in (
                self.shown.activations,
                self.forces,
                self.energy,
                self.feedback,
                self.fibers,
            )
            if series.names
        )

    @property
    def motion(self) -> Motion:
        """Of the body."""
        return self.shown.motion


def page_run(name: str, simulation: Simulation, facts: tuple[tuple[str, str], ...] = ()) -> PageRun:
    """Take what a page shows from a simulation.

    Parameters
    ----------
    name : of the run
    simulation : done
    facts : of the run, by name
    """
    time = simulation.time
    elastic = simulation.elastic
    followed = bool(simulation.feedback.any())
    return PageRun(
        shown=ShownRun(
            name=name,
            model=simulation.model,
            motion=simulation.motion,
            activations=Series(
                time, simulation.muscles, simulation.activation, quantity=ACTIVATION
            ),
            wrenches=contact_wrenches(simulation),
        ),
        forces=Series(time, simulation.muscles, simulation.muscle_force, quantity=MUSCLE_FORCE),
        energy=_energy(simulation),
        feedback=Series(
            time,
            simulation.free if followed else (),
            simulation.feedback if followed else np.zeros((len(time), 0)),
            quantity=FEEDBACK_FORCE,
        ),
        fibers=Series(time, elastic, simulation.fiber_length, quantity=ELASTIC_FIBER_LENGTH),
        notes=simulation.notes,
        facts=(*_facts(simulation), *facts),
    )


def contact_wrenches(simulation: Simulation) -> Wrenches | None:
    """Take forces of contacts as external forces, None without contacts."""
    if not simulation.contact_bodies:
        return None
    numbers = range(1, len(simulation.contact_bodies) + 1)
    return Wrenches(
        time=simulation.time,
        names=tuple(
            f"{body}_{number}"
            for body, number in zip(simulation.contact_bodies, numbers, strict=True)
        ),
        bodies=simulation.contact_bodies,
        forces=simulation.contact_force,
        points=simulation.contact_point,
        torques=np.zeros_like(simulation.contact_force),
    )


def _energy(simulation: Simulation) -> Series:
    """Kinetic and potential energy, the residual, and works that are not 0 throughout [J]."""
    balance = simulation.energy
    columns: dict[str, Array] = {
        KINETIC: balance.kinetic,
        POTENTIAL: balance.potential,
        RESIDUAL: balance.residual,
    }
    for column, name in enumerate(balance.names):
        if balance.work[:, column].any():
            columns[WORK + name] = balance.work[:, column]
    return Series(
        balance.time, tuple(columns), np.column_stack(list(columns.values())), quantity=ENERGY
    )


def _facts(simulation: Simulation) -> list[tuple[str, str]]:
    """Facts on the steps and the energy of a run."""
    counts = simulation.counts
    facts = [
        ("Steps", f"{counts.steps}, {counts.rejected} more rejected"),
        ("Tolerance of a step", f"{simulation.tolerance:g}"),
        (
            "Energy error",
            f"{100 * simulation.energy.largest_share:.2g} % of"
            f" {simulation.energy.exchanged:.3g} J exchanged",
        ),
    ]
    if np.isfinite(simulation.halved):
        facts.append(
            ("With half the tolerance", f"coordinates differ by {simulation.halved:.1e} rad or m")
        )
    return facts
