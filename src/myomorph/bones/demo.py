"""`demo --study morph`: a leg's muscles, transferred to bones whose deformation is known.

The errors of the transfer are reported. The bones are the left ones of `myo-sim`, mirrored to the
right and deformed by one smooth field; nobody was scanned.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.bones import deformed_leg
from myomorph.bones.morph.arm_intervals import DRAWS, with_arm_intervals
from myomorph.bones.morph.checks.checks import PARTS, check_morph
from myomorph.bones.morph.checks.moment_arms import COUNT, compare_moment_arms, compared_coordinates
from myomorph.bones.morph.maps.fields import (
    BoneMap,
    FeaturePoints,
    MapKind,
    MapOptions,
    PointMap,
    fit_map,
)
from myomorph.bones.morph.morphed import Morph, MorphOptions
from myomorph.bones.morph.transfer.model import MorphTarget, morph_model
from myomorph.bones.report.morph_summary import morph_lines
from myomorph.bones.study.morphing import (
    STEP,
    Morphed,
    MorphSettings,
    TargetBones,
    map_bones,
    write_morphed,
)
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.paths import PathPoint
from myomorph.core.surfaces.linear_maps import AffineMap, procrustes
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.rows import Rows, dot_plot
from myomorph.lab.report.page.parts import Figure, Grid, Note, Section
from myomorph.lab.store.progress import progress
from myomorph.lab.store.results import provenance_of, value_source
from myomorph.lab.study.subject.subjects import tables_folder

WRITTEN = "as written"
DENSE: Mapping[MapKind, str] = {"rbf": "RBF, dense", "ssd": "SSD, dense"}
STYLES = ("middle", "second", "third", "fourth", "left", "first")


@read_only
class MorphErrors:
    """Errors against the truth."""

    points: tuple[tuple[str, str, str], ...]  # owner, name and body of the muscles' fixed points
    distances: Mapping[str, Array]  # (points,) by method [m]
    joints: Mapping[str, float]  # distance of each joint's center in its child from the truth [m]
    # by method, root mean square over the range of the error of each moment arm [m]
    arms: Mapping[str, Array]
    pairs: tuple[tuple[str, str], ...]  # muscle and coordinate of each of these


def axis_scaling(landmarks: FeaturePoints) -> AffineMap:
    """Each axis scaled by how far landmarks spread along it, as generic models are scaled."""
    middle = landmarks.source.mean(axis=0)
    goal = landmarks.target.mean(axis=0)
    factors = landmarks.target.std(axis=0) / landmarks.source.std(axis=0)
    return AffineMap(np.diag(factors), goal - factors * middle)


def morph_errors(
    morph: Morph, truth: Mapping[str, PointMap], landmarks: Mapping[str, FeaturePoints]
) -> MorphErrors:
    """Compare a morph with a known deformation of the bodies.

    Simpler maps through landmarks alone are compared with it as well.
    """
    fixed = {
        (m.name, p.name)
        for m in morph.source.muscles
        for p in m.path.points
        if isinstance(p, PathPoint)
    }
    points = [
        point
        for point in morph.points
        if (point.owner, point.name) in fixed and point.body in truth
    ]
    bodies = [point.body for point in points]
    source = np.array([point.source for point in points])
    true = _carried(truth, bodies, source)
    methods = _methods(morph, landmarks)
    distances = {
        name: np.linalg.norm(_carried(by, bodies, source) - true, axis=1)
        for name, by in methods.items()
    }
    distances[WRITTEN] = np.linalg.norm(np.array([point.target for point in points]) - true, axis=1)
    scaled = next(iter(methods))
    arms, pairs = _arm_errors(morph, truth, {scaled: methods[scaled]})
    return MorphErrors(
        points=tuple((point.owner, point.name, point.body) for point in points),
        distances=distances,
        joints=_joint_errors(morph, truth),
        arms=arms,
        pairs=pairs,
    )


def _methods(
    morph: Morph, landmarks: Mapping[str, FeaturePoints]
) -> dict[str, Mapping[str, PointMap]]:
    """Return the maps of each method, by body; scaling first."""
    count = max(len(landmark) for landmark in landmarks.values())
    result: dict[str, Mapping[str, PointMap]] = {
        f"scaling, {count} landmarks": {
            body: axis_scaling(landmark) for body, landmark in landmarks.items()
        }
    }
    kinds: dict[MapKind, str] = {"affine": "affine", "rbf": "RBF", "ssd": "SSD"}
    for kind, name in kinds.items():
        maps = {
            body: fit_map(landmark, MapOptions(map=kind)) for body, landmark in landmarks.items()
        }
        result[f"{name}, {count} landmarks"] = maps
    for kind, name in DENSE.items():
        result[name] = {
            body: fit_map(_features(morph.bones[body]), MapOptions(map=kind)) for body in landmarks
        }
    return result


def _features(bone: BoneMap) -> FeaturePoints:
    if bone.features is None:
        raise BadData(f"the map of '{bone.body}' has no feature points")
    return bone.features


def _carried(maps: Mapping[str, PointMap], bodies: list[str], points: Array) -> Array:
    result = np.empty_like(points)
    owner = np.array(bodies)
    for body in set(bodies):
        result[owner == body] = maps[body].apply(points[owner == body])
    return result


def _joint_errors(morph: Morph, truth: Mapping[str, PointMap]) -> dict[str, float]:
    joints = {joint.name: joint for joint in morph.source.joints}
    result = {}
    for moved_joint in morph.joints:
        joint = joints[moved_joint.name]
        if joint.child in truth and joint.parent in truth:
            goal = truth[joint.child].apply(joint.child_frame.translation)
            result[moved_joint.name] = float(np.linalg.norm(moved_joint.in_child - goal))
    return result


def _arm_errors(
    morph: Morph, truth: Mapping[str, PointMap], others: Mapping[str, Mapping[str, PointMap]]
) -> tuple[dict[str, Array], tuple[tuple[str, str], ...]]:
    """Errors of moment arms against the model that the truth itself carries, and their kind."""
    exact = MorphOptions(surface_within=0.0, joints="mapped")
    true = morph_model(morph.source, _bones(morph, truth), exact).model
    models = {
        name: morph_model(morph.source, _bones(morph, by), exact).model
        for name, by in others.items()
    }
    errors = {}
    pairs = []
    for name, model in {**models, WRITTEN: morph.model}.items():
        tables = compare_moment_arms(true, model, compared_coordinates(true, model))
        turning = [table for table in tables if table.kind == "rotational"]
        errors[name] = np.concatenate(
            [np.sqrt(np.mean((arm.target - arm.source) ** 2, axis=0)) for arm in turning]
        )
        pairs = [(muscle, arm.pair.source) for arm in turning for muscle in arm.muscles]
    return errors, tuple(pairs)


def _bones(morph: Morph, maps: Mapping[str, PointMap]) -> dict[str, BoneMap]:
    """Bones that go by given maps."""
    result = {}
    for body, map_ in maps.items():
        surface = morph.bones[body].source
        if surface is None:
            raise BadData(f"the source has no bone of '{body}'")
        whole = procrustes(surface.vertices, map_.apply(surface.vertices), True)
        result[body] = BoneMap(
            body=body,
            target_body=body,
            map=map_,
            whole=whole,
            basis="given",
            source=surface,
            target=None,
        )
    return result


def error_section(morph_errors: MorphErrors) -> Section:
    """How far each method puts muscles and joints from where they truly are."""
    bodies = list(dict.fromkeys(body for _, _, body in morph_errors.points))
    owner = np.array([body for _, _, body in morph_errors.points])
    shown = [name for name in morph_errors.distances if not name.startswith("affine")]
    medians = [
        np.array(
            [1e3 * float(np.median(morph_errors.distances[name][owner == body])) for body in bodies]
        )
        for name in shown
    ]
    styles = STYLES[: len(shown)]
    plot = dot_plot(
        "Median error of the muscle points on each bone",
        "mm",
        Rows(names=bodies, values=medians, styles=styles, labels=shown),
        880,
    )
    lead = (
        f"{len(morph_errors.points)} points of muscles, each where a map puts it, against where the"
        f" known deformation puts it. “{WRITTEN.capitalize()}” is the model of this page: the dense"
        " map, then points near a surface put back onto it, and via points brought out of bones."
        " Moment arms are compared with those of the model that the known deformation itself"
        " carries; joint centers against where it puts the source's."
    )
    head = ("Method", "Median [mm]", "Mean [mm]", "95 % [mm]", "Worst [mm]")
    grids = (
        Grid(
            head,
            tuple(_row(name, distance) for name, distance in morph_errors.distances.items()),
            "Error of the muscle points",
        ),
        Grid(
            head,
            tuple(_row(name, arm) for name, arm in morph_errors.arms.items()),
            f"Error of {len(morph_errors.pairs)} moment arms, root mean square over the range of"
            " the coordinate",
        ),
        Grid(
            ("Joint", "Error [mm]"),
            tuple((name, number(1e3 * joint)) for name, joint in morph_errors.joints.items()),
            "Error of the joint centers in the child's frame",
        ),
        _worst_points(morph_errors),
    )
    legend = tuple(zip(styles, shown, strict=True))
    return Section(
        key="errors",
        title="Error against the truth",
        lead=lead,
        legend=legend,
        figures=(Figure(plot, "full"),),
        grids=grids,
    )


def _row(name: str, errors: Array) -> tuple[str, ...]:
    values = (np.median(errors), errors.mean(), np.percentile(errors, 95.0), errors.max())
    return (name, *(number(1e3 * float(value)) for value in values))


def _worst_points(morph_errors: MorphErrors, most: int = 10) -> Grid:
    written = morph_errors.distances[WRITTEN]
    order = np.argsort(-written)[:most]
    rows = tuple((*morph_errors.points[i], number(1e3 * float(written[i]))) for i in order)
    return Grid(
        head=("Muscle", "Point", "Bone", "Error [mm]"),
        rows=rows,
        title=f"The {len(rows)} worst points as written",
        folded=True,
    )


RESULT = "leg.osim"
ERRORS = "errors.csv"


@dataclass(frozen=True, eq=False)
class MorphDemo:
    """What the demo found."""

    morphed: Morphed  # the leg in the deformed bones
    truth: Mapping[str, deformed_leg.BodyTruth]  # by body
    errors: MorphErrors  # against the truth
    report: Path  # path of the page


def run_morph_demo(out: Path) -> MorphDemo:
    """Transfer the leg's muscles to the deformed bones.

    The model, its errors, bones, tables and a report are written.
    """
    from myomorph.bones.report.morph_page import PageParts, morph_page
    from myomorph.lab.study.trial.reporting import REPORT

    out.mkdir(parents=True, exist_ok=True)
    model, ours, theirs, truth = deformed_leg.demo_case()
    pairs = deformed_leg.picked_landmarks(ours, truth)
    settings = MorphSettings()
    bones = map_bones(model, ours, TargetBones(surfaces=theirs, landmarks=pairs), settings)
    with progress("muscles", 2 * (COUNT + 1), "postures") as advance:
        target = MorphTarget(name="leg in deformed bones")
        morph = morph_model(model, bones, settings.morph, target, advance)
    with progress("checks", PARTS, "parts") as advance:
        checks = check_morph(morph, progress=advance)
    with progress("intervals", DRAWS, "models") as advance:
        checks = with_arm_intervals(morph, checks, advance)
    source = value_source("model", "demo:morph", *(point.source for point in morph.points))
    morphed = Morphed(
        morph=morph,
        checks=checks,
        provenance=provenance_of("morph", (source,), settings.plain()),
        warnings=(),
    )
    errors = morph_errors(morph, truth, pairs)
    page = morph_page(
        morph,
        checks,
        morphed.provenance,
        parts=PageParts(
            title="A leg in deformed bones",
            notes=_notes(),
            further=(error_section(errors),),
        ),
    )
    tables = tables_folder(out / RESULT, STEP.tables)
    write_morphed(morphed, out / RESULT, tables, page=page)
    _write_errors(errors, out / ERRORS)
    return MorphDemo(morphed=morphed, truth=truth, errors=errors, report=tables / REPORT)


def _notes() -> tuple[Note, ...]:
    stretch = ", ".join(f"{factor:g}" for factor in deformed_leg.STRETCH)
    return (
        Note(
            "simulated",
            "The target's bones are synthetic: the left bones of myo-sim mirrored to the right,"
            f" stretched by {stretch} along the axes of the ground and bent by three waves of"
            f" {1e3 * deformed_leg.AMPLITUDE:g} mm. Where every muscle point truly is follows from"
            " that field.",
        ),
        Note(
            "simulated",
            f"{deformed_leg.LANDMARKS} landmarks a bone, picked in the target with a standard"
            f" deviation of {1e3 * deformed_leg.PICKED:g} mm an axis; the target's triangles are"
            " not the source's.",
        ),
    )


def _write_errors(errors: MorphErrors, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(("muscle", "point", "body", *(f"{name} [m]" for name in errors.distances)))
        for i, names in enumerate(errors.points):
            writer.writerow(
                (*names, *(f"{distance[i]:.6g}" for distance in errors.distances.values()))
            )


def summary(morph_demo: MorphDemo) -> list[str]:
    """Return the lines that the command prints: errors by method, and the number of warnings."""
    lines = [
        f"error of {len(morph_demo.errors.points)} muscle points against the known deformation,"
        " median and worst [mm]:"
    ]
    lines += [
        f"  {name:<24} {1e3 * float(np.median(distance)):5.1f} {1e3 * float(distance.max()):5.1f}"
        for name, distance in morph_demo.errors.distances.items()
    ]
    return [*lines, *morph_lines(morph_demo.morphed.morph, morph_demo.morphed.checks)]
