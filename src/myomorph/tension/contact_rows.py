"""What contacts bring into the tension problem of all frames: amplitudes, forces measured together, greatest forces.

A force that several sites carry together, or that must not pass a limit, is one more row of A x = b with one more
variable, so that the problem stays separable:

    sum_g S_g z_g - sd e = measured,  cost e^2        sum_g n_g z_g - most q = 0,  -1 <= q <= 1
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import GROUND
from myomorph.rigid.tree import Tree
from myomorph.tension.contact_columns import ContactColumns, compile_contacts
from myomorph.tension.contacts import ContactTask

MEASURED_COST = 1.0
"""Cost of missing a measured force by one standard deviation, in units of the effort a^2 of one muscle."""

MOST_LEAN = 0.45
"""Share of the friction up to which forces may be wanted to lean: at a half an edge would be lost."""

LIMIT_COST = 1e-6
"""Cost of a force at its greatest: small enough to change nothing, above 0 for a unique solution."""


@dataclass(frozen=True, eq=False)
class ExtraRows:
    """Rows behind those of the coordinates, each with a variable of its own behind all others.

    Attributes
    ----------
    names : (rows,) such as "plate_1 FX", "hand_r most"
    wrench, component : (rows,) of a measured wrench: its number, and 0 ... 5 (force, moment); -1 of others
    site, axis : (rows,) of a greatest force: its site, and the axis in ground or -1 for the cone's; -1 of others
    row, edge : (entries,) which edges take part in which row
    unit : (rows,) sd or greatest force: what one unit of the own variable stands for [N] or [N m]
    weight, lower, upper : (rows,) cost and bounds of the own variables
    """

    names: tuple[str, ...]
    wrench: NDArray[np.int64]
    component: NDArray[np.int64]
    site: NDArray[np.int64]
    axis: NDArray[np.int64]
    row: NDArray[np.int64]
    edge: NDArray[np.int64]
    unit: Array
    weight: Array
    lower: Array
    upper: Array

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True, eq=False)
class ContactTerms:
    """Contacts of all frames, as the problem needs them.

    Attributes
    ----------
    strengths : (frames, sites)
    amounts : (frames, edges) force of one unit of an edge's amplitude: strength times weight, more of an edge that
        leans as wanted [N]
    """

    task: ContactTask
    columns: ContactColumns
    extra: ExtraRows
    strengths: Array
    amounts: Array

    @property
    def cost(self) -> Array:
        """(edges,) cost of amplitude^2."""
        return self.task.options.compliance * self.columns.cost

    def rows(self, part: slice, places: Array, pushes: Array, turns: Array) -> tuple[Array, Array]:
        """Entries (frames, entries) of the extra rows and their right-hand sides (frames, rows).

        A component that was not measured has no entries and asks for nothing.
        """
        extra, columns = self.extra, self.columns
        amounts = self.amounts[part]
        forces = pushes * amounts[..., None]
        moments = np.cross(places[:, columns.point], forces) + turns * amounts[..., None]
        wrenches = np.concatenate([forces, moments], axis=2)
        entries, right = np.zeros((len(places), len(extra.row))), np.zeros((len(places), len(extra)))
        for r in range(len(extra)):
            mine = extra.row == r
            edges = extra.edge[mine]
            if extra.wrench[r] >= 0:
                measured = self.task.measured[extra.wrench[r]]
                group, axis = divmod(int(extra.component[r]), 3)
                told = (measured.moments if group else measured.forces)[part, axis]
                known = np.isfinite(told)
                right[:, r] = np.where(known, told, 0.0)
                entries[:, mine] = wrenches[:, edges, extra.component[r]] * known[:, None]
            elif extra.axis[r] >= 0:
                entries[:, mine] = forces[:, edges, extra.axis[r]]
            else:
                entries[:, mine] = columns.normal[edges] * amounts[:, edges]
        return entries, right

    def forces_of(self, part: slice, coordinates: Array, amplitudes: Array) -> Array:
        """Forces, centers of pressure and free torques (3, frames, sites, 3) from the amplitudes (frames, edges)."""
        columns = self.columns
        _, places, pushes, turns = columns.evaluate(coordinates)
        size = amplitudes * self.amounts[part]
        found = np.zeros((3, len(size), len(columns.sites), 3))
        for k, site in enumerate(columns.sites):
            mine = columns.site == k
            numbers = np.unique(columns.point[mine])
            edges = [mine & (columns.point == i) for i in numbers]
            each = np.stack([np.einsum("fg,fgi->fi", size[:, one], pushes[:, one]) for one in edges], axis=1)
            if site.cone.direction is None:
                press = np.linalg.norm(each, axis=2)
            else:
                press = np.stack([size[:, one] @ columns.normal[one] for one in edges], axis=1)
            share = np.where(press.sum(axis=1, keepdims=True) > 0.0, press, 1.0)
            at = places[:, numbers]
            point = np.einsum("fp,fpi->fi", share / share.sum(axis=1, keepdims=True), at)
            turned = np.einsum("fg,fgi->fi", size[:, mine], turns[:, mine])
            found[:, :, k] = each.sum(axis=1), point, turned + np.cross(at - point[:, None], each).sum(axis=1)
        return found

    def torques_of(self, coordinates: Array, amplitudes: Array) -> Array:
        """Generalized forces (frames, coordinates) of the contacts, each coordinate by itself."""
        arrays = self.columns.arrays
        entries, _, _, _ = self.columns.evaluate(coordinates)
        shares = entries * np.repeat(amplitudes * self.amounts, np.diff(arrays.first), axis=1)
        total: Array = shares @ (arrays.coordinate[:, None] == np.arange(coordinates.shape[1]))
        return total


def contact_terms(tree: Tree, time: Array, task: ContactTask) -> ContactTerms:
    """Contacts fitted to the motion's times.

    Raises
    ------
    BadData
        where strengths are of other times or not 0 ... 1, or a measured wrench has another number of frames
    UnknownName
        where a site names a body that the model does not have
    """
    strengths = task.strengths
    if len(strengths) != len(time) or np.max(np.abs(strengths.time - time), initial=0.0) > 1e-6:
        raise BadData(
            f"strengths of contacts have {len(strengths)} frames from {strengths.time[:1]} s, the motion {len(time)} "
            f"from {time[:1]} s: both must have the same times"
        )
    if not np.all((strengths.values >= 0.0) & (strengths.values <= 1.0)):
        frame, site = np.argwhere(~((strengths.values >= 0.0) & (strengths.values <= 1.0)))[0]
        raise BadData(
            f"strength of contact site '{strengths.names[site]}' at frame {frame} is "
            f"{strengths.values[frame, site]:g}: expected 0 to 1"
        )
    for measured in task.measured:
        if len(measured.forces) != len(time):
            raise BadData(f"'{measured.name}' has {len(measured.forces)} frames of forces, the motion {len(time)}")
    columns = compile_contacts(tree, task.sites)
    values = np.array(strengths.values)
    amounts = (values * columns.weight)[:, columns.site] * np.sqrt(_leaning(task, columns))
    return ContactTerms(task, columns, _extra_rows(task, columns), values, amounts)


def _leaning(task: ContactTask, columns: ContactColumns) -> Array:
    """By how much each edge (frames, edges) is favoured so that a force which leans as wanted costs least.

    Of a pyramid of edges d + mu t_k with costs 1 / w_k the cheapest force is sum_k w_k (d + mu t_k), which is
    d + lean for w_k = 1 + 2 lean . t_k / mu, as sum_k t_k t_k^T = n / 2 of n edges; where edges of torsion, which do
    not lean, share the force, the others lean the more. The cone stays as it is.
    """
    shares = np.ones((len(task.strengths), len(columns)))
    if task.leans is None:
        return shares
    for k, site in enumerate(task.sites):
        cone = site.cone
        if cone.direction is None or cone.frame != GROUND or not 0.0 < cone.friction < np.inf:
            continue
        edges = np.flatnonzero((columns.site == k) & (columns.normal != 0.0))
        across = (columns.arrays.push[edges] - cone.direction) / cone.friction
        lean = np.nan_to_num(task.leans[:, k]) * len(edges) / np.any(np.abs(across) > 1e-12, axis=1).sum()
        size = np.linalg.norm(lean, axis=1, keepdims=True)
        lean = lean * np.minimum(1.0, MOST_LEAN * cone.friction / np.maximum(size, 1e-12))
        shares[:, edges] = 1.0 + 2.0 / cone.friction * lean @ across.T
    return shares


def _extra_rows(task: ContactTask, columns: ContactColumns) -> ExtraRows:
    names: list[str] = []
    marks: list[tuple[int, int, int, int]] = []
    entries: list[tuple[int, int]] = []
    costs: list[tuple[float, float, float]] = []

    def add(name: str, mark: tuple[int, int, int, int], chosen: np.ndarray, cost: tuple[float, float, float]) -> None:
        entries.extend((len(names), int(g)) for g in np.flatnonzero(chosen))
        names.append(name)
        marks.append(mark)
        costs.append(cost)

    order = [one.name for one in task.sites]
    for k, measured in enumerate(task.measured):
        members = np.isin(columns.site, [order.index(site) for site in measured.sites])
        for i, label in enumerate(("FX", "FY", "FZ", "MX", "MY", "MZ")):
            sd = measured.moment_sd if i >= 3 else measured.force_sd
            add(f"{measured.name} {label}", (k, i, -1, -1), members, (sd, MEASURED_COST, np.inf))
    for k, site in enumerate(task.sites):
        if not np.isfinite(site.cone.most):
            continue
        limit, mine = (site.cone.most, LIMIT_COST, 1.0), columns.site == k
        if site.cone.direction is None:
            for i, axis in enumerate("XYZ"):
                add(f"{site.name} most {axis}", (-1, -1, k, i), mine, limit)
        else:
            add(f"{site.name} most", (-1, -1, k, -1), mine & (columns.normal != 0.0), limit)
    wrench, component, owner, axes = np.array(marks, np.int64).reshape(-1, 4).T
    row, edge = np.array(entries, np.int64).reshape(-1, 2).T
    unit, weight, upper = np.array(costs, dtype=np.float64).reshape(-1, 3).T.copy()
    return ExtraRows(tuple(names), wrench, component, owner, axes, row, edge, unit, weight, -upper, upper)
