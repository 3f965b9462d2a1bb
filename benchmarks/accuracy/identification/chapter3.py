"""[D] chapter 3 by one study file.

Its steps calibrate, transfer with the motion, identify on many links and predict another motion.
`python -m benchmarks.accuracy.identification.chapter3 SET ...` runs some sets; the tables have
all that were run.
"""

from __future__ import annotations

import csv
import json
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.identification.identification import GAIT, OPENCAP, RAJAGOPAL, RUN
from benchmarks.results import Row, provenance
from data_collection import data_folder
from myomorph.body.identify.subject import GENERIC
from myomorph.body.shape.regions import regions_of
from myomorph.core.io.loads import read_external_loads, write_external_loads
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.trc import write_trc
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Coupler, Joint
from myomorph.lab.report.trial.identification_tables import spine_groups
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from truths.simulated_bodies import many_coordinates
from truths.simulated_engines import SimbodyEngine
from truths.simulated_subject import (
    Instruments,
    Movement,
    exciting_curves,
    middles_and_reaches,
    random_subject,
    record,
    step_curves,
)

MANY = "fullbody-many-muscles/cyclistFullBodyMuscle.osim"
SIMULATED = "simulated"
DURATIONS = (180.0, 167.0)
"""Of the motion that masses are identified from and of the one that is predicted, as in [D] [s]."""
RATE = 50.0  # Frames a second.
SPINE_SPREAD = (0.2, 1.8)
"""By which share of the lowest lumbar joint's bend the other joints of the simulated spine bend, at
random.
"""
RIBS_SPREAD = (0.0, 0.6)

STUDY = """
[study]
name = "chapter 3"
[[subject]]
name = "body"
model = "{model}"
detailed = "{detailed}"
mass = {mass}
steps = ["calibrate", "transfer", "ik", "identify"]
{trials}
[options.id]
force_checks = "report"
[options.calibrate]
{calibrate}
[options.identify]
cutoff = {cutoff}
check = "{check}"
{identify}
"""
TRIAL = """
[[subject.trials]]
name = "{name}"
markers = "{markers}"
loads = "{loads}"
{more}
"""
PAPER = (
    'prior = "paper"\nkeep_mass = false\npoint_floor = 1e-9\nif_worse = "identified"\nmotion_sd ='
    ' 0.0\ncompare = false\nweights = "{}"\nspacing = {}'
)
DEFAULTS = "defaults"
COG = "[D], w_d"
NEAREST = "[D], w_n"
WAYS: Mapping[str, str] = {
    DEFAULTS: "compare = false",
    COG: PAPER.format("cog", 0.038),
    NEAREST: PAPER.format("nearest", 0.038),
}
"""How masses are identified: what the study file says of the step. [D]'s printed masses are
multiples of what a point of a grid of 38 mm weighs, its text says 5 mm.
"""

PRINTED = {
    "identified": (0.32, 0.99, 0.25, 1.04, 1.20, 0.04),
    "shape only": (0.32, 2.75, 9.13, 5.86, 4.21, 2.39),
}
"""[D] figure 3.3: average error of F_x, F_y, F_z [N] and N_x, N_y, N_z [N m]."""
# Share of the body's mass from which on a link's ratio to the generic one says something
LARGE = 0.01
COMPONENTS = {"Fx": "N", "Fy": "N", "Fz": "N", "Nx": "N m", "Ny": "N m", "Nz": "N m"}
SPINE = {
    "Lumbar vertebrae": (0.46, 0.60, 0.60),
    "Rib vertebrae": (0.32, 0.63, 0.42),
    "Neck vertebrae": (0.31, 0.75, 0.63),
}
"""[D] table 3.3: w_d, w_n, shape [kg]."""
SHARES = {
    "Head": (7.79, 7.05, 6.98),
    "Body": (48.88, 50.81, 56.36),
    "Upper arm": (2.77, 3.03, 1.91),
    "Lower arm": (2.69, 2.68, 1.91),
    "Hand": (0.51, 0.51, 0.17),
    "Thigh": (6.36, 5.52, 8.31),
    "Shank": (4.26, 3.67, 2.16),
    "Foot": (2.36, 2.67, 1.00),
    "Upper body": (25.93, 26.36, 23.61),
    "Lower body": (22.95, 24.45, 32.75),
}
"""[D] table 3.4: w_d, w_n, shape [%]."""
TRUNK = {"Upper body": "Upper trunk", "Lower body": "Lower trunk"}


@dataclass(frozen=True)
class Case:
    """A set of recordings.

    `trials`: name to markers, loads, and further keys of the study file; `check`: which is only
    predicted; `truth`: the simulated person.
    """

    name: str
    model: Path
    detailed: Path
    mass: float
    trials: Mapping[str, tuple[Path, Path, str]]
    check: str
    cutoff: float = 6.0
    calibrate: str = ""
    truth: mm.Model | None = None

    def study(self, way: str) -> str:
        """Return the text of the study file."""
        trials = "".join(
            TRIAL.format(name=name, markers=markers, loads=loads, more=more)
            for name, (markers, loads, more) in self.trials.items()
        )
        return STUDY.format(
            model=self.model,
            detailed=self.detailed,
            mass=self.mass,
            trials=trials,
            calibrate=self.calibrate,
            cutoff=self.cutoff,
            check=self.check,
            identify=WAYS[way],
        )


def few_joints(model: mm.Model) -> mm.Model:
    """Weld the joints inside the regions of a model.

    Its regions correspond to those of [D]'s model of few joints.
    """
    regions = regions_of(model)
    gone = set[str]()
    joints = []
    for joint in model.joints:
        inside = joint.parent != GROUND and regions[joint.parent] == regions[joint.child]
        gone |= set(joint.coordinates) if inside else set()
        joints.append(
            Joint(
                name=joint.name,
                kind="WeldJoint",
                parent=joint.parent,
                child=joint.child,
                parent_frame=joint.parent_frame,
                child_frame=joint.child_frame,
            )
            if inside
            else joint
        )
    couplers = tuple(
        one
        for one in model.couplers
        if one.dependent not in gone and not gone & set(one.independents)
    )
    coordinates = tuple(one for one in model.coordinates if one.name not in gone)
    return replace(
        model,
        joints=tuple(joints),
        coordinates=coordinates,
        couplers=couplers,
        muscles=(),
        wrap_objects=(),
    )


def bending_person(model: mm.Model, seed: int = 4) -> mm.Model:
    """Return the 171-coordinate model as a person whose spine bends.

    Every joint of the spine bends with the lowest, each by a share of its own, which no step knows.
    """
    random = np.random.default_rng(seed)
    whole = many_coordinates(model)
    spine = [
        one.name
        for one in whole.coordinates
        if one.name[-3:] in ("_FE", "_LB", "_AR") and "_" in one.name[:-3]
    ]
    lowest = {axis: f"L5_S1{axis}" for axis in ("_FE", "_LB", "_AR")}
    others = [name for name in spine if name not in lowest.values() and "head" not in name]
    couplers = [one for one in whole.couplers if one.dependent not in others]
    for name in others:
        share = random.uniform(*(SPINE_SPREAD if name.startswith("L") else RIBS_SPREAD))
        couplers.append(
            Coupler(
                name=f"{name}_follows",
                dependent=name,
                function=linear(share),
                independents=(lowest[name[-3:]],),
            )
        )
    free = set(others)
    coordinates = tuple(
        replace(one, locked=False, range=(-0.5, 0.5)) if one.name in free else one
        for one in whole.coordinates
    )
    return replace(whole, coordinates=coordinates, couplers=tuple(couplers))


def simulated(folder: Path, data: Path, durations: tuple[float, float] = DURATIONS) -> Case:
    """Files of a simulated person: exciting motion, another motion, both models of the study."""
    model = mm.read_model(data / MANY)
    generic = bending_person(model)
    subject = random_subject(generic)
    engine = SimbodyEngine(subject.person)
    detailed = model.with_markers(generic.markers)
    write_osim(detailed, folder / "detailed.osim")
    write_osim(few_joints(detailed), folder / "few.osim")
    names, middles, reaches = middles_and_reaches(subject.person)
    curves = exciting_curves(middles, reaches), step_curves(middles, reaches, durations[1])
    trials = {}
    for seed, (name, curve, duration) in enumerate(
        zip(("exciting", "other"), curves, durations, strict=True), 5
    ):
        recording = record(
            subject,
            engine,
            Movement(names=names, curves=curve, duration=duration),
            Instruments(rate=RATE, seed=seed),
        )
        write_trc(recording.markers, folder / f"{name}.trc")
        write_external_loads(recording.wrenches, folder / f"{name}.mot", folder / f"{name}.xml")
        trials[name] = (folder / f"{name}.trc", folder / f"{name}.xml", "")
    return Case(
        name=SIMULATED,
        model=folder / "few.osim",
        detailed=folder / "detailed.osim",
        mass=subject.person.mass,
        trials=trials,
        check="other",
        cutoff=4.0,
        calibrate="noise = 0.0",
        truth=subject.person,
    )


def real(data: Path) -> Iterator[Case]:
    """Yield sets of the collection whose model has the regions of a whole body.

    Where there is one recording, it is split in two parts.
    """
    runs = {
        name: (data / RUN / name / "markers.trc", data / RUN / name / "grf.mot", "")
        for name in ("run200", "run500")
    }
    yield Case(
        name="runner",
        model=data / RUN / "unscaled_generic.osim",
        detailed=data / MANY,
        mass=82.0,
        trials=runs,
        check="run500",
    )
    opencap = {
        name: (
            data / OPENCAP / "markers" / f"{name}.trc",
            data / OPENCAP / "grf" / f"{name}_external_forces.xml",
            "",
        )
        for name in ("walking1", "STS1", "DJ1")
    }
    yield Case(
        name="OpenCap",
        model=data / OPENCAP / "models/unscaled_generic.osim",
        detailed=data / MANY,
        mass=62.6,
        trials=opencap,
        check="walking1",
    )
    walk = data / RAJAGOPAL / "markers_walk.trc", data / RAJAGOPAL / "grf_walk.xml"
    yield Case(
        name="walk",
        model=data / RAJAGOPAL / "subject_walk_scaled.osim",
        detailed=data / MANY,
        mass=85.27,
        trials=_parts(*walk, 0.6),
        check="second",
    )
    walk = (
        data / GAIT / "experiment/subject01_walk1.trc",
        data / GAIT / "experiment/subject01_walk1_grf.xml",
    )
    yield Case(
        name="gait2354",
        model=data / GAIT / "ref_scale/std_subject01_simbody.osim",
        detailed=data / MANY,
        mass=72.6,
        trials=_parts(*walk),
        check="second",
    )


def _parts(markers: Path, loads: Path, share: float = 0.5) -> dict[str, tuple[Path, Path, str]]:
    found = mm.read_recording(markers).markers
    assert found is not None
    forces = read_external_loads(loads).time
    start = max(found.time[0], forces[0])
    end = min(found.time[-1], forces[-1])
    middle = start + share * (end - start)
    spans = {"first": (start, middle), "second": (middle, end)}
    return {name: (markers, loads, f"time = [{a:.3f}, {b:.3f}]") for name, (a, b) in spans.items()}


@dataclass(frozen=True)
class Found:
    """Results of a set.

    They are tables of the step `identify` by way and name of the file, those of the step
    `transfer`, and what `identify` noted; `truth`: masses of a simulated person's links [kg].
    """

    tables: Mapping[str, Mapping[str, list[dict[str, str]]]]
    transfer: Mapping[str, list[dict[str, str]]]
    notes: Mapping[str, list[str]]
    truth: Mapping[str, float]


def run(case: Case, folder: Path) -> Found:
    """Run the study once a way; steps before `identify` are reused."""
    tables = {}
    notes = {}
    out = folder / "results"
    for way in WAYS:
        path = folder / "study.toml"
        path.write_text(case.study(way))
        outcomes = run_study(read_plan(path), out)
        wrong = [outcome.error for outcome in outcomes if outcome.error]
        if wrong:
            raise RuntimeError(f"{case.name}, {way}: {wrong[0]}")
        home = out / "body"
        tables[way] = {
            path.name: _rows(path) for path in sorted((home / "identification").glob("*.csv"))
        }
        notes[way] = [
            text for outcome in outcomes for text in outcome.findings if text.startswith("identify")
        ]
    person = case.truth
    truth = {} if person is None else {body.name: body.mass for body in person.bodies}
    return Found(
        tables=tables,
        transfer={path.name: _rows(path) for path in sorted((home / "transfer").glob("*.csv"))},
        notes=notes,
        truth=truth,
    )


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


HOME = Path(tempfile.gettempdir()) / "myomorph_chapter3"
"""Where the sets that were run are kept, by commit, as one takes many minutes."""
SETS = (SIMULATED, "runner", "OpenCap", "walk", "gait2354")


def found(name: str) -> Found:
    """Return the results of a set, run where it was not yet."""
    folder = HOME / provenance()["commit"] / name
    data = data_folder()
    kept = folder / "found.json"
    if not kept.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        case = (
            simulated(folder, data)
            if name == SIMULATED
            else next(one for one in real(data) if one.name == name)
        )
        kept.write_text(json.dumps(asdict(run(case, folder))), encoding="utf-8")
    facts = json.loads(kept.read_text(encoding="utf-8"))
    return Found(
        tables=facts["tables"],
        transfer=facts["transfer"],
        notes=facts["notes"],
        truth=facts["truth"],
    )


def sets() -> Iterator[tuple[str, Found]]:
    """Every set, run where this commit did not yet."""
    for name in SETS:
        yield name, found(name)


def measure_wrenches() -> Iterator[Row]:
    """Compare the base wrench on the motion that was not used, as in [D] figure 3.3.

    The rows have the mean absolute error of each component.
    """
    for name, one in sets():
        for way, tables in one.tables.items():
            for method, errors in _methods(tables).items():
                if way != DEFAULTS and method == GENERIC:
                    continue
                yield (
                    {"set": name, "settings": way, "masses": method}
                    | {
                        f"{component} [{unit}]": float(
                            errors[component]["mean absolute error [N m, N]"]
                        )
                        for component, unit in COMPONENTS.items()
                    }
                    | {
                        "force, RMS [N]": _together(errors, "F"),
                        "moment, RMS [N m]": _together(errors, "N"),
                    }
                )
    for masses, numbers in PRINTED.items():
        yield {"set": "[D] figure 3.3, measured", "settings": "printed", "masses": masses} | {
            f"{component} [{unit}]": number
            for (component, unit), number in zip(COMPONENTS.items(), numbers, strict=True)
        }


def measure_measured() -> Iterator[Row]:
    """Measure errors of the wrench of measured persons on the motion that was not used.

    The rows have the lightest link and the first warning too.
    """
    for case in real(data_folder()):
        if not (HOME / case.name / "found.json").is_file():
            continue
        one = found(case.name)
        row: Row = {
            "set": case.name,
            "used": ", ".join(name for name in case.trials if name != case.check),
            "predicted": case.check,
        }
        for way, tables in one.tables.items():
            row |= _wrench_errors(way, tables)
        for way, tables in one.tables.items():
            row |= _mass_ratios(way, tables)
        for way, notes in one.notes.items():
            row[f"says, {way}"] = next(
                (note.removeprefix("identify: ").split(";")[0] for note in notes), "nothing"
            )
        yield row


def _wrench_errors(way: str, tables: Mapping[str, list[dict[str, str]]]) -> Row:
    """Return errors of force and moment of a way's masses, and once those of the generic ones."""
    row: Row = {}
    for kind, word, unit in (("F", "force", "N"), ("N", "moment", "N m")):
        for label, errors in _methods(tables).items():
            if label == GENERIC and way == DEFAULTS:
                row[f"{word}, generic [{unit}]"] = _together(errors, kind)
            elif label.startswith("identified"):
                row[f"{word}, {way} [{unit}]"] = _together(errors, kind)
    return row


def _mass_ratios(way: str, tables: Mapping[str, list[dict[str, str]]]) -> Row:
    """Return smallest and largest ratio of a large link's mass to the generic one."""
    links = {part["link"]: part for part in tables["masses.csv"]}
    generic = {link: float(part[f"{GENERIC} [kg]"]) for link, part in links.items()}
    large = LARGE * sum(generic.values())
    ratios = {
        link: _identified(links[link]) / mass for link, mass in generic.items() if mass > large
    }
    row: Row = {}
    for end, word in ((min, "smallest"), (max, "largest")):
        link = end(ratios, key=lambda name: ratios[name])
        row[f"{word} of generic, {way}"] = f"{ratios[link]:.2g} ({link})"
    return row


def _methods(tables: Mapping[str, list[dict[str, str]]]) -> dict[str, dict[str, dict[str, str]]]:
    """Errors on the motion that was not used, by method and component."""
    methods: dict[str, dict[str, dict[str, str]]] = {}
    for row in tables["cross_validation.csv"]:
        methods.setdefault(row["method"], {})[row["component"]] = row
    return methods


def _together(errors: Mapping[str, Mapping[str, str]], kind: str) -> float:
    squares = [
        float(row["RMS error [N m, N]"]) ** 2
        for component, row in errors.items()
        if component[0] == kind
    ]
    return float(np.sqrt(sum(squares)))


def measure_masses() -> Iterator[Row]:
    """[D] tables 3.1 and 3.2: mass of every link of the simulated person, with the truth."""
    one = found(SIMULATED)
    by_way = {
        way: {row["link"]: row for row in tables["masses.csv"]}
        for way, tables in one.tables.items()
    }
    for link, mass in one.truth.items():
        default = by_way[DEFAULTS][link]
        low = float(default["90 % interval from [kg]"])
        high = float(default["90 % interval to [kg]"])
        yield {
            "link": link,
            "true [kg]": mass,
            **{f"{way} [kg]": _identified(rows[link]) for way, rows in by_way.items()},
            "shape only, w_n [kg]": float(by_way[NEAREST][link]["shape only [kg]"]),
            "generic, scaled [kg]": float(default["generic, scaled [kg]"]),
            "90 % interval of defaults holds": "yes" if low <= mass <= high else "no",
        }
    totals = {
        way: sum(_identified(rows[link]) for link in one.truth) for way, rows in by_way.items()
    }
    yield {"link": "Total", "true [kg]": sum(one.truth.values())} | {
        f"{way} [kg]": sum_ for way, sum_ in totals.items()
    }


def _identified(row: Mapping[str, str]) -> float:
    return float(next(value for column, value in row.items() if column.startswith("identified")))


def measure_spine() -> Iterator[Row]:
    """[D] table 3.3: population standard deviation of the vertebrae's masses."""
    for name, one in sets():
        for group in one.tables[DEFAULTS]["spine.csv"]:
            rows = {
                way: next(
                    row for row in tables["spine.csv"] if row["link group"] == group["link group"]
                )
                for way, tables in one.tables.items()
            }
            bodies = list(one.truth)
            members = [bodies[index] for index in spine_groups(bodies).get(group["link group"], [])]
            yield {
                "set": name,
                "link group": group["link group"],
                "true [kg]": (
                    float(np.std([one.truth[body] for body in members])) if members else None
                ),
                **{f"{way} [kg]": _identified(row) for way, row in rows.items()},
                "shape only, w_n [kg]": float(rows[NEAREST]["shape only [kg]"]),
            }
    for group, numbers in SPINE.items():
        yield {"set": "[D] table 3.3", "link group": group} | dict(
            zip((f"{COG} [kg]", f"{NEAREST} [kg]", "shape only, w_n [kg]"), numbers, strict=True)
        )


def measure_segments() -> Iterator[Row]:
    """Compare masses of segments of the right side with [D] tables 3.4 and 3.5.

    The rows have shares of the body's mass, and the links of each segment.
    """
    for name, one in sets():
        parts: dict[str, list[str]] = {}
        for row in one.tables[DEFAULTS]["links.csv"]:
            if row["side"] in ("", "right"):
                parts.setdefault(row["segment"].replace("_", " ").capitalize(), []).append(
                    row["link"]
                )
        for index, segment in enumerate(one.tables[DEFAULTS]["segments.csv"]):
            rows = {way: tables["segments.csv"][index] for way, tables in one.tables.items()}
            links = parts.get(segment["segment"], parts.get(TRUNK.get(segment["segment"], ""), []))
            yield {
                "set": name,
                "segment": segment["segment"],
                "athletes [%]": float(segment["athletes (Ae et al. 1992) [%]"]),
                "true [%]": (
                    100.0 * sum(one.truth[link] for link in links) / sum(one.truth.values())
                    if one.truth and links
                    else None
                ),
                **{f"{way} [%]": _share(row) for way, row in rows.items()},
                "shape only, w_n [%]": float(rows[NEAREST]["shape only, right [%]"] or "nan"),
                "links": " ".join(links),
            }
    for segment, shares in SHARES.items():
        yield {"set": "[D] table 3.4", "segment": segment} | dict(
            zip((f"{COG} [%]", f"{NEAREST} [%]", "shape only, w_n [%]"), shares, strict=True)
        )


def _share(row: Mapping[str, str]) -> float:
    return float(
        next(value for column, value in row.items() if column.startswith("identified")) or "nan"
    )


if __name__ == "__main__":
    for chosen in sys.argv[1:]:
        found(chosen)
