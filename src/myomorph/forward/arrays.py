"""What the kernels of a simulation read: a model with its drives, as flat arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.muscles.curves import CurveArrays
from myomorph.core.muscles.hill import HillArrays
from myomorph.core.muscles.path_arrays import PathArrays
from myomorph.core.rigid.bushing_kernels import BushingArrays
from myomorph.core.rigid.coordinates import FunctionArrays, Ints
from myomorph.core.rigid.tree import LoopArrays, TreeArrays

WORKS = (
    "muscles",
    "muscle viscosity",
    "joint springs",
    "joint damping",
    "torques",
    "reserves",
    "contacts",
    "external forces",
    "feedback",
    "prescribed coordinates",
)
"""What does work on the body, in the order of the states that add it up."""
(
    MUSCLES,
    MUSCLE_VISCOSITY,
    SPRINGS,
    DAMPING,
    TORQUES,
    RESERVES,
    CONTACTS,
    LOADS,
    FEEDBACK,
    PRESCRIBED,
) = range(len(WORKS))


class Springs(NamedTuple):
    """Passive torques of coordinates: torque(c) - damping(c) cdot.

    Attributes
    ----------
    coordinate : (springs,) index of the coordinate of each
    torque, damping : (springs,) rows in `functions`
    functions : of all
    """

    coordinate: Ints
    torque: Ints
    damping: Ints
    functions: FunctionArrays


class MuscleArrays(NamedTuple):
    """Muscles of a simulation.

    Attributes
    ----------
    hill : sizes and curves
    enabled : (muscles,) whether each pulls
    viscosity : (muscles,) along the whole path [N s/m]
    least : (muscles,) least activation
    times : (2, muscles) time constants of activation and deactivation [s]
    smoothing : (muscles,) steepness of the switch between both, 0 for a sudden one
    fiber : (muscles,) number of the fiber length among the states, -1 for a rigid tendon
    curve : (muscles, 4) rows in `curves` of active, velocity, passive and tendon curve
    curves : of muscles with elastic tendons
    damping : (muscles,) of the fibers, normalized
    slowed : (muscles,) see `MuscleModel.slowed`
    """

    hill: HillArrays
    enabled: NDArray[np.bool_]
    viscosity: Array
    least: Array
    times: Array
    smoothing: Array
    fiber: Ints
    curve: Ints
    curves: CurveArrays
    damping: Array
    slowed: Array


class ContactArrays(NamedTuple):
    """Spheres on bodies that touch a plane of the ground.

    Attributes
    ----------
    body : (spheres,) number of the body of each
    center : (spheres, 3) in the body [m]
    radius : (spheres,) [m]
    up : (3,) unit normal of the plane in ground
    height : (1,) of the plane along `up` [m]
    law : (8,) as of `ContactLaw.values`
    """

    body: Ints
    center: Array
    radius: Array
    up: Array
    height: Array
    law: Array


class DriveArrays(NamedTuple):
    """What drives the body, as tables over time, straight between samples; none has no samples.

    Attributes
    ----------
    torque_time : (samples,) [s]
    torques : (samples, coordinates) generalized forces [N m or N]
    reserve_time : (samples,) [s]
    reserves : (samples, coordinates) generalized forces beside muscles [N m or N]
    muscle_time : (samples,) [s]
    muscles : (samples, muscles) activations, or excitations where activations are states
    load_time : (samples,) [s]
    load_body : (forces,) number of the body that each external force acts on
    loads : (samples, forces, 6) force [N] and its moment about the ground's origin [N m], in ground
    followed_time : (samples,) [s]
    followed : (samples, free) coordinates that feedback pulls to [rad or m]
    followed_rates : (samples, free) [per s]
    frequency : (1,) of the feedback [rad/s], 0 for none
    """

    torque_time: Array
    torques: Array
    reserve_time: Array
    reserves: Array
    muscle_time: Array
    muscles: Array
    load_time: Array
    load_body: Ints
    loads: Array
    followed_time: Array
    followed: Array
    followed_rates: Array
    frequency: Array


class System(NamedTuple):
    """A body that moves.

    Its state is the free coordinates, their velocities, activations where excitations drive
    muscles, fiber lengths of elastic tendons, and the works of `WORKS`.

    Attributes
    ----------
    tree : the compiled model
    loops : that stay closed
    free : (free,) indices of coordinates that are neither dependent, locked nor prescribed
    prescribed : (prescribed,) indices of prescribed coordinates
    prescribed_functions : of time, in the same order
    held : (coordinates,) value of each where nothing moves it [rad or m]
    springs : passive torques
    bushings : of joints
    paths : of the muscles
    muscles : their forces
    contacts : with the ground
    drives : torques, activations and external forces over time
    activations, fibers : numbers of these states
    """

    tree: TreeArrays
    loops: LoopArrays
    free: Ints
    prescribed: Ints
    prescribed_functions: FunctionArrays
    held: Array
    springs: Springs
    bushings: BushingArrays
    paths: PathArrays
    muscles: MuscleArrays
    contacts: ContactArrays
    drives: DriveArrays
    activations: int
    fibers: int

    @property
    def size(self) -> int:
        """Number of the states."""
        return 2 * len(self.free) + self.activations + self.fibers + len(WORKS)
