"""The commands and where each is found; a command's module is imported only when it is called."""

from __future__ import annotations

from typing import NamedTuple

from cyclopts import App, Group, Parameter

from myomorph import __version__
from myomorph.lab.cli.panels import PanelHelp
from myomorph.lab.study.step.step_table import STEPS

PANELS = {
    "Main job": ("demo", "analyze", "run", "report", "view"),
    "The body": (
        "calibrate",
        "morph",
        "refine",
        "identify",
        "transfer",
        "personalize",
        "viscosity",
    ),
    "The movement and its forces": ("ik", "id", "muscles", "tension", "uncertainty", "live"),
    "Files": ("info", "convert", "export", "run-tool"),
}
"""Panels of commands in the program's help."""


class Command(NamedTuple):
    """Where a command is found, what it does, and an example of its use."""

    module: str
    help: str
    example: str


COMMANDS = {
    "demo": Command(
        "study",
        "The main job on data that come with the installation, from markers to a report.",
        "myomorph demo --out demo",
    ),
    "analyze": Command(
        "analyze",
        "From raw recordings to a report, with nothing written by hand.",
        "myomorph analyze walk1.c3d --mass 72.6 --out walk1",
    ),
    "run": Command(
        "study",
        "Run a study file: subjects, models, trials and steps.",
        "myomorph run study.toml --out results",
    ),
    "run-tool": Command(
        "files",
        "Run an OpenSim setup file: ScaleTool, InverseKinematicsTool, InverseDynamicsTool or"
        " AnalyzeTool.",
        "myomorph run-tool scale_setup.xml",
    ),
    "info": Command(
        "files",
        "What is in a model, C3D, TRC, MOT or STO file, and what is wrong with it.",
        "myomorph info walk1.c3d",
    ),
    "convert": Command(
        "files",
        "A recording as other files: C3D to TRC, MOT with external loads and STO, and back.",
        "myomorph convert walk1.c3d --out walk1",
    ),
    "export": Command(
        "files",
        "A model for MuJoCo, with a certificate of what differs; or a study as a dataset of BIDS.",
        "myomorph export subject.osim --mjcf subject.xml",
    ),
    "calibrate": Command(
        "calibrate",
        "Link lengths and marker positions of the body that recordings show.",
        "myomorph calibrate --model generic.osim --markers walk1.trc squat1.trc --static static.trc"
        " --mass 72.6 --out subject.osim",
    ),
    "morph": Command(
        "myomorph.bones.command",
        "A model's muscles in other bones: those of a subject or of another species.",
        "myomorph morph --source generic.osim --bones scan --landmarks pairs.csv --out"
        " subject.osim",
    ),
    "ik": Command(
        "step_command",
        "Inverse kinematics: coordinates of recorded markers, inertial sensors, or both.",
        "myomorph ik --model subject.osim --markers walk1.trc --out walk1.mot",
    ),
    "id": Command(
        "step_command",
        "Inverse dynamics: the generalized force of every coordinate.",
        "myomorph id --model subject.osim --motion walk1.mot --loads walk1_grf.xml --cutoff 6 --out"
        " walk1_torques.sto",
    ),
    "muscles": Command(
        "step_command",
        "Muscle lengths, lengthening velocities and moment arms.",
        "myomorph muscles --model subject.osim --motion walk1.mot --out walk1_muscles",
    ),
    "tension": Command(
        "step_command",
        "Muscle tensions that make the joint torques with the least effort.",
        "myomorph tension --model subject.osim --motion walk1.mot --loads walk1_grf.xml --cutoff 6"
        " --out walk1_tension",
    ),
    "uncertainty": Command(
        "step_command",
        "How far errors in markers, plates, model and muscles move the results.",
        "myomorph uncertainty --model subject.osim --motion walk1.mot --loads walk1_grf.xml --draws"
        " 200 --out walk1",
    ),
    "live": Command(
        "myomorph.live.command",
        "Joint angles, torques and muscle activations while frames arrive, from streams or a"
        " recording.",
        "myomorph live --model subject.osim --markers walk1.trc --loads walk1_grf.xml --web 8080",
    ),
    "refine": Command(
        "refine",
        "Motions, link lengths, marker positions and masses that agree with markers and force"
        " plates at once.",
        "myomorph refine --model subject.osim --markers walk1.trc jump1.trc --loads walk1_grf.xml"
        " jump1_grf.xml --mass 72.6 --out refined.osim",
    ),
    "identify": Command(
        "identify",
        "Masses, mass centers and inertias of every body from motions, their forces and the body's"
        " shape.",
        "myomorph identify --model subject.osim --motion walk1.mot jump1.mot --loads walk1.xml"
        " jump1.xml --mass 72.6 --cutoff 6 --out identified.osim",
    ),
    "transfer": Command(
        "transfer",
        "A subject's lengths, marker positions and masses for a model with more joints.",
        "myomorph transfer --model subject.osim --to detailed.osim --out detailed_subject.osim",
    ),
    "personalize": Command(
        "personalize",
        "Fiber lengths, tendon slack lengths and strengths of a person's muscles, from torques and"
        " EMG.",
        "myomorph personalize --model subject.osim --motion walk1.mot --loads walk1_grf.xml"
        " --cutoff 6 --out personalized.osim",
    ),
    "viscosity": Command(
        "myomorph.swings.command",
        "Viscosity of a joint and of its muscles from a swinging limb, in vitro or relaxed.",
        "myomorph viscosity shoulder.toml --out shoulder",
    ),
    "report": Command(
        "files", "Make report.html of a folder of results.", "myomorph report results"
    ),
    "view": Command(
        "files",
        "Show results in a web page: the body moves, with its muscles and forces.",
        "myomorph view demo",
    ),
}

HELP = """From markers, force plates and EMG to the forces inside one body.

Start with `myomorph demo`. Exit status: 0 done, 2 bad input, 1 a fault of Myomorph. `--debug` with any command shows
where an error came from. `--help` with a command shows what most users need, `--help-all` every option.
"""


def command_names() -> tuple[str, ...]:
    """All commands: those above, and one for every other step of a trial."""
    return (*COMMANDS, *(step for step in STEPS["trial"] if step not in COMMANDS))


def new_app(everything: bool = False) -> App:
    """The program with all its commands. `everything`: help names every option, with its whole
    text.
    """
    app = App(
        name="myomorph",
        help=HELP,
        version=__version__,
        suppress_keyboard_interrupt=False,
        help_format="markdown",
        default_parameter=Parameter(negative_iterable=(), negative_none=(), consume_multiple=True),
    )
    panels = {title: Group.create_ordered(title) for title in PANELS}
    groups = {name: panels[title] for title, names in PANELS.items() for name in names}
    for name, command in COMMANDS.items():
        is_guest = "." in command.module
        module = command.module if is_guest else f"myomorph.lab.cli.{command.module}"
        app.command(
            f"{module}:{name.replace('-', '_')}_command",
            name=name,
            group=groups.get(name),
            help=command.help,
            help_epilogue=f"Example: `{command.example}`",
            help_formatter=PanelHelp(name, everything),
        )
    for name in command_names()[len(COMMANDS) :]:
        app.command(
            f"myomorph.lab.cli.step_command:{name}_command",
            name=name,
            group=groups.get(name),
            help_formatter=PanelHelp(name, everything),
        )
    return app
