"""Causes of the messages that a morphed model makes."""

from __future__ import annotations

from myomorph.core.model.messages import Cause

PATHS = Cause(
    key="morphed_paths",
    title="Paths of muscles that changed",
    severity="may change results",
    effect="Moment arms of the muscles named are not those of the source.",
    remedy="Look at the paths and bones named; choose another map.",
    quantities=("moment_arm", "muscle_length"),
)
ATTACHMENTS = Cause(
    key="attachments",
    title="Attachments off their bones",
    severity="may change results",
    effect="Paths of the muscles named begin or end elsewhere.",
    remedy="Look at the registration of the bone named.",
    quantities=("moment_arm", "muscle_length"),
)
FIBERS = Cause(
    key="morphed_fibers",
    title="Fibers that work at other lengths",
    severity="may change results",
    effect="The muscles named give other forces than in the source.",
    remedy="Fit their lengths to the new paths.",
    quantities=("muscle_force",),
)
JOINTS = Cause(
    key="morphed_joints",
    title="Joints that do not meet",
    severity="may change results",
    effect="Parent and child of the joints named have their centers apart.",
    remedy="Look at the registration of both bones.",
    quantities=("coordinate_value",),
)
