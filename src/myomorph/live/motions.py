"""Motions of recordings for the live identification."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.store.settings import with_settings
from myomorph.study.subject.identifying import SubjectMotion, _surfaces, open_motions


def live_motions(
    model: Model,
    motions: Sequence[Path],
    loads: Sequence[Path],
    mass: float | None,
    time: tuple[float, float] | None,
    settings: Mapping[str, Any],
) -> list[SubjectMotion]:
    """Motions as they arrive, shown while they do, from recordings one after the other or from streams.

    Raises
    ------
    BadData : neither recordings nor streams, or nothing usable came
    """
    from myomorph.identify.online import OnlineOptions
    from myomorph.live.identification import LiveOptions, open_recording, run_live

    live = with_settings(LiveOptions(), settings)
    online = with_settings(OnlineOptions(), settings)
    surfaces = _surfaces(model)
    if live.lsl_markers or live.lsl_forces:
        result = run_live(model, mass=mass, live=live, online=online, surfaces=surfaces)
        sys.stderr.write(result.summary() + "\n")
        return [SubjectMotion("live", result.motion, result.wrenches)]
    opened = open_motions(model, motions, loads, time)
    if not opened:
        raise BadData("--live needs a recording (--motion and --loads) or streams (--lsl-markers and --lsl-forces)")
    for motion_path, loads_path in zip(motions, loads, strict=True):
        result = run_live(
            model,
            open_recording(model, motion_path, loads_path, time),
            mass=mass,
            live=live,
            online=online,
            surfaces=surfaces,
        )
        sys.stderr.write(f"{motion_path.name}: {result.summary()}\n")
    return opened
