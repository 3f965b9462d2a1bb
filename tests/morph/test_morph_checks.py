"""Checks of a morph find what was made wrong, with its number.

They find nothing in a model that only grew.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from boxed_leg import FRONT, HALF, box, grown, leg, morph_of, muscle, with_muscle
from myomorph.bones.morph.checks.checks import check_morph, distinct_bones
from myomorph.bones.morph.checks.moment_arms import compare_moment_arms, compared_coordinates
from myomorph.bones.morph.checks.penetration import Penetration, Solid, bones_beside
from myomorph.bones.morph.checks.warnings import CheckOptions, bone_warnings, surface_warnings
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import AffineMap
from myomorph.lab.analyze.leg_model import leg_model


def through(depth: float):
    """Return an extensor that runs along the thigh under its front."""
    x = HALF - depth
    return muscle("extensor", [("thigh", (x, -0.05, 0.0)), ("thigh", (x, -0.3, 0.0)), *FRONT[1:]])


@pytest.mark.parametrize("size", [1.0, 0.9, 0.04])
def test_a_model_that_only_grew_has_no_warning(size):
    source = leg()
    checks = check_morph(morph_of(source, grown(source, size), size))
    assert checks.warnings == ()
    assert checks.notes == ()
    (arms,) = checks.arms
    np.testing.assert_allclose(arms.target, size * arms.source, rtol=1e-9)


def test_where_a_path_is_deepest_is_told_in_the_coordinate_s_unit():
    deep = [
        Penetration(
            muscle="biceps",
            body="femur",
            source=0.0,
            target=0.004,
            increase=0.004,
            coordinate=one,
            value=0.05,
            length=0.4,
        )
        for one in ("slide", "turn")
    ]
    slide, turn = bone_warnings(deep, 0.4, CheckOptions(), ("slide",))
    assert "at slide = 50.0 mm" in slide.text
    assert "at turn = 3°" in turn.text


@pytest.mark.parametrize("size", [1.0, 0.04])
def test_a_path_through_bone_is_found_with_its_depth(size):
    source = leg()
    morph = morph_of(source, grown(with_muscle(source, through(0.005)), size), size)
    checks = check_morph(morph)
    (worst,) = [
        one for one in checks.penetrations if (one.muscle, one.body) == ("extensor", "thigh")
    ]
    assert (worst.muscle, worst.source) == ("extensor", 0.0)
    assert worst.target == pytest.approx(0.005 * size, rel=1e-6)
    assert worst.increase == pytest.approx(worst.target)
    (warned,) = checks.of("bone")
    assert warned.place == "extensor"
    digits = 1 if size == 1.0 else 2
    assert f"{5.0 * size:.{digits}f} mm deep through thigh" in warned.text


def test_what_the_source_has_already_is_not_blamed_on_the_morph():
    source = with_muscle(leg(), through(0.005))
    checks = check_morph(morph_of(source, grown(source, 1.1), 1.1))
    (found,) = [
        one for one in checks.penetrations if (one.muscle, one.body) == ("extensor", "thigh")
    ]
    assert found.source == pytest.approx(0.005, rel=1e-6)
    assert found.target == pytest.approx(0.0055, rel=1e-6)
    assert found.increase == pytest.approx(0.0, abs=1e-9)
    assert checks.of("bone") == ()


def test_a_moment_arm_of_another_sign_is_found():
    source = leg()
    wrong = muscle("extensor", [(body, (-x, y, z)) for body, (x, y, z) in FRONT])
    checks = check_morph(morph_of(source, with_muscle(source, wrong)))
    (warned,) = checks.of("sign")
    assert warned.place == "extensor"
    assert "the other sign in 100 % of the range" in warned.text
    assert checks.of("arm") == ()


def test_a_moment_arm_beyond_what_bones_explain_is_found():
    source = leg()
    far = muscle("extensor", [(body, (3.0 * x, y, z)) for body, (x, y, z) in FRONT])
    (warned,) = check_morph(morph_of(source, with_muscle(source, far))).of("arm")
    ratio = float(warned.text.split(" times")[0].rsplit(" ", 1)[1])
    assert 2.0 < ratio <= 3.0


def test_a_jump_is_found_with_its_size():
    source = leg()
    points = list(source.muscle("extensor").path.points)
    points.insert(
        2,
        replace(
            points[2],
            name="patella",
            location=np.array([0.1, -0.02, 0.0]),
            coordinate="knee",
            range=(0.217, 9.0),
        ),
    )
    one = source.muscle("extensor")
    jumping = replace(one, path=replace(one.path, points=tuple(points)))
    target = with_muscle(source, jumping)
    morph = replace(morph_of(source, source), model=target)
    (warned,) = check_morph(morph).of("jump")
    table = compare_moment_arms(source, target, compared_coordinates(source, target), samples=31)[0]
    k = table.muscles.index("extensor")
    assert table.source_jumps[k] == 0.0
    assert table.target_jump_at[k] == pytest.approx(0.217, abs=1e-3)
    # Both sides of the jump, one ten-thousandth of a radian apart.
    fine = compare_moment_arms(source, target, compared_coordinates(source, target), samples=12001)[
        0
    ]
    assert table.target_jumps[k] == pytest.approx(
        np.abs(np.diff(fine.target[:, k])).max(), rel=1e-3
    )
    assert f"jumps by {1e3 * table.target_jumps[k]:.1f} mm" in warned.text


def test_space_that_folds_at_a_muscle_is_found():
    source = leg()
    morph = morph_of(source, source)
    turned = replace(morph.bones["shank"], map=AffineMap(np.diag([1.0, 1.0, -1.0]), np.zeros(3)))
    checks = check_morph(replace(morph, bones={**morph.bones, "shank": turned}))
    assert {owner for owner, _, _ in checks.folded} == {"extensor", "flexor"}
    assert {body for _, _, body in checks.folded} == {"shank"}
    assert len(checks.of("fold")) == 2


def test_attachments_fibers_and_joints_are_held_against_the_source():
    source = leg()
    morph = morph_of(source, source)
    off = replace(morph.points[0], depth_source=0.001, depth_target=0.006)
    near = replace(morph.points[1], depth_source=0.001, depth_target=-0.002)
    far = replace(morph.points[2], depth_source=0.05, depth_target=0.06)
    short = replace(morph.muscles[0], range_target=(0.35, 1.25))
    apart = replace(morph.joints[0], gap=0.005)
    morph = replace(
        morph, points=(off, near, far), muscles=(short, morph.muscles[1]), joints=(apart,)
    )
    checks = check_morph(morph)
    assert [one.kind for one in checks.warnings] == ["surface", "fiber", "joint"]
    assert (
        "extensor-P1 lies 6.0 mm outside the bone of thigh, source 1.0 mm"
        in checks.of("surface")[0].text
    )
    assert (
        "from 0.35 to 1.25 of their optimal length, source from 0.50 to 1.20"
        in checks.of("fiber")[0].text
    )
    assert "5.0 mm apart" in checks.of("joint")[0].text


@pytest.mark.parametrize(("off", "warned"), [(0.00202, True), (0.00198, False)])
@pytest.mark.parametrize("size", [1.0, 0.5])
def test_an_attachment_may_leave_its_surface_by_a_share_of_the_longest_bone(off, size, warned):
    """Half a percent of 0.4 m, both ways, after the source's depth has grown with the bone."""
    source = leg()
    morph = morph_of(source, grown(source, size), size)
    points = (
        replace(morph.points[0], depth_source=0.003, depth_target=0.003 * size + off),
        replace(morph.points[1], depth_source=-0.003, depth_target=-0.003 * size - off),
        replace(morph.points[2], depth_source=0.003, depth_target=0.003 * size - off),
    )
    found = list(
        surface_warnings(replace(morph, points=points), 0.4, CheckOptions(off_surface=0.005))
    )
    assert len(found) == (2 if warned else 0)


def test_other_coordinates_are_compared_as_a_table_pairs_them():
    source = leg()
    other = replace(
        source,
        coordinates=(replace(source.coordinates[0], name="flexion", range=(-0.4, 0.8)),),
        joints=(
            source.joints[0],
            replace(
                source.joints[1],
                coordinates=("flexion",),
                axes=(
                    replace(
                        source.joints[1].axes[0],
                        coordinates=("flexion",),
                        vector=np.array([0.0, 0.0, -1.0]),
                    ),
                ),
            ),
        ),
    )
    # The new coordinate grows the other way, so the same posture has the opposite value.
    morph = replace(morph_of(source, source), model=other)
    checks = check_morph(morph, coordinates={"knee": ("flexion", -1.0, 0.0)})
    (arms,) = checks.arms
    assert arms.source_values[[0, -1]] == pytest.approx([-0.1, 0.4])
    np.testing.assert_allclose(arms.target, arms.source, atol=1e-12)
    assert checks.warnings == ()
    with pytest.raises(UnknownName, match="hip"):
        check_morph(morph, coordinates={"knee": ("hip", 1.0, 0.0)})


def test_ranges_that_do_not_meet_are_compared_share_by_share():
    source = leg()
    shifted = replace(source, coordinates=(replace(source.coordinates[0], range=(1.0, 1.4)),))
    (pair,) = compared_coordinates(source, shifted)
    values, theirs = pair.values(source, shifted, 3)
    np.testing.assert_allclose(values, [-0.1, 0.25, 0.6])
    np.testing.assert_allclose(theirs, [1.0, 1.2, 1.4])


def test_depth_does_not_depend_on_how_the_surface_is_turned_or_where_it_is_open():
    points = np.random.default_rng(3).uniform(-1.0, 1.0, (400, 3)) * [0.03, 0.25, 0.03]
    whole = box(0.0)
    inside = np.abs(points) < [HALF, 0.2, HALF]
    true = np.where(
        inside.all(axis=1), (np.array([HALF, 0.2, HALF]) - np.abs(points)).min(axis=1), 0.0
    )
    flipped = Surface(whole.vertices, whole.faces[:, ::-1])
    mixed = Surface(
        whole.vertices,
        np.where(
            (np.arange(len(whole.faces)) % 3 == 0)[:, None], whole.faces[:, ::-1], whole.faces
        ),
    )
    for surface, turned in ((whole, 0.0), (flipped, 1.0), (mixed, 1.0 / 3.0)):
        solid = Solid(surface)
        assert solid.turned == pytest.approx(turned, abs=0.01)
        assert not solid.open
        np.testing.assert_allclose(solid.depths(points), true, atol=1e-9)
    cut = Surface(
        whole.vertices, whole.faces[whole.vertices[whole.faces].mean(axis=1)[:, 1] < 0.19]
    )
    assert Solid(cut).open
    with pytest.raises(BadData, match="no faces"):
        Solid(Surface(whole.vertices, np.zeros((0, 3), np.int64)))


def test_open_and_flipped_bones_are_named():
    source = leg()
    morph = morph_of(source, source)
    bone = morph.bones["thigh"]
    flipped = replace(bone, target=Surface(bone.target.vertices, bone.target.faces[:, ::-1]))
    checks = check_morph(replace(morph, bones={**morph.bones, "thigh": flipped}))
    assert checks.notes == ("thigh: the target's bone looks inward; its faces were turned outward",)
    none = replace(bone, source=None, target=None)
    checks = check_morph(replace(morph, bones={**morph.bones, "thigh": none}))
    assert checks.notes == (
        "paths are not checked against thigh: no bones of both source and target are known",
    )


def test_a_muscle_is_held_against_the_bones_beside_it():
    model = leg_model()
    assert bones_beside(model, model.muscle("vasmed_r")) == {"femur_r", "tibia_r", "patella_r"}
    assert bones_beside(model, model.muscle("recfem_r")) >= {"pelvis", "femur_r", "patella_r"}
    assert "femur_r" not in bones_beside(model, model.muscle("grac_l"))


def test_options_say_what_they_expect():
    with pytest.raises(BadData, match="more than 1"):
        CheckOptions(ratio=1.0)
    with pytest.raises(BadData, match="2 or more"):
        CheckOptions(poses=1)


def test_bodies_that_share_a_bone_are_looked_at_once():
    source = leg()
    morph = morph_of(source, source)
    thigh = morph.bones["thigh"]
    shank = morph.bones["shank"]
    again = replace(
        shank, source=Surface(thigh.source.vertices - [0.0, 0.1, 0.0], thigh.source.faces)
    )
    assert distinct_bones(replace(morph, bones={"thigh": thigh, "shank": again})) == (thigh, again)
    fused = replace(again, target_body="thigh")
    assert distinct_bones(replace(morph, bones={"thigh": thigh, "shank": fused})) == (thigh,)
