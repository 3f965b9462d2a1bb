"""What the wing of exchange adds: models for MuJoCo, OpenSim's setups, datasets of BIDS."""

from myomorph.core.model.extension import CommandEntry, Extension, Format

EXTENSION = Extension(
    commands={
        "run-tool": CommandEntry(
            function="myomorph.exchange.command:run_tool_command",
            help=(
                "Run an OpenSim setup file: ScaleTool, InverseKinematicsTool, InverseDynamicsTool"
                " or AnalyzeTool."
            ),
            example="myomorph run-tool scale_setup.xml",
            panel="Files",
            option_panels={"Inputs and outputs": ("setup",)},
        ),
        "export": CommandEntry(
            function="myomorph.exchange.command:export_command",
            help=(
                "A model for MuJoCo, with a certificate of what differs; or a study as a dataset"
                " of BIDS."
            ),
            example="myomorph export subject.osim --mjcf subject.xml",
            panel="Files",
            option_panels={"Inputs and outputs": ("source", "mjcf", "geometry")},
        ),
    },
    recordings=(
        Format(
            name="BIDS motion",
            endings=("_motion.tsv",),
            reader="myomorph.exchange.bids.recording:read_motion_trial",
            # Forces are read with their markers.
            part=r"tracksys-forces_[^/]*$|/derivatives/",
        ),
    ),
    channels=(
        Format(
            name="EMG of BIDS",
            endings=(".bdf", ".edf"),
            reader="myomorph.exchange.bids.recording:read_emg",
        ),
    ),
)
