"""How well lengths and marker positions of a model are known before it is refined."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from myomorph.identify.refine.options import RefineOptions
from myomorph.model.arrays import Array, read_only
from myomorph.model.frozen_map import FrozenMap
from myomorph.motion.calibration import Calibration
from myomorph.motion.lengths import Length

LENGTH_SD, MARKER_SD = 0.02, 0.005
"""Of a length, of itself, and of a marker on a body of human size [m], where neither options nor a calibration state
them."""

SMALLEST_LENGTH_SD, SMALLEST_MARKER_SD = 0.002, 0.001
"""Standard deviations that no calibration is believed to go below, of a length, of itself, and of a marker [m]."""


@dataclass(frozen=True)
class KnownBody:
    """Standard deviations that `calibrate` left of a model.

    Attributes
    ----------
    lengths : by name, of the length, of itself
    markers : by name, (3,) along the axes of the marker's body [m]
    """

    lengths: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    markers: Mapping[str, tuple[float, float, float]] = field(default_factory=lambda: FrozenMap({}))

    @classmethod
    def of(cls, found: Calibration) -> KnownBody:
        """What a calibration found out."""
        return cls(
            FrozenMap({one.length.name: one.sd / one.factor for one in found.lengths}),
            FrozenMap({one.name: (float(one.sd[0]), float(one.sd[1]), float(one.sd[2])) for one in found.markers}),
        )


@read_only
@dataclass(frozen=True, eq=False)
class BodyPrior:
    """The same as arrays, with the options' values where nothing is known.

    Attributes
    ----------
    lengths : (lengths,) standard deviation, of itself
    markers : (markers, 3) along the axes of the bodies [m]
    """

    lengths: Array
    markers: Array

    @classmethod
    def of(
        cls,
        lengths: Sequence[Length],
        markers: Sequence[str],
        known: KnownBody | None,
        options: RefineOptions,
        unit: float,
    ) -> BodyPrior:
        """Prior of these lengths and markers; what the options state goes before what a calibration found.

        Parameters
        ----------
        unit : size of the body against a human's, see `length_unit`
        """
        known = known or KnownBody()
        lengths_given = {} if options.length_sd is not None else known.lengths
        markers_given = {} if options.marker_sd is not None else known.markers
        length_sd = LENGTH_SD if options.length_sd is None else options.length_sd
        marker_sd = MARKER_SD * unit if options.marker_sd is None else options.marker_sd
        of_lengths = np.array([lengths_given.get(one.name, length_sd) for one in lengths], dtype=np.float64)
        of_markers = np.array([markers_given.get(name, (marker_sd,) * 3) for name in markers], dtype=np.float64)
        if options.length_sd is None:
            of_lengths = np.maximum(of_lengths, SMALLEST_LENGTH_SD)
        if options.marker_sd is None:
            of_markers = np.maximum(of_markers, SMALLEST_MARKER_SD * unit)
        return cls(of_lengths, of_markers.reshape(-1, 3))
