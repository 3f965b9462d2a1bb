"""What defaults of tensions and of estimated contacts were chosen by.

Every setting is compared with EMG or hidden plates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import myomorph as mm
from benchmarks.accuracy.faults.emg_faults import implant
from benchmarks.accuracy.tension.emg import WALKS, Walk
from benchmarks.accuracy.tension.knee import STRIDES
from benchmarks.errors import rms
from benchmarks.hands_lift import LIFTS, MASS, hands_measured, recorded
from benchmarks.hands_lift_forces import holding, left_floor
from benchmarks.hands_lift_forces import task as lift_task
from benchmarks.hidden_plates import CASES, Hidden, HiddenCase, feet_of, opened
from myomorph.core.contact.states import preferred_directions
from myomorph.core.model.arrays import Array
from myomorph.core.motion.emg_activation import USUAL, channel_means, shifted
from myomorph.core.tension.recruitment import (
    EFFORT_ALONE,
    KNEE_LOAD,
    RecruitmentOptions,
    recruitment_terms,
)
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask

SECONDS = 8.0
"""Of each walk: some strides, so that the table is made in a minute."""

SETTINGS: Mapping[str, mm.TensionOptions] = {
    "effort alone": mm.TensionOptions(),
    "with passive force": mm.TensionOptions(passive=True),
    "activations from the model's minimum": mm.TensionOptions(min_activation="model"),
    "curves as OpenSim's": mm.TensionOptions(curves="opensim"),
    "no curves": mm.TensionOptions(curves="constant"),
    "exponent 1.5": mm.TensionOptions(exponent=1.5),
    "exponent 3": mm.TensionOptions(exponent=3.0),
    "exponent 4": mm.TensionOptions(exponent=4.0),
    "exponent 10": mm.TensionOptions(exponent=10.0),
    "min/max": mm.TensionOptions(recruitment="minmax"),
    "weights by volume": mm.TensionOptions(weights="volume"),
    "weights by strength": mm.TensionOptions(weights="strength"),
}


LOADS: Mapping[str, RecruitmentOptions] = {
    f"loads of {joints}, {weight:g}": RecruitmentOptions(weight, joints)
    for joints, weights in (("knees", (0.01, 0.02, 0.05)), ("all", (0.02,)))
    for weight in weights
} | {
    f"knee contact {level:g}": RecruitmentOptions(KNEE_LOAD, knee_contact=level) for level in (0.2,)
}
"""Costs beside the effort; that of knees with 0.02 is the default."""
HIPS = (0.1, 1.0)
"""Weights of the hips' load beside the default's of the knees."""
BIARTICULAR = ("recfem", "rect_fem", "gas")
"""How names of muscles begin, or hold, whose silence is a test of its own."""
SILENT = 0.4
"""The share of a channel's samples that count as silence, its smallest."""


class _Criterion(NamedTuple):
    """What a setting minimizes: options, and costs that become terms."""

    options: mm.TensionOptions
    costs: tuple[RecruitmentOptions, ...]


def measure_settings(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for every walk and setting.

    No setting sees EMG, and the delay is the same for all.
    """
    for walk in _walks(folder):
        motion, torques = walk.part(walk.tested)
        emg = _measured(walk, motion.time)
        wrenches = mm.resample_wrenches(walk.wrenches, motion.time)
        for name, criterion in _criteria(walk.model).items():
            terms = tuple(
                term
                for costs in criterion.costs
                for term in recruitment_terms(walk.model, motion, torques, wrenches, costs)
            )
            found = mm.solve_tension(
                walk.model,
                motion,
                torques,
                criterion.options,
                recruitment=EFFORT_ALONE,
                terms=terms,
            )
            yield {"walk": walk.name, "setting": name} | _row(walk, found, emg)


def _walks(folder: Path) -> Iterator[Walk]:
    """Yield the walks, each tested for `SECONDS` at most."""
    for make in WALKS:
        yield _shortened(make(folder))
    for stride in STRIDES:
        yield _shortened(implant(folder, stride))


def _shortened(walk: Walk) -> Walk:
    start, stop = walk.tested
    return replace(walk, tested=(start, min(stop, start + SECONDS)))


def _criteria(model: mm.Model) -> dict[str, _Criterion]:
    """Return what every setting minimizes, by its name."""
    hips = ",".join(joint.name for joint in model.joints if "hip" in joint.name)
    knees = RecruitmentOptions(KNEE_LOAD)
    criteria = {name: _Criterion(options, (EFFORT_ALONE,)) for name, options in SETTINGS.items()}
    for name, loads in LOADS.items():
        criteria[name] = _Criterion(mm.TensionOptions(), (loads,))
    for weight in HIPS:
        name = f"loads of knees, {KNEE_LOAD:g}, and hips, {weight:g}"
        costs = (knees, RecruitmentOptions(weight, hips))
        criteria[name] = _Criterion(mm.TensionOptions(), costs)
    return criteria


def _row(walk: Walk, found: Tension, emg: Mapping[str, Array]) -> dict[str, object]:
    fits = {channel: _fit(found, walk, channel, emg[channel]) for channel in walk.channels}
    r, rms = zip(*fits.values(), strict=True)
    both = [channel for channel in fits if _is_biarticular(walk, channel)]
    silent = [_in_silence(found, walk, channel, emg[channel]) for channel in both]
    return {
        "frames": len(found),
        "channels": len(r),
        "correlation with EMG, mean": float(np.mean(r)),
        "correlation with EMG, minimum": float(np.min(r)),
        "RMS from EMG, mean": float(np.mean(rms)),
        "correlation, biarticular": float(np.mean([fits[channel][0] for channel in both])),
        "activation of these in silence": float(np.mean(silent)),
        "largest activation, mean": float(np.nanmax(found.activation, axis=1).mean()),
        "tension of all muscles, mean [kN]": float(found.muscle_force.sum(axis=1).mean()) / 1e3,
        "not optimal": int((~found.optimal).sum()),
    }


def _measured(walk: Walk, time: Array) -> dict[str, Array]:
    """Each channel over its largest value, by the usual delay later."""
    moved = shifted(walk.emg, time, np.full(len(walk.emg.names), USUAL))
    return {
        name: moved[:, walk.emg.names.index(name)] / np.nanmax(walk.emg[name])
        for name in walk.channels
    }


def _fit(found: Tension, walk: Walk, channel: str, measured: Array) -> tuple[float, float]:
    """Correlation of the channel's muscles, and RMS once they are scaled to fit best."""
    predicted = channel_means({channel: walk.channels[channel]}, found.muscles, found.activation)[
        :, 0
    ]
    use = np.isfinite(predicted) & np.isfinite(measured)
    scale = max(predicted[use] @ measured[use], 0.0) / max(predicted[use] @ predicted[use], 1e-300)
    rms = float(np.sqrt(np.mean((scale * predicted[use] - measured[use]) ** 2)))
    moves = np.std(predicted[use]) > 1e-9
    # A channel whose muscles never work follows nothing.
    return float(np.corrcoef(predicted[use], measured[use])[0, 1]) if moves else 0.0, rms


def _is_biarticular(walk: Walk, channel: str) -> bool:
    return all(any(part in muscle for part in BIARTICULAR) for muscle in walk.channels[channel])


def _in_silence(found: Tension, walk: Walk, channel: str, measured: Array) -> float:
    """Mean activation of a channel's muscles where its EMG is least."""
    predicted = channel_means({channel: walk.channels[channel]}, found.muscles, found.activation)[
        :, 0
    ]
    return float(predicted[measured < np.nanquantile(measured, SILENT)].mean())


Row = dict[str, object]

IMPLANT = "knee-implant-walk"
UNSEEN = tuple(
    HiddenCase(
        name=f"walk, knee implant {stride}",
        model=f"{IMPLANT}/scaled.osim",
        markers=f"{IMPLANT}/walk{stride}.trc",
        forces=f"{IMPLANT}/walk{stride}_grf.xml",
        mass=75.0,
        tasks=f"{IMPLANT}/ik_tasks.xml",
    )
    for stride in (1, 3)
)
"""Recordings that were looked at once, after the choice."""

CHOSEN_ON = ("walk, Rajagopal", "walk, OpenCap", "sit to stand, OpenCap", "stoop1")


@dataclass(frozen=True)
class Setting:
    """Options, and whether each site counts as a contact of its own, as it did before."""

    contacts: ContactOptions = field(default_factory=ContactOptions)
    tension: mm.TensionOptions = field(default_factory=mm.TensionOptions)
    by_site: bool = False


def _contacts(**changes: Any) -> Setting:
    return Setting(contacts=replace(ContactOptions(), **changes))


def _tension(**changes: object) -> Setting:
    return Setting(tension=mm.TensionOptions(**changes))  # type: ignore[arg-type]


CONTACT_SETTINGS: Mapping[str, Setting] = {
    "default": Setting(),
    "no passive force": _contacts(contact_passive=False),
    "each site a contact": Setting(by_site=True),
    "each site, no passive force": Setting(ContactOptions(contact_passive=False), by_site=True),
    "compliance 0.3": _contacts(compliance=0.3),
    "compliance 1": _contacts(compliance=1.0),
    "compliance 3": _contacts(compliance=3.0),
    "compliance 1, no passive force": _contacts(compliance=1.0, contact_passive=False),
    "no smoothness": _contacts(smoothness=0.0),
    "smoothness 10": _contacts(smoothness=10.0),
    "activations from the model's minimum": _tension(min_activation="model"),
    "exponent 3": _tension(exponent=3.0),
    "weights by volume": _tension(weights="volume"),
    "residuals 1 N": _tension(residual=1.0),
    "reserves 10 N m": _tension(reserve=10.0),
    "contacts first": _contacts(formulation="sequential"),
}


def measure_contact_settings(folder: Path) -> Iterator[Row]:
    """Yield a row for every setting.

    It has the error of a foot's vertical force in each recording, and of the hands' in the lifts.
    """
    cases = [opened(folder, case) for case in (*CASES, *UNSEEN)]
    for name, setting in CONTACT_SETTINGS.items():
        feet = {one.case.name: foot_error(one, setting) for one in cases}
        hands = {}
        for lift in LIFTS:
            hands[lift], feet[lift] = lift_errors(folder, lift, setting)
        row: Row = {
            "setting": name,
            "chosen on, mean": float(np.mean([feet[one] for one in CHOSEN_ON])),
        }
        row["others, mean"] = float(
            np.mean([error for one, error in feet.items() if one not in CHOSEN_ON])
        )
        yield row | feet | {f"{lift}, hands [N]": error for lift, error in hands.items()}


def foot_error(hidden: Hidden, setting: Setting) -> float:
    """RMS error of the vertical force of a foot, mean of both feet [% weight]."""
    preferred = preferred_directions(hidden.model, hidden.motion, hidden.sites)
    task = _as_set(ContactTask(hidden.sites, hidden.activations, (), preferred=preferred), setting)
    torques = mm.inverse_dynamics(hidden.model, hidden.motion)
    found = mm.solve_tension(
        hidden.model,
        hidden.motion,
        torques,
        setting.tension,
        contacts=task,
        recruitment=EFFORT_ALONE,
    ).contacts
    assert found is not None
    errors = []
    for side, measured, _ in feet_of(hidden):
        mine = [k for k, one in enumerate(hidden.sites) if one.group == f"foot_{side[0]}"]
        errors.append(rms((found.contact_force[:, mine].sum(axis=1) - measured)[hidden.use, 1]))
    return 100.0 * float(np.mean(errors)) / hidden.weight


def lift_errors(folder: Path, lift: str, setting: Setting) -> tuple[float, float]:
    """Return RMS errors without any plate.

    They are of the hands' upward force while they hold the box on the floor [N], and of the feet's
    upward force [% weight].
    """
    asked = lift_task(folder, lift, "hidden")
    task = _as_set(asked.contacts, setting)
    found = mm.solve_tension(
        asked.model,
        asked.motion,
        asked.torques,
        setting.tension,
        contacts=task,
        recruitment=EFFORT_ALONE,
    ).contacts
    assert found is not None
    time = recorded(folder, lift).markers.time
    grasp = time[np.flatnonzero(holding(folder, lift)[1].any(axis=1))[0]]
    during = (time >= grasp) & (time < left_floor(folder, lift))
    hands = -found.contact_force[:, :2].sum(axis=1) - hands_measured(folder, lift)
    feet: Array = found.contact_force[
        :, [k for k, one in enumerate(asked.contacts.sites) if one.group.startswith("foot")]
    ]
    weight = MASS * float(np.linalg.norm(asked.model.gravity))
    return rms(hands[during, 1]), 100.0 * rms(
        (feet.sum(axis=1) - recorded(folder, lift).plate)[:, 1]
    ) / weight


def _as_set(task: ContactTask, setting: Setting) -> ContactTask:
    sites = (
        tuple(replace(one, group=one.name) for one in task.sites) if setting.by_site else task.sites
    )
    return replace(task, sites=sites, options=setting.contacts)
