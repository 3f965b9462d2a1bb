"""The section on what EMG and joint torques cannot both have, by muscle and time."""

from __future__ import annotations

from myomorph.report.charts.axis import number
from myomorph.report.page.parts import Grid, Section
from myomorph.report.trial.prepared import Prepared
from myomorph.tension.emg_conflicts import APART, BORNE, EmgConflict

MUSCLES = ("Muscle", "From", "To", "Farthest at", "Activation by EMG", "Activation found")
RESERVES = ("Coordinate", "From", "To", "Most at", "Torque wanted", "Borne by the reserve")
SHOWN = 20
"""Rows above which a table is folded away."""


def emg_conflict_section(prepared: Prepared) -> Section | None:
    """Stretches in which muscles leave their EMG, and in which reserves bear what EMG leaves."""
    conflicts = prepared.results.emg_conflicts
    if conflicts is None:
        return None
    muscles = [conflict for conflict in conflicts if conflict.muscle]
    reserves = [conflict for conflict in conflicts if conflict.coordinate]
    lead = (
        f"Where the joint torques need an activation that is more than {APART:g} from the muscle's EMG, or leave more "
        f"than {BORNE:.0%} of a joint's largest torque to a reserve: gains, the model's moment arms or the torques are "
        "wrong there, or the EMG is."
    )
    if not conflicts:
        lead = "EMG and joint torques agree throughout: no muscle leaves its EMG, and no reserve bears what EMG leaves."
    grids = []
    for title, head, rows in (("Muscles", MUSCLES, muscles), ("Reserves", RESERVES, reserves)):
        if rows:
            grids.append(Grid(head, tuple(_row(row) for row in rows), title, folded=len(rows) > SHOWN))
    return Section("emg-conflicts", "EMG against joint torques", lead, (), (), tuple(grids))


def _row(conflict: EmgConflict) -> tuple[str, ...]:
    times = (f"{number(value, 0.001)} s" for value in (conflict.start, conflict.stop, conflict.worst))
    if conflict.muscle:
        return conflict.muscle, *times, number(conflict.emg, 0.01), number(conflict.found, 0.01)
    return conflict.coordinate, *times, number(conflict.emg), number(conflict.found)
