"""Options of following a specimen's bones, and the result: motion, wrench and doubts of every trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData
from myomorph.model.series import Motion
from myomorph.motion.clocks import Clock
from myomorph.viscosity.specimen.model import Specimen
from myomorph.viscosity.tracking.held import Slip


@dataclass(frozen=True)
class TrackingOptions:
    """How bones are followed.

    Attributes
    ----------
    cluster : a distance between two markers of a bone may differ from the model's by this much [m]
    slip : a held joint, or the base, that turns by more is named [rad]
    shift : a base that moves by more is named [m]
    center : "motion" for the point about which the limb turns, "model" for the joint's center of the model, which a
        limb that hardly turns keeps anyway
    max_center_distance : distance of these two above which there is a warning [m]
    clock : estimate offset and drift of the plate's clock against the markers' from the swing itself
    find_contact : find the frames in which the wrench says that something besides the joint carries the limb
    contact_threshold : share of the swing's largest change of force below which a mismatch is no contact
    """

    cluster: float = 0.006
    slip: float = 0.035
    shift: float = 0.002
    center: Literal["model", "motion"] = "motion"
    max_center_distance: float = 0.005
    clock: bool = True
    find_contact: bool = True
    contact_threshold: float = 0.1

    def __post_init__(self) -> None:
        for name in ("cluster", "slip", "shift", "max_center_distance", "contact_threshold"):
            if not getattr(self, name) > 0.0:
                raise BadData(f"{name} is {getattr(self, name):g}: expected above 0")


@read_only
@dataclass(frozen=True, eq=False)
class TrackedTrial:
    """A trial as motion of the joint's coordinates [rad], NaN where too few markers are seen, and wrench (frames, 6) on
    the base [N m], [N], NaN where the plate did not record; on the markers' clock, neither filtered.

    `touched` (frames,): something besides the joint carries the limb; `rms` (frames,) of the distances between markers
    and model [m]; `clock`: the plate's against the markers', as taken; `origin`: mean point of the plate's wrench from
    the joint's center, in ground [m].
    """

    name: str
    motion: Motion
    wrench: Array
    touched: np.ndarray
    rms: Array
    clock: Clock
    notes: tuple[str, ...] = ()
    origin: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True, eq=False)
class TrackedSpecimen:
    """The trials of one condition; the base of the specimen fixed where it stood, held joints locked as they were."""

    specimen: Specimen
    trials: tuple[TrackedTrial, ...]
    held: Mapping[str, float]
    slips: tuple[Slip, ...]
    notes: tuple[str, ...] = ()
