"""Fiber and tendon lengths, force and pennation of muscles in other bones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.bones.morph.checks.moment_arms import Postures
from myomorph.bones.morph.morphed import Architecture, MorphOptions, MuscleChange
from myomorph.bones.morph.transfer.body_transfer import Transfers
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import quoted
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle
from myomorph.core.model.scale import FIBER_LENGTHS
from myomorph.core.muscles.model_paths import compile_paths

USUAL = 0.4, 1.6
"""Normalized fiber lengths of the source that count: beyond, a posture is none that the muscle was
made for.
"""

MIN_COUNT = 10  # Postures that must be among those.
LEAST_TRAVEL = 0.02
"""A path that changes by less than this share of its length tells nothing of the fiber's share in
it.
"""

# A fiber that would grow or shrink so many times more than the path as a whole is not believed.
STEEPEST = 3.0
GREATEST_PENNATION = np.radians(80.0)

# Parameters of muscle classes that are lengths.
OWN_LENGTHS = (*FIBER_LENGTHS, "default_fiber_length")


def path_lengths(
    source: Model, target: Model, postures: Postures, progress: Callable[[int], None] | None
) -> tuple[Array, Array]:
    """Return lengths of the paths of two models that have the same muscles.

    Parameters
    ----------
    source, target : models
    postures : of both, the default posture first
    progress : called with the number of postures just done

    Returns
    -------
    (postures, muscles) lengths of the source and of the target [m]
    """
    of_source = compile_paths(source).evaluate(postures.source, progress=progress)[0]
    of_target = compile_paths(target).evaluate(postures.target, progress=progress)[0]
    return of_source, of_target


@dataclass(frozen=True)
class Growth:
    """Change of a muscle's lengths.

    Path lengths l become slope l + shift, so fibers grow by slope.
    """

    slope: float
    shift: float


@dataclass(frozen=True, eq=False, kw_only=True)
class MuscleTransfer:
    """How muscles get the parameters that the target's bones require.

    Attributes
    ----------
    source : model with the muscles
    target : model with their transferred paths and the source's parameters
    transfers : of the bodies
    options : what is transferred how
    architecture : known fiber lengths and forces, by muscle; tendons of these keep the mean
        normalized fiber length
    """

    source: Model
    target: Model
    transfers: Transfers
    options: MorphOptions
    architecture: Mapping[str, Architecture]

    def muscles(
        self, lengths: tuple[Array, Array]
    ) -> tuple[tuple[Muscle, ...], tuple[MuscleChange, ...], list[str]]:
        """Return the target's muscles with their parameters.

        Parameters
        ----------
        lengths : (postures, muscles) path lengths of source and target [m]

        Returns
        -------
        muscles, what changed in each, and warnings
        """
        owners = {muscle.name: muscle for muscle in self.source.muscles}
        result = []
        changes = []
        doubtful = []
        slack = []
        for i, muscle in enumerate(self.target.muscles):
            before = lengths[0][:, i]
            after = lengths[1][:, i]
            ratio = float(after[0] / before[0]) if before[0] > 0.0 else 1.0
            growth = self._growth(muscle, before[1:], after[1:], ratio)
            if growth is None:
                doubtful.append(muscle.name)
                growth = Growth(ratio, 0.0)
            tendon = growth.slope * muscle.tendon_slack_length + growth.shift
            if muscle.name in self.architecture and not tendon > 0.0:
                slack.append(muscle.name)
            bodies = {point.body for point in owners[muscle.name].path.points}
            changed, force = self._changed(muscle, growth, bodies)
            result.append(changed)
            change = _change(muscle, changed, before[1:], after[1:], ratio, force)
            changes.append(self._with_basis(change, muscle.name))
        return tuple(result), tuple(changes), _unsure(doubtful, slack)

    def _growth(self, muscle: Muscle, before: Array, after: Array, ratio: float) -> Growth | None:
        """Return how a muscle's lengths change; None where paths (postures,) do not show it.

        `ratio`: of the path in the default posture, target over source.
        """
        if muscle.name in self.architecture:
            fiber = self.architecture[muscle.name].fiber
            return _given_growth(muscle, before, after, fiber)
        if self.options.fibers == "range":
            return _range_growth(muscle, before, after, ratio)
        return Growth(1.0 if self.options.fibers == "keep" else ratio, 0.0)

    def _changed(self, muscle: Muscle, growth: Growth, bodies: set[str]) -> tuple[Muscle, float]:
        """Return a muscle after a growth, and its force over the source's."""
        size = float(np.mean([self.transfers[body].size for body in bodies]))
        changed = _with_pennation(with_lengths(muscle, growth), muscle, self.options, size)
        known = self.architecture.get(muscle.name)
        if known is None:
            mass = self.source.mass
            mass_ratio = self.target.mass / mass if mass > 0.0 else 1.0
            force = _force_ratio(self.options, self.transfers, bodies, growth.slope, mass_ratio)
            return _with_force(changed, force, growth.slope), force
        strength = muscle.max_isometric_force
        force = known.force / strength if strength > 0.0 else 1.0
        changed = replace(changed, tendon_slack_length=max(changed.tendon_slack_length, 0.0))
        if known.pennation is not None:
            pennation = min(known.pennation, float(GREATEST_PENNATION))
            changed = replace(changed, pennation_at_optimal=pennation)
        return _with_force(changed, force, growth.slope), force

    def _with_basis(self, change: MuscleChange, muscle: str) -> MuscleChange:
        """Add the basis and the intervals of a muscle's known architecture, where it has one."""
        known = self.architecture.get(muscle)
        if known is None:
            return change
        return replace(
            change,
            basis=known.basis,
            fiber_interval=known.fiber_interval,
            force_interval=known.force_interval,
        )


def _unsure(doubtful: Sequence[str], slack: Sequence[str]) -> list[str]:
    """Warn of muscles whose fibers and tendons paths do not show, or that have no tendon left."""
    notes = []
    if doubtful:
        notes.append(
            "paths do not distinguish fiber from tendon, both scale with the path:"
            f" {quoted(doubtful)}"
        )
    if slack:
        notes.append(
            "paths are shorter than the fibers of the species' tables: without a tendon:"
            f" {quoted(slack)}"
        )
    return notes


def normalized_lengths(muscle: Muscle, lengths: Array) -> Array:
    """Return fiber lengths over the optimal one, with a rigid tendon.

    The fibers keep their thickness.

    Parameters
    ----------
    muscle : with its parameters
    lengths : (...) path lengths [m]

    Returns
    -------
    (...) normalized fiber lengths; NaN for a muscle without an optimal fiber length
    """
    if not muscle.optimal_fiber_length > 0.0:
        return np.full(np.shape(lengths), np.nan)
    along = np.maximum(lengths - muscle.tendon_slack_length, 0.0)
    height = muscle.optimal_fiber_length * np.sin(muscle.pennation_at_optimal)
    return np.sqrt(along**2 + height**2) / muscle.optimal_fiber_length


def _usual(muscle: Muscle, lengths: Array) -> np.ndarray:
    """Which path lengths (postures,) the muscle was made for; all of them where too few are."""
    normal = normalized_lengths(muscle, lengths)
    usual = (normal >= USUAL[0]) & (normal <= USUAL[1])
    return usual if usual.sum() >= MIN_COUNT else np.isfinite(lengths)


def _range_growth(muscle: Muscle, before: Array, after: Array, ratio: float) -> Growth | None:
    """Return the growth that keeps normalized fiber lengths over the range of motion.

    None where the paths do not show it. The fiber along the tendon, in optimal lengths, is (l(q) -
    l_T) / l_0 over postures q. l_0' and l_T' of the target give it the mean and the standard
    deviation that the source's has:

        l_0' / l_0 = sd(l') / sd(l),   l_T' = mean(l') - (l_0' / l_0) (mean(l) - l_T)

    Where both paths change alike this is what least squares over postures give (Modenese et al.
    2016, with a rigid tendon); where they do not, as in another species, least squares would
    shorten the fiber by their correlation and so widen its range.
    """
    usual = _usual(muscle, before)
    x = before[usual]
    y = after[usual]
    if not np.ptp(x) > LEAST_TRAVEL * before[0]:
        return None
    slope = float(y.std() / x.std())
    shift = float(y.mean() - slope * x.mean())
    tendon = slope * muscle.tendon_slack_length + shift
    if (
        not ratio / STEEPEST < slope < ratio * STEEPEST
        or tendon < 0.0 <= muscle.tendon_slack_length
    ):
        return None
    return Growth(slope, shift)


def _given_growth(muscle: Muscle, before: Array, after: Array, fiber: float) -> Growth:
    """Return the growth to a known fiber length.

    The tendon keeps the mean normalized fiber length over postures.
    """
    usual = _usual(muscle, before)
    slope = fiber / muscle.optimal_fiber_length
    return Growth(slope, float(after[usual].mean() - slope * before[usual].mean()))


def with_lengths(muscle: Muscle, growth: Growth) -> Muscle:
    """Scale fibers and tendon of a muscle, and what its class has of both, by a growth."""
    parameters = dict(muscle.parameters)
    for name in OWN_LENGTHS:
        if name in parameters:
            shift = growth.shift if name in ("LT", "lengthrange0", "lengthrange1") else 0.0
            parameters[name] = growth.slope * parameters[name] + shift
    return replace(
        muscle,
        optimal_fiber_length=growth.slope * muscle.optimal_fiber_length,
        tendon_slack_length=growth.slope * muscle.tendon_slack_length + growth.shift,
        parameters=FrozenMap(parameters),
    )


def _with_pennation(muscle: Muscle, before: Muscle, options: MorphOptions, size: float) -> Muscle:
    """Set the pennation that fits the muscle's thickness.

    Thickness is optimal fiber length times the sine of pennation; it grows with the bones if
    that is wanted.
    """
    if options.pennation == "keep" or not muscle.optimal_fiber_length > 0.0:
        return muscle
    sine = (
        np.sin(before.pennation_at_optimal)
        * before.optimal_fiber_length
        * size
        / muscle.optimal_fiber_length
    )
    return replace(
        muscle, pennation_at_optimal=float(min(np.arcsin(min(sine, 1.0)), GREATEST_PENNATION))
    )


def _force_ratio(
    options: MorphOptions, transfers: Transfers, bodies: set[str], fiber: float, mass_ratio: float
) -> float:
    """Return the factor of a muscle's force.

    Force is volume over fiber length times a stress that stays; the bones' volume stands for the
    muscle's.
    """
    if options.force == "keep":
        return 1.0
    if options.force == "area":
        return float(np.mean([transfers[body].size for body in bodies])) ** 2
    if options.force == "mass":
        return mass_ratio / fiber
    return float(np.exp(np.mean([np.log(transfers[body].volume) for body in bodies]))) / fiber


def _with_force(muscle: Muscle, ratio: float, fiber: float) -> Muscle:
    """Scale a muscle's force.

    A damper along the path resists as its muscle pulls, at speeds in fiber lengths.
    """
    parameters = dict(muscle.parameters)
    for name in ("F0", "force"):
        if parameters.get(name, -1.0) > 0.0:
            parameters[name] *= ratio
    if muscle.kind == "mujoco" and "scale" in parameters:
        parameters["scale"] *= ratio
    return replace(
        muscle,
        max_isometric_force=muscle.max_isometric_force * ratio,
        viscosity=muscle.viscosity * ratio / fiber,
        parameters=FrozenMap(parameters),
    )


def _change(
    before: Muscle, after: Muscle, old: Array, new: Array, path: float, force: float
) -> MuscleChange:
    def over(first: float, other: float) -> float:
        return other / first if first > 0.0 else 1.0

    ours = normalized_lengths(before, old)
    theirs = normalized_lengths(after, new)
    return MuscleChange(
        name=before.name,
        path=path,
        fiber=over(before.optimal_fiber_length, after.optimal_fiber_length),
        tendon=over(before.tendon_slack_length, after.tendon_slack_length),
        force=force,
        pennation=after.pennation_at_optimal - before.pennation_at_optimal,
        range_source=(float(ours.min()), float(ours.max())),
        range_target=(float(theirs.min()), float(theirs.max())),
    )
