"""Give a calibrated model's lengths, markers and masses to a model with more joints.

[D] 3.2.1, step 5. Both models are cut into the same regions. The higher model's bodies are scaled
until the joint centers of its regions lie as far from each other as in the lower model, and it is
posed so that they coincide; in that pose markers keep their place in space, and the masses of each
region are spread over its bodies.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.body.causes import COUNTERPARTS
from myomorph.body.identify.transfer_options import TransferOptions
from myomorph.body.shape.center_fit import (
    CenterFit,
    LengthMatch,
    between_grounds,
    first_frame,
    hinge_cues,
)
from myomorph.body.shape.points import Links, links_of
from myomorph.body.shape.regions import Region, Standing, regions_of, spread, spread_mass
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import inertial_parameters, parameters_of, with_inertial_parameters
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Marker, Model
from myomorph.core.model.scale import scale
from myomorph.core.model.series import DEFAULT_POSE, Motion
from myomorph.core.motion.stretch import skeleton
from myomorph.core.muscles.kinematics import default_path_lengths

MIN_CENTERS = 4


@dataclass(frozen=True)
class MassMatch:
    """A region's mass, and how well the sum of its bodies reproduces the lower model's.

    Attributes
    ----------
    region : of the body
    lower_bodies, higher_bodies : bodies of the region in the simpler and in the richer model
    mass : of the lower model's bodies [kg]
    mass_error, center_error, inertia_error : of the sum of the higher model's bodies [kg], [m], [kg
        m^2]
    largest_shift : of a body's mass center by the spreading [m]
    note : why mass center and inertia are not reproduced, "" where they are
    """

    region: Region
    lower_bodies: tuple[str, ...]
    higher_bodies: tuple[str, ...]
    mass: float
    mass_error: float
    center_error: float
    inertia_error: float
    largest_shift: float
    note: str = ""


@read_only
class Transfer:
    """A higher model with a lower model's lengths, markers and masses, and how well it took them.

    Attributes
    ----------
    lengths : matched, one each
    masses : matched, one a region
    notes : warnings, one line each
    model : the higher model as it is now
    lower_pose, higher_pose : one frame each, in which the joint centers coincide
    rotation : (3, 3) from the lower model's ground axes to the higher's
    factors : (3,) scale factors of the higher model's bodies
    joint_shifts : how far each joint had to be moved in its inner body, which scaling and posing
        left [m]
    joint_errors : distance of each pair of corresponding joint centers that is left [m]
    without_center : joint centers that only one of the models has
    without_counterpart : bodies of regions that the other model lacks; they follow the region they
        hang on
    """

    model: Model
    lower_pose: Motion
    higher_pose: Motion
    rotation: Array
    factors: Mapping[str, Array]
    joint_shifts: Mapping[str, float]
    joint_errors: Mapping[str, float]
    lengths: tuple[LengthMatch, ...]
    masses: tuple[MassMatch, ...]
    without_center: tuple[str, ...]
    without_counterpart: tuple[str, ...]
    notes: tuple[Message, ...] = ()


def transfer(
    lower: Model,
    higher: Model,
    options: TransferOptions | None = None,
    pose: Motion | None = None,
    path_lengths: Callable[[Model], Array] | None = default_path_lengths,
) -> Transfer:
    """Give a model with more joints the lengths, marker places and masses of one with fewer.

    Lengths: a region with two joint centers is scaled evenly in all directions, so that their
    distance is the lower model's; the pelvis and the torso, which have three or more, along the
    axes of their bodies, one factor an axis for all of them, as evenly as their distances allow:
    the chain of the spine shares the length of the trunk. Head, hands and toes, which have one,
    take the mean factor of the region they hang on.

    Markers: they are fixed to the body on which the higher model has a marker of that name, or of
    the same name as the lower model's body, or to that of the region whose bone is nearest.

    Masses: see `mass_map.spread`. A region that one model lacks (a head that is part of the torso)
    counts to the one it hangs on.

    Source: [D], chapter 3; see docs/identification.md.

    Parameters
    ----------
    lower : calibrated and identified
    higher : with more joints; its masses and lengths are the generic ones
    options : which markers and masses are carried over; see `TransferOptions`
    pose : of the lower model, its first frame; by default its default pose, which should be much
        like the higher model's
    path_lengths : see `scale`; None leaves the muscles' fibers and tendons as they are

    Returns
    -------
    the higher model with the lower one's lengths, markers and masses, errors of joint centers [m],
    masses by region [kg], notes

    Raises
    ------
    BadData : the models have fewer than four joint centers in common, or names tell no segments

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> def leg(thigh):
    ...     parts = {"pelvis": ("ground", 1.0, 0.0), "femur_r": ("pelvis", -0.1, 0.1)}
    ...     parts |= {"femur_l": ("pelvis", -0.1, -0.1), "tibia_r": ("femur_r", -thigh, 0.0)}
    ...     parts |= {"calcn_r": ("tibia_r", -0.4, 0.0)}
    ...     bodies = []
    ...     joints = []
    ...     no = mm.model.Transform(np.eye(3), np.zeros(3))
    ...     for name, (parent, y, z) in parts.items():
    ...         at = mm.model.Transform(np.eye(3), np.array([0.0, y, z]))
    ...         bodies.append(mm.model.Body(name, 5.0, [0.0, -0.1, 0.0], 0.05 * np.eye(3)))
    ...         joints.append(mm.model.Joint(f"to_{name}", "WeldJoint", parent, name, at, no))
    ...     return mm.Model("leg", tuple(bodies), tuple(joints), (), [0.0, -9.80665, 0.0])
    >>> found = mm.transfer(leg(thigh=0.44), leg(thigh=0.4), path_lengths=None)
    >>> round(float(found.model.joints[3].parent_frame.translation[1]), 3)
    -0.44
    """
    options = options or TransferOptions()
    ours = Standing(lower, first_frame(pose, lower), regions_of(lower, options.lower_segments))
    generic = Standing(higher, DEFAULT_POSE, regions_of(higher, options.higher_segments))
    rotation = between_grounds(ours, generic, _shared_centers(ours, generic))
    fit = _center_fit(ours, generic, rotation)
    factors, higher_pose = fit.solve(options.rounds, options.tolerance)
    shifts, shifted = fit.shifts(higher, factors, higher_pose)
    scaled = _scaled(higher, shifted, factors, path_lengths)
    theirs = Standing(scaled, higher_pose, generic.regions)
    model, masses = _with_masses(ours, theirs, rotation)
    markers, notes = _markers(ours, theirs, rotation, options)
    return Transfer(
        model=replace(model, markers=markers),
        lower_pose=ours.pose,
        higher_pose=higher_pose,
        rotation=rotation,
        factors=FrozenMap(factors),
        joint_shifts=FrozenMap(shifts),
        joint_errors=FrozenMap(_joint_errors(fit, theirs.places)),
        lengths=fit.lengths(theirs.places),
        masses=masses,
        without_center=tuple(sorted(set(ours.centers) ^ set(generic.centers))),
        without_counterpart=_without_counterpart(ours, generic),
        notes=tuple(notes),
    )


def _center_fit(lower: Standing, higher: Standing, rotation: Array) -> CenterFit:
    """Set up the problem of laying the higher model's joint centers onto the lower one's.

    Parameters
    ----------
    lower, higher : each in its own pose
    rotation : (3, 3) from the lower model's ground axes to the higher's
    """
    shared = _shared_centers(lower, higher)
    return CenterFit(
        model=skeleton(higher.model),
        regions=higher.regions,
        centers={key: higher.centers[key] for key in shared},
        targets={key: rotation @ lower.places[key] for key in shared},
        cues=hinge_cues(lower, higher, shared, rotation),
    )


def _joint_errors(fit: CenterFit, places: Mapping[str, Array]) -> dict[str, float]:
    """Compute the distance of each pair of joint centers that is left [m].

    Parameters
    ----------
    fit : with the targets
    places : name to (3,) joint center of the higher model in its ground [m]
    """
    return {key: float(np.linalg.norm(places[key] - target)) for key, target in fit.targets.items()}


def _without_counterpart(lower: Standing, higher: Standing) -> tuple[str, ...]:
    """Name the bodies of regions that the other model lacks."""
    common = _common(lower, higher)
    regions = (*lower.regions.items(), *higher.regions.items())
    return tuple(name for name, region in regions if region not in common)


def _common(lower: Standing, higher: Standing) -> set[Region]:
    return set(lower.regions.values()) & set(higher.regions.values())


def _shared_centers(lower: Standing, higher: Standing) -> tuple[str, ...]:
    """Return the names of joint centers that both models have.

    Raises
    ------
    BadData : fewer than `MIN_CENTERS`
    """
    shared = tuple(key for key in lower.centers if key in higher.centers)
    if len(shared) < MIN_CENTERS:
        raise BadData(
            f"models '{lower.model.name}' and '{higher.model.name}' have only {len(shared)} joint"
            f" centers in common ({', '.join(shared) or 'none'}): expected at least {MIN_CENTERS}"
        )
    return shared


def _scaled(
    unscaled: Model,
    shifted: Model,
    factors: Mapping[str, Array],
    path_lengths: Callable[[Model], Array] | None,
) -> Model:
    """Scale the model with its joints shifted.

    Muscles keep the ratios they have in the model as given.

    Parameters
    ----------
    unscaled : as given
    shifted : with its joints shifted
    factors : body to (3,)
    path_lengths : see `scale`; None leaves the muscles as they are
    """
    if path_lengths is None or not unscaled.muscles:
        return scale(shifted, factors)
    before = path_lengths(unscaled)
    return scale(
        shifted,
        factors,
        path_lengths=lambda model: before if model is shifted else path_lengths(model),
    )


def _with_masses(
    lower: Standing, higher: Standing, rotation: Array
) -> tuple[Model, tuple[MassMatch, ...]]:
    """Give the higher model the lower one's mass, mass center and inertia of each region.

    Parameters
    ----------
    lower, higher : in poses in which their joint centers coincide
    rotation : (3, 3) from the lower model's ground axes to the higher's

    Returns
    -------
    the model, and how well each region took its mass
    """
    turn = np.eye(4)
    turn[:3, :3] = rotation
    wanted = turn @ lower.pseudo_inertias() @ turn.T
    masses = higher.pseudo_inertias()
    common = _heavy_regions(lower) & _heavy_regions(higher)
    lower_regions = _region_of_each_body(lower, common)
    higher_regions = _region_of_each_body(higher, common)

    after = masses.copy()
    matches = []
    for region in dict.fromkeys(higher_regions):
        of_lower = np.flatnonzero([other == region for other in lower_regions])
        of_higher = np.flatnonzero([other == region for other in higher_regions])
        target = wanted[of_lower].sum(axis=0)
        after[of_higher], note = _spread_over(masses[of_higher], target)
        match = _mass_match(region, target, masses[of_higher], after[of_higher])
        matches.append(
            replace(
                match,
                lower_bodies=tuple(lower.model.body_names[i] for i in of_lower),
                higher_bodies=tuple(higher.model.body_names[i] for i in of_higher),
                note=note,
            )
        )
    return _with_pseudo_inertias(higher, after), tuple(matches)


def _heavy_regions(standing: Standing) -> set[Region]:
    """Find the regions with a body of positive mass."""
    bodies = standing.model.body
    return {region for name, region in standing.regions.items() if bodies(name).mass > 0.0}


def _region_of_each_body(standing: Standing, common: set[Region]) -> list[Region]:
    """List the region that each body counts to: one of those that both models have."""
    return [common_region(standing.regions[name], common) for name in standing.model.body_names]


def _spread_over(masses: Array, target: Array) -> tuple[Array, str]:
    """Change bodies of a region so that they sum to a target, as far as bodies can.

    Parameters
    ----------
    masses : (bodies, 4, 4) pseudo-inertias in ground
    target : (4, 4) that they shall sum to

    Returns
    -------
    (bodies, 4, 4), and why mass center and inertia are not met, "" where they are
    """
    try:
        return spread(masses, target), ""
    except BadData as error:
        return spread_mass(masses, target), f"only mass and mass center: {error}"


def _mass_match(region: Region, target: Array, before: Array, after: Array) -> MassMatch:
    """Compare a region's mass with what it shall be.

    Parameters
    ----------
    region : of the body
    target : (4, 4) pseudo-inertia that its bodies shall sum to
    before, after : (bodies, 4, 4) pseudo-inertias of its bodies

    Returns
    -------
    the match, without names of bodies
    """
    total = after.sum(axis=0)
    heavy = before[:, 3, 3] > 0.0
    centers_before = before[heavy, :3, 3] / before[heavy, 3, 3, None]
    centers_after = after[heavy, :3, 3] / after[heavy, 3, 3, None]
    shifts = np.linalg.norm(centers_after - centers_before, axis=1)
    center_error = total[:3, 3] / total[3, 3] - target[:3, 3] / target[3, 3]
    return MassMatch(
        region=region,
        lower_bodies=(),
        higher_bodies=(),
        mass=float(target[3, 3]),
        mass_error=float(abs(total[3, 3] - target[3, 3])),
        center_error=float(np.linalg.norm(center_error)),
        inertia_error=float(np.abs(total[:3, :3] - target[:3, :3]).max()),
        largest_shift=float(shifts.max(initial=0.0)),
    )


def _with_pseudo_inertias(standing: Standing, masses: Array) -> Model:
    """Give the model pseudo-inertias; bodies without mass stay as they are.

    Parameters
    ----------
    standing : the model in its pose
    masses : (bodies, 4, 4) in ground
    """
    model = standing.model
    back = np.linalg.inv(np.array(list(standing.frames.values())))
    parameters = parameters_of(back @ masses @ np.swapaxes(back, 1, 2))
    own = inertial_parameters(model)
    massless = own[:, 0] == 0.0
    parameters[massless] = own[massless]
    return with_inertial_parameters(model, parameters)


def common_region(region: Region, common: set[Region]) -> Region:
    """Return the region itself, or the nearest it hangs on that both models have.

    Parameters
    ----------
    region : of one model
    common : regions of both

    Raises
    ------
    BadData : there is none
    """
    above: Region | None = region
    while above is not None and above not in common:
        above = above.parent
    if above is None:
        raise BadData(f"the {region} has no mass in one of the models, and no body above it has")
    return above


def _markers(
    lower: Standing, higher: Standing, rotation: Array, options: TransferOptions
) -> tuple[tuple[Marker, ...], list[Message]]:
    """Place the lower model's markers at the same places in space, on bodies of the higher.

    Parameters
    ----------
    rotation : (3, 3) from the lower model's ground axes to the higher's

    Returns
    -------
    markers, and one line for each that is left out
    """
    links = links_of(higher.model, higher.pose)
    common = _common(lower, higher)
    counted = {name: common_region(region, common) for name, region in higher.regions.items()}
    body_of = {marker.name: marker.body for marker in higher.model.markers}
    placed = []
    notes = []
    for marker in lower.model.markers:
        if marker.body not in lower.regions:
            notes.append(
                COUNTERPARTS.message(
                    f"marker '{marker.name}' is on the ground: it is left out",
                    severity="good to know",
                )
            )
            continue
        place = rotation @ lower.in_ground(marker.body, marker.location)
        region = common_region(lower.regions[marker.body], common)
        inside = [name for name in higher.model.body_names if counted[name] == region]
        body = body_of.get(marker.name, marker.body)
        if body not in inside:
            body = _nearest(place, links, inside)
        placed.append(
            Marker(
                name=marker.name,
                body=body,
                location=higher.in_body(body, place),
                fixed=marker.fixed,
            )
        )
    if options.keep_markers:
        taken = {marker.name for marker in placed}
        placed += [marker for marker in higher.model.markers if marker.name not in taken]
    return tuple(placed), notes


def _nearest(place: Array, links: Links, names: Sequence[str]) -> str:
    """Find the body of those named whose bone is nearest to a position.

    Parameters
    ----------
    place : (3,) in ground [m]
    """
    wanted = np.isin(links.bone_links, [links.names.index(name) for name in names])
    start = links.bones[wanted, 0]
    end = links.bones[wanted, 1]
    along = end - start
    length = np.maximum((along**2).sum(axis=1), 1e-18)
    share = np.clip(((place - start) * along).sum(axis=1) / length, 0.0, 1.0)
    distance = np.linalg.norm(start + share[:, None] * along - place, axis=1)
    return links.names[links.bone_links[wanted][int(np.argmin(distance))]]
