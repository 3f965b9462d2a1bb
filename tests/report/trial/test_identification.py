import csv
import io
import re
from dataclasses import replace

import numpy as np
import pytest
from lxml import etree, html
from tests.walker import shown

from myomorph.identify.validation import LinkConsistency
from myomorph.model.errors import BadData
from myomorph.model.inertia import inertial_parameters
from myomorph.model.model import Body, Joint, Model
from myomorph.model.segments import segments_of
from myomorph.model.spatial import Transform
from myomorph.report.charts.axis import number
from myomorph.report.trial.identification_tables import (
    ATHLETES,
    identification_tables,
    segment_share,
    spine_groups,
    wrench_errors,
)
from myomorph.report.trial.identified import (
    CalibratedBody,
    IdentificationInput,
    IdentifiedBase,
    LengthFound,
    TrialError,
    WrenchCheck,
)
from myomorph.report.trial.trial_page import report_page
from walker import model as walker

TABLE_3_1 = {
    "identified, w_d": [2.85, 2.12, 1.80, 1.67, 1.61, 1.54, 1.48, 1.25, 1.16, 1.26, 0.97, 0.90, 0.85, 0.76, 0.73,
                        0.61, 0.48, 0.42, 0.39, 0.41, 0.44, 0.59, 0.77, 1.32],
    "identified, w_n": [3.07, 1.87, 1.83, 1.79, 1.22, 1.58, 2.29, 0.83, 1.45, 1.88, 0.67, 0.64, 0.58, 0.43, 0.77,
                        0.57, 0.09, 0.30, 0.12, 0.21, 0.02, 0.35, 0.12, 2.29],
    "shape only": [3.39, 1.89, 2.17, 2.00, 1.72, 1.33, 1.50, 0.67, 1.28, 1.28, 0.61, 0.56, 0.44, 0.28, 0.67, 0.56,
                   0.22, 0.39, 0.11, 0.44, 0.11, 0.50, 0.22, 2.17],
}  # fmt: skip
"""Masses of the vertebrae as [D] table 3.1 prints them, from lumbar 5 to neck 1 [kg]."""

TABLE_3_3 = {
    "Lumbar vertebrae": (0.46, 0.60, 0.60),
    "Rib vertebrae": (0.32, 0.63, 0.42),
    "Neck vertebrae": (0.31, 0.75, 0.63),
}


def spine() -> Model:
    """A chain of the 24 vertebrae of [D]."""
    names = [f"lumbar{i}" for i in range(5, 0, -1)] + [f"thoracic{i}" for i in range(12, 0, -1)]
    names += [f"C{i}" for i in range(7, 0, -1)]
    still = Transform.identity()
    bodies = tuple(Body(name, 1.0, np.zeros(3), np.eye(3)) for name in names)
    joints = tuple(
        Joint(f"to_{name}", "WeldJoint", before, name, still, still)
        for before, name in zip(["ground", *names], names, strict=False)
    )
    return Model("spine", bodies, joints, (), np.array([0.0, -9.81, 0.0]))


def masses_only(body: Model, masses: dict[str, list[float]]) -> IdentificationInput:
    tables = {name: np.column_stack([one, np.zeros((len(one), 9))]) for name, one in masses.items()}
    return IdentificationInput(body, parameters=tables)


def link(name: str, mass: float, least: float, *faults: str) -> LinkConsistency:
    eigenvalues = np.array([least, 1.0, 1.0, mass])
    return LinkConsistency(name, mass, np.zeros(3), np.ones(3), np.ones(3), eigenvalues, None, faults)


def everything() -> IdentificationInput:
    body = walker()
    true = inertial_parameters(body)
    time = np.linspace(0.0, 1.0, 101)
    measured = np.column_stack([np.full(101, 10.0 * k) for k in range(6)])
    measured[50] = np.nan
    predicted = {"identified": measured + [0, 0, 0, 1.0, -2.0, 3.0], "generic": measured + 4.0}
    return IdentificationInput(
        model=body,
        parameters={"identified": true, "generic": 1.1 * true},
        chosen="identified",
        share=np.array([0.9, 0.5, 0.25, np.nan, 0.0]),
        base=IdentifiedBase(
            ("m of all", "m c_x of it"), [60.0, 2.0], [0.001, np.nan], np.array([True, False]), 12.0, 900, np.ones(6)
        ),
        never_shown=("I_xx tibia_l",),
        not_shown=("m c_x of it",),
        checks=(link("pelvis", 36.0, 0.1), link("femur_r", 9.0, -0.2, "center outside <skin>")),
        left_out={"no force": 100},
        frames=1000,
        validation=(WrenchCheck(time, measured, predicted, 588.0, "walk 2"),),
        calibration=CalibratedBody(
            (LengthFound("thigh", 0.40, 0.42, 0.001),), {"RASI": 0.012}, (TrialError("walk 2", 0.02, 0.01),), 50
        ),
    )


def rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_spread_of_spine_masses_as_printed() -> None:
    """[D] table 3.3 follows from table 3.1 with the population's standard deviation, to its printed digits.

    All but the neck by the shape: the masses that are printed have 0.67 where the table prints 0.63.
    """
    sheet = identification_tables(masses_only(spine(), TABLE_3_1))["spine.csv"]
    assert [row[0] for row in sheet.rows] == list(TABLE_3_3)
    for group, _, *spread in sheet.rows:
        printed = np.array(TABLE_3_3[str(group)])
        if group == "Neck vertebrae":
            printed[2] = 0.672
        np.testing.assert_allclose(spread, printed, atol=0.0075)


def test_vertebrae_are_found_by_many_names() -> None:
    names = ["L5", "L4", "T12", "T1", "C7", "C1", "rib12_R", "Abd_L_L1", "lumbar_vertebra_1", "pelvis", "calcn_l"]
    assert spine_groups(names) == {"Lumbar vertebrae": [0, 1, 8], "Rib vertebrae": [2, 3], "Neck vertebrae": [4, 5]}


def test_masses_sum() -> None:
    given = everything()
    *links, total = identification_tables(given)["masses.csv"].rows
    assert total[0] == "Total"
    for column in (1, 2):
        assert total[column] == pytest.approx(sum(row[column] for row in links))  # type: ignore[misc]
    assert total[1] == pytest.approx(60.0)


def test_segments_cover_the_body_once() -> None:
    """Middle and both sides together are the whole body, whatever the masses are."""
    given = everything()
    masses = np.random.default_rng(1).uniform(0.1, 5.0, len(given.model.bodies))
    share = {
        (row, side): segment_share(given, masses, row, side) or 0.0 for row in ATHLETES for side in ("right", "left")
    }
    middle = share["Head", "right"] + share["Body", "right"]
    limbs = sum(share[row, side] for row, side in share if row not in ("Head", "Body", "Upper body", "Lower body"))
    assert middle + limbs == pytest.approx(100.0)
    assert share["Upper body", "right"] + share["Lower body", "right"] == pytest.approx(share["Body", "right"])


def test_athletes_sum_to_all_with_the_body_as_the_sum_of_its_parts() -> None:
    limbs = 2.0 * sum(ATHLETES[name] for name in ("Upper arm", "Lower arm", "Hand", "Thigh", "Shank", "Foot"))
    parts = ATHLETES["Upper body"] + ATHLETES["Lower body"]
    assert ATHLETES["Head"] + parts + limbs == pytest.approx(100.0)


def test_errors_of_a_known_wrench() -> None:
    check = everything().validation[0]
    found = {(one.component, one.method): one for one in wrench_errors(check)}
    assert found["Fy", "identified"].mean == pytest.approx(-2.0)
    assert found["Fy", "identified"].mean_absolute == pytest.approx(2.0)
    assert found["Fz", "identified"].rms == pytest.approx(3.0)
    assert found["Fz", "identified"].share == pytest.approx(100.0 * 3.0 / 588.0)
    assert found["Nx", "generic"].peak == pytest.approx(4.0)


def test_files_hold_what_was_given() -> None:
    given = everything()
    text = {name: sheet.csv() for name, sheet in identification_tables(given).items()}
    assert set(text) == {
        "masses.csv", "parameters.csv", "segments.csv", "links.csv", "base_parameters.csv", "cross_validation.csv",
        "wrench_walk_2.csv",
    }  # fmt: skip
    for row, parameters in zip(rows(text["parameters.csv"]), inertial_parameters(given.model), strict=False):
        assert float(row["I_zx [kg m^2]"]) == parameters[8]
    assert [row["share from the data"] for row in rows(text["links.csv"])] == ["0.9", "0.5", "0.25", "", "0.0"]
    assert rows(text["base_parameters.csv"])[1]["relative standard deviation"] == ""
    wrench = rows(text["wrench_walk_2.csv"])
    assert float(wrench[3]["Fx measured [N]"]) == 30.0
    assert wrench[50]["Fx measured [N]"] == ""


def test_every_link_has_its_segment() -> None:
    given = everything()
    told = {row[0]: (row[1], row[2]) for row in identification_tables(given)["links.csv"].rows}
    assert told == {body: (one.name, one.side) for body, one in segments_of(given.model).items()}


def test_the_page_prints_the_numbers() -> None:
    text = report_page(shown("s01", model=everything().model, identification=everything()))
    page = html.document_fromstring(text.encode("utf-8"), parser=html.HTMLParser(encoding="utf-8"))
    keys = page.xpath("//main/section/@id")
    assert keys == ["body-identified", "masses", "segments", "base", "cross-validation", "calibration", "made"]
    assert not page.xpath("//section[@class='absent']")
    masses = page.xpath("//section[@id='masses']//table")[0]
    for body, row in zip(everything().model.bodies, masses.xpath("tbody/tr"), strict=False):
        assert row.xpath("td/text()") == [body.name, number(body.mass), number(1.1 * body.mass)]
    rms = page.xpath("//section[@id='cross-validation']//table")[0]
    assert rms.xpath("tbody/tr[1]/td/text()") == ["Fx [N]", number(1.0), number(4.0)]
    assert "center outside <skin>" in page.xpath("string(//section[@id='body-identified']/p)")
    assert "42" in page.xpath("string(//section[@id='calibration'])")
    sources = page.xpath("//ol[@class='references']/li/@id")
    assert sources == ["ref-dissertation", "ref-ayusawa2014", "ref-ae1992", "ref-wensing2018"]
    for drawing in re.findall(r"<svg.*?</svg>", text, re.DOTALL):
        etree.fromstring(drawing)


def test_little_is_enough() -> None:
    """Masses alone make a page; what was not given is not shown."""
    given = masses_only(spine(), TABLE_3_1)
    text = report_page(shown("spine", model=given.model, identification=given))
    page = html.document_fromstring(text.encode("utf-8"), parser=html.HTMLParser(encoding="utf-8"))
    assert page.xpath("//main/section/@id") == ["body-identified", "masses", "segments", "made"]


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(BadData, match="share of 5 links, but got 2"):
        replace(everything(), share=np.zeros(2))
