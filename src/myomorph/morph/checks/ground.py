"""What paths are held against: bones, poses, and how deep each may run through them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from myomorph.model.model import Model
from myomorph.morph.checks.moment_arms import CoordinatePair, paired_values
from myomorph.morph.checks.penetration import Depth, Poses, Solid, path_depths, range_poses
from myomorph.morph.checks.warnings import CheckOptions
from myomorph.morph.maps.fields import BoneMap


@dataclass(frozen=True, eq=False)
class Ground:
    """What paths are held against.

    Attributes
    ----------
    target : bones, by body
    poses : in which paths are looked at
    deeper : how much deeper than the source's, in the target's size, a path may run, as a share of the bone's length
    allowed : by muscle and body of the target how deep its path may run [m]; the share for those that are not there
    """

    target: Mapping[str, Solid]
    poses: Poses
    deeper: float
    allowed: Mapping[tuple[str, str], float]

    @staticmethod
    def of(
        source: Model,
        target: Model,
        bones: Iterable[BoneMap],
        pairs: Sequence[CoordinatePair],
        options: CheckOptions,
    ) -> Ground | None:
        """The bones of which both surfaces are known; None where there is none."""
        known = {bone.body: bone for bone in bones if bone.source is not None and bone.target is not None}
        if not known:
            return None
        values, target_values = paired_values(source, target, pairs, options.poses)
        ours = {body: Solid(bone.source) for body, bone in known.items() if bone.source is not None}
        allowed: dict[tuple[str, str], float] = {}
        poses = range_poses(source, [pair.source for pair in pairs], values)
        for (muscle, body), depth in path_depths(source, ours, poses).items():
            key, size = (muscle, known[body].target_body), known[body].whole.scale
            allowed[key] = max(allowed.get(key, 0.0), size * depth.depth)
        return Ground(
            {bone.target_body: Solid(bone.target) for bone in known.values() if bone.target is not None},
            range_poses(target, [pair.target for pair in pairs], target_values),
            options.deeper,
            allowed,
        )

    def too_deep(self, model: Model, muscles: Sequence[str]) -> Iterator[tuple[str, Depth, float]]:
        """Muscles that run deeper through a bone than they may, where, and by how much [m]."""
        for (muscle, body), depth in path_depths(model, self.target, self.poses, muscles).items():
            over = depth.depth - self.allowed.get((muscle, body), 0.0) - self.deeper * self.target[body].length
            if over > 0.0:
                yield muscle, depth, over

    def excess(self, model: Model, muscles: Sequence[str]) -> dict[str, float]:
        """By muscle how much too deep it runs at most, where it does [m]."""
        result: dict[str, float] = {}
        for muscle, _, over in self.too_deep(model, muscles):
            result[muscle] = max(result.get(muscle, 0.0), over)
        return result
