"""Help in panels: what most users need first, everything by `--help-all`."""

from __future__ import annotations

import pytest
from docs_build.command_line import help_of_all

from myomorph.lab.cli.app import PANELS as COMMAND_PANELS
from myomorph.lab.cli.app import commands, new_app
from myomorph.lab.cli.panels import ALL_FLAG, METHOD, PANELS, first_sentence, option_panel

COMMANDS = commands()
FIRST = {name: entry.first_options for name, entry in COMMANDS.items() if entry.first_options}
MAX_OPTIONS = 40
SCREEN = 40
"""Lines of a terminal, at 80 columns."""


def options_of(command: str) -> set[str]:
    names = [
        name
        for argument in new_app()[command].assemble_argument_collection()
        for name in argument.names
    ]
    return {name.removeprefix("--") for name in names if not name.startswith(("--no-", "--empty-"))}


def test_tension_fits_two_screens(command):
    assert len(command("tension", "--help").out.splitlines()) <= 2 * SCREEN


@pytest.mark.parametrize("name", COMMANDS)
def test_all_options_are_in_the_long_help(name, command):
    text = command(name, ALL_FLAG).out
    rare = set(COMMANDS[name].rare_options)
    assert {
        option
        for option in options_of(name) - rare
        if option.islower() and f"--{option}" not in text
    } == set()
    assert not {option for option in rare if f"--{option} " in text}


@pytest.mark.parametrize("name", COMMANDS)
def test_the_long_help_is_not_too_long(name):
    options = {option for option in options_of(name) if option.islower()}
    assert len(options - set(COMMANDS[name].rare_options)) <= MAX_OPTIONS


@pytest.mark.parametrize("name", [name for name, entry in COMMANDS.items() if entry.rare_options])
def test_rare_options_exist_and_stand_in_the_reference(name):
    rare = COMMANDS[name].rare_options
    assert set(rare) <= options_of(name)
    assert len(set(rare)) == len(rare)
    section = help_of_all().split(f"## {name}\n")[1].split("\n## ")[0]
    assert [option for option in rare if f"| `--{option}` |" not in section] == []


@pytest.mark.parametrize("name", [name for name, entry in COMMANDS.items() if entry.example])
def test_the_help_shows_what_its_example_uses(name, command):
    text = command(name, "--help").out
    used = [word for word in COMMANDS[name].example.split() if word.startswith("--")]
    assert [option for option in used if f"{option} " not in text.partition("Example:")[0]] == []


@pytest.mark.parametrize("name", FIRST)
def test_the_short_help_shows_what_it_promises(name, command):
    known = options_of(name)
    text = command(name, "--help").out
    assert set(FIRST[name]) <= known
    assert all(f"--{option} " in text for option in FIRST[name])
    rare = len(COMMANDS[name].rare_options)
    hidden = len(known) - rare - sum(f"--{option} " in text for option in known)
    assert hidden == 0 or ALL_FLAG in text


def test_panels_name_options_that_exist():
    known = {option.lower() for name in COMMANDS for option in options_of(name)}
    assert {option for options in PANELS.values() for option in options} - known == set()


@pytest.mark.parametrize("name", [name for name, entry in COMMANDS.items() if entry.option_panels])
def test_panels_of_a_command_name_its_options(name):
    panels = COMMANDS[name].option_panels.values()
    known = {option.lower() for option in options_of(name)}
    assert {option for options in panels for option in options} - known == set()


def test_every_command_is_in_a_panel():
    assert {entry.panel for entry in COMMANDS.values()} == set(COMMAND_PANELS)


def test_where_an_option_stands():
    assert (option_panel("emg-side"), option_panel("joint-load"), option_panel("iterations")) == (
        "EMG",
        "Muscles",
        METHOD,
    )


def test_first_sentence():
    assert (
        first_sentence("Low-pass filter [Hz]; 0 for none, e.g. always. More.")
        == "Low-pass filter [Hz]."
    )
    assert first_sentence("Files (.mot, .sto) of forces.") == "Files (.mot, .sto) of forces."
