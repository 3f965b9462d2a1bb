"""Results as xarray and pandas show them: named variables over named dimensions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.curve_columns import CurveColumns, column_units, flattened
from myomorph.core.model.errors import BadData, UnknownName, check_name, from_extra
from myomorph.core.model.frames import Variable, columns_frame, variables_frame
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.plots import plot_over_time
from myomorph.core.model.quantity import CLOCK, Quantity
from myomorph.core.model.stride_curves import (
    EventLike,
    StrideCurves,
    StridesLike,
    curves_over,
    stride_spans,
)

if TYPE_CHECKING:
    import pandas
    import xarray

AXES = ("x", "y", "z")
AXIS = "axis"
"""Dimension of the components of vectors."""


class Labelled:
    """A value that states what its arrays are, so that files and other libraries can hold them.

    `quantities` are declared once; a value may hold only some of them (None for the others). `axes`
    are the fields that hold the times and names of the quantities' axes.
    """

    quantities: ClassVar[tuple[Quantity, ...]] = ()
    axes: ClassVar[Mapping[str, str]] = FrozenMap({})

    @property
    def held(self) -> tuple[Quantity, ...]:
        """The quantities of this value."""
        return self.quantities

    def held_arrays(self) -> Iterator[tuple[Quantity, Any]]:
        """Yield each quantity that this value holds, with its array or texts."""
        for quantity in self.held:
            values = quantity.of(self)
            if values is not None:
                yield quantity, values

    def variables(self) -> Mapping[str, Variable]:
        """Name the arrays, each with its dimensions and unit."""
        return {
            quantity.name: Variable(quantity.dims, np.asarray(values), quantity.unit)
            for quantity, values in self.held_arrays()
            if quantity.kind != "text"
        }

    def labels(self) -> Mapping[str, Sequence[object] | np.ndarray]:
        """Label each dimension: times, names, axes.

        Returns
        -------
        by dimension
        """
        if not self.axes:
            raise TypeError(f"{type(self).__name__} names no labels")
        return {axis: getattr(self, field) for axis, field in self.axes.items()}

    def curve(self, quantity: str, *labels: str) -> np.ndarray:
        """Return a quantity over time for what is named.

        Parameters
        ----------
        quantity : its name, as in result files
        labels : one for each of its axes after the times, a muscle for instance; the axes that are
            left out stay

        Returns
        -------
        (times, ...) in the quantity's unit

        Raises
        ------
        UnknownName : this value has no such quantity, or an axis no such name
        BadData : more labels than axes

        Examples
        --------
        >>> import numpy as np
        >>> import myomorph as mm
        >>> loads = mm.Wrenches(
        ...     np.arange(2.0), ("plate",), ("calcn_r",), np.ones((2, 1, 3)), np.zeros((2, 1, 3))
        ... )
        >>> loads.curve("external_force_vector", "plate", "y")
        array([1., 1.])
        """
        held = {one.name: one for one in self.held if one.dims[0].endswith(CLOCK)}
        check_name("quantity", quantity, held, type(self).__name__)
        values = held[quantity].of(self)
        if values is None:
            others = [name for name in held if name != quantity]
            raise UnknownName("quantity", quantity, others, where=type(self).__name__)
        axes = held[quantity].dims[1:]
        if len(labels) > len(axes):
            raise BadData(f"'{quantity}' has the axes {axes}, but {len(labels)} names were given")
        names = self.labels()
        place: list[int] = []
        for axis, label in zip(axes, labels, strict=False):
            known = [str(name) for name in names[axis]]
            check_name(axis, label, known, f"'{quantity}'")
            place.append(known.index(label))
        index: tuple[slice | int, ...] = (slice(None), *place)
        return np.asarray(values)[index]

    def strides(
        self,
        strikes: StridesLike | Iterable[EventLike] | Mapping[str, ArrayLike] | None,
        quantity: str = "",
    ) -> StrideCurves:
        """Resample a quantity over strides, from 0 to 100 % of each.

        Parameters
        ----------
        strikes : strides that `walking_strides` found; events of a recording, of which foot strikes
            with a side count; or times of foot strikes by foot or side [s]
        quantity : its name, as in result files, "" for the first that has names

        Returns
        -------
        curves (strides, 101, names) with side, start and end of each stride

        Raises
        ------
        UnknownName : there is no such quantity
        BadData : nothing marks a stride

        Examples
        --------
        >>> import numpy as np
        >>> import myomorph as mm
        >>> time = np.linspace(0.0, 4.0, 401)
        >>> angle = mm.Series(time, ("knee_angle_r",), np.sin(np.pi * time)[:, None])
        >>> curves = angle.strides({"right": [0.0, 2.0, 4.0]})
        >>> curves["knee_angle_r"].shape, round(float(curves.mean("knee_angle_r").max()), 2)
        ((2, 101), 1.0)
        """
        return curves_over(self.curve_columns(quantity), stride_spans(strikes))

    def curve_columns(self, quantity: str = "") -> CurveColumns:
        """Lay out a quantity over time as plain columns.

        Parameters
        ----------
        quantity : its name, as in result files, "" for the first that has names

        Raises
        ------
        UnknownName : there is no such quantity
        BadData : there is nothing over time
        """
        named = {
            name: variable
            for name, variable in self.variables().items()
            if variable.over_time and len(variable.dimensions) > 1
        }
        if not named:
            raise BadData(f"{type(self).__name__} has no curves over time")
        chosen = quantity or next(iter(named))
        check_name("quantity", chosen, named, type(self).__name__)
        variable = named[chosen]
        labels = self.labels()
        names, values = flattened(variable.values, variable.dimensions, labels)
        return CurveColumns(
            time=np.asarray(labels[variable.dimensions[0]]),
            names=names,
            values=values,
            quantity=chosen,
            units=column_units(variable.unit, names, getattr(self, "motion_kinds", None)),
            vectors=variable.dimensions[-1] == AXIS,
        )

    def to_xarray(self) -> xarray.Dataset:
        """Put all arrays into one `xarray.Dataset`, with units, named as in result files."""
        # Only here: it brings pandas, which takes longer to import than most steps take to run.
        xarray = from_extra("xarray", "xarray")
        variables = self.variables()
        used = {name for variable in variables.values() for name in variable.dimensions}
        return xarray.Dataset(
            {
                name: (
                    variable.dimensions,
                    np.asarray(variable.values),
                    {"units": variable.unit} if variable.unit else {},
                )
                for name, variable in variables.items()
            },
            {
                name: (name, np.asarray(values), {"units": "s"} if name.endswith(CLOCK) else {})
                for name, values in self.labels().items()
                if name in used
            },
        )

    def plot(self, names: Sequence[str] = (), quantity: str = "", axes: Any = None) -> Any:
        """Draw a quantity over time with matplotlib, right and left of a name together.

        Parameters
        ----------
        names : curves, with or without their side: "knee_angle" draws both; () for all, or for
            those with the largest values where there are many
        quantity : its name, as in result files, "" for the first that has names
        axes : to draw into, one per panel; None makes a new figure

        Returns
        -------
        the axes; `axes[0].figure` is the figure

        Raises
        ------
        UnknownName : there is no such quantity or curve
        BadData : there are fewer axes than panels
        MissingPackage : matplotlib is not installed
        """
        return plot_over_time(self.curve_columns(quantity), names, axes=axes)

    def to_pandas(self, quantity: str = "") -> pandas.DataFrame:
        """Put arrays over time into one `pandas.DataFrame`, one row per frame.

        Columns are the names of a single variable, else pairs of variable and name. Vectors have
        one column per axis. `attrs["units"]` has the unit of each column.

        Parameters
        ----------
        quantity : name of one variable, whose columns are then its names; "" for all

        Raises
        ------
        UnknownName : there is no such quantity
        MissingPackage : pandas is not installed
        """
        if quantity:
            return columns_frame(self.curve_columns(quantity))
        return variables_frame(
            {name: values for name, values in self.variables().items() if values.over_time},
            self.labels(),
            getattr(self, "motion_kinds", None),
        )
