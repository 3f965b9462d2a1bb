"""Which movement gives its main result by which module."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.movement import Movement
from myomorph.lab.report.trial.answer.any_movement import any_movement
from myomorph.lab.report.trial.answer.judgement import Use
from myomorph.lab.report.trial.answer.jump import jump
from myomorph.lab.report.trial.answer.main_result import MainResult
from myomorph.lab.report.trial.answer.rise import rise
from myomorph.lab.report.trial.answer.run import run
from myomorph.lab.report.trial.answer.squat import squat
from myomorph.lab.report.trial.answer.walk import walk
from myomorph.lab.report.trial.prepared import Prepared

Maker: TypeAlias = Callable[[Prepared, Use], MainResult | None]

MAKERS: Mapping[Movement, Maker] = FrozenMap(
    {
        "walking": walk,
        "running": run,
        "jumping": jump,
        "squatting": squat,
        "rising": rise,
    }
)
"""Makers of main results; of other movements the joints that move most are the result."""


def main_result(prepared: Prepared, use: Use) -> MainResult | None:
    """Return the main result of a trial, None where no joint moves.

    Where the movement is not known, forces that show a jump and strides that show a walk tell it.
    """
    known = prepared.results.recorded.movement.value
    if known is not None:
        maker = MAKERS.get(known, any_movement)
        return maker(prepared, use) or any_movement(prepared, use)
    jumps = prepared.ground.kind == "jump"
    shown = jump(prepared, use) if jumps else walk(prepared, use)
    return shown or any_movement(prepared, use)
