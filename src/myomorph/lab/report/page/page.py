"""The HTML around sections, tiles and verdicts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.resources import files
from typing import get_args

from jinja2 import Environment, FunctionLoader, StrictUndefined

from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.page.parts import Link, Note, PageHead, Reference, Section, State, Verdict
from myomorph.lab.report.scene.pictures import Picture

_KINDS = {"real": "Measured", "assumed": "Assumed", "simulated": "Simulated", "warning": "Note"}


@dataclass(frozen=True)
class Instant:
    """The body at one time: label and pictures from the side and the front."""

    label: str
    side: Picture
    front: Picture


@dataclass(frozen=True)
class Tile:
    """One number of the summary: value, what it is, whether it is within its limit."""

    value: str
    name: str
    state: str


@dataclass(frozen=True, kw_only=True)
class Summary:
    """What a page shows besides its sections.

    Attributes
    ----------
    facts : names and values at the head
    tiles : quantities at the head
    verdicts : quantities held against limits
    missing : sections that the results do not allow
    instants : pictures of the body
    motion : the moving skeleton
    muscles_colored : whether the pictures show activations
    arrows : the kind of forces that they show, "" where none
    pages : further ones beside this one
    first : what the page begins with (`answer.html.j2`), and under which its sections are folded;
        without it the head, facts and tiles stand first, and sections are open
    """

    facts: Sequence[tuple[str, str]] = ()
    tiles: Sequence[Tile] = ()
    verdicts: Sequence[Verdict] = ()
    missing: Sequence[str] = ()
    instants: Sequence[Instant] = ()
    motion: str = ""
    muscles_colored: bool = False
    arrows: str = ""
    pages: Sequence[Link] = ()
    first: object | None = None


def rendered(
    head: PageHead,
    sections: Sequence[Section],
    references: Sequence[Reference],
    summary: Summary | None = None,
) -> str:
    """Render the page of given sections as HTML text.

    Parameters
    ----------
    head : title, notes, warnings and provenance
    sections : figures and tables
    references : sources
    summary : what stands around the sections
    """
    summary = summary or Summary()
    verdicts = summary.verdicts
    # What is over its limit first.
    ordered = [
        _printed(verdict)
        for state in get_args(State)
        for verdict in verdicts
        if verdict.state == state
    ]
    over = sum(1 for verdict in verdicts if verdict.state == "over")
    judged = sum(1 for verdict in verdicts if verdict.limit is not None)
    return page_text(
        "report.html.j2",
        head=replace(head, notes=_simulated_first(head.notes)),
        date=_date(head.date),
        script=_text("report.js"),
        facts=summary.facts,
        tiles=summary.tiles,
        kinds=_KINDS,
        verdicts=ordered,
        over=over,
        judged=judged,
        sections=sections,
        missing=summary.missing,
        instants=summary.instants,
        motion=summary.motion,
        muscles_colored=summary.muscles_colored,
        arrows=summary.arrows,
        references=references,
        pages=summary.pages,
        first=summary.first,
        checks_note=_checks_note(verdicts, judged, over),
    )


def _simulated_first(notes: Iterable[Note]) -> tuple[Note, ...]:
    """Order notes so that a page of simulated data does not begin with what was measured."""
    return tuple(sorted(notes, key=lambda note: note.kind != "simulated"))


def _checks_note(verdicts: Sequence[Verdict], judged: int, over: int) -> str:
    """How many checks passed, and which one is furthest over its limit."""
    if not over:
        return f"{judged}, all passed"
    failed = [verdict for verdict in verdicts if verdict.state == "over" and verdict.limit]
    worst = max(failed, key=lambda verdict: verdict.value / (verdict.limit or 1.0), default=None)
    counts = f"{judged}, {over} to be checked"
    if worst is None or worst.limit is None:
        return counts
    times = number(worst.value / worst.limit, 1.0)
    return f"{counts}; worst: {worst.quantity.lower()}, {times} times its limit"


def page_text(template: str, **values: object) -> str:
    """Render a template of the room with the style of all pages, as HTML text."""
    environment = Environment(
        loader=FunctionLoader(_text),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    style = _text("report.css") + _text("answer.css")
    return environment.get_template(template).render(style=style, **values)


def _date(text: str) -> str:
    """Write a date of a clock (ISO 8601) to the minute; any other text as it is."""
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        return text
    if len(text) <= len("2026-01-02"):
        return text
    zone = "" if when.tzinfo is None else " UTC"
    return (when if when.tzinfo is None else when.astimezone(UTC)).strftime("%Y-%m-%d %H:%M") + zone


def _text(name: str) -> str:
    return (files("myomorph.lab.report") / "templates" / name).read_text(encoding="utf-8")


def _printed(verdict: Verdict) -> dict[str, str]:
    """Write a verdict as text, by the names that the template has."""
    limit = "none agreed" if verdict.limit is None else "0"
    if verdict.limit:
        unit = "%" if "%" in verdict.unit else verdict.unit
        limit = f"{number(verdict.limit)} {unit}"
    whole = (
        verdict.value == int(verdict.value) and "%" not in verdict.unit and "cm" not in verdict.unit
    )
    value = number(verdict.value, 1.0) if whole else number(verdict.value)
    time = "" if verdict.time is None else f"{number(verdict.time, 0.001)} s"
    return {
        **{
            name: getattr(verdict, name)
            for name in ("quantity", "state", "worst", "source", "detail")
        },
        **{"value": f"{value} {verdict.unit}".strip(), "limit": limit, "time": time},
    }
