"""One recording of one subject as files: its model, and the settings of its inputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self, TypeVar

from myomorph.study.inputs.by_type import ByType
from myomorph.study.inputs.imu import ImuFiles
from myomorph.study.inputs.markers import MarkersFile
from myomorph.study.inputs.motion import MotionFile
from myomorph.study.inputs.table import input_of, inputs_of, settings_of_keys
from myomorph.study.inputs.time_span import TimeSpan

Settings = Mapping[str, Mapping[str, Any]]
"""The settings of each step, by step and setting."""
Held = TypeVar("Held")


@dataclass(frozen=True)
class TrialFiles:
    """The files of one recording of one subject: its model, its name ("" for that of its recording), whose it is, the
    condition that it was recorded in, and settings of its inputs (`study.inputs.table`).
    """

    model: Path
    name: str = ""
    subject: str = ""
    inputs: ByType = field(default_factory=ByType)
    condition: str = ""

    def get(self, kind: type[Held]) -> Held:
        """Settings of an input, its defaults where nothing is said."""
        return self.inputs.or_default(kind)

    def having(self, *settings: object) -> Self:
        """The same with other settings of inputs."""
        return replace(self, inputs=self.inputs.having(*settings))

    @property
    def markers(self) -> Path | None:
        """The recording of markers, None where the trial begins with coordinates."""
        return self.get(MarkersFile).markers

    @property
    def recording(self) -> Path | None:
        """The recording of markers, the coordinates or the sensors that the trial begins with."""
        sensors = self.get(ImuFiles).imu
        return self.markers or self.get(MotionFile).motion or (sensors[0] if sensors else None)

    @property
    def time(self) -> tuple[float, float] | None:
        """Start and end of what is used [s]."""
        return self.get(TimeSpan).time

    @property
    def paths(self) -> tuple[Path, ...]:
        """All files but the model, in the order in which they are opened."""
        return tuple(
            path
            for name, settings in inputs_of(self.inputs).items()
            for key in input_of(name).keys
            for path in key.kind.files(getattr(settings, key.name))
        )


def trial_files(model: Path, name: str = "", subject: str = "", **values: object) -> TrialFiles:
    """The files of a trial from values of the keys of its inputs, as a study file names them:
    `trial_files(Path("arm.osim"), motion=Path("reach.mot"), time=(0.0, 0.5))`.
    """
    return TrialFiles(model, name, subject, settings_of_keys(values))
