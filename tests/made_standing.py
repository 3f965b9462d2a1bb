"""A made recording for tests: the generic model stands with Plug-in Gait's markers."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.series import Markers
from myomorph.core.motion.measurements import default_markers
from myomorph.core.motion.protocols import protocols
from myomorph.lab.analyze.generic_model import generic_model

LABELS = (
    "LASI",
    "RASI",
    "LPSI",
    "RPSI",
    "LKNE",
    "RKNE",
    "LANK",
    "RANK",
    "LHEE",
    "RHEE",
    "LTOE",
    "RTOE",
    "C7",
    "LSHO",
    "RSHO",
)


def standing(shift: float = 0.0) -> Markers:
    """Make markers (20, 15, 3) of the model as it stands [m], y up and x forward.

    They move `shift` forward.
    """
    pytest.importorskip("myo_sim")
    sites = {label: protocols().protocols["plug_in_gait"].labels[label] for label in LABELS}
    model, _ = generic_model(sites)
    places = default_markers(model, LABELS)
    way = np.linspace(0.0, shift, 20)[:, None, None] * np.array([1.0, 0.0, 0.0])
    return Markers(np.arange(20) / 100.0, LABELS, places + way)
