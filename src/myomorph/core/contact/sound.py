"""Impacts heard by microphones: when each drum was struck, how loud, and by which site.

The way from the instrument to its microphone is taken off at the speed of sound, and what one
impact sends into several microphones is separated by how loud it is in each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from myomorph.core.contact.onsets import REST, Heard, Onset, energy_after, listen, onsets
from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.causes import SOUND
from myomorph.core.model.contacts import Contacts, Touch
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.model import index_of
from myomorph.core.model.series import Sound

SPEED = 343.0
"""Speed of sound in air of 20 degrees C [m/s]."""
TOGETHER = 0.02
"""Arrivals this close may be one impact in several microphones [s]."""
SOFTEST = 0.002
"""Energy below which an impact of an instrument is none, as a share of its loud ones."""
ECHO = 0.03
ECHO_TIME = 0.12
"""An impact of less than this share of the energy of another of its instrument within so long [s]
is its echo.
"""
OWN = 0.75
"""Part of a channel's energy that its own instrument must explain, so that it was struck."""


def speed_of_sound(celsius: float) -> float:
    """Speed of sound in dry air [m/s]: 331.3 sqrt(1 + T / 273.15)."""
    if not -80.0 < celsius < 80.0:
        raise BadData(f"air of {celsius:g} degrees C: expected -80 to 80")
    return float(331.3 * np.sqrt(1.0 + celsius / 273.15))


@dataclass(frozen=True, eq=False)
class Instrument:
    """Something that sounds when it is struck, and the microphone that stands nearest to it.

    Attributes
    ----------
    channel : name of the microphone's channel
    distance : from the place that is struck to that microphone [m]
    sites : contact sites of the body that may strike it, such as the tips of two sticks
    others : distances to microphones of other channels [m], where known: they give how loud it is
        there
    """

    name: str
    channel: str
    distance: float = 0.0
    sites: tuple[str, ...] = ()
    others: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))

    def __post_init__(self) -> None:
        for channel, far in {self.channel: self.distance, **self.others}.items():
            if not 0.0 <= far < 1000.0:
                raise BadData(
                    f"instrument '{self.name}' is {far:g} m from channel '{channel}': expected 0 to"
                    " 1000 m"
                )


@dataclass(frozen=True)
class HeardImpact:
    """One impact on one instrument.

    Attributes
    ----------
    time : at the instrument, on the motion's clock [s]
    energy : what its own microphone got of it [full scale^2 s]
    confidence : 0 to 1: the part of what was heard then in its microphone that is this impact
    """

    instrument: str
    time: float
    energy: float
    confidence: float


@dataclass(frozen=True)
class HeardImpacts:
    """Impacts that were heard, in the order of time, and what looks wrong, one line each."""

    instruments: tuple[Instrument, ...]
    impacts: tuple[HeardImpact, ...]
    warnings: tuple[Message, ...] = ()

    def of(self, instrument: str) -> tuple[HeardImpact, ...]:
        """Impacts on one instrument; raises `UnknownName`."""
        names = tuple(instrument.name for instrument in self.instruments)
        index_of("instrument", instrument, names, "the sound")
        return tuple(impact for impact in self.impacts if impact.instrument == instrument)


def hear_impacts(
    sound: Sound, instruments: Sequence[Instrument], speed: float = SPEED, time: Array | None = None
) -> HeardImpacts:
    """Find impacts on every instrument, each heard once.

    Parameters
    ----------
    sound : all channels on one clock, which `sound.start` ties to the motion's
    instruments : with their microphones
    speed : of sound [m/s]
    time : (frames,) of the motion, where there is one: a sound of another length is reported [s]

    Returns
    -------
    in the order of time, with warnings

    Raises
    ------
    BadData : no instrument, two of one name, or no time in common with the motion
    UnknownName : a channel is not in the sound
    """
    names = tuple(instrument.name for instrument in instruments)
    if not names or len(set(names)) != len(names):
        raise BadData(
            f"instruments are named {names}: expected one or more, each with a name of its own"
        )
    for instrument in instruments:
        for channel in (instrument.channel, *instrument.others):
            index_of(
                "sound channel",
                channel,
                sound.names,
                f"the recording, for instrument '{instrument.name}',",
            )
    warnings = [*sound.warnings, *sound_faults(sound, time)]
    channels = tuple(dict.fromkeys(instrument.channel for instrument in instruments))
    heard = {name: listen(sound, name) for name in channels}
    arrivals = {name: onsets(heard[name]) for name in channels}
    separated = _told_apart(instruments, arrivals, heard, speed)
    impacts: list[HeardImpact] = []
    for name in names:
        on_it = _without_echoes([impact for impact in separated if impact.instrument == name])
        impacts += on_it
        if not on_it:
            warnings.append(SOUND.message(f"no impact on '{name}' was heard", place=name))
    in_order = sorted(impacts, key=lambda impact: impact.time)
    return HeardImpacts(tuple(instruments), tuple(in_order), tuple(warnings))


def sound_faults(sound: Sound, time: Array | None = None) -> tuple[Message, ...]:
    """Find silent and clipped channels, and another length than the motion's.

    Parameters
    ----------
    sound : all channels on one clock
    time : (frames,) of the motion [s]

    Returns
    -------
    one line each

    Raises
    ------
    BadData : the sound and the motion have no time in common
    """
    faults = [fault for name in sound.names for fault in _channel_faults(sound, name)]
    if time is None:
        return tuple(faults)
    stop = sound.start + sound.duration
    first = float(time[0])
    last = float(time[-1])
    if stop <= first or sound.start >= last:
        raise BadData(
            f"the sound runs from {sound.start:g} to {stop:g} s, the motion from {first:g} to"
            f" {last:g} s: they have no time in common"
        )
    if abs(sound.start - first) > 0.1 or abs(stop - last) > 0.1:
        faults.append(
            SOUND.message(
                f"the sound runs from {sound.start:.3f} to {stop:.3f} s, the motion from"
                f" {first:.3f} to {last:.3f} s: impacts are known where both run; check the sound's"
                " start"
            )
        )
    return tuple(faults)


def _channel_faults(sound: Sound, name: str) -> list[Message]:
    """Say whether a channel is silent or clipped."""
    channel = sound[name]
    peak = float(np.abs(channel).max(initial=0.0))
    if peak < 1e-5:
        return [SOUND.message(f"sound channel '{name}' is silent", place=name)]
    for edge in (channel.max(), channel.min()):
        flat = max((stop - start for start, stop in runs(channel == edge)), default=0)
        if flat >= 3 and abs(edge) > 0.5 * peak:
            at = sound.start + int(np.argmax(channel == edge)) / sound.rate
            return [
                SOUND.message(
                    f"sound channel '{name}' is clipped at {abs(edge):.2g} of full scale, first at"
                    f" {at:.3f} s: energies of loud impacts are too small",
                    place=name,
                )
            ]
    return []


def contacts_heard(heard: HeardImpacts, sites: Sequence[str], duration: float = 0.01) -> Contacts:
    """Make contact intervals of impacts: each site touches its instrument for a duration [s].

    Parameters
    ----------
    heard : impacts whose site is known
    sites : that made each impact, as `strikers.find_strikers` finds
    duration : [s]
    """
    known = tuple(
        dict.fromkeys(name for instrument in heard.instruments for name in instrument.sites)
    )
    touches = []
    for site, impact in zip(sites, heard.impacts, strict=True):
        check_name("contact site", site, known, "the instruments")
        stop = impact.time + duration
        touches.append(
            Touch(
                site=site,
                start=impact.time,
                stop=stop,
                surface=impact.instrument,
                confidence=impact.confidence,
                source="sound",
            )
        )
    return Contacts(known, tuple(touches), heard.warnings)


def _told_apart(
    instruments: Sequence[Instrument],
    arrivals: Mapping[str, Sequence[Onset]],
    heard: Mapping[str, Heard],
    speed: float,
) -> list[HeardImpact]:
    """Make impacts of arrivals in all channels: those close in time belong together."""
    ways = {instrument.name: instrument.distance / speed for instrument in instruments}
    entries = sorted(
        (
            (onset.time - ways[instrument.name], i, onset)
            for i, instrument in enumerate(instruments)
            for onset in arrivals[instrument.channel]
        ),
        key=lambda entry: entry[:2],
    )
    groups: list[list[tuple[float, int, Onset]]] = []
    for entry in entries:
        if groups and entry[0] - groups[-1][0][0] <= TOGETHER:
            groups[-1].append(entry)
        else:
            groups.append([entry])
    if not groups:
        return []
    energies = np.array([_energies(instruments, group, heard, speed) for group in groups])
    bleed = _bleed(instruments, energies)
    loud = np.quantile(energies, 0.9, axis=0)
    impacts = []
    for group, energy in zip(groups, energies, strict=True):
        scale = np.where(loud > 0.0, loud, 1.0)
        shares, _ = scipy.optimize.nnls(bleed * scale / scale[:, None], energy / scale)
        scaled = shares * scale
        # The first arrival of every instrument.
        first = {i: (time, onset) for time, i, onset in reversed(group)}
        for i in dict.fromkeys(i for _, i, _ in group):
            time, onset = first[i]
            if scaled[i] >= OWN * max(energy[i], 1e-300) and scaled[i] >= SOFTEST * loud[i]:
                sure = scaled[i] / (energy[i] + onset.background)
                impacts.append(
                    HeardImpact(
                        instrument=instruments[i].name,
                        time=time,
                        energy=float(scaled[i]),
                        confidence=float(min(sure, 1.0)),
                    )
                )
    return impacts


def _energies(
    instruments: Sequence[Instrument],
    group: Sequence[tuple[float, int, Onset]],
    heard: Mapping[str, Heard],
    speed: float,
) -> Array:
    """Energy that each microphone got (instruments,) while a group of arrivals sounded."""
    energies = {i: onset.energy for _, i, onset in reversed(group)}
    result = np.zeros(len(instruments))
    for i, instrument in enumerate(instruments):
        if i in energies:
            result[i] = energies[i]
            continue
        arrival = group[0][0] + instrument.distance / speed
        result[i] = max(energy_after(heard[instrument.channel], arrival)[0], 0.0)
    return result


def _bleed(instruments: Sequence[Instrument], energies: Array) -> Array:
    """Energy in microphone i of an impact on j that gives 1 in its own.

    The median of what the louder half of the impacts that were loudest on j left in i; with fewer
    than four of these it falls with the square of the distances, where they are known.

    Parameters
    ----------
    energies : (groups, instruments)

    Returns
    -------
    (instruments, instruments)
    """
    count = len(instruments)
    relative = energies / np.maximum(np.quantile(energies, 0.9, axis=0), 1e-300)
    result = np.eye(count)
    for j, source in enumerate(instruments):
        loudest = (relative.argmax(axis=1) == j) & (energies[:, j] > 0.0)
        for i, other in enumerate(instruments):
            if i == j:
                continue
            if other.channel == source.channel:
                result[i, j] = 1.0
            elif loudest.sum() >= 4:
                louder = loudest & (energies[:, j] >= np.median(energies[loudest, j]))
                result[i, j] = np.median(energies[louder, i] / energies[louder, j])
            elif other.channel in source.others:
                near = max(source.distance, 0.02)
                result[i, j] = min((near / max(source.others[other.channel], 0.02)) ** 2, 1.0)
    return result


def _without_echoes(impacts: Sequence[HeardImpact]) -> list[HeardImpact]:
    """Impacts on one instrument, in order, without weak ones soon after a loud one."""
    own: list[HeardImpact] = []
    for impact in sorted(impacts, key=lambda impact: impact.time):
        near = [item for item in own if impact.time - item.time <= ECHO_TIME]
        if any(impact.energy < ECHO * candidate.energy for candidate in near):
            continue
        if own and impact.time - own[-1].time < 0.5 * REST:
            continue
        own.append(impact)
    return own
