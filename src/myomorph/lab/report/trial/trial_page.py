"""The report: one HTML text that needs nothing else, from everything a trial produced."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.known import Known
from myomorph.core.model.movement import Movement
from myomorph.core.model.series import Motion
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.pictures import nearest_frames
from myomorph.lab.report.page.page import Instant, Summary, Tile, rendered
from myomorph.lab.report.page.parts import Link, Quantity, State, listed
from myomorph.lab.report.scene.pictures import frames_to_play, pictures, player, proportion
from myomorph.lab.report.scene.scene import Acting, Scene, make_scene
from myomorph.lab.report.trial.answer.answer import Answer, answer_of
from myomorph.lab.report.trial.answer.first_screen import first_screen
from myomorph.lab.report.trial.estimated_forces import acting_forces
from myomorph.lab.report.trial.gait.gait_page import GAIT_PAGE
from myomorph.lab.report.trial.movement.movement_section import KEY, SOURCES, movement_section
from myomorph.lab.report.trial.prepared import Prepared, prepare
from myomorph.lab.report.trial.report_input import ReportInput
from myomorph.lab.report.trial.sections import sections

# References.
ANALYSIS = frozenset({"experts", "bartlett1946", "mcleod2005", "bartlett1935", "benjamini1995"})
KEY_INSTANTS = 6
FEW_INSTANTS = 3
WIDE = 1.2


def report_page(results: ReportInput) -> str:
    """Render one self-contained HTML page: no network, every style, script and picture inside.

    A section appears where its part is there; what is absent has a sentence each. The page works
    without scripts. With them, values are read under the pointer and the skeleton plays.
    """
    return prepared_page(prepare(results))


def prepared_page(prepared: Prepared, answer: Answer | None = None) -> str:
    """Return the page of what was prepared already, and answered where that was done too."""
    results = prepared.results
    answer = answer or answer_of(prepared)
    parts, missing = sections(prepared)
    leading = movement_section(prepared, answer.judgement.use)
    if leading is not None:
        parts = [leading, *parts]
    instants, motion = _body(prepared)
    forces = "ground" if results.contacts.forces is None else "estimated contact"
    return rendered(
        results.head,
        parts,
        listed(_cited(prepared, [part.key for part in parts])),
        Summary(
            facts=_facts(prepared),
            tiles=_tiles(prepared),
            verdicts=prepared.verdicts,
            missing=missing,
            instants=instants,
            motion=motion,
            muscles_colored=results.tension is not None,
            arrows="" if acting_forces(results) is None else forces,
            pages=() if prepared.gait is None else (Link("Gait on one page", GAIT_PAGE),),
            first=None if answer.result is None else first_screen(prepared, answer),
        ),
    )


def _cited(prepared: Prepared, sections_shown: Sequence[str]) -> set[str]:
    """Return the keys of the references of what a page shows, with its sections by their keys."""
    results = prepared.results
    steps = (
        (results.kinematics.fit, ("lu1999",)),
        (results.dynamics.torques, ("featherstone2008", "woltring1986")),
        (results.tension, ("crowninshield1981", "millard2013")),
    )
    cited = {key for part, keys in steps if part is not None for key in keys}
    if cited or results.identification is None:
        cited |= {"hicks2015", "opensim"}
    if results.identification is not None:
        cited |= {"dissertation", "ayusawa2014", "ae1992", "wensing2018"}
    if prepared.ground.kind == "jump":
        cited |= {"owen2014", "mcmahon2018"}
    if "analysis" in sections_shown:
        cited |= ANALYSIS
    recorded = prepared.recorded_movement
    if KEY in sections_shown and recorded is not None:
        cited |= set(SOURCES[recorded.movement])
    return cited


def _facts(prepared: Prepared) -> list[tuple[str, str]]:
    """Lines of the heading: name and text."""
    results = prepared.results
    rows = [("Subject", results.recorded.subject)] if results.recorded.subject else []
    rows += [("Recorded", results.recorded.date)] if results.recorded.date else []
    rows += _movement(prepared)
    rows += list(results.recorded.facts.items())
    if results.model is not None:
        model = results.model
        text = f"{model.name}: {len(model.bodies)} bodies, {len(model.coordinates)} coordinates"
        text += f", {len(model.muscles)} muscles" if model.muscles else ""
        rows.append(("Model", f"{text}, {number(model.mass)} kg"))
    motion = results.kinematics.motion
    for name, series in (
        ("Motion", motion),
        ("Markers", results.kinematics.markers),
        ("Forces", results.dynamics.wrenches),
        ("EMG", results.recorded.emg),
    ):
        if series is not None and len(series.time) > 1:
            # The rate of a long clock is its mean; times are often rounded to a millisecond.
            first = float(series.time[0])
            last = float(series.time[-1])
            text = (
                f"{number(len(series.time), 1.0)} frames at"
                f" {number((len(series.time) - 1) / (last - first))} Hz, "
            )
            rows.append((name, f"{text}{number(first, 0.01)} to {number(last, 0.01)}\u00a0s"))
    return rows


def _movement(prepared: Prepared) -> list[tuple[str, str]]:
    """Which movement it is, how that is known, and what forces show of it."""
    movement = prepared.results.recorded.movement
    texts = [] if movement.value is None else [_by_whom(movement)]
    kind = prepared.ground.kind
    if kind:
        words = {
            "gait": "gait",
            "jump": "countermovement jump",
            "contact": "contacts with the ground",
        }
        texts.append(f"{words.get(kind, kind)}, {len(prepared.events)} events")
    return [("Movement", "; ".join(texts))] if texts else []


def _by_whom(movement: Known[Movement]) -> str:
    """Name the movement with what shows it, or say that the study file states it."""
    if movement.origin == "user":
        return f"{movement} (study file)"
    return f"{movement} ({movement.sentence})" if movement.sentence else str(movement)


OF_MARKERS = (Quantity.MARKER_RMS, Quantity.MARKER_LARGEST)
"""Checks of what the tile of markers says: it is not green while one of them is over its limit."""


def _tiles(prepared: Prepared) -> list[Tile]:
    """Choose the few numbers to see first."""
    results = prepared.results
    tiles = []
    fit = results.kinematics.fit
    if fit is not None and np.isfinite(fit.marker_error).any():
        rms = 100 * float(np.sqrt(np.nanmean(fit.marker_error**2)))
        tiles.append(Tile(f"{number(rms)} cm", "marker error, RMS", _state(prepared, *OF_MARKERS)))
        done = int(np.sum(fit.converged))
        shown = int(np.sum(fit.seen))
        tiles.append(
            Tile(f"{done} / {shown}", "frames fitted", _state(prepared, Quantity.NOT_CONVERGED))
        )
    for quantity, name in (
        (Quantity.RESIDUAL_FORCE_PEAK, "residual force, of peak external force"),
        (Quantity.RESIDUAL_MOMENT_PEAK, "residual moment, of COM height × force"),
        (Quantity.RESERVES, "largest reserve, of its peak torque"),
    ):
        matching = (verdict for verdict in prepared.verdicts if verdict.quantity == quantity)
        tiles += [Tile(f"{number(verdict.value)} %", name, verdict.state) for verdict in matching]
    if results.tension is not None:
        solved = int(np.sum(results.tension.optimal))
        state = _state(prepared, Quantity.NOT_OPTIMAL)
        asked = len(results.tension.time[results.tension.asked])
        tiles.append(Tile(f"{solved} / {asked}", "frames optimal", state))
        full = next(
            verdict for verdict in prepared.verdicts if verdict.quantity == Quantity.SATURATED
        )
        tiles.append(Tile(f"{int(full.value)} {full.unit}", "muscles saturated", full.state))
    return tiles


def _state(prepared: Prepared, *quantities: Quantity) -> str:
    """Return the worst state of some checks, "note" where none was made."""
    states = {verdict.state for verdict in prepared.verdicts if verdict.quantity in quantities}
    return next((state for state in get_args(State) if state in states), "note")


def _body(prepared: Prepared) -> tuple[list[Instant], str]:
    """Pictures at key instants, and the moving skeleton; empty without a model and a motion."""
    results = prepared.results
    model = results.model
    motion = results.kinematics.motion
    if model is None or motion is None or not model.bodies:
        return [], ""
    good = np.flatnonzero(np.isfinite(motion.values).all(axis=1))
    if not len(good):
        return [], ""
    acting = Acting(results.activations, acting_forces(results))
    chosen = _key_frames(motion, good, prepared)
    still = make_scene(model, motion, [frame for frame, _ in chosen], results.surfaces, acting)
    if proportion(still, "side") > WIDE:
        chosen = chosen[:: -(-len(chosen) // FEW_INSTANTS)]
        still = make_scene(model, motion, [frame for frame, _ in chosen], results.surfaces, acting)
    points = sum(len(muscle.path.points) for muscle in model.muscles)
    count = frames_to_play(len(good), points, len(model.bodies))
    first, last = np.searchsorted(motion.time[good], prepared.played)
    played = good[first : max(last, first) + 1]
    moving = played[np.unique(np.linspace(0, len(played) - 1, count).round().astype(np.int64))]
    scene = make_scene(model, motion, [int(i) for i in moving], results.surfaces, acting)
    return _instants(still, chosen, motion.time), player(scene)


def _instants(still: Scene, chosen: Sequence[tuple[int, str]], time: Array) -> list[Instant]:
    """Pictures of a scene from the side and from the front, with label and time of each frame."""
    drawn = pictures(still)
    sides = drawn[: len(chosen)]
    fronts = drawn[len(chosen) :]
    instants = []
    for (frame, label), side, front in zip(chosen, sides, fronts, strict=True):
        words = (label, f"{number(float(time[frame]), 0.001)} s")
        instants.append(Instant(", ".join(word for word in words if word), side, front))
    return instants


def _key_frames(motion: Motion, good: np.ndarray, prepared: Prepared) -> list[tuple[int, str]]:
    """Choose frames to show, with their labels.

    They are those at requested times, those at events where there are some, else evenly spread
    ones.
    """
    if prepared.results.analysis.times:
        return [
            (frame, "")
            for frame in nearest_frames(motion.time, good, prepared.results.analysis.times)
        ]
    first, last = np.searchsorted(motion.time[good], prepared.detail)
    good = good[first : max(last, first) + 1]
    time = motion.time[good]
    inside = [event for event in prepared.events if time[0] <= event.time <= time[-1]]
    frames = [int(good[int(np.argmin(np.abs(time - event.time)))]) for event in inside]
    marked = list(
        zip(
            frames,
            (f"{event.side} {event.label}".strip().capitalize() for event in inside),
            strict=True,
        )
    )
    marked = [mark for i, mark in enumerate(marked) if i == 0 or mark[0] != marked[i - 1][0]]
    if len(marked) > KEY_INSTANTS:
        # Neighbouring events of one cycle tell more than single ones far apart.
        start = max(0, (len(marked) - KEY_INSTANTS) // 2)
        marked = marked[start : start + KEY_INSTANTS]
    if marked:
        return marked
    count = min(KEY_INSTANTS, len(good))
    return [
        (int(good[i]), "")
        for i in np.unique(np.linspace(0, len(good) - 1, count).round().astype(np.int64))
    ]
