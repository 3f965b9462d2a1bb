"""The force in a man's instrumented knee.

It is measured, and estimated by OpenSim's static optimization and by `myomorph tension`. Nothing
here is fitted to the measured force. Two strides of the fifth Grand Challenge to Predict In Vivo
Knee Loads (Fregly et al. 2012), with the coordinates and models of Modenese et al. (2021).
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import myomorph as mm
from benchmarks.errors import rms
from myomorph.core.io.formats import read_trial
from myomorph.core.io.loads import read_external_loads, write_external_loads
from myomorph.core.io.sto import table_from_motion
from myomorph.core.model.arrays import Array
from myomorph.core.motion.cutoff_choice import choose_cutoff
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.cli import main
from myomorph.lab.study.inputs.contact_points import contact_points

if TYPE_CHECKING:
    from benchmarks.opensim_static import StaticResult

Row = dict[str, object]

STUDY = "knee-implant-walk"
MODEL = "nominal.osim"
GENERIC = "rajagopal-walk-emg/raw/Rajagopal2016.osim"
JOINT = "walker_knee_l"
STRIDES = ("walk1", "walk3")
BODY_WEIGHT = 735.75
"""Of the man [N]."""
CUTOFF = 6.0
"""Of coordinates and ground forces on both sides, as the study's [Hz]."""
PARTS = ("total", "medial", "lateral")
CHANNELS = {
    "gracilis": ("grac_l",),
    "semimem": ("semimem_l",),
    "bifeml": ("bflh_l",),
    "vasmed": ("vasmed_l",),
    "vaslat": ("vaslat_l",),
    "rf": ("recfem_l",),
    "medgas": ("gasmed_l",),
    "latgas": ("gaslat_l",),
    "tfl": ("tfl_l",),
    "tibant": ("tibant_l",),
    "peronl": ("perlong_l",),
    "soleus": ("soleus_l",),
    "addmag": ("addmagMid_l", "addmagProx_l", "addmagDist_l", "addmagIsch_l"),
    "gmax": ("glmax1_l", "glmax2_l", "glmax3_l"),
    "gmed": ("glmed1_l", "glmed2_l", "glmed3_l"),
    "sartorius": ("sart_l",),
}
"""Channels of the recordings, all on the left leg, and the muscles of the model under them."""


@dataclass(frozen=True)
class Way:
    """One way to ask for the tensions.

    `settings`: of `myomorph tension`, beside the files and `--contact-points auto`; `emg`: whether
    EMG is given; `own_angles`: coordinates by `myomorph ik` from the markers instead of the
    study's; `personal`: the model as `myomorph personalize` fits it to the other stride; `model`:
    of the data set.
    """

    name: str
    settings: tuple[str, ...] = ()
    emg: bool = False
    own_angles: bool = False
    personal: bool = False
    model: str = MODEL


AT_6_HZ = ("--cutoff", f"{CUTOFF:g}")
ELASTIC = ("--tendons", "elastic")
ACTIVE = (*ELASTIC, "--no-passive")
SHARED = ("--contacts", "auto", "--measured", "shared", "--intervals", "0")
WAYS = (
    Way("default"),
    Way("default, but 6 Hz", AT_6_HZ),
    Way("activations from the model's 0.01", ("--min-activation", "model")),
    Way("passive muscle force on rigid tendons", ("--passive",)),
    Way("effort alone, no loads of knees", ("--joint-load", "0")),
    Way("curves as OpenSim's static optimization", ("--curves", "opensim")),
    Way("loads of all joints", ("--joint-load", "0.02", "--joint-load-joints", "all")),
    Way("knee contact 0.2", ("--knee-contact", "0.2")),
    Way("passive hips", ("--joint-tissue", "hips")),
    Way("passive legs", ("--joint-tissue", "legs")),
    Way("exponent 1.5", ("--exponent", "1.5")),
    Way("exponent 3", ("--exponent", "3")),
    Way("weights by volume", ("--weights", "volume")),
    Way("min/max", ("--recruitment", "minmax")),
    Way("plates shared by both feet", SHARED),
    Way("plates shared, EMG", SHARED, emg=True),
    Way("plates shared, personalized", SHARED, personal=True),
    Way("own joint angles", own_angles=True),
    Way("EMG", emg=True),
    Way("elastic tendons", ELASTIC),
    Way("elastic tendons, no passive force", ACTIVE),
    Way("elastic tendons, EMG", ELASTIC, emg=True),
    Way("personalized", personal=True),
    Way("personalized, elastic tendons", ELASTIC, personal=True),
    Way("personalized, elastic tendons, no passive force", ACTIVE, personal=True),
    Way("personalized, elastic tendons, EMG", ELASTIC, emg=True, personal=True),
)
"""Rows of the table; what a way needs beside `settings` is a field of `Way`."""


def measure(folder: Path, ways: tuple[Way, ...] = WAYS) -> Iterator[Row]:
    """Measure the distance of the estimated force from the measured one: OpenSim's, then ours.

    The rows are of both strides and their mean.
    """
    for name, cutoff, smooth in (
        ("OpenSim 4.6 as the study: coordinates 6 Hz, loads as recorded", CUTOFF, False),
        ("OpenSim 4.6, coordinates and loads 6 Hz", CUTOFF, True),
        ("OpenSim 4.6, coordinates and loads filtered as by our default", None, True),
    ):
        found = [
            opensim_loads(folder, stride, cutoff or own_cutoff(folder, stride), smooth)
            for stride in STRIDES
        ]
        yield _row(name, found, folder)
    for way in ways:
        yield _row(way.name, [our_loads(folder, stride, way) for stride in STRIDES], folder)


def own_cutoff(folder: Path, stride: str) -> float:
    """Low pass that `myomorph tension` takes for a stride where none is given [Hz]."""
    model, motion = inputs_of(folder, stride)[:2]
    found = choose_cutoff(motion, model).cutoff
    assert found is not None
    return found


def measure_peaks(folder: Path) -> Iterator[Row]:
    """Greatest forces of each stride, measured and by default."""
    for stride in STRIDES:
        truth, clock = measured(folder, stride)
        yield _peaks(stride, "measured", truth / BODY_WEIGHT)
        for way in (WAYS[0], WAYS[1]):
            loads = our_loads(folder, stride, way)
            yield _peaks(stride, way.name, at_times(loads, clock) / BODY_WEIGHT)


def measure_cutoffs(folder: Path) -> Iterator[Row]:
    """How far the low-pass filter moves the result; nothing is chosen by it."""
    for cutoff in ("0", "3", "4", "6", "8", "10", "15"):
        way = Way(f"{cutoff} Hz" if cutoff != "0" else "none", ("--cutoff", cutoff))
        yield {"low pass": way.name} | _numbers(
            [our_loads(folder, stride, way) for stride in STRIDES], folder
        )


def measure_where(folder: Path) -> Iterator[Row]:
    """Measure by which part of the stride the error of the default comes.

    The rows have what a delay between the clocks would explain.
    """
    for stride in STRIDES:
        truth, clock = measured(folder, stride)
        loads = our_loads(folder, stride, WAYS[1])
        error = (at_times(loads, clock) - truth)[:, 0] / BODY_WEIGHT
        share = [float((error[first:last] ** 2).sum() / (error**2).sum()) for first, last in PHASES]
        worst = int(np.argmax(np.abs(error)))
        best = late_by(folder, stride, loads)
        yield {
            "stride": stride,
            "RMS [BW]": rms(error),
            **{
                f"share of {a} to {b - 1} %": one for (a, b), one in zip(PHASES, share, strict=True)
            },
            "largest error [BW]": float(error[worst]),
            "at [%]": worst,
            "measured force later by [ms]": round(1e3 * best),
            "RMS then [BW]": rms((at_times(loads, clock - best) - truth)[:, 0] / BODY_WEIGHT),
            "center of pressure behind the heel [mm]": behind_heel(folder, stride),
        }


DELAYS = tuple(np.arange(-60, 61, 5) / 1e3)
"""Of the measured force that are tried [s]."""
PHASES = ((0, 15), (15, 55), (55, 75), (75, 101))
"""Loading, the foot flat, push-off, swing: samples of the stride."""


def behind_heel(folder: Path, stride: str) -> float:
    """Return how far the plate's center of pressure lies behind the heel's body at most [mm].

    Only frames count in which it bears 100 N or more.
    """
    model, motion, wrenches = inputs_of(folder, stride)
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    b = tree.body_index["calcn_l"]
    seen = np.einsum(
        "fji,fj->fi", poses.rotations[:, b], wrenches.points[:, 0] - poses.origins[:, b]
    )
    return 1e3 * max(0.0, float(-seen[wrenches.forces[:, 0, 1] > 100.0, 0].min()))


def measured(folder: Path, stride: str) -> tuple[Array, Array]:
    """Read the measured force and its times.

    Parameters
    ----------
    folder : of the collection
    stride : name of the recording

    Returns
    -------
    (101, 3) total, medial and lateral force [N], and (101,) times [s]
    """
    table = np.loadtxt(folder / STUDY / f"{stride}_knee_force.csv", delimiter=",", skiprows=1)
    return table[:, [3, 1, 2]], table[:, 0]


def our_loads(folder: Path, stride: str, way: Way) -> mm.Series:
    """Total, medial and lateral force of the left knee by `myomorph tension`."""
    return _our_loads(folder, stride, way)


@cache
def _our_loads(folder: Path, stride: str, way: Way) -> mm.Series:
    here = folder / STUDY
    with tempfile.TemporaryDirectory() as work:
        out = Path(work) / "out"
        motion = here / f"{stride}_ik.mot"
        model = here / way.model
        if way.own_angles:
            motion = Path(work) / "ik.mot"
            told = ("--markers", here / f"{stride}.trc", "--tasks", here / "ik_tasks.xml")
            command("ik", "--model", model, *told, "--out", motion)
        if way.personal:
            model = personal_model(folder, stride, model, Path(work))
        emg = ("--emg", write_emg(folder, stride, Path(work))) if way.emg else ()
        files = ("--model", model, "--motion", motion, "--loads", here / f"{stride}_grf.xml", *emg)
        command("tension", *files, "--contact-points", "auto", "--out", out, *way.settings)
        return left_knee(mm.read_sto(out / "joint_contact_forces.sto"))


def personal_model(folder: Path, stride: str, model: Path, work: Path) -> Path:
    """Return the model fitted to the other stride.

    The fit never sees this stride and never a measured knee force.
    """
    other = next(one for one in STRIDES if one != stride)
    here = folder / STUDY
    out = work / "personal.osim"
    files = (
        "--model",
        model,
        "--motion",
        here / f"{other}_ik.mot",
        "--loads",
        here / f"{other}_grf.xml",
    )
    emg = ("--emg", write_emg(folder, other, work))
    command("personalize", *files, *emg, "--generic", folder / GENERIC, "--out", out)
    return out


def command(*words: object) -> None:
    """Run a command of the program quietly; raises `RuntimeError` where it fails."""
    with (
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()) as told,
    ):
        status = main([str(one) for one in words])
    if status:
        raise RuntimeError(f"myomorph {' '.join(map(str, words))}: {told.getvalue()}")


def left_knee(table: mm.Series) -> mm.Series:
    """Total, medial and lateral force of the instrumented knee."""
    return mm.Series(
        table.time, PARTS, np.column_stack([table[f"{part}_{JOINT}"] for part in PARTS])
    )


def write_emg(folder: Path, stride: str, work: Path) -> Path:
    """Raw EMG by the muscles' names, on the clock of the study's coordinates."""
    raw = raw_emg(folder, stride)
    pairs = [(channel, muscle) for channel, muscles in CHANNELS.items() for muscle in muscles]
    path = work / f"{stride}_emg.sto"
    columns = np.column_stack([raw[channel] for channel, _ in pairs])
    mm.write_sto(mm.Table(raw.time, tuple(muscle for _, muscle in pairs), columns), path)
    return path


def raw_emg(folder: Path, stride: str) -> mm.Series:
    """Raw EMG by channel on the study's clock, which starts at the foot strike."""
    analog = read_trial(folder / STUDY / f"{stride}.c3d").analog
    assert analog is not None
    with open(folder / STUDY / f"{stride}.trc", encoding="utf-8") as lines:
        head = [next(lines).split() for _ in range(3)]
    told = dict(zip(head[1], head[2], strict=True))
    start = (float(told["OrigDataStartFrame"]) - 1.0) / float(told["OrigDataRate"])
    return mm.Series(
        analog.time - start,
        tuple(CHANNELS),
        np.column_stack([analog[channel] for channel in CHANNELS]),
    )


def inputs_of(folder: Path, stride: str) -> tuple[mm.Model, mm.Motion, mm.Wrenches]:
    """Return model, coordinates and loads at their times, not filtered.

    Coordinates that couplers drive are corrected. The study's tables have the patella's coordinate
    in degrees, and OpenSim 4 takes a coordinate that is neither an angle nor a length unchanged.
    """
    here = folder / STUDY
    model = mm.read_model(here / MODEL)
    given = mm.read_motion(here / f"{stride}_ik.mot", model)
    motion = mm.Motion(
        given.time, model.coordinate_names, compile_tree(model).coordinates_of(given)
    )
    return (
        model,
        motion,
        mm.resample_wrenches(read_external_loads(here / f"{stride}_grf.xml"), motion.time),
    )


@cache
def opensim_loads(folder: Path, stride: str, cutoff: float, smooth: bool) -> mm.Series:
    """Return the force of the left knee by OpenSim's StaticOptimization and JointReaction.

    It is shared among our contact points. OpenSim's tool filters the coordinates; the loads are as
    recorded, or filtered as ours. The reserves are the model's own.
    """
    model, motion, _ = inputs_of(folder, stride)
    static, total, wrenches = _static_reaction(folder, stride, cutoff, smooth)
    # Their times are rounded: ours lie within the recording.
    at = np.clip(static.time, motion.time[0], motion.time[-1])
    points = contact_points("auto", model)
    assert points is not None
    shared = mm.joint_contact_forces(
        model,
        _at(mm.differentiate(motion, cutoff), at),
        mm.Series(at, static.names, static.forces),
        mm.resample_wrenches(wrenches, at),
        [one for one in points.points if one.joint == JOINT],
        patella="string",
    )
    values = [
        np.interp(at, total.time, total.values[:, 0]),
        shared.of(JOINT, "medial"),
        shared.of(JOINT, "lateral"),
    ]
    return mm.Series(at, PARTS, np.column_stack(values))


def _static_reaction(
    folder: Path, stride: str, cutoff: float, smooth: bool
) -> tuple[StaticResult, mm.Series, mm.Wrenches]:
    """Return OpenSim's tensions, its total force on the knee [N], and the loads that it read."""
    # OpenSim is wanted here alone.
    from benchmarks.opensim_static import AnalyzeInputs, reaction_force, static_optimization

    model, motion, _ = inputs_of(folder, stride)
    loads = folder / STUDY / f"{stride}_grf.xml"
    with tempfile.TemporaryDirectory() as work:
        if smooth:
            filtered = mm.resample_wrenches(read_external_loads(loads), motion.time, cutoff=cutoff)
            loads = Path(work) / "loads.xml"
            write_external_loads(filtered, Path(work) / "loads.sto", loads)
        table = Path(work) / "motion.sto"
        mm.write_sto(table_from_motion(motion, model, degrees=False), table)
        inputs = AnalyzeInputs(
            model=folder / STUDY / MODEL, motion=table, loads=loads, cutoff=cutoff
        )
        static = static_optimization(inputs, 0.0, float(motion.time[-1]))
        clock, force = reaction_force(inputs, static, JOINT)
        wrenches = read_external_loads(loads)
    total = np.linalg.norm(force, axis=1)[:, None]
    return static, mm.Series(clock, ("total",), total), wrenches


def _at(motion: mm.Motion, time: Array) -> mm.Motion:
    """Return a motion with derivatives at times next to its frames."""
    return replace(motion.frames(np.abs(motion.time[:, None] - time).argmin(axis=0)), time=time)


def at_times(loads: mm.Series, time: Array) -> Array:
    """Interpolate loads between frames.

    Parameters
    ----------
    loads : (frames, 3) total, medial and lateral [N]
    time : (samples,) [s]

    Returns
    -------
    (samples, 3) [N]
    """
    return np.column_stack([np.interp(time, loads.time, column) for column in loads.values.T])


def _numbers(found: list[mm.Series], folder: Path) -> Row:
    row: Row = {}
    each = []
    for stride, loads in zip(STRIDES, found, strict=True):
        truth, clock = measured(folder, stride)
        ours = at_times(loads, clock)
        each.append(
            [
                (
                    rms(ours[:, k] - truth[:, k]) / BODY_WEIGHT,
                    float(np.corrcoef(ours[:, k], truth[:, k])[0, 1]),
                )
                for k in range(3)
            ]
        )
    for k, part in enumerate(PARTS):
        row |= {f"{part} {stride}": one[k][0] for stride, one in zip(STRIDES, each, strict=True)}
        row[f"{part}, mean"] = float(np.mean([one[k][0] for one in each]))
        row[f"r of {part}"] = float(np.mean([one[k][1] for one in each]))
    row["total, clock by the other stride"] = float(np.mean(_on_the_others_clock(found, folder)))
    return row


def _on_the_others_clock(found: list[mm.Series], folder: Path) -> list[float]:
    """Return the RMS of the total in each stride, moved in time [BW].

    The delay is the one at which the total fits the other stride best.
    """
    errors = []
    best = [late_by(folder, stride, loads) for stride, loads in zip(STRIDES, found, strict=True)]
    for stride, loads, late in zip(STRIDES, found, best[::-1], strict=True):
        truth, clock = measured(folder, stride)
        errors.append(rms((at_times(loads, clock - late) - truth)[:, 0] / BODY_WEIGHT))
    return errors


def late_by(folder: Path, stride: str, loads: mm.Series) -> float:
    """Delay of the measured force at which the total fits it best [s]."""
    truth, clock = measured(folder, stride)
    return min(DELAYS, key=lambda late: rms((at_times(loads, clock - late) - truth)[:, 0]))


def _row(name: str, found: list[mm.Series], folder: Path) -> Row:
    return {"RMS of the force [BW]": name} | _numbers(found, folder)


def _peaks(stride: str, name: str, values: Array) -> Row:
    row: Row = {"stride": stride, "force": name}
    for k, part in enumerate(PARTS):
        early = values[:35, k]
        late = values[35:75, k]
        row |= {
            f"{part}, first peak [BW]": float(early.max()),
            f"{part}, second peak [BW]": float(late.max()),
        }
    return row
