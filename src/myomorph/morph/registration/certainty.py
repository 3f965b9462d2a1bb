"""How far points may belong from where a match puts them: an error measure that sees sliding along a surface.

The distance between matched surfaces says nothing of points that slid along them. What says something is whether other
ways to the same match agree: back from the target, with a stiffer and with a softer displacement. The radius r within
which a point belongs with 90 % follows from what they differ by at the point, and from the distance d that is left, all
in shares of the bone's length and none below a floor,

    log s = b_0 + sum_k b_k log(d_k + floor) ,    r^2 = s^2 + between^2 ,

fitted to known errors as their 90 % quantile (`COEFFICIENTS`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.morph.maps.fields import FeaturePoints
from myomorph.morph.maps.linear import AffineMap
from myomorph.morph.registration.smooth import MatchOptions, SmoothFit, fit_smoothly
from myomorph.morph.shapes.surface_points import Shape

STIFFER, SOFTER, NARROWER = 4.0, 0.25, 0.5
"""Factors on the stiffness of the other displacements, and on the width of the softer one."""

POINTS = 1200
"""Of each surface in the other displacements, at most."""

FLOOR = 1e-4
"""What is added to the differences, in shares of the bone's length."""

BETWEEN = 0.004
"""What the map between matched points, and putting points back on the surface, add, in shares of the bone's length."""

COEFFICIENTS = (3.594, 0.131, 0.504, 0.193, 0.429)
"""Constant, and of the logarithms of the differences from the stiffer, the softer, the way back, and of what is left.
Fitted to 35 random deformations of seven bones of a leg and to persons 1, 5, 9, ... of LLP26, each kind counting half;
tried on others (`benchmarks/accuracy/morph/correspondence.py`)."""


def match_radii(
    ours: Shape,
    goal: Shape,
    fit: SmoothFit,
    points: Array,
    landmarks: FeaturePoints | None,
    options: MatchOptions,
) -> Array:
    """Distances (n,) within which points (n, 3) of the source belong with 90 %, in shares of the bone's length.

    Parameters
    ----------
    ours, goal : surfaces of about unit length
    fit : of the source onto the target
    """
    few = replace(options, match_points=min(POINTS, options.match_points))
    stiffer = fit_smoothly(ours, goal, fit.before, landmarks, replace(few, stiffness=STIFFER * options.stiffness))
    narrow = max(0.5, NARROWER * options.match_kernel_width)
    softer = replace(few, stiffness=SOFTER * options.stiffness, match_kernel_width=narrow)
    here = fit.apply(points)
    beside = [
        stiffer.apply(points) - here,
        fit_smoothly(ours, goal, fit.before, landmarks, softer).apply(points) - here,
    ]
    turned = None if landmarks is None else FeaturePoints(landmarks.names, landmarks.target, landmarks.source)
    back = fit_smoothly(goal, ours, fit.before.inverse(), turned, few).apply(here) - points
    beside.append(_size(fit.before) * back)
    apart = [np.linalg.norm(one, axis=1) for one in beside] + [np.full(len(points), fit.rms)]
    constant, *factors = COEFFICIENTS
    logs = sum(b * np.log(one + FLOOR) for b, one in zip(factors, apart, strict=True))
    return np.asarray(np.hypot(np.exp(constant + logs), BETWEEN))


def _size(affine: AffineMap) -> float:
    """Mean stretch of an affine map."""
    return float(np.linalg.svd(affine.matrix, compute_uv=False).mean())
