"""Bones that are not what they are called, or of which a part is missing.

They are refused, or held by the intervals.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import myomorph as mm
from benchmarks.accuracy.morph.correspondence import WITHIN
from benchmarks.accuracy.morph.shapes import Case, attachments, cases
from myomorph.bones.morph.transfer.body_transfer import Transfer
from myomorph.bones.morph.transfer.points import put_on_surface
from myomorph.bones.study.morphing import MorphSettings, TargetBones, map_bones
from myomorph.core.model.errors import BadData
from truths.leg_shapes import leg_shapes

PERSONS = (4,)
"""Of LLP26; the source is the mean of the others."""
BONES = ("femur", "tibia")
HOLE = 0.015
"""Radius of a hole around a muscle attachment [m]."""
LEFT = 0.6
"""Share of the bone's length, from its upper end, that a cut leaves."""
INCH = 0.0254

Row = dict[str, object]


def part_of(surface: mm.Surface, kept: np.ndarray) -> mm.Surface:
    """Cut a surface to some of its vertices.

    Parameters
    ----------
    surface : of n vertices
    kept : (n,) whether a vertex stays

    Returns
    -------
    Surface of these vertices
    """
    faces = surface.faces[kept[surface.faces].all(axis=1)]
    used, index = np.unique(faces, return_inverse=True)
    return mm.Surface(surface.vertices[used], index.reshape(faces.shape))


def _person(bone: str, person: int) -> tuple[Case, mm.Surface, mm.Surface]:
    case = [one for one in cases("mean") if one.bone == bone][person]
    faces = leg_shapes()[bone].faces
    return case, mm.Surface(case.template, faces), mm.Surface(case.person, faces)


def measure() -> Iterator[Row]:
    """Yield a row for each bone, person and fault."""
    for person in PERSONS:
        whole = {bone: _person(bone, person) for bone in BONES}
        ours = {bone: source for bone, (_, source, _) in whole.items()}
        for bone, other in (BONES, BONES[::-1]):
            target = whole[other][2]
            yield {"fault": f"a {other} given as a {bone}", "person": person} | _refusal(
                ours, {bone: target}
            )
        inches = {
            bone: mm.Surface(target.vertices / INCH, target.faces)
            for bone, (_, _, target) in whole.items()
        }
        yield {"fault": "all bones in inches", "person": person} | _refusal(ours, inches)
        for bone in BONES:
            row = {"fault": f"{bone} with a hole of 30 mm", "person": person}
            yield row | _with_hole(bone, *whole[bone])
            row = {"fault": f"{bone}, 60 % of it", "person": person}
            yield row | _cut(bone, *whole[bone])


def _with_hole(bone: str, case: Case, source: mm.Surface, target: mm.Surface) -> Row:
    """Carry attachments to a bone with a hole around one of them."""
    here = attachments()[bone].on(case.template)
    truth = attachments()[bone].on(case.person)
    center = truth[len(truth) // 2]
    hole = part_of(target, np.linalg.norm(target.vertices - center, axis=1) > HOLE)
    near = np.linalg.norm(truth - center, axis=1) < HOLE
    return _held(source, hole, here, truth, near)


def _cut(bone: str, case: Case, source: mm.Surface, target: mm.Surface) -> Row:
    """Carry attachments to the upper part of a bone."""
    here = attachments()[bone].on(case.template)
    truth = attachments()[bone].on(case.person)
    spread = target.vertices - target.vertices.mean(axis=0)
    axis = np.linalg.svd(spread, full_matrices=False)[2][0]
    up = axis * np.sign(axis[np.argmax(np.abs(axis))])
    height = target.vertices @ up
    border = height.max() - LEFT * np.ptp(height)
    return _held(source, part_of(target, height > border), here, truth, truth @ up < border)


def _refusal(ours: dict[str, mm.Surface], theirs: dict[str, mm.Surface]) -> Row:
    here = mm.model.Transform(np.eye(3), np.zeros(3))
    bodies = tuple(mm.model.Body(name, 1.0, np.zeros(3), np.eye(3)) for name in ours)
    joints = tuple(
        mm.model.Joint(f"to_{name}", "WeldJoint", "ground", name, here, here) for name in ours
    )
    model = mm.Model("bones", bodies, joints, (), np.zeros(3))
    try:
        map_bones(model, ours, TargetBones(surfaces=theirs), MorphSettings())
    except BadData as error:
        return {"refused": "yes", "words": str(error)}
    return {"refused": "no", "words": ""}


def _held(
    source: mm.Surface, target: mm.Surface, here: np.ndarray, truth: np.ndarray, missing: np.ndarray
) -> Row:
    bone = mm.map_bone("bone", source, target)
    transfer = Transfer(bone, "bone")
    away = np.linalg.norm(put_on_surface(transfer, here, WITHIN).points - truth, axis=1)
    within = transfer.within(here)
    row: Row = {"refused": "no", "words": ""}
    for name, some in (("where surface is missing", missing), ("elsewhere", ~missing)):
        if some.any():
            row |= {
                f"{name}: points": int(some.sum()),
                f"{name}: largest error [mm]": 1e3 * float(away[some].max()),
                f"{name}: interval, median [mm]": 1e3 * float(np.median(within[some])),
                f"{name}: intervals hold [%]": 100.0 * float(np.mean(away[some] <= within[some])),
            }
    return row
