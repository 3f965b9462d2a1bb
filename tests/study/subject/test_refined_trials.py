"""Trials of a subject that was refined go on with the refined motion, on a real walk."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import read_sto, table_from_motion, write_sto
from myomorph.core.model.errors import BadFile
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.model.soft_tissue import SoftTissue, coordinate_groups
from myomorph.lab.report.trial.identification_tables import tissue_sheet
from myomorph.lab.store.results import read_result
from myomorph.lab.study.inputs import refined
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study

OPENCAP = "opencap-subject4-multitask"
STUDY = """
[study]
name = "refined"
[[subject]]
name = "s4"
model = "{folder}/models/manually_scaled.osim"
mass = 62.6
time = [0.3, 1.0]
trials = [{{ markers = "{folder}/markers/walking1.trc", \
loads = "{folder}/grf/walking1_external_forces.xml" }}]
steps = ["ik", "refine", "id"]
[options.refine]
check = false
iterations = 3
use_motions = {use}
"""
AGAIN = """
[[subject]]
name = "again"
model_of = "s4"
mass = 62.6
time = [0.35, 0.95]
trials = [{{ markers = "{folder}/markers/walking1.trc", \
loads = "{folder}/grf/walking1_external_forces.xml" }}]
steps = ["ik", "refine", "id"]
options = {{ refine = {{ fit = [], iterations = 3 }} }}
"""


def run(folder, home, use, more=""):
    path = home / "study.toml"
    options = STUDY.index("[options.refine]")
    path.write_text((STUDY[:options] + more + STUDY[options:]).format(folder=folder, use=use))
    return run_study(read_plan(path), home / "results")


def residual(path):
    """Root mean square of the force and the moment that are left at the pelvis [N], [N m]."""
    table = read_sto(path)
    parts = {
        "force": ("tx_force", "ty_force", "tz_force"),
        "moment": ("tilt_moment", "list_moment", "rotation_moment"),
    }
    middle = slice(len(table.time) // 4, -len(table.time) // 4)
    return [
        float(np.sqrt(sum((table[f"pelvis_{name}"][middle] ** 2).mean() for name in names)))
        for names in parts.values()
    ]


def one_body(folder):
    """Write a trunk with an arm as a file."""
    ball = '<geom type="sphere" size=".1" mass="1"/>'
    arm = f'<body name="arm" pos="0 0 .3"><joint name="shoulder" axis="1 0 0"/>{ball}</body>'
    path = folder / "body.xml"
    path.write_text(
        f'<mujoco><worldbody><body name="trunk"><freejoint/>{ball}{arm}</body></worldbody></mujoco>'
    )
    return path


def test_markers_lie_where_soft_tissue_has_them(tmp_path):
    """A refined motion is that of the mass.

    Its marker errors are of q - alpha q'', here q (1 + alpha w^2).
    """
    model = read_model(one_body(tmp_path))
    time = np.arange(0.0, 2.0, 0.005)
    w = 12.0
    alpha = 5e-4
    values = 0.3 * np.sin(w * time)[:, None] * np.ones(len(model.coordinates))
    path = tmp_path / "motions" / "walk.mot"
    path.parent.mkdir()
    write_sto(table_from_motion(Motion(time, model.coordinate_names, values), model), path)
    opening = SimpleNamespace(model=model, values={})
    assert refined._open(refined.RefinedFile(path, 6.0), opening).values[0].tissue is None
    count = len(model.coordinates)
    tissue = SoftTissue(
        names=model.coordinate_names,
        groups=coordinate_groups(model),
        alpha=np.full(count, alpha),
        sd=np.zeros(count),
    )
    (tmp_path / "soft_tissue.csv").write_text(tissue_sheet(tissue).csv())
    of_markers = refined._open(refined.RefinedFile(path, 6.0), opening).values[0].of_markers
    np.testing.assert_allclose(of_markers[20:-20], (1.0 + alpha * w**2) * values[20:-20], atol=1e-3)


def test_forces_move_by_the_clock_that_was_found(tmp_path):
    """The trial's own line in clocks.csv counts; a table without it is refused."""
    model = read_model(one_body(tmp_path))
    time = np.arange(0.0, 1.0, 0.01)
    values = np.zeros((len(time), len(model.coordinates)))
    motion = Motion(time, model.coordinate_names, values)
    path = tmp_path / "motions" / "a_walk.mot"
    path.parent.mkdir()
    write_sto(table_from_motion(motion, model), path)
    force = np.sin(5.0 * time)[:, None, None] * [0.0, 700.0, 0.0]
    wrenches = Wrenches(
        time=time,
        names=("plate",),
        bodies=("trunk",),
        forces=force,
        points=np.zeros_like(force),
        torques=np.zeros_like(force),
    )
    loads = ExternalLoads.on_known_bodies(lambda moved: wrenches)
    opening = SimpleNamespace(model=model, values={ExternalLoads: loads})

    def times():
        found = refined._open(refined.RefinedFile(path, 6.0), opening).values[1]
        return found.of(motion).time

    np.testing.assert_array_equal(times(), time)
    head = "trial,offset_s,low_s,high_s,shown\n"
    (tmp_path / "clocks.csv").write_text(head + "other,0.5,0,1,no\na walk,0.012,0.01,0.014,yes\n")
    np.testing.assert_allclose(times(), time + 0.012)
    (tmp_path / "clocks.csv").write_text(head + "other,0.5,0,1,no\n")
    with pytest.raises(BadFile, match="no clock of 'a_walk'"):
        times()


def _refined_coordinates(folder):
    """Check that a trial has the refined motion, and return it."""
    refined = read_sto(folder / "refinement" / "motions" / "walking1.mot")
    used = read_sto(folder / "walking1" / "coordinates.mot")
    np.testing.assert_allclose(used.values, refined.values, atol=1e-6)
    return used


@pytest.mark.long
def test_trials_use_the_refined_motion_and_its_forces(data, tmp_path):
    folder = data(OPENCAP)
    subject, trial, other, its_trial = run(folder, tmp_path, "true", AGAIN)
    assert (subject.error, trial.error, other.error, its_trial.error) == ("", "", "", "")
    home = tmp_path / "results" / "s4"
    used = _refined_coordinates(home)
    plain = read_sto(home / "walking1" / "coordinates_ik.mot")
    assert 0.1 < np.abs(used.values - plain.values).max() < 30.0
    left = residual(home / "walking1" / "torques.sto")
    # What `refine` itself says is left: the trial's inverse dynamics has the same motion, forces
    # and masses.
    last = (home / "refinement" / "trials.csv").read_text().splitlines()[-1].split(",")
    assert left[0] < 1.5 * float(last[-2])
    assert (
        "refined together with body"
        in read_result(home / "walking1" / "walking1.nc").facts["notes"]
    )

    # A new recording of that body: only its motion is refined.
    later = tmp_path / "results" / "again"
    first = read_osim(home / "refined.osim")
    second = read_osim(later / "refined.osim")
    assert [one.mass for one in first.bodies] == pytest.approx(
        [one.mass for one in second.bodies], rel=1e-9
    )
    for one, same in zip(first.markers, second.markers, strict=True):
        np.testing.assert_allclose(one.location, same.location, atol=1e-9)
    _refined_coordinates(later)

    again = run(folder, tmp_path, "true")
    assert [one.reused for one in again] == [("refine",), ("ik", "id")]
    subject, trial = run(folder, tmp_path, "false")
    assert (subject.reused, trial.reused) == (("refine",), ())
    assert any("refined motion" in text for text in trial.changed)
    np.testing.assert_allclose(
        read_sto(home / "walking1" / "coordinates.mot").values[:, 6:], plain.values[:, 6:]
    )
    after = residual(home / "walking1" / "torques.sto")
    assert after[0] > 1.5 * left[0]
