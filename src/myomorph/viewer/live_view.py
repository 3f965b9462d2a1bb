"""What a subject sees while identification goes on: progress, the body, what to move next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from myomorph.analysis.segment_words import plain_words, segment_words
from myomorph.identify.online import OnlineState
from myomorph.model.arrays import Array
from myomorph.model.segments import SEGMENTS, Segment
from myomorph.model.sides import split_side
from myomorph.report.charts.axis import number
from myomorph.report.scene.image import level_color

BAR = 18
"""Characters of a bar."""


@dataclass(frozen=True)
class Clock:
    """How far a live session is: time in the recording, its length where known, and how late it is shown [s]."""

    now: float
    duration: float | None = None
    late: float = 0.0


def segment_levels(
    names: tuple[str, ...], segments: Mapping[str, Segment], levels: Array
) -> dict[str, dict[str, float]]:
    """Mean level of the links of every segment by side: {"thigh": {"right": 0.8, "left": 0.7}, ...}, from the head."""
    found: dict[str, dict[str, list[float]]] = {}
    for name, level in zip(names, levels, strict=True):
        if name in segments and np.isfinite(level):
            one = segments[name]
            found.setdefault(one.name, {}).setdefault(one.side, []).append(float(level))
    order = [*(name for name in SEGMENTS if name in found), *(name for name in found if name not in SEGMENTS)]
    return {plain_words(name): {side: float(np.mean(one)) for side, one in found[name].items()} for name in order}


def move_next(state: OnlineState, segments: Mapping[str, Segment]) -> str:
    """The movement that would show most: "left forearm (elbow flexion)"; "" where nothing would."""
    if not state.proposals:
        return ""
    best = state.proposals[0]
    joint = split_side(best.coordinate)[0].replace("_", " ")
    where = segment_words(segments[best.body]) if best.body in segments else best.body
    return f"{where} ({joint})"


def live_panel(
    state: OnlineState, names: tuple[str, ...], segments: Mapping[str, Segment], at: Clock, body: Text | None = None
) -> RenderableType:
    """Everything for a terminal.

    Parameters
    ----------
    names : of the bodies
    segments : of the bodies
    body : the body drawn in characters
    """
    facts = Table.grid(padding=(0, 2))
    facts.add_column(style="dim", no_wrap=True)
    facts.add_column()
    facts.add_row("Progress", _bar(state.fit.progress))
    facts.add_row("Frames", _frames(state))
    facts.add_row("Parameters", _shown(state))
    moment, force = state.fit.innovation_rms[:3], state.fit.innovation_rms[3:]
    facts.add_row("Wrench error", f"{_rms(force)} N, {_rms(moment)} N·m")
    told = move_next(state, segments)
    facts.add_row("Move next", Text(told or "anything", style="bold"))
    grid = Table.grid(padding=(0, 2))
    for words, sides in segment_levels(names, segments, state.levels).items():
        bars = {side: Text.assemble((f"{side:>6}", "dim"), " ", _bar(level)) for side, level in sides.items()}
        if "" in bars:
            grid.add_row(words.capitalize(), bars[""])
        if "right" in bars or "left" in bars:
            grid.add_row(words.capitalize(), *(bars.get(side, Text()) for side in ("right", "left")))
    right: RenderableType = Group(facts, Text(), grid)
    both = Table.grid(padding=(0, 3))
    both.add_row(*([body, right] if body is not None else [right]))
    title = f"Identification, {at.now:.1f} s" + (f" of {at.duration:.1f} s" if at.duration else "")
    title += f", {at.late:.1f} s late" if at.late > 0.5 else ""
    return Panel(both, title=title, title_align="left", border_style="dim")


def _bar(level: float) -> Text:
    """A bar in the color of its level, and the level in percent."""
    filled = round(BAR * min(max(level, 0.0), 1.0))
    r, g, b = (int(255 * one) for one in level_color(np.array([level]))[0])
    text = Text("█" * filled, style=f"rgb({r},{g},{b})")
    text.append("░" * (BAR - filled), "dim")
    return text.append(f" {100 * level:3.0f} %", "default")


def _frames(state: OnlineState) -> str:
    told = f"{state.fit.frames} used of {state.frames}"
    reasons = ", ".join(f"{count} {reason.split(':')[0].split(',')[0]}" for reason, count in state.left_out.items())
    return f"{told}; left out: {reasons}" if reasons else told


def _shown(state: OnlineState) -> str:
    fit = state.fit
    told = f"{fit.rank} of {len(fit.estimate)} shown"
    return f"{told}, condition number {number(fit.condition)}" if np.isfinite(fit.condition) else told


def _rms(errors: Array) -> str:
    return number(float(np.linalg.norm(errors)))


def live_markdown(state: OnlineState, names: tuple[str, ...], segments: Mapping[str, Segment], at: Clock) -> str:
    """The same as text for a web page."""
    moment, force = state.fit.innovation_rms[:3], state.fit.innovation_rms[3:]
    lines = [
        f"**Move next: {move_next(state, segments) or 'anything'}**",
        "",
        f"{at.now:.1f} s" + (f" of {at.duration:.1f} s" if at.duration else ""),
        "",
        f"{_frames(state)}",
        "",
        _shown(state).capitalize(),
        "",
        f"Error of the predicted wrench {_rms(force)} N, {_rms(moment)} N·m",
        "",
        "| Segment | identified |",
        "|---|---|",
    ]
    for words, sides in segment_levels(names, segments, state.levels).items():
        lines += [f"| {f'{side} {words}'.strip()} | {100 * level:.0f} % |" for side, level in sides.items()]
    return "\n".join(lines)
