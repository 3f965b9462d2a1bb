"""Tables of contacts: what plates measured of the contacts on them, and impacts that were heard."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.lab.analysis.contact_states import row_label
from myomorph.lab.analysis.selection import Subject
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.page.parts import Grid
from myomorph.lab.report.trial.estimated_forces import Group
from myomorph.lab.report.trial.figures import axis_names
from myomorph.lab.report.trial.plate_comparison import PlateComparison
from myomorph.lab.report.trial.prepared import Prepared

MANY = 16
"""Number of impacts above which their table is folded."""


def plate_grids(
    prepared: Prepared, groups: Sequence[Group], comparisons: Sequence[PlateComparison]
) -> tuple[Grid, ...]:
    """Make the table of plates beside the sum of the contacts on them; none without any.

    Parameters
    ----------
    prepared : results, for the names of the axes
    groups : contacts, with their labels
    comparisons : of contacts that were on the same plates
    """
    vectors, names = axis_names(prepared.up)
    labels = {group.name: group.label for group in groups}
    rows = []
    for each in comparisons:
        if not each.compared.any():
            continue
        sum_of = " + ".join(labels.get(name, name) for name in each.groups)
        share = f"{100.0 * float(np.mean(each.compared)):.0f} %"
        plates = ", ".join(each.plates)
        rows.append((sum_of, plates, share, *(_off(each, vector) for vector in vectors)))
    if not rows:
        return ()
    head = ("Contacts together", "Plates", "Of frames", *(f"RMS off, {name}" for name in names))
    return (Grid(head, tuple(rows), "Sum of contacts compared with plates"),)


def _off(comparison: PlateComparison, direction: np.ndarray) -> str:
    """Root mean square off, also as a share of the range of what was measured."""
    rms = comparison.rms(direction)
    if not np.isfinite(rms):
        return "–"
    span = comparison.measured_range(direction)
    share = f" ({number(100.0 * rms / span)} % of its range)" if span > 1e-9 else ""
    return f"{number(rms)} N{share}"


def impact_grids(prepared: Prepared, who: Sequence[Subject]) -> tuple[Grid, ...]:
    """Make the table of impacts that were heard; none without any.

    Parameters
    ----------
    prepared : results, with the impacts
    who : was recorded
    """
    impacts = prepared.results.contacts.impacts
    if not impacts:
        return ()
    rows = []
    for impact in impacts:
        known = np.isfinite(impact.low) and np.isfinite(impact.high)
        interval = f"{impact.low:.3g} to {impact.high:.3g} N·s" if known else "not shown"
        rows.append(
            (
                f"{number(impact.time, 0.001)} s",
                row_label(impact.site, who),
                impact.instrument,
                f"{impact.impulse:.3g} N·s",
                interval,
                f"{100.0 * impact.confidence:.0f} %",
            )
        )
    head = ("Time", "Contact", "Struck", "Impulse", "90 % interval", "Certainty of the contact")
    title = f"Impacts heard: {len(impacts)}"
    return (Grid(head, tuple(rows), title, folded=len(impacts) > MANY),)
