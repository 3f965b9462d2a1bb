"""Options of `refine`."""

from __future__ import annotations

from dataclasses import dataclass

from myomorph.body.identify.soft_tissue import Use
from myomorph.core.model.errors import BadData

LENGTHS = "lengths"
MARKERS = "markers"
MASSES = "masses"
CLOCK = "clock"
MOTIONS = "motions"
"""Names in `fit`. Motions are always estimated, so that their name alone means nothing else."""

POSITIVE = (
    "cutoff",
    "marker_time",
    "force_noise",
    "moment_noise",
    "length_sd",
    "mass_sd",
    "iterations",
)


@dataclass(frozen=True)
class RefineOptions:
    """Options of `refine`: what is estimated, and how much each part of the problem is believed.

    Attributes
    ----------
    fit : unknowns that are estimated together with the motions: "lengths", "markers" (their
        positions), "masses" (with mass centers and inertias), "clock" (of the forces relative to
        the markers); others keep their given values, and "motions" estimates the motions alone
    cutoff : cutoff frequency of the low-pass filter of the forces [Hz]; the motion has four knots
        per period of it
    marker_noise : standard deviation of a marker's position on a rigid body along one axis, mostly
        movement of the skin [m]; by default 0.01 on a body of human size, on a smaller one in
        proportion
    marker_time : correlation time of the skin's movement [s]
    force_noise : standard deviation of each component of the residual force [body weights]
    moment_noise : standard deviation of each component of the residual moment [body weights times 1
        m]
    length_sd : relative standard deviation of a length from the model's
    marker_sd : standard deviation of a marker's position from that on the model [m]; by default
        0.015 on a body of human size, on a smaller one in proportion
    mass_sd : relative standard deviation of a link's mass from that which `identify` finds in the
        same recordings
    shared_clock : estimate one clock offset for all recordings instead of one for each
    soft_tissue : model the motion of markers relative to the body's mass; "auto": if that predicts
        held-out parts of the recordings better (with `check`); "always" or "never"
    iterations : maximum number of iterations
    check : predict every recording, or the parts of a single one, from the others, and keep the
        given body and masses if they predict better
    """

    fit: tuple[str, ...] = (LENGTHS, MARKERS, MASSES)
    cutoff: float = 6.0
    marker_noise: float | None = None
    marker_time: float = 0.1
    force_noise: float = 0.005
    moment_noise: float = 0.005
    length_sd: float = 0.1
    marker_sd: float | None = None
    mass_sd: float = 0.2
    shared_clock: bool = False
    soft_tissue: Use = "auto"
    iterations: int = 20
    check: bool = True

    def __post_init__(self) -> None:
        for name in POSITIVE:
            if not getattr(self, name) > 0:
                raise BadData(
                    f"refine: {name} is {getattr(self, name):g}; expected a number above 0"
                )
        if self.soft_tissue not in ("auto", "always", "never"):
            raise BadData(
                f"soft_tissue is '{self.soft_tissue}': expected 'auto', 'always' or 'never'"
            )
        for name in ("marker_noise", "marker_sd"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise BadData(f"refine: {name} is {value:g}; expected metres above 0")

    @property
    def fits_body(self) -> bool:
        """Whether lengths or marker positions change."""
        return LENGTHS in self.fit or MARKERS in self.fit

    @property
    def fits_masses(self) -> bool:
        """Whether masses, mass centers and inertias change."""
        return MASSES in self.fit

    @property
    def fits_clock(self) -> bool:
        """Whether the clock of the forces is estimated."""
        return CLOCK in self.fit
