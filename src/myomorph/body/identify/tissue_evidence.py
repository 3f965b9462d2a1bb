"""Whether measured forces show that markers move more than the mass, or noise of the motion alone.

Soft tissue makes the force that a motion needs larger than the measured one by alpha w^2 of it.
Noise of the coordinates makes it larger too, for accelerations hold w^2 of the noise. A fit of
alpha by least squares cannot tell both apart: 1 / (1 + alpha w^2) takes noise from the needed force
as it takes soft tissue, so that it predicts held-out parts better where markers move as the mass.

What distinguishes them is that noise of the motion is not in the measured force F. So F is the
instrument (Fuller 1987, Measurement Error Models, 1.4): with

    z = F - F / (1 + alpha w^2)

for the usual alpha, and what fitted masses leave of the force, r = needed - F, where k times the
usual soft tissue was taken from the motion,

    E[z r(0)] = 0      for noise alone, whatever its size and however long it is alike
    E[z r(k)] = 0      for soft tissue of k times the usual one, with noise or without

so that k = z r(0) / (z r(0) - z r(1)), as r is nearly linear in k. Before, z is freed of what other
masses would explain. Noise of the plates is in z and in r with opposite signs: it lowers k. So do
markers that move less than the mass, as after a camera's filter, for which k is below 0.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.body.identify.fitted import Fitted
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.link_prior import conditioned, people_sd, prior_covariance
from myomorph.body.identify.parts import BORDER, Parts, TissueColumns, parts_of
from myomorph.body.identify.triangles import absorb
from myomorph.body.identify.unseen import ChosenPrior, Strength
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.soft_tissue import SoftTissue, slow_part
from myomorph.core.rigid.regressor import base_wrench

BLOCKS = 12  # Pieces of time of all recordings together, at least, by which scores are judged
MIN_BLOCKS = 4  # Fewer show no spread
LEVEL = 0.975  # Probability with which noise alone is not called soft tissue, on one side


@read_only
class TissueEvidence:
    """How much soft tissue measured forces show.

    Attributes
    ----------
    size : in units of the usual soft tissue; NaN where too little was recorded
    sd : standard deviation of it that noise alone would give; infinite where nothing is known
    blocks : pieces of time that this was judged by
    """

    size: float
    sd: float
    blocks: int

    @property
    def shown(self) -> bool:
        """Whether it is more than noise of the motion alone would give."""
        if self.blocks < MIN_BLOCKS:
            return False
        return bool(self.size > scipy.special.stdtrit(self.blocks - 1, LEVEL) * self.sd)

    @property
    def sentence(self) -> str:
        """What forces show, in words."""
        if not np.isfinite(self.size):
            return "soft tissue: not identifiable, the recording is too short"
        word = "identifiable" if self.shown else "not identifiable"
        return (
            f"soft tissue: {word}; measured forces have {self.size:.2g} of the usual one, and noise"
            f" of the motion alone would give 0 +- {self.sd:.2g}"
        )


class _Scores(NamedTuple):
    """Products of the instrument with what masses leave of the force.

    Attributes
    ----------
    markers : (blocks,) with the motion of the markers
    soft : (blocks,) with the usual soft tissue taken from it
    """

    markers: Array
    soft: Array


def tissue_evidence(
    model: Model, markers: Fitted, usual: SoftTissue, strength: Strength
) -> TissueEvidence:
    """Test whether measured forces show soft tissue.

    Parameters
    ----------
    model : whose masses the prior is about
    markers : fitted to the motion of the markers
    usual : soft tissue before anything is measured
    strength : problem of choosing how far data may move masses

    Returns
    -------
    size of soft tissue that forces show, and what noise alone would give
    """
    softened = [recording.moved(usual.of) for recording in markers.recordings]
    alpha = float(np.median(usual.alpha))
    instruments = TissueColumns(
        slopes=tuple(_instrument(model, recording, alpha) for recording in markers.recordings),
        least=np.zeros(1),
        mean=np.zeros(1),
        root=np.zeros((1, 1)),
    )
    each = max(MIN_BLOCKS, -(-BLOCKS // len(softened)))
    base = markers.parts.base
    choice = markers.choice
    of_markers = parts_of(model, markers.recordings, base, each, instruments)
    of_softened = parts_of(model, softened, base, each, instruments)
    return _judged(
        _Scores(
            markers=_scores(of_markers, strength, choice),
            soft=_scores(of_softened, strength, choice),
        )
    )


def _instrument(model: Model, recording: Recording, alpha: float) -> Array:
    """Compute the fast part of the measured force, as usual soft tissue would have it.

    Parameters
    ----------
    recording : whose measured force counts
    alpha : of the usual soft tissue [s^2]

    Returns
    -------
    (frames, 6, 1) with zeros for moments, which are about a point of the noisy motion [N]
    """
    source = recording if recording.finer is None else recording.finer
    time = source.motion.time
    measured = base_wrench(model, source.motion, source.wrenches)
    fast = np.zeros_like(measured)
    fast[:, 3:] = measured[:, 3:] - slow_part(time, measured[:, 3:], alpha)
    if recording.finer is not None:
        fast = recording.finer.passed(fast)
    return np.nan_to_num(fast)[:, :, None]


def _scores(blocks: Parts, strength: Strength, choice: ChosenPrior) -> Array:
    """Multiply the instrument by what fitted masses leave of the force, block by block.

    With z' = z - A (A^T A + C^-1)^-1 A^T z, which masses of the prior covariance C do not explain,

        u = z'^T (A x - b)

    Parameters
    ----------
    blocks : equations A x = b, with the instrument z as their first column
    strength : problem of choosing how far data may move masses
    choice : noise and strength of the prior

    Returns
    -------
    (blocks,) in squares of the noise
    """
    equations = _without_instrument(blocks)
    parameters = strength.fit(equations, choice.noise, choice.mass_sd)
    unknowns = blocks.unknowns(parameters)
    weights = np.square(blocks.weights(choice.noise))
    products_by_kind = blocks.factors.swapaxes(2, 3) @ blocks.factors
    squares = np.einsum("pkil,k->pil", products_by_kind, weights)
    combination = blocks.base.combination
    prior = (
        combination @ prior_covariance(strength.points, people_sd(strength.points)) @ combination.T
    )
    R, _ = equations.factor(choice.noise)
    explained = conditioned(prior, R) @ squares.sum(axis=0)[1:-1, 0]
    products = squares @ unknowns  # (blocks, 1 + n + 1)
    scores = products[:, 0] - products[:, 1:-1] @ explained
    return np.asarray(scores[blocks.pieces != BORDER])


def _without_instrument(blocks: Parts) -> Parts:
    """Leave out the first column of the equations."""
    size = blocks.factors.shape[-1] - 1
    factors = np.zeros((*blocks.factors.shape[:2], size, size))
    for part, kind in np.ndindex(factors.shape[:2]):
        factors[part, kind] = absorb(factors[part, kind], blocks.factors[part, kind][:, 1:])
    return replace(blocks, factors=factors, tissue=None)


def _judged(scores: _Scores) -> TissueEvidence:
    """Estimate how much soft tissue makes the scores vanish, and what noise alone would give.

    Noise alone has scores with the mean 0, whose spread between blocks says how far their sum is
    off.
    """
    blocks = len(scores.markers)
    less = float((scores.markers - scores.soft).sum())
    if blocks < MIN_BLOCKS or not less > 0.0:
        return TissueEvidence(size=np.nan, sd=np.inf, blocks=0)
    size = float(scores.markers.sum()) / less
    sd = float(np.sqrt(blocks) * scores.markers.std(ddof=1)) / less
    return TissueEvidence(size=size, sd=sd, blocks=blocks)
