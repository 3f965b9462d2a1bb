"""Coverage of intervals: simulated recordings with known truth, and an instrumented knee.

A simulated recording is made with a body, markers and plates that differ from what the user has, by
errors of known sizes. Then a study is run as a user would run it, and its intervals are compared
with the truth.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.intervals.uncertainty_measured import STUDY_FILE, Held, limits
from benchmarks.accuracy.tension.knee import (
    BODY_WEIGHT,
    MODEL,
    PARTS,
    STRIDES,
    STUDY,
    at_times,
    command,
    late_by,
    left_knee,
    measured,
)
from benchmarks.recordings import RECORDINGS
from myomorph.core.fit.interval_rule import LEVEL
from myomorph.core.io.loads import write_external_loads
from myomorph.core.model.arrays import Array
from myomorph.core.model.segments import joint_labels
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.motion.sync import cut
from myomorph.core.rigid.kinematics import marker_positions
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.load_quantities import JOINT_REACTION
from myomorph.core.tension.quantities import MUSCLE_FORCE
from myomorph.core.tension.recruitment import (
    EFFORT_ALONE,
    RecruitmentOptions,
    recruitment_terms,
)
from myomorph.lab.store.results import Stored, read_result
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.inputs.loads import ExternalLoads, LoadsFile
from myomorph.lab.study.inputs.motion import MotionFile
from myomorph.lab.study.trial.steps.drawn_trials import drawn_costs, drawn_criterion
from myomorph.lab.study.trial.steps.ik import recorded_poses
from myomorph.lab.study.trial.trial_inputs import TrialFiles, open_trial
from myomorph.lab.uncertainty.bodies import Draw, drawn_subject
from myomorph.lab.uncertainty.drawn_inputs import drawn_markers, drawn_wrenches
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import Sources
from myomorph.lab.uncertainty.spread import FACTORS

Row = dict[str, object]

HOME = "opencap-subject4-multitask"
MOTIONS = {"walking1": (0.2, 1.2), "STS1": (0.6, 1.8), "DJ1": (0.8, 1.8)}
"""Recordings and the part of each that is used [s]."""
FOUND_ON = ("walking1", "DJ1")
"""Motions on which factors of limits are found; the third is held against them."""
TITLES = {
    "coordinate_value": "angles",
    "generalized_force": "torques",
    "muscle_force": "tensions",
    "joint_reaction": "joint loads",
}
DRAWN = {
    quantity.name: quantity
    for quantity in (COORDINATE_VALUE, GENERALIZED_FORCE, MUSCLE_FORCE, JOINT_REACTION)
}
PEOPLE = 4
DRAWS = 60
SEED = 7
"""Of the truths; the limits are drawn with another one."""
CUTOFF = 6.0
NEGLIGIBLE = 0.01
"""Of the maximum isometric force: where truth and upper limit are below it, a tension is not
counted.
"""
OTHER = replace(
    Sources(),
    skin_thigh=0.016,
    skin_shank=0.01,
    skin_foot=0.006,
    skin_trunk=0.01,
    skin_arm=0.01,
    plate_position=0.01,
)
"""Errors that the limits do not assume: twice the skin movement, plates 10 mm elsewhere."""


def measure_assumed(folder: Path) -> Iterator[Row]:
    """Share of values inside their limits, with errors as assumed."""
    yield from _shares(_simulated(folder, Sources()))


def measure_other(folder: Path) -> Iterator[Row]:
    """Measure the same with errors that the intervals do not assume."""
    yield from _shares(_simulated(folder, OTHER))


def measure_factors(folder: Path) -> Iterator[Row]:
    """By how much limits have to be widened, found on some motions."""
    kinds = {
        "errors as assumed": _simulated(folder, Sources()),
        "other errors": _simulated(folder, OTHER),
    }
    for table, title in TITLES.items():
        row: Row = {"limits of": title}
        for name, apart in kinds.items():
            row[f"factor, {name}"] = _factor([apart[motion][table] for motion in FOUND_ON])
        row["factor, both"] = _factor(
            [apart[motion][table] for apart in kinds.values() for motion in FOUND_ON]
        )
        yield row | {"factor of the package": FACTORS[table]}


@lru_cache(maxsize=2)
def _simulated(folder: Path, errors: Sources) -> dict[str, dict[str, tuple[Array, ...]]]:
    """Return how far from the middle of its interval the truth lies, in half widths.

    The values are of each person, by motion and table.
    """
    found: dict[str, dict[str, tuple[Array, ...]]] = {}
    for motion in MOTIONS:
        people = [distances_from_limits(folder, motion, errors, person) for person in range(PEOPLE)]
        found[motion] = {table: tuple(one[table] for one in people) for table in TITLES}
    return found


def _shares(apart: dict[str, dict[str, tuple[Array, ...]]]) -> Iterator[Row]:
    everything = {
        table: tuple(one for motion in apart.values() for one in motion[table]) for table in TITLES
    }
    for name, tables in {**apart, "all": everything}.items():
        row: Row = {"inside the limits of 90 % [%]": name}
        for table, title in TITLES.items():
            row |= {
                title: _inside(tables[table], 1.0),
                f"{title}, widened": _inside(tables[table], FACTORS[table]),
            }
        yield row


def _inside(people: tuple[Array, ...], factor: float) -> float:
    """Share of values inside limits that are widened [%], every person alike."""
    return 100.0 * float(np.mean([(one <= factor).mean() for one in people]))


def _factor(groups: list[tuple[Array, ...]]) -> float:
    """Return the least factor by which intervals hold 90 % of the values."""
    return max(
        1.0, float(np.quantile(np.concatenate([one for people in groups for one in people]), LEVEL))
    )


def distances_from_limits(
    folder: Path, motion: str, errors: Sources, person: int, seed: int = SEED
) -> dict[str, Array]:
    """Run the study of a simulated recording and compare its limits with the truth.

    Parameters
    ----------
    folder : of the data
    motion : among `MOTIONS`
    errors : sizes of what differs between user's model and truth
    person : number of the draw that is the truth
    seed : of the truths

    Returns
    -------
    by table, distances of the truth from the middle of the limits in half widths, so that limits
    hold what is at most 1
    """
    model, moved, wrenches = _recorded(folder, motion, MOTIONS[motion])
    draw = Draw(person, errors, Normals(PEOPLE * len(MOTIONS), seed))
    body = drawn_subject(model, draw)
    truth = _truth(model, body, mm.differentiate(moved, None), wrenches, draw)
    with tempfile.TemporaryDirectory() as work:
        here = Path(work)
        mm.write_trc(
            drawn_markers(body, marker_positions(body, moved), draw, {}), here / "markers.trc"
        )
        write_external_loads(
            drawn_wrenches(wrenches, model.up, draw), here / "loads.sto", here / "loads.xml"
        )
        text = STUDY_FILE.format(
            draws=DRAWS,
            trial='markers = "markers.trc", loads = "loads.xml"',
            options='tension]\nreactions = "child"',
            steps='"id", "tension"',
            model=str(folder / HOME / "models" / "manually_scaled.osim"),
        )
        (here / "study.toml").write_text(text, encoding="utf-8")
        command("run", here / "study.toml", "--out", here / "out")
        found = read_result(next((here / "out").rglob("motion.nc")))
    frames = np.searchsorted(found.time, moved.time - 1e-6)
    apart = {}
    for table, (names, values) in truth.items():
        low, high = _bounds(found, table, names, frames)
        if table == "muscle_force":
            strengths = np.array([model.muscle(name).max_isometric_force for name in names])
            counted = np.maximum(values, high) > NEGLIGIBLE * strengths
        else:
            counted = (high - low) > 1e-9
        apart[table] = _half_widths(values, low, high)[counted]
    return apart


def _half_widths(values: Array, low: Array, high: Array) -> Array:
    """Return how far values are from the middle of their interval, in half widths."""
    return np.abs(values - 0.5 * (low + high)) / np.maximum(0.5 * (high - low), 1e-12)


def _bounds(
    found: Stored, table: str, names: Sequence[str], frames: np.ndarray
) -> tuple[Array, Array]:
    """Return lower and upper bounds (frames, names) of columns of a result."""
    columns = found.names[DRAWN[table].dims[1]]
    at = [columns.index(name) for name in names]
    low = found.values[f"{table}_low"][frames][:, at]
    high = found.values[f"{table}_high"][frames][:, at]
    return low, high


def _recorded(
    folder: Path, motion: str, span: tuple[float, float]
) -> tuple[mm.Model, mm.Motion, mm.Wrenches]:
    """Return a model, a smooth motion without derivatives, and the forces on it.

    Each force is on the foot that it acts on.
    """
    home = folder / HOME
    coordinates = MotionFile(home / "ik_manual_scaling" / f"{motion}_ik.mot")
    forces = LoadsFile(home / "grf" / f"{motion}_external_forces.xml")
    trial = open_trial(
        TrialFiles(home / "models" / "manually_scaled.osim", inputs=ByType(coordinates, forces)), {}
    )
    poses = recorded_poses(trial)
    loads = trial.inputs[ExternalLoads]
    model = trial.model
    given = poses.recorded
    wrenches = loads.of(given)
    start = max(given.time[0], wrenches.time[0])
    end = min(given.time[-1], wrenches.time[-1])
    smooth = mm.differentiate(given, CUTOFF)
    used = cut(
        mm.Motion(smooth.time, smooth.names, smooth.values), max(start, span[0]), min(end, span[1])
    )
    return model, used, mm.resample_wrenches(wrenches, used.time, CUTOFF)


def _truth(
    model: mm.Model, body: mm.Model, moved: mm.Motion, wrenches: mm.Wrenches, draw: Draw
) -> dict[str, tuple[tuple[str, ...], Array]]:
    """Return the truth of a body that the user does not know, by table: columns and values."""
    torques = mm.inverse_dynamics(body, moved, wrenches)
    options = drawn_criterion(mm.TensionOptions(), draw)
    costs = drawn_costs(RecruitmentOptions().settled(body, options, external=True), draw)
    terms = recruitment_terms(body, moved, torques, wrenches, costs)
    tension = mm.solve_tension(body, moved, torques, options, recruitment=EFFORT_ALONE, terms=terms)
    loads = mm.joint_reactions(body, moved, tension, wrenches).table(joint_labels(body))
    driven = {one.dependent for one in model.couplers}
    free = tuple(one.name for one in model.coordinates if not one.locked and one.name not in driven)
    sizes = tuple(name for name in loads.names if name.endswith("_force"))
    return {
        "coordinate_value": (free, np.column_stack([moved[name] for name in free])),
        "generalized_force": (free, np.column_stack([torques[name] for name in free])),
        "muscle_force": (tension.muscles, tension.muscle_force),
        "joint_reaction": (sizes, np.column_stack([loads[name] for name in sizes])),
    }


def measure_knee(folder: Path) -> Iterator[Row]:
    """Measure the coverage of the measured force of the knee, in the samples of both strides.

    The implant's clock is its own: the last column has the total moved by the delay that fits the
    other stride best.
    """
    factor = FACTORS["joint_contact_load"]
    every = {stride: _knee_limits(folder, stride) for stride in STRIDES}
    late = {stride: late_by(folder, stride, found) for stride, (_, found, _) in every.items()}
    for stride, tables in every.items():
        truth, clock = measured(folder, stride)
        row: Row = {"stride": stride}
        for k, part in enumerate(PARTS):
            low, found, high = tables
            low = at_times(low, clock)[:, k]
            found = at_times(found, clock)[:, k]
            high = at_times(high, clock)[:, k]
            row |= Held(truth=truth[:, k], low=low, found=found, high=high).row(
                part, "BW", factor, 1.0 / BODY_WEIGHT
            )
        (other,) = set(STRIDES) - {stride}
        low, found, high = tables
        low = at_times(low, clock - late[other])[:, 0]
        found = at_times(found, clock - late[other])[:, 0]
        high = at_times(high, clock - late[other])[:, 0]
        inside = Held(truth=truth[:, 0], low=low, found=found, high=high).apart <= factor
        yield row | {"total, on the other stride's clock, inside [%]": 100.0 * float(inside.mean())}


def _knee_limits(folder: Path, stride: str) -> tuple[mm.Series, mm.Series, mm.Series]:
    """Lower limits, values and upper limits of the left knee's forces [N], by a user's command."""
    here = folder / STUDY
    with tempfile.TemporaryDirectory() as work:
        out = Path(work) / "out"
        sizes = Path(work) / "sizes.toml"
        sizes.write_text("contributions = 0\nwidened = false\n", encoding="utf-8")
        files = ("--model", here / MODEL, "--motion", here / f"{stride}_ik.mot")
        points = ("--contact-points", "auto", "--draws", 200, "--uncertainty", sizes)
        command("tension", *files, "--loads", here / f"{stride}_grf.xml", *points, "--out", out)
        low, found, high = map(left_knee, limits(out / "joint_contact_forces.sto"))
    return low, found, high


LIVE_DRAWS = 40
LIVE = (COORDINATE_VALUE, GENERALIZED_FORCE, MUSCLE_FORCE)


def measure_live(folder: Path) -> Iterator[Row]:
    """Compare standard deviations of both, of a recorded walk."""
    files = {
        name: str(folder / getattr(RECORDINGS["rajagopal"], name))
        for name in ("model", "markers", "loads")
    }
    with tempfile.TemporaryDirectory() as work:
        here = Path(work)
        words = [word for name, path in files.items() for word in (f"--{name}", path)]
        command("live", *words, "--speed", 0, "--draws", LIVE_DRAWS, "--out", here / "live")
        study = {"options": "id]\ncutoff = 6", "steps": '"id", "tension"', "model": files["model"]}
        trial = f"markers = {files['markers']!r}, loads = {files['loads']!r}"
        (here / "study.toml").write_text(
            STUDY_FILE.format(draws=LIVE_DRAWS, trial=trial, **study), encoding="utf-8"
        )
        command("run", here / "study.toml", "--out", here / "out")
        live = read_result(here / "live" / "live.nc")
        whole = read_result(next((here / "out").rglob("motion.nc")))
    for quantity in LIVE:
        words = {"limits of": TITLES[quantity.name]}
        yield words | _compared(quantity.name, quantity.dims[1], live, whole)


def _compared(table: str, dimension: str, live: Stored, whole: Stored) -> Row:
    """Ratios of columns above a hundredth of the table's largest standard deviation."""
    names = [one for one in whole.names[dimension] if one in live.names[dimension]]
    own = [live.names[dimension].index(one) for one in names]
    other = [whole.names[dimension].index(one) for one in names]
    known = np.isfinite(live.values[f"{table}_sd"]).all(axis=1)
    inside = (whole.time >= live.time[known][0]) & (whole.time <= live.time[known][-1])
    found = np.sqrt((live.values[f"{table}_sd"][known][:, own] ** 2).mean(axis=0))
    expected = np.sqrt((whole.values[f"{table}_sd"][inside][:, other] ** 2).mean(axis=0))
    counted = expected > 0.01 * expected.max()
    ratios = found[counted] / expected[counted]
    furthest = int(np.argmax(np.abs(np.log(ratios))))
    return {
        "columns": int(counted.sum()),
        "mean ratio": float(ratios.mean()),
        "within 10 % [%]": 100.0 * float((np.abs(ratios - 1.0) <= 0.1).mean()),
        "within 20 % [%]": 100.0 * float((np.abs(ratios - 1.0) <= 0.2).mean()),
        "furthest": np.array(names)[counted][furthest],
        "its ratio": float(ratios[furthest]),
    }
