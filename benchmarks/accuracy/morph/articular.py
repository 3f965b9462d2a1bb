"""Spheres and cylinders of articular surfaces, and landmarks found by rules.

They are compared with truths and other methods.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.bones.morph.registration.alignment import automatic_landmarks
from myomorph.bones.morph.shapes.articular import (
    ExpectedCylinder,
    articular_cylinder,
    articular_sphere,
    spherical_patches,
    warning_of,
)
from myomorph.bones.morph.shapes.quadrics import CylinderFit, SphereFit, fit_cylinder, fit_sphere
from myomorph.core.model.surface import pieces_of, turned_outward
from myomorph.core.surfaces.linear_maps import Similarity, procrustes
from myomorph.core.surfaces.surface_points import Shape
from truths.leg_shapes import leg_shapes

Row = dict[str, object]

RUNS = 50
POINTS = 600
RADIUS = 0.023
NOISE = 3e-4
WRONG = 0.008
EVERY = 5
"""Every so many of the persons in what takes long."""

SOCKET = 1.15
"""Radius of a socket over that of its head, from which it is looked for."""


def measure_made() -> Iterator[Row]:
    """Made surfaces: noise, wrong points, little cover."""
    for share in (0.6, 0.3, 0.15):
        yield _made("sphere", share, f"{100 * share:.0f} % of the sphere")
    for share in (0.5, 0.35, 0.2):
        yield _made("cylinder", share, f"{360 * share:.0f}° of the turn, 40 mm long")


def _made(kind: str, share: float, cover: str) -> Row:
    errors = []
    deviations = []
    tilts = []
    for seed in range(RUNS):
        random = np.random.default_rng(seed)
        if kind == "sphere":
            height = 1.0 - 2.0 * share * random.random(POINTS)
            along = np.zeros((POINTS, 3))
            angle = 2.0 * np.pi * random.random(POINTS)
        else:
            height = np.zeros(POINTS)
            along = np.outer(0.04 * random.random(POINTS) - 0.02, [0.0, 0.0, 1.0])
            angle = 2.0 * np.pi * share * random.random(POINTS)
        level = np.sqrt(1.0 - height**2)
        direction = np.stack([level * np.cos(angle), level * np.sin(angle), height], axis=1)
        points = along + direction * (RADIUS + NOISE * random.normal(size=POINTS))[:, None]
        points[::7] += WRONG * random.normal(size=points[::7].shape)
        looks = direction + 0.15 * random.normal(size=direction.shape)
        looks /= np.linalg.norm(looks, axis=1)[:, None]
        if kind == "sphere":
            sphere = fit_sphere(
                points, looks, np.full(POINTS, 4.0 * np.pi * RADIUS**2 * share / POINTS)
            )
            errors.append(float(np.linalg.norm(sphere.center)))
            deviations.append(float(np.sqrt(np.trace(sphere.covariance))))
        else:
            cylinder = fit_cylinder(points, looks, np.ones(POINTS), [0.0, 0.0, 1.0])
            errors.append(float(np.linalg.norm(np.cross(cylinder.point, cylinder.axis))))
            deviations.append(cylinder.deviation)
            tilts.append(float(np.degrees(np.arccos(min(1.0, abs(cylinder.axis[2]))))))
    return {
        "surface (simulated)": kind,
        "cover": cover,
        "center or axis off, rms [mm]": 1e3 * float(np.sqrt(np.mean(np.square(errors)))),
        "worst [mm]": 1e3 * max(errors),
        "estimated SD, median [mm]": 1e3 * float(np.median(deviations)),
        "axis turned, rms [°]": float(np.sqrt(np.mean(np.square(tilts)))) if tilts else "",
    }


def measure_centers(folder: Path) -> Iterator[Row]:
    """Heads found without a start, against sockets and against what others took for the center."""
    adults = folder / "bones-mri-two-adults"
    for name, person in (("man, MRI", "ICL_MRI"), ("woman, MRI", "MC22")):
        femur = _meters(adults / person / "femur_r.ply")
        pelvis = _meters(adults / person / "pelvis_no_sacrum.ply")
        yield _hip(f"right hip, {name}", _head(femur), pelvis)
    bones = folder / "bones-opensim-rajagopal" / "Geometry"
    for name, file in (
        ("right femur, generic (OpenSim)", "r_femur"),
        ("left femur, generic (OpenSim)", "l_femur"),
        ("right humerus, generic (OpenSim)", "humerus_rv"),
    ):
        yield _against(
            name, _head(mm.read_mesh(bones / f"{file}.vtp")), np.zeros(3), "the body's origin"
        )


def _head(femur: mm.Surface) -> SphereFit:
    return spherical_patches(femur)[0]


def _hip(name: str, head: SphereFit, pelvis: mm.Surface) -> Row:
    socket = articular_sphere(pelvis, head.center, SOCKET * head.radius, hollow=True)
    return _center_row(name, head, socket, socket.center, "the socket's center")


def _against(name: str, head: SphereFit, center: np.ndarray, against: str) -> Row:
    return _center_row(name, head, None, center, against)


def _center_row(
    name: str, head: SphereFit, socket: SphereFit | None, center: np.ndarray, against: str
) -> Row:
    warnings = [
        warning for one in (head, socket) if one is not None and (warning := warning_of(one))
    ]
    return {
        "joint": name,
        "head, radius [mm]": 1e3 * head.radius,
        "head, rms [mm]": 1e3 * head.rms,
        "head, cover": head.coverage,
        "head, estimated SD [mm]": 1e3 * head.deviation,
        "socket, radius [mm]": "" if socket is None else 1e3 * socket.radius,
        "socket, cover": "" if socket is None else socket.coverage,
        "socket, estimated SD [mm]": "" if socket is None else 1e3 * socket.deviation,
        "warnings": "; ".join(warnings) or "none",
        "against": against,
        "distance [mm]": 1e3 * float(np.linalg.norm(head.center - center)),
    }


def measure_persons() -> Iterator[Row]:
    """Find round surfaces of one person's bones on the other 25, from a similarity.

    Dense points are the truth.
    """
    femur = _person("femur", _average())
    pelvis = _person("pelvis", _average())
    head = _head(femur)
    yield _found_again("femur", "head", head)
    yield _found_again("femur", "condyles, one cylinder", _condyles(femur, head))
    for number, socket in enumerate(spherical_patches(pelvis, hollow=True)[:2], start=1):
        yield _found_again("pelvis", f"socket {number}", socket)


def _condyles(femur: mm.Surface, head: SphereFit) -> CylinderFit:
    """Fit a femur's condyle cylinder from the two largest round patches far from the head."""
    length = float(np.linalg.norm(np.ptp(femur.vertices, axis=0)))
    far = [
        one
        for one in spherical_patches(femur)
        if np.linalg.norm(one.center - head.center) > 0.6 * length
    ]
    one, other = sorted(far, key=lambda one: -one.radius)[:2]
    between = other.center - one.center
    radius = 0.5 * (one.radius + other.radius)
    width = float(np.linalg.norm(between)) + 2.0 * radius
    middle = 0.5 * (one.center + other.center)
    return articular_cylinder(femur, ExpectedCylinder(middle, between, radius, width=width))


def _found_again(bone: str, name: str, fit: SphereFit | CylinderFit) -> Row:
    source = _person(bone, _average())
    center = fit.center if isinstance(fit, SphereFit) else fit.point
    reach = 1.8 * fit.radius if isinstance(fit, SphereFit) else fit.length
    near = np.linalg.norm(source.vertices - center, axis=1) < reach
    mapped = []
    fitted = []
    turned = []
    refused = 0
    for k in _others():
        target = _person(bone, k)
        whole = procrustes(source.vertices, target.vertices, True)
        part = procrustes(source.vertices[near], target.vertices[near], True)
        start = whole.apply(center)
        mapped.append(float(np.linalg.norm(start - part.apply(center))))
        try:
            place, angle = _again(fit, target, start, whole, part)
        except mm.BadData:
            refused += 1
            continue
        fitted.append(place)
        turned.append(angle)
    return {
        "bone": bone,
        "surface": name,
        "persons": f"{len(fitted)} of {len(fitted) + refused}",
        "fitted, median [mm]": 1e3 * float(np.median(fitted)),
        "fitted, 95 % [mm]": 1e3 * float(np.percentile(fitted, 95)),
        "by the similarity alone, median [mm]": 1e3 * float(np.median(mapped)),
        "and 95 % [mm]": 1e3 * float(np.percentile(mapped, 95)),
        "axis turned, median [°]": float(np.median(turned)) if isinstance(fit, CylinderFit) else "",
    }


def _again(
    fit: SphereFit | CylinderFit,
    target: mm.Surface,
    start: np.ndarray,
    whole: Similarity,
    part: Similarity,
) -> tuple[float, float]:
    """Return how far the center (or the axis) lies from where it was carried, and its angle [°].

    The points around it carry it [m].
    """
    radius = whole.scale * fit.radius
    if isinstance(fit, SphereFit):
        sphere = articular_sphere(target, start, radius, fit.hollow)
        if warning := warning_of(sphere):
            raise mm.BadData(warning)
        return float(np.linalg.norm(sphere.center - part.apply(fit.center))), 0.0
    width = whole.scale * (fit.length + fit.radius)
    expected = ExpectedCylinder(start, whole.rotation @ fit.axis, radius, width=width)
    cylinder = articular_cylinder(target, expected)
    if warning := warning_of(cylinder):
        raise mm.BadData(warning)
    beside = np.cross(cylinder.point - part.apply(fit.point), cylinder.axis)
    cosine = min(1.0, abs(float(cylinder.axis @ part.rotation @ fit.axis)))
    return float(np.linalg.norm(beside)), float(np.degrees(np.arccos(cosine)))


def measure_landmarks() -> Iterator[Row]:
    """Landmarks found by rules on one person's bones and on those of some others."""
    others = _others()[::EVERY]
    for bone in ("femur", "tibia", "pelvis", "patella"):
        source = _person(bone, _average())
        errors: dict[str, list[float]] = defaultdict(list)
        refused = 0
        for k in others:
            target = _person(bone, k)
            try:
                found = automatic_landmarks(source, target)
            except mm.BadData:
                refused += 1
                continue
            truth = _carried(source, target, found.source)
            apart = 1e3 * np.linalg.norm(found.target - truth, axis=1)
            for name, one in zip(found.names, apart.tolist(), strict=True):
                errors[name].append(one)
        often = {
            name: apart
            for name, apart in errors.items()
            if len(apart) >= 0.5 * (len(others) - refused)
        }
        every = [one for apart in errors.values() for one in apart]
        yield {
            "bone": bone,
            "refused": f"{refused} of {len(others)}",
            "landmarks a person": len(every) / max(len(others) - refused, 1),
            "error, median [mm]": float(np.median(every)) if every else "",
            "95 % [mm]": float(np.percentile(every, 95)) if every else "",
            "worst [mm]": max(every) if every else "",
            "found in half of them or more (median [mm])": ", ".join(
                f"{name} ({np.median(apart):.1f})" for name, apart in often.items()
            ),
        }


def _carried(source: mm.Surface, target: mm.Surface, points: np.ndarray) -> np.ndarray:
    """Return where the vertices around points carry them.

    They are the nearest dozen, more for a point off the surface.
    """
    apart = np.abs(Shape(source).signed(points))
    carried = []
    for point, off in zip(points, apart, strict=True):
        distance = np.linalg.norm(source.vertices - point, axis=1)
        near = distance < max(1.6 * off, np.sort(distance)[11] + 1e-9)
        carried.append(procrustes(source.vertices[near], target.vertices[near], True).apply(point))
    return np.array(carried).reshape(-1, 3)


@cache
def _average() -> int:
    """Return the person whose bones are nearest to the mean of all."""
    away = sum(
        np.linalg.norm(one.nodes - one.nodes.mean(axis=0), axis=2).mean(axis=1)
        for one in leg_shapes().values()
    )
    return int(np.argmin(away))


def _others() -> list[int]:
    return [k for k in range(26) if k != _average()]


def _person(bone: str, k: int) -> mm.Surface:
    shape = leg_shapes()[bone]
    nodes = shape.nodes[0]
    faces = np.concatenate(
        [turned_outward(nodes, piece) for piece in pieces_of(len(nodes), shape.faces)]
    )
    return mm.Surface(shape.nodes[k], faces)


def _meters(path: Path) -> mm.Surface:
    surface = mm.read_mesh(path)
    return mm.Surface(1e-3 * surface.vertices, surface.faces)
