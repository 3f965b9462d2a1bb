"""Masses of morphed models: envelopes grown around bones against the masses that models have."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.io.osim.read import read_osim
from myomorph.model.scale import scale
from myomorph.morph.maps.fields import BoneMap
from myomorph.morph.maps.linear import AffineMap, Similarity
from myomorph.morph.morphed import Morph
from myomorph.simulate.jump import leg_model
from myomorph.study.subject.morph_files import source_bones
from myomorph.study.subject.morph_masses import min_eigenvalues, with_envelope_masses, with_morphed_masses

SIZE = 0.8
LEAST = 0.02
"""Bodies of less than this share of the whole are left out of medians."""

GEOMETRY = "bones-opensim-rajagopal/Geometry"

Row = dict[str, object]


def measure(folder: Path) -> Iterator[Row]:
    """Two rows a model: flesh as the source's masses ask for, and flesh in one proportion on every bone."""
    rajagopal = read_osim(folder / "rajagopal-walk-emg/subject_walk_scaled.osim")
    for model, geometry in ((leg_model(), None), (rajagopal, folder / GEOMETRY)):
        bones = source_bones(model, geometry)
        morph = smaller(model, bones)
        mass = morph.model.mass
        for name, found in (
            ("as the source's masses ask for", with_morphed_masses(morph, mass, by="envelope")[0]),
            ("one share of every bone's length", with_envelope_masses(morph.model, _surfaces(morph), mass)[0]),
        ):
            yield {"model": model.name, "flesh": name} | compared(morph.model, found)


def smaller(model: mm.Model, bones: dict[str, mm.Surface]) -> Morph:
    """The morph that makes the model uniformly smaller."""
    shrunk = AffineMap(SIZE * np.eye(3), np.zeros(3))
    whole = Similarity(np.eye(3), np.zeros(3), SIZE)
    maps = {
        name: BoneMap(name, name, shrunk, whole, "bone", one, mm.Surface(SIZE * one.vertices, one.faces))
        for name, one in bones.items()
    }
    grown = scale(model, {name: np.full(3, SIZE) for name in model.body_names})
    return Morph(model, grown, maps, (), (), ())


def _surfaces(morph: Morph) -> dict[str, mm.Surface]:
    return {bone.target_body: bone.target for bone in morph.bones.values() if bone.target is not None}


def compared(model: mm.Model, found: mm.Model) -> Row:
    """Masses, mass centers and moments of inertia against the scaled model's own."""
    own = np.array([body.mass for body in model.bodies])
    new = np.array([body.mass for body in found.bodies])
    heavy = np.flatnonzero(own >= LEAST * own.sum())
    off = np.abs(new[heavy] / own[heavy] - 1.0)
    apart = [np.linalg.norm(model.bodies[i].mass_center - found.bodies[i].mass_center) for i in heavy]
    moments = [np.trace(found.bodies[i].inertia) / np.trace(model.bodies[i].inertia) for i in heavy]
    worst = model.body_names[heavy[int(np.argmax(off))]]
    possible = Counter(bool(one > 0.0) for one in min_eigenvalues(found)[new > 0.0])
    return {
        "whole mass off [kg]": abs(float(new.sum() - own.sum())),
        "bodies that can be": f"{possible[True]} of {sum(possible.values())}",
        "heavy bodies": len(heavy),
        "mass off, median [%]": 100.0 * float(np.median(off)),
        "worst [%]": 100.0 * float(off.max()),
        "worst body": worst,
        "mass center off, median [mm]": 1e3 * float(np.median(apart)),
        "inertia over the model's, median": float(np.median(moments)),
    }
