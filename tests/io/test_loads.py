"""External loads: every version's layout, frames, missing parts, and the table they point to."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.loads import read_external_loads, read_load_entries
from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadFile, BadModel, UnknownName

FILES = {
    "lenhart-knee-contact-walk/motion/overground_17_ext_loads.xml": (
        "calcn_l",
        "calcn_r",
        "calcn_l",
    ),
    "opensim-gait-subject01/experiment/subject01_walk1_grf.xml": ("calcn_r", "calcn_l"),
    "opensim-gait-subject01/ref_id/subject01_walk1_grf.xml": ("calcn_r", "calcn_l"),
    "opensim-gait-subject01/ref_rra/subject01_externalForces.xml": ("calcn_r", "calcn_l"),
    "opencap-subject4-multitask/grf/walking1_external_forces.xml": ("talus_r", "talus_r"),
    "rajagopal-walk-emg/grf_walk.xml": ("calcn_r", "calcn_l"),
}
COLUMNS = "vx vy vz px py pz tx ty tz"
ROWS = np.array([[0.0, *range(1, 10)], [0.1, *range(2, 11)]])


@pytest.fixture
def loads(tmp_path):
    """Write an external loads file of one force with the given properties, and its table."""
    names = "\t".join(["time", *(f"g_{one}" for one in COLUMNS.split())])
    rows = "\n".join("\t".join(str(one) for one in row) for row in ROWS)
    table = f"forces\nnRows=2\nnColumns=10\nendheader\n{names}\n{rows}\n"
    (tmp_path / "forces.mot").write_text(table)

    def write(inside, datafile="forces.mot", version=40000):
        path = tmp_path / "loads.xml"
        force = f'<ExternalForce name="plate">{inside}</ExternalForce>'
        path.write_text(
            f'<OpenSimDocument Version="{version}"><ExternalLoads'
            f' name="loads"><objects>{force}</objects><datafile> {datafile}'
            " </datafile></ExternalLoads></OpenSimDocument>"
        )
        return path

    return write


WHOLE = (
    "<applied_to_body> foot </applied_to_body><force_identifier>g_v</force_identifier>"
    "<point_identifier>g_p</point_identifier><torque_identifier>g_t</torque_identifier>"
)


def poses(body, time):
    """Return a quarter turn about z, one meter up."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return np.broadcast_to(turn, (len(time), 3, 3)), np.tile([0.0, 1.0, 0.0], (len(time), 1))


@pytest.mark.parametrize("name", FILES)
def test_wrenches_are_the_table_s_columns(name, data):
    path = data(name)
    wrenches = read_external_loads(path)
    assert wrenches.bodies == FILES[name]
    entries = read_load_entries(path)
    table = read_sto(entries[0].data)
    assert np.array_equal(wrenches.time, table.time)
    for i, entry in enumerate(entries):
        for part, identifier in (
            ("forces", entry.force),
            ("points", entry.point),
            ("torques", entry.torque),
        ):
            stem = identifier if f"{identifier}x" in table.names else f"{identifier}_"
            expected = np.column_stack([table[f"{stem}{axis}"] for axis in "xyz"])
            assert np.array_equal(getattr(wrenches, part)[:, i], expected)


def test_a_force_has_its_point_and_torque(loads):
    wrenches = read_external_loads(loads(WHOLE))
    assert wrenches.names == ("plate",)
    assert wrenches.bodies == ("foot",)
    assert np.array_equal(wrenches.forces[0, 0], (1, 2, 3))
    assert np.array_equal(wrenches.points[0, 0], (4, 5, 6))
    assert np.array_equal(wrenches.torques[1, 0], (8, 9, 10))


def test_a_torque_may_come_alone(loads):
    wrenches = read_external_loads(
        loads("<applied_to_body>foot</applied_to_body><torque_identifier>g_t</torque_identifier>")
    )
    assert not wrenches.forces.any()
    assert np.array_equal(wrenches.torques[0, 0], (7, 8, 9))


def test_frames_of_bodies_are_turned_into_ground_where_their_motion_is_known(loads):
    frames = (
        "<force_expressed_in_body>foot</force_expressed_in_body>"
        "<point_expressed_in_body>foot</point_expressed_in_body>"
    )
    path = loads(WHOLE + frames)
    with pytest.raises(BadModel, match=r"'plate' is given in the frame .* of body 'foot'"):
        read_external_loads(path)
    wrenches = read_external_loads(path, poses=poses)
    assert np.allclose(wrenches.forces[0, 0], (-2, 1, 3))
    assert np.allclose(wrenches.points[0, 0], (-5, 5, 6))
    assert np.allclose(wrenches.torques[0, 0], (-8, 7, 9))


def test_a_force_without_a_point_acts_at_the_body_s_origin(loads):
    path = loads("<applied_to_body>foot</applied_to_body><force_identifier>g_v</force_identifier>")
    with pytest.raises(BadModel, match="origin"):
        read_external_loads(path)
    wrenches = read_external_loads(path, poses=poses)
    assert np.array_equal(wrenches.forces[0, 0], (1, 2, 3))
    assert np.array_equal(wrenches.points[0, 0], (0, 1, 0))


def test_another_table_may_be_given(loads, tmp_path):
    path = loads(WHOLE, datafile="elsewhere.mot")
    with pytest.raises(BadFile, match=r"line 1: .*'elsewhere\.mot' does not exist"):
        read_external_loads(path)
    wrenches = read_external_loads(path, tmp_path / "forces.mot")
    assert np.array_equal(wrenches.forces[0, 0], (1, 2, 3))


def test_a_table_in_a_folder_that_is_gone_is_found_beside_the_file(loads):
    wrenches = read_external_loads(loads(WHOLE, datafile=r"..\Experiment\forces.mot"))
    assert len(wrenches) == 2


def test_switched_off_forces_are_left_out(loads):
    for switch in ("<appliesForce>false</appliesForce>", "<isDisabled> true </isDisabled>"):
        assert read_load_entries(loads(switch + WHOLE)) == ()
    with pytest.raises(BadFile, match="applies no force"):
        read_external_loads(loads("<appliesForce>false</appliesForce>" + WHOLE))


def test_columns_that_are_not_there_are_named(loads):
    with pytest.raises(UnknownName, match=r"'f_vx'.*'plate'.*'g_vx'"):
        read_external_loads(loads(WHOLE.replace("g_v<", "f_v<")))


@pytest.mark.parametrize(
    ("inside", "words"),
    [
        ("<force_identifier>g_v</force_identifier>", "names no body"),
        ("<applied_to_body>foot</applied_to_body>", "neither a force nor a torque"),
        (
            (
                "<applied_to_body>foot</applied_to_body><torque_identifier>g_t</torque_identifier>"
                "<point_identifier>g_p</point_identifier>"
            ),
            "a point but no force",
        ),
    ],
)
def test_a_force_needs_a_body_and_a_force_or_torque(loads, inside, words):
    with pytest.raises(BadFile, match=words):
        read_load_entries(loads(inside))


def test_the_layout_before_2_3_1_names_columns_by_functions(loads, tmp_path):
    functions = "".join(
        f'<FunctionSet name="{what}"><objects>'
        + "".join(f'<NaturalCubicSpline name="g_{column}"/>' for column in columns.split())
        + "</objects></FunctionSet>"
        for what, columns in (("forceFunctions", "vx vy vz"), ("pointFunctions", "px py pz"))
    )
    torques = (
        '<FunctionSet name="torqueFunctions"><objects><Constant name="#7"/></objects></FunctionSet>'
    )
    path = loads("", version=20201)
    force = (
        "<PrescribedForce"
        f' name="old"><body_name>foot</body_name>{functions}{torques}</PrescribedForce>'
    )
    path.write_text(path.read_text().replace('<ExternalForce name="plate"></ExternalForce>', force))
    wrenches = read_external_loads(path)
    assert wrenches.names == ("old",)
    assert np.array_equal(wrenches.forces[0, 0], (1, 2, 3))
    assert np.array_equal(wrenches.torques[0, 0], (7, 8, 9))
