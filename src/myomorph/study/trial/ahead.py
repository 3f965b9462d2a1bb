"""The muscle kernels compiled in a second process while the first steps run: once on a new machine.

Compilation takes most of the first command's time and uses one core. This process compiles inverse
kinematics, muscle curves and the tension solver; a child meanwhile compiles muscle paths and what is left
of tension, and leaves it in Numba's cache on disk.
"""

from __future__ import annotations

import gc
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from myomorph.model.functions import linear
from myomorph.model.model import GROUND, Actuator, Axis, Body, Coordinate, Joint, Marker, Model
from myomorph.model.paths import Muscle, PathPoint
from myomorph.model.paths import Path as MusclePath
from myomorph.model.series import Markers, Motion, Series
from myomorph.model.spatial import Transform
from myomorph.motion.filters import differentiate

MUSCLE_STEPS = ("muscles", "tension")


class Ahead:
    """A child process that compiles, or none."""

    def __init__(self, child: subprocess.Popen[bytes] | None) -> None:
        self._child = child

    @property
    def works(self) -> bool:
        """Whether the child still compiles."""
        return self._child is not None and self._child.poll() is None

    def wait(self, step: str) -> None:
        """Return when the kernels of a step are compiled (or the child has failed: then they compile here)."""
        if self._child is not None and step in MUSCLE_STEPS:
            if self._child.poll() is None:
                sys.stderr.write("compiling the muscle kernels: once on this machine, up to half a minute\n")
                compile_forces()
            self._child.wait()
            self._child = None

    def stop(self) -> None:
        """End the child, if it still runs."""
        if self._child is not None:
            self._child.terminate()
            self._child = None


def compile_ahead(steps: Sequence[str]) -> Ahead:
    """Compile the muscle kernels in a child where steps after the first need them and they are not cached."""
    child = None
    if any(step in MUSCLE_STEPS for step in steps[1:]) and not cached():
        command = [sys.executable, "-m", "myomorph.study.trial.ahead"]
        child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return Ahead(child)


def cached() -> bool:
    """Whether an earlier command has left the muscle kernels in Numba's cache."""
    from myomorph.muscles.path_kernels import path_frames
    from myomorph.rigid.kernels import is_compiled

    return is_compiled(path_frames)


def motion_cached() -> bool:
    """Whether an earlier command has left the kernels of inverse kinematics in Numba's cache."""
    from myomorph.motion.least_squares import solve_frames
    from myomorph.rigid.kernels import is_compiled

    return is_compiled(solve_frames)


def two_links() -> Model:
    """The smallest model that has a muscle: two bodies, a hinge each, one muscle across the second."""
    still, z = Transform.identity(), np.array([0.0, 0.0, 1.0])
    bodies, joints = [], []
    for name, parent in (("first", GROUND), ("second", "first")):
        bodies.append(Body(name, 1.0, np.zeros(3), np.eye(3)))
        axes = (Axis("rotation", z, linear(1.0), (f"{name}_angle",)),)
        joints.append(Joint(f"{name}_joint", "PinJoint", parent, name, still, still, axes, (f"{name}_angle",)))
    points = (
        PathPoint("origin", "first", np.array([0.1, 0.3, 0.0])),
        PathPoint("end", "second", np.array([0.0, -0.3, 0.0])),
    )
    muscle = Muscle("muscle", "Millard2012EquilibriumMuscle", MusclePath(points), 100.0, 0.3, 0.3)
    coordinates = tuple(Coordinate(f"{body.name}_angle") for body in bodies)
    return Model("two links", tuple(bodies), tuple(joints), coordinates, np.zeros(3), muscles=(muscle,))


@contextmanager
def uncollected() -> Iterator[None]:
    """Keep the garbage collector out: the compiler makes millions of objects and frees few."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@uncollected()
def compile_motion() -> None:
    """Run every kernel of inverse kinematics and dynamics once."""
    from myomorph.motion.ik import inverse_kinematics
    from myomorph.rigid.dynamics import inverse_dynamics
    from myomorph.rigid.kinematics import forward_kinematics
    from myomorph.rigid.tree import compile_tree

    bare = two_links()
    places = ((0.1, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.1))
    marked = [
        Marker(f"{body.name}_{i}", body.name, np.array(at)) for body in bare.bodies for i, at in enumerate(places)
    ]
    model = bare.with_markers(tuple(marked))
    tree = compile_tree(model)
    time = np.linspace(0.0, 0.07, 8)
    motion = Motion(time, model.coordinate_names, np.column_stack([time, 2.0 * time]))
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    bodies = np.array([tree.body_index[one.body] for one in marked])
    seen = poses.points(bodies, np.array([one.location for one in marked]))
    found = inverse_kinematics(model, Markers(time, model.marker_names, seen)).motion
    inverse_dynamics(model, differentiate(found))


@uncollected()
def compile_forces() -> None:
    """Run the muscle curves and the tension solver once, which need no paths."""
    from myomorph.muscles.hill import hill_forces
    from myomorph.tension.dual import solve_separable
    from myomorph.tension.separable import Separable, no_links, no_penalties, pattern

    hill_forces(two_links(), np.full((2, 1), 0.6), np.zeros((2, 1)))
    shape, one = pattern(np.zeros(2, np.int64), np.arange(2), (1, 2)), np.ones(2)
    problem = Separable(shape.start, shape.row, shape.first, one, 2.0 * one, -one, one)
    given = np.ones((1, 2)), np.ones((1, 1)), np.zeros((1, 2)), no_penalties(2), no_links(), np.zeros(1)
    found = np.empty((1, 2)), np.empty((1, 1)), np.empty(1), np.empty(1, np.int64), np.empty(1, np.int8)
    solve_separable(problem, *given, *found)


@uncollected()
def compile_muscles() -> None:
    """Run every muscle and tension kernel once, paths first."""
    from myomorph.muscles.path import muscle_kinematics
    from myomorph.tension.solve import solve_tension

    model = two_links()
    residual = Actuator("residual", "torque", 1.0, body="first", direction=np.array([0.0, 0.0, 1.0]))
    time = np.linspace(0.0, 0.07, 8)
    motion = differentiate(Motion(time, model.coordinate_names, np.column_stack([time, 2.0 * time])))
    muscle_kinematics(model, motion)
    still = Series(time, model.coordinate_names, np.zeros((len(time), len(model.coordinates))))
    solve_tension(model, motion, still, actuators=(residual,))


if __name__ == "__main__":
    compile_muscles()
