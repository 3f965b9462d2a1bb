"""A plate whose axes are off passes for no clock, and one whose clock is off is still found."""

from __future__ import annotations

import numpy as np
from benchmarks.accuracy.viscosity.faulty_limbs import Faults, faulty_limb

from myomorph.swings.viscosity.tracking.track import track

SEED = 312
TILT = (0.02, 0.0, -0.02)


def clocks(faults):
    """Clocks of the plate in the three swings of a simulated limb, muscles removed [s]."""
    limb = faulty_limb(SEED, faults, 0.05)
    tracked = track(limb.known, limb.trials["without"])
    return [trial.clock for trial in tracked.trials]


def test_a_tilted_plate_is_no_clock():
    for clock in clocks(Faults(turn=TILT)):
        assert abs(clock.offset) <= 2.5 * clock.offset_sd


def test_a_clock_under_a_tilted_plate_is_found_within_its_interval():
    for clock in clocks(Faults(turn=TILT, clock=0.012)):
        assert abs(clock.offset + 0.012) < 3.0 * clock.offset_sd
        assert abs(clock.offset + 0.012) < 0.004


def test_what_a_tilt_makes_of_a_clock_is_less_than_its_error():
    plain = np.array([clock.offset for clock in clocks(Faults(clock=0.012))])
    tilted = clocks(Faults(turn=TILT, clock=0.012))
    errors = np.array([clock.offset_sd for clock in tilted])
    assert (np.abs(plain - [clock.offset for clock in tilted]) < errors).all()
