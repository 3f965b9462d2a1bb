"""Muscle tensions and contact forces: for every frame, the least effort that balances all equations of motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from myomorph.model.model import Actuator, Model
from myomorph.model.series import Motion, Series
from myomorph.rigid.frames import over_frames
from myomorph.tension.contacts import ContactTask
from myomorph.tension.emg import EmgTarget
from myomorph.tension.problem import TensionProblem, tension_problem
from myomorph.tension.sequential import solve_sequential
from myomorph.tension.tension import Tension, TensionOptions

__all__ = ["Tension", "TensionOptions", "TensionProblem", "solve_tension", "tension_problem"]


def solve_tension(
    model: Model,
    motion: Motion,
    torques: Series,
    options: TensionOptions | None = None,
    actuators: Sequence[Actuator] | None = None,
    progress: Callable[[int], None] | None = None,
    *,
    contacts: ContactTask | None = None,
    emg: EmgTarget | None = None,
) -> Tension:
    """Share the joint torques among muscles with the least effort, frame by frame.

        minimise  sum_m w_m a_m^p + sum_r u_r^p + sum_g c_g z_g^2
        subject to  R^T F a + D u + J^T G z = tau - R^T (F_passive + F_viscous),  bounds on a, u and z

    with moment arms R, forces per unit activation F (rigid tendon), directions D of actuators with
    controls u, edges G of contact cones with amplitudes z, and one row for every coordinate that is not locked,
    prescribed, driven by a coupler or taken as dependent by closed loops. Which of a loop's coordinates is taken so
    does not change the solution. The problem of a frame is convex and its solution unique; frames depend on each
    other only through the smoothness of contact forces. See docs/contact-forces.md.

    Parameters
    ----------
    motion : with velocities; a coordinate it lacks rests at its default
    torques : generalized forces of inverse dynamics at the motion's times (frames, coordinates), of those
        external forces alone that are known
    actuators : added to the model's own, replacing those of the same name, as OpenSim's
        `force_set_files`; None adds `default_reserves`, () adds nothing
    progress : called with the number of frames just done
    contacts : sites whose forces are to be found
    emg : what is known of activations

    Raises
    ------
    BadData
        where the motion has no velocities, torques, strengths or activations are of other times, or loops stand open
        by more than `OPEN`
    UnknownName
        where torques lack a free coordinate, or an actuator, a site or EMG names what does not exist
    BadModel
        where the model has nothing to solve for
    """
    if contacts is not None and contacts.options.formulation == "sequential":
        return solve_sequential(model, motion, torques, options, actuators, progress, contacts, emg)
    problem, names = tension_problem(model, motion, torques, options, actuators, contacts=contacts, emg=emg)
    over_frames(problem.solve, len(motion), progress, problem.window)
    return problem.result(names)
