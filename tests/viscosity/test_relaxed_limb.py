"""A relaxed limb that is dropped: its equation of motion.

Also what is found of its joint, and what is named.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import myomorph as mm
from myomorph.core.model.errors import BadData, BadFile
from myomorph.lab.cli.program import main
from myomorph.swings.viscosity.relaxed.drops import activities, find_drops
from myomorph.swings.viscosity.relaxed.identify import (
    LimbBody,
    identify_limb,
    quantities,
)
from myomorph.swings.viscosity.relaxed.swing_equation import swing_equation
from myomorph.swings.viscosity.relaxed.swing_fit import fit_swings
from myomorph.swings.viscosity.study.limb_files import limb_body
from myomorph.swings.viscosity.study.limb_step import read_limb
from myomorph.swings.viscosity.study.plan import read_viscosity_plan
from myomorph.swings.viscosity.study.run import run_viscosity
from myomorph.swings.viscosity.study.template import study_template
from myomorph.swings.viscosity.trust.law import PassiveLaw
from truths.relaxed_limbs import HOLD, MUSCLE, RATE, RelaxedLeg, drop_leg, leg_model, write_leg

LEG = RelaxedLeg()
SPRUNG = ("viscosity", "stiffness")


def motion_of(angles, hips=None):
    time = np.arange(len(angles)) / RATE
    values = np.column_stack([np.zeros(len(angles)) if hips is None else hips, angles])
    return mm.differentiate(mm.Motion(time, ("hip", "knee"), values), 6.0)


def drops_of(leg, count=1, seed=0):
    found = []
    for number in range(count):
        angles = drop_leg(leg, number, seed).angles
        motion = motion_of(angles)
        equation = swing_equation(leg_model(leg), "knee", motion)
        found += find_drops(
            f"drop{number + 1}", equation, angles, motion.values[:, 1], motion.velocities[:, 1]
        )
    return found


def body_of(leg):
    return LimbBody(leg.mass, leg.distance, leg.inertia + leg.mass * leg.distance**2)


def test_the_equation_is_inverse_dynamics_of_the_coordinate_while_the_base_moves():
    time = np.arange(200) / RATE
    motion = motion_of(0.2 + np.sin(3.0 * time), 0.3 * np.sin(2.0 * time))
    equation = swing_equation(leg_model(LEG), "knee", motion)
    torque = equation.torque(
        *(values[:, 1] for values in (motion.values, motion.velocities, motion.accelerations))
    )
    np.testing.assert_allclose(
        torque, mm.inverse_dynamics(leg_model(LEG), motion)["knee"], atol=1e-5
    )


def test_a_swing_forward_is_that_of_mujoco():
    (drop,) = drops_of(LEG)
    law = PassiveLaw.of(
        np.array([LEG.damping, LEG.stiffness, LEG.stiffness * LEG.rest, *np.zeros(6)])
    )
    held = round(HOLD * RATE)
    swung = drop.equation.swing(held, len(drop.angles), drop.measured[held], 0.0, law)
    np.testing.assert_allclose(swung[:200], drop.measured[held : held + 200], atol=2e-3)


def test_a_limb_of_twice_the_mass_has_twice_the_torque():
    drops = drops_of(LEG)
    heavy = [replace(drop, equation=drop.equation.scaled(2.0, 2.0)) for drop in drops]
    once = quantities(fit_swings(drops, SPRUNG))
    twice = quantities(fit_swings(heavy, SPRUNG))
    for name in ("viscosity", "stiffness", "zero_torque"):
        assert twice[name] == pytest.approx(2.0 * once[name], rel=1e-3)
    assert twice["rest_angle"] == pytest.approx(once["rest_angle"], rel=1e-3)


def test_each_drop_of_a_recording_is_found_and_no_lift_by_hand():
    leg = replace(LEG, damping=0.4)
    first = drop_leg(leg, 0, 0).angles
    second = drop_leg(leg, 1, 0).angles
    lift = first[-1] + (second[0] - first[-1]) * 0.5 * (
        1.0 - np.cos(np.pi * np.linspace(0.0, 1.0, 120))
    )
    angles = np.concatenate([first, lift, second])
    motion = motion_of(angles)
    equation = swing_equation(leg_model(leg), "knee", motion)
    drops = find_drops("both", equation, angles, motion.values[:, 1], motion.velocities[:, 1])
    assert [drop.name for drop in drops] == ["both, drop 1", "both, drop 2"]
    released = [drop.equation.time[drop.turns[0]] for drop in drops]
    np.testing.assert_allclose(released, [HOLD, HOLD + (len(first) + len(lift)) / RATE], atol=0.1)
    values = quantities(fit_swings(drops, SPRUNG))
    assert values["viscosity"] == pytest.approx(leg.damping, rel=0.01)


def test_what_a_coordinate_moves_is_weighed():
    body = limb_body(leg_model(LEG), "knee", drops_of(LEG)[0].equation)
    whole = LEG.inertia + LEG.mass * LEG.distance**2
    np.testing.assert_allclose(
        (body.mass, body.distance, body.inertia), (LEG.mass, LEG.distance, whole), rtol=1e-3
    )


def test_dry_friction_is_chosen_where_there_is_some_and_only_there():
    leg = replace(LEG, friction=0.15)
    rough = identify_limb(drops_of(leg, 2), body_of(leg))
    smooth = identify_limb(drops_of(LEG, 2), body_of(LEG))
    assert rough.fit.terms == (*SPRUNG, "coulomb")
    assert rough.estimates["coulomb"].value == pytest.approx(0.15, rel=0.05)
    assert smooth.fit.terms == SPRUNG
    for result, truth in ((rough, leg.truth), (smooth, LEG.truth)):
        assert not result.missed
        assert all(result.estimates[name].holds(value) for name, value in truth.items())


def test_a_reflex_that_no_emg_shows_is_named_and_left_out():
    result = identify_limb(drops_of(replace(LEG, bursts=(1,)), 2), body_of(LEG))
    assert [(missed.drop, missed.half) for missed in result.missed] == [("drop2", 0)]
    assert np.rad2deg(result.missed[0].short) > 10.0
    assert result.estimates["viscosity"].value == pytest.approx(LEG.damping, rel=0.01)


def test_activity_is_what_rises_above_the_level_at_rest():
    dropped = drop_leg(replace(LEG, bursts=(0,)), 0, 0)
    (active,) = activities(dropped.emg, (), [(0.0, 0.9)])
    assert active.muscle == MUSCLE
    assert abs(active.start - dropped.burst[0]) < 0.1
    assert active.ratio > 5.0
    assert activities(drop_leg(LEG, 0, 0).emg, (MUSCLE,), [(0.0, 0.9)]) == ()
    with pytest.raises(BadData, match="'vastus': the recording has"):
        activities(dropped.emg, ("vastus",), [(0.0, 0.9)])
    with pytest.raises(BadData, match="record a second more"):
        activities(dropped.emg, (), [(0.0, 0.1)])


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    """Run a study of three drops from its files, with a reflex in the second that EMG shows."""
    folder = tmp_path_factory.mktemp("relaxed")
    write_leg(replace(LEG, bursts=(1,)), folder)
    (folder / "study.toml").write_text(
        '[study]\nname = "leg"\nsimulated = ["A leg in MuJoCo."]\n[[limb]]\nname = "p01"\nmodel ='
        ' "leg.osim"\ncoordinate = "knee"\ndrops = ["drop?.trc"]\ntruth = {viscosity = 0.2,'
        " stiffness = 2.0, rest_angle = 0.3}\n"
    )
    plan = read_viscosity_plan(folder / "study.toml")
    outcomes = run_viscosity(plan, folder / "out")
    assert [outcome.error for outcome in outcomes] == [""]
    return folder


def test_a_study_finds_the_truth_from_markers(studied):
    row = read_limb(studied / "out" / "p01").row
    assert row["viscosity"].value == pytest.approx(LEG.damping, rel=0.02)
    assert row["stiffness"].value == pytest.approx(LEG.stiffness, rel=0.02)
    assert all(row[name].holds(value) for name, value in LEG.truth.items())


def test_the_active_muscle_is_named_with_time_and_size(studied):
    notes = read_limb(studied / "out" / "p01").notes
    assert notes[0] == "the silence of muscles was judged by EMG"
    (named,) = [note for note in notes if MUSCLE in note]
    assert named.startswith("drop2: ")
    assert "times its level at rest" in named


def test_the_model_has_the_spring_and_the_damper(studied):
    row = read_limb(studied / "out" / "p01").row
    (torque,) = mm.read_model(studied / "out" / "p01" / "identified.osim").passive_torques
    assert torque.coordinate == "knee"
    at = np.array([0.0, 1.0])
    np.testing.assert_allclose(
        torque.torque(at), row["zero_torque"].value - row["stiffness"].value * at, rtol=1e-6
    )
    assert float(torque.damping(0.0)) == pytest.approx(row["viscosity"].value)


def test_the_page_and_the_table_hold_the_limb(studied):
    page = (studied / "out" / "report.html").read_text(encoding="utf-8")
    assert "Limb p01" in page
    head, rest = page.split("Relaxed limbs", 1)
    assert head.index("judged by EMG") < head.index("times its level at rest")
    assert "judged by EMG" not in rest
    assert "Tables I and II" not in page
    table = (studied / "out" / "limbs.csv").read_text().splitlines()
    assert table[1].startswith("p01,knee,viscosity,0.")


def test_a_mujoco_model_gets_damper_and_spring(studied):
    folder = studied / "mjcf"
    folder.mkdir()
    (folder / "leg.xml").write_text(replace(LEG, giving=1.0).mjcf(passive=False))
    for number in (0, 2):
        angles = drop_leg(LEG, number, 0).angles
        rows = "".join(f"{i / RATE}\t0\t{angle}\n" for i, angle in enumerate(angles))
        (folder / f"drop{number}.mot").write_text(
            f"drop\ninDegrees=no\nendheader\ntime\thip\tknee\n{rows}"
        )
    text = (
        (studied / "study.toml")
        .read_text()
        .replace("leg.osim", "leg.xml")
        .replace("drop?.trc", "drop?.mot")
    )
    (folder / "study.toml").write_text(text)
    assert main(["viscosity", str(folder / "study.toml"), "--out", str(folder / "out")]) == 0
    assert read_limb(folder / "out" / "p01").notes == (
        "no EMG was recorded: whether the muscles were silent is not known",
    )
    made = mujoco.MjModel.from_xml_path(str(folder / "out" / "p01" / "identified.xml"))
    knee = made.joint("knee")
    assert np.ravel(knee.damping)[0] == pytest.approx(LEG.damping, rel=0.02)
    assert np.ravel(knee.stiffness)[0] == pytest.approx(LEG.stiffness, rel=0.02)
    assert made.qpos_spring[made.jnt_qposadr[made.joint("knee").id]] == pytest.approx(
        LEG.rest, rel=0.02
    )


def test_what_is_wrong_with_a_limb_is_said_at_once(studied):
    path = studied / "wrong.toml"
    path.write_text(
        '[study]\nname = "leg"\n[[limb]]\nname = "p01"\nmodel = "arm.osim"\ncoordinate = "knee"\n'
        'drops = ["jump*.trc"]\n'
        "truth = {viscous = 1.0}\n"
    )
    with pytest.raises(BadFile) as caught:
        read_viscosity_plan(path)
    for part in (
        "'arm.osim' does not exist",
        "no file matches 'jump*.trc'",
        "unknown quantity 'viscous'",
    ):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"knee"', '"ankle"', "coordinate 'ankle'"),
        ('"drop?.trc"', '{recording = "drop1.trc", time = [0.0, 0.9]}', "holds no drop"),
        (
            'coordinate = "knee"',
            'coordinate = "knee"\nmuscles = ["vastus"]',
            "no EMG channel 'vastus'",
        ),
        ("[[limb]]", "[[limp]]", "'limb'"),
    ],
)
def test_bad_input_ends_with_status_2(studied, capsys, old, new, message):
    path = studied / "bad.toml"
    path.write_text((studied / "study.toml").read_text().replace(old, new))
    assert main(["viscosity", str(path), "--out", str(studied / "bad")]) == 2
    told = capsys.readouterr()
    assert message in told.err + told.out


def test_the_template_holds_a_limb(tmp_path):
    text = study_template()
    start = text.index("# [[limb]]")
    limb = [
        line.removeprefix("# ")
        for line in text[start : text.index("[options.", start)].splitlines()
    ]
    for name in ("p01.osim", "drop1.trc"):
        (tmp_path / name).write_text("")
    (tmp_path / "study.toml").write_text("\n".join(['[study]\nname = "x"', *limb]))
    (made,) = read_viscosity_plan(tmp_path / "study.toml").limbs
    assert (made.coordinate, made.muscles) == ("knee_angle_r", ("rectus_femoris",))
