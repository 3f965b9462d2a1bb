"""Markers of a scan on a model's bones.

A scanned arm of two bones is recovered with its markers where they were.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.model import Body, Joint, Mesh, Model
from myomorph.core.model.spatial import Transform, rotation_from_euler_xyz
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.clusters import (
    BoneScan,
    Picks,
    bone_surface,
    place_cluster_markers,
    place_scanned_bone,
)
from myomorph.core.surfaces.rigid_registration import SurfaceOptions
from scans import ScanQuality, made_scan, sharper

BONE = sharper(Surface(np.zeros((1, 3)), np.zeros((0, 3), dtype=np.int64)))
MARKERS = {
    "hum1": np.array([0.05, 0.06, 0.0]),
    "hum2": np.array([0.08, 0.06, 0.01]),
    "hum3": np.array([0.06, 0.09, 0.0]),
}
QUICK = SurfaceOptions(points=500, starts=4, mirror=False)
POSE = Transform.from_euler_xyz((0.2, 0.1, -0.3), (0.01, 0.02, 0.03))


def arm() -> Model:
    humerus = Body(
        name="humerus",
        mass=1.0,
        mass_center=np.zeros(3),
        inertia=np.eye(3) * 0.01,
        meshes=(Mesh("humerus.stl", POSE, np.full(3, 1.1)),),
    )
    joint = Joint(
        name="shoulder",
        kind="BallJoint",
        parent="ground",
        child="humerus",
        parent_frame=Transform.identity(),
        child_frame=Transform.identity(),
    )
    return Model(
        name="arm",
        bodies=(humerus,),
        joints=(joint,),
        coordinates=(),
        gravity=np.array([0.0, -9.81, 0.0]),
    )


def scanned(seed: int = 1, scale: float = 1.02):
    """Scan of the body's bone with three markers beside it, and the similarity that it hides."""
    surface = bone_surface(arm().body("humerus"), {"humerus.stl": BONE})
    scan, truth = made_scan(surface, seed=seed, scale=scale, quality=ScanQuality(refine=0))
    return (
        surface,
        scan,
        truth,
        {name: truth.inverse().apply(place) for name, place in MARKERS.items()},
    )


def test_a_bodys_meshes_lie_in_its_frame():
    surface = bone_surface(arm().body("humerus"), {"humerus.stl": BONE})
    np.testing.assert_allclose(surface.vertices, POSE.apply(1.1 * BONE.vertices))
    with pytest.raises(
        BadData, match=r"no bone mesh that can be read \(the model names humerus.stl\)"
    ):
        bone_surface(arm().body("humerus"), {})


def test_markers_come_to_lie_where_they_were():
    surface, scan, truth, markers = scanned()
    bone = place_scanned_bone("humerus", BoneScan(surface=scan, markers=markers), surface)
    assert bone.scale == pytest.approx(1.02, abs=2e-3)
    resized = place_cluster_markers(arm(), [bone])
    for name, place in MARKERS.items():
        np.testing.assert_allclose(resized.marker(name).location, place / 1.02, atol=3e-4)
    np.testing.assert_allclose(resized.body("humerus").meshes[0].scale, 1.1 / bone.scale, rtol=1e-9)
    assert truth.scale == pytest.approx(1.02)


def test_picked_points_start_the_fit_and_a_wrong_one_is_named_and_not_followed():
    surface, scan, truth, markers = scanned()
    points = surface.vertices[[0, 100, 250, 400, 600]]
    names = ("a", "b", "c", "d", "e")
    picks = Picks(names, truth.inverse().apply(points), points)
    good = place_scanned_bone("humerus", BoneScan(surface=scan, markers=markers), surface, picks)
    assert not good.notes
    wrong = np.array(picks.scanned)
    wrong[3] += 0.02
    bad = place_scanned_bone(
        "humerus", BoneScan(surface=scan, markers=markers), surface, Picks(names, wrong, points)
    )
    assert "picked point 'd' lies" in bad.notes[0]
    np.testing.assert_allclose(
        bad.fit.similarity.apply(scan.vertices), truth.apply(scan.vertices), atol=5e-4
    )


def test_picks_that_lead_elsewhere_are_noticed():
    """Points consistently picked end over end: the surfaces tell."""
    surface, scan, truth, markers = scanned()
    points = surface.vertices[[0, 100, 250, 400]]
    middle = surface.vertices.mean(axis=0)
    turned = (points - middle) @ rotation_from_euler_xyz((0.0, np.pi, 0.0)).T + middle
    found = place_scanned_bone(
        "humerus",
        BoneScan(surface=scan, markers=markers),
        surface,
        Picks(("a", "b", "c", "d"), truth.inverse().apply(turned), points),
    )
    assert any("from other starts" in line for line in found.notes)
    np.testing.assert_allclose(
        found.fit.similarity.apply(scan.vertices), truth.apply(scan.vertices), atol=5e-4
    )


def test_wrong_units_bones_and_far_markers_are_named():
    surface, scan, _, markers = scanned()
    moved = {"hum1": markers["hum1"] + 1.0}
    far = place_scanned_bone(
        "humerus", BoneScan(surface=scan, markers=moved), surface, options=QUICK
    )
    assert any("'hum1' lies" in line for line in far.notes)
    small = BoneScan(surface=Surface(0.5 * scan.vertices, scan.faces), markers={})
    assert any(
        "wrong unit" in line
        for line in place_scanned_bone("humerus", small, surface, options=QUICK).notes
    )


def test_bad_bones_are_refused():
    surface, scan, _, markers = scanned()
    bone = place_scanned_bone(
        "humerus", BoneScan(surface=scan, markers=markers), surface, options=QUICK
    )
    with pytest.raises(BadData, match="two scanned bones are for body 'humerus'"):
        place_cluster_markers(arm(), [bone, bone])
    other = replace(bone, body="ulna")
    with pytest.raises(UnknownName, match="unknown body 'ulna'"):
        place_cluster_markers(arm(), [bone, other])
