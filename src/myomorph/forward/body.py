"""A model with what drives it, compiled to the arrays of a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadModel
from myomorph.core.model.functions import Function
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle
from myomorph.core.model.series import Series
from myomorph.core.muscles.curves import Curve, Piece, pack_curves
from myomorph.core.muscles.fiber_states import fiber_muscle
from myomorph.core.muscles.hill import (
    HillArrays,
    activation_times,
    compile_hill,
    has_elastic_tendon,
    muscle_models,
    viscosities,
)
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.muscles.muscle_model import MuscleModel
from myomorph.core.muscles.path import PathRules
from myomorph.core.rigid.bushings import bushing_arrays
from myomorph.core.rigid.coordinates import compile_functions
from myomorph.core.rigid.loops import free_coordinates
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.forward.arrays import (
    ContactArrays,
    DriveArrays,
    MuscleArrays,
    Springs,
    System,
)
from myomorph.forward.contact_law import Ground
from myomorph.forward.drives import NO_DRIVES, Drives

NONE = np.zeros(0)
NOTHING = Curve(pieces=(Piece(start=-np.inf, y=(0.0,)),))  # Of fibers without passive force
STEEPNESS = 0.1  # Of a smooth switch where the muscle states none, as in OpenSim


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedBody:
    """A model as it takes part in a simulation.

    Attributes
    ----------
    model : its muscles, springs and bushings take part but where torques drive it
    drives : what moves it
    elastic : whether tendons stretch, where a muscle's class and the model let them
    passive : whether passive elastic forces of muscles take part
    """

    model: Model
    drives: Drives = NO_DRIVES
    elastic: bool = False
    passive: bool = True

    def __post_init__(self) -> None:
        refuse(self.model)
        self.drives.check(self.model)

    @property
    def has_tissue(self) -> bool:
        """Whether muscles and passive tissue take part: torques hold what they do."""
        return self.drives.torques is None

    @cached_property
    def tree(self) -> Tree:
        """The compiled model."""
        return compile_tree(self.model)

    @cached_property
    def elastic_muscles(self) -> tuple[str, ...]:
        """Names of muscles whose tendons stretch, in the order of their states."""
        if not (self.elastic and self.has_tissue):
            return ()
        return tuple(
            muscle.name
            for muscle in self.model.muscles
            if muscle.enabled and has_elastic_tendon(muscle)
        )

    @property
    def path_rules(self) -> PathRules:
        """Rules by which the paths have their lengths."""
        return compile_paths(self.model).rules

    def system(self, held: Array) -> System:
        """Compile what the kernels read.

        Parameters
        ----------
        held : (coordinates,) values where nothing moves a coordinate [rad or m]

        Returns
        -------
        arrays
        """
        tree = self.tree
        paths = compile_paths(self.model)
        free = free_coordinates(tree)
        prescribed = self._prescribed()
        functions = [
            coordinate.prescribed
            for coordinate in self.model.coordinates
            if coordinate.prescribed is not None
        ]
        excited = self.drives.excitations is not None
        return System(
            tree=tree.arrays,
            loops=tree.loops,
            free=free,
            prescribed=prescribed,
            prescribed_functions=compile_functions(functions),
            held=np.array(held, dtype=np.float64),
            springs=spring_arrays(self.model if self.has_tissue else None, self.model),
            bushings=bushing_arrays(tree, self.model.bushings if self.has_tissue else ()),
            paths=paths.arrays,
            muscles=self._muscles(),
            contacts=_contacts(tree, self.drives.ground),
            drives=self._drives(free),
            activations=len(self.model.muscles) if excited else 0,
            fibers=len(self.elastic_muscles),
        )

    def _prescribed(self) -> np.ndarray:
        """List the prescribed coordinates that no lock holds."""
        return np.array(
            [
                j
                for j, coordinate in enumerate(self.model.coordinates)
                if coordinate.prescribed is not None and not coordinate.locked
            ],
            np.int64,
        )

    def _muscles(self) -> MuscleArrays:
        """Muscles as the kernels read them."""
        model = self.model
        kinds = muscle_models(model)
        count = len(model.muscles)
        fiber = np.full(count, -1, np.int64)
        curve = np.full((count, 4), -1, np.int64)
        damping = np.zeros(count)
        slowed = np.zeros(count)
        curves: list[Curve] = []
        for m, (kind, muscle) in enumerate(zip(kinds, model.muscles, strict=True)):
            if muscle.name not in self.elastic_muscles:
                continue
            fiber[m] = self.elastic_muscles.index(muscle.name)
            curve[m] = len(curves) + np.arange(4)
            fibers = kind.curves(muscle)
            passive = fibers.passive if self.passive else NOTHING
            curves += [fibers.active, _unbounded(fibers.velocity), passive]
            curves.append(kind.tendon(muscle))
            damping[m] = kind.fiber_damping(muscle)
            slowed[m] = kind.slowed
        return MuscleArrays(
            hill=compile_hill(model) if self.passive else _without_passive(model),
            enabled=np.array([muscle.enabled for muscle in model.muscles], np.bool_)
            & self.has_tissue,
            viscosity=viscosities(model),
            least=self._least_activations(),
            times=activation_times(model),
            smoothing=np.array(
                [_smoothing(*pair) for pair in zip(kinds, model.muscles, strict=True)]
            ),
            fiber=fiber,
            curve=curve,
            curves=pack_curves(curves),
            damping=damping,
            slowed=slowed,
        )

    def _least_activations(self) -> Array:
        """Find the least activation of each muscle, (muscles,).

        A rigid tendon needs none, so that activations of a table act as they are.
        """
        activations = self.drives.activations
        given = () if activations is None or self.elastic else activations.names
        least = np.zeros(len(self.model.muscles))
        for m, muscle in enumerate(self.model.muscles):
            stated = fiber_muscle(muscle)
            if stated is not None and muscle.name not in given:
                least[m] = stated.least_activation(muscle) or 0.0
        return least

    def _drives(self, free: np.ndarray) -> DriveArrays:
        """Drives as tables in the model's order."""
        drives = self.drives
        model = self.model
        driven = drives.activations if drives.excitations is None else drives.excitations
        loads = drives.loads
        bodies = np.zeros(0, np.int64)
        wrenches = np.zeros((0, 0, 6))
        if loads is not None:
            bodies = np.array([self.tree.body_number(body) for body in loads.bodies], np.int64)
            points = np.nan_to_num(loads.points)
            moments = loads.torques + np.cross(points, loads.forces)
            wrenches = np.concatenate([loads.forces, moments], axis=2)
        follow = drives.follow
        values = np.zeros((0, len(free)))
        rates = values
        if follow is not None:
            values = self.tree.coordinates_of(follow)[:, free]
            rates = self.tree.rates_of(follow).velocities[:, free]
        return DriveArrays(
            torque_time=_time(drives.torques),
            torques=_columns(drives.torques, model.coordinate_names),
            reserve_time=_time(drives.reserves),
            reserves=_columns(drives.reserves, model.coordinate_names),
            muscle_time=_time(driven),
            muscles=_columns(driven, model.muscle_names),
            load_time=NONE if loads is None else np.array(loads.time),
            load_body=bodies,
            loads=np.ascontiguousarray(wrenches),
            followed_time=NONE if follow is None else np.array(follow.time),
            followed=np.ascontiguousarray(values),
            followed_rates=np.ascontiguousarray(rates),
            frequency=np.array([2.0 * np.pi * drives.feedback]),
        )


def refuse(model: Model) -> None:
    """Refuse a model that cannot move.

    Raises
    ------
    BadModel : nothing of it moves
    """
    if not len(free_coordinates(compile_tree(model))):
        raise BadModel(f"no coordinate of model '{model.name}' is free to move: unlock one")


def _without_passive(model: Model) -> HillArrays:
    """Compile muscles whose fibers have no passive force."""
    kinds = muscle_models(model)
    curves: list[Curve] = []
    for kind, muscle in zip(kinds, model.muscles, strict=True):
        fibers = kind.curves(muscle)
        curves += [fibers.active, fibers.velocity, NOTHING]
    rows = np.arange(len(curves), dtype=np.int64).reshape(-1, 3)
    return compile_hill(model)._replace(curve=rows, curves=pack_curves(curves))


def _unbounded(velocity: Curve) -> Curve:
    """Continue a force-velocity curve below its least velocity, where fibers push.

    So does OpenSim, where the tendon pulls less than resting fibers do.
    """
    _, right = velocity.slopes
    return replace(velocity, slopes=(None, right), bounds=(-np.inf, np.inf))


def _smoothing(kind: MuscleModel, muscle: Muscle) -> float:
    """Steepness of the switch from activation to deactivation, 0 for a sudden one."""
    if not kind.smooth:
        return 0.0
    return float(muscle.parameters.get("activation_dynamics_smoothing", STEEPNESS))


def spring_arrays(model: Model | None, named: Model) -> Springs:
    """Compile passive torques.

    Parameters
    ----------
    model : with the torques; None for none
    named : whose coordinates count

    Returns
    -------
    the torques as the kernels read them
    """
    torques = () if model is None else model.passive_torques
    functions: list[Function] = []
    for torque in torques:
        functions += [torque.torque, torque.damping]
    names = named.coordinate_names
    rows = 2 * np.arange(len(torques), dtype=np.int64)
    return Springs(
        coordinate=np.array([names.index(torque.coordinate) for torque in torques], np.int64),
        torque=rows,
        damping=rows + 1,
        functions=compile_functions(functions),
    )


def _contacts(tree: Tree, ground: Ground) -> ContactArrays:
    """Compile the spheres that touch the ground."""
    spheres = ground.spheres
    return ContactArrays(
        body=np.array([tree.body_number(sphere.body) for sphere in spheres], np.int64),
        center=np.array([sphere.center for sphere in spheres], np.float64).reshape(-1, 3),
        radius=np.array([sphere.radius for sphere in spheres], np.float64),
        up=np.array(tree.model.up),
        height=np.array([ground.height]),
        law=ground.law.values,
    )


def _time(series: Series | None) -> Array:
    """Take the times (samples,) of a table [s]; none without one."""
    return NONE if series is None else np.array(series.time)


def _columns(series: Series | None, names: Sequence[str]) -> Array:
    """Columns (samples, names) of a table in the order of names; 0 where it has none."""
    if series is None:
        return np.zeros((0, len(names)))
    values = np.zeros((len(series), len(names)))
    for column, name in enumerate(series.names):
        values[:, names.index(name)] = series.values[:, column]
    return values
