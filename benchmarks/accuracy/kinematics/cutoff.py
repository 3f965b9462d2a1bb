"""The low-pass filter that a motion gets by default.

It is compared with simulated truth, and judged by measured ground forces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.kinematics.white_noise_cutoff import white_noise_cutoff
from benchmarks.recordings import RECORDINGS, read_markers
from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Markers
from myomorph.core.motion.cutoff_choice import choose_cutoff
from myomorph.core.motion.filters import lowpass
from myomorph.core.motion.noise_evidence import NoiseEvidence
from myomorph.core.motion.splines import natural_spline
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from truths.mouse_motion import mouse

FIXED = (
    2.0,
    3.0,
    4.0,
    5.0,
    6.0,
    7.0,
    8.0,
    9.0,
    10.0,
    12.0,
    14.0,
    16.0,
    18.0,
    20.0,
    25.0,
    30.0,
    40.0,
)
"""Cutoffs among which the best is looked for [Hz]."""

EDGE = 0.1
"""Time at both ends that is not judged [s]."""

LOADED = 20.0
"""Vertical force from which somebody stands on the plates [N]."""

RATES = (60.0, 100.0, 250.0)
NOISES = ((0.0, 0.0), (0.3, 0.0), (1.0, 0.0), (3.0, 0.0), (0.5, 5.0), (1.0, 10.0))
"""White errors of markers and drift of skin, by standard deviation [mm]."""

SKIN = 2.0
"""Frequency below which skin drifts [Hz]."""

LEAST = 0.1
"""Smallest error that ratios are taken to [N m]: without noise no filter leaves nothing."""


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """What a filter is chosen by.

    Attributes
    ----------
    model : of the person
    motion : by inverse kinematics
    markers : that it was made of, None where there are none
    wrenches : of plates, None where there are none
    """

    model: mm.Model
    motion: mm.Motion
    markers: mm.Markers | None = None
    wrenches: mm.Wrenches | None = None

    @property
    def cutoff(self) -> float | None:
        """The default cutoff [Hz]."""
        evidence = NoiseEvidence(markers=self.markers, wrenches=self.wrenches)
        return choose_cutoff(self.motion, self.model, evidence=evidence).cutoff


Rule = Callable[[Recorded], mm.Motion]
Row = dict[str, object]


@dataclass(frozen=True)
class Movement:
    """A recorded motion that is made smooth and then taken as truth.

    `name`, `recording`: of it; a recording of `RECORDINGS`, or of a mouse; `cutoff`: of the filter
    that makes it smooth [Hz]; `span`: what is used of it [s]; `faster`: times it is played faster:
    a run becomes a sprint; `size`: of the errors, over those of a human's markers; `chosen`:
    whether the rule's two numbers were chosen with it.
    """

    name: str
    recording: str
    cutoff: float
    span: tuple[float, float] = (0.0, 1e9)
    faster: float = 1.0
    size: float = 1.0
    chosen: bool = True


MOVEMENTS = (
    Movement(name="walk, Rajagopal", recording="rajagopal", cutoff=12.0, span=(0.4, 2.4)),
    Movement("walk, implant 1", "implant-1", 12.0),
    Movement("walk, gait2354", "gait2354-dynamics", 12.0),
    Movement("walk, OpenCap", "opencap-walk", 12.0),
    Movement(name="sit to stand", recording="opencap-rise", cutoff=8.0, span=(0.0, 4.0)),
    Movement("drop jump", "opencap-jump", 20.0),
    Movement("run, 2 m/s", "run-2", 18.0),
    Movement("run, 5 m/s", "run-5", 20.0),
    Movement("sprint: the run 1.5 times as fast", "run-5", 20.0, faster=1.5),
    Movement(name="abduction of a shoulder", recording="shoulder", cutoff=8.0, span=(0.0, 3.0)),
    Movement("walk, implant 3", "implant-3", 12.0, chosen=False),
    Movement(
        name="walk, treadmill", recording="treadmill", cutoff=12.0, span=(2.0, 6.0), chosen=False
    ),
    Movement(
        name="walk, gait2392", recording="gait2392", cutoff=12.0, span=(5.0, 9.0), chosen=False
    ),
    Movement("walk, Lenhart", "lenhart", 12.0, chosen=False),
    Movement("mouse on a treadmill", "mouse", 30.0, size=0.1, chosen=False),
)


def by_default(recorded: Recorded) -> mm.Motion:
    """Smooth as the product does where nobody states a cutoff."""
    return mm.smooth_motion(
        recorded.motion, recorded.model, markers=recorded.markers, wrenches=recorded.wrenches
    ).motion


def by_spectra(recorded: Recorded) -> mm.Motion:
    """Smooth by the spectra of coordinates alone, as where no marker and no force is known."""
    return mm.smooth_motion(recorded.motion, recorded.model).motion


def as_before(recorded: Recorded) -> mm.Motion:
    """Filter as the product did before there was a noise model."""
    return mm.differentiate(recorded.motion, white_noise_cutoff(recorded.motion))


def at(cutoff: float) -> Rule:
    """Filter at a fixed cutoff [Hz]."""
    return lambda recorded: mm.differentiate(recorded.motion, cutoff)


RULES: dict[str, Rule] = {
    "automatic": by_default,
    "spectra alone": by_spectra,
    "before": as_before,
    "6 Hz": at(6.0),
    "8 Hz": at(8.0),
    "12 Hz": at(12.0),
}


def measure_truth(folder: Path) -> Iterator[Row]:
    """Measure errors of joint torques over those at the best fixed cutoff.

    The rows are by movement and noise; then of all together.
    """
    together: dict[bool, list[dict[str, float]]] = {True: [], False: []}
    exact: dict[bool, list[dict[str, float]]] = {True: [], False: []}
    for movement in MOVEMENTS:
        model, truth = _smooth(folder, movement)
        for white, skin in NOISES:
            ratios = []
            best = []
            chosen = []
            for rate in RATES:
                true, recorded = _recorded(model, truth, movement, rate, white, skin)
                error = partial(_torque_error, model, true)
                fixed = {
                    cutoff: error(mm.differentiate(recorded.motion, cutoff))
                    for cutoff in (*FIXED, None)
                }
                best.append(min(fixed, key=fixed.__getitem__))
                chosen.append(recorded.cutoff)
                least = max(min(fixed.values()), LEAST)
                ratios.append(
                    {
                        name: max(error(rule(recorded)), LEAST) / least
                        for name, rule in RULES.items()
                    }
                )
            together[movement.chosen] += ratios if white else []
            exact[movement.chosen] += [] if white else ratios
            yield {
                "movement": movement.name,
                "rule chosen with it": "yes" if movement.chosen else "no",
                "noise [mm]": movement.size * white,
                "skin [mm]": movement.size * skin,
                "best [Hz]": _range(best),
                "automatic [Hz]": _range(chosen),
                **_means(ratios),
            }
    for name, groups in (("all with noise", together), ("all without noise", exact)):
        for chosen_with, ratios in groups.items():
            head = {"movement": name, "rule chosen with it": "yes" if chosen_with else "no"}
            empty = dict.fromkeys(("noise [mm]", "skin [mm]", "best [Hz]", "automatic [Hz]"), "")
            yield {**head, **empty, **_means(ratios)}


def _range(cutoffs: list[float | None]) -> str:
    known = [cutoff for cutoff in cutoffs if cutoff is not None]
    none = ["none"] if len(known) < len(cutoffs) else []
    ends = [f"{min(known):.2g} to {max(known):.2g}"] if known else []
    return ", ".join(ends + none)


def _means(ratios: list[dict[str, float]]) -> Row:
    row: Row = {
        name: float(np.exp(np.mean([np.log(ratio[name]) for ratio in ratios]))) for name in RULES
    }
    return row | {"automatic, worst": max(ratio["automatic"] for ratio in ratios)}


def _smooth(folder: Path, movement: Movement) -> tuple[mm.Model, mm.Motion]:
    if movement.recording == "mouse":
        fitted = mouse(folder, "treadmill")
        model = fitted.calibration.model
        motion = fitted.fit.motion
    else:
        model, motion = _poses(folder, movement.recording)
    seen = np.isfinite(motion.values).all(axis=1)
    ends = np.flatnonzero(np.diff(np.concatenate([[0], seen.astype(int), [0]])))
    start, stop = max(zip(ends[::2], ends[1::2], strict=True), key=lambda run: run[1] - run[0])
    part = mm.Motion(motion.time[start:stop], motion.names, motion.values[start:stop])
    part = mm.cut(part, max(movement.span[0], part.time[0]), min(movement.span[1], part.time[-1]))
    return model, mm.differentiate(part, movement.cutoff)


def _poses(folder: Path, recording: str) -> tuple[mm.Model, mm.Motion]:
    """Coordinates that markers give, or where there are none those of a file."""
    files = RECORDINGS[recording]
    model = mm.read_model(folder / files.model)
    if files.motion and recording != "implant-1":
        return model, mm.read_motion(folder / files.motion, model)
    return model, mm.inverse_kinematics(model, read_markers(folder / files.markers)).motion


def _recorded(
    model: mm.Model, truth: mm.Motion, movement: Movement, rate: float, white: float, skin: float
) -> tuple[mm.Motion, Recorded]:
    """Truth at a sampling rate with exact derivatives, and noisy markers with what they give."""
    spline = natural_spline(truth.time, truth.values)
    faster = movement.faster
    at = np.arange(truth.time[0], truth.time[-1], faster / rate)
    rates = (faster * spline.derivative(1)(at), faster**2 * spline.derivative(2)(at))
    true = mm.Motion((at - at[0]) / faster, truth.names, spline(at), *rates)
    tree = compile_tree(model)
    random = np.random.default_rng(int(rate + 10 * white + skin))
    bodies = np.array([tree.body_index[marker.body] for marker in model.markers])
    places = forward_kinematics(tree, true.values).points(
        bodies, np.array([one.location for one in model.markers])
    )
    errors = white * random.standard_normal(places.shape)
    if skin:
        drift = lowpass(random.standard_normal(places.shape), rate, SKIN)
        errors += skin * drift / drift.std()
    markers = Markers(true.time, model.marker_names, places + 1e-3 * movement.size * errors)
    motion = mm.inverse_kinematics(model, markers).motion
    return true, Recorded(model=model, motion=motion, markers=markers)


def _torque_error(model: mm.Model, true: mm.Motion, filtered: mm.Motion) -> float:
    """Root mean square over the torques of all rotations, without external forces [N m]."""
    turning = [coordinate.motion == "rotational" for coordinate in model.coordinates]
    inner = (true.time >= EDGE) & (true.time <= true.time[-1] - EDGE)
    found = mm.inverse_dynamics(model, filtered).values
    wrong = (found - mm.inverse_dynamics(model, true).values)[inner][:, turning]
    return float(np.sqrt(np.nanmean(wrong**2)))


RECORDED = (
    *(
        "rajagopal",
        "gait2354",
        "opencap-walk",
        "implant-1",
        "implant-3",
        "treadmill",
        "gait2392",
        "lenhart",
    ),
    *("run-2", "run-5", "opencap-jump", "opencap-rise"),
)


def measure(folder: Path) -> Iterator[Row]:
    """Measure force and moment that have to hold the pelvis, over the least of any fixed cutoff.

    Forces are not filtered.
    """
    for name in RECORDED:
        files = RECORDINGS[name]
        model = mm.read_model(folder / files.model)
        markers = read_markers(folder / files.markers) if files.markers else None
        if markers is not None:
            motion = mm.inverse_kinematics(model, markers).motion
        else:
            motion = mm.read_motion(folder / files.motion, model)
        measured = mm.read_loads(folder / files.loads, model, mm.differentiate(motion, 6.0))
        motion = mm.cut(motion, measured.time[0], measured.time[-1])
        recorded = Recorded(model=model, motion=motion, markers=markers, wrenches=measured)
        held = partial(_held, model, measured)
        fixed = {cutoff: held(mm.differentiate(motion, cutoff)) for cutoff in (*FIXED, None)}
        least = np.min(list(fixed.values()), axis=0)
        chosen = recorded.cutoff
        row: Row = {"recording": name, "frames": len(motion)}
        row["automatic cutoff [Hz]"] = "none" if chosen is None else f"{chosen:.2g}"
        for part, (kind, unit) in enumerate((("force", "N"), ("moment", "N m"))):
            row[f"best for the {kind} [Hz]"] = (
                min(fixed, key=lambda cutoff: fixed[cutoff][part]) or "none"
            )
            row[f"smallest {kind} error [{unit}]"] = least[part]
            row |= {
                f"{kind}, {rule}": held(of(recorded))[part] / least[part]
                for rule, of in RULES.items()
            }
        yield row


def _held(model: mm.Model, measured: mm.Wrenches, motion: mm.Motion) -> Array:
    """Return the root mean square of force and moment on the floating joint [N, N m].

    Only frames on the plates count.
    """
    loads = mm.resample_wrenches(measured, motion.time)
    torques = mm.inverse_dynamics(model, motion, loads)
    used = (motion.time >= motion.time[0] + EDGE) & (motion.time <= motion.time[-1] - EDGE)
    used &= np.abs(loads.forces[:, :, 1]).sum(axis=1) > LOADED
    held = []
    for kind in ("translational", "rotational"):
        names = [
            name for name in floating_coordinates(model) if model.coordinate(name).motion == kind
        ]
        held.append(
            float(np.sqrt(np.nanmean(np.sum([torques[name][used] ** 2 for name in names], axis=0))))
        )
    return np.array(held)
