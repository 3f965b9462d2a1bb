"""`myomorph refine`: what it writes, and what it says of bad input."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.inertia import inertial_parameters, pseudo_inertias

OPENCAP = "opencap-subject4-multitask"


def test_each_recording_needs_its_forces(command, tmp_path):
    told = command(
        "refine",
        "--model",
        "a.osim",
        "--markers",
        "a.trc",
        "b.trc",
        "--loads",
        "a.mot",
        "--out",
        tmp_path / "r.osim",
    )
    assert told.status == 2
    assert "2 recordings of markers and 1 files of forces" in told.err


@pytest.mark.long
def test_a_walk_is_refined(command, data, tmp_path):
    folder = data(OPENCAP)
    out = tmp_path / "refined.osim"
    told = command(
        *(
            "refine",
            "--model",
            folder / "models" / "manually_scaled.osim",
            "--mass",
            62.6,
            "--no-check",
        ),
        *("--markers", folder / "markers" / "walking1.trc", "--time", 0.2, 1.1, "--iterations", 3),
        *("--loads", folder / "grf" / "walking1_external_forces.xml", "--out", out),
    )
    assert told.status == 0, told.err
    assert "1 trial: markers" in told.out
    model = read_osim(out)
    assert model.mass == pytest.approx(62.6, rel=1e-6)
    moving = inertial_parameters(model)
    moving = moving[moving[:, 0] > 1e-3]
    assert (np.linalg.eigvalsh(pseudo_inertias(moving))[:, 0] > 0.0).all()
    beside = tmp_path / "refined_refinement"
    assert {
        "motions",
        "error_sizes.csv",
        "trials.csv",
        "masses.csv",
        "lengths.csv",
        "soft_tissue.csv",
        "report.html",
        "provenance.json",
    } == {one.name for one in beside.iterdir()}
    before, after = csv.DictReader((beside / "trials.csv").read_text().splitlines())
    assert float(after["force_N"]) < 0.5 * float(before["force_N"])
    assert float(after["moment_N_m"]) < 0.6 * float(before["moment_N_m"])
    assert float(after["markers_mm"]) < 1.1 * float(before["markers_mm"])
    torques = command(
        *("id", "--model", out, "--motion", beside / "motions" / "walking1.mot"),
        *(
            "--loads",
            folder / "grf" / "walking1_external_forces.xml",
            "--cutoff",
            6,
            "--out",
            tmp_path / "torques.sto",
        ),
    )
    assert torques.status == 0, torques.err


@pytest.mark.long
def test_the_clock_of_a_walk_is_found_where_it_is_asked_for(command, data, tmp_path):
    """Forces that come 20 ms late are moved back, and trials of the folder say by how much."""
    folder = data(OPENCAP)
    offsets = {}
    for shift in (0.0, -0.02):
        out = tmp_path / f"refined_{abs(shift):g}.osim"
        told = command(
            *("refine", "--model", folder / "models" / "manually_scaled.osim", "--mass", 62.6),
            *("--markers", folder / "markers" / "walking1.trc", "--time", 0.2, 1.1),
            *("--loads", folder / "grf" / "walking1_external_forces.xml"),
            *("--force-checks", "report", "--force-shift", shift, "--no-check"),
            *("--fit", "masses", "clock", "--out", out),
        )
        assert told.status == 0, told.err
        tables = out.with_name(f"{out.stem}_refinement")
        (row,) = csv.DictReader((tables / "clocks.csv").read_text().splitlines())
        assert (row["trial"], row["identifiable"]) == ("walking1", "yes")
        offsets[shift] = float(row["offset_s"])
        assert f"--force-shift {offsets[shift]:.4f}"[:-2] in told.out
        # Lengths stay as given, so that no factor differs from 1.
        factors = csv.DictReader((tables / "lengths.csv").read_text().splitlines())
        assert {float(row["factor"]) for row in factors} == {1.0}
    assert offsets[-0.02] - offsets[0.0] == pytest.approx(0.02, abs=0.004)
