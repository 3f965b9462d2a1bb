"""Positions of the limb's markers and the fixed point, from the motion of one rigid limb."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import Evaluation, NormalEquations
from myomorph.core.fit.solver import Method, minimize
from myomorph.core.fit.unknowns import Block, Unknown, Unknowns, Values
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Marker
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.swings.viscosity.specimen.model import Specimen
from myomorph.swings.viscosity.tracking.held import nearest_rotations

MIN_MARKERS = 3  # Of the limb, seen in a frame that takes part.
CENTER = "center"
PLACES = "places"
"""The blocks of unknowns."""
# The places may turn as a whole, which no marker shows: no step does. What markers show counts
# frames [1/m^2].
METHOD = Method(iterations=20, tolerance=1e-9, hidden_sd=1e3)


def shaped(specimen: Specimen, trials: Sequence[Markers]) -> tuple[Specimen, float]:
    """Move the joint's center and the limb's markers to where the motion says they are.

    Places out of a CT or a model do not fit each other and the center to better than some tenths of
    a millimeter, which turns into angles that are too small or too large by a part in a thousand,
    in the same sense in every swing. The limb is one rigid body about one fixed point, so

        marker = center + R x,    center and places x (3,) of every marker the same in all frames

    by least squares, from which the rotations R are eliminated. How the bones stand in the limb is
    kept: the places as a whole do not turn.

    Parameters
    ----------
    specimen : its base fixed, held joints locked
    trials : in which nothing slips

    Returns
    -------
    the specimen, and the root mean square by which markers moved against the center [m]
    """
    poses = limb_poses(specimen)
    carried = _carried(specimen, trials, poses)
    if len(carried) < MIN_MARKERS:
        return specimen, 0.0
    seen = _seen(carried, trials)
    if not len(seen.positions) or (seen.weight.sum(axis=0) == 0.0).any():
        return specimen, 0.0
    before = np.array([poses[marker.body].apply(marker.location) for marker in carried])
    center, places = _fitted(seen, specimen.center_in_ground, before)
    markers = {marker.name: marker for marker in specimen.model.markers}
    for marker, place in zip(carried, places, strict=True):
        location = poses[marker.body].inverse().apply(place)
        markers[marker.name] = replace(marker, location=location)
    in_base = specimen.stand.inverse().apply(center)
    moved = specimen.with_markers(tuple(markers.values()))
    moved = moved.centered(in_base, specimen.center_in_limb)
    distances = np.square(places - before).sum(axis=1)
    return moved, float(np.sqrt(distances.mean()))


def limb_poses(specimen: Specimen, held: Mapping[str, float] | None = None) -> dict[str, Transform]:
    """Find the pose of every bone in the limb's first body, about the joint's center.

    Parameters
    ----------
    specimen : with its model
    held : values of held joints; by default as they are
    """
    ground = standing_poses(specimen.model, held)
    first = ground[specimen.first]
    back = Transform(first.rotation, first.apply(specimen.center_in_limb)).inverse()
    return {name: back @ ground[name] for name in specimen.limb}


def _carried(
    specimen: Specimen, trials: Sequence[Markers], poses: Mapping[str, Transform]
) -> list[Marker]:
    """List the markers of the limb that all trials have."""
    common = set.intersection(*(set(trial.names) for trial in trials))
    return [
        marker
        for marker in specimen.model.markers
        if marker.body in poses and marker.name in common
    ]


def _seen(carried: Sequence[Marker], trials: Sequence[Markers]) -> SeenLimb:
    """Join the frames in which enough markers of the limb were seen."""
    names = [marker.name for marker in carried]
    parts = [np.stack([trial[name] for name in names], axis=1) for trial in trials]
    positions = np.concatenate(parts)
    shown = np.asarray(np.isfinite(positions).all(axis=2))
    used = shown.sum(axis=1) >= MIN_MARKERS
    positions = np.where(shown[..., None], positions, 0.0)
    return SeenLimb(positions=positions[used], weight=shown[used].astype(np.float64))


def _fitted(seen: SeenLimb, center: Array, places: Array) -> tuple[Array, Array]:
    """Estimate center (3,) and places (markers, 3), which as a whole stay as they are turned."""
    at_center = tuple(
        Unknown(name=f"center {axis}", unit="m", where="joint", start=value)
        for axis, value in zip("xyz", center.tolist(), strict=True)
    )
    at_places = tuple(
        Unknown(name=f"marker {number} {axis}", unit="m", where="limb", start=value)
        for number, place in enumerate(places.tolist())
        for axis, value in zip("xyz", place, strict=True)
    )
    blocks = (Block(name=CENTER, unknowns=at_center), Block(name=PLACES, unknowns=at_places))
    unknowns = Unknowns(blocks)
    found = Values(unknowns, minimize(Problem(unknowns, (seen,)), method=METHOD).x)
    found_places = found[PLACES].reshape(places.shape)
    back = _rotations(found_places, places[None], np.ones((1, len(places))))[0]
    return found[CENTER], found_places @ back.T


@read_only
class SeenLimb:
    """Markers of one rigid limb about a fixed point, as residuals of that point and their places.

    Attributes
    ----------
    positions : (frames, markers, 3) in ground, 0 where a marker was not seen [m]
    weight : (frames, markers) 1 where it was seen, else 0
    """

    positions: Array
    weight: Array
    name: str = field(default="markers of the limb", init=False)
    blocks: tuple[str, ...] = field(default=(CENTER, PLACES), init=False)
    prior: bool = field(default=False, init=False)

    def at(self, values: Values, before: Evaluation | None = None) -> SeenLimbAt:
        """Evaluate the residuals, with the rotations that are nearest.

        Parameters
        ----------
        values : of the unknowns
        before : not used
        """
        return SeenLimbAt(seen=self, center=values[CENTER], places=values[PLACES].reshape(-1, 3))


@read_only
class SeenLimbAt:
    """Markers of a limb at one center and one set of places.

    Attributes
    ----------
    seen : where markers were seen
    center : (3,) in ground [m]
    places : (markers, 3) from the center, along the limb's axes [m]
    """

    seen: SeenLimb
    center: Array
    places: Array

    @cached_property
    def rotations(self) -> Array:
        """(frames, 3, 3) of the limb, that bring the places nearest to where they were seen."""
        return _rotations(self.places, self.seen.positions - self.center, self.seen.weight)

    @cached_property
    def turned(self) -> Array:
        """(frames, markers, 3) y = R x, places in ground from the center [m]."""
        return np.einsum("fij,mj->fmi", self.rotations, self.places)

    @cached_property
    def errors(self) -> Array:
        """(frames, markers, 3) seen less expected [m]; 0 where a marker was not seen."""
        off = self.seen.positions - self.center - self.turned
        return off * self.seen.weight[..., None]

    @property
    def cost(self) -> float:
        """Sum of squares [m^2]."""
        return float(np.square(self.errors).sum())

    @property
    def count(self) -> int:
        """Count of components that were seen."""
        return 3 * int(self.seen.weight.sum())

    def normal(self) -> NormalEquations:
        """Return the normal equations of center and places, the rotations eliminated.

        A small rotation a of a frame moves its markers by a x y. With w the weights, H and g of
        center c and places x_m at fixed rotations, and of each frame

            S = sum_m w_m (y_m . y_m - y_m y_m^T),    B = [sum_m w_m Y_m,  w_m Y_m R ...]

        (Y the cross products with y) what rotations do as well is taken off: H - sum B^T S^-1 B.
        """
        count = len(self.places)
        weight = self.seen.weight
        rotations = self.rotations
        total = weight.sum(axis=0)
        across = np.einsum("fm,fij->mij", weight, rotations)
        fixed = np.zeros((1 + count, 3, 1 + count, 3))
        fixed[0, :, 0, :] = total.sum() * np.eye(3)
        for m in range(count):
            fixed[1 + m, :, 1 + m, :] = total[m] * np.eye(3)
            fixed[0, :, 1 + m, :] = across[m]
            fixed[1 + m, :, 0, :] = across[m].T

        y = self.turned
        cross = _cross_matrices(y) * weight[..., None, None]
        squares = np.einsum("fm,fmk,fmk->f", weight, y, y)[:, None, None] * np.eye(3)
        squares = squares - np.einsum("fm,fmi,fmj->fij", weight, y, y)
        B = np.concatenate([cross.sum(axis=1)[:, None], cross @ rotations[:, None]], axis=1)
        B = B.transpose(0, 2, 1, 3).reshape(len(y), 3, -1)
        taken = np.einsum("fki,fkj->ij", B, np.linalg.solve(squares, B), optimize=True)

        of_center = self.errors.sum(axis=(0, 1))
        of_places = np.einsum("fji,fmj->mi", rotations, self.errors).ravel()
        return NormalEquations(
            H=fixed.reshape(3 + 3 * count, -1) - taken,
            g=-np.concatenate([of_center, of_places]),
        )


def _cross_matrices(vectors: Array) -> Array:
    """Make the matrices (..., 3, 3) whose products with a are a x v, of vectors v (..., 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    half = np.zeros((*vectors.shape, 3))
    half[..., 2, 1] = x
    half[..., 0, 2] = y
    half[..., 1, 0] = z
    return half - np.swapaxes(half, -1, -2)


def _rotations(places: Array, seen: Array, weight: Array) -> Array:
    """Find the rotations about the origin that bring places nearest to those seen.

    Parameters
    ----------
    places : (markers, 3)
    seen : (frames, markers, 3)
    weight : (frames, markers)

    Returns
    -------
    (frames, 3, 3)
    """
    return nearest_rotations(np.einsum("fm,fmi,mj->fij", weight, seen, places))
