"""Digits that are none, names that no file can have, JSON without end: what a fuzzer found."""

from pathlib import Path

import pytest

from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.osim.document import read_document
from myomorph.core.io.parsing.text import whole_number
from myomorph.core.io.sto import read_sto
from myomorph.core.io.trc import read_trc
from myomorph.core.model.errors import BadFile
from myomorph.exchange.bids.signals import facts_of_file
from myomorph.lab.study.plan.measures import read_measures

SUPERSCRIPT = "4\u00b2"
HUGE = "9" * 5000
TRC = """PathFileType\t4\t(X/Y/Z)\tx.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames
100\t100\t{count}\t{count}\tmm\t100\t1\t2
Frame#\tTime\tA\t\t
\t\tX1\tY1\tZ1
1\t0.00\t1\t2\t3
2\t0.01\t1\t2\t3
"""


@pytest.mark.parametrize(
    ("text", "number"), [("12", 12), ("", None), ("-1", None), (SUPERSCRIPT, None), (HUGE, None)]
)
def test_whole_numbers_are_plain_digits(text, number):
    assert whole_number(text) == number


@pytest.mark.parametrize("count", [SUPERSCRIPT, HUGE])
def test_counts_of_tables_that_are_no_numbers_are_passed_over(tmp_path, count):
    trc = tmp_path / "x.trc"
    trc.write_text(TRC.format(count=count), encoding="utf-8")
    assert read_trc(trc).markers.names == ("A",)
    sto = tmp_path / "x.sto"
    sto.write_text(f"x\nnRows={count}\nnColumns=2\nendheader\ntime\ta\n0\t1\n1\t2\n", "utf-8")
    assert read_sto(sto).names == ("a",)


@pytest.mark.parametrize("version", [SUPERSCRIPT, HUGE])
def test_versions_that_are_no_numbers_are_refused(tmp_path, version):
    path = tmp_path / "x.xml"
    path.write_text(f'<OpenSimDocument Version="{version}"><Model/></OpenSimDocument>', "utf-8")
    with pytest.raises(BadFile, match="Version is"):
        read_document(path, ("Model",), "a model")


def test_names_that_no_file_can_have_are_said_not_to_exist(tmp_path):
    loads = tmp_path / "loads.xml"
    loads.write_text(
        '<OpenSimDocument Version="40000"><ExternalLoads><objects>'
        "<ExternalForce><applied_to_body>foot</applied_to_body>"
        "<force_identifier>f</force_identifier></ExternalForce></objects>"
        f"<datafile>{'x' * 5000}</datafile></ExternalLoads></OpenSimDocument>",
        "utf-8",
    )
    with pytest.raises(BadFile, match="does not exist"):
        read_external_loads(loads)
    measures = tmp_path / "measures.csv"
    measures.write_text(f"subject,model\na,{'x' * 5000}.osim\n", "utf-8")
    problems: list[str] = []
    read_measures(measures, problems, [])
    assert "does not exist" in problems[0]


def test_json_that_is_nested_without_end_is_no_description(tmp_path):
    (tmp_path / "sub-1_motion.json").write_text("[" * 100_000, "utf-8")
    with pytest.raises(BadFile, match="not JSON"):
        facts_of_file(Path(tmp_path / "sub-1_motion.tsv"))
