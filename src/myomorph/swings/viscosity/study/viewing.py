"""Swings of a specimen as a page plays them.

Its motion is in a file, its model is made again from that of the study.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadFile, MyomorphError
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform
from myomorph.lab.report.page.parts import PageHead
from myomorph.lab.report.trial.report_input import Kinematics, Recorded, ReportInput
from myomorph.lab.store.results import file_source
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.study.trial.reporting import reduced_for_pictures, surfaces_of
from myomorph.swings.viscosity.identification.identify import STATES
from myomorph.swings.viscosity.specimen.model import SpecimenNames, build_specimen
from myomorph.swings.viscosity.study.results import write_whole
from myomorph.swings.viscosity.tracking.tracked import TrackedSpecimen

SWINGS = "swings.json"
RATE = 60.0  # Frames a second that are kept at most [Hz].
DIGITS = 5


def write_view(tracked: Mapping[str, TrackedSpecimen], folder: Path) -> None:
    """Write what `swings_of` plays.

    That is how each condition's specimen is made from the model, and where it swung.
    """
    conditions = {}
    for name, condition in tracked.items():
        model = condition.specimen.model
        conditions[name] = {
            "names": asdict(condition.specimen.names)
            | {"muscles": dict(condition.specimen.names.muscles)},
            "gravity": np.asarray(model.gravity).tolist(),
            "joints": {
                joint.name: [_plain(joint.parent_frame), _plain(joint.child_frame)]
                for joint in model.joints
            },
            "coordinates": {each.name: [each.default, each.locked] for each in model.coordinates},
            "trials": {trial.name: _thinned(trial.motion) for trial in condition.trials},
        }
    source = next(iter(tracked.values())).specimen.model.source
    stored = {
        "model": source,
        "sha256": file_source("model", source).sha256,
        "conditions": conditions,
    }
    write_whole(json.dumps(stored, separators=(",", ":")) + "\n", folder / SWINGS)


def swings_of(folder: Path) -> Mapping[str, Callable[[], ReportInput]]:
    """Find the swings in a folder of results, of one specimen or of a study, by name."""
    result: dict[str, Callable[[], ReportInput]] = {}
    for path in sorted([*folder.glob(SWINGS), *folder.glob(f"*/{SWINGS}")]):
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
            for condition, entries in stored["conditions"].items():
                for trial in entries["trials"]:
                    name = f"{path.parent.name} {trial}"
                    name += f" ({STATES[condition]})" if name in result else ""
                    result[name] = partial(_opened, path, stored, condition, trial, name)
        except (OSError, ValueError, KeyError, AttributeError) as error:
            raise BadFile(
                path, f"holds no swings that can be read ({error})", "run the study again"
            ) from None
    return result


def _opened(
    path: Path, stored: Mapping[str, Any], condition: str, trial: str, name: str
) -> ReportInput:
    entries = stored["conditions"][condition]
    source = Path(stored["model"])
    if not source.is_file() or file_source("model", source).sha256 != stored["sha256"]:
        raise BadFile(
            source,
            "is gone or has changed, but the model is needed",
            f"{path} was made with it: run again",
        )
    try:
        model = _specimen_model(open_model(source), entries)
        if condition == "without":
            model = replace(model, muscles=(), wrap_objects=())
        motion = entries["trials"][trial]
        moved = Motion(
            np.array(motion["time"]),
            tuple(motion["names"]),
            np.array(motion["values"], dtype=np.float64),
        )
    except (ValueError, KeyError, TypeError, MyomorphError) as error:
        raise BadFile(
            path, f"holds no swings that can be read ({error})", "run the study again"
        ) from None
    surfaces = reduced_for_pictures(surfaces_of(model))
    head = PageHead(name)
    return ReportInput(
        head=head,
        model=model,
        surfaces=surfaces,
        recorded=Recorded(subject=path.parent.name),
        kinematics=Kinematics(coordinates=moved),
    )


def _specimen_model(model: Model, entries: Mapping[str, Any]) -> Model:
    """Make the specimen of the study as it stood, without markers."""
    names = entries["names"]
    specimen_names = SpecimenNames(
        base=names["base"],
        first=names["first"],
        bones=tuple(names["bones"]),
        muscles={name: tuple(strands) for name, strands in names["muscles"].items()},
        joint=names["joint"],
    )
    made = build_specimen(model, specimen_names).model
    joints = []
    coordinates = []
    for joint in made.joints:
        above, below = entries["joints"][joint.name]
        joints.append(replace(joint, parent_frame=_frame(above), child_frame=_frame(below)))
    for coordinate in made.coordinates:
        default, locked = entries["coordinates"][coordinate.name]
        coordinates.append(replace(coordinate, default=default, locked=locked))
    made = replace(made, joints=tuple(joints), coordinates=tuple(coordinates), markers=())
    return replace(made, gravity=np.array(entries["gravity"]))


def _frame(plain: Sequence[Any]) -> Transform:
    """Read the frame that `_plain` wrote."""
    rotation, translation = plain
    return Transform(rotation=np.array(rotation), translation=np.array(translation))


def _plain(frame: Transform) -> list[Any]:
    return [frame.rotation.tolist(), frame.translation.tolist()]


def _thinned(motion: Motion) -> dict[str, Any]:
    """List time, names and values of frames that are known, at most `RATE` a second."""
    known = np.flatnonzero(np.isfinite(motion.values).all(axis=1))[
        :: max(int(motion.rate / RATE), 1)
    ]
    values: Array = np.round(motion.values[known], DIGITS)
    return {
        "time": np.round(motion.time[known], DIGITS).tolist(),
        "names": motion.names,
        "values": values.tolist(),
    }
