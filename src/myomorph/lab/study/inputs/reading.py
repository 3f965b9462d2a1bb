"""Input files as nouns that fit the model, or one sentence that says why not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from myomorph.core.contact.plates import force_plates
from myomorph.core.io.formats import read_model, read_trial
from myomorph.core.io.osim.document import legal
from myomorph.core.io.sto import motion_from_table, motion_notes, read_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import LABELS, LOOPS, READING, SETTINGS
from myomorph.core.model.errors import (
    BadData,
    BadFile,
    BadModel,
    MyomorphError,
    UnknownName,
    listing,
    quoted,
)
from myomorph.core.model.messages import Message, located
from myomorph.core.model.model import Model
from myomorph.core.model.series import Z_UP_TO_Y_UP, ForcePlate, Motion, Series, Trial

Named = TypeVar("Named", bound=Series)
TABLE_FILES = (".mot", ".sto")
SIZES = ((1000.0, "millimetres"), (100.0, "centimetres"), (0.001, "metres"), (0.0254, "inches"))
COUPLED = 0.1
"""How far a coordinate may lie from where its coupler puts it without a word [rad or m]; filters
move it by less.
"""


@contextmanager
def about(path: object) -> Iterator[None]:
    """Put the file's name before an error that does not name it."""
    try:
        yield
    except (BadFile, UnknownName, BadData, BadModel, ValueError) as error:
        if isinstance(error, MyomorphError) and str(path) in str(error):
            raise
        kind = BadModel if isinstance(error, BadModel) else BadData
        raise kind(f"{path}: {error}") from None


def open_model(path: str | Path) -> Model:
    """Read the model of a file; raise `BadFile` or `BadModel`."""
    with about(path):
        return read_model(path)


def has_mass(model: Model, step: str) -> None:
    """Raise `BadModel` where no body has a mass, so that forces would all be zero."""
    if not np.isfinite(model.mass) or model.mass <= 0.0:
        raise BadModel(
            f"{model.source or model.name}: {step} needs masses, but the model's bodies weigh"
            f" {model.mass:g} kg; give the bodies their masses"
        )


def read_recording(path: str | Path) -> Trial:
    """Read a recording of markers or keypoints, plates as forces in the laboratory.

    Source: Motion Lab Systems, the C3D file format; see docs/conventions.md.

    Parameters
    ----------
    path : of a recording of markers (C3D, TRC, ...)

    Returns
    -------
    markers [m], plates as forces [N] in ground, EMG, events, what looks wrong in `warnings`

    Raises
    ------
    BadFile, BadData
        where the file cannot be read, or a force plate's data are not what its type says

    Examples
    --------
    >>> import myomorph as mm
    >>> trial = mm.read_recording("reach.trc")
    >>> trial.markers.names, trial.markers.values.shape
    (('UA1', 'UA2', 'FA1', 'FA2'), (61, 4, 3))
    """
    with about(path):
        trial = read_trial(path)
        return force_plates(trial) if trial.plate_recordings else trial


def with_labels(trial: Trial, labels: Mapping[str, str]) -> Trial:
    """Return the trial with its markers under the model's names.

    Parameters
    ----------
    trial : recording
    labels : recorded label to the model's name, or to "" where the marker is left out; a label that
        was not recorded is passed over, for labels differ from file to file, but one of them must
        be there

    Returns
    -------
    the trial, with a warning where none of the labels was recorded

    Raises
    ------
    BadData : two markers would have the same name
    """
    if trial.markers is None or not labels:
        return trial
    recorded = trial.markers.names
    if not any(name in labels for name in recorded):
        warning = LABELS.message(
            f"labels: none of its {len(labels)} labels was recorded, which are"
            f" {listing(next(iter(labels)), recorded)}"
        )
        return replace(trial, warnings=(*trial.warnings, warning))
    with about(trial.source):
        return replace(trial, markers=renamed(trial.markers, labels))


def renamed(series: Named, labels: Mapping[str, str]) -> Named:
    """Rename the columns of a series, without those whose new name is "".

    Raises `BadData` where two would have the same name.
    """
    kept = [column for column, name in enumerate(series.names) if labels.get(name, name)]
    series = series.columns(kept)
    names = tuple(labels.get(name, name) for name in series.names)
    for name, count in Counter(names).items():
        if count > 1:
            same = " and ".join(
                repr(old) for old, new in zip(series.names, names, strict=True) if new == name
            )
            raise BadData(f"{same} would both be named '{name}'")
    return replace(series, names=names)


def check_labels(labels: Mapping[str, str], model: Model) -> None:
    """Raise `UnknownName` where labels are mapped to markers that the model does not have."""
    for name in labels.values():
        if name and name not in model.marker_names:
            raise UnknownName(
                "marker", name, existing=model.marker_names, where="labels: the model"
            )


def fitted_to(model: Model, trial: Trial) -> Trial:
    """Turn the trial to the model's ground frame, and check its markers against the model's size.

    A C3D file in which a standing body is tallest along z, or whose plates lie level with z, and a
    Qualisys export, whose z points up by convention, are turned to the model's vertical, with a
    warning. Nothing is turned where a standing body is tallest along y.
    """
    trial = _with_legal_labels(trial, model)
    markers = trial.markers
    if markers is None or not markers.names:
        raise BadData(f"{trial.source}: holds no markers")
    if len(markers) == 0:
        raise BadData(f"{trial.source}: holds no frames")
    shared = [name for name in model.marker_names if name in markers.names]
    if not shared:
        with about(trial.source):
            from myomorph.core.motion.ik import InverseKinematicsOptions, tracked_markers

            tracked_markers(model, markers, InverseKinematicsOptions())
    if 2 * len(shared) < min(len(model.markers), len(markers.names)):
        others = [name for name in markers.names if name not in shared]
        warning = LABELS.message(
            f"{len(shared)} of the model's {len(model.markers)} markers were recorded, and"
            f" {len(others)} labels are not among its markers ({quoted(others, 3)}): are these its"
            " markers under other names (--labels)?"
        )
        trial = replace(trial, warnings=(*trial.warnings, warning))
    # Brings Numba and SciPy: a model alone is read without.
    from myomorph.core.motion.measurements import default_markers

    own = default_markers(model, shared)
    recorded = markers.values[:, [markers.names.index(name) for name in shared]]
    if not np.isfinite(recorded).all(axis=2).any():
        raise BadData(
            f"{trial.source}: none of its {len(markers)} frames shows a marker that the model has"
        )
    _check_size(trial.source, own, recorded)
    why = _why_z_is_up(model, trial, own, recorded)
    if not why:
        return trial
    warning = READING.message(f"{why}: the recording was rotated to the model's y axis")
    return replace(trial.rotated(Z_UP_TO_Y_UP), warnings=(*trial.warnings, warning))


def _with_legal_labels(trial: Trial, model: Model) -> Trial:
    """Return the trial with labels as a model's file has them.

    `r asis` is `r_asis` there, for OpenSim refuses blanks.
    """
    recorded = trial.markers.names if trial.markers is not None else ()
    written = [legal(name) for name in recorded]
    lacking = {
        name for name in model.marker_names if name not in recorded and written.count(name) == 1
    }
    return with_labels(
        trial, {old: new for old, new in zip(recorded, written, strict=True) if new in lacking}
    )


def _check_size(source: str, own: Array, recorded: Array) -> None:
    """Refuse markers a hundred times too large or small: the stated unit must be wrong."""
    size = _spread(recorded)
    expected = float(np.linalg.norm(np.ptp(own, axis=0)))
    if len(own) < 3 or expected <= 0.0 or not np.isfinite(size) or size <= 0.0:
        return
    ratio = size / expected
    if 1.0 / 15.0 < ratio < 15.0:
        return
    guess = min(SIZES, key=lambda one: abs(np.log(ratio / one[0])))
    hint = (
        f"are its numbers {guess[1]}?"
        if 0.5 < ratio / guess[0] < 2.0
        else "does it belong to this model?"
    )
    raise BadData(
        f"{source}: its markers spread over {size:.4g} m, those of the model over {expected:.3g} m;"
        f" {hint} Correct the unit in the file's header"
    )


def _spread(recorded: Array) -> float:
    """Return the median over frames of the diagonal of the box around the markers [m].

    It is nan without enough of them.
    """
    seen = np.isfinite(recorded).all(axis=2)
    full = recorded[seen.sum(axis=1) >= max(3, 0.6 * seen.shape[1])]
    if not len(full):
        return float("nan")
    extent = np.nanmax(full, axis=1) - np.nanmin(full, axis=1)
    return float(np.median(np.linalg.norm(extent, axis=1)))


def _why_z_is_up(model: Model, trial: Trial, own: Array, recorded: Array) -> str:
    """Name what shows that z is up in the recording but y in the model; "" where nothing does."""
    ending = Path(trial.source).suffix.lower()
    if ending not in (".c3d", ".mat") or model.gravity[1] >= 0.0:
        return ""
    size = np.ptp(own, axis=0)
    seen = recorded[np.isfinite(recorded).all(axis=(1, 2))]
    if len(seen) and size[1] > 1.3 * size[2]:
        extent = np.median(np.ptp(seen, axis=1), axis=0)
        if extent[2] > 1.3 * extent[1]:
            return "the laboratory's z axis points up"
        if extent[1] > 1.3 * extent[2]:
            return ""
    if ending == ".mat":
        return "the z axis of a Qualisys export points up by convention"
    return "the plates lie level with z" if trial.plates and all(map(faces_z, trial.plates)) else ""


def faces_z(plate: ForcePlate) -> bool:
    """Whether a plate's normal is the z axis."""
    normal = np.cross(plate.corners[0] - plate.corners[1], plate.corners[0] - plate.corners[3])
    return bool(abs(normal[2]) > 0.9 * np.linalg.norm(normal) > 0.0)


def read_motion(path: str | Path, model: Model) -> Motion:
    """Coordinates over time for a model.

    Source: Seth et al. 2018, OpenSim's storage files.

    Parameters
    ----------
    path : of an STO or MOT file
    model : whose coordinates the columns are

    Returns
    -------
    coordinates (frames, coordinates) [rad or m], degrees turned into radians

    Raises
    ------
    BadFile, BadData
        where the file is no table of coordinates, or some coordinates of a frame are missing

    Examples
    --------
    >>> import myomorph as mm
    >>> motion = mm.read_motion("reach.mot", mm.read_model("arm.osim"))
    >>> len(motion), motion.names
    (61, ('shoulder_flexion', 'elbow_flexion'))
    """
    return read_noted_motion(path, model).motion


class NotedMotion(NamedTuple):
    """Coordinates of a file, and what was assumed or repaired when it was read."""

    motion: Motion
    notes: tuple[Message, ...]


def read_noted_motion(path: str | Path, model: Model) -> NotedMotion:
    """Coordinates over time for a model, with notes; see `read_motion`."""
    ending = Path(path).suffix.lower()
    if ending not in TABLE_FILES:
        raise BadFile(
            path, f"is not a motion: its name ends in '{ending}'", "expected .mot or .sto"
        )
    with about(path):
        table = read_sto(path)
        motion = motion_from_table(table, model)
    missing = np.isnan(motion.values)
    partly = missing.any(axis=1) & ~missing.all(axis=1)
    if partly.any():
        frame = int(np.argmax(partly))
        name = motion.names[int(np.argmax(missing[frame]))]
        raise BadData(
            f"{path}: coordinate '{name}' has no finite value at {motion.time[frame]:g} s"
            f" ({int(partly.sum())} such frames); fill the gap, or leave those frames out with"
            " --time START END"
        )
    notes = (*motion_notes(table, model), *table.warnings)
    return NotedMotion(motion, located(Path(path).name, notes))


def whole_motion(motion: Motion, model: Model) -> tuple[Motion, tuple[str, ...]]:
    """Return the motion with all coordinates of the model, and those that are missing.

    Those are missing that the motion does not hold and no coupler gives.
    """
    if set(motion.names) == set(model.coordinate_names):
        return motion, ()
    from myomorph.core.rigid.tree import compile_tree

    values = compile_tree(model).coordinates_of(motion)
    known = (*motion.names, *model.dependent_coordinates)
    lacking = tuple(name for name in model.coordinate_names if name not in known)
    return Motion(motion.time, model.coordinate_names, values), lacking


def coupled_motion(motion: Motion, model: Model) -> tuple[Motion, tuple[Message, ...]]:
    """Put coordinates that couplers drive where the couplers put them.

    Notes report those that were elsewhere.

    OpenSim 3 wrote a coordinate that is neither an angle nor a length (a patella's) in degrees,
    OpenSim 4 takes such a column as it stands: one in degrees would be read as 57 times as much.
    """
    driven = [name for name in model.dependent_coordinates if name in motion.names]
    if not driven or not len(motion):
        return motion, ()
    from myomorph.core.rigid.tree import compile_tree

    coupled = compile_tree(model).coordinates_of(motion)
    values = np.array(motion.values)
    notes = []
    for name in driven:
        own = values[:, motion.names.index(name)]
        right = coupled[:, model.coordinate_names.index(name)]
        apart = np.abs(np.nan_to_num(own - right))
        worst = int(np.argmax(apart))
        if apart[worst] > COUPLED:
            notes.append(
                LOOPS.message(
                    f"'{name}' is {own[worst]:.4g} at {motion.time[worst]:.2f} s where its coupler"
                    f" puts it at {right[worst]:.4g}: the coupler's value is taken throughout"
                )
            )
        values[:, motion.names.index(name)] = np.where(np.isnan(own), own, right)
    return replace(motion, values=values), tuple(notes)


class PosesBy:
    """Poses of bodies in ground at any time of a motion, for loads given in moving frames."""

    def __init__(self, model: Model, motion: Motion):
        self.model = model
        self.motion = motion

    def __call__(self, body: str, time: Array) -> tuple[Array, Array]:
        """Rotations (frames, 3, 3) and origins (frames, 3) of a body."""
        from myomorph.core.rigid.kinematics import forward_kinematics
        from myomorph.core.rigid.tree import compile_tree

        tree = compile_tree(self.model)
        if body not in tree.body_index:
            raise UnknownName("body", body, self.model.body_names)
        columns = [np.interp(time, self.motion.time, column) for column in self.motion.values.T]
        values = np.array(columns).T.reshape(len(time), len(self.motion.names))
        poses = forward_kinematics(
            tree, tree.coordinates_of(Motion(time, self.motion.names, values))
        )
        b = tree.body_index[body]
        return poses.rotations[:, b], poses.origins[:, b]


def cut_to(
    time: tuple[float, float] | None, series: Series, path: object
) -> tuple[float, float] | None:
    """Check a time range that a user gave against a recording.

    Raises `BadData` where it ends before it starts, or holds no frame of the recording.
    """
    if time is None:
        return None
    start, end = time
    if not start < end:
        raise BadData(f"--time {start:g} {end:g}: expected a start before an end [s]")
    first = float(series.time[0])
    last = float(series.time[-1])
    if end < first or start > last:
        raise BadData(
            f"{path}: runs from {first:g} to {last:g} s, so it has nothing from {start:g} to"
            f" {end:g} s"
        )
    return start, end


def cut_warning(time: tuple[float, float] | None, series: Series) -> tuple[Message, ...]:
    """Report what a requested time range has beyond the recording.

    It would otherwise be cut in silence.
    """
    if time is None or len(series) < 2:
        return ()
    first = float(series.time[0])
    last = float(series.time[-1])
    step = (last - first) / (len(series) - 1)
    if time[0] > first - 1.5 * step and time[1] < last + 1.5 * step:
        return ()
    used = f"{max(time[0], first):.4g} to {min(time[1], last):.4g} s"
    asked = f"time {time[0]:g} to {time[1]:g} s was requested"
    return (
        SETTINGS.message(f"{asked}, but it runs from {first:.4g} to {last:.4g} s: {used} are used"),
    )
