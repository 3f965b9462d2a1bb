"""What fixes bones and plate among the markers.

These are CT scans of bones with their clusters, and a marked weight on the plate.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import Field

from myomorph.core.contact.plate_placements import MarkedWeight, Placement, find_placements
from myomorph.core.io.mesh import find_mesh, read_mesh
from myomorph.core.io.parsing.cells import csv_rows
from myomorph.core.io.parsing.door import content_of
from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.model.messages import located
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, PlateRecording, Trial
from myomorph.core.model.surface import Surface
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.surfaces import clusters as register
from myomorph.lab.store import named_files
from myomorph.lab.store.study_file import Strict
from myomorph.lab.study.inputs.reading import about, read_recording
from myomorph.swings.plate_calibration import PlateCalibration, calibrate_plate, place_plate
from myomorph.swings.viscosity.report.specimen_report import Residual
from myomorph.swings.viscosity.study.study_folder import StudyFolder

UNITS = {"m": 1.0, "mm": 0.001}
HUGE = 1.5  # A scanned surface that is larger than that is in millimetres [m].


class ScanFiles(Strict):
    """One scanned bone, as an entry of `ct` in a study file.

    Attributes
    ----------
    bone : body of the model
    surface, cluster : STL, PLY, OBJ or VTP of the bone and of its cluster, in one frame
    markers : of the cluster, as motion capture names them
    picked : table of points (CSV: name, x, y, z and, for points that are no marker of the model,
        bone_x, bone_y, bone_z in the body's frame [m]), or None; points called as `markers` tell
        which ball is which
    mesh : the model's bone in the body's frame [m], None for the meshes that the model names
    unit : of the scan, "m" or "mm"; None tells by the size
    diameter : of the markers' balls [m]
    """

    bone: str
    surface: Path
    cluster: Path
    markers: tuple[str, ...]
    picked: Path | None = None
    mesh: Path | None = None
    unit: str | None = None
    diameter: float = 0.009

    def within(self, folder: Path) -> ScanFiles:
        """Make the paths of an entry whole.

        Parameters
        ----------
        folder : of the study file

        Raises
        ------
        BadData : an unknown unit, or few markers
        """
        if len(self.markers) < 3:
            raise BadData(
                f"ct of '{self.bone}': {len(self.markers)} markers, but a cluster needs three"
            )
        if self.unit is not None and self.unit not in UNITS:
            raise BadData(
                f"ct of '{self.bone}': unit '{self.unit}' is not one of {', '.join(UNITS)}"
            )
        paths = {name: path for name, path in self if isinstance(path, Path)}
        return self.model_copy(update={name: folder / path for name, path in paths.items()})


@dataclass(frozen=True, eq=False)
class ScannedModel:
    """A model with bones of the size of the scanned ones and the markers of a CT.

    Attributes
    ----------
    model : with these
    bones : how each was laid on the model's
    clusters : markers found in each cluster's surface
    notes : a line each
    """

    model: Model
    bones: tuple[register.ScannedBone, ...]
    clusters: tuple[register.NamedCluster, ...]
    notes: tuple[str, ...]


def model_from_scans(
    model: Model, scans: Sequence[ScanFiles], recorded: Markers | None = None
) -> ScannedModel:
    """Put the markers of scanned clusters on a model's bones ([S] figure 3).

    Parameters
    ----------
    model : with the bones
    scans : of bones and clusters
    recorded : a trial; distances between its markers tell which ball is which and are checked
        against the scan

    Returns
    -------
    the model, and how well all of it fits
    """
    bones = []
    clusters = []
    for scan in scans:
        scanned = read_mesh(scan.surface)
        small = float(np.ptp(scanned.vertices, axis=0).max()) <= HUGE
        factor = UNITS[scan.unit or ("m" if small else "mm")]
        points = {} if scan.picked is None else read_picks(scan.picked)
        distances = _distances(recorded, scan.markers)
        near = {name: factor * row[:3] for name, row in points.items() if name in scan.markers}
        with about(scan.cluster):
            balls = register.find_balls(_sized(read_mesh(scan.cluster), factor), scan.diameter)
            cluster = register.name_cluster(balls, scan.markers, distances, near)
        with about(scan.surface):
            picks = _picks(model, scan, points, factor)
            bone = register.BoneScan(surface=_sized(scanned, factor), markers=cluster.centers)
            bones.append(
                register.place_scanned_bone(scan.bone, bone, _modelled(model, scan), picks)
            )
        clusters.append(cluster)
    placed = register.place_cluster_markers(
        model, bones, path_lengths=default_path_lengths if model.muscles else None
    )
    notes = [line for bone in bones for line in bone.notes]
    notes += [
        note
        for scan, cluster in zip(scans, clusters, strict=True)
        for note in located(scan.bone, cluster.notes)
    ]
    return ScannedModel(
        model=placed, bones=tuple(bones), clusters=tuple(clusters), notes=tuple(notes)
    )


def read_picks(path: Path) -> dict[str, Array]:
    """Read a table of picked points.

    Parameters
    ----------
    path : of the table

    Returns
    -------
    (3,) or (6,) by name: x, y, z of the scan, perhaps of the bone (bone_x, ...) too
    """
    try:
        rows = list(csv_rows(content_of(path, "settings").decode("utf-8-sig").splitlines()))
    except (UnicodeDecodeError, BadData):
        raise BadFile(path, "cannot be read (not text)") from None
    result: dict[str, Array] = {}
    for number, row in enumerate(rows, start=1):
        cells = [cell.strip() for cell in row]
        if not any(cells):
            continue
        filled = [cell for cell in cells[1:] if cell]
        try:
            values = np.array([float(cell) for cell in filled])
        except ValueError:
            values = np.zeros(0)
        if len(values) not in (3, 6) or not np.isfinite(values).all():
            if number == 1:
                continue
            raise BadFile(path, f"line {number} is not 'name, x, y, z': {','.join(row)[:60]!r}")
        result[cells[0]] = values
    if not result:
        raise BadFile(
            path,
            "holds no point",
            "give lines 'name, x, y, z', or with bone_x, bone_y, bone_z behind",
        )
    return result


def _sized(surface: Surface, factor: float) -> Surface:
    return Surface(factor * surface.vertices, surface.faces)


def _modelled(model: Model, scan: ScanFiles) -> Surface:
    """Read the model's bone in its body's frame."""
    body = model.body(scan.bone)
    if scan.mesh is not None:
        return read_mesh(scan.mesh)
    folder = Path(model.source).resolve().parent
    folders = [
        place
        for name in ("", "Geometry", "geometry", "meshes")
        if (place := folder / name).is_dir()
    ]
    meshes = {}
    for name in (mesh.file for mesh in body.meshes if mesh.shape == "mesh" and mesh.file):
        # Models from packages name their meshes by whole paths; only those beside the model are
        # opened.
        whole = (
            Path(name).is_absolute()
            and is_named_file(Path(name))
            and Path(name).resolve().is_relative_to(folder)
        )
        path = Path(name) if whole else find_mesh(name, folders)
        if path is not None:
            meshes[name] = read_mesh(path)
    return register.bone_surface(body, meshes)


def _picks(
    model: Model, scan: ScanFiles, points: Mapping[str, Array], factor: float
) -> register.Picks | None:
    """List points of the scan and of the model's bone; None if fewer than three were picked."""
    locations = {
        marker.name: marker.location for marker in model.markers if marker.body == scan.bone
    }
    pairs = {}
    for name, row in points.items():
        if len(row) == 6:
            pairs[name] = (factor * row[:3], row[3:])
        elif name in locations and name not in scan.markers:
            pairs[name] = (factor * row, locations[name])
        elif name not in scan.markers:
            raise UnknownName(
                "picked point", name, existing=tuple(locations), where=f"body '{scan.bone}'"
            )
    if not pairs:
        return None
    if len(pairs) < 3:
        raise BadData(f"{len(pairs)} points were picked on '{scan.bone}', but three are needed")
    scanned, modelled = map(np.array, zip(*pairs.values(), strict=True))
    return register.Picks(tuple(pairs), scanned, modelled)


def _distances(recorded: Markers | None, names: Sequence[str]) -> Array | None:
    """Find median distances between recorded markers.

    Returns
    -------
    (markers, markers) [m], NaN where two were never seen together
    """
    if recorded is None:
        return None
    lacking = [name for name in names if name not in recorded.names]
    if lacking:
        raise UnknownName("marker", lacking[0], existing=recorded.names, where="the recording")
    places = np.stack([recorded[name] for name in names], axis=1)
    apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=3)
    result = np.full(apart.shape[1:], np.nan)
    seen = np.isfinite(apart).any(axis=0)
    result[seen] = np.nanmedian(apart[:, seen], axis=0)
    return result


@dataclass(frozen=True)
class PlateFiles:
    """What a study file says of the plate.

    Attributes
    ----------
    placements : C3D recordings of the weight on the plate, one or more placements in each
    weight : what stood on it
    plate : its name in the C3D files, "" where they hold one plate only
    """

    placements: tuple[Path, ...]
    weight: MarkedWeight
    plate: str = ""


class PlateTable(Strict):
    """C3D recordings of a marked weight on the plate, from which its place is calibrated."""

    placements: list[str] = Field(min_length=1)
    markers: list[str] = Field(min_length=1)
    shares: list[float] | None = None
    mass: float | None = Field(default=None, gt=0.0)
    axis: tuple[str, str] | None = None
    tip: float | None = None
    name: str = ""


def found_scans(scans: Sequence[ScanFiles], where: str, folder: StudyFolder) -> Iterator[ScanFiles]:
    """Find the files of scanned bones.

    Parameters
    ----------
    scans : entries of the study file
    where : in the study file, for what is noted
    folder : of the study file

    Yields
    ------
    entries with whole paths
    """
    problems = folder.problems
    for scan in scans:
        for path in (scan.surface, scan.cluster, scan.picked, scan.mesh):
            name = None if path is None else str(path)
            named_files.existing(folder.path, name, f"{where} of '{scan.bone}'", problems)
        try:
            yield scan.within(folder.path)
        except BadData as error:
            problems.append(f"{where}: {error}")


def plate_files(table: PlateTable, where: str, folder: StudyFolder) -> PlateFiles | None:
    """Find the recordings of a weight on the plate.

    Parameters
    ----------
    table : of the study file
    where : in the study file, for what is noted
    folder : of the study file

    Returns
    -------
    None where the weight cannot be as it is described
    """
    problems = folder.problems
    placements = [
        path
        for name in table.placements
        for path in named_files.matching(folder.path, name, where, problems)
    ]
    problems += [
        f"{where}: '{path.name}' is no C3D recording"
        for path in placements
        if path.suffix.lower() != ".c3d"
    ]
    try:
        weight = MarkedWeight(
            name="weight",
            markers=tuple(table.markers),
            shares=None if table.shares is None else tuple(table.shares),
            mass=table.mass,
            axis=table.axis,
            tip=table.tip,
        )
    except BadData as error:
        problems.append(f"{where}: {error}")
        return None
    return PlateFiles(tuple(placements), weight, table.name)


def calibrate(files: PlateFiles) -> PlateCalibration:
    """Find the plate's pose in the laboratory of the C3D files.

    Raises
    ------
    BadFile, BadData, UnknownName
        where a file holds no such plate or weight, or too few placements
    """
    placements: list[Placement] = []
    nominal: PlateRecording | None = None
    for path in files.placements:
        trial = read_recording(path)
        with about(path):
            if trial.markers is None:
                raise BadData("holds no markers of the weight")
            nominal = chosen(trial, files.plate)
            placements += find_placements(nominal, trial.plate_time, trial.markers, files.weight)
    return calibrate_plate(placements, nominal)


def chosen(trial: Trial, name: str) -> PlateRecording:
    """Choose the plate of that name, or the only one."""
    plates = {recording.name: recording for recording in trial.plate_recordings}
    if not plates:
        raise BadFile(trial.source, "holds no force plates", "plates are calibrated from C3D files")
    if name and name not in plates:
        raise UnknownName("force plate", name, existing=tuple(plates), where=trial.source)
    if not name and len(plates) > 1:
        raise BadData(
            f"{trial.source}: holds {len(plates)} plates ({', '.join(plates)}): name one as"
            " 'plate.name'"
        )
    return plates[name] if name else next(iter(plates.values()))


def placed(trial: Trial, files: PlateFiles, calibration: PlateCalibration) -> Trial:
    """Leave one plate in a recording, where the calibration says."""
    return replace(trial, plate_recordings=(place_plate(chosen(trial, files.plate), calibration),))


def plate_residuals(plate_calibration: PlateCalibration) -> tuple[Residual, ...]:
    """List the calibration as lines of the report."""
    left_out = plate_calibration.left_out_distances, plate_calibration.left_out_angles
    far_residuals, turned_residuals = left_out
    far = float(np.sqrt(np.mean(far_residuals**2)))
    turned = float(np.sqrt(np.mean(turned_residuals**2)))
    count = f"{len(plate_calibration.names)} placements"
    shift = 1e3 * float(np.max(plate_calibration.left_out_shifts, initial=0.0))
    past = 1e3 * plate_calibration.distance_rms
    angle = np.degrees(plate_calibration.angle_rms)
    rows = (
        ("force past the marked point", past, "mm", f"{count}; {1e3 * far:.2f} mm left out"),
        ("direction of the force", angle, "°", f"{count}; {np.degrees(turned):.2f}° left out"),
        ("shift of its center", shift, "mm", "the largest when one placement is left out"),
    )
    return tuple(
        Residual(what=f"plate: {what}", value=float(value), unit=unit, detail=detail)
        for what, value, unit, detail in rows
    )
