"""The base wrench on a motion that identification did not see, measured and by several models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData, UnknownName
from myomorph.model.inertia import inertial_parameters
from myomorph.model.model import Model
from myomorph.model.series import Motion, Wrenches
from myomorph.rigid.regressor import base_wrench, regressor_blocks


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """The base wrench on a motion that identification did not see, by several models, [D] figure 3.3.

    Attributes
    ----------
    time : (frames,) [s]
    measured : (frames, 6) moment about the base body's origin [N m] and force [N]; NaN where left out
    predicted : (frames, 6) by name
    weight : of the body [N]
    """

    time: Array
    measured: Array
    predicted: Mapping[str, Array]
    weight: float

    @property
    def errors(self) -> Mapping[str, Array]:
        """(frames, 6) predicted less measured, by name."""
        return {name: one - self.measured for name, one in self.predicted.items()}

    def rms(self, name: str) -> Array:
        """(2,) root mean square of the moment's and the force's error vectors [N m], [N].

        Raises
        ------
        UnknownName : no model of that name was compared
        """
        if name not in self.predicted:
            raise UnknownName("model", name, tuple(self.predicted), "the cross-validation")
        error = self.errors[name]
        error = error[np.isfinite(error).all(axis=1)]
        halves = (error[:, :3], error[:, 3:])
        return np.array([np.sqrt(np.mean(np.square(half).sum(axis=1))) for half in halves])

    def table(self) -> Mapping[str, Mapping[str, Array]]:
        """By name: mean of the absolute error, RMS and peak of the six components, and RMS as percent of body weight.

        The percentage of a moment is of body weight times 1 m.
        """
        found = {}
        for name, error in self.errors.items():
            rms = np.sqrt(np.nanmean(np.square(error), axis=0))
            found[name] = {
                "mean": np.nanmean(np.abs(error), axis=0),
                "rms": rms,
                "peak": np.nanmax(np.abs(error), axis=0),
                "percent": 100.0 * rms / self.weight,
            }
        return found


def cross_validate(
    models: Mapping[str, Model], motion: Motion, wrenches: Wrenches, use: np.ndarray | None = None
) -> CrossValidation:
    """Measured and predicted base wrench of models that share their bodies and joints.

    Parameters
    ----------
    motion : with derivatives, through the same filter as the wrenches, on the same clock
    use : (frames,) which frames count, as `Usable.recording.use`

    Raises
    ------
    BadData : no model, or models with other bodies
    """
    if not models:
        raise BadData("cross-validation needs at least one model")
    one = next(iter(models.values()))
    for name, other in models.items():
        if other.body_names != one.body_names:
            raise BadData(f"model '{name}' has other bodies than the rest: cross-validate models of one skeleton")
    measured = base_wrench(one, motion, wrenches)
    if use is not None:
        measured[~np.asarray(use)] = np.nan
    parameters = np.stack([inertial_parameters(other).ravel() for other in models.values()], axis=1)
    blocks = [np.array(block.rows @ parameters) for block in regressor_blocks(one, motion)]
    predicted = np.concatenate(blocks)
    weight = one.mass * float(np.linalg.norm(one.gravity))
    return CrossValidation(
        motion.time,
        frozen_array(measured),
        MappingProxyType({name: frozen_array(predicted[:, :, i]) for i, name in enumerate(models)}),
        weight,
    )
