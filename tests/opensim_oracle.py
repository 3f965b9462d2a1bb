"""What OpenSim says of model files: run as a script, each file in a process of its own.

OpenSim keeps the `defaults` section of a file for all files read after it, so files must not share
a process; forking spares the two seconds that importing OpenSim takes.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import traceback
from pathlib import Path
from typing import Any

import numpy as np

POSES = 3


def ask(files: dict[str, Path], folder: Path) -> dict[str, dict[str, Any] | str]:
    """Facts by name, or the error text, of every file."""
    work = folder / "oracle.pickle"
    work.write_bytes(pickle.dumps(files))
    subprocess.run(
        [sys.executable, __file__, str(work)], check=True, capture_output=True, cwd=folder
    )
    return pickle.loads(work.read_bytes())  # type: ignore[no-any-return]


def facts(path: Path) -> dict[str, Any]:
    """Masses, coordinates, and at some poses the places of bodies, markers and path points."""
    import opensim

    opensim.Logger.setLevelString("Off")
    model = opensim.Model(str(path))
    state = model.initSystem()
    found: dict[str, Any] = {
        "bodies": {body.getName(): _mass(body) for body in _all(model.getBodySet())},
        "coordinates": {one.getName(): _coordinate(one) for one in _all(model.getCoordinateSet())},
        "muscles": {one.getName(): _muscle(opensim, one) for one in _all(model.getMuscles())},
        "actuators": [one.getName() for one in _all(model.getForceSet())],
        "mass": model.getTotalMass(state),
        "gravity": model.getGravity().to_numpy(),
        "poses": [],
    }
    random = np.random.default_rng(7)
    for i in range(POSES):
        found["poses"].append(_pose(opensim, model, state, random, i == 0))
    return found


def _all(collection: Any) -> list[Any]:
    return [collection.get(i) for i in range(collection.getSize())]


def _mass(body: Any) -> tuple[float, Any, Any]:
    inertia = body.getInertia()
    (xx, yy, zz) = inertia.getMoments().to_numpy()
    (xy, xz, yz) = inertia.getProducts().to_numpy()
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return body.getMass(), body.getMassCenter().to_numpy(), matrix


def _coordinate(one: Any) -> tuple[Any, ...]:
    motion = ("undefined", "rotational", "translational", "coupled")[one.getMotionType()]
    return (
        one.getDefaultValue(),
        one.getDefaultSpeedValue(),
        one.getRangeMin(),
        one.getRangeMax(),
        one.getDefaultClamped(),
        one.getDefaultLocked(),
        motion,
    )


def _muscle(opensim: Any, one: Any) -> dict[str, Any]:
    path = opensim.GeometryPath.safeDownCast(one.getPath())
    wraps = []
    for wrap in _all(path.getWrapSet()):
        surface = wrap.getWrapObject()
        body = surface.getFrame().findBaseFrame().getName()
        wraps.append(
            (
                surface.getName(),
                body,
                wrap.getMethodName(),
                wrap.getStartPoint(),
                wrap.getEndPoint(),
            )
        )
    own = getattr(opensim, one.getConcreteClassName(), None)
    return {
        "kind": one.getConcreteClassName(),
        "numbers": (
            one.get_max_isometric_force(),
            one.get_optimal_fiber_length(),
            one.get_tendon_slack_length(),
            one.get_pennation_angle_at_optimal(),
            one.get_max_contraction_velocity(),
            one.getMinControl(),
            one.getMaxControl(),
        ),
        "enabled": one.get_appliesForce(),
        "parameters": _parameters(own.safeDownCast(one)) if own is not None else {},
        "wraps": wraps,
    }


def _parameters(one: Any, prefix: str = "") -> dict[str, str]:
    found = {}
    for i in range(one.getNumProperties()):
        name = one.getPropertyByIndex(i).getName()
        if name.endswith("Curve"):
            found.update(_parameters(getattr(one, f"get_{name}")(), f"{name}/"))
        else:
            found[prefix + name] = one.getPropertyByIndex(i).toString().strip("()")
    return found


def _pose(opensim: Any, model: Any, state: Any, random: Any, default: bool) -> dict[str, Any]:
    coordinates = _all(model.getCoordinateSet())
    for one in coordinates:
        low = max(one.getRangeMin(), -1.5)
        high = min(one.getRangeMax(), 1.5)
        value = one.getDefaultValue() if default else random.uniform(min(low, high), high)
        one.setLocked(state, False)
        one.setValue(state, value, False)
    model.realizePosition(state)
    paths = {
        one.getName(): opensim.GeometryPath.safeDownCast(one.getPath())
        for one in _all(model.getMuscles())
    }
    return {
        "coordinates": {one.getName(): one.getValue(state) for one in coordinates},
        "bodies": {
            one.getName(): _transform(one.getTransformInGround(state))
            for one in _all(model.getBodySet())
        },
        "markers": {
            one.getName(): one.getLocationInGround(state).to_numpy()
            for one in _all(model.getMarkerSet())
        },
        "points": {
            name: [
                one.getLocationInGround(state).to_numpy() for one in _all(path.getPathPointSet())
            ]
            for name, path in paths.items()
        },
        "lengths": {name: path.getLength(state) for name, path in paths.items()},
    }


def _transform(pose: Any) -> tuple[Any, Any]:
    rotation = np.array([[pose.R().get(i, j) for j in range(3)] for i in range(3)])
    return rotation, pose.p().to_numpy()


def _in_child(path: Path) -> dict[str, Any] | str:
    reader, writer = os.pipe()
    if os.fork() == 0:
        os.close(reader)
        try:
            answer: dict[str, Any] | str = facts(path)
        except Exception:
            answer = traceback.format_exc()
        with os.fdopen(writer, "wb") as stream:
            stream.write(pickle.dumps(answer))
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as stream:
        content = stream.read()
    os.wait()
    return pickle.loads(content) if content else "OpenSim crashed"


if __name__ == "__main__":
    import opensim  # noqa: F401

    work = Path(sys.argv[1])
    answers = {name: _in_child(path) for name, path in pickle.loads(work.read_bytes()).items()}
    work.write_bytes(pickle.dumps(answers))
