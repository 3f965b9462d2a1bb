"""What drives a simulated body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.forward.contact_law import NO_GROUND, Ground


@dataclass(frozen=True, eq=False, kw_only=True)
class Drives:
    """Torques or muscles' activations over time, external forces, and a motion to follow.

    Values are straight between samples, and stay as they are before the first and after the last.

    Attributes
    ----------
    torques : generalized forces by coordinate, as of `inverse_dynamics` [N m or N]. They hold what
        muscles and passive tissue do, so these take no part
    activations : by muscle; what has none is at rest
    excitations : by muscle, in the place of activations, which then follow them
    reserves : generalized forces by coordinate that act beside muscles and passive tissue, as those
        that a solution of tensions needed [N m or N]
    loads : external forces on bodies
    ground : that spheres on the body touch
    follow : motion that a feedback pulls to, with velocities
    feedback : natural frequency of the feedback, critically damped [Hz]
    """

    torques: Series | None = None
    activations: Series | None = None
    excitations: Series | None = None
    reserves: Series | None = None
    loads: Wrenches | None = None
    ground: Ground = NO_GROUND
    follow: Motion | None = None
    feedback: float = 0.0

    @property
    def last_time(self) -> float | None:
        """When what is known of the drives ends [s]; None where nothing is."""
        tables = (
            self.torques,
            self.activations,
            self.excitations,
            self.reserves,
            self.loads,
            self.follow,
        )
        ends = [float(table.time[-1]) for table in tables if table is not None]
        return min(ends) if ends else None

    def muscles_at(self, model: Model, time: float) -> Array:
        """Activations or excitations at a time.

        Parameters
        ----------
        model : whose muscles are driven
        time : [s]

        Returns
        -------
        (muscles,) 0 of those that nothing drives
        """
        values = np.zeros(len(model.muscles))
        driven = self.activations if self.excitations is None else self.excitations
        for column, name in enumerate(() if driven is None else driven.names):
            assert driven is not None
            at = np.interp(time, driven.time, driven.values[:, column])
            values[model.muscle_names.index(name)] = at
        return values

    def check(self, model: Model) -> None:
        """Check that the drives are those of a model, and do not exclude each other.

        Raises
        ------
        BadData : torques and muscles are given, or activations and excitations, or no velocities
        UnknownName : a column is no coordinate, muscle or body of the model
        """
        given = [
            name
            for name in ("torques", "activations", "excitations")
            if getattr(self, name) is not None
        ]
        if len(given) > 1:
            raise BadData(
                f"{given[0]} and {given[1]} are given: torques contain the muscles, and"
                " activations follow excitations, so give one of them"
            )
        if self.torques is not None and self.reserves is not None:
            raise BadData(
                "torques and reserves are given: torques hold what reserves do, so give reserves"
                " with activations"
            )
        known = (
            ("coordinate", self.torques, model.coordinate_names),
            ("coordinate", self.reserves, model.coordinate_names),
            ("muscle", self.activations, model.muscle_names),
            ("muscle", self.excitations, model.muscle_names),
            ("coordinate", self.follow, model.coordinate_names),
        )
        for kind, series, names in known:
            for name in () if series is None else series.names:
                if name not in names:
                    raise UnknownName(kind, name, existing=names, where="the model")
        if self.follow is not None and self.follow.velocities is None:
            raise BadData("a motion to follow needs velocities: differentiate it first")
        if not 0.0 <= self.feedback < 1000.0:
            raise BadData(
                f"the feedback's frequency is {self.feedback:g} Hz: expected 0 (none) to 1000"
            )


NO_DRIVES = Drives()
