"""Contacts of a recording as far as they are known before anything is computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from myomorph.core.contact.feet_on_steps import Stairs
from myomorph.core.contact.heard import SoundPlan
from myomorph.core.contact.supports import Supports
from myomorph.core.model.contacts import Contacts, Site
from myomorph.core.model.frozen_map import FrozenMap

When: TypeAlias = Literal["always", "motion", "file"]


@dataclass(frozen=True, eq=False)
class ContactPlan:
    """Contacts of a recording as far as they are known before anything is computed."""

    feet: bool = True  # whether the soles of the model's feet are sites
    sites: tuple[Site, ...] = ()  # in addition to the soles
    # of each of `sites` what determines when it touches: "always", the "motion", or the "file" of
    # its intervals
    when: Mapping[str, When] = field(default_factory=lambda: FrozenMap({}))
    # height of what a site rests on where that is not the floor [m], None for the lowest that it
    # gets
    surfaces: Mapping[str, float | None] = field(default_factory=lambda: FrozenMap({}))
    # contact intervals of a file; of the soles too where it names them
    reported: Contacts | None = None
    # impacts that microphones recorded, whose forces are known by their loudness or motion
    sound: SoundPlan | None = None
    # what measured loads are used for: "exact": they act as measured, and contacts are estimated
    # where none was measured; "shared": each is known for the sites on it together; "hidden": not
    # at all
    measured: Literal["exact", "shared", "hidden"] = "exact"
    # load cells of steps that show who stands on them and, together, what force they carry
    stairs: Stairs | None = None
    # steps, rails and seats; None where they are still to be found
    supports: Supports | None = None

    @property
    def found_supports(self) -> Supports:
        """Steps, rails and seats as far as they are found."""
        return self.supports or Supports()

    @property
    def situation(self) -> Literal["unknown", "shared", "sound"]:
        """Which of the situations of [D] chapter 4 it is."""
        if self.sound is not None:
            return "sound"
        return "shared" if self.measured == "shared" else "unknown"
