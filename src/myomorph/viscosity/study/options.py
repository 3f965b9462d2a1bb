"""The options of the viscosity study."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from myomorph.model.errors import BadData
from myomorph.store.settings import plain_settings, with_settings
from myomorph.viscosity.identification.identify import ViscosityOptions
from myomorph.viscosity.tracking.track import TrackingOptions
from myomorph.viscosity.trust.models import PassiveOptions
from myomorph.viscosity.trust.moment_arms import ArmOptions

TRACKING, IDENTIFYING = 0.5, 0.25
"""Shares of a specimen's time, for the bar."""


MASSES = {"without": ("mass_without", "com_without"), "with": ("mass_with", "com_with")}


VISCOSITIES = {"without": ("joint_viscosity",), "with": ("total_viscosity",)}
"""What a condition gives to the tables."""


@dataclass(frozen=True)
class FilterOptions:
    """The low-pass of motion and wrench.

    Attributes
    ----------
    cutoff : of motion and wrench [Hz]; by default the one that residual analysis of the recordings asks for
    """

    cutoff: float | None = None

    def __post_init__(self) -> None:
        if self.cutoff is not None and not self.cutoff > 0.0:
            raise BadData(f"cutoff of motion and wrench is {self.cutoff:g} Hz: expected above 0")


@dataclass(frozen=True)
class StudyOptions:
    """All that a study of swinging limbs may be told, each part in its own table."""

    filter: FilterOptions = field(default_factory=FilterOptions)
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    identification: ViscosityOptions = field(default_factory=ViscosityOptions)
    laws: PassiveOptions = field(default_factory=PassiveOptions)
    arms: ArmOptions = field(default_factory=ArmOptions)

    @staticmethod
    def of(settings: Mapping[str, Mapping[str, Any]]) -> StudyOptions:
        """Options from the tables of a study file, or from a command line."""
        plain = StudyOptions()
        return replace(plain, **{name: with_settings(getattr(plain, name), own) for name, own in settings.items()})

    @property
    def plain(self) -> dict[str, dict[str, object]]:
        """The settings as plain values, by table."""
        return {name: plain_settings(getattr(self, name)) for name in self.__dataclass_fields__}
