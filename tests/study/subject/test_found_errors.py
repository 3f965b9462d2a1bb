"""How far off a model is, in the units of the sources, from what its steps found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.model.inertia import inertial_parameters
from myomorph.lab.study.subject.found_errors import identified_errors
from myomorph.lab.uncertainty.bodies import Draw, drawn_model
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import GROUPS, Sources

NONE = replace(Sources(), **{name: 0.0 for names in GROUPS.values() for name in names})


def test_errors_of_drawn_parameters_come_out_as_they_were_drawn(arm):
    """Parameters of many drawn bodies, their standard deviations, and the sizes from these."""
    model = read_model(arm.model)
    # Of the whole mass nothing is known here: no body's error is another's.
    sizes = replace(NONE, body_mass=0.04, mass_center=0.1, inertia=0.06)
    tables = [
        inertial_parameters(drawn_model(model, Draw(k, sizes, Normals(400)))) for k in range(400)
    ]
    found = {
        (one.source, one.item): one.size for one in identified_errors(model, np.std(tables, axis=0))
    }
    for body in model.body_names:
        assert found["segment_mass", body] == pytest.approx(0.04, rel=0.05)
        assert found["mass_center", body] == pytest.approx(0.1, rel=0.1)
