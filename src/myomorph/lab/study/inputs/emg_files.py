"""EMG of files.

Raw channels become envelopes, channels find their muscles, and what is wrong with them is reported.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from myomorph.core.io.formats import CHANNELS, channel_format
from myomorph.core.io.sto import read_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import EMG
from myomorph.core.model.errors import BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message, located, summarized
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.series import Emg, Series, Table
from myomorph.core.motion import emg_checks
from myomorph.core.motion.envelope import EnvelopeOptions, envelopes, largest
from myomorph.core.tension.emg_targets import EmgOptions
from myomorph.lab.store.results import file_source, file_sources, value_source
from myomorph.lab.store.settings import plain_settings
from myomorph.lab.study.inputs.emg import EmgFiles, RecordedEmg
from myomorph.lab.study.inputs.emg_gains import read_gains, rescaled
from myomorph.lab.study.inputs.emg_names import muscles_of_channels
from myomorph.lab.study.inputs.input import Opened, Opening
from myomorph.lab.study.inputs.markers import Recording
from myomorph.lab.study.inputs.motion import RecordedMotion
from myomorph.lab.study.inputs.reading import TABLE_FILES, about, read_recording

CHANNEL_FILES = (".sto", ".mot", ".csv", ".c3d")
"""Endings of files with channels, besides those of the formats of channels alone."""
OTHER_SENSORS = re.compile(
    r"force|moment|torque|plate|cop|sync|trigger|pulse|speed|treadmill|gonio|acc|gyro|mag|load.?cell|imu|spare|channel"
    r"|^(.*[._ ])?(fp|amti|pin|f|m)?[_.]?\d*[_.]?[fm]?[xyz]?[_.]?\d*([-+]\d*)*$",
    re.IGNORECASE,
)
"""Analog channels that are no EMG by their names."""
SWINGS = 0.3
"""Share of negative samples from which on a channel is raw EMG: it swings about zero, an envelope
does not.
"""
MOSTLY_FAST = 0.5  # Share of the variance above 20 Hz from which on a channel is no envelope.
SYMMETRIC = 0.55
"""How far raw EMG goes below its median at least, over how far above; rectified EMG goes 0.35 times
as far.
"""


def opened(settings: EmgFiles, opening: Opening) -> Opened:
    """EMG of a trial, with the gains that its subject's steps found."""
    sources = []
    if settings.emg_muscles or settings.emg_side:
        muscles = sorted(settings.emg_muscles.items())
        sources.append(value_source("emg", "muscles of channels", muscles, settings.emg_side))
    mvc = (("emg mvc", path) for path in settings.emg_mvc)
    sources += file_sources(*mvc, ("emg gains", settings.emg_gains_file))
    if settings.emg is None:
        return Opened(sources=tuple(sources))
    options = opening.options[EnvelopeOptions]
    sources.append(file_source("emg", settings.emg))
    sources.append(
        value_source("emg", "settings of envelopes", sorted(plain_settings(options).items()))
    )
    recorded = open_emg(settings, opening.model, options)
    if settings.emg_gains_file is not None:
        gains = read_gains(settings.emg_gains_file)
        emg = rescaled(recorded.emg, recorded.scale, gains.scale)
        recorded = replace(recorded, emg=emg, scale=gains.scale, gains=gains.calibration)
    motion = opening.values.get(RecordedMotion)
    markers = opening.values.or_default(Recording).trial.markers
    clocked = markers if motion is None else motion.motion
    rate = "" if clocked is None else emg_checks.rate_against(recorded.emg, clocked.time)
    # Options of EMG count wherever a recording has EMG.
    return Opened(
        values=(recorded,),
        sources=tuple(sources),
        warnings=(*recorded.notes, *((rate,) if rate else ())),
        real=f"EMG from {settings.emg.name}",
        options=(opening.options[EmgOptions],),
    )


def open_emg(files: EmgFiles, model: Model, options: EnvelopeOptions | None = None) -> RecordedEmg:
    """Read EMG of a table or of the analog channels of a C3D file as envelopes.

    Channels that swing about zero, or fast about an offset, are raw: they are filtered
    (`envelopes`) and scaled to their largest value in the `reference` recordings (maximum voluntary
    contractions), else to their own. Envelopes are scaled to the reference, too, or stay as they
    are; a table whose largest value is over 1.5 has every channel scaled to its own. `named`
    channels have the muscles that a user specifies. Others find theirs by name, on `side` where the
    name has none.
    """
    path = files.emg
    assert path is not None
    channels = channels_of(path)
    _check_named(files.emg_muscles, channels.names, model, path)
    with about(path):
        muscles = muscles_of_channels(channels.names, model, files.emg_side)
        muscles |= dict(files.emg_muscles)
        # A channel with an empty list takes no part.
        muscles = {channel: names for channel, names in muscles.items() if names}
        notes = located(path.name, channels.warnings) if isinstance(channels, Table) else ()
        notes += _left_out(path, channels.names, muscles)
        if path.suffix.lower() == ".c3d":
            if not muscles:
                raise BadFile(
                    path, "has no analog channel named as a muscle", "name them in emg_muscles"
                )
            channels = _picked(channels, tuple(muscles))
        if _is_raw(channels):
            recorded = _from_raw(channels, muscles, files, options)
        else:
            recorded = _as_envelopes(channels, muscles, path.name, files.emg_mvc)
    return _without_noise(replace(recorded, notes=(*notes, *recorded.notes)), files.emg_muscles)


def _check_named(
    named: Mapping[str, tuple[str, ...]], channels: tuple[str, ...], model: Model, path: Path
) -> None:
    """Raise `UnknownName` where a user names a channel or a muscle that does not exist."""
    for channel, muscles in named.items():
        index_of("EMG channel", channel, channels, str(path))
        for muscle in muscles:
            index_of(f"muscle of EMG channel '{channel}'", muscle, model.muscle_names)


def _from_raw(
    channels: Series,
    muscles: Mapping[str, tuple[str, ...]],
    files: EmgFiles,
    options: EnvelopeOptions | None,
) -> RecordedEmg:
    """Return the envelopes of raw channels, scaled to the reference, else to their own maxima."""
    assert files.emg is not None
    reference = files.emg_mvc
    maxima = None
    if reference:
        maxima = largest(
            [_picked(channels_of(path), channels.names) for path in reference], options
        )
    peaks = largest([channels], options) if maxima is None else maxima
    faults = emg_checks.raw_faults(channels)
    emg = emg_checks.without_faults(envelopes(channels, options, maxima), faults)
    scaled = "scaled to the reference" if reference else "scaled to their own largest value"
    made = f"{files.emg.name}: raw EMG, made into envelopes and {scaled}"
    return RecordedEmg(
        emg=emg,
        muscles=muscles,
        notes=(
            EMG.message(made, severity="good to know"),
            *summarized((fault.kind, fault.message) for fault in faults),
        ),
        maxima=FrozenMap(dict.fromkeys(emg.names, 1.0) if reference else {}),
        scale=FrozenMap(
            {channel: peaks[channel] if peaks[channel] > 0.0 else 1.0 for channel in emg.names}
        ),
    )


def _without_noise(opened: RecordedEmg, named: Mapping[str, tuple[str, ...]]) -> RecordedEmg:
    """Channels that are noise throughout take no part, unless a user names their muscles."""
    found = emg_checks.noise_faults(opened.emg, tuple(opened.muscles))
    if not found:
        return opened
    left = {one.channel for one in found} - set(named)
    effects = {False: "it is used, as its muscles are named", True: "it is not used"}
    notes = summarized(
        (
            one.channel in left,
            one.message.changed(f"{one.text}; {effects[one.channel in left]}"),
        )
        for one in found
    )
    muscles = FrozenMap(
        {name: muscle for name, muscle in opened.muscles.items() if name not in left}
    )
    return replace(opened, muscles=muscles, notes=(*notes, *opened.notes))


def _left_out(
    path: str | Path, names: Sequence[str], measured_on: Mapping[str, tuple[str, ...]]
) -> tuple[Message, ...]:
    """Report channels that take no part while others do.

    Of a C3D file these are only those that are none of a plate or another sensor.
    """
    lacking = [name for name in names if name not in measured_on]
    if Path(path).suffix.lower() == ".c3d":
        lacking = [name for name in lacking if not OTHER_SENSORS.search(name)]
    if not measured_on or not lacking:
        return ()
    which = ", ".join(lacking[:6]) + (" ..." if len(lacking) > 6 else "")
    told_by = "emg_muscles of a study, --emg-muscles"
    return (
        (
            EMG.message(
                f"EMG of {which} is not used: its name contains no muscle of the model; name them"
                f" ({told_by})"
            )
        ),
    )


def channels_of(path: str | Path) -> Series:
    """All channels of a file."""
    ending = Path(path).suffix.lower()
    if ending in (".csv", ".txt"):
        from myomorph.core.io.channels import read_csv_table

        return read_csv_table(Path(path))
    if ending in TABLE_FILES:
        return read_sto(path)
    if ending == ".c3d":
        analog = read_recording(path).analog
        if analog is None:
            raise BadFile(
                path, "has no analog channels", "EMG of another file can be given as .sto or .mot"
            )
        return analog
    channels = channel_format(path)
    if channels is not None:
        recorded: Series = channels.read(Path(path))
        return recorded
    endings = [*CHANNEL_FILES, *(other for kind in CHANNELS for other in kind.endings)]
    raise BadFile(
        path,
        f"holds no EMG: its name ends in '{ending}'",
        f"expected {', '.join(endings[:-1])} or {endings[-1]}",
    )


def _picked(series: Series, names: tuple[str, ...]) -> Series:
    values = np.array([series[name] for name in names]).T.reshape(len(series), len(names))
    return Series(series.time, names, values)


def _is_raw(series: Series) -> bool:
    known = np.isfinite(series.values)
    negative = (known & (series.values < 0.0)).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    if not negative.size:
        return False
    # Channels whose offset is below or above all that they swing do not pass zero.
    shifted = [_swings_about_offset(column, series.rate) for column in series.values.T]
    return bool(np.median(negative) > SWINGS or np.median(shifted) > 0.5)


def _swings_about_offset(column: Array, rate: float) -> bool:
    """Return whether a channel (samples,) is raw EMG with an offset.

    It is where it is fast, and goes as far below its median as above it.
    """
    column = column[np.isfinite(column)]
    if not emg_checks.fast_share(column, rate) > MOSTLY_FAST:
        return False
    low, middle, high = np.percentile(column, [1.0, 50.0, 99.0])
    return bool(middle - low > SYMMETRIC * (high - middle))


def _as_envelopes(
    series: Series, measured_on: Mapping[str, tuple[str, ...]], name: str, reference: Sequence[Path]
) -> RecordedEmg:
    values = series.values
    notes = []
    maxima = FrozenMap[str, float]({})
    peak = np.nanmax(values) if np.isfinite(values).any() else 0.0
    scale = np.ones(len(series.names))
    if reference:
        scale = np.array([_largest_of(reference, channel) for channel in series.names])
        maxima = FrozenMap(dict.fromkeys(series.names, 1.0))
        notes.append(
            EMG.message(
                f"{name}: envelopes scaled to maximum voluntary contractions",
                severity="good to know",
            )
        )
    elif peak > emg_checks.BEYOND_ONE:
        scale = np.nanmax(values, axis=0).clip(1e-12)
        notes.append(
            EMG.message(
                f"{name}: envelopes reach {peak:.3g}: every channel is scaled to its own largest"
                " value"
            )
        )
    emg = Emg(series.time, series.names, values / scale)
    faults = emg_checks.envelope_faults(emg)
    used = summarized(
        (fault.kind, fault.message)
        for fault in faults
        if not measured_on or fault.channel in measured_on
    )
    divided = FrozenMap(dict(zip(series.names, scale.tolist(), strict=True)))
    return RecordedEmg(
        emg=emg_checks.without_faults(emg, faults),
        muscles=measured_on,
        notes=(*notes, *used),
        maxima=maxima,
        scale=divided,
    )


def _largest_of(reference: Sequence[Path], channel: str) -> float:
    """Largest envelope of a channel in recordings of maximum voluntary contractions."""
    largest_found = 0.0
    for path in reference:
        one = channels_of(path)
        index_of("EMG channel", channel, one.names, str(path))
        if _is_raw(one):
            raise BadFile(
                path,
                "holds raw EMG, but the recording has envelopes",
                "give envelopes of the same units",
            )
        largest_found = max(largest_found, float(np.nanmax(np.append(one[channel], 0.0))))
    if not largest_found > 0.0:
        raise BadFile(
            reference[0],
            f"has no values of channel '{channel}'",
            "leave it out, or give another recording",
        )
    return largest_found
