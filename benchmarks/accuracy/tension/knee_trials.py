"""Four trials of another man's instrumented right knee, by `myomorph tension`.

A normal walk, two retrained ones (bouncy; medial thrust with poles) and a fast walk on a treadmill,
with the model, coordinates and plates of the public repository gilserrancoli/ReducePoly_forMSK.
Nothing here is fitted to the measured force.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import scipy

import myomorph as mm
from benchmarks.accuracy.tension.knee import PARTS, command
from benchmarks.errors import rms
from benchmarks.results import Row
from myomorph.core.model.arrays import Array
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.tree import compile_tree

FOLDER = "reducepoly-knee"
"""Of the data collection: a clone of the repository."""
RECORDED = Path("ExampleTrackingSimulations/OpenSimModel/subject_GC")
GENERAL_MODEL = Path(
    "MuscleTendonLengthParameterizationReduction",
    "JW All Body Model-scaled_forvisualization_leftright_v42.osim",
)
POUND = 4.4482216
"""Of force [N]."""
KNEE = "knee"
KNEES = "knee_flexion,knee_flexion_l"
WITH_TENDON = "_withreallength"
"""How copies of quadriceps that reach the shank are called."""
QUADRICEPS = ("recfem", "vasint", "vaslat", "vasmed")
MARGIN = 0.02
"""At both ends, where nothing is compared [s]."""


@dataclass(frozen=True)
class KneeTrial:
    """One trial.

    `file`: in its names; `start`, `stop`: where plates carry the feet [s]; `legs`: body under each
    plate.
    """

    name: str
    file: str
    start: float
    stop: float
    legs: tuple[str, ...] = ("calcaneus_l", "calcaneus", "calcaneus")


TRIALS = (
    KneeTrial(name="normal", file="ngait_og5", start=2.14, stop=4.17),
    KneeTrial(name="bouncy", file="bouncy7", start=0.02, stop=2.3),
    KneeTrial(name="medial thrust, poles", file="mtpgait3", start=1.4, stop=3.62),
    KneeTrial(
        name="fast, treadmill",
        file="ngait_tm_fast1",
        start=2.0,
        stop=6.0,
        legs=("calcaneus_l", "calcaneus"),
    ),
)
WAYS: dict[str, tuple[str, ...]] = {
    "default": (),
    "effort alone, no loads of knees": ("--joint-load", "0"),
    "knee contact 0.2": ("--knee-contact", "0.2"),
    "passive hips": ("--joint-tissue", "hips"),
    "passive legs": ("--joint-tissue", "legs"),
    "exponent 3": ("--exponent", "3"),
    "co-contraction 0.02": ("--co-contraction", "0.02", "--co-contraction-coordinates", KNEES),
    "co-contraction 0.05": ("--co-contraction", "0.05", "--co-contraction-coordinates", KNEES),
}
"""Settings of `myomorph tension` beside files and `--contact-points auto`."""


def measure(folder: Path) -> Iterator[Row]:
    """Distance of the estimated force from the measured one, a row for each trial and way."""
    source = folder / FOLDER
    if not (source / GENERAL_MODEL).is_file():
        print(
            f"knee_trials: the data folder has no {FOLDER}: clone"
            " https://github.com/gilserrancoli/ReducePoly_forMSK there"
        )
        return
    for way, settings in WAYS.items():
        errors = []
        for trial in TRIALS:
            row = row_of(source, trial, settings)
            errors.append([row[f"{part} [BW]"] for part in PARTS])
            yield {"settings": way, "trial": trial.name} | row
        means = np.mean(np.array(errors, dtype=np.float64), axis=0)
        yield {"settings": way, "trial": "mean"} | {
            f"{part} [BW]": float(mean) for part, mean in zip(PARTS, means, strict=True)
        }


def row_of(source: Path, trial: KneeTrial, settings: Sequence[str]) -> Row:
    """Errors of a trial in body weights, with correlations and peaks."""
    weight = mm.read_model(made_model(source)).weight
    clock, truth = measured(source, trial)
    loads = tension_loads(source, trial, tuple(settings))
    known = (clock > loads.time[0] + MARGIN) & (clock < loads.time[-1] - MARGIN)
    row: Row = {}
    for number, part in enumerate(PARTS):
        estimate = np.interp(clock[known], loads.time, loads[f"{part}_{KNEE}"])
        row[f"{part} [BW]"] = rms(estimate - truth[known, number]) / weight
        row[f"r of {part}"] = float(np.corrcoef(estimate, truth[known, number])[0, 1])
        row[f"peak of {part} [BW]"] = float(estimate.max()) / weight
        row[f"measured peak of {part} [BW]"] = float(truth[known, number].max()) / weight
    return row


def tension_loads(source: Path, trial: KneeTrial, settings: tuple[str, ...]) -> mm.Table:
    """Joint contact forces that `myomorph tension` writes."""
    model = made_model(source)
    with tempfile.TemporaryDirectory() as work:
        out = Path(work) / "out"
        motion = write_motion(source, trial, Path(work))
        loads = write_loads(source, trial, Path(work))
        files = ("--model", model, "--motion", motion, "--loads", loads)
        span = ("--time", trial.start, trial.stop)
        command("tension", *files, *span, "--contact-points", "auto", "--out", out, *settings)
        return mm.read_sto(out / "joint_contact_forces.sto")


def measured(source: Path, trial: KneeTrial) -> tuple[Array, Array]:
    """Read the measured force; the implant has a cell in each corner of the tibial tray.

    Parameters
    ----------
    source : the repository
    trial : one of `TRIALS`

    Returns
    -------
    instants (samples,) [s], and total, medial and lateral force (samples, 3) [N]
    """
    names, values = read_columns(source, "KCF", trial)
    of_cell = {name: POUND * values[:, names.index(name)] for name in ("PM", "AM", "AL", "PL")}
    medial = of_cell["PM"] + of_cell["AM"]
    lateral = of_cell["AL"] + of_cell["PL"]
    return values[:, 0], np.column_stack([medial + lateral, medial, lateral])


def read_columns(source: Path, kind: str, trial: KneeTrial) -> tuple[list[str], Array]:
    """Read one of a trial's files.

    Parameters
    ----------
    source : the repository
    kind : of the file: "IK", "GRF" or "KCF"
    trial : one of `TRIALS`

    Returns
    -------
    names of columns, and values (samples, columns) in the file's units, 0 where there is none
    """
    path = source / RECORDED / kind / f"{kind}_{trial.file}.mat"
    content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    table = next(value for name, value in content.items() if not name.startswith("__"))
    return [str(name) for name in table.colheaders], np.nan_to_num(table.data.astype(np.float64))


@cache
def made_model(source: Path) -> Path:
    """Write the study's model with muscles that pull at the shank once.

    The model has every muscle of quadriceps twice: up to the patella, and once more, for its
    length, to the shank. The copies are left out; slack lengths grow by what lies below the
    patella.
    """
    path = Path(tempfile.mkdtemp()) / "model.osim"
    general = mm.read_model(source / GENERAL_MODEL)
    names, values = read_columns(source, "IK", TRIALS[0])
    walk = mm.read_motion(
        write_table(path.with_name("walk.mot"), names, values, degrees=True), general
    )
    coordinates = compile_tree(general).coordinates_of(walk)[::10]
    lengths = compile_paths(general).evaluate(coordinates)[0]
    tree = ElementTree.parse(source / GENERAL_MODEL)
    for name in QUADRICEPS:
        below = (
            lengths[:, general.muscle_names.index(name)]
            - lengths[:, general.muscle_names.index(name + WITH_TENDON)]
        )
        slack = tree.getroot().find(f".//*[@name='{name}']/tendon_slack_length")
        assert slack is not None
        slack.text = repr(float(slack.text or 0.0) + float(below.mean()))
    for group in list(tree.getroot().iter()):
        for item in list(group):
            if WITH_TENDON in (item.get("name") or ""):
                group.remove(item)
    tree.write(path)
    return path


def write_motion(source: Path, trial: KneeTrial, work: Path) -> Path:
    """Write the study's coordinates as a file of motion."""
    names, values = read_columns(source, "IK", trial)
    return write_table(work / "ik.mot", names, values, degrees=True)


def write_loads(source: Path, trial: KneeTrial, work: Path) -> Path:
    """Write plates as a file of external loads, each on the foot that stands on it."""
    names, values = read_columns(source, "GRF", trial)
    write_table(work / "grf.mot", names, values, degrees=False)
    forces = "".join(
        f'<ExternalForce name="plate{number}"><applied_to_body>{body}</applied_to_body>'
        "<force_expressed_in_body>ground</force_expressed_in_body>"
        "<point_expressed_in_body>ground</point_expressed_in_body>"
        f"<force_identifier>grforce{number}_f</force_identifier>"
        f"<point_identifier>grforce{number}_p</point_identifier>"
        f"<torque_identifier>grforce{number}_t</torque_identifier></ExternalForce>"
        for number, body in enumerate(trial.legs, start=1)
    )
    path = work / "grf.xml"
    path.write_text(
        '<?xml version="1.0"?><OpenSimDocument Version="40000"><ExternalLoads name="plates">'
        f"<objects>{forces}</objects><datafile>grf.mot</datafile></ExternalLoads>"
        "</OpenSimDocument>",
        encoding="utf-8",
    )
    return path


def write_table(path: Path, names: Sequence[str], values: Array, *, degrees: bool) -> Path:
    """Write a table as OpenSim does.

    Parameters
    ----------
    path : of the file
    names : of the columns, the first one "time"
    values : (rows, columns) in the file's units
    degrees : whether angles are in degrees

    Returns
    -------
    the path
    """
    in_degrees = "yes" if degrees else "no"
    head = (
        path.stem,
        "version=1",
        f"nRows={len(values)}",
        f"nColumns={len(names)}",
        f"inDegrees={in_degrees}",
        "endheader",
        "\t".join(names),
    )
    rows = ("\t".join(f"{value:.10g}" for value in row) for row in values)
    path.write_text("\n".join((*head, *rows)) + "\n", encoding="utf-8")
    return path
