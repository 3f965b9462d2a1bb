"""Results of trials as values, from the folders that a run, a step or a demo wrote."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from myomorph.core.model.curve_columns import CurveColumns, column_units, flattened
from myomorph.core.model.errors import MyomorphError, check_name, from_extra
from myomorph.core.model.frames import columns_frame
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.labelled import AXES, AXIS
from myomorph.core.model.message_groups import CauseGroup, grouped_messages
from myomorph.core.model.model import Model
from myomorph.core.model.plots import Limits, plot_over_time
from myomorph.core.model.provenance import Provenance
from myomorph.core.model.quantity import CLOCK
from myomorph.core.model.series import Emg, Markers, Motion, Series, Wrenches
from myomorph.core.model.shown import shown
from myomorph.core.model.stride_curves import StrideCurves, curves_over, stride_spans
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.tension.tension import Tension, TensionOptions
from myomorph.lab.analysis.strides import Strides
from myomorph.lab.analysis.walking import walking_strides
from myomorph.lab.store import stored as store
from myomorph.lab.store.quantity_table import stated_quantities
from myomorph.lab.store.results import Stored, read_result, result_files
from myomorph.lab.store.stored_fit import get_fit
from myomorph.lab.store.stored_tension import get_tension
from myomorph.lab.store.uncertainty_store import get_uncertainty
from myomorph.lab.uncertainty.spread import Uncertainty

if TYPE_CHECKING:
    import pandas
    import xarray


@shown
@dataclass(frozen=True, eq=False)
class TrialResult:
    """What the steps found for one trial, each part None where its step was not run.

    Attributes
    ----------
    path : of the result file
    provenance : by step: inputs with their hashes, options, version, date
    facts : texts about the trial: its name, its subject, notes
    fit : of inverse kinematics: coordinates [rad, m] and marker errors [m]
    motion : coordinates with velocities and accelerations, as forces were computed for them
    torques : generalized forces of inverse dynamics (frames, coordinates) [N m, N]
    wrenches : external forces as they were used
    tension : activations, muscle forces [N], reserves
    uncertainty : limits of the tables that hold 90 % of the draws, and what contributes to them
    markers, emg : as recorded and used
    model : that the results were made with
    steps : strides of the motion, None where it is no walk
    causes : messages by their cause, the most severe first
    """

    path: Path
    provenance: Mapping[str, Provenance]
    facts: Mapping[str, str]
    stored: Stored

    @property
    def headline(self) -> str:
        """Whose trial it is and what was found, in one line."""
        found = {
            "motion": "coordinate_value",
            "torques": "generalized_force",
            "muscle paths": "muscle_length",
            "tension": "muscle_force",
        }
        parts = [part for part, quantity in found.items() if quantity in self.stored.values]
        name = self.facts.get("trial", self.path.stem)
        who = self.facts.get("subject", "")
        of = f" of '{who}'" if who else ""
        return f"'{name}'{of}: {', '.join(parts) or 'nothing'}"

    @cached_property
    def causes(self) -> tuple[CauseGroup, ...]:
        """What may be wrong, by cause, the most severe first, as on the trial's page."""
        from myomorph.lab.study.trial.reporting import report_input

        return grouped_messages(report_input(self.stored, self.model, drawn=False).head.warnings)

    @cached_property
    def fit(self) -> KinematicsFit | None:
        """Of inverse kinematics."""
        return get_fit(self.stored)

    @cached_property
    def motion(self) -> Motion | None:
        """Coordinates with derivatives; as fitted where no later step has filtered them."""
        return store.get_derivatives(self.stored) or (None if self.fit is None else self.fit.motion)

    @cached_property
    def torques(self) -> Series | None:
        """Generalized forces."""
        return store.get_torques(self.stored)

    @cached_property
    def wrenches(self) -> Wrenches | None:
        """External forces."""
        return store.get_wrenches(self.stored)

    @cached_property
    def tension(self) -> Tension | None:
        """Muscle tensions."""
        return get_tension(self.stored, TensionOptions())

    @cached_property
    def uncertainty(self) -> Uncertainty | None:
        """Limits of the results, and what contributes to them."""
        return get_uncertainty(self.stored)

    @cached_property
    def markers(self) -> Markers | None:
        """Recorded markers."""
        return store.get_markers(self.stored)

    @cached_property
    def emg(self) -> Emg | None:
        """Recorded excitations."""
        return store.get_emg(self.stored)

    @cached_property
    def model(self) -> Model:
        """The model that the results were made with, read again; raises `BadFile` if it is gone."""
        # It brings the report's pages, which take longer to import than results to read.
        from myomorph.lab.study.trial.reporting import model_of

        return model_of(self.stored)

    @cached_property
    def steps(self) -> Strides | None:
        """Strides of the motion: by plates, else events, else motion; None where it is no walk."""
        if self.fit is None and self.motion is None:
            return None
        motion = store.get_motion(self.stored)
        events = store.get_events(self.stored)
        return walking_strides(self.model, motion, self.fit, wrenches=self.wrenches, events=events)

    def strides(self, quantity: str = "coordinate_value") -> StrideCurves:
        """Resample a quantity over the strides of the trial, from 0 to 100 % of each.

        Parameters
        ----------
        quantity : its name in result files, with one column a name: "generalized_force",
            "activation", "muscle_force", ...

        Raises
        ------
        UnknownName : the trial has no such quantity
        BadData : it has no strides
        """
        return curves_over(self.curve_columns(quantity), stride_spans(self.steps))

    def curve_columns(self, quantity: str) -> CurveColumns:
        """Lay out a quantity over time as plain columns.

        Parameters
        ----------
        quantity : its name in result files

        Raises
        ------
        UnknownName : the trial has no such quantity
        """
        known = {
            declared.name: declared
            for declared in stated_quantities()
            if declared.over_time and len(declared.stored_dims) > 1
            if declared.name in self.stored.values
        }
        check_name("quantity", quantity, known, "the trial")
        declared = known[quantity]
        labels = {name: self.stored.names.get(name, AXES) for name in declared.dims[1:]}
        names, values = flattened(self.stored.values[quantity], declared.dims, labels)
        clock = declared.dims[0]
        time = self.stored.time if clock == CLOCK else self.stored.values[clock]
        kinds = store.stored_motion_kinds(self.stored)
        return CurveColumns(
            time=time,
            names=names,
            values=values,
            quantity=quantity,
            units=column_units(declared.unit, names, kinds),
            vectors=declared.dims[-1] == AXIS,
        )

    def drawing(self) -> str:
        """Draw three poses of the motion, as HTML for notebooks; "" where the model is gone."""
        # As for the model, and for the renderer.
        from myomorph.lab.study.trial.notebook_pictures import motion_picture

        if self.fit is None and self.motion is None:
            return ""
        tension = self.tension
        active = None if tension is None else tension.curve_columns("activation")
        activations = None if active is None else Series(active.time, active.names, active.values)
        with contextlib.suppress(MyomorphError):
            return motion_picture(self.model, store.get_motion(self.stored), activations)
        return ""

    def plot(self, quantity: str = "coordinate_value", names: Sequence[str] = ()) -> Any:
        """Draw a quantity over time with matplotlib, with its 90 % interval where draws were made.

        Parameters
        ----------
        quantity : its name in result files
        names : curves, with or without their side; () for all, or for those with the largest values

        Returns
        -------
        the axes; `axes[0].figure` is the figure

        Raises
        ------
        UnknownName : there is no such quantity or curve
        MissingPackage : matplotlib is not installed
        """
        held = self.stored.values
        low = held.get(f"{quantity}_low")
        high = held.get(f"{quantity}_high")
        limits = None if low is None or high is None else Limits(low, high)
        return plot_over_time(self.curve_columns(quantity), names, limits=limits)

    def to_xarray(self) -> xarray.Dataset:
        """Every variable of the result file, moment arms included, as one `xarray.Dataset`.

        Raises
        ------
        MissingPackage
            where xarray is not installed
        """
        # Only here: it brings pandas, which takes longer to import than most steps take to run.
        xarray = from_extra("xarray", "xarray")
        _ = from_extra("xarray", "h5netcdf")
        return xarray.load_dataset(self.path, engine="h5netcdf")

    def to_pandas(self, quantity: str = "") -> pandas.DataFrame:
        """All that has one value a frame, a row a frame: columns are pairs of variable and name.

        Parameters
        ----------
        quantity : name of one variable, whose columns are then its names with their units in
            `attrs["units"]`; "" for all

        Raises
        ------
        UnknownName : there is no such quantity
        MissingPackage : xarray and pandas are not installed
        """
        if quantity:
            return columns_frame(self.curve_columns(quantity))
        dataset = self.to_xarray()
        pandas = from_extra("xarray", "pandas")
        parts = {
            str(name): variable.to_pandas()
            if variable.ndim == 2
            else variable.to_pandas().to_frame("")
            for name, variable in dataset.data_vars.items()
            if variable.dims[:1] == ("time",) and variable.ndim <= 2
        }
        return pandas.concat(parts, axis=1)


def load(folder: str | Path) -> Mapping[str, TrialResult]:
    """Return the results in a folder that `run`, a step or a demo wrote, by subject and trial.

    Values are read when they are first used; the models behind them are not needed.

    Parameters
    ----------
    folder : of results, of a whole study, or one result file

    Returns
    -------
    by name: the place of the result below the folder, e.g. "s01/walk1", or the trial's name in a
    folder of one trial

    Raises
    ------
    BadFile
        where there are no results

    Examples
    --------
    >>> import myomorph as mm
    >>> results = mm.load("results")
    >>> list(results)
    ['s01/reach']
    >>> results["s01/reach"].torques.names
    ('shoulder_flexion', 'elbow_flexion')
    """
    folder = Path(folder)
    results: dict[str, TrialResult] = {}
    for path in result_files(folder):
        stored = read_result(path, leave_out=("moment_arm",))
        home = path.parent.relative_to(folder if folder.is_dir() else folder.parent)
        name = (
            path.stem
            if home == Path()
            else (home if home.name == path.stem else home / path.stem).as_posix()
        )
        results[name] = TrialResult(
            path=path, provenance=stored.provenance, facts=stored.facts, stored=stored
        )
    return FrozenMap(results)
