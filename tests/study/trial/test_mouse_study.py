"""A study of a mouse: labels of its own, parts worth using.

Muscle lengths of every stride are in page and tables.
"""

from __future__ import annotations

import csv

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.series import Markers, Trial
from myomorph.core.tension.dual import STATUS_NAMES
from myomorph.lab.study.inputs.reading import with_labels
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from truths.mouse_recordings import GAIT_LABELS, both_hindlimbs

RECORDING = "mouse-gait-c3d-force/Cage6_1R_12_01_26_trial_2.c3d"


def study(folder, data, steps, more="", contacts=""):
    data("mouse-hindlimb-muscles/mouse_hindlimb.json")
    recording = data(RECORDING)
    write_osim(both_hindlimbs(recording.parents[1]), folder / "mouse.osim")
    labels = ", ".join(f'"{old}" = "{new}"' for old, new in GAIT_LABELS.items())
    said = f'contacts = "{contacts}"' if contacts else ""
    text = f"""
        [study]
        name = "mouse"
        [[subject]]
        name = "1R"
        model = "mouse.osim"
        trials = ["{recording}"]
        steps = {steps}
        labels = {{ {labels} }}
        {said}
        {more}
        """
    (folder / "study.toml").write_text("\n".join(line.strip() for line in text.splitlines()))
    return read_plan(folder / "study.toml")


def test_strides_of_a_mouse_end_in_the_page(tmp_path, data):
    plan = study(tmp_path, data, ["ik", "muscles", "report"], "[options.ik]\npasses_only = true")
    outcome = run_study(plan, tmp_path / "out")[0]
    assert outcome.error == ""
    assert outcome.done == ("ik", "muscles", "report")
    # Generic bones under skin: millimetres, not centimetres.
    assert outcome.rms < 5e-3
    page = (outcome.folder / "report.html").read_text()
    assert "Muscle lengths over the stride" in page
    rows = list(csv.DictReader((outcome.folder / "length_ranges.csv").open()))
    assert len(rows) == 84
    assert {row["limb"] for row in rows} == {"Foot_r", "Foot_l"}
    strides = list(csv.reader((outcome.folder / "length_strides.csv").open()))
    lasting = {(row[0], row[1]): float(row[2]) - float(row[1]) for row in strides[1:]}
    assert len(lasting) >= 12
    assert np.median(list(lasting.values())) == pytest.approx(0.28, abs=0.05)


def test_a_leg_has_tensions_only_where_its_load_is_known(tmp_path, data):
    """Two hind paws and two forepaws on one plate.

    What is left is solved, and its reserves are small. Most of the weight is nobody's, so that it
    has to be asked for.
    """
    steps = ["ik", "id", "tension"]
    plan = study(tmp_path, data, steps, "[options.ik]\npasses_only = true", contacts="none")
    outcome = run_study(plan, tmp_path / "out")[0]
    assert outcome.error == ""
    assert [text for text in outcome.findings if "the load on 'Foot_l' is not determined" in text]
    (result,) = mm.load(outcome.folder).values()
    tension = result.tension
    left = [name.endswith("_l") for name in tension.muscles]
    unknown = tension.undetermined
    assert 0.1 < unknown[tension.asked].mean() < 0.9
    # A leg is left out as a whole, and so are the torques and reserves of its joints.
    for side, leg in ((True, "l"), (False, "r")):
        muscles = unknown[:, [value is side for value in left]]
        np.testing.assert_array_equal(muscles.all(axis=1), muscles.any(axis=1))
        out = muscles.all(axis=1)
        assert np.isnan(tension.curve("actuator_force", f"reserve_Knee_extension_{leg}")[out]).all()
        assert np.isnan(
            tension.balanced_torque[out, tension.coordinates.index(f"Knee_extension_{leg}")]
        ).all()
        given = tension.curve("actuator_force", f"reserve_Knee_extension_{leg}")
        asked = f"Knee_extension_{leg}"
        torque = tension.balanced_torque[:, tension.coordinates.index(asked)]
        assert np.sqrt(np.nanmean(given**2) / np.nanmean(torque**2)) < 0.2
    np.testing.assert_array_equal(
        tension.status == STATUS_NAMES.index("not determined"), unknown.all(axis=1)
    )


def test_a_mouse_whose_forepaws_nobody_measured_is_refused_by_name(tmp_path, data):
    plan = study(tmp_path, data, ["ik", "id", "tension"], "[options.ik]\npasses_only = true")
    outcome = run_study(plan, tmp_path / "out")[0]
    assert outcome.done == ("ik", "id")
    assert "do not support the body of 0.02" in outcome.error
    assert "would be unexplained at 'Pelvis'" in outcome.error
    assert "--contacts none" in outcome.error


def test_parts_that_show_enough_nowhere_are_named(tmp_path, data):
    plan = study(
        tmp_path, data, ["ik"], "[options.ik]\npasses_only = true\npasses_min_duration = 30.0"
    )
    assert "no part of 30 s shows 75 %" in run_study(plan, tmp_path / "out")[0].error
    with pytest.raises(BadFile, match="passes_onl"):
        study(tmp_path, data, ["ik"], "[options.ik]\npasses_onl = true")


def test_a_recording_without_such_passes_is_used_where_it_shows_most(tmp_path, data):
    """No part of 2 s shows all that markers could tell: what shows most is used, and said."""
    asked = "passes_min_visible = 1.0\npasses_max_gap = 0.0\npasses_min_duration = 2.0"
    plan = study(tmp_path, data, ["ik"], f"[options.ik]\npasses_only = true\n{asked}")
    outcome = run_study(plan, tmp_path / "out")[0]
    assert outcome.error == ""
    assert outcome.done == ("ik",)
    (told,) = [text for text in outcome.findings if "no part of 2 s shows 100 %" in text]
    assert "are used" in told
    (result,) = mm.load(outcome.folder).values()
    motion = result.motion
    used = motion.time[np.isfinite(motion.values).all(axis=1)]
    assert used[-1] - used[0] >= 2.0


def test_labels_that_the_model_does_not_know_are_named(tmp_path, data):
    study(tmp_path, data, ["ik"])
    file = tmp_path / "study.toml"
    file.write_text(file.read_text().replace('"Left_Illiac"', '"Left_Iliac"'))
    with pytest.raises(
        BadFile, match=r"labels: unknown marker 'Left_Iliac': mouse\.osim has 'Left_Illiac'"
    ):
        read_plan(file)


def test_two_markers_cannot_have_one_name():
    trial = Trial(
        markers=Markers(np.zeros(1), ("LEFT_HIP", "LeftHIP"), np.zeros((1, 2, 3))),
        source="mouse.c3d",
    )
    with pytest.raises(BadData, match="'LEFT_HIP' and 'LeftHIP' would both be named 'Left_Hip'"):
        with_labels(trial, GAIT_LABELS)
    assert with_labels(trial, {"Nose": "Head", "LeftHIP": "hip"}).markers.names == (
        "LEFT_HIP",
        "hip",
    )
