"""Inverse kinematics tasks and the setup files of OpenSim's tools."""

from __future__ import annotations

import math

import pytest

from myomorph.core.io.osim.setup_parts import read_ik_tasks
from myomorph.core.model.errors import BadFile
from myomorph.exchange.opensim.tool_setups import (
    AnalyzeSetup,
    InverseDynamicsSetup,
    InverseKinematicsSetup,
    read_setup,
)


def test_only_applied_tasks_count(data):
    tasks = read_ik_tasks(data("rajagopal-walk-emg/ik_tasks_walk.xml"))
    assert tasks.marker_weights["R.ASIS"] == 20
    assert "R.Biceps" not in tasks.marker_weights
    assert tasks.coordinates == ()


def test_a_setup_s_own_tasks_with_coordinates(data):
    tasks = read_ik_tasks(data("opensim-gait-subject01/experiment/subject01_Setup_IK.xml"))
    assert len(tasks.marker_weights) == 31
    assert [one.coordinate for one in tasks.coordinates] == [
        "subtalar_angle_r",
        "mtp_angle_r",
        "subtalar_angle_l",
        "mtp_angle_l",
    ]
    assert {(one.weight, one.source) for one in tasks.coordinates} == {(1000.0, "default")}


def test_a_file_without_opensimdocument_around_it(data):
    assert (
        len(
            read_ik_tasks(
                data("opensim-gait-subject01/ref_ik/gait2354_IK_Tasks_uniform.xml")
            ).marker_weights
        )
        == 31
    )


def test_tasks_against_opensim(data):
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    path = data("opensim-gait-subject01/ref_scale/gait2354_Scale_Tasks.xml")
    theirs = opensim.IKTaskSet(str(path))
    used = {
        theirs.get(i).getName(): theirs.get(i).getWeight()
        for i in range(theirs.getSize())
        if theirs.get(i).getApply()
    }
    tasks = read_ik_tasks(path)
    assert {
        **tasks.marker_weights,
        **{one.coordinate: one.weight for one in tasks.coordinates},
    } == used


def test_inverse_kinematics_setup(data):
    path = data("opensim-gait-subject01/experiment/subject01_Setup_IK.xml")
    setup = read_setup(path)
    assert isinstance(setup, InverseKinematicsSetup)
    assert setup.time_range == (0.4, 1.6)
    assert setup.markers == path.parent / "subject01_walk1.trc"
    assert setup.output == path.parent / "subject01_walk1_ik.mot"
    assert setup.constraint_weight == 20
    other = read_setup(data("shoulder-bonepin/setup_ik_abdbonepin.xml"))
    assert isinstance(other, InverseKinematicsSetup)
    assert other.constraint_weight == math.inf


def test_inverse_dynamics_setup(data):
    path = data("opensim-gait-subject01/ref_id/subject01_Setup_InverseDynamics.xml")
    setup = read_setup(path)
    assert isinstance(setup, InverseDynamicsSetup)
    assert setup.cutoff == 6
    assert setup.model == path.parent / "subject01.osim"
    assert setup.excluded == ("muscles",)
    assert setup.loads is not None
    assert setup.loads.name == "subject01_walk1_grf.xml"


def test_static_optimization_setup(data):
    path = data("opensim-gait-subject01/ref_so_10dof18musc/staticoptimization_spring_Setup.xml")
    setup = read_setup(path)
    assert isinstance(setup, AnalyzeSetup)
    assert setup.actuators == (path.parent / "gait10dof_Actuators_weak.xml",)
    assert setup.time_range == (0.5, 1.3)
    assert not setup.replace_forces
    (analysis,) = setup.analyses
    assert (analysis.kind, analysis.name, analysis.step) == (
        "StaticOptimization",
        "StaticOptimization",
        10,
    )
    assert analysis.static_optimization is not None
    assert analysis.static_optimization.exponent == 2.0


TOOL = """<OpenSimDocument Version="{version}"><IKTool name="old"><model_file>m.osim</model_file>
<IKTaskSet><objects>{tasks}</objects></IKTaskSet>
<IKTrialSet><objects><IKTrial name="t"><marker_file>C:\\data\\walk.trc</marker_file>\
<time_range>1 2</time_range>
</IKTrial>{more}</objects></IKTrialSet></IKTool></OpenSimDocument>"""


def test_tools_with_trials_from_before_2_3(tmp_path):
    path = tmp_path / "ik.xml"
    task = (
        '<IKCoordinateTask name="k"><weight>2</weight><value_type>{}</value_type>'
        "<value>0.5</value></IKCoordinateTask>"
    )
    tasks = task.format("manual_value") + task.format("from_file")
    path.write_text(TOOL.format(version=20000, tasks=tasks, more=""))
    setup = read_setup(path)
    assert isinstance(setup, InverseKinematicsSetup)
    assert setup.time_range == (1, 2)
    assert [(one.source, one.value) for one in setup.tasks.coordinates] == [
        ("value", 0.5),
        ("table", 0.0),
    ]
    assert setup.markers is not None
    assert setup.markers.name == "walk.trc"
    path.write_text(TOOL.format(version=20000, tasks="", more="<IKTrial/>"))
    with pytest.raises(BadFile, match="several trials"):
        read_setup(path)


def test_files_without_tasks_or_of_other_tools(data, tmp_path):
    with pytest.raises(BadFile, match="has no IKTaskSet"):
        read_ik_tasks(data("rajagopal-walk-emg/grf_walk.xml"))
    with pytest.raises(
        BadFile, match="holds <CMCTool>, a tool that is not supported; the tools that exist are"
    ):
        read_setup(data("opensim-reference-small/cmc_arm26_Setup_CMC.xml"))
    path = tmp_path / "tasks.xml"
    path.write_text(
        "<IKTaskSet><objects><IKMarkerTask"
        ' name="a"><weight>-1</weight></IKMarkerTask></objects></IKTaskSet>'
    )
    with pytest.raises(BadFile, match="weight -1"):
        read_ik_tasks(path)
