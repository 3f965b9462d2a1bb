"""`mm.analyze`: what the command writes, as values."""

from __future__ import annotations

import numpy as np
import pytest

import myomorph as mm
from myomorph.lab.cli import main


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Write a short simulated walk and its model."""
    folder = tmp_path_factory.mktemp("recordings")
    walk = mm.sample("walk")
    files = walk.write(folder / "model")
    short = mm.cut(walk.markers, 0.0, 2.6)
    home = folder / "trials"
    home.mkdir()
    mm.write_trc(short, home / "simulated_walk.trc")
    for part in (files.loads, files.loads.with_suffix(".mot")):
        (home / part.name).write_bytes(part.read_bytes())
    return home, files.model


@pytest.fixture(scope="module")
def analysis(recordings, tmp_path_factory):
    home, model = recordings
    out = tmp_path_factory.mktemp("python") / "walk"
    return mm.analyze(home, out, mass=70.0, model=model)


def test_results_are_values(analysis):
    assert "1 trial" in repr(analysis)
    trial = analysis.trial
    assert trial is next(iter(analysis.trials.values()))
    assert trial.tension.muscle_force.shape[1] == len(trial.model.muscles) == 86
    assert analysis.failed == {}
    assert any("70" in text or "simulated" in text for text in analysis.assumed) or analysis.assumed


def test_pages_and_files_are_named(analysis):
    assert analysis.study.name == "study.toml"
    assert analysis.page.is_file()
    (page,) = analysis.reports.values()
    assert page.is_file()
    assert analysis.session.trials[0].movement.value == "walking"


def test_values_of_all_trials_are_a_table(analysis):
    pytest.importorskip("pandas")
    table = analysis.to_pandas()
    knee = table[table.quantity == "knee_angle_r, maximum"].value.item()
    degrees = np.degrees(analysis.trial.fit.motion["knee_angle_r"].max())
    assert knee == pytest.approx(degrees, abs=0.01)


def test_strides_of_a_trial_are_those_that_the_walk_took(analysis):
    truth = mm.sample("walk")
    knee = analysis.trial.strides("coordinate_value")
    true = truth.truth["coordinate_value"].strides(truth.events)
    count = len(knee["knee_angle_r"])
    assert count >= 1
    error = np.degrees(knee["knee_angle_r"] - true["knee_angle_r"][:count])
    # The model was calibrated to noisy markers.
    assert np.sqrt(np.mean(error**2)) < 3.0
    force = analysis.trial.strides("muscle_force")
    assert set(force.units) == {"N"}
    assert force["soleus_r"].shape == (count, 101)


def test_the_command_writes_the_same(recordings, analysis, tmp_path, capsys):
    home, model = recordings
    out = tmp_path / "command"
    words = ["analyze", str(home), "--mass", "70", "--model", str(model), "--out", str(out)]
    assert main(words) == 0
    (by_command,) = mm.load(out).values()
    np.testing.assert_array_equal(by_command.tension.activation, analysis.trial.tension.activation)
    names = {path.relative_to(out) for path in out.rglob("*") if path.is_file()}
    assert names == {
        path.relative_to(analysis.folder) for path in analysis.folder.rglob("*") if path.is_file()
    }


def test_more_than_one_trial_is_not_the_only_one(analysis):
    two = {"a": analysis.trial, "b": analysis.trial}
    several = mm.Analysis(
        folder=analysis.folder,
        recordings=analysis.recordings,
        study=analysis.study,
        assumed=(),
        outcomes=(),
    )
    several.__dict__["trials"] = two
    with pytest.raises(mm.BadData, match="2 trials"):
        _ = several.trial


def test_a_folder_without_recordings_is_answered_as_on_the_command_line(tmp_path):
    with pytest.raises(mm.MyomorphError):
        mm.analyze(tmp_path, tmp_path / "out")
