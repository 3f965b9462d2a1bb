"""`norms`: results of a control group become a file that walks are held against."""

from __future__ import annotations

import numpy as np
import pytest

from made_walker import recording, walker
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.trc import write_trc
from myomorph.lab.analysis.gait_curves import KEYS
from myomorph.lab.cli import main
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.trial.norm_file import read_norms

PEOPLE = {"c1": 24, "c2": 31, "c3": 42}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Make results of three people who walk alike."""
    home = tmp_path_factory.mktemp("controls")
    write_osim(walker(), home / "walker.osim")
    text = '[study]\nname = "controls"\n'
    for seed, (name, age) in enumerate(PEOPLE.items()):
        write_trc(recording(walker(), np.random.default_rng(seed), 0.5), home / f"{name}.trc")
        text += (
            f'[[subject]]\nname = "{name}"\nmodel = "walker.osim"\nage = {age}\n'
            f'trials = ["{name}.trc"]\nsteps = ["ik"]\n'
        )
    (home / "study.toml").write_text(text)
    outcomes = run_study(read_plan(home / "study.toml"), home / "out")
    assert [outcome.error for outcome in outcomes] == [""] * 3
    return home / "out"


def test_a_control_group_becomes_a_norm_that_walks_are_held_against(results, tmp_path, capsys):
    table = tmp_path / "controls.csv"
    folders = [str(results / name) for name in PEOPLE]
    assert main(["norms", *folders, "--out", str(table)]) == 0
    assert "3 people (c1, c2, c3)" in capsys.readouterr().out
    (norm,) = read_norms(table)
    assert norm.persons == 3
    assert norm.ages == (24.0, 42.0)
    assert np.isfinite(norm.mean[:, KEYS.index("knee_flexion")]).all()
    assert {"Walking speed", "Stride length"} <= set(norm.parameters)
    assert main(["report", str(results / "c1" / "c1"), "--norms", str(table)]) == 0
    page = (results / "c1" / "c1" / "gait.html").read_text("utf-8")
    assert "own control group: c1, c2, c3; 3 persons" in page
    assert 'class="band norm"' in page


def test_what_is_no_control_group_is_refused(results, tmp_path, capsys):
    few = [str(results / name) for name in ("c1", "c2")]
    assert main(["norms", *few, "--out", str(tmp_path / "n.csv")]) == 2
    assert "2 persons" in capsys.readouterr().err
    assert main(["norms", *few, "--out", str(tmp_path / "n.txt")]) == 2
    assert main(["norms"]) == 2
    assert not list(tmp_path.iterdir())
