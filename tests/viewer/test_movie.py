"""A movie of results: when its pictures are, which curves it has, and what is in the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.tension.joint_contact import JointContactForces
from myomorph.lab.report.trial.report_input import ReportInput
from myomorph.lab.viewer.movie import MovieOptions, draw_movie, movie_clock
from myomorph.lab.viewer.movie_curves import movie_charts
from myomorph.lab.viewer.replay_body import PlayedBody
from myomorph.lab.viewer.replay_charts import joint_force_chart
from walker import everything

image = pytest.importorskip("PIL.Image", reason="needs the extra 'view'")
SIZE = (300, 180)


def loaded() -> ReportInput:
    """Return the walker with forces in its knees, of which the left one carries more."""
    given = everything()
    assert given.kinematics.motion is not None
    time = given.kinematics.motion.time
    totals = np.stack([np.full_like(time, 1200.0), 1500.0 + 100.0 * time], axis=1)
    none = np.zeros_like(totals)
    contacts = JointContactForces(
        time=time,
        joints=("walker_knee_r", "walker_knee_l"),
        points=("medial", "medial"),
        joint_of=("walker_knee_r", "walker_knee_l"),
        joint_contact_force=totals,
        joint_contact_total=totals,
        joint_contact_shear=none,
        joint_contact_unbalanced_force=none,
        joint_contact_unbalanced_moment=none,
        weight=600.0,
    )
    return replace(given, joint_contacts=contacts)


@pytest.fixture(scope="module")
def body() -> PlayedBody:
    return PlayedBody(loaded())


TIME = np.arange(0.0, 2.005, 0.01)


@pytest.mark.parametrize(
    ("options", "pictures", "last"),
    [
        (MovieOptions(), 40, 1.95),
        (MovieOptions(speed=0.5), 80, 1.975),
        (MovieOptions(seconds=1.0), 20, 1.9),
        (MovieOptions(seconds=1.0, speed=0.5), 20, 0.475),
        (MovieOptions(time=(0.5, 1.0)), 10, 0.95),
        (MovieOptions(speed=0.01), 400, 0.1995),
    ],
)
def test_pictures_are_spread_over_the_recording(options, pictures, last) -> None:
    clock = movie_clock(TIME, options)
    assert len(clock.times) == pictures
    assert clock.times[-1] == pytest.approx(last)
    assert clock.cut == (last < 1.9 and options.time is None)


def test_what_no_movie_can_have_is_answered(body: PlayedBody, tmp_path: Path) -> None:
    with pytest.raises(BadData, match="from 0 to 2 s"):
        movie_clock(TIME, MovieOptions(time=(1.0, 3.0)))
    with pytest.raises(BadData, match="size"):
        MovieOptions(size=(5, 5))
    with pytest.raises(BadData, match="seconds 0"):
        MovieOptions(seconds=0.0)
    with pytest.raises(BadData, match="speed -1"):
        MovieOptions(speed=-1.0)
    with pytest.raises(BadFile, match=r"'\.avi'"):
        draw_movie(loaded(), tmp_path / "a.avi", MovieOptions())
    with pytest.raises(BadFile, match="does not exist"):
        draw_movie(loaded(), tmp_path / "nowhere" / "a.gif", MovieOptions())
    with pytest.raises(UnknownName, match="curve 'nose'"):
        movie_charts(body, ["nose"])
    with pytest.raises(BadData, match="room for 3"):
        movie_charts(body, ["forces", "forces", "forces", "forces"])


def test_curves_are_found_by_name_with_a_side_or_without(body: PlayedBody) -> None:
    knees, angle, moment = movie_charts(body, ["walker_knee", "knee_angle_r", "knee_angle_moment"])
    assert knees.title == "Knee force [body weights]"
    assert [curve.label for curve in knees.curves] == ["right", "left"]
    assert knees.curves[0].values == pytest.approx(2.0)
    assert [curve.label for curve in angle.curves] == ["right"]
    assert moment.title.endswith("moment [N m]")
    (muscles,) = movie_charts(body, ["recfem"])
    assert muscles.title == "Rectus femoris: activation"


def test_without_names_the_most_loaded_joint_comes_first(body: PlayedBody) -> None:
    titles = [chart.title for chart in movie_charts(body)]
    assert titles[0] == "Knee force [body weights]"
    assert len(titles) == 3
    unloaded = movie_charts(PlayedBody(everything()))
    assert unloaded[0].title == "Vertical force [N]"


def test_the_page_has_forces_of_all_joints(body: PlayedBody) -> None:
    chart = joint_force_chart(body)
    assert chart is not None
    assert len(chart.curves) == 2
    assert joint_force_chart(PlayedBody(everything())) is None


@pytest.mark.parametrize("name", ["walk.gif", "walk.webp", "walk.png"])
def test_a_movie_is_written_and_moves(tmp_path: Path, name: str) -> None:
    options = MovieOptions(size=SIZE, time=(0.3, 0.8))
    draw_movie(loaded(), tmp_path / name, options)
    with image.open(tmp_path / name) as movie:
        assert movie.n_frames == 10
        assert movie.size == SIZE
        pictures = []
        for number in (0, 5):
            movie.seek(number)
            pictures.append(np.asarray(movie.convert("RGB")).astype(int))
    first, later = pictures
    right = slice(int(0.54 * SIZE[0]) + 2, None)
    assert (first[0, right] >= 250).all()
    changed = (np.abs(first - later) > 40).any(axis=2)
    assert changed[:, right].mean() > 0.01
    # Of the charts only the cursor moves.
    assert 0.0 < changed[: -SIZE[1] // 4, : right.start].mean() < 0.1


def test_muscles_have_the_colors_of_their_activations(tmp_path: Path) -> None:
    """Those of the walker are far more active than at rest: much is red."""
    draw_movie(loaded(), tmp_path / "walk.png", MovieOptions(size=SIZE, time=(0.3, 0.4)))
    with image.open(tmp_path / "walk.png") as movie:
        picture = np.asarray(movie.convert("RGB")).astype(int)[:, int(0.54 * SIZE[0]) + 2 :]
    red = (picture[..., 0] > picture[..., 2] + 60) & (picture[..., 0] > picture[..., 1] + 60)
    assert red.mean() > 0.003
