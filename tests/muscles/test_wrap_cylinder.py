"""One segment around a cylinder of finite length, unrolled to a plane.

Tested is where the straight line leaves the cylinder.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.muscles.wrap.cylinder import wrap_cylinder
from myomorph.core.muscles.wrap.surface import MANDATORY, NO_WRAP, Half
from myomorph.core.rigid.kernels import kernel

ANGLE = np.deg2rad(170.0)


@kernel
def _wrapped(a, b, radius, length):
    """`wrap_cylinder`, which only kernels may call, on any side, slid to tangency."""
    return wrap_cylinder(a, b, (radius, length), Half(axis=0, side=0), False)


@pytest.mark.parametrize(
    ("rise", "wrapped"), [(1.0, True), (2.0, True), (-2.0, True), (3.0, False), (-3.0, False)]
)
def test_a_path_leaves_a_cylinder_alone_that_it_passes_beyond_both_ends_of_its_arc(rise, wrapped):
    """From height 0 to `rise`, both points two radii from the axis: unrolled the way is straight.

    It touches at 0.4 and 0.6 of the rise; the cylinder ends at heights of 1 and -1.
    """
    code, arc, r, s = _wrapped(
        (2.0, 0.0, 0.0), (2.0 * np.cos(ANGLE), 2.0 * np.sin(ANGLE), rise), 1.0, 2.0
    )
    if not wrapped:
        assert code == NO_WRAP
        return
    assert code == MANDATORY
    across = ANGLE - 2.0 * np.arccos(0.5)
    free = np.sqrt(3.0)
    slope = rise / (2.0 * free + across)
    assert (r[2], s[2]) == pytest.approx((slope * free, slope * (free + across)), rel=0.02)
    assert arc == pytest.approx(np.hypot(across, across * slope), rel=0.02)
