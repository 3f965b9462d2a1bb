"""What the wing of bones adds: the command and the step `morph`, and a demonstration of it."""

from myomorph.core.model.extension import CommandEntry, DemoEntry, Extension, StepEntry

EXTENSION = Extension(
    commands={
        "morph": CommandEntry(
            function="myomorph.bones.command:morph_command",
            help="Transfer muscles to other bones: those of a subject or of another species.",
            example=(
                "myomorph morph --source generic.osim --bones scan --landmarks pairs.csv --out"
                " subject.osim"
            ),
            panel="The body",
            first_options=(
                "bones",
                "landmarks",
                "mass",
                "mirror",
                "across",
                "species",
                "joints",
                "map",
                "clear",
                "balance",
                "fibers",
            ),
            option_panels={
                "Inputs and outputs": (
                    "source",
                    "bones",
                    "geometry",
                    "unit",
                    "link",
                    "species",
                    "target",
                    "target-geometry",
                    "together",
                    "mirror",
                    "across",
                    "beside",
                ),
                "Muscles": ("fibers", "force", "pennation", "architecture"),
            },
        )
    },
    steps=(
        StepEntry(
            name="morph",
            place="myomorph.bones.study.morphing:STEP",
            scope="subject",
            before="calibrate",
        ),
    ),
    demos={
        "morph": DemoEntry(
            run="myomorph.bones.command:run_demo",
            help="a leg's muscles transferred to bones whose deformation is known",
            needs={"igl": "libigl"},
            extra="demo",
        )
    },
)
