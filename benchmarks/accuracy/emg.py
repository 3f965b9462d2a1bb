"""EMG in the tension problem: channels left out and predicted, with and without the EMG of the others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.io.loads import read_external_loads
from myomorph.model.arrays import Array
from myomorph.motion.envelope import ChannelMap, EmgCalibration, EnvelopeOptions, channel_means, shifted
from myomorph.motion.filters import lowpass
from myomorph.motion.sync import cut
from myomorph.tension.emg_calibration import calibrate_emg
from myomorph.tension.emg_held_out import EmgTrial
from myomorph.tension.emg_targets import EmgOptions, emg_targets
from myomorph.tension.emg_tracking import few_frames
from myomorph.tension.tension import Tension

CUTOFF = 6.0
ALONE = "without EMG"
WAYS: Mapping[str, EmgOptions | None] = {
    ALONE: None,
    "default": EmgOptions(),
    "others by least effort": EmgOptions(unmeasured="effort"),
    "weight 10": EmgOptions(weight=10.0),
    "driven": EmgOptions(mode="driven"),
}
"""The first is without EMG, the second the library's own choice."""

RAJAGOPAL = {
    "SOL": ("soleus",),
    "GAS": ("gasmed", "gaslat"),
    "TA": ("tibant",),
    "MH": ("semimem", "semiten"),
    "BF": ("bflh",),
    "VL": ("vaslat",),
    "VM": ("vasmed",),
    "RF": ("recfem",),
    "GMAX": ("glmax1", "glmax2", "glmax3"),
    "GMED": ("glmed1", "glmed2", "glmed3"),
}
"""Muscles under each electrode of the raw recording; the side is the leg whose tensions it fits."""


@dataclass(frozen=True, eq=False)
class Walk:
    """A motion with torques, external forces and EMG, and the times that are calibrated on and tested on."""

    name: str
    model: mm.Model
    motion: mm.Motion
    torques: mm.Series
    wrenches: mm.Wrenches
    emg: mm.Emg
    channels: ChannelMap
    calibrated: tuple[float, float]
    tested: tuple[float, float]
    every: int

    def part(self, span: tuple[float, float]) -> tuple[mm.Motion, mm.Series]:
        """Motion and torques of a span, every so many frames."""
        motion, torques = cut(self.motion, *span), cut(self.torques, *span)
        return few_frames(motion, torques, self.every)


def torques_of(path: Path) -> mm.Series:
    """A table of inverse dynamics, low-pass filtered as the motion."""
    table = mm.read_sto(path)
    names = tuple(name.removesuffix("_moment").removesuffix("_force") for name in table.names)
    return mm.Series(table.time, names, lowpass(table.values, table.rate, CUTOFF))


def belts(path: Path, left: str) -> mm.Wrenches:
    """Forces of both feet, those of the left one under columns that begin so."""
    table = mm.read_sto(path)
    parts = [
        np.stack([np.column_stack([table[f"{foot}ground_{kind}{x}"] for x in "xyz"]) for foot in ("", left)], axis=1)
        for kind in ("force_v", "force_p", "torque_")
    ]
    return mm.Wrenches(table.time, ("right", "left"), ("calcn_r", "calcn_l"), *parts)


def treadmill(folder: Path) -> Walk:
    """CEINMS: the generic model's forces brought to the walker's mass, as areas: (58 / 75.16)^(2/3)."""
    at = folder / "ceinms-emg-walk"
    model = mm.read_model(at / "model/gait2392.osim")
    weaker = (58.0 / 75.16) ** (2.0 / 3.0)
    muscles = tuple(replace(one, max_isometric_force=weaker * one.max_isometric_force) for one in model.muscles)
    model = replace(model, muscles=muscles)
    motion = mm.differentiate(mm.read_motion(at / "walk36/ik.sto", model), CUTOFF)
    table = mm.read_sto(at / "walk36/emgFilt.sto")
    emg = mm.Emg(table.time, table.names, table.values)
    torques = torques_of(at / "walk36/id.sto")
    channels = {name: (name,) for name in emg.names}
    wrenches = belts(at / "walk36/XLD.mot", "l_")
    return Walk("ceinms-emg-walk", model, motion, torques, wrenches, emg, channels, (5.0, 25.0), (30.0, 50.0), 4)


def overground(folder: Path, side: str = "r") -> Walk:
    """Rajagopal 2016: raw EMG made into envelopes here; one stride, so that it is calibrated and tested alike."""
    at = folder / "rajagopal-walk-emg"
    model = mm.read_model(at / "subject_walk_scaled.osim")
    motion = mm.differentiate(mm.read_motion(at / "coordinates.sto", model), None)
    channels = {name: tuple(f"{one}_{side}" for one in muscles) for name, muscles in RAJAGOPAL.items()}
    emg = mm.envelopes(raw_emg(at / "raw/emg_walk_raw.anc"))
    span = (0.5, 1.75)
    wrenches = mm.resample_wrenches(read_external_loads(at / "grf_walk.xml"), motion.time)
    torques = mm.inverse_dynamics(model, motion, wrenches)
    name = "rajagopal-walk-emg" if side == "r" else "rajagopal-walk-emg, on the left leg"
    return Walk(name, model, motion, torques, wrenches, emg, channels, span, span, 5)


def loaded(folder: Path) -> Walk:
    """Uhlrich 2022: the left leg; its channel of vastus intermedius is a copy of lateralis and goes with it."""
    at = folder / "walk-so-jointload-emg"
    model = mm.read_model(at / "Rajagopal_scaled_Sub1_gasAvoid.osim")
    motion = mm.differentiate(mm.read_motion(at / "results_ik.sto", model), CUTOFF)
    table = mm.read_sto(at / "EMG_allMuscles.sto")
    emg = mm.Emg(table.time, table.names, table.values)
    channels = {name: (name.removesuffix("_activation"),) for name in emg.names if "vasint" not in name}
    channels["vaslat_l_activation"] = ("vaslat_l", "vasint_l")
    torques = torques_of(at / "results_id.sto")
    wrenches = belts(at / "walking_baseline1_forces.mot", "1_")
    return Walk("walk-so-jointload-emg", model, motion, torques, wrenches, emg, channels, (15.0, 35.0), (35.0, 55.0), 2)


WALKS = (treadmill, overground, loaded)


def raw_emg(path: Path) -> mm.Series:
    """The EMG channels of an ANC file, in counts."""
    lines = path.read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("Name"))
    names = lines[head].split()[1:]
    rows = np.array([line.split() for line in lines[head + 3 :] if line.strip()], dtype=np.float64)
    chosen = [names.index(name) for name in RAJAGOPAL]
    return mm.Series(rows[:, 0], tuple(RAJAGOPAL), rows[:, 1:][:, chosen])


@dataclass(frozen=True)
class HeldOut:
    """One channel left out: how its muscles' activation fits its envelope, and what the others had to give.

    `correlation`, `rms`: of the mean activation with the envelope; RMS in shares of the channel's largest value, the
    activation scaled to fit best; `tracking`: RMS distance of the used muscles from what EMG told them [activation];
    `reserve`: largest torque of a reserve of a joint [N m].
    """

    channel: str
    way: str
    correlation: float
    rms: float
    tracking: float
    reserve: float


@lru_cache(maxsize=1)
def held_out(folder: Path) -> Mapping[str, tuple[HeldOut, ...]]:
    """Every channel of every walk left out in turn, by the walk's name."""
    return {walk.name: tuple(_leave_out(walk)) for walk in (make(folder) for make in WALKS)}


def _leave_out(walk: Walk) -> Iterator[HeldOut]:
    motion, torques = walk.part(walk.tested)
    trial = EmgTrial(*walk.part(walk.calibrated), walk.emg)
    alone = mm.solve_tension(walk.model, motion, torques)
    for channel, muscles in walk.channels.items():
        rest = {name: told for name, told in walk.channels.items() if name != channel}
        calibration = calibrate_emg(walk.model, [trial], rest)
        # The channel that is left out is only ever looked at here, later by the delay that the others tell.
        delay = float(np.median(calibration.delays))
        measured = shifted(walk.emg, motion.time, np.full(len(walk.emg.names), delay))
        measured = measured[:, walk.emg.names.index(channel)] / np.nanmax(walk.emg[channel])
        for way, options in WAYS.items():
            found, tracking = alone, float("nan")
            if options is not None:
                told = emg_targets(walk.emg, rest, walk.model, motion.time, options, calibration)
                found = mm.solve_tension(walk.model, motion, torques, emg=told)
                used = found.activations[:, [found.muscles.index(one) for one in told.muscles]]
                tracking = float(np.sqrt(np.nanmean((used - told.activations) ** 2)))
            predicted = channel_means({channel: muscles}, found.muscles, found.activations)[:, 0]
            correlation, rms = _fit(predicted, measured)
            yield HeldOut(channel, way, correlation, rms, tracking, _largest_reserve(found))


def _fit(predicted: Array, measured: Array) -> tuple[float, float]:
    """Correlation, and RMS after the scale that fits best."""
    use = np.isfinite(predicted) & np.isfinite(measured)
    predicted, measured = predicted[use], measured[use]
    scale = max(predicted @ measured, 0.0) / max(predicted @ predicted, 1e-300)
    rms = float(np.sqrt(np.mean((scale * predicted - measured) ** 2)))
    return float(np.corrcoef(predicted, measured)[0, 1]), rms


def _largest_reserve(found: Tension) -> float:
    joints = [k for k, name in enumerate(found.reserve_names) if name.startswith("reserve")]
    return float(np.nanmax(np.abs(found.reserves[:, joints]), initial=0.0))


def measure_held_out(folder: Path) -> Iterator[dict[str, object]]:
    """Means over the channels of each walk."""
    for name, rows in held_out(folder).items():
        for way in WAYS:
            of = [row for row in rows if row.way == way]
            r, rms = np.array([row.correlation for row in of]), np.array([row.rms for row in of])
            yield {
                "walk": name,
                "others": way,
                "channels": len(of),
                "correlation, mean": float(r.mean()),
                "SD over channels": float(r.std()),
                "least ... most": f"{r.min():.2f} ... {r.max():.2f}",
                "RMS, mean": float(rms.mean()),
                "SD of RMS": float(rms.std()),
                "RMS of those used": "" if way == ALONE else float(np.mean([row.tracking for row in of])),
                "largest reserve [N m]": float(max(row.reserve for row in of)),
            }


def measure_channels(folder: Path) -> Iterator[dict[str, object]]:
    """Correlation and RMS of every channel that was left out."""
    for name, rows in held_out(folder).items():
        for channel in dict.fromkeys(row.channel for row in rows):
            of = {row.way: row for row in rows if row.channel == channel}
            row: dict[str, object] = {"walk": name, "channel": channel}
            row |= {f"r, {way}": of[way].correlation for way in WAYS}
            row |= {f"RMS, {way}": of[way].rms for way in WAYS}
            yield row


def measure_calibration(folder: Path) -> Iterator[dict[str, object]]:
    """Delays, gains and weights by two halves of each walk, and what torques say of them."""
    for walk in (*(make(folder) for make in WALKS), overground(folder, "l")):
        first, second = (_calibrated(walk, span) for span in (walk.calibrated, walk.tested))
        apart = np.abs(np.log(first.gains / second.gains))
        same = walk.calibrated == walk.tested
        known = first.by_torque
        yield {
            "walk": walk.name,
            "delay [ms]": round(1e3 * float(first.delays[0])),
            "on other frames [ms]": "" if same else round(1e3 * float(second.delays[0])),
            "gains, least ... most": f"{first.gains.min():.2f} ... {first.gains.max():.2f}",
            "told by torques": f"{int(known.sum())} of {len(known)}",
            "gains on other frames apart, median": "" if same else f"{np.median(np.expm1(apart)):.1%}",
            "largest": "" if same else f"{np.expm1(apart).max():.1%}",
            "weight": first.weight,
            "channels that others mislead": sum("misleads" in text for text in first.warnings),
        }


def _calibrated(walk: Walk, span: tuple[float, float]) -> EmgCalibration:
    return calibrate_emg(walk.model, [EmgTrial(*walk.part(span), walk.emg)], walk.channels)


def measure_study(folder: Path) -> Iterator[dict[str, object]]:
    """One stance of the walk with joint loads: ours and that study's activations against its EMG and each other."""
    walk = loaded(folder)
    table = mm.read_sto(folder / "walk-so-jointload-emg/results_SO/results_states.sto")
    motion, torques = replace(walk, every=1).part((10.9, 11.7))
    calibration = calibrate_emg(walk.model, [EmgTrial(*walk.part(walk.calibrated), walk.emg)], walk.channels)
    theirs = {name: np.interp(motion.time, table.time, table[f"/forceset/{name}/activation"]) for name in _left(walk)}
    for way, options in WAYS.items():
        told = None
        if options is not None:
            told = emg_targets(walk.emg, walk.channels, walk.model, motion.time, options, calibration)
        found = mm.solve_tension(walk.model, motion, torques, emg=told)
        ours = {name: found.activations[:, found.muscles.index(name)] for name in _left(walk)}
        row: dict[str, object] = {"ours": way, "muscles": len(ours)}
        apart = np.array([ours[name] - theirs[name] for name in ours])
        row["RMS from the study's"] = float(np.sqrt(np.mean(apart**2)))
        both = [_correlation(ours[name], theirs[name]) for name in ours]
        row["correlation with the study's, median"] = float(np.nanmedian(both))
        for label, activations in (("ours", ours), ("theirs", theirs)):
            told_by = [
                _correlation(np.mean([activations[one] for one in muscles], axis=0), _envelope(walk, name, motion.time))
                for name, muscles in walk.channels.items()
            ]
            row[f"correlation with EMG, {label}, mean"] = float(np.nanmean(told_by))
        yield row


def _left(walk: Walk) -> tuple[str, ...]:
    return tuple(name for name in walk.model.muscle_names if name.endswith("_l"))


def _envelope(walk: Walk, channel: str, time: Array) -> Array:
    """Envelope without delay: the study's static optimization had none."""
    found: Array = np.interp(time, walk.emg.time, walk.emg[channel])
    return found


def _correlation(one: Array, other: Array) -> float:
    flat = np.std(one) < 1e-9 or np.std(other) < 1e-9
    return float("nan") if flat else float(np.corrcoef(one, other)[0, 1])


def measure_envelopes(folder: Path) -> Iterator[dict[str, object]]:
    """Our envelopes of the raw recording against those that came with it, with its filters and with ours."""
    at = folder / "rajagopal-walk-emg"
    raw, table = raw_emg(at / "raw/emg_walk_raw.anc"), mm.read_sto(at / "electromyography.sto")
    for label, options in (
        ("band 50 to 500 Hz, low-pass 7.5 Hz, as there", EnvelopeOptions((50.0, 500.0), 7.5)),
        ("default: 20 to 450 Hz, low-pass 6 Hz", EnvelopeOptions()),
    ):
        found = mm.envelopes(raw, options)
        rows = []
        for k, name in enumerate(found.names):
            ours, theirs = np.interp(table.time, found.time, found[name]), table.values[:, k]
            rows.append((_correlation(ours, theirs), float(np.sqrt(np.mean((ours - theirs) ** 2)))))
        r, rms = np.array(rows).T
        yield {
            "envelope": label,
            "channels": len(rows),
            "correlation, least": float(r.min()),
            "median": float(np.median(r)),
            "RMS, largest": float(rms.max()),
        }
