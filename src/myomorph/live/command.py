"""`live`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

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

LiveSettings = flags.options_class(
    ChainOptions, TensionOptions, LimitOptions, leave_out=("draw_seed", "widened")
)
LiveInputs = flags.inputs_class("labels", "imu")


@flags.documented
def live_command(
    *,
    model: Annotated[
        Path | None, Parameter(name="--model", help="OpenSim (.osim) or MuJoCo (.xml) model.")
    ] = None,
    markers: Path | None = None,
    loads: Path | None = None,
    inputs: LiveInputs | None = None,  # type: ignore[valid-type]
    speed: float = 1.0,
    lsl_markers: str = "",
    lsl_imu: str = "",
    lsl_forces: str = "",
    up: Literal["y", "z"] = "y",
    web: int | None = None,
    lsl_out: str = "",
    out: Path | None = None,
    recover: Path | None = None,
    uncertainty: flags.UncertaintyFile = None,
    options: LiveSettings | None = None,  # type: ignore[valid-type]
) -> int:
    """Joint angles, torques and muscle activations while frames arrive.

    Parameters
    ----------
    markers : recording to play: markers (.trc, .c3d), or coordinates (.mot, .sto)
    loads : its external forces: an OpenSim external loads file (.xml), or a table of plates (.mot),
        each given to the foot that is nearest. A C3D file's own plates by default
    speed : of the recording, times real time; 0 as fast as it goes
    lsl_markers : stream of markers of the Lab Streaming Layer
    lsl_imu : stream of orientations of inertial sensors; --imu plays a recording of them
    lsl_forces : stream of forces of the Lab Streaming Layer
    up : vertical axis of the streams' laboratory; the model's is y
    web : port of a web page on this machine that shows the body
    lsl_out : send coordinates, torques and activations as a stream of this name
    out : folder for tables of all frames, and of how late each of them was
    recover : folder of a session that was killed: write its results from the log that is left
    """
    from myomorph.lab.store.settings import with_settings
    from myomorph.lab.study.trial.uncertainty_file import read_sizes
    from myomorph.lab.uncertainty.sources import Sources
    from myomorph.live.run import (
        LiveFiles,
        LiveOutputs,
        LiveSensors,
        LiveStreams,
        recover_session,
        run_live_chain,
    )

    if recover is not None:
        _say(recover_session(recover), recover)
        return 0
    if model is None:
        raise BadData("live needs a model (--model FILE), or a session to recover")
    given = flags.inputs_of_flags(inputs, near=True)
    sensors = given.or_default(ImuFiles)
    labels = given.or_default(Labels).labels
    if sum(map(bool, (markers, lsl_markers, sensors.imu, lsl_imu))) != 1:
        raise BadData(
            "live needs either a recording (--markers FILE, --imu FILE ...) or a stream"
            " (--lsl-markers NAME, --lsl-imu NAME)"
        )
    if (lsl_markers or lsl_imu) and loads is not None:
        raise BadData("--loads belongs to a recording: with --lsl-markers give --lsl-forces NAME")
    if not lsl_markers and lsl_forces:
        raise BadData("--lsl-forces belongs to --lsl-markers: with --markers give --loads FILE")
    if markers is None and labels:
        raise BadData(
            "--labels belongs to a recording (--markers): a stream names its channels itself"
        )
    frames: LiveFiles | LiveStreams | LiveSensors = LiveSensors(
        settings=sensors, stream=lsl_imu, loads=loads, speed=speed
    )
    if markers is not None:
        frames = LiveFiles(markers=markers, loads=loads, speed=speed, labels=labels)
    elif lsl_markers:
        frames = LiveStreams(lsl_markers, lsl_forces, up)
    settings = flags.settings_dict(options)
    sizes = {} if uncertainty is None else read_sizes(uncertainty)
    drawn = sizes | ({"draws": settings["draws"]} if settings.get("draws") else {})
    if sizes and not drawn.get("draws"):
        raise BadData(
            f"--uncertainty {uncertainty} without --draws: say how many draws there are to be"
            " (--draws 40)"
        )
    session = run_live_chain(
        model,
        frames,
        LiveOutputs(web, lsl_out, out),
        with_settings(ChainOptions(), settings),
        with_settings(TensionOptions(), settings),
        _status,
        with_settings(LimitOptions(), drawn),
        with_settings(Sources(), sizes),
    )
    _say(session, out)
    return 0


def _say(session: LiveSession, out: Path | None) -> None:
    warn(session.notes)
    for line in session.summary():
        said(line)
    if out is not None:
        said(f"wrote {out}")


def _status(line: str) -> None:
    sys.stderr.write(f"{line}\n")
