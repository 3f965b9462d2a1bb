"""Mass points of an adult at 5 mm: the grid inside a skin and the weights of its points, time and memory."""

from __future__ import annotations

import multiprocessing
import time

import numpy as np

from benchmarks.cases import data_folder
from benchmarks.speed.size import MEGABYTE, peak, resident
from myomorph.identify.body.fit_pose import pose_model_to_skin
from myomorph.identify.body.points import SPACING, fill, links_of
from myomorph.identify.body.shape import body_shape
from myomorph.identify.body.weights import bone_weights, links_with_mass
from myomorph.io.formats import read_model

MODEL = "fullbody-many-muscles/cyclistFullBodyMuscle.osim"


def run() -> list[dict[str, object]]:
    """Rows of the steps, measured in a process of its own so that memory is theirs alone."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_steps)


def _steps() -> list[dict[str, object]]:
    model = read_model(data_folder() / MODEL)
    shape = body_shape(1.822, 0.870, 66.8, "male")
    posed = pose_model_to_skin(model, shape)
    links, taking = links_of(model, posed.motion), links_with_mass(model)
    # What is compiled and loaded on first use is not timed.
    bone_weights(fill(posed.skin, 0.05), links, taking=taking)
    rows: list[dict[str, object]] = []

    def row(step: str, began: float, cpu: float, before: int, size: int, count: int) -> None:
        rows.append(
            {
                "step": step,
                "points": count,
                "s": time.perf_counter() - began,
                "CPU s": time.process_time() - cpu,
                "peak beyond start and results [MB]": (peak() - before - size) / MEGABYTE,
            }
        )

    before, began, cpu = resident(), time.perf_counter(), time.process_time()
    points = fill(posed.skin, SPACING)
    row("grid inside the skin", began, cpu, before, points.nbytes, len(points))
    before, began, cpu = resident(), time.perf_counter(), time.process_time()
    weights = bone_weights(points, links, taking=taking)
    size = weights.data.nbytes + weights.indices.nbytes + weights.indptr.nbytes
    row(f"weights by bone of {int(np.sum(taking))} links", began, cpu, before, size, len(points))
    return rows
