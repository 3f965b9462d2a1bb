"""Charts and tables of the gait page: spread, counts, fixed axes, and what a verdict leaves out."""

from __future__ import annotations

import re
import statistics
from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.series import Emg
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.lab.analysis.emg_strides import emg_strides
from myomorph.lab.analysis.gait_curves import KEYS, SAMPLES, SIDES, VARIABLES
from myomorph.lab.analysis.gait_extremes import gait_extremes
from myomorph.lab.analysis.stride_spread import MIN_STRIDES, StrideSpread
from myomorph.lab.analysis.strides import Stride
from myomorph.lab.report.page.parts import PageHead
from myomorph.lab.report.trial.answer.judgement import USES
from myomorph.lab.report.trial.gait import gait_page as page_module
from myomorph.lab.report.trial.gait.gait_axis import AXES
from myomorph.lab.report.trial.gait.gait_chart import StrideLine, gait_chart
from myomorph.lab.report.trial.gait.gait_page import gait_page
from myomorph.lab.report.trial.gait.gait_tables import interval_words, spread_words
from myomorph.lab.report.trial.gait.gait_title import gait_title
from myomorph.lab.report.trial.prepared import prepare
from myomorph.lab.report.trial.report_input import Dynamics, Kinematics, Recorded, ReportInput

AXIS = AXES["knee_flexion"]
PERCENT = np.linspace(0.0, 100.0, SAMPLES)


@pytest.fixture(scope="module")
def prepared(data):
    """Make a walk with plates: angles, moments and powers of few strides."""
    home = data("opensim-gait-subject01") / "ref_id"
    model = read_model(home / "subject01.osim")
    coordinates = motion_from_table(read_sto(home / "subject01_walk1_ik.mot"), model)
    motion = differentiate(coordinates, cutoff=6.0)
    wrenches = read_external_loads(home / "subject01_walk1_grf.xml")
    torques = inverse_dynamics(model, motion, resample_wrenches(wrenches, motion.time, cutoff=6.0))
    recorded = Recorded(
        subject="s01", mass=72.6, age=34.0, sex="female", height=1.66, date="2026-03-05"
    )
    return prepare(
        ReportInput(
            head=PageHead("s01: walk"),
            model=model,
            kinematics=Kinematics(coordinates=motion),
            dynamics=Dynamics(torques=torques, wrenches=wrenches, motion=motion),
            recorded=recorded,
        )
    )


def made_strides(count, sd=4.0, seed=0):
    """Strides of one shape whose size differs with a known standard deviation."""
    sizes = np.random.default_rng(seed).normal(60.0, sd, count)
    return sizes[:, None] * np.sin(np.pi * PERCENT / 100.0) ** 2, sizes


def drawn(count):
    strides, _ = made_strides(count)
    line = StrideLine(strides=strides, style="right", label="right")
    return gait_chart("Knee", "°", AXIS, [line])


def test_many_strides_are_a_mean_and_a_band():
    chart = drawn(12)
    assert chart.count('class="band right"') == 1
    assert 'class="line right"' in chart
    assert "thin" not in chart


def test_the_band_is_one_standard_deviation_between_strides():
    strides, sizes = made_strides(30)
    chart = gait_chart("Knee", "°", AXIS, [StrideLine(strides=strides, style="right", label="r")])
    outline = re.search(r'class="band right" d="([^"]+)"', chart)[1]
    heights = np.array(
        [[float(v) for v in pair.split()] for pair in re.findall(r"[\d.]+ [\d.]+", outline)]
    )
    middle = np.argmin(np.abs(heights[: len(heights) // 2, 0] - heights[:, 0].mean()))
    upper = heights[middle, 1]
    lower = heights[-1 - middle, 1]
    place = [float(v) for v in re.search(r'data-place="([^"]+)"', chart)[1].split()]
    ends = [float(v) for v in re.search(r'data-range="([^"]+)"', chart)[1].split()]
    per_unit = (place[3] - place[1]) / (ends[3] - ends[2])
    assert (lower - upper) / per_unit / 2 == pytest.approx(statistics.stdev(sizes), rel=0.06)


@pytest.mark.parametrize("count", [2, MIN_STRIDES - 1])
def test_few_strides_are_drawn_each(count):
    chart = drawn(count)
    assert chart.count("line thin right") == count
    assert "band" not in chart
    assert f"right\u00a0{count}" in chart


def test_one_stride_never_looks_like_a_mean():
    chart = drawn(1)
    assert "line single right" in chart
    assert 'class="line right"' not in chart
    assert "thin" not in chart
    assert gait_title({"right": (1,), "left": ()}) == "Single strides, no mean: 1 right"
    one = StrideSpread(mean=62.0, sd=np.nan, low=np.nan, high=np.nan, count=1)
    assert spread_words(one) == "62.0 (1)"
    assert interval_words(one) == "–"


def test_titles_say_of_how_many_strides_a_mean_is():
    assert gait_title({"right": range(12), "left": range(11)}) == (
        "Mean of 23 strides: 12 right, 11 left"
    )
    assert gait_title({"right": range(3), "left": range(1)}) == (
        "Mean of few strides, each drawn: 3 right, 1 left (no mean)"
    )


def test_axes_are_the_same_on_every_page_and_have_direction_words():
    assert set(AXES) == set(KEYS)
    for variable in VARIABLES:
        axis = AXES[variable.key]
        inside = np.linspace(axis.low, axis.high, SAMPLES)
        assert axis.holding(inside) == axis
        assert variable.kind == "force" or (axis.up and axis.down)
        outside = axis.holding(np.array([axis.high + 0.3 * axis.step]))
        assert outside.longer
        assert outside.high == pytest.approx(axis.high + axis.step)
    for count in (1, 3, 12):
        assert 'data-range="0 100 -20 80"' in drawn(count)
    assert "flexion" in drawn(3)
    assert "extension" in drawn(3)


def test_extremes_are_of_single_strides(prepared):
    curves = prepared.gait
    for side in SIDES:
        table = gait_extremes(curves, side)
        knee = curves.of(side)[:, :, KEYS.index("knee_flexion")]
        peaks = [max(stride) for stride in knee.tolist()]
        found = table["knee_flexion", "largest"]
        assert found.mean == pytest.approx(statistics.fmean(peaks))
        assert found.count == len(peaks)
        ranges = [max(stride) - min(stride) for stride in knee.tolist()]
        assert table["knee_flexion", "range"].mean == pytest.approx(statistics.fmean(ranges))


@pytest.mark.parametrize("use", list(USES))
def test_what_the_verdict_excludes_is_not_on_the_page(prepared, use, monkeypatch):
    answered = page_module.answer_of(prepared)
    stated = replace(answered, judgement=replace(answered.judgement, use=use))
    monkeypatch.setattr(page_module, "answer_of", lambda _: stated)
    page = gait_page(prepared, prepared.gait, None)
    allowed = use in ("everything", "angles and torques")
    for words in ("Ankle moment", "Hip power"):
        assert (words in page) == allowed
    assert ("Knee flexion" in page) == (use != "nothing")
    assert ("Walking speed" in page) == (use != "nothing")
    assert USES[use] in page
    assert ("Moments and powers are left out" in page) == (use == "angles")
    assert ("Curves and numbers are left out" in page) == (use == "nothing")
    assert not (use == "nothing" and "<svg" in page)


def test_who_was_recorded_stands_at_the_top(prepared):
    page = gait_page(prepared, prepared.gait, None)
    for words in ("s01", "34\u00a0years", "female", "1.66\u00a0m", "72.6\u00a0kg", "2026-03-05"):
        assert words in page
    assert "Not stated" not in page
    unknown = replace(prepared.results, recorded=Recorded(subject="s01"))
    assert "age, sex, height, mass" in gait_page(prepare(unknown), prepared.gait, None)


def test_emg_is_cut_at_the_strikes_of_its_own_side():
    time = np.linspace(0.0, 4.0, 401)
    wave = 0.5 - 0.5 * np.cos(2.0 * np.pi * time)
    channels = ("soleus_r", "tibant_l_activation", "trunk", "EMG 4")
    emg = Emg(time, channels, np.stack([wave, 3.0 * wave, wave, wave], axis=1))
    strides = {
        side: [made(start, side) for start in (begin, begin + 1.0)]
        for side, begin in (("right", 0.0), ("left", 0.5))
    }
    found = emg_strides(emg, strides, {"EMG 4": ("vasmed_r", "vaslat_r")})
    assert [(each.channel, each.side) for each in found] == [
        ("soleus_r", "right"),
        ("tibant_l_activation", "left"),
        ("EMG 4", "right"),
    ]
    right, left, _ = found
    assert right.values.shape == (2, SAMPLES)
    assert right.values.max() == pytest.approx(1.0)
    # The left strikes half a stride later, when the wave is highest.
    assert right.values[0, 0] == pytest.approx(0.0, abs=1e-3)
    assert left.values[0, 0] == pytest.approx(1.0, abs=1e-3)


def made(start, limb):
    return Stride(
        limb=limb,
        start=start,
        lift=start + 0.6,
        stop=start + 1.0,
        length=1.2,
        width=0.1,
        seen=1.0,
        source="plates",
    )
