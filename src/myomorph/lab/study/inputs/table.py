"""Which inputs a trial has: one line each. This table imports nothing, so that the command line
starts fast.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

from myomorph.lab.study.inputs.input import ByType, Input
from myomorph.lab.study.inputs.keys import Key

INPUTS: dict[str, str] = {
    "markers": "myomorph.lab.study.inputs.markers",
    "motion": "myomorph.lab.study.inputs.motion",
    "imu": "myomorph.lab.study.inputs.imu",
    "labels": "myomorph.lab.study.inputs.labels",
    "laboratory": "myomorph.lab.study.inputs.laboratory",
    "tasks": "myomorph.lab.study.inputs.tasks",
    "contacts": "myomorph.lab.study.inputs.contacts",
    "contact points": "myomorph.lab.study.inputs.contact_points",
    "loads": "myomorph.lab.study.inputs.loads",
    "refined": "myomorph.lab.study.inputs.refined",
    "soft tissue": "myomorph.lab.study.inputs.soft_tissue",
    "torques": "myomorph.lab.study.inputs.torques",
    "emg": "myomorph.lab.study.inputs.emg",
    "actuators": "myomorph.lab.study.inputs.actuators",
    "error sizes": "myomorph.lab.study.inputs.error_size_tables",
    "phases": "myomorph.lab.study.inputs.phases",
    "time": "myomorph.lab.study.inputs.time_span",
    "mass": "myomorph.lab.study.inputs.mass",
    "assumed": "myomorph.lab.study.inputs.assumed",
    "truth": "myomorph.lab.study.inputs.truth",
}
"""In the order in which they are opened: an input's name, and the module whose `INPUT` it is,
imported when needed.
"""


def input_of(name: str) -> Input:
    """An input of `INPUTS`."""
    declared: Input = import_module(INPUTS[name]).INPUT
    return declared


def inputs_of(settings: ByType) -> dict[str, Any]:
    """Settings by the names of their inputs, in the order of `INPUTS`; no other module is imported."""
    by_module = {type(value).__module__: value for value in settings}
    return {name: by_module[module] for name, module in INPUTS.items() if module in by_module}


def all_keys() -> dict[str, tuple[Input, Key]]:
    """All keys of study files by name, each with its input."""
    return {
        key.name: (declared, key) for declared in map(input_of, INPUTS) for key in declared.keys
    }


def settings_of_keys(values: Mapping[str, Any], among: Iterable[str] | None = None) -> ByType:
    """Settings of inputs from values of their keys; inputs of which no key has a value are left
    out. `among`: inputs whose keys they are, None for all.
    """
    made = []
    for declared in map(input_of, INPUTS if among is None else among):
        own = {key.name: values[key.name] for key in declared.keys if key.name in values}
        if any(own[key.name] != key.default for key in declared.keys if key.name in own):
            made.append(declared.settings(**own))
    return ByType(*made)
