"""EMG of a trial, and how its channels belong to muscles."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Emg, Trial
from myomorph.core.motion.emg_activation import EmgCalibration
from myomorph.lab.store import stored as store
from myomorph.lab.store.results import ResultWriter
from myomorph.lab.store.settings import Side
from myomorph.lab.study.inputs.beside import companion, is_alone
from myomorph.lab.study.inputs.input import Beside, Input, Recorded, later
from myomorph.lab.study.inputs.keys import File, Files, KeyKind, Pairs

WORDS = ("emg", "EMG", "electromyography", "envelopes")
ENDINGS = (".sto", ".mot", ".csv")
"""In the name of a file of EMG that belongs to a recording, and its endings."""


@dataclass(frozen=True)
class EmgFiles:
    """EMG and what is known of its channels.

    Attributes
    ----------
    emg : EMG as raw signals or envelopes (.sto, .mot, .csv, .c3d); a channel belongs to the muscle
        in its name
    emg_side : side of EMG channels whose names contain none: right or left
    emg_muscles : CHANNEL=MUSCLE[,MUSCLE...] ...: muscles of EMG channels whose names contain none
    emg_mvc : recordings of maximum voluntary contractions; EMG is normalized to their largest
        envelopes, which also limit the gains
    emg_gains_file : gains of the subject's EMG channels, fitted over all trials (gains.json of the
        step 'emg' of a study); by default they are fitted to this recording alone
    """

    emg: Annotated[Path | None, File(per="trial")] = None
    emg_side: Annotated[Side, KeyKind()] = ""
    emg_muscles: Annotated[
        Mapping[str, tuple[str, ...]], Pairs(many=True, of="muscle", shown="CHANNEL=MUSCLE,MUSCLE")
    ] = field(default_factory=lambda: FrozenMap({}))
    emg_mvc: Annotated[tuple[Path, ...], Files()] = ()
    emg_gains_file: Annotated[Path | None, File()] = None


@dataclass(frozen=True, eq=False)
class RecordedEmg(Recorded):
    """EMG of a recording.

    Attributes
    ----------
    emg : envelopes; of a C3D file those of channels whose names contain a muscle
    muscles : of each channel
    notes : what was done and what is wrong, one line each
    maxima : of the envelopes in maximum voluntary contractions, where measured
    scale : what each channel was divided by
    gains : delays and gains, None to find them on this recording
    """

    emg: Emg
    muscles: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: FrozenMap({}))
    notes: tuple[Message, ...] = ()
    maxima: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    scale: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    gains: EmgCalibration | None = None

    @property
    def facts(self) -> Mapping[str, str]:
        """Muscles of the channels."""
        muscles = {channel: list(names) for channel, names in self.muscles.items()}
        return FrozenMap({"emg_muscles": json.dumps(muscles)})

    def put(self, writer: ResultWriter) -> None:
        """Write the envelopes."""
        store.put_emg(writer, self.emg)


def emg_by_name(recording: Path) -> Path | None:
    """Find the EMG that belongs to a recording by the rule of names, None where there is none."""
    return companion(recording, WORDS, ENDINGS)


def _near(recording: Path, trial: Trial) -> Path | None:
    """By its name, or the only one that is called EMG."""
    path = emg_by_name(recording)
    if path is not None or not is_alone(recording):
        return path
    named = [
        file
        for file in sorted(recording.parent.iterdir())
        if file.suffix.lower() in ENDINGS
        and any(word in file.stem.lower() for word in ("emg", "electromyo"))
    ]
    return named[0] if len(named) == 1 else None


INPUT = Input(
    name="emg",
    settings=EmgFiles,
    open=later("myomorph.lab.study.inputs.emg_files:opened"),
    main="emg",
    beside=lambda recording, values: Beside(emg_by_name(recording)),
    near=_near,
)
