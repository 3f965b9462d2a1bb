"""Parts of recordings, each condensed apart, to fit some and predict the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.body.identify.base_parameters import BaseParameters
from myomorph.body.identify.errors_in_rows import SEEN, ReturningErrors, Whitening
from myomorph.body.identify.least_squares import Recording, RowBlock
from myomorph.body.identify.triangles import absorb
from myomorph.core.model.arrays import Array, checked_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Model
from myomorph.core.rigid.regressor import base_wrench

MIN_PARTS = 4
# Time at each side of a cut that neither part has, because neighboring frames say the same [s]
GAP = 0.1
MAX_GAP_SHARE = 0.15  # The same at most, as a share of a part
MAX_NOISE = 0.5
"""Share of what data say of a combination of parameters that noise of the motion is taken to have
made, at most.
"""
BORDER = -1
"""Fold of frames beside a cut: they are fitted with all others, but neither held out nor fitted
while others are.
"""


@read_only
class TissueColumns:
    """Unknowns beside the base parameters: how much more soft tissue moves than the mass.

    See `SoftTissue`.

    Attributes
    ----------
    slopes : of each recording (frames, 6, groups), what a unit of each unknown adds to the measured
        wrench [N m], [N]
    least : (groups,) lowest value of each, where the mass moves as the markers
    mean : (groups,) before anything is measured
    root : (groups, groups) whose square is the inverse of their covariance then
    """

    slopes: tuple[Array, ...]
    least: Array
    mean: Array
    root: Array


@read_only
class Parts:
    """Equations of the base parameters by parts of recordings, moments and forces apart.

    Attributes
    ----------
    base : what the factors are of
    factors : (parts, 2, g + n + 1, g + n + 1) triangular, |R (t, x, -1)|^2 is the squared misfit of
        soft tissue t, of g groups, and base parameters x in the moments [N m] and the forces [N] of
        a part
    frames : (parts,) number of frames
    folds : (parts,) what is held out together: the recording where there are several, else the
        piece of time
    pieces : (parts,) piece of time, or `BORDER`
    least : parts that each recording was cut into
    center : (n,) base parameters of the model, about which equations with noise are corrected
    added : (parts, 2, g + n + 1, g + n + 1) what noise of the motion added to the squares of [A,
        b], which fits are corrected by (`motion_noise`); None corrects nothing
    tissue : of the first columns; None where there are none
    skin : errors of the motion that return with the posture (`skin_errors`), which fits are
        weighed by; None where there are none
    alike : frames that a filter makes say the same, which count as one
    """

    base: BaseParameters
    factors: Array
    frames: np.ndarray
    folds: np.ndarray
    pieces: np.ndarray
    least: int
    center: Array
    added: Array | None = None
    tissue: TissueColumns | None = None
    skin: ReturningErrors | None = None
    alike: float = 1.0

    def __post_init__(self) -> None:
        size = self.groups + len(self.base) + 1
        checked_array(self.factors, (len(self.frames), 2, size, size), "factors of parts")
        if self.added is not None:
            checked_array(self.added, self.factors.shape, "what noise added to parts")

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def groups(self) -> int:
        """Number of unknowns of soft tissue."""
        return 0 if self.tissue is None else len(self.tissue.mean)

    @property
    def names(self) -> list[int]:
        """The folds that can be held out."""
        return [int(fold) for fold in np.unique(self.folds) if fold != BORDER]

    @property
    def several(self) -> bool:
        """Whether whole recordings are held out, not pieces of one."""
        return not np.array_equal(self.folds, self.pieces)

    def fold(self, fold: int) -> np.ndarray:
        """Select the parts of one fold.

        Parameters
        ----------
        fold : its number, one of `names`

        Returns
        -------
        (chosen,) numbers of parts
        """
        return np.flatnonzero(self.folds == fold)

    def without(self, fold: int) -> np.ndarray:
        """Select the parts to fit while one fold is held out.

        Parameters
        ----------
        fold : its number, one of `names`

        Returns
        -------
        (chosen,) numbers of parts, without those beside a cut
        """
        return np.flatnonzero((self.folds != fold) & (self.folds != BORDER))

    def only(self, parts: Sequence[int] | np.ndarray) -> Parts:
        """Select parts; if all are of one recording, its pieces of time are the folds.

        Parameters
        ----------
        parts : (chosen,) numbers

        Returns
        -------
        the chosen parts
        """
        chosen = np.asarray(parts)
        folds = self.folds[chosen]
        folds = self.pieces[chosen] if len(np.unique(folds[folds != BORDER])) < 2 else folds
        return replace(
            self,
            factors=self.factors[chosen],
            frames=self.frames[chosen],
            folds=folds,
            pieces=self.pieces[chosen],
            added=None if self.added is None else self.added[chosen],
            skin=None if self.skin is None else self.skin.only(chosen),
        )

    def unknowns(self, parameters: Array, tissue: Array | None = None) -> Array:
        """Stack soft tissue, base parameters and -1, which a factor is multiplied by.

        Parameters
        ----------
        parameters : (bodies, 10)
        tissue : (g,) unknowns of soft tissue; by default where it was linearized

        Returns
        -------
        (g + n + 1,)
        """
        first = np.zeros(self.groups) if tissue is None else tissue
        return np.concatenate([first, self.base.of(parameters), [-1.0]])

    def rms(
        self,
        parameters: Array,
        parts: Sequence[int] | np.ndarray | None = None,
        tissue: Array | None = None,
    ) -> Array:
        """Compute the misfit of parameters.

        Parameters
        ----------
        parameters : (bodies, 10)
        parts : (chosen,) numbers; all by default
        tissue : (g,) unknowns of soft tissue; by default where it was linearized

        Returns
        -------
        (2,) root mean square of the moment's and the force's misfit [N m], [N]
        """
        chosen = np.arange(len(self)) if parts is None else np.asarray(parts)
        squares = np.square(self.factors[chosen] @ self.unknowns(parameters, tissue)).sum(
            axis=(0, 2)
        )
        return np.sqrt(squares / self.frames[chosen].sum())

    def soft_tissue(
        self, parameters: Array, noise: Array, parts: Sequence[int] | np.ndarray | None = None
    ) -> tuple[Array, Array]:
        """Estimate soft tissue from chosen parts, masses known.

        Parameters
        ----------
        parameters : (bodies, 10)
        noise : (2,) of moments and forces [N m], [N]
        parts : (chosen,) numbers; all by default

        Returns
        -------
        (g,) unknowns, at least `TissueColumns.least`, and (g,) their standard deviations
        """
        g = self.groups
        factor = self._absorbed(noise, parts)
        left = factor[:g, -1] - factor[:g, g:-1] @ self.base.of(parameters)
        found = (
            scipy.linalg.solve_triangular(factor[:g, :g], left)
            if self.tissue is not None
            else np.zeros(0)
        )
        least = np.zeros(0) if self.tissue is None else self.tissue.least
        return np.maximum(found, least), np.linalg.norm(np.linalg.inv(factor[:g, :g]), axis=1)

    def _absorbed(self, noise: Array, parts: Sequence[int] | np.ndarray | None = None) -> Array:
        """Combine factors of chosen parts in units of noise, with what is known of soft tissue.

        Parameters
        ----------
        noise : (2,) of moments and forces [N m], [N]

        Returns
        -------
        (g + n + 1, g + n + 1) upper triangular
        """
        factor: Array = np.zeros(self.factors.shape[2:])
        for part in np.arange(len(self)) if parts is None else np.asarray(parts):
            for kind, weight in enumerate(self.weights(noise)):
                factor = absorb(factor, self.factors[part, kind] * weight)
        if self.tissue is not None:
            rows = np.zeros((self.groups, len(factor)))
            rows[:, : self.groups] = self.tissue.root
            rows[:, -1] = self.tissue.root @ self.tissue.mean
            factor = absorb(factor, rows)
        return factor

    def weights(self, noise: Array) -> Array:
        """Return the weight of one component of a moment and a force.

        A vector of three components has three times the variance of one.

        Parameters
        ----------
        noise : (2,) of the vectors [N m], [N]

        Returns
        -------
        (2,) [1 / (N m)], [1 / N]
        """
        # A vector of three components has three times the variance of one.
        return np.sqrt(3.0 / self.alike) / noise

    def carried(self, noise: Array) -> Array:
        """Compute the change of soft tissue that goes with a unit of each base parameter.

        Parameters
        ----------
        noise : (2,) of moments and forces [N m], [N]

        Returns
        -------
        (g, n)
        """
        factor = self._absorbed(noise)
        g = self.groups
        return np.asarray(np.linalg.solve(factor[:g, :g], factor[:g, g:-1]), dtype=np.float64)

    def factor(
        self, noise: Array, parts: Sequence[int] | np.ndarray | None = None
    ) -> tuple[Array, Array]:
        """Condense chosen parts to |R phi_B - z|^2, their misfit in units of noise.

        Soft tissue is what fits phi_B best. Where noise of the motion is known (`added`), R and z
        are those of the motion without it, on the mean. Where its errors return with the posture
        (`skin`), rows that these move count less.

        Parameters
        ----------
        noise : (2,) of moments and forces [N m], [N]
        parts : (chosen,) numbers; all by default

        Returns
        -------
        (n, n) R and (n,) z
        """
        chosen = np.arange(len(self)) if parts is None else np.asarray(parts)
        R, z = self._independent(noise, chosen)
        if self.skin is None:
            return R, z
        return Whitening.of(R, self._skin_pulls(noise, chosen)).rows(z)

    def weighed(self, scores: Array, noise: Array) -> Array:
        """Weigh pulls at base parameters as the rows are weighed for errors of the skin.

        Parameters
        ----------
        scores : (draws, n) products of rows and errors, of all parts
        noise : (2,) of moments and forces [N m], [N]

        Returns
        -------
        (draws, n)
        """
        if self.skin is None:
            return scores
        every = np.arange(len(self))
        R, _ = self._independent(noise, every)
        return Whitening.of(R, self._skin_pulls(noise, every)).scores(scores)

    def _skin_pulls(self, noise: Array, chosen: np.ndarray) -> Array:
        """Sum what the skin does over chosen parts, in units of noise.

        Returns
        -------
        (n, k)
        """
        weights = np.square(self.weights(noise))
        assert self.skin is not None
        pulls: Array = np.einsum("pknj,k->nj", self.skin.pulls[chosen], weights)
        return pulls

    def explained_errors(self, noise: Array) -> Array:
        """Compute what base parameters explain of errors that return with the posture.

        Parameters
        ----------
        noise : (2,) of moments and forces [N m], [N]

        Returns
        -------
        (2,) mean square of moment and force [(N m)^2], [N^2]
        """
        if self.skin is None:
            return np.zeros(2)
        squares = self.skin.squares.sum(axis=0)
        every = np.arange(len(self))
        R, _ = self._independent(noise, every)
        explained = Whitening.of(R, self._skin_pulls(noise, every)).explained
        share = explained / max(float(np.square(self.weights(noise)) @ squares), 1e-300)
        return np.asarray(share * squares / self.frames.sum())

    def _independent(self, noise: Array, chosen: np.ndarray) -> tuple[Array, Array]:
        """Condense chosen parts as if the motion had no errors that return with the posture.

        Parameters
        ----------
        noise : (2,) of moments and forces [N m], [N]
        chosen : (chosen,) numbers of parts

        Returns
        -------
        (n, n) R and (n,) z
        """
        g = self.groups
        factor = self._absorbed(noise, chosen)
        if self.added is not None:
            added = np.einsum("pkij,k->ij", self.added[chosen], np.square(self.weights(noise)))
            center = np.concatenate([np.zeros(g), self.center])
            R, z = without_noise(factor[:-1, :-1], np.array(factor[:-1, -1]), added, center)
            if not g:
                return R, z
            factor = absorb(np.zeros_like(factor), np.column_stack([R, z]))
        # Soft tissue comes first, so that its rows can be met whatever the base parameters are.
        return factor[g:-1, g:-1], np.array(factor[g:-1, -1])

    def rows(
        self, noise: Array, parts: Sequence[int] | np.ndarray | None = None
    ) -> tuple[Array, Array]:
        """Condense chosen parts to |A phi - b|^2, their misfit in units of noise.

        Parameters
        ----------
        noise : (2,) of moments and forces [N m], [N]
        parts : (chosen,) numbers; all by default

        Returns
        -------
        (n, 10 bodies) A and (n,) b
        """
        R, z = self.factor(noise, parts)
        return R @ self.base.combination, z

    def estimate(self, noise: Array, mean: Array, spread: Array) -> Array:
        """Estimate base parameters by least squares, with a prior for what no frame shows.

        Parameters
        ----------
        noise : (2,) of moments and forces [N m], [N]
        mean, spread : (n,) prior of the base parameters

        Returns
        -------
        (n,)
        """
        R, z = self.factor(noise)
        rows = np.vstack([R, np.diag(1.0 / spread)])
        return scipy.linalg.lstsq(rows, np.concatenate([z, mean / spread]))[0]


def parts_of(
    model: Model,
    recordings: Sequence[Recording],
    base: BaseParameters,
    least: int = MIN_PARTS,
    tissue: TissueColumns | None = None,
) -> Parts:
    """Cut recordings in time into `least` parts each, with gaps between them.

    Whole recordings are held out where there are several: halves of one motion are too much alike
    to tell how masses do on another.

    Parameters
    ----------
    model : with the recordings' joints
    recordings : with derivatives of the motion
    base : what the parts are equations of
    least : parts of each recording
    tissue : unknowns beside the base parameters, of the same recordings

    Returns
    -------
    the parts, those of frames beside a cut included

    Raises
    ------
    BadData : no frame can be used
    """
    g = 0 if tissue is None else len(tissue.mean)
    n = g + len(base)
    factors = []
    frames = []
    folds = []
    pieces = []
    for number, recording in enumerate(recordings):
        cut = pieces_of(model, recording, least)
        use = cut.use
        piece = cut.piece
        sums = np.zeros((least + 1, 2, n + 1, n + 1))
        for block in recording.rows(model):
            known = use[block.frames] & np.isfinite(block.wrench).all(axis=1)
            for lag in range(BORDER, least):
                wanted = known & (piece[block.frames] == lag)
                if not wanted.any():
                    continue
                slopes = None
                if tissue is not None:
                    slopes = tissue.slopes[number][block.frames][wanted]
                for kind, rows in enumerate((slice(0, 3), slice(3, 6))):
                    table = _table(block, wanted, rows, base.columns, slopes)
                    sums[lag, kind] = absorb(sums[lag, kind], table)
        for lag, count in cut.counts.items():
            factors.append(sums[lag])
            frames.append(count)
            pieces.append(BORDER if lag == BORDER else number * least + lag)
            folds.append(number if len(recordings) > 1 else pieces[-1])
    if not frames:
        raise BadData("no frame can be used to identify")
    center = base.of(inertial_parameters(model))
    return Parts(
        base=base,
        factors=np.stack(factors),
        frames=np.array(frames),
        folds=np.array(folds),
        pieces=np.array(pieces),
        least=least,
        center=center,
        added=None,
        tissue=tissue,
        alike=float(np.mean([recording.alike for recording in recordings])),
    )


class Pieces(NamedTuple):
    """A recording cut in time.

    Attributes
    ----------
    use : (frames,) which frames are used
    piece : (frames,) number of the piece, `BORDER` beside a cut
    counts : used frames by piece, in the order of parts; pieces without any are left out
    """

    use: np.ndarray
    piece: np.ndarray
    counts: dict[int, int]

    def parts(self, first: int) -> np.ndarray:
        """Find the part that each frame is in.

        Parameters
        ----------
        first : number of the recording's first part

        Returns
        -------
        (frames,) -1 for frames that are not used
        """
        result = np.full(len(self.use), -1)
        for index, piece in enumerate(self.counts):
            result[self.use & (self.piece == piece)] = first + index
        return result


def pieces_of(model: Model, recording: Recording, least: int) -> Pieces:
    """Cut the used frames of a recording in time.

    Parameters
    ----------
    model : with the recording's joints
    recording : with derivatives of the motion
    least : number of pieces
    """
    use = np.ones(len(recording.motion), bool)
    if recording.use is not None:
        use = np.asarray(recording.use)
    measured = base_wrench(model, recording.motion, recording.wrenches)
    use = use & np.isfinite(measured).all(axis=1)
    piece = _pieces(recording.motion.time, use, least)
    every = {lag: int((use & (piece == lag)).sum()) for lag in (*range(least), BORDER)}
    counts = {lag: count for lag, count in every.items() if count}
    return Pieces(use=use, piece=piece, counts=counts)


def _table(
    block: RowBlock, wanted: np.ndarray, rows: slice, columns: np.ndarray, slopes: Array | None
) -> Array:
    """Write three rows of the wrench in some frames as one table.

    Parameters
    ----------
    block : equations
    wanted : (frames,) of the block
    rows : three of the six, moments or forces
    columns : (n,) of the regressor that count
    slopes : (wanted frames, 6, g) what soft tissue adds to the wrench; None without soft tissue

    Returns
    -------
    (3 wanted frames, g + n + 1) soft tissue, base parameters and the measured wrench
    """
    g = 0 if slopes is None else slopes.shape[2]
    n = len(columns)
    table = np.empty((3 * int(wanted.sum()), g + n + 1), order="F")
    if slopes is not None:
        table[:, :g] = slopes[:, rows].reshape(-1, g)
    table[:, g:-1] = block.rows[wanted][:, rows][:, :, columns].reshape(-1, n)
    table[:, -1] = block.wrench[wanted][:, rows].ravel()
    return table


def without_noise(R: Array, z: Array, added: Array, center: Array) -> tuple[Array, Array]:
    """Take from the squares of [R, z] what noise added to them.

    |R x - z|^2 is the misfit of x. The pull of the data at x is corrected in full. Their hold on x
    is only where noise made up to `MAX_NOISE` of it: beyond, it keeps the rest, since a hold that
    is not positive has no least misfit.

    Parameters
    ----------
    R : (n, n)
    z : (n,)
    added : (n + 1, n + 1) to the squares of [R, z]
    center : (n,) where x is expected, from which the pull is counted

    Returns
    -------
    (n, n) R and (n,) z without the noise, on the mean
    """
    _, sizes, right = np.linalg.svd(R)
    seen = sizes > SEEN * sizes[0]
    whitened = right[seen] / sizes[seen, None]
    share, axes = np.linalg.eigh(whitened @ added[:-1, :-1] @ whitened.T)
    kept = np.sqrt(1.0 - np.minimum(share, MAX_NOISE))
    root = (axes * kept) @ axes.T @ (right[seen] * sizes[seen, None])
    pull = R.T @ (z - R @ center) - (added[:-1, -1] - added[:-1, :-1] @ center)
    aim = root @ center + (axes / kept) @ axes.T @ whitened @ pull
    full = np.zeros_like(R)
    full[: len(root)] = root
    return full, np.append(aim, np.zeros(len(R) - len(aim)))


def _pieces(time: Array, use: np.ndarray, pieces: int) -> np.ndarray:
    """Assign used frames to pieces of time, as many frames in each.

    Parameters
    ----------
    time : (frames,) [s]
    use : (frames,) which frames are used
    pieces : number of pieces

    Returns
    -------
    (frames,) number of the piece, `BORDER` beside a cut
    """
    total = max(int(use.sum()), 1)
    place = (np.cumsum(use) - 0.5) * pieces / total
    number = np.clip(place.astype(int), 0, pieces - 1)
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    gap = min(GAP / step * pieces / total, MAX_GAP_SHARE)
    cut = np.round(place)
    beside = (np.abs(place - cut) < gap) & (cut > 0.5) & (cut < pieces - 0.5)
    return np.where(beside, BORDER, number)


def held_out(parts: Parts, fit: Callable[[int], Array], noise: Array) -> Array:
    """Compute the misfit of each fold by what was fitted to the others.

    Parameters
    ----------
    parts : with the folds
    fit : parameters (bodies, 10) fitted without a fold
    noise : (2,) of moments and forces, that soft tissue is fitted with, without the fold too [N m],
        [N]

    Returns
    -------
    (folds, 2) mean square misfit of moment and force [(N m)^2], [N^2]
    """
    return np.square([predicted(parts, fold, fit(fold), noise) for fold in parts.names])


def predicted(parts: Parts, fold: int, parameters: Array, noise: Array) -> Array:
    """Compute the misfit of a fold, with the soft tissue that the others say.

    Parameters
    ----------
    parts : with the folds
    fold : that is predicted
    parameters : (bodies, 10)
    noise : (2,) of moments and forces [N m], [N]

    Returns
    -------
    (2,) root mean square of moment and force [N m], [N]
    """
    tissue = parts.soft_tissue(parameters, noise, parts.without(fold))[0] if parts.groups else None
    return parts.rms(parameters, parts.fold(fold), tissue)
