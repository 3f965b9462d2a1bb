"""A lower model's lengths, markers and masses in models with more joints.

Measured is what these reproduce of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.errors import rms_of_vectors
from myomorph.body.identify.transfer import Transfer
from myomorph.body.shape.regions import centers_of, regions_of
from myomorph.core.model.inertia import inertial_parameters, pseudo_inertias
from myomorph.core.model.model import Marker
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.regressor import base_regressor
from myomorph.core.rigid.tree import compile_tree

LOWER = "rajagopal-walk-emg/subject_walk_scaled.osim"
MOTION = "rajagopal-walk-emg/coordinates.sto"
CYCLIST = "fullbody-many-muscles/cyclistFullBodyMuscle.osim"
CUTOFF = 6.0
"""Of the motions of both models [Hz]."""
STEP = 10
"""Every so many frames of the motion, which has 1000 a second."""


def higher_models(data: Path) -> dict[str, Path]:
    """Return the models that take the lower one's body.

    They are the one of 171 coordinates, and MyoFullBody where it is installed.
    """
    found = {"cyclistFullBodyMuscle": data / CYCLIST}
    spec = find_spec("musclemimic_models")
    if spec is not None and spec.origin is not None:
        found["MyoFullBody"] = Path(spec.origin).parent / "model" / "body" / "myofullbody.xml"
    return found


def with_centers(model: mm.Model, keys: tuple[str, ...]) -> mm.Model:
    """Return the model with its joint centers as markers."""
    centers = centers_of(model, regions_of(model))
    virtual = tuple(
        Marker(f"center {key}", centers[key].joint.child, centers[key].location) for key in keys
    )
    return replace(model, markers=(*model.markers, *virtual))


def marker_motion(model: mm.Model, motion: mm.Motion) -> mm.Markers:
    """Where a model's markers are during a motion."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    bodies = np.array([tree.body_index[one.body] for one in model.markers])
    places = poses.points(bodies, np.array([one.location for one in model.markers]))
    return mm.Markers(motion.time, model.marker_names, places)


def same_movement(
    lower: mm.Model, motion: mm.Motion, found: Transfer
) -> tuple[mm.Motion, np.ndarray]:
    """Return the higher model's motion that follows the lower one's markers and joint centers.

    Parameters
    ----------
    lower : model with fewer joints
    motion : of the lower model
    found : transfer to the higher model

    Returns
    -------
    The motion, and (frames,) root mean square marker errors [m]
    """
    keys = tuple(found.joint_errors)
    seen = marker_motion(with_centers(lower, keys), motion)
    names = set(found.model.marker_names) | {f"center {key}" for key in keys}
    kept = [i for i, name in enumerate(seen.names) if name in names]
    seen = mm.Markers(
        seen.time, tuple(seen.names[i] for i in kept), seen.values[:, kept] @ found.rotation.T
    )
    fit = mm.inverse_kinematics(
        with_centers(found.model, keys), seen, mm.InverseKinematicsOptions()
    )
    return fit.motion, fit.rms


def wrench(model: mm.Model, motion: mm.Motion, points: np.ndarray) -> np.ndarray:
    """Return the external wrench that a motion needs.

    Parameters
    ----------
    model : that moves
    motion : with derivatives
    points : (frames, 3) about which the moment is, in ground [m]

    Returns
    -------
    (frames, 6) moment [N m] and force [N]
    """
    rows = base_regressor(model, motion, np.zeros(3))
    needed = np.einsum("fij,j->fi", rows, inertial_parameters(model).ravel())
    needed[:, :3] -= np.cross(points, needed[:, 3:])
    return needed


def measure_model(data: Path, name: str, path: Path) -> dict[str, object]:
    """Measure what one higher model reproduces of the lower one."""
    lower = mm.read_model(data / LOWER)
    higher = mm.read_model(path)
    found = mm.transfer(lower, higher)
    return {
        "model": name,
        "joint centers": len(found.joint_errors),
        "distance of joint centers [mm]": 1000.0 * max(found.joint_errors.values()),
        "joints moved by [mm]": 1000.0 * max(found.joint_shifts.values()),
        "difference of lengths [mm]": 1000.0
        * max(abs(one.higher - one.lower) for one in found.lengths),
        "difference of mass [kg]": abs(found.model.mass - lower.mass),
        "distance of region mass centers [mm]": 1000.0
        * max(one.center_error for one in found.masses),
        "regions without inertia": sum(bool(one.note) for one in found.masses),
        "smallest eigenvalue ratio": _least_ratio(higher, found.model),
    } | _walk(data, lower, higher, found)


def _walk(data: Path, lower: mm.Model, higher: mm.Model, found: Transfer) -> dict[str, object]:
    """Compare the wrench that a walk needs with that of the lower model."""
    whole = mm.read_motion(data / MOTION, lower)
    motion = mm.Motion(whole.time[::STEP], whole.names, whole.values[::STEP])
    followed, marker_rms = same_movement(lower, motion, found)
    tree = compile_tree(lower)
    pelvis = forward_kinematics(tree, tree.coordinates_of(motion)).origins[:, 1]
    needed = wrench(lower, mm.differentiate(motion, CUTOFF), pelvis)
    turn = np.kron(np.eye(2), found.rotation)
    weight = lower.mass * float(np.linalg.norm(lower.gravity))
    inside = slice(10, -10)
    row: dict[str, object] = {"walk: marker RMS [mm]": 1000.0 * float(np.mean(marker_rms))}
    for kind, model in (("transferred", found.model), ("generic", _masses_of(higher, found))):
        values = wrench(model, mm.differentiate(followed, CUTOFF), pelvis @ found.rotation.T)
        apart = values[inside] - needed[inside] @ turn.T
        force = 100.0 * rms_of_vectors(apart[:, 3:]) / weight
        row[f"walk: force RMS, {kind} [% of weight]"] = force
        row[f"walk: moment RMS, {kind} [N m]"] = rms_of_vectors(apart[:, :3])
    return row


def _masses_of(higher: mm.Model, found: Transfer) -> mm.Model:
    """Return the transferred model with the generic masses, scaled to the same total.

    That is what lengths alone would give.
    """
    growth = found.model.mass / higher.mass
    bodies = tuple(
        replace(
            body,
            mass=higher.body(body.name).mass * growth,
            mass_center=higher.body(body.name).mass_center * found.factors[body.name],
            inertia=higher.body(body.name).inertia
            * growth
            * float(np.prod(found.factors[body.name])) ** (2.0 / 3.0),
        )
        for body in found.model.bodies
    )
    return replace(found.model, bodies=bodies)


def _least_ratio(before: mm.Model, after: mm.Model) -> float:
    """Return the least eigenvalue of any body's pseudo-inertia relative to before.

    Only bodies count that were possible before.
    """
    least = [
        np.linalg.eigvalsh(pseudo_inertias(inertial_parameters(model)))[:, 0]
        for model in (before, after)
    ]
    possible = least[0] > 1e-12
    return float((least[1][possible] / least[0][possible]).min())


def measure(data: Path) -> Iterator[dict[str, object]]:
    """Rows of all higher models."""
    for name, path in higher_models(data).items():
        yield measure_model(data, name, path)
