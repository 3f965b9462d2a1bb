"""A person of the bundled legs and trunk who walks or runs, with markers and forces on the feet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Event, Markers, Motion, Wrenches
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.motion.protocols import protocols
from myomorph.core.motion.splines import natural_spline
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.lab.analysis.center_of_mass import centroid
from myomorph.lab.analyze.generic_model import generic_model
from myomorph.show.simulate.gait.balance import (
    balanced_way,
    counted_phase,
    heights,
    support_of,
    wrenches_on_feet,
)
from myomorph.show.simulate.gait.foot_paths import Sole, foot_path, sole_of
from myomorph.show.simulate.gait.plan import SIDES, Footfall, GaitPlan, footfalls
from myomorph.show.simulate.squat import SimulationOptions, Splines, measured_markers
from myomorph.show.simulate.total_wrench import total_wrench

HEIGHT = 1.75
MASS = 70.0
"""Of the person [m], [kg]."""
LABELS = (
    *("LASI", "RASI", "LPSI", "RPSI", "LTHI", "RTHI", "LKNE", "RKNE", "LTIB", "RTIB"),
    *("LANK", "RANK", "LHEE", "RHEE", "LTOE", "RTOE", "LMT5", "RMT5"),
    *("LKNM", "RKNM", "LMED", "RMED", "C7", "T10", "CLAV", "STRN"),
)
"""Markers, in the words of Plug-in Gait and CGM2."""
PROTOCOL = "cgm2"
HELD = (
    *("pelvis_tilt", "pelvis_list", "pelvis_rotation", "pelvis_tx", "pelvis_ty", "pelvis_tz"),
    *("lumbar_extension", "lumbar_bending", "lumbar_rotation"),
)
"""Coordinates of pelvis and trunk, which are planned."""
KNOT_RATE = 50.0
ROUNDS = 5  # In which pelvis and feet come into balance.
FIRM = 0.3
"""Share of the weight from which on the feet can turn the body as its legs ask for."""
TRUNK_TURN = -1.5  # Of the trunk on the pelvis, over the pelvis' own.
FIRST = 2
LAST = -4
"""Footfalls at which the recording begins and ends: those before and after are not in balance."""
MARGIN = 0.12  # Before the first and after the last of them [s].
NOISE = SimulationOptions()


@cache
def person() -> Model:
    """Make the bundled legs and trunk with markers where a laboratory would stick them."""
    protocol = protocols().protocols[PROTOCOL]
    sites = {label: protocol.site(label) for label in LABELS}
    known = {label: site for label, site in sites.items() if site is not None}
    model, _ = generic_model(known, height=HEIGHT, mass=MASS)
    return replace(model.with_mass(MASS), name="simulated person")


@dataclass(frozen=True, eq=False)
class SimulatedGait:
    """A gait with what would have been recorded of it.

    Attributes
    ----------
    model : of the person
    motion : true coordinates at the markers' rate, with derivatives [rad, m]
    markers : with noise [m]
    wrenches : on both heels, with noise [N], [N m]
    events : true foot strikes and foot offs within the recording
    """

    model: Model
    motion: Motion
    markers: Markers
    wrenches: Wrenches
    events: tuple[Event, ...]


def simulated_gait(plan: GaitPlan, seed: int, noise: SimulationOptions = NOISE) -> SimulatedGait:
    """Simulate somebody who walks or runs, and what a laboratory would record.

    Feet go as planned. Pelvis and trunk follow so that the center of pressure stays where the feet
    stand; legs follow from both by inverse kinematics. The forces on the feet are those that the
    equations of motion of the whole body leave, so a walk leaves nothing at the pelvis. In flight
    nothing can turn the body, but planned legs do: a run leaves moments there.

    Parameters
    ----------
    plan : of the gait
    seed : of the differences between steps, and of the noise
    noise : of markers and forces, and their rates
    """
    random = np.random.default_rng(seed)
    model = person()
    walker = Walker(model=model, plan=plan, falls=footfalls(plan, random))
    splines = walker.splines()
    start = walker.falls[FIRST].strike - MARGIN
    stop = walker.falls[LAST].strike + MARGIN
    motion = _sampled(splines, noise.rate, start, stop)
    wrenches = walker.wrenches(_sampled(splines, noise.force_rate, start, stop))
    shaken = noise.force_noise * random.standard_normal(wrenches.forces.shape)
    loaded = np.any(wrenches.forces != 0.0, axis=2, keepdims=True)
    wrenches = replace(wrenches, forces=wrenches.forces + np.where(loaded, shaken, 0.0))
    markers = measured_markers(model, motion, noise, random)
    events = tuple(event for event in walker.events if start <= event.time <= stop)
    return SimulatedGait(
        model=model,
        motion=replace(motion, time=motion.time - start),
        markers=replace(markers, time=markers.time - start),
        wrenches=replace(wrenches, time=wrenches.time - start),
        events=tuple(replace(event, time=event.time - start) for event in events),
    )


def _sampled(splines: Splines, rate: float, start: float, stop: float) -> Motion:
    """Sample a motion with exact derivatives at so many frames a second, from start on."""
    time = start + np.arange(int((stop - start) * rate) + 1) / rate
    return splines.at_times(time)


@dataclass(frozen=True, eq=False)
class Walker:
    """A person with a plan.

    Attributes
    ----------
    model : of the person
    plan : of the gait
    falls : footfalls, in the order of time
    """

    model: Model
    plan: GaitPlan
    falls: tuple[Footfall, ...]

    @cached_property
    def tree(self) -> Tree:
        """The model as arrays."""
        return compile_tree(self.model)

    @cached_property
    def soles(self) -> Mapping[str, Sole]:
        """Points under both feet, by side."""
        return {side: sole_of(self.model, side) for side in SIDES}

    @cached_property
    def time(self) -> Array:
        """(knots,) of the coordinates' splines [s]."""
        count = round((self.falls[-1].lift + 0.2) * KNOT_RATE)
        return np.arange(count + 1) / KNOT_RATE

    @property
    def gravity(self) -> float:
        """[m/s^2]."""
        return float(np.linalg.norm(self.model.gravity))

    @property
    def events(self) -> tuple[Event, ...]:
        """True foot strikes and foot offs."""
        found = [
            Event(time=time, label=label, side=fall.side.capitalize())
            for fall in self.falls
            for time, label in ((fall.strike, "Foot Strike"), (fall.lift, "Foot Off"))
        ]
        return tuple(sorted(found, key=lambda event: event.time))

    @cached_property
    def feet(self) -> Markers:
        """Places of the points under both feet, as markers that legs are led by."""
        places = [
            foot_path(self.plan, self._of(side), self.soles[side], self.time) for side in SIDES
        ]
        names = [marker.name for sole in self.soles.values() for marker in sole.markers]
        return Markers(self.time, tuple(names), np.concatenate(places, axis=1))

    def _of(self, side: str) -> Sequence[Footfall]:
        return [fall for fall in self.falls if fall.side == side]

    def splines(self) -> Splines:
        """Lay smooth coordinates through poses in which the body is in balance over its feet."""
        pressure = support_of(self.falls, self.soles["right"].length, self.time).pressure
        lift = heights(self.plan, self.falls, self.gravity, self.time)
        height = self._standing_height - self.plan.crouch + lift.height
        rate = (self.gravity + lift.acceleration) / height
        # Where the feet hardly press, they cannot turn the body.
        presses = np.clip((1.0 + lift.acceleration / self.gravity) / FIRM, 0.0, 1.0)
        forcing = np.zeros_like(pressure)
        offset = np.zeros_like(pressure)
        for _ in range(ROUNDS):
            way = np.stack([height] * 3, axis=1)
            for axis in (0, 2):
                way[:, axis] = balanced_way(self.time, pressure[:, axis], rate, forcing[:, axis])
            splines = self._led(way - offset)
            motion = splines.at_times(self.time)
            center = centroid(self.model, motion).values
            offset = center - np.stack([motion[f"pelvis_t{axis}"] for axis in "xyz"], axis=1)
            # Its rate of angular momentum: about z it moves the body along x, about x against z.
            spin = total_wrench(self.tree, motion).about(center)
            turned = np.stack([spin[:, 2], np.zeros(len(spin)), -spin[:, 0]], axis=1)
            forcing = (presses / (self.model.mass * height))[:, None] * turned
        return splines

    @cached_property
    def _standing_height(self) -> float:
        """Height of the center of mass above the soles of the default pose [m]."""
        rest = Motion(np.zeros(1), self.model.coordinate_names, self.tree.defaults[None])
        center = centroid(self.model, rest).values[0, 1]
        heel = self.soles["right"].markers[0]
        sole = standing_poses(self.model)[heel.body].apply(heel.location)[1]
        return float(center - sole)

    def _led(self, pelvis: Array) -> Splines:
        """Find the legs' coordinates under a pelvis.

        Parameters
        ----------
        pelvis : (knots, 3) its origin [m]
        """
        strikes = np.array([fall.strike for fall in self.falls])
        turn = self.plan.turn * np.cos(np.pi * counted_phase(strikes, self.time))
        values = {name: np.zeros(len(self.time)) for name in HELD}
        values |= {f"pelvis_t{axis}": pelvis[:, i] for i, axis in enumerate("xyz")}
        values |= {"pelvis_rotation": turn, "lumbar_rotation": TRUNK_TURN * turn}
        held = Motion(self.time, tuple(values), np.stack(list(values.values()), axis=1))
        markers = [marker for sole in self.soles.values() for marker in sole.markers]
        led = self.model.with_markers(tuple(markers)).lock(*HELD)
        fit = inverse_kinematics(led, self.feet, InverseKinematicsOptions(coordinates=held))
        names = [
            coordinate.name
            for coordinate in self.model.coordinates
            if not coordinate.locked and coordinate.name not in self.model.dependent_coordinates
        ]
        columns = [fit.motion.names.index(name) for name in names]
        spline = natural_spline(self.time, fit.motion.values[:, columns])
        return Splines(tuple(names), spline)

    def wrenches(self, motion: Motion) -> Wrenches:
        """Share the wrench that a motion takes between both feet."""
        support = support_of(self.falls, self.soles["right"].length, motion.time)
        bodies = (self.soles["right"].body, self.soles["left"].body)
        return wrenches_on_feet(self.falls, support, total_wrench(self.tree, motion), bodies)
