"""`tension --torques`: torques from a table in the place of inverse dynamics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.sto import read_sto, write_sto
from myomorph.core.model.frozen_map import FrozenMap


@pytest.fixture
def torques(arm, command, tmp_path):
    """Write the arm's torques as `id` writes them."""
    path = tmp_path / "torques.sto"
    told = command("id", "--model", arm.model, "--motion", arm.motion, "--out", path)
    assert told.status == 0, told.err
    return path


def forces(command, arm, out, *more):
    told = command("tension", "--model", arm.model, "--motion", arm.motion, "--out", out, *more)
    return told, read_sto(out / "forces.sto").values if told.status == 0 else None


def test_torques_of_id_give_the_tensions_that_id_would(arm, command, tmp_path, torques):
    _, expected = forces(command, arm, tmp_path / "own")
    told, found = forces(command, arm, tmp_path / "given", "--torques", torques)
    assert told.status == 0, told.err
    assert "no inverse dynamics was computed" in told.err
    # The table holds ten digits.
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_other_times_are_resampled_and_names_may_be_those_of_coordinates(
    arm, command, tmp_path, torques
):
    _, expected = forces(command, arm, tmp_path / "own")
    table = read_sto(torques)
    time = np.linspace(table.time[0], table.time[-1], 4 * len(table) - 3)
    values = np.column_stack([np.interp(time, table.time, one) for one in table.values.T])
    plain = tuple(name.removesuffix("_moment") for name in table.names)
    write_sto(
        replace(table, time=time, names=plain, values=values, facts=FrozenMap({})),
        tmp_path / "fine.sto",
    )
    told, found = forces(command, arm, tmp_path / "given", "--torques", tmp_path / "fine.sto")
    assert told.status == 0, told.err
    assert np.abs(found - expected).max() < 0.02 * np.abs(expected).max()


def changed(path, out, **changes):
    write_sto(replace(read_sto(path), facts=FrozenMap({}), **changes), out)
    return out


def test_what_does_not_fit_is_refused(arm, command, tmp_path, torques):
    table = read_sto(torques)
    out = tmp_path / "there"
    short = changed(torques, tmp_path / "short.sto", time=table.time[:20], values=table.values[:20])
    told, _ = forces(command, arm, out, "--torques", short)
    assert told.status == 2
    assert "cut the motion" in told.err
    lacking = changed(
        torques, tmp_path / "lacking.sto", names=table.names[:1], values=table.values[:, :1]
    )
    told, _ = forces(command, arm, out, "--torques", lacking)
    assert told.status == 2
    assert table.names[1].removesuffix("_moment") in told.err
    names = (table.names[0].replace("_moment", "_force"), *table.names[1:])
    told, _ = forces(
        command, arm, out, "--torques", changed(torques, tmp_path / "unit.sto", names=names)
    )
    assert told.status == 2
    assert "is rotational" in told.err
    values = np.array(table.values)
    values[5, 0] = np.nan
    told, _ = forces(
        command, arm, out, "--torques", changed(torques, tmp_path / "gap.sto", values=values)
    )
    assert told.status == 2
    assert "no finite value" in told.err
    for more, words in (
        (("--loads", arm.loads), "give one of them"),
        (("--contacts", "auto"), "leave the torques out"),
        (("--reactions", "child"), "give loads instead"),
    ):
        told, _ = forces(command, arm, out, "--torques", torques, *more)
        assert told.status == 2
        assert words in told.err
