"""Carry the motion of a model to the model with more joints that has its lengths.

The motion of [D] 3.2.1, step 5, after `transfer` has carried lengths and masses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.body.identify.transfer import Transfer, common_region
from myomorph.body.identify.transfer_options import TransferOptions
from myomorph.body.shape.regions import Region, Standing, regions_of
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Marker, Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.motion.tasks.coordinates import CoordinateTask
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.rigid.coordinates import couple_frames
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.loops import free_coordinates
from myomorph.core.rigid.tree import compile_tree

LEVER = 0.1  # Of the points beside a joint center that carry the orientation of its segment [m].
TARGET_SD = 2e-3  # By which points of the two models may differ [m].
FREE_SD = {"rotational": 0.1, "translational": 0.002}
"""Of a coordinate of a joint inside a region, which the lower model does not have [rad or m]."""


@read_only
class CarriedMotion:
    """A motion of a transferred model.

    Attributes
    ----------
    motion : of all its coordinates, NaN where the lower model's is unknown [rad or m]
    errors : (frames, targets) distances of the two models' points [m]
    targets : names of the points
    known : share of each coordinate's variance that the points remove, mean over frames: near 0 it
        stays where the transfer left it, near 1 it follows the lower model; coordinates that are
        locked or driven have none
    """

    motion: Motion
    errors: Array
    targets: tuple[str, ...]
    known: dict[str, float]


def carry_motion(
    lower: Model, motion: Motion, transfer: Transfer, options: TransferOptions | None = None
) -> CarriedMotion:
    """Find the motion of a transferred model that follows one of the lower model, frame by frame.

    Points that coincide in the transfer's pose are kept together: markers, joint centers, and three
    points around each center of a limb, which carry its segment's orientation (the torso's follows
    from markers and shoulders, as one body became many). What the points leave open is held:
    coordinates of joints inside a region (vertebrae, ribs, shoulder blades) are pulled to where the
    transfer left them, with a standard deviation of `FREE_SD` against the points' of `TARGET_SD`;
    so a bend of the trunk is spread evenly over its joints.

    Source: [D] 3.2.1, step 5.

    Parameters
    ----------
    lower : the model that was transferred
    motion : of that model [rad or m]
    transfer : its result, with the higher model and the pose in which both coincide
    options : those of the transfer

    Returns
    -------
    the motion of the higher model, and how far it is from the lower one's

    Raises
    ------
    BadData : the two models' grounds have different verticals
    """
    options = options or TransferOptions()
    higher = transfer.model
    if np.cross(lower.gravity, higher.gravity).any():
        raise BadData(
            f"models '{lower.name}' and '{higher.name}' have other verticals ({lower.gravity} and"
            f" {higher.gravity} m/s^2): a motion is transferred only in one laboratory"
        )
    points, places = _points(lower, transfer, options)
    tree = compile_tree(lower)
    values = forward_kinematics(tree, tree.coordinates_of(motion)).markers(points)
    values[~np.isfinite(motion.values).all(axis=1)] = np.nan
    markers = Markers(motion.time, tuple(point.name for point in points), values)
    model = replace(higher, markers=places)
    rest = compile_tree(higher).coordinates_of(transfer.higher_pose)[0]
    common = {match.region for match in transfer.masses}
    pulls = _pulls(higher, rest, len(places), common, options)
    fit = inverse_kinematics(model, markers, InverseKinematicsOptions(tasks=pulls))
    return CarriedMotion(
        motion=fit.motion,
        errors=fit.marker_error,
        targets=fit.marker_names,
        known=_known(model, fit.motion, pulls),
    )


def _points(
    lower: Model, transfer: Transfer, options: TransferOptions
) -> tuple[tuple[Marker, ...], tuple[Marker, ...]]:
    """Place the same points on the lower and on the transferred model.

    They coincide in the transfer's pose.

    Returns
    -------
    points on the lower model, and on the transferred one in the same order
    """
    higher = transfer.model
    ours = Standing(lower, transfer.lower_pose, regions_of(lower, options.lower_segments))
    theirs = Standing(higher, transfer.higher_pose, regions_of(higher, options.higher_segments))
    pairs = [
        (lower.marker(marker.name), marker.body)
        for marker in higher.markers
        if marker.name in lower.marker_names
    ]
    for key in transfer.joint_errors:
        center = ours.centers[key]
        body = theirs.centers[key].joint.child
        beside = (
            np.zeros((1, 3))
            if center.outer.name == "torso"
            else LEVER * np.vstack([np.zeros(3), np.eye(3)])
        )
        pairs += [
            (Marker(f"center {key} {i}", center.joint.child, center.location + offset), body)
            for i, offset in enumerate(beside)
        ]
    placed = []
    for point, body in pairs:
        place = transfer.rotation @ ours.in_ground(point.body, point.location)
        placed.append(Marker(point.name, body, theirs.in_body(body, place)))
    return tuple(point for point, _ in pairs), tuple(placed)


def _pulls(
    model: Model, rest: Array, points: int, common: set[Region], options: TransferOptions
) -> list[CoordinateTask]:
    """Make pulls of the coordinates inside common regions to the transfer's pose.

    Parameters
    ----------
    rest : (coordinates,) of the higher model in that pose [rad or m]
    points : number of points that the weights are measured against
    common : regions of both models
    """
    regions = {
        body: common_region(region, common)
        for body, region in regions_of(model, options.higher_segments).items()
    }
    inside = {
        name
        for joint in model.joints
        if regions.get(joint.parent, regions[joint.child]) == regions[joint.child]
        for name in joint.coordinates
    } - set(floating_coordinates(model))
    return [
        CoordinateTask(
            coordinate.name,
            (TARGET_SD / FREE_SD.get(coordinate.motion, 0.1)) ** 2 / points,
            float(rest[index]),
        )
        for index, coordinate in enumerate(model.coordinates)
        if coordinate.name in inside
        and not coordinate.locked
        and coordinate.name not in model.dependent_coordinates
    ]


def _known(model: Model, motion: Motion, pulls: list[CoordinateTask]) -> dict[str, float]:
    """Compute the share of each coordinate's variance that the points remove.

    See `CarriedMotion.known`: the diagonal of 1 - (J^T J / s^2 + D^-1)^-1 D^-1, mean of up to ten
    frames, with the slopes J of the points, their standard deviation s and the variances D of the
    pulls.
    """
    tree = compile_tree(model)
    held = {pull.coordinate: pull.weight * len(model.markers) for pull in pulls}
    free = free_coordinates(tree)
    step = 1e-5
    names = [model.coordinates[j].name for j in free]
    prior = np.array([held[name] / TARGET_SD**2 if name in held else 1.0 for name in names])
    shown = np.flatnonzero(np.isfinite(motion.values).all(axis=1))
    shares = np.zeros((0, len(free)))
    for frame in shown[:: max(1, len(shown) // 10)]:
        moved = np.repeat(tree.coordinates_of(motion)[frame : frame + 1], 2 * len(free), axis=0)
        moved[np.arange(2 * len(free)), np.tile(free, 2)] += np.repeat([step, -step], len(free))
        couple_frames(tree.arrays, moved)
        places = forward_kinematics(tree, moved).markers(model.markers).reshape(2, len(free), -1)
        J = (places[0] - places[1]) / (2.0 * step * TARGET_SD)
        shares = np.vstack(
            [shares, 1.0 - np.diagonal(np.linalg.inv(J @ J.T + np.diag(prior))) * prior]
        )
    return dict(zip(names, shares.mean(axis=0).tolist(), strict=True)) if len(shares) else {}
