"""Request of `analyze`, and what is done with each recording: axes, forces and EMG found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from myomorph.core.model.errors import BadFile, counted, few
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import Analog
from myomorph.core.motion.protocols import ProtocolTable, protocol_table, protocols
from myomorph.lab.analysis.arm_labels import is_arm
from myomorph.lab.session.plate_cover import LASTS, SHARED, shared_time, uncovered_share
from myomorph.lab.session.recordings import Recording, bare
from myomorph.lab.session.sensor_recordings import placed_sensors
from myomorph.lab.session.statements import StatedPerson, Statements
from myomorph.lab.store.settings import ForceOptions, with_settings
from myomorph.lab.study.inputs.contacts import ContactsFile
from myomorph.lab.study.inputs.emg import EmgFiles
from myomorph.lab.study.inputs.emg_names import muscles_of_channels
from myomorph.lab.study.inputs.external_forces import force_table
from myomorph.lab.study.inputs.imu import ImuFiles
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.inputs.laboratory import AS_RECORDED, Laboratory
from myomorph.lab.study.inputs.loads import TABLES, LoadsFile
from myomorph.lab.study.inputs.markers import MarkersFile
from myomorph.lab.study.inputs.person import RecordedPerson
from myomorph.lab.study.inputs.time_span import TimeSpan
from myomorph.lab.study.trial.trial_inputs import Settings, TrialFiles

EMG_SAMPLES = 300
EMG_RATE = 100.0  # Less than so many samples, or a lower rate [Hz], does not show raw EMG.
# An EMG channel whose spread is below this share of the median of all has no electrode on a muscle.
DEAD = 0.05


def read_protocols(path: Path) -> ProtocolTable:
    """Read a table of protocols in TOML, beside those of the package.

    Parameters
    ----------
    path : of the table

    Raises
    ------
    BadFile, BadData : it cannot be read, or is wrong
    """
    try:
        text = path.read_text("utf-8")
    except OSError as error:
        raise BadFile(
            path, f"cannot be read ({error.strerror or error})", "give a table of protocols (.toml)"
        ) from None
    except UnicodeDecodeError:
        raise BadFile(path, "is not text", "give a table of protocols (.toml)") from None
    return protocol_table(text, str(path), protocols())


@dataclass(frozen=True)
class AnalyzeRequest:
    """What a user asks for.

    Attributes
    ----------
    mass, height : of the subject [kg], [m]; without a mass, plates weigh the subject
    static : recording of standing still
    model : None for the generic one
    arms : the generic one with arms, where markers show how they move
    table : protocols, None for those of the package
    inputs : settings of inputs, which go before what is found
    options : settings of the steps
    command : as typed, for the study file
    statements : what the user says of single recordings and people
    """

    recordings: tuple[Path, ...]
    mass: float | None = None
    height: float | None = None
    static: Path | None = None
    model: Path | None = None
    arms: bool = False
    table: ProtocolTable | None = None
    inputs: ByType = field(default_factory=ByType)
    options: Settings = field(default_factory=lambda: FrozenMap({}))
    command: str = "myomorph analyze"
    statements: Statements = field(default_factory=Statements)

    def of_person(self, name: str) -> AnalyzeRequest:
        """Request for the recordings of one person, with what is stated of this person."""
        stated = self.statements.people.get(name, StatedPerson())
        body = self.inputs.or_default(RecordedPerson)
        if stated.age is not None:
            body = replace(body, age=stated.age)
        return replace(
            self,
            inputs=self.inputs.having(body),
            mass=self.mass if stated.mass is None else stated.mass,
            height=self.height if stated.height is None else stated.height,
            static=self.static if stated.static is None else stated.static,
        )

    @property
    def time(self) -> tuple[float, float] | None:
        """The part of every recording that is used [s], None for all."""
        return self.inputs.or_default(TimeSpan).time

    @property
    def forces(self) -> ForceOptions:
        """How a table of forces is laid out, and its clock."""
        return with_settings(ForceOptions(), self.options.get("id", {}))


def laboratory_of(recording: Recording, model: Model, request: AnalyzeRequest) -> Laboratory:
    """Choose the axes that a user names, else those that the recording shows.

    For a model whose y is not up they are as recorded.
    """
    named = request.inputs.get(Laboratory) or recording.laboratory
    return named if model.gravity[1] < 0.0 else AS_RECORDED


def recorded_trial(
    recording: Recording, files: TrialFiles, model: Model, request: AnalyzeRequest
) -> tuple[TrialFiles, list[str]]:
    """Make a trial of a recording, with what was found beside it and in it; and sentences."""
    texts: list[str] = []
    alone = recording.trial.markers is None
    if recording.sensors is not None:
        imu, texts = placed_sensors(
            recording.sensors, recording.sensor_files, model, files.get(ImuFiles), alone
        )
        files = files.having(imu)
    laboratory = laboratory_of(recording, model, request)
    texts += _axes_sentences(recording, laboratory)
    if recording.shown_still(request.time):
        texts.append("No movement: angles, torques and tensions are those of one pose.")
    emg, of_emg = _emg(recording, model, files.get(EmgFiles))
    texts += of_emg
    if request.statements.of(recording.path).plates:
        measured = _measured_forces(recording, files.get(LoadsFile), model, request)
    else:
        measured = _without_plates(recording, files.get(LoadsFile), model)
    contacts, of_contacts = _contacts(recording, files.get(ContactsFile), measured, model, request)
    texts += (*measured.sentences, *of_contacts)
    if alone:
        return files.having(measured.loads, emg, contacts), texts
    markers = MarkersFile(recording.path)
    return files.having(markers, laboratory, measured.loads, emg, contacts), texts


def _axes_sentences(recording: Recording, laboratory: Laboratory) -> list[str]:
    """Say how a recording is turned, where its own axes are used."""
    if laboratory is not recording.laboratory:
        return []
    texts = []
    if laboratory.up:
        why = recording.why_up
        texts.append(
            f"{laboratory.up} points up in the laboratory, because {why}: rotated to the model's y"
            " axis."
        )
    if laboratory.turn:
        texts.append(
            f"Turned by {laboratory.turn:g}° about the vertical, because {recording.why_turn}."
        )
    return texts


@dataclass(frozen=True, kw_only=True)
class MeasuredForces:
    """External forces of a recording.

    Attributes
    ----------
    loads : where they come from
    feet : names of the model's feet that they may act on, () where nothing shows the feet
    found : there are any that act
    sentences : on them
    """

    loads: LoadsFile
    feet: tuple[str, ...]
    found: bool = False
    sentences: tuple[str, ...] = ()


def _without_plates(recording: Recording, loads: LoadsFile, model: Model) -> MeasuredForces:
    """Leave out the plates of a recording, as a user says."""
    unused = replace(loads, plates=("none",) * len(recording.trial.plates))
    text = "Forces of plates are not used, as stated."
    return MeasuredForces(loads=unused, feet=feet_of(model), sentences=(text,))


def _measured_forces(
    recording: Recording, loads: LoadsFile, model: Model, request: AnalyzeRequest
) -> MeasuredForces:
    """Take forces of a table beside the recording, else of plates, where markers show feet."""
    plates = recording.trial.plates
    path = recording.near.get("loads")
    feet = feet_of(model)
    if recording.trial.markers is None:
        if not plates and path is None:
            return MeasuredForces(loads=loads, feet=feet)
        text = "Forces of plates are not used: sensors do not show where on them the feet are."
        return MeasuredForces(loads=loads, feet=feet, sentences=(text,))
    texts = []
    if request.model is None and is_arm(recording.found):
        feet = ()
        if plates and not loads.plates:
            loads = replace(loads, plates=("none",) * len(plates))
            texts.append(
                "Forces of plates are not used: no marker shows where on them the feet are."
            )
    if path is not None:
        loads = replace(loads, loads=path)
        texts += _table_sentences(path, request)
    elif plates and feet:
        texts.append(f"External forces of {counted(len(plates), 'plate')} of the recording.")
        # Named, so that a file of forces beside the recording is not taken for them.
        loads = replace(loads, loads=recording.path)
    found = path is not None or bool(plates and feet)
    return MeasuredForces(loads=loads, feet=feet, found=found, sentences=tuple(texts))


def _table_sentences(path: Path, request: AnalyzeRequest) -> list[str]:
    """Sentences on a file of forces."""
    texts = [f"External forces from {path.name}."]
    if path.suffix.lower() in TABLES:
        notes = force_table(path, None, request.forces).notes
        texts += [f"{path.name}: {text}." for text in notes]
    return texts


def _contacts(
    recording: Recording,
    contacts: ContactsFile,
    measured: MeasuredForces,
    model: Model,
    request: AnalyzeRequest,
) -> tuple[ContactsFile, list[str]]:
    """Contacts that are estimated because nobody measured their forces, and sentences on them."""
    if not measured.feet or contacts.contacts:
        return contacts, []
    if not measured.found:
        text = "No force was measured: forces under the feet are estimated from the motion."
        return replace(contacts, contacts="auto"), [text]
    assert request.mass is not None
    weight = request.mass * float(np.linalg.norm(model.gravity))
    texts = []
    shared = shared_time(recording, weight, request.forces)
    if shared > SHARED and contacts.measured is None:
        contacts = ContactsFile("auto", "shared")
        texts.append(
            f"Two feet share a plate for {shared:.2f} s: muscle tensions divide its force"
            " between them as motion and effort allow (--measured exact: one foot's); torques"
            " of inverse dynamics have it on one foot."
        )
    bare_share = uncovered_share(recording, weight, request.forces)
    if bare_share > LASTS:
        contacts = replace(contacts, contacts="auto")
        texts.append(
            f"In {100.0 * bare_share:.0f} % of the frames a foot is on the ground and plates"
            " carry less than half the weight (a foot beside them, a seat): muscle tensions"
            " estimate forces under feet that nobody measured; torques of inverse dynamics are"
            " wrong there."
        )
    return contacts, texts


def _emg(recording: Recording, model: Model, asked: EmgFiles) -> tuple[EmgFiles, list[str]]:
    """EMG of a recording, its channels without a signal on no muscle, and sentences on them."""
    path = asked.emg or recording.near.get("emg")
    if path is not None:
        return replace(asked, emg=path), [f"EMG from {path.name}."]
    analog = recording.trial.analog
    if analog is None:
        return asked, []
    given = {name: muscles for name, muscles in asked.emg_muscles.items() if name in analog.names}
    used = muscles_of_channels(analog.names, model, asked.emg_side) | given
    alive = _channels_with_signal(analog, list(used))
    if alive and (len(analog) < EMG_SAMPLES or analog.rate < EMG_RATE):
        short = (
            f"EMG of {len(analog)} samples at {analog.rate:.0f} Hz is too little for envelopes: not"
            " used."
        )
        return asked, [short]
    dead = [name for name in used if name not in alive]
    sideless = [] if asked.emg_side else list(muscles_of_channels(analog.names, model, "right"))
    texts = _channel_sentences(alive, dead, [name for name in sideless if name not in used])
    if not alive:
        return asked, texts
    muscles = FrozenMap(dict.fromkeys(dead, ()) | dict(asked.emg_muscles))
    return replace(asked, emg=recording.path, emg_muscles=muscles), texts


def _channel_sentences(
    alive: Sequence[str], dead: Sequence[str], sideless: Sequence[str]
) -> list[str]:
    """Say which channels are used, which have no signal, and which have no side."""
    texts = [f"EMG of {len(alive)} analog channels: {few(alive)}."] if alive else []
    if dead:
        texts.append(f"Analog channels without a signal, not used: {few(dead)}.")
    if sideless:
        lost = few(sideless)
        texts.append(
            f"EMG without a side in its name is not used: {lost} (--emg-side left or right)."
        )
    return texts


def _channels_with_signal(analog: Analog, names: Sequence[str]) -> list[str]:
    """Channels whose spread is no small share of the median of all."""
    spread = {name: float(np.nanstd(analog[name])) for name in names}
    return [name for name in names if spread[name] > DEAD * float(np.median([*spread.values()]))]


def protocol_sentences(moving: Sequence[Recording], of_model: Sequence[str] = ()) -> list[str]:
    """Write sentences on protocols.

    Parameters
    ----------
    moving : recordings of motion
    of_model : labels that are markers of the model that was given, whether a protocol knows them or
        not
    """
    texts = []
    for title in dict.fromkeys(
        one.found.protocol.title if one.found.protocol else "" for one in moving
    ):
        own = [
            one
            for one in moving
            if (one.found.protocol.title if one.found.protocol else "") == title
        ]
        known = own[0].found
        what = (
            f"marker protocol {title}"
            if title
            else "no known marker protocol, but labels in common use"
        )
        files = few([one.path.name for one in own])
        text = f"{files}: {what}; {len(known.sites)} labels lie on known landmarks"
        if title and known.common:
            text += f", {len(known.common)} of them by common names ({few(known.common)})"
        unknown = [
            label
            for label in known.unknown
            if label not in of_model and bare(label) not in of_model
        ]
        texts.append(text + (f"; not used: {few(unknown)}." if unknown else "."))
    return texts
