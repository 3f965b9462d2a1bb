"""Contacts that cannot carry the motion: which frames, and the smallest relaxation that would make them able to.

What carries a subject as a whole is in the equations of motion of its root, where muscles have no part. Where the
contacts leave more there than residuals may give, a linear program asks for the least that would have to be allowed,

    minimise  sum_k c_k |r_k|   subject to  E z + sum_k D_k r_k + R w = b,   z >= 0,  |w| <= limits

with relaxations r: force at a site that is said not to touch, force across a cone beyond its friction, force beyond a
site's greatest, a pull at a site that only pushes, and, dearest, a residual. The sum of sizes (1-norm) makes few of
them differ from 0, so that the answer has a name.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData
from myomorph.tension.dual import MISSING
from myomorph.tension.problem import TensionProblem
from myomorph.tension.relaxation_program import Allowance, Roots, smallest_relaxation, what_lacks, what_would_do
from myomorph.tension.tension import Tension
from myomorph.tension.terms.actuators import floating_joints

RESIDUAL_SHARE = 0.05
"""Residual force at a root from which a frame is marked, as a share of its subject's weight (Hicks et al. 2015 ask for
less than that of the greatest external force)."""
MOMENT_SHARE = 0.05  # Residual moment, as a share of the weight times the height of the center of mass above the floor
NAMED = 0.01  # Relaxations smaller than this share of the weight are not named beside greater ones


@read_only
class Relaxation:
    """A frame whose contacts cannot carry the motion."""

    frame: int
    time: float
    # (3,) what contacts leave at the roots together, in ground; moments about the bodies' mass centers [N]
    force: Array
    # (3,) what contacts leave at the roots together, in ground; moments about the bodies' mass centers [N m]
    moment: Array
    touching: tuple[str, ...]  # sites that may carry force
    allowances: tuple[Allowance, ...]  # what would do, greatest first
    size: float  # sum of all their sizes, over the weight of the model
    sentence: str  # all that in one line


def relaxations(
    problem: TensionProblem, tension: Tension, residual: float = RESIDUAL_SHARE, moment: float = MOMENT_SHARE
) -> tuple[Relaxation, ...]:
    """Frames whose contacts cannot carry the motion, and the smallest relaxation of each.
    Frames that lack input are left out, and those in which residuals are large though contacts could do without them;
    a model that does not float has none.
    `problem`, `tension`: as `tension_problem` sets it up with contacts, solved, and what it found.
    """
    if problem.contacts is None:
        raise BadData("there are no contacts that could carry the motion: give contacts to the tension problem")
    held = {name for joint in floating_joints(problem.assembly.tree.model) for name in joint.coordinates}
    if not held or not held <= set(problem.assembly.rows):
        return ()
    roots = Roots(problem, problem.contacts, tension)
    limits = roots.weights[:, None] * [residual, moment * roots.center]
    left = roots.left.reshape(len(tension), -1, 2, 3)
    beyond = (np.linalg.norm(left, axis=3) > limits).any(axis=(1, 2))
    marked = np.flatnonzero((tension.status != MISSING) & beyond)
    results = []
    for frame in marked.tolist():
        allowed = smallest_relaxation(roots, frame, limits)
        if not allowed:
            # The contacts could carry it, at more effort than the residuals that were taken instead.
            continue
        force, turn = left[frame].sum(axis=0)
        sites = problem.contacts.generators.sites
        touching = tuple(
            site.name for index, site in enumerate(sites) if problem.contacts.activations[frame, index] > 0.0
        )
        named = tuple(allowance for allowance in allowed if allowance.size > NAMED * roots.weight) or allowed[:1]
        time = float(tension.time[frame])
        lacking = what_lacks(touching, force, turn, roots.up)
        size = sum(allowance.size for allowance in allowed) / roots.weight
        results.append(
            Relaxation(
                frame, time, force, turn, touching, named, size, f"{time:.2f} s: {lacking}: {what_would_do(named)}"
            )
        )
    return tuple(results)


def relaxation_lines(relaxations: Sequence[Relaxation]) -> tuple[str, ...]:
    """One line for each run of neighbouring frames that the same would help: that of the frame that lacks most."""
    runs: list[list[Relaxation]] = []
    for relaxation in relaxations:
        last = runs[-1][-1] if runs else None
        if last is not None and relaxation.frame == last.frame + 1 and _names(relaxation) == _names(last):
            runs[-1].append(relaxation)
        else:
            runs.append([relaxation])
    lines = []
    for run in runs:
        worst = max(run, key=lambda frame: frame.size)
        span = f"{run[0].time:.2f} to {run[-1].time:.2f} s, worst at " if len(run) > 1 else ""
        lines.append(span + worst.sentence)
    return tuple(lines)


def _names(relaxation: Relaxation) -> tuple[tuple[str, str], ...]:
    return tuple(sorted((part.kind, part.where) for part in relaxation.allowances))
