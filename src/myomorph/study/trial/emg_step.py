"""EMG in the step of muscle tensions: what it tells of activations, once its delay and gains are known."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from myomorph.io.parsing.text import written
from myomorph.model.model import Actuator
from myomorph.model.series import Motion, Series
from myomorph.motion.emg_delay import USUAL, EmgCalibration
from myomorph.study.trial.take import Take
from myomorph.tension.contacts import ContactTask
from myomorph.tension.emg import EmgTarget
from myomorph.tension.emg_calibration import EmgTrial, calibrate_emg
from myomorph.tension.emg_targets import EmgOptions, emg_targets
from myomorph.tension.solve import TensionOptions

EMG_TABLE = "emg_channels.csv"
SHORTEST = 2.0
"""Recordings that are shorter do not tell a delay [s]."""


@dataclass(frozen=True, eq=False)
class ToldByEmg:
    """What EMG tells of a recording.

    Attributes
    ----------
    target : None where no channel tells of a muscle
    """

    target: EmgTarget | None
    calibration: EmgCalibration | None
    notes: tuple[str, ...] = ()


def emg_takes_part(take: Take) -> bool:
    """Whether EMG was given to take part in the tensions, rather than to be shown."""
    return take.emg is not None and take.emg_options is not None and not take.emg_use.emg_shown_only


def told_by_emg(
    take: Take,
    motion: Motion,
    torques: Series,
    options: TensionOptions,
    actuators: Sequence[Actuator],
    contacts: ContactTask | None,
) -> ToldByEmg:
    """Targets of activations, with delay and gains that this recording tells (see `calibrate_emg`).

    Parameters
    ----------
    torques, options, actuators, contacts : as for the tensions that EMG is to take part in
    """
    assert take.emg is not None
    chosen: EmgOptions = take.emg_options or EmgOptions()
    if not take.emg_muscles:
        names = ", ".join(take.emg.names)
        note = f"EMG takes no part: no channel's name tells a muscle of the model; name them in emg_muscles ({names})"
        return ToldByEmg(None, None, (note,))
    notes: list[str] = []
    short = motion.time[-1] - motion.time[0] < SHORTEST
    if short and chosen.delay is None:
        chosen = replace(chosen, delay=USUAL)
        notes.append(f"EMG: the recording is shorter than {SHORTEST:g} s, so a delay of {USUAL:g} s is taken")
    trial = EmgTrial(motion, torques, take.emg, contacts)
    calibration = calibrate_emg(take.model, [trial], take.emg_muscles, chosen, options, actuators)
    target = emg_targets(take.emg, take.emg_muscles, take.model, motion.time, chosen, calibration)
    return ToldByEmg(target, calibration, (*notes, *calibration.warnings))


def write_calibration(told: ToldByEmg, muscles: Mapping[str, Sequence[str]], path: Path) -> None:
    """Delay, gain and muscles of each channel as a table, where there are any."""
    if told.calibration is None:
        return
    found = told.calibration
    with written(path) as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(("channel", "delay_s", "gain", "offset", "muscles"))
        for name, delay, gain, offset in zip(found.channels, found.delays, found.gains, found.offsets, strict=True):
            table.writerow((name, f"{delay:.4f}", f"{gain:.6g}", f"{offset:.6g}", " ".join(muscles[name])))
