"""The files of a specimen as values.

Its model becomes base, joint and limb, its swings become markers and wrench.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from myomorph.core.contact.plates import plate_axes, plate_wrench
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.mesh import read_mesh
from myomorph.core.io.sto import read_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadFile, BadModel, check_name, listing
from myomorph.core.model.messages import located
from myomorph.core.model.model import Model
from myomorph.core.model.series import Z_UP_TO_Y_UP, Markers, Trial, Wrenches
from myomorph.core.model.spatial import least_rotation
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.pictures import residual_map
from myomorph.lab.report.page.parts import Figure
from myomorph.lab.study.inputs.reading import about, fitted_to, open_model, read_recording
from myomorph.swings.viscosity.report.specimen_report import Residual
from myomorph.swings.viscosity.specimen.bodies import ancestors
from myomorph.swings.viscosity.specimen.model import (
    Specimen,
    SpecimenNames,
    SwingTrial,
    build_specimen,
)
from myomorph.swings.viscosity.specimen.muscles import fig1_muscles
from myomorph.swings.viscosity.study.calibration import ScannedModel, model_from_scans
from myomorph.swings.viscosity.study.recordings import SwingFiles
from myomorph.swings.viscosity.study.specimen_files import SpecimenFiles

AXES = "xyz"
STEADY = 2.0  # A mean force is that of a weight where it is so many times the force's own change.
# Cosine of the angle to the vertical from which a weight does not hang in the model's laboratory.
ASLANT = 0.7
NAMED = {"base": ("scapula",), "first_body": ("humerus", "humer", "upper_arm", "upperarm")}
"""What the bodies of a shoulder are called where a study file does not name them."""
WHOLE = 9  # Columns of a table of one force: force, point and torque.


def turn_to(up: str, gravity: Array) -> Array:
    """Find the shortest turn of a laboratory into axes with some gravity.

    Parameters
    ----------
    up : axis of the laboratory that points up
    gravity : (3,) in the other axes

    Returns
    -------
    (3, 3)
    """
    return least_rotation(np.eye(3)[AXES.index(up)], -np.asarray(gravity) / np.linalg.norm(gravity))


def turned(wrenches: Wrenches, rotation: Array) -> Wrenches:
    """Turn wrenches into other axes.

    Parameters
    ----------
    wrenches : in the old axes
    rotation : (3, 3) that turns vectors

    Returns
    -------
    the same wrenches
    """
    forces = wrenches.forces @ rotation.T
    points = wrenches.points @ rotation.T
    torques = wrenches.torques @ rotation.T
    return replace(wrenches, forces=forces, points=points, torques=torques)


def carrying(
    wrenches: Wrenches, gravity: Array, name: str, up: str | None = None
) -> tuple[Wrenches, tuple[str, ...]]:
    """Take wrenches as what carries a hanging limb.

    They are reversed, and said so, where they are what the limb does. A plate that was set to zero
    with the limb on it tells nothing of the vertical.

    Parameters
    ----------
    wrenches : as they were measured
    gravity : (3,) in their axes [m/s^2]
    name : of the recording
    up : axis that the study file says points up

    Returns
    -------
    the wrenches, and notes

    Raises
    ------
    BadData : the weight does not hang along the vertical
    """
    force = wrenches.forces.sum(axis=1)
    force = force[np.isfinite(force).all(axis=1)]
    if not len(force):
        return wrenches, ()
    mean = force.mean(axis=0)
    size = float(np.linalg.norm(mean))
    change = float(np.linalg.norm(force.std(axis=0)))
    vertical = -np.asarray(gravity) / np.linalg.norm(gravity)
    if size <= STEADY * change or size == 0.0:
        return wrenches, ()
    cosine = float(mean @ vertical) / size
    if abs(cosine) < ASLANT:
        lab = AXES[int(np.argmax(np.abs(mean)))]
        axis = AXES[int(np.argmax(np.abs(vertical)))]
        if up is not None:
            was = AXES[int(np.argmax(np.abs(turn_to(up, gravity).T @ mean)))]
            wrong = f'up = "{up}" is not the recording\'s vertical, its weight hangs along {was}'
            raise BadData(f"recording '{name}': {wrong}: give up = \"{was}\", or leave it out")
        hangs = f"the weight hangs along {lab}, but the model's vertical is {axis}"
        raise BadData(f"recording '{name}': {hangs}: give up = \"{lab}\" in the study file")
    if cosine > 0.0:
        return wrenches, ()
    reverse = replace(wrenches, forces=-wrenches.forces, torques=-wrenches.torques)
    return reverse, (f"{name}: the forces were those on the plate, and were reversed",)


@dataclass(frozen=True, eq=False)
class OpenedSpecimen:
    """A specimen from its files, what was said of them, and how well a CT fits the bones."""

    specimen: Specimen
    notes: tuple[str, ...] = ()
    residuals: tuple[Residual, ...] = ()
    scans: tuple[Figure, ...] = ()


def open_specimen(files: SpecimenFiles, recorded: Markers) -> OpenedSpecimen:
    """Make the specimen of a model, with a CT from its clusters.

    Its bones are those that carry three recorded markers.

    Parameters
    ----------
    files : of the specimen
    recorded : markers of a recording
    """
    with about(files.model):
        model = _model(files.model, recorded.names)
        scanned = model_from_scans(model, files.ct, recorded) if files.ct else None
        model = model if scanned is None else scanned.model
        first = body_named(model, files.first, "first_body")
        base = body_named(model, files.base, "base", first)
        bones = files.bones or _marked(model, base, first, recorded.names)
        names = SpecimenNames(
            base=base,
            first=first,
            bones=bones,
            muscles=files.muscles or _muscles(model),
            joint=files.joint,
        )
        specimen = build_specimen(model, names)
    lost = _unknown_markers(specimen, recorded.names)
    if scanned is None:
        return OpenedSpecimen(specimen, lost)
    maps = []
    for bone, scan in zip(scanned.bones, files.ct, strict=True):
        unit = f"mm, root mean square {number(1e3 * bone.fit.rms)}"
        maps.append(
            Figure(residual_map(bone.body, unit, read_mesh(scan.surface), bone.fit.distances))
        )
    return OpenedSpecimen(
        specimen=specimen,
        notes=(*lost, *scanned.notes),
        residuals=_fits(scanned),
        scans=tuple(maps),
    )


def _unknown_markers(specimen: Specimen, recorded: Sequence[str]) -> tuple[str, ...]:
    """Note every bone with fewer than three recorded markers, where others are unknown."""
    owner = {marker.name: marker.body for marker in specimen.model.markers}
    unknown = [name for name in recorded if name not in owner]
    if not unknown:
        return ()
    counts = {
        bone: sum(owner.get(name) == bone for name in recorded)
        for bone in dict.fromkeys(owner.values())
    }
    text = (
        f"of its markers in the recording, which has {listing('', unknown)} that the model does not"
        " know"
    )
    few = ((bone, count) for bone, count in counts.items() if 0 < count < 3)
    return tuple(f"bone '{bone}' has {count} {text}: name them alike" for bone, count in few)


def _fits(scanned: ScannedModel) -> tuple[Residual, ...]:
    rows = []
    for bone in scanned.bones:
        within = (
            f"95 % of its places within {1e3 * bone.fit.percentile(95.0):.2f} mm; scale"
            f" {bone.scale:.3f}"
        )
        rows.append(
            Residual(
                what=f"CT of {bone.body} on the model's bone",
                value=1e3 * bone.fit.rms,
                unit="mm",
                detail=within,
            )
        )
    for bone, cluster in zip(scanned.bones, scanned.clusters, strict=True):
        if np.isfinite(cluster.misfit):
            rows.append(
                Residual(
                    f"CT cluster of {bone.body}, distances of markers", 1e3 * cluster.misfit, "mm"
                )
            )
    return tuple(rows)


def _model(path: Path, markers: Sequence[str]) -> Model:
    """Read a model; of MJCF, whose sites may be anything, those called as recorded markers are."""
    if path.suffix.lower() == ".osim":
        return open_model(path)
    # Brings MuJoCo: loaded only where it is needed.
    from myomorph.core.io.mjcf.read import read_mjcf

    return read_mjcf(path, marker_sites="|".join(re.escape(name) for name in markers) or None)


def body_named(model: Model, wanted: str | None, role: str, other: str = "") -> str:
    """Choose the body that a study file names, or the one whose name tells.

    Parameters
    ----------
    model : with the body
    wanted : name in the study file
    role : "base" or "first_body"
    other : a body of the same side

    Raises
    ------
    BadModel : no name tells, or several do
    """
    if wanted is not None:
        check_name("body", wanted, model.body_names, f"model '{model.name}'")
        return wanted
    for word in NAMED[role]:
        bodies = [
            name
            for name in model.body_names
            if word in name.lower() and "phantom" not in name.lower()
        ]
        sided = [name for name in bodies if other and name.lower().endswith(other.lower()[-2:])]
        bodies = bodies if len(bodies) == 1 else sided or bodies
        if len(bodies) == 1:
            return bodies[0]
        if bodies:
            raise BadModel(
                f"which body is the '{role}' of {listing('', bodies)}? Name it in the study file"
            )
    called = NAMED[role][0]
    has = listing(called, model.body_names)
    raise BadModel(
        f"no body is called '{called}': give '{role}' in the study file; the model has {has}"
    )


def _marked(model: Model, base: str, first: str, markers: Sequence[str]) -> tuple[str, ...]:
    parents = {joint.child: joint.parent for joint in model.joints}
    counts = Counter(marker.body for marker in model.markers if marker.name in set(markers))
    return tuple(
        body
        for body, n in counts.items()
        if n >= 3 and body != base and first in ancestors(parents, body)
    )


def _muscles(model: Model) -> dict[str, tuple[str, ...]]:
    """List those of [S] figure 1 where the model has them; else all between base and limb."""
    try:
        return dict(fig1_muscles(model))
    except BadModel:
        return {}


def open_swing(
    swing: SwingFiles,
    model: Model,
    files: SpecimenFiles,
    place: Callable[[Trial], Trial] | None = None,
) -> tuple[SwingTrial, tuple[str, ...]]:
    """Read a swing into the model's ground axes.

    Parameters
    ----------
    swing : its files
    model : of the specimen
    files : of the specimen
    place : puts the plates of a C3D file where they are

    Returns
    -------
    the swing, and notes
    """
    recorded = read_recording(swing.markers)
    if files.up is not None:
        recorded = recorded.rotated(turn_to(files.up, model.gravity))
    trial = fitted_to(model, recorded)
    turn = np.eye(3) if files.up is None else turn_to(files.up, model.gravity)
    turn = turn if trial is recorded else Z_UP_TO_Y_UP @ turn
    raw = turned(open_wrench(swing.loads, place), turn)
    wrenches, carried_notes = carrying(raw, model.gravity, swing.name, files.up)
    empty = None
    if files.tare is not None:
        empty = turned(open_wrench(files.tare, place), turn)
        empty = (
            replace(empty, forces=-empty.forces, torques=-empty.torques) if carried_notes else empty
        )
    assert trial.markers is not None
    notes = located(swing.name, (text for text in trial.warnings if "plate" not in text))
    return SwingTrial(
        name=swing.name, markers=trial.markers, wrenches=wrenches, time=swing.time, tare=empty
    ), (*carried_notes, *notes)


def recorded_markers(files: SwingFiles) -> Markers:
    """Read the markers of a recording.

    Raises
    ------
    BadFile : it has none
    """
    markers = read_recording(files.markers).markers
    if markers is None or not markers.names:
        raise BadFile(files.markers, "holds no markers")
    return markers


def open_wrench(path: Path, place: Callable[[Trial], Trial] | None = None) -> Wrenches:
    """Read the forces on the base.

    These are a table of force, point and torque in ground, an external loads file, or plates of a
    C3D.
    """
    ending = path.suffix.lower()
    with about(path):
        if ending == ".c3d":
            return plate_wrenches(
                read_recording(path) if place is None else place(read_recording(path))
            )
        if place is not None:
            raise BadFile(
                path,
                "is a table in ground, where no plate can be moved",
                "'plate' goes with C3D forces",
            )
        if ending == ".xml":
            return read_external_loads(path)
        if ending not in (".mot", ".sto"):
            raise BadFile(
                path,
                f"holds no forces: its name ends in '{ending}'",
                "expected .mot, .sto, .xml or .c3d",
            )
        return wrench_of_table(path)


def wrench_of_table(path: Path) -> Wrenches:
    """Read one force of nine columns, force, point and torque.

    They are known by endings (vx, px, x of a torque) or by their order.
    """
    table = read_sto(path)
    if len(table.names) != WHOLE:
        raise BadFile(
            path,
            f"has {len(table.names)} columns beside the time: {listing('', table.names)}",
            "give one force on the base: force, point and torque (9 columns)",
        )
    places = [_triple(table.names, ends) for ends in ("v", "p")]
    if all(place is not None for place in places):
        taken = [i for place in places if place is not None for i in place]
        places.append([i for i in range(WHOLE) if i not in taken])
    columns = places if len(places) == 3 else [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    force_column, point_column, torque_column = columns
    force = table.values[:, force_column][:, None, :]
    point = table.values[:, point_column][:, None, :]
    torque = table.values[:, torque_column][:, None, :]
    return Wrenches(
        time=table.time, names=("base",), bodies=("",), forces=force, points=point, torques=torque
    )


def _triple(names: Sequence[str], kind: str) -> list[int] | None:
    columns = [
        [i for i, name in enumerate(names) if name.lower().endswith(f"{kind}{axis}")]
        for axis in "xyz"
    ]
    return (
        [column[0] for column in columns] if all(len(column) == 1 for column in columns) else None
    )


def plate_wrenches(trial: Trial) -> Wrenches:
    """Read force and moment of all plates of a C3D file, as measured.

    They are not set to zero, and are about the plates' centers.
    """
    if not trial.plate_recordings:
        raise BadFile(
            trial.source,
            "holds no force plates",
            "give 'loads': a table of force, point and torque",
        )
    parts = []
    for plate in trial.plate_recordings:
        axes = plate_axes(plate.corners)
        force, moment = plate_wrench(plate)
        parts.append(
            (
                force @ axes.T,
                np.broadcast_to(plate.corners.mean(axis=0), force.shape),
                moment @ axes.T,
            )
        )
    force_values, point_values, torque_values = zip(*parts, strict=True)
    force = np.stack(force_values, axis=1)
    point = np.stack(point_values, axis=1)
    torque = np.stack(torque_values, axis=1)
    names = tuple(plate.name for plate in trial.plate_recordings)
    return Wrenches(
        time=trial.plate_time,
        names=names,
        bodies=("",) * len(names),
        forces=force,
        points=point,
        torques=torque,
    )
