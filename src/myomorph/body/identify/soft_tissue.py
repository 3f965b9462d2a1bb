"""Soft tissue: how much more the markers move than the body's mass.

It is found together with masses, and taken where that predicts unseen parts better.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.parts import Parts, TissueColumns, held_out, parts_of
from myomorph.body.identify.unseen import ChosenPrior, Strength
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.soft_tissue import SoftTissue, coordinate_groups

ALPHA = 3e-4
"""Mean of alpha before anything is measured: a resonance of 9 Hz [s^2].

Soft tissue of legs vibrates at 10 to 50 Hz after impacts (Wakeling and Nigg 2001), models of
jumpers and runners have 5 to 15 Hz (Pain and Challis 2006), and what walkers store and return is
slower (Zelik and Kuo 2010).
"""

ALPHA_SD = 2e-4
GROUP_SD = 1e-4
"""Standard deviations of what all groups have in common, and of each group from that [s^2]: 7 to 16
Hz.
"""
STEP = 0.05  # Step of differences in alpha, in units of `ALPHA_SD`
ROUNDS = 6
SETTLED = 0.02
"""Times that motion and wrench are linearized at most, and change of alpha, in units of `ALPHA_SD`,
that ends it.
"""
GAIN = 0.95
LOSS = 1.02
"""Misfit on unseen parts, over that with the motion of the markers, under which soft tissue is
taken; and of one of several recordings, over which it is not: what helps a jump and harms a walk
says nothing of the next walk.
"""

Use = Literal["auto", "always", "never"]


@read_only
class Fitted:
    """Parts of recordings, with the noise and strength of the prior that were chosen on them.

    Attributes
    ----------
    recordings : whose motion is that of the body's mass
    parts : of these recordings
    tissue : that was taken from the motion of the markers; None for none
    choice : on those parts
    """

    recordings: tuple[Recording, ...]
    parts: Parts
    tissue: SoftTissue | None
    choice: ChosenPrior

    def misfits(self, strength: Strength) -> Array:
        """Compute the misfit on each unseen part.

        Parameters
        ----------
        strength : problem of choosing how far data may move masses

        Returns
        -------
        (folds, 2) root mean square of moment [N m] and force [N]
        """
        noise, _, sd = self.choice
        parts = self.parts
        return np.sqrt(
            held_out(parts, lambda fold: strength.fit(parts, noise, sd, parts.without(fold)), noise)
        )


def with_soft_tissue(
    model: Model, markers: Fitted, strength: Strength, use: Use = "auto"
) -> Fitted:
    """Give recordings the motion of the body's mass, where that predicts unseen parts better.

    Coordinates of the mass are those of the markers through 1 / (1 + alpha w^2), which leaves q =
    q_body - alpha q_body''; see docs/identification.md, "Soft tissue". Alphas of groups of
    coordinates are unknowns beside the base parameters, and the wrench is linearized in them until
    they settle.

    Parameters
    ----------
    model : whose masses the prior is about
    markers : fitted to the motion of the markers
    strength : problem of choosing how far data may move masses
    use : "auto" takes it where it makes the misfit on unseen parts smaller by `GAIN`, and no force
        or moment of a whole recording larger by `LOSS`

    Returns
    -------
    `markers` itself, or the same with soft tissue
    """
    if use == "never":
        return markers
    groups = coordinate_groups(model)
    names = tuple(dict.fromkeys(groups))
    member = np.array([names.index(group) for group in groups])
    root = np.linalg.inv(np.linalg.cholesky(np.eye(len(names)) * (GROUP_SD / ALPHA_SD) ** 2 + 1.0))
    sizes = np.full(len(names), ALPHA / ALPHA_SD)
    sds = np.zeros(len(names))
    parameters = strength.generic
    for _ in range(ROUNDS):
        tissue = SoftTissue(
            names=model.coordinate_names,
            groups=groups,
            alpha=ALPHA_SD * sizes[member],
            sd=ALPHA_SD * sds[member],
        )
        columns = TissueColumns(
            slopes=tuple(
                _slopes(model, recording, parameters, tissue, member)
                for recording in markers.recordings
            ),
            least=-sizes,
            mean=ALPHA / ALPHA_SD - sizes,
            root=root,
        )
        softened = tuple(recording.moved(tissue.of) for recording in markers.recordings)
        parts = parts_of(model, softened, markers.parts.base, markers.parts.least, columns)
        choice = strength.choose(parts)
        parameters = strength.fit(parts, choice[0], choice[2])
        change, sds = parts.soft_tissue(parameters, choice[0])
        if np.abs(change).max() < SETTLED:
            break
        sizes = sizes + change
    fitted = Fitted(
        recordings=softened,
        parts=parts,
        tissue=replace(tissue, sd=ALPHA_SD * sds[member]),
        choice=choice,
    )
    if use == "always":
        return fitted
    ratios = fitted.misfits(strength) / markers.misfits(strength)
    return fitted if predicts_better(ratios, parts.several) else markers


def predicts_better(ratios: Array, several: bool) -> bool:
    """Judge whether soft tissue is taken, from misfits on unseen parts.

    Parameters
    ----------
    ratios : (parts, 2) of moment and force, over those with the motion of the markers
    several : whether the parts are whole recordings

    Returns
    -------
    whether it is taken
    """
    lost = several and bool((ratios > LOSS).any())
    # Moment and force together, as where identified masses are judged.
    return bool(np.sqrt(np.square(ratios).mean(axis=1)).mean() < GAIN) and not lost


def usual_tissue(model: Model) -> SoftTissue:
    """Return soft tissue as it is before anything is measured."""
    groups = coordinate_groups(model)
    alpha = np.full(len(groups), ALPHA)
    sd = np.full(len(groups), np.hypot(ALPHA_SD, GROUP_SD))
    return SoftTissue(names=model.coordinate_names, groups=groups, alpha=alpha, sd=sd)


def _slopes(
    model: Model, recording: Recording, parameters: Array, tissue: SoftTissue, member: np.ndarray
) -> Array:
    """Compute what `ALPHA_SD` more of each group's alpha adds to the wrench to be explained.

    Parameters
    ----------
    parameters : (bodies, 10)
    tissue : about which differences are taken
    member : (coordinates,) number of the group of each

    Returns
    -------
    (frames, 6, groups) [N m], [N]
    """

    def missing(alpha: Array) -> Array:
        return recording.moved(replace(tissue, alpha=alpha).of).missing(model, parameters)

    at = missing(tissue.alpha)
    steps = [
        (missing(tissue.alpha + STEP * ALPHA_SD * (member == i)) - at) / STEP
        for i in range(member.max() + 1)
    ]
    return np.nan_to_num(np.stack(steps, axis=2))
