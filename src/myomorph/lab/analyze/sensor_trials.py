"""Recordings of sensors alone: calibration pose, a model of the body's height, their worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from myomorph.core.io.carried_meshes import carry_meshes
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.scale import scale
from myomorph.lab.analyze.generic_model import generic_model
from myomorph.lab.analyze.recorded_trial import AnalyzeRequest
from myomorph.lab.session.recordings import Recording, look_at
from myomorph.lab.session.sensor_recordings import starts_still
from myomorph.lab.study.inputs.imu import ImuFiles
from myomorph.lab.study.inputs.loads import LoadsFile
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.study.trial.uncertainty_file import STEP as UNCERTAINTY

BY_HEIGHT = 0.013
"""Standard deviation of a joint's place where the height alone is known [m]: stature follows from
the femur within 3.3 cm, 2.4 cm for each of its own (Trotter and Gleser 1952).
"""
MIN_FRAMES = 6  # Frames that derivatives need.


def unmarked_request(request: AnalyzeRequest) -> tuple[AnalyzeRequest, str]:
    """Give a request the mass of the model where none was given.

    Returns
    -------
    the request, and what results of sensors alone are worth

    Raises
    ------
    BadData : neither a height nor a model
    """
    if request.model is None and request.height is None:
        raise BadData(
            "inertial sensors show no lengths: give the subject's height (--height M) for the"
            " generic model, or a model of the subject (--model FILE)"
        )
    lengths = "the lengths of segments are those of the model that was given"
    if request.model is None:
        lengths = "the lengths of segments follow from the height alone"
        drawn = request.options.get(UNCERTAINTY)
        if drawn is not None:
            options = {**request.options, UNCERTAINTY: {"joint_center": BY_HEIGHT, **drawn}}
            request = replace(request, options=FrozenMap(options))
    elif request.mass is None:
        request = replace(request, mass=open_model(request.model).mass)
    return (
        request,
        (
            "INERTIAL SENSORS ALONE, no markers and no plates: flexion is as good as the"
            f" calibration pose, {lengths}, and forces under the feet are estimated; torques and"
            " tensions are rougher than with plates (docs: inertial sensors, accuracy)."
        ),
    )


def with_pose(
    request: AnalyzeRequest, sensed: Sequence[Recording], alone: bool
) -> tuple[AnalyzeRequest, list[Recording], list[str]]:
    """Give a request the calibration pose among the recordings, or that of --static.

    Returns
    -------
    the request, the other recordings, and a sentence
    """
    asked = request.inputs.or_default(ImuFiles)
    static = None
    rest = list(sensed)
    if alone and request.static is not None:
        static = look_at(request.static)
    elif not asked.imu_pose and asked.imu_pose_time is None:
        still = [recording for recording in sensed if recording.still]
        if 0 < len(still) < len(sensed):
            static = still[0]
            rest = [recording for recording in sensed if not recording.still]
    if static is None:
        return request, rest, []
    if static.sensors is None:
        raise BadData(
            f"{static.path}: holds no inertial sensors, so it calibrates none (--static,"
            " --imu-pose)"
        )
    inputs = request.inputs.having(replace(asked, imu_pose=static.sensor_files))
    return (
        replace(request, inputs=inputs),
        rest,
        [f"{static.path.name} is the calibration pose of the sensors."],
    )


def check_sensors(recording: Recording, request: AnalyzeRequest) -> None:
    """Refuse a part that is too short, or sensors whose mounting nothing shows.

    Raises
    ------
    BadData
    """
    sensors = recording.sensors
    asked = request.inputs.or_default(ImuFiles)
    assert sensors is not None
    used = sensors if request.time is None else sensors.between(*request.time)
    if len(used) < MIN_FRAMES:
        raise BadData(
            f"{recording.path}: holds {len(used)} frames, derivatives need {MIN_FRAMES} in a row"
        )
    if request.inputs.or_default(LoadsFile).loads is not None:
        raise BadData(
            "--loads with inertial sensors alone: they do not show where on the plates the feet are"
        )
    posed = asked.imu_pose or asked.imu_pose_time is not None
    if (
        not posed
        and request.options.get("ik", {}).get("imu_mounting") != "model"
        and not starts_still(sensors)
    ):
        raise BadData(
            f"{recording.path}: it does not begin with quiet standing, so the mounting of its"
            " sensors is unknown: give a recording of the same sensors in quiet standing"
            " (--static"
            " FILE), or its time in this one (--imu-pose-time START END)"
        )


def unmarked_model(request: AnalyzeRequest, path: Path) -> tuple[Model, Path, list[str]]:
    """Choose the model of a body that no marker shows.

    The generic one, written to `path`, has the subject's height and mass; one that was given is
    taken as it is.

    Returns
    -------
    the model, its file, and a sentence on it
    """
    if request.model is not None:
        model = open_model(request.model)
        text = f"{request.model.name} is used as it is, its lengths and its {model.mass:.1f} kg."
        return model, request.model, [text]
    model, _ = generic_model(FrozenMap({}), request.height, request.mass)
    model = scale(model, {}, request.mass)
    write_osim(model, path)
    carry_meshes(model, path.parent)
    return (
        model,
        path,
        [
            f"No model was given (--model FILE): myo-sim's legs and trunk with {len(model.muscles)}"
            f" muscles, all segments stretched alike to {request.height:g} m, masses in proportion"
            f" to {request.mass:g} kg. The arms' mass is part of the trunk's."
        ],
    )
