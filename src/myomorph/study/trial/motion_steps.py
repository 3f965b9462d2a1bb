"""Inverse kinematics and inverse dynamics of one trial."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from myomorph.model.errors import BadData
from myomorph.model.series import Markers, Motion, Series, Wrenches
from myomorph.motion.crossings import crossings, within_crossings
from myomorph.motion.filters import differentiate
from myomorph.motion.ik import KinematicsFit, inverse_kinematics
from myomorph.motion.sync import cut, resample_wrenches
from myomorph.store.progress import progress
from myomorph.study.trial.inputs import has_mass
from myomorph.study.trial.take import Found, Take

if TYPE_CHECKING:
    pass


def solve_kinematics(take: Take) -> KinematicsFit:
    """Inverse kinematics of the part of a recording that is asked for."""
    if take.markers is None:
        raise BadData(f"{take.name}: holds no markers")
    markers = used_markers(take, take.markers)
    with progress(f"{take.name}: inverse kinematics", len(markers)) as advance:
        return inverse_kinematics(take.model, markers, take.kinematics, advance)


def used_markers(take: Take, markers: Markers) -> Markers:
    """The part of a recording that is asked for; with crossings only, markers are hidden elsewhere.

    Raises
    ------
    BadData
        where crossings are asked for, but there is none
    """
    markers = markers if take.time is None else cut(markers, *take.time)
    if not take.crossings.only:
        return markers
    spans = crossings(markers, take.model, take.crossings)
    if not spans:
        raise BadData(
            f"{take.name}: no part of {take.crossings.shortest:g} s shows {100 * take.crossings.shown:g} % of what its "
            "markers could tell: ask for less (crossings_shown, crossings_shortest)"
        )
    return within_crossings(markers, spans)


def with_derivatives(take: Take, found: Found) -> Found:
    """The motion with velocities and accelerations, cut to the time that is asked for, with closed loops closed.

    Derivatives are taken of all frames first, as OpenSim does, so the cut leaves no edges.
    """
    from myomorph.rigid.closed_motion import closed_motion

    motion = differentiate(_recorded(take, found), take.derivatives.cutoff)
    motion, notes = closed_motion(take.model, motion if take.time is None else cut(motion, *take.time))
    return replace(found, motion=motion, notes=(*found.notes, *notes))


def loads_at(take: Take, recorded: Motion, motion: Motion) -> Wrenches | None:
    """External forces at the motion's times, filtered as the motion."""
    if take.loads is None:
        return None
    return resample_wrenches(take.loads(recorded), motion.time, take.derivatives.cutoff)


def solve_dynamics(take: Take, found: Found) -> Found:
    """Inverse dynamics of the coordinates found so far."""
    from myomorph.rigid.dynamics import inverse_dynamics

    has_mass(take.model, "inverse dynamics")
    found = with_derivatives(take, found)
    assert found.motion is not None
    wrenches = loads_at(take, _recorded(take, found), found.motion)
    notes = found.notes if wrenches is None else (*found.notes, *wrenches.notes)
    torques = inverse_dynamics(take.model, found.motion, wrenches)
    return replace(found, wrenches=wrenches, torques=torques, notes=notes)


def told_torques(take: Take, motion: Motion, torques: Series) -> Series:
    """The torques that the table of inverse dynamics shows: all of them, or what its options leave."""
    if take.torque_table.net:
        from myomorph.muscles.passive import passive_generalized_forces

        torques = replace(torques, values=torques.values - passive_generalized_forces(take.model, motion).values)
    if take.torque_table.folded:
        from myomorph.rigid.closed_motion import loop_torques

        torques = loop_torques(take.model, motion, torques).torques
    return torques


def _recorded(take: Take, found: Found) -> Motion:
    if found.recorded is None:
        raise BadData(f"{take.name}: has no motion yet: run 'ik' first")
    return found.recorded
