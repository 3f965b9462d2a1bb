"""Tables beside a model that was written for MuJoCo: what differs, and the curves of its muscles."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from myomorph.io.parsing.text import written
from myomorph.model.model import Model
from myomorph.mujoco_tools.certificate import Certificate
from myomorph.mujoco_tools.muscle_forces import LENGTHS, SPEEDS, curves_of

EVERY = 8
"""Of the sampled lengths and speeds, those that the table has."""


def write_tables(model: Model, certificate: Certificate, path: Path) -> tuple[Path, ...]:
    """Write `NAME_differences.csv` and `NAME_curves.csv` beside the model's file `NAME.xml`.

    The first has a row a muscle and the certificate's lines at its end. The second has the model's own curves over
    fiber length along the tendon and over velocity, for whoever computes forces of MuJoCo's tendons by them.

    Raises
    ------
    BadFile : a file cannot be written
    """
    if not model.muscles:
        return ()
    differences, curves = path.with_name(f"{path.stem}_differences.csv"), path.with_name(f"{path.stem}_curves.csv")
    _write(differences, certificate.rows)
    sampled, rows = curves_of(model), []
    for m, muscle in enumerate(model.muscles):
        for curve, x, y in (
            ("active force by length", LENGTHS, sampled.active[:, m]),
            ("passive force by length", LENGTHS, sampled.passive[:, m]),
            ("active force by velocity", SPEEDS, sampled.velocity[:, m]),
        ):
            rows += [
                {
                    "muscle": muscle.name,
                    "strength [N]": f"{sampled.strength[m]:.6g}",
                    "curve": curve,
                    "x": f"{x[i]:.4g}",
                    "y": f"{y[i]:.6g}",
                }
                for i in range(0, len(x), EVERY)
            ]
    _write(curves, rows)
    return differences, curves


def _write(path: Path, rows: Sequence[dict[str, str | float]] | list[dict[str, str]]) -> None:
    with written(path) as stream:
        writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({key: f"{value:.6g}" if isinstance(value, float) else value for key, value in row.items()})
