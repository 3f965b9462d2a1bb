"""The section below the first screen: the numbers of a run, a jump, a squat or a rise."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.movement import Movement
from myomorph.lab.movements import quantities as of
from myomorph.lab.movements.part import MovementNumbers
from myomorph.lab.report.page.parts import SIDES_LEGEND, Figure, Section
from myomorph.lab.report.trial.answer.judgement import Use
from myomorph.lab.report.trial.answer.squat import WITH_TORQUES
from myomorph.lab.report.trial.movement.movement_figure import movement_figure
from myomorph.lab.report.trial.movement.number_tables import number_tables
from myomorph.lab.report.trial.prepared import Prepared

KEY = "movement"
TITLES: Mapping[Movement, str] = FrozenMap(
    {
        "running": "Numbers of the run",
        "jumping": "Numbers of the jump",
        "squatting": "Numbers of the squat",
        "rising": "Numbers of rising from the seat",
    }
)
SOURCES: Mapping[Movement, tuple[str, ...]] = FrozenMap(
    {
        "running": ("mcmahon1990", "morin2005", "milner2006", "blackmore2016"),
        "jumping": ("owen2014", "mcmahon2018", "mclellan2011", "young1995"),
        "squatting": ("wretenberg1993", "newton2006"),
        "rising": ("schenkman1990",),
    }
)
"""References of the definitions."""


def shown_numbers(prepared: Prepared, use: Use) -> MovementNumbers | None:
    """Return the numbers that a verdict allows.

    There are no moments where torques do not hold, and none where not even angles do.
    """
    numbers = prepared.movement_numbers
    if numbers is None or use == "nothing":
        return None
    if use in WITH_TORQUES:
        return numbers
    kept = [quantity for quantity in numbers.quantities if quantity not in of.MOMENTS]
    return numbers.only(kept)


def movement_section(prepared: Prepared, use: Use) -> Section | None:
    """Return the section; None for movements that have no numbers of their own, or show none."""
    numbers = shown_numbers(prepared, use)
    recorded = prepared.recorded_movement
    if numbers is None or recorded is None:
        return None
    drawn = movement_figure(recorded, numbers)
    figures = () if drawn is None else (Figure(drawn.svg, "full", drawn.caption),)
    return Section(
        key=KEY,
        title=TITLES[recorded.movement],
        lead=_lead(numbers, prepared.results.dynamics.measured is not None, use),
        legend=SIDES_LEGEND if drawn is not None and drawn.sides else (),
        figures=figures,
        grids=number_tables(numbers),
        leads=True,
    )


def _lead(numbers: MovementNumbers, measured: bool, use: Use) -> str:
    """Say how many parts there are, and why something is not shown."""
    count = len(numbers.parts)
    noun = numbers.one if count == 1 else numbers.many
    words = f"{count} {noun}"
    if count > 1 and numbers.one == "rise":
        whole = numbers.parts[-1].stop - numbers.parts[0].start
        words += f" in {whole:.1f}\u00a0s"
    sentences = [f"{words}."]
    if not measured and not _knows_force(numbers):
        sentences.append("No plate measured a force, so quantities that need one are not shown.")
    if use not in WITH_TORQUES and numbers.one in ("repetition", "rise"):
        sentences.append("Torques are not usable, so moments are not shown.")
    return " ".join(sentences)


def _knows_force(numbers: MovementNumbers) -> bool:
    """Whether any number comes from a plate."""
    forces = (of.PEAK_VERTICAL_FORCE, of.RIGHT_SHARE, of.HEIGHT_BY_FLIGHT)
    return any(np.isfinite(part.number(quantity)) for part in numbers.parts for quantity in forces)
