"""Whether the body of a draw could have done what was recorded."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.lab.study.trial.steps.drawn_quantities import Strength, TooWeak


def tension(hip, toes, hip_reserve, toe_reserve):
    """Peaks of torques and of reserves [N m], each reached in one of two frames."""
    return SimpleNamespace(
        coordinates=("hip", "toes"),
        balanced_torque=np.array([[hip, 0.0], [0.0, toes]]),
        reserve_names=("reserve_hip", "reserve_toes", "residual_FX"),
        actuator_force=np.array([[-hip_reserve, toe_reserve, 900.0], [0.0, 0.0, 0.0]]),
    )


@pytest.mark.parametrize(
    ("drawn", "weak"),
    [
        (tension(100.0, 5.0, 24.0, 0.0), False),
        (tension(100.0, 5.0, 26.0, 0.0), True),
        # The same share of a larger torque, and toes, which are not judged.
        (tension(120.0, 5.0, 29.0, 5.0), False),
    ],
)
def test_reserves_may_give_a_fifth_more_than_in_the_result(drawn, weak):
    found = Strength.of(tension(100.0, 5.0, 5.0, 1.0))
    if not weak:
        found.check(drawn)
        return
    with pytest.raises(TooWeak, match="hip gives 26 % of its torque, 25 % at most"):
        found.check(drawn)
