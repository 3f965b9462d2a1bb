"""The report's input as a file, so that the page can be made again from results alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from myomorph.model.errors import BadFile
from myomorph.model.provenance import Estimate
from myomorph.report.page.head import Note, SourceFile, Step
from myomorph.report.page.section import Figure
from myomorph.viscosity.report import given as shown
from myomorph.viscosity.report.given import ViscosityInput
from myomorph.viscosity.report.page import viscosity_page
from myomorph.viscosity.study.files import write_whole
from myomorph.viscosity.viscosity import MuscleViscosity

STORE, REPORT = "viscosity.json", "report.html"
KIND, ARRAY = "is", "array"
DIGITS = 6

NOUNS: dict[str, Any] = {
    one.__name__: one
    for one in (
        Estimate,
        Figure,
        MuscleViscosity,
        Note,
        SourceFile,
        Step,
        shown.ArmError,
        shown.ArmSpread,
        shown.CutoffScan,
        shown.HeldOutSwing,
        shown.PassiveModel,
        shown.Residual,
        shown.ShownCondition,
        shown.SpecimenReport,
        shown.SwingCurves,
        shown.ViscosityInput,
    )
}


def write_store(given: ViscosityInput, folder: Path) -> None:
    """Write what a report shows, arrays to six digits."""
    write_whole(json.dumps(_plain(given), separators=(",", ":")) + "\n", folder / STORE)


def read_store(folder: Path) -> ViscosityInput:
    """What `write_store` wrote.

    Raises
    ------
    BadFile
        where it is something else
    """
    path = folder / STORE
    try:
        found = json.loads(path.read_text(encoding="utf-8"), object_hook=_value)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadFile(path, f"is no result of 'myomorph viscosity' ({error})", "run the study again") from None
    if not isinstance(found, ViscosityInput):
        raise BadFile(path, "is no result of 'myomorph viscosity'", "run the study again")
    return found


def remake_report(folder: Path) -> Path:
    """Make `report.html` of a folder of results again.

    Raises
    ------
    BadFile
        as `read_store`
    """
    write_whole(viscosity_page(read_store(folder)), folder / REPORT)
    return folder / REPORT


def _plain(value: object) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return {KIND: type(value).__name__} | {one.name: _plain(getattr(value, one.name)) for one in fields(value)}
    if isinstance(value, np.ndarray):
        if value.dtype.kind != "f":
            return {KIND: ARRAY, "values": value.tolist(), "whole": True}
        return {KIND: ARRAY, "values": [float(f"{one:.{DIGITS}g}") for one in value.ravel()], "shape": value.shape}
    if isinstance(value, Mapping):
        return {"of": {str(name): _plain(one) for name, one in value.items()}}
    if isinstance(value, tuple | list):
        return [_plain(one) for one in value]
    if isinstance(value, np.generic):
        return value.item()
    return value


def _value(found: dict[str, Any]) -> Any:
    kind = found.pop(KIND, None)
    if kind is None:
        return MappingProxyType(found["of"]) if set(found) == {"of"} else found
    if kind == ARRAY:
        if found.get("whole"):
            return np.array(found["values"])
        return np.array(found["values"], dtype=np.float64).reshape(found["shape"])
    return NOUNS[kind](**{name: tuple(one) if isinstance(one, list) else one for name, one in found.items()})
