"""Muscle tensions and contact forces: for every frame, the least effort that balances all equations
of motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from myomorph.core.model.errors import BadModel
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.tension.elastic.problem import solve_elastic
from myomorph.core.tension.problem import TensionInputs, TensionProblem, tension_problem
from myomorph.core.tension.tension import Tension, TensionOptions
from myomorph.core.tension.terms.actuators import floating_joints
from myomorph.core.tension.terms.contacts import ContactTask
from myomorph.core.tension.terms.emg import EmgTarget
from myomorph.core.tension.terms.term import Term


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
    terms: Sequence[Term] = (),
) -> Tension:
    """Share the joint torques among muscles with the least effort, frame by frame.

        minimise  sum_m w_m a_m^p + sum_r u_r^p + sum_g c_g z_g^2
        subject to  R^T F a + D u + J^T G z = tau - R^T (F_passive + F_viscous),  bounds on a, u and
        z

    with moment arms R, forces per unit activation F (rigid tendon), directions D of actuators with
    controls u, generators G of contact cones with amplitudes z, and one row for every coordinate
    that is not locked, prescribed, driven by a coupler or taken as dependent by closed loops. Which
    of a loop's coordinates is taken so does not change the solution. The problem of a frame is
    convex and its solution unique; frames depend on each other only through the smoothness of
    contact forces. See docs/contact-forces.md.

    Source: Crowninshield and Brand 1981.

    Parameters
    ----------
    model : with muscles
    motion : with velocities; a coordinate it lacks rests at its default
    torques : generalized forces of inverse dynamics at the motion's times (frames, coordinates), of
        those external forces alone that are known
    options : exponent, weights and which forces take part; see `TensionOptions`
    actuators : added to the model's own, replacing those of the same name, as OpenSim's
        `force_set_files`; None adds `default_reserves`, () adds nothing
    progress : called with the number of frames just done
    contacts : sites whose forces are to be found; passive muscle forces take part in that by
        `ContactOptions.contact_passive`, and in the tensions under these forces by `options`
    emg : what is known of activations
    terms : further costs and constraints, see `myomorph.core.tension.terms.term.Term` and
        docs/adding.md; where contact forces are found first (`ContactOptions.formulation`), they
        belong to the problem of the muscles

    Returns
    -------
    activations (frames, muscles) [-], forces (frames, muscles) [N], reserves [N m or N], status of
    each frame

    Raises
    ------
    BadData : where the motion has no velocities, torques, contacts or EMG are of other times, or
        loops are open by more than `loops.MAX_OPENING`
    UnknownName : where torques lack a free coordinate, or an actuator, a site or EMG names what
        does not exist
    BadModel : where the model has nothing to solve for

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.differentiate(mm.read_motion("reach.mot", model), cutoff=6.0)
    >>> found = mm.solve_tension(model, motion, mm.inverse_dynamics(model, motion))
    >>> found.muscles, found.forces.shape, bool(found.optimal.all())
    (('flexor', 'extensor'), (61, 2), True)
    """
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
    if contacts is not None and contacts.options.formulation == "sequential":
        return _sequential(inputs, progress)
    if contacts is not None and inputs.options.tendons == "rigid":
        return solve_contacts(inputs, progress)[0]
    return _solve_once(inputs, progress)


def _solve_once(inputs: TensionInputs, progress: Callable[[int], None] | None = None) -> Tension:
    if inputs.options.tendons == "elastic":
        return solve_elastic(inputs, progress)
    return tension_problem(inputs).solve_all(progress)


class ContactSolution(NamedTuple):
    """The problem that found contact forces, and all that it found."""

    problem: TensionProblem
    found: Tension


def solve_contacts(
    inputs: TensionInputs, progress: Callable[[int], None] | None = None
) -> tuple[Tension, ContactSolution]:
    """`solve_tension` with simultaneous contacts and rigid tendons, and the problem that found
    their forces. That problem has passive muscle forces by `ContactOptions.contact_passive`. Where
    the tensions are to have others, they are found once more, under the contact forces.
    """
    problem = tension_problem(inputs)
    first = problem.solve_all(progress)
    if problem.options == inputs.options:
        return first, ContactSolution(problem, first)
    under = replace(inputs, torques=torques_under(problem, inputs.torques), contacts=None)
    return with_contacts(_solve_once(under), first), ContactSolution(problem, first)


def torques_under(problem: TensionProblem, torques: Series) -> Series:
    """Joint torques (frames, coordinates) that remain under the contact forces of a solved problem
    [N m or N].
    """
    assert problem.contacts is not None
    names = problem.assembly.tree.model.coordinate_names
    mine = [index for index, name in enumerate(torques.names) if name in names]
    carried = problem.contacts.torques_of(problem.coordinates, problem.amplitudes)
    left = np.array(torques.values)
    left[:, mine] -= carried[:, [names.index(torques.names[number]) for number in mine]]
    return Series(torques.time, torques.names, left)


def with_contacts(tension: Tension, found: Tension) -> Tension:
    """Tensions under contact forces that were found before them; of status and residual the worse
    counts.
    """
    return replace(
        tension,
        contacts=found.contacts,
        status=np.where(found.status > 0, found.status, tension.status),
        iterations=found.iterations + tension.iterations,
        equilibrium_residual=np.maximum(found.equilibrium_residual, tension.equilibrium_residual),
    )


def _sequential(inputs: TensionInputs, progress: Callable[[int], None] | None) -> Tension:
    """Contact forces from the six equations of motion of every floating body, then muscles given
    these forces. It is what [D] ch. 4 argues against and most programs do. The first problem has
    the costs of contacts and residuals, and joints as ideal torques that cost nothing, which is to
    leave their equations out; the second has the contact forces as known ones.
    """
    model = inputs.model
    roots = {name for joint in floating_joints(model) for name in joint.coordinates}
    if not roots:
        raise BadModel(
            f"model '{model.name}' has no body that floats freely: contact forces cannot be found"
            " before muscle tensions; use the simultaneous formulation"
        )
    first = tension_problem(
        replace(inputs, model=replace(model, muscles=()), emg=None, terms=()), roots
    )
    result = first.solve_all()
    under = replace(inputs, torques=torques_under(first, inputs.torques), contacts=None)
    return with_contacts(_solve_once(under, progress), result)
