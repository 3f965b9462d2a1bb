"""A study takes all that the commands of its steps take, by the same names."""

from __future__ import annotations

import dataclasses
import inspect
import typing

import pytest

from myomorph.lab.cli import personalize
from myomorph.lab.cli.step_command import step_command
from myomorph.lab.store.settings import settings_of
from myomorph.lab.study.inputs.table import all_keys
from myomorph.lab.study.plan.subject_tables import (
    SubjectTable,
    input_keys,
    step_settings,
    trial_table,
)
from myomorph.lab.study.trial.steps.tension import STEP as TENSION

RUN = {"out": "run --out", "threads": "run --workers", "options": "[options.STEP]"}
"""Parameters that belong to a run of the whole study."""
TABLES = dict.fromkeys(("draws", "uncertainty", "method", "workers"), "uncertainty")
"""Parameters whose place is a table of their own, a step's."""

COMMANDS = {
    "tension": step_command("tension"),
    "muscles": step_command("muscles"),
    "personalize": personalize.personalize_command,
}


def taken_by(command, parameter):
    """Names of the options that a command takes as one parameter."""
    kind = inspect.signature(command, eval_str=True).parameters[parameter].annotation
    return {one.name for one in dataclasses.fields(typing.get_args(typing.get_args(kind)[0])[0])}


def named(command):
    """Names of all that a command takes, of options that belong together each."""
    names = set()
    for name, parameter in inspect.signature(command, eval_str=True).parameters.items():
        kind = (*typing.get_args(parameter.annotation), parameter.annotation)[0]
        kind = (*typing.get_args(kind), kind)[0]
        is_group = dataclasses.is_dataclass(kind)
        names |= {field.name for field in dataclasses.fields(kind)} if is_group else {name}
    return names


@pytest.mark.parametrize("name", COMMANDS)
def test_every_file_of_a_command_is_a_key_of_a_subject_or_a_trial(name):
    keys = {
        *input_keys("subject", SubjectTable),
        *trial_table().model_fields,
        *SubjectTable.model_fields,
    }
    asked = named(COMMANDS[name]) - {*RUN, *TABLES, *taken_by(COMMANDS[name], "options")}
    assert set(TABLES.values()) <= set(step_settings())
    assert asked <= keys, sorted(asked - keys)


@pytest.mark.parametrize("step", ["tension", "muscles"])
def test_every_option_of_a_command_is_a_setting_of_its_step(step):
    own = taken_by(COMMANDS[step], "options")
    keys = {name for name, (_, key) in all_keys().items() if key.kind.option_of == step}
    assert own | keys == {setting.name for setting in step_settings()[step]}


def test_options_of_personalize_are_settings_of_its_step_or_of_those_before():
    own = {one.name for one in dataclasses.fields(typing.get_args(personalize.PersonalSettings)[0])}
    known = {setting.name for step in ("personalize", "id") for setting in step_settings()[step]}
    assert own <= known, sorted(own - known)


def test_help_of_a_setting_is_one_line_and_the_same_everywhere():
    shown = {setting.name: setting.help for setting in step_settings()["tension"]}
    for source in TENSION.options:
        for setting in settings_of(source):
            assert setting.help
            assert shown[setting.name] == setting.help
