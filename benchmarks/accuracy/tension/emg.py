"""EMG in the tension problem: channels that are left out and predicted.

The EMG of the others is used, or not.
"""

from __future__ import annotations

import csv
import json
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension.knee import command
from benchmarks.accuracy.tension.knee import raw_emg as implant_emg
from benchmarks.hidden_plates import subject_model
from benchmarks.recordings import RECORDINGS
from myomorph.body.tension.emg_calibration import calibrate_emg
from myomorph.body.tension.emg_held_out import EmgTrial
from myomorph.core.io.loads import read_external_loads
from myomorph.core.model.arrays import Array
from myomorph.core.motion.emg_activation import ChannelMap, EmgCalibration
from myomorph.core.motion.envelope import EnvelopeOptions
from myomorph.core.motion.filters import lowpass
from myomorph.core.motion.sync import cut
from myomorph.core.tension.emg_quantities import CHANNEL_TABLE
from myomorph.core.tension.emg_targets import EmgOptions, emg_targets

Row = dict[str, object]

CUTOFF = 6.0
ALONE = "without EMG"
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
    """A motion with torques, external forces and EMG.

    It has the times that are calibrated on and tested on.
    """

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
        motion = cut(self.motion, *span)
        torques = cut(self.torques, *span)
        few = slice(None, None, self.every)
        return motion.frames(few), torques.frames(few)


def torques_of(path: Path) -> mm.Series:
    """Read a table of inverse dynamics, low-pass filtered as the motion."""
    table = mm.read_sto(path)
    names = tuple(name.removesuffix("_moment").removesuffix("_force") for name in table.names)
    return mm.Series(table.time, names, lowpass(table.values, table.rate, CUTOFF))


def belts(path: Path, left: str) -> mm.Wrenches:
    """Read forces of both feet, those of the left one under columns that begin so."""
    table = mm.read_sto(path)
    parts = [
        np.stack(
            [
                np.column_stack([table[f"{foot}ground_{kind}{x}"] for x in "xyz"])
                for foot in ("", left)
            ],
            axis=1,
        )
        for kind in ("force_v", "force_p", "torque_")
    ]
    return mm.Wrenches(table.time, ("right", "left"), ("calcn_r", "calcn_l"), *parts)


def treadmill(folder: Path) -> Walk:
    """Read the walk of CEINMS.

    The generic model's forces are scaled to the walker's mass, as areas: (58 / 75.16)^(2/3).
    """
    at = folder / "ceinms-emg-walk"
    model = mm.read_model(at / "model/gait2392.osim")
    weaker = (58.0 / 75.16) ** (2.0 / 3.0)
    muscles = tuple(
        replace(one, max_isometric_force=weaker * one.max_isometric_force) for one in model.muscles
    )
    model = replace(model, muscles=muscles)
    motion = mm.differentiate(mm.read_motion(at / "walk36/ik.sto", model), CUTOFF)
    table = mm.read_sto(at / "walk36/emgFilt.sto")
    emg = mm.Emg(table.time, table.names, table.values)
    torques = torques_of(at / "walk36/id.sto")
    channels = {name: (name,) for name in emg.names}
    wrenches = belts(at / "walk36/XLD.mot", "l_")
    return Walk(
        name="ceinms-emg-walk",
        model=model,
        motion=motion,
        torques=torques,
        wrenches=wrenches,
        emg=emg,
        channels=channels,
        calibrated=(5.0, 25.0),
        tested=(30.0, 50.0),
        every=4,
    )


def overground(folder: Path, side: str = "r") -> Walk:
    """Read the walk of Rajagopal 2016, whose raw EMG is made into envelopes here.

    It is one stride, so that it is calibrated and tested alike.
    """
    at = folder / "rajagopal-walk-emg"
    model = mm.read_model(at / "subject_walk_scaled.osim")
    motion = mm.differentiate(mm.read_motion(at / "coordinates.sto", model), None)
    channels = {
        name: tuple(f"{one}_{side}" for one in muscles) for name, muscles in RAJAGOPAL.items()
    }
    emg = mm.envelopes(raw_emg(at / "raw/emg_walk_raw.anc"))
    span = (0.5, 1.75)
    wrenches = mm.resample_wrenches(read_external_loads(at / "grf_walk.xml"), motion.time)
    torques = mm.inverse_dynamics(model, motion, wrenches)
    name = "rajagopal-walk-emg" if side == "r" else "rajagopal-walk-emg, on the left leg"
    return Walk(
        name=name,
        model=model,
        motion=motion,
        torques=torques,
        wrenches=wrenches,
        emg=emg,
        channels=channels,
        calibrated=span,
        tested=span,
        every=5,
    )


def loaded(folder: Path) -> Walk:
    """Read the walk of Uhlrich 2022: the left leg.

    Its channel of vastus intermedius is a copy of lateralis and goes with it.
    """
    at = folder / "walk-so-jointload-emg"
    model = mm.read_model(at / "Rajagopal_scaled_Sub1_gasAvoid.osim")
    motion = mm.differentiate(mm.read_motion(at / "results_ik.sto", model), CUTOFF)
    table = mm.read_sto(at / "EMG_allMuscles.sto")
    emg = mm.Emg(table.time, table.names, table.values)
    channels = {
        name: (name.removesuffix("_activation"),) for name in emg.names if "vasint" not in name
    }
    channels["vaslat_l_activation"] = ("vaslat_l", "vasint_l")
    torques = torques_of(at / "results_id.sto")
    wrenches = belts(at / "walking_baseline1_forces.mot", "1_")
    return Walk(
        name="walk-so-jointload-emg",
        model=model,
        motion=motion,
        torques=torques,
        wrenches=wrenches,
        emg=emg,
        channels=channels,
        calibrated=(15.0, 35.0),
        tested=(35.0, 55.0),
        every=2,
    )


WALKS = (treadmill, overground, loaded)


def raw_emg(path: Path) -> mm.Series:
    """Read the EMG channels of an ANC file, in counts."""
    lines = path.read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("Name"))
    names = lines[head].split()[1:]
    rows = np.array([line.split() for line in lines[head + 3 :] if line.strip()], dtype=np.float64)
    chosen = [names.index(name) for name in RAJAGOPAL]
    return mm.Series(rows[:, 0], tuple(RAJAGOPAL), rows[:, 1:][:, chosen])


class Recorded(NamedTuple):
    """Options a user gives `myomorph tension`; `mass` of the walker if not the model's [kg]."""

    name: str
    files: str
    emg: str
    words: tuple[object, ...] = ()
    mass: float | None = None


RECORDED = (
    Recorded(
        name="ceinms-emg-walk",
        files="gait2392",
        emg="ceinms-emg-walk/walk36/emgFilt.sto",
        words=("--time", 30, 38),
        mass=58.0,
    ),
    Recorded(
        name="rajagopal-walk-emg",
        files="rajagopal",
        emg="rajagopal-walk-emg/electromyography.sto",
        words=("--emg-side", "right"),
    ),
    Recorded(
        name="walk-so-jointload-emg",
        files="treadmill",
        emg="walk-so-jointload-emg/EMG_allMuscles.sto",
        words=("--time", 35, 43),
    ),
    Recorded(
        name="knee-implant-walk, walk1",
        files="implant-1",
        emg="knee-implant-walk/walk1.c3d",
        words=("--emg-side", "left"),
    ),
    Recorded(
        name="knee-implant-walk, walk3",
        files="implant-3",
        emg="knee-implant-walk/walk3.c3d",
        words=("--emg-side", "left"),
    ),
)
COPIES = ("vasint_l_activation",)
"""Channels that are copies of another one."""
WORDS: Mapping[str, tuple[str, ...]] = {ALONE: ("--emg-display-only",), "default": ()}
"""Ways to use EMG, as a user asks for them."""


def measure_channels(folder: Path) -> Iterator[Row]:
    """Correlation of every channel with its muscles, by commands that do not get that channel."""
    yield from (row for recorded in RECORDED for row in held_out(folder, recorded))


def measure_held_out(folder: Path) -> Iterator[Row]:
    """Means over the channels of each recording."""
    for recorded in RECORDED:
        rows = held_out(folder, recorded)
        for way in WORDS:
            r = np.array([row[f"r, {way}"] for row in rows])
            yield {
                "walk": recorded.name,
                "others": way,
                "channels": len(r),
                "correlation, mean": float(r.mean()),
                "correlation, minimum ... maximum": f"{r.min():.2f} ... {r.max():.2f}",
            }


@lru_cache(maxsize=len(RECORDED))
def held_out(folder: Path, recorded: Recorded) -> tuple[Row, ...]:
    """Return a row for each channel.

    It has its correlation with the mean activation of its muscles, later by the delay that others
    have.
    """
    source = folder / recorded.emg
    # The C3D files have another clock than the coordinates.
    emg = implant_emg(folder, source.stem) if source.suffix == ".c3d" else mm.read_sto(source)
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        words = _words(folder, recorded, work)

        def run(left_out: str, way: str) -> Path:
            kept = [
                k
                for k, channel in enumerate(emg.names)
                if channel != left_out and channel not in COPIES
            ]
            table = mm.Table(emg.time, tuple(emg.names[k] for k in kept), emg.values[:, kept])
            mm.write_sto(table, work / "emg.sto")
            out = work / f"{way} {left_out}"
            command("tension", *words, *WORDS[way], "--out", out)
            return out

        (alone,) = mm.load(run("", ALONE)).values()
        rows = []
        for channel in json.loads(alone.facts["emg_muscles"]):
            outs = {way: alone.path.parent if way == ALONE else run(channel, way) for way in WORDS}
            rows.append({"walk": recorded.name} | _channel_row(alone, channel, outs))
    return tuple(rows)


def _words(folder: Path, recorded: Recorded, work: Path) -> tuple[object, ...]:
    """Return the inputs of `tension`; the table of EMG is `emg.sto` in the working folder."""
    files = RECORDINGS[recorded.files]
    model = folder / files.model
    if recorded.mass is not None:
        model = work / "model.osim"
        mm.write_osim(subject_model(folder, files.model, recorded.mass, False), model)
    loads = folder / files.loads
    assigned = loads.with_suffix(".xml")
    return (
        *("--model", model, "--motion", folder / files.motion),
        *recorded.words,
        *("--emg", work / "emg.sto"),
        *("--loads", assigned if assigned.exists() else loads),
    )


def _channel_row(alone: mm.TrialResult, channel: str, outs: Mapping[str, Path]) -> Row:
    """Correlate a channel with its muscles in the results of each way, by way their folder."""
    muscles = json.loads(alone.facts["emg_muscles"])[channel]
    with open(outs["default"] / CHANNEL_TABLE, encoding="utf-8") as lines:
        calibrated = next(csv.DictReader(lines))
    assert alone.emg is not None
    row: Row = {"channel": channel}
    for way, out in outs.items():
        activations = mm.read_sto(out / "activations.sto")
        at = activations.time - float(calibrated["delay_s"])
        measured = np.interp(at, alone.emg.time, alone.emg[channel])
        predicted = np.mean([activations[one] for one in muscles], axis=0)
        # Muscles that never work follow nothing.
        row[f"r, {way}"] = float(np.nan_to_num(_correlation(predicted, measured)))
    return row | {"weight by default": float(calibrated["weight"])}


def measure_calibration(folder: Path) -> Iterator[Row]:
    """Delays, gains and weights by two halves of each walk, and what torques say of them."""
    for walk in (*(make(folder) for make in WALKS), overground(folder, "l")):
        first = _calibrated(walk, walk.calibrated)
        second = _calibrated(walk, walk.tested)
        apart = np.abs(np.log(first.gains / second.gains))
        same = walk.calibrated == walk.tested
        known = first.by_torque
        yield {
            "walk": walk.name,
            "delay [ms]": round(1e3 * float(first.delays[0])),
            "on other frames [ms]": "" if same else round(1e3 * float(second.delays[0])),
            "gains, minimum ... maximum": f"{first.gains.min():.2f} ... {first.gains.max():.2f}",
            "identified by torques": f"{int(known.sum())} of {len(known)}",
            "difference of gains from other frames, median": (
                "" if same else f"{np.median(np.expm1(apart)):.1%}"
            ),
            "difference of gains from other frames, maximum": ""
            if same
            else f"{np.expm1(apart).max():.1%}",
            "weight": first.weight,
            "channels that others mislead": sum("misleads" in text for text in first.warnings),
        }


def _calibrated(walk: Walk, span: tuple[float, float]) -> EmgCalibration:
    motion, torques = walk.part(span)
    trial = EmgTrial(motion=motion, torques=torques, emg=walk.emg)
    return calibrate_emg(walk.model, [trial], walk.channels)


def measure_study(folder: Path) -> Iterator[Row]:
    """Compare activations of one stance of the walk with joint loads.

    They are ours and that study's, against its EMG and each other.
    """
    walk = loaded(folder)
    table = mm.read_sto(folder / "walk-so-jointload-emg/results_SO/results_states.sto")
    motion, torques = replace(walk, every=1).part((10.9, 11.7))
    calibration = _calibrated(walk, walk.calibrated)
    left = [name for name in walk.model.muscle_names if name.endswith("_l")]
    theirs = {
        name: np.interp(motion.time, table.time, table[f"/forceset/{name}/activation"])
        for name in left
    }
    # Without delay: the study's static optimization had none.
    envelopes = {
        name: np.interp(motion.time, walk.emg.time, walk.emg[name]) for name in walk.channels
    }
    targets = emg_targets(
        walk.emg, walk.channels, walk.model, motion.time, EmgOptions(), calibration
    )
    for way, told in {ALONE: None, "default": targets}.items():
        found = mm.solve_tension(walk.model, motion, torques, emg=told)
        ours = {name: found.activation[:, found.muscles.index(name)] for name in left}
        row: Row = {"ours": way, "muscles": len(ours)}
        apart = np.array([ours[name] - theirs[name] for name in ours])
        row["RMS from the study's"] = float(np.sqrt(np.mean(apart**2)))
        both = [_correlation(ours[name], theirs[name]) for name in ours]
        row["correlation with the study's, median"] = float(np.nanmedian(both))
        for label, activations in (("ours", ours), ("theirs", theirs)):
            told_by = [
                _correlation(
                    np.mean([activations[one] for one in muscles], axis=0), envelopes[name]
                )
                for name, muscles in walk.channels.items()
            ]
            row[f"correlation with EMG, {label}, mean"] = float(np.nanmean(told_by))
        yield row


def _correlation(one: Array, other: Array) -> float:
    """Correlation of two signals (frames,) over the frames that both know; NaN where one is flat.

    Tensions are NaN where no plate measures the load of their limb alone.
    """
    known = np.isfinite(one) & np.isfinite(other)
    if not known.any():
        raise ValueError("two signals share no frame that both know")
    kept = one[known], other[known]
    flat = min(np.std(values) for values in kept) < 1e-9
    return float("nan") if flat else float(np.corrcoef(*kept)[0, 1])


def measure_envelopes(folder: Path) -> Iterator[Row]:
    """Compare our envelopes of the raw recording with those that came with it.

    They are by its filters and by ours.
    """
    at = folder / "rajagopal-walk-emg"
    raw = raw_emg(at / "raw/emg_walk_raw.anc")
    table = mm.read_sto(at / "electromyography.sto")
    for label, options in (
        ("band 50 to 500 Hz, low-pass 7.5 Hz, as there", EnvelopeOptions((50.0, 500.0), 7.5)),
        ("default: 20 to 450 Hz, low-pass 6 Hz", EnvelopeOptions()),
    ):
        found = mm.envelopes(raw, options)
        rows = []
        for k, name in enumerate(found.names):
            ours = np.interp(table.time, found.time, found[name])
            theirs = table.values[:, k]
            rows.append((_correlation(ours, theirs), float(np.sqrt(np.mean((ours - theirs) ** 2)))))
        r, rms = np.array(rows).T
        yield {
            "envelope": label,
            "channels": len(rows),
            "correlation, minimum": float(r.min()),
            "correlation, median": float(np.median(r)),
            "RMS, largest": float(rms.max()),
        }
