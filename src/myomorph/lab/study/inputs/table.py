"""The inputs of a trial: one line each, and those of extensions.

This table imports none of them, so that the command line starts fast.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from myomorph.core.model.errors import BadExtension
from myomorph.core.model.extension import load
from myomorph.core.model.registry import remark, with_extensions
from myomorph.lab.study.inputs.input import ByType, Input, Opened
from myomorph.lab.study.inputs.keys import Key

OWN_INPUTS = {
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
    "person": "myomorph.lab.study.inputs.person",
    "session": "myomorph.lab.study.inputs.session",
    "assumed": "myomorph.lab.study.inputs.assumed",
    "truth": "myomorph.lab.study.inputs.truth",
}
"""In the order in which they are opened: an input's name, and the module whose `INPUT` it is,
imported when needed.
"""

INPUTS: dict[str, str] = with_extensions(OWN_INPUTS, "input", lambda extension: extension.inputs)
"""The same with those of extensions, which are opened last."""


@dataclass(frozen=True)
class _Nothing:
    """Settings of an input that cannot be opened."""


def input_of(name: str) -> Input:
    """Return an input of `INPUTS`.

    An input of an installed package that cannot be imported is replaced by one without keys, so
    that trials without it go on.
    """
    try:
        declared: Input = load(INPUTS[name], "INPUT")
    except BadExtension as error:
        remark(str(error))
        return Input(name=name, settings=_Nothing, open=lambda settings, opening: Opened())
    return declared


def inputs_of(settings: ByType) -> dict[str, Any]:
    """Return settings by the names of their inputs, in the order of `INPUTS`.

    Nothing else is imported.
    """
    by_module = {type(value).__module__: value for value in settings}
    modules = {name: place.partition(":")[0] for name, place in INPUTS.items()}
    return {name: by_module[module] for name, module in modules.items() if module in by_module}


def all_keys() -> dict[str, tuple[Input, Key]]:
    """All keys of study files by name, each with its input."""
    return {
        key.name: (declared, key) for declared in map(input_of, INPUTS) for key in declared.keys
    }


def settings_of_keys(values: Mapping[str, Any], among: Iterable[str] | None = None) -> ByType:
    """Make settings of inputs from values of their keys.

    Inputs of which no key has a value are left out. `among`: inputs whose keys they are, None for
    all.
    """
    made = []
    for declared in map(input_of, INPUTS if among is None else among):
        own = {key.name: values[key.name] for key in declared.keys if key.name in values}
        if any(own[key.name] != key.default for key in declared.keys if key.name in own):
            made.append(declared.settings(**own))
    return ByType.of(made)
