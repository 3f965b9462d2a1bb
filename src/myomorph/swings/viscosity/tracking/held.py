"""What should not move while a limb swings: the base on its plate, and joints that wires hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.spatial.transform import Rotation

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.filters import lowpass
from myomorph.swings.viscosity.specimen.model import Specimen

# Time over which a held pose is averaged before it is judged, against the markers' noise [s].
WINDOW = 0.25
# Low-pass of a base that goes back and forth with the limb, far above the rate of its swings [Hz].
SWAY = 5.0


@dataclass(frozen=True)
class Slip:
    """A held coordinate, or the "base", that moved in a trial, fastest at `time` [s].

    It moved by `amount` between its extremes, each the mean over `WINDOW`, or against the other
    trials, in `unit` "rad" or "m".

    `lasting`: it stays where it went (a wire slipped), instead of going to and fro (a wire is
    loose); `before`: it moved before this trial, and stands still in it; `center_off`: it goes to
    and fro with a limb that turns about another point than the center that is used; `cluster`: not
    what is named moved, but the cluster on that bone.
    """

    trial: str
    what: str
    time: float
    amount: float
    lasting: bool
    unit: str = "rad"
    before: bool = False
    center_off: bool = False
    cluster: bool = False

    @property
    def line(self) -> str:
        """The warning, as one line."""
        amount = (
            f"{np.degrees(self.amount):.1f} degrees"
            if self.unit == "rad"
            else f"{1000 * self.amount:.1f} mm"
        )
        if self.cluster:
            where = (
                f"trial '{self.trial}': the cluster of '{self.what}' slips on its bone by {amount}"
            )
            return (
                f"{where} at {self.time:.2f} s: fix it again; put back where bones beside it show"
                " where it was"
            )
        base = self.what == "base"
        what = "the base" if base else f"held joint '{self.what}'"
        if self.before:
            return (
                f"trial '{self.trial}': {what} is {amount} away from its position in the other"
                " trials"
            )
        if self.center_off:
            return (
                f"trial '{self.trial}': {what} seems to move by {amount} back and forth with the"
                " limb: the joint's center is off rather than loose: set center to 'motion'"
            )
        if base:
            cause = "clamp it again"
        elif self.lasting:
            cause = "a wire slipped"
        else:
            cause = "a wire is loose"
        return f"trial '{self.trial}': {what} moves by {amount}, most at {self.time:.2f} s: {cause}"


def mean_rotation(rotations: Array, weights: Array | None = None) -> Array:
    """Return the rotation nearest to all of several, in the mean of squared chords.

    Parameters
    ----------
    rotations : (frames, 3, 3)
    weights : (frames,) of each; equal by default

    Returns
    -------
    (3, 3)
    """
    return nearest_rotations(
        np.einsum("f,fij->ij", np.ones(len(rotations)) if weights is None else weights, rotations)
    )


def nearest_rotations(matrices: Array) -> Array:
    """Return the rotations nearest to matrices, as of sums of products of vectors (Kabsch 1976).

    Parameters
    ----------
    matrices : (..., 3, 3)

    Returns
    -------
    (..., 3, 3)
    """
    left, _, right = np.linalg.svd(matrices)
    left[..., 2] *= np.linalg.det(left @ right)[..., None]
    return left @ right


def cluster_poses(places: Array, seen: Array) -> tuple[Array, Array]:
    """Return the poses that bring a bone's markers onto those seen: least squares (Kabsch 1976).

    Parameters
    ----------
    places : (markers, 3) in the bone's frame [m]
    seen : (frames, markers, 3) in ground, NaN where hidden [m]

    Returns
    -------
    rotations (frames, 3, 3) and origins (frames, 3) [m]; NaN where fewer than three are seen
    """
    finite = np.asarray(np.isfinite(seen).all(axis=2))
    weight = finite.astype(float)[..., None]
    count = np.maximum(weight.sum(axis=1), 1.0)
    values = np.where(finite[..., None], seen, 0.0)
    middle = values.sum(axis=1) / count
    center = (weight * places).sum(axis=1) / count
    spread = (values - middle[:, None]) * weight
    cross = np.einsum("fmi,fmj->fij", spread, places - center[:, None])
    rotations = nearest_rotations(cross)
    origins = middle - np.einsum("fij,fj->fi", rotations, center)
    lacking = finite.sum(axis=1) < 3
    rotations[lacking] = np.nan
    origins[lacking] = np.nan
    return rotations, origins


def bone_poses(model: Model, bone: str, trials: Sequence[Markers]) -> tuple[Array, Array]:
    """Return `cluster_poses` of a bone's markers as the model has them.

    Parameters
    ----------
    model : with the markers
    bone : that carries them
    trials : recordings

    Returns
    -------
    rotations (frames, 3, 3) and origins (frames, 3) [m], all trials in a row; NaN in a trial that
    recorded fewer than three
    """
    poses = []
    for trial in trials:
        carried = [
            marker for marker in model.markers if marker.body == bone and marker.name in trial.names
        ]
        places = np.array([marker.location for marker in carried]).reshape(-1, 3)
        columns = [trial.names.index(marker.name) for marker in carried]
        poses.append(cluster_poses(places, trial.values[:, columns]))
    return np.concatenate([pose[0] for pose in poses]), np.concatenate([pose[1] for pose in poses])


def rotation_center(base: tuple[Array, Array], limb: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the point of a limb that stays nearest to one of the base.

    min sum |R_b c_b + p_b - R_l c_l - p_l|^2 over all frames (SCoRE: Ehrig et al. 2006,
    Journal of Biomechanics 39:2798).

    Parameters
    ----------
    base : finite rotations (frames, 3, 3) and origins (frames, 3) in ground [m]
    limb : the same of the limb

    Returns
    -------
    (3,) in the base and (3,) in the limb [m]
    """
    rows = np.concatenate([base[0], -limb[0]], axis=2).reshape(-1, 6)
    both = np.linalg.lstsq(rows, (limb[1] - base[1]).ravel(), rcond=None)[0]
    return both[:3], both[3:]


def base_poses(specimen: Specimen, motion: Motion) -> tuple[Array, Array]:
    """Return the poses of the base in ground, of its six coordinates.

    Parameters
    ----------
    specimen : with the base
    motion : with its coordinates

    Returns
    -------
    rotations (frames, 3, 3) and origins (frames, 3) [m]
    """
    columns = [motion.names.index(name) for name in specimen.base_coordinates]
    places = motion.values[:, columns[:3]]
    angles = motion.values[:, columns[3:]]
    stand = specimen.stand
    turns = np.full((len(motion), 3, 3), np.nan)
    seen = np.isfinite(angles).all(axis=1)
    turns[seen] = Rotation.from_euler("XYZ", angles[seen]).as_matrix()
    return stand.rotation @ turns, places @ stand.rotation.T + stand.translation


def mean_base(specimen: Specimen, motions: Sequence[Motion], weights: Sequence[Array]) -> Transform:
    """Return the one pose of the base over all trials of a condition.

    Parameters
    ----------
    specimen : with the base
    motions : of the trials
    weights : (frames,) of each trial

    Returns
    -------
    pose in ground
    """
    poses = [base_poses(specimen, motion) for motion in motions]
    rotations, origins = map(np.concatenate, zip(*poses, strict=True))
    weight = np.concatenate(weights) * np.isfinite(origins).all(axis=1)
    used = weight > 0.0
    place = np.average(origins[used], axis=0, weights=weight[used])
    return Transform(mean_rotation(rotations[used], weight[used]), place)


def mean_held(
    specimen: Specimen,
    motions: Sequence[Motion],
    weights: Sequence[Array],
    slipped: Sequence[Sequence[str]] = (),
) -> dict[str, float]:
    """Return the one value of every held coordinate over all trials.

    Of angles, it is the mean on the circle. What slipped in a trial does not count unless it
    slipped in all.

    Parameters
    ----------
    specimen : with the coordinates
    motions : of the trials
    weights : (frames,) of each trial
    slipped : coordinates that slipped, of each trial

    Returns
    -------
    value by coordinate [rad or m]
    """
    means = {}
    for name in specimen.held_coordinates:
        firm = [name not in names for names in slipped] or [True] * len(motions)
        chosen = [index for index, holds in enumerate(firm) if holds or not any(firm)]
        values = np.concatenate([motions[number][name] for number in chosen])
        weight = np.concatenate([weights[number] for number in chosen])
        used = np.isfinite(values) & (weight > 0.0)
        if not used.any():
            means[name] = specimen.model.coordinate(name).default
        elif specimen.model.coordinate(name).motion == "translational":
            means[name] = float(np.average(values[used], weights=weight[used]))
        else:
            means[name] = float(
                np.angle(np.average(np.exp(1j * values[used]), weights=weight[used]))
            )
    return means


@dataclass(frozen=True)
class SlipLimits:
    """Motion from which on something that should be held has slipped.

    Attributes
    ----------
    turned : rotation [rad]
    moved : displacement [m]
    """

    turned: float
    moved: float


@read_only
class MeanRest:
    """What is held, in the mean of all trials.

    Attributes
    ----------
    held : value of each held coordinate [rad or m]
    center : (3,) the joint's center, in ground [m]
    """

    held: Mapping[str, float]
    center: Array


def slips_within(specimen: Specimen, name: str, motion: Motion, limits: SlipLimits) -> list[Slip]:
    """Return held coordinates and the base that move in a trial by more than the limits."""
    slips = []
    for held in specimen.held_coordinates:
        unit = _unit(specimen, held)
        limit = limits.moved if unit == "m" else limits.turned
        slips += _slip(
            name, held, motion.time, np.unwrap(_filled(motion[held]))[:, None], limit, unit
        )
    return slips + base_slips(specimen, name, motion.time, base_poses(specimen, motion), limits)


def base_slips(
    specimen: Specimen, name: str, time: Array, poses: tuple[Array, Array], limits: SlipLimits
) -> list[Slip]:
    """Return the base where it rotates, or the joint's center moves, in a trial.

    Parameters
    ----------
    specimen : with the base
    name : of the trial
    time : (frames,) [s]
    poses : rotations (frames, 3, 3) and origins (frames, 3) of the base in ground, NaN where
        unknown [m]
    limits : from which on it is a slip

    Returns
    -------
    at most one slip
    """
    rotations, origins = poses
    seen = np.isfinite(origins).all(axis=1)
    if not seen.any():
        return []
    middle = mean_rotation(rotations[seen])
    angles = np.full((len(time), 3), np.nan)
    angles[seen] = Rotation.from_matrix(middle.T @ rotations[seen]).as_rotvec()
    slip = _slip(name, "base", time, _filled(angles), limits.turned, "rad")
    return slip or _slip(
        name, "base", time, center_course(specimen, time, rotations, origins), limits.moved, "m"
    )


def slips_before(
    specimen: Specimen, name: str, motion: Motion, rest: MeanRest, limits: SlipLimits
) -> list[Slip]:
    """Return what stands elsewhere in a trial than in the mean of all: it moved in between.

    Parameters
    ----------
    specimen : with the coordinates
    name : of the trial
    motion : of the trial
    rest : what is held, in the mean of all trials
    limits : from which on it is a slip

    Returns
    -------
    slips of coordinates and of the base
    """
    result = []
    start = float(motion.time[0])
    for coordinate, mean in rest.held.items():
        values = motion[coordinate][np.isfinite(motion[coordinate])]
        unit = _unit(specimen, coordinate)
        off = float(np.median(values)) - mean if len(values) else 0.0
        off = off if unit == "m" else float(np.angle(np.exp(1j * off)))
        if abs(off) > (limits.moved if unit == "m" else limits.turned):
            result.append(
                Slip(
                    trial=name,
                    what=coordinate,
                    time=start,
                    amount=abs(off),
                    lasting=True,
                    unit=unit,
                    before=True,
                )
            )
    there = center_course(specimen, motion.time, *base_poses(specimen, motion))
    distance = float(np.linalg.norm(np.median(there, axis=0) - rest.center))
    if distance > limits.moved:
        result.append(
            Slip(
                trial=name,
                what="base",
                time=start,
                amount=distance,
                lasting=True,
                unit="m",
                before=True,
            )
        )
    return result


def center_course(specimen: Specimen, time: Array, rotations: Array, origins: Array) -> Array:
    """Return where a base carries the joint's center, as a running median over `WINDOW`.

    Parameters
    ----------
    specimen : with the joint
    time : (frames,) [s]
    rotations : (frames, 3, 3) of the base in ground
    origins : (frames, 3) of the base in ground [m]

    Returns
    -------
    (frames, 3) in ground [m]
    """
    return median_filter(
        _filled(rotations @ specimen.center + origins), (_window(time), 1), mode="nearest"
    )


def base_sway(specimen: Specimen, motion: Motion, stand: Transform) -> Array:
    """Return the motion below `SWAY` of a base that goes to and fro.

    Parameters
    ----------
    specimen : with the base
    motion : with its coordinates
    stand : where it stands, in ground

    Returns
    -------
    (frames, 6) displacement of the joint's center [m] and rotation vector of the base [rad], in
    ground
    """
    rotations, origins = base_poses(specimen, motion)
    angles = np.full((len(motion), 3), np.nan)
    seen = np.isfinite(origins).all(axis=1)
    angles[seen] = Rotation.from_matrix(rotations[seen] @ stand.rotation.T).as_rotvec()
    center = rotations @ specimen.center + origins - stand.apply(specimen.center)
    return lowpass(_filled(np.hstack([center, angles])), motion.rate, SWAY)


def _unit(specimen: Specimen, name: str) -> str:
    return "m" if specimen.model.coordinate(name).motion == "translational" else "rad"


def course(motion: Motion, name: str) -> Array:
    """Return a held coordinate that slipped: the running median over `WINDOW`, gaps bridged.

    Parameters
    ----------
    motion : with the coordinate
    name : of the coordinate

    Returns
    -------
    (frames,) [rad or m]
    """
    values = np.unwrap(_filled(motion[name]))
    return median_filter(values, _window(motion.time), mode="nearest")


def _window(time: Array) -> int:
    """Frames in `WINDOW`, an odd number, so that a median stays where it is."""
    return max(3, round(WINDOW / float(np.median(np.diff(time)))) | 1) if len(time) > 1 else 3


def _slip(trial: str, what: str, time: Array, values: Array, limit: float, unit: str) -> list[Slip]:
    frames = _window(time)
    if len(time) <= 2 * frames:
        return []
    smooth = uniform_filter1d(values, frames, axis=0, mode="nearest")
    axis = int(np.argmax(np.ptp(smooth, axis=0)))
    column = smooth[:, axis]
    if np.ptp(column) <= limit:
        return []
    rate = np.abs(column[frames:] - column[:-frames])
    at = int(np.argmax(rate)) + frames // 2
    before = np.median(column[: max(at, 1)])
    after = np.median(column[at:])
    lasting = bool(abs(after - before) > 0.5 * np.ptp(column))
    return [
        Slip(
            trial=trial,
            what=what,
            time=float(time[at]),
            amount=float(np.ptp(column)),
            lasting=lasting,
            unit=unit,
        )
    ]


def _filled(values: Array) -> Array:
    """Values with gaps bridged along straight lines."""
    filled = np.array(values, dtype=np.float64)
    columns = filled.reshape(len(filled), -1)
    frames = np.arange(len(filled))
    for column in columns.T:
        known = np.isfinite(column)
        column[~known] = (
            np.interp(frames[~known], frames[known], column[known]) if known.any() else 0.0
        )
    return columns.reshape(filled.shape)
