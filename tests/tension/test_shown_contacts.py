"""Contacts of whose forces nothing is known: the data allow more than they vary by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.model.contacts import Cone, Site
from myomorph.core.tension.certificates import ContactIntervals
from myomorph.core.tension.shown_contacts import open_contact_findings, open_contacts

WEIGHT = 700.0
TIME = np.linspace(0.0, 2.0, 25)
SITES = (
    Site("sole", "calcn_r", np.zeros((1, 3)), group="foot_r"),
    Site("grip", "hand_r", np.zeros((1, 3)), cone=Cone(None, grip=0.05), against="box"),
)


def allowed(foot: np.ndarray, half: np.ndarray | float) -> ContactIntervals:
    """Make intervals about a foot's force, and exact ones of a grip that changes.

    Parameters
    ----------
    foot : (25,) upwards [N]
    half : (25,) or one, to either side of it [N]

    Returns
    -------
    at 25 instants
    """
    forces = np.zeros((25, 2, 3))
    forces[:, 0, 1] = foot
    forces[:, 1, 0] = 100.0 * np.sin(3.0 * TIME)
    around = np.zeros((25, 2, 3))
    around[:, 0, 1] = half
    empty = np.full((25, 2, 3), np.nan)
    return ContactIntervals(
        time=TIME,
        frames=np.arange(25),
        groups=("foot_r", "grip"),
        forces=forces,
        low=forces - around,
        high=forces + around,
        normal=forces[..., 1],
        normal_low=(forces - around)[..., 1],
        normal_high=(forces + around)[..., 1],
        near_low=empty,
        near_high=empty,
        direction=empty,
        spread=np.full(25, np.nan),
        sentences=("",) * 25,
    )


def names(intervals: ContactIntervals) -> list[str]:
    return [contact.group for contact in open_contacts(intervals, SITES, WEIGHT)]


def test_a_foot_beside_another_that_hardly_changes_is_not_known() -> None:
    still = 350.0 + 20.0 * np.sin(3.0 * TIME)
    found = open_contacts(allowed(still, 300.0), SITES, WEIGHT)
    assert [contact.group for contact in found] == ["foot_r"]
    np.testing.assert_allclose(found[0].error, 600.0 / np.sqrt(12.0))
    (finding,) = open_contact_findings(found)
    assert finding.place == "foot_r"
    assert "nothing is known of the contact forces of foot_r" in finding.text
    assert "173 N" in finding.text


def test_a_foot_that_steps_is_known() -> None:
    """Zero in swing, the whole body in single support, and a third of the time beside the other."""
    stepping = np.where(np.sin(3.0 * TIME) > 0.0, WEIGHT, 0.0)
    beside = np.where(np.arange(25) % 3 == 0, 0.5 * WEIGHT, 0.0)
    assert names(allowed(stepping, beside)) == []
    assert names(allowed(stepping, 2.0 * WEIGHT)) == ["foot_r"]
    assert open_contact_findings(()) == ()


def test_what_is_determined_is_known_although_it_does_not_change() -> None:
    assert names(allowed(np.full(25, 350.0), 5.0)) == []


def test_a_grip_is_asked_for_its_whole_force() -> None:
    wide = allowed(350.0 + 300.0 * np.sin(TIME), 0.0)
    low = np.array(wide.low)
    low[:, 1, 2] = -np.inf
    assert names(replace(wide, low=low)) == ["grip"]


def test_few_instants_say_nothing() -> None:
    few = allowed(np.full(25, 350.0), 300.0)
    normal = np.where(np.arange(25)[:, None] < 7, few.normal, np.nan)
    assert names(replace(few, normal=normal)) == []
