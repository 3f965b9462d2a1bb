"""Drawings of a morphed model: both models, residuals of its bones, moment arms of its muscles."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from myomorph.bones.morph.checks.checks import distinct_bones, target_surface
from myomorph.bones.morph.checks.moment_arms import CoordinatePair, MomentArms
from myomorph.bones.morph.maps.fields import BoneMap
from myomorph.bones.morph.morphed import Morph
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Mesh, Model
from myomorph.core.model.series import DEFAULT_POSE
from myomorph.core.model.spatial import Transform
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.surface_points import Shape
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.marks import across, band, drawing, frame, line, text
from myomorph.lab.report.charts.pictures import RowLook, picture_row, residual_map
from myomorph.lab.report.scene.pictures import fitting_scale, pictures
from myomorph.lab.report.scene.scene import Scene, make_scene
from myomorph.lab.report.scene.shapes import outward, reduced

VIEWS = {"side": "from the right", "front": "from the front", "left": "from the left"}
MAX_FACES = 60_000  # Triangles that pictures are drawn from.
HEIGHT = 560
WIDEST = 340  # Of one picture in the drawing of both bodies at most [pixels].
UNLIKE = 4.0  # Bodies whose sizes differ by this factor are drawn at scales of their own.
COLUMNS = 6
CELL = 170.0
ROW = 106.0
MARGIN = 30.0
MAX_PANELS = 30  # Muscles drawn about one coordinate.


def body_figure(morph: Morph) -> str:
    """Draw source and target side by side from each of `VIEWS`, in the default pose, at one scale.

    Where one is so much smaller that it could not be seen, each has a scale of its own, and the
    title says so.
    """
    names = set(morph.source.muscle_names) & set(morph.model.muscle_names)
    ours = {bone.body: bone.source for bone in distinct_bones(morph)}
    both = (
        ("source", morph.source.name, _scene(morph.source, ours, names)),
        ("target", morph.model.name, _scene(morph.model, _target_bones(morph), names)),
    )
    sides = HEIGHT, WIDEST, tuple(VIEWS)
    scales = [fitting_scale(scene, *sides) for _, _, scene in both]
    alike = max(scales) < UNLIKE * min(scales)
    scales = [min(scales)] * 2 if alike else scales
    drawn = [
        (whose, picture)
        for (whose, _, scene), scale in zip(both, scales, strict=True)
        for picture in pictures(scene, sides[:2], views=sides[2], scale=scale)
    ]
    order = sorted(drawn, key=lambda pair: sides[2].index(pair[1].view))
    labels = [f"{whose}, {VIEWS[picture.view]}" for whose, picture in order]
    sizes = " and ".join(
        f"{whose} ({name}) {_length(scene.high - scene.low)}" for whose, name, scene in both
    )
    scale_words = "one scale" if alike else "each at a scale of its own"
    unit = f"{sizes} high; {scale_words}"
    return picture_row(
        "Source and target",
        [picture for _, picture in order],
        labels,
        look=RowLook(unit=unit, width=1040.0),
    )


def _target_bones(morph: Morph) -> dict[str, Surface]:
    """Bones of the target by body; several of the source's that became one are drawn once."""
    result: dict[str, Surface] = {}
    for bone in morph.bones.values():
        surface = target_surface(bone)
        if surface is not None and (bone.target is not None or bone.target_body not in result):
            result[bone.target_body] = surface
    return result


def _scene(model: Model, bones: Mapping[str, Surface | None], muscles: Collection[str]) -> Scene:
    """Return the model in its default pose with these bones and muscles alone.

    Bodies without a known bone are sticks.
    """
    known = {
        name: outward(bone)
        for name, bone in bones.items()
        if bone is not None and name in model.body_names
    }
    size = max(
        (float(np.ptp(surface.vertices, axis=0).max()) for surface in known.values()), default=1.0
    )
    lean = dict(zip(known, reduced(list(known.values()), size, MAX_FACES), strict=True))
    still = Transform.identity()
    meshes = {name: (Mesh(name, still, np.ones(3)),) for name in lean}
    shown = replace(
        model,
        bodies=tuple(replace(body, meshes=meshes.get(body.name, ())) for body in model.bodies),
        muscles=tuple(muscle for muscle in model.muscles if muscle.name in muscles),
        ground_meshes=(),
    )
    scene = make_scene(shown, DEFAULT_POSE, [0], lean)
    held = {point.body for muscle in shown.muscles for point in muscle.path.points} | set(lean)
    return _only(scene, [i + 1 for i, name in enumerate(model.body_names) if name in held])


def _only(scene: Scene, bodies: Sequence[int]) -> Scene:
    """Keep some bodies of a scene, and its muscles, framed by these."""
    numbers = {old: new + 1 for new, old in enumerate(bodies)}
    kept = [0, *bodies]
    solids = tuple(
        replace(solid, body=numbers[solid.body]) for solid in scene.solids if solid.body in numbers
    )
    R = scene.rotations[0, kept]
    p = scene.origins[0, kept]
    clouds = [solid.surface.vertices @ R[solid.body].T + p[solid.body] for solid in solids]
    clouds += [
        muscle.points[0][np.isfinite(muscle.points[0]).all(axis=1)] for muscle in scene.muscles
    ]
    if not clouds:
        return scene
    everything = np.concatenate(clouds)
    heights = everything @ scene.up
    grown = float(np.linalg.norm(np.ptp(everything, axis=0))) / scene.size
    low = float(heights.min())
    high = float(heights.max())
    return replace(
        scene,
        rotations=scene.rotations[:, kept],
        origins=scene.origins[:, kept],
        solids=solids,
        muscles=tuple(replace(muscle, radius=muscle.radius * grown) for muscle in scene.muscles),
        size=scene.size * grown,
        low=low,
        high=high,
        floor=low,
    )


def _length(meters: float) -> str:
    return f"{number(meters)} m" if meters >= 0.2 else f"{number(1e3 * meters)} mm"


def bone_figures(morph: Morph) -> list[str]:
    """Draw the target's bones colored by how far the transferred source's bones lie from them.

    Each pair of surfaces is drawn once.
    """
    shared: dict[tuple[int, int], list[BoneMap]] = {}
    for bone in distinct_bones(morph):
        if bone.source is not None and bone.target is not None:
            key = hash(bone.source.faces.tobytes()), hash(bone.target.faces.tobytes())
            shared.setdefault(key, []).append(bone)
    return [
        _bone_figure(bones[0], bones[0].source, bones[0].target, len(bones) - 1)
        for bones in shared.values()
    ]


def _bone_figure(bone: BoneMap, source: Surface | None, target: Surface | None, others: int) -> str:
    assert source is not None
    assert target is not None
    carried = outward(Surface(bone.map.apply(source.vertices), source.faces))
    distances = Shape(carried).signed(np.array(target.vertices))
    name = bone.target_body + (f" and {others} more" if others else "")
    rms = 1e3 * float(np.sqrt(np.mean(distances**2)))
    return residual_map(name, f"mm, {number(rms)} root mean square", outward(target), distances)


def arm_figure(
    moment_arms: MomentArms, sizes: Mapping[str, float], flagged: Collection[str]
) -> str:
    """Draw moment arms of all muscles about a coordinate over its range, a small panel each.

    The source's are scaled to the target by `sizes`; names of muscles in `flagged` are printed in
    the color of warnings.
    """
    size = np.array([sizes.get(name, 1.0) for name in moment_arms.muscles])
    shown = _shown_muscles(moment_arms, size, flagged)
    turning = moment_arms.kind == "rotational"
    words = _axis_words(moment_arms.target_values, turning)
    if len(shown) < len(moment_arms.muscles):
        words += (
            f", {len(shown)} of {len(moment_arms.muscles)} muscles: those with a warning and the"
            " largest"
        )
    factor = 1e3 if turning else 1.0
    parts = []
    for place, muscle_index in enumerate(shown):
        muscle = moment_arms.muscles[muscle_index]
        x = (place % COLUMNS) * CELL
        y = MARGIN + (place // COLUMNS) * ROW
        ours = factor * float(size[muscle_index]) * moment_arms.source[:, muscle_index]
        lines = (ours, factor * moment_arms.target[:, muscle_index])
        within = (
            None if moment_arms.within is None else factor * moment_arms.within[:, muscle_index]
        )
        parts.append(
            _panel(x, y, muscle, moment_arms.target_values, lines, within, muscle in flagged)
        )
    rows = -(-len(shown) // COLUMNS)
    return drawing(
        "arms",
        f"Moment arms about {name_of(moment_arms.pair)}",
        (COLUMNS * CELL, MARGIN + rows * ROW + 6),
        *parts,
        unit=words,
    )


def _shown_muscles(moment_arms: MomentArms, size: Array, flagged: Collection[str]) -> list[int]:
    """Return indices of muscles to draw: of too many, those that are flagged and the largest.

    They are in their order. `size`: (muscles,) of the target over the source.
    """
    largest = np.maximum(
        np.abs(moment_arms.source).max(axis=0) * size, np.abs(moment_arms.target).max(axis=0)
    )
    order = np.lexsort([-largest, [name not in flagged for name in moment_arms.muscles]])
    return sorted(int(muscle) for muscle in order[:MAX_PANELS])


def _axis_words(values: Array, turning: bool) -> str:
    """Write the unit of moment arms, and the range of a coordinate's values (samples,)."""
    factor = 180.0 / np.pi if turning else 1e3
    low = float(np.min(values)) * factor
    high = float(np.max(values)) * factor
    unit = "mm" if turning else "mm/mm"
    over = "°" if turning else " mm"
    return f"{unit}, from {number(low, 1.0)} to {number(high, 1.0)}{over}"


def name_of(pair: CoordinatePair) -> str:
    """Name a coordinate of the target in print, with the source's where that differs."""
    return pair.target if pair.source == pair.target else f"{pair.target} (source {pair.source})"


def _panel(
    x: float,
    y: float,
    muscle: str,
    values: Array,
    lines: tuple[Array, Array],
    within: Array | None,
    flagged: bool,
) -> str:
    low = min(0.0, *(float(values.min()) for values in lines))
    high = max(0.0, *(float(values.max()) for values in lines))
    high = high if high > low else low + 1.0
    first = float(values.min())
    last = float(values.max())
    area = frame(
        (x + 34, y + 16),
        (x + CELL - 8, y + ROW - 14),
        (first, last if last > first else first + 1),
        (low, high),
    )
    parts = [text(x + 34, y + 9, muscle, "limit start" if flagged else "tick end")]
    parts.append(across(area, float(area.y.at(0.0)), "zero"))
    parts += [
        text(x + 30, float(area.y.at(value)) + 3, number(value), "tick y") for value in (low, high)
    ]
    if within is not None:
        parts.append(band(area, values, lines[1] - within, lines[1] + within, "first"))
    for line_values, style, label in zip(
        lines, ("truth", "first"), ("source, scaled", "target"), strict=True
    ):
        parts.append(line(area, values, line_values, style, f"{muscle}, {label}"))
    return "".join(parts)
