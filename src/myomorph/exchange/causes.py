"""Causes of the messages that files of other programs make."""

from __future__ import annotations

from myomorph.core.model.messages import Cause

SETUPS = Cause(
    key="setups",
    title="Parts of a setup that work differently here",
    severity="may change results",
    effect="Results differ from those of the program that the setup was written for.",
    remedy="Look at the parts named.",
)
COPIES = Cause(
    key="copies",
    title="Differences of a copy for another program",
    severity="may change results",
    effect="The copy behaves differently in the parts named.",
    remedy="Look at the parts named.",
)
DATASETS = Cause(
    key="datasets",
    title="Data missing in a data set",
    severity="good to know",
    effect="As each says.",
)
TOO_WEAK = Cause(
    key="too_weak",
    title="Muscles that cannot produce the torque",
    severity="changes results",
    size="up to {size} N m are missing",
    effect="Activations of those frames are no solution.",
    remedy="Add actuators (force_set_files), or check strengths, moment arms and torques.",
    quantities=("activation", "muscle_force"),
)
