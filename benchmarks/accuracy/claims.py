"""Claims of the front page of docs/validation.

Each has its number, target, comparison and table. Every number is computed from the other tables
of results; none is typed.
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

    `text`: what is claimed; `table`: of results that has the rows; `number`: from the rows to what
    is printed; `target`: "" where none was set; `against`: what it is compared with.
    """

    text: str
    table: str
    number: Callable[[Table], str]
    target: str
    against: str


def claims() -> tuple[Claim, ...]:
    """List the lines of the front page in their order."""
    return (*_of_programs(), *_of_measured_bodies(), *_of_measured_forces(), *_of_known_truths())


def _of_programs() -> tuple[Claim, ...]:
    """Claims that other programs decide."""
    return (
        Claim(
            text="Models that open",
            table="models",
            number=_share("opened", lambda cell: cell == "yes"),
            target="all",
            against="the data collection",
        ),
        Claim(
            text="Kernels, largest difference",
            table="kernels",
            number=_largest("largest difference"),
            target="1e-9",
            against="Pinocchio, MuJoCo",
        ),
        Claim(
            text="Models whose muscle lengths agree [mm]",
            table="muscles",
            number=_within("length 99 % [mm]", 0.1, {"compared with": "OpenSim"}),
            target="0.1 in all",
            against="OpenSim 4.6",
        ),
        Claim(
            text="Models whose moment arms agree at the 99th percentile [mm]",
            table="muscles",
            number=_within("moment arm 99 % [mm]", 0.1, {"compared with": "OpenSim"}),
            target="0.1 in all",
            against="OpenSim 4.6",
        ),
        Claim(
            text="Moment arms over a closed loop [mm]",
            table="loop_arms",
            number=_largest("difference [mm]"),
            target="0.001",
            against="OpenSim 4.6",
        ),
        Claim(
            text="Inverse kinematics: marker error at most 0.5 % above the peer's",
            table="inverse_kinematics",
            number=_pairs("RMSE ours [mm]", "RMSE OpenSim [mm]", 1.005),
            target="all cases",
            against="OpenSim 4.6",
        ),
        Claim(
            text="Inverse dynamics: recordings with every coordinate within 1 % of its range",
            table="inverse_dynamics",
            number=_within("worst RMS / range [%]", 1.0),
            target="all",
            against="OpenSim 4.6",
        ),
        Claim(
            text="Static optimization, activations RMS",
            table="tension",
            number=_largest("RMS of activations"),
            target="0.02",
            against="OpenSim 4.6",
        ),
        Claim(
            text="Joint reactions, same tensions in [N]",
            table="reaction",
            number=_largest("difference of forces, maximum [N]", {"against": "OpenSim 4.6"}),
            target="0.1",
            against="OpenSim 4.6",
        ),
    )


def _of_measured_bodies() -> tuple[Claim, ...]:
    """Claims that measured persons' models decide."""
    return (
        Claim(
            text="Live activations, RMS",
            table="live",
            number=_span("activations: rms"),
            target="",
            against="the whole recording",
        ),
        Claim(
            text="Calibrated models with lower marker error on held-out motion",
            table="calibration",
            number=_share("lower", lambda cell: cell == "True"),
            target="all",
            against="an expert's or OpenSim's scaling",
        ),
        Claim(
            text="Identified masses: ground force on held-out motion, ratio to the generic body",
            table="identification",
            number=_ratios("points, own link"),
            target="below 1",
            against="measured plates",
        ),
        Claim(
            text="Mass points: farthest mass [kg]",
            table="masspoints",
            number=_largest("farthest mass from NNLS [kg]"),
            target="",
            against="exact NNLS",
        ),
    )


def _of_measured_forces() -> tuple[Claim, ...]:
    """Claims that measured forces, torques and EMG decide."""
    return (
        Claim(
            text="Hidden plates: vertical force [% of range]",
            table="hidden_plates",
            number=_span("vertical [% range]", {"formulation": "simultaneous"}),
            target="8 in walks",
            against="measured plates",
        ),
        Claim(
            text="Share of frames with the plate inside the interval of the vertical force",
            table="certificates",
            number=_span("plates inside, vertical"),
            target="",
            against="measured plates",
        ),
        Claim(
            text="Force in an instrumented knee, default settings [body weights RMS]",
            table="knee",
            number=_largest("total, mean", {"RMS of the force [BW]": "default"}),
            target="0.35",
            against="measured force",
        ),
        Claim(
            text="The same by OpenSim's static optimization with the same filter",
            table="knee",
            number=_largest("total, mean", {"RMS of the force [BW]": LIKE_OURS}),
            target="ours 10 % below",
            against="measured force",
        ),
        Claim(
            text="EMG channels left out: mean correlation without EMG",
            table="emg_held_out",
            number=_span("correlation, mean", {"others": "without EMG"}),
            target="",
            against="measured EMG",
        ),
        Claim(
            text="The same with the other channels as targets, by default",
            table="emg_held_out",
            number=_span("correlation, mean", {"others": "default"}),
            target="above the line before",
            against="measured EMG",
        ),
        Claim(
            text="Limits of 90 %: share of samples of a measured knee force inside [%]",
            table="uncertainty_knee",
            number=_span("total, inside [%]"),
            target="85 to 95",
            against="measured force",
        ),
        Claim(
            text=(
                "Limits of 90 %: vertical forces of feet whose plates are hidden inside, walks by"
                " recording [%]"
            ),
            table="uncertainty_plates",
            number=_span("vertical, inside [%]"),
            target="85 to 95",
            against="measured force",
        ),
        Claim(
            text="Limits of 90 %: the force that lifts a box of known mass inside, by lift [%]",
            table="uncertainty_box",
            number=_span("up, inside [%]"),
            target="85 to 95",
            against="measured force",
        ),
        Claim(
            text=(
                "Raw recordings by one command: correlation of flexion moments of the hip, where a"
                " set has its own"
            ),
            table="analyze",
            number=_span("hip, r"),
            target="",
            against="each set's own moments",
        ),
    )


def _of_known_truths() -> tuple[Claim, ...]:
    """Claims that simulated truths, undisturbed runs and wrong files decide."""
    return (
        Claim(
            text="Faults put into external forces: missed",
            table="force_faults",
            number=_total("missed"),
            target="0",
            against="clean recordings",
        ),
        Claim(
            text="90 % intervals of fiber and slack lengths that hold the truth [%]",
            table="personal_truth",
            number=_span("within the 90 % interval [%]", {"identifiable": "all"}),
            target="87 to 95",
            against="simulated people",
        ),
        Claim(
            text="Limits of 90 %: joint torques of simulated persons inside [%]",
            table="uncertainty_assumed",
            number=_span("torques, widened"),
            target="87 to 93",
            against="simulated recordings",
        ),
        Claim(
            text="The same with errors that the limits do not assume [%]",
            table="uncertainty_other",
            number=_span("torques, widened"),
            target="80 to 95",
            against="simulated recordings",
        ),
        Claim(
            text="Viscosity of a joint: runs within 3 %",
            table="virtual_joints",
            number=_counted("within target", {"quantity": "viscosity"}),
            target="all",
            against="simulated in MuJoCo",
        ),
        Claim(
            text="Its 95 % intervals that hold the truth",
            table="virtual_joints",
            number=_counted("95 % intervals that hold the truth", {"quantity": "viscosity"}),
            target="95 %",
            against="simulated in MuJoCo",
        ),
        Claim(
            text="Leg in deformed bones: muscle points, median error [mm]",
            table="morph_demo",
            number=_smallest("point error, median [mm]"),
            target="",
            against="known deformation",
        ),
        Claim(
            text="The same by scaling [mm]",
            table="morph_demo",
            number=_largest("point error, median [mm]", {"method": "scaling, 12 landmarks"}),
            target="",
            against="known deformation",
        ),
        Claim(
            text="Interrupted studies: files that differ",
            table="interrupted",
            number=_total("not equal"),
            target="0",
            against="an undisturbed run",
        ),
        Claim(
            text="Wrong files: faults found in all inputs",
            table="wrong_files",
            number=_total("found"),
            target="0",
            against="files made wrong at random",
        ),
    )


def claim_rows() -> list[Row]:
    """Return the claims with their numbers, from the tables as they are on disk."""
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


def _within(
    column: str, limit: float, only: Mapping[str, str] | None = None
) -> Callable[[Table], str]:
    def text(rows: Table) -> str:
        values = _values(rows, column, only)
        count = sum(one <= limit for one in values)
        return f"{count} of {len(values)} (worst {max(values):.3g})"

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
    def text(rows: Table) -> str:
        count = sum(holds(row[column]) for row in rows)
        return f"{count} of {len(rows)}"

    return text


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
        cells = [
            row[column] for row in rows if all(row[name] == cell for name, cell in only.items())
        ]
        pairs = [[int(one) for one in re.findall(r"(\d+) of (\d+)", cell)[0]] for cell in cells]
        counts, totals = zip(*pairs, strict=True)
        return f"{sum(counts)} of {sum(totals)}"

    return text
