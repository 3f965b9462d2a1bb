"""The command `simulate`: what it writes, what if, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.sto import read_sto
from myomorph.forward.folder import remake_report, simulations_of
from myomorph.lab.cli.program import main
from myomorph.lab.store.results import read_result

ARM = "opensim-reference-small/arm26_bounds.osim"


def run(*words):
    return main([str(word) for word in words])


def test_an_arm_falls_and_its_tables_are_whole(data, tmp_path, capsys):
    out = tmp_path / "fall"
    model = data(ARM)
    assert run("simulate", "--model", model, "--seconds", 0.2, "--certify", "--out", out) == 0
    printed = capsys.readouterr().out
    assert "energy error" in printed
    assert "With half the tolerance" in printed
    moved = read_sto(out / "coordinates.mot")
    assert moved.in_degrees
    assert set(moved.names) == {"r_shoulder_elev", "r_elbow_flex"}
    energy = read_sto(out / "energy.sto")
    residual = energy.values[:, energy.names.index("residual")]
    kinetic = energy.values[:, energy.names.index("kinetic")]
    assert np.abs(residual).max() < 1e-5 * kinetic.max()
    stored = read_result(out / "simulation.nc")
    assert stored.provenance["simulate"].sources[0].role == "model"
    assert stored.values["muscle_force"].shape == (21, 6)
    assert "<h2" in (out / "report.html").read_text(encoding="utf-8")


def test_what_if_moves_both_bodies_side_by_side(data, tmp_path, capsys):
    out = tmp_path / "weaker"
    model = data(ARM)
    words = ("--weaker", "BRA=0.5", "--mass", "r_ulna_radius_hand=1.5")
    assert run("simulate", "--model", model, "--seconds", 0.2, *words, "--out", out) == 0
    assert "changed minus unchanged at the end" in capsys.readouterr().out
    assert {path.name for path in out.iterdir()} == {"unchanged", "changed", "report.html"}
    recordings = simulations_of(out)
    assert list(recordings) == ["unchanged and changed", "unchanged", "changed"]
    both = recordings["unchanged and changed"]()
    assert both.model.bodies[-1].name == "changed_r_ulna_radius_hand"
    alone = recordings["changed"]()
    heavier = alone.model.body("r_ulna_radius_hand").mass
    assert heavier == pytest.approx(1.5 * both.model.body("unchanged_r_ulna_radius_hand").mass)
    assert alone.model.muscle("BRA").max_isometric_force == pytest.approx(
        0.5 * both.model.muscle("unchanged_BRA").max_isometric_force
    )
    before = (out / "report.html").read_text(encoding="utf-8")
    assert remake_report(out) == out / "report.html"
    assert len((out / "report.html").read_text(encoding="utf-8")) == len(before)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--weaker", "BRAX=0.5"), "BRA"),
        (("--mass", "ulna"), "BODY=FACTOR"),
        (("--viscosity", "2"), "no viscosity to change"),
        (("--seconds", "-1"), "expected a time above 0"),
        (("--follow", "5"), "--start"),
        (("--activations", "nothing.sto"), "nothing.sto"),
    ],
)
def test_bad_input_is_named_and_nothing_is_written(data, tmp_path, capsys, words, said):
    out = tmp_path / "out"
    assert run("simulate", "--model", data(ARM), *words, "--out", out) == 2
    printed = capsys.readouterr().err
    assert said in printed
    assert len(printed.strip().splitlines()) == 1
    assert not out.exists()
