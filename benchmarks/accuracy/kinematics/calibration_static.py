"""`calibrate` from a standing trial alone against OpenSim's ScaleTool from the same trial.

Both are tested on other motion.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import opensim

import myomorph as mm
from benchmarks.accuracy.kinematics.calibration import (
    GAIT,
    OPENCAP,
    RAJAGOPAL,
    recorded,
    root_mean_square,
    tracked,
)
from benchmarks.accuracy.kinematics.scale import BODY, MEASUREMENT, PAIR, TASK
from myomorph.core.io.osim.setup_parts import read_ik_tasks, read_marker_set, write_marker_set

opensim.Logger.setLevelString("Off")

KNEE = "knee-implant-walk"
LENHART = "lenhart-knee-contact-walk"
SETUP = """<OpenSimDocument Version="40000"><ScaleTool name="subject"><mass>-1</mass>\
<GenericModelMaker>
<model_file>{model}</model_file><marker_set_file>set.xml</marker_set_file></GenericModelMaker>
<ModelScaler><apply>true</apply><scaling_order>measurements</scaling_order>
<MeasurementSet><objects>{measurements}</objects></MeasurementSet><marker_file>static.trc</marker_file>
<time_range>{first} {last}</time_range>\
<preserve_mass_distribution>false</preserve_mass_distribution>
<output_model_file>scaled.osim</output_model_file></ModelScaler>
<MarkerPlacer><apply>true</apply><IKTaskSet><objects>{tasks}</objects></IKTaskSet><marker_file>static.trc</marker_file>
<time_range>{first} {last}</time_range><output_model_file>placed.osim</output_model_file>\
</MarkerPlacer>
</ScaleTool></OpenSimDocument>
"""
LEGS = ("pelvis", "femur", "tibia", "talus", "calcn", "toes")
FEET = ("talus", "calcn", "toes")
MEASURED = (
    ("pelvis width", ("asis_r asis_l",), ("pelvis",), "Z"),
    ("pelvis depth", ("asis_r psis_r", "asis_l psis_l"), ("pelvis",), "X Y"),
    (
        "thigh",
        ("asis_r knee_r", "asis_l knee_l"),
        ("femur_r", "femur_l", "patella_r", "patella_l"),
        "X Y Z",
    ),
    ("shank", ("knee_r ankle_r", "knee_l ankle_l"), ("tibia_r", "tibia_l"), "X Y Z"),
    (
        "foot",
        ("heel_r toe_r", "heel_l toe_l"),
        tuple(f"{one}_{s}" for one in FEET for s in "rl"),
        "X Y Z",
    ),
    ("trunk", ("shoulder_r psis_r", "shoulder_l psis_l"), ("torso",), "X Y Z"),
    (
        "upper arm",
        ("shoulder_r elbow_r", "shoulder_l elbow_l"),
        ("humerus_r", "humerus_l"),
        "X Y Z",
    ),
    (
        "forearm",
        ("elbow_r wrist_r", "elbow_l wrist_l"),
        tuple(f"{one}_{s}" for one in ("ulna", "radius", "hand") for s in "rl"),
        "X Y Z",
    ),
)
"""Usual pairs of markers, both sides averaged, and the bodies that take the mean ratio of their
distances.
"""

STANFORD = {
    f"{role}_{side.lower()}": f"{side}.{name}"
    for side in "RL"
    for role, name in (
        ("asis", "ASIS"),
        ("psis", "PSIS"),
        ("knee", "Knee"),
        ("ankle", "Ankle"),
        ("heel", "Heel"),
        ("toe", "MT5"),
        ("shoulder", "Shoulder"),
        ("elbow", "Elbow"),
        ("wrist", "Wrist"),
    )
}
OPENCAP_ROLES = {
    f"{role}_{side}": f"{letter}{name}"
    for side, letters in (("r", ("r.", "r_", "R_")), ("l", ("L.", "L_", "L_")))
    for letter, role, name in (
        (letters[0], "asis", "ASIS"),
        (letters[0], "psis", "PSIS"),
        (letters[1], "knee", "knee"),
        (letters[1], "ankle", "ankle"),
        (letters[1], "heel", "calc"),
        (letters[1], "toe", "toe"),
        (letters[2], "shoulder", "Shoulder"),
        (letters[2], "elbow", "elbow_lat"),
        (letters[2], "wrist", "wrist_radius"),
    )
}
GAIT_ROLES = {
    f"{role}_{side.lower()}": f"{side}.{name}"
    for side in "RL"
    for role, name in (
        ("asis", "ASIS"),
        ("knee", "Knee.Lat"),
        ("ankle", "Ankle.Lat"),
        ("heel", "Heel"),
        ("toe", "Toe.Tip"),
        ("shoulder", "Acromium"),
    )
} | {"psis_r": "V.Sacral", "psis_l": "V.Sacral"}
IMPLANT_NAMES = {
    f"{side}{name}": f"{letter}{other}"
    for side, lower in (("R", "r"), ("L", "L"))
    for name, letter, other in (
        ("Asis", lower, ".ASIS"),
        ("Psis", lower, ".PSIS"),
        ("Shoulder", side, "_Shoulder"),
        ("KneeLateral", lower, "_knee"),
        ("KneeMedial", lower, "_mknee"),
        ("AnkleLateral", lower, "_ankle"),
        ("AnkleMedial", lower, "_mankle"),
        ("ankleMedial", lower, "_mankle"),
        ("Heel", lower, "_calc"),
        ("Toe", lower, "_toe"),
        ("MidfootLateral", lower, "_5meta"),
        ("ThighSuperior", lower, "_thigh1"),
        ("ThighInferior", lower, "_thigh2"),
        ("ThighLateral", lower, "_thigh3"),
        ("ShankSuperior", lower, "_shank_antsup"),
        ("ShankInferior", lower, "_sh2"),
        ("ShankLateral", lower, "_sh3"),
    )
}
"""The implant wearer's markers by the names of a generic model that has them."""


@dataclass(frozen=True, eq=False)
class Standing:
    """A subject with a standing trial and a motion.

    `file`: of the generic model; `generic`: with the markers that both methods get; `roles`: marker
    of each role of `MEASURED`; `chosen`: whether settings were chosen with this subject in view;
    `weights`: of markers in ScaleTool's pose, where no marker is called fixed; `expert`: model of
    the same person that an expert scaled.
    """

    name: str
    file: Path
    generic: mm.Model
    static: mm.Markers
    motion: mm.Markers
    roles: Mapping[str, str]
    chosen: bool
    weights: Mapping[str, float] = field(default_factory=dict)
    expert: Path | None = None


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """Marker errors of both on the motion, and where they were made."""
    for one in subjects(folder):
        with tempfile.TemporaryDirectory() as scratch:
            theirs = scaled_by_opensim(one, Path(scratch))
        found = mm.calibrate(one.generic, [], mm.CalibrationOptions(static=one.static))
        shared = set(one.static.names) & set(one.generic.marker_names)
        names = tuple(name for name in one.motion.names if name in shared)
        fits = [tracked(model, one.motion, names) for model in (theirs, found.model)]
        legs = [one.generic.marker(name).body.startswith(LEGS) for name in fits[0].marker_names]
        errors = [1e3 * root_mean_square(fit) for fit in fits]
        lower = [1e3 * float(np.sqrt(np.nanmean(fit.marker_error[:, legs] ** 2))) for fit in fits]
        expert = None if one.expert is None else implant_names(mm.read_model(one.expert))
        of_expert = (
            () if expert is None else tuple(name for name in names if name in expert.marker_names)
        )
        theirs_mm = (
            "" if expert is None else 1e3 * root_mean_square(tracked(expert, one.motion, of_expert))
        )
        yield {
            "subject": one.name,
            "settings chosen on it": one.chosen,
            "markers": len(names),
            "RMSE, ScaleTool [mm]": errors[0],
            "RMSE, calibrated [mm]": errors[1],
            "RMSE, expert's model [mm]": theirs_mm,
            "ratio": errors[1] / errors[0],
            "ratio, pelvis and legs": lower[1] / lower[0],
            "at most 0.95": errors[1] <= 0.95 * errors[0],
        }


def scaled_by_opensim(one: Standing, scratch: Path) -> mm.Model:
    """Scale the generic model by marker pairs with OpenSim's ScaleTool.

    The tool places its markers too. As experts do, the pose is that of the landmarks (markers that
    the generic model calls fixed), all of weight 1; without such, that of the weights of the
    subject's own task file.
    """
    names = [name for name in one.generic.marker_names if name in one.static.names]
    kept = mm.Markers(
        one.static.time,
        tuple(names),
        one.static.values[:, [one.static.names.index(name) for name in names]],
    )
    mm.write_trc(kept, scratch / "static.trc")
    write_marker_set(one.generic, scratch / "set.xml")
    weights = one.weights or {marker.name: float(marker.fixed) for marker in one.generic.markers}
    setup = SETUP.format(
        model=one.file,
        measurements=_measurements(one, names),
        tasks="".join(TASK.format(name, weights.get(name, 0.0)) for name in names),
        first=kept.time[0],
        last=kept.time[-1],
    )
    (scratch / "setup.xml").write_text(setup, encoding="utf-8")
    tool = opensim.ScaleTool(str(scratch / "setup.xml"))
    if not tool.run():
        raise RuntimeError(f"{one.name}: ScaleTool failed")
    return mm.read_model(scratch / "placed.osim")


def _measurements(one: Standing, names: Sequence[str]) -> str:
    """Return the setup's measurements by the pairs of markers that the recording has."""
    bodies = set(one.generic.body_names)
    measurements = []
    for title, pairs, of, axes in MEASURED:
        found = [[one.roles.get(role, "") for role in pair.split()] for pair in pairs]
        found = [pair for pair in found if all(name in names for name in pair)]
        if found:
            text = "".join(PAIR.format(*pair) for pair in found)
            scales = "".join(BODY.format(body, axes) for body in of if body in bodies)
            measurements.append(MEASUREMENT.format(name=title, pairs=text, bodies=scales))
    return "".join(measurements)


def subjects(folder: Path) -> Iterator[Standing]:
    """All of them; data sets that are absent are left out."""
    gait = folder / GAIT
    opencap = folder / OPENCAP
    rajagopal = folder / RAJAGOPAL
    if gait.is_dir():
        file = gait / "experiment/gait2354_simbody.osim"
        model = _with_set(file, gait / "experiment/gait2354_Scale_MarkerSet.xml")
        weights = read_ik_tasks(gait / "ref_scale/gait2354_Scale_Tasks.xml").marker_weights
        static = recorded(gait / "experiment", "subject01_static.trc")
        walk = recorded(gait / "experiment", "subject01_walk1.trc")
        yield Standing(
            name="gait2354",
            file=file,
            generic=model,
            static=_part(static, 20),
            motion=_part(walk),
            roles=GAIT_ROLES,
            chosen=True,
            weights=weights,
            expert=gait / "ref_scale/std_subject01_simbody.osim",
        )
    file = opencap / "models/unscaled_generic.osim"
    if opencap.is_dir():
        model = mm.read_model(file)
        markers = opencap / "markers"
        static = recorded(markers, "static1.trc")
        walk = recorded(markers, "walking1.trc")
        yield Standing(
            name="OpenCap subject 4",
            file=file,
            generic=model,
            static=_part(static, 20),
            motion=_part(walk),
            roles=OPENCAP_ROLES,
            chosen=True,
            expert=opencap / "models/manually_scaled.osim",
        )
        if (folder / KNEE).is_dir():
            static = implant_markers(recorded(folder / KNEE, "static.trc"))
            walk = implant_markers(recorded(folder / KNEE, "walk1.trc"))
            yield Standing(
                name="knee implant",
                file=file,
                generic=model,
                static=_part(static, 20),
                motion=_part(walk),
                roles=OPENCAP_ROLES,
                chosen=False,
                expert=folder / KNEE / "scaled.osim",
            )
    if rajagopal.is_dir():
        file = rajagopal / "raw/Rajagopal2016.osim"
        model = _with_set(file, rajagopal / "raw/markerset_walk_preScale.xml")
        static = recorded(rajagopal / "raw", "static_walk_1.trc")
        walk = recorded(rajagopal, "markers_walk.trc")
        yield Standing(
            name="Rajagopal",
            file=file,
            generic=model,
            static=_part(static, 20),
            motion=_part(walk),
            roles=STANFORD,
            chosen=True,
            expert=rajagopal / "subject_walk_scaled.osim",
        )
        if (folder / LENHART).is_dir():
            static = recorded(folder / LENHART / "motion", "static1.trc")
            walk = recorded(folder / LENHART / "motion", "overground_17.trc")
            yield Standing(
                name="Lenhart",
                file=file,
                generic=model,
                static=_part(static, 20),
                motion=_part(walk),
                roles=STANFORD,
                chosen=False,
            )


def _part(markers: mm.Markers, count: int = 200) -> mm.Markers:
    rows = np.unique(np.linspace(0, len(markers) - 1, min(count, len(markers))).astype(int))
    return mm.Markers(markers.time[rows], markers.names, markers.values[rows])


def implant_markers(given: mm.Markers) -> mm.Markers:
    """Return a recording of the implant wearer with the markers' names of the generic model."""
    return replace(given, names=tuple(IMPLANT_NAMES.get(name, name) for name in given.names))


def implant_names(given: mm.Model) -> mm.Model:
    """Return the implant wearer's model with the markers' names of the generic model."""
    return given.with_markers(
        tuple(replace(one, name=IMPLANT_NAMES.get(one.name, one.name)) for one in given.markers)
    )


def _with_set(file: Path, markers: Path) -> mm.Model:
    model = mm.read_model(file)
    return model.with_markers(read_marker_set(markers, model))
