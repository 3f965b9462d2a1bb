"""What the wing of swings adds: the command `viscosity`, its steps, and a demonstration of it."""

from myomorph.core.model.extension import (
    CommandEntry,
    DemoEntry,
    Extension,
    FolderReader,
    SampleEntry,
    StepEntry,
)

EXTENSION = Extension(
    commands={
        "viscosity": CommandEntry(
            function="myomorph.swings.command:viscosity_command",
            help=(
                "Viscosity of a joint and of its muscles from a swinging limb, in vitro or relaxed."
            ),
            example="myomorph viscosity shoulder.toml --out shoulder",
            panel="The body",
            first_options=(
                "out",
                "model",
                "intact",
                "removed",
                "intact-loads",
                "removed-loads",
                "template",
                "time",
                "cutoff",
                "muscle-mass",
                "instruments",
            ),
            rare_options=("block", "min-relative-speed"),
            option_panels={
                "Inputs and outputs": (
                    "template",
                    "intact",
                    "removed",
                    "intact-loads",
                    "removed-loads",
                    "muscle-mass",
                    "base",
                    "first-body",
                ),
                "Forces and filter": ("tare",),
                "Contacts": ("find-contact", "contact-threshold"),
                "Errors and intervals": ("level", "seed"),
            },
        )
    },
    steps=(
        StepEntry(
            name="viscosity",
            place="myomorph.swings.viscosity.study.specimen_step:STEP",
            scope="specimen",
        ),
        StepEntry(
            name="relaxed", place="myomorph.swings.viscosity.study.limb_step:STEP", scope="limb"
        ),
        StepEntry(
            name="cohort", place="myomorph.swings.viscosity.study.cohort_step:STEP", scope="cohort"
        ),
    ),
    demos={
        "shoulder": DemoEntry(
            run="myomorph.swings.command:run_demo",
            help="six virtual shoulders that swing on a force plate",
            needs={"igl": "libigl"},
            extra="demo",
        )
    },
    reports=(
        FolderReader(
            files=("viscosity.json",),
            function="myomorph.swings.viscosity.study.results:remake_report",
        ),
    ),
    replays=(
        FolderReader(
            files=("swings.json", "*/swings.json"),
            function="myomorph.swings.viscosity.study.viewing:swings_of",
        ),
    ),
    samples={"swings": SampleEntry(make="myomorph.swings.samples:swings")},
)
