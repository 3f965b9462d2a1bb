"""Contacts in the tension problem: which sites may carry force, and what is known of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.contacts import SharedWrench, Site
from myomorph.model.errors import BadData, UnknownName
from myomorph.model.series import Series


@dataclass(frozen=True)
class ContactOptions:
    """How forces of contacts are chosen where physics leaves them open.

    Attributes
    ----------
    formulation : "simultaneous": contact forces and muscle tensions in one problem; "sequential": contact
        forces first, from the six equations of motion of each body that floats, muscles after
    compliance : cost of a contact force of one body weight at a site of full strength, in units of the
        effort a^2 of one muscle; at a site of strength s it is compliance / s^2
    smoothness : weight of (f_k - f_(k-1))^2 between frames, in units of `compliance`, for frames 10 ms apart
    window : frames that are solved together when forces are smoothed (more where smoothness reaches further)
    sweeps : most passes over a window, each frame given those beside it; they end earlier when nothing changes
    """

    formulation: Literal["simultaneous", "sequential"] = "simultaneous"
    compliance: float = 0.1
    smoothness: float = 1.0
    window: int = 64
    sweeps: int = 200

    def __post_init__(self) -> None:
        if self.formulation not in ("simultaneous", "sequential"):
            raise BadData(f"unknown formulation '{self.formulation}': there are 'simultaneous', 'sequential'")
        if not (self.compliance > 0.0 and self.smoothness >= 0.0):
            raise BadData(
                f"compliance {self.compliance:g}, smoothness {self.smoothness:g} of contacts: expected above 0, and "
                "0 or more"
            )
        if self.window < 1 or self.sweeps < 1:
            raise BadData(f"window {self.window}, sweeps {self.sweeps} of contacts: expected 1 or more")


@dataclass(frozen=True, eq=False)
class ContactTask:
    """Contacts whose forces are to be found.

    Attributes
    ----------
    strengths : (frames, sites) in 0..1 at the motion's times: 0 for no contact, between for a contact that
        is only beginning, or not sure
    measured : forces known for some sites together
    leans : (frames, sites, 3) in ground: force across a cone's direction, per force along it, that costs least;
        None for a force along the direction. Of cones whose direction is fixed in ground
    """

    sites: tuple[Site, ...]
    strengths: Series
    measured: tuple[SharedWrench, ...] = ()
    options: ContactOptions = field(default_factory=ContactOptions)
    leans: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "sites", tuple(self.sites))
        if self.leans is not None:
            object.__setattr__(self, "leans", frozen_array(self.leans, (len(self.strengths), len(self.sites), 3)))
        names = tuple(one.name for one in self.sites)
        if self.strengths.names != names:
            raise BadData(f"strengths are of the sites {self.strengths.names}, but the contacts have {names}")
        for wrench in self.measured:
            for site in wrench.sites:
                if site not in names:
                    raise UnknownName("contact site", site, names, f"the contacts, for '{wrench.name}',")
