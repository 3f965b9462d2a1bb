"""Base parameters: the combinations of inertial parameters that a base wrench can show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy

from myomorph.body.identify.null_space import (
    SCALE,
    TOLERANCE,
    NullSpace,
    held_values,
    numerical_null_space,
    random_states,
    tree_null_space,
)
from myomorph.core.model.arrays import Array, checked_array, read_only
from myomorph.core.model.errors import BadData, BadModel
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import PARAMETERS, inertial_parameters
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.series import Motion
from myomorph.core.rigid.regressor import base_regressor


@read_only
class BaseParameters:
    """The combinations phi_B = Z phi that the base wrench is made of, [D] eq. 3.2.

    Y phi = Y[:, columns] Z phi for every motion of the model.

    Attributes
    ----------
    bodies : names
    columns : (n,) the standard parameter that each base parameter is named after, 10 body +
        parameter
    combination : (n, 10 bodies) Z; 1 in its own column, in the others what is lumped with it
    names : such as "femur_r m c_y + 0.41 tibia_r m", at most four terms
    never : standard parameters that no motion shows at all, such as "toes_r I_xx"
    held : coordinates that do not move, with their values [rad or m]
    rank : number by random states, which is n
    tared : (n, k) combinations of base parameters that show as constants only, so that a force
        plate that was tared with the body on it hides them; none where the base moves freely
    """

    bodies: tuple[str, ...]
    columns: np.ndarray
    combination: Array
    names: tuple[str, ...]
    never: tuple[str, ...]
    held: Mapping[str, float]
    rank: int
    tared: Array

    def __post_init__(self) -> None:
        checked_array(
            self.combination,
            (len(self.columns), 10 * len(self.bodies)),
            "combination of base parameters",
        )
        checked_array(self.tared, (len(self.columns), "constants"), "tared base parameters")
        object.__setattr__(self, "held", FrozenMap(dict(self.held)))

    def __len__(self) -> int:
        return len(self.columns)

    @property
    def owners(self) -> np.ndarray:
        """(n,) index of the body that each base parameter is named after."""
        return self.columns // 10

    def of(self, parameters: Array) -> Array:
        """Combine inertial parameters to base parameters, [D] eq. 3.2.

        Parameters
        ----------
        parameters : (bodies, 10) in the order of [D] eq. 3.4

        Returns
        -------
        (n,) base parameters
        """
        return self.combination @ np.asarray(parameters).ravel()

    def standard(self, values: Array) -> Array:
        """Give base parameters to the standard ones that they are named after.

        Parameters
        ----------
        values : (n,) base parameters

        Returns
        -------
        (bodies, 10) one of all bodies that have them, possible or not; others are 0
        """
        parameters = np.zeros(self.combination.shape[1])
        parameters[self.columns] = values
        return parameters.reshape(-1, 10)

    def describe(self, i: int, most: int | None = None) -> str:
        """Write base parameter i as a sum of standard ones, the largest terms first.

        Parameters
        ----------
        i : number of the base parameter
        most : so many terms beside its own are written; None for all

        Returns
        -------
        such as "femur_r m c_y + 0.41 tibia_r m + 3 more"
        """
        column = int(self.columns[i])
        row = self.combination[i] * SCALE[np.arange(self.combination.shape[1]) % 10]
        others = [
            int(j) for j in np.argsort(-np.abs(row), kind="stable") if row[j] != 0.0 and j != column
        ]
        text = self._term(column)
        for j in others[:most]:
            factor = self.combination[i, j]
            size = f"{abs(factor):.3g} "
            sign = "-" if factor < 0.0 else "+"
            multiple = "" if size == "1 " else size
            text += f" {sign} {multiple}{self._term(j)}"
        left = len(others) - len(others[:most])
        return text + (f" + {left} more" if left else "")

    def _term(self, column: int) -> str:
        return f"{self.bodies[column // 10]} {PARAMETERS[column % 10]}"


def base_parameters(
    model: Model, fixed: bool = False, held: Mapping[str, float] | None = None
) -> BaseParameters:
    """Find the base parameters of a model, from its tree and checked on random states.

    The null space of the tree (`tree_null_space`) goes first. What is then still dependent on
    random states, which happens where the base cannot move freely, is found by QR with column
    pivoting. With columns c that are kept and d that depend on them, and a basis N of the null
    space,

        Z[:, c] = 1,   Z[:, d] = -N[c] N[d]^-1

    Parameters
    ----------
    model : whose joints and gravity count, not its masses
    fixed : the base does not move, as on a force plate that it is bolted to: its joint to the
        ground stands at its default or held value
    held : coordinates that do not move, with their values [rad or m]; by default the locked ones

    Returns
    -------
    base parameters with names

    Raises
    ------
    BadModel : no motion shows any inertial parameter
    UnknownName : a held coordinate is not the model's
    """
    still = held_values(model, held)
    if fixed:
        still = {name: model.coordinate(name).default for name in root_coordinates(model)} | still
    tree = tree_null_space(model, still)
    size = 10 * len(model.bodies)
    left = np.setdiff1d(np.arange(size), tree.dependent)
    rest = numerical_null_space(model, still, left)
    whole = NullSpace(
        np.hstack([tree.vectors, rest.vectors]), np.concatenate([tree.dependent, rest.dependent])
    )
    columns = np.setdiff1d(np.arange(size), whole.dependent)
    if not len(columns):
        raise BadModel(
            f"no motion of model '{model.name}' determines any inertial parameter: is gravity zero,"
            " or is every coordinate locked?"
        )
    combination = np.zeros((len(columns), size))
    combination[np.arange(len(columns)), columns] = 1.0
    combination[:, whole.dependent] = -whole.vectors[columns] @ np.linalg.inv(
        whole.vectors[whole.dependent]
    )
    largest = np.abs(combination * SCALE[np.arange(size) % 10]).max(axis=1, keepdims=True)
    combination[np.abs(combination) * SCALE[np.arange(size) % 10] < 1e-10 * largest] = 0.0
    bare = BaseParameters(
        bodies=model.body_names,
        columns=columns,
        combination=combination,
        names=(),
        never=tuple(
            f"{model.body_names[j // 10]} {PARAMETERS[j % 10]}"
            for j in np.flatnonzero(~combination.any(axis=0))
        ),
        held=still,
        rank=len(columns),
        tared=_tared(model, still, columns) if len(rest.dependent) else np.zeros((len(columns), 0)),
    )
    names = tuple(bare.describe(i, most=3) for i in range(len(bare)))
    return replace(bare, names=names)


def _tared(model: Model, held: Mapping[str, float], columns: np.ndarray) -> Array:
    """Find combinations whose wrench about a point of the ground never changes.

    Parameters
    ----------
    columns : (n,) standard parameters that base parameters are named after

    Returns
    -------
    (n, k) a basis of them
    """
    rows = base_regressor(
        model, random_states(model, held, frames=64 + len(columns) // 3, seed=1), np.zeros(3)
    )
    rows = (rows - rows.mean(axis=0))[:, :, columns].reshape(-1, len(columns))
    scale = SCALE[columns % 10]
    R, order = scipy.linalg.qr(rows * scale, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(R))
    rank = int(np.sum(diagonal > TOLERANCE * diagonal[0])) if diagonal[0] > 0.0 else 0
    vectors = np.zeros((len(columns), len(columns) - rank))
    vectors[order[:rank]] = -np.linalg.solve(R[:rank, :rank], R[:rank, rank:])
    vectors[order[rank:]] = np.eye(len(columns) - rank)
    return vectors * scale[:, None]


def root_coordinates(model: Model) -> tuple[str, ...]:
    """Return the names of the coordinates of joints to the ground."""
    return tuple(
        name for joint in model.joints if joint.parent == GROUND for name in joint.coordinates
    )


def held_in(model: Model, motions: Sequence[Motion], fixed: bool = False) -> dict[str, float]:
    """Find locked coordinates that indeed rest in every motion.

    Parameters
    ----------
    model : says which are locked
    motions : (frames, coordinates) each [rad or m]; a coordinate that is missing rests at its
        default
    fixed : the coordinates of joints to the ground must rest too

    Returns
    -------
    name to the value that it rests at [rad or m]

    Raises
    ------
    BadData : the base is specified as fixed, but one of its coordinates moves
    """
    held: dict[str, float] = {}
    roots = root_coordinates(model) if fixed else ()
    for coordinate in model.coordinates:
        name = coordinate.name
        if not coordinate.locked and name not in roots:
            continue
        values = [
            motion[name] if name in motion.names else np.array([coordinate.default])
            for motion in motions
        ]
        seen = np.concatenate(
            [value[np.isfinite(value)] for value in values] or [np.array([coordinate.default])]
        )
        reach = np.ptp(seen) if len(seen) else 0.0
        if name in roots and reach > 1e-6:
            raise BadData(
                f"the base is specified as fixed, but '{name}' moves by {reach:.3g}: identify it as"
                " a"
                " free one"
            )
        if len(seen) and reach < 1e-6:
            held[name] = float(np.median(seen))
    return held


def link_levels(model: Model, base: BaseParameters, levels: Array) -> dict[str, float]:
    """Average levels by body.

    Parameters
    ----------
    model : says which body hangs on which
    base : says after which body each base parameter is named
    levels : (n,) of the base parameters, 0 to 1

    Returns
    -------
    level of every body: the mean over base parameters named after it, or its parent's where there
        are none
    """
    parents = {joint.child: joint.parent for joint in model.joints}
    result: dict[str, float] = {}
    for b, name in enumerate(model.body_names):
        on_link = base.owners == b
        result[name] = (
            float(levels[on_link].mean()) if on_link.any() else result.get(parents[name], 0.0)
        )
    return result


def parameter_sizes(model: Model) -> Array:
    """Compute how large a body's parameters are, to judge what is known well.

    They are m, m l, m l^2 with the model's own mass and radius of gyration l about the body's
    origin: at least 0.5 % of the whole mass and a tenth of the largest radius, because some bodies
    only join two others.

    Parameters
    ----------
    model : with its own masses

    Returns
    -------
    (bodies, 10) [kg, kg m, kg m^2]
    """
    table = inertial_parameters(model)
    mass = table[:, 0]
    whole = mass.sum() if mass.sum() > 0.0 else 1.0
    half_trace = 0.5 * table[:, 4:7].sum(axis=1)
    length = np.sqrt(np.where(mass > 0.005 * whole, half_trace / np.maximum(mass, 1e-300), 0.0))
    length = np.maximum(length, 0.1 * (length.max() or 1.0))
    mass = np.maximum(mass, 0.005 * whole)
    return mass[:, None] * np.column_stack([np.ones_like(length), *[length] * 3, *[length**2] * 6])


def base_sizes(model: Model, base: BaseParameters) -> Array:
    """Compute how large base parameters are.

    It is the root of the sum of squares of what each combines.

    Parameters
    ----------
    model : with its own masses
    base : of the same bodies

    Returns
    -------
    (n,) in the units of each
    """
    return np.sqrt(np.square(base.combination) @ np.square(parameter_sizes(model).ravel()))
