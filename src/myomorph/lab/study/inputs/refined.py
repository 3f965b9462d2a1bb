"""Coordinates that agree with markers and forces, and these forces.

They take the place of those of inverse kinematics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from myomorph.core.io.parsing.cells import csv_records
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import SETTINGS
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion, Wrenches
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.lab.store.results import file_name, file_source
from myomorph.lab.study.inputs.input import Input, Opened, Opening
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.reading import read_motion
from myomorph.lab.study.inputs.soft_tissue import SOFT_TISSUE, read_soft_tissue

if TYPE_CHECKING:
    from myomorph.core.motion.marker_checks import CheckedFit


CLOCKS = "clocks.csv"  # Table of `refine`, where it estimated the clock of forces.


@dataclass(frozen=True)
class RefinedFile:
    """What the subject's step `refine` found of a trial.

    Attributes
    ----------
    path : of its coordinates; no such file where the trial was not among its own
    cutoff : of the low-pass filter of the forces that these agree with [Hz]
    """

    path: Path
    cutoff: float


@read_only
class RefinedMotion:
    """Coordinates that agree with markers and forces.

    Attributes
    ----------
    motion : coordinates (frames, coordinates) [rad or m]; it holds nothing much above the cutoff
    cutoff : of the low-pass filter of the forces [Hz]
    tissue : by which its markers move more, None for not at all
    """

    motion: Motion
    cutoff: float
    tissue: SoftTissue | None = None

    @property
    def of_markers(self) -> Array:
        """(frames, coordinates) that the markers show."""
        if self.tissue is None:
            return self.motion.values
        from myomorph.core.motion.filters import differentiate

        return self.tissue.shown(differentiate(self.motion))


def _open(settings: RefinedFile, opening: Opening) -> Opened:
    """Read the refined motion, and external forces filtered as they were when it was refined.

    Raises `BadFile` where it is of another model.
    """
    path = settings.path
    loads = opening.values.get(ExternalLoads)
    if not path.is_file():
        return Opened()
    from myomorph.core.motion.sync import resample_wrenches

    motion = read_motion(path, opening.model)
    shift = _clock_offset(path)
    table = path.parent.parent / SOFT_TISSUE
    tissue = read_soft_tissue(table) if table.is_file() else None
    if motion.names != opening.model.coordinate_names:
        raise BadFile(
            path, "is no refined motion of this model", "run the study again with --fresh"
        )

    def filtered(moved: Motion) -> Wrenches:
        assert loads is not None
        wrenches = loads.of(moved)
        smooth = resample_wrenches(wrenches, wrenches.time, settings.cutoff)
        return smooth if shift == 0.0 else replace(smooth, time=smooth.time + shift)

    return Opened(
        (
            RefinedMotion(motion, settings.cutoff, tissue),
            None if loads is None else ExternalLoads.on_known_bodies(filtered),
        ),
        (file_source("refined motion", path),),
        real="coordinates refined together with body, masses and forces",
    )


def _clock_offset(path: Path) -> float:
    """Return what `refine` adds to the times of a trial's forces [s], 0 without an estimated clock.

    `path`: of the refined motion. Raises `BadFile` where the table of clocks is damaged.
    """
    table = path.parent.parent / CLOCKS
    if not table.is_file():
        return 0.0
    try:
        with table.open(encoding="utf-8", newline="") as stream:
            rows = list(csv_records(stream))
        offsets = {file_name(row["trial"]): float(row["offset_s"]) for row in rows}
        return offsets[path.stem]
    except (OSError, ValueError, KeyError, TypeError, BadData) as error:
        hint = "run the study again with --fresh"
        raise BadFile(table, f"has no clock of '{path.stem}' ({error})", hint) from error


INPUT = Input(name="refined", settings=RefinedFile, open=_open)


def refined_fit(
    name: str, model: Model, refined: RefinedMotion, checked: CheckedFit
) -> tuple[CheckedFit, tuple[Message, ...]]:
    """Put refined coordinates in the place of those of inverse kinematics.

    The fit gets their marker errors; notes are returned with it. Raises `BadData` where they are of
    other frames than the recording.
    """
    fit = checked.fit
    time = refined.motion.time
    step = float(np.median(np.diff(fit.motion.time)))
    rows = (fit.motion.time > time[0] - 0.5 * step) & (fit.motion.time < time[-1] + 0.5 * step)
    if rows.sum() != len(time) or np.abs(fit.motion.time[rows] - time).max() > 0.1 * step:
        raise BadData(
            f"{name}: its refined motion is of other frames than its markers: run again with"
            " --fresh"
        )
    markers = replace(
        checked.markers, time=fit.motion.time[rows], values=checked.markers.values[rows]
    )
    seen = np.isfinite(fit.motion.values[rows]).all(axis=1)
    motion = Motion(
        markers.time, refined.motion.names, np.where(seen[:, None], refined.motion.values, np.nan)
    )
    shown = Motion(
        markers.time, refined.motion.names, np.where(seen[:, None], refined.of_markers, np.nan)
    )
    errors = marker_distances(model, fit.marker_names, markers, shown)
    lost = len(fit.motion) - int(rows.sum())
    notes = (
        (
            (
                SETTINGS.message(
                    f"coordinates are refined from {time[0]:.2f} to {time[-1]:.2f} s, where forces"
                    f" were recorded; {lost} frames of markers before and after are not used"
                )
            ),
        )
        if lost > 1
        else ()
    )
    fit = replace(
        fit,
        motion=motion,
        marker_error=errors,
        converged=fit.converged[rows],
        iterations=fit.iterations[rows],
        loop_closure_error=None if fit.loop_closure_error is None else fit.loop_closure_error[rows],
    )
    return replace(checked, fit=fit, markers=markers), notes


def marker_distances(model: Model, names: Sequence[str], markers: Markers, motion: Motion) -> Array:
    """Return the distance of markers on a model in motion from those recorded.

    Parameters
    ----------
    model : that has the markers
    names : of the markers
    markers : recorded positions (frames, markers, 3) [m]
    motion : coordinates (frames, coordinates) [rad or m], NaN in frames without

    Returns
    -------
    (frames, names) [m], NaN where a marker was not recorded or the motion is not known
    """
    from myomorph.core.rigid.kinematics import forward_kinematics
    from myomorph.core.rigid.tree import compile_tree

    tree = compile_tree(model)
    known = np.isfinite(motion.values).all(axis=1)
    distances = np.full((len(motion), len(names)), np.nan)
    poses = forward_kinematics(tree, tree.coordinates_of(motion)[known])
    points = poses.markers([model.marker(name) for name in names])
    recorded = markers.values[:, [markers.names.index(name) for name in names]]
    distances[known] = np.linalg.norm(points - recorded[known], axis=2)
    return distances
