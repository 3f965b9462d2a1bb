"""Causes of the messages that files of other programs make."""

from __future__ import annotations

from myomorph.core.model.messages import Cause

SETUPS = Cause(
    key="setups",
    title="Parts of a setup that do otherwise here",
    gravity="may change results",
    effect="Results differ from those of the program that the setup was written for.",
    remedy="Look at the parts named.",
)
COPIES = Cause(
    key="copies",
    title="What a copy for another program holds otherwise",
    gravity="may change results",
    effect="The copy does otherwise where each says so.",
    remedy="Look at the parts named.",
)
DATASETS = Cause(
    key="datasets",
    title="What a data set does not hold",
    gravity="good to know",
    effect="As each says.",
)
TOO_WEAK = Cause(
    key="too_weak",
    title="Muscles that cannot give the torque",
    gravity="changes results",
    size="up to {size} N m are missing",
    effect="Activations of those frames are no solution.",
    remedy="Add actuators (force_set_files), or check strengths, moment arms and torques.",
    quantities=("activation", "muscle_force"),
)
