"""What the wing of live frames adds: the command `live`, and `identify --live`."""

from myomorph.core.model.extension import CommandEntry, Extension, MotionSource

EXTENSION = Extension(
    commands={
        "live": CommandEntry(
            function="myomorph.live.command:live_command",
            help=(
                "Joint angles, torques and muscle activations while frames arrive, from streams or"
                " a recording."
            ),
            example=(
                "myomorph live --model subject.osim --markers walk1.trc --loads walk1_grf.xml"
                " --web 8080"
            ),
            panel="The movement and its forces",
            first_options=(
                "model",
                "markers",
                "loads",
                "labels",
                "lsl-markers",
                "lsl-forces",
                "web",
                "lsl-out",
                "out",
                "recover",
                "cutoff",
                "recruitment",
                "draws",
            ),
            option_panels={"Inputs and outputs": ("lsl-out", "recover"), "Running": ("max-age",)},
        )
    },
    motion_sources={
        "live": MotionSource(
            help="show the estimate while frames arrive from files or streams",
            options="myomorph.live.identification:LiveOptions",
            open="myomorph.live.identification:live_motions",
        )
    },
)
