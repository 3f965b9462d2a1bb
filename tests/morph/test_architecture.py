"""Strength and fibers from tables of species: level, order, shares and intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import spearmanr

from myomorph.bones.morph.species.architecture import (
    ArchitectureTable,
    MuscleRow,
    ScalingLaw,
    Size,
    architectures,
    scaled_architectures,
)
from myomorph.bones.study.species_morphing import read_species
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle, Path
from myomorph.lab.study.inputs.reading import open_model

NAMES = tuple("abcdefghij")


def source() -> Model:
    rng = np.random.default_rng(0)
    sizes = rng.uniform([100, 0.05], [900, 0.1], (len(NAMES), 2)).tolist()
    muscles = tuple(
        Muscle(
            name=name,
            kind="Millard2012EquilibriumMuscle",
            path=Path(()),
            max_isometric_force=force,
            optimal_fiber_length=fiber,
            tendon_slack_length=0.1,
        )
        for name, (force, fiber) in zip(NAMES, sizes, strict=True)
    )
    return Model(
        name="man", bodies=(), joints=(), coordinates=(), gravity=np.zeros(3), muscles=muscles
    )


def rows(factor: float, only: tuple[str, ...] = NAMES, noise: float = 0.0) -> tuple[MuscleRow, ...]:
    rng = np.random.default_rng(1)
    return tuple(
        MuscleRow(
            name=n.upper(),
            sources=(n,),
            fiber=factor * 0.01 * (1 + i),
            strength=factor**3 * 0.02 * np.exp(noise * rng.normal()),
        )
        for i, n in enumerate(only)
    )


def test_without_a_table_the_law_of_scaling_gives_all():
    """Fibers scale with the length, forces with its square.

    Both are by the law's factors and within its intervals.
    """
    law = ScalingLaw(
        citation="legs",
        bones=("humerus",),
        fiber=1.5,
        force=0.4,
        fiber_interval=(0.5, 2.0),
        force_interval=(0.2, 5.0),
    )
    man = source()
    found = scaled_architectures(man, law, 0.05, NAMES[:3])
    assert tuple(found) == NAMES[:3]
    for name, one in found.items():
        assert one.fiber == pytest.approx(0.05 * 1.5 * man.muscle(name).optimal_fiber_length)
        assert one.force == pytest.approx(0.05**2 * 0.4 * man.muscle(name).max_isometric_force)
        assert (one.fiber_interval, one.force_interval) == ((0.5, 2.0), (0.2, 5.0))
        assert "legs" in one.basis
    for wrong in ({"fiber": 0.0}, {"force_interval": (1.2, 5.0)}):
        with pytest.raises(BadData, match="scaling of"):
            replace(law, **wrong)


def test_bones_and_body_give_fibers_and_strength():
    """Twice the length: fibers twice, force by the body's mass or else the square."""
    table = ArchitectureTable("mouse", "x", rows(1.0))
    for size, strength in ((Size(2.0), 8.0), (Size(2.0, 27.0), 18.0)):
        found = architectures(source(), [table], [size], NAMES)
        for row in table.rows:
            one = found[row.sources[0]]
            assert one.fiber == pytest.approx(2.0 * row.fiber)
            assert one.force * one.fiber == pytest.approx(strength * row.strength)
            assert np.isnan(one.force_interval).all()


def test_a_relative_fills_in_at_the_level_of_the_target():
    """A relative 3 times as large supplies what the target's table is missing.

    The size that is assumed for it does not matter.
    """
    table = ArchitectureTable("mouse", "x", rows(1.0, NAMES[:7]))
    relative = ArchitectureTable("rat", "y", rows(3.0))
    for size in (Size(), Size(0.2)):
        found = architectures(source(), [table, relative], [Size(), size], NAMES)
        for row in rows(1.0):
            assert found[row.sources[0]].fiber == pytest.approx(row.fiber)
            assert found[row.sources[0]].force == pytest.approx(row.strength / row.fiber)
        assert found["j"].basis == "rat: y"
        assert found["j"].force_interval == pytest.approx((1.0, 1.0))


def test_the_source_is_the_last_and_its_interval_wider():
    table = ArchitectureTable("mouse", "x", rows(1.0, NAMES[:7]))
    relative = ArchitectureTable("rat", "y", rows(3.0, NAMES[:9], 0.1))
    found = architectures(source(), [table, relative], [Size(), Size()], NAMES)
    assert found["j"].basis == "man, at the level of mouse"
    assert found["j"].force_interval[1] > found["i"].force_interval[1] > 1.05


def test_parts_and_shares_keep_the_strength():
    """Two rows of one muscle add up; a row of two muscles is shared as the relative has them."""
    table = ArchitectureTable(
        "mouse",
        "x",
        (
            MuscleRow(name="A1", sources=("a",), fiber=0.01, strength=0.02),
            MuscleRow(name="A2", sources=("a",), fiber=0.02, strength=0.06),
            MuscleRow(name="BC", sources=("b", "c"), fiber=0.01, strength=0.04),
        ),
    )
    relative = ArchitectureTable("rat", "y", rows(1.0))
    found = architectures(source(), [table, relative], [Size(), Size()], NAMES)
    assert found["a"].force == pytest.approx(2.0 + 3.0)
    assert found["a"].force * found["a"].fiber == pytest.approx(0.08)
    assert found["b"].force + found["c"].force == pytest.approx(4.0)
    assert found["b"].force == pytest.approx(found["c"].force)


def test_rats_tell_the_order_of_a_mouse(data):
    """Nothing of the mouse's own table is used.

    Its order of forces and fibers comes out of the rats' tables.
    """
    man = open_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    species = read_species("human-mouse")
    table = species.architecture
    names = [one.name for one in man.muscles if one.name.endswith("_r")]
    mouse = architectures(man, table[:1], [Size()] * len(table[:1]), names)
    rats = architectures(man, table[1:], [Size()] * len(table[1:]), names)
    pairs = [
        one.sources
        for one in species.muscles
        if all(mouse[n].basis.startswith("mouse") for n in one.sources)
    ]
    assert len(pairs) > 20
    forces = [[sum(by[n].force for n in pair) for pair in pairs] for by in (mouse, rats)]
    fibers = [[np.mean([by[n].fiber for n in pair]) for pair in pairs] for by in (mouse, rats)]
    assert spearmanr(*forces).statistic > 0.8
    assert spearmanr(*fibers).statistic > 0.7


def test_a_muscle_without_fibers_is_refused():
    with pytest.raises(BadData, match="'A'"):
        MuscleRow(name="A", sources=("a",), fiber=0.0, strength=1.0)
