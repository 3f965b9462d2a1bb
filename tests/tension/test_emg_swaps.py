"""EMG channels whose names are exchanged are found by what joint torques need of muscles.

Clean ones are left alone.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from myomorph.body.tension.emg_held_out import Swap, held_out_verdict, swap_lines, swapped_channels
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.series import Emg, Motion, Series
from myomorph.core.motion.emg_activation import channel_means, shifted
from myomorph.core.motion.filters import differentiate, lowpass
from myomorph.core.tension.solve import solve_tension


@pytest.fixture(scope="module")
def walk(data):
    """Return names, envelopes and activations by minimum effort of nine channels.

    They are over five seconds of a walk.
    """
    model = read_osim(data("ceinms-emg-walk/model/gait2392.osim"))
    folder = "ceinms-emg-walk/walk36/"
    whole = differentiate(motion_from_table(read_sto(data(folder + "ik.sto")), model), 6.0)
    table = read_sto(data(folder + "id.sto"))
    given = read_sto(data(folder + "emgFilt.sto"))
    span = slice(1000, 1500, 4)
    motion = Motion(
        whole.time[span], whole.names, whole.values[span], velocities=whole.velocities[span]
    )
    names = tuple(name.removesuffix("_moment").removesuffix("_force") for name in table.names)
    torques = Series(motion.time, names, lowpass(table.values, 100.0, 6.0)[span])
    emg = Emg(given.time, given.names, given.values)
    alone = solve_tension(model, motion, torques)
    means = channel_means({name: (name,) for name in emg.names}, alone.muscles, alone.activation)
    return emg.names, shifted(emg, motion.time, np.full(len(emg.names), 0.1)), means


def test_no_pair_of_a_clean_walk_looks_exchanged(walk):
    _, envelopes, activations = walk
    assert swapped_channels(envelopes, activations) == ()


def test_exchanged_channels_are_named(walk):
    """Of pairs with different envelopes (correlation below 0) most are found, never another."""
    names, envelopes, activations = walk
    alike = np.corrcoef(envelopes.T)
    found = 0
    all_pairs = 0
    for i, j in itertools.combinations(range(len(names)), 2):
        # Least effort says nothing of these: rectus femoris and tibialis follow their own EMG by
        # -0.1 and 0.2.
        if alike[i, j] > 0.0 or {names[i], names[j]} & {"rect_fem_r", "tib_ant_r"}:
            continue
        order = np.arange(len(names))
        order[[i, j]] = j, i
        swaps = swapped_channels(envelopes[:, order], activations)
        all_pairs += 1
        found += any({one.first, one.second} == {i, j} for one in swaps)
    assert all_pairs >= 8
    assert found >= 0.8 * all_pairs


def test_the_line_has_both_names_and_the_evidence():
    (line,) = swap_lines(("a", "b"), (Swap(first=0, second=1, own=-0.3, other=0.85),))
    assert line.startswith("EMG channels 'a' and 'b' look exchanged")
    assert "0.85" in line
    assert "-0.30" in line


def test_too_few_frames_say_nothing():
    rng = np.random.default_rng(0)
    first = rng.random((20, 2))
    assert swapped_channels(first[:, ::-1], first) == ()


def test_left_out_channels_are_judged_by_their_mean_correlation():
    names = ["vasti", "soleus", "silent"]
    held = np.array([[0.5, 0.7], [0.6, 0.5], [np.nan, np.nan]])
    verdict = held_out_verdict(names, held)
    assert verdict.parts == ("vasti", "soleus")
    assert verdict.better == (np.nanmean(held[:, 1]) > np.nanmean(held[:, 0]))
    assert not held_out_verdict(names, held[:, ::-1]).better
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(2, 500))
    courses = [(values - values.mean()) / values.std() for values in (one, one + 0.4 * other)]
    r = float(np.corrcoef(courses)[0, 1])
    apart = held_out_verdict(["vasti"], np.array([[0.0, r]])).estimate[0, 0]
    assert apart == pytest.approx(np.sqrt(np.mean((courses[0] - courses[1]) ** 2)))
