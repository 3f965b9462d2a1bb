"""What a file holds and what looks wrong with it: `myomorph info FILE`."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from myomorph.core.io.formats import (
    channel_format,
    is_composed,
    model_format,
    read_model,
    trial_format,
)
from myomorph.core.io.sto import read_sto
from myomorph.core.model.causes import MODEL, MUSCLES
from myomorph.core.model.errors import BadFile
from myomorph.core.model.messages import Message, located
from myomorph.core.model.model import Model
from myomorph.core.model.series import Table
from myomorph.lab.causes import FILE_SHAPE
from myomorph.lab.info.inspect_recording import Inspection, inspect_table, inspect_trial, listed

TABLES = (".mot", ".sto")
EXPECTED = "expected a model (.osim, .xml), markers (.trc, .c3d, .mat, .h5) or a table (.mot, .sto)"


def inspect(path: str | os.PathLike[str], reasons: bool = False) -> Inspection:
    """Find out what a file holds, and what looks wrong with it.

    Of a folder of recordings, who was recorded, when and in which movements.

    Parameters
    ----------
    path : model, C3D, TRC, MAT, H5, MOT, STO, external loads, or a folder of recordings
    reasons : of a folder, how each statement is known
    """
    path = Path(path)
    if is_composed(path):
        return inspect_model(read_model(path))
    if not path.exists():
        raise BadFile(path, "does not exist")
    if path.is_dir():
        from myomorph.lab.info.inspect_session import inspect_session
        from myomorph.lab.session.read import read_session

        return inspect_session(read_session(path), reasons)
    ending = path.suffix.lower()
    recording = trial_format(path)
    if recording is not None:
        from myomorph.lab.study.inputs.reading import read_recording

        return inspect_trial(read_recording(path), recording.name)
    if ending in TABLES:
        return inspect_table(read_sto(path))
    channels = channel_format(path)
    if channels is not None:
        series = channels.read(path)
        return inspect_table(Table(series.time, series.names, series.values))
    if ending == ".xml":
        return _inspect_xml(path)
    if model_format(path) is not None:
        return inspect_model(read_model(path))
    raise BadFile(path, f"is not a known kind of file: its name ends in '{ending}'", EXPECTED)


def _inspect_xml(path: Path) -> Inspection:
    """Inspect a model of MuJoCo, or one of OpenSim's settings."""
    from myomorph.core.io.parsing.xml import read_xml

    file = read_xml(path)
    root = file.root
    if root.tag == "mujoco":
        return inspect_model(read_model(path))
    if root.tag == "mujocoinclude":
        raise BadFile(
            path,
            "is a part of a MuJoCo model and not a model by itself: its outermost element is"
            " <mujocoinclude>",
            "give the file that includes it",
        )
    inner = (
        next((child for child in root if isinstance(child.tag, str)), None)
        if root.tag == "OpenSimDocument"
        else root
    )
    if inner is None:
        raise BadFile(path, f"holds an empty '{root.tag}'", EXPECTED)
    if inner.tag == "Model":
        from myomorph.core.io.osim.read import read_osim

        return inspect_model(read_osim(path))
    if inner.tag == "ExternalLoads":
        return _inspect_loads(path)
    named = [child.tag for child in inner if isinstance(child.tag, str)]
    facts = (("name", str(inner.get("name", ""))), ("settings", listed(sorted(set(named)))))
    return Inspection(f"OpenSim settings: {inner.tag}", facts, file.warnings)


def _inspect_loads(path: Path) -> Inspection:
    from myomorph.core.io.loads import read_load_entries

    entries = read_load_entries(path)
    facts = [("forces", str(len(entries)))]
    warnings = []
    for entry in entries:
        facts.append(
            (
                entry.name,
                f"on '{entry.body}', columns '{entry.force}*' and '{entry.point}*' of {entry.data}",
            )
        )
    for data in dict.fromkeys(entry.data for entry in entries):
        if not data.exists():
            warnings.append(FILE_SHAPE.message(f"the table {data} does not exist"))
            continue
        table = read_sto(data)
        warnings += located(data.name, table.warnings)
        for entry in entries:
            for prefix in (entry.force, entry.point, entry.torque):
                if (
                    entry.data == data
                    and prefix
                    and not any(name.startswith(prefix) for name in table.names)
                ):
                    warnings.append(
                        FILE_SHAPE.message(f"{data.name} has no column that begins with '{prefix}'")
                    )
    return Inspection("OpenSim external loads", tuple(facts), tuple(warnings))


def inspect_model(model: Model) -> Inspection:
    """Count bodies, joints and muscles of a model, and collect what looks wrong with it."""
    facts = [
        ("name", model.name),
        ("mass", f"{model.mass:.5g} kg in {len(model.bodies)} bodies"),
        ("joints", _counted([joint.kind for joint in model.joints])),
        ("coordinates", _coordinates(model)),
        ("gravity", " ".join(f"{value:g}" for value in model.gravity) + " m/s^2"),
        ("markers", str(len(model.markers))),
        ("muscles", _counted([muscle.kind for muscle in model.muscles])),
        ("wrap objects", str(len(model.wrap_objects))),
        ("actuators", _counted([actuator.kind for actuator in model.actuators])),
        ("coordinate names", listed(model.coordinate_names)),
        ("body names", listed(model.body_names)),
    ]
    warnings = (*model.warnings, *_model_warnings(model), *_arm_warnings(model))
    return Inspection("model", (*facts, *_further_parts(model)), warnings)


def _further_parts(model: Model) -> list[tuple[str, str]]:
    """List parts that few models have."""
    passive = [torque.name for torque in model.passive_torques]
    passive += [bushing.name for bushing in model.bushings]
    further = {
        "closed loops": [loop.name for loop in model.loops],
        "springs, limits and bushings": passive,
        "muscles with viscosity": [muscle.name for muscle in model.muscles if muscle.viscosity],
    }
    facts = [(label, listed(names)) for label, names in further.items() if names]
    modelled = {name.removesuffix("_upper").removesuffix("_lower") for name in passive}
    kept = [part.kind for part in model.kept if part.name not in modelled]
    return facts + ([("kept, not modelled", _counted(kept))] if kept else [])


def _arm_warnings(model: Model) -> tuple[Message, ...]:
    if not model.muscles:
        return ()
    from myomorph.core.muscles.published_arms import arm_warnings
    from myomorph.core.rigid.kernels import uncompiled

    # Compiling takes half a minute; a few poses of a few muscles take less than a second without.
    with uncompiled(), np.errstate(all="ignore"):
        try:
            return arm_warnings(model)
        except ZeroDivisionError:
            return (
                MUSCLES.message(
                    "moment arms at the knee were not compared: two points of a path coincide",
                    severity="good to know",
                ),
            )


def _coordinates(model: Model) -> str:
    locked = sum(1 for coordinate in model.coordinates if coordinate.locked)
    clamped = sum(1 for coordinate in model.coordinates if coordinate.clamped)
    parts = [f"{len(model.coordinates)}"]
    for count, word in (
        (len(model.couplers), "dependent"),
        (locked, "locked"),
        (clamped, "clamped"),
    ):
        if count:
            parts.append(f"{count} {word}")
    return ", ".join(parts)


def _model_warnings(model: Model) -> list[Message]:
    """List what looks wrong with the numbers of a model."""
    result = []
    light = [body.name for body in model.bodies if body.mass <= 0.0]
    if not np.isfinite(model.mass) or model.mass <= 0:
        result.append(
            MODEL.message(
                "the bodies have no mass: inverse dynamics and tensions would be zero",
                severity="changes results",
            )
        )
    elif light:
        result.append(MODEL.message(f"{len(light)} bodies have no mass: {listed(light)}"))
    for body in model.bodies:
        moments = np.sort(np.linalg.eigvalsh(0.5 * (body.inertia + body.inertia.T)))
        if body.mass > 0 and (
            moments[0] < -1e-9 or moments[2] > (moments[0] + moments[1]) * (1 + 1e-6) + 1e-12
        ):
            result.append(
                MODEL.message(
                    f"the inertia of body '{body.name}' is not that of a real body:"
                    f" {np.round(moments, 6).tolist()}",
                    severity="may change results",
                )
            )
    for coordinate in model.coordinates:
        lower, upper = coordinate.range
        if coordinate.clamped and not lower <= coordinate.default <= upper:
            result.append(
                MODEL.message(
                    f"the default of '{coordinate.name}' ({coordinate.default:.4g}) is outside its"
                    " range"
                )
            )
    if np.linalg.norm(model.gravity) == 0:
        result.append(MODEL.message("gravity is zero"))
    return result


def _counted(kinds: Sequence[str]) -> str:
    """'3 PinJoint, 1 FreeJoint' of a list of kinds."""
    counts = ", ".join(f"{count} {kind}" for kind, count in Counter(kinds).most_common())
    return f"{len(kinds)}: {counts}" if counts else f"{len(kinds)}"
