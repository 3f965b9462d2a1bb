"""A relaxed leg whose passive knee is known, dropped in MuJoCo.

MuJoCo is an engine that is not ours. Nobody was measured. The thigh rests on a table, held by a
stiff spring where it may give way. A hand holds the shank and lets go; a reflex, where there is
one, is a torque of the knee's extensors in the first swing, with EMG of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

import myomorph as mm
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.sto import write_sto
from myomorph.core.io.trc import write_trc
from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Table
from myomorph.swings.viscosity.study.limb_files import DropFiles, LimbFiles

STEP = 5e-4
RATE = 100.0
EMG_RATE = 1000.0
HOLD = 1.0
SWINGING = 9.0  # Times that the hand holds the shank, and that it swings [s].
# Else MuJoCo's dry friction creeps.
HARD = 'solreffriction="0.004 1" solimpfriction="0.99 0.999 0.001"'
MUSCLE = "rectus_femoris"
DELAY = 0.04  # By which EMG comes before force [s].
PLACES = {
    "thigh": ((0.05, 0.06, 0.05), (0.2, -0.07, 0.06), (0.38, 0.05, 0.05), (0.3, 0.0, 0.09)),
    "shank": ((0.05, 0.06, -0.06), (0.04, -0.06, -0.1), (0.05, 0.04, -0.3), (-0.03, 0.03, -0.38)),
}
"""Markers on each bone, in its frame [m]."""


@dataclass(frozen=True)
class RelaxedLeg:
    """A leg whose knee is passive.

    Its knee's damping [N m s/rad], stiffness [N m/rad], rest angle from where the shank
    hangs [rad] and dry friction [N m]; mass of shank and foot [kg], its center below the knee [m],
    inertia about it [kg m^2].

    `giving`: stiffness of what carries the thigh [N m/rad], 0 where nothing moves it; `noise` of
    markers [m]; `bursts`: number of each drop whose first swing has a reflex of `burst` [N m];
    `wrong`: factors of mass, distance and inertia in the model that is identified with.
    """

    damping: float = 0.2
    stiffness: float = 2.0
    rest: float = 0.3
    friction: float = 0.0
    mass: float = 4.0
    distance: float = 0.25
    inertia: float = 0.06
    giving: float = 0.0
    noise: float = 5e-4
    bursts: tuple[int, ...] = ()
    burst: float = 4.0
    wrong: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def truth(self) -> dict[str, float]:
        """By the names of `relaxed.identify.UNITS`; the coordinate is 0 where the shank hangs."""
        torque = {"zero_torque": self.stiffness * self.rest}
        known = {
            "viscosity": self.damping,
            "stiffness": self.stiffness,
            "rest_angle": self.rest,
        } | torque
        return known | ({"coulomb": self.friction} if self.friction else {})

    def mjcf(self, passive: bool = True) -> str:
        """Return the leg, its passive knee left out where it is what is estimated."""
        knee = (
            f'damping="{self.damping}" stiffness="{self.stiffness}"'
            f' springref="{np.rad2deg(self.rest)}" frictionloss="{self.friction}" {HARD}'
        )
        weight = 9.81 * (8.0 * 0.2 + 0.42 * self.mass)
        slack = np.rad2deg(weight / self.giving) if self.giving else 0.0
        hip = (
            f'stiffness="{self.giving}" damping="{0.02 * self.giving}" springref="{slack}"'
            if passive
            else ""
        )
        joint = f'<joint name="hip" axis="0 -1 0" {hip}/>' if self.giving or not passive else ""
        mass, distance, inertia = (
            (self.mass, self.distance, self.inertia)
            if passive
            else (
                value * factor
                for value, factor in zip(
                    (self.mass, self.distance, self.inertia), self.wrong, strict=True
                )
            )
        )
        sites = {
            body: "".join(
                f'<site name="{body}_{i}" pos="{x} {y} {z}" size="0.005"/>'
                for i, (x, y, z) in enumerate(places)
            )
            for body, places in PLACES.items()
        }
        passive_knee = knee if passive else ""
        return f"""<mujoco model="leg">\
<option gravity="0 0 -9.81" timestep="{STEP}" integrator="RK4"/><worldbody>
          <body name="thigh" pos="0 0 1">{joint}{sites["thigh"]}
            <inertial pos="0.2 0 0" mass="8" diaginertia="0.03 0.12 0.12"/>
            <body name="shank" pos="0.42 0 0">\
<joint name="knee" axis="0 -1 0" {passive_knee}/>
              {sites["shank"]}
              <inertial pos="0 0 {-distance}" mass="{mass}"
                diaginertia="{inertia} {inertia} {0.2 * inertia}"/>
            </body></body></worldbody></mujoco>"""


@dataclass(frozen=True, eq=False)
class Dropped:
    """One drop.

    Markers with noise, raw EMG, the true knee angle (frames,) [rad], and when a reflex pulled [s].
    """

    markers: mm.Markers
    emg: mm.Series
    angles: Array
    burst: tuple[float, float] | None = field(default=None)


def drop_leg(leg: RelaxedLeg, number: int, seed: int, release: float = 1.35) -> Dropped:
    """Hold the shank `release` rad above where it hangs, more or less, and let go."""
    random = np.random.default_rng((seed, number))
    model = mujoco.MjModel.from_xml_string(leg.mjcf())
    start = release + 0.1 * random.standard_normal()
    burst = (0.12, 0.32) if number in leg.bursts else None
    angles, places = _held_and_dropped(model, start, burst, leg.burst)
    time = np.arange(len(angles)) / RATE
    names = tuple(model.site(i).name for i in range(model.nsite))
    markers = mm.Markers(time, names, places + leg.noise * random.standard_normal(places.shape))
    when = None if burst is None else (HOLD + burst[0], HOLD + burst[1])
    return Dropped(markers=markers, emg=_raw_emg(when, random), angles=angles, burst=when)


def _held_and_dropped(
    model: mujoco.MjModel, start: float, burst: tuple[float, float] | None, torque: float
) -> tuple[Array, Array]:
    """Hold the shank at an angle [rad], let go, and record.

    Parameters
    ----------
    model : of the leg
    start : of the knee [rad]
    burst : start and end of a reflex after the release [s], None without one
    torque : of the reflex [N m]

    Returns
    -------
    knee angles (frames,) [rad] and marker positions (frames, 8, 3) [m]
    """
    data = mujoco.MjData(model)
    knee = model.joint("knee")
    held = round(HOLD * RATE)
    frames = round((HOLD + SWINGING) * RATE)
    angles = np.empty(frames)
    places = np.empty((frames, 8, 3))
    for frame in range(frames):
        if frame < held:
            data.qpos[:] = 0.0
            data.qpos[knee.qposadr[0]] = start
            data.qvel[:] = 0.0
            mujoco.mj_forward(model, data)
        angles[frame] = data.qpos[knee.qposadr[0]]
        places[frame] = data.site_xpos
        for _ in range(round(1.0 / (RATE * STEP)) if frame >= held else 0):
            pulls = burst is not None and burst[0] <= data.time <= burst[1]
            data.qfrc_applied[knee.dofadr[0]] = torque if pulls else 0.0
            mujoco.mj_step(model, data)
    return angles, places


def _raw_emg(when: tuple[float, float] | None, random: np.random.Generator) -> mm.Series:
    """Make raw EMG of noise that is larger while a reflex is on its way [s]."""
    samples = np.arange(round((HOLD + SWINGING) * EMG_RATE)) / EMG_RATE
    size = np.full(len(samples), 5e-6)
    if when is not None:
        size[(samples > when[0] - DELAY) & (samples < when[1] - DELAY)] = 6e-5
    return mm.Series(samples, (MUSCLE,), (size * random.standard_normal(len(samples)))[:, None])


def leg_model(leg: RelaxedLeg) -> mm.Model:
    """Return the known parts of a leg: bones, markers and masses, the latter off by `wrong`."""
    text = replace(leg, giving=leg.giving or 1.0).mjcf(passive=False)
    return model_from_mujoco(
        mujoco.MjModel.from_xml_string(text), name="leg", marker_sites=r"(thigh|shank)_\d"
    )


def write_leg(
    leg: RelaxedLeg, folder: Path, drops: int = 3, seed: int = 0, emg: bool = True
) -> LimbFiles:
    """Write the model and the drops as a laboratory would have them.

    They are returned as a limb of a study.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_osim(leg_model(leg), folder / "leg.osim")
    files = []
    for number in range(drops):
        dropped = drop_leg(leg, number, seed)
        recording = folder / f"drop{number + 1}.trc"
        channel = folder / f"drop{number + 1}_emg.sto"
        write_trc(dropped.markers, recording)
        if emg:
            write_sto(Table(dropped.emg.time, dropped.emg.names, dropped.emg.values), channel)
        files.append(DropFiles(recording.stem, recording, channel if emg else None))
    return LimbFiles(name="leg", model=folder / "leg.osim", coordinate="knee", drops=tuple(files))
