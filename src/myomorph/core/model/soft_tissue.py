"""Motion of the body's mass below markers on soft tissue, which move more, the faster the more.

The skin follows the bone and the mass about it as a body on a spring does below its resonance w_0:
its motion is larger by 1 / (1 - w^2 / w_0^2). So coordinates tracked by markers are brought back by

    q_body = q / (1 + alpha w^2),   alpha = 1 / w_0^2,

which keeps what is slow, and takes from accelerations what no plate measures. Source: Pain and
Challis 2006; Zelik and Kuo 2010, for soft tissue that moves apart from bones; Wakeling and Nigg
2001 for its frequencies.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, checked_array, read_only, runs
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.series import Motion
from myomorph.core.model.sides import split_side


@read_only
class SoftTissue:
    """Excess motion of a model's coordinates over that of the body's mass.

    Attributes
    ----------
    names : of coordinates
    groups : (coordinates,) the group of each; those of a group have the same alpha
    alpha : (coordinates,) [s^2]; 0 for coordinates whose motion is that of the mass
    sd : (coordinates,) standard deviation of alpha [s^2]
    """

    names: tuple[str, ...]
    groups: tuple[str, ...]
    alpha: Array
    sd: Array

    def __post_init__(self) -> None:
        shape = (len(self.names),)
        for label, values in (("alpha", self.alpha), ("its standard deviations", self.sd)):
            checked_array(values, shape, f"soft tissue: {label}, one value a coordinate,")
        positive = np.isfinite(self.alpha) & (self.alpha >= 0.0)
        if len(self.groups) != len(self.names) or not positive.all():
            raise BadData(
                "soft tissue: expected a group and an alpha of 0 s^2 or more for every coordinate"
            )

    @property
    def by_group(self) -> dict[str, tuple[float, float]]:
        """Alpha and its standard deviation by group [s^2]."""
        values = zip(self.alpha.tolist(), self.sd.tolist(), strict=True)
        return dict(zip(self.groups, values, strict=True))

    @property
    def words(self) -> str:
        """Alpha of each group, for a line of output."""
        parts = [f"{name} {1e4 * alpha:.1f}" for name, (alpha, _) in self.by_group.items()]
        return ", ".join(parts) + " · 1e-4 s^2"

    def shown(self, motion: Motion) -> Array:
        """Coordinates that markers show of the mass's motion: q - alpha q'', the inverse of `of`.

        Parameters
        ----------
        motion : of the mass, with accelerations

        Returns
        -------
        (frames, coordinates) [rad or m]
        """
        assert motion.accelerations is not None
        by_name = dict(zip(self.names, self.alpha.tolist(), strict=True))
        alpha = [by_name.get(name, 0.0) for name in motion.names]
        return np.asarray(motion.values - motion.accelerations * alpha)

    def of(self, motion: Motion) -> Motion:
        """Motion of the mass: the low-pass 1 / (1 + alpha w^2) of every coordinate, zero lag.

        Accelerations are filtered, each unbroken run of frames by itself, and velocities and values
        changed by alpha times their derivatives, so that a steady movement stays as it is:

            a - alpha a'' = q'',   q += alpha a,   q' += alpha a'

        Parameters
        ----------
        motion : that markers show, with derivatives

        Raises
        ------
        BadData : the motion has no derivatives
        """
        if motion.velocities is None or motion.accelerations is None:
            raise BadData(
                "soft tissue is taken from a motion with derivatives: differentiate it first"
            )
        step = float(np.median(np.diff(motion.time))) if len(motion) > 1 else 1.0
        values = np.array(motion.values)
        velocities = np.array(motion.velocities)
        accelerations = np.array(motion.accelerations)
        alphas = dict(zip(self.names, self.alpha.tolist(), strict=True))
        for column, name in enumerate(motion.names):
            alpha = alphas.get(name, 0.0)
            if not alpha > 0.0:
                continue
            for start, stop in runs(np.isfinite(accelerations[:, column])):
                frames = slice(start, stop)
                soft = _smoothed(accelerations[frames, column], alpha / step**2)
                values[frames, column] += alpha * soft
                jerk = np.gradient(soft, step) if len(soft) > 1 else 0.0
                velocities[frames, column] += alpha * jerk
                accelerations[frames, column] = soft
        return replace(motion, values=values, velocities=velocities, accelerations=accelerations)


def slow_part(time: Array, values: Array, alpha: float) -> Array:
    """Pass signals through 1 / (1 + alpha w^2), each unbroken run of frames by itself.

    Parameters
    ----------
    time : (frames,) evenly spaced [s]
    values : (frames, columns), NaN where missing
    alpha : [s^2]

    Returns
    -------
    (frames, columns)

    Examples
    --------
    >>> import numpy as np
    >>> from myomorph.core.model.soft_tissue import slow_part
    >>> time = np.arange(0.0, 4.0, 0.005)
    >>> fast = np.sin(40.0 * time)[:, None]
    >>> round(float(slow_part(time, fast, 4e-4)[200:600].max()), 2)
    0.61
    """
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    slow = np.array(values)
    for column in range(values.shape[1]):
        for start, stop in runs(np.isfinite(values[:, column])):
            frames = slice(start, stop)
            slow[frames, column] = _smoothed(values[frames, column], alpha / step**2)
    return slow


def _smoothed(values: Array, stiffness: float) -> Array:
    """Solve y - stiffness y'' = values, with differences of neighbors for y'', level at both ends.

    Parameters
    ----------
    values : (frames,)
    stiffness : in squares of the time between frames

    Returns
    -------
    (frames,)
    """
    band = np.empty((2, len(values)))
    band[0] = -stiffness
    band[1] = 1.0 + 2.0 * stiffness
    band[1, [0, -1]] -= stiffness
    if len(values) < 2:
        return values
    return scipy.linalg.solveh_banded(band, values)


def coordinate_groups(model: Model) -> tuple[str, ...]:
    """Group the coordinates: translation of the base, its rotation, and what hangs on one joint.

    Both sides are one group: legs, and trunk with arms.

    Returns
    -------
    the group of each coordinate
    """
    parents = {joint.child: joint.parent for joint in model.joints}
    roots = {GROUND, *(child for child, parent in parents.items() if parent == GROUND)}
    groups = dict[str, str]()
    for joint in model.joints:
        limb = joint.child
        while parents[limb] not in roots and parents[limb] in parents:
            limb = parents[limb]
        for name in joint.coordinates:
            if joint.parent != GROUND:
                groups[name] = split_side(limb)[0]
                continue
            translates = model.coordinate(name).motion == "translational"
            kind = "translation" if translates else "rotation"
            groups[name] = f"{joint.child}, {kind}"
    return tuple(groups.get(name, "") for name in model.coordinate_names)
