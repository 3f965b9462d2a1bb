"""A model to MuJoCo: its joints, paths and muscles made MuJoCo's, written, and certified."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from myomorph.core.io.mesh import read_surfaces
from myomorph.core.io.mjcf.couplings import Cam
from myomorph.core.io.mjcf.original import put_original
from myomorph.core.io.mjcf.write import MjcfDocument, mjcf_document
from myomorph.core.io.osim.document import write_document
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import quoted
from myomorph.core.model.messages import Message, located
from myomorph.core.model.model import Mesh, Model
from myomorph.core.model.series import Motion
from myomorph.core.rigid.coordinates import couple_frames
from myomorph.core.rigid.tree import compile_tree
from myomorph.exchange.causes import COPIES
from myomorph.exchange.mujoco.cams import cams_of
from myomorph.exchange.mujoco.certificate import (
    Certificate,
    ComparedPoses,
    RecordedPoses,
    certify,
)
from myomorph.exchange.mujoco.copy import MujocoCopy
from myomorph.exchange.mujoco.joints import mujoco_joints, poses_over_ranges, routes
from myomorph.exchange.mujoco.muscle_forces import LENGTHS, SPEEDS, curves_of, mujoco_muscles
from myomorph.exchange.mujoco.tendon_paths import tendon_paths

FITTED_POSES = 200
CERTIFIED_POSES = 300
FITTED_SEED = 0
CERTIFIED_SEED = 1


def write_mjcf(
    model: Model,
    path: str | os.PathLike[str],
    geometry: Sequence[str | os.PathLike[str]] = (),
    motion: Motion | None = None,
) -> Certificate:
    """Write a model as MJCF for MuJoCo 3 and 4, and say how far MuJoCo's copy is the model.

    Masses, inertias, joints and points of paths are the model's; what MuJoCo lacks (joints that
    follow splines, points that move, surfaces, curves of muscles) is replaced. The certificate
    compares the result with the model over the coordinates' ranges, moving from pose to pose, and
    by the rules of both versions. Meshes go into a folder beside the file.

    Source: Todorov, Erez and Tassa 2012, MuJoCo.

    Parameters
    ----------
    model : to write
    path : of the new file (.xml), replaced where it exists
    geometry : folders of its meshes, besides those beside the model's own file
    motion : coordinates [rad or m] along which lengths are compared as well

    Returns
    -------
    differences of each muscle's length [m] and moment arms [m/rad], of mass [kg] and of inverse
    dynamics [N m]

    Raises
    ------
    BadModel
        a joint cannot be MuJoCo's
    BadFile
        a file cannot be written

    Examples
    --------
    >>> import myomorph as mm
    >>> certificate = mm.write_mjcf(mm.read_model("arm.osim"), "arm.xml")
    >>> certificate.steps, [difference.muscle for difference in certificate.differences]
    (True, ['flexor', 'extensor'])
    """
    path = Path(path)
    model, left_out = _without_path_functions(model)
    copied, cams, notes = mujoco_model(model)
    notes = (*left_out, *notes)
    folders = _folders_of_meshes(model, geometry)
    surfaces, _ = read_surfaces(model, folders) if folders else ({}, ())
    document = mjcf_document(copied, path, cams, surfaces)
    if not any(muscle.kind == "mujoco" for muscle in model.muscles):
        notes += located("read back", put_original(document.root, _drawn_by(model, document)))
    write_document(document.root, path)
    coordinates, swept = poses_over_ranges(model, CERTIFIED_POSES, CERTIFIED_SEED)
    poses = ComparedPoses(
        model=coordinates,
        copy=in_copy(copied, model, coordinates),
        swept=swept,
        route=routes(model, coordinates, swept),
    )
    recorded = None if motion is None else _recorded(model, copied, motion)
    copy = MujocoCopy(path, copied)
    return certify(model, copy, poses, recorded, (*notes, *document.warnings))


def _recorded(model: Model, copied: Model, motion: Motion) -> RecordedPoses:
    """Poses of a motion in both models; frames without a pose are left out."""
    known = np.isfinite(motion.values).all(axis=1)
    coordinates = compile_tree(model).coordinates_of(motion)[known]
    count = len(coordinates)
    poses = ComparedPoses(
        model=coordinates,
        copy=in_copy(copied, model, coordinates),
        swept=np.full(count, -1),
        route=np.arange(-1, count - 1),
    )
    return RecordedPoses(time=motion.time[known], poses=poses)


def _folders_of_meshes(model: Model, geometry: Sequence[str | os.PathLike[str]]) -> list[Path]:
    """Return the folders given, and those beside the model's own file."""
    folders = [Path(folder) for folder in geometry]
    if model.source:
        beside = Path(model.source).parent
        folders += [
            folder
            for folder in (beside, beside / "Geometry", beside / "geometry")
            if folder.is_dir()
        ]
    return folders


def _without_path_functions(model: Model) -> tuple[Model, tuple[Message, ...]]:
    """Leave out muscles whose length a function gives, which no tendon has, with a note."""
    names = [muscle.name for muscle in model.muscles if muscle.path.function is not None]
    if not names:
        return model, ()
    muscles = tuple(muscle for muscle in model.muscles if muscle.path.function is None)
    note = COPIES.message(
        f"{len(names)} muscles are left out, as functions of coordinates give their lengths and"
        f" MuJoCo's tendons have points: {quoted(names, 3)}"
    )
    return replace(model, muscles=muscles), (note,)


def _drawn_by(model: Model, document: MjcfDocument) -> Model:
    """Give the model the meshes that were written for MuJoCo."""

    def drawn(mesh: Mesh) -> Mesh:
        file = document.meshes.get(mesh.file)
        return (
            mesh if file is None else replace(mesh, file=str(PurePosixPath(document.folder, file)))
        )

    bodies = tuple(replace(body, meshes=tuple(map(drawn, body.meshes))) for body in model.bodies)
    return replace(model, bodies=bodies, ground_meshes=tuple(map(drawn, model.ground_meshes)))


def mujoco_model(model: Model) -> tuple[Model, tuple[Cam, ...], tuple[Message, ...]]:
    """Return the model as MuJoCo can hold it, its cams, and notes."""
    jointed = mujoco_joints(model)
    coordinates, _ = poses_over_ranges(model, FITTED_POSES, FITTED_SEED)
    notes = []
    made, changed = tendon_paths(jointed, in_copy(jointed, model, coordinates))
    if changed:
        lines = [f"{muscle} without {what}" for muscle, what in changed.items()]
        notes.append(
            COPIES.message(
                f"paths of {len(changed)} muscles have fewer surfaces in MuJoCo: {quoted(lines, 3)}"
            )
        )
    pairs = zip(mujoco_muscles(model), made.muscles, strict=True)
    muscles = tuple(replace(muscle, path=other.path) for muscle, other in pairs)
    cams, polynomials = cams_of(jointed)
    if polynomials:
        names = [coupler.dependent for coupler in polynomials]
        notes.append(
            COPIES.message(
                "coordinates that follow by a polynomial of degree four, not their curve:"
                f" {quoted(names, 3)}"
            )
        )
    by_name = {coupler.name: coupler for coupler in polynomials}
    couplers = tuple(by_name.get(coupler.name, coupler) for coupler in made.couplers)
    return replace(made, muscles=muscles, couplers=couplers), cams, tuple(notes)


def in_copy(copied: Model, model: Model, coordinates: Array) -> Array:
    """Convert poses of a model to the coordinates of one of `mujoco_joints`.

    Parameters
    ----------
    copied : of `mujoco_joints`
    model : from which it was made
    coordinates : (poses, coordinates) of the model [rad or m]

    Returns
    -------
    (poses, coordinates of the copied model) [rad or m]
    """
    result = np.tile(
        [coordinate.default for coordinate in copied.coordinates], (len(coordinates), 1)
    )
    for i, name in enumerate(copied.coordinate_names):
        if name in model.coordinate_names:
            result[:, i] = coordinates[:, model.coordinate_names.index(name)]
    couple_frames(compile_tree(copied).arrays, result)
    return result


EVERY = 8  # Of the sampled lengths and speeds, those that the table has.


def write_tables(model: Model, certificate: Certificate, path: Path) -> tuple[Path, ...]:
    """Write `NAME_differences.csv` and `NAME_curves.csv` beside the model's file `NAME.xml`.

    The first has a row a muscle and the certificate's lines at its end. The second has the model's
    own curves over fiber length along the tendon and over velocity, for whoever computes forces of
    MuJoCo's tendons by them.
    """
    if not model.muscles:
        return ()
    differences = path.with_name(f"{path.stem}_differences.csv")
    curves = path.with_name(f"{path.stem}_curves.csv")
    write_csv(differences, certificate.rows[0], (row.values() for row in certificate.rows))
    sampled = curves_of(model)
    rows = []
    for m, muscle in enumerate(model.muscles):
        for curve, x, y in (
            ("active force by length", LENGTHS, sampled.active[:, m]),
            ("passive force by length", LENGTHS, sampled.passive[:, m]),
            ("active force by velocity", SPEEDS, sampled.velocity[:, m]),
        ):
            strength = f"{sampled.strength[m]:.6g}"
            every = slice(None, None, EVERY)
            rows += [
                (muscle.name, strength, curve, f"{at:.4g}", f"{value:.6g}")
                for at, value in zip(x[every], y[every], strict=True)
            ]
    write_csv(curves, ("muscle", "strength [N]", "curve", "x", "y"), rows)
    return differences, curves
