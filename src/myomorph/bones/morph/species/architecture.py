"""Strength and fiber length of a target species' muscles, from tables of anatomists.

[D] chapter 6 has only paths. A table holds what was measured on animals of one species: optimal
fiber length l and maximum force F, or the muscle's mass, which is its strength W = F l over
specific tension, times density. To another animal l goes by the length of its bones, F by its body
mass to the power 2/3 (or the length squared where the table's body mass is not known): a
cross-section that a skeleton of long legs does not change. The first table is the target species'
own. Where it lacks a muscle, tables of relatives follow and then the source model itself, each at
the level that the muscles in common with the first give it (the median ratio): so a relative shows
how muscles compare with each other, not how strong the animal is. Intervals are what left-out
muscles show: the spread of the ratios to the first table. Where a species has no table at all, the
source's fibers and forces follow a law of scaling that other muscles of both species show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from myomorph.bones.morph.morphed import Architecture
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model

DENSITY = 1060.0  # Of muscle (Mendez and Keys 1960) [kg/m^3].
SPECIFIC_TENSION = 3.0e5
"""Of tables that have masses but no forces [Pa]; it matters only where no table of the target gives
the level.
"""

MIN_COUNT = 5  # Muscles in common that a level is taken from.


@dataclass(frozen=True)
class MuscleRow:
    """One muscle of a table."""

    name: str  # the anatomist's
    # muscles of the source that it corresponds to; several share its strength, as a relative's
    # table has them or else as they do in the source
    sources: tuple[str, ...]
    fiber: float  # optimal fiber length [m]
    strength: float  # maximum isometric force times that [N m]
    pennation: float | None = None  # at optimal fiber length [rad]; None keeps the source's

    def __post_init__(self) -> None:
        if not (
            np.isfinite([self.fiber, self.strength]).all()
            and self.fiber > 0.0
            and self.strength > 0.0
        ):
            raise BadData(
                f"architecture of '{self.name}': fiber length and strength must be above 0"
            )
        if not self.sources:
            raise BadData(f"architecture of '{self.name}': it needs a muscle of the source")


@dataclass(frozen=True, eq=False)
class ArchitectureTable:
    """Muscles of one species as an anatomist measured them."""

    # species, citation: whose, and where it was published
    species: str
    citation: str
    rows: tuple[MuscleRow, ...]
    # of the animals' bones by body of the source [m]
    lengths: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    # "joints" where these are distances of joint centers, "bones" where they are whole bones
    measured: Literal["joints", "bones"] = "joints"
    body_mass: float | None = None  # of these animals [kg], None where it is not known

    def __post_init__(self) -> None:
        if not self.rows:
            raise BadData(f"architecture of {self.species}: it has no muscle")
        if self.measured not in ("joints", "bones"):
            raise BadData(
                f"architecture of {self.species}: measured is '{self.measured}': expected joints or"
                " bones"
            )

    def without(self, names: Sequence[str]) -> ArchitectureTable | None:
        """Return the table without some of its muscles, None where nothing is left."""
        rows = tuple(row for row in self.rows if row.name not in names)
        return replace(self, rows=rows) if rows else None


@dataclass(frozen=True)
class ScalingLaw:
    """Ratios of the target's fibers and forces to the source's in its size.

    They come from muscles known in both.
    """

    citation: str  # which muscles, and where they were published
    # bodies of the source whose joint centers tell the target's length over the source's
    bones: tuple[str, ...]
    fiber: float  # optimal fiber length, times what that length gives
    force: float  # maximum isometric force, times what that length squared gives
    # fiber_interval, force_interval: within what the truth lies (90 %), as factors of what the law
    # gives
    fiber_interval: tuple[float, float]
    force_interval: tuple[float, float]

    def __post_init__(self) -> None:
        for name in ("fiber", "force"):
            low, high = getattr(self, f"{name}_interval")
            if not (getattr(self, name) > 0.0 and 0.0 < low <= 1.0 <= high):
                raise BadData(
                    f"scaling of {name}: expected a factor above 0, and an interval around 1"
                )


@dataclass(frozen=True)
class Size:
    """The target animal over a table's."""

    length: float = 1.0  # of their bones
    mass: float | None = None  # of their bodies, None where one is not known

    @property
    def strength(self) -> float:
        """By which force times fiber length grows."""
        return self.length * (self.length**2 if self.mass is None else self.mass ** (2.0 / 3.0))


@dataclass(frozen=True)
class _Value:
    fiber: float
    strength: float
    pennation: float | None
    basis: str


Values = dict[str, _Value]


def architectures(
    source: Model,
    tables: Sequence[ArchitectureTable],
    sizes: Sequence[Size],
    muscles: Sequence[str],
) -> Mapping[str, Architecture]:
    """Return fiber length, force and pennation of all muscles wanted, by the source's names.

    Without a table there are none. `tables`: the target species' first, then the nearest
    relatives'; `sizes`: of the target animal over each table's. Muscles that no table has follow
    the source at the level of the others.
    """
    if not tables:
        return FrozenMap({})
    table_values = [
        _values(source, table, size, tables) for table, size in zip(tables, sizes, strict=True)
    ]
    model = {
        muscle.name: _Value(
            muscle.optimal_fiber_length,
            muscle.max_isometric_force * muscle.optimal_fiber_length,
            None,
            "",
        )
        for muscle in source.muscles
        if muscle.name in muscles
        and muscle.optimal_fiber_length > 0.0
        and muscle.max_isometric_force > 0.0
    }
    first = table_values[0]
    between = _spread_within(tables, table_values)
    source_basis = f"{source.name}, at the level of {tables[0].species}"
    results: dict[str, Architecture] = {}
    for index, values in enumerate((*table_values, model)):
        level, spread = (np.ones(2), between) if index == 0 else _level(first, values)
        for name, value in values.items():
            if name in results or name not in muscles or not np.isfinite(level).all():
                continue
            fiber, strength = level * (value.fiber, value.strength)
            reach = np.exp(half_width(spread))
            low_high = [(float(1.0 / factor), float(factor)) for factor in reach]
            results[name] = Architecture(
                fiber=float(fiber),
                force=float(strength / fiber),
                pennation=value.pennation,
                basis=value.basis or source_basis,
                fiber_interval=low_high[0],
                force_interval=low_high[1],
            )
    return FrozenMap(results)


def scaled_architectures(
    source: Model, law: ScalingLaw, length: float, muscles: Sequence[str]
) -> Mapping[str, Architecture]:
    """Return fiber length and force of muscles by a law of scaling.

    `length`: of the target's bones over the source's.
    """
    basis = f"{source.name}, scaled as {law.citation}"
    return FrozenMap(
        {
            muscle.name: Architecture(
                fiber=length * law.fiber * muscle.optimal_fiber_length,
                force=length**2 * law.force * muscle.max_isometric_force,
                pennation=None,
                basis=basis,
                fiber_interval=law.fiber_interval,
                force_interval=law.force_interval,
            )
            for muscle in source.muscles
            if muscle.name in muscles
            and muscle.optimal_fiber_length > 0.0
            and muscle.max_isometric_force > 0.0
        }
    )


def _values(
    source: Model, table: ArchitectureTable, size: Size, tables: Sequence[ArchitectureTable]
) -> Values:
    """Return a table's values of the source's muscles, in the target's size."""
    volumes = {
        muscle.name: muscle.max_isometric_force * muscle.optimal_fiber_length
        for muscle in source.muscles
    }
    parts: dict[str, list[tuple[MuscleRow, float]]] = {}
    for row in table.rows:
        here = [name for name in row.sources if name in volumes]
        strengths = _told_apart(here, tables) or volumes
        total = sum(strengths[name] for name in here)
        for name in here:
            share = strengths[name] / total if total > 0.0 else 1.0 / len(here)
            parts.setdefault(name, []).append((row, row.strength * share))
    values: Values = {}
    for name, rows in parts.items():
        weights = np.array([strength for _, strength in rows])
        angles = [row.pennation for row, _ in rows]
        known = (
            None
            if None in angles
            else float(np.average(np.array(angles, dtype=np.float64), weights=weights))
        )
        # Parts side by side: their forces add up, so the common fiber is the one that keeps
        # strength and force.
        fiber = weights.sum() / sum(strength / row.fiber for row, strength in rows)
        basis = f"{table.species}: {table.citation}"
        values[name] = _Value(
            size.length * float(fiber), size.strength * float(weights.sum()), known, basis
        )
    return values


def _told_apart(muscles: Sequence[str], tables: Sequence[ArchitectureTable]) -> Mapping[str, float]:
    """Strengths of muscles by the first table with a row for each alone; empty if there is none."""
    for table in tables:
        alone = {row.sources[0]: row.strength for row in table.rows if len(row.sources) == 1}
        if len(muscles) > 1 and all(name in alone for name in muscles):
            return alone
    return {}


def _ratios(first: Values, other: Values) -> np.ndarray:
    """(muscles, 2) logarithms of fiber length and force, of the first over the other."""
    common = [name for name in first if name in other]
    rows = [
        (
            np.log(first[n].fiber / other[n].fiber),
            np.log(first[n].strength / first[n].fiber) - np.log(other[n].strength / other[n].fiber),
        )
        for n in common
    ]
    return np.array(rows).reshape(-1, 2)


def _level(first: Values, other: Values) -> tuple[np.ndarray, np.ndarray]:
    """Return factors that bring a table to the first one's level, and the spread about them.

    Factors are of fiber length and strength, spreads standard deviations of the logarithms of fiber
    length and force. NaN with too little in common.
    """
    ratios = _ratios(first, other)
    if len(ratios) < MIN_COUNT:
        return np.full(2, np.nan), np.full(2, np.nan)
    fiber, force = np.median(ratios, axis=0)
    return np.exp([fiber, fiber + force]), ratios.std(axis=0, ddof=1)


def _spread_within(tables: Sequence[ArchitectureTable], values: Sequence[Values]) -> np.ndarray:
    """Return how far two anatomists of one species differ, each from their middle.

    Values are logarithms of fiber length and force.
    """
    for i, table in enumerate(tables):
        for other in range(i):
            ratios = _ratios(values[other], values[i])
            if tables[other].species == table.species and len(ratios) >= MIN_COUNT:
                return np.asarray(ratios.std(axis=0, ddof=1) / np.sqrt(2.0))
    return np.full(2, np.nan)
