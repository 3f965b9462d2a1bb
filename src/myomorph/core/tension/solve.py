"""Muscle tensions and contact forces: the least effort that balances all motion equations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arguments import check_argument
from myomorph.core.model.errors import BadModel
from myomorph.core.model.joint_torques import JointTorques
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.contact_setting import all_loads
from myomorph.core.tension.elastic.problem import solve_elastic
from myomorph.core.tension.problem import TensionInputs, TensionProblem, tension_problem
from myomorph.core.tension.recruitment import (
    EFFORT_ALONE,
    RecruitmentOptions,
    recruitment_terms,
    settled_recruitment,
)
from myomorph.core.tension.tension import Tension, TensionOptions
from myomorph.core.tension.terms.actuators import floating_joints
from myomorph.core.tension.terms.contacts import ContactTask
from myomorph.core.tension.terms.emg import EmgTarget
from myomorph.core.tension.terms.term import Term


def solve_tension(  # page: the terms of one problem, most of them optional
    model: Model,
    motion: Motion,
    torques: Series,
    options: TensionOptions | None = None,
    actuators: Sequence[Actuator] | None = None,
    progress: Callable[[int], None] | None = None,
    *,
    contacts: ContactTask | None = None,
    emg: EmgTarget | None = None,
    recruitment: RecruitmentOptions | None = None,
    terms: Sequence[Term] = (),
) -> Tension:
    """Share the joint torques among muscles with the least effort, frame by frame.

        minimise    sum_m w_m a_m^p + sum_r u_r^p + sum_g c_g z_g^2 + w sum_j |F_j / W|^2
        subject to  R^T F a + D u + J^T G z = tau - R^T (F_passive + F_viscous)
                    bounds on a, u and z

    with moment arms R, forces per unit activation F (rigid tendon), directions D of actuators with
    controls u, generators G of contact cones with amplitudes z, forces F_j of knees in shares of
    the body's weight W where the external forces are known (`recruitment`), and one row for every
    coordinate that is not locked, prescribed, driven by a coupler or taken as dependent by closed
    loops. Which of a loop's coordinates is taken so does not change the solution. The problem of a
    frame is convex and its solution unique; frames depend on each other only through the smoothness
    of contact forces. See docs/contact-forces.md.

    Source: Crowninshield and Brand 1981 for the effort; [D] ch. 4 for muscles and contacts in one
    problem.

    Parameters
    ----------
    model : with muscles
    motion : with velocities; a coordinate missing in it rests at its default
    torques : generalized forces of inverse dynamics at the motion's times (frames, coordinates), of
        those external forces alone that are known. What `inverse_dynamics` returns carries these
        forces; a table from elsewhere does not, and joint loads then take no part
    options : exponent, weights and which forces take part; see `TensionOptions`
    actuators : added to the model's own, replacing those of the same name, as OpenSim's
        `force_set_files`; None adds `default_reserves`, () adds nothing
    progress : called with the number of frames just done
    contacts : sites whose forces are to be found; passive muscle forces take part in that by
        `ContactOptions.contact_passive`, and in the tensions under these forces by `options`
    emg : what is known of activations
    recruitment : costs beside the effort; by default those of `RecruitmentOptions`, as commands
        take them. With contacts they are costs of the tensions under the contact forces, and none
        by default beside `terms`, which belong to the problem of the contacts
    terms : further costs and constraints, see `myomorph.core.tension.terms.term.Term` and
        docs/adding.md; where contact forces are found first (`ContactOptions.formulation`), they
        belong to the problem of the muscles

    Returns
    -------
    activations (frames, muscles) [-], forces (frames, muscles) [N], reserves [N m or N], status of
    each frame

    Raises
    ------
    BadData : the motion has no velocities, torques, contacts or EMG are of other times, the
        loop-closure error is above `loops.MAX_OPENING`, or joint loads are requested with torques
        of unknown external forces
    UnknownName : torques of a free coordinate are missing, or an actuator, a site or EMG names what
        does not exist
    BadModel : the model has nothing to solve for

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.differentiate(mm.read_motion("reach.mot", model), cutoff=6.0)
    >>> tension = mm.solve_tension(model, motion, mm.inverse_dynamics(model, motion))
    >>> tension.muscles, tension.muscle_force.shape, bool(tension.optimal.all())
    (('flexor', 'extensor'), (61, 2), True)
    """
    check_argument("model", model, Model)
    check_argument("motion", motion, Motion)
    check_argument("torques", torques, Series)
    inputs = TensionInputs(
        model=model,
        motion=motion,
        torques=torques,
        options=options or TensionOptions(),
        actuators=actuators,
        contacts=contacts,
        emg=emg,
        terms=terms,
    )
    known = isinstance(torques, JointTorques)
    if contacts is not None and terms:
        recruitment = recruitment or EFFORT_ALONE
    costs = settled_recruitment(recruitment, model, inputs.options, known)
    if contacts is not None:
        return _under_contacts(inputs, costs, _solve_with_contacts(inputs, progress))
    return _solve_once(_with_costs(inputs, costs), progress)


def _with_costs(inputs: TensionInputs, costs: RecruitmentOptions) -> TensionInputs:
    """Add the terms of costs beside the effort, under the external forces of the torques."""
    if not costs.has_costs:
        return inputs
    torques = inputs.torques
    wrenches = torques.wrenches if isinstance(torques, JointTorques) else None
    terms = recruitment_terms(inputs.model, inputs.motion, torques, wrenches, costs)
    return replace(inputs, terms=(*inputs.terms, *terms))


def _solve_with_contacts(inputs: TensionInputs, progress: Callable[[int], None] | None) -> Tension:
    """Solve for contact forces and muscles as options say, by the effort alone."""
    assert inputs.contacts is not None
    if inputs.contacts.options.formulation == "sequential":
        return _sequential(inputs, progress)
    if inputs.options.tendons == "rigid":
        return solve_contacts(inputs, progress)[0]
    return _solve_once(inputs, progress)


def _under_contacts(inputs: TensionInputs, costs: RecruitmentOptions, first: Tension) -> Tension:
    """Solve for the tensions under contact forces once more, where more than the effort costs.

    Parameters
    ----------
    inputs : of the problem with contacts
    costs : beside the effort
    first : its solution
    """
    if not costs.has_costs or first.contacts is None:
        return first
    torques = inputs.torques
    exact = torques.wrenches if isinstance(torques, JointTorques) else None
    carried = inverse_dynamics(inputs.model, inputs.motion, all_loads(exact, first.contacts))
    under = _with_costs(replace(inputs, torques=carried, contacts=None), costs)
    return with_contacts(_solve_once(under), first)


def _solve_once(inputs: TensionInputs, progress: Callable[[int], None] | None = None) -> Tension:
    """Solve for muscles and contacts together, on rigid or on elastic tendons."""
    if inputs.options.tendons == "elastic":
        return solve_elastic(inputs, progress)
    return tension_problem(inputs).solve_all(progress)


class ContactSolution(NamedTuple):
    """The problem that contact forces come from, and its whole solution."""

    problem: TensionProblem
    tension: Tension


def solve_contacts(
    inputs: TensionInputs, progress: Callable[[int], None] | None = None
) -> tuple[Tension, ContactSolution]:
    """Do `solve_tension` with simultaneous contacts and rigid tendons.

    The problem that gives contact forces has passive muscle forces by
    `ContactOptions.contact_passive`. Where the tensions are to have others, they are solved for
    once more, under the contact forces.

    Returns
    -------
    the tensions, and the problem that the contact forces come from
    """
    problem = tension_problem(inputs)
    first = problem.solve_all(progress)
    if problem.options.has_passive == inputs.options.has_passive:
        return first, ContactSolution(problem, first)
    torques = torques_under(problem, inputs.torques)
    tension = _solve_once(replace(inputs, torques=torques, contacts=None))
    return with_contacts(tension, first), ContactSolution(problem, first)


def torques_under(problem: TensionProblem, torques: Series) -> Series:
    """Joint torques that remain under the contact forces of a solved problem.

    Returns
    -------
    (frames, coordinates) [N m or N]
    """
    assert problem.contacts is not None
    names = problem.assembly.tree.model.coordinate_names
    columns = [index for index, name in enumerate(torques.names) if name in names]
    of_contacts = problem.contacts.torques_of(problem.coordinates, problem.amplitudes)
    remaining = np.array(torques.values)
    remaining[:, columns] -= of_contacts[:, [names.index(torques.names[i]) for i in columns]]
    return Series(torques.time, torques.names, remaining)


def with_contacts(tension: Tension, first: Tension) -> Tension:
    """Tensions under contact forces that an earlier problem gave.

    Of status and residual the worse counts.

    Parameters
    ----------
    tension : of the muscles
    first : with the contact forces
    """
    return replace(
        tension,
        contacts=first.contacts,
        status=np.where(first.status > 0, first.status, tension.status),
        iterations=first.iterations + tension.iterations,
        equilibrium_residual=np.maximum(first.equilibrium_residual, tension.equilibrium_residual),
    )


def _sequential(inputs: TensionInputs, progress: Callable[[int], None] | None) -> Tension:
    """Contact forces from the six equations of motion of every floating body, muscles after.

    It is what [D] ch. 4 argues against and most programs do. The first problem has the costs of
    contacts and residuals, and joints as ideal torques that cost nothing, which is to leave their
    equations out; the second has the contact forces as known ones.

    Raises
    ------
    BadModel : no body floats
    """
    model = inputs.model
    roots = {name for joint in floating_joints(model) for name in joint.coordinates}
    if not roots:
        raise BadModel(
            f"model '{model.name}' has no body that floats freely: contact forces cannot be found"
            " before muscle tensions; use the simultaneous formulation"
        )
    without_muscles = replace(inputs, model=replace(model, muscles=()), emg=None, terms=())
    problem = tension_problem(without_muscles, roots)
    first = problem.solve_all()
    torques = torques_under(problem, inputs.torques)
    tension = _solve_once(replace(inputs, torques=torques, contacts=None), progress)
    return with_contacts(tension, first)
