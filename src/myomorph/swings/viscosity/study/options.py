"""All settings of a study of swinging limbs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from myomorph.lab.store.settings import plain_settings, with_settings
from myomorph.swings.viscosity.identification.budget import ErrorOptions
from myomorph.swings.viscosity.identification.identify import ViscosityOptions
from myomorph.swings.viscosity.relaxed.identify import LimbOptions
from myomorph.swings.viscosity.tracking.tracked import TrackingOptions
from myomorph.swings.viscosity.trust.cutoff import FilterOptions
from myomorph.swings.viscosity.trust.models import PassiveOptions
from myomorph.swings.viscosity.trust.moment_arms import MomentArmOptions


@dataclass(frozen=True)
class StudyOptions:
    """Settings of a study of swinging limbs, those of each step in a table of their own."""

    filter: FilterOptions = field(default_factory=FilterOptions)
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    identification: ViscosityOptions = field(default_factory=ViscosityOptions)
    laws: PassiveOptions = field(default_factory=PassiveOptions)
    moment_arms: MomentArmOptions = field(default_factory=MomentArmOptions)
    errors: ErrorOptions = field(default_factory=ErrorOptions)
    limb: LimbOptions = field(default_factory=LimbOptions)

    @staticmethod
    def of(settings: Mapping[str, Mapping[str, Any]]) -> StudyOptions:
        """Read the tables of a study file, or of a command line.

        Parameters
        ----------
        settings : by table, only what was specified
        """
        plain = StudyOptions()
        return replace(
            plain,
            **{name: with_settings(getattr(plain, name), told) for name, told in settings.items()},
        )

    @property
    def plain(self) -> dict[str, dict[str, object]]:
        """The settings as plain values, by table."""
        return {name: plain_settings(getattr(self, name)) for name in self.__dataclass_fields__}
