"""The bodies that unknown markers may be on, by geometry.

The truth where it is known, and a table that the user returns.
"""

from __future__ import annotations

import numpy as np
import pytest

from made_standing import standing
from myomorph.core.io.trc import read_trc, write_trc
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import axis_rotation
from myomorph.core.motion.protocols import protocols, recognize
from myomorph.lab.analyze.analyze import prepare_request
from myomorph.lab.analyze.proposed_protocol import LANDMARKS, proposed_sites
from myomorph.lab.analyze.recorded_trial import AnalyzeRequest, read_protocols

pytest.importorskip("myo_sim")


def numbered(markers: Markers, size: float, turn: float, shift: float = 0.0) -> Markers:
    """Return the same body, of another height, rotated, z up, its markers numbered."""
    upright = axis_rotation([1.0, 0.0, 0.0], np.pi / 2) @ axis_rotation([0.0, 1.0, 0.0], turn)
    places = size * markers.values @ upright.T + [0.7, -0.3, 0.0]
    places = places + np.linspace(0.0, shift, len(markers))[:, None, None] * [1.0, 0.0, 0.0]
    return Markers(markers.time, tuple(f"M{k}" for k in range(len(markers.names))), places)


@pytest.mark.parametrize(("size", "turn"), [(1.0, 0.0), (0.8, 2.2), (1.1, -1.0)])
def test_numbered_markers_of_the_model_itself_are_found_again(size: float, turn: float) -> None:
    body = standing()
    truth = [protocols().protocols["plug_in_gait"].labels[label] for label in body.names]
    found = proposed_sites(numbered(body, size, turn))
    assert len(found) == len(truth)
    assert {proposal.label: proposal.site for proposal in found} == {
        f"M{k}": site for k, site in enumerate(truth)
    }
    assert max(proposal.distance for proposal in found) < 0.02


def test_landmarks_of_a_person_are_offered_on_the_right_side(data) -> None:
    """Rajagopal's standing trial: most landmarks right, no side or leg segment confused."""
    markers = read_trc(data("rajagopal-walk-emg/raw/static_walk_1.trc")).markers
    assert markers is not None
    truth = recognize(markers.names).sites
    names = tuple(label for label, site in truth.items() if site.kind == "bony")
    found = proposed_sites(
        Markers(markers.time, names, np.stack([markers[name] for name in names], axis=1))
    )
    right = [proposal for proposal in found if proposal.site == truth[proposal.label]]
    assert len(right) >= 0.8 * sum(site.key in LANDMARKS for site in truth.values())
    for proposal in found:
        site = truth[proposal.label]
        if site.segment in ("thigh", "shank", "foot"):
            assert (proposal.site.segment, proposal.site.side) == (site.segment, site.side)


def test_the_table_is_written_beside_the_refusal_and_taken_when_it_is_given_back(tmp_path) -> None:
    write_trc(numbered(standing(), 1.0, 0.5), tmp_path / "standing.trc")
    write_trc(numbered(standing(), 1.0, 0.5, shift=0.4), tmp_path / "walk.trc")
    request = AnalyzeRequest((tmp_path / "walk.trc",), 70.0, static=tmp_path / "standing.trc")
    with pytest.raises(BadData, match=r"are numbered.*check each line.*--protocol"):
        prepare_request(request, tmp_path / "out")
    table = tmp_path / "out" / "protocol.toml"
    assert '= "left thigh.lateral_epicondyle"' in table.read_text()
    assert not (tmp_path / "out" / "study.toml").exists()
    checked = AnalyzeRequest(
        request.recordings, 70.0, static=request.static, table=read_protocols(table)
    )
    prepared = prepare_request(checked, tmp_path / "out")
    assert any("Proposed by geometry, then checked; 15 labels" in text for text in prepared.assumed)


def test_what_is_no_standing_body_is_not_offered() -> None:
    places = np.random.default_rng(0).random((5, 30, 3))
    assert (
        proposed_sites(Markers(np.arange(5) / 100.0, tuple(f"M{k}" for k in range(30)), places))
        == ()
    )
