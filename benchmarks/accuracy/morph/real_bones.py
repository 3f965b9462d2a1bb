"""A leg model in the bones of two living persons.

Measured are residuals, attachments, moment arms next to published ones, and depths.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.morph.demo import demo_morph
from data_collection import data_folder
from myomorph.bones.morph.checks.checks import check_morph
from myomorph.bones.morph.checks.clearance import WEIGHT, Clearance, clear_paths
from myomorph.bones.morph.checks.moment_arms import compared_coordinates
from myomorph.bones.morph.checks.path_changes import Ground, path_changes
from myomorph.bones.morph.checks.warnings import CheckOptions, MorphChecks
from myomorph.bones.morph.maps.fields import BoneMap, FeaturePoints, MapOptions, fit_map
from myomorph.bones.morph.morphed import Morph, MorphOptions
from myomorph.bones.morph.transfer.body_transfer import Transfer
from myomorph.bones.study.morph_files import source_bones
from myomorph.bones.study.morphing import MorphSettings, TargetBones, map_bones
from myomorph.core.io.landmarks import read_landmarks
from myomorph.core.surfaces.linear_maps import procrustes

MODEL = "rajagopal-walk-emg/subject_walk_scaled.osim"
GEOMETRY = "bones-opensim-rajagopal/Geometry"
COORDINATES = ("hip_flexion_r", "knee_angle_r", "ankle_angle_r")
DEEP = 1e-3
"""A path that runs deeper under a bone's surface goes through the bone [m]."""

BONES = {
    "man (ICL)": {
        "pelvis": ("ICL_MRI/pelvis_no_sacrum.ply", "ICL_MRI/sacrum.ply"),
        "femur_r": ("ICL_MRI/femur_r.ply",),
        "tibia_r": ("ICL_MRI/tibia_r.ply", "ICL_MRI/fibula_r.ply"),
        "patella_r": ("ICL_MRI/patella_r.ply",),
        "talus_r": ("ICL_MRI/talus_r.ply",),
        "calcn_r": ("ICL_MRI/calcn_r.ply",),
    },
    "woman (MC22)": {
        "pelvis": ("MC22/pelvis_no_sacrum.ply",),
        "femur_r": ("MC22/femur_r.ply",),
        "tibia_r": ("MC22/tibia_r.ply",),
    },
}
"""Files of each body's bone. The woman has no sacrum and one mesh for the whole foot, which is left
out; so are the man's toes, an open mesh cut elsewhere than the model's.
"""


@dataclass(frozen=True)
class Published:
    """Moment arms [m] about a coordinate, from angle to angle [degrees]."""

    coordinate: str
    muscles: tuple[str, ...]
    angles: tuple[float, float]
    least: float
    most: float
    source: str


SURVEY = "survey in Manal et al. 2013, table 2"
TABLE = "textbook table after Spoor et al. 1990, Spoor and van Leeuwen 1992"
PUBLISHED = (
    Published(
        coordinate="knee_angle_r",
        muscles=("vasint_r", "vaslat_r", "vasmed_r"),
        angles=(0, 60),
        least=0.020,
        most=0.050,
        source="Sheehan 2007, 34 living",
    ),
    Published(
        coordinate="knee_angle_r",
        muscles=("recfem_r",),
        angles=(0, 90),
        least=0.020,
        most=0.040,
        source=TABLE,
    ),
    Published(
        coordinate="knee_angle_r",
        muscles=("semiten_r",),
        angles=(0, 90),
        least=0.040,
        most=0.055,
        source=TABLE,
    ),
    Published(
        coordinate="knee_angle_r",
        muscles=("semimem_r",),
        angles=(0, 90),
        least=0.020,
        most=0.040,
        source=TABLE,
    ),
    Published(
        coordinate="knee_angle_r",
        muscles=("gaslat_r", "gasmed_r"),
        angles=(0, 90),
        least=0.012,
        most=0.020,
        source=TABLE,
    ),
    Published(
        coordinate="ankle_angle_r",
        muscles=("soleus_r", "gaslat_r", "gasmed_r"),
        angles=(-20, 20),
        least=0.035,
        most=0.064,
        source=SURVEY,
    ),
)


@dataclass(frozen=True, eq=False)
class Person:
    """The leg in a person's bones."""

    name: str
    morph: Morph
    checks: MorphChecks


@cache
def persons(folder: Path) -> tuple[Person, ...]:
    """Both, their bones as one scan shows them, without landmarks."""
    model = right_leg(mm.read_model(folder / MODEL))
    settings = MorphSettings()
    found = []
    for name, files in BONES.items():
        ours = source_bones(model, folder / GEOMETRY)
        if len(files["pelvis"]) == 1:
            pelvis = next(body for body in model.bodies if body.name == "pelvis")
            parts = [mesh for mesh in pelvis.meshes if "sacrum" not in mesh.file]
            ours["pelvis"] = joined(
                [scaled(mm.read_mesh(folder / GEOMETRY / mesh.file), mesh.scale) for mesh in parts]
            )
        theirs = {
            body: joined(
                [scaled(mm.read_mesh(folder / "bones-mri-two-adults" / one), 1e-3) for one in paths]
            )
            for body, paths in files.items()
        }
        bones = map_bones(model, ours, TargetBones(surfaces=theirs, together=True), settings)
        morph = mm.morph_model(model, bones, settings.morph, mm.morph.MorphTarget(together=True))
        checks = check_morph(
            morph,
            None,
            {one: (one, 1.0, 0.0) for one in ("hip_flexion_r", "knee_angle_r", "ankle_angle_r")},
        )
        found.append(Person(name, morph, checks))
    return tuple(found)


def right_leg(model: mm.Model) -> mm.Model:
    """Return the model with the muscles of the right leg alone."""
    return replace(model, muscles=tuple(one for one in model.muscles if one.name.endswith("_r")))


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each bone of a person.

    It has how well the surfaces match, and where attachments came to lie.
    """
    for person in persons(folder):
        for body in BONES[person.name]:
            bone = person.morph.bones[body]
            points = [
                one
                for one in person.morph.points
                if one.body == body and abs(one.depth_source) < 0.005
            ]
            depth = np.array(
                [abs(one.depth_target - bone.whole.scale * one.depth_source) for one in points]
            )
            yield {
                "person": person.name,
                "bone": body,
                "vertices": len(bone.target.vertices),
                "size of the source's": bone.whole.scale,
                "residual [mm]": 1e3 * bone.measures["residual [m]"],
                "95 % [mm]": 1e3 * bone.measures["residual 95 % [m]"],
                "back [mm]": 1e3 * bone.measures["symmetric residual [m]"],
                "coverage": bone.measures["coverage"],
                "inverted": bone.measures["inverted"],
                "map inverted": bone.measures["map inverted"],
                "points within 5 mm of the source's bone": len(points),
                "depth changed, median [mm]": (
                    1e3 * float(np.median(depth)) if len(points) else float("nan")
                ),
                "worst [mm]": 1e3 * float(depth.max()) if len(points) else float("nan"),
            }


def measure_arms(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each muscle with published moment arms.

    It has least and greatest over the published angles, of source and persons.
    """
    for known in PUBLISHED:
        for muscle in known.muscles:
            row: dict[str, object] = {
                "coordinate": known.coordinate,
                "muscle": muscle,
                "angles [degrees]": f"{known.angles[0]:g} to {known.angles[1]:g}",
                "published [mm]": f"{1e3 * known.least:.0f} to {1e3 * known.most:.0f}",
            }
            for person in persons(folder):
                arms = next(
                    one for one in person.checks.arms if one.pair.source == known.coordinate
                )
                at = np.degrees(arms.source_values)
                kept = (at >= known.angles[0] - 0.1) & (at <= known.angles[1] + 0.1)
                column = arms.muscles.index(muscle)
                row["source"] = spread(arms.source[kept, column])
                row[person.name] = spread(arms.target[kept, column])
                inside = np.abs(arms.target[kept, column])
                row[f"inside, {person.name}"] = float(
                    np.mean((inside >= known.least) & (inside <= known.most))
                )
            yield row | {"published by": known.source}


def measure_depths(folder: Path) -> Iterator[dict[str, object]]:
    """Muscles that run through bone before and after, and what the checks warn of, per person."""
    for person in persons(folder):
        deep = [one for one in person.checks.penetrations if one.body in BONES[person.name]]
        worst = max(deep, key=lambda one: one.increase)
        kinds = sorted({one.kind for one in person.checks.warnings})
        yield {
            "person": person.name,
            "muscles": len(person.morph.model.muscles),
            "deeper than 1 mm": len({one.muscle for one in deep if one.target > DEEP}),
            "in the source": len({one.muscle for one in deep if one.source > DEEP}),
            "deeper than the source's by 1 mm": len(
                {one.muscle for one in deep if one.increase > DEEP}
            ),
            "largest increase of depth [mm]": 1e3 * worst.increase,
            "of": f"{worst.muscle} in {worst.body}",
            "warnings": ", ".join(f"{len(person.checks.of(kind))} {kind}" for kind in kinds),
        }


def measure_round(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each bone that both persons have whole.

    Muscle points go onto the woman's bone directly and by way of the man's.
    """
    man, woman = persons(folder)
    man = man.morph
    woman = woman.morph
    for body in ("femur_r", "tibia_r"):
        between = mm.map_bone(body, man.bones[body].target, woman.bones[body].target)
        yield {"bone": body} | round_trip(man, woman, between, body)


def round_trip(man: Morph, woman: Morph, between: BoneMap, body: str) -> dict[str, object]:
    """Compare points of a bone that went both ways.

    The row has their distances, and whether the intervals of both predict them.
    """
    source = np.array([one.source for one in man.points if one.body == body])
    direct = woman.bones[body].map.apply(source)
    first = man.bones[body].map.apply(source)
    around = between.map.apply(first)
    radii = [
        Transfer(woman.bones[body], body).within(source),
        Transfer(between, body).within(first),
    ]
    radii.append(between.whole.scale * Transfer(man.bones[body], body).within(source))
    apart = np.linalg.norm(around - direct, axis=1)
    likely = np.sqrt(np.sum(np.square(radii), axis=0))
    scaled = procrustes(source, direct, True).apply(source)
    return {
        "points": len(source),
        "distance, median [mm]": 1e3 * float(np.median(apart)),
        "distance, 95 % [mm]": 1e3 * float(np.percentile(apart, 95)),
        "distance, maximum [mm]": 1e3 * float(apart.max()),
        "from a similarity, median [mm]": (
            1e3 * float(np.median(np.linalg.norm(scaled - direct, axis=1)))
        ),
        "intervals of all three together, median [mm]": 1e3 * float(np.median(likely)),
        "hold [%]": 100.0 * float(np.mean(apart <= likely)),
    }


def measure_pairs(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each map of the landmark pairs of two femurs.

    Each landmark is left out in turn.
    """
    home = folder / "bones-landmarks-leg" / "Geometry"
    ours = read_landmarks(home / "femur_r_warp.landmarks.csv")
    theirs = read_landmarks(home / "subject_femur_r.landmarks.csv")
    names = tuple(name for name in ours if name in theirs)
    source = np.array([ours[name] for name in names])
    target = np.array([theirs[name] for name in names])
    for label, options in (
        ("similarity", MapOptions(map="similarity")),
        ("affine", MapOptions(map="affine")),
        ("RBF", MapOptions(map="rbf")),
        ("SSD", MapOptions()),
    ):
        away = []
        for k in range(len(names)):
            rest = np.delete(np.arange(len(names)), k)
            pairs = FeaturePoints(tuple(names[i] for i in rest), source[rest], target[rest])
            away.append(float(np.linalg.norm(fit_map(pairs, options).apply(source[k]) - target[k])))
        yield {
            "map": label,
            "landmarks": len(names),
            "size": procrustes(source, target, True).scale,
            "left out, median [mm]": 1e3 * float(np.median(away)),
            "worst [mm]": 1e3 * max(away),
            "of": names[int(np.argmax(away))],
        }


def spread(values: np.ndarray) -> str:
    """Write least and greatest moment arm, without their sign.

    Parameters
    ----------
    values : moment arms in any shape [m]

    Returns
    -------
    Text [mm]
    """
    sizes = 1e3 * np.abs(values)
    return f"{sizes.min():.0f} to {sizes.max():.0f}"


def scaled(surface: mm.Surface, factor: float | np.ndarray) -> mm.Surface:
    """Return a surface in another size.

    Parameters
    ----------
    surface : to scale
    factor : one, or (3,) of the axes

    Returns
    -------
    The surface, its faces unchanged
    """
    return mm.Surface(surface.vertices * factor, surface.faces)


def joined(parts: list[mm.Surface]) -> mm.Surface:
    """Several surfaces as one."""
    first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = [part.faces + start for part, start in zip(parts, first, strict=True)]
    return mm.Surface(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))


if __name__ == "__main__":
    from benchmarks.__main__ import print_rows

    for part in (measure_pairs, measure, measure_arms, measure_depths):
        print_rows(list(part(data_folder())))


Row = dict[str, object]

WAYS = {"least move": 0.0, "least change": WEIGHT}


def measure_clearing(folder: Path) -> Iterator[Row]:
    """Yield a row for each leg and way."""
    legs = [("demo, known deformation", demo_morph(), False)]
    legs += [(one.name, one.morph, True) for one in persons(folder)]
    for name, morph, together in legs:
        mapped = mm.morph_model(
            morph.source,
            morph.bones,
            MorphOptions(clear=False, fibers="keep", force="keep"),
            mm.morph.MorphTarget(together=together),
        )
        pairs = compared_coordinates(mapped.source, mapped.model)
        ground = Ground.of(
            mapped.source, mapped.model, mapped.bones.values(), pairs, CheckOptions()
        )
        if ground is None:
            continue
        for way, weight in WAYS.items():
            yield {"leg": name, "way": way} | changes(
                clear_paths(mapped.model, ground, weight), ground, mapped
            )


def changes(found: Clearance, ground: Ground, mapped: Morph) -> Row:
    """Return what was too deep before and after, what was moved, and what this changed.

    Moves beyond intervals are counted.
    """
    changed = path_changes(found.start, found.model, ground.poses)
    # A wrap object that grows changes only some of the muscles that run around it.
    odd = {name: one for name, one in changed.items() if max(one.length, one.arm) > 1e-6}
    within = {(one.owner, one.name): one.within for one in mapped.points}
    shifts = found.shifts
    worst = max(odd, key=lambda name: odd[name].arm, default="")
    lengths = 1e3 * np.array([one.length for one in odd.values()])
    arms = 1e3 * np.array([one.arm for one in odd.values()])
    return {
        "muscles too deep": len(found.before),
        "after": len(found.after),
        "sum of depths [mm]": 1e3 * sum(found.before.values()),
        "after [mm]": 1e3 * sum(found.after.values()),
        "points moved": len(shifts),
        "furthest [mm]": 1e3 * max(shifts.values(), default=0.0),
        "beyond their interval": sum(shift > within[name] for name, shift in shifts.items()),
        "wrap objects grown": len(found.grown),
        "lengths changed, rms [mm]": _rms(lengths),
        "lengths changed, maximum [mm]": float(lengths.max(initial=0.0)),
        "moment arms changed, rms [mm]": _rms(arms),
        "moment arms changed, maximum [mm]": float(arms.max(initial=0.0)),
        "of": worst,
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
