"""Analog channels that are probably EMG, by their labels and units."""

from __future__ import annotations

import re

from myomorph.core.model.series import Trial

EMG_NAME = re.compile(
    r"emg|rect|fem|vast|bicep|tricep|gast|sol(eus)?\b|tib|ham|glut|delt|trap|pect?\b|infra|supra"
    r"|subscap|lat(iss)?\b"
    r"|semi[tm]|peron|erect|sartor|addu|(^|[\W_])([rl][\W_]?)?(ta|gm|gl|gas|rf|re|rec|vl|vm|va|vas"
    r"|bf|bi|st|ham|isc|gmed|gmax|glu|so|pe|pl|es|mh|lh|mg|lg)\d?$",
    re.IGNORECASE,
)
NOT_EMG = re.compile(
    r"switch|sync|trig|speed|\b(force|moment)\b|handle|accel|acc\b|gyro|\bpin\b|goni|digital|foot",
    re.IGNORECASE,
)
VOLTS = ("v", "mv", "uv", "volts", "")
"""Units of channels that may be EMG; some files state none."""


def emg_channels(trial: Trial) -> tuple[str, ...]:
    """List the analog channels that are probably EMG, a guess from labels and units.

    Channels that a force plate uses are left out. Those whose label says EMG or a muscle are taken;
    without any, all that are in volts and do not look like a switch, a trigger or an accelerometer.

    Parameters
    ----------
    trial : analog channels with their units, and plates

    Returns
    -------
    names of channels, in the recording's order; () without analog channels
    """
    if trial.analog is None:
        return ()
    of_plates = {name for plate in trial.plate_recordings for name in plate.channel_names}
    in_volts = []
    named = []
    units = trial.analog.units or ("",) * len(trial.analog.names)
    for name, unit in zip(trial.analog.names, units, strict=True):
        electric = unit.lower().replace("µ", "u") in VOLTS
        if not electric or name in of_plates or NOT_EMG.search(name):
            continue
        in_volts.append(name)
        if EMG_NAME.search(name):
            named.append(name)
    return tuple(named or in_volts)
