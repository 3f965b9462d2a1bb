"""How EMG takes part in muscle tensions: options, and activations by calibrated envelopes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.series import Emg
from myomorph.core.motion.emg_activation import USUAL, ChannelMap, EmgCalibration, uncalibrated
from myomorph.core.motion.emg_checks import envelope_faults, refuse_unfit, without_faults
from myomorph.core.tension.terms.emg import EmgTarget


@dataclass(frozen=True)
class EmgOptions:
    """How EMG takes part in the tension problem.

    Attributes
    ----------
    mode : use of EMG; "soft": a cost keeps activations near EMG; "driven": they follow EMG within
        the slack
    weight : weight of the soft cost, relative to the effort of one muscle; by default the largest
        at which held-out channels are predicted as well as without EMG, and 0 if they are not
    slack : allowed deviation of driven muscles from EMG [activation]
    delay : electromechanical delay [s]; by default fitted with the gains, or the usual one if gains
        are not fitted
    gains : gains of the channels; "fitted": one per channel, so that the muscles with EMG produce
        the joint torques; "normalized": envelopes are activations already
    offsets : fit an activation at rest for each channel, too
    shape : shape factor A of the map (exp(A e) - 1) / (exp(A) - 1) from envelope e to activation; 0
        is linear; None fits one for all channels
    unmeasured : activation of muscles without EMG; "effort": minimum effort alone; "synergies":
        muscles that act at the joints as measured ones do are kept near these
    unmeasured_weight : weight of these synergies, relative to the effort of one muscle; by default
        chosen together with `weight`
    """

    SETTING_PREFIX: ClassVar[str] = "emg_"

    mode: Literal["soft", "driven"] = "soft"
    weight: float | None = None
    slack: float = 0.02
    delay: float | None = None
    gains: Literal["fitted", "normalized"] = "fitted"
    offsets: bool = False
    shape: float | None = 0.0
    unmeasured: Literal["effort", "synergies"] = "synergies"
    unmeasured_weight: float | None = None

    def __post_init__(self) -> None:
        # What the target would refuse is refused before anything is calibrated.
        EmgTarget(
            muscles=(),
            activations=np.zeros((0, 0)),
            mode=self.mode,
            weight=1.0 if self.weight is None else self.weight,
            slack=self.slack,
        )
        if self.gains not in ("fitted", "normalized"):
            raise BadData(f"unknown gains of EMG '{self.gains}': there are 'fitted', 'normalized'")
        if self.unmeasured not in ("effort", "synergies"):
            raise BadData(
                f"unknown treatment of muscles without EMG '{self.unmeasured}': there are 'effort',"
                " 'synergies'"
            )
        if self.unmeasured_weight is not None and not self.unmeasured_weight > 0.0:
            raise BadData(
                f"weight {self.unmeasured_weight:g} of muscles without EMG: expected above 0"
            )
        if self.delay is not None and not 0.0 <= self.delay <= 0.5:
            raise BadData(f"electromechanical delay of {self.delay:g} s: expected 0 to 0.5 s")
        if self.shape is not None and not -10.0 <= self.shape <= 0.0:
            raise BadData(f"shape factor {self.shape:g} of EMG: expected -10 to 0")


def emg_targets(  # page: the calibration and options are optional
    emg: Emg,
    channels: ChannelMap,
    model: Model,
    time: Array,
    options: EmgOptions | None = None,
    calibration: EmgCalibration | None = None,
) -> EmgTarget:
    """Activations by EMG, at the motion's times, with delay and gain applied.

    Each muscle takes the mean of its channels that are known at that time. Dead stretches are
    unknown, negative values 0 (see `emg_checks.envelope_faults` for warnings).

    Parameters
    ----------
    emg : envelopes, its channels those that are calibrated
    channels : channel of `emg` to muscles of the model; channels that are not named are not used
    model : of the body
    time : (frames,) of the motion [s]
    options : settings
    calibration : delays and gains of at least these channels, by `calibrate_emg`; None takes
        envelopes as activations, `options.delay` late

    Returns
    -------
    activations of the muscles that channels measure, and of others by synergies

    Raises
    ------
    BadData : no channel measures a muscle, or EMG is unfit
    UnknownName : a channel is not in the EMG or the calibration, or a muscle not in the model
    """
    options = options or EmgOptions()
    muscles = mapped_muscles(emg, channels, model)
    refuse_unfit(emg, time, channels)
    clean = without_faults(emg, envelope_faults(emg))
    if calibration is None:
        delay = USUAL if options.delay is None else options.delay
        calibration = uncalibrated(tuple(channels), delay)
    for channel in channels:
        index_of("EMG channel", channel, calibration.channels, "the calibration")
    by_channel = calibration.applied(clean, time)
    activations = np.full((len(time), len(muscles)), np.nan)
    for column, muscle in enumerate(muscles):
        measured = [by_channel[channel] for channel, names in channels.items() if muscle in names]
        activations[:, column] = _mean_of_known(np.array(measured))

    others = None
    weight = calibration.weight if options.weight is None else options.weight
    if options.unmeasured == "synergies" and calibration.synergies and weight:
        others = calibration.extrapolated(clean, time)
    return EmgTarget(
        muscles=muscles,
        activations=activations,
        mode=options.mode,
        weight=weight,
        slack=options.slack,
        others=others,
        others_weight=options.unmeasured_weight or calibration.others_weight,
    )


def _mean_of_known(values: Array) -> Array:
    """Mean over rows of what is known.

    Parameters
    ----------
    values : (channels, frames) NaN where unknown

    Returns
    -------
    (frames,) NaN where no channel is known
    """
    known = np.isfinite(values)
    count = known.sum(axis=0)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def mapped_muscles(emg: Emg, channels: ChannelMap, model: Model) -> tuple[str, ...]:
    """Muscles that the channels measure, in the model's order.

    Raises
    ------
    BadData : no channel measures a muscle
    UnknownName : a channel is not in the EMG, or a muscle not in the model
    """
    measured: set[str] = set()
    for channel, names in channels.items():
        index_of("EMG channel", channel, emg.names, "the EMG")
        for name in names:
            index_of(f"muscle of EMG channel '{channel}'", name, model.muscle_names)
        measured |= set(names)
    if not measured:
        raise BadData(
            "no EMG channel belongs to a muscle: name them as emg_muscles = { channel = ['muscle']"
            " }"
        )
    return tuple(name for name in model.muscle_names if name in measured)
