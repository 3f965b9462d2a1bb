"""What the steps of a study may be told: for all trials, for those of a subject, for one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from myomorph.model.errors import MyomorphError
from myomorph.store.settings import (
    Differentiation,
    EmgUse,
    ReportOptions,
    Setting,
    TensionTables,
    TorqueTable,
    settings_of,
    with_settings,
)
from myomorph.study.subject.body_shape import BodyOptions

STEPS = ("morph", "calibrate", "ik", "identify", "id", "muscles", "tension", "report")
FILTERED = ("id", "muscles", "tension")
"""Steps that share one low-pass filter, as they share the derivatives."""

NOT_SETTINGS = {"ik": ("only_weighted",), "calibrate": ("mass",)}
"""Fields of the options that come from elsewhere in a study file."""


def step_options() -> dict[str, tuple[type, ...]]:
    """Option dataclasses of every step, by its name."""
    from myomorph.identify.recordings import RecordingOptions
    from myomorph.identify.subject import IdentificationOptions
    from myomorph.morph.fields import MapOptions
    from myomorph.morph.morphed import MorphOptions
    from myomorph.morph.nonrigid import MatchOptions
    from myomorph.motion.calibrate import CalibrationOptions
    from myomorph.motion.crossings import CrossingOptions
    from myomorph.motion.envelope import EnvelopeOptions
    from myomorph.motion.ik import InverseKinematicsOptions
    from myomorph.tension.emg_calibration import EmgOptions
    from myomorph.tension.solve import TensionOptions
    from myomorph.tension.terms.contacts import ContactOptions

    return {
        "morph": (MatchOptions, MapOptions, MorphOptions),
        "calibrate": (CalibrationOptions,),
        "identify": (RecordingOptions, IdentificationOptions, BodyOptions),
        "ik": (InverseKinematicsOptions, CrossingOptions),
        "id": (Differentiation, TorqueTable),
        "muscles": (Differentiation,),
        "report": (ReportOptions,),
        "tension": (
            Differentiation,
            TensionOptions,
            ContactOptions,
            EmgOptions,
            EnvelopeOptions,
            EmgUse,
            TensionTables,
        ),
    }


def step_settings() -> dict[str, tuple[Setting, ...]]:
    """Settings of every step, by its name."""
    return {
        step: tuple(
            one for options in own for one in settings_of(options) if one.name not in NOT_SETTINGS.get(step, ())
        )
        for step, own in step_options().items()
    }


def check_settings(settings: Mapping[str, Mapping[str, Any]], where: str, problems: list[str]) -> None:
    """Add to the problems what the option dataclasses refuse, as a filter below zero."""
    for step, own in step_options().items():
        for options in own:
            try:
                with_settings(options(), settings.get(step, {}))
            except MyomorphError as error:
                told = f"{where}options.{step}: {' '.join(str(error).split())}"
                if told not in problems:
                    problems.append(told)


def merged(
    settings: Mapping[str, Mapping[str, Any]], own: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Settings with those of a subject or a trial over them.

    A filter that these name for one of the steps that share it takes the place of all that were named before.
    """
    found = {step: dict(given) for step, given in settings.items()}
    if any("cutoff" in own.get(step, {}) for step in FILTERED):
        for step in FILTERED:
            found.get(step, {}).pop("cutoff", None)
    for step, given in own.items():
        found[step] = found.get(step, {}) | dict(given)
    return {step: given for step, given in found.items() if given}
