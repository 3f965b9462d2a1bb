"""What the wing of forward dynamics adds: the command `simulate`, its quantities and its pages."""

from myomorph.core.model.extension import CommandEntry, Extension, FolderReader

FILES = ("simulation.nc", "unchanged/simulation.nc")

EXTENSION = Extension(
    commands={
        "simulate": CommandEntry(
            function="myomorph.forward.command:simulate_command",
            help=(
                "Forward dynamics under muscles, torques, passive forces and contacts, also with"
                " other strength, mass or viscosity."
            ),
            example="myomorph simulate --model arm.osim --seconds 1 --out fall",
            panel="The movement and its forces",
            first_options=(
                "start",
                "activations",
                "excitations",
                "torques",
                "reserves",
                "loads",
                "contacts",
                "time",
                "seconds",
                "follow",
                "tendons",
                "certify",
                "weaker",
                "mass",
                "viscosity",
            ),
            option_panels={
                "Inputs and outputs": (
                    "start",
                    "activations",
                    "excitations",
                    "torques",
                    "reserves",
                    "loads",
                    "contacts",
                    "floor",
                    "time",
                    "follow",
                ),
                "What if": ("weaker", "mass", "viscosity"),
            },
        )
    },
    quantities=("myomorph.forward.quantities:QUANTITIES",),
    reports=(FolderReader(files=FILES, function="myomorph.forward.folder:remake_report"),),
    replays=(FolderReader(files=FILES, function="myomorph.forward.folder:simulations_of"),),
)
