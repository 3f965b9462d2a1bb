"""Soft tissue: how much more the markers move than the body's mass.

It is found together with masses, and taken where measured forces show it (`tissue_evidence`) and
held-out parts are predicted better.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from myomorph.body.identify.fitted import Fitted
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.parts import TissueColumns, parts_of
from myomorph.body.identify.tissue_evidence import TissueEvidence, tissue_evidence
from myomorph.body.identify.unseen import Strength
from myomorph.core.model.arrays import Array
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
"""Misfit on held-out parts, over that with the motion of the markers, under which soft tissue is
taken; and of one of several recordings, over which it is not: what helps a jump and harms a walk
says nothing of the next walk.
"""

Use = Literal["auto", "always", "never"]


class TissueChoice(NamedTuple):
    """Recordings with the motion that masses are fitted to.

    Attributes
    ----------
    fitted : without soft tissue, where that was taken
    evidence : what measured forces show of it; None where nobody asked
    """

    fitted: Fitted
    evidence: TissueEvidence | None


def with_soft_tissue(
    model: Model, markers: Fitted, strength: Strength, use: Use = "auto"
) -> TissueChoice:
    """Give recordings the motion of the body's mass, where forces show another than the markers'.

    Coordinates of the mass are those of the markers through 1 / (1 + alpha w^2), which leaves q =
    q_body - alpha q_body''; see docs/identification.md, "Soft tissue". Alphas of groups of
    coordinates are unknowns beside the base parameters, and the wrench is linearized in them until
    they settle.

    Parameters
    ----------
    model : whose masses the prior is about
    markers : fitted to the motion of the markers
    strength : problem of choosing how far data may move masses
    use : "auto" takes it where measured forces show it, and where it makes the misfit on unseen
        parts smaller by `GAIN` and no force or moment of a whole recording larger by `LOSS`

    Returns
    -------
    `markers`, or the same without soft tissue; and what forces show of it
    """
    if use == "never":
        return TissueChoice(markers, None)
    evidence = tissue_evidence(model, markers, usual_tissue(model), strength)
    if use == "auto" and not evidence.shown:
        return TissueChoice(markers, evidence)
    fitted = _fitted_tissue(model, markers, strength)
    if use == "always":
        return TissueChoice(fitted, evidence)
    ratios = fitted.misfits(strength) / markers.misfits(strength)
    taken = predicts_better(ratios, fitted.parts.several)
    return TissueChoice(fitted if taken else markers, evidence)


def _fitted_tissue(model: Model, markers: Fitted, strength: Strength) -> Fitted:
    """Estimate alphas beside the masses, and give recordings the motion of the body's mass.

    Parameters
    ----------
    model : whose masses the prior is about
    markers : fitted to the motion of the markers
    strength : problem of choosing how far data may move masses
    """
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
        parts = replace(parts, skin=markers.parts.skin)
        choice = strength.choose(parts)
        parameters = strength.fit(parts, choice[0], choice[2])
        change, sds = parts.soft_tissue(parameters, choice[0])
        if np.abs(change).max() < SETTLED:
            break
        sizes = sizes + change
    return Fitted(
        recordings=softened,
        parts=parts,
        tissue=replace(tissue, sd=ALPHA_SD * sds[member]),
        choice=choice,
    )


def predicts_better(ratios: Array, several: bool) -> bool:
    """Judge whether soft tissue is taken, from misfits on held-out parts.

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
