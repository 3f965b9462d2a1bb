"""EMG of files: raw or envelopes, channels and their muscles, and what is wrong with them."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.sto import write_sto
from myomorph.core.model.errors import BadFile, UnknownName
from myomorph.core.model.series import Table
from myomorph.core.motion.envelope import envelopes
from myomorph.lab.study.inputs.emg import EmgFiles
from myomorph.lab.study.inputs.emg_files import open_emg
from myomorph.lab.study.inputs.emg_names import muscles_of_channels
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.study.inputs.table import settings_of_keys
from myomorph.lab.study.step.step import step_of
from myomorph.lab.study.trial.trial_inputs import TrialFiles, open_trial
from myomorph.lab.study.trial.trial_step import step_provenance

WALK = "rajagopal-walk-emg"
HEAD = "emg\nversion=1\nnRows=3\nnColumns=3\ninDegrees=no\nendheader\ntime\ta\tb\n"


@pytest.fixture(scope="module")
def walker(data):
    return open_model(data(f"{WALK}/subject_walk_scaled.osim"))


@pytest.fixture
def raw(tmp_path):
    """Write a file with a minute of noise of 1 kHz whose amplitude rises and falls."""
    time = np.arange(4000) / 1000.0
    noise = (
        np.random.default_rng(4).normal(size=(len(time), 2)) * (1.2 + np.sin(3.0 * time))[:, None]
    )
    table = Table(time, ("soleus_r", "CH7"), 1e-3 * noise)
    write_sto(table, tmp_path / "raw.sto")
    return tmp_path / "raw.sto", table


def test_settings_of_envelopes_belong_to_what_tensions_are_made_from(data, walker, raw):
    """So that a run which is taken up again sees that they changed."""
    path, _ = raw
    files = TrialFiles(
        data(f"{WALK}/subject_walk_scaled.osim"),
        inputs=settings_of_keys({"motion": data(f"{WALK}/coordinates.sto"), "emg": path}),
    )

    def key(step, **given):
        return step_provenance(step_of(step), open_trial(files, {"tension": given}, walker)).key

    assert key("tension", emg_cutoff=6.0) == key("tension", emg_cutoff=6.0)
    assert key("tension", emg_cutoff=6.0) != key("tension", emg_cutoff=3.0)
    assert key("muscles", emg_cutoff=6.0) == key("muscles", emg_cutoff=3.0)


def test_channels_find_their_muscles(walker):
    channels = ("soleus_r", " vas_lat_l_activation", "bifemlh_r", "soleus", "CH1", "glut_med_l")
    assert muscles_of_channels(channels, walker) == {
        "soleus_r": ("soleus_r",),
        " vas_lat_l_activation": ("vaslat_l",),
        "bifemlh_r": ("bflh_r",),
        "glut_med_l": ("glmed1_l", "glmed2_l", "glmed3_l"),
    }
    assert muscles_of_channels(
        ("Voltage.R Tib Ant", "R_TA", "gluteus_maximus_r", "biceps_femoris"), walker, "left"
    ) == {
        "Voltage.R Tib Ant": ("tibant_r",),
        "R_TA": ("tibant_r",),
        "gluteus_maximus_r": ("glmax1_r", "glmax2_r", "glmax3_r"),
        "biceps_femoris": ("bflh_l",),
    }


def test_envelopes_of_any_scale(tmp_path, walker):
    (tmp_path / "small.sto").write_text(HEAD + "0\t0.1\t0.2\n1\t0.5\t-0.1\n2\t0.9\t1.1\n")
    (tmp_path / "large.sto").write_text(HEAD + "0\t10\t2\n1\t50\t1\n2\t90\t4\n")
    small = open_emg(EmgFiles(emg=tmp_path / "small.sto"), walker)
    np.testing.assert_allclose(small.emg["b"], [0.2, 0.0, 1.1])
    assert any("'b' is negative" in note for note in small.notes)
    large = open_emg(EmgFiles(emg=tmp_path / "large.sto"), walker)
    np.testing.assert_allclose(large.emg["a"], [1 / 9, 5 / 9, 1.0])
    np.testing.assert_allclose(large.emg["b"], [0.5, 0.25, 1.0])
    assert any("scaled to its own largest" in note for note in large.notes)


def test_channels_that_take_no_part_are_named(tmp_path, walker):
    rows = "0\t0.1\t0.2\n1\t0.5\t0.1\n1\t0.9\t0.1\n"
    (tmp_path / "part.sto").write_text(HEAD.replace("\ta\tb", "\tsoleus_r\tb") + rows)
    found = open_emg(EmgFiles(emg=tmp_path / "part.sto"), walker)
    assert any(note.startswith("EMG of b is not used") for note in found.notes)
    assert any("time does not increase" in note for note in found.notes)


def test_raw_channels_become_envelopes(raw, walker):
    path, table = raw
    found = open_emg(EmgFiles(emg=path, emg_muscles={"CH7": ("tibant_r",)}), walker)
    np.testing.assert_allclose(found.emg.values, envelopes(table).values, atol=1e-6)
    assert found.muscles == {"soleus_r": ("soleus_r",), "CH7": ("tibant_r",)}
    assert "raw EMG" in found.notes[0]


def test_a_reference_scales_raw_channels(raw, walker, tmp_path):
    path, table = raw
    write_sto(Table(table.time, table.names, 2.0 * table.values), tmp_path / "mvc.sto")
    own = open_emg(EmgFiles(emg=path), walker)
    by_reference = open_emg(EmgFiles(emg=path, emg_mvc=(tmp_path / "mvc.sto",)), walker)
    np.testing.assert_allclose(by_reference.emg.values, 0.5 * own.emg.values, rtol=1e-6)


def test_a_dead_raw_channel_is_named_and_unknown(raw, walker, tmp_path):
    _, table = raw
    values = table.values.copy()
    values[1000:2000, 1] = 0.0
    write_sto(Table(table.time, table.names, values), tmp_path / "dead.sto")
    found = open_emg(EmgFiles(emg=tmp_path / "dead.sto"), walker)
    assert any("'CH7' does not change from" in note for note in found.notes)
    assert np.isnan(found.emg["CH7"][1500])
    assert np.isfinite(found.emg["soleus_r"]).all()


def test_what_does_not_exist_is_named(raw, walker, tmp_path):
    path, _ = raw
    with pytest.raises(UnknownName, match="'CH8'"):
        open_emg(EmgFiles(emg=path, emg_muscles={"CH8": ("soleus_r",)}), walker)
    with pytest.raises(UnknownName, match="'soleous_r'"):
        open_emg(EmgFiles(emg=path, emg_muscles={"CH7": ("soleous_r",)}), walker)
    with pytest.raises(BadFile, match="holds no EMG"):
        open_emg(EmgFiles(emg=tmp_path / "emg.xlsx"), walker)


def test_noise_of_a_real_recording_takes_no_part(data, walker):
    """The right gastrocnemius of the child of Plug-in Gait.

    The electrodes of tibialis posterior are on nobody.
    """
    path = data("c3d-gait-plugingait/HC030A/Straight/HC030A05.c3d")
    opened = open_emg(EmgFiles(emg=path), walker)
    noise = [text for text in opened.notes if "noise throughout" in text]
    assert any("Voltage.R Gast" in text and "is not used" in text for text in noise)
    assert "Voltage.R Gast" not in opened.muscles
    assert {"Voltage.L Gast", "Voltage.R Hams", "Voltage.L Tib Ant"} <= set(opened.muscles)
    # Who names its muscles has seen it.
    named = open_emg(EmgFiles(emg=path, emg_muscles={"Voltage.R Gast": ("gasmed_r",)}), walker)
    assert named.muscles["Voltage.R Gast"] == ("gasmed_r",)
    assert any("is used, as its muscles are named" in text for text in named.notes)


@pytest.mark.parametrize("offset", [-0.02, 0.05])
def test_raw_channels_with_an_offset_are_raw(raw, walker, tmp_path, offset):
    path, table = raw
    write_sto(Table(table.time, table.names, table.values + offset), tmp_path / "offset.sto")
    found = open_emg(
        EmgFiles(emg=tmp_path / "offset.sto", emg_muscles={"soleus_r": ("soleus_r",)}), walker
    )
    plain = open_emg(EmgFiles(emg=path, emg_muscles={"soleus_r": ("soleus_r",)}), walker)
    assert any("raw EMG" in note for note in found.notes)
    np.testing.assert_allclose(found.emg["soleus_r"], plain.emg["soleus_r"], atol=0.02)


def test_rectified_channels_are_not_raw(raw, walker, tmp_path):
    _, table = raw
    write_sto(Table(table.time, table.names, np.abs(table.values)), tmp_path / "rectified.sto")
    found = open_emg(
        EmgFiles(emg=tmp_path / "rectified.sto", emg_muscles={"soleus_r": ("soleus_r",)}), walker
    )
    assert any("rectified" in note for note in found.notes)
    assert not any("made into envelopes" in note for note in found.notes)
