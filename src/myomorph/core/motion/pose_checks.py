"""Checks of solved coordinates: held at a bound, shown by no marker, a body that lies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import POSES, UNSEEN
from myomorph.core.model.errors import quoted
from myomorph.core.model.findings import Finding, spans_of
from myomorph.core.model.messages import Severity
from myomorph.core.model.model import GROUND, Coordinate, Model
from myomorph.core.model.series import Markers
from myomorph.core.model.severity import ANGLE_ERROR, severity_of, severity_of_share
from myomorph.core.motion.ik import InverseKinematicsOptions, KinematicsFit, inverse_kinematics
from myomorph.core.motion.marker_frames import marker_frames
from myomorph.core.motion.marker_influence import undetermined
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.motion.unseen import DEFAULT, UPRIGHT
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

HELD = 0.1  # Share of the frames in which a coordinate may lie at its bound without a word
AT = 1e-9  # A coordinate nearer to its bound lies at it [rad or m]
BEYOND = {"rotational": np.radians(1.0), "translational": 0.002}
"""What the markers must ask for beyond a bound for the bound to matter [rad or m]."""

OVER = np.radians(90.0)  # An angle so far outside the model's range has turned a joint over [rad]
SAMPLES = 24
ASSUMPTIONS = {
    UPRIGHT: "assumed to hold the trunk upright",
    DEFAULT: "assumed to be as in the default pose",
}
"""What is assumed of coordinates that are never seen, for people."""
LIES = 60.0
MOSTLY = 0.8


def pose_findings(
    model: Model,
    markers: Markers,
    fit: KinematicsFit,
    problem: PoseProblem,
    options: InverseKinematicsOptions,
) -> Iterator[Finding]:
    """Check the coordinates of a fit of these markers.

    Parameters
    ----------
    model : that was fitted
    markers : as used (frames, markers, 3) [m], NaN where hidden
    fit : of inverse kinematics
    problem : of the fit
    options : of inverse kinematics

    Yields
    ------
    findings on bounds, hidden coordinates, joints turned over, the vertical and convergence
    """
    if not fit.seen.any():
        return
    yield from _bound_findings(model, markers, fit, problem, options)
    yield from _blind_findings(model, markers, fit, problem)
    yield from turned_findings(model, fit)
    yield from _upright_findings(model, fit)
    yield from _convergence_findings(fit)


def _bound_findings(
    model: Model,
    markers: Markers,
    fit: KinematicsFit,
    problem: PoseProblem,
    options: InverseKinematicsOptions,
) -> Iterator[Finding]:
    """Find coordinates at a bound for more than a tenth of the frames.

    Some of these frames are solved again without the bound, for how far the coordinate would go.
    """
    values = fit.motion.values[:, problem.free]
    with np.errstate(invalid="ignore"):
        at = (values <= problem.lower + AT) | (values >= problem.upper - AT)
    at &= np.asarray(problem.lower < problem.upper)
    held = np.flatnonzero(at.sum(axis=0) > HELD * int(fit.seen.sum()))
    if not len(held):
        return
    names = [model.coordinate_names[problem.free[i]] for i in held]
    some = np.flatnonzero(at[:, held].any(axis=1))
    some = some[np.unique(np.linspace(0, len(some) - 1, SAMPLES).astype(int))]
    freed = inverse_kinematics(_unclamped(model, names), markers.frames(some), options)
    for name, i in zip(names, held, strict=True):
        lower = float(problem.lower[i])
        low = 2 * int((values[:, i] <= lower + AT).sum()) > int(at[:, i].sum())
        bound = _Bound(
            coordinate=model.coordinate(name),
            value=lower if low else float(problem.upper[i]),
            is_lower=low,
        )
        beyond = bound.beyond(freed.motion[name][at[some, i]])
        if beyond < BEYOND["rotational" if bound.turns else "translational"]:
            continue
        spans = spans_of(fit.motion.time, at[:, i])
        first = f"from {spans[0][0]:.2f} s on"
        if len(spans) == 1:
            first = f"from {spans[0][0]:.2f} to {spans[0][1]:.2f} s"
        further = f"{np.degrees(beyond):.0f} degrees" if bound.turns else f"{100 * beyond:.1f} cm"
        text = POSES.message(
            f"coordinate '{name}' is held at its bound of {bound} in {int(at[:, i].sum())} of"
            f" {len(fit.motion)} frames ({first}); the markers suggest about {further} more: check"
            " the bound, the markers there and the model's size",
            severity=_bound_severity(bound, beyond),
        )
        yield Finding(kind="at its bound", place=name, text=text, times=spans)


def _bound_severity(bound: _Bound, beyond: float) -> Severity:
    """Severity of a bound that the markers would pass by so much [rad or m]."""
    return severity_of(np.degrees(beyond), ANGLE_ERROR) if bound.turns else POSES.severity


def _unclamped(model: Model, names: Sequence[str]) -> Model:
    """Remove the bounds of some coordinates."""
    coordinates = tuple(
        replace(each, clamped=each.clamped and each.name not in names) for each in model.coordinates
    )
    return replace(model, coordinates=coordinates)


@dataclass(frozen=True, kw_only=True)
class _Bound:
    """The bound that a coordinate is held at.

    Attributes
    ----------
    coordinate : whose it is
    value : of the bound [rad or m]
    is_lower : whether it is the lower one
    """

    coordinate: Coordinate
    value: float
    is_lower: bool

    @property
    def turns(self) -> bool:
        """Whether the coordinate is an angle."""
        return self.coordinate.motion != "translational"

    def __str__(self) -> str:
        return f"{np.degrees(self.value):.4g} degrees" if self.turns else f"{self.value:.4g} m"

    def beyond(self, freed: Array) -> float:
        """Median of how far values (frames,) that were found without it lie outside [rad or m]."""
        if not len(freed):
            return 0.0
        beyond = (self.value - freed) if self.is_lower else (freed - self.value)
        if self.turns:
            # Freed, an angle may come out a turn further.
            beyond = (beyond + np.pi) % (2.0 * np.pi) - np.pi
        return float(np.nanmedian(beyond))


def _blind_findings(
    model: Model, markers: Markers, fit: KinematicsFit, problem: PoseProblem
) -> Iterator[Finding]:
    """Coordinates that no marker shows."""
    if model.loops:
        # What a loop ties is determined by the loop: slopes of single markers do not know it.
        return
    if fit.assumed_as:
        yield from _assumed_findings(model, fit)
        return
    seen = np.flatnonzero(fit.seen)
    chosen = seen[np.unique(np.linspace(0, len(seen) - 1, 6).astype(int))]
    columns = [markers.names.index(name) for name in fit.marker_names]
    frames = marker_frames(
        compile_tree(model), problem, markers.values[chosen][:, columns], fit.motion.values[chosen]
    )
    names = [
        model.coordinate_names[j] for j in undetermined(frames, problem, problem.markers.weight)
    ]
    if names:
        count, stay = (
            ("a coordinate", "It stays")
            if len(names) == 1
            else (f"{len(names)} coordinates", "They stay")
        )
        text = UNSEEN.message(
            f"no marker determines {count}: {quoted(names)}. {stay} near the default; lock what is "
            "not measured, or add markers"
        )
        yield Finding("undetermined", ", ".join(names), text)


def _assumed_findings(model: Model, fit: KinematicsFit) -> Iterator[Finding]:
    """Coordinates that no marker shows, and what was assumed of them."""
    assert fit.assumed_sd is not None
    parts = []
    every: list[str] = []
    for how, what in ASSUMPTIONS.items():
        columns = [j for j, assumed in enumerate(fit.assumed_as) if assumed == how]
        if not columns:
            continue
        names = [model.coordinate_names[j] for j in columns]
        every += names
        turning = [j for j in columns if model.coordinates[j].motion == "rotational"]
        sd = np.degrees(float(np.nanmax(np.nanmean(fit.assumed_sd[:, turning], axis=0), initial=0)))
        within = f" (standard deviation up to {sd:.0f} degrees)" if turning else ""
        parts.append(f"{quoted(names)}: not seen, {what}{within}")
    if every:
        count = "a coordinate" if len(every) == 1 else f"{len(every)} coordinates"
        text = UNSEEN.message(
            f"no marker determines {count}; {'; '.join(parts)}. Add markers, or lock what does not"
            " move"
        )
        yield Finding("undetermined", ", ".join(every), text)


def turned_findings(model: Model, fit: KinematicsFit) -> Iterator[Finding]:
    """Find angles of joints that lie more than 90 degrees outside their range.

    Two neighbors that turn over together look much the same to markers.

    Parameters
    ----------
    model : that was fitted
    fit : of inverse kinematics

    Yields
    ------
    a finding for each coordinate
    """
    floating = set(floating_coordinates(model))
    for coordinate in model.coordinates:
        low, high = coordinate.range
        if (
            coordinate.name in floating
            or coordinate.motion == "translational"
            or not 0.0 < high - low < np.pi + 0.1
        ):
            continue
        angles = fit.motion[coordinate.name]
        with np.errstate(invalid="ignore"):
            over = (angles < low - OVER) | (angles > high + OVER)
        if not over.any():
            continue
        spans = spans_of(fit.motion.time, over)
        far = float(np.nanmax(np.abs(angles[over] - 0.5 * (low + high))))
        text = POSES.message(
            f"coordinate '{coordinate.name}' is up to {np.degrees(far):.0f} degrees from the middle"
            f" of its range ({np.degrees(low):.0f} to {np.degrees(high):.0f} degrees), in"
            f" {int(over.sum())} of {len(angles)} frames from {spans[0][0]:.2f} s on: the joint"
            " flipped over, and torques there are wrong: clamp it, or check the markers",
            severity="changes results",
        )
        yield Finding(kind="joint turned over", place=coordinate.name, text=text, times=spans)


def _upright_findings(model: Model, fit: KinematicsFit) -> Iterator[Finding]:
    """Find a floating body that lies or is upside down in nearly all frames.

    Its vertical may be another axis of the recording.
    """
    floating = set(floating_coordinates(model))
    joint = next(
        (
            each
            for each in model.joints
            if each.parent == GROUND and floating & set(each.coordinates)
        ),
        None,
    )
    gravity = float(np.linalg.norm(model.gravity))
    if joint is None or gravity == 0.0:
        return
    tree = compile_tree(model)
    up = -np.asarray(model.gravity) / gravity
    body = tree.body_index[joint.child]
    # Massless links may lie between the ground and the body: their default pose is the upright one
    # all the same.
    poses = forward_kinematics(
        tree, np.vstack([tree.defaults, fit.motion.values[fit.seen]])
    ).rotations[:, body]
    now = poses[1:] @ (poses[0].T @ up)
    tilt = np.degrees(np.arccos(np.clip(now @ up, -1.0, 1.0)))
    if float((tilt > LIES).mean()) < MOSTLY:
        return
    axis = "xyz"[int(np.argmax(np.abs(now.mean(axis=0))))]
    usual = float(np.median(tilt))
    what = "is upside down" if usual > 150.0 else "lies"
    count = f"{int((tilt > LIES).sum())} of {len(tilt)} frames"
    text = POSES.message(
        f"the body {what}: it is tilted by {usual:.0f} degrees in {count}, along the recording's"
        f" {axis} axis. If it stood, the recording's vertical is not the model's: rotate its axes",
        severity="changes results",
    )
    yield Finding("vertical axis", joint.child, text)


def _convergence_findings(fit: KinematicsFit) -> Iterator[Finding]:
    """Frames whose search did not end."""
    lost = fit.seen & ~np.asarray(fit.converged, bool)
    if lost.any():
        spans = spans_of(fit.motion.time, lost)
        share = float(lost.mean())
        text = POSES.message(
            f"{int(lost.sum())} of {len(lost)} frames did not converge, the first at"
            f" {spans[0][0]:.2f} s",
            share=share,
            severity=severity_of_share(share, POSES.severity),
        )
        yield Finding(kind="not converged", place="frames", text=text, times=spans)
