"""What a user asks of `analyze`, and what is done with each recording: axes, forces and EMG that
were found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from myomorph.core.model.errors import BadFile, few
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.segments import feet_of
from myomorph.core.motion.protocols import ProtocolTable, protocol_table, protocols
from myomorph.lab.analysis.arm_labels import is_arm
from myomorph.lab.session.plate_cover import LASTS, SHARED, shared_time, uncovered_share
from myomorph.lab.session.recordings import Recording, bare
from myomorph.lab.session.sensor_recordings import placed_sensors
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
from myomorph.lab.study.inputs.time_span import TimeSpan
from myomorph.lab.study.trial.trial_inputs import Settings, TrialFiles


def read_protocols(path: Path) -> ProtocolTable:
    """The protocols of the package and those of a table in TOML. Raises `BadFile` or `BadData`
    where it cannot be read, or is wrong.
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


EMG_SAMPLES = 300
EMG_RATE = 100.0  # Less than so many samples, or a lower rate [Hz], does not show raw EMG.
# An EMG channel whose spread is below this share of the median of all has no electrode on a muscle.
DEAD = 0.05


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

    @property
    def time(self) -> tuple[float, float] | None:
        """The part of every recording that is used [s], None for all."""
        return self.inputs.or_default(TimeSpan).time

    @property
    def forces(self) -> ForceOptions:
        """How a table of forces is laid out, and its clock."""
        return with_settings(ForceOptions(), self.options.get("id", {}))


def laboratory_of(recording: Recording, model: Model, request: AnalyzeRequest) -> Laboratory:
    """The axes that a user names, else those that the recording shows; as recorded for a model
    whose y is not up.
    """
    named = request.inputs.get(Laboratory) or recording.laboratory
    return named if model.gravity[1] < 0.0 else AS_RECORDED


def recorded_trial(
    recording: Recording, files: TrialFiles, model: Model, request: AnalyzeRequest
) -> tuple[TrialFiles, list[str]]:
    """A recording with what was found beside it and in it, and sentences on that."""
    texts = list[str]()
    alone = recording.trial.markers is None
    if recording.sensors is not None:
        imu, texts = placed_sensors(
            recording.sensors, recording.sensor_files, model, files.get(ImuFiles), alone
        )
        files = files.having(imu)
    laboratory = laboratory_of(recording, model, request)
    if laboratory is recording.laboratory:
        if laboratory.up:
            why = recording.why_up
            texts.append(
                f"{laboratory.up} points up in the laboratory, for {why}: turned to the model's y"
                " axis."
            )
        if laboratory.turn:
            texts.append(
                f"Turned by {laboratory.turn:g}° about the vertical, for {recording.why_turn}."
            )
    if recording.shown_still(request.time):
        texts.append("Nobody moves in it: angles, torques and tensions are those of one pose.")
    emg, of_emg = _emg(recording, model, files.get(EmgFiles))
    texts += of_emg
    plates = recording.trial.plates
    path = recording.near.get("loads")
    if alone and (plates or path is not None):
        texts.append(
            "Forces of plates are not used: sensors do not show where on them the feet are."
        )
        plates = ()
        path = None
    contacts = files.get(ContactsFile)
    loads = files.get(LoadsFile)
    feet = feet_of(model)
    if request.model is None and not alone and is_arm(recording.found):
        feet = ()
        if plates and not loads.plates:
            loads = replace(loads, plates=("none",) * len(plates))
            texts.append(
                "Forces of plates are not used: no marker shows where on them the feet are."
            )
    if path is not None:
        loads = replace(loads, loads=path)
        texts.append(f"External forces from {path.name}.")
        if path.suffix.lower() in TABLES:
            texts += [
                f"{path.name}: {text}." for text in force_table(path, None, request.forces).notes
            ]
    elif plates and feet:
        texts.append(
            f"External forces of {len(plates)} plate{'s' if len(plates) > 1 else ''} of the"
            " recording."
        )
        # Named, so that a file of forces beside the recording is not taken for them.
        loads = replace(loads, loads=recording.path)
    elif feet and not contacts.contacts:
        contacts = replace(contacts, contacts="auto")
        texts.append("No force was measured: forces under the feet are estimated from the motion.")
    if loads.loads is not None and feet and not contacts.contacts:
        assert request.mass is not None
        weight = request.mass * float(np.linalg.norm(model.gravity))
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
    if alone:
        return files.having(loads, emg, contacts), texts
    return files.having(MarkersFile(recording.path), laboratory, loads, emg, contacts), texts


def _emg(recording: Recording, model: Model, asked: EmgFiles) -> tuple[EmgFiles, list[str]]:
    """EMG of a recording, its channels without a signal on no muscle, and sentences on them."""
    path = asked.emg or recording.near.get("emg")
    if path is not None:
        return replace(asked, emg=path), [f"EMG from {path.name}."]
    analog = recording.trial.analog
    if analog is None:
        return asked, []
    used = muscles_of_channels(analog.names, model, asked.emg_side) | {
        name: muscles for name, muscles in asked.emg_muscles.items() if name in analog.names
    }
    spread = {name: float(np.nanstd(analog[name])) for name in used}
    alive = [name for name in used if spread[name] > DEAD * float(np.median([*spread.values()]))]
    if alive and (len(analog) < EMG_SAMPLES or analog.rate < EMG_RATE):
        short = (
            f"EMG of {len(analog)} samples at {analog.rate:.0f} Hz is too little for envelopes: not"
            " used."
        )
        return asked, [short]
    texts = [f"EMG of {len(alive)} analog channels: {few(alive)}."] if alive else []
    dead = [name for name in used if name not in alive]
    if dead:
        texts.append(f"Analog channels without a signal, which take no part: {few(dead)}.")
    sideless = [] if asked.emg_side else list(muscles_of_channels(analog.names, model, "right"))
    lost = [name for name in sideless if name not in used]
    if lost:
        texts.append(
            f"EMG without a side in its name is not used: {few(lost)} (--emg-side left or right)."
        )
    if not alive:
        return asked, texts
    muscles = FrozenMap(dict.fromkeys(dead, ()) | dict(asked.emg_muscles))
    return replace(asked, emg=recording.path, emg_muscles=muscles), texts


def protocol_sentences(moving: Sequence[Recording], of_model: Sequence[str] = ()) -> list[str]:
    """Sentences on protocols.

    Parameters
    ----------
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
        text = (
            f"{few([one.path.name for one in own])}: {what}; {len(known.sites)} labels lie on known"
            " landmarks"
        )
        if title and known.common:
            text += f", {len(known.common)} of them by common names ({few(known.common)})"
        unknown = [
            label
            for label in known.unknown
            if label not in of_model and bare(label) not in of_model
        ]
        texts.append(text + (f"; not used: {few(unknown)}." if unknown else "."))
    return texts
