"""Options and results of kinematic identification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from myomorph.body.calibrate.patella_fit import PatellaDistance
from myomorph.core.fit.estimation import Estimate
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.findings import Finding
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers
from myomorph.core.model.shown import shown
from myomorph.core.motion.lengths import Length
from myomorph.core.rigid.coordinates import Ints

STATIC = "static trial"
FUNCTIONAL = "joint centers and axes"
SYMMETRY = "symmetric posture"
GENERIC = "generic model"
SOURCES = (STATIC, FUNCTIONAL, SYMMETRY, GENERIC)
MARKER_SD = 0.02
FIXED_SD = 0.01
"""How far a marker, and one on a bony landmark, usually lies from the model's along one axis of a
human body [m].
"""
SLIDE = 0.005
SLIDE_TURN = 0.05
"""How far all markers of a segment of a human body slide [m] and turn [rad] as one, standard
deviations.
"""


@dataclass(frozen=True)
class CalibrationOptions:
    """Options of kinematic identification.

    Attributes
    ----------
    frames : maximum number of frames; those whose postures differ most are used
    symmetric : give the right and the left side the same lengths
    fit : unknowns that are estimated together: "lengths", "markers" (their positions); others keep
        the values of the given model, lengths scaled to the overall size
    method : order of estimation; "joint": all unknowns at once; "alternating": lengths and marker
        positions in turn, as in [D]
    mass : body mass [kg]; by default the model's, scaled with the segments
    length_sd : relative standard deviation of a segment's length from the overall size
    shape_sd : relative standard deviation between the scale factors of a segment along and across
        it
    side_sd : relative standard deviation between right and left lengths; if the data show larger
        differences, a wider prior replaces it, with a warning
    posture_sd : standard deviation between right and left mean joint angles, and of the trunk's
        mean lateral lean [rad]; more if both sides were not recorded alike
    marker_sd : standard deviation of a marker's position from that on the given model [m]; outliers
        are released (Student's t with 3 degrees of freedom); by default 0.02 on a body of human
        size, on a smaller one in proportion (`length_unit`)
    fixed_sd : standard deviation of the position of a marker that the model calls fixed, as on a
        bony landmark, from that on the given model [m]; such markers are not released; by default
        0.01 on a body of human size, on a smaller one in proportion
    noise : standard deviation of a marker's position on a rigid body along one axis, mostly
        movement of the skin [m]; 0 estimates it from the residual, which is right for markers
        without skin; by default 0.005 on a body of human size, on a smaller one in proportion
    zero_sd : standard deviation of the orientation of the person's bone axes relative to the
        generic model's [rad]; it widens the intervals of zero angles. The default of 4 degrees is
        that of angles between examiners who palpate the same landmarks (Della Croce et al. 2005)
    slide_sd : standard deviation of the common translation of all markers of a segment while the
        body moves, along one axis [m]; it widens the intervals of lengths, marker positions and
        zero angles; by default as `noise`. Translations and rotations of whole clusters are most of
        the skin's movement in walking (Barré et al. 2017)
    slide_turn_sd : standard deviation of their common rotation about each axis [rad]; by default 3
        degrees if `slide_sd` is 5 mm, and in proportion, like the 1 to 6 degrees between hip angles
        by markers and by fluoroscopy (Fiorentino et al. 2017); without effect if `slide_sd` is 0
    independent_frames : effective number of independent frames of moving skin and clothes, as their
        movement is similar from frame to frame; without effect if the residual gives the noise
    static_sd : standard deviation of the coordinates that are known in the static trial [rad]
    iterations : maximum number of iterations
    marker_weights : weight of each marker; markers that are not named have 1, and 0 leaves a marker
        out
    fixed_markers : markers that keep their position on the model
    static : a recording of standing still
    static_pose : values of coordinates in it [rad or m]; by default knees and feet as the model
        stands
    posture_weight : weight of the pull to the default pose, as in `InverseKinematicsOptions`, but
        too small to affect lengths
    patellae : move patellae as far from the knees' axes as markers on them say, with the spread of
        published moment arms as prior
    """

    frames: int = 50
    symmetric: bool = False
    fit: tuple[str, ...] = ("lengths", "markers")
    method: Literal["joint", "alternating"] = "joint"
    mass: float | None = None
    length_sd: float = 0.05
    shape_sd: float = 0.05
    side_sd: float = 0.01
    posture_sd: float = 0.07
    marker_sd: float | None = None
    fixed_sd: float | None = None
    noise: float | None = None
    zero_sd: float = 0.07
    slide_sd: float | None = None
    slide_turn_sd: float | None = None
    independent_frames: int = 6
    static_sd: float = 0.1
    iterations: int = 60
    marker_weights: Mapping[str, float] = field(default_factory=dict)
    fixed_markers: tuple[str, ...] = ()
    static: Markers | None = None
    static_pose: Mapping[str, float] | None = None
    posture_weight: float = 1e-10
    patellae: bool = True


@dataclass(frozen=True, kw_only=True)
class Distances:
    """Distances that the options state, on a body of some size.

    Attributes
    ----------
    marker, fixed : how far a marker and one on a landmark usually lie from the model's [m]
    noise : of a marker along one axis [m]; 0 takes it from the residual
    unit : `length_unit` of the body
    slide : how far all markers of a segment slide as one [m]
    turn : how far they rotate as one [rad]
    """

    marker: float
    fixed: float
    noise: float
    unit: float
    slide: float
    turn: float

    @classmethod
    def of(cls, options: CalibrationOptions, unit: float) -> Distances:
        """Take distances as specified, or those of a human body times the size of this one.

        Parameters
        ----------
        options : None in a field means the usual value
        unit : `length_unit` of the body, 1 for human size

        Returns
        -------
        distances [m], and the rotation of sliding skin [rad]
        """

        def specified(value: float | None, usual: float) -> float:
            return usual * unit if value is None else value

        noise = specified(options.noise, SLIDE)
        slide = noise if options.slide_sd is None else options.slide_sd
        turn = options.slide_turn_sd
        if turn is None:
            turn = SLIDE_TURN * slide / (SLIDE * unit)
        return cls(
            marker=specified(options.marker_sd, MARKER_SD),
            fixed=specified(options.fixed_sd, FIXED_SD),
            noise=noise,
            unit=unit,
            slide=slide,
            turn=turn,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class LengthEstimate:
    """A length as the recordings show it.

    Attributes
    ----------
    length : which one
    factor, sd : of the given model's length, and the standard deviation that noise and prior leave
    prior_sd : standard deviation before any marker was seen, the overall size known
    generic, value : distance between joint centers along the axis before and after [m]
    """

    length: Length
    factor: float
    sd: float
    prior_sd: float

    @property
    def generic(self) -> float:
        """Distance on the given model [m]."""
        return self.length.extent

    @property
    def value(self) -> float:
        """Distance found [m]."""
        return self.length.extent * self.factor

    @property
    def shown(self) -> bool:
        """Whether the recordings halve the standard deviation known before."""
        return self.sd < 0.5 * self.prior_sd


@read_only
class MarkerEstimate:
    """A marker where the recordings show it.

    Attributes
    ----------
    name, body : of the marker, and that it is on
    location : (3,) on its stretched body [m]
    shift : (3,) from where stretching alone puts it [m]
    sd : (3,) standard deviation along the body's axes [m]
    before, after : root mean square distance from the recordings on the given model and at the end
        [m]
    """

    name: str
    body: str
    location: Array
    shift: Array
    sd: Array
    before: float
    after: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ZeroAngle:
    """The zero of one coordinate.

    Attributes
    ----------
    coordinate : name
    offset : mean angle on the found model less that on the generic one at the body's size [rad]
    sd : standard deviation of what every angle of this coordinate is off by [rad]
    shares : of what is known of the zero, by source
    """

    coordinate: str
    offset: float
    sd: float
    shares: Mapping[str, float]

    @property
    def source(self) -> str:
        """The source that fixes the zero most; of equal ones the first of `SOURCES`."""
        return max(SOURCES, key=lambda source: self.shares[source])

    @property
    def interval(self) -> tuple[float, float]:
        """Of the offset, 90 % [rad]."""
        half = float(half_width(self.sd))
        return self.offset - half, self.offset + half


@dataclass(frozen=True, kw_only=True)
class SideEstimate:
    """A length of both sides, as the data show it without the assumption that sides are alike.

    Attributes
    ----------
    first, second : names of the lengths
    difference, sd : first less second, as a share of the length, and its standard deviation
    differs : whether the data show more than `side_sd` explains, so that the sides were set free
    """

    first: str
    second: str
    difference: float
    sd: float
    differs: bool


@shown
@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """A model of the recorded body, and how far to trust it.

    Attributes
    ----------
    options : of the calibration
    lengths : every length of the model that may change
    markers : every marker, with its shift
    model : stretched, markers placed
    factors : (3,) of every body
    size : overall size relative to the given model
    noise : of a marker along one axis, as counted for `independent_frames`, or found [m]
    frames : for each recording (the static one last) its chosen frames
    angles : for each recording (frames, coordinates) of the chosen frames [rad or m]
    before, after : for each recording (frames, markers) distances on the given model and on the
        found one [m]
    marker_names : of the columns of `before` and `after`
    converged : whether the last step was small
    steps, last_change : of all stages; largest change in the last one, of a factor or in
        `length_unit`
    zero_angles : what fixes the zero of each angle, and how well
    sides : what the data say of the lengths of both sides
    costs : the objective after every step of the last stage [m^2]
    notes : what the recordings do not show, one line each
    warnings : what of the recordings the model's joints cannot explain, and whether it was left out
    estimate : the unknowns with their covariance, and how each source of residuals is explained
    marker_spread : how far markers lie from their places, relative to `marker_sd` and `fixed_sd`;
        intervals take it
    patella : how much farther out the patellae of `model` lie than those of the given model; None
        where no marker on them shows it
    """

    model: Model
    options: CalibrationOptions
    factors: Mapping[str, Array]
    lengths: tuple[LengthEstimate, ...]
    markers: tuple[MarkerEstimate, ...]
    size: float
    noise: float
    frames: tuple[Ints, ...]
    angles: tuple[Array, ...]
    before: tuple[Array, ...]
    after: tuple[Array, ...]
    marker_names: tuple[str, ...]
    converged: bool
    costs: tuple[float, ...]
    notes: tuple[Message, ...]
    steps: int = 0
    last_change: float = 0.0
    zero_angles: tuple[ZeroAngle, ...] = ()
    sides: tuple[SideEstimate, ...] = ()
    warnings: tuple[Finding, ...] = ()
    estimate: Estimate | None = None
    marker_spread: float = 1.0
    patella: PatellaDistance | None = None

    @property
    def rms_before(self) -> float:
        """Root mean square distance of all markers on the given model [m]."""
        return root_mean_square(self.before)

    @property
    def rms_after(self) -> float:
        """Root mean square distance of all markers on the found model [m]."""
        return root_mean_square(self.after)


def root_mean_square(errors: Sequence[Array]) -> float:
    """Compute the root mean square of distances in several arrays.

    Parameters
    ----------
    errors : arrays of any shape [m]; NaN is left out

    Returns
    -------
    root mean square [m], NaN where no distance is known
    """
    distances = np.concatenate([error.ravel() for error in errors]) if errors else np.zeros(0)
    if not np.isfinite(distances).any():
        return float("nan")
    return float(np.sqrt(np.nanmean(distances**2)))
