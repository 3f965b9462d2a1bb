"""Landmarks by rule and maps between species.

They rotate with the bone, and a bone enlarged is found enlarged.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.bones.morph.checks.moment_arms import CoordinatePair
from myomorph.bones.morph.maps.fields import MapOptions, PlacedMap
from myomorph.bones.morph.morphed import MorphOptions
from myomorph.bones.morph.species.counterparts import (
    AnatomicalFrame,
    BoneHomology,
    LandmarkRule,
    Skeleton,
    SpeciesTable,
)
from myomorph.bones.morph.species.landmarks import MarkedBone, landmarks_by_rules, section
from myomorph.bones.morph.species.maps import (
    SpeciesOptions,
    coordinate_table,
    species_bones,
    species_morph,
)
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.functions import linear
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.spatial import Transform, axis_rotation
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import AffineMap

UPRIGHT = AnatomicalFrame(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
ON_FOURS = AnatomicalFrame(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]))
TURN = ON_FOURS.axes.T @ UPRIGHT.axes
"""From the axes of a body of the one to those of the other."""
SMALL = 0.05
RULES = (
    LandmarkRule("joint", "joint", source_joint="shank", target_joint="leg"),
    LandmarkRule("top", "farthest", {"proximal": 1.0, "anterior": 0.2}),
    LandmarkRule("toe", "farthest", {"anterior": 1.0}, within={"proximal": (0.0, 0.3)}),
    LandmarkRule("shaft", "section", at=(0.3, 0.6), around=4),
)


def bone(length: float = 0.4) -> Surface:
    """Make a club with a foot in front: it has no symmetry."""
    rings = 24
    around = 16
    height = np.linspace(-length, 0.0, rings)[:, None]
    angle = 2.0 * np.pi * np.arange(around) / around
    thick = (
        0.03
        + 0.02 * (height / length) ** 2
        + 0.02 * np.exp(-((height + 0.9 * length) ** 2) / 0.002)
    )
    x = thick * (1.0 + 0.4 * np.cos(angle)) * np.cos(angle)
    z = 0.7 * thick * np.sin(angle) + 0.05 * (height / length) ** 2
    vertices = np.stack([x, np.broadcast_to(height, x.shape), z], axis=2).reshape(-1, 3)
    faces = []
    for i in range(rings - 1):
        for j in range(around):
            a = i * around + j
            b = i * around + (j + 1) % around
            faces += [[a, a + around, b], [b, a + around, b + around]]
    ends = [len(vertices), len(vertices) + 1]
    vertices = np.vstack(
        [vertices, vertices[:around].mean(axis=0), vertices[-around:].mean(axis=0)]
    )
    last = (rings - 1) * around
    for j in range(around):
        k = (j + 1) % around
        faces += [[ends[0], j, k], [ends[1], last + k, last + j]]
    return Surface(vertices, np.array(faces))


def _limb(names: tuple[str, str, str], axes: np.ndarray, size: float, muscles: bool) -> Model:
    """Two bones that hang from each other."""
    bodies = tuple(
        Body(name=name, mass=size**3, mass_center=np.zeros(3), inertia=1e-3 * size**5 * np.eye(3))
        for name in names[:2]
    )
    side = axes @ [0.0, 0.0, 1.0]
    joints = tuple(
        Joint(
            name=f"joint_{child}",
            kind="PinJoint",
            parent=parent,
            child=child,
            parent_frame=Transform(np.eye(3), size * axes @ place),
            child_frame=Transform.identity(),
            axes=(
                Axis(kind="rotation", vector=side, function=linear(1.0), coordinates=(coordinate,)),
            ),
            coordinates=(coordinate,),
        )
        for parent, child, place, coordinate in (
            ("ground", names[0], np.zeros(3), f"{names[2]}_hip"),
            (names[0], names[1], np.array([0.0, -0.4, 0.0]), f"{names[2]}_knee"),
        )
    )
    points = [
        (names[0], [0.04, -0.1, 0.01]),
        (names[0], [0.05, -0.35, 0.0]),
        (names[1], [0.04, -0.08, 0.0]),
    ]
    path = Path(
        tuple(PathPoint(f"P{i}", body, axes @ place) for i, (body, place) in enumerate(points))
    )
    return Model(
        name=names[2],
        bodies=bodies,
        joints=joints,
        coordinates=tuple(
            Coordinate(one, range=(-1.0, 1.0)) for joint in joints for one in joint.coordinates
        ),
        gravity=axes @ [0.0, -9.8, 0.0],
        muscles=(
            Muscle(
                name="front",
                kind="Millard2012EquilibriumMuscle",
                path=path,
                max_isometric_force=500.0,
                optimal_fiber_length=0.08,
                tendon_slack_length=0.25,
            ),
        )
        if muscles
        else (),
    )


def table(match: str = "landmarks") -> SpeciesTable:
    """Upright limb and small limb on all fours."""
    bones = tuple(
        BoneHomology(
            (ours,),
            (theirs,),
            (replace(RULES[0], source_joint=ours, target_joint=theirs), *RULES[1:]),
            match=match,  # type: ignore[arg-type]
        )
        for ours, theirs in (("thigh", "upper"), ("shank", "leg"))
    )
    pairs = (CoordinatePair("man_hip", "mouse_hip"), CoordinatePair("man_knee", "mouse_knee"))
    return SpeciesTable(
        name="test", source_frame=UPRIGHT, target_frame=ON_FOURS, bones=bones, coordinates=pairs
    )


def both() -> tuple[Model, dict[str, Surface], Model, dict[str, Surface]]:
    """Make the same limb twice: standing and large, on all fours and small."""
    shape = bone()
    small = Surface(SMALL * shape.vertices @ TURN.T, shape.faces)
    return (
        _limb(("thigh", "shank", "man"), np.eye(3), 1.0, True),
        {"thigh": shape, "shank": shape},
        _limb(("upper", "leg", "mouse"), TURN, SMALL, False),
        {"upper": small, "leg": small},
    )


def test_landmarks_turn_and_grow_with_the_bone():
    shape = bone()
    joints = {"shank": np.zeros(3), "leg": np.zeros(3)}
    ours, lost = landmarks_by_rules(
        RULES, MarkedBone(surface=shape, frame=UPRIGHT, joints=joints, of_source=True)
    )
    small = Surface(SMALL * shape.vertices @ TURN.T, shape.faces)
    theirs, _ = landmarks_by_rules(
        RULES, MarkedBone(surface=small, frame=ON_FOURS, joints=joints, of_source=False)
    )
    assert lost == ()
    assert set(ours) == set(theirs) >= {"top", "toe", "shaft 0.3 at 0", "shaft 0.6 at 270"}
    for name, place in ours.items():
        assert theirs[name] == pytest.approx(SMALL * TURN @ place, abs=1e-9), name


def test_a_cut_lies_in_its_plane_on_the_surface():
    tetrahedron = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 1.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    ends = section(tetrahedron, faces, 0.25).reshape(-1, 2)
    assert {tuple(np.round(one, 12)) for one in ends} == {(0.0, 0.0), (0.25, 0.0), (0.0, 0.25)}


@pytest.mark.parametrize("kind", ["ssd", "rbf", "affine"])
def test_a_smaller_limb_gets_smaller_muscles_at_the_same_places(kind):
    source, ours, target, theirs = both()
    morph = species_morph(
        Skeleton(source, ours),
        Skeleton(target, theirs),
        table(),
        SpeciesOptions(morph=MorphOptions(), map=MapOptions(kind)),
    )
    (muscle,) = morph.model.muscles
    for before, after in zip(source.muscle("front").path.points, muscle.path.points, strict=True):
        assert after.location == pytest.approx(SMALL * TURN @ before.location, abs=1e-6 * SMALL)
    assert [one.body for one in muscle.path.points] == ["upper", "upper", "leg"]
    assert muscle.optimal_fiber_length == pytest.approx(SMALL * 0.08, rel=1e-4)
    assert muscle.max_isometric_force == pytest.approx(SMALL**2 * 500.0, rel=1e-4)


def test_coordinates_that_one_model_lacks_are_left_out():
    source, _, target, _ = both()
    assert set(coordinate_table(table(), source, target)) == {"man_hip", "man_knee"}
    fewer = replace(
        table(), coordinates=(*table().coordinates, CoordinatePair("toe", "mouse_knee"))
    )
    assert set(coordinate_table(fewer, source, target)) == {"man_hip", "man_knee"}


def test_a_posture_brings_a_riding_bone_along():
    source, ours, target, theirs = both()
    bones = (replace(table().bones[0], transferred=("shank",)),)
    bent = replace(table(), bones=bones, posture={"man_knee": 0.5 * np.pi})
    found = species_bones(Skeleton(source, ours), Skeleton(target, theirs), bent).bones
    place = np.array([0.02, -0.1, 0.03])
    on_thigh = axis_rotation([0.0, 0.0, 1.0], 0.5 * np.pi) @ place + [0.0, -0.4, 0.0]
    assert found["shank"].target_body == "upper"
    assert found["shank"].map.apply(place) == pytest.approx(
        SMALL * TURN @ on_thigh, abs=1e-6 * SMALL
    )


def test_muscle_points_go_to_the_nearest_of_several_bones():
    source, ours, target, theirs = both()
    whole = Surface(
        np.vstack([ours["thigh"].vertices, ours["shank"].vertices - [0.0, 0.4, 0.0]]),
        np.vstack([ours["thigh"].faces, ours["shank"].faces + len(ours["thigh"].vertices)]),
    )
    one = replace(table().bones[0], targets=("upper", "leg"), spread=True)
    fused = replace(
        source,
        muscles=tuple(
            replace(
                m,
                path=replace(
                    m.path, points=(*m.path.points[:2], PathPoint("P2", "thigh", [0.04, -0.6, 0.0]))
                ),
            )
            for m in source.muscles
        ),
    )
    found = species_bones(
        Skeleton(fused, {"thigh": whole}),
        Skeleton(target, theirs),
        replace(table(), bones=(one,)),
    )
    points = found.source.muscle("front").path.points
    assert [one.body for one in points] == ["thigh", "thigh", "thigh@leg"]
    below = found.bones["thigh@leg"]
    assert below.map.apply(points[2].location) == pytest.approx(
        SMALL * TURN @ [0.04, -0.2, 0.0], abs=1e-6 * SMALL
    )


def test_landmarks_that_contradict_each_other_are_left_out():
    source, ours, target, theirs = both()
    twice = LandmarkRule(
        "again",
        "farthest",
        {"anterior": 1.0},
        source_within={"proximal": (0.0, 0.3)},
        target_within={"right": (0.9, 1.0)},
    )
    torn = replace(table().bones[0], landmarks=(*table().bones[0].landmarks, twice))
    found = species_bones(
        Skeleton(source, ours), Skeleton(target, theirs), replace(table(), bones=(torn,))
    )
    assert any("again" in note for note in found.notes)
    assert "again" not in found.bones["thigh"].features.names


def test_jacobian_of_a_placed_map():
    random = np.random.default_rng(3)
    inner = AffineMap(np.eye(3) + 0.2 * random.normal(size=(3, 3)), random.normal(size=3))
    pose = AffineMap(axis_rotation([0.3, 0.5, 0.8], 0.7), random.normal(size=3))
    placed = PlacedMap(pose, inner, AffineMap(random.normal(size=(3, 3)), random.normal(size=3)))
    place = random.normal(size=3)
    step = 1e-6
    columns = [
        (placed.apply(place + step * one) - placed.apply(place - step * one)) / (2 * step)
        for one in np.eye(3)
    ]
    assert placed.jacobian(place) == pytest.approx(np.stack(columns, axis=1), abs=1e-8)


def test_what_cannot_be_is_named():
    source, ours, target, theirs = both()
    with pytest.raises(BadData, match="mirrored"):
        AnatomicalFrame(np.eye(3))
    with pytest.raises(BadData, match="needs toward"):
        LandmarkRule("nowhere", "farthest")
    with pytest.raises(BadData, match="becomes two bones"):
        replace(table(), bones=table().bones[:1] * 2)
    with pytest.raises(BadData, match="no surface of shank"):
        species_bones(Skeleton(source, {"thigh": ours["thigh"]}), Skeleton(target, theirs), table())
    with pytest.raises(UnknownName, match="ankle"):
        species_bones(
            Skeleton(source, ours),
            Skeleton(target, theirs),
            replace(table(), posture={"ankle": 0.1}),
        )
    with pytest.raises(BadData, match="no pair of its bodies"):
        species_morph(Skeleton(target, theirs), Skeleton(target, theirs), table())
    few = replace(
        table(), bones=(replace(table().bones[0], landmarks=table().bones[0].landmarks[:2]),)
    )
    with pytest.raises(BadData, match="expected four or more"):
        species_bones(Skeleton(source, ours), Skeleton(target, theirs), few)
