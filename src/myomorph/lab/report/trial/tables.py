"""Verdicts: what was out of range against the community's limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.fit.unknowns import Bools
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import few
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion, Series, Wrenches
from myomorph.core.motion.ik import KinematicsFit
from myomorph.lab.analysis.selection import root_coordinates
from myomorph.lab.report.page.parts import Quantity, Verdict

MARKER_RMS = 0.02
MARKER_LARGEST = 0.04
RESIDUAL_FORCE = 0.05
RESIDUAL_MOMENT = 0.01
RESERVE = 0.10
# A joint's torque below this share of the largest joint torque is no measure for its reserve.
NEGLIGIBLE = 0.05
LOOPS_CLOSED = 1e-9
SATURATED = 0.99
HICKS = "hicks2015"
CHECKLIST = "opensim"


def body_scale(markers: Markers | None) -> float:
    """Return 1 for bodies of human size, else the extent of their markers beside an adult's.

    An adult's extent is 1.7 m. The limits on marker errors were made for people: 2 cm is the length
    of a mouse's thigh.
    """
    if markers is None or not np.isfinite(markers.values).any():
        return 1.0
    frame = markers.values[int(np.argmax(np.isfinite(markers.values).all(axis=2).sum(axis=1)))]
    seen = frame[np.isfinite(frame).all(axis=1)]
    extent = float(np.linalg.norm(np.ptp(seen, axis=0))) if len(seen) else 1.7
    return extent / 1.7 if 1e-3 < extent < 0.4 else 1.0


def loaded_height(wrenches: Wrenches, up: Array) -> float:
    """Find the height at which loaded forces act, that of the ground.

    Parameters
    ----------
    wrenches : forces of the ground [N] and their points [m]
    up : (3,) unit vector against gravity

    Returns
    -------
    The height [m]; 0 where none is loaded
    """
    loaded = np.nan_to_num(wrenches.forces @ up)
    heights = wrenches.points @ up
    heights = heights[
        (loaded > 0.1 * max(float(loaded.max(initial=0.0)), 1e-12)) & np.isfinite(heights)
    ]
    return float(np.median(heights)) if heights.size else 0.0


def marker_verdicts(fit: KinematicsFit, scale: float = 1.0) -> list[Verdict]:
    """Judge marker errors: RMS of the worst frame under 2 cm, largest under 4 cm.

    Both limits are times `scale`.

    Source: Hicks et al. 2015.
    """
    if not np.isfinite(fit.marker_error).any():
        return []
    time = fit.motion.time
    rms = 100 * fit.rms
    frame = int(np.nanargmax(rms))
    when, who = np.unravel_index(int(np.nanargmax(fit.marker_error)), fit.marker_error.shape)
    detail = f"{100 * float(np.sqrt(np.nanmean(fit.marker_error**2))):.2f} cm over all frames"
    detail += (
        ""
        if scale == 1.0
        else f"; the limit of human size times {scale:.3f}, the size of this body"
    )
    values = float(rms[frame]), 100 * float(fit.marker_error[when, who])
    limits = 100 * MARKER_RMS * scale, 100 * MARKER_LARGEST * scale
    first = float(time[frame])
    at = float(time[when])
    rows = [
        Verdict(
            quantity=Quantity.MARKER_RMS,
            value=values[0],
            unit="cm",
            limit=limits[0],
            worst="all markers",
            time=first,
            source=HICKS,
            detail=detail,
        ),
        Verdict(
            quantity=Quantity.MARKER_LARGEST,
            value=values[1],
            unit="cm",
            limit=limits[1],
            worst=fit.marker_names[who],
            time=at,
            source=HICKS,
        ),
        counted_verdict(
            Quantity.NOT_CONVERGED, fit.seen & ~np.asarray(fit.converged, dtype=bool), time
        ),
    ]
    if fit.loop_closure_error is not None:
        frame = int(np.nanargmax(fit.loop_closure_error))
        opened = 1e3 * float(fit.loop_closure_error[frame])
        rows.append(
            Verdict(
                quantity=Quantity.LOOP_CLOSURE,
                value=opened,
                unit="mm",
                limit=1e3 * LOOPS_CLOSED,
                worst="",
                time=float(time[frame]),
            )
        )
    return rows


def counted_verdict(quantity: Quantity, flags: np.ndarray, time: Array) -> Verdict:
    """Count frames that are flagged, of which there should be none.

    Parameters
    ----------
    quantity : what the flags say
    flags : (frames,) whether a frame is flagged
    time : (frames,) [s]

    Returns
    -------
    The verdict, with the time of the first
    """
    first = float(time[int(np.argmax(flags))]) if flags.any() else None
    return Verdict(
        quantity=quantity, value=float(flags.sum()), unit=f"of {len(flags)}", limit=0.0, time=first
    )


def gap_verdicts(markers: Markers) -> list[Verdict]:
    """Markers that were hidden: reported, as no limit is agreed."""
    hidden: np.ndarray = np.asarray(~np.isfinite(markers.values).all(axis=2))
    share = hidden.mean(axis=0) if len(markers) else np.zeros(len(markers.names))
    worst = int(np.argmax(share)) if len(share) else 0
    if not len(share) or share[worst] == 0.0:
        return [Verdict(quantity=Quantity.MARKER_GAPS, value=0.0, unit="%", limit=None)]
    first = float(markers.time[int(np.argmax(hidden[:, worst]))])
    detail = f"{int((share > 0).sum())} of {len(share)} markers are hidden at some time"
    value = 100 * float(share[worst])
    return [
        Verdict(
            quantity=Quantity.MARKER_GAPS,
            value=value,
            unit="% of frames",
            limit=None,
            worst=markers.names[worst],
            time=first,
            source="",
            detail=detail,
        )
    ]


def residuals(model: Model, torques: Series) -> tuple[Array, Array] | None:
    """Compute the norms of the residual force and moment at the root.

    Parameters
    ----------
    model : with the root's coordinates
    torques : (frames, coordinates) [N m or N]

    Returns
    -------
    (frames,) force [N] and (frames,) moment [N m]; None without a free root
    """
    moving, turning = root_coordinates(model)
    columns = {name: i for i, name in enumerate(torques.names)}
    if not moving or any(name not in columns for name in moving + turning):
        return None
    force = np.linalg.norm(torques.values[:, [columns[name] for name in moving]], axis=1)
    moment = np.linalg.norm(torques.values[:, [columns[name] for name in turning]], axis=1)
    return force, moment


def residual_verdicts(
    model: Model, torques: Series, wrenches: Wrenches, height: float
) -> list[Verdict]:
    """Judge residuals against the peak net external force F.

    Forces are to be under 5 % of F, moments under 1 % of F times the mean height of the center of
    mass over the ground [m]; peak and RMS.

    Source: Hicks et al. 2015.
    """
    weight = model.weight
    root = residuals(model, torques)
    inside = (wrenches.time >= torques.time[0] - 1e-6) & (wrenches.time <= torques.time[-1] + 1e-6)
    net = np.linalg.norm(np.nan_to_num(wrenches.forces[inside]).sum(axis=1), axis=1)
    peak = float(net.max()) if net.size else 0.0
    if root is None or peak <= 0.0 or not np.isfinite(root[0]).any():
        return []
    rows = []
    for what, values, scale in (("force", root[0], peak), ("moment", root[1], peak * height)):
        for row, at in judged_residual(what, values, torques.time, scale):
            detail = f"; F = {peak:.4g} N, filtered as the torques are"
            if what == "force" and at is not None:
                detail += _support(wrenches, float(torques.time[at]), weight, values[at])
            rows.append(replace(row, detail=row.detail + detail))
    return rows


def judged_residual(
    what: str, values: Array, time: Array, scale: float, contacts: bool = False
) -> list[tuple[Verdict, int | None]]:
    """Judge peak and root mean square of a residual against its limit.

    Parameters
    ----------
    what : "force" or "moment"
    values : (frames,) norm of the residual [N] or [N m]
    time : (frames,) [s]
    scale : the peak external force [N], of moments times the height of the center of mass [N m]
    contacts : whether contacts carry what they can

    Returns
    -------
    Verdicts, each with the frame that it is of
    """
    force = what == "force"
    unit = "% of peak external force" if force else "% of COM height × peak external force"
    limit, size = (RESIDUAL_FORCE, "N") if force else (RESIDUAL_MOMENT, "N·m")
    peak = int(np.nanargmax(values))
    rows = []
    for name, value, at in (
        ("peak", values[peak], peak),
        ("RMS", np.sqrt(np.nanmean(values**2)), None),
    ):
        when = None if at is None else float(time[at])
        share = 100 * float(value) / scale
        quantity = Quantity.residual(what, name, contacts)
        row = Verdict(
            quantity=quantity,
            value=share,
            unit=unit,
            limit=100 * limit,
            worst="root joint",
            time=when,
            source=HICKS,
            detail=f"{float(value):.3g} {size}",
        )
        rows.append((row, at))
    return rows


def _support(wrenches: Wrenches, time: float, weight: float, residual: float) -> str:
    """Write a clause where the plates carry little of the body and residuals stand in for them."""
    near = int(np.argmin(np.abs(wrenches.time - time)))
    carried = float(np.linalg.norm(np.nan_to_num(wrenches.forces[near]).sum(axis=0)))
    if weight <= 0.0 or carried > 0.5 * weight or residual < 0.3 * weight:
        return ""
    advice = "was there a step beside the plates? Choose a time range that the plates cover"
    return f"; the measured forces carry {100 * carried / weight:.0f} % of the body then: {advice}"


@dataclass(frozen=True)
class WorstReserve:
    """The reserve that is the largest share of what it is held against."""

    # frame, column: where it is largest
    frame: int
    column: int
    coordinate: str  # that it drives
    share: float  # of `scale`
    peak: float  # largest torque of the coordinate [N m or N]
    # what it is held against: that peak, or a share of the largest one where that is negligible
    scale: float

    @property
    def own(self) -> bool:
        """Whether it is held against its own coordinate's torque."""
        return self.peak >= self.scale


def worst_reserve(
    model: Model, torques: Series, names: Sequence[str], reserves: Array, driven: Sequence[str] = ()
) -> WorstReserve | None:
    """Find the worst reserve of the joints, as a share of its coordinate's peak torque.

    A torque that is negligible beside the largest of its unit is no measure: twice nothing is
    nothing.

    Parameters
    ----------
    model : with the coordinates
    torques : (frames, coordinates) [N m or N]
    names : coordinates that the reserves drive
    reserves : (frames, reserves) [N m or N]
    driven : coordinates that some muscle moves; () for all

    Returns
    -------
    The reserve and its frame; None where there is none
    """
    peaks = _joint_peaks(model, torques)
    slides = {name: model.coordinate(name).motion == "translational" for name in peaks}
    floors = {
        kind: NEGLIGIBLE * max((peaks[name] for name in peaks if slides[name] is kind), default=0.0)
        for kind in (True, False)
    }
    judged = []
    for i, name in enumerate(names):
        unmoved = bool(driven) and name not in driven
        if name not in peaks or unmoved or not np.isfinite(reserves[:, i]).any():
            continue
        frame = int(np.nanargmax(np.abs(reserves[:, i])))
        scale = max(peaks[name], floors[slides[name]], 1e-12)
        judged.append(
            WorstReserve(
                frame=frame,
                column=i,
                coordinate=name,
                share=abs(float(reserves[frame, i])) / scale,
                peak=peaks[name],
                scale=scale,
            )
        )
    return max(judged, key=lambda reserve: reserve.share, default=None)


def _joint_peaks(model: Model, torques: Series) -> dict[str, float]:
    """Peak torques of the coordinates of joints, as far as they are known."""
    root = {name for group in root_coordinates(model) for name in group}
    known = [
        name for name in torques.names if name not in root and np.isfinite(torques[name]).any()
    ]
    return {name: float(np.nanmax(np.abs(torques[name]))) for name in known}


def reserve_verdicts(
    model: Model, torques: Series, reserves: Series, driven: Sequence[str] = ()
) -> list[Verdict]:
    """Judge reserve actuators: peak under 10 % of the peak torque of their coordinate.

    What no muscle moves has a row of its own. Source: OpenSim's checklist.

    Parameters
    ----------
    model : with the coordinates
    torques : (frames, coordinates) [N m or N]
    reserves : (frames, reserves) [N m or N], by the coordinates that they drive
    driven : coordinates that some muscle moves; () for all

    Returns
    -------
    Verdict on the worst reserve, and on coordinates that no muscle moves
    """
    names = reserves.names
    worst = worst_reserve(model, torques, names, reserves.values, driven)
    rows = []
    if worst is not None:
        value = abs(float(reserves.values[worst.frame, worst.column]))
        force = model.coordinate(worst.coordinate).motion == "translational"
        size = "N" if force else "N·m"
        detail = f"{value:.3g} {size} beside a peak of {worst.peak:.3g} {size}"
        unit = "% of the coordinate's peak torque"
        if not worst.own:
            unit = f"% of {worst.scale:.3g} {size}"
            detail += (
                f", which is negligible: compared with {100 * NEGLIGIBLE:g} % of the largest joint"
                " torque"
            )
        rows.append(
            Verdict(
                quantity=Quantity.RESERVES,
                value=100 * worst.share,
                unit=unit,
                limit=100 * RESERVE,
                worst=worst.coordinate,
                time=float(reserves.time[worst.frame]),
                source=CHECKLIST,
                detail=detail,
            )
        )
    root = {name for group in root_coordinates(model) for name in group}
    unmoved = [
        name for name in names if driven and name in torques.names and name not in (*root, *driven)
    ]
    undriven = list(dict.fromkeys(unmoved))
    if undriven:
        detail = "reserve actuators alone produce their torque"
        rows.append(
            Verdict(
                quantity=Quantity.UNDRIVEN,
                value=float(len(undriven)),
                unit="",
                limit=None,
                worst=few(undriven, 4),
                detail=detail,
            )
        )
    return rows


def saturated_frames(activations: Array, most: Array) -> Bools:
    """Mark activations that reach their muscle's largest one.

    Parameters
    ----------
    activations : (frames, muscles)
    most : (muscles,) largest activation of each

    Returns
    -------
    (frames, muscles)
    """
    return np.asarray(activations >= SATURATED * most)


def largest_activations(model: Model, muscles: Sequence[str]) -> Array:
    """Look up the largest activation of muscles, 1 of those that the model does not have.

    Parameters
    ----------
    model : with the muscles
    muscles : names

    Returns
    -------
    (muscles,) from 0 to 1
    """
    bounds = {muscle.name: muscle.max_activation for muscle in model.muscles}
    return np.array([bounds.get(name, 1.0) for name in muscles])


def saturation_verdicts(
    names: Sequence[str], activations: Array, most: Array, time: Array
) -> list[Verdict]:
    """Judge muscles at their largest activation.

    They are too weak for the torque, or the torque is too large.

    Parameters
    ----------
    names : of the muscles
    activations : (frames, muscles) from 0 to 1
    most : (muscles,) largest activations
    time : (frames,) [s]

    Returns
    -------
    The verdict, with the muscle that is saturated in most frames
    """
    full = saturated_frames(activations, most)
    ever = np.any(full, axis=0)
    if not ever.any():
        return [Verdict(quantity=Quantity.SATURATED, value=0.0, unit=f"of {len(names)}", limit=0.0)]
    worst = int(np.argmax(full.sum(axis=0)))
    first = float(time[int(np.argmax(full[:, worst]))])
    detail = f"{names[worst]} in {100 * float(full[:, worst].mean()):.1f} % of frames; all: "
    detail += few([name for name, saturated in zip(names, ever, strict=True) if saturated], 8)
    return [
        Verdict(
            quantity=Quantity.SATURATED,
            value=float(ever.sum()),
            unit=f"of {len(names)}",
            limit=0.0,
            worst=names[worst],
            time=first,
            source="",
            detail=detail,
        )
    ]


def stretch_verdict(
    names: Sequence[str], count: int, passive: Sequence[tuple[str, float, float]] = ()
) -> Verdict:
    """Judge muscles whose passive force is above the maximum isometric force.

    Their fiber and tendon lengths do not fit the body's size or pose. `passive` has muscles, shares
    of the maximum isometric force and times [s].
    """
    detail = f"passive force over the maximum isometric force: {few(names, 8)}" if names else ""
    if passive:
        shares = few(
            [f"{name} {100.0 * share:.0f} % at {time:.2f} s" for name, share, time in passive], 8
        )
        separator = "; " if detail else ""
        detail += f"{separator}largest passive forces of the maximum isometric force: {shares}"
    worst = names[0] if names else ""
    return Verdict(
        quantity=Quantity.OVERSTRETCHED,
        value=float(len(names)),
        unit=f"of {count}",
        limit=0.0,
        worst=worst,
        detail=detail,
    )


def range_verdicts(model: Model, motion: Motion) -> list[Verdict]:
    """Coordinates that left the range the model gives them."""
    beyond: list[tuple[float, str, float]] = []
    for i, name in enumerate(motion.names):
        if name not in model.coordinate_names or name in model.dependent_coordinates:
            continue
        coordinate = model.coordinate(name)
        values = motion.values[:, i]
        if coordinate.motion != "rotational" or coordinate.locked or not np.isfinite(values).any():
            continue
        low, high = coordinate.range
        past = np.maximum(low - values, values - high)
        at = int(np.nanargmax(past))
        if past[at] > np.deg2rad(0.5):
            beyond.append((float(past[at]), name, float(motion.time[at])))
    if not beyond:
        return [Verdict(quantity=Quantity.OUT_OF_RANGE, value=0.0, unit="", limit=0.0)]
    far, name, time = max(beyond)
    detail = f"{name} by {np.rad2deg(far):.1f}°; all: " + few([name for _, name, _ in beyond], 8)
    return [
        Verdict(
            quantity=Quantity.OUT_OF_RANGE,
            value=float(len(beyond)),
            unit="",
            limit=0.0,
            worst=name,
            time=time,
            source="",
            detail=detail,
        )
    ]
