"""The embedded default: a recorded countermovement jump and a leg model fitted to the jumper.

The recording comes with `biomdp` (MIT licence), the model with `myo-sim` (Apache-2.0): nothing of
either is copied here. `jump_study` brings them together: it turns the recording and the model into
one ground frame (x forward, y up, z to the right), scales the model's segments to the recorded joint
centers, puts the recorded markers on it where quiet standing shows them, and shares the force of the
one plate between both feet.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from myomorph.contact.plates import force_plates
from myomorph.io.c3d.read import read_c3d
from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.series import Analog, Event, Markers, Trial, Wrenches
from myomorph.motion.sync import cut
from myomorph.simulate import jump_model

WINDOW = (3.0, 5.6)
"""From quiet standing until after landing; at 6.2 s the right foot is lifted and put down elsewhere [s]."""
CUTOFF = 10.0  # Low-pass of motion and forces [Hz]: kept the same so that the landing makes no artefact of its own.
LAB_TO_GROUND = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""The jumper faces the laboratory's +y, which becomes x; z up becomes y; +x, to the right, becomes z."""
SEGMENTS = {"pelvis": "pelvis", "thigh": "femur_r", "shank": "tibia_r", "foot": "calcn_r", "trunk": "torso"}
EMG_CHANNELS = ("EMG1.v", "EMG2.v", "EMG3.v", "EMG4.v", "EMG5.v", "EMG6.v")
MIRRORED_WEIGHT = 0.1  # Of the mirrored left markers: enough to place the left leg, too little to pull on the pelvis.
SHOULDER_WEIGHT = 0.2  # Of the shoulder: it moves on the trunk, which is rigid here.


@read_only
class JumpStudy:
    """All that inverse kinematics, inverse dynamics and tensions of the jump need."""

    model: Model  # scaled to the jumper, with the recording's markers; ground x forward, y up, z right
    trial: Trial  # the recording in that ground, with its plates
    # recorded markers of pelvis, trunk and right leg, and the right leg's mirror images (named `Left_... (mirrored)`)
    markers: Markers
    marker_weights: dict[str, float]  # for inverse kinematics
    wrenches: Wrenches  # half of plate 1 on each foot, at the plates' clock; see `share`
    analog: Analog  # the six EMG channels that carry signals [V]
    events: tuple[Event, ...]  # phases of the jump, read off the plate
    mass: float  # of the jumper, from the plate in quiet standing [kg]
    factors: dict[str, float]  # scale factor of each body
    # window, cutoff: what to use of the recording [s], low-pass of motion and forces [Hz]
    window: tuple[float, float]
    cutoff: float
    # (samples,) share of the right foot in the load that the center of pressure shows, NaN in flight; 0.5 is assumed
    share: Array
    # real, assumed: sentences for the first lines of a report
    real: tuple[str, ...]
    assumed: tuple[str, ...]
    source: str  # path of the recording


def jump_study() -> JumpStudy:
    """The jump, ready for inverse kinematics, inverse dynamics, muscle paths and tensions."""
    path = jump_model.recording_path()
    # The file is read in a process of its own, which leaves this one free to make the model.
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(read_c3d, path)
        model = jump_model.leg_model()
        trial = force_plates(reading.result()).rotated(LAB_TO_GROUND)
    if trial.markers is None or not trial.plates or trial.analog is None:
        raise BadData(f"{path}: expected markers, force plates and analog channels")
    quiet = cut(trial.markers, *jump_model.QUIET)
    mass = jump_model.standing_mass(trial, model)
    model, factors = jump_model.fitted_model(model, quiet, mass)
    model = jump_model.calibrated(model, quiet)
    wrenches, share = jump_model.shared_wrenches(trial)
    events = jump_model.events_of(trial)
    channels = [trial.analog.names.index(name) for name in EMG_CHANNELS]
    units = tuple(trial.analog.units[i] for i in channels)
    weights = {name: MIRRORED_WEIGHT if "mirrored" in name else 1.0 for name in model.marker_names}
    return JumpStudy(
        model=model,
        trial=trial,
        markers=jump_model.with_mirrored(trial.markers),
        marker_weights=weights | {jump_model.SHOULDER: SHOULDER_WEIGHT},
        wrenches=wrenches,
        analog=Analog(trial.analog.time, EMG_CHANNELS, trial.analog.values[:, channels], units),
        events=events,
        mass=mass,
        factors=factors,
        window=WINDOW,
        cutoff=CUTOFF,
        share=share,
        real=(
            "A countermovement jump recorded by Vicon (package biomdp, MIT licence): markers on pelvis, right leg "
            "and right shoulder at 200 Hz, force plates and EMG at 2000 Hz.",
            f"The mass of the jumper, {mass:.1f} kg, from the plate in quiet standing.",
        ),
        assumed=_assumed(factors, share, trial, events),
        source=str(path),
    )


def _assumed(factors: dict[str, float], share: Array, trial: Trial, events: tuple[Event, ...]) -> tuple[str, ...]:
    clock, takeoff = trial.plate_time, next(event.time for event in events if event.label == "Take-off")
    still = (clock >= jump_model.QUIET[0]) & (clock <= jump_model.QUIET[1])
    pushing = (clock > jump_model.QUIET[1]) & (clock < takeoff) & np.isfinite(share)
    low, high = np.percentile(share[pushing], [5, 95])
    grown = ", ".join(f"{name} {factors[body]:.3f}" for name, body in SEGMENTS.items())
    return (
        "Both feet stand on one plate, so each gets half of its force. As a check, where the center of "
        f"pressure lies between the feet gives the right foot {share[still].mean():.0%} in quiet standing and "
        f"{low:.0%} to {high:.0%} until take-off; after landing the feet stand too close for this check.",
        "The left leg, which has no markers, and its force are the mirror image of the right one in the "
        "upright plane that halves the pelvis.",
        f"The model is myo-sim's legs (Apache-2.0), scaled to the recorded joint centers ({grown}), with the "
        "arms' mass in the trunk, so that what the swing of the arms takes shows up as residual force; toes, side "
        "bending and twist of the trunk are locked.",
        "In quiet standing the soles are level and the trunk is upright; the shoulder, which the arms' "
        "swing lifts along the trunk, shows how far it bends.",
        "The file does not name the muscles of EMG channels 1 to 6: they are shown without saying which is which.",
    )
