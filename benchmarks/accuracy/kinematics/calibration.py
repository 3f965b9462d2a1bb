"""Calibrated models against those of experts and of ScaleTool, on held-out motions.

Calibration did not see these motions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.recordings import read_markers
from myomorph.body.calibrate.calibration import Calibration
from myomorph.core.io.osim.setup_parts import read_marker_set
from myomorph.core.model.landmarks import Measurement
from myomorph.core.model.scale import scale
from myomorph.core.motion import measurements
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.motion.lengths import lengths_of
from myomorph.core.motion.sync import cut

OPENCAP = "opencap-subject4-multitask"
GAIT = "opensim-gait-subject01"
RAJAGOPAL = "rajagopal-walk-emg"
HAMNER = "hamner-run-subject04"
HAMNER_PAIRS = (
    ("pelvis", ("RASI LASI", "RPSI LPSI"), ("pelvis",)),
    ("thigh", ("RASI RLFC", "LASI LLFC"), ("femur_r", "femur_l")),
    ("shank", ("RLFC RLMAL", "LLFC LLMAL"), ("tibia_r", "tibia_l")),
    (
        "foot",
        ("RCAL RTOE", "LCAL LTOE"),
        ("talus_r", "calcn_r", "toes_r", "talus_l", "calcn_l", "toes_l"),
    ),
    ("trunk", ("C7 RPSI", "C7 LPSI", "RACR LACR"), ("torso",)),
    ("upper arm", ("RACR RLEL", "LACR LLEL"), ("humerus_r", "humerus_l")),
    (
        "forearm",
        ("RLEL RFAradius", "LLEL LFAradius"),
        ("ulna_r", "radius_r", "hand_r", "ulna_l", "radius_l", "hand_l"),
    ),
)
"""Distances between markers, averaged over the running motion, that scale the generic runner."""


@dataclass(frozen=True, eq=False)
class Split:
    """Recordings to calibrate from and others to test on.

    `peer`: the model to do better than, and who made it.
    """

    name: str
    generic: mm.Model
    peer: mm.Model
    peer_name: str
    shown: tuple[mm.Markers, ...]
    held_out: dict[str, mm.Markers]
    static: mm.Markers | None = None


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """Measure the marker errors of the peer's model and of the calibrated one on held-out motions.

    The rows are of every split.
    """
    for split in splits(folder):
        found = mm.calibrate(split.generic, split.shown, mm.CalibrationOptions(static=split.static))
        for name, markers in split.held_out.items():
            common = tuple(
                one
                for one in markers.names
                if all(
                    one in model.marker_names for model in (split.generic, split.peer, found.model)
                )
            )
            errors = [
                root_mean_square(tracked(model, markers, common))
                for model in (split.peer, found.model)
            ]
            yield {
                "calibrated from": split.name,
                "held out": name,
                "markers": len(common),
                "peer": split.peer_name,
                "RMSE, peer [mm]": 1e3 * errors[0],
                "RMSE, calibrated [mm]": 1e3 * errors[1],
                "ratio": errors[1] / errors[0],
                "lower": errors[1] < errors[0],
                "RMSE where calibrated [mm]": 1e3 * found.rms_after,
                "frames": sum(len(one) for one in found.frames),
            }


def measure_lengths(folder: Path) -> Iterator[dict[str, object]]:
    """Joint-to-joint lengths of the calibrated models beside those of the peers'."""
    for split in splits(folder):
        found = mm.calibrate(split.generic, split.shown, mm.CalibrationOptions(static=split.static))
        yield {"calibrated from": split.name, **compared_lengths(split, found)}


def compared_lengths(split: Split, found: Calibration) -> dict[str, object]:
    """Thigh and shank of both sides and the trunk in mm: calibrated (its SD) / peer."""
    theirs = {one.name: one.extent for one in lengths_of(split.peer) if one.between_joints}
    ours = {one.length.name: one for one in found.lengths}
    shown = {
        "thigh right": "femur_r_y",
        "thigh left": "femur_l_y",
        "shank right": "tibia_r_y",
        "shank left": "tibia_l_y",
    }
    row: dict[str, object] = {}
    for title, name in shown.items():
        one = ours[name]
        sd = 1e3 * one.length.extent * one.sd
        row[f"{title} [mm]"] = f"{1e3 * one.value:.0f} ({sd:.0f}) / {1e3 * theirs[name]:.0f}"
    hips = [_hip_distance(model) for model in (found.model, split.peer)]
    row["between hips [mm]"] = f"{1e3 * hips[0]:.0f} / {1e3 * hips[1]:.0f}"
    return row


def _hip_distance(model: mm.Model) -> float:
    places = {joint.child: joint.parent_frame.translation for joint in model.joints}
    return float(np.linalg.norm(places["femur_r"] - places["femur_l"]))


def tracked(model: mm.Model, markers: mm.Markers, names: tuple[str, ...]) -> KinematicsFit:
    """Inverse kinematics with the same markers and equal weights for every model."""
    options = mm.InverseKinematicsOptions(
        marker_weights=dict.fromkeys(names, 1.0), only_weighted=True
    )
    return mm.inverse_kinematics(model, markers, options)


def root_mean_square(fit: KinematicsFit) -> float:
    """Of all marker distances [m]."""
    return float(np.sqrt(np.nanmean(fit.marker_error**2)))


def splits(folder: Path) -> Iterator[Split]:
    """All of them; data sets that are absent are left out."""
    makers: dict[str, Callable[[Path], Iterator[Split]]] = {
        OPENCAP: opencap,
        GAIT: gait,
        RAJAGOPAL: rajagopal,
        HAMNER: hamner,
    }
    for name, make in makers.items():
        if (folder / name).is_dir():
            yield from make(folder / name)


def opencap(folder: Path) -> Iterator[Split]:
    """Yield splits of the standing trial and one of three motions, tested on the other two.

    The peer is an expert's model.
    """
    trial = partial(recorded, folder / "markers")
    generic = mm.read_model(folder / "models/unscaled_generic.osim")
    expert = mm.read_model(folder / "models/manually_scaled.osim")
    motions = {name: trial(f"{name}.trc") for name in ("walking1", "STS1", "DJ1")}
    for name, markers in motions.items():
        held_out = {
            f"OpenCap {other}": motion for other, motion in motions.items() if other != name
        }
        static = trial("static1.trc")
        yield Split(
            name=f"OpenCap static1, {name}",
            generic=generic,
            peer=expert,
            peer_name="expert",
            shown=(markers,),
            held_out=held_out,
            static=static,
        )


def gait(folder: Path) -> Iterator[Split]:
    """Yield the standing trial alone, and with half of the walk, against ScaleTool's model."""
    generic = mm.read_model(folder / "experiment/gait2354_simbody.osim")
    generic = generic.with_markers(
        read_marker_set(folder / "experiment/gait2354_Scale_MarkerSet.xml", generic)
    )
    peer = mm.read_model(folder / "ref_scale/std_subject01_simbody.osim")
    static = recorded(folder / "experiment", "subject01_static.trc")
    walk = recorded(folder / "experiment", "subject01_walk1.trc")
    yield Split(
        name="gait2354 static",
        generic=generic,
        peer=peer,
        peer_name="ScaleTool",
        shown=(),
        held_out={"gait2354 walk": walk},
        static=static,
    )
    yield from _halves("gait2354", generic, peer, "ScaleTool", walk, static)


def rajagopal(folder: Path) -> Iterator[Split]:
    """Yield the standing trials alone, and with half of the walk.

    The peer is the authors' model made with ScaleTool.
    """
    generic = mm.read_model(folder / "raw/Rajagopal2016.osim")
    generic = generic.with_markers(
        read_marker_set(folder / "raw/markerset_walk_preScale.xml", generic)
    )
    peer = mm.read_model(folder / "subject_walk_scaled.osim")
    static = [recorded(folder / "raw", f"static_walk_{i}.trc") for i in (1, 2)]
    walk = recorded(folder, "markers_walk.trc")
    shown = (static[0],)
    yield Split(
        name="Rajagopal two static",
        generic=generic,
        peer=peer,
        peer_name="authors",
        shown=shown,
        held_out={"Rajagopal walk": walk},
        static=static[1],
    )
    yield from _halves("Rajagopal", generic, peer, "authors", walk, static[1])


def hamner(folder: Path) -> Iterator[Split]:
    """Yield one speed of running, tested on the other.

    No expert's model exists, so marker pairs scale the peer.
    """
    generic = mm.read_model(folder / "unscaled_generic.osim")
    runs = {name: recorded(folder / name, "markers.trc") for name in ("run200", "run500")}
    for name, other in (("run200", "run500"), ("run500", "run200")):
        peer = scaled_by_pairs(generic, runs[name])
        held_out = {f"Hamner {other}": runs[other]}
        yield Split(
            name=f"Hamner {name}",
            generic=generic,
            peer=peer,
            peer_name="marker pairs",
            shown=(runs[name],),
            held_out=held_out,
        )


def scaled_by_pairs(generic: mm.Model, markers: mm.Markers) -> mm.Model:
    """Scale a model as ScaleTool does without a static trial.

    Mean marker distances scale, and markers go to their mean positions.
    """
    pairs = [
        Measurement(
            name,
            tuple((a, b) for a, b in (one.split() for one in of)),
            dict.fromkeys(bodies, "xyz"),
        )
        for name, of, bodies in HAMNER_PAIRS
    ]
    model = scale(
        generic,
        measurements.with_measured(
            [measurements.measure(generic, markers, pair) for pair in pairs]
        ),
    )
    names = tuple(name for name in model.marker_names if name in markers.names)
    fit = tracked(model, markers, names)
    bodies = {name: model.marker(name).body for name in names}
    placed = {
        one.name: one for one in measurements.place_markers(model, fit.motion, markers, bodies)
    }
    return model.with_markers(tuple(placed.get(one.name, one) for one in model.markers))


def _halves(
    name: str,
    generic: mm.Model,
    peer: mm.Model,
    peer_name: str,
    walk: mm.Markers,
    static: mm.Markers,
) -> Iterator[Split]:
    middle = 0.5 * float(walk.time[0] + walk.time[-1])
    halves = (
        cut(walk, float(walk.time[0]), middle),
        cut(walk, middle + 1e-6, float(walk.time[-1])),
    )
    for shown, other, which, rest in ((0, 1, "first", "second"), (1, 0, "second", "first")):
        held_out = {f"{name} walk, {rest} half": halves[other]}
        yield Split(
            name=f"{name} static, {which} half",
            generic=generic,
            peer=peer,
            peer_name=peer_name,
            shown=(halves[shown],),
            held_out=held_out,
            static=static,
        )


def recorded(folder: Path, name: str) -> mm.Markers:
    """Read the markers of a TRC file."""
    markers = read_markers(folder / name)
    return markers
