"""Positions of the limb's markers and the fixed point, from the motion of one rigid limb."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.swings.viscosity.specimen.model import Specimen
from myomorph.swings.viscosity.tracking.held import nearest_rotations

ROUNDS = 5  # Of Gauss-Newton steps: millimeters are less than a micrometer after three.
MIN_MARKERS = 3  # Of the limb, seen in a frame that takes part.


def shaped(specimen: Specimen, trials: Sequence[Markers]) -> tuple[Specimen, float]:
    """The specimen whose joint's center and markers on the limb are where the motion says (its base
    fixed, held joints locked, nothing slipped), and the root mean square by which markers moved
    against the center [m].

    Places out of a CT or a model do not fit each other and the center to better than some tenths of
    a millimeter, which turns into angles that are too small or too large by a part in a thousand,
    in the same sense in every swing. The limb is one rigid body about one fixed point, so

        marker = center + R x,    center and places x (3,) of every marker the same in all frames

    by least squares (Gauss-Newton steps from which the rotations R are eliminated). How the bones
    stand in the limb is kept: the places as a whole do not turn.
    """
    poses = limb_poses(specimen)
    common = set.intersection(*(set(trial.names) for trial in trials))
    carried = [
        marker
        for marker in specimen.model.markers
        if marker.body in poses and marker.name in common
    ]
    names = [marker.name for marker in carried]
    if len(names) < MIN_MARKERS:
        return specimen, 0.0
    seen = np.concatenate([np.stack([trial[name] for name in names], axis=1) for trial in trials])
    shown = np.isfinite(seen).all(axis=2)
    used = shown.sum(axis=1) >= MIN_MARKERS
    seen = np.where(shown[..., None], seen, 0.0)[used]
    weight = shown[used].astype(np.float64)
    if not len(seen) or (weight.sum(axis=0) == 0.0).any():
        return specimen, 0.0
    places = np.array([poses[marker.body].apply(marker.location) for marker in carried])
    first = places
    center = specimen.center_in_ground
    for _ in range(ROUNDS):
        step = _step(_rotations(places, seen - center, weight), places, seen - center, weight)
        center = center + step[0]
        places = places + step[1:]
        places = places @ _rotations(places, first[None], np.ones((1, len(names))))[0].T
    markers = {marker.name: marker for marker in specimen.model.markers}
    for marker, place in zip(carried, places, strict=True):
        markers[marker.name] = replace(marker, location=poses[marker.body].inverse().apply(place))
    in_base = specimen.stand.inverse().apply(center)
    moved = specimen.with_markers(tuple(markers.values())).centered(
        in_base, specimen.center_in_limb
    )
    return moved, float(np.sqrt(np.square(places - first).sum(axis=1).mean()))


def limb_poses(specimen: Specimen, held: Mapping[str, float] | None = None) -> dict[str, Transform]:
    """Of every bone in the limb's first body, about the joint's center, held joints at these values
    or as they are.
    """
    ground = standing_poses(specimen.model, held)
    first = ground[specimen.first]
    back = Transform(first.rotation, first.apply(specimen.center_in_limb)).inverse()
    return {name: back @ ground[name] for name in specimen.limb}


def _step(rotations: Array, places: Array, seen: Array, weight: Array) -> Array:
    """(1 + markers, 3) change of center and places that fits best what was seen (frames, markers,
    3) from the center; the rotations, nearest at these places, free to follow.
    """
    count = len(places)
    y = np.einsum("fij,mj->fmi", rotations, places)
    e = (seen - y) * weight[..., None]
    N = np.zeros((1 + count, 3, 1 + count, 3))
    total = weight.sum(axis=0)
    across = np.einsum("fm,fij->mij", weight, rotations)
    N[0, :, 0, :] = total.sum() * np.eye(3)
    for m in range(count):
        N[1 + m, :, 1 + m, :] = total[m] * np.eye(3)
        N[0, :, 1 + m, :] = across[m]
        N[1 + m, :, 0, :] = across[m].T
    # What a small rotation of a frame does as well as a change of center or places counts for
    # neither.
    turning = np.zeros((len(y), count, 3, 3))
    turning[..., 2, 1], turning[..., 0, 2], turning[..., 1, 0] = np.moveaxis(y, 2, 0)
    turning = (turning - np.swapaxes(turning, 2, 3)) * weight[..., None, None]
    square = np.einsum("fm,fmk,fmk->f", weight, y, y)[:, None, None] * np.eye(3)
    square = square - np.einsum("fm,fmi,fmj->fij", weight, y, y)
    B = np.concatenate([turning.sum(axis=1)[:, None], turning @ rotations[:, None]], axis=1)
    B = B.transpose(0, 2, 1, 3).reshape(len(y), 3, -1)
    H = N.reshape(3 + 3 * count, -1) - np.einsum(
        "fki,fkj->ij", B, np.linalg.solve(square, B), optimize=True
    )
    g = np.concatenate([e.sum(axis=(0, 1)), np.einsum("fji,fmj->mi", rotations, e).ravel()])
    return np.asarray(np.linalg.lstsq(H, g, rcond=1e-9)[0]).reshape(-1, 3)


def _rotations(places: Array, seen: Array, weight: Array) -> Array:
    """(frames, 3, 3) that turn places (markers, 3) about the origin nearest to those seen (frames,
    markers, 3).
    """
    return nearest_rotations(np.einsum("fm,fmi,mj->fij", weight, seen, places))
