"""Commands on models with passive dynamics and closed loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.sto import motion_from_table, read_sto, table_from_motion, write_sto
from myomorph.core.model.passive_dynamics import with_passive_dynamics
from myomorph.core.model.paths import Bushing
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.filters import differentiate
from myomorph.core.muscles.passive import passive_generalized_forces
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.loops import closed_motion, loop_torques

SHOULDER = "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim"
SHRUG = "shoulder-thoracoscapular/ik/SHRUG01.mot"


@pytest.fixture
def thick(arm, tmp_path):
    """Return the arm with a spring, a damper and viscous muscles, its file and its motion."""
    model = read_osim(arm.model)
    first, second = model.coordinate_names[:2]
    made = with_passive_dynamics(
        model, {first: 0.4}, {second: 3.0}, {second: 0.1}, dict.fromkeys(model.muscle_names, 200.0)
    )
    path = tmp_path / "thick.osim"
    write_osim(made, path)
    return path, read_osim(path), arm.motion


def test_net_torques_are_all_less_passive_ones(thick, command, tmp_path):
    path, model, motion_file = thick
    tables = {}
    for name, more in (("all", ()), ("net", ("--net",))):
        told = command(
            "id", "--model", path, "--motion", motion_file, "--out", tmp_path / f"{name}.sto", *more
        )
        assert told.status == 0, told.err
        tables[name] = read_sto(tmp_path / f"{name}.sto")
    motion = differentiate(motion_from_table(read_sto(motion_file), model), None)
    passive = passive_generalized_forces(model, motion).values
    assert np.abs(passive).max() > 0.1
    np.testing.assert_allclose(tables["all"].values - tables["net"].values, passive, atol=1e-6)


def test_tensions_know_viscosity(thick, command, tmp_path):
    path, _, motion_file = thick
    found = {}
    for name, more in (("with", ()), ("without", ("--no-viscous",))):
        out = tmp_path / name
        told = command("tension", "--model", path, "--motion", motion_file, "--out", out, *more)
        assert told.status == 0, told.err
        found[name] = read_sto(out / "forces.sto").values
    assert np.abs(found["with"] - found["without"]).max() > 1.0


def test_a_limit_is_excluded_by_the_name_it_has_in_the_file(data):
    from myomorph.exchange.opensim.run import net_torques

    model = read_osim(data("shoulder-bonepin/subject1_abdbonepin.osim"))
    motion = differentiate(
        motion_from_table(read_sto(data("shoulder-bonepin/std_subject1_abdbonepin_IK.mot")), model),
        6.0,
    )
    limit = "ScapulaRoationLimits"
    assert {f"{limit}_upper", f"{limit}_lower"} <= {one.name for one in model.passive_torques}
    # An elevation far outside its limit, so that the limit pushes.
    values = motion.values.copy()
    values[:, motion.names.index("scapula_upward_rot")] = 1.2
    motion = replace(motion, values=values)
    every, _ = net_torques(model, motion, None, ("Muscles",))
    less, _ = net_torques(model, motion, None, ("Muscles", limit))
    nothing, _ = net_torques(model, motion, None, ("ALL",))
    column = every.names.index("scapula_upward_rot")
    assert np.abs(every.values - less.values)[:, column].min() > 50.0
    np.testing.assert_array_equal(less.values[:, column], nothing.values[:, column])


def test_a_shoulder_goes_through_every_step(data, command, tmp_path):
    time = ("--time", "1.0", "1.2", "--cutoff", "3")
    common = ("--model", data(SHOULDER), "--motion", data(SHRUG))
    for step, out in (("id", "torques.sto"), ("muscles", "muscles"), ("tension", "tension")):
        told = command(step, *common, "--out", tmp_path / out, *time)
        assert told.status == 0, told.err
    folded = command(
        "id", *common, "--out", tmp_path / "folded.sto", "--independent-coordinates", *time
    )
    assert folded.status == 0
    model = read_osim(data(SHOULDER))
    assert len(read_sto(tmp_path / "torques.sto").names) == len(model.coordinates)
    table = read_sto(tmp_path / "folded.sto")
    assert len(table.names) == len(model.coordinates) - 3
    motion, _ = closed_motion(
        model, differentiate(motion_from_table(read_sto(data(SHRUG)), model), 3.0)
    )
    expected = loop_torques(model, motion, inverse_dynamics(model, motion)).torques
    frames = np.searchsorted(motion.time, table.time - 1e-9)
    np.testing.assert_allclose(table.values, expected.values[frames], atol=1e-6)
    # A muscle that only shares the loop has an arm about all of its coordinates.
    arms = read_sto(tmp_path / "muscles" / "moment_arms_clav_prot.sto")
    assert "SerratusAnterior_M" in arms.names
    assert read_sto(tmp_path / "tension" / "forces.sto").values.shape == (len(table), 33)


def test_a_loop_that_stands_open_is_told_or_refused(data, command, tmp_path):
    model = read_osim(data(SHOULDER))
    motion = motion_from_table(read_sto(data(SHRUG)), model)
    for by, status, said in (
        (0.01, 0, "loops ('AC') stood open by up to 0.0"),
        (0.2, 2, "'AC' open by up to 0.0"),
    ):
        values = motion.values.copy()
        values[:, motion.names.index("clav_prot")] += by
        path = tmp_path / "open.mot"
        write_sto(table_from_motion(replace(motion, values=values), model), path)
        told = command(
            "id", "--model", data(SHOULDER), "--motion", path, "--out", tmp_path / f"{by}.sto"
        )
        assert told.status == status
        assert said in " ".join((told.out + told.err).split())
    assert not (tmp_path / "0.2.sto").exists()


SETUP = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000"><InverseDynamicsTool name="thick"><model_file>{model}</model_file>
<results_directory>{out}</results_directory><time_range>0.1 0.5</time_range>
<forces_to_exclude>{excluded}</forces_to_exclude><coordinates_file>{motion}</coordinates_file>
<output_gen_force_file>id.sto</output_gen_force_file></InverseDynamicsTool></OpenSimDocument>
"""


@pytest.mark.parametrize(
    "excluded", ["Muscles", "ALL", "Muscles flexor_viscosity passive_elbow_flexion bush"]
)
def test_setups_take_off_what_opensim_takes_off(thick, excluded, tmp_path):
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    from myomorph.exchange.opensim.run import run_tool

    path, model, motion = thick
    stiff = Bushing(
        name="bush",
        body_1="upper",
        body_2="fore",
        pose_1=Transform(np.eye(3), np.array([0.0, -0.3, 0.0])),
        pose_2=Transform.identity(),
        rotational_damping=np.array([0.1, 0.2, 0.3]),
        translational_stiffness=np.array([50.0, 60.0, 70.0]),
    )
    write_osim(with_passive_dynamics(model, bushings=(stiff,)), path)
    setup = tmp_path / "setup.xml"
    setup.write_text(SETUP.format(model=path, out="ours", excluded=excluded, motion=motion))
    ours = read_sto(run_tool(setup).written[0])
    setup.write_text(
        SETUP.format(model=path, out=tmp_path / "theirs", excluded=excluded, motion=motion)
    )
    opensim.InverseDynamicsTool(str(setup)).run()
    theirs = read_sto(tmp_path / "theirs" / "id.sto")
    for name in ours.names:
        np.testing.assert_allclose(ours[name], theirs[name], atol=1e-4, err_msg=name)


STATIC = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000"><AnalyzeTool name="thick"><model_file>{model}</model_file>
<replace_force_set>false</replace_force_set><results_directory>{out}</results_directory>
<initial_time>0.1</initial_time><final_time>0.5</final_time><solve_for_equilibrium>false</solve_for_equilibrium>
<force_set_files>{reserves}</force_set_files>
<coordinates_file>{motion}</coordinates_file><AnalysisSet><objects>
<StaticOptimization name="StaticOptimization"><step_interval>20</step_interval>
<optimizer_convergence_criterion>1e-6</optimizer_convergence_criterion></StaticOptimization>
</objects></AnalysisSet></AnalyzeTool></OpenSimDocument>
"""
RESERVES = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000"><ForceSet name="reserves"><objects>{all}</objects></ForceSet>\
</OpenSimDocument>
"""
RESERVE = """<CoordinateActuator name="r_{name}"><coordinate>{name}</coordinate>\
<optimal_force>10</optimal_force>
<min_control>-Inf</min_control><max_control>Inf</max_control></CoordinateActuator>"""


def test_static_optimization_takes_springs_and_viscosity_into_account_as_opensim(
    thick, arm, tmp_path
):
    """OpenSim's muscle forces leave its dampers out, and so do ours in this tool.

    Dampers are forces of their own.
    """
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    from myomorph.exchange.opensim.run import run_tool

    path, model, motion = thick
    reserves = tmp_path / "reserves.xml"
    reserves.write_text(
        RESERVES.format(all="".join(RESERVE.format(name=name) for name in model.coordinate_names))
    )
    setup = tmp_path / "so.xml"
    tables = []
    for out, used in (("ours", path), ("theirs", path), ("bare", arm.model)):
        folder = tmp_path / out
        setup.write_text(STATIC.format(model=used, out=folder, motion=motion, reserves=reserves))
        if out == "theirs":
            opensim.AnalyzeTool(str(setup)).run()
        else:
            run_tool(setup)
        tables.append(read_sto(folder / "thick_StaticOptimization_force.sto"))
    ours, theirs, bare = tables
    near = [int(np.argmin(np.abs(theirs.time - at))) for at in ours.time]
    assert np.abs(theirs.time[near] - ours.time).max() < 1e-6
    for name in ours.names:
        np.testing.assert_allclose(ours[name], theirs[name][near], atol=0.02, err_msg=name)
    assert max(np.abs(ours[name] - bare[name]).max() for name in bare.names) > 0.5
