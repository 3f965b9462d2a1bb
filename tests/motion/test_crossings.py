"""Parts of a recording in which enough is visible.

By the markers alone, and by what they show of a model.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Markers
from myomorph.core.motion.crossings import (
    CrossingOptions,
    best_crossings,
    crossings,
    marker_slopes,
    shown_shares,
    within_crossings,
)
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.rigid.tree import compile_tree
from stick_figure import person


@pytest.fixture(scope="module")
def subject():
    return person(frames=400)


def hidden(markers, *spans, names=None):
    """Return the same with some markers hidden in spans of frames."""
    values = markers.values.copy()
    columns = [k for k, name in enumerate(markers.names) if names is None or name.startswith(names)]
    for start, stop in spans:
        values[start:stop, columns] = np.nan
    return replace(markers, values=values)


def test_gaps_are_bridged_or_cut_and_short_parts_left_out(subject):
    markers = subject.markers
    step = 1.0 / markers.rate
    gone = hidden(markers, (0, 20), (60, 64), (150, 200), (208, 260))
    found = crossings(gone, options=CrossingOptions(max_gap=5.0 * step, min_duration=20.0 * step))
    expected = [(markers.time[20], markers.time[149]), (markers.time[260], markers.time[-1])]
    np.testing.assert_allclose(found, expected)
    apart = crossings(gone, options=CrossingOptions(max_gap=0.0, min_duration=0.0))
    assert len(apart) == 4
    kept = within_crossings(gone, found)
    assert not np.isfinite(kept.values[200:208]).any()
    np.testing.assert_array_equal(kept.values[300:], markers.values[300:])


def test_where_no_part_shows_enough_those_that_show_most_are_taken(subject):
    """All markers are never seen together: of the parts the one with most markers is the best."""
    markers = subject.markers
    half = hidden(markers, (0, 200), names="pelvis0")
    gone = hidden(half, (150, 400), names=("foot_r", "foot_l"))
    options = CrossingOptions(min_visible=1.0, max_gap=0.0, min_duration=0.0)
    assert crossings(gone, options=options) == ()
    found = best_crossings(gone, options=options)
    np.testing.assert_allclose(found.spans, [(markers.time[0], markers.time[149])])
    assert found.share == pytest.approx(1.0 - 1.0 / len(markers.names))
    enough = best_crossings(markers, options=options)
    assert enough.spans == crossings(markers, options=options)
    assert enough.share == 1.0
    nothing = replace(options, min_duration=1e3)
    assert best_crossings(gone, options=nothing) == ((), 0.0)


def test_a_model_tells_which_markers_are_missed(subject):
    """Three markers on the pelvis tell as much as four; none on a foot leaves its turns open."""
    model = subject.model
    markers = subject.markers
    assert shown_shares(hidden(markers, (0, 50), names="pelvis0"), model)[0] == 1.0
    one_foot = shown_shares(hidden(markers, (0, 50), names="foot_r"), model)
    free = len([one for one in model.coordinates if not one.locked])
    assert one_foot[0] == pytest.approx(1.0 - 2.0 / free)
    assert one_foot[60] == 1.0
    legs = hidden(markers, (0, 50), names=("foot", "tibia", "femur"))
    assert shown_shares(legs, model)[0] == pytest.approx(9.0 / free)
    assert crossings(legs, model)[0][0] == pytest.approx(markers.time[50])


def test_slopes_are_those_of_the_markers(subject):
    tree = compile_tree(subject.model)
    names = list(subject.model.marker_names)
    slopes = marker_slopes(tree, names)
    assert slopes.shape == (len(names), 3, len(subject.model.coordinates))
    # Sliding the pelvis moves every marker by one metre per metre, along one axis.
    np.testing.assert_allclose(np.linalg.norm(slopes[:, :, :3], axis=1), 1.0, atol=1e-6)
    on_foot = [k for k, name in enumerate(names) if not name.startswith("foot_r")]
    own = [k for k, one in enumerate(subject.model.coordinates) if one.name.startswith("foot_r")]
    assert np.abs(slopes[on_foot][:, :, own]).max() == 0.0


def test_inverse_kinematics_waits_through_a_gap(subject):
    """The pose found after a long gap is that of the whole recording, whatever came before."""
    model = subject.model
    markers = subject.markers
    whole = inverse_kinematics(model, markers)
    for start, stop in ((70, 260), (10, 45), (0, 100)):
        part = inverse_kinematics(model, hidden(markers, (start, stop)))
        seen = np.r_[0:start, stop : len(markers)]
        assert np.isnan(part.motion.values[start:stop]).all()
        assert not part.converged[start:stop].any()
        # Angles may be whole turns apart, and so feel another pull: what they explain is the same,
        # to the noise.
        np.testing.assert_allclose(part.marker_error[seen], whole.marker_error[seen], atol=2e-4)


def test_what_cannot_be_is_named(subject):
    other = Markers(subject.markers.time, ("nose",), subject.markers.values[:, :1])
    with pytest.raises(BadData, match="share no marker"):
        crossings(other, subject.model)
    with pytest.raises(BadData, match="a share above 0"):
        CrossingOptions(min_visible=0.0)
    with pytest.raises(BadData, match="0 or more"):
        CrossingOptions(max_gap=-1.0)
    assert crossings(hidden(subject.markers, (0, 400))) == ()
