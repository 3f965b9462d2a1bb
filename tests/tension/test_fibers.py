"""Fibers and tendons as values: parts of joined models, labelled arrays."""

import numpy as np
import pytest

from myomorph.core.tension.tension import Certificate, Fibers, Tension, TensionOptions, Unreachable
from truths.part_tension import tension_of


@pytest.fixture
def joined():
    """Return a tension of a joined model of two parts with two muscles each."""
    rng = np.random.default_rng(1)
    names = ("one_soleus", "one_tibant", "two_soleus", "two_tibant")
    lengths, velocities, tendon_strains, fiber_powers, tendon_powers = rng.normal(size=(5, 5, 4))
    ends = np.array([True, False, False, False, True])
    unreachable = (Unreachable("two_tibant", 3, -0.4),)
    fibers = Fibers(
        fiber_length=lengths,
        fiber_velocity=velocities,
        tendon_strain=tendon_strains,
        fiber_power=fiber_powers,
        tendon_power=tendon_powers,
        transient=ends,
        bridged=~ends,
        rigid=("one_tibant", "two_tibant"),
        unreachable=unreachable,
        certificate=Certificate(1e-5, 1e-7, 12),
    )
    none = np.zeros((5, 0))
    zeros = np.zeros((5, 4))
    return Tension(
        time=np.arange(5.0),
        muscles=names,
        activation=zeros,
        muscle_force=zeros,
        reserve_names=(),
        actuator_force=none,
        coordinates=(),
        balanced_torque=none,
        equilibrium_residual=np.zeros(5),
        status=np.zeros(5, np.int8),
        iterations=np.ones(5, np.int64),
        activation_lower=np.zeros(4),
        activation_upper=np.ones(4),
        overstretched=(),
        options=TensionOptions(tendons="elastic"),
        fibers=fibers,
    )


def test_a_part_of_a_joined_model_has_its_own_fibers(joined):
    part = tension_of(joined, "two").fibers
    whole = joined.fibers
    assert np.array_equal(part.fiber_length, whole.fiber_length[:, 2:])
    assert np.array_equal(part.fiber_velocity, whole.fiber_velocity[:, 2:])
    assert np.array_equal(part.tendon_strain, whole.tendon_strain[:, 2:])
    assert np.array_equal(part.fiber_power, whole.fiber_power[:, 2:])
    assert np.array_equal(part.tendon_power, whole.tendon_power[:, 2:])
    assert part.rigid == ("tibant",)
    assert part.unreachable == (Unreachable("tibant", 3, -0.4),)
    assert tension_of(joined, "one").fibers.unreachable == ()


def test_fibers_are_read_only(joined):
    with pytest.raises(ValueError, match="read-only"):
        joined.fibers.fiber_length[0, 0] = 1.0


def test_labelled_arrays_of_a_tension_hold_its_fibers(joined):
    found = joined.variables()
    assert found["fiber_length"].unit == "m"
    assert np.array_equal(found["tendon_strain"].values, joined.fibers.tendon_strain)
    pytest.importorskip("xarray")
    assert joined.to_xarray()["fiber_power"].sel(muscle="one_tibant").shape == (5,)
