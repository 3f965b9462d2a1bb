"""`live`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from myomorph.core.model.errors import BadData
from myomorph.core.tension.tension import TensionOptions
from myomorph.lab.cli import options as flags
from myomorph.lab.cli.output import said, warn
from myomorph.lab.study.inputs.imu import ImuFiles
from myomorph.lab.study.inputs.labels import Labels
from myomorph.live.chain import ChainOptions
from myomorph.live.limits import LimitOptions
from myomorph.live.loop import LiveSession

if TYPE_CHECKING:
    from myomorph.live.run import LiveFiles, LiveSensors, LiveSettings, LiveStreams

LiveChoices = flags.options_class(
    ChainOptions, TensionOptions, LimitOptions, leave_out=("draw_seed", "widened")
)
LiveInputs = flags.inputs_class("labels", "imu")


@flags.documented
@dataclass(frozen=True, kw_only=True)
class FrameOptions:
    """A model, and the frames that it follows.

    Attributes
    ----------
    model : OpenSim (.osim) or MuJoCo (.xml) model
    markers : recording that is played: markers (.trc, .c3d) or coordinates (.mot, .sto)
    loads : external forces of the recording: an OpenSim external loads file (.xml), or a table of
        plates (.mot), each on the nearest foot; by default the plates of a C3D file
    speed : playback speed relative to real time; 0 for as fast as possible
    lsl_markers : name of the marker stream in the Lab Streaming Layer
    lsl_imu : name of the stream of inertial sensor orientations in the Lab Streaming Layer; --imu
        plays a recording instead
    lsl_forces : name of the force stream in the Lab Streaming Layer
    up : vertical axis of the streams; the model's is y
    """

    model: Path | None = None
    markers: Path | None = None
    loads: Path | None = None
    speed: float = 1.0
    lsl_markers: str = ""
    lsl_imu: str = ""
    lsl_forces: str = ""
    up: Literal["y", "z"] = "y"


@flags.documented
@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Where results go.

    Attributes
    ----------
    web : port of a local web page that shows the body
    lsl_out : name of an output stream of coordinates, torques and activations
    out : folder for tables of all frames and of their latency
    recover : folder of an interrupted session, whose results are written from its log
    """

    web: int | None = None
    lsl_out: str = ""
    out: Path | None = None
    recover: Path | None = None


PLAYED = FrameOptions()
NO_OUTPUTS = OutputOptions()


@flags.documented
def live_command(
    *,
    frames: Annotated[FrameOptions, Parameter(name="*")] = PLAYED,
    inputs: LiveInputs | None = None,  # type: ignore[valid-type]
    outputs: Annotated[OutputOptions, Parameter(name="*")] = NO_OUTPUTS,
    uncertainty: flags.UncertaintyFile = None,
    options: LiveChoices | None = None,  # type: ignore[valid-type]
) -> int:
    """Compute joint angles, torques and muscle activations while frames arrive."""
    from myomorph.live.run import LiveOutputs, recover_session, run_live_chain

    if outputs.recover is not None:
        _say(recover_session(outputs.recover), outputs.recover)
        return 0
    if frames.model is None:
        raise BadData("live needs a model (--model FILE), or a session to recover")
    given = flags.inputs_of_flags(inputs, near=True)
    session = run_live_chain(
        frames.model,
        _frames_of(frames, given.or_default(ImuFiles), given.or_default(Labels).labels),
        LiveOutputs(outputs.web, outputs.lsl_out, outputs.out),
        _settings_of(flags.settings_dict(options), uncertainty),
        _status,
    )
    _say(session, outputs.out)
    return 0


def _frames_of(
    frames: FrameOptions, sensors: ImuFiles, labels: Mapping[str, str]
) -> LiveFiles | LiveStreams | LiveSensors:
    """Choose the one source of frames; raises `BadData` where options do not fit together."""
    from myomorph.live.run import LiveFiles, LiveSensors, LiveStreams

    sources = (frames.markers, frames.lsl_markers, sensors.imu, frames.lsl_imu)
    if sum(map(bool, sources)) != 1:
        raise BadData(
            "live needs either a recording (--markers FILE, --imu FILE ...) or a stream"
            " (--lsl-markers NAME, --lsl-imu NAME)"
        )
    if (frames.lsl_markers or frames.lsl_imu) and frames.loads is not None:
        raise BadData("--loads belongs to a recording: with --lsl-markers give --lsl-forces NAME")
    if not frames.lsl_markers and frames.lsl_forces:
        raise BadData("--lsl-forces belongs to --lsl-markers: with --markers give --loads FILE")
    if frames.markers is None and labels:
        raise BadData(
            "--labels belongs to a recording (--markers): a stream names its channels itself"
        )
    if frames.markers is not None:
        return LiveFiles(
            markers=frames.markers, loads=frames.loads, speed=frames.speed, labels=labels
        )
    if frames.lsl_markers:
        return LiveStreams(frames.lsl_markers, frames.lsl_forces, frames.up)
    return LiveSensors(
        settings=sensors, stream=frames.lsl_imu, loads=frames.loads, speed=frames.speed
    )


def _settings_of(settings: Mapping[str, Any], uncertainty: Path | None) -> LiveSettings:
    """Collect the options of what is computed; errors are drawn only where draws are wanted."""
    from myomorph.lab.store.settings import with_settings
    from myomorph.lab.study.trial.uncertainty_file import read_sizes
    from myomorph.lab.uncertainty.sources import Sources
    from myomorph.live.run import LiveSettings

    sizes = {} if uncertainty is None else read_sizes(uncertainty)
    drawn = sizes | ({"draws": settings["draws"]} if settings.get("draws") else {})
    if sizes and not drawn.get("draws"):
        raise BadData(
            f"--uncertainty {uncertainty} without --draws: give the number of draws (--draws 40)"
        )
    return LiveSettings(
        chain=with_settings(ChainOptions(), settings),
        tension=with_settings(TensionOptions(), settings),
        limits=with_settings(LimitOptions(), drawn),
        sources=with_settings(Sources(), sizes),
    )


def _say(session: LiveSession, out: Path | None) -> None:
    warn(session.notes)
    for line in session.summary():
        said(line)
    if out is not None:
        said(f"wrote {out}")


def _status(line: str) -> None:
    sys.stderr.write(f"{line}\n")
