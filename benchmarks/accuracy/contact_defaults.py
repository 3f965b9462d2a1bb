"""What the defaults of estimated contact forces were chosen by: forces that were measured and hidden, by setting."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.hidden_plates import rms
from benchmarks.hands_lift import LIFTS, MASS, hands_measured, recorded
from benchmarks.hands_lift_forces import holding, left_floor
from benchmarks.hands_lift_forces import task as lift_task
from benchmarks.hidden_plates import CASES, Hidden, HiddenCase, feet_of, opened
from myomorph.contact.states import preferred_directions
from myomorph.model.arrays import Array
from myomorph.tension.terms.contacts import ContactOptions, ContactTask

Row = dict[str, object]

IMPLANT = "knee-implant-walk"
UNSEEN = tuple(
    HiddenCase(
        f"walk, knee implant {stride}",
        f"{IMPLANT}/scaled.osim",
        f"{IMPLANT}/walk{stride}.trc",
        f"{IMPLANT}/walk{stride}_grf.xml",
        75.0,
        f"{IMPLANT}/ik_tasks.xml",
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


def _contacts(**changes: object) -> Setting:
    return Setting(ContactOptions(**changes))  # type: ignore[arg-type]


def _tension(**changes: object) -> Setting:
    return Setting(tension=mm.TensionOptions(**changes))  # type: ignore[arg-type]


SETTINGS: Mapping[str, Setting] = {
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
    """A row for every setting: error of a foot's vertical force in each recording, and of the hands' in the lifts."""
    cases = [opened(folder, case) for case in (*CASES, *UNSEEN)]
    for name, setting in SETTINGS.items():
        feet = {one.case.name: foot_error(one, setting) for one in cases}
        hands = {}
        for lift in LIFTS:
            hands[lift], feet[lift] = lift_errors(folder, lift, setting)
        row: Row = {"setting": name, "chosen on, mean": float(np.mean([feet[one] for one in CHOSEN_ON]))}
        row["others, mean"] = float(np.mean([error for one, error in feet.items() if one not in CHOSEN_ON]))
        yield row | feet | {f"{lift}, hands [N]": error for lift, error in hands.items()}


def foot_error(hidden: Hidden, setting: Setting) -> float:
    """RMS error of the vertical force of a foot, mean of both feet [% weight]."""
    preferred = preferred_directions(hidden.model, hidden.motion, hidden.sites)
    task = _as_set(ContactTask(hidden.sites, hidden.activations, (), preferred=preferred), setting)
    torques = mm.inverse_dynamics(hidden.model, hidden.motion)
    found = mm.solve_tension(hidden.model, hidden.motion, torques, setting.tension, contacts=task).contacts
    assert found is not None
    errors = []
    for side, measured, _ in feet_of(hidden):
        mine = [k for k, one in enumerate(hidden.sites) if one.group == f"foot_{side[0]}"]
        errors.append(rms((found.forces[:, mine].sum(axis=1) - measured)[hidden.use, 1]))
    return 100.0 * float(np.mean(errors)) / hidden.weight


def lift_errors(folder: Path, lift: str, setting: Setting) -> tuple[float, float]:
    """RMS errors without any plate: of the hands' upward force while they hold the box on the floor [N], and of the
    feet's upward force [% weight].
    """
    asked = lift_task(folder, lift, "hidden")
    task = _as_set(asked.contacts, setting)
    found = mm.solve_tension(asked.model, asked.motion, asked.torques, setting.tension, contacts=task).contacts
    assert found is not None
    time = recorded(folder, lift).markers.time
    grasp = time[np.flatnonzero(holding(folder, lift)[1].any(axis=1))[0]]
    during = (time >= grasp) & (time < left_floor(folder, lift))
    hands = -found.forces[:, :2].sum(axis=1) - hands_measured(folder, lift)
    feet: Array = found.forces[:, [k for k, one in enumerate(asked.contacts.sites) if one.group.startswith("foot")]]
    weight = MASS * float(np.linalg.norm(asked.model.gravity))
    return rms(hands[during, 1]), 100.0 * rms((feet.sum(axis=1) - recorded(folder, lift).plate)[:, 1]) / weight


def _as_set(task: ContactTask, setting: Setting) -> ContactTask:
    sites = tuple(replace(one, group=one.name) for one in task.sites) if setting.by_site else task.sites
    return replace(task, sites=sites, options=setting.contacts)
