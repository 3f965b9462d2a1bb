"""Signals that no foot makes are named, those of a step are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.contact.consistency.plate_disturbances import HUM, SPIKES
from myomorph.core.contact.consistency.plate_signals import (
    CLIPPED,
    DEAD,
    LOST,
    SAME,
    WRAPPED,
    plate_signals,
)

WEIGHT = 700.0
UP = np.array([0.0, 1.0, 0.0])
TIME = np.arange(0.0, 2.0, 0.001)


# A step with two peaks that pushes back and forth.
def step(start, stop):
    phase = np.clip((TIME - start) / (stop - start), 0.0, 1.0)
    vertical = WEIGHT * 1.2 * (np.sin(np.pi * phase) + 0.3 * np.sin(3.0 * np.pi * phase))
    fore = -0.15 * WEIGHT * np.sin(2.0 * np.pi * phase)
    return np.column_stack([fore, vertical, 0.05 * vertical])


def steps() -> mm.Wrenches:
    forces = np.stack([step(0.2, 0.9), step(0.8, 1.6)], axis=1)
    forces += np.random.default_rng(5).normal(0.0, 0.5, forces.shape)
    points = np.zeros_like(forces)
    points[:, 0, 0] = np.linspace(0.0, 0.2, len(TIME))
    points[:, 1, 0] = np.linspace(0.7, 0.9, len(TIME))
    return mm.Wrenches(TIME, ("one", "two"), ("calcn_r", "calcn_l"), forces, points, 0.0 * forces)


def changed(change) -> mm.Wrenches:
    wrenches = steps()
    forces = np.array(wrenches.forces)
    forces[:, 0] = change(forces[:, 0])
    return replace(wrenches, forces=forces)


def clipped(force):
    return np.minimum(force, [np.inf, 0.8 * force[:, 1].max(), np.inf])


def wrapped(force):
    most = 0.7 * force[:, 1].max()
    result = force.copy()
    result[:, 1] = (force[:, 1] + most) % (2.0 * most) - most
    return result


def kinds(wrenches: mm.Wrenches) -> set[str]:
    return {item.kind for item in plate_signals(wrenches, WEIGHT, UP).findings}


def test_steps_are_signals_of_feet():
    signals = plate_signals(steps(), WEIGHT, UP)
    assert signals.findings == ()
    assert signals.usable.all()


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (DEAD, lambda force: force * [1.0, 0.0, 1.0]),
        (DEAD, lambda force: force * [0.0, 1.0, 1.0]),
        (CLIPPED, clipped),
        (WRAPPED, wrapped),
    ],
)
def test_a_broken_channel_is_named_with_its_plate(kind, change):
    signals = plate_signals(changed(change), WEIGHT, UP)
    assert {(item.kind, item.place) for item in signals.findings} == {(kind, "one")}
    assert signals.usable.tolist() == [False, True]


def test_one_signal_on_two_plates_breaks_both():
    wrenches = steps()
    same = replace(wrenches, forces=wrenches.forces[:, [0, 0]])
    assert kinds(same) == {SAME}
    assert not plate_signals(same, WEIGHT, UP).usable.any()


def test_lost_samples_are_a_leap_of_all_forces():
    wrenches = steps()
    kept = np.r_[0:450, 520 : len(TIME)]
    lost = replace(
        wrenches,
        time=TIME[: len(kept)],
        forces=wrenches.forces[kept],
        points=wrenches.points[kept],
        torques=wrenches.torques[kept],
    )
    assert kinds(lost) == {LOST}


def test_a_plate_that_measures_the_vertical_alone_is_not_broken():
    wrenches = steps()
    assert kinds(replace(wrenches, forces=wrenches.forces * [0.0, 1.0, 0.0])) == set()


def test_a_plate_on_which_nobody_steps_is_neither_usable_nor_broken():
    wrenches = steps()
    forces = np.array(wrenches.forces)
    forces[:, 1] = 0.0
    signals = plate_signals(replace(wrenches, forces=forces), WEIGHT, UP)
    assert signals.findings == ()
    assert signals.usable.tolist() == [True, False]


def humming(frequency, amplitude):
    line = amplitude * np.sin(2.0 * np.pi * frequency * TIME + 0.4)
    return changed(lambda force: force + line[:, None] * UP)


@pytest.mark.parametrize("frequency", [50.0, 60.0, 100.0, 120.0, 150.0])
def test_hum_of_the_mains_is_named_with_its_size(frequency):
    signals = plate_signals(humming(frequency, 20.0), WEIGHT, UP)
    (said,) = signals.findings
    assert (said.kind, said.place) == (HUM, "one")
    assert said.text.size == pytest.approx(20.0, rel=0.1)
    assert f"{frequency:.0f} Hz" in said.text
    assert signals.usable.all()


@pytest.mark.parametrize(("frequency", "amplitude"), [(50.0, 2.0), (37.0, 20.0)])
def test_what_is_soft_or_not_of_the_mains_is_no_hum(frequency, amplitude):
    assert kinds(humming(frequency, amplitude)) == set()


def test_single_samples_are_spikes_where_they_stand():
    at = [150, 500, 1200]
    spiked = changed(lambda force: force + 200.0 * np.isin(np.arange(len(TIME)), at)[:, None] * UP)
    (said,) = plate_signals(spiked, WEIGHT, UP).findings
    assert (said.kind, said.place) == (SPIKES, "one")
    assert [start for start, _ in said.times] == pytest.approx(TIME[at])
