"""Ground forces of a walk that plates measured, hidden from the problem and found again."""

from __future__ import annotations

import numpy as np
import pytest

from measured_walk import measured_walk
from myomorph.core.contact.states import (
    ActivationOptions,
    ContactStateOptions,
    contact_activations,
    find_contacts,
    preferred_directions,
)
from myomorph.core.motion.sync import cut, resample_wrenches
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask


@pytest.fixture(scope="module")
def walk(data):
    one = measured_walk(data)
    model = one.model
    motion = one.motion
    sites = one.sites
    floor = one.floor
    contacts = find_contacts(model, motion, sites, ContactStateOptions(floor=floor.height))
    ready = contact_activations(
        model, motion, sites, contacts, ActivationOptions(floor=floor.height)
    )
    # The plates caught every step from 0.6 s on.
    part = cut(motion, 0.6, 1.7)
    ready = cut(ready, 0.6, 1.7)
    wrenches = resample_wrenches(one.loads, part.time, 6.0)
    return model, part, sites, ready, wrenches


@pytest.mark.parametrize("formulation", ["simultaneous", "sequential"])
def test_hidden_forces_of_a_walk_are_found(walk, formulation):
    """Vertical force within 8 % and fore-aft force within 15 % of their ranges.

    This holds for each foot, with defaults.
    """
    model, motion, sites, ready, wrenches = walk
    task = ContactTask(
        sites=sites,
        activations=ready,
        measured=(),
        options=ContactOptions(formulation=formulation),
        preferred=preferred_directions(model, motion, sites),
    )
    tension = solve_tension(model, motion, inverse_dynamics(model, motion), contacts=task)
    assert tension.contacts is not None
    assert tension.optimal.all()
    for foot, group in enumerate(("foot_r", "foot_l")):
        mine = [k for k, one in enumerate(sites) if one.group == group]
        found = tension.contacts.contact_force[:, mine].sum(axis=1)
        error = np.sqrt(np.mean((found - wrenches.forces[:, foot]) ** 2, axis=0))
        spread = np.ptp(wrenches.forces[:, foot], axis=0)
        assert error[1] < 0.08 * spread[1]
        assert error[0] < 0.15 * spread[0]


def test_leaning_matters_where_physics_does_not_tell(walk):
    """Without it the sequential formulation shares fore-aft forces of double support evenly.

    Feet do not.
    """
    model, motion, sites, ready, wrenches = walk
    errors = []
    for way in (None, preferred_directions(model, motion, sites)):
        task = ContactTask(
            sites=sites,
            activations=ready,
            measured=(),
            options=ContactOptions(formulation="sequential"),
            preferred=way,
        )
        tension = solve_tension(model, motion, inverse_dynamics(model, motion), contacts=task)
        assert tension.contacts is not None
        right = [k for k, one in enumerate(sites) if one.group == "foot_r"]
        found = tension.contacts.contact_force[:, right].sum(axis=1)
        errors.append(np.sqrt(np.mean((found - wrenches.forces[:, 0])[:, 0] ** 2)))
        # What leans is only preferred: no force leaves its friction pyramid.
        across = np.linalg.norm(tension.contacts.contact_force[..., [0, 2]], axis=2)
        assert (across <= 0.8 * tension.contacts.contact_force[..., 1] + 1e-6).all()
    assert errors[1] < 0.7 * errors[0]
