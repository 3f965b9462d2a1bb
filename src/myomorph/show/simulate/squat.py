"""A full-body capture that the project simulates itself: a squat with raised arms.

Its truth is known. The body is MyoFullBody, which comes with `myo-sim`. Smooth coordinates are laid
through poses that keep both feet on the floor; markers follow from them, with noise; the force on
the feet is the one that balances the equations of motion, so that nothing is left at the root;
torques follow by inverse dynamics, and activations by the same least-effort criterion that the
estimate uses. What the report compares is thus the effect of noise and filters, not the criterion
itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from myomorph.core.io.mjcf.composed import composed_model
from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.known import Known
from myomorph.core.model.model import Marker, Model
from myomorph.core.model.series import Markers, Motion, Series, Trial, Wrenches
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.motion.filters import lowpass
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.motion.measurements import default_markers
from myomorph.core.motion.splines import natural_spline
from myomorph.core.motion.tasks.coordinates import CoordinateTask
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import forward_kinematics, marker_positions
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.core.tension.quantities import ACTIVATION
from myomorph.lab.store.results import value_source
from myomorph.lab.store.settings import Differentiation
from myomorph.lab.study.inputs.input import ByType, OptionSet
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.markers import Recording
from myomorph.lab.study.inputs.mass import BodyMass
from myomorph.lab.study.inputs.session import RecordedSession
from myomorph.lab.study.inputs.truth import KnownTruth
from myomorph.lab.study.trial.trial_inputs import TrialInputs, TrialNotes
from myomorph.show.simulate.total_wrench import total_wrench

FEET = ("calcn_r", "calcn_l")
MARKED = (
    "pelvis",
    "femur_r",
    "tibia_r",
    "calcn_r",
    "femur_l",
    "tibia_l",
    "calcn_l",
    "torso",
    "head",
    "humerus_r",
    "ulna_r",
    "thirdmc_r",
    "humerus_l",
    "ulna_l",
    "thirdmc_l",
)
KEPT_FREE = (
    "root_",
    "flex_extension",
    "lat_bending",
    "axial_rotation",
    "elv_angle_",
    "shoulder_elv_",
    "shoulder_rot_",
    "elbow_flexion_",
    "pro_sup_",
    "hip_",
    "knee_angle_",
    "ankle_angle_",
    "subtalar_angle_",
)
STANDING = FrozenMap(
    {"elv_angle_r": 80.0, "elv_angle_l": 80.0, "shoulder_elv_r": 20.0, "shoulder_elv_l": 20.0}
)
"""The highest pose, differences from the default pose [deg], as hanging arms have no plane of
elevation.
"""
_BENT = {
    "hip_flexion": 55.0,
    "hip_adduction": -5.0,
    "knee_angle": 65.0,
    "ankle_angle": 22.0,
    "shoulder_elv": 40.0,
    "elbow_flexion": 50.0,
}
SQUAT = FrozenMap(
    {"root_rx": 14.0} | {f"{name}_{side}": angle for name, angle in _BENT.items() for side in "rl"}
)
"""The lowest pose, the coordinates' differences from the highest [deg]."""
SOLE = 0.012  # Height of the heel bones' origins above their lowest point [m].
KNOT_RATE = 20.0
CLUSTER = 0.05 * np.array(
    [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]
)
"""Markers of a body about its mass center [m]."""


@dataclass(frozen=True)
class SimulationOptions:
    """What is simulated, and how badly it is measured."""

    duration: float = 2.0  # [s]
    squats: int = 1  # in that time
    # rate, force_rate: of markers and forces [Hz]
    rate: float = 100.0
    force_rate: float = 1000.0
    marker_noise: float = 0.0005  # standard deviation of each marker's white noise [m]
    tissue: float = 0.002  # standard deviation of its slow shift on the skin, below 2 Hz [m]
    force_noise: float = 1.0  # standard deviation of the forces' white noise [N]
    cutoff: float = 6.0  # low-pass of the estimate [Hz]
    seed: int = 20  # of the noise


def simulated_trial(options: SimulationOptions | None = None) -> TrialInputs:
    """Return the simulated capture, ready for all steps, with its truth."""
    # Brings SciPy: loaded only where it is needed.
    from myomorph.core.tension.solve import solve_tension

    options = options or SimulationOptions()
    model = marked_body()
    tree = compile_tree(model)
    splines = squat_splines(model, options)
    truth = splines.at(options.rate, options.duration)
    forces_motion = splines.at(options.force_rate, options.duration)
    wrenches = balancing_wrenches(tree, forces_motion)
    at_markers = balancing_wrenches(tree, truth)
    torques = inverse_dynamics(model, truth, at_markers)
    tension = solve_tension(model, truth, torques)
    random = np.random.default_rng(options.seed)
    markers = measured_markers(model, truth, options, random)
    noisy = replace(
        wrenches,
        forces=wrenches.forces
        + options.force_noise * random.standard_normal(wrenches.forces.shape),
    )
    activations = Series(truth.time, tension.muscles, tension.activation)
    known = _known(model, tree.coordinates_of(truth), torques, activations)
    return TrialInputs(
        name="squat",
        subject="simulated body",
        model=model,
        inputs=ByType().having(
            Recording(Trial(markers)),
            ExternalLoads.on_known_bodies(lambda motion: noisy),
            BodyMass(model.mass),
            RecordedSession(movement=Known(value="squatting", origin="user")),
            KnownTruth(FrozenMap(known)),
        ),
        options=OptionSet(Differentiation(options.cutoff)),
        notes=_notes(model, options),
        sources=(
            value_source(
                "model",
                "demo:simulated",
                *(body.mass for body in model.bodies),
                *model.coordinate_names,
            ),
            value_source("markers", "simulated markers", markers.values),
            value_source("loads", "simulated forces", noisy.forces, noisy.points, noisy.torques),
        ),
    )


def _known(
    model: Model, coordinates: Array, torques: Series, activations: Series
) -> dict[str, Series]:
    """Collect the truth by quantity, without coordinates that are locked."""
    used = [i for i, name in enumerate(model.coordinate_names) if not model.coordinates[i].locked]
    names = tuple(model.coordinate_names[i] for i in used)
    return {
        COORDINATE_VALUE.name: Series(torques.time, names, coordinates[:, used]),
        GENERALIZED_FORCE.name: Series(torques.time, names, torques.values[:, used]),
        ACTIVATION.name: activations,
    }


def _notes(model: Model, options: SimulationOptions) -> TrialNotes:
    """Write what is assumed and what is simulated."""
    times = "once" if options.squats == 1 else f"{options.squats} times"
    return TrialNotes(
        assumed=(
            "Fingers and wrists do not move; each foot carries half of the force.",
            (
                "The true activations are the least-effort ones of the noise-free motion, the"
                " criterion that the estimate uses too: their difference shows what noise and"
                " filters do, not whether the criterion is right."
            ),
        ),
        simulated=(
            (
                f"Everything: a {model.mass:.1f} kg body (MyoFullBody, {len(model.muscles)}"
                f" muscles) squats {times} in {options.duration:g} s with raised arms; nobody"
                " was measured."
            ),
            (
                f"Standard deviations of the noise: markers {1000 * options.marker_noise:g} mm"
                f" white and {1000 * options.tissue:g} mm slow shift on the skin, forces"
                f" {options.force_noise:g} N white; seed {options.seed}."
            ),
        ),
    )


def marked_body() -> Model:
    """Put a cluster of four markers on each of 15 bodies of MyoFullBody.

    Fingers and wrists are locked.
    """
    model = composed_model("myofullbody")
    dependent = model.dependent_coordinates
    coordinates = tuple(
        replace(
            coordinate,
            locked=not coordinate.name.startswith(KEPT_FREE) and coordinate.name not in dependent,
        )
        for coordinate in model.coordinates
    )
    markers = []
    for name in MARKED:
        center = model.body(name).mass_center
        shrink = 0.6 if name.startswith(("calcn", "thirdmc")) else 1.0
        markers += [
            Marker(f"{name}_{i + 1}", name, center + shrink * offset)
            for i, offset in enumerate(CLUSTER)
        ]
    return replace(model, coordinates=coordinates, markers=tuple(markers))


@dataclass(frozen=True, eq=False)
class Splines:
    """Coordinates as quintic splines of time."""

    names: tuple[str, ...]
    spline: Any

    def at(self, rate: float, duration: float) -> Motion:
        """Sample the motion with exact derivatives at so many frames a second."""
        return self.at_times(np.arange(round(rate * duration) + 1) / rate)

    def at_times(self, time: Array) -> Motion:
        """Sample the motion with exact derivatives.

        Parameters
        ----------
        time : (frames,) [s]

        Returns
        -------
        coordinates with velocities and accelerations [rad, m, per s, per s^2]
        """
        return Motion(
            time=time,
            names=self.names,
            values=self.spline(time, 0),
            velocities=self.spline(time, 1),
            accelerations=self.spline(time, 2),
        )


def squat_splines(model: Model, options: SimulationOptions) -> Splines:
    """Lay smooth coordinates through poses that keep the feet where they stand.

    Between standing and `SQUAT` the depth is (1 - cos) / 2; each pose is the one nearest to that
    whose heel markers stay in place.
    """
    time = np.arange(round(KNOT_RATE * options.duration) + 1) / KNOT_RATE
    depth = 0.5 - 0.5 * np.cos(2.0 * np.pi * options.squats * time / options.duration)
    free = [
        coordinate
        for coordinate in model.coordinates
        if not coordinate.locked and coordinate.name not in model.dependent_coordinates
    ]
    names = tuple(coordinate.name for coordinate in free)
    default = np.array([coordinate.default for coordinate in free])
    high = np.deg2rad([STANDING.get(name, 0.0) for name in names])
    low = np.deg2rad([SQUAT.get(name, 0.0) for name in names])
    wanted = default + high + np.outer(depth, low)
    planted = tuple(marker.name for marker in model.markers if marker.body in FEET)
    feet = Markers(
        time, planted, np.repeat(default_markers(model, planted)[None], len(time), axis=0)
    )
    pull = [CoordinateTask(name, 1e-5) for name in names if not name.startswith("root_t")]
    pulled = InverseKinematicsOptions(tasks=pull, coordinates=Motion(time, names, wanted))
    poses = inverse_kinematics(model, feet, pulled).motion
    values = poses.values[:, [poses.names.index(name) for name in names]]
    return Splines(names, natural_spline(time, values))


def balancing_wrenches(tree: Tree, motion: Motion) -> Wrenches:
    """Find forces on both feet, half each, that leave nothing at the root.

    The force that the whole body needs is moved to the feet: its center of pressure on the floor
    lies midway between two points that are as far apart as the feet.
    """
    total = total_wrench(tree, motion)
    force = total.force
    moment = total.moment
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    feet = [poses.origins[:, tree.body_index[name]] for name in FEET]
    up = -tree.model.gravity / np.linalg.norm(tree.model.gravity)
    floor = float(np.min([foot @ up for foot in feet])) - SOLE
    vertical = force @ up
    # Of all points of the line of action, the one on the floor; what moment remains is vertical.
    center = np.cross(up, moment - floor * np.cross(up, force)) / vertical[:, None] + floor * up
    free = (moment - np.cross(center, force)) / 2.0
    apart = feet[0] - feet[1]
    apart = (apart - np.outer(apart @ up, up)) / 2.0
    points = np.stack([center + apart, center - apart], axis=1)
    halves = np.repeat(force[:, None] / 2.0, 2, axis=1)
    return Wrenches(
        time=motion.time,
        names=("right foot", "left foot"),
        bodies=FEET,
        forces=halves,
        points=points,
        torques=np.repeat(free[:, None], 2, axis=1),
    )


def measured_markers(
    model: Model, motion: Motion, options: SimulationOptions, random: np.random.Generator
) -> Markers:
    """Markers of a motion, with white noise and a slow shift of each on the skin."""
    places = marker_positions(model, motion).values
    # The filter's ends are not like its middle: they are cut off.
    margin = int(options.rate)
    longer = random.standard_normal((len(places) + 2 * margin, *places.shape[1:]))
    slow: Array = lowpass(longer, options.rate, 2.0)[margin:-margin]
    shift = options.tissue * slow / slow.std(axis=0)
    noise = options.marker_noise * random.standard_normal(places.shape)
    return Markers(motion.time, model.marker_names, places + shift + noise)
