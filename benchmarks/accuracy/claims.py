"""What the front page of docs/validation claims: for each claim the number, the target, the comparison and its table.

Every number is computed from the other tables of results; none is typed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from benchmarks.results import Row, Table, load

LIKE_OURS = "OpenSim 4.6, coordinates and loads filtered as by our default"


@dataclass(frozen=True)
class Claim:
    """One line of the front page.

    `text`: what is claimed; `table`: of results that has the rows; `number`: from the rows to what is printed;
    `target`: "" where none was set; `against`: what it is compared with.
    """

    text: str
    table: str
    number: Callable[[Table], str]
    target: str
    against: str


def claims() -> tuple[Claim, ...]:
    """The lines of the front page in their order."""
    return (*_of_programs(), *_of_persons(), *_of_known_truths())


def _of_programs() -> tuple[Claim, ...]:
    """Claims that other programs decide."""
    return (
        Claim("Models that open", "models", _share("opened", lambda cell: cell == "yes"), "all", "the data collection"),
        Claim("Kernels, largest difference", "kernels", _largest("largest difference"), "1e-9", "Pinocchio, MuJoCo"),
        Claim(
            "Models whose muscle lengths agree [mm]",
            "muscles",
            _within("length 99 % [mm]", 0.1, {"compared with": "OpenSim"}),
            "0.1 in all",
            "OpenSim 4.6",
        ),
        Claim(
            "Models whose moment arms agree at the 99th percentile [mm]",
            "muscles",
            _within("moment arm 99 % [mm]", 0.1, {"compared with": "OpenSim"}),
            "0.1 in all",
            "OpenSim 4.6",
        ),
        Claim(
            "Moment arms over a closed loop [mm]",
            "loop_arms",
            _largest("difference [mm]"),
            "0.001",
            "OpenSim 4.6",
        ),
        Claim(
            "Inverse kinematics: marker error at most 0.5 % above the peer's",
            "inverse_kinematics",
            _pairs("RMSE ours [mm]", "RMSE OpenSim [mm]", 1.005),
            "all cases",
            "OpenSim 4.6",
        ),
        Claim(
            "Inverse dynamics: recordings with every coordinate within 1 % of its range",
            "inverse_dynamics",
            _within("worst RMS / range [%]", 1.0),
            "all",
            "OpenSim 4.6",
        ),
        Claim("Static optimization, activations RMS", "tension", _largest("RMS of activations"), "0.02", "OpenSim 4.6"),
        Claim(
            "Joint reactions, same tensions in [N]",
            "reaction",
            _largest("forces apart, at most [N]", {"against": "OpenSim 4.6"}),
            "0.1",
            "OpenSim 4.6",
        ),
    )


def _of_persons() -> tuple[Claim, ...]:
    """Claims that recordings of persons decide."""
    return (
        Claim("Live activations, RMS", "live", _span("activations: rms"), "", "the whole recording"),
        Claim(
            "Calibrated models with lower marker error on unseen motion",
            "calibration",
            _share("lower", lambda cell: cell == "True"),
            "all",
            "an expert's or OpenSim's scaling",
        ),
        Claim(
            "Identified masses: ground force on unseen motion, ratio to the generic body",
            "identification",
            _ratios("points, own link"),
            "below 1",
            "measured plates",
        ),
        Claim(
            "Mass points: farthest mass [kg]", "masspoints", _largest("farthest mass from NNLS [kg]"), "", "exact NNLS"
        ),
        Claim(
            "Hidden plates: vertical force [% of range]",
            "hidden_plates",
            _span("vertical [% range]", {"formulation": "simultaneous"}),
            "8 in walks",
            "measured plates",
        ),
        Claim(
            "Share of frames with the plate inside the interval of the vertical force",
            "certificates",
            _span("plates inside, vertical"),
            "",
            "measured plates",
        ),
        Claim(
            "Force in an instrumented knee, default settings [body weights RMS]",
            "knee",
            _largest("total, mean", {"RMS of the force [BW]": "default"}),
            "0.35",
            "measured force",
        ),
        Claim(
            "The same by OpenSim's static optimization with the same filter",
            "knee",
            _largest("total, mean", {"RMS of the force [BW]": LIKE_OURS}),
            "ours 10 % below",
            "measured force",
        ),
        Claim(
            "EMG channels left out: mean correlation without EMG",
            "emg_held_out",
            _span("correlation, mean", {"others": "without EMG"}),
            "",
            "measured EMG",
        ),
        Claim(
            "The same with the other channels as targets, by default",
            "emg_held_out",
            _span("correlation, mean", {"others": "default"}),
            "above the line before",
            "measured EMG",
        ),
        Claim(
            "Limits of 90 %: share of samples of a measured knee force inside [%]",
            "uncertainty_knee",
            _span("total, inside [%]"),
            "85 to 95",
            "measured force",
        ),
        Claim(
            "Limits of 90 %: vertical forces of feet whose plates are hidden inside, walks by recording [%]",
            "uncertainty_plates",
            _span("vertical, inside [%]"),
            "85 to 95",
            "measured force",
        ),
        Claim(
            "Limits of 90 %: the force that lifts a box of known mass inside, by lift [%]",
            "uncertainty_box",
            _span("up, inside [%]"),
            "85 to 95",
            "measured force",
        ),
        Claim(
            "Raw recordings by one command: correlation of flexion moments of the hip, where a set has its own",
            "analyze",
            _span("hip, r"),
            "",
            "each set's own moments",
        ),
    )


def _of_known_truths() -> tuple[Claim, ...]:
    """Claims that simulated truths, undisturbed runs and wrong files decide."""
    return (
        Claim("Faults put into external forces: missed", "force_faults", _total("missed"), "0", "clean recordings"),
        Claim(
            "90 % intervals of fiber and slack lengths that hold the truth [%]",
            "personal_truth",
            _span("within the 90 % interval [%]", {"identifiable": "all"}),
            "87 to 95",
            "simulated people",
        ),
        Claim(
            "Limits of 90 %: joint torques of simulated persons inside [%]",
            "uncertainty_assumed",
            _span("torques, widened"),
            "87 to 93",
            "simulated recordings",
        ),
        Claim(
            "The same with errors that the limits do not assume [%]",
            "uncertainty_other",
            _span("torques, widened"),
            "80 to 95",
            "simulated recordings",
        ),
        Claim(
            "Viscosity of a joint: runs within 3 %",
            "virtual_joints",
            _counted("within target", {"quantity": "viscosity"}),
            "all",
            "simulated in MuJoCo",
        ),
        Claim(
            "Its 95 % intervals that hold the truth",
            "virtual_joints",
            _counted("95 % intervals that hold the truth", {"quantity": "viscosity"}),
            "95 %",
            "simulated in MuJoCo",
        ),
        Claim(
            "Leg in deformed bones: muscle points, median error [mm]",
            "morph_demo",
            _smallest("point error, median [mm]"),
            "",
            "known deformation",
        ),
        Claim(
            "The same by scaling [mm]",
            "morph_demo",
            _largest("point error, median [mm]", {"method": "scaling, 12 landmarks"}),
            "",
            "known deformation",
        ),
        Claim("Interrupted studies: files that differ", "interrupted", _total("not equal"), "0", "an undisturbed run"),
        Claim(
            "Wrong files: faults found in all inputs", "wrong_files", _total("found"), "0", "coverage-guided fuzzing"
        ),
    )


def claim_rows() -> list[Row]:
    """The claims with their numbers, from the tables as they are on disk."""
    return [
        {
            "claim": claim.text,
            "measured": claim.number(load(f"validation/{claim.table}")),
            "target": claim.target,
            "compared with": claim.against,
            "table": claim.table,
        }
        for claim in claims()
    ]


def _number(cell: str) -> float:
    found = re.match(r"[-+]?[0-9.]+(?:e[-+]?[0-9]+)?", cell)
    return float(found[0]) if found else float("nan")


def _values(rows: Table, column: str, only: Mapping[str, str] | None = None) -> list[float]:
    chosen = [row for row in rows if all(row[name] == cell for name, cell in (only or {}).items())]
    values = [_number(row[column]) for row in chosen]
    return [one for one in values if one == one]


def _largest(column: str, only: Mapping[str, str] | None = None) -> Callable[[Table], str]:
    return lambda rows: f"{max(_values(rows, column, only)):.3g}"


def _within(column: str, limit: float, only: Mapping[str, str] | None = None) -> Callable[[Table], str]:
    def text(rows: Table) -> str:
        values = _values(rows, column, only)
        return f"{sum(one <= limit for one in values)} of {len(values)} (worst {max(values):.3g})"

    return text


def _smallest(column: str, only: Mapping[str, str] | None = None) -> Callable[[Table], str]:
    return lambda rows: f"{min(_values(rows, column, only)):.3g}"


def _span(column: str, only: Mapping[str, str] | None = None) -> Callable[[Table], str]:
    def text(rows: Table) -> str:
        values = _values(rows, column, only)
        return f"{min(values):.3g} to {max(values):.3g}"

    return text


def _total(column: str) -> Callable[[Table], str]:
    return lambda rows: f"{sum(_values(rows, column)):.0f}"


def _share(column: str, holds: Callable[[str], bool]) -> Callable[[Table], str]:
    return lambda rows: f"{sum(holds(row[column]) for row in rows)} of {len(rows)}"


def _pairs(ours: str, theirs: str, factor: float) -> Callable[[Table], str]:
    def text(rows: Table) -> str:
        good = [_number(row[ours]) <= factor * _number(row[theirs]) for row in rows]
        return f"{sum(good)} of {len(good)}"

    return text


def _ratios(column: str) -> Callable[[Table], str]:
    """Range of the force's ratios in cells like "24.1 N (1.01), 11.1 N m (0.76)"."""

    def text(rows: Table) -> str:
        found = [re.search(r"\(([0-9.]+)\)", row[column]) for row in rows]
        values = [float(one[1]) for one in found if one]
        return f"{min(values):.2f} to {max(values):.2f}"

    return text


def _counted(column: str, only: Mapping[str, str]) -> Callable[[Table], str]:
    """Sum of cells like "97 of 100"."""

    def text(rows: Table) -> str:
        cells = [row[column] for row in rows if all(row[name] == cell for name, cell in only.items())]
        pairs = [[int(one) for one in re.findall(r"(\d+) of (\d+)", cell)[0]] for cell in cells]
        return f"{sum(a for a, _ in pairs)} of {sum(b for _, b in pairs)}"

    return text
