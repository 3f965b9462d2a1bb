"""Laws of muscle transfer that hold exactly on whole models.

Where a branching point goes by balance is measured too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from given_maps import given, grown, poses_of, sheared, similar

import myomorph as mm
from mujoco_models import load
from myomorph.bones.morph.maps.fields import BoneMap
from myomorph.bones.morph.mirror.model import mirrored_motion
from myomorph.bones.morph.morphed import Morph, MorphOptions, TransferredPoint
from myomorph.bones.morph.transfer.virtual_links import branch_load
from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.model import GROUND
from myomorph.core.model.paths import PathWrap
from myomorph.core.model.sides import split_side
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.rigid.kinematics import standing_poses

OPENSIM = (
    "ceinms-emg-walk/model/gait2392.osim",
    "rajagopal-walk-emg/raw/Rajagopal2016.osim",
    "lenhart-knee-contact-walk/lenhart2015.osim",
    "c3d-functional-joints/models/Wu_Shoulder_Model_via_points.osim",
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim",
    "opensim-reference-small/arm26_bounds.osim",
    "fullbody-many-muscles/cyclistFullBodyMuscle.osim",
)
MUJOCO = ("myolegs", "myoarm_r", "mouse arm")
SYMMETRIC = ("gait2392", "Rajagopal2016")
SIZE = 1.3
POSES = 10

Row = dict[str, object]


def models(folder: Path) -> Iterator[tuple[str, mm.Model]]:
    """Yield the models by name."""
    for name in OPENSIM:
        yield Path(name).stem, read_osim(folder / name)
    for name in MUJOCO:
        yield name, load(name, lambda file: folder / file)[1]


def measure(folder: Path) -> Iterator[Row]:
    """Yield a row for each model."""
    for name, model in models(folder):
        row: Row = {"model": name, "muscles": len(model.muscles)}
        row["muscle points"] = sum(len(one.path.points) for one in model.muscles)
        yield row | identity(model) | twin(model) | affine(model) | sides(name, model)


def of_bones(points: Sequence[TransferredPoint], errors: Iterable[float]) -> float:
    """Return the worst relative error of points.

    Each is over the extent of all points on its body, 5 cm at least.
    """
    places: dict[str, list[np.ndarray]] = {}
    for one in points:
        places.setdefault(one.body, []).append(one.source)
    lengths = {body: max(0.05, float(np.ptp(some, axis=0).max())) for body, some in places.items()}
    return max(error / lengths[one.body] for one, error in zip(points, errors, strict=True))


def identity(model: mm.Model) -> Row:
    """Measure what an identity map changes: points, and moment arms."""
    morph = mm.morph_model(model, similar(model, 1.0))
    errors = (float(np.linalg.norm(one.target - one.source)) for one in morph.points)
    motion = poses_of(model, POSES)
    ours = mm.muscle_kinematics(morph.model, motion, velocities=False)
    theirs = mm.muscle_kinematics(model, motion, velocities=False)
    return {
        "identity: points [bone lengths]": of_bones(morph.points, errors),
        "identity: lengths [m]": float(np.abs(ours.muscle_length - theirs.muscle_length).max()),
        "identity: moment arms [m]": float(np.abs(ours.moment_arm - theirs.moment_arm).max()),
    }


def twin(model: mm.Model) -> Row:
    """Transfer muscles to a model larger by `SIZE` in bodies' frames that lie anyhow.

    Lengths and moment arms must grow by `SIZE`.
    """
    bones = similar(model, SIZE, seed=3) | {GROUND: given(GROUND, SIZE * np.eye(3), np.zeros(3))}
    morph = mm.morph_model(model, bones)
    motion = poses_of(model, POSES)
    ours = mm.muscle_kinematics(morph.model, grown(model, motion, SIZE), velocities=False)
    theirs = mm.muscle_kinematics(model, motion, velocities=False)
    lengths = np.abs(ours.muscle_length / SIZE - theirs.muscle_length).max(axis=0)
    turning = np.array([one.motion == "rotational" for one in model.coordinates])
    arms = np.abs(ours.moment_arm / SIZE - theirs.moment_arm)[:, :, turning].max(axis=(0, 2))
    around = np.array(
        [any(isinstance(wrap, PathWrap) for wrap in one.path.wraps) for one in model.muscles]
    )
    return {
        "larger twin: lengths [m]": float(lengths[~around].max(initial=0.0)),
        "larger twin: moment arms [m]": float(arms[~around].max(initial=0.0)),
        "larger twin: lengths around OpenSim's surfaces [m]": float(lengths[around].max())
        if around.any()
        else "",
        "larger twin: their surfaces [sizes]": _surfaces(model, morph.model, bones)
        if around.any()
        else "",
    }


def _surfaces(model: mm.Model, morphed: mm.Model, bones: dict[str, BoneMap]) -> float:
    """Return how far sizes, middles and axes of wrap objects are from those of the twin.

    The result is a share of their size.
    """
    error = 0.0
    for before, after in zip(model.wrap_objects, morphed.wrap_objects, strict=True):
        bone = bones[before.body]
        size = before.size[0]
        turned = bone.whole.rotation @ before.pose.rotation
        error = max(
            error,
            float(np.abs(np.array(after.size) / (SIZE * np.array(before.size)) - 1.0).max()),
            float(np.linalg.norm(after.pose.translation - bone.map.apply(before.pose.translation)))
            / size,
            float(np.abs(after.pose.rotation - turned).max()),
        )
    return error


def affine(model: mm.Model) -> Row:
    """Transfer muscles by one matrix for the whole body as it stands.

    Every point must be where the matrix puts it, joints on the way included.
    """
    rng = np.random.default_rng(5)
    matrix = rotation_from_euler_xyz((0.3, -0.4, 0.2)) @ (
        np.diag([1.2, 0.8, 1.1]) + 0.05 * rng.standard_normal((3, 3))
    )
    morph = mm.morph_model(model, sheared(model, matrix))
    before = standing_poses(model)
    after = standing_poses(morph.model)
    _, d, vt = np.linalg.svd(matrix)
    stretch = vt.T * d @ vt
    wanted = (stretch @ before[one.body].apply(one.source) for one in morph.points)
    errors = (
        float(np.linalg.norm(after[one.target_body].apply(one.target) - place))
        for one, place in zip(morph.points, wanted, strict=True)
    )
    return {"affine: points in place [bone lengths]": of_bones(morph.points, errors)}


def sides(name: str, model: mm.Model) -> Row:
    """Transfer muscles by mirrored maps for left and right.

    The row has how unlike mirrored muscles become, next to how unlike they were.
    """
    title = "left and right: difference of lengths, {} [m]"
    row: Row = {title.format("before"): "", title.format("after"): ""}
    if name not in SYMMETRIC:
        return row
    flip = np.diag([1.0, 1.0, -1.0])
    rng = np.random.default_rng(1)
    bones = {}
    for body in model.body_names:
        if body in bones:
            continue
        other = _other(body, model.body_names)
        matrix = np.eye(3) + 0.1 * rng.standard_normal((3, 3))
        offset = rng.uniform(-0.1, 0.1, 3)
        if other:
            bones |= {
                body: given(body, matrix, offset),
                other: given(other, flip @ matrix @ flip, flip @ offset),
            }
        else:
            bones[body] = given(
                body, 0.5 * (matrix + flip @ matrix @ flip), 0.5 * (offset + flip @ offset)
            )
    motion = poses_of(model, POSES)
    other_motion = mirrored_motion(model, motion)
    for when, one in (("before", model), ("after", mm.morph_model(model, bones).model)):
        row[title.format(when)] = _apart(one, motion, other_motion)
    return row


def _apart(model: mm.Model, motion: mm.Motion, other: mm.Motion) -> float:
    here = mm.muscle_kinematics(model, motion, velocities=False).muscle_length
    there = mm.muscle_kinematics(model, other, velocities=False).muscle_length
    names = model.muscle_names
    pairs = [
        (i, names.index(other)) for i, name in enumerate(names) if (other := _other(name, names))
    ]
    return max(float(np.abs(here[:, i] - there[:, j]).max()) for i, j in pairs)


def _other(name: str, names: tuple[str, ...]) -> str:
    base, side = split_side(name)
    return next((one for one in names if side and one != name and split_side(one)[0] == base), "")


MODEL = "fullbody-many-muscles/cyclistFullBodyMuscle.osim"
LINK = "Abdomen"
AROUND = ("pelvis", "lumbar5", "lumbar1", "thoracic12", "rib10_R", "rib10_L")
BRANCH_SIZE = 1.15
"""Of a stretch along one axis, of a twin, and of the thorax that alone is larger."""
ABOUT = ("L1_L2_FE", "L1_L2_LB", "L1_L2_AR")
"""Coordinates of the trunk, in which the strands' moment arms are compared."""
STRETCHED = {
    "the same": (1.0, 1.0, 1.0),
    "a larger twin": (BRANCH_SIZE, BRANCH_SIZE, BRANCH_SIZE),
    "deeper": (BRANCH_SIZE, 1.0, 1.0),
    "taller": (1.0, BRANCH_SIZE, 1.0),
    "wider": (1.0, 1.0, BRANCH_SIZE),
}
"""Factors along x (forward), y (up) and z (right)."""


def measure_branches(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each trunk.

    It has how far the balance is from where the bones put the link, and what that changes.
    """
    if not (folder / MODEL).is_file():
        return
    model = read_osim(folder / MODEL)
    load = branch_load(model, LINK)
    cases = {name: sheared(model, np.diag(factors)) for name, factors in STRETCHED.items()}
    cases["larger thorax alone"] = similar(model, 1.0) | {
        name: bone
        for name, bone in similar(model, BRANCH_SIZE).items()
        if name.startswith(("rib", "thoracic", "sternum"))
    }
    for name, maps in cases.items():
        bones = {body: bone for body, bone in maps.items() if body != LINK}
        mapped = _morphed(model, bones, False)
        balanced = _morphed(model, bones, True)
        link = balanced.bones[LINK]
        lengths, arms = _changed(mapped.model, balanced.model, load.muscles)
        yield {
            "trunk": name,
            "strands": len(load.muscles),
            "held by no line of action [% of tensions]": 100.0
            * link.measures["held by no line of action"],
            "moved to balance [mm]": 1e3 * link.measures["moved to balance [m]"],
            "strands' lengths changed, rms [mm]": 1e3 * float(np.sqrt(np.mean(lengths**2))),
            "strands' lengths changed, maximum [mm]": 1e3 * float(np.abs(lengths).max()),
            "moment arms about the trunk changed, rms [mm]": 1e3 * float(np.sqrt(np.mean(arms**2))),
            "moment arms about the trunk changed, maximum [mm]": 1e3 * float(np.abs(arms).max()),
        }


def _morphed(model: mm.Model, bones: dict[str, BoneMap], balance: bool) -> Morph:
    options = MorphOptions(
        joints="mapped", clear=False, fibers="keep", force="keep", balance=balance
    )
    return mm.morph_model(model, bones, options, mm.morph.MorphTarget(surrounding={LINK: AROUND}))


def _changed(
    before: mm.Model, after: mm.Model, strands: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    found = []
    for model in (before, after):
        own = replace(model, muscles=tuple(model.muscle(name) for name in strands))
        found.append(
            mm.muscle_kinematics(
                own, mm.Motion(np.zeros(1), (), np.zeros((1, 0))), velocities=False
            )
        )
    columns = [found[0].coordinates.index(name) for name in ABOUT]
    arms = found[1].moment_arm[0][:, columns] - found[0].moment_arm[0][:, columns]
    return found[1].muscle_length[0] - found[0].muscle_length[0], arms
