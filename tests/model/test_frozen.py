"""Values that are declared frozen are frozen.

Their arrays cannot be written, and no class of the package is missed.
"""

from __future__ import annotations

import copy
import copyreg
import importlib
import inspect
import pickle
import pkgutil
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pytest

import myomorph
from myomorph.core.model import shapes
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap

SHAPES = [
    name for name in vars(shapes) if name[0].isupper() and name not in ("TYPE_CHECKING", "Float")
]
ARRAY = re.compile(rf"\b(Ints|Flags|NDArray|ndarray|{'|'.join(SHAPES)})\b")

KERNELS = "kernels take its arrays as they are, and would be compiled anew for read-only ones"
EXCEPTIONS: dict[str, str] = {
    "myomorph.body.refine.trial.TrialState": KERNELS,
    "myomorph.core.fit.unknowns.Block": "holds no array, but a function that gives one",
    "myomorph.body.calibrate.calibration.Calibration": KERNELS,
    "myomorph.body.calibrate.shared_problem.FrameSet": KERNELS,
    "myomorph.body.calibrate.shared_problem.Point": KERNELS,
    "myomorph.body.calibrate.shared_problem.Reduced": KERNELS,
    "myomorph.body.calibrate.shared_problem.SharedProblem": KERNELS,
    "myomorph.body.sensors.fit_mounting.FramesAt": KERNELS,
    "myomorph.core.muscles.coupled_arms.LoopGroup": KERNELS,
    "myomorph.core.muscles.fiber_equations.Fibers": KERNELS,
    "myomorph.core.muscles.fiber_states.FiberStates": KERNELS,
    "myomorph.core.muscles.hill.HillForces": KERNELS,
    "myomorph.core.muscles.kinematics.MuscleKinematics": KERNELS,
    "myomorph.core.motion.newton.SolvedPoses": "kernels write its arrays, a frame at a time",
    "myomorph.core.motion.online.SteadyFrame": KERNELS,
    "myomorph.core.rigid.dynamics.JointWrenches": KERNELS,
    "myomorph.core.tension.elastic.problem.WindowResults": "the windows fill its arrays",
    "myomorph.core.tension.elastic.windows.Paths": KERNELS,
    "myomorph.core.rigid.kinematics.Poses": KERNELS,
    "myomorph.core.rigid.loops.LoopBasis": KERNELS,
}
"""Frozen classes whose arrays may be written, and why."""


WAYS = ("pickled", "copied", "deeply")


class Pair(NamedTuple):
    first: Array
    second: Array


@read_only
@dataclass(frozen=True, eq=False)
class Plain:
    values: Array
    parts: tuple[Array, ...] = ()
    pair: Pair | None = None
    named: Mapping[str, Array] = field(default_factory=dict)
    name: str = ""


@read_only
@dataclass(frozen=True, eq=False)
class Derived(Plain):
    more: Array = field(default_factory=lambda: np.zeros(2))


@read_only
@dataclass(frozen=True, eq=False, slots=True)
class Slotted:
    values: Array
    name: str = ""


@read_only
@dataclass(frozen=True, eq=False)
class Checked:
    values: Array

    def __post_init__(self):
        object.__setattr__(self, "values", np.asarray(self.values, dtype=np.float64))


def plain():
    return Plain(
        values=np.zeros(3),
        parts=(np.zeros(2), np.ones(2)),
        pair=Pair(np.zeros(1), np.ones(1)),
        named={"a": np.zeros(4)},
        name="name",
    )


def arrays_in(value):
    """All arrays in the fields of a value."""
    left = [getattr(value, one.name) for one in fields(value)]
    found = []
    while left:
        one = left.pop()
        if isinstance(one, np.ndarray):
            found.append(one)
        elif isinstance(one, tuple):
            left += one
        elif isinstance(one, Mapping):
            left += one.values()
    return found


def again(value):
    return pickle.loads(pickle.dumps(value))


@pytest.mark.parametrize(
    "way",
    [lambda one: one, again, copy.copy, copy.deepcopy, replace],
    ids=["made", *WAYS, "replaced"],
)
@pytest.mark.parametrize(
    "made",
    [plain, lambda: Derived(np.zeros(3)), lambda: Slotted(np.zeros(3)), lambda: Checked([1, 2])],
)
def test_no_array_can_be_written(made, way):
    value = way(made())
    assert arrays_in(value)
    for array in arrays_in(value):
        assert not array.flags.writeable
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1.0


def test_nothing_is_copied_and_what_was_given_stays_as_it_was():
    values = np.zeros(3)
    value = Plain(values)
    assert np.shares_memory(value.values, values)
    assert values.flags.writeable


def test_kinds_names_and_values_stay():
    value = plain()
    back = again(plain())
    for one in (value, back, replace(value, name="name")):
        assert isinstance(one.pair, Pair)
        assert isinstance(one.parts, tuple)
        assert one.name == "name"
        np.testing.assert_array_equal(one.named["a"], np.zeros(4))
        np.testing.assert_array_equal(one.pair.second, [1.0])
    assert list(inspect.signature(Plain).parameters) == ["values", "parts", "pair", "named", "name"]


def frozen_classes():
    """All frozen dataclasses of the package that have arrays, by full name."""
    found = {}
    for module in pkgutil.walk_packages(myomorph.__path__, "myomorph."):
        if not module.name.endswith("__main__"):
            for one in vars(importlib.import_module(module.name)).values():
                if inspect.isclass(one) and is_dataclass(one) and one.__module__ == module.name:
                    arrays = any(ARRAY.search(str(each.type)) for each in fields(one))
                    if arrays and one.__dataclass_params__.frozen:
                        found[f"{one.__module__}.{one.__qualname__}"] = one
    return found


def test_every_frozen_class_has_read_only_arrays():
    found = frozen_classes()
    assert len(found) > 100
    assert set(EXCEPTIONS) <= set(found), "an exception that is none"
    open_ones = [name for name, one in found.items() if "_arrays_are_read_only" not in vars(one)]
    assert sorted(set(open_ones) - set(EXCEPTIONS)) == []


@pytest.mark.parametrize(
    "way", [lambda one: one, again, copy.copy, copy.deepcopy], ids=["made", *WAYS]
)
def test_a_frozen_map_cannot_be_written_and_travels(way):
    entries = {"b": np.ones(2), "a": 2.0}
    made = FrozenMap(entries)
    entries["c"] = 3.0
    found = way(made)
    assert type(found) is FrozenMap
    assert list(found) == ["b", "a"]
    assert found["a"] == 2.0
    assert found.get("c", -1.0) == -1.0
    with pytest.raises(TypeError):
        found["a"] = 1.0
    with pytest.raises(AttributeError):
        found._entries = {}
    assert not hasattr(found, "update")


def test_every_read_only_mapping_can_be_pickled():
    """`types.MappingProxyType` cannot be pickled by itself.

    The package registers how when it is imported.
    """
    source = Path(myomorph.__file__).parent
    used = [
        path.name
        for path in source.rglob("*.py")
        if "MappingProxyType(" in path.read_text(encoding="utf-8")
    ]
    assert used == []
    assert MappingProxyType not in copyreg.dispatch_table
