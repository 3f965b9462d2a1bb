"""Values as one line and as a table: short for every value that a trial leads to."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from html.parser import HTMLParser

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.model.shown import MAX_LINE, brief, shown

MAX_REPR = MAX_LINE + 100


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Model, recording and results of the arm that holds a weight."""
    files = mm.example_files(tmp_path_factory.mktemp("arm"))
    model = mm.read_model(files.model)
    trial = mm.read_recording(files.markers)
    fit = mm.inverse_kinematics(model, trial.markers)
    motion = mm.differentiate(fit.motion, cutoff=6.0)
    loads = mm.read_loads(files.loads, model, motion)
    wrenches = mm.resample_wrenches(loads, motion.time, cutoff=6.0)
    torques = mm.inverse_dynamics(model, motion, wrenches)
    tension = mm.solve_tension(model, motion, torques)
    elbow = mm.joint_reactions(model, motion, tension, wrenches, joints=["elbow"])
    lengths = mm.muscle_kinematics(model, motion)
    return [model, trial, fit, motion, loads, wrenches, torques, tension, elbow, lengths]


def reached(value: object, depth: int = 4) -> Iterator[object]:
    """Values of the package that hang on one, itself too."""
    if dataclasses.is_dataclass(value) and type(value).__module__.startswith("myomorph"):
        yield value
        if depth:
            for field in dataclasses.fields(value):
                yield from reached(getattr(value, field.name, None), depth - 1)
    elif isinstance(value, Mapping):
        for one in value.values():
            yield from reached(one, depth)
    elif isinstance(value, tuple | list):
        for one in value:
            yield from reached(one, depth)


def test_every_value_is_one_short_line(results) -> None:
    every = [one for result in results for one in reached(result)]
    assert len({type(one) for one in every}) > 20
    long = {type(one).__name__: len(repr(one)) for one in every if len(repr(one)) > MAX_REPR}
    assert not long
    assert not any("\n" in repr(one) for one in every)


class Tags(HTMLParser):
    """Tags that are open, of a text that closes them all in turn."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: object) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_results_are_tables_in_notebooks(results) -> None:
    for result in results:
        text = result._repr_html_()
        tags = Tags()
        tags.feed(text)
        assert tags.open == []
        assert "<table>" in text
        # Pictures of bodies lie in the text.
        assert len(re.sub(r"'data:image/png;base64,[^']*'", "''", text)) < 40_000
        assert len(text) < 400_000


def test_models_and_motions_have_a_drawing(results) -> None:
    model, _, fit = results[:3]
    assert model.drawing().count("<line") == len(model.bodies) - 1
    assert fit.motion.drawing().count("<polyline") == len(fit.motion.names)
    assert results[1].markers.drawing() == ""


def test_a_model_is_told_by_its_counts(results) -> None:
    model = results[0]
    assert repr(model).startswith(f"Model('{model.name}': {len(model.bodies)} bodies, ")
    assert "Hz" in repr(results[1].markers)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.zeros((3, 4)), "array(3, 4)"),
        (np.zeros(9), "array(9)"),
        (np.array([1.0, 2.5]), "[1, 2.5]"),
        ("x" * 90, f"'{'x' * 45}...'"),
        (("a", "b"), "('a', 'b')"),
        (tuple("abcdef"), "(6 names)"),
        ({"a": 1}, "{1 by name}"),
        (None, "None"),
        (0.1 + 0.2, "0.3"),
    ],
)
def test_fields_are_told_in_a_few_words(value: object, text: str) -> None:
    assert brief(value) == text


def test_fields_as_by_default_are_left_out() -> None:
    @shown
    @dataclasses.dataclass(frozen=True)
    class Options:
        """Some."""

        speed: float
        range: tuple[float, float] = (0.0, 1.0)
        names: tuple[str, ...] = ()

    assert repr(Options(2.0)) == "Options(speed=2)"
    assert repr(Options(2.0, (0.0, 2.0), ("a",))) == "Options(speed=2, range=(0, 2), names=('a'))"
    assert "range" in Options(2.0)._repr_html_()
