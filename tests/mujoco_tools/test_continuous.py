"""A certificate moves from pose to pose, along motion too, and speaks of both MuJoCo versions."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.mjcf.muscles import VERSION
from myomorph.core.model.functions import PiecewisePolynomial, linear, simm_spline
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Coupler, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform
from myomorph.exchange.mujoco import cams
from myomorph.exchange.mujoco.certificate import OTHER_VERSION, TOLERANCE
from myomorph.exchange.mujoco.copy import MujocoCopy
from myomorph.exchange.mujoco.export import in_copy, mujoco_model, write_mjcf
from myomorph.exchange.mujoco.joints import poses_over_ranges, routes
from myomorph.exchange.mujoco.tendon_paths import lengths_of_version

FLEXION = np.radians(140.0)


def knee_with_patella():
    """Make a knee that bends to 140 degrees, with a patella and a muscle over it.

    The patella turns and slides with the knee by splines, as in OpenSim's full-body models.
    """
    x = np.linspace(0.0, FLEXION, 8)
    turned = simm_spline(x, -0.87 * x + 0.05 * np.sin(x))
    slid = simm_spline(x, 0.05 - 0.03 * (1.0 - np.cos(x)))
    knee = (
        Axis(
            kind="rotation", vector=np.eye(3)[2], function=linear(-1.0), coordinates=("knee_angle",)
        ),
    )
    patella = (
        Axis(kind="translation", vector=np.eye(3)[0], function=slid, coordinates=("beta",)),
        Axis(kind="rotation", vector=np.eye(3)[2], function=turned, coordinates=("beta",)),
    )
    joints = tuple(
        Joint(
            name=name,
            kind="CustomJoint",
            parent=parent,
            child=child,
            parent_frame=Transform.identity(),
            child_frame=Transform(np.eye(3), np.array(offset)),
            axes=axes,
            coordinates=coordinates,
        )
        for name, parent, child, offset, axes, coordinates in (
            ("knee", GROUND, "tibia", (0.0, 0.0, 0.0), knee, ("knee_angle",)),
            ("patellofemoral", GROUND, "patella", (0.0, 0.0, 0.0), patella, ("beta",)),
        )
    )
    bodies = tuple(
        Body(name=name, mass=1.0, mass_center=np.array([0.0, -0.1, 0.0]), inertia=0.01 * np.eye(3))
        for name in ("tibia", "patella")
    )
    points = (
        PathPoint("origin", GROUND, np.array([0.03, 0.3, 0.0])),
        PathPoint("over", "patella", np.array([0.02, 0.03, 0.0])),
        PathPoint("under", "patella", np.array([0.015, -0.02, 0.0])),
        PathPoint("end", "tibia", np.array([0.04, -0.07, 0.0])),
    )
    quadriceps = Muscle(
        name="quadriceps",
        kind="Thelen2003Muscle",
        path=Path(points),
        max_isometric_force=1000.0,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.3,
    )
    same = PiecewisePolynomial(np.zeros(1), np.array([[0.0, 1.0]]))
    beta = Coupler(name="follow", dependent="beta", function=same, independents=("knee_angle",))
    return Model(
        name="knee",
        bodies=bodies,
        joints=joints,
        coordinates=(
            Coordinate("knee_angle", range=(0.0, FLEXION)),
            Coordinate("beta", range=(0.0, FLEXION)),
        ),
        couplers=(beta,),
        muscles=(quadriceps,),
        gravity=np.array([0.0, -9.81, 0.0]),
    )


def bent(model, degrees):
    """Bend the knee and straighten it again, once."""
    time = np.linspace(0.0, 1.0, 41)
    angle = np.radians(degrees) * np.sin(np.pi * time)
    return Motion(time, model.coordinate_names, np.column_stack([angle, angle]))


def test_a_patella_follows_the_knee_over_its_whole_range(tmp_path):
    model = knee_with_patella()
    certificate = write_mjcf(model, tmp_path / "knee.xml", motion=bent(model, 135.0))
    (one,) = certificate.differences
    assert max(one.length, one.arm, one.along) < TOLERANCE
    assert certificate.lines[0].startswith("lengths and moment arms of all")
    assert any(line.startswith("along the motion all") for line in certificate.lines)


def test_a_cam_that_folds_back_is_named(tmp_path, monkeypatch):
    """A measure across the default turns back at a right angle.

    A certificate that puts each pose down by itself does not see it.
    """
    monkeypatch.setattr(cams._Curve, "_middle", lambda self: self.leader.default)
    model = knee_with_patella()
    certificate = write_mjcf(model, tmp_path / "knee.xml", motion=bent(model, 135.0))
    (one,) = certificate.differences
    assert one.length > 5e-3
    assert one.along > 5e-3
    assert "quadriceps" in certificate.lines[0]
    assert any("along the motion 1 muscles leave" in line for line in certificate.lines)
    copied = mujoco_model(model)[0]
    copy = MujocoCopy(tmp_path / "knee.xml", copied)
    straight_there = in_copy(copied, model, np.array([[np.radians(120.0)] * 2]))
    copy.place(straight_there[0])
    placed = copy.d.ten_length[copy.tendons][0]
    copied_lengths = lengths_of_version(copied, VERSION, straight_there)
    assert placed == pytest.approx(copied_lengths[0, 0], abs=1e-4)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            "opensim-gait-subject01/ref_so_10dof18musc/subject01_adjusted_spring.osim",
            marks=pytest.mark.long,
        ),
        "opensim-reference-small/arm26.osim",
    ],
)
def test_the_installed_version_is_as_our_rules_of_it_say(name, data, tmp_path):
    """Run with MuJoCo 3 and with MuJoCo 4: what a certificate says of the other one is so."""
    from myomorph.core.io.osim.read import read_osim

    model = read_osim(data(name))
    path = tmp_path / "model.xml"
    certificate = write_mjcf(model, path)
    copied = mujoco_model(model)[0]
    coordinates, swept = poses_over_ranges(model, 20, seed=5)
    there = in_copy(copied, model, coordinates)
    theirs, _ = MujocoCopy(path, copied).lengths_and_arms(there, routes(model, coordinates, swept))
    np.testing.assert_allclose(theirs, lengths_of_version(copied, VERSION, there), atol=1e-5)
    said = {f"length by MuJoCo {OTHER_VERSION} [mm]" in row for row in certificate.rows}
    assert said == {True}
    assert any(f"rules of MuJoCo {OTHER_VERSION}" in line for line in certificate.lines)


def test_poses_of_one_coordinate_are_reached_from_the_default_outwards():
    model = knee_with_patella()
    coordinates, swept = poses_over_ranges(model, 3)
    route = routes(model, coordinates, swept)
    own = np.flatnonzero(swept == 0)
    assert route[own[0]] == -1
    np.testing.assert_array_equal(route[own[1:]], own[:-1])
    assert (route[swept < 0] == -1).all()
