"""OpenSim's setup files, run to the files they ask for."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.exchange.opensim.bodies import FIBERS
from myomorph.exchange.opensim.outputs import write_outputs
from myomorph.exchange.opensim.run import run_tool
from myomorph.exchange.opensim.states import stepped
from myomorph.lab.cli.program import main
from myomorph.show.demo.arm import example_files

ANALYZE = """<OpenSimDocument Version="40000"><AnalyzeTool name="arm">\
<model_file>arm26.osim</model_file>
<results_directory>Results</results_directory><initial_time>0.25</initial_time><final_time>0.3</final_time>
<AnalysisSet><objects>{analyses}</objects></AnalysisSet>
<coordinates_file>arm26_InverseKinematics.mot</coordinates_file>
<lowpass_cutoff_frequency_for_coordinates>6</lowpass_cutoff_frequency_for_coordinates></AnalyzeTool></OpenSimDocument>"""


@pytest.fixture
def arm(data, tmp_path):
    """Return a folder with a small arm, and a function that writes its setup."""
    for name in ("arm26.osim", "arm26_InverseKinematics.mot"):
        shutil.copy(data(f"opensim-reference-small/{name}"), tmp_path)

    def setup(analyses):
        path = tmp_path / "setup.xml"
        path.write_text(ANALYZE.format(analyses=analyses))
        return path

    return setup


@pytest.fixture
def scale_folder(data, tmp_path):
    for name in (
        "subject01_Setup_Scale.xml",
        "gait2354_simbody.osim",
        "gait2354_Scale_MarkerSet.xml",
    ):
        shutil.copy(data(f"opensim-gait-subject01/ref_scale/{name}"), tmp_path)
    shutil.copy(data("opensim-gait-subject01/experiment/subject01_static.trc"), tmp_path)
    return tmp_path


def test_scale_tool_makes_the_expected_model(data, scale_folder):
    """OpenSim's own expected result.

    Sizes and masses agree to its printed digits, markers as far as its pose is off.
    """
    result = run_tool(scale_folder / "subject01_Setup_Scale.xml")
    assert {path.name for path in result.written} == {
        "subject01_scaledOnly.osim",
        "subject01_scaleSet_applied.xml",
        "subject01_simbody.osim",
        "subject01_static_output.mot",
    }
    ours = read_model(scale_folder / "subject01_simbody.osim")
    std = read_model(data("opensim-gait-subject01/ref_scale/std_subject01_simbody.osim"))
    assert ours.mass == pytest.approx(72.6, abs=1e-12)
    for one, other in zip(ours.bodies, std.bodies, strict=True):
        assert one.mass == pytest.approx(other.mass, abs=1e-10)
        np.testing.assert_allclose(one.mass_center, other.mass_center, atol=1e-6)
        np.testing.assert_allclose(one.inertia, other.inertia, rtol=1e-10, atol=1e-12)
    places = {joint.child: joint.parent_frame.translation for joint in std.joints}
    for joint in ours.joints:
        np.testing.assert_allclose(joint.parent_frame.translation, places[joint.child], atol=1e-12)
    for muscle in ours.muscles:
        other = std.muscle(muscle.name)
        assert muscle.optimal_fiber_length == pytest.approx(other.optimal_fiber_length, abs=1e-10)
        assert muscle.tendon_slack_length == pytest.approx(other.tendon_slack_length, abs=1e-10)
    assert set(ours.marker_names) == set(std.marker_names)
    apart = [np.linalg.norm(one.location - std.marker(one.name).location) for one in ours.markers]
    assert np.median(apart) < 5e-4
    assert max(apart) < 0.011
    pose = motion_from_table(read_sto(scale_folder / "subject01_static_output.mot"), ours)
    assert pose["pelvis_ty"] == pytest.approx(1.0353, abs=1e-3)


def test_nothing_is_overwritten_that_was_read(scale_folder):
    path = scale_folder / "subject01_Setup_Scale.xml"
    path.write_text(
        path.read_text().replace("subject01_scaledOnly.osim", "./gait2354_simbody.osim")
    )
    before = sorted(one.name for one in scale_folder.iterdir())
    with pytest.raises(
        BadFile, match=r"gait2354_simbody\.osim: is both read and written by this setup"
    ):
        run_tool(path)
    path.write_text(
        path.read_text().replace("./gait2354_simbody.osim", "subject01_scaleSet_applied.xml")
    )
    with pytest.raises(BadFile, match="is the name of two results"):
        run_tool(path)
    assert sorted(one.name for one in scale_folder.iterdir()) == before


def test_both_steps_may_write_one_model(scale_folder):
    """The placer's model stays, as in OpenSim."""
    path = scale_folder / "subject01_Setup_Scale.xml"
    run_tool(path)
    placed = read_model(scale_folder / "subject01_simbody.osim")
    path.write_text(path.read_text().replace("subject01_scaledOnly.osim", "subject01_simbody.osim"))
    result = run_tool(path)
    assert sum(one.name == "subject01_simbody.osim" for one in result.written) == 1
    again = read_model(scale_folder / "subject01_simbody.osim")
    for one in placed.markers:
        np.testing.assert_allclose(again.marker(one.name).location, one.location, atol=1e-12)


def test_a_failure_while_writing_leaves_nothing(tmp_path):
    def broken(path):
        path.write_text("half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_outputs(
            {tmp_path / "a.sto": lambda path: path.write_text("whole"), tmp_path / "b.sto": broken}
        )
    assert list(tmp_path.iterdir()) == []


def test_inverse_kinematics_of_a_closed_loop(data, tmp_path):
    """OpenSim's setup of the bone pins.

    The stored result, solved to 1e-6, is up to 0.9 degrees off the minimum.
    """
    folder = tmp_path / "ik"
    shutil.copytree(data("shoulder-bonepin"), folder)
    path = folder / "setup_ik_abdbonepin.xml"
    path.chmod(0o644)
    folder.chmod(0o755)
    path.write_text(path.read_text().replace("<time_range> 0.0 19.0<", "<time_range> 0.0 1.0<"))
    result = run_tool(path)
    assert "loops closed to" in result.lines[0]
    ours = read_sto(folder / "subject1_abdbonepin_IK.mot")
    stored = read_sto(folder / "std_subject1_abdbonepin_IK.mot")
    assert len(ours) == 101
    for name in stored.names:
        np.testing.assert_allclose(ours[name], stored[name][:101], atol=1.0, err_msg=name)


def test_inverse_kinematics_of_simulated_markers(data, tmp_path):
    folder = tmp_path / "ik"
    shutil.copytree(data("opensim-gait-subject01/ref_ik"), folder)
    path = folder / "subject01_Setup_InverseKinematics.xml"
    path.chmod(0o644)
    path.write_text(path.read_text().replace("1.6 </time", "0.6 </time"))
    result = run_tool(path)
    assert "<InverseKinemtaticsTool> was taken for <InverseKinematicsTool>" in result.warnings
    assert [one.name for one in result.written] == [
        "subject01_walk1_ik_test.mot",
        "subject01_ik_model_marker_locations.sto",
    ]
    ours = read_sto(result.written[0])
    std = read_sto(folder / "std_subject01_walk1_ik.mot")
    assert len(ours) == 13
    for name in std.names:
        np.testing.assert_allclose(ours[name], std[name][:13], atol=0.05, err_msg=name)
    assert any("constraint_weight is 10" in one for one in result.warnings)


def test_markers_and_forces_are_checked_and_nothing_is_repaired(data, tmp_path):
    """Exchanged labels and forces on the wrong feet are reported; numbers stay OpenSim's."""
    for name in ("ref_ik", "ref_id"):
        shutil.copytree(data(f"opensim-gait-subject01/{name}"), tmp_path / name)
        for path in (tmp_path / name, *(tmp_path / name).rglob("*")):
            path.chmod(0o755)
    markers = next((tmp_path / "ref_ik").glob("*.trc"))
    text = (
        markers.read_text().replace("R.Thigh.Upper", "#").replace("R.Shank.Upper", "R.Thigh.Upper")
    )
    markers.write_text(text.replace("#", "R.Shank.Upper"))
    result = run_tool(tmp_path / "ref_ik" / "subject01_Setup_InverseKinematics.xml")
    assert "'R.Thigh.Upper'" in result.warnings[0]
    assert "are exchanged" in result.warnings[0]
    assert "repaired" not in result.warnings[0]
    assert "over 2 and 4 cm" in result.lines[0]

    loads = next(
        one for one in (tmp_path / "ref_id").glob("*.xml") if "<ExternalForce " in one.read_text()
    )
    good = run_tool(tmp_path / "ref_id" / "subject01_Setup_InverseDynamics.xml")
    assert "largest residual force" in good.lines[0]
    text = (
        loads.read_text()
        .replace("calcn_r", "#")
        .replace("calcn_l", "calcn_r")
        .replace("#", "calcn_l")
    )
    loads.write_text(text)
    wrong = run_tool(tmp_path / "ref_id" / "subject01_Setup_InverseDynamics.xml")
    assert "foot" in wrong.warnings[0]
    assert not any("foot" in one for one in good.warnings)


def test_inverse_dynamics_is_opensims(data, tmp_path, monkeypatch):
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    mine = tmp_path / "mine"
    other = tmp_path / "other"
    for folder in (mine, other):
        shutil.copytree(data("opensim-gait-subject01/ref_id"), folder)
    result = run_tool(mine / "subject01_Setup_InverseDynamics.xml")
    monkeypatch.chdir(other)
    opensim.InverseDynamicsTool("subject01_Setup_InverseDynamics.xml").run()
    ours = read_sto(result.written[0])
    theirs = read_sto(other / "Results" / "subject01_InverseDynamics.sto")
    assert result.written[0] == mine / "Results" / "subject01_InverseDynamics.sto"
    assert set(ours.names) == set(theirs.names)
    for name in theirs.names:
        np.testing.assert_allclose(ours[name], theirs[name], atol=0.01, err_msg=name)


def test_passive_forces_are_taken_off_unless_excluded(data, tmp_path, monkeypatch):
    """The ankle spring of this model moves it too, so its torque is not the ankle's."""
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    folder = "opensim-gait-subject01/ref_so_10dof18musc"
    for name in ("subject01_adjusted_spring.osim", "walk_subject01_Kinematics_q.sto"):
        shutil.copy(data(f"{folder}/{name}"), tmp_path)
    text = """<OpenSimDocument Version="40000"><InverseDynamicsTool name="walk">
    <results_directory>{out}</results_directory>
    <model_file>subject01_adjusted_spring.osim</model_file><time_range>2.48 2.5</time_range>
    <forces_to_exclude>{excluded}</forces_to_exclude><coordinates_file>walk_subject01_Kinematics_q.sto</coordinates_file>
    <output_gen_force_file>id.sto</output_gen_force_file></InverseDynamicsTool></OpenSimDocument>"""
    tables = {}
    monkeypatch.chdir(tmp_path)
    for excluded in ("Muscles", "ALL"):
        path = tmp_path / f"{excluded}.xml"
        path.write_text(text.format(out=f"ours_{excluded}", excluded=excluded))
        tables[excluded] = read_sto(run_tool(path).written[0])
        path.write_text(text.format(out=f"theirs_{excluded}", excluded=excluded))
        opensim.InverseDynamicsTool(path.name).run()
        theirs = read_sto(tmp_path / f"theirs_{excluded}" / "id.sto")
        for name in theirs.names:
            np.testing.assert_allclose(
                tables[excluded][name], theirs[name], atol=0.02, err_msg=f"{excluded} {name}"
            )
    assert (
        np.abs(
            tables["ALL"]["ankle_angle_r_moment"] - tables["Muscles"]["ankle_angle_r_moment"]
        ).max()
        > 0.5
    )


def test_muscle_analysis_writes_what_it_names(arm, tmp_path):
    analysis = (
        '<MuscleAnalysis name="MuscleAnalysis"><on>true</on><step_interval>2</step_interval>'
        "<muscle_list>BRA TRIlong</muscle_list>"
        "<moment_arm_coordinate_list>r_elbow_flex</moment_arm_coordinate_list>"
        "<compute_moments>true</compute_moments></MuscleAnalysis><ProbeReporter/>"
    )
    result = run_tool(arm(analysis))
    written = {
        path.name.removeprefix("arm_MuscleAnalysis_").removesuffix(".sto"): path
        for path in result.written
    }
    assert set(written) == {
        *FIBERS,
        "Length",
        "NormalizedFiberLength",
        "ActiveFiberForceAlongTendon",
        "PassiveFiberForceAlongTendon",
        "MomentArm_r_elbow_flex",
        "Moment_r_elbow_flex",
    }
    assert {path.parent for path in result.written} == {tmp_path / "Results"}
    assert "analysis ProbeReporter is left out: it is not supported" in result.warnings
    table = read_sto(written["MomentArm_r_elbow_flex"])
    assert table.names == ("BRA", "TRIlong")
    assert (table["BRA"] > 0).all()
    assert (table["TRIlong"] < 0).all()
    model = read_model(tmp_path / "arm26.osim")
    motion = motion_from_table(read_sto(tmp_path / "arm26_InverseKinematics.mot"), model)
    lengths = muscle_kinematics(model, motion, velocities=False, moment_arms=False)
    near = [int(np.argmin(np.abs(motion.time - at))) for at in table.time]
    found = read_sto(written["Length"])["BRA"]
    np.testing.assert_allclose(
        found, lengths.muscle_length[near, lengths.muscles.index("BRA")], atol=2e-4
    )


def test_static_optimization_ends_are_analysed_too():
    assert stepped(500, 24, 10).tolist() == [0, 10, 20, 23]
    assert stepped(503, 24, 10).tolist() == [0, 7, 17, 23]
    assert stepped(0, 3, 1).tolist() == [0, 1, 2]


def test_static_optimization_of_the_arm(arm, data):
    """The effort of our activations is at most that of OpenSim's table on the same frames."""
    static = (
        "<StaticOptimization"
        ' name="StaticOptimization"><step_interval>1</step_interval></StaticOptimization>'
    )
    result = run_tool(arm(static))
    names = [path.name for path in result.written]
    assert names == [
        f"arm_StaticOptimization_{end}" for end in ("activation.sto", "force.sto", "controls.xml")
    ]
    ours = read_sto(result.written[0])
    std = read_sto(data("opensim-reference-small/std_arm26_StaticOptimization_activation.sto"))
    near = [int(np.argmin(np.abs(std.time - at))) for at in ours.time]
    assert np.abs(std.time[near] - ours.time).max() < 1e-3
    effort = (ours.values**2).sum(axis=1)
    theirs = sum(std[name][near] ** 2 for name in ours.names)
    assert (effort < theirs + 0.01).all()


def test_analyses_that_do_not_exist(arm):
    with pytest.raises(
        BadData, match="asks for InducedAccelerations, but the analyses that exist are"
    ):
        run_tool(arm("<InducedAccelerations/>"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "<OpenSimDocument Version='40000'><RRATool/></OpenSimDocument>",
            "the tools that exist are",
        ),
        (
            "<OpenSimDocument Version='40000'><ScaleTool name='a'/></OpenSimDocument>",
            "names no model_file",
        ),
        (
            "<OpenSimDocument Version='40000'><InverseKinematicsTool/></OpenSimDocument>",
            "names no model_file",
        ),
        ("<html>", "line 1"),
    ],
)
def test_bad_setups_end_with_status_2_and_one_line(tmp_path, capsys, text, said):
    path = tmp_path / "setup.xml"
    path.write_text(text)
    assert main(["run-tool", str(path)]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1
    assert [one.name for one in tmp_path.iterdir()] == ["setup.xml"]


def test_the_command_tells_what_it_wrote(arm, capsys):
    analysis = '<MuscleAnalysis name="m"><compute_moments>false</compute_moments></MuscleAnalysis>'
    assert main(["run-tool", str(arm(analysis))]) == 0
    assert "arm_m_Length.sto" in capsys.readouterr().out


def test_muscles_that_are_too_weak_are_named_and_the_run_is_no_success(tmp_path, capsys):
    files = example_files(tmp_path)
    text = files.model.read_text(encoding="utf-8")
    weak = "<max_isometric_force>8</max_isometric_force>"
    assert "<max_isometric_force>800</max_isometric_force>" in text
    files.model.write_text(
        text.replace("<max_isometric_force>800</max_isometric_force>", weak), encoding="utf-8"
    )
    setup = tmp_path / "setup.xml"
    setup.write_text(
        ANALYZE.format(analyses="<StaticOptimization name='so'><on>true</on></StaticOptimization>")
        .replace("arm26.osim", files.model.name)
        .replace("arm26_InverseKinematics.mot", files.motion.name),
        encoding="utf-8",
    )
    assert main(["run-tool", str(setup)]) == 2
    printed = capsys.readouterr()
    said = printed.out + printed.err
    assert "cannot produce the torque of 'shoulder_flexion'" in said
    assert "N m are missing" in said
    assert (tmp_path / "Results" / "arm_so_activation.sto").exists()
