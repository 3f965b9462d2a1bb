"""run-tool with a JointReaction analysis: the table that OpenSim writes, from the same setup."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.sto import read_sto, write_sto
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.exchange.opensim.run import run_tool

SMALL = "opensim-reference-small/"
STUDY = "walk-so-jointload-emg/"
CASES = (
    ("SinglePin", ""),
    ("SinglePin", "_FrameKeyword"),
    ("DoublePendulum3D", ""),
    ("DoublePendulum3D", "_FrameKeyword"),
)
ACTUATOR = """<CoordinateActuator name="{name}"><coordinate>{coordinate}</coordinate>\
<optimal_force>1</optimal_force>
</CoordinateActuator>"""
FORCE = """<ExternalForce name="{body}_force"><applied_to_body>{body}</applied_to_body>\
<force_expressed_in_body>ground
</force_expressed_in_body><point_expressed_in_body>ground</point_expressed_in_body><force_identifier>{side}ground_force_v
</force_identifier><point_identifier>{side}ground_force_p</point_identifier><torque_identifier>{side}ground_torque_
</torque_identifier></ExternalForce>"""
SETUP = """<?xml version="1.0"?><OpenSimDocument Version="40000"><AnalyzeTool name="so">\
<model_file>{model}</model_file>
<replace_force_set>false</replace_force_set><force_set_files>actuators.xml</force_set_files>
<results_directory>{results}</results_directory><initial_time>11.1</initial_time><final_time>11.3</final_time>
<solve_for_equilibrium_for_auxiliary_states>false</solve_for_equilibrium_for_auxiliary_states>
<AnalysisSet name="Analyses"><objects><JointReaction name="JR"><on>true</on>\
<step_interval>1</step_interval>
<forces_file>forces.sto</forces_file><joint_names>ALL</joint_names><apply_on_bodies>{on}</apply_on_bodies>
<express_in_frame>{frame}</express_in_frame></JointReaction></objects></AnalysisSet>
<external_loads_file>loads.xml</external_loads_file><states_file>{states}</states_file></AnalyzeTool>
</OpenSimDocument>"""
OPENSIM = """
import opensim, sys
opensim.Logger.setLevelString("Off")
tool = opensim.AnalyzeTool(sys.argv[1])
sys.exit(0 if tool.run() else 1)
"""


@pytest.mark.parametrize(("model", "setup"), CASES)
def test_loads_of_pendulums_are_those_that_come_with_opensim(data, tmp_path, model, setup):
    for source in sorted(data(SMALL + f"{model}.osim").parent.glob(f"{model}*")):
        shutil.copy(source, tmp_path)
    path = tmp_path / f"{model}_Setup_JointReaction{setup}.xml"
    result = run_tool(path)
    assert [one.name for one in result.written] == [
        f"{model}{setup}_JointReaction_ReactionLoads.sto"
    ]
    found = read_sto(result.written[0])
    wanted = read_sto(data(SMALL + f"std_{model}_JointReaction_ReactionLoads{setup}.sto"))
    assert found.names == wanted.names
    # Some files' last two frames stand at one time: OpenSim writes both.
    assert len(found) == 301
    np.testing.assert_allclose(found.values, wanted.values[:301], atol=1e-7)
    assert result.written[0].read_text().split("endheader")[1].strip().count("\n") == 302


def study(data, folder, on="child", frame="child"):
    """Write a setup on the study's own states and forces, the model's own actuators at rest."""
    model = data(STUDY + "Rajagopal_scaled_Sub1_gasAvoid.osim")
    states = data(STUDY + "results_SO/results_states.sto")
    forces = read_sto(data(STUDY + "results_SO/results_forces.sto"))
    # OpenSim reads as many columns as the model has actuators: none may stand before them.
    keep = [
        k for k, name in enumerate(forces.names) if not name.startswith(("calcn", "patellofemoral"))
    ]
    own = ("lumbar_ext", "lumbar_bend", "lumbar_rot")
    names = tuple(forces.names[k] for k in keep)
    values = np.hstack([forces.values[:, keep], np.zeros((len(forces), 3))])
    write_sto(replace(forces, names=(*names, *own), values=values), folder / "forces.sto")
    reserves = [name for name in names if name.endswith("_reserve")]
    actuators = "".join(
        ACTUATOR.format(name=name, coordinate=name.removesuffix("_reserve")) for name in reserves
    )
    head = '<?xml version="1.0"?><OpenSimDocument Version="40000">'
    (folder / "actuators.xml").write_text(
        f"{head}<ForceSet"
        f' name="reserves"><objects>{actuators}</objects></ForceSet></OpenSimDocument>'
    )
    plates = "".join(
        FORCE.format(body=body, side=side) for body, side in (("calcn_r", ""), ("calcn_l", "1_"))
    )
    plates = plates.replace("\n<", "<")
    table = data(STUDY + "walking_baseline1_forces.mot")
    (folder / "loads.xml").write_text(
        f"{head}<ExternalLoads"
        f' name="loads"><objects>{plates}</objects><datafile>{table}</datafile></ExternalLoads>'
        "</OpenSimDocument>"
    )
    path = folder / "setup.xml"
    path.write_text(SETUP.format(model=model, states=states, results="ours", on=on, frame=frame))
    theirs = folder / "theirs.xml"
    theirs.write_text(
        SETUP.format(model=model, states=states, results="theirs", on=on, frame=frame)
    )
    return path, theirs


@pytest.mark.parametrize(("on", "frame"), [("child", "child"), ("parent", "ground")])
def test_same_tensions_in_same_reactions_out(data, tmp_path, on, frame):
    """OpenSim 4.6 on the same setup: 80 muscles, all joints; forces to 0.05 N of 3,900."""
    pytest.importorskip("opensim")
    ours, theirs = study(data, tmp_path, on, frame)
    subprocess.run(
        [sys.executable, "-c", OPENSIM, str(theirs)], check=True, capture_output=True, cwd=tmp_path
    )
    run_tool(ours)
    found = read_sto(tmp_path / "ours" / "so_JR_ReactionLoads.sto")
    wanted = read_sto(tmp_path / "theirs" / "so_JR_ReactionLoads.sto")
    assert found.names == wanted.names
    assert np.abs(found.values - wanted.values).max() < 0.05
    assert np.abs(wanted.values).max() > 2000.0


def test_what_a_setup_lacks_is_named(data, tmp_path):
    path, _ = study(data, tmp_path)
    text = path.read_text()
    path.write_text(text.replace("ALL", "knee"))
    with pytest.raises(UnknownName, match="unknown joint 'knee'"):
        run_tool(path)
    path.write_text(
        text.replace("ALL", "hip_r hip_l").replace(">child</apply", ">child parent child</apply")
    )
    with pytest.raises(BadData, match="apply_on_bodies names 3 for 2 joints"):
        run_tool(path)
    table = read_sto(tmp_path / "forces.sto")
    write_sto(
        replace(table, names=table.names[:-1], values=table.values[:, :-1]), tmp_path / "forces.sto"
    )
    path.write_text(text)
    with pytest.raises(BadData, match=r"forces\.sto: unknown actuator 'lumbar_rot'"):
        run_tool(path)
    assert not (tmp_path / "ours").exists() or not list((tmp_path / "ours").iterdir())


def test_a_joint_that_does_not_exist_is_left_out_with_its_side(data, tmp_path):
    path, _ = study(data, tmp_path, on="child parent parent", frame="ground child parent")
    path.write_text(path.read_text().replace("ALL", "hip_r knee hip_l"))
    result = run_tool(path)
    assert any("'knee' is not a joint" in one for one in result.warnings)
    names = read_sto(result.written[0]).names
    assert names[0] == "hip_r_on_femur_r_in_ground_fx"
    assert names[9] == "hip_l_on_pelvis_in_pelvis_fx"
