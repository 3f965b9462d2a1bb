"""Forces in joints on the page of a trial: what is drawn, and what is not shown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.causes import BENT_KNEES, LABELS
from myomorph.core.model.series import Series
from myomorph.core.tension.joint_contact import JointContactForces
from myomorph.core.tension.load_quantities import JOINT_CONTACT_LOAD
from myomorph.lab.report.trial.joint_load_section import joint_load_section, joint_loads
from myomorph.lab.report.trial.prepared import Prepared, prepare
from myomorph.lab.uncertainty.spread import Spread, Uncertainty
from walker import everything, having

KNEE = "knee_r"
FRAMES = 200
TOP = 120
"""Frame of the greatest force that is known."""


@pytest.fixture(scope="module")
def prepared() -> Prepared:
    """Prepare a page whose knee is not known for a while, with range, interval and warnings."""
    given = everything(FRAMES)
    time = given.tension.time
    weight = given.model.weight
    # In units of the body's weight; it rises to where it is not known.
    total = 2.0 + np.sin(np.linspace(0.0, np.pi, FRAMES))
    total[TOP] = 3.1
    total[40:90] = np.nan
    column = weight * total[:, None]
    zero = np.zeros((FRAMES, 1))
    contacts = JointContactForces(
        time=time,
        joints=(KNEE,),
        points=("medial", "lateral"),
        joint_of=(KNEE, KNEE),
        joint_contact_force=np.hstack([0.7 * column, 0.3 * column]),
        joint_contact_total=column,
        joint_contact_shear=zero,
        joint_contact_unbalanced_force=zero,
        joint_contact_unbalanced_moment=zero,
        weight=weight,
    )
    spread = Spread(
        time=time,
        names=(f"total_{KNEE}",),
        low=0.8 * column,
        high=1.3 * column,
        deviation=zero,
        quantity=JOINT_CONTACT_LOAD,
    )
    warnings = (BENT_KNEES.message("a knee bends"), LABELS.message("a label is odd"))
    given = having(
        given,
        joint_contacts=contacts,
        static_loads=(
            Series(time, (KNEE,), 0.5 * column),
            Series(time, (KNEE,), 1.5 * column),
        ),
        uncertainty=Uncertainty(spreads={JOINT_CONTACT_LOAD.name: spread}),
        warnings=warnings,
    )
    return prepare(given)


def test_the_greatest_force_stands_with_its_interval_and_range(prepared: Prepared) -> None:
    section = joint_load_section(prepared)
    (row,) = section.grids[0].rows
    assert row[:4] == ("Knee, right", "3.10", "2.48 to 4.03", "1.55 to 4.65")
    assert ("statics", "by statics") in section.legend


def test_a_warning_that_touches_joint_loads_is_named_beside_them(prepared: Prepared) -> None:
    lead = joint_load_section(prepared).lead
    assert f"Caution, see the warnings: {BENT_KNEES.title}." in lead
    assert LABELS.title not in lead


def test_an_impulse_over_frames_that_are_not_known_is_not_shown(prepared: Prepared) -> None:
    rows = joint_load_section(prepared).grids[1].rows
    assert rows
    assert all(row[-1] == "–" for row in rows)


def test_nothing_is_shown_of_a_joint_that_is_never_known(prepared: Prepared) -> None:
    contacts = prepared.results.joint_contacts
    unknown = replace(
        contacts, joint_contact_total=np.full_like(contacts.joint_contact_total, np.nan)
    )
    assert joint_loads(prepare(replace(prepared.results, joint_contacts=unknown))) is None
