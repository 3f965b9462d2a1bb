"""A study file of swinging limbs is checked as a whole; forces are found by the stem."""

from __future__ import annotations

import pytest

from myomorph.core.model.errors import BadFile
from myomorph.swings.viscosity.study.plan import read_viscosity_plan

SMALLEST = """
[study]
name = "shoulder"
[[specimen]]
name = "01"
model = "arm.osim"
removed = ["bare*.trc"]
intact = ["full1.c3d"]
"""


@pytest.fixture
def folder(tmp_path):
    for name in (
        "arm.osim",
        "bare1.trc",
        "bare1.mot",
        "bare2.trc",
        "bare2_loads.mot",
        "full1.c3d",
        "lone.trc",
    ):
        (tmp_path / name).write_text("")
    return tmp_path


def plan_of(folder, text):
    path = folder / "shoulder.toml"
    path.write_text(text, encoding="utf-8")
    return read_viscosity_plan(path)


def problems_of(folder, text):
    with pytest.raises(BadFile) as caught:
        plan_of(folder, text)
    return str(caught.value)


def test_smallest_form(folder):
    plan = plan_of(folder, SMALLEST)
    (one,) = plan.specimens
    assert (plan.name, one.name, one.model, one.joint) == (
        "shoulder",
        "01",
        folder / "arm.osim",
        "ball",
    )
    assert [(swing.name, swing.loads.name) for swing in one.without] == [
        ("bare1", "bare1.mot"),
        ("bare2", "bare2_loads.mot"),
    ]
    assert one.intact[0].loads == one.intact[0].markers == folder / "full1.c3d"
    assert any("bare2_loads.mot" in remark for remark in plan.remarks)


def test_whole_form(folder):
    text = SMALLEST.replace(
        '["bare*.trc"]', '[{markers = "lone.trc", loads = "bare1.mot", time = [1, 3], name = "a"}]'
    )
    text = text.replace('name = "shoulder"', 'name = "shoulder"\nsimulated = ["made"]')
    text += """measured_muscle_mass = 0.765
base = "blade"
first_body = "arm"
bones = ["ulna"]
muscles = {biceps = ["BIClong", "BICshort"]}
tare = "bare2_loads.mot"
truth = {joint_viscosity = 0.0761}
[options.identification]
draws = 20
"""
    plan = plan_of(folder, text)
    (one,) = plan.specimens
    assert one.without[0].time == (1.0, 3.0)
    assert (one.base, one.first, one.bones, one.measured_muscle_mass) == (
        "blade",
        "arm",
        ("ulna",),
        0.765,
    )
    assert one.muscles == {"biceps": ("BIClong", "BICshort")}
    assert one.tare == folder / "bare2_loads.mot"
    assert one.truth == {"joint_viscosity": 0.0761}
    assert plan.settings == {"identification": {"draws": 20}}
    assert plan.simulated == ("made",)


def test_everything_wrong_is_told_at_once(folder):
    text = SMALLEST.replace("arm.osim", "harm.osim").replace(
        '"bare*.trc"', '"lone.trc", "bare1.trc", "bare1.trc"'
    )
    text = text.replace("full1.c3d", "full2.c3d") + "truth = {viscosity = 1.0}\n[[specimen]]\n"
    text += 'name = "01"\nmodel = "arm.osim"\n'
    told = problems_of(folder, text)
    for words in (
        "7 problems",
        "'harm.osim' does not exist",
        "no forces belong to lone.trc",
        "two recordings are named 'bare1'",
        "'full2.c3d' does not exist",
        "unknown quantity 'viscosity'",
        "'joint_viscosity'",
        "has no recordings",
        "two specimens or limbs are named '01'",
    ):
        assert words in told


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("removed =", "remvoed =", "unknown key 'specimen.1.remvoed': there are 'removed'"),
        ("intact =", "muscle =", "unknown key 'specimen.1.muscle': there are 'muscles'"),
        ('name = "shoulder"', 'nam = "shoulder"', "'study.name' is missing"),
        (
            '["bare*.trc"]',
            '[{marker = "bare1.trc"}]',
            "unknown key 'specimen.1.removed.1.marker': there are 'markers'",
        ),
        ('["bare*.trc"]', '["bare1.trc"]\nmeasured_muscle_mass = -1', "greater than 0"),
        ('["bare*.trc"]', '["bare1.trc"]\ntime = [3, 1]', "expected a start before an end"),
        (
            "[study]",
            "[options.identification]\ndraw = 1\n[study]",
            "'options.identification.draw': there are 'draws'",
        ),
    ],
)
def test_each_mistake_is_named(folder, old, new, told):
    assert told in problems_of(folder, SMALLEST.replace(old, new, 1))


def test_a_study_of_subjects_is_another_command(folder):
    told = problems_of(folder, SMALLEST.replace("[[specimen]]", "[[subject]]"))
    assert "myomorph run" in told


def test_one_condition_alone_is_remarked(folder):
    plan = plan_of(folder, SMALLEST.replace('intact = ["full1.c3d"]\n', ""))
    assert any("no recordings of muscles intact" in remark for remark in plan.remarks)


def test_plate_and_ct(folder):
    for name in ("weight1.c3d", "weight2.c3d", "humerus.stl", "cluster.stl"):
        (folder / name).write_text("")
    plan = plan_of(
        folder,
        SMALLEST
        + """up = "z"
plate = {placements = ["weight*.c3d"], markers = ["w1", "w2", "w3"], mass = 10.0, name = "FP1"}
[[specimen.ct]]
bone = "humerus_r"
surface = "humerus.stl"
cluster = "cluster.stl"
markers = ["h1", "h2", "h3"]
unit = "mm"
""",
    )
    (one,) = plan.specimens
    assert one.up == "z"
    assert [path.name for path in one.plate.placements] == ["weight1.c3d", "weight2.c3d"]
    assert (one.plate.weight.markers, one.plate.weight.mass, one.plate.plate) == (
        ("w1", "w2", "w3"),
        10.0,
        "FP1",
    )
    (scan,) = one.ct
    assert (scan.bone, scan.surface, scan.markers) == (
        "humerus_r",
        folder / "humerus.stl",
        ("h1", "h2", "h3"),
    )


def test_what_is_wrong_with_plate_and_ct_is_told(folder):
    told = problems_of(
        folder,
        SMALLEST
        + """plate = {placements = ["bare1.trc"], markers = ["w1"], shares = [0.5]}
ct = [{bone = "humerus_r", surface = "humerus.stl", cluster = "bare1.trc", markers = ["h1"]}]
""",
    )
    for words in (
        "'bare1.trc' is no C3D recording",
        "1 shares",
        "'humerus.stl' does not exist",
        "a cluster needs three",
    ):
        assert words in told
    told = problems_of(folder, SMALLEST + 'plate = {placements = ["full1.c3d"], marker = ["w1"]}\n')
    assert "unknown key 'specimen.1.plate.marker': there are 'markers'" in told
