"""Coverage of measured truth by intervals.

The truth is ground forces of hidden plates, angles by bone pins, and the force that lifts a box.
Studies and commands are those of a user, with all settings and sizes of errors as they are. Only
the comparison reads the measured values.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import myomorph as mm
from benchmarks.accuracy.tension.knee import command
from benchmarks.hands_lift import LIFTS, hands_measured, man, recorded, tracked
from benchmarks.hands_lift_forces import HANDS, holding, plate_on_feet
from benchmarks.hidden_plates import CASES, Hidden, HiddenCase, feet_of, opened
from benchmarks.recordings import read_markers
from myomorph.core.contact.sites import body_sites, foot_sites
from myomorph.core.fit.interval_rule import LEVEL
from myomorph.core.io.loads import write_external_loads
from myomorph.core.io.sto import table_from_motion
from myomorph.core.model.arrays import Array
from myomorph.core.model.contacts import Site
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.uncertainty.spread import FACTORS

Row = dict[str, object]

DRAWS = 60
LASTS = 1.5
"""Of each walk so much is used [s]."""
AXES = {"vertical": 1, "fore-aft": 0, "lateral": 2}
LOADED = 0.05
"""Of the weight: frames in which neither the measured force of a foot nor its upper limit is as
large do not count.
"""
WALKS = tuple(one for one in CASES if one.name.startswith("walk"))
STUDY_FILE = """
[study]
name = "drawn"
flat = true
[uncertainty]
draws = {draws}
contributions = 0
widened = false
[options.{options}
[[subject]]
name = "person"
model = {model!r}
steps = ["ik", {steps}]
trials = [{{ name = "motion", {trial} }}]
"""
"""`options`: those of a step, from its name on."""
ESTIMATED = 'tension]\ncutoff = {:g}\nintervals = 0\nmeasured = "hidden"'

PINS = "shoulder-bonepin"
PIN_MODEL = "subject1_abdbonepin.osim"
PIN_MARKERS = "abdbonepin.trc"
SCAPULA = ("scapula_abduction", "scapula_elevation", "scapula_upward_rot", "scapula_winging")
HUMERUS = ("plane_of_elev", "shoulder_elv", "axial_rot")
PIN_EVERY = 20
"""Of the frames each so many-th is compared."""
PIN_SPAN = (0.0, 19.0)
"""Time in which the arm is raised [s]."""
SUBSETS = {
    "without the blade of the scapula": ("ts", "ai"),
    "without blade and head of the humerus": ("ts", "ai", "gu"),
}
"""Markers that are left out: what cannot be seen on skin."""
NOT_USED = ("ijc",)
"""A marker that the laboratory's own angles leave out."""
NO_SKIN = "".join(f"skin_{one} = 0\n" for one in ("thigh", "shank", "foot", "trunk", "arm"))
SIZES = {
    "usual": "",
    "no movement of skin": NO_SKIN,
    "no movement of skin, no misplaced marker": f"{NO_SKIN}placement = 0\n",
}
"""Sizes of errors that a user states who knows of the pins, and that their landmarks define the
bones.
"""

LIFT_FILE = """
feet = false
measured = "shared"
"""
SITE = """
[[site]]
name = "{name}"
body = "{body}"
points = {points}
group = "{group}"
direction = "{direction}"
grip = {grip}
intervals = {intervals}
"""


@dataclass(frozen=True, eq=False)
class Held:
    """A truth beside what was found of it: values (samples,) each.

    `low`, `high`: limits as drawn.
    """

    truth: Array
    low: Array
    found: Array
    high: Array

    @property
    def apart(self) -> Array:
        """How far the truth lies from the middle of the limits, in half widths."""
        return np.asarray(
            np.abs(self.truth - 0.5 * (self.low + self.high))
            / np.maximum(0.5 * (self.high - self.low), 1e-9)
        )

    def row(self, name: str, unit: str, factor: float = 1.0, scale: float = 1.0) -> Row:
        """Share inside, width, and the range that holds 90 % of the error of the result itself."""
        error = np.quantile(self.found - self.truth, [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL])
        drawn = (
            {}
            if factor == 1.0
            else {f"{name}, inside as drawn [%]": 100.0 * float((self.apart <= 1.0).mean())}
        )
        return drawn | {
            f"{name}, inside [%]": 100.0 * float((self.apart <= factor).mean()),
            f"{name}, width [{unit}]": scale * factor * float((self.high - self.low).mean()),
            f"{name}, 90 % of the error [{unit}]": scale * float(error[1] - error[0]),
        }


def measure_plates(folder: Path) -> Iterator[Row]:
    """Ground forces of walks whose plates are hidden: share inside the limits, and their widths."""
    for case in WALKS:
        weight = opened(folder, case).weight
        row: Row = {"recording": case.name}
        for axis, held in _of_plates(folder, case).items():
            row |= held.row(axis, "% weight", scale=100.0 / weight)
        yield row


def _of_plates(folder: Path, case: HiddenCase) -> Mapping[str, Held]:
    """By axis, forces of both feet in frames in which they carry."""
    hidden = opened(folder, case)
    study = StudyTable(
        table="contact_groups",
        steps='"tension"',
        options=ESTIMATED.format(hidden.cutoff),
        forces='contacts = "auto"',
    )
    tables, frames = drawn(folder, hidden, study)
    time = hidden.motion.time
    parts: dict[str, list[Held]] = {axis: [] for axis in AXES}
    for side, force, _ in feet_of(hidden):
        columns = [_force_column(f"foot_{side[0]}", axis) for axis in AXES.values()]
        low, found, high = [
            np.column_stack([np.interp(time[frames], one.time, one[name]) for name in columns])
            for one in tables
        ]
        carrying = np.maximum(force[frames, 1], high[:, 0]) > LOADED * hidden.weight
        for k, (axis, at) in enumerate(AXES.items()):
            parts[axis].append(
                Held(
                    truth=force[frames, at][carrying],
                    low=low[carrying, k],
                    found=found[carrying, k],
                    high=high[carrying, k],
                )
            )
    return {axis: joined(held) for axis, held in parts.items()}


def _force_column(group: str, axis: int) -> str:
    """Name the column of a force in a table of contact groups."""
    letter = "xyz"[axis]
    return f"{group}_f{letter}"


def joined(parts: Sequence[Held]) -> Held:
    """Values of all parts, one behind the other."""
    return Held(
        truth=np.concatenate([part.truth for part in parts]),
        low=np.concatenate([part.low for part in parts]),
        found=np.concatenate([part.found for part in parts]),
        high=np.concatenate([part.high for part in parts]),
    )


def held_at(time: Array, truth: Array, tables: Sequence[mm.Table], column: str) -> Held:
    """Compare a column of the tables of a study with the truth.

    Parameters
    ----------
    time : (samples,) [s]
    truth : (samples,) measured, in the unit of the column
    tables : lower bounds, values and upper bounds
    column : name of the column

    Returns
    -------
    The truth, and the tables at its times
    """
    low, found, high = tables
    return Held(
        truth=truth,
        low=np.interp(time, low.time, low[column]),
        found=np.interp(time, found.time, found[column]),
        high=np.interp(time, high.time, high[column]),
    )


@dataclass(frozen=True, kw_only=True)
class StudyTable:
    """A table of a study.

    Attributes
    ----------
    table : stem of the table's file
    steps : of the study, as its file has them
    options : further lines of the study file
    forces : entries of the trial that specify its forces
    """

    table: str
    steps: str
    options: str
    forces: str


def drawn(
    folder: Path, hidden: Hidden, study: StudyTable
) -> tuple[tuple[mm.Table, mm.Table, mm.Table], Array]:
    """Run a study of a recording and read the intervals of one of its tables.

    Parameters
    ----------
    folder : of the collection
    hidden : the recording
    study : and its table

    Returns
    -------
    Tables of lower bounds, values and upper bounds, and (frames,) indices of the frames to compare
    """
    case = hidden.case
    time = hidden.motion.time
    used = time[hidden.use]
    start = float(used[0])
    stop = float(min(used[-1], used[0] + LASTS))
    with tempfile.TemporaryDirectory() as work:
        here = Path(work)
        mm.write_osim(hidden.model, here / "model.osim")
        write_external_loads(hidden.raw, here / "loads.sto", here / "loads.xml")
        kind = "motion" if case.tracked else "markers"
        trial = f"{kind} = {str(folder / case.markers)!r}, {study.forces}"
        trial += f", time = [{start}, {stop}]"
        if case.tasks:
            trial += f", tasks = {str(folder / case.tasks)!r}"
        text = STUDY_FILE.format(
            draws=DRAWS,
            options=study.options,
            model="model.osim",
            steps=study.steps,
            trial=trial,
        )
        (here / "study.toml").write_text(text, encoding="utf-8")
        command("run", here / "study.toml", "--out", here / "out")
        tables = limits(next((here / "out").rglob(f"{study.table}.sto")))
    return tables, np.flatnonzero(hidden.use & (time >= start - 1e-6) & (time <= stop + 1e-6))


def limits(path: Path) -> tuple[mm.Table, mm.Table, mm.Table]:
    """Lower limits, values and upper limits of a table that a command wrote."""
    return (
        mm.read_sto(path.with_name(f"{path.stem}_low{path.suffix}")),
        mm.read_sto(path),
        mm.read_sto(path.with_name(f"{path.stem}_high{path.suffix}")),
    )


def measure_pins(folder: Path) -> Iterator[Row]:
    """Measure the coverage of angles of a shoulder by bone pins.

    The angles are estimated from fewer markers. The rows have the widths of the intervals too.
    """
    home = folder / PINS
    factor = FACTORS["coordinate_value"]
    markers = read_markers(home / PIN_MARKERS)
    time, truth = _of_bones(folder, markers)
    for words, left_out in SUBSETS.items():
        kept = _without(markers, (*left_out, *NOT_USED))
        for stated, sizes in SIZES.items():
            with tempfile.TemporaryDirectory() as work:
                here = Path(work)
                mm.write_trc(kept, here / "markers.trc")
                (here / "sizes.toml").write_text(
                    f"{sizes}contributions = 0\nwidened = false\n", encoding="utf-8"
                )
                files = (
                    "--model",
                    home / PIN_MODEL,
                    "--markers",
                    here / "markers.trc",
                    "--out",
                    here / "angles.mot",
                )
                command(
                    "ik",
                    *files,
                    "--time",
                    *PIN_SPAN,
                    "--draws",
                    DRAWS,
                    "--uncertainty",
                    here / "sizes.toml",
                )
                tables = limits(here / "angles.mot")
            held = {name: held_at(time, values, tables, name) for name, values in truth.items()}
            row: Row = {"markers": words, "sizes": stated}
            row |= joined(list(held.values())).row("all", "deg", factor)
            for name, one in held.items():
                shares = one.row("", "deg", factor)
                row[f"{name}: inside [%], width, 90 % of the error [deg]"] = ", ".join(
                    f"{float(shares[key]):.3g}"  # type: ignore[arg-type]
                    for key in (", inside [%]", ", width [deg]", ", 90 % of the error [deg]")
                )
            yield row


def _of_bones(folder: Path, markers: mm.Markers) -> tuple[Array, dict[str, Array]]:
    """Return times, and angles [deg] that the pins of each bone show by themselves.

    Those of the scapula are from its own markers and the thorax's alone, without clavicle and
    humerus. Those of the humerus are from the rotations of scapula and humerus, each of its own
    markers.
    """
    model = mm.read_model(folder / PINS / PIN_MODEL)
    some = np.flatnonzero(markers.time <= PIN_SPAN[1])[::PIN_EVERY]
    shown = replace(markers, time=markers.time[some], values=markers.values[some])
    apart = tuple(one for one in model.markers if one.body in ("thorax", "scapula"))
    alone = mm.inverse_kinematics(
        replace(model, loops=(), markers=apart), _without(shown, NOT_USED)
    ).motion
    found = {name: np.degrees(alone[name]) for name in SCAPULA}
    scapula = _rotations(model, "scapula", shown)
    humerus = _rotations(model, "humerus", shown)
    turned = np.einsum("fji,fjk->fik", scapula, humerus)
    tree = compile_tree(model)
    at = [model.coordinate_names.index(name) for name in HUMERUS]
    bodies = [tree.body_index[name] for name in ("scapula", "humerus")]
    values = np.array(alone.values)

    def apart_from(angles: Array, frame: int) -> Array:
        c = values[frame].copy()
        c[at] = angles
        rotations = forward_kinematics(tree, c[None]).rotations[0, bodies]
        return np.asarray((rotations[0].T @ rotations[1] - turned[frame]).ravel())

    start = values[0, at]
    angles = np.empty((len(some), len(at)))
    for frame in range(len(some)):
        angles[frame] = start = least_squares(apart_from, start, args=(frame,)).x
    return shown.time, found | dict(zip(HUMERUS, np.degrees(angles.T), strict=True))


def _rotations(model: mm.Model, body: str, markers: mm.Markers) -> Array:
    """(frames, 3, 3) of a body from its own markers."""
    own = [one for one in model.markers if one.body == body and one.name not in NOT_USED]
    places = np.array([one.location for one in own])
    seen = markers.values[:, [markers.names.index(one.name) for one in own]]
    places = places - places.mean(axis=0)
    seen = seen - seen.mean(axis=1, keepdims=True)
    return np.array([Rotation.align_vectors(frame, places)[0].as_matrix() for frame in seen])


def _without(markers: mm.Markers, names: tuple[str, ...]) -> mm.Markers:
    kept = [k for k, name in enumerate(markers.names) if name not in names]
    return replace(
        markers, names=tuple(markers.names[k] for k in kept), values=markers.values[:, kept]
    )


def measure_box(folder: Path) -> Iterator[Row]:
    """Measure the coverage of the force of the hands on a box whose mass is known.

    The force is estimated from body and plate. The rows have the widths of the intervals too.
    """
    for lift in LIFTS:
        truth = hands_measured(folder, lift)
        time = man(folder, lift)[1].time
        held = holding(folder, lift)[1].max(axis=1) > 0.0
        low, found, high = _lift_limits(folder, lift, _spans(time, held))
        frames = np.flatnonzero(held)
        clock = time[frames]
        row: Row = {"lift": lift, "frames": len(frames)}
        for axis, at in (("up", 1), ("forward", 0)):
            column = _force_column("hands", at)
            # The sites are on the hands; the box is pushed the other way.
            pushed = Held(
                truth=truth[frames, at],
                low=-np.interp(clock, high.time, high[column]),
                found=-np.interp(clock, found.time, found[column]),
                high=-np.interp(clock, low.time, low[column]),
            )
            row |= pushed.row(axis, "N")
        yield row


def _lift_limits(
    folder: Path, lift: str, spans: list[list[float]]
) -> tuple[mm.Table, mm.Table, mm.Table]:
    """Return intervals of contact forces in a lift by `tension`, the hands holding in some spans.

    The tables are of lower bounds, values and upper bounds.
    """
    model, motion = man(folder, lift)
    with tempfile.TemporaryDirectory() as work:
        here = Path(work)
        mm.write_osim(model, here / "model.osim")
        mm.write_sto(table_from_motion(tracked(folder, lift).motion, model), here / "motion.mot")
        loads = plate_on_feet(recorded(folder, lift), motion.time)
        write_external_loads(loads, here / "plate.sto", here / "plate.xml")
        feet = "".join(_site(one, "feet", '"motion"') for one in foot_sites(model))
        hands = "".join(_site(one, "hands", str(spans)) for one in body_sites(model, HANDS))
        (here / "contacts.toml").write_text(LIFT_FILE + feet + hands, encoding="utf-8")
        sizes = "contributions = 0\nwidened = false\n"
        (here / "sizes.toml").write_text(sizes, encoding="utf-8")
        files = ("--model", here / "model.osim", "--motion", here / "motion.mot")
        contacts = ("--loads", here / "plate.xml", "--contacts", here / "contacts.toml")
        settings = ("--cutoff", 6, "--intervals", 0)
        draws = ("--draws", DRAWS, "--uncertainty", here / "sizes.toml")
        command("tension", *files, *contacts, *settings, *draws, "--out", here / "out")
        return limits(here / "out" / "contact_groups.sto")


def _site(site: Site, group: str, intervals: str) -> str:
    cone = site.cone
    return SITE.format(
        name=site.name,
        body=site.body,
        points=[list(map(float, one)) for one in site.points],
        group=group,
        direction="any" if cone.direction is None else "up",
        grip=cone.grip,
        intervals=intervals,
    )


def _spans(time: Array, held: Array) -> list[list[float]]:
    """Start and end of every run of frames [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], held.astype(int), [0]])))
    return [[float(time[start]), float(time[stop - 1])] for start, stop in edges.reshape(-1, 2)]
