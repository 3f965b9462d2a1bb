"""The commands and where each is found; a command's module is imported only when it is called."""

from __future__ import annotations

from cyclopts import App, Group, Parameter

from myomorph import __version__
from myomorph.core.model.extension import CommandEntry
from myomorph.core.model.registry import extensions, with_extensions
from myomorph.lab.cli import rare_options as rare
from myomorph.lab.cli.panels import METHOD, PanelHelp
from myomorph.lab.study.step.step_table import STEPS

PANELS = ("Main job", "The body", "The movement and its forces", "Files")
"""Panels of commands in the program's help, in their order; those of extensions follow."""

OWN_COMMANDS = {
    "analyze": CommandEntry(
        function="myomorph.lab.cli.analyze:analyze_command",
        help="From raw recordings to a report, without any file written by hand.",
        example="myomorph analyze walk1.c3d --mass 72.6 --out walk1",
        panel="Main job",
        first_options=(
            "mass",
            "age",
            "static",
            "model",
            "loads",
            "protocol",
            "time",
            "emg-muscles",
            "emg-side",
            "draws",
            "out",
            "dry-run",
        ),
        rare_options=rare.ANALYZE,
    ),
    "run": CommandEntry(
        function="myomorph.lab.cli.study:run_command",
        help="Run a study file: subjects, models, trials and steps.",
        example="myomorph run study.toml --out results",
        panel="Main job",
    ),
    "info": CommandEntry(
        function="myomorph.lab.cli.files:info_command",
        help="Contents of a model, C3D, TRC, MOT or STO file, and possible errors in it.",
        example="myomorph info walk1.c3d",
        panel="Files",
    ),
    "convert": CommandEntry(
        function="myomorph.lab.cli.files:convert_command",
        help="Convert recordings: C3D to TRC, MOT with external loads and STO, and back.",
        example="myomorph convert walk1.c3d --out walk1",
        panel="Files",
    ),
    "calibrate": CommandEntry(
        function="myomorph.lab.cli.calibrate:calibrate_command",
        help="Link lengths and marker positions of the recorded body.",
        example=(
            "myomorph calibrate --model generic.osim --markers walk1.trc squat1.trc --static"
            " static.trc --mass 72.6 --out subject.osim"
        ),
        panel="The body",
        first_options=(
            "markers",
            "static",
            "marker-set",
            "tasks",
            "labels",
            "mass",
            "time",
            "symmetric",
            "frames",
        ),
    ),
    "ik": CommandEntry(
        function="myomorph.lab.cli.step_command:ik_command",
        help="Inverse kinematics: coordinates of recorded markers, inertial sensors, or both.",
        example="myomorph ik --model subject.osim --markers walk1.trc --out walk1.mot",
        panel="The movement and its forces",
        first_options=(
            "markers",
            "imu",
            "imu-pose",
            "imu-bodies",
            "imu-heading",
            "imu-mounting",
            "tasks",
            "labels",
            "time",
            "draws",
            "repair",
            "root-bounds",
        ),
    ),
    "id": CommandEntry(
        function="myomorph.lab.cli.step_command:id_command",
        help="Inverse dynamics: the generalized force of every coordinate.",
        example=(
            "myomorph id --model subject.osim --motion walk1.mot --loads walk1_grf.xml"
            " --cutoff 6 --out walk1_torques.sto"
        ),
        panel="The movement and its forces",
        first_options=(
            "loads",
            "bodies",
            "plates",
            "time",
            "cutoff",
            "force-checks",
            "net",
            "draws",
        ),
    ),
    "muscles": CommandEntry(
        function="myomorph.lab.cli.step_command:muscles_command",
        help="Muscle lengths, lengthening velocities and moment arms.",
        example="myomorph muscles --model subject.osim --motion walk1.mot --out walk1_muscles",
        panel="The movement and its forces",
    ),
    "tension": CommandEntry(
        function="myomorph.lab.cli.step_command:tension_command",
        help="Muscle tensions that produce the joint torques with minimum effort.",
        example=(
            "myomorph tension --model subject.osim --motion walk1.mot --loads walk1_grf.xml"
            " --cutoff 6 --out walk1_tension"
        ),
        panel="The movement and its forces",
        first_options=(
            "loads",
            "emg",
            "contacts",
            "time",
            "cutoff",
            "recruitment",
            "passive",
            "tendons",
            "reactions",
            "draws",
        ),
        rare_options=rare.TENSION,
    ),
    "uncertainty": CommandEntry(
        function="myomorph.lab.cli.step_command:uncertainty_command",
        help="Effects of errors in markers, plates, model and muscles on the results.",
        example=(
            "myomorph uncertainty --model subject.osim --motion walk1.mot --loads"
            " walk1_grf.xml --draws 200 --out walk1"
        ),
        panel="The movement and its forces",
        first_options=(
            "loads",
            "plates",
            "time",
            "draws",
            "contributions",
            "marker-noise",
            "placement",
            "plate-position",
            "body-mass",
            "joint-center",
        ),
        rare_options=rare.UNCERTAINTY,
    ),
    "refine": CommandEntry(
        function="myomorph.lab.cli.refine:refine_command",
        help=(
            "Motions, link lengths, marker positions and masses that fit markers and force"
            " plates together."
        ),
        example=(
            "myomorph refine --model subject.osim --markers walk1.trc jump1.trc --loads"
            " walk1_grf.xml jump1_grf.xml --mass 72.6 --out refined.osim"
        ),
        panel="The body",
        first_options=(
            "markers",
            "loads",
            "plates",
            "mass",
            "tasks",
            "labels",
            "time",
            "cutoff",
            "fit",
            "check",
        ),
    ),
    "body": CommandEntry(
        function="myomorph.lab.cli.body:body_command",
        help="A person's body from height, chest, sex and mass: model, skin, a picture.",
        example="myomorph body --height 1.75 --chest 0.95 --sex male --out body.osim",
        panel="The body",
    ),
    "identify": CommandEntry(
        function="myomorph.lab.cli.identify:identify_command",
        help=(
            "Masses, mass centers and inertias of every body from motions, their forces and"
            " the body's shape."
        ),
        example=(
            "myomorph identify --model subject.osim --motion walk1.mot jump1.mot --loads"
            " walk1.xml jump1.xml --mass 72.6 --cutoff 6 --out identified.osim"
        ),
        panel="The body",
        first_options=(
            "motion",
            "mass",
            "loads",
            "plates",
            "skin",
            "height",
            "chest",
            "sex",
            "check-motion",
            "check-loads",
            "time",
            "cutoff",
        ),
        rare_options=rare.IDENTIFY,
        option_panels={METHOD: ("weights",)},
    ),
    "transfer": CommandEntry(
        function="myomorph.lab.cli.transfer:transfer_command",
        help="Transfer a subject's lengths, markers and masses to a model with more joints.",
        example=(
            "myomorph transfer --model subject.osim --to detailed.osim --out detailed_subject.osim"
        ),
        panel="The body",
    ),
    "personalize": CommandEntry(
        function="myomorph.lab.cli.personalize:personalize_command",
        help=(
            "Fiber lengths, tendon slack lengths and strengths of a person's muscles, from"
            " torques and EMG."
        ),
        example=(
            "myomorph personalize --model subject.osim --motion walk1.mot --loads"
            " walk1_grf.xml --cutoff 6 --out personalized.osim"
        ),
        panel="The body",
        first_options=(
            "motion",
            "loads",
            "torques",
            "emg",
            "passive",
            "time",
            "cutoff",
            "tendons",
            "sides",
            "hold-out",
            "generic",
        ),
    ),
    "report": CommandEntry(
        function="myomorph.lab.cli.report:report_command",
        help="Write report.html for results, or a page that compares two sessions of walking.",
        example="myomorph report results",
        panel="Main job",
    ),
    "norms": CommandEntry(
        function="myomorph.lab.cli.norms:norms_command",
        help="Write the norms of a control group to a file, for comparison with walks.",
        example="myomorph norms controls/c1 controls/c2 controls/c3 --out controls.csv",
        panel="Files",
    ),
    "view": CommandEntry(
        function="myomorph.lab.cli.view:view_command",
        help="Show results as a web page or a movie of the moving body, with muscles and curves.",
        example="myomorph view demo",
        panel="Main job",
        option_panels={"Movie": ("movie", "size", "time", "seconds", "speed", "curves")},
    ),
}

COMMANDS = with_extensions(OWN_COMMANDS, "command", lambda extension: extension.commands)
"""All commands but those that steps of trials have by themselves."""

HELP = """From markers, force plates and EMG to the forces inside one body.

Start with `myomorph demo`. Exit status: 0 done, 2 bad input, 1 a fault of Myomorph. \
`--debug` with any command shows
where an error came from. `--help` with a command shows what most users need, \
`--help-all` all but rare options.
"""


def commands() -> dict[str, CommandEntry]:
    """All commands: those above, and one for every other step of a trial."""
    helps = {entry.name: entry.help for extension in extensions() for entry in extension.steps}
    steps = {
        name: CommandEntry(
            function=f"myomorph.lab.cli.step_command:{name}_command", help=helps.get(name, name)
        )
        for name in STEPS["trial"]
    }
    return COMMANDS | {name: entry for name, entry in steps.items() if name not in COMMANDS}


def new_app(everything: bool = False) -> App:
    """Make the program with all its commands.

    With `everything`, help names every option, with its whole text.
    """
    app = App(
        name="myomorph",
        help=HELP,
        version=__version__,
        suppress_keyboard_interrupt=False,
        help_format="markdown",
        default_parameter=Parameter(negative_iterable=(), negative_none=(), consume_multiple=True),
    )
    entries = commands()
    titles = dict.fromkeys((*PANELS, *(entry.panel for entry in entries.values() if entry.panel)))
    panels = {title: Group.create_ordered(title) for title in titles}
    for name, entry in entries.items():
        app.command(
            entry.function,
            name=name,
            group=panels.get(entry.panel),
            help=entry.help,
            help_epilogue=f"Example: `{entry.example}`" if entry.example else None,
            help_formatter=PanelHelp(name, entry, everything),
        )
    return app
