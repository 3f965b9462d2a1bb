"""Setups of OpenSim's ScaleTool, marker sets, and parts that stand in files of their own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.osim.scale_setup import ScaleSetup
from myomorph.core.io.osim.setup_parts import read_marker_set, write_marker_set, write_scale_set
from myomorph.core.model.errors import BadData, BadFile
from myomorph.exchange.opensim.tool_setups import read_setup

TOOL = """<OpenSimDocument Version="40000"><ScaleTool name="s"><mass>{mass}</mass>
<GenericModelMaker><model_file>m.osim</model_file></GenericModelMaker>
<ModelScaler><scaling_order>{order}</scaling_order>{scaler}</ModelScaler>
<MarkerPlacer>{placer}</MarkerPlacer></ScaleTool></OpenSimDocument>"""


def written(path, mass=1, order="measurements", scaler="", placer="<apply>false</apply>"):
    path.write_text(TOOL.format(mass=mass, order=order, scaler=scaler, placer=placer))
    return path


def test_an_old_setup(data):
    path = data("opensim-gait-subject01/ref_scale/subject01_Setup_Scale.xml")
    setup = read_setup(path)
    assert isinstance(setup, ScaleSetup)
    assert (setup.name, setup.mass) == ("subject01", 72.6)
    assert setup.marker_set == path.parent / "gait2354_Scale_MarkerSet.xml"
    scaler = setup.scaler
    placer = setup.placer
    assert scaler is not None
    assert placer is not None
    assert scaler.order == ("measurements", "manualScale")
    thigh = next(one for one in scaler.measurements if one.name == "thigh")
    assert thigh.pairs == (("R.ASIS", "R.Knee.Lat"), ("L.ASIS", "L.Knee.Lat"))
    assert dict(thigh.bodies) == dict.fromkeys(
        ("femur_r", "femur_l", "patella_r", "patella_l"), "xyz"
    )
    np.testing.assert_array_equal(scaler.factors["tibia_l"], 0.988523)
    assert (scaler.time_range, scaler.preserve_mass_distribution) == ((1.0, 2.0), True)
    assert scaler.output_factors == path.parent / "subject01_scaleSet_applied.xml"
    assert placer.output_motion == path.parent / "subject01_static_output.mot"
    assert (placer.output_markers, placer.coordinates, placer.most_movement) == (
        None,
        None,
        math.inf,
    )
    assert placer.tasks.marker_weights["R.ASIS"] == 1000
    assert {one.coordinate for one in placer.tasks.coordinates} >= {
        "subtalar_angle_r",
        "mtp_angle_l",
    }
    assert setup.facts["height"].startswith("1803.4")


def test_a_mass_of_zero_and_switched_off_parts(data):
    setup = read_setup(data("rajagopal-walk-emg/raw/scale_setup_walk.xml"))
    assert isinstance(setup, ScaleSetup)
    assert setup.mass is None
    assert setup.scaler is not None
    assert setup.scaler.order == ()
    assert setup.placer is not None
    assert "L.MElbow" not in setup.placer.tasks.marker_weights


@pytest.mark.parametrize(
    ("order", "scaler", "said"),
    [
        (
            "automatic",
            "",
            "'scaling_order' names 'automatic'; expected measurements or manualScale",
        ),
        (
            "",
            (
                "<ScaleSet><objects><Scale><scales>1 -1"
                " 1</scales><segment>a</segment></Scale></objects></ScaleSet>"
            ),
            "'scales' is '1 -1 1'; expected three positive numbers",
        ),
        (
            "",
            (
                "<MeasurementSet><objects><Measurement"
                ' name="a"><MarkerPairSet><objects><MarkerPair>'
                "<markers>one</markers></MarkerPair></objects></MarkerPairSet></Measurement></objects></MeasurementSet>"
            ),
            "'markers' names 1; expected two markers for measurement 'a'",
        ),
        (
            "",
            (
                '<MeasurementSet><objects><Measurement name="a"><BodyScaleSet><objects><BodyScale'
                ' name="b">'
                "<axes>X Q</axes></BodyScale></objects></BodyScaleSet>"
                "</Measurement></objects></MeasurementSet>"
            ),
            "'axes' is 'xq'; expected some of X, Y and Z",
        ),
        (
            "",
            "<output_model_file>notes.txt</output_model_file>",
            "'output_model_file' is 'notes.txt'; expected a name",
        ),
    ],
)
def test_bad_setups_name_what_is_wrong(tmp_path, order, scaler, said):
    with pytest.raises(BadFile, match="line ") as caught:
        read_setup(written(tmp_path / "scale.xml", order=order, scaler=scaler))
    assert said in str(caught.value)


def test_unknown_parts_are_told(tmp_path):
    scaler = "<shape_model>ai</shape_model><marker_file>Unassigned</marker_file>"
    setup = read_setup(written(tmp_path / "scale.xml", scaler=scaler))
    assert setup.warnings == ("<shape_model> of ModelScaler is left out",)


def test_a_part_in_its_own_file(data, tmp_path):
    text = data("opensim-gait-subject01/ref_scale/gait2354_Scale_Tasks.xml").read_text()
    (tmp_path / "tasks.xml").write_text(text)
    setup = read_setup(written(tmp_path / "scale.xml", placer='<IKTaskSet file="tasks.xml"/>'))
    assert isinstance(setup, ScaleSetup)
    assert setup.placer is not None
    assert setup.placer.tasks.marker_weights["R.ASIS"] == 1000
    with pytest.raises(BadFile, match="no such file"):
        read_setup(written(tmp_path / "other.xml", placer='<IKTaskSet file="lost.xml"/>'))
    (tmp_path / "again.xml").write_text(
        '<IKTaskSet><objects><IKMarkerTask file="again.xml"/></objects></IKTaskSet>'
    )
    with pytest.raises(BadFile, match="names a further file"):
        read_setup(written(tmp_path / "third.xml", placer='<IKTaskSet file="again.xml"/>'))


def test_marker_sets_come_back(data, tmp_path):
    model = read_model(data("opensim-gait-subject01/ref_scale/gait2354_simbody.osim"))
    markers = read_marker_set(
        data("opensim-gait-subject01/ref_scale/gait2354_Scale_MarkerSet.xml"), model
    )
    assert len(markers) == 39
    own = read_model(data("opensim-gait-subject01/ref_scale/std_subject01_simbody.osim"))
    write_marker_set(own, tmp_path / "markers.xml")
    again = read_marker_set(tmp_path / "markers.xml", own)
    for one, two in zip(own.markers, again, strict=True):
        assert (one.name, one.body, one.fixed) == (two.name, two.body, two.fixed)
        np.testing.assert_array_equal(one.location, two.location)
    with pytest.raises(BadData, match="marker 'Sternum': unknown body 'torso'"):
        read_marker_set(
            tmp_path / "markers.xml",
            read_model(data("opensim-reference-small/double_pendulum.osim")),
        )


def test_opensim_reads_what_is_written(data, tmp_path):
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    own = read_model(data("opensim-gait-subject01/ref_scale/std_subject01_simbody.osim"))
    write_marker_set(own, tmp_path / "markers.xml")
    assert opensim.MarkerSet(str(tmp_path / "markers.xml")).getSize() == len(own.markers)
    write_scale_set({"femur_r": np.array([1.0, 1.25, 0.1 + 0.2])}, tmp_path / "factors.xml")
    theirs = opensim.ScaleSet(str(tmp_path / "factors.xml"))
    factors = opensim.Vec3()
    theirs.get(0).getScaleFactors(factors)
    assert theirs.get(0).getSegmentName() == "femur_r"
    np.testing.assert_array_equal(factors.to_numpy(), (1.0, 1.25, 0.1 + 0.2))
