"""A limb with the viscosity of its joint swings as the simulated recordings of swings do."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation
from tests.viscosity.swung_limb import GRAVITY, LIMB, Setup, law, swung

from myomorph.core.model.functions import linear
from myomorph.core.model.inertia import inertia_matrices
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.passive_dynamics import with_passive_dynamics
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.forward.simulate import SimulationOptions, simulate

DAMPING = np.array([0.03, 0.08, 0.05])
NAMES = ("x", "y", "z")
SECONDS = 5.0


def limb():
    """Make the limb of `LIMB` on three hinges, x first in ground and z last in the limb."""
    mass = float(LIMB[0])
    center = LIMB[1:4] / mass
    about_joint = inertia_matrices(LIMB)
    steiner = mass * (center @ center * np.eye(3) - np.outer(center, center))
    axes = tuple(
        Axis(kind="rotation", vector=direction, function=linear(1.0), coordinates=(name,))
        for name, direction in zip(NAMES, np.eye(3), strict=True)
    )
    joint = Joint(
        name="shoulder",
        kind="ball",
        parent="ground",
        child="limb",
        parent_frame=Transform.identity(),
        child_frame=Transform.identity(),
        axes=axes,
        coordinates=NAMES,
    )
    body = Body(name="limb", mass=mass, mass_center=center, inertia=about_joint - steiner)
    return Model(
        name="limb",
        bodies=(body,),
        joints=(joint,),
        coordinates=tuple(Coordinate(name) for name in NAMES),
        gravity=GRAVITY,
    )


def angle_rates(angles, rates):
    """Rates of the angles x, y, z of an angular velocity along the limb's axes."""
    _, y, z = angles
    E = np.array(
        [
            [np.cos(y) * np.cos(z), np.sin(z), 0.0],
            [-np.cos(y) * np.sin(z), np.cos(z), 0.0],
            [np.sin(y), 0.0, 1.0],
        ]
    )
    return np.linalg.solve(E, rates)


def test_a_swing_with_its_viscosity_is_the_recorded_one():
    start = [0.5, 0.2, 0.3]
    recording = swung([law(hinges=DAMPING)], [start], [[0.5, 1.0, 0.4]], Setup(seconds=SECONDS))[0]
    model = with_passive_dynamics(limb(), damping=dict(zip(NAMES, DAMPING, strict=True)))
    angles = Rotation.from_matrix(recording.rotations[0]).as_euler("XYZ")
    first = Motion(
        np.zeros(1),
        NAMES,
        angles[None],
        velocities=angle_rates(angles, recording.rates[0])[None],
    )
    options = SimulationOptions(seconds=SECONDS - 0.01, rate=100.0, tolerance=1e-9)
    simulation = simulate(model, first, options=options)
    undamped = simulate(limb(), first, options=options)
    tree = compile_tree(model)

    def off(motion):
        turned = forward_kinematics(tree, motion.values).rotations[:, 1]
        apart = np.swapaxes(turned, 1, 2) @ recording.rotations
        return np.degrees(Rotation.from_matrix(apart).magnitude())

    assert off(simulation.motion).max() < 1e-4
    assert off(undamped.motion).max() > 2.0
