"""Laws of the error budget.

Intervals that include errors shared by all swings cover them.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from made_swings import Made, eleven, three_releases

from myomorph.core.model.errors import BadData, BadFile
from myomorph.lab.store.settings import settings_of
from myomorph.lab.store.study_file import checked
from myomorph.swings.viscosity.identification.budget import ErrorOptions, disturbed
from myomorph.swings.viscosity.identification.identify import ViscosityOptions, identify_specimen
from myomorph.swings.viscosity.identification.shared_errors import with_shared_errors
from myomorph.swings.viscosity.study.options import StudyOptions
from myomorph.swings.viscosity.study.tables import viscosity_tables
from myomorph.swings.viscosity.study.template import write_template
from truths.mechanical_joint import JointExperiment, mechanical_joint

OPTIONS = ViscosityOptions(draws=50, stiffness=False)
BARE = Made(damping=0.05)
WHOLE = replace(BARE, mass=2.5, **eleven(np.random.default_rng(0)))
NONE = ErrorOptions(
    plate_position=0.0,
    plate_rotation=0.0,
    force_gain=0.0,
    moment_gain=0.0,
    plate_clock=0.0,
    joint_center=0.0,
    soft_tissue=0.0,
)


@pytest.fixture(scope="module")
def swings():
    return three_releases(BARE), three_releases(WHOLE)


@pytest.mark.parametrize(
    ("source", "axis", "size"),
    [
        ("plate_position", 0, 0.005),
        ("moment_gain", 1, -0.02),
        ("joint_center", 2, 0.008),
        ("plate_rotation", 1, 0.01),
    ],
)
def test_an_instrument_that_is_off_is_in_the_interval_that_knows_of_it_only(
    swings, source, axis, size
):
    off = [
        [
            disturbed(replace(one, origin=np.array([0.2, 0.0, -0.8])), source, axis, size)
            for one in own
        ]
        for own in swings
    ]
    found = identify_specimen("off", *off, options=OPTIONS)
    wider, shares = with_shared_errors(found, OPTIONS, replace(NONE, **{source: abs(size)}))
    for condition, truth in ((wider.without, BARE), (wider.intact, WHOLE)):
        assert condition.com.holds(float(np.linalg.norm(truth.parameters[1:4]) / truth.mass))
        assert condition.mass.holds(truth.mass) or condition.mass.value == pytest.approx(
            truth.mass, rel=1e-3
        )
    assert wider.without.viscosity.holds(0.05)
    assert wider.muscles.common.holds(120.0)
    for quantity in ("joint_viscosity", "muscle_viscosity"):
        assert sum(one.share for one in shares if one.quantity == quantity) == pytest.approx(1.0)
    largest = max(
        (one for one in shares if one.quantity == "joint_viscosity"), key=lambda one: one.share
    )
    assert largest.source in (source, "swings")


@pytest.fixture(scope="module")
def joint():
    return mechanical_joint("ball", 0.055, 0.0, seed=4, experiment=JointExperiment(seconds=15.0))


@pytest.mark.parametrize(
    "errors",
    [
        [("plate_position", 2, 0.005)],
        [("moment_gain", 0, 0.02), ("moment_gain", 1, -0.01), ("moment_gain", 2, 0.02)],
    ],
    ids=["plate 5 mm", "gains +2/-1/+2 %"],
)
def test_the_plain_law_stays_near_a_mujoco_joints_truth_and_the_default_errors_hold_it(
    joint, errors
):
    swings = [replace(one, origin=np.array([0.2, 0.0, -0.8])) for one in joint.swings()]
    for error in errors:
        swings = [disturbed(one, *error) for one in swings]
    found = identify_specimen("off", swings, [], options=OPTIONS)
    wider, _ = with_shared_errors(found, OPTIONS, ErrorOptions())
    assert wider.without.viscosity.value == pytest.approx(0.055, rel=0.03)
    assert wider.without.viscosity.holds(0.055)
    assert wider.without.mass.holds(joint.truth.mass)
    assert wider.without.com.holds(joint.truth.com)


def test_sources_of_no_error_leave_intervals_as_they_are(swings):
    found = identify_specimen("exact", *swings, options=OPTIONS)
    same, shares = with_shared_errors(found, OPTIONS, NONE)
    assert same.without.viscosity.high == pytest.approx(found.without.viscosity.high)
    assert {one.source for one in shares} == {"swings"}


def test_what_errors_add_grows_with_their_standard_deviation(swings):
    found = identify_specimen("exact", *swings, options=OPTIONS)
    sds = []
    for size in (0.002, 0.004):
        shares = with_shared_errors(found, OPTIONS, replace(NONE, plate_position=size))[1]
        sds.append(
            next(s.sd for s in shares if (s.source, s.quantity) == ("plate_position", "com_intact"))
        )
    assert sds[1] == pytest.approx(2.0 * sds[0], rel=0.05)


def test_a_negative_standard_deviation_is_refused():
    with pytest.raises(BadData, match="plate_position"):
        ErrorOptions(plate_position=-1.0)


def test_the_template_has_every_key_and_is_what_the_reader_knows(tmp_path):
    path = write_template(tmp_path / "new")
    text = path.read_text(encoding="utf-8")
    given = [
        line[2:]
        if line.startswith("# ") and re.match(r"# \[\[|.* = ", line) and " =  #" not in line
        else line
        for line in text.split("\n")
    ]
    specimen, _ = "\n".join(given).split("[options.", 1)
    found = tomllib.loads(specimen)
    found, problems = checked(viscosity_tables(), found)
    assert not problems
    for table in (found.specimen[0], found.limb[0]):
        assert set(type(table).model_fields) == table.model_fields_set
    for table, options in vars(StudyOptions()).items():
        assert f"[options.{table}]" in text
        for one in settings_of(type(options)):
            assert f"# {one.name} = " in text
    with pytest.raises(BadFile, match="exists already"):
        write_template(path.parent)
