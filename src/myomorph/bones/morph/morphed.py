"""Options of a transfer and its result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from myomorph.bones.morph.maps.fields import BoneMap
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.shown import shown

UNKNOWN = float("nan"), float("nan")  # An interval that nothing determines.


@dataclass(frozen=True)
class MorphOptions:
    """What is made of a model once the maps of its bones are known.

    Attributes
    ----------
    surface_within : distance to its bone's surface, relative to the bone's length, within which a
        muscle point is moved to the target's surface (at the same relative depth or height); 0
        leaves points where the map puts them
    balance : move virtual links, which are bodies without a bone on which muscles branch, to where
        the tensions of their lines balance as in the source
    clear : move via points and wrap objects out of bones that the source's paths do not penetrate
    joints : joint centers; "fitted": of spheres and cylinders fitted to the target's articular
        surfaces, if they fit as in the source; "mapped": as the map gives them
    fibers : fiber and tendon lengths; "range": keep the range of normalized fiber lengths over the
        joints' ranges of motion; "path": keep the ratio of fiber and tendon to the path in the
        default pose; "keep": keep the lengths
    force : maximum isometric force; "volume": in proportion to the bones' volume over optimal fiber
        length; "area": to the square of the bones' length; "mass": to body mass over fiber length;
        "keep": unchanged
    pennation : pennation angle at optimal fiber length; "keep": unchanged; "thickness": so that the
        muscle's thickness is in proportion to the bones
    architecture : source of fibers, force and pennation; "tables": the tables of a species file, if
        it has some; "maps": the maps of the bones
    """

    surface_within: float = 0.02
    balance: bool = True
    clear: bool = True
    joints: Literal["fitted", "mapped"] = "fitted"
    fibers: Literal["range", "path", "keep"] = "range"
    force: Literal["volume", "area", "mass", "keep"] = "volume"
    pennation: Literal["keep", "thickness"] = "keep"
    architecture: Literal["tables", "maps"] = "tables"

    def __post_init__(self) -> None:
        if not 0.0 <= self.surface_within <= 0.2:
            raise BadData(
                f"surface_within is {self.surface_within:g}: expected a share of bone length from 0"
                " to 0.2"
            )


@read_only
class TransferredPoint:
    """One path point on its way.

    Attributes
    ----------
    owner : muscle or ligament
    name : of the point
    body, target_body : that it is fixed to
    source, target : (3,) in their frames, in the middle of its way for a moving point [m]
    lifted : how far it was moved onto the surface [m]; 0 where it was not
    depth_source, depth_target : signed distance from the bones' surfaces, positive outside [m]; NaN
        without surfaces
    within : distance from the target within which the point belongs with 90 % [m]; NaN where
        nothing is known
    cleared : how far it was brought out of a bone [m]; 0 where it was not
    """

    owner: str
    name: str
    body: str
    target_body: str
    source: Array
    target: Array
    lifted: float = 0.0
    depth_source: float = float("nan")
    depth_target: float = float("nan")
    within: float = float("nan")
    cleared: float = 0.0


@read_only
class RebuiltJoint:
    """A joint in the new bones.

    Attributes
    ----------
    name : of the joint
    method : "mapped", "sphere", "cylinder" or "given"
    in_parent, in_child : (3,) its center in the target bodies' frames [m]
    moved : between the fitted and the mapped center [m]; 0 where it is mapped
    gap : in the target's bones as they lie in one frame, between the centers found by parent and
        child [m]; NaN where the bones do not share a frame
    """

    name: str
    method: str
    in_parent: Array
    in_child: Array
    moved: float = 0.0
    gap: float = float("nan")


@dataclass(frozen=True)
class Architecture:
    """Fiber length and force of a muscle, from tables of the target's species or its relatives.

    Attributes
    ----------
    fiber, force : [m], [N]
    pennation : [rad], None to keep the source's
    basis : species and citation that it comes from
    fiber_interval, force_interval : 90 % intervals as factors, NaN where nothing shows them
    """

    fiber: float
    force: float
    pennation: float | None
    basis: str
    fiber_interval: tuple[float, float] = UNKNOWN
    force_interval: tuple[float, float] = UNKNOWN


@dataclass(frozen=True)
class MuscleChange:
    """What became of a muscle's parameters, target over source.

    Attributes
    ----------
    name : of the muscle
    path : length in the default pose
    fiber, tendon, force : optimal fiber length, tendon slack length, maximum isometric force
    pennation : difference [rad]
    range_source, range_target : least and greatest normalized fiber length over the joints' ranges
    basis : what fiber and force come from, "" for the bones' maps
    fiber_interval, force_interval : 90 % intervals as factors, NaN where nothing tells them
    """

    name: str
    path: float
    fiber: float
    tendon: float
    force: float
    pennation: float
    range_source: tuple[float, float]
    range_target: tuple[float, float]
    basis: str = ""
    fiber_interval: tuple[float, float] = UNKNOWN
    force_interval: tuple[float, float] = UNKNOWN


@shown
@dataclass(frozen=True, eq=False)
class Morph:
    """A model in other bones, and how it came about.

    Attributes
    ----------
    options : of the transfer
    left_out : why, by what was not transferred
    source, model : before and after
    bones : by body of the source
    points : of all muscles and ligaments, in order
    joints : that were rebuilt
    muscles : what became of their parameters
    notes : what looks wrong or was assumed, one line each
    """

    source: Model
    model: Model
    bones: Mapping[str, BoneMap]
    points: tuple[TransferredPoint, ...]
    joints: tuple[RebuiltJoint, ...]
    muscles: tuple[MuscleChange, ...]
    options: MorphOptions = field(default_factory=MorphOptions)
    notes: tuple[str, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
