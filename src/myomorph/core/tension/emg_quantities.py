"""Quantities of EMG beside torques: their conflicts, and channels as they were calibrated."""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity

CONFLICT = ("emg_conflict",)
TABLE = "emg_conflicts.csv"
CHANNEL = ("emg_channel",)
CHANNEL_TABLE = "emg_channels.csv"

CONFLICTS = (
    Quantity(
        name="emg_conflict_muscle",
        dims=CONFLICT,
        unit="",
        meaning="muscle with EMG, nothing where a reserve bears what is left",
        attribute="muscle",
        kind="text",
        file=TABLE,
    ),
    Quantity(
        name="emg_conflict_coordinate",
        dims=CONFLICT,
        unit="",
        meaning="coordinate of the reserve",
        attribute="coordinate",
        kind="text",
        file=TABLE,
    ),
    Quantity(
        name="emg_conflict_start",
        dims=CONFLICT,
        unit="s",
        meaning="start of a time interval in which EMG and torques contradict each other",
        attribute="start",
        file=TABLE,
    ),
    Quantity(
        name="emg_conflict_stop",
        dims=CONFLICT,
        unit="s",
        meaning="end of this time interval",
        attribute="stop",
        file=TABLE,
    ),
    Quantity(
        name="emg_conflict_worst",
        dims=CONFLICT,
        unit="s",
        meaning="time of the largest difference",
        attribute="worst",
        file=TABLE,
    ),
    Quantity(
        name="emg_conflict_emg",
        dims=CONFLICT,
        unit="1",
        meaning="activation by EMG then, or torque wanted where a reserve bears it",
        attribute="emg",
        file=TABLE,
    ),
    Quantity(
        name="emg_conflict_found",
        dims=CONFLICT,
        unit="1",
        meaning="activation of the solution then, or torque of the reserve",
        attribute="found",
        file=TABLE,
    ),
)

CHANNELS = (
    Quantity(
        name="emg_channel_name",
        dims=CHANNEL,
        unit="",
        meaning="EMG channel",
        attribute="channel",
        kind="text",
        stored=False,
        file=CHANNEL_TABLE,
    ),
    Quantity(
        name="emg_channel_delay",
        dims=CHANNEL,
        unit="s",
        meaning="activation comes later by this than the envelope",
        attribute="delay",
        stored=False,
        file=CHANNEL_TABLE,
    ),
    Quantity(
        name="emg_channel_gain",
        dims=CHANNEL,
        unit="1",
        meaning="activation of an envelope of 1",
        attribute="gain",
        stored=False,
        file=CHANNEL_TABLE,
    ),
    Quantity(
        name="emg_channel_gain_low",
        dims=CHANNEL,
        unit="1",
        meaning="lower limit of 95 % of the gain",
        attribute="gain_low",
        stored=False,
        file=CHANNEL_TABLE,
    ),
    Quantity(
        name="emg_channel_gain_high",
        dims=CHANNEL,
        unit="1",
        meaning="upper limit of 95 % of the gain",
        attribute="gain_high",
        stored=False,
        file=CHANNEL_TABLE,
    ),
    Quantity(
        name="emg_channel_gain_from",
        dims=CHANNEL,
        unit="",
        meaning="what the gain is known from: torques, usual values or a file",
        attribute="gain_from",
        kind="text",
        stored=False,
        file=CHANNEL_TABLE,
    ),
    Quantity(
        name="emg_channel_offset",
        dims=CHANNEL,
        unit="1",
        meaning="activation at rest",
        attribute="offset",
        stored=False,
        file=CHANNEL_TABLE,
    ),
    Quantity(
        name="emg_channel_shape",
        dims=CHANNEL,
        unit="1",
        meaning="factor by which envelopes are bent, 0 for none",
        attribute="shape",
        stored=False,
        file=CHANNEL_TABLE,
    ),
    Quantity(
        name="emg_channel_weight",
        dims=CHANNEL,
        unit="1",
        meaning="weight of EMG beside least effort",
        attribute="weight",
        stored=False,
        file=CHANNEL_TABLE,
    ),
    Quantity(
        name="emg_channel_r_held_out_without_emg",
        dims=CHANNEL,
        unit="1",
        meaning="correlation with its muscles when left out, without any EMG",
        attribute="r_held_out_without_emg",
        stored=False,
        file=CHANNEL_TABLE,
    ),
    Quantity(
        name="emg_channel_r_held_out_with_emg",
        dims=CHANNEL,
        unit="1",
        meaning="the same with the EMG of the other channels",
        attribute="r_held_out_with_emg",
        stored=False,
        file=CHANNEL_TABLE,
    ),
    Quantity(
        name="emg_channel_muscles",
        dims=CHANNEL,
        unit="",
        meaning="muscles that it measures",
        attribute="muscles",
        kind="text",
        stored=False,
        file=CHANNEL_TABLE,
    ),
)
"""Columns of the table of calibrated channels, in its order."""

QUANTITIES = (*CONFLICTS, *CHANNELS)
