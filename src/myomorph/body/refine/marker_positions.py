"""Positions of markers on their bodies as unknowns of `refine`: shifts from the given model's."""

from __future__ import annotations

import numpy as np

from myomorph.body.refine.kind import Here, Kind, KindSlopes, PriorRows, Setup
from myomorph.body.refine.options import MARKERS
from myomorph.core.fit.unknowns import Block, Unknown
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.rigid.coordinates import Ints

MARKER_SD = 0.015  # By default, of a position along one axis on a body of human size [m]


@read_only
class OwnSlopes(KindSlopes):
    """Slopes of markers that move with their own positions alone.

    Attributes
    ----------
    rotations : (frames, markers, 3, 3) from each marker's body to the ground
    """

    rotations: Array | None = None

    def markers_in(self, frames: Ints) -> Array | None:
        """Spread the rotations of some frames over the diagonal.

        Parameters
        ----------
        frames : (chosen,) numbers

        Returns
        -------
        (chosen, 3 markers, 3 markers)
        """
        assert self.rotations is not None
        chosen = self.rotations[frames]
        count = chosen.shape[1]
        slopes = np.zeros((len(frames), count, 3, count, 3))
        each = np.arange(count)
        slopes[:, each, :, each] = np.swapaxes(chosen, 0, 1)
        return slopes.reshape(len(frames), 3 * count, 3 * count)


@read_only
class MarkerPositions(Kind):
    """Shifts of markers.

    Attributes
    ----------
    names : of the markers
    sd : standard deviation along one axis before anything is measured [m]
    """

    names: tuple[str, ...]
    sd: float

    name = MARKERS
    moves_markers = True

    @classmethod
    def of(cls, setup: Setup) -> MarkerPositions:
        """Take the markers that are tracked."""
        sd = setup.options.marker_sd
        return cls(names=setup.markers, sd=MARKER_SD * setup.unit if sd is None else sd)

    def start(self) -> Array:
        """Take the model's positions.

        Returns
        -------
        (markers, 3) shifts of 0 [m]
        """
        return np.zeros((len(self.names), 3))

    def block(self, values: Array) -> Block:
        """List the shifts.

        Parameters
        ----------
        values : (markers, 3) where the search begins [m]

        Returns
        -------
        three unknowns for each marker
        """
        axes = [(name, axis) for name in self.names for axis in "xyz"]
        unknowns = [
            Unknown(
                name=f"{name} {axis}",
                unit="m",
                where=f"marker {name}: {axis} on its body",
                start=float(shift),
            )
            for (name, axis), shift in zip(axes, values.ravel(), strict=True)
        ]
        return Block(name=MARKERS, unknowns=tuple(unknowns))

    def locations(self, locations: Array, values: Array) -> Array:
        """Shift positions of markers.

        Parameters
        ----------
        locations : (markers, 3) on stretched bodies [m]
        values : (markers, 3) shifts [m]

        Returns
        -------
        (markers, 3) [m]
        """
        return locations + values

    def slopes(self, here: Here) -> OwnSlopes:
        """Differentiate markers in their own positions: the rotations of their bodies.

        Markers are linear in positions, so that a step of 1 has no error.
        """
        errors = here.predicted.errors
        markers = here.setting.markers
        rotations = np.empty((*errors.shape, 3))
        for axis in range(3):
            shifted = markers._replace(location=markers.location + np.eye(3)[axis])
            other = here.problem.predict(here.setting._replace(markers=shifted), here.state)
            rotations[:, :, :, axis] = other.errors - errors
        return OwnSlopes(rotations=rotations)

    def prior_rows(self, values: Array) -> PriorRows:
        """Compare shifts with 0.

        Parameters
        ----------
        values : (markers, 3) [m]

        Returns
        -------
        misses in standard deviations
        """
        return PriorRows(rows=np.eye(values.size) / self.sd, misses=values.ravel() / self.sd)
