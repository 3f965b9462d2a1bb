"""Contacts that are alone on their plates: what these measured acts as it was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import ContactForces, SharedWrench, Site
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import Series, Wrenches

STEEP = 0.05
"""Part of a force upwards below which it has no center of pressure on the floor."""


@read_only
class AloneOnPlates:
    """Forces of contacts that were alone on their plates.

    Attributes
    ----------
    forces : one per contact, named as it, 0 in other frames
    carriers : of each contact, the name of the site that stands for it
    """

    forces: Wrenches
    carriers: Mapping[str, str]

    def silenced(self, ready: Series, sites: Sequence[Site]) -> Series:
        """Set activations of contacts to zero while their force is known.

        Parameters
        ----------
        ready : activations (frames, sites)
        sites : one per column
        """
        values = np.array(ready.values)
        for column, group in enumerate(self.forces.names):
            members = [index for index, site in enumerate(sites) if site.group == group]
            values[np.ix_(self._known(column), np.array(members))] = 0.0
        return replace(ready, values=values)

    def added_to(self, estimated: ContactForces) -> ContactForces:
        """Put known forces on the sites that stand for their contacts.

        Parameters
        ----------
        estimated : forces at contact sites, none while they are known
        """
        activation = np.array(estimated.contact_activation)
        force = np.array(estimated.contact_force)
        point = np.array(estimated.contact_point)
        torque = np.array(estimated.contact_torque)
        for column, group in enumerate(self.forces.names):
            known = self._known(column)
            site = estimated.names.index(self.carriers[group])
            activation[known, site] = 1.0
            force[known, site] = self.forces.forces[known, column]
            point[known, site] = self.forces.points[known, column]
            torque[known, site] = self.forces.torques[known, column]
        return replace(
            estimated,
            contact_activation=activation,
            contact_force=force,
            contact_point=point,
            contact_torque=torque,
        )

    def _known(self, column: int) -> NDArray[np.bool_]:
        """Return whether the force of a contact is known (frames,)."""
        return np.asarray(self.forces.forces[:, column].any(axis=1))


def alone_on_plates(
    model: Model, time: Array, sites: Sequence[Site], plates: Sequence[SharedWrench], floor: float
) -> AloneOnPlates | None:
    """Find what plates measured of contacts while nothing else stood on them.

    Parameters
    ----------
    model : with the sites' bodies
    time : (frames,) of the plates' forces [s]
    sites : of contact
    plates : what plates measured of which sites together
    floor : height of the plates [m]

    Returns
    -------
    forces [N], points [m] and free torques [N m]; None where no contact was alone
    """
    alone = {group: wrench for group, wrench in _of_groups(sites, plates).items() if wrench}
    if not alone:
        return None
    carriers = {group: _carrier(model, [s for s in sites if s.group == group]) for group in alone}
    frames = len(time)
    forces = np.zeros((frames, len(alone), 3))
    points = np.zeros_like(forces)
    torques = np.zeros_like(forces)
    up = np.asarray(model.up)
    for column, wrenches in enumerate(alone.values()):
        for wrench in wrenches:
            known = np.isfinite(wrench.forces).all(axis=1) & np.isfinite(wrench.moments).all(axis=1)
            force = wrench.forces[known]
            moment = wrench.moments[known]
            center = _centers(force, moment, up, floor)
            forces[known, column] = force
            points[known, column] = center
            torques[known, column] = moment - np.cross(center, force)
    return AloneOnPlates(
        forces=Wrenches(
            time=time,
            names=tuple(alone),
            bodies=tuple(carriers[group].body for group in alone),
            forces=forces,
            points=points,
            torques=torques,
        ),
        carriers=FrozenMap({group: site.name for group, site in carriers.items()}),
    )


def still_shared(sites: Sequence[Site], plates: Sequence[SharedWrench]) -> tuple[SharedWrench, ...]:
    """Choose the plates with several contacts, or whose forces are known in part only."""
    alone = [wrench for found in _of_groups(sites, plates).values() for wrench in found]
    return tuple(plate for plate in plates if all(plate is not wrench for wrench in alone))


def _of_groups(
    sites: Sequence[Site], plates: Sequence[SharedWrench]
) -> dict[str, list[SharedWrench]]:
    """Wholly measured wrenches of one contact each, by its name."""
    groups = {site.name: site.group for site in sites}
    found: dict[str, list[SharedWrench]] = {}
    for plate in plates:
        names = {groups[name] for name in plate.sites}
        whole = np.isfinite(plate.forces) == np.isfinite(plate.forces[:, :1])
        moments = np.isfinite(plate.moments) == np.isfinite(plate.forces[:, :1])
        if len(names) == 1 and whole.all() and moments.all():
            found.setdefault(names.pop(), []).append(plate)
    return found


def _carrier(model: Model, members: Sequence[Site]) -> Site:
    """Choose the site that stands for a contact: of the foot's own body, where there is one."""
    feet = feet_of(model)
    return next((site for site in members if site.body in feet), members[0])


def _centers(force: Array, moment: Array, up: Array, floor: float) -> Array:
    """Centers of pressure on the floor; the ground's origin where a force does not press on it.

    Parameters
    ----------
    force, moment : (frames, 3), the moment about the ground's origin [N], [N m]
    up : (3,) unit vector
    floor : its height [m]

    Returns
    -------
    (frames, 3) [m]
    """
    size = np.linalg.norm(force, axis=1)
    pressing = force @ up
    firm = np.abs(pressing) > STEEP * np.maximum(size, 1e-12)
    square = np.where(firm, size**2, 1.0)[:, None]
    near = np.cross(force, moment) / square
    along = (floor - near @ up) / np.where(firm, pressing, 1.0)
    return np.where(firm[:, None], near + along[:, None] * force, 0.0)
