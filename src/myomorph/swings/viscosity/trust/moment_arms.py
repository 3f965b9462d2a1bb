"""How far the muscles' viscosity follows an error of their moment arms.

[S] blames these errors for the spread of its own. Attachments come from another body unless they
were digitized on the specimen: d_M's interval holds their error (`attachments`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.swings.viscosity.identification.torque import (
    FIRST,
    JOINT,
    TORQUE,
    muscle_problem,
    torque_problem,
)
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.swings.sums import eliminated, swing_sums

ATTACHMENT = 13.3e-3
"""Mean distance between an attachment carried over from another body's bone and the true one, SD
8.1 mm; legs (Pellikaan, Carbone, Fluit, van der Krogt, Verdonschot, Koopman 2013) [m].
"""
OFFSET = float(ATTACHMENT / np.sqrt(8.0 / np.pi))
"""Standard deviation of each component of such a distance, 8.3 mm, and about that of the moment
arms that follow: points of a muscle moved so on each bone change its arms by 1.0 to 1.3 times as
much (`docs/validation`) [m].
"""
ANGLE = JOINT + 1
CONSTANT = JOINT + 2  # Columns beside torque and rate, of what a spring explains.


@dataclass(frozen=True)
class MomentArmOptions:
    """Settings of `moment_arm_sensitivity` and of `attachments.with_attachments`.

    Attributes
    ----------
    factor : standard deviation of the factors, relative
    offset : of each component of an offset [m]; d_M's interval holds it; 0 where the attachments
        were digitized on the specimen itself
    draws, seed : of the errors
    stiffness : as in `ViscosityOptions`
    """

    factor: float = 0.10
    offset: float = OFFSET
    draws: int = 1000
    seed: int = 0
    stiffness: bool = True

    def __post_init__(self) -> None:
        if not (0.0 < self.factor < 1.0 and self.offset >= 0.0 and self.draws >= 2):
            raise BadData(
                "errors of moment arms: expected factor within 0 and 1 and at least 2 draws, but"
                f" got {self}"
            )


@read_only
class MomentArmSpread:
    """What one kind of error does to d_M, the common viscosity of the muscles.

    Attributes
    ----------
    kind : "one factor" for all; "factor of each muscle"; "offset of each muscle", of its arms,
        constant in the limb's axes
    error : standard deviation of the factor, relative, or of each component of the offset [m]
    exact : d_M with the arms as given [N s/m]
    draws : (draws,) of d_M [N s/m]
    """

    kind: str
    error: float
    exact: float
    draws: Array

    @property
    def sd(self) -> float:
        """Standard deviation of d_M, relative to the exact value."""
        return float(np.std(self.draws) / self.exact)

    @property
    def bias(self) -> float:
        """Mean of d_M less the exact value, relative to that."""
        return float(np.mean(self.draws) / self.exact - 1.0)

    def quantiles(self) -> Array:
        """Find 2.5, 50 and 97.5 % of d_M.

        Returns
        -------
        (3,) [N s/m]
        """
        return np.quantile(self.draws, (0.025, 0.5, 0.975))


def moment_arm_sensitivity(
    intact: Sequence[SwingRecording],
    parameters: Array,
    joint: float | Array,
    options: MomentArmOptions | None = None,
) -> tuple[MomentArmSpread, ...]:
    """Draw d_M with every muscle's moment arms systematically wrong, by each kind of error.

    The common value of swings with muscles, less d_J of those without, is d_M = v g / v H v with
    v_m the square of the factor of muscle m, so a factor s of all arms makes it d_M / s^2.

    Parameters
    ----------
    intact : recordings with muscles
    parameters : (10,) of the limb
    joint : d_J, one value or one an axis [N m s/rad]
    options : sizes of the errors

    Returns
    -------
    the spread of each kind

    Raises
    ------
    BadData : the swings show no viscosity of muscles
    """
    options = options or MomentArmOptions()
    random = np.random.default_rng(options.seed)
    sums = swing_sums(intact)
    torque = torque_problem(sums.torque_total(np.ones(len(sums))), parameters, options.stiffness)
    problem = muscle_problem(
        torque, np.broadcast_to(np.asarray(joint, dtype=np.float64), (len(sums.axes),))
    )
    n = len(problem.g)
    exact = problem.along(np.ones(n)) if n else 0.0
    if not exact > 0.0:
        raise BadData("sensitivity to moment arms: these swings show no viscosity of muscles")
    spreads = []
    for kind, own in (("one factor", 1), ("factor of each muscle", n)):
        v = (1.0 + options.factor * random.standard_normal((options.draws, own)) * np.ones(n)) ** 2
        draws = np.maximum(v @ problem.g, 0.0) / np.einsum("di,ij,dj->d", v, problem.H, v)
        spreads.append(MomentArmSpread(kind=kind, error=options.factor, exact=exact, draws=draws))
    if options.offset > 0.0:
        spreads.append(_by_offsets(intact, parameters, joint, options, random))
    return tuple(spreads)


def _by_offsets(
    intact: Sequence[SwingRecording],
    parameters: Array,
    joint: float | Array,
    options: MomentArmOptions,
    random: np.random.Generator,
) -> MomentArmSpread:
    """Draw d_M with offsets of the moment arms.

    With J + delta the torque u = (J + delta) ((J + delta) . w) is a sum of products that do not
    change.
    """
    sums = swing_sums(intact)
    parts = [
        _offset_columns(intact[i], use, parameters)
        for i, use in zip(sums.trial, sums.uses, strict=True)
    ]
    columns = np.concatenate(parts).transpose(1, 0, 2)
    products = columns.transpose(0, 2, 1) @ columns
    if options.stiffness:
        products = eliminated(products, [ANGLE, CONSTANT])
    count, axes = intact[0].lengthening.shape[1:]
    damping = np.broadcast_to(np.asarray(joint, dtype=np.float64), (axes,))

    def common(delta: Array) -> float:
        maps = _offset_maps(delta)
        return muscle_problem(maps.transpose(0, 2, 1) @ products @ maps, damping).along(
            np.ones(count)
        )

    # A strand's row holds its arm divided by the root of its muscle's strands, and so its error
    # does.
    table = intact[0].strands_of
    roots = np.sqrt(table @ table.sum(axis=0))[:, None]
    draws = [
        common(options.offset / roots * random.standard_normal((count, axes)))
        for _ in range(options.draws)
    ]
    exact = common(np.zeros((count, axes)))
    return MomentArmSpread(
        kind="offset of each muscle",
        error=float(options.offset),
        exact=exact,
        draws=np.array(draws),
    )


def _offset_columns(swing_recording: SwingRecording, use: np.ndarray, parameters: Array) -> Array:
    """Put a block's frames in columns (frames, axes, 5 + n).

    They are torque, rate, resisted, angle, one; of every muscle u, J . w and J_a w; w.
    """
    rates = swing_recording.rates[use]
    J = swing_recording.lengthening[use]
    frames, axes = rates.shape
    speeds = np.einsum("fma,fa->fm", J, rates)
    columns = [
        (swing_recording.torque_rows[use] @ parameters)[:, :, None],
        rates[:, :, None],
        swing_recording.resisted[use][:, :, None],
        swing_recording.angles[use][:, :, None],
        np.ones((frames, axes, 1)),
        (J * speeds[:, :, None]).transpose(0, 2, 1),
        np.broadcast_to(speeds[:, None], (frames, axes, speeds.shape[1])),
        np.einsum("fma,fb->famb", J, rates).reshape(frames, axes, -1),
        np.broadcast_to(rates[:, None], (frames, axes, axes)),
    ]
    return np.concatenate(columns, axis=2)


def _offset_maps(delta: Array) -> Array:
    """Combine `_offset_columns` to torque, resisted and u with arms that are off.

        u_a = J_a (J . w) + delta_a (J . w) + sum_b delta_b J_a w_b + delta_a delta . w

    Parameters
    ----------
    delta : (muscles, axes) [m/rad]

    Returns
    -------
    (axes, 5 + n, 3 + muscles)
    """
    count, axes = delta.shape
    muscle = np.arange(count)
    maps = np.zeros((axes, CONSTANT + 1 + (2 + axes) * count + axes, FIRST + count))
    maps[:, TORQUE, TORQUE] = maps[:, JOINT, JOINT] = 1.0
    start = CONSTANT + 1
    maps[:, start + muscle, FIRST + muscle] = 1.0
    maps[:, start + count + muscle, FIRST + muscle] = delta.T
    for b in range(axes):
        maps[:, start + 2 * count + axes * muscle + b, FIRST + muscle] = delta[:, b]
        maps[:, -axes + b, FIRST:] = delta.T * delta[:, b]
    return maps
