"""How far points may belong from where a match puts them: an error measure that sees sliding along a surface.

The distance between matched surfaces says nothing of points that slid along them. What says something is whether other
ways to the same match agree: back from the target, and with a softer displacement. The radius r within which a point
belongs with 90 % follows from what these differ by at the point, and from the distance d that is left, all in shares of
the bone's length and none below a floor,

    log s = b_0 + sum_k b_k log(d_k + floor) ,    1 / r^2 = 1 / s^2 + 1 / most^2 ,

fitted to known errors as their 90 % quantile (`COEFFICIENTS`, `MOST`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.morph.maps.fields import FeaturePoints
from myomorph.morph.maps.linear import AffineMap
from myomorph.morph.registration.smooth import MatchOptions, SmoothFit, fit_smoothly
from myomorph.morph.shapes.surface_points import Shape

SOFTER, NARROWER = 0.25, 0.5
"""Factors on the stiffness and on the width of the other displacement."""

POINTS = 1200
"""Of each surface in the other displacements, at most."""

FLOOR = 1e-4
"""What is added to the differences, in shares of the bone's length."""

COEFFICIENTS, MOST = (2.867, 0.431, 0.258, 0.491), 0.0592
"""Constant, and of the logarithms of the differences from the softer, the way back, and of what is left; the share of
the bone's length that radii come near, as not even an affine map misses by more. Fitted to attachments: 41 random
deformations of seven bones of a leg, and persons 1, 5, 9, ... 21 of LLP26 as the model has them, which count threefold,
and from a template cut into 80 to 700 triangles, as OpenSim's bones are; tried on others
(`benchmarks/accuracy/morph/correspondence.py`)."""


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
    narrow = max(0.5, NARROWER * options.match_kernel_width)
    softer = replace(few, stiffness=SOFTER * options.stiffness, match_kernel_width=narrow)
    here = fit.apply(points)
    beside = [fit_smoothly(ours, goal, fit.before, landmarks, softer).apply(points) - here]
    turned = None if landmarks is None else FeaturePoints(landmarks.names, landmarks.target, landmarks.source)
    back = fit_smoothly(goal, ours, fit.before.inverse(), turned, few).apply(here) - points
    beside.append(_size(fit.before) * back)
    apart = [np.linalg.norm(difference, axis=1) for difference in beside] + [np.full(len(points), fit.rms)]
    constant, *factors = COEFFICIENTS
    logs = sum(b * np.log(distance + FLOOR) for b, distance in zip(factors, apart, strict=True))
    return np.asarray(1.0 / np.hypot(np.exp(-constant - logs), 1.0 / MOST))


def _size(affine: AffineMap) -> float:
    """Mean stretch of an affine map."""
    return float(np.linalg.svd(affine.matrix, compute_uv=False).mean())
