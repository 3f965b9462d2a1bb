"""How well landmarks of rats' bones lead to the mouse's: each left out in turn."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import numpy as np

import myomorph as mm
from benchmarks.accuracy.morph.species import percent
from benchmarks.species_cases import MOUSE, bones_of_man
from myomorph.morph.maps.fields import FeaturePoints, MapKind, MapOptions, fit_map
from myomorph.study.subject.species_morphing import read_species


def measure(data: Path) -> Iterator[dict[str, object]]:
    """A row a bone: errors of landmarks left out, by kind of map, in percent of the landmarks' extent."""
    if not (data / MOUSE).is_file():
        return
    bones = bones_of_man(data, "landmarks").bones
    for relative in read_species("human-mouse").relatives:
        marks = bones[relative.body].features
        assert marks is not None
        theirs = dict(zip(marks.names, marks.target, strict=True))
        names = tuple(name for name in relative.landmarks if name in theirs)
        source, target = (np.array([each[name] for name in names]) for each in (relative.landmarks, theirs))
        row: dict[str, object] = {"bone": relative.body, "landmarks": len(names)}
        for kind in get_args(MapKind):
            row[f"{kind} [%]"] = _left_out(names, source, target, MapOptions(kind))
        yield row


def _left_out(names: tuple[str, ...], source: np.ndarray, target: np.ndarray, options: MapOptions) -> str:
    """Median and worst error, or that the others make no map."""
    errors = []
    for k in range(len(names)):
        kept = np.arange(len(names)) != k
        others = tuple(name for i, name in enumerate(names) if i != k)
        try:
            found = fit_map(FeaturePoints(others, source[kept], target[kept]), options).apply(source[k])
        except mm.BadData:
            return "none"
        errors.append(float(np.linalg.norm(found - target[k]) / np.ptp(target, axis=0).max()))
    return percent(errors)
