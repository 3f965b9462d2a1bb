"""Muscle tensions of one frame after the other, as recordings come in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, BadModel
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.rigid.dynamics import OnlineDynamics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.core.tension.dual import OPTIMAL
from myomorph.core.tension.problem import TensionInputs, tension_problem
from myomorph.core.tension.reaction import of_bushings
from myomorph.core.tension.recruitment import (
    RecruitmentOptions,
    loaded_joints,
    settled_recruitment,
)
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.joint_load import JointLoadTerm


@read_only
class TensionFrame:
    """Result of one frame.

    Attributes
    ----------
    activations : (muscles,) NaN where the frame was not solved
    forces : (muscles,) along the tendons [N], NaN where the frame was not solved
    reserves : (actuators,) their forces [N] and torques [N m]
    balanced : (rows,) what muscles and actuators had to give together, in the order of
        `OnlineTension.coordinates`
    status : index into `STATUS_NAMES`
    equilibrium_residual : greatest torque or force left unbalanced [N m or N]
    """

    activations: Array
    forces: Array
    reserves: Array
    balanced: Array
    status: int
    equilibrium_residual: float


class OnlineTension:
    """The problem of `solve_tension`, set up once and solved frame by frame.

    Costs beside the effort are those of `solve_tension`: loads of knees by default.

    Parameters
    ----------
    model : with muscles
    options : as of `solve_tension`
    actuators : as of `solve_tension`
    recruitment : costs beside the effort; None for the default

    Attributes
    ----------
    loads_joints : whether loads of joints cost, so that `solve` needs the forces of joints
    muscles, actuators : names
    coordinates : names of those that are balanced
    lower, upper : (muscles,) bounds of the activations

    Raises
    ------
    BadModel : the model closes loops
    BadData : co-contraction or contact of knees is requested
    """

    def __init__(
        self,
        model: Model,
        options: TensionOptions | None = None,
        actuators: Sequence[Actuator] | None = None,
        recruitment: RecruitmentOptions | None = None,
    ):
        if model.loops:
            raise BadModel(
                f"model '{model.name}' closes loops ('{model.loops[0].name}'), which muscle"
                " tensions frame by frame do not take: use 'myomorph tension' after the recording"
            )
        options = options or TensionOptions()
        self._loads = _load_term(model, options, recruitment)
        self.loads_joints = self._loads is not None
        rest = np.array([[coordinate.default for coordinate in model.coordinates]])
        at_rest = Motion(
            time=np.zeros(1),
            names=model.coordinate_names,
            values=rest,
            velocities=np.zeros_like(rest),
        )
        no_torques = Series(np.zeros(1), model.coordinate_names, np.zeros_like(rest))
        self._problem = tension_problem(
            TensionInputs(
                model=model,
                motion=at_rest,
                torques=no_torques,
                options=options,
                actuators=actuators,
                terms=() if self._loads is None else (self._loads.term,),
            )
        )
        self.actuators = tuple(actuator.name for actuator in self._problem.actuators.actuators)
        self.muscles = model.muscle_names
        self.coordinates = self._problem.assembly.coordinates
        shared = self._problem.separable
        muscles = len(self.muscles)
        self.lower = shared.lower[:muscles]
        self.upper = shared.upper[:muscles]
        self._optimal_forces = self._problem.actuators.optimal_forces
        self._warm = np.zeros(len(self._problem.assembly.pattern.order))

    def solve_after(self, dynamics: OnlineDynamics) -> TensionFrame:
        """Share the torques of the last frame of inverse dynamics among muscles."""
        forces = dynamics.joint_forces() if self.loads_joints else None
        return self.solve(dynamics.coordinates, dynamics.rates, dynamics.torques, forces)

    def solve(
        self, coordinates: Array, rates: Array, torques: Array, joint_forces: Array | None = None
    ) -> TensionFrame:
        """Share the torques of a frame among muscles.

        Parameters
        ----------
        coordinates, rates : (1, coordinates) consistent [rad or m], [rad/s or m/s]
        torques : (1, coordinates) of inverse dynamics [N m or N]
        joint_forces : (bodies, 3) as of `OnlineDynamics.joint_forces` [N], where joint loads cost

        Returns
        -------
        activations, forces and reserves, and whether they are an optimum
        """
        self._problem.renew(coordinates, rates, torques)
        if self._loads is not None:
            if joint_forces is None:
                raise BadData("loads of joints cost: give the forces that joints transmit")
            self._loads.renew(coordinates, rates, joint_forces)
        balance = self._problem.balance(0, 1)
        solved = self._problem.solved(balance, 0, self._warm)
        status = int(solved.status[0])
        if status != OPTIMAL:
            self._warm[:] = 0.0
        muscles = len(self.muscles)
        activations = solved.x[0, :muscles]
        return TensionFrame(
            activations=activations,
            forces=balance.active[0] * activations + balance.passive[0] + balance.viscous[0],
            reserves=solved.x[0, muscles : muscles + len(self.actuators)] * self._optimal_forces,
            balanced=balance.torques[0],
            status=status,
            equilibrium_residual=float(solved.residual[0]),
        )


@read_only
@dataclass(frozen=True, eq=False)
class JointLoads:
    """Loads of joints that cost.

    Attributes
    ----------
    tree : of the model
    term : of the problem
    bodies : (joints,) numbers of the joints' children
    """

    tree: Tree
    term: JointLoadTerm
    bodies: NDArray[np.int64]

    def renew(self, coordinates: Array, rates: Array, joint_forces: Array) -> None:
        """Put another frame in the place of the last one.

        Parameters
        ----------
        coordinates, rates : (1, coordinates) consistent [rad or m], [rad/s or m/s]
        joint_forces : (bodies, 3) without bushings [N]
        """
        forces = joint_forces[self.bodies]
        bushings = self.tree.model.bushings
        if bushings:
            poses = forward_kinematics(self.tree, coordinates)
            pushes = of_bushings(self.tree, poses, bushings, rates)[0, :, :3]
            names = [joint.child for joint in self.tree.model.joints]
            carried = {self.tree.body_index[name]: self.tree.hanging(name) for name in names}
            forces = forces - np.stack([pushes[carried[b]].sum(axis=0) for b in self.bodies])
        self.term.renew(forces[None])


def _load_term(
    model: Model, options: TensionOptions, recruitment: RecruitmentOptions | None
) -> JointLoads | None:
    """Make the term of joint loads of one frame; None where they cost nothing.

    Raises
    ------
    BadData : co-contraction is requested
    """
    costs = settled_recruitment(recruitment, model, options, external=True)
    if costs.co_contraction:
        raise BadData(
            "co-contraction is not supported frame by frame: use 'myomorph tension' after the"
            " recording"
        )
    if costs.knee_contact:
        raise BadData(
            "knee_contact is not supported frame by frame: use 'myomorph tension' after the"
            " recording"
        )
    if not costs.joint_load:
        return None
    joints = loaded_joints(model, costs.joint_load_joints)
    child = {joint.name: joint.child for joint in model.joints}
    tree = compile_tree(model)
    alone = np.zeros((1, len(joints), 3))
    term = JointLoadTerm(model=model, joints=joints, alone=alone, weight=costs.joint_load)
    bodies = np.array([tree.body_index[child[name]] for name in joints])
    return JointLoads(tree=tree, term=term, bodies=bodies)
