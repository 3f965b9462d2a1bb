"""Fibers and tendons as part of the step `tension`.

They are written, and reported in notes, signals and numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import MUSCLES
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Series
from myomorph.core.tension.dual import STALLED
from myomorph.core.tension.elastic.windows import MAX_RATE, solved_every
from myomorph.core.tension.fiber_quantities import (
    FIBER_LENGTH,
    FIBER_POWER,
    FIBER_VELOCITY,
    FIBER_WORK,
    NORMALIZED_FIBER_LENGTH,
    TENDON_FORCE,
    TENDON_POWER,
    TENDON_STRAIN,
    WORK_TABLE,
)
from myomorph.core.tension.tension import Fibers, Tension
from myomorph.lab.analysis.joint_loads import own_strides
from myomorph.lab.analysis.strides import Strides
from myomorph.lab.store.quantity_files import write_series
from myomorph.lab.store.results import Stored
from myomorph.lab.store.stored_tension import get_fibers
from myomorph.lab.study.step.step import StepOutput
from myomorph.lab.study.trial.trial_inputs import Signals, Value, tidy_signals

FIBER_TABLES = (FIBER_LENGTH, FIBER_VELOCITY, TENDON_STRAIN, FIBER_POWER, TENDON_POWER)
"""Quantities of fibers with a table of their own."""

# Strain at which tendons tear: where it is passed, the model's tendon does not fit.
LARGE_STRAIN = 0.1

MAX_NAMED = 8  # Muscles that a note names one by one.


@dataclass(frozen=True)
class FiberWork:
    """What fibers and tendon of one muscle do in one stride.

    Attributes
    ----------
    muscle : name
    stride : 1, 2, ... of the muscle's own leg; 0 for the whole recording
    start, stop : of the stride [s]
    fiber_positive_work, fiber_negative_work : positive work of the fibers, and negative as a
        positive number [J]
    tendon_returned_energy, tendon_stored_energy : the same of the tendon [J]
    fiber_peak_power, tendon_peak_power : maxima [W]
    max_tendon_strain : of the tendon
    min_normalized_length, max_normalized_length : of the fibers, over the optimal length
    """

    muscle: str
    stride: int
    start: float
    stop: float
    fiber_positive_work: float
    fiber_negative_work: float
    tendon_returned_energy: float
    tendon_stored_energy: float
    fiber_peak_power: float
    tendon_peak_power: float
    max_tendon_strain: float
    min_normalized_length: float
    max_normalized_length: float


def fiber_work(
    time: Array,
    muscles: tuple[str, ...],
    fibers: Fibers,
    optimal: Mapping[str, float],
    strides: Strides | None,
) -> tuple[FiberWork, ...]:
    """Return work, powers, strains and lengths of every muscle in every stride of its own leg.

    Without strides they are of the whole recording. Frames near an end of the recording
    (`Fibers.transient`) and unsolved ones are left out; a stride with less than two others is left
    out itself.

    Parameters
    ----------
    time : (frames,) [s]
    muscles : names
    fibers : lengths, powers and strains (frames, muscles)
    optimal : optimal fiber length of each muscle [m]
    strides : of both legs, None for the whole recording

    Returns
    -------
    one for each muscle and stride
    """
    result = []
    for m, name in enumerate(muscles):
        spans = [
            (index, stride.start, stride.stop)
            for index, stride in enumerate(own_strides(name, strides), 1)
        ]
        for number, start, stop in spans or [(0, float(time[0]), float(time[-1]))]:
            inside = (time >= start - 1e-9) & (time <= stop + 1e-9) & ~fibers.transient
            known = np.flatnonzero(inside & np.isfinite(fibers.fiber_power[:, m]))
            if len(known) < 2:
                continue
            fiber = fibers.fiber_power[known, m]
            tendon = fibers.tendon_power[known, m]
            lengths = fibers.fiber_length[known, m] / optimal[name]
            fiber_positive_work, fiber_negative_work = _work(time[known], fiber)
            tendon_returned_energy, tendon_stored_energy = _work(time[known], tendon)
            result.append(
                FiberWork(
                    muscle=name,
                    stride=number,
                    start=start,
                    stop=stop,
                    fiber_positive_work=fiber_positive_work,
                    fiber_negative_work=fiber_negative_work,
                    tendon_returned_energy=tendon_returned_energy,
                    tendon_stored_energy=tendon_stored_energy,
                    fiber_peak_power=float(fiber.max()),
                    tendon_peak_power=float(tendon.max()),
                    max_tendon_strain=float(fibers.tendon_strain[known, m].max()),
                    min_normalized_length=float(lengths.min()),
                    max_normalized_length=float(lengths.max()),
                )
            )
    return tuple(result)


def _work(time: Array, power: Array) -> tuple[float, float]:
    """Positive and negative work [J], the latter as a positive number."""
    done_part = np.maximum(power, 0.0)
    absorbed_part = np.maximum(-power, 0.0)
    done = float(0.5 * (done_part[1:] + done_part[:-1]) @ np.diff(time))
    absorbed = float(0.5 * (absorbed_part[1:] + absorbed_part[:-1]) @ np.diff(time))
    return done, absorbed


def write_fibers(
    tension: Tension, model: Model, strides: Strides | None, output: StepOutput
) -> tuple[Message, ...]:
    """Write fibers and tendons, and their work over strides or the whole.

    Notes are returned; there are none for rigid tendons.
    """
    fibers = tension.fibers
    if fibers is None:
        return ()
    values = {quantity: quantity.of(fibers) for quantity in FIBER_TABLES} | {
        TENDON_FORCE: tension.muscle_force
    }
    for quantity, table in values.items():
        series = Series(tension.time, tension.muscles, table, quantity=quantity)
        write_series(output.folder, series)
    optimal = {muscle.name: muscle.optimal_fiber_length for muscle in model.muscles}
    work = fiber_work(tension.time, tension.muscles, fibers, optimal, strides)
    rows = ([quantity.of(stride) for quantity in FIBER_WORK] for stride in work)
    write_csv(output.folder / WORK_TABLE, (quantity.column for quantity in FIBER_WORK), rows)
    return fiber_notes(tension)


def fiber_notes(tension: Tension) -> tuple[Message, ...]:
    """Report what is wrong with fibers and tendons.

    These are frames that did not converge or were bridged, muscles whose fibers cannot reach, and
    tendons strained too far.
    """
    fibers = tension.fibers
    if fibers is None:
        return ()
    notes = []
    stalled = np.flatnonzero(tension.status == STALLED)
    if len(stalled):
        first, last = tension.time[stalled[[0, -1]]]
        notes.append(
            MUSCLES.message(
                f"elastic tendons did not converge in {len(stalled)} of {len(tension)} frames,"
                f" between {first:.3f} and {last:.3f} s (residual"
                f" {fibers.certificate.residual:.2g}): forces and fibers there are not reliable;"
                " try frames at 100 Hz, or rigid tendons",
                severity="changes results",
            )
        )
    for fiber in fibers.unreachable[:MAX_NAMED]:
        too_long = f"fibers would be {fiber.worst:.2f} optimal lengths long"
        why = "the path is shorter than the slack tendon" if fiber.worst <= 0.0 else too_long
        at = f"{tension.time[fiber.frame]:.3f} s (frame {fiber.frame})"
        notes.append(
            MUSCLES.message(
                f"{fiber.muscle}: {why}, first at {at}; it is solved with a rigid tendon"
            )
        )
    left = [fiber.muscle for fiber in fibers.unreachable[MAX_NAMED:]]
    if left:
        notes.append(
            MUSCLES.message(
                f"fibers of {len(left)} more muscles cannot reach; solved with rigid tendons:"
                f" {', '.join(left)}"
            )
        )
    every = solved_every(tension.time)
    if every > 1 and tension.contacts is None:
        notes.append(
            MUSCLES.message(
                f"one in {every} frames was solved ({MAX_RATE:.0f} a second at most); activations"
                " between them are interpolated, and forces so too, changed as little as balances"
                " the torques",
                severity="good to know",
            )
        )
    if fibers.bridged.any():
        first, last = tension.time[np.flatnonzero(fibers.bridged)[[0, -1]]]
        notes.append(
            MUSCLES.message(
                f"torques or coordinates are missing in {int(fibers.bridged.sum())} frames between"
                f" {first:.3f} and {last:.3f} s: interpolated for the tendons' dynamics, without"
                " results there"
            )
        )
    inside = np.where(fibers.transient[:, None], np.nan, fibers.tendon_strain)
    most = np.max(np.nan_to_num(inside, nan=-np.inf), axis=0, initial=-np.inf)
    torn = np.flatnonzero(most > LARGE_STRAIN)
    if len(torn):
        worst = int(torn[np.argmax(most[torn])])
        at = tension.time[int(np.nanargmax(inside[:, worst]))]
        notes.append(
            MUSCLES.message(
                f"tendons of {len(torn)} muscles have strains above {100 * LARGE_STRAIN:.0f}"
                f" %, at which tendons rupture; most {tension.muscles[worst]},"
                f" {100 * most[worst]:.1f} %"
                f" at {at:.3f} s: its slack length does not fit"
            )
        )
    return tuple(notes)


def inside_ends(fibers: Fibers, values: Array) -> Array:
    """Return values with NaN where the start-up or the end has an effect.

    Parameters
    ----------
    fibers : that know these frames (`transient`)
    values : (frames, muscles)

    Returns
    -------
    (frames, muscles)
    """
    return np.where(fibers.transient[:, None], np.nan, values)


def fiber_signals(stored: Stored, model: Model) -> tuple[Signals, ...]:
    """Return normalized fiber length, tendon strain and powers for tables of values and curves.

    The ends of the recording are left out.
    """
    fibers = get_fibers(stored)
    if fibers is None:
        return ()
    muscles = stored.names["muscle"]
    optimal = {muscle.name: muscle.optimal_fiber_length for muscle in model.muscles}
    normal = fibers.fiber_length / np.array([optimal.get(name, np.nan) for name in muscles])

    found = {NORMALIZED_FIBER_LENGTH: normal} | {
        quantity: quantity.of(fibers) for quantity in (TENDON_STRAIN, FIBER_POWER, TENDON_POWER)
    }
    shown = [
        Series(stored.time, muscles, inside_ends(fibers, values), quantity=quantity)
        for quantity, values in found.items()
    ]
    return tuple(tidy_signals("tension", series, model) for series in shown)


def fiber_numbers(stored: Stored) -> Iterator[Value]:
    """Greatest tendon strain, muscles on rigid tendons, and how sure the solution is."""
    fibers = get_fibers(stored)
    if fibers is None:
        return
    strains = inside_ends(fibers, fibers.tendon_strain)
    if np.isfinite(strains).any():
        yield Value(
            step="tension",
            quantity="tendon strain, largest",
            value=float(np.nanmax(strains)),
            unit="1",
        )
    yield Value(
        step="tension",
        quantity="muscles on rigid tendons",
        value=float(len(fibers.rigid)),
        unit="1",
    )
    yield Value(
        step="tension",
        quantity="muscles whose fibers cannot reach",
        value=float(len(fibers.unreachable)),
        unit="1",
    )
    yield Value(
        step="tension", quantity="frames bridged", value=float(fibers.bridged.sum()), unit="1"
    )
    yield Value(
        step="tension",
        quantity="elastic tendons, residual",
        value=fibers.certificate.residual,
        unit="1",
    )
