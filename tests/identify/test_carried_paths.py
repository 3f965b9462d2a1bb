"""Jumps of muscle paths in a transferred model, told apart from those of the model as given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.identify.carried_paths import carried_paths, motion_hops
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform

HERE = Transform.identity()
ENTERS = 0.3  # Of the hinge, where a path through a conditional point snaps to it [rad].
BULGE = 0.02  # How far that point lies off the straight path [m].


def straight(name: str) -> Muscle:
    """Make a muscle from ground to the limb without a point between."""
    ends = (
        PathPoint("a", GROUND, np.array([0.0, 0.1, 0.0])),
        PathPoint("b", "limb", np.array([0.0, -0.1, 0.0])),
    )
    return Muscle(
        name=name,
        kind="Thelen2003Muscle",
        path=Path(ends),
        max_isometric_force=1.0,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.1,
    )


def snapping(name: str) -> Muscle:
    """Make the same through a point that counts only where the hinge is bent enough."""
    muscle = straight(name)
    first, last = muscle.path.points
    between = PathPoint(
        "c", GROUND, np.array([BULGE, 0.05, 0.0]), coordinate="bend", range=(ENTERS, 9.0)
    )
    return replace(muscle, path=Path((first, between, last)))


def limb(*muscles: Muscle) -> Model:
    """Make a limb on a hinge."""
    bend = Axis(
        kind="rotation",
        vector=np.array([0.0, 0.0, 1.0]),
        function=linear(1.0),
        coordinates=("bend",),
    )
    hinge = Joint(
        name="hinge",
        kind="CustomJoint",
        parent=GROUND,
        child="limb",
        parent_frame=HERE,
        child_frame=HERE,
        axes=(bend,),
        coordinates=("bend",),
    )
    return Model(
        name="limb",
        bodies=(Body(name="limb", mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3)),),
        joints=(hinge,),
        coordinates=(Coordinate("bend"),),
        gravity=np.zeros(3),
        muscles=muscles,
    )


def bent(frames: int = 101) -> Motion:
    """Bend the hinge for a second through the angle at which paths snap."""
    time = np.linspace(0.0, 1.0, frames)
    return Motion(time, ("bend",), 0.6 * time[:, None])


def test_own_jumps_are_known_from_new_ones():
    given = limb(straight("calm"), snapping("own"), straight("new"), snapping("gone"))
    after = limb(straight("calm"), snapping("own"), snapping("new"), straight("gone"))
    found = carried_paths(given, after, bent())
    assert found is not None
    assert found.own == ("own",)
    assert found.new == ("new",)
    assert (found.given > 0.0).tolist() == [False, True, False, True]
    # What the point adds to the straight path where it begins to count.
    ends = np.array([0.0, 0.1]), 0.1 * np.array([np.sin(ENTERS), -np.cos(ENTERS)])
    point = np.array([BULGE, 0.05])
    added = sum(np.linalg.norm(end - point) for end in ends) - np.linalg.norm(ends[0] - ends[1])
    assert found.transferred[2] == pytest.approx(added, abs=5e-4)


def test_a_motion_that_hops_is_named_and_no_path_is_blamed():
    """The hinge hops by a radian half way: every path jumps there, and none of its own."""
    motion = Motion(bent().time, ("bend",), 0.4 * bent().values)
    values = motion.values + np.where(motion.time >= 0.505, -1.0, 0.0)[:, None]
    model = limb(snapping("one"), straight("two"))
    found = carried_paths(model, model, replace(motion, values=values))
    assert found is not None
    assert found.own == found.new == ()
    (hop,) = found.hops
    assert hop.coordinate == "bend"
    assert hop.time == pytest.approx(0.51)
    assert hop.size == pytest.approx(1.0, abs=0.01)
    smooth = carried_paths(model, model, bent())
    assert smooth is not None
    assert smooth.hops == ()
    assert smooth.own == ("one",)


@pytest.mark.parametrize(
    ("clamped", "low", "bounds"),
    [(True, -0.897, ("bend",)), (True, -1.5, ()), (False, -0.897, ())],
)
def test_a_hop_at_the_end_of_a_range_says_so(clamped, low, bounds):
    """After the hop the hinge lies at its bound, is far from it, or has none that holds it."""
    still = np.where(bent().time >= 0.505, -0.9, 0.1)[:, None]
    steady = replace(bent(), values=still + 0.001 * bent().time[:, None])
    model = limb(straight("one"))
    ranged = replace(model, coordinates=(Coordinate("bend", range=(low, 2.0), clamped=clamped),))
    (hop,) = motion_hops(ranged, steady)
    assert hop.size == pytest.approx(1.0, abs=0.01)
    assert hop.bounds == bounds


def test_frames_without_a_pose_are_no_jumps():
    """Only the longest part that is known is judged, and a few frames are not enough."""
    motion = bent()
    values = motion.values.copy()
    values[40:] = np.nan
    model = limb(snapping("one"))
    early = carried_paths(model, model, replace(motion, values=values))
    assert early is not None
    assert early.own == ()
    values[4:] = np.nan
    assert carried_paths(model, model, replace(motion, values=values)) is None
    assert carried_paths(limb(), limb(), motion) is None
