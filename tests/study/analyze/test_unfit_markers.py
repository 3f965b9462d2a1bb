"""Recordings that the generic model cannot use end with one line.

It names what their markers are, and which option helps.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from made_standing import standing
from myomorph.core.io.trc import write_trc
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.series import Markers
from myomorph.core.motion.protocols import recognize
from myomorph.lab.analysis.arm_labels import is_arm
from myomorph.lab.analyze.analyze import prepare_request
from myomorph.lab.analyze.recorded_trial import AnalyzeRequest
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.inputs.loads import LoadsFile
from myomorph.lab.study.inputs.time_span import TimeSpan
from myomorph.lab.study.plan.plan import read_plan

KINDS = {
    "an arm": ("R.Epi.Lat", "R.Epi.Med", "R.Wrist.Rad", "R.Wrist.Ulna", "R.Hand"),
    "clusters of an arm": tuple(
        f"{part}{k}" for part in ("Scapula", "ArmR", "ForearmR", "GloveR") for k in (1, 2, 3)
    ),
    "landmarks by the ISB": ("ij", "px", "ts", "ac", "ai", "gu", "EpL", "EpM"),
}
NUMBERED = tuple(f"Point    {k}" for k in range(1, 20))
CLUSTERS = tuple(
    f"{side}{part}{k}" for side in "RL" for part in ("SK", "TH", "FT") for k in (1, 2, 3)
)


def refusal(labels: tuple[str, ...], folder) -> str:
    """Return what `analyze` prints on a recording of such labels."""
    places = np.random.default_rng(0).random((20, len(labels), 3))
    write_trc(Markers(np.arange(20) / 100.0, labels, places), folder / "x.trc")
    with pytest.raises(BadData) as error:
        prepare_request(AnalyzeRequest((folder / "x.trc",), 70.0), folder / "out")
    assert not (folder / "out").exists()
    return str(error.value)


@pytest.mark.parametrize("kind", KINDS)
def test_an_arm_needs_markers_on_the_trunk(kind: str, tmp_path) -> None:
    text = refusal(KINDS[kind], tmp_path)
    assert "those of an arm" in text
    assert "--model" in text


def test_numbers_and_clusters_need_a_table(tmp_path) -> None:
    assert "19 markers are numbered, not named" in refusal(NUMBERED, tmp_path)
    clusters = refusal(CLUSTERS, tmp_path)
    assert "in clusters" in clusters
    assert "none on pelvis" in clusters
    assert "--protocol" in clusters


def test_a_body_with_arms_is_not_an_arm() -> None:
    whole = (
        "LASI",
        "RASI",
        "LKNE",
        "LANK",
        "LSHO",
        "LELB",
        "LWRA",
        "LWRB",
        "RELB",
        "RWRA",
        "RWRB",
        "RUPA",
    )
    assert not is_arm(recognize(whole))


def test_a_part_in_which_nobody_is_seen_is_refused_with_where_somebody_is(tmp_path) -> None:
    body = standing(0.3)
    values = np.array(body.values)
    values[:10] = np.nan
    write_trc(Markers(body.time, body.names, values), tmp_path / "x.trc")
    with pytest.raises(BadData, match=r"fewer than 6 markers.*seen together from 0\.10 to 0\.19 s"):
        prepare_request(
            AnalyzeRequest((tmp_path / "x.trc",), 70.0, inputs=ByType(TimeSpan((0.0, 0.05)))),
            tmp_path / "out",
        )
    prepared = prepare_request(
        AnalyzeRequest((tmp_path / "x.trc",), 70.0, inputs=ByType(TimeSpan((0.1, 0.15)))),
        tmp_path / "out",
    )
    assert tomllib.loads(prepared.study.read_text())["subject"][0]["time"] == [0.1, 0.15]


def test_a_model_of_the_arm_takes_a_recording_of_the_arm(data, tmp_path) -> None:
    model = data("shoulder-bonepin/subject1_abdbonepin.osim")
    request = AnalyzeRequest((data("shoulder-bonepin/abdbonepin.trc"),), 70.0, model=model)
    prepared = prepare_request(request, tmp_path)
    assert any(
        "11 labels are markers of subject1_abdbonepin.osim" in text for text in prepared.assumed
    )
    assert any("no muscles" in text for text in prepared.assumed)
    assert not any("not used" in text for text in prepared.assumed)
    subject = tomllib.loads(prepared.study.read_text())["subject"][0]
    assert subject["steps"] == ["calibrate", "ik", "id", "report"]


def test_forces_of_a_named_table_and_its_layout_go_into_the_study(tmp_path) -> None:
    """A table that only its owner can read: named, laid out, and read again by the plan."""
    body = standing(0.3)
    write_trc(body, tmp_path / "x.trc")
    rows = np.column_stack(
        [np.zeros(20), *[np.full(20, value) for value in (0.0, 700.0, 0.0, 0.1, 0.0, 0.1)]]
    )
    np.savetxt(tmp_path / "plates.txt", rows)
    layout = {"force_columns": "-,Fx1,Fy1,Fz1,COPx1,COPy1,COPz1", "force_rate": 100.0}
    loads = ByType(LoadsFile(tmp_path / "plates.txt"))
    request = AnalyzeRequest((tmp_path / "x.trc",), 70.0, inputs=loads, options={"id": layout})
    prepared = prepare_request(request, tmp_path / "out")
    assert any("rows at 100 Hz" in text for text in prepared.assumed)
    plan = read_plan(prepared.study)
    assert plan.trials[0].get(LoadsFile).loads.name == "plates.txt"
    assert plan.settings["id"] == layout
    with pytest.raises(BadFile, match="--force-columns"):
        prepare_request(replace(request, options={}), tmp_path / "other")
