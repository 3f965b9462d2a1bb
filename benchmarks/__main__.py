"""Run one comparison and print its medians and ratios.

`python -m benchmarks NAME [--save] [--json FILE]`: with `--save` its rows become the table of
docs/results/performance that docs/performance.md shows.
"""

from __future__ import annotations

import argparse
import importlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.results import save

COMPARISONS = {
    "opensim": (
        "benchmarks.speed.opensim",
        "speed of every step against OpenSim 4.6, both in one run",
    ),
    "mujoco": (
        "benchmarks.speed.opensim:run_mujoco",
        "speed of tendon lengths and moment arms against MuJoCo",
    ),
    "size": ("benchmarks.speed.size", "36,000 frames of the 520-muscle model: time and memory"),
    "start": ("benchmarks.speed.start", "import, first command with compilation, later commands"),
    "qp": ("benchmarks.speed.qp", "our tension solver against maintained QP solvers"),
    "elastic": (
        "benchmarks.speed.elastic",
        "tensions on elastic tendons: a stride, and 60 s of walking",
    ),
    "forward": (
        "benchmarks.speed.simulate",
        "forward dynamics against OpenSim's Manager and MuJoCo, alone and as one of 200",
    ),
    "identify": (
        "benchmarks.speed.identify",
        "base parameters of 36,000 frames: time and memory, sequential rate",
    ),
    "live-delay": (
        "benchmarks.speed.live_delay",
        "latency of angles, torques and tensions while frames arrive",
    ),
    "live-sensors": (
        "benchmarks.speed.live_delay:run_sensors",
        "the same by inertial sensors in the place of markers",
    ),
    "live": (
        "benchmarks.speed.live_delay:run_identification",
        "frames a second that live identification can take",
    ),
    "morph": (
        "benchmarks.speed.morph",
        "997 elements with 3,000 points over 53 bones of 2,000 features: seconds",
    ),
    "registration": (
        "benchmarks.speed.morph:run_registration",
        "non-rigid registration of a femur of 20,000 vertices",
    ),
    "matching": ("benchmarks.matching_methods", "ways to match bones: accuracy, seconds"),
    "masspoints": (
        "benchmarks.speed.masspoints",
        "the mass-point problem at full size, and general QP solvers",
    ),
    "calibrate": (
        "benchmarks.speed.calibrate",
        "kinematic identification of 50 to 2,000 frames: time and memory",
    ),
    "grid": (
        "benchmarks.speed.masspoints:run_grid",
        "grid of mass points of an adult at 5 mm, with weights: time and memory",
    ),
    "viscosity": (
        "benchmarks.speed.viscosity",
        "one specimen of the shoulder experiment, and runs on both cores",
    ),
    "contacts": (
        "benchmarks.speed.contacts",
        "tensions and contact forces in one problem, and general QP solvers",
    ),
    "species": (
        "benchmarks.speed.morph:run_species",
        "a whole human leg to a mouse: bones, muscles, files",
    ),
    "view": (
        "benchmarks.speed.view",
        "results in a page: from the command to the first pose, frames a second of playback",
    ),
    "draws": (
        "benchmarks.speed.draws",
        "intervals of results: 200 draws of a 10 s walk, and the walk alone",
    ),
    "study": (
        "benchmarks.speed.study",
        "1,000 short trials: workers side by side, memory, cost of a trial",
    ),
    "fuzz": (
        "benchmarks.fuzz",
        "readers on wrong files: inputs tried, and their outcomes",
    ),
    "revision": (
        "benchmarks.speed.revision",
        "functions and commands against those of --before REVISION, in turns",
    ),
    "page": (
        "benchmarks.page",
        "readability of the code, by wing; --before REVISION",
    ),
    "first_result": (
        "benchmarks.first_result",
        "from nothing installed to the report of a recording: seconds",
    ),
    "pages": (
        "benchmarks.pages",
        "pages of results on two screens, light and dark, and what axe finds in them",
    ),
    "trial_path": (
        "benchmarks.trial_path",
        "number of files that the inputs of a trial pass through; --tree PATH",
    ),
    "release": (
        "benchmarks.release",
        "sdist and wheel: contents, and the wheel alone in a fresh environment",
    ),
    "mutants": (
        "benchmarks.mutants",
        "small wrong changes of the science rooms: how many their own tests notice",
    ),
    "wheels": (
        "benchmarks.wheels",
        "dependencies without a wheel for Windows, macOS and Linux on ARM",
    ),
    "sources": (
        "benchmarks.sources",
        "every row of both sources: number, truth and the command that measured it",
    ),
    "validation": (
        "benchmarks.validation",
        "accuracy against OpenSim, MuJoCo and Pinocchio: docs/results/validation",
    ),
}


@dataclass(frozen=True, kw_only=True)
class Request:
    """Request of a command line.

    Attributes
    ----------
    name : of the comparison
    measure : gives its rows
    options : of the comparison, by name
    words : behind its name, as they are logged
    json : file to write the rows to, None for none
    save : write them to docs/results/performance
    """

    name: str
    measure: Callable[..., list[dict[str, object]]]
    options: Mapping[str, Any]
    words: Sequence[str]
    json: Path | None
    save: bool


def parsed(arguments: Sequence[str] | None = None) -> Request:
    """Read a command line; those of this process by default."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    listing = "; ".join(f"{name}: {what}" for name, (_, what) in COMPARISONS.items())
    parser.add_argument("name", choices=sorted(COMPARISONS), help=listing)
    parser.add_argument("--json", type=Path, help="write the rows to this file too")
    parser.add_argument(
        "--save", action="store_true", help="write the rows to docs/results/performance"
    )
    options, rest = parser.parse_known_args(arguments)
    module, _, function = COMPARISONS[options.name][0].partition(":")
    comparison = importlib.import_module(module)
    parser = argparse.ArgumentParser(prog=f"python -m benchmarks {options.name}", add_help=False)
    if not function and hasattr(comparison, "add_options"):
        comparison.add_options(parser)
    return Request(
        name=options.name,
        measure=getattr(comparison, function or "run"),
        options=vars(parser.parse_args(rest)),
        words=rest,
        json=options.json,
        save=options.save,
    )


def main() -> None:
    """Run the comparison that the command line names."""
    request = parsed()
    rows = request.measure(**request.options)
    print_rows(rows)
    if request.json:
        request.json.write_text(json.dumps(rows, indent=1, default=float))
    if request.save:
        words = " ".join([request.name, *request.words])
        table = "-".join(words.replace("--", "").split())
        save(f"performance/{table}", rows, f"python -m benchmarks {words} --save")


def print_rows(rows: list[dict[str, object]]) -> None:
    """Print rows as text, one line each."""
    for row in rows:
        print("; ".join(f"{key}: {_short(value)}" for key, value in row.items()))


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
