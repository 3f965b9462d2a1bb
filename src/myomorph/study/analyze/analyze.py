"""Raw recordings to a study: protocol, axes, static trial, model, forces and EMG found, and the study file written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from myomorph.io.osim.write import write_osim
from myomorph.model.errors import BadData, BadFile, listing
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Model
from myomorph.model.segments import feet_of
from myomorph.model.series import Markers
from myomorph.motion.protocols import ProtocolTable, labels_between
from myomorph.motion.sync import cut
from myomorph.muscles.published_arms import arm_warnings
from myomorph.store.settings import ForceOptions
from myomorph.study.analyze.generic_model import generic_model
from myomorph.study.analyze.plate_cover import LASTS, uncovered_share
from myomorph.study.analyze.recordings import (
    Recording,
    bare,
    files_of,
    look_at,
    sites_of,
    standing_height,
    static_beside,
)
from myomorph.study.analyze.study_text import STEPS, StudyEntries, TrialEntry, is_unchanged, study_text
from myomorph.study.analyze.unfit_markers import unfit_markers
from myomorph.study.inputs.emg_names import muscles_of_channels
from myomorph.study.inputs.external_forces import TABLES, force_table
from myomorph.study.inputs.laboratory import AS_RECORDED
from myomorph.study.inputs.reading import cut_to, open_model

STUDY, GENERIC = "study.toml", "generic.osim"
MIN_FRAMES = 6
"""Frames in a row that derivatives need."""
MIN_MARKERS = 6
"""Fewer markers on a body's bones say too little of a motion."""
NEEDED = ("pelvis", "thigh", "shank")
OF_MUSCLES = ("muscles", "tension")
"""Steps that a model without muscles does not take."""
EMG_SAMPLES, EMG_RATE = 300, 100.0
"""Less than so many samples, or a lower rate [Hz], does not show raw EMG."""
DEAD = 0.05
"""An EMG channel whose spread is below this share of the median of all has no electrode on a muscle."""
HEIGHT_TOLERANCE = 0.1
"""A height that the markers show lies within this share of the true one."""


@dataclass(frozen=True)
class AnalyzeRequest:
    """What a user asks for.

    Attributes
    ----------
    mass, height : of the subject [kg], [m]
    static : recording of standing still
    model : None for the generic one
    table : protocols, None for those of the package
    emg_muscles : EMG channel to muscles
    emg_side : side of channels whose names contain none
    emg_mvc : recordings of maximum voluntary contractions
    command : as typed, for the study file
    draws : with errors in all inputs, None for none
    time : the part of every recording that is used [s], None for all
    loads : file of forces of the one recording, None for its plates or what lies beside it
    forces : how a table of forces is laid out, and its clock
    """

    recordings: tuple[Path, ...]
    mass: float
    height: float | None = None
    static: Path | None = None
    model: Path | None = None
    table: ProtocolTable | None = None
    emg_muscles: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: FrozenMap({}))
    emg_side: Literal["right", "left", ""] = ""
    emg_mvc: tuple[Path, ...] = ()
    command: str = "myomorph analyze"
    draws: int | None = None
    time: tuple[float, float] | None = None
    loads: Path | None = None
    forces: ForceOptions = field(default_factory=ForceOptions)


@dataclass(frozen=True)
class Prepared:
    """A study file that was written, and what it assumes.

    Attributes
    ----------
    assumed : sentences, those on all recordings first
    """

    study: Path
    assumed: tuple[str, ...]


def prepare_study(request: AnalyzeRequest, out: Path) -> Prepared:
    """Look at the recordings and write `study.toml`, and the generic model where none is given, into a folder.

    Raises
    ------
    MyomorphError
        with one line that says what is missing, and the option that supplies it
    """
    _refuse_changed(out / STUDY)
    paths, assumed = files_of(request.recordings)
    looked = [look_at(path, table=request.table) for path in paths]
    static, moving, text = _static(looked, request)
    if text:
        assumed.append(text)
    if request.loads is not None:
        moving = [_with_loads(moving, request.loads)]
    for one in moving:
        if request.model is None:
            _check_markers(one)
        assert one.trial.markers is not None
        body = one.found.sites if request.model is None else one.trial.markers.names
        _check_time(one.path, one.trial.markers, tuple(body), request.time)
    everyone = [*moving, *([static] if static is not None else [])]
    out.mkdir(parents=True, exist_ok=True)
    height, of_height = _height(static or moving[0], request.height)
    model, path, labels, of_model = _model(everyone, request, height, out)
    named = () if request.model is None else model.marker_names
    assumed = [*of_height, *assumed, *_protocols(moving, (*named, *labels)), *of_model]
    if not model.muscles:
        assumed.append(f"{path.name} has no muscles: the report ends with joint angles and torques.")
    trials = tuple(_trial(one, model, request, name) for one, name in zip(moving, _names(moving), strict=True))
    study = StudyEntries(
        out.resolve().name,
        request.command,
        path,
        request.mass,
        trials,
        None if static is None else static.path,
        AS_RECORDED if static is None or not _is_y_up(model) else static.laboratory,
        labels,
        request.emg_muscles,
        request.emg_side,
        request.emg_mvc,
        forces=request.forces,
        steps=STEPS if model.muscles else tuple(one for one in STEPS if one not in OF_MUSCLES),
        draws=request.draws,
        assumed=tuple(assumed),
    )
    target = out / STUDY
    target.write_text(study_text(study, out), encoding="utf-8")
    own = [f"{trial.name}: {text}" for trial in trials for text in trial.assumed]
    return Prepared(target, (*assumed, *own))


def _with_loads(moving: Sequence[Recording], loads: Path) -> Recording:
    """The one recording with a file of forces that is named.

    Raises
    ------
    BadData, BadFile
        where there are several recordings, or no such file
    """
    if len(moving) != 1:
        raise BadData(f"--loads {loads}: {len(moving)} recordings; name the forces of one recording at a time")
    if not loads.is_file():
        raise BadFile(loads, "does not exist", "give the forces of the recording (--loads FILE)")
    return replace(moving[0], loads=loads)


def _refuse_changed(path: Path) -> None:
    """Raise `BadData` where a study file stands that somebody has changed or written."""
    if path.is_file() and not is_unchanged(path.read_text(encoding="utf-8", errors="replace")):
        raise BadData(
            f"{path} was changed since it was written, and would be lost: run it ('myomorph run {path} --out "
            f"{path.parent}'), or give another folder (--out)"
        )


def _static(looked: list[Recording], request: AnalyzeRequest) -> tuple[Recording | None, list[Recording], str]:
    """The recording of standing still, the others, and a sentence on it."""
    if request.static is not None:
        static = look_at(request.static, table=request.table)
        moved = "" if static.still else ", although markers move in it by more than 3 cm"
        return static, looked, f"{static.path.name} is the static trial, as --static says{moved}."
    still = [one for one in looked if one.still]
    moving = [one for one in looked if not one.still]
    if still and moving:
        static = max(still, key=lambda one: len(one.found.sites))
        return static, moving, f"{static.path.name} is the static trial: nobody moves in it."
    beside = static_beside(looked[0], request.table) if moving else None
    if beside is not None:
        return beside, moving, f"{beside.path.name} beside the recording is the static trial: nobody moves in it."
    return None, looked, "There is no static trial (--static FILE): segment lengths come from the motion alone."


def _check_markers(recording: Recording) -> None:
    """Raise `BadData` where the labels that are known do not show a pelvis and a leg, and say what the markers are."""
    segments = {site.segment for site in recording.found.sites.values()}
    lacking = [name for name in NEEDED if name not in segments]
    if len(recording.found.sites) >= MIN_MARKERS and not lacking:
        return
    if not recording.found.sites and not recording.found.unknown:
        raise BadData(f"{recording.path}: holds no marker that is ever seen: give the recording of the markers")
    raise BadData(f"{recording.path}: {unfit_markers(recording.found, lacking)}")


def _check_time(path: Path, markers: Markers, labels: Sequence[str], time: tuple[float, float] | None) -> None:
    """Raise `BadData` where the part of a recording that is used is too short, or shows too few of the markers."""
    used = cut_to(time, markers, path)
    count = len(markers if used is None else cut(markers, *used))
    if count < MIN_FRAMES:
        raise BadData(
            f"{path}: holds {count} frame{'' if count == 1 else 's'}{' (--time)' if time else ''}, derivatives need "
            f"{MIN_FRAMES} in a row: give a longer recording, and this one as --static where nobody moves in it"
        )
    if time is None:
        return
    places = np.stack([markers[label] for label in labels], axis=1)
    seen = np.isfinite(places).all(axis=2).sum(axis=1) >= MIN_MARKERS
    if not seen[(markers.time >= time[0]) & (markers.time <= time[1])].any():
        known = markers.time[seen]
        where = f"seen together from {known[0]:.2f} to {known[-1]:.2f} s" if len(known) else "never seen together"
        raise BadData(
            f"{path}: from {time[0]:g} to {time[1]:g} s (--time) fewer than {MIN_MARKERS} markers of the body are "
            f"seen in any frame; they are {where}"
        )


def _protocols(moving: Sequence[Recording], of_model: Sequence[str] = ()) -> list[str]:
    """Sentences on protocols.

    Parameters
    ----------
    of_model : labels that are markers of the model that was given, whether a protocol knows them or not
    """
    texts = []
    for title in dict.fromkeys(one.found.protocol.title if one.found.protocol else "" for one in moving):
        own = [one for one in moving if (one.found.protocol.title if one.found.protocol else "") == title]
        known = own[0].found
        what = f"marker protocol {title}" if title else "no known marker protocol, but labels in common use"
        text = f"{_list([one.path.name for one in own])}: {what}; {len(known.sites)} labels lie on known landmarks"
        if title and known.common:
            text += f", {len(known.common)} of them by common names ({_list(known.common)})"
        unknown = [label for label in known.unknown if label not in of_model and bare(label) not in of_model]
        texts.append(text + (f"; not used: {_list(unknown)}." if unknown else "."))
    return texts


def _model(
    everyone: Sequence[Recording], request: AnalyzeRequest, height: float | None, out: Path
) -> tuple[Model, Path, dict[str, str], list[str]]:
    """The model, its file, what it calls markers that recordings call otherwise, and sentences on it."""
    if request.model is None:
        recorded = list(dict.fromkeys(label for one in everyone for label in one.found.sites))
        model, without = generic_model(sites_of(everyone), height, request.mass)
        path = out / GENERIC
        write_osim(model, path)
        text = (
            f"No model was given (--model FILE): myo-sim's legs and trunk with {len(model.muscles)} muscles, "
            f"{len(model.markers)} markers placed on its bones by landmark, its segments stretched to the recordings"
            f"{'' if height is None else f', from those of a body of {height:g} m'}. "
            "The arms' mass is part of the trunk's."
        )
        if without:
            text += f" Without a place on it: {_list(without)}."
        return model, path, {label: bare(label) for label in recorded if bare(label) != label}, [text]
    model = open_model(request.model)
    names = model.marker_names
    # A model may have markers that no protocol knows.
    recorded = list(dict.fromkeys(label for one in everyone for label in (*one.found.sites, *one.found.unknown)))
    labels = {label: bare(label) for label in recorded if bare(label) != label and bare(label) in names}
    rest = [label for label in recorded if label not in labels]
    labels |= {
        old: new for old, new in labels_between(rest, names, request.table).items() if new not in labels.values()
    }
    known = [label for label in recorded if label in names or label in labels]
    if len(known) < MIN_MARKERS:
        raise BadData(
            f"{request.model}: {len(known)} of its {len(names)} markers are in the recordings, which have "
            f"{listing('', recorded)}: give a model with such markers, or leave --model out for the generic one"
        )
    texts = [f"{len(known)} labels are markers of {request.model.name}."]
    if labels:
        shown = _list([f"{old} as {new}" for old, new in labels.items()])
        texts.append(f"{len(labels)} labels lie on the landmark of a marker of another name: {shown}.")
    texts += [f"{request.model.name}: {line}." for line in arm_warnings(model)]
    return model, request.model, labels, texts


def _is_y_up(model: Model) -> bool:
    return bool(model.gravity[1] < 0.0)


def _height(recording: Recording, height: float | None) -> tuple[float | None, list[str]]:
    """The height that the generic model begins with [m], None for its own; and a sentence on what markers show."""
    if height is None:
        return None, []
    found = standing_height(recording)
    if found is None:
        return height, [
            f"--height {height:g} m could not be held against the markers: none are on shoulders and ankles."
        ]
    apart = found / height - 1.0
    shown = (
        f"the markers of {recording.path.name} show a body of about {found:.2f} m, {100.0 * apart:+.0f} % of --height"
    )
    if abs(apart) < HEIGHT_TOLERANCE:
        return height, [f"Height {height:g} m (--height): {shown}."]
    return None, [f"WARNING: {shown} {height:g} m, which is not used: is the unit right, and are they of this person?"]


def _trial(recording: Recording, model: Model, request: AnalyzeRequest, name: str) -> TrialEntry:
    """What the study file says of a recording."""
    texts = []
    laboratory = recording.laboratory if _is_y_up(model) else AS_RECORDED
    if laboratory.up:
        texts.append(
            f"{laboratory.up} points up in the laboratory, for {recording.why_up}: turned to the model's y axis."
        )
    if laboratory.turn:
        texts.append(f"Turned by {laboratory.turn:g}° about the vertical, for {recording.why_turn}.")
    emg, dead, said = _emg(recording, model, request)
    texts += said
    plates = recording.trial.plates
    contacts, loads = "", recording.loads
    if recording.loads is not None:
        texts.append(f"External forces from {recording.loads.name}.")
        if recording.loads.suffix.lower() in TABLES:
            notes = force_table(recording.loads, None, request.forces).notes
            texts += [f"{recording.loads.name}: {text}." for text in notes]
    elif plates and feet_of(model):
        texts.append(f"External forces of {len(plates)} plate{'s' if len(plates) > 1 else ''} of the recording.")
        # Named, so that a file of forces beside the recording is not taken for them.
        loads = recording.path
    elif feet_of(model):
        contacts = "auto"
        texts.append("No force was measured: forces under the feet are estimated from the motion.")
    if loads is not None and feet_of(model):
        weight = request.mass * float(np.linalg.norm(model.gravity))
        bare_share = uncovered_share(recording, weight, request.forces)
        if bare_share > LASTS:
            contacts = "auto"
            texts.append(
                f"In {100.0 * bare_share:.0f} % of the frames a foot is on the ground and plates carry less than "
                "half the weight (a foot beside them, a seat): muscle tensions estimate forces under feet that nobody "
                "measured; torques of inverse dynamics are wrong there."
            )
    return TrialEntry(name, recording.path, laboratory, loads, emg, contacts, dead, request.time, tuple(texts))


def _emg(recording: Recording, model: Model, request: AnalyzeRequest) -> tuple[Path | None, tuple[str, ...], list[str]]:
    """The file of EMG of a recording, its channels without a signal, and sentences on them."""
    if recording.emg is not None:
        return recording.emg, (), [f"EMG from {recording.emg.name}."]
    analog = recording.trial.analog
    if analog is None:
        return None, (), []
    given = request.emg_muscles
    used = muscles_of_channels(analog.names, model, request.emg_side) | {
        name: muscles for name, muscles in given.items() if name in analog.names
    }
    spread = {name: float(np.nanstd(analog[name])) for name in used}
    alive = [name for name in used if spread[name] > DEAD * float(np.median([*spread.values()]))]
    sideless = [] if request.emg_side else list(muscles_of_channels(analog.names, model, "right"))
    lost = [name for name in sideless if name not in used]
    texts = []
    if alive and (len(analog) < EMG_SAMPLES or analog.rate < EMG_RATE):
        return (
            None,
            (),
            [f"EMG of {len(analog)} samples at {analog.rate:.0f} Hz is too little for envelopes: not used."],
        )
    if alive:
        texts.append(f"EMG of {len(alive)} analog channels: {_list(alive)}.")
    dead = tuple(name for name in used if name not in alive)
    if dead:
        texts.append(f"Analog channels without a signal, which take no part: {_list(dead)}.")
    if lost:
        texts.append(f"EMG without a side in its name is not used: {_list(lost)} (--emg-side left or right).")
    return (recording.path, dead, texts) if alive else (None, (), texts)


def _names(recordings: Sequence[Recording]) -> list[str]:
    """Names of trials: those of the files, and of their folders where these say nothing or are alike."""
    names = [one.name for one in recordings]
    result = []
    for recording, name in zip(recordings, names, strict=True):
        plain = name.lower() in ("markers", "marker", "motion", "motion_capture")
        parent = recording.path.resolve().parent.name
        result.append(parent if plain and parent else f"{parent}_{name}" if names.count(name) > 1 else name)
    return result


def _list(names: Sequence[str], count: int = 8) -> str:
    """Names in a row, the first ones."""
    more = f" and {len(names) - count} more" if len(names) > count else ""
    return ", ".join(names[:count]) + more
