"""Results of a live session: tables, one result file and delays, made of its log."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from myomorph.core.io.sto import write_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Provenance
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.quantities import ACTIVATION, MUSCLE_FORCE
from myomorph.core.tension.tension import Tension, TensionOptions
from myomorph.lab.store import stored as store
from myomorph.lab.store.quantity_files import quantity_table, write_series
from myomorph.lab.store.results import STORED, new_result
from myomorph.lab.store.settings import with_settings
from myomorph.lab.store.stored_tension import put_tension
from myomorph.lab.store.uncertainty_store import put_uncertainty
from myomorph.lab.uncertainty.spread import Spread, Uncertainty
from myomorph.live.limits import TABLES
from myomorph.live.loop import STATES, LiveSession
from myomorph.live.session_log import LogHead

STEP = "live"


class SessionResults:
    """Writes what a log holds into a folder.

    Parameters
    ----------
    head, rows : of the log, (frames, numbers)
    model : that moved
    folder : that exists
    """

    def __init__(self, head: LogHead, rows: Array, model: Model, folder: Path):
        self._head = head
        self._rows = rows
        self._model = model
        self._folder = folder
        self._part = head.parts

    def write(self, session: LiveSession) -> None:
        """Write tables, `live.nc`, `delays.csv` and `session.json`."""
        self._write_delays(session)
        # What has a value is of an instant before the newest frame by the filter's delay.
        known = np.isfinite(self._rows[:, self._part["coordinates"]]).all(axis=1)
        known &= np.isfinite(self._rows[:, self._part["time"]].ravel())
        if known.any():
            self._write_results(self._rows[known])

    def _write_delays(self, session: LiveSession) -> None:
        delays = session.delays
        markers = self._rows[:, [self._part[part].start for part in ("seen", "error", "remaining")]]
        head = (
            "time_s,waiting_ms,latency_ms,computation_ms,state,markers_seen,marker_error_mm,"
            "remaining_jump"
        )
        lines = (
            f"{time:.6f},{1e3 * waiting:.4f},{1e3 * age:.4f},{1e3 * busy:.4f},"
            f"{STATES[int(state)]},{seen:.0f},{1e3 * error:.3f},{remaining:.3g}"
            for (time, waiting, age, busy, state), (seen, error, remaining) in zip(
                delays.table, markers, strict=True
            )
        )
        (self._folder / "delays.csv").write_text(
            "\n".join([head, *lines, ""]), encoding="utf-8", newline="\n"
        )
        spread = {}
        for name, delay in (
            ("from_frame_to_result", delays.end_to_end),
            ("computation", delays.busy),
        ):
            times = {"median": delay.median, "percentile_99": delay.late, "worst": delay.worst}
            rounded = {
                key: round(1e3 * time, 4) if np.isfinite(time) else None
                for key, time in times.items()
            }
            spread[f"{name}_ms"] = rounded
        facts = {
            "frames": len(delays),
            "dropped": delays.dropped,
            "seconds": round(session.seconds, 3),
            "states": {STATES[state]: count for state, count in delays.states().items()},
            "filter_delay_s": round(session.filter_delay, 6),
            **spread,
            "notes": list(session.notes),
        }
        (self._folder / "session.json").write_text(
            json.dumps(facts, indent=1) + "\n", encoding="utf-8"
        )

    def _write_results(self, rows: Array) -> None:
        folder = self._folder
        part = self._part
        model = self._model
        time = rows[:, part["time"].start] - self._head.filter_delay
        provenance = Provenance.from_json(self._head.provenance)
        motion = Motion(
            time=time,
            names=model.coordinate_names,
            values=rows[:, part["coordinates"]],
            velocities=rows[:, part["velocities"]],
        )
        torques = Series(
            time, model.coordinate_names, rows[:, part["torques"]], quantity=GENERALIZED_FORCE
        )
        tension = self._tension(time, rows, with_settings(TensionOptions(), provenance.options))
        write_series(folder, motion, model)
        write_series(folder, torques, model)
        for quantity in (ACTIVATION, MUSCLE_FORCE):
            values = quantity.of(tension)
            write_series(folder, Series(time, tension.muscles, values, quantity=quantity))
        with new_result(folder / f"{STEP}{STORED}", STEP) as writer:
            writer.provenance(provenance)
            store.put_derivatives(writer, motion, model)
            store.put_torques(writer, torques, self._wrenches(time, rows))
            acts = {actuator.name: actuator.coordinate for actuator in model.actuators}
            put_tension(
                writer, tension, tuple(acts.get(name, "") for name in tension.reserve_names)
            )
            writer.fact("trial", STEP)
            if self._head.draws:
                put_uncertainty(writer, self._limits(time, rows))

    def _limits(self, time: Array, rows: Array) -> Uncertainty:
        """Limits of all tables, written beside them."""
        head = self._head
        model = self._model
        spreads = dict[str, Spread]()
        for part, quantity in TABLES.items():
            by_muscle = quantity.dims[1] == "muscle"
            names = head.muscles if by_muscle else model.coordinate_names
            parts = rows[:, self._part[f"{part}_limits"]].reshape(len(rows), 3, len(names))
            low, high, deviation = np.array(parts).swapaxes(0, 1)
            spreads[quantity.name] = Spread(
                time=time, names=names, low=low, high=high, deviation=deviation, quantity=quantity
            )
            for bound, values in (("low", low), ("high", high)):
                file = f"{quantity.stem}_{bound}{quantity.suffix}"
                table = quantity_table(Series(time, names, values, quantity=quantity), model)
                write_sto(table, self._folder / file)
        return Uncertainty(FrozenMap(spreads), draws=head.draws, factors=FrozenMap(head.factors))

    def _tension(self, time: Array, rows: Array, options: TensionOptions) -> Tension:
        head = self._head
        kept = {name: np.array(rows[:, part]) for name, part in self._part.items()}
        return Tension(
            time=np.array(time),
            muscles=head.muscles,
            activation=kept["activations"],
            muscle_force=kept["forces"],
            reserve_names=head.actuators,
            actuator_force=kept["reserves"],
            coordinates=head.coordinates,
            balanced_torque=kept["balanced"],
            equilibrium_residual=kept["residual"][:, 0],
            status=kept["status"][:, 0].astype(np.int8),
            iterations=np.zeros(len(rows), np.int64),
            activation_lower=np.array(head.lower),
            activation_upper=np.array(head.upper),
            overstretched=(),
            options=options,
        )

    def _wrenches(self, time: Array, rows: Array) -> Wrenches | None:
        """External forces where they meet the floor."""
        bodies = self._head.bodies
        if not bodies:
            return None
        each = rows[:, self._part["wrenches"]].reshape(len(rows), len(bodies), 6)
        moments = each[..., :3]
        forces = each[..., 3:]
        up = np.array(self._head.up)
        lift = forces @ up
        acts = np.abs(lift) > 1.0
        points = np.where(
            acts[..., None], np.cross(up, moments) / np.where(acts, lift, 1.0)[..., None], 0.0
        )
        return Wrenches(
            time=time,
            names=bodies,
            bodies=bodies,
            forces=forces,
            points=points,
            torques=moments - np.cross(points, forces),
        )
