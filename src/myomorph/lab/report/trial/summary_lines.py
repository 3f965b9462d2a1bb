"""What a command prints of its result: the numbers that the field judges by.

They come with unit, place, time and verdict.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import few
from myomorph.core.model.model import Model
from myomorph.core.model.paths import impossible_fibers
from myomorph.core.model.series import Markers, Motion, Series, Wrenches
from myomorph.core.motion.ik import KinematicsFit
from myomorph.lab.analysis.center_of_mass import centroid
from myomorph.lab.report.trial import tables

if TYPE_CHECKING:
    from myomorph.body.calibrate.calibration import Calibration
    from myomorph.core.tension.tension import Tension

# Share of a coordinate's torque that its muscles give at most where it has none that counts.
ALONE = 1e-3


def kinematics_line(fit: KinematicsFit, model: Model, markers: Markers | None) -> str:
    """Write the frames, markers that matched, and errors with marker and time.

    It says whether the errors are within the usual limits. The markers show the size of the body.

    Source: Hicks et al. 2015 (root mean square under 2 cm, largest under 2 to 4 cm).
    """
    matched = f"{len(fit.marker_names)} of the model's {len(model.markers)} markers"
    if len(fit.marker_names) == len(model.markers):
        matched = f"all {len(model.markers)} markers of the model"
    unused = f" ({len(fit.unused_markers)} recorded ones unused)" if fit.unused_markers else ""
    if fit.sensor_names and not fit.marker_names:
        matched = f"{len(fit.sensor_names)} inertial sensors"
        unused = ""
    text = f"{len(fit.motion)} frames, {matched}{unused}"
    sensed = _sensors_text(fit)
    if not np.isfinite(fit.marker_error).any():
        return f"{text}: {sensed or 'no frame shows a marker'}"
    worst, largest, lost, *_ = tables.marker_verdicts(fit, tables.body_scale(markers))
    within = "within" if worst.state == largest.state == "ok" else "over"
    sensors = f"; {sensed}" if sensed else ""
    unconverged = f"; {lost.value:.0f} frames did not converge" if lost.value else ""
    closed = (
        ""
        if fit.loop_closure_error is None
        else f"; loops closed to {float(np.nanmax(fit.loop_closure_error)):.1g} m"
    )
    return (
        f"{text}: root mean square {100 * float(np.nanmean(fit.rms)):.2f} cm (worst frame"
        f" {worst.value:.2f} cm at "
        f"{worst.time:.2f} s), largest {largest.value:.2f} cm ({largest.worst} at"
        f" {largest.time:.2f} s): {within} "
        f"{worst.limit:.3g} and {largest.limit:.3g} cm (Hicks et al."
        f" 2015){sensors}{unconverged}{closed}"
    )


def _sensors_text(fit: KinematicsFit) -> str:
    """How well the sensors are explained; "" without any."""
    errors = np.degrees(fit.sensor_error)
    if not np.isfinite(errors).any():
        return ""
    rms = np.sqrt(np.nanmean(errors**2, axis=0))
    worst = int(np.nanargmax(rms))
    mean = float(np.sqrt(np.nanmean(errors**2)))
    worst_name = fit.sensor_names[worst]
    return (
        f"{len(rms)} sensors explained to {mean:.1f}° RMS ({worst_name} worst, {rms[worst]:.1f}°)"
    )


def dynamics_line(model: Model, motion: Motion, torques: Series, wrenches: Wrenches | None) -> str:
    """Write the residuals of the root as a share of body weight, against their limits.

    The limits come from the external force. The line is "" without a free root.

    Source: Hicks et al. 2015 (force under 5 % of the peak external force, moment under 1 % of that
    times the height of the center of mass).
    """
    root = tables.residuals(model, torques)
    if root is None or not np.isfinite(root[0]).any() or model.weight <= 0.0:
        return ""
    parts = []
    for what, values, unit in (("force", root[0], "N"), ("moment", root[1], "N m")):
        at = int(np.nanargmax(values))
        share = (
            "" if unit == "N m" else f", {plain(100 * values[at] / model.weight)} % of body weight"
        )
        rms = float(np.sqrt(np.nanmean(values**2)))
        parts.append(
            f"{what} {plain(values[at])} {unit}{share} at {torques.time[at]:.2f} s (RMS"
            f" {plain(rms)} {unit})"
        )
    text = f"largest residual {parts[0]}, {parts[1]}"
    if wrenches is None or not len(wrenches.names):
        return f"{text}: without external forces they support the body"
    verdict = residual_verdict(model, motion, torques, wrenches)
    return f"{text}: {verdict}" if verdict else text


def residual_verdict(model: Model, motion: Motion, torques: Series, wrenches: Wrenches) -> str:
    """Write the largest residuals of the root against limits by the external force.

    The line is "" without a free root or external force.

    Source: that of `dynamics_line`.
    """
    root = tables.residuals(model, torques)
    if root is None or not np.isfinite(root[0]).any():
        return ""
    net = np.linalg.norm(np.nan_to_num(wrenches.forces).sum(axis=1), axis=1)
    height = float(np.nanmean(centroid(model, motion).values @ model.up)) - tables.loaded_height(
        wrenches, model.up
    )
    peak = float(net.max(initial=0.0))
    if peak <= 0.0 or not height > 0.0:
        return ""
    force_component, moment_component = root
    force = float(np.nanmax(force_component))
    moment = float(np.nanmax(moment_component))
    shares = f"{plain(100 * force / peak)} and {plain(100 * moment / (peak * height))} %"
    within = (
        force <= tables.RESIDUAL_FORCE * peak and moment <= tables.RESIDUAL_MOMENT * peak * height
    )
    limits = f"{100 * tables.RESIDUAL_FORCE:g} and {100 * tables.RESIDUAL_MOMENT:g} %"
    judged = "within" if within else "over"
    return (
        f"{shares} of the peak external force (times height), {judged} the limits of {limits}"
        " (Hicks et al. 2015)"
    )


def tension_line(model: Model, tension: Tension) -> str:
    """Optimal frames, and the largest reserve with its unit, time and share of the torque."""
    from myomorph.core.tension.dual import MISSING

    optimal = int(tension.optimal.sum())
    count = (
        "all frames optimal"
        if optimal == len(tension)
        else f"{optimal} of {len(tension)} frames optimal"
    )
    text = f"{len(tension)} frames, {len(tension.muscles)} muscles, {count}"
    missing = int((tension.status == MISSING).sum())
    unknown = tension.undetermined
    text += f", {missing} without input" if missing else ""
    if unknown.any():
        share = 100.0 * float(unknown.sum()) / (unknown.shape[1] * (len(tension) - missing))
        text += (
            f", {share:.0f} % of the tensions not determined (no plate measures the load of their"
            " limb alone)"
        )
    text += _saturated(model, tension)
    if tension.actuator_force.size:
        text += _reserves(model, tension)
    if tension.contacts is not None:
        together = np.linalg.norm(tension.contacts.contact_force.sum(axis=1), axis=1)
        peak = float(together[np.isfinite(together)].max(initial=0.0))
        groups = len({site.group for site in tension.contacts.sites})
        text += f"; {groups} contacts carry up to {peak:.4g} N together"
    if tension.pushing:
        some = ", ".join(tension.pushing[:3]) + (" ..." if len(tension.pushing) > 3 else "")
        text += (
            f"; {len(tension.pushing)} muscles push somewhere, shortening against their viscosity"
            f" ({some})"
        )
    return text


def _saturated(model: Model, tension: Tension) -> str:
    """Muscles that reach their largest activation, the one that does so longest; "" for none."""
    most = tables.largest_activations(model, tension.muscles)
    full = tables.saturated_frames(tension.activation, most)
    count = int(full.any(axis=0).sum())
    if not count:
        return ""
    worst = int(np.argmax(full.sum(axis=0)))
    share = plain(100.0 * float(full[:, worst].mean()))
    noun = "muscle" if count == 1 else "muscles"
    return f"; {count} {noun} saturated ({tension.muscles[worst]} in {share} % of the frames)"


def _reserves(model: Model, tension: Tension) -> str:
    """Name the reserve that is the largest share of its coordinate's torque.

    The largest that holds the root follows.
    """
    torques = Series(tension.time, tension.coordinates, tension.balanced_torque)
    names = [reserve_coordinate(model, name) for name in tension.reserve_names]
    alone = _without_muscles(torques, names, tension)
    driven = [name for name in tension.coordinates if name not in alone]
    worst = tables.worst_reserve(model, torques, names, tension.actuator_force, driven)
    text = "" if worst is None else _largest_reserve(model, tension, worst)
    for unit in ("N", "N m"):
        largest = _largest_residual(model, tension, names, unit)
        if largest:
            text += (", " if text.endswith(" s)") else "; largest residual ") + largest
    if alone:
        name = max(alone, key=lambda coordinate: float(np.nanmax(np.abs(torques[coordinate]))))
        peak = float(np.nanmax(np.abs(torques[name])))
        largest = f"{name} up to {plain(peak)} {reserve_unit(model, name)}"
        text += (
            f"; {len(alone)} coordinates without muscles are carried by reserves alone ({largest})"
        )
    return text


def _largest_reserve(model: Model, tension: Tension, worst: tables.WorstReserve) -> str:
    """Write the worst reserve with its verdict."""
    value = abs(float(tension.actuator_force[worst.frame, worst.column]))
    at = float(tension.time[worst.frame])
    unit = reserve_unit(model, worst.coordinate)
    verdict = "within" if worst.share <= tables.RESERVE else "over"
    whose = "its peak torque"
    if not worst.own:
        whose = f"{plain(worst.scale)} {unit} (its own torque is negligible)"
    text = f"; largest reserve {plain(value)} {unit} ({worst.coordinate} at {at:.2f} s), "
    return text + f"{plain(100 * worst.share)} % of {whose}: {verdict} {100 * tables.RESERVE:g} %"


def _largest_residual(model: Model, tension: Tension, names: Sequence[str], unit: str) -> str:
    """Write the largest actuator in a unit that holds the root; "" where there is none."""
    columns = [
        i
        for i, name in enumerate(tension.reserve_names)
        if _residual_unit(model, name, names[i]) == unit
    ]
    values = np.abs(tension.actuator_force[:, columns])
    if not columns or not np.isfinite(values).any():
        return ""
    frame, column = np.unravel_index(int(np.nanargmax(values)), values.shape)
    name = tension.reserve_names[columns[column]]
    return f"{plain(values[frame, column])} {unit} ({name} at {tension.time[frame]:.2f} s)"


def _without_muscles(torques: Series, names: list[str], tension: Tension) -> list[str]:
    """Find coordinates of joints whose torque is that of their reserve throughout.

    No muscle drives them.
    """
    result = []
    for i, name in enumerate(names):
        if name in torques.names and np.isfinite(torques[name]).any():
            peak = float(np.nanmax(np.abs(torques[name])))
            if (
                float(np.nanmax(np.abs(torques[name] - tension.actuator_force[:, i])))
                <= ALONE * peak
            ):
                result.append(name)
    return result


def reserve_coordinate(model: Model, name: str) -> str:
    """Return the coordinate that a reserve drives, "" where it drives none."""
    if name in model.coordinate_names:
        return name
    coordinate = next(
        (actuator.coordinate for actuator in model.actuators if actuator.name == name), ""
    )
    short = name.removesuffix("_reserve").removeprefix("reserve_")
    return coordinate or (short if short in model.coordinate_names else "")


def reserve_unit(model: Model, coordinate: str) -> str:
    """N m of a rotation, N of a translation."""
    return "N" if coordinate and model.coordinate(coordinate).motion == "translational" else "N m"


def _residual_unit(model: Model, name: str, coordinate: str) -> str:
    """Return the unit of a residual, "" of a reserve of a joint."""
    if coordinate or not name.startswith("residual_"):
        return ""
    return "N" if "_F" in name.removeprefix("residual") else "N m"


def calibration_line(calibration: Calibration) -> str:
    """Frames, markers, errors before and after, size, and whether the search ended."""
    # Rooms of other steps are imported where their line is written.
    from myomorph.body.calibrate.calibration import SOURCES

    count = sum(len(frame) for frame in calibration.frames)
    names = calibration.marker_names
    after = np.concatenate([errors.reshape(-1, len(names)) for errors in calibration.after])
    with np.errstate(invalid="ignore"):
        each = np.sqrt(
            np.nanmean(np.where(np.isfinite(after).any(axis=0), after, 0.0) ** 2, axis=0)
        )
    worst = int(np.nanargmax(each))
    status = "converged" if calibration.converged else "NOT converged"
    ended = f"{status} after {calibration.steps} steps"
    ended += f" (last change {calibration.last_change:.1g})"
    fixed = Counter(angle.source for angle in calibration.zero_angles)
    counts = ", ".join(f"{name} {fixed[name]}" for name in SOURCES if fixed[name])
    zeros = f"; zero angles by {counts}" if fixed else ""
    limit = "within" if calibration.rms_after <= tables.MARKER_RMS else "over"
    return (
        f"{count} frames, {len(names)} markers: root mean square {1e3 * calibration.rms_before:.1f}"
        f" -> {1e3 * calibration.rms_after:.1f} mm ({limit} {1e3 * tables.MARKER_RMS:g} mm), worst"
        f" marker {names[worst]} {1e3 * each[worst]:.1f} mm; size {calibration.size:.3f};"
        f" {ended}{zeros}"
    )


def plain(value: float) -> str:
    """Write a number of three digits, or whole if it has more, without exponent.

    So it reads 0.264, 15.5 or 1012.
    """
    return f"{value:.0f}" if abs(value) >= 99.95 else f"{value:.3g}"


# Lengths over the optimal one between which fibers pull actively (Zajac 1989).
FIBER_RANGE = (0.5, 1.5)
MAX_NAMED = 3


def muscles_line(model: Model, time: Array, lengths: Array, velocities: Array) -> str:
    """Write the frames, muscles, range of fibers, fastest shortening, and jumps of paths.

    The shortest and longest fibers are named with muscle and time. Fibers are those on a tendon at
    its slack length.

    Source: Zajac 1989 (active force between 0.5 and 1.5 optimal fiber lengths).

    Parameters
    ----------
    model : with the muscles
    time : (frames,) [s]
    lengths : (frames, muscles) of muscle-tendon units [m], NaN where not known
    velocities : (frames, muscles) [m/s]

    Returns
    -------
    The line
    """
    text = f"{len(time)} frames, {len(model.muscles)} muscles"
    known = np.isfinite(lengths).all(axis=1)
    no_fibers = set(impossible_fibers(model.muscles))
    optimal = np.array(
        [
            0.0 if muscle.name in no_fibers else muscle.optimal_fiber_length
            for muscle in model.muscles
        ]
    )
    slack = np.array([muscle.tendon_slack_length for muscle in model.muscles])
    sine = np.sin([muscle.pennation_at_optimal for muscle in model.muscles])
    fibers = np.hypot(
        np.maximum(lengths - slack, 0.0) / np.where(optimal > 0.0, optimal, np.nan), sine
    )
    if not known.any() or not np.isfinite(fibers).any():
        return text
    if no_fibers:
        text += f", {len(no_fibers)} of them without a length of fibers"
    parts = (
        _range(model, time, fibers),
        _fastest(model, time, velocities),
        _jumps(model, time, lengths, velocities),
    )
    return f"{text}: {'; '.join(parts)}"


def _range(model: Model, time: Array, fibers: Array) -> str:
    """Name the shortest and the longest fibers, and which leave the range of active force."""
    names = model.muscle_names
    ends = []
    for at in (np.nanargmin(fibers), np.nanargmax(fibers)):
        frame, muscle = np.unravel_index(int(at), fibers.shape)
        ends.append(f"{fibers[frame, muscle]:.2f} ({names[muscle]} at {time[frame]:.2f} s)")
    low, high = FIBER_RANGE
    with np.errstate(invalid="ignore"):
        out = np.any((fibers < low) | (fibers > high), axis=0)
    verdict = f"within {low:g} to {high:g} (Zajac 1989)"
    if out.any():
        verdict = (
            f"{few(itertools.compress(names, out), MAX_NAMED)} outside {low:g} to {high:g} (Zajac"
            " 1989)"
        )
    return f"fibers {ends[0]} to {ends[1]} optimal lengths, tendons at slack length: {verdict}"


def _fastest(model: Model, time: Array, velocities: Array) -> str:
    """Name the greatest shortening velocity as a share of what the muscle can do at all."""
    limit = np.array(
        [muscle.optimal_fiber_length * muscle.max_contraction_velocity for muscle in model.muscles]
    )
    shares = -velocities / np.where(limit > 0.0, limit, np.nan)
    if not np.isfinite(shares).any():
        return "no velocities"
    frame, column = np.unravel_index(int(np.nanargmax(shares)), shares.shape)
    share = float(shares[frame, column])
    with np.errstate(invalid="ignore"):
        over = np.any(shares >= 1.0, axis=0)
    fast = few(itertools.compress(model.muscle_names, over), MAX_NAMED)
    verdict = f"{fast} too fast to pull" if over.any() else "below it"
    where = f"{model.muscle_names[column]} at {time[frame]:.2f} s"
    return (
        f"fastest shortening {plain(100 * share)} % of the greatest velocity ({where}): {verdict}"
    )


def _jumps(model: Model, time: Array, lengths: Array, velocities: Array) -> str:
    """Name paths whose length changes between two frames by what no velocity explains.

    A path does so where it leaves a surface.
    """
    from myomorph.core.muscles.path_jumps import path_jumps

    if len(time) < 3:
        return "too few frames to find jumps"
    jumps = path_jumps(time, lengths, velocities)
    if not jumps.any():
        return "no path jumps"
    frame, muscle = np.unravel_index(int(np.argmax(jumps)), jumps.shape)
    where = (
        f"{model.muscle_names[muscle]} by {1e3 * jumps[frame, muscle]:.1f} mm at"
        f" {time[frame + 1]:.2f} s"
    )
    count = int(jumps.any(axis=0).sum())
    some = "1 path jumps" if count == 1 else f"{count} paths jump"
    return f"{some} ({where}): moment arms there are unreliable"
