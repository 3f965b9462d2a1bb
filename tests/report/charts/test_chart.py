import re
import zlib
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from myomorph.core.model.series import Event
from myomorph.lab.report.charts.axis import number, scaled_unit, ticks
from myomorph.lab.report.charts.cells import Columns, heat_map, pooled
from myomorph.lab.report.charts.curves import Line, TimeLook, time_plot
from myomorph.lab.report.charts.marks import Level, decimate, envelope
from myomorph.lab.report.charts.points import floor_plot
from myomorph.lab.report.charts.rows import Rows, bar_plot
from myomorph.lab.report.scene.image import HEAT, png


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.integers(2, 10))
def test_ticks_are_even_and_inside(low: float, span: float, count: int) -> None:
    found = ticks(low, low + span, count)
    assert 1 <= len(found) <= 2 * count + 2
    slack = 1e-6 * (span + abs(low))
    assert found[0] >= low - slack
    assert found[-1] <= low + span + slack
    if len(found) > 2:
        assert np.diff(found) == pytest.approx(found[1] - found[0], rel=1e-4, abs=slack)


@pytest.mark.parametrize(
    ("value", "step", "text"),
    [
        (-0.0, 1.0, "0"),
        (1234.0, 200.0, "1\u202f234"),
        (-2.5, 0.5, "−2.5"),
        (0.3, None, "0.300"),
        (float("nan"), None, "–"),
    ],
)
def test_numbers_for_print(value: float, step: float | None, text: str) -> None:
    assert number(value + 0.0, step) == text


@pytest.mark.parametrize(("peak", "told"), [(30.0, "N"), (3e-3, "mN"), (4e-6, "µN"), (0.0, "N")])
def test_small_values_get_a_small_unit(peak: float, told: str) -> None:
    factor, unit = scaled_unit("N", np.array([peak, np.nan, -peak / 2]))
    assert unit == told
    assert peak == 0.0 or 1.0 <= factor * peak <= 1e3


@given(st.integers(0, 2**32 - 1), st.integers(900, 5000))
def test_a_decimated_line_keeps_its_peaks(seed: int, samples: int) -> None:
    random = np.random.default_rng(seed)
    values = random.normal(size=samples)
    values[random.integers(0, samples, 20)] = np.nan
    time = np.arange(float(samples))
    t, v = decimate(time, values)
    assert len(t) <= 842
    assert np.all(np.diff(t) > 0)
    assert (np.nanmax(v), np.nanmin(v)) == (np.nanmax(values), np.nanmin(values))
    assert (t[0], t[-1]) == (0.0, samples - 1.0)


def test_a_long_gap_stays_a_gap() -> None:
    values = np.ones(9000)
    values[3000:4000] = np.nan
    _, v = decimate(np.arange(9000.0), values)
    assert np.isnan(v).any()


def test_a_line_can_be_read_back_from_its_drawing() -> None:
    """What the page's script does: places to values through the chart's own scales."""
    time = np.linspace(2.0, 5.0, 60)
    values = -3.0 + 40.0 * np.sin(time)
    drawing = ElementTree.fromstring(
        time_plot("a", "N", [Line(time=time, values=values, style="right", label="r")], (2.0, 5.0))
    )
    left, top, right, bottom = map(float, drawing.get("data-place", "").split())
    x0, x1, y0, y1 = map(float, drawing.get("data-range", "").split())
    (line,) = [one for one in drawing.iter() if one.get("data-label") == "r"]
    flat = np.array([float(one) for one in re.findall(r"-?[\d.]+", line.get("d", ""))]).reshape(
        -1, 2
    )
    read_time = x0 + (flat[:, 0] - left) / (right - left) * (x1 - x0)
    read = y0 + (bottom - flat[:, 1]) / (bottom - top) * (y1 - y0)
    assert read_time == pytest.approx(time, abs=1e-3)
    assert read == pytest.approx(values, abs=1e-3 * (y1 - y0))


@pytest.mark.parametrize(
    "values",
    [np.full(5, np.nan), np.zeros(5), np.array([1.0, np.nan, 2.0, np.inf, 3.0]), np.zeros(0)],
)
def test_odd_values_still_make_a_drawing(values: np.ndarray) -> None:
    """Values that are missing, constant, infinite or none.

    Parameters
    ----------
    values : (frames,)
    """
    drawing = time_plot(
        "<odd> & 'quoted'",
        "N",
        [
            Line(
                time=np.arange(float(len(values))),
                values=values,
                style="emg left",
                label='a "b"',
                filled=True,
            )
        ],
        (0.0, 4.0),
        TimeLook(
            events=[Event(1.0, "Foot Strike", "Left"), Event(1.01, "<b>"), Event(99.0, "outside")],
            levels=[Level(0.5, "a < b")],
            name_events=True,
        ),
    )
    ElementTree.fromstring(drawing)


def test_noise_becomes_a_band() -> None:
    time = np.arange(20000.0)
    noise = np.random.default_rng(0).normal(size=20000)
    band = envelope(time, noise)
    assert band is not None
    assert np.all(band[2] <= band[1])
    assert np.all(band[1] <= band[3])
    assert envelope(time, np.sin(time / 4000)) is None


def test_bars_are_as_long_as_their_values() -> None:
    drawing = ElementTree.fromstring(
        bar_plot(
            "t",
            "cm",
            Rows(names=["a", "b"], values=[np.array([2.0, 1.0])], styles=["first"], labels=["RMS"]),
        )
    )
    long, short = [float(one.get("width", "")) for one in drawing.iter() if one.tag == "rect"]
    assert long == pytest.approx(2 * short, rel=0.01)


def test_pooling_keeps_the_largest() -> None:
    values = np.random.default_rng(0).uniform(size=(5003, 4))
    found = pooled(values, 700)
    assert found.shape == (700, 4)
    assert found.max(axis=0) == pytest.approx(values.max(axis=0))


def _indices(image: bytes) -> np.ndarray:
    """Palette indices of a PNG with filter 0."""
    width = int.from_bytes(image[16 : 16 + 4], "big")
    height = int.from_bytes(image[20 : 20 + 4], "big")
    start = image.index(b"IDAT") + 4
    size = int.from_bytes(image[start - 8 : start - 4], "big")
    rows = np.frombuffer(zlib.decompress(image[start : start + size]), np.uint8).reshape(
        height, width + 1
    )
    assert not rows[:, 0].any()
    return rows[:, 1:]


def test_a_picture_holds_its_pixels() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (7, 5), dtype=np.uint8)
    assert np.array_equal(_indices(png(pixels, HEAT)), pixels)


def test_a_color_of_the_heat_map_names_its_value() -> None:
    assert len(np.unique(HEAT, axis=0)) == 256


def test_the_heat_map_shows_every_muscle() -> None:
    names = [f"m{i}_r" for i in range(30)]
    values = np.random.default_rng(0).uniform(0, 800, (50, 30))
    drawing = ElementTree.fromstring(
        heat_map(
            "T",
            "N",
            Columns(
                time=np.arange(50.0), values=values, names=names, blocks=[("right", np.arange(30))]
            ),
        )
    )
    (image,) = [one for one in drawing.iter() if one.get("data-names")]
    assert image.get("data-names") == "|".join(names)
    assert float(drawing.get("data-peak", "")) == pytest.approx(values.max())


def test_a_path_on_the_floor_has_one_scale() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    drawing = ElementTree.fromstring(
        floor_plot("p", ("x", "y"), [("r", "right", square)], [("plate", square)])
    )
    (line,) = [one for one in drawing.iter() if one.get("data-label") == "r"]
    flat = np.array([float(one) for one in re.findall(r"-?[\d.]+", line.get("d", ""))]).reshape(
        -1, 2
    )
    assert np.ptp(flat[:, 0]) == pytest.approx(np.ptp(flat[:, 1]), abs=0.2)
    assert floor_plot("p", ("x", "y"), [("r", "right", np.full((3, 2), np.nan))]) == ""
