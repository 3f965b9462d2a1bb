"""Mass points of an adult at 5 mm: the grid inside a skin and the weights of its points, time and memory."""

from __future__ import annotations

import numpy as np

import myomorph as mm
from benchmarks.speed.timing import MEGABYTE, clocked, in_own_process
from data_collection import data_folder
from myomorph.identify.body.fit_pose import pose_model_to_skin
from myomorph.identify.body.points import SPACING, fill, links_of
from myomorph.identify.body.shape import body_shape
from myomorph.identify.body.weights import bone_weights, links_with_mass

MODEL = "fullbody-many-muscles/cyclistFullBodyMuscle.osim"


def run() -> list[dict[str, object]]:
    """Rows of the steps, measured in a process of its own so that memory is theirs alone."""
    return in_own_process(_steps)


def _steps() -> list[dict[str, object]]:
    model = mm.read_model(data_folder() / MODEL)
    posed = pose_model_to_skin(model, body_shape(1.822, 0.870, 66.8, "male"))
    links, taking = links_of(model, posed.motion), links_with_mass(model)
    # What is compiled and loaded on first use is not timed.
    bone_weights(fill(posed.skin, 0.05), links, taking=taking)
    grid = clocked(lambda: fill(posed.skin, SPACING))
    points = grid.result
    weighted = clocked(lambda: bone_weights(points, links, taking=taking))
    table = weighted.result
    steps = {
        "grid inside the skin": (grid, points.nbytes),
        f"weights by bone of {int(np.sum(taking))} links": (
            weighted,
            table.data.nbytes + table.indices.nbytes + table.indptr.nbytes,
        ),
    }
    return [
        {
            "step": step,
            "points": len(points),
            "s": taken.seconds,
            "CPU s": taken.cpu,
            "peak beyond start and results [MB]": taken.peak - size / MEGABYTE,
        }
        for step, (taken, size) in steps.items()
    ]
