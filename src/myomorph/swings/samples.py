"""Sample of the wing: an arm without muscles that swings from a base on a force plate."""

from __future__ import annotations

import numpy as np

from myomorph.core.io.samples import Sample, SampleSource
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.series import Series, Trial
from myomorph.swings.simulate.shoulder import bare_swing

NUMBER = 3  # Of the specimen, a row of the published tables.
SECONDS = 4.0
CUTOFF = 6.0  # Low-pass of motion and forces [Hz].


def swings() -> Sample:
    """Release a virtual arm of bones once, and record markers and the force on its base."""
    specimen, condition = bare_swing(NUMBER, SECONDS)
    trial = condition.trials[0]
    time = trial.markers.time
    known = {
        "mass": (condition.mass, "limb"),
        "com": (condition.com, "limb"),
        "viscosity": (condition.viscosity, "joint"),
    }
    truth = {
        name: Series(time[:1], (of,), np.array([[value]])) for name, (value, of) in known.items()
    }
    text = (
        "the bones of an arm, their muscles removed, swing from a base on a force plate, simulated"
        " in MuJoCo with masses and viscosity of a published specimen; nobody was recorded, and the"
        " model is myo-sim's (Apache-2.0)"
    )
    return Sample(
        name="swings",
        model=specimen.model,
        recording=Trial(markers=trial.markers),
        loads=trial.wrenches,
        mass=condition.mass,
        movement="upper limb",
        window=(float(time[0]), float(time[-1])),
        cutoff=CUTOFF,
        truth=FrozenMap(truth),
        source=SampleSource(
            kind="simulated",
            text=text,
            licence="Apache-2.0",
            citation="Caggiano et al. 2022, MyoSuite, for the arm of myo-sim",
        ),
    )
