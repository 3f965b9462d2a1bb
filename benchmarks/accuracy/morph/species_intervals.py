"""Coverage of intervals of attachments and moment arms on another species.

The intervals are the command's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import get_args

import numpy as np

import myomorph as mm
from benchmarks.accuracy.morph import species_arm
from benchmarks.accuracy.morph.species import ANATOMIST, Ground, Muscles, on_skeleton, percent
from benchmarks.species_cases import BONES, MAN, MOUSE, anatomist_on_skeleton, bones_of_man
from myomorph.bones.morph.maps.fields import FeaturePoints, MapKind, MapOptions, fit_map
from myomorph.bones.morph.morphed import Morph
from myomorph.bones.morph.species.counterparts import MuscleHomology
from myomorph.bones.study.morphing import Morphed, MorphSettings
from myomorph.bones.study.species_morphing import SpeciesFiles, read_species, species_files

LEG = "human-mouse"
ARM = "human-mouse-arm"


@cache
def morphed(data: Path, table: str) -> Morphed:
    """Return what `myomorph morph --target` makes."""
    source, geometry = (
        (data / MAN, data / BONES) if table == LEG else (Path("myo-sim:myoarm"), None)
    )
    return species_files(
        SpeciesFiles(source=source, target=data / MOUSE, species=table, geometry=geometry),
        MorphSettings.of({}),
    )[0]


def measure(data: Path) -> Iterator[dict[str, object]]:
    """Yield a row for the ends of each limb's muscles, and one for each coordinate.

    The latter is of the moment arms about the coordinate.
    """
    if not all((data / one).exists() for one in (ANATOMIST, MOUSE, species_arm.FORELIMB, MAN)):
        return
    legs = on_skeleton(data)
    arms = species_arm.ground(data)
    limbs = (
        ("leg, by which the interval was set", LEG, legs, anatomist_on_skeleton(data).model),
        ("arm, which was not used", ARM, arms, species_arm.forelimb_on_skeleton(data).model),
    )
    for limb, table, ground, truth in limbs:
        found = morphed(data, table)
        pairs = [
            one
            for one in read_species(table).muscles
            if set(one.sources) <= set(found.morph.model.muscle_names)
        ]
        away, within = _ends(found.morph, truth, pairs, ground)
        yield {"of": f"ends of muscles of the {limb}"} | _row(away, within)
        standing = replace(ground, posture={})
        for word, name in ground.coordinates.items():
            apart, sure = _arms(found, truth, pairs, standing, word, name)
            if len(apart):
                yield {"of": f"moment arms about the {word}"} | _row(apart, sure)


def _ends(
    morph: Morph, truth: mm.Model, pairs: list[MuscleHomology], ground: Ground
) -> tuple[np.ndarray, np.ndarray]:
    """Return (ends,) distances from the truth and intervals [m].

    Of several parts of a muscle they are of the middle and the mean.
    """
    ours = Muscles(morph.model, ground)
    theirs = Muscles(truth, ground)
    away = []
    within = []
    for pair in pairs:
        for which in (0, -1):
            away.append(
                float(
                    np.linalg.norm(
                        ours.ends(pair.sources, which) - theirs.ends(pair.targets, which)
                    )
                )
            )
            body = ours.body(pair.sources[0], which)
            own = [
                p.within for p in morph.points if p.owner in pair.sources and p.target_body == body
            ]
            within.append(float(np.mean(own)))
    return np.array(away), np.array(within)


def _arms(
    found: Morphed,
    truth: mm.Model,
    pairs: list[MuscleHomology],
    ground: Ground,
    word: str,
    name: str,
) -> tuple[np.ndarray, np.ndarray]:
    """Compare mean moment arms over the range with the truth [m].

    The results are (muscles,) how far they are from the truth's, and the mean of their intervals.
    """
    ours = Muscles(found.morph.model, ground)
    theirs = Muscles(truth, ground)
    own = next((one for one in found.checks.arms if one.pair.target == name), None)
    if own is None or own.within is None:
        return np.zeros(0), np.zeros(0)
    apart = []
    within = []
    for pair in pairs:
        if not set(pair.sources) <= set(own.muscles):
            continue
        columns = [own.muscles.index(one) for one in pair.sources]
        sure = float(np.mean(own.within[:, columns]))
        mine = float(ours.arm(pair.sources, word).mean())
        other = float(theirs.arm(pair.targets, word).mean())
        if np.isfinite(sure) and (mine or other):
            apart.append(abs(mine - other))
            within.append(sure)
    return np.array(apart), np.array(within)


def _row(away: np.ndarray, within: np.ndarray) -> dict[str, object]:
    known = np.isfinite(within)
    return {
        "number": int(known.sum()),
        "off, median [mm]": 1e3 * float(np.median(away[known])),
        "off, 90 % [mm]": 1e3 * float(np.quantile(away[known], 0.9)),
        "interval, median [mm]": 1e3 * float(np.median(within[known])),
        "intervals hold [%]": 100.0 * float(np.mean(away[known] <= within[known])),
    }


def measure_relative(data: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each bone.

    It has errors of landmarks left out, by kind of map, in percent of the landmarks' extent.
    """
    if not (data / MOUSE).is_file():
        return
    bones = bones_of_man(data, "landmarks").bones
    for relative in read_species("human-mouse").relatives:
        marks = bones[relative.body].features
        assert marks is not None
        theirs = dict(zip(marks.names, marks.target, strict=True))
        names = tuple(name for name in relative.landmarks if name in theirs)
        source = np.array([relative.landmarks[name] for name in names])
        target = np.array([theirs[name] for name in names])
        row: dict[str, object] = {"bone": relative.body, "landmarks": len(names)}
        for kind in get_args(MapKind):
            row[f"{kind} [%]"] = _left_out(names, source, target, MapOptions(kind))
        yield row


def _left_out(
    names: tuple[str, ...], source: np.ndarray, target: np.ndarray, options: MapOptions
) -> str:
    """Median and worst error, or that the others make no map."""
    errors = []
    for k in range(len(names)):
        kept = np.arange(len(names)) != k
        others = tuple(name for i, name in enumerate(names) if i != k)
        try:
            found = fit_map(FeaturePoints(others, source[kept], target[kept]), options).apply(
                source[k]
            )
        except mm.BadData:
            return "none"
        errors.append(float(np.linalg.norm(found - target[k]) / np.ptp(target, axis=0).max()))
    return percent(errors)
