"""Causes of the messages that the laboratory makes."""

from __future__ import annotations

from myomorph.core.model.messages import Cause

SESSION = Cause(
    key="session",
    title="Person, date or movement that is not certain",
    severity="may change results",
    effect="Norms, sentences and pages are those of the movement and person that were assumed.",
    remedy="State them in the study file, or check names and files.",
    order=0,
)
STRIDES = Cause(
    key="strides",
    title="Strides that were not found",
    severity="may change results",
    effect="Means over strides and curves over the cycle leave them out.",
    remedy="Give events in the recording, or the direction and speed of the ground.",
)
GROUPS = Cause(
    key="groups",
    title="Comparisons with less data than requested",
    severity="may change results",
    effect="Differences are described, or rest on fewer subjects.",
    remedy="Look at what was left out.",
)
DRAWS = Cause(
    key="draws",
    title="Drawn errors without a solution",
    severity="may change results",
    effect="Intervals are too narrow.",
    remedy="Draw smaller errors, or look at the trials named.",
)
FILE_SHAPE = Cause(
    key="file_shape",
    title="Possible errors in a file",
    severity="may change results",
    effect="Steps that read it may fail or give wrong results.",
    remedy="Correct the file.",
    order=0,
)
CONVERSION = Cause(
    key="conversion",
    title="Differences between a converted file and its source",
    severity="good to know",
    effect="As each says.",
)
