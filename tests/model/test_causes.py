"""Causes: each is declared once, in its wing, with all that a page says of it."""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path

import pytest

import myomorph
from myomorph.core.model.messages import OTHER, SEVERITIES, Cause
from myomorph.core.model.severity import (
    ANGLE_ERROR,
    FORCE_ERROR,
    MOST_FRAMES,
    severity_of,
    severity_of_share,
)
from myomorph.lab.store.quantity_table import stated_quantities

HOME = Path(myomorph.__file__).parent
PLACES = (
    "myomorph.core.model.causes",
    "myomorph.body.causes",
    "myomorph.lab.causes",
    "myomorph.bones.causes",
    "myomorph.swings.causes",
    "myomorph.exchange.causes",
    "myomorph.forward.causes",
)
CAUSES = [
    (place, cause)
    for place in PLACES
    for cause in vars(import_module(place)).values()
    if isinstance(cause, Cause)
]
CARRIED = ("notes", "warnings")
"""Fields of values that carry messages."""


def test_keys_and_titles_are_those_of_one_cause() -> None:
    causes = [cause for _, cause in CAUSES] + [OTHER]
    for names in ([cause.key for cause in causes], [cause.title for cause in causes]):
        assert len(set(names)) == len(names)


@pytest.mark.parametrize(("place", "cause"), CAUSES, ids=lambda value: getattr(value, "key", ""))
def test_a_cause_says_what_it_does_in_words_and_in_names(place: str, cause: Cause) -> None:
    assert cause.severity in SEVERITIES
    assert cause.effect.endswith(".")
    assert not cause.title.endswith(".")
    assert cause.remedy.endswith(".") or cause.severity == "good to know"
    assert "{size}" in cause.size or not cause.size
    known = {quantity.name for quantity in stated_quantities()}
    assert set(cause.quantities) <= known


def test_a_cause_is_made_nowhere_but_where_its_wing_declares_them() -> None:
    declared = {HOME.joinpath(*place.split(".")[1:]).with_suffix(".py") for place in PLACES}
    allowed = {
        *declared,
        HOME / "core/model/messages.py",
        HOME / "lab/study/trial/message_table.py",
    }
    for path in HOME.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        calls = [node.func for node in ast.walk(tree) if isinstance(node, ast.Call)]
        made = any(isinstance(func, ast.Name) and func.id == "Cause" for func in calls)
        assert not made or path in allowed, path


@pytest.mark.parametrize("wing", ["core", "body"])
def test_values_carry_messages_and_no_bare_texts(wing: str) -> None:
    """Mypy then holds that each is made with its cause."""
    for path in (HOME / wing).rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
                continue
            kind = ast.unparse(node.annotation)
            assert node.target.id not in CARRIED or "str" not in kind, f"{path}: {kind}"


def test_severity_is_by_the_change_against_the_error_of_the_number() -> None:
    weight = 700.0
    assert severity_of(13.7, FORCE_ERROR * weight) == "good to know"
    assert severity_of(-60.0, FORCE_ERROR * weight) == "may change results"
    assert severity_of(300.0, FORCE_ERROR * weight) == "changes results"
    assert severity_of(1.0, ANGLE_ERROR) == "good to know"
    assert severity_of_share(MOST_FRAMES, "changes results") == "good to know"
    assert severity_of_share(0.2, "changes results") == "changes results"
