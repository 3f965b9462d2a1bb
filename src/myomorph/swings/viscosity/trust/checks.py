"""What can be wrong with a swing experiment, named in a line each.

A line says what was given, what it spoils, and what to do.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import CLOCKS
from myomorph.core.model.findings import Finding
from myomorph.swings.causes import LIMB, PLATE, SWINGS, TRACKING
from myomorph.swings.viscosity.identification.budget import disturbed, thinned
from myomorph.swings.viscosity.identification.excitation import LEAN, MAX_NOISE, Excitation
from myomorph.swings.viscosity.identification.identify import (
    MAX_RELATIVE_WIDTH,
    Condition,
    is_narrow,
)
from myomorph.swings.viscosity.identification.inertia import (
    InertiaOptions,
    limb_inertia,
)
from myomorph.swings.viscosity.identification.instruments import Instruments
from myomorph.swings.viscosity.swings.parameter_scale import parameter_scale
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.swings.sums import SwingSums, swing_sums
from myomorph.swings.viscosity.tracking.tracked import TrackedSpecimen
from myomorph.swings.viscosity.trust.forward import hinge_axis, sense

TARED = "tare"
TOO_SMALL = "small swing"
LOADED = "base load"
"""Kinds of findings: the mass and its center cannot be known; the condition has no viscosity; what
the base carries.
"""
MOVING_BASE = "moving base"
LOOSE_WIRE = "loose wire"
SLIPPED = "slipped cluster"
"""Kinds of findings: what should stand still and moves."""

SPARE = 0.9  # A mass below this share of the least that the motion allows cannot be the limb's.
RESTS = (
    "something rests on the base, or the plate's zero is off; weigh it and give base_mass, or a"
    " tare recording with the base and without the limb"
)
UNLIKELY = 60.0
"""Squared distance of two normal numbers from zero, over their standard deviations, that
instruments half as good as assumed pass once in 1,000 times.
"""
# Share of the limb's own moment by which a constant moment is off for other reasons than
# instruments.
ROUNDED = 5e-4
# A constant moment above this share of the limb's own, m g c, is not the noise of a plate.
OFF = 0.05
UPRIGHT = 1e-3  # Sine to the vertical below which a hinge stands upright.
# How much larger than that of free parameters the residual of a possible limb's wrench may be.
MISFIT = 1.5
LOST = 0.5  # Share of a trial's frames without a pose from which the trial is questioned.
# A drift that shifts force against motion by more over a trial would be seen in the viscosity [s].
DRIFT = 5e-3


@read_only
class PlateZero:
    """What the constant part of the wrench says against what the moving part says.

    Attributes
    ----------
    mass : what the constant force amounts to [kg]
    least_mass : |h|^2 / I, below which no body has first moment h and inertia I about the joint
        [kg]
    moment : (3,) constant one about the joint that no limb explains; without what the mass center
        of a hinge's limb can make of it by lying elsewhere along the axis [N m]
    own_moment : |h| g, the limb's at a right angle to gravity [N m]
    oscillation : I / |h|, the distance from the joint beyond which no mass center lies [m]
    """

    mass: float
    least_mass: float
    moment: Array
    own_moment: float
    oscillation: float


def plate_zero(recordings: Sequence[SwingRecording], sums: SwingSums | None = None) -> PlateZero:
    """Identify first moment and inertia from what changes, then see what is left of the wrench.

    On a fixed base the mass shows only as the constant force m g, which a zero set with the limb on
    the plate takes away; the first moment h = m c and the inertia I show in what changes. Since I
    >= m c^2 for every body, m >= |h|^2 / I, and c <= I / |h|, the distance of the center of
    oscillation.

    Parameters
    ----------
    recordings : of one condition
    sums : of these; made by default
    """
    sums = swing_sums(recordings) if sums is None else sums
    limb = limb_inertia(sums, None, InertiaOptions(tare="unknown"))
    parameters = limb.parameters.copy()
    parameters[0] = 0.0
    parts = [(recordings[i], use) for i, use in zip(sums.trial, sums.uses, strict=True)]
    left = np.concatenate(
        [each.wrench[use] - each.wrench_rows[use] @ parameters for each, use in parts]
    ).mean(axis=0)
    gravity = recordings[0].gravity
    h = limb.first_moment
    g = float(np.linalg.norm(gravity))
    mass = -sense(recordings[0]) * float(left[3:] @ gravity) / g**2
    least = limb.least_mass
    across = _across_hinge(recordings[0])
    moment = left[:3] - across * float(across @ left[:3])
    return PlateZero(
        mass=mass, least_mass=least, moment=moment, own_moment=h * g, oscillation=h / least
    )


def _across_hinge(recording: SwingRecording) -> Array:
    """Find the direction of the moment of a weight that lies along a hinge's axis.

    Returns
    -------
    (3,) a unit vector in ground, level and across the axis; zeros for a ball, and for a hinge that
    stands upright
    """
    axis = hinge_axis(recording)
    turned = recording.rotations[recording.used][0] @ axis
    across = np.cross(turned, recording.gravity)
    size = float(np.linalg.norm(across))
    return across / size if size > UPRIGHT * np.linalg.norm(recording.gravity) else np.zeros(3)


def recording_findings(recordings: Sequence[SwingRecording]) -> tuple[Finding, ...]:
    """Find faults that recordings of one condition show before anything is identified."""
    sums = swing_sums(recordings)
    findings = []
    if len(sums) < 3:
        text = (
            f"only {len(sums)} of the three whole swings that intervals need: record more releases,"
            " or longer ones"
        )
        findings.append(Finding("few swings", "swings", SWINGS.message(text)))
    zero = plate_zero(recordings, sums)
    if zero.mass < SPARE * zero.least_mass:
        text = (
            f"the constant force says {zero.mass:.2f} kg, but the motion allows no limb below"
            f" {zero.least_mass:.2f} kg (its mass center would lie beyond the center of oscillation"
            f" at {zero.oscillation:.2f} m): the plate was set to zero with the limb on it, so the"
            " mass is not identifiable; set zero with the fixture alone, or give that as tare"
        )
        findings.append(Finding(TARED, "plate", PLATE.message(text)))
    elif float(np.linalg.norm(zero.moment)) > OFF * zero.own_moment:
        most = f"{zero.own_moment:.2f} N m at most"
        text = (
            f"a constant moment of {np.linalg.norm(zero.moment):.2f} N m is not the limb's"
            f" ({most}): {RESTS}"
        )
        findings.append(Finding("zero", "plate", PLATE.message(text)))
    return tuple(findings)


def base_findings(
    recordings: Sequence[SwingRecording], instruments: Instruments
) -> tuple[Finding, ...]:
    """Find a load of the base: a constant level moment that instruments do not explain.

    Parameters
    ----------
    recordings : of one condition
    instruments : errors, and what is not known of them
    """
    thin = [thinned(recording) for recording in recordings]
    zero = plate_zero(thin)
    errors = zip(instruments.sources, instruments.prior, strict=True)
    changes = [
        (plate_zero([disturbed(r, *source, size) for r in thin]).moment - zero.moment) / size
        for source, size in errors
        if size > 0.0
    ]
    covariance = (ROUNDED * zero.own_moment) ** 2 * np.eye(3)
    if changes:
        covariance = covariance + np.array(changes).T @ instruments.covariance @ np.array(changes)
    # What no limb makes is level and, of a hinge, along its axis.
    made = np.stack([recordings[0].gravity, _across_hinge(recordings[0])])
    made = made[np.linalg.norm(made, axis=1) > 0.0]
    level = np.linalg.svd(made)[2][len(made) :]
    moment = level @ zero.moment
    if moment @ np.linalg.solve(level @ covariance @ level.T, moment) < UNLIKELY:
        return ()
    more = "is not the limb's, and more than errors of the instruments explain"
    text = f"a constant moment of {np.linalg.norm(moment):.2f} N m about the joint {more}: {RESTS}"
    return (Finding(LOADED, "base", PLATE.message(text)),)


def condition_findings(condition: Condition) -> tuple[Finding, ...]:
    """Find faults that show in what was identified.

    These are a swing too small, or not about an axis, and a limb that cannot be. An axis is excited
    where its rates are at least `LEAN` of the fastest axis', with a share of noise in their squares
    of at most `MAX_NOISE`, and its viscosity has an interval narrower than plus or minus
    `MAX_RELATIVE_WIDTH` of the one value.
    """
    viscosity = condition.viscosity
    excitation = Excitation.of(condition.recordings)
    size = excitation.rates
    wide = not is_narrow(viscosity)
    if wide and "viscosity" in condition.by_trial:
        ends = f"{viscosity.low:.2g} to {viscosity.high:.2g} N m s/rad"
        text = (
            f"one viscosity does not describe the trials: {ends}; those of single axes and muscles"
            " stand beside"
        )
        return (Finding("trials", "swings", SWINGS.message(text)), *_misfit(condition))
    if wide:
        ends = (
            f"{viscosity.low:.2g} to {viscosity.high:.2g} N m s/rad at rates of"
            f" {np.linalg.norm(size):.2f} rad/s"
        )
        text = (
            f"the swings are too small to determine the viscosity: {ends}; release it from farther"
            " out,"
            " or more often"
        )
        return (Finding(TOO_SMALL, "swings", SWINGS.message(text)),)
    findings = [
        _axis_finding(excitation, number, axis)
        for number, axis in enumerate(condition.recordings[0].axes)
        if not (condition.excited[number] and excitation.shown[number])
    ]
    return (*findings, *_misfit(condition))


def _axis_finding(excitation: Excitation, number: int, axis: str) -> Finding:
    """Say why an axis is not excited."""
    noise = float(excitation.noise_share[number])
    if excitation.leans[number]:
        why = f"below {100 * LEAN:.0f} % of the fastest axis'"
    elif noise > MAX_NOISE:
        why = f"of whose squares {100 * noise:.0f} % is noise"
    else:
        limit = f"+-{100 * MAX_RELATIVE_WIDTH:.0f} % of the joint's"
        why = f"which leave an interval wider than {limit}"
    text = (
        f"axis '{axis}' is not excited, its viscosity not identifiable: rates of"
        f" {excitation.rates[number]:.3g} rad/s (root mean square), {why}; spin the limb about that"
        " axis as it is released (merely turned and released it hardly rotates)"
    )
    return Finding("axis", axis, SWINGS.message(text))


def _misfit(condition: Condition) -> tuple[Finding, ...]:
    """Find whether the limb explains the wrench nearly as well as any ten numbers could."""
    rows = np.concatenate(
        [recording.wrench_rows[recording.used] for recording in condition.recordings]
    )
    wrench = np.concatenate(
        [recording.wrench[recording.used] for recording in condition.recordings]
    )
    rows = rows - rows.mean(axis=0)
    wrench = wrench - wrench.mean(axis=0)
    left = wrench - rows @ condition.parameters
    scale = np.repeat(
        [np.sqrt(np.square(left[:, part]).mean()) for part in (slice(3), slice(3, 6))], 3
    )
    A = (rows / scale[:, None]).reshape(-1, rows.shape[2])
    b = (wrench / scale).ravel()
    size = parameter_scale(np.linalg.norm(A, axis=0))
    free = b - A @ (np.linalg.lstsq(A / size, b, rcond=1e-9)[0] / size)
    ratio = float(
        np.linalg.norm(left / scale) / max(np.linalg.norm(free), 1e-9 * np.linalg.norm(b))
    )
    if ratio < MISFIT:
        return ()
    text = (
        f"the identified limb leaves {ratio:.1f} times as much of the wrench as free numbers would:"
        " its inertia "
    )
    text += (
        "cannot be trusted, nor the viscosity; swing it about every axis, and check the joint's"
        " center"
    )
    return (Finding("misfit", "limb", LIMB.message(text)),)


def tracking_findings(tracked: TrackedSpecimen) -> tuple[Finding, ...]:
    """Find faults that the markers, the plate's clock and the held joints show."""
    findings = []
    for slip in tracked.slips:
        if slip.cluster:
            kind = SLIPPED
        else:
            kind = MOVING_BASE if slip.what == "base" else LOOSE_WIRE
        findings.append(Finding(kind, slip.what, TRACKING.message(slip.line)))
    for trial in tracked.trials:
        lost = float(np.mean(~np.isfinite(trial.motion.values).all(axis=1)))
        if lost > LOST:
            text = f"{100 * lost:.0f} % of its frames show too few markers: label them, or drop it"
            findings.append(
                Finding(
                    "lost frames", trial.name, TRACKING.message(f"trial '{trial.name}': {text}")
                )
            )
        shift = abs(trial.clock.drift) * trial.clock.length
        if shift > max(DRIFT, 3.0 * trial.clock.drift_sd * trial.clock.length):
            drift = (
                f"{1e6 * trial.clock.drift:.0f} parts per million, {1e3 * shift:.1f} ms over the"
                " trial"
            )
            text = (
                f"trial '{trial.name}': the plate's clock drifts by {drift}: corrected; a common"
                " clock is better"
            )
            findings.append(Finding("clock", trial.name, CLOCKS.message(text)))
    return tuple(findings)
