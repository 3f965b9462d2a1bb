"""run-tool with AnalyzeTool setups.

Every analysis that is implemented, against OpenSim's own run of the same setup.
"""

from __future__ import annotations

import shutil
import subprocess
import sys

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.sto import read_sto, write_sto
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.model.series import Table
from myomorph.exchange.opensim.run import run_tool
from myomorph.exchange.opensim.states import even_times

SMALL = "opensim-reference-small/"
SETUP = """<OpenSimDocument Version="40000"><AnalyzeTool name="arm"><model_file>{model}</model_file>
<results_directory>{results}</results_directory><output_precision>16</output_precision>
<initial_time>0.25</initial_time><final_time>0.4</final_time>
<solve_for_equilibrium_for_auxiliary_states>{balanced}</solve_for_equilibrium_for_auxiliary_states>
<AnalysisSet><objects>{analyses}</objects></AnalysisSet><{kind}_file>{motion}</{kind}_file>
<lowpass_cutoff_frequency_for_coordinates>6</lowpass_cutoff_frequency_for_coordinates></AnalyzeTool></OpenSimDocument>"""
EVERY = """<MuscleAnalysis name="MA"/><BodyKinematics name="BK"/><Kinematics name="K"/>\
<Actuation name="A"/>
<BodyKinematics name="own">\
<express_results_in_body_local_frame>true</express_results_in_body_local_frame>
</BodyKinematics><PointKinematics name="PK"><body_name>r_ulna_radius_hand</body_name>\
<point_name>hand</point_name>
<point>0 -0.2 0.01</point><relative_to_body_name>none</relative_to_body_name></PointKinematics>
<ForceReporter name="FR"/><StatesReporter name="SR"/><JointReaction name="JR"/>"""
OPENSIM = """
import opensim, sys
opensim.Logger.setLevelString("Off")
tool = opensim.AnalyzeTool(sys.argv[1])
sys.exit(0 if tool.run() else 1)
"""


@pytest.fixture
def arm(data, tmp_path):
    """Return a folder with an arm of six muscles, and a function that writes a setup."""
    for name in ("arm26_bounds.osim", "arm26_InverseKinematics.mot"):
        shutil.copyfile(data(SMALL + name), tmp_path / name)

    def write(
        analyses,
        results="ours",
        balanced="false",
        kind="coordinates",
        motion="arm26_InverseKinematics.mot",
    ):
        path = tmp_path / f"{results}.xml"
        path.write_text(
            SETUP.format(
                model="arm26_bounds.osim",
                results=results,
                balanced=balanced,
                analyses=analyses,
                kind=kind,
                motion=motion,
            )
        )
        return path

    return write


def opensim_on(path):
    """Return what OpenSim writes for a setup, in a process of its own."""
    pytest.importorskip("opensim")
    subprocess.run(
        [sys.executable, "-c", OPENSIM, path.name], check=True, capture_output=True, cwd=path.parent
    )
    return path.parent / path.stem


@pytest.mark.parametrize("balanced", ["false", "true"])
def test_every_table_is_opensims(arm, tmp_path, balanced):
    """Names, order and rows; values to 2e-5 of a column's range.

    The filter's even times leave 1e-5.
    """
    run_tool(arm(EVERY, "ours", balanced))
    theirs = opensim_on(arm(EVERY, "theirs", balanced))
    names = {path.name for path in theirs.glob("*.sto")}
    assert len(names) == 40
    assert {path.name for path in (tmp_path / "ours").iterdir()} == names
    for name in sorted(names):
        found = read_sto(tmp_path / "ours" / name)
        wanted = read_sto(theirs / name)
        assert found.names == wanted.names, name
        assert found.in_degrees == wanted.in_degrees, name
        np.testing.assert_allclose(found.time, wanted.time, atol=1e-6, err_msg=name)
        span = np.ptp(wanted.values, axis=0)
        size = max(float(span.max()), 0.01 * float(np.abs(wanted.values).max()), 1e-9)
        apart = np.abs(found.values - wanted.values).max(axis=0) / np.maximum(span, 0.01 * size)
        assert apart.max() < 2e-5, (name, found.names[int(apart.argmax())])


def test_states_of_a_file_are_taken(arm, tmp_path):
    """Written states, read back with other activations.

    They give other forces and the same motion.
    """
    first = run_tool(arm('<StatesReporter name="SR"/>', "first", "true"))
    table = read_sto(first.written[0])
    active = [name.endswith("/activation") for name in table.names]
    write_sto(
        Table(table.time, table.names, np.where(active, 0.5, table.values)), tmp_path / "states.sto"
    )
    analyses = '<Actuation name="A"/><Kinematics name="K"/>'
    weak = run_tool(
        arm(
            analyses,
            "weak",
            kind="states",
            motion=first.written[0].relative_to(tmp_path).as_posix(),
        )
    )
    strong = run_tool(arm(analyses, "strong", kind="states", motion="states.sto"))
    forces = [read_sto(one.written[0]) for one in (weak, strong)]
    # the tendon's, by the fiber's length
    np.testing.assert_allclose(forces[0].values, forces[1].values, atol=1e-6)
    q = read_sto(tmp_path / "weak" / "arm_K_q.sto")
    u = read_sto(tmp_path / "weak" / "arm_K_u.sto")
    values = {name.split("/")[-2]: table[name] for name in table.names if name.endswith("/value")}
    speeds = {name.split("/")[-2]: table[name] for name in table.names if name.endswith("/speed")}
    for name in q.names:
        np.testing.assert_allclose(np.radians(q[name]), values[name], atol=1e-8)
        np.testing.assert_allclose(np.radians(u[name]), speeds[name], atol=1e-8)
    assert not any("equilibrium is not requested" in one for one in weak.warnings)


def test_default_states_are_told(arm):
    result = run_tool(
        arm('<MuscleAnalysis name="MA"><compute_moments>false</compute_moments></MuscleAnalysis>')
    )
    assert any("equilibrium is not requested" in one for one in result.warnings)
    assert len(result.written) == 18


def test_inverse_dynamics_of_opensim_3(data, tmp_path):
    """An analysis that OpenSim 4 no longer has; the table is OpenSim's own of that time."""
    for name in ("arm26.osim", "arm26_InverseKinematics.mot", "arm26_Setup_InverseDynamics.xml"):
        shutil.copyfile(data(SMALL + name), tmp_path / name)
    result = run_tool(tmp_path / "arm26_Setup_InverseDynamics.xml")
    assert [one.name for one in result.written] == ["arm26_InverseDynamics.sto"]
    found = read_sto(result.written[0])
    wanted = read_sto(data(SMALL + "std_arm26_InverseDynamics.sto"))
    assert found.names == wanted.names
    assert len(found) == len(wanted)
    np.testing.assert_allclose(found.values, wanted.values, atol=0.01)
    assert np.abs(wanted.values).max() > 1.0


@pytest.mark.parametrize(
    ("analysis", "error", "said"),
    [
        (
            "<PointKinematics><body_name>hand</body_name></PointKinematics>",
            UnknownName,
            "unknown body 'hand'",
        ),
        (
            "<PointKinematics><point>0 1</point></PointKinematics>",
            BadData,
            "expected three numbers",
        ),
        (
            "<PointKinematics><point>0 1 up</point></PointKinematics>",
            BadData,
            "expected three numbers",
        ),
        ("<BodyKinematics><bodies>hand</bodies></BodyKinematics>", BadData, "none of its bodies"),
        ("<InverseDynamics/>", BadData, "use_model_force_set is not supported"),
        (
            "<InducedAccelerations/>",
            BadData,
            "asks for InducedAccelerations, but the analyses that exist are",
        ),
    ],
)
def test_what_an_analysis_asks_in_vain_is_named(arm, tmp_path, analysis, error, said):
    with pytest.raises(error, match=said):
        run_tool(arm(analysis))
    assert not (tmp_path / "ours").exists()


def test_lists_keep_their_order_and_name_what_is_missing(arm, tmp_path):
    analysis = (
        "<Kinematics name='K'><coordinates>r_elbow_flex wrist"
        " r_shoulder_elev</coordinates></Kinematics>"
    )
    result = run_tool(arm(analysis))
    assert any("coordinate 'wrist' is not in the model" in one for one in result.warnings)
    assert read_sto(tmp_path / "ours" / "arm_K_q.sto").names == ("r_elbow_flex", "r_shoulder_elev")


def test_tools_that_are_not_built_are_named(tmp_path):
    path = tmp_path / "setup.xml"
    path.write_text("<OpenSimDocument Version='40000'><CMCTool/></OpenSimDocument>")
    with pytest.raises(
        BadFile, match="holds <CMCTool>, a tool that is not supported; the tools that exist are"
    ):
        run_tool(path)


def test_uneven_times_become_even_with_a_limit():
    even = 0.01 * np.arange(50)
    assert even_times(even) is even
    uneven = np.concatenate([even[:20], [even[19] + 1e-7], even[20:]])
    found = even_times(uneven)
    assert found[0] >= even[0]
    assert found[-1] <= even[-1]
    assert np.ptp(np.diff(found)) < 1e-12
    assert 40_000 < len(found) < 60_000


def test_orientations_come_back(data):
    model = read_model(data(SMALL + "arm26_bounds.osim"))
    assert model.muscles
    angles = np.random.default_rng(1).uniform(-1.5, 1.5, (20, 3))
    from myomorph.core.model.spatial import euler_xyz_from_rotation, rotation_from_euler_xyz

    rotations = np.stack([rotation_from_euler_xyz(one) for one in angles])
    np.testing.assert_allclose(euler_xyz_from_rotation(rotations), angles, atol=1e-12)


def test_paths_of_other_systems(arm, tmp_path):
    """Backslashes, spaces and accents; a drive that is not here counts by the file's name."""
    folder = tmp_path / "Läufer 1"
    (folder / "das Modell").mkdir(parents=True)
    shutil.copyfile(tmp_path / "arm26_bounds.osim", folder / "das Modell" / "arm é.osim")
    shutil.copyfile(tmp_path / "arm26_InverseKinematics.mot", folder / "motion.mot")
    motion = "D:\\lab\\motion.mot" if sys.platform != "win32" else "motion.mot"
    text = arm("<Kinematics name='K'/>", "out", motion=motion).read_text()
    path = folder / "set up.xml"
    path.write_text(text.replace("arm26_bounds.osim", "das Modell\\arm é.osim"), encoding="utf-8")
    result = run_tool(path)
    assert {one.relative_to(folder).as_posix() for one in result.written} == {
        f"out/arm_K_{kind}.sto" for kind in ("q", "u", "dudt")
    }
