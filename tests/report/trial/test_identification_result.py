from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse

from myomorph.body.identify.recordings import RecordingOptions, usable
from myomorph.body.identify.subject import Identification, IdentificationOptions, identify
from myomorph.body.identify.validation import COMPONENTS, CrossValidation, cross_validate
from myomorph.body.shape.points import MassPoints, links_of
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.lab.report.trial.identification import identification_sections
from myomorph.lab.report.trial.identification_tables import identification_tables
from myomorph.lab.report.trial.report_input import IdentificationInput
from myomorph.lab.study.inputs.external_forces import read_loads
from myomorph.lab.study.inputs.reading import open_model, read_motion


def balls(model: Model) -> MassPoints:
    """Eight points around the mass center of every body, at its radii of gyration."""
    links = links_of(model, Motion(np.zeros(1), (), np.zeros((1, 0))))
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    points = []
    owners = []
    masses = []
    for i, body in enumerate(model.bodies):
        second = np.maximum(0.5 * np.trace(body.inertia) - np.diag(body.inertia), 1e-6 * body.mass)
        points.append(
            links.centers[i] + corners * np.sqrt(second / body.mass) @ links.rotations[i].T
        )
        owners += [i] * 8
        masses += [body.mass / 8] * 8
    weights = sparse.csr_array((np.ones(len(owners)), (np.arange(len(owners)), owners)))
    return MassPoints(
        points=np.concatenate(points),
        reference=np.array(masses),
        weights=weights,
        links=links,
        spacing=0.005,
        source="eight points a body",
    )


@pytest.fixture(scope="module")
def found(data: Callable[[str], Path]) -> tuple[Identification, CrossValidation]:
    folder = data("opensim-gait-subject01") / "ref_id"
    model = open_model(folder / "subject01.osim")
    motion = read_motion(folder / "subject01_walk1_ik.mot", model)
    loads = read_loads(folder / "subject01_walk1_grf.xml", model, motion)
    first = usable(
        model, motion, loads, time=(0.6, 1.5), options=RecordingOptions(cutoff=6.0), name="walk"
    )
    second = usable(
        model, motion, loads, time=(1.5, 2.3), options=RecordingOptions(cutoff=6.0), name="walk"
    )
    options = IdentificationOptions(mass_sd=0.2, compare=False)
    identified = identify(model, [first], {"points": balls(model)}, options=options)
    recording = second.recording
    models = {"identified": identified.model, "generic": model}
    return identified, cross_validate(models, recording)


def test_the_report_shows_what_was_identified(
    found: tuple[Identification, CrossValidation],
) -> None:
    identification, validation = found
    tables = identification_tables(identification, {"second half": validation})
    sheet = tables["masses.csv"]
    masses = {row[0]: row[sheet.head.index(f"{identification.chosen} [kg]")] for row in sheet.rows}
    assert masses["Total"] == pytest.approx(identification.model.mass)
    for body in identification.model.bodies:
        assert masses[body.name] == pytest.approx(body.mass)
    assert len(tables["base_parameters.csv"].rows) == len(identification.base.base)
    assert {row[0] for row in tables["misfit.csv"].rows} >= set(identification.parameters)
    faulty = {link.name for link in identification.consistency[identification.chosen].faulty}
    assert {row[0] for row in tables["links.csv"].rows if row[6] == "no"} == faulty


def test_frames_left_out_are_listed(found: tuple[Identification, CrossValidation]) -> None:
    identification, validation = found
    shown = IdentificationInput(identification.model, identification, {"second half": validation})
    body, *_ = identification_sections(shown, {})
    assert "eight points a body" in body.lead
    rows = {grid.title: grid.rows for grid in body.grids}.get("Frames excluded", ())
    assert [row[0] for row in rows] == list(identification.left_out)


def test_errors_are_those_of_the_cross_validation(
    found: tuple[Identification, CrossValidation],
) -> None:
    identification, validation = found
    errors = validation.table()
    sheet = identification_tables(identification, {"second half": validation})[
        "cross_validation.csv"
    ]
    assert len(sheet.rows) == 6 * len(errors)
    for _, component, method, *values in sheet.rows:
        place = COMPONENTS.index(str(component))
        assert values == [
            errors[str(method)][name][place] for name in ("bias", "mean", "rms", "peak", "percent")
        ]
