"""Kernels compiled in two processes at once: what a new machine waits for before its first result.

Compilation takes most of the first command's time and uses one core. This process compiles inverse
kinematics and what its first steps use; a child meanwhile compiles muscle paths and the tension
solver, and leaves them in the kernels' cache on disk.
"""

from __future__ import annotations

import gc
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from myomorph.core.model.cache_folder import kernel_folder
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Actuator, Axis, Body, Coordinate, Joint, Marker, Model
from myomorph.core.model.paths import Muscle, PathPoint, PathWrap, TendonWrap, WrapObject
from myomorph.core.model.paths import Path as MusclePath
from myomorph.core.model.series import Motion, Series
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kernels import signatures_on_disk
from myomorph.lab.store.progress import progress

AHEAD = "myomorph.lab.study.workers.ahead"
MUSCLE_STEPS = ("muscles", "tension")
SURFACES = "surfaces"
TENDONS = "tendons"
"""By whose rules muscle paths wrap, OpenSim's or MuJoCo's: each is a kernel of its own."""
KERNELS = 86  # About how many files the kernels of all steps have, for the bar.
PERIOD = 0.3  # Between two looks at those files [s].


class Ahead:
    """A child process that compiles, or none."""

    def __init__(self, child: subprocess.Popen[bytes] | None) -> None:
        self._child = child

    @property
    def works(self) -> bool:
        """Whether the child still compiles."""
        return self._child is not None and self._child.poll() is None

    def wait(self, step: str) -> None:
        """Return when the kernels of a step are compiled.

        Where the child has failed, they compile here.
        """
        if step in MUSCLE_STEPS and self.works:
            with compiling():
                self.join()

    def join(self) -> None:
        """Return when the child has ended."""
        if self._child is not None:
            self._child.wait()

    def stop(self) -> None:
        """End the child, if it still runs."""
        if self._child is not None:
            self._child.terminate()


def compile_ahead(steps: Sequence[str], wraps: frozenset[str] = frozenset()) -> Ahead:
    """Compile the muscle kernels in a child process.

    It does so where steps after the first need them and they are not cached.
    """
    child = None
    if any(step in MUSCLE_STEPS for step in steps[1:]) and not cached(wraps):
        # -P: what lies in the folder of recordings is no module.
        command = [sys.executable, "-P", "-m", AHEAD, *sorted(wraps)]
        child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return Ahead(child)


def wraps_of(model: Model) -> frozenset[str]:
    """By whose rules the paths of a model wrap: `SURFACES`, `TENDONS`, both or neither."""
    wraps = [wrap for muscle in model.muscles for wrap in muscle.path.wraps]
    return frozenset(TENDONS if isinstance(wrap, TendonWrap) else SURFACES for wrap in wraps)


def cached(wraps: frozenset[str] = frozenset()) -> bool:
    """Whether an earlier command has left the muscle kernels on disk."""
    # Kernels of muscles are not imported by what needs none.
    from myomorph.core.muscles.path import path_frames

    # The last rules are those of paths by functions, which the smallest model has none of.
    wanted = [kind in wraps for kind in (SURFACES, TENDONS)] + [False]
    signatures = signatures_on_disk(path_frames)
    return any(
        [rules != "none" for rules in signature[2][1:]] == wanted for signature in signatures
    )


def motion_cached() -> bool:
    """Whether an earlier command has left the kernels of inverse kinematics on disk."""
    from myomorph.core.motion.newton import solve_chunk

    return bool(signatures_on_disk(solve_chunk))


@contextmanager
def compiling() -> Iterator[None]:
    """Show a bar while this process or a child compiles, by the files that appear in the cache."""
    folder = kernel_folder()
    ended = threading.Event()

    def watch() -> None:
        with progress("compiling, once on this machine", KERNELS, "kernels") as advance:
            seen = 0
            while not ended.wait(PERIOD):
                files = min(sum(1 for _ in folder.glob("*.nbc")), KERNELS)
                advance(max(files - seen, 0))
                seen = max(files, seen)
            advance(KERNELS - seen)

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        yield
    finally:
        ended.set()
        watcher.join()


def two_links(wraps: frozenset[str] = frozenset()) -> Model:
    """Return the smallest model that has a muscle.

    It has two bodies, a hinge each, and one muscle across the second; one more for each wrap.
    """
    still = Transform.identity()
    z = np.array([0.0, 0.0, 1.0])
    bodies = []
    joints = []
    for name, parent in (("first", GROUND), ("second", "first")):
        bodies.append(Body(name=name, mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3)))
        axes = (
            Axis(kind="rotation", vector=z, function=linear(1.0), coordinates=(f"{name}_angle",)),
        )
        joints.append(
            Joint(
                name=f"{name}_joint",
                kind="PinJoint",
                parent=parent,
                child=name,
                parent_frame=still,
                child_frame=still,
                axes=axes,
                coordinates=(f"{name}_angle",),
            )
        )
    points = (
        PathPoint("origin", "first", np.array([0.1, 0.3, 0.0])),
        PathPoint("end", "second", np.array([0.0, -0.3, 0.0])),
    )
    ball = WrapObject(name="ball", body="second", kind="sphere", pose=still, size=(0.01,))
    paths = [MusclePath(points)]
    if SURFACES in wraps:
        paths.append(MusclePath(points, (PathWrap(ball.name),)))
    if TENDONS in wraps:
        paths.append(MusclePath(points, (TendonWrap(ball.name, 0),)))
    kind = "Millard2012EquilibriumMuscle"
    muscles = tuple(
        Muscle(
            name=f"muscle_{index}",
            kind=kind,
            path=path,
            max_isometric_force=100.0,
            optimal_fiber_length=0.3,
            tendon_slack_length=0.3,
        )
        for index, path in enumerate(paths)
    )
    coordinates = tuple(Coordinate(f"{body.name}_angle") for body in bodies)
    return Model(
        name="two links",
        bodies=tuple(bodies),
        joints=tuple(joints),
        coordinates=coordinates,
        gravity=np.zeros(3),
        muscles=muscles,
        wrap_objects=(ball,),
    )


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
    from myomorph.core.motion.ik import inverse_kinematics
    from myomorph.core.rigid.kinematics import marker_positions

    bare = two_links()
    places = ((0.1, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.1))
    model = bare.with_markers(
        tuple(
            Marker(f"{body.name}_{i}", body.name, np.array(at))
            for body in bare.bodies
            for i, at in enumerate(places)
        )
    )
    time = np.linspace(0.0, 0.07, 8)
    motion = Motion(time, model.coordinate_names, np.column_stack([time, 2.0 * time]))
    kinematics = inverse_kinematics(model, marker_positions(model, motion)).motion
    inverse_dynamics(model, differentiate(kinematics))


@uncollected()
def compile_curves() -> None:
    """Run the muscle curves once, which need no paths."""
    from myomorph.core.muscles.hill import hill_forces

    hill_forces(two_links(), np.full((2, 1), 0.6), np.zeros((2, 1)))


@uncollected()
def compile_muscles(wraps: frozenset[str] = frozenset()) -> None:
    """Run every muscle and tension kernel once, paths first."""
    from myomorph.core.muscles.kinematics import muscle_kinematics
    from myomorph.core.tension.solve import solve_tension

    model = two_links(wraps)
    residual = Actuator(
        "residual", "torque", 1.0, body="first", direction=np.array([0.0, 0.0, 1.0])
    )
    time = np.linspace(0.0, 0.07, 8)
    motion = differentiate(
        Motion(time, model.coordinate_names, np.column_stack([time, 2.0 * time]))
    )
    muscle_kinematics(model, motion)
    still = Series(time, model.coordinate_names, np.zeros((len(time), len(model.coordinates))))
    solve_tension(model, motion, still, actuators=(residual,))


if __name__ == "__main__":
    compile_muscles(frozenset(sys.argv[1:]))
