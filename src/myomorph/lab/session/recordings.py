"""A recording looked at: its protocol and axes, whether somebody stands still, files beside it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from myomorph.core.io.formats import is_part, trial_format
from myomorph.core.io.inertial.read import read_inertial, sensor_files, sensors_of_trial
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadFile, MyomorphError
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Trial
from myomorph.core.motion.protocols import ProtocolTable, Recognized, Site, recognize
from myomorph.core.motion.sync import cut
from myomorph.lab.causes import SESSION
from myomorph.lab.session.sensor_recordings import is_still
from myomorph.lab.study.inputs.beside import plain_stem
from myomorph.lab.study.inputs.laboratory import AS_RECORDED, Laboratory, Up
from myomorph.lab.study.inputs.reading import read_recording
from myomorph.lab.study.inputs.table import INPUTS, input_of

# Markers of somebody who stands still stay within so much, the farthest tenth of the frames left
# out [m].
STILL = 0.03
STATIC_WORDS = (
    "static",
    "stand",
    "neutral",
    "calibration",
    "tpose",
    "t-pose",
    "t_pose",
    "anatomical",
)
SHARED = 0.6
ALIKE = 0.08
"""A static trial of the same body has this share of the markers, and distances that differ by less
than this.
"""
RIGID = (
    (("pelvis.asis", "right"), ("pelvis.asis", "left")),
    (("thigh.lateral_epicondyle", "right"), ("shank.lateral_malleolus", "right")),
    (("thigh.lateral_epicondyle", "left"), ("shank.lateral_malleolus", "left")),
)
FOREFOOT = tuple(
    f"foot.{one}" for one in ("mt1_head", "mt2_head", "mt5_head", "big_toe", "small_toe", "toe_tip")
)
SHOULDERS = tuple(f"trunk.{one}" for one in ("c7", "t2", "jugular_notch", "acromion"))
CHEST = tuple(f"trunk.{one}" for one in ("t8", "t10", "t12", "xiphoid"))
STERNUM = tuple(f"trunk.{one}" for one in ("jugular_notch", "sternum", "xiphoid"))
BACK = tuple(f"trunk.{one}" for one in ("c7", "t2", "t6", "t7", "t8", "t10"))
FACING = (
    ("the pelvis faces", ("pelvis.asis",), ("pelvis.psis", "pelvis.sacrum")),
    ("the feet point", FOREFOOT, ("foot.heel", "foot.ankle", "shank.lateral_malleolus")),
    ("the chest faces", STERNUM, BACK),
)
"""What shows which way people face: landmarks in front, and those behind them."""
MARKER_FOLDERS = ("MarkerData", "pose-3d", "markers")
"""Folders of markers that programs write, those first that are looked for first."""
# A laboratory's axes are taken to be along the walk where they are by less [degrees].
RIGHT_ANGLE = 20.0


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording and what was found in it.

    Attributes
    ----------
    trial : as the file has it
    found : what its labels lie on
    laboratory : how its axes stand to a model's, y up and x forward
    why_up, why_turn : why, in words; "" where nothing was turned
    still : somebody stands still in it
    near : files beside it that belong to it, by the input that they are of
    sensors, sensor_files : inertial sensors, which may be all there is, None and () for none
    """

    path: Path
    name: str
    trial: Trial
    found: Recognized
    laboratory: Laboratory
    why_up: str
    why_turn: str
    still: bool
    near: Mapping[str, Path] = field(default_factory=lambda: FrozenMap({}))
    sensors: InertialSensors | None = None
    sensor_files: tuple[Path, ...] = ()

    def shown_still(self, time: tuple[float, float] | None) -> bool:
        """Whether markers show somebody standing still, in a part of it [s] or throughout."""
        markers = self.trial.markers
        if markers is None:
            return False
        used = markers if time is None else cut(markers, *time)
        return stands_still(used[label] for label in self.found.sites)


def look_at(path: Path, name: str = "", table: ProtocolTable | None = None) -> Recording:
    """Look at the recording of a file.

    Raises
    ------
    BadFile, BadData
        where it cannot be read, or shows no motion
    """
    alone = sensor_files(path)
    if alone:
        return _of_sensors(path, name, Trial(source=str(path)), alone)
    trial = read_recording(path)
    if trial.markers is None or not len(trial.markers):
        if sensors_of_trial(trial) is not None:
            return _of_sensors(path, name, replace(trial, markers=None), (path,))
        raise BadData(
            f"{path}: holds no markers, so there is no motion to analyze: give the recording of the"
            " markers" + (", and this file's forces with it" if trial.plates else "")
        )
    names = [
        one for one in trial.markers.names if np.isfinite(trial.markers[one]).all(axis=1).any()
    ]
    found = recognize(names, table)
    places = {label: trial.markers[label] for label in found.sites}
    up, why_up = _up(trial, found, places)
    turn, why_turn = _turn(Laboratory(up), found, places)
    near = _near(path, trial)
    own = near.get("imu")
    files: tuple[Path, ...]
    if own is None:
        files = ()
    elif own == path:
        files = (path,)
    else:
        files = sensor_files(own)
    return Recording(
        path=path,
        name=name or plain_stem(path),
        trial=trial,
        found=found,
        laboratory=Laboratory(up, turn),
        why_up=why_up,
        why_turn=why_turn,
        still=stands_still(places.values()),
        near=near,
        sensors=read_inertial(files) if files else None,
        sensor_files=files,
    )


def _of_sensors(path: Path, name: str, trial: Trial, files: tuple[Path, ...]) -> Recording:
    """Look at a recording that inertial sensors alone show."""
    sensors = read_inertial(files)
    near = _near(path, trial)
    nothing = Recognized(None, FrozenMap({}))
    still = is_still(sensors)
    return Recording(
        path=path,
        name=name or plain_stem(path),
        trial=trial,
        found=nothing,
        laboratory=AS_RECORDED,
        why_up="",
        why_turn="",
        still=still,
        near=near,
        sensors=sensors,
        sensor_files=files,
    )


def _near(path: Path, trial: Trial) -> Mapping[str, Path]:
    """Files beside a recording, by the inputs that look for any."""
    near = {
        value.name: value.near(path, trial)
        for value in map(input_of, INPUTS)
        if value.near is not None
    }
    return FrozenMap({name: file for name, file in near.items() if file is not None})


def by_what_shows(recordings: Iterable[Recording]) -> tuple[list[Recording], list[Recording]]:
    """Sort recordings into those of markers, and those of sensors alone.

    Sensors that belong to a recording of markers are not listed again.
    """
    recordings = list(recordings)
    marked = [recording for recording in recordings if recording.trial.markers is not None]
    taken = {file for recording in marked for file in recording.sensor_files}
    return marked, [
        item for item in recordings if item.trial.markers is None and item.path not in taken
    ]


def mean_place(recording: Recording, *keys: str, side: str = "") -> Array | None:
    """Mean of the markers of landmarks.

    Parameters
    ----------
    recording : that was looked at
    keys : landmarks, as `foot.heel`
    side : of the body, "" for both

    Returns
    -------
    (frames, 3) [m]; None where there is none
    """
    markers = recording.trial.markers
    sites = recording.found.sites.items()
    assert markers is not None
    return _mean(
        recording.found,
        {label: markers[label] for label, site in sites if side in ("", site.side)},
        *keys,
    )


def _mean(
    recognized: Recognized, places: dict[str, Array], *keys: str, segments: tuple[str, ...] = ()
) -> Array | None:
    """Mean of the markers of landmarks or segments that have a place.

    Returns
    -------
    (frames, 3) [m]; None where there is none
    """
    chosen = [
        places[label]
        for label, site in recognized.sites.items()
        if label in places and (site.key in keys or site.segment in segments)
    ]
    if not chosen:
        return None
    with np.errstate(invalid="ignore"):
        stacked = np.stack(chosen)
        seen = np.isfinite(stacked).all(axis=2).any(axis=0)
        mean = np.full(stacked.shape[1:], np.nan)
        mean[seen] = np.nanmean(stacked[:, seen], axis=0)
    return mean


def _up(trial: Trial, recognized: Recognized, places: dict[str, Array]) -> tuple[Up, str]:
    """Find the axis that points up, "" where it is y; and why."""
    low = _mean(recognized, places, segments=("foot", "shank"))
    high = _mean(recognized, places, segments=("pelvis", "trunk", "head"))
    axis: Up = "y"
    why = ""
    what = "the trunk is above the feet"
    if low is None:
        low = _mean(recognized, places, *CHEST)
        high = _mean(recognized, places, *SHOULDERS)
        what = "the shoulders are above the chest"
    if low is not None and high is not None:
        along = np.nanmedian(high - low, axis=0)
        if np.isfinite(along).all() and np.abs(along).max() > 0.7 * np.linalg.norm(along):
            k = int(np.argmax(np.abs(along)))
            axis = ("-" if along[k] < 0.0 else "") + "xyz"[k]  # type: ignore[assignment]
            why = f"{what} along {axis}"
    if not why and trial.plates:
        normals = [
            np.cross(plate.corners[0] - plate.corners[1], plate.corners[0] - plate.corners[3])
            for plate in trial.plates
        ]
        k = int(np.argmax(np.abs(np.mean(normals, axis=0))))
        axis = "xyz"[k]  # type: ignore[assignment]
        why = f"the plates lie level with {axis}"
    if not why and Path(trial.source).suffix.lower() == ".c3d":
        axis = "z"
        why = "the z axis of a C3D file points up by convention"
    return ("", "") if axis == "y" else (axis, why)


def _turn(
    upright: Laboratory, recognized: Recognized, places: dict[str, Array]
) -> tuple[float, str]:
    """Find by how much the recording is turned so that people face along x.

    Returns
    -------
    angle about the vertical [degrees], and why
    """
    for what, before, behind in FACING:
        front = _mean(recognized, places, *before)
        back = _mean(recognized, places, *behind)
        if front is not None and back is not None:
            facing = (front - back) @ upright.rotation.T
            way = what
            break
    else:
        return 0.0, ""
    level = facing[:, [0, 2]]
    with np.errstate(invalid="ignore"):
        level = level / np.linalg.norm(level, axis=1, keepdims=True)
    level = level[np.isfinite(level).all(axis=1)]
    if not len(level):
        return 0.0, ""
    mean = level.mean(axis=0)
    if np.linalg.norm(mean) < 0.5:
        return 0.0, ""
    # About y, x goes to -z: a body that faces -z has turned by +90 degrees.
    faces = float(np.rad2deg(np.arctan2(-mean[1], mean[0])))
    nearest = 90.0 * round(faces / 90.0)
    turned = nearest if abs(faces - nearest) < RIGHT_ANGLE else round(faces)
    turn = float((-turned + 180.0) % 360.0 - 180.0)
    turn = 180.0 if turn == -180.0 else turn + 0.0
    if turn == 0.0:
        return 0.0, ""
    side = "left" if faces > 0.0 else "right"
    return turn, f"{way} {abs(faces):.0f}° to the {side} of the x axis"


def stands_still(places: Iterable[Array]) -> bool:
    """Whether somebody stands still: no marker of the body leaves its place.

    Parameters
    ----------
    places : (frames, 3) of each marker [m]

    Returns
    -------
    False without markers
    """
    ways = []
    for place in places:
        seen = place[np.isfinite(place).all(axis=1)]
        if len(seen):
            ways.append(
                float(np.linalg.norm(np.ptp(np.percentile(seen, (5.0, 95.0), axis=0), axis=0)))
            )
    return bool(ways) and float(np.percentile(ways, 90.0)) < STILL


def static_beside(recording: Recording, table: ProtocolTable | None = None) -> Recording | None:
    """Find a recording of standing still beside another one.

    Its name says that somebody stands, and it has the same markers on the same body.
    """
    for path in _static_files(recording.path):
        try:
            result = look_at(path, table=table)
        except MyomorphError:
            continue
        if result.still and same_body(result, recording):
            return result
    return None


def _static_files(path: Path) -> Iterator[Path]:
    """Yield recordings whose names, or whose folders' names, say that somebody stands still."""
    for other in sorted(path.parent.iterdir()):
        if _says_static(other.stem) and _is_another(other, path):
            yield other
    if not path.parent.parent.is_dir():
        return
    for home in sorted(path.parent.parent.iterdir()):
        if home.is_dir() and home != path.parent and _says_static(home.name):
            yield from (other for other in sorted(home.iterdir()) if _is_another(other, path))


def _says_static(name: str) -> bool:
    return any(word in name.lower() for word in STATIC_WORDS)


def _is_another(other: Path, path: Path) -> bool:
    """Whether a file is a recording, and not the one at the path."""
    return other != path and other.is_file() and trial_format(other) is not None


def same_body(recording: Recording, other: Recording) -> bool:
    """Whether two recordings share most markers and agree in lengths on pelvis and shanks."""
    mine = {site: label for label, site in recording.found.sites.items()}
    theirs = {site: label for label, site in other.found.sites.items()}
    shared = mine.keys() & theirs.keys()
    if len(shared) < 6 or len(shared) < SHARED * max(len(mine), len(theirs)):
        return False
    assert recording.trial.markers is not None
    assert other.trial.markers is not None
    for first, second in RIGID:
        ends = [site for end in (first, second) for site in shared if (site.key, site.side) == end]
        if len(ends) < 2:
            continue
        lengths = [
            float(
                np.nanmedian(
                    np.linalg.norm(markers[names[ends[0]]] - markers[names[ends[1]]], axis=1)
                )
            )
            for markers, names in ((recording.trial.markers, mine), (other.trial.markers, theirs))
        ]
        if abs(lengths[0] / lengths[1] - 1.0) > ALIKE:
            return False
    return True


def files_of(paths: Iterable[Path]) -> tuple[list[Path], list[Message]]:
    """Find the recordings that files and folders stand for.

    A folder is one of recordings, or of OpenCap (`MarkerData`) or Pose2Sim (`pose-3d`), of whose
    files of one recording the last stage counts: with markers added, else filtered, else as
    triangulated.

    Parameters
    ----------
    paths : files and folders

    Returns
    -------
    the recordings, and what was passed over, one line each

    Raises
    ------
    BadFile : a path does not exist, is no recording, or a folder holds none
    """
    found: list[Path] = []
    notes: list[Message] = []
    for path in paths:
        if not path.exists():
            raise BadFile(
                path,
                "does not exist",
                "give recordings of markers or inertial sensors, or their folder",
            )
        if path.is_file():
            if trial_format(path) is None and not sensor_files(path):
                raise BadFile(
                    path,
                    "is no recording of markers or inertial sensors",
                    "expected .c3d, .trc, or sensors' .sto, .mvnx, .h5, .csv, .txt",
                )
            found.append(path)
            continue
        inside = _in_folder(path, notes)
        if not inside:
            raise BadFile(
                path,
                "holds no recording of markers or inertial sensors",
                "expected .c3d, .trc, .mvnx, ...",
            )
        found += inside
    # Of sensors with a file each, the first stands for all.
    return list(dict.fromkeys((sensor_files(path) or (path,))[0] for path in found)), notes


def _in_folder(folder: Path, notes: list[Message]) -> list[Path]:
    """List recordings of markers in a folder, else those of sensors.

    Parameters
    ----------
    notes : gets what was passed over
    """
    written = _written_markers(folder)
    if written is not None:
        return _last_stage(written, notes)
    here = [path for path in sorted(folder.iterdir()) if path.is_file()]
    below = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    for files in (here, below):
        # As forces in files of their own, which are read with the markers.
        trials = [path for path in files if trial_format(path) and not is_part(path)]
        if trials:
            return _last_stage(trials, notes)
    of_sensors = [[path for path in files if sensor_files(path)] for files in (here, below)]
    return of_sensors[0] or of_sensors[1]


def _written_markers(folder: Path) -> list[Path] | None:
    """List recordings in the folders that a program wrote, of the first kind that is there."""
    for name in MARKER_FOLDERS:
        inside = sorted(path for path in folder.rglob(name) if path.is_dir())
        every = [path for home in inside for path in sorted(home.rglob("*"))]
        if inside:
            return [path for path in every if trial_format(path) is not None]
    return None


def _last_stage(files: list[Path], notes: list[Message]) -> list[Path]:
    """Of each recording that Pose2Sim wrote in several stages, the last."""
    kept: dict[Path, tuple[int, Path]] = {}
    for path in files:
        stem = path.stem
        stage = 0
        for number, mark in ((1, "_filt"), (2, "_LSTM")):
            if mark in path.stem:
                stem = stem.split(mark)[0]
                stage = number
        key = path.with_name(stem)
        if key in kept:
            notes.append(
                SESSION.message(
                    f"{kept[key][1].name} and {path.name} are stages of one recording: the last is"
                    " used",
                    severity="good to know",
                )
            )
        if key not in kept or stage > kept[key][0]:
            kept[key] = (stage, path)
    return [path for _, path in kept.values()]


def sites_of(recordings: Iterable[Recording]) -> dict[str, Site]:
    """Labels of all recordings, without the names of subjects, and what they lie on."""
    result: dict[str, Site] = {}
    for recording in recordings:
        for label, site in recording.found.sites.items():
            result.setdefault(bare(label), site)
    return result


def bare(label: str) -> str:
    """Take the subject's name before a label away."""
    return label.split(":")[-1].strip()


def standing_height(recording: Recording) -> float | None:
    """Height of the body that markers show, by the usual shares of a body's height.

    Parameters
    ----------
    recording : that was looked at

    Returns
    -------
    [m]; None where it is unknown

    Notes
    -----
    Source: Winter 2009, table 4.1 (after Drillis and Contini 1966): the acromion at 0.818 of the
    height, the ankle at 0.039.
    """
    high = mean_place(recording, "trunk.acromion")
    low = mean_place(recording, "shank.lateral_malleolus")
    if high is None or low is None:
        return None
    rise = ((high - low) @ recording.laboratory.rotation.T)[:, 1]
    rise = rise[np.isfinite(rise)]
    return float(np.percentile(rise, 90.0)) / (0.818 - 0.039) if len(rise) else None
