"""What a user specifies of contacts: one word, a table, or a file of sites.

What is wrong is reported at once.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io.wavfile import write as write_wav

from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.contacts import Contacts, Site
from myomorph.core.model.errors import BadFile
from myomorph.core.tension.contact_setting import unreported_feet
from myomorph.lab.study.inputs.contact_file import contact_files, read_contacts

SITE = """
[[site]]
name = "hand"
body = "fore"
points = [[0.0, -0.28, 0.0]]
"""


@pytest.fixture
def model(arm):
    return read_osim(arm.model)


def written(folder, text, name="contacts.toml"):
    (folder / name).write_text(text)
    return folder / name


def test_auto_asks_for_soles_alone(model):
    plan = read_contacts("auto", model, "hidden")
    assert (plan.feet, plan.sites, plan.reported, plan.measured) == (True, (), None, "hidden")


def test_a_table_tells_touches(model, tmp_path):
    path = written(tmp_path, "site,start,stop\nheel_r,0.1,0.4\nheel_r,0.6,0.9\n", "taps.csv")
    plan = read_contacts(path, model)
    assert [(one.site, one.start, one.stop) for one in plan.reported.intervals] == [
        ("heel_r", 0.1, 0.4),
        ("heel_r", 0.6, 0.9),
    ]
    assert contact_files(path) == (path,)


def test_a_file_of_sites(model, tmp_path):
    taps = written(tmp_path, "frame,site,event\n150,hand,touch\n300,hand,leave\n", "taps.csv")
    text = (
        'feet = false\nmeasured = "shared"\nintervals = "taps.csv"\n[camera]\nrate = 300.0\nstart ='
        " 1.0\n"
        + SITE.replace("[[site]]", '[[site]]\nintervals = "file"\ndirection = "any"\ngrip = 0.05')
        + SITE.replace('"hand"', '"elbow"').replace(
            "points", "intervals = [[0.0, 0.5]]\nfriction = inf\npoints"
        )
        + SITE.replace('"hand"', '"wrist"').replace(
            "points", 'direction = [0.0, 0.0, 2.0]\nframe = "upper"\npoints'
        )
    )
    path = written(tmp_path, text)
    plan = read_contacts(path, model)
    hand, elbow, wrist = plan.sites
    assert (plan.feet, plan.measured) == (False, "shared")
    assert hand.cone.direction is None
    np.testing.assert_array_equal(elbow.cone.direction, [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(wrist.cone.direction, [0.0, 0.0, 1.0])
    assert (wrist.cone.frame, np.isinf(elbow.cone.friction)) == ("upper", True)
    assert plan.when == {"hand": "file", "elbow": "file", "wrist": "motion"}
    assert [(one.site, one.start, one.stop) for one in plan.reported.intervals] == [
        ("elbow", 0.0, 0.5),
        ("hand", 1.5, 2.0),
    ]
    assert contact_files(path) == (path, taps)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (SITE.replace('"fore"', '"fora"'), "site 'hand': unknown body 'fora'"),
        (SITE.replace("points", "point"), "unknown key 'site.1.point'"),
        (SITE + "friction = -1\n", "friction of a contact is -1"),
        ('intervals = "tap.csv"\n' + SITE, "intervals file 'tap.csv' does not exist"),
        (SITE + 'intervals = "sometimes"\n', "intervals"),
        ('measured = "maybe"\n', "'measured' = 'maybe'"),
        (SITE.replace('"hand"', '""'), "'site.1.name' = ''"),
        (SITE + "rests = nan\n", "'site.1.rests' = nan"),
        (
            SITE + "intervals = [[0.4, 0.2]]\n",
            "site 'hand': intervals = .*expected a start before an end",
        ),
        ("[camera]\nstart = nan\n" + SITE, "'camera.start' = nan"),
    ],
)
def test_what_is_wrong_is_named(model, tmp_path, text, told):
    with pytest.raises(BadFile, match=told.replace("'", ".")):
        read_contacts(written(tmp_path, text), model)


def test_sound_needs_instruments_and_strokes_of_known_impulse(model, tmp_path):
    sound = '[sound]\nfile = "drums.wav"\n'
    with pytest.raises(BadFile, match=r"sound file 'drums\.wav' does not exist"):
        read_contacts(written(tmp_path, sound + SITE), model)
    write_wav(tmp_path / "drums.wav", 48000, np.zeros((4800, 1), np.int16))
    with pytest.raises(BadFile, match=r"needs \[\[instrument\]\] tables"):
        read_contacts(written(tmp_path, sound + SITE), model)
    snare = '[[instrument]]\nname = "snare"\nsites = ["hand"]\n'
    with pytest.raises(BadFile, match="no impacts of known impulse"):
        read_contacts(written(tmp_path, sound + snare + SITE), model)
    plan = read_contacts(written(tmp_path, sound + 'impulse = "motion"\n' + snare + SITE), model)
    assert plan.sound.instruments[0].sites == ("hand",)


def test_names_that_end_otherwise_are_refused(model, tmp_path):
    with pytest.raises(BadFile, match=r"expected auto, none, \.csv or \.toml"):
        read_contacts(tmp_path / "contacts.json", model)


def test_a_file_that_is_not_there_tells_what_is(tmp_path):
    written(tmp_path, SITE, "seat.toml")
    with pytest.raises(
        BadFile, match=r"is no file; expected auto, none, \.csv or \.toml; .* has 'seat\.toml'"
    ):
        contact_files(tmp_path / "seet.toml")


def test_touches_of_another_clock_are_named(arm, command, tmp_path):
    path = written(tmp_path, "feet = false\n" + SITE + "intervals = [[900.0, 901.0]]\n")
    done = command(
        "tension",
        "--model",
        arm.model,
        "--motion",
        arm.motion,
        "--contacts",
        path,
        "--out",
        arm.out,
    )
    assert done.status == 0
    assert "'hand' is specified to touch from 900 s to 901 s" in done.err


def test_soles_that_a_table_leaves_out_are_named():
    told = Contacts(("heel_r",), ())
    soles = [Site(name, "foot", np.zeros((1, 3))) for name in ("heel_r", "toe_r")]
    assert unreported_feet(told, soles) == (
        "no contact interval is specified for toe_r: found from the motion",
    )
    assert unreported_feet(Contacts(("hand",), ()), soles) == ()


@pytest.mark.parametrize(
    "told", [("--measured", "hidden"), ("--measured", "shared", "--contacts", "auto")]
)
def test_what_plates_are_for_needs_contacts_and_plates(arm, command, told):
    done = command("tension", "--model", arm.model, "--motion", arm.motion, *told, "--out", arm.out)
    assert done.status == 2
    assert f"--measured {told[1]} without" in done.err
    assert not arm.out.exists()


def test_a_model_without_feet_needs_sites(arm, command):
    done = command(
        "tension",
        "--model",
        arm.model,
        "--motion",
        arm.motion,
        "--contacts",
        "auto",
        "--out",
        arm.out,
    )
    assert done.status == 2
    assert "no contact site" in done.err
    assert not arm.out.exists()


def test_touches_of_a_site_that_does_not_exist(arm, command, tmp_path):
    taps = written(tmp_path, "site,start,stop\nheel_r,0.1,0.4\n", "taps.csv")
    path = written(tmp_path, f'feet = false\nintervals = "{taps.name}"\n' + SITE)
    done = command(
        "tension",
        "--model",
        arm.model,
        "--motion",
        arm.motion,
        "--contacts",
        path,
        "--out",
        arm.out,
    )
    assert done.status == 2
    assert "'heel_r'" in done.err
    assert "hand" in done.err
