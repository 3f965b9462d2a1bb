"""Two simulated fighters pulling on each other, as a laboratory would record them.

Every force is known. Nobody was measured. MuJoCo moves both bodies forward under the forces of
their muscles; the mat holds the soles by its contacts, tori's right hand holds uke's lapel by a
constraint, and a sleeve that can only pull joins tori's left fist to uke's right forearm. How the
fighters choose activations stands in `bout`; it is not how the estimate does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from myomorph.core.io.mjcf.compile import silent_mujoco
from myomorph.core.io.mjcf.read import coordinates_from_qpos, model_from_mujoco
from myomorph.core.model.arrays import Array
from myomorph.core.model.contacts import Cone, Site
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.join import join_models
from myomorph.core.model.model import Marker, Model
from myomorph.core.model.series import Emg, Markers, Motion, Series, Wrenches
from myomorph.core.motion.filters import lowpass
from myomorph.core.rigid.kinematics import marker_positions
from myomorph.show.simulate import fighter
from myomorph.show.simulate.bout import FEET, GRIPS, Habits, Run, simulate_bout
from myomorph.show.simulate.plan import Kind, Plan, make_plan, start_pose

SETTLING = 0.3  # Time at the start that is not recorded, while the fighters settle [s].
FALLEN = 0.5  # Distance of a joint from the plan at which a bout counts as lost [rad].
CHANNELS = (
    "delt_ant",
    "delt_post",
    "bic_long",
    "tri_lat",
    "rect_fem",
    "bifemlh",
    "tib_ant",
    "gas_lat",
)
"""The muscles (a) to (h) of [D] fig. 5.3, of which a laboratory would measure both sides."""
LOADED = 0.02  # Share of a fighter's weight from which on a foot touches.


@dataclass(frozen=True)
class PairOptions:
    """What is simulated, and how badly it is measured."""

    # "pull": both lean back and pull; "sway": and sway to the sides; "step": tori steps back
    kind: Kind = "pull"
    seed: int = 0  # of builds, measures of the movement, criteria of the fighters and noise
    rate: float = 100.0  # of markers [Hz]
    marker_noise: float = 0.0005  # standard deviation of each coordinate of a marker, white [m]
    # of what the laboratory takes for the muscles' maximum forces, standard deviation of its
    # logarithm
    strength_error: float = 0.15
    # emg_gain, emg_noise: of envelopes: standard deviation of a channel's gain about 1, and white
    # noise
    emg_gain: float = 0.1
    emg_noise: float = 0.02
    # standard deviation of the logarithm of a muscle's weight in its fighter's own criterion
    weight_spread: float = 0.5
    # least and greatest activation that a muscle keeps without need
    tone: tuple[float, float] = (0.01, 0.05)
    vigor: float = 1.0  # factor of the pulls, and of how far the fighters lean back for them
    until: float = float("inf")  # when the bout ends, where the plan is not over sooner [s]


@dataclass(frozen=True, eq=False)
class PairTruth:
    """What truly happened, at the times of the markers."""

    motion: Motion  # coordinates of the joined model
    # activations, tensions: (frames, muscles) [1, N]
    activations: Series
    tensions: Series
    # (frames, contacts, 3) of `FEET` on the feet and of `GRIPS` on tori's hands, in ground [N]
    forces: Series
    wrenches: Wrenches  # the same as loads, with those on uke beside them
    models: Mapping[str, Model]  # the fighters' own, by part


@dataclass(frozen=True, eq=False)
class VirtualPair:
    """What a laboratory has of a simulated bout, and the truth."""

    options: PairOptions
    # of the fighters as the laboratory knows them, by part: strengths are off by `strength_error`
    models: Mapping[str, Model]
    model: Model  # of both together
    # markers, emg: as recorded; channels of `emg` are all muscles of `model`
    markers: Markers
    emg: Emg
    # of each fighter, by part, what plates under both of its feet would measure
    plates: Mapping[str, Wrenches]
    sites: tuple[Site, ...]  # heels and toes of the feet, and the grips
    touching: Series  # (frames, sites) 1 where a site bears load, as a camera would tell
    builds: Mapping[str, fighter.Build]  # of the fighters as the laboratory knows them
    truth: PairTruth


def virtual_pair(options: PairOptions | None = None, cutoff: float | None = None) -> VirtualPair:
    """Simulate a bout.

    `cutoff` is that of a low-pass of the true forces, to compare with an estimate that filters so
    [Hz].
    """
    options = options or PairOptions()
    random = np.random.default_rng(options.seed)
    with silent_mujoco():
        compiled, builds, believed, plan, habits = _setting(options, random)
        run = simulate_bout(compiled, builds, plan, habits, options.until)
        strayed = float(run.strayed[round(SETTLING / fighter.STEP) :].max())
        if strayed > FALLEN:
            raise BadData(
                f"a fighter of bout '{options.kind}' {options.seed} falls: a joint is {strayed:.2g}"
                " rad off; take another seed"
            )
        models = {part: fighter_model(part, builds[part]) for part in fighter.PARTS}
        known = {part: fighter_model(part, believed[part]) for part in fighter.PARTS}
    truth = _truth(compiled, models, run, options, cutoff)
    return _recorded(believed, known, truth, options, random)


def _setting(
    options: PairOptions, random: np.random.Generator
) -> tuple[Any, dict[str, fighter.Build], dict[str, fighter.Build], Plan, Habits]:
    """Draw the setting of a bout.

    It is the pair's mujoco.MjModel, builds, builds as the laboratory takes them, plan, and habits.
    """
    builds = {
        part: fighter.Build(
            random.uniform(65.0, 90.0), random.uniform(1.68, 1.84), random.uniform(0.9, 1.15)
        )
        for part in fighter.PARTS
    }
    compiled = fighter.compile_pair(builds)
    builds = fighter.with_fibers(builds, compiled, start_pose(compiled))
    compiled = fighter.compile_pair(builds)
    plan = make_plan(compiled, builds, options.kind, random, options.vigor)
    weight = np.exp(options.weight_spread * random.standard_normal(compiled.nu))
    tone = random.uniform(*options.tone, compiled.nu)
    believed = {
        part: fighter.misjudged(build, options.strength_error, random)
        for part, build in builds.items()
    }
    return compiled, builds, believed, plan, Habits(weight, tone)


def fighter_model(part: str, build: fighter.Build) -> Model:
    """One fighter's model with its markers."""
    compiled = mujoco.MjModel.from_xml_string(fighter.fighter_text(part, build))
    markers = tuple(
        Marker(name, body, build.size * place)
        for name, (body, place) in fighter.marker_points().items()
    )
    return model_from_mujoco(compiled, name=part).with_markers(markers)


def _truth(
    compiled: Any, models: Mapping[str, Model], run: Run, options: PairOptions, cutoff: float | None
) -> PairTruth:
    every = round(1.0 / (options.rate * fighter.STEP))
    rows = slice(round(SETTLING / fighter.STEP), None, every)
    time = run.time[rows] - run.time[rows][0]
    whole = join_models(models)
    muscles = tuple(compiled.actuator(i).name for i in range(compiled.nu))

    def seen(values: Array) -> Array:
        return (values if cutoff is None else lowpass(values, 1.0 / fighter.STEP, cutoff))[rows]

    forces = seen(run.forces)
    moments = seen(run.moments)
    points = _points(run, rows, forces, moments)
    return PairTruth(
        motion=Motion(time, whole.coordinate_names, _coordinates(models, run.qpos[rows])),
        activations=Series(time, muscles, run.activations[rows]),
        tensions=Series(time, muscles, run.tensions[rows]),
        forces=Series(time, (*FEET, *GRIPS), forces),
        wrenches=_wrenches(time, forces, points, moments - np.cross(points, forces)),
        models=FrozenMap(dict(models)),
    )


def _coordinates(models: Mapping[str, Model], qpos: Array) -> Array:
    """Convert MuJoCo's positions of all models, one after the other, to coordinates."""
    values = []
    start = 0
    for model in models.values():
        width = len(model.coordinates) + 1
        values.append(coordinates_from_qpos(model, qpos[:, start : start + width]))
        start += width
    return np.unwrap(np.hstack(values), axis=0)


def _wrenches(time: Array, forces: Array, points: Array, torques: Array) -> Wrenches:
    """Make wrenches of (frames, contacts, 3) values, with what the grips do to uke."""
    bodies = (*FEET, "tori_forearm_r", "tori_forearm_l", "uke_torso", "uke_forearm_r")
    grips = slice(len(FEET), None)
    return Wrenches(
        time=time,
        names=(*FEET, *GRIPS, *(f"{grip}_on_uke" for grip in GRIPS)),
        bodies=bodies,
        forces=np.concatenate([forces, -forces[:, grips]], axis=1),
        points=np.concatenate([points, points[:, grips]], axis=1),
        torques=np.concatenate([torques, -torques[:, grips]], axis=1),
    )


def _points(run: Run, rows: slice, forces: Array, moments: Array) -> Array:
    """Where forces act: the center of pressure of soles on the mat (y = 0), and the fists."""
    points = np.zeros_like(forces)
    feet = slice(0, len(FEET))
    up = np.where(np.abs(forces[:, feet, 1]) > 1.0, forces[:, feet, 1], np.inf)
    points[:, feet, 0] = moments[:, feet, 2] / up
    points[:, feet, 2] = -moments[:, feet, 0] / up
    points[:, len(FEET) :] = run.places[rows]
    return points


def _recorded(
    builds: Mapping[str, fighter.Build],
    known: Mapping[str, Model],
    truth: PairTruth,
    options: PairOptions,
    random: np.random.Generator,
) -> VirtualPair:
    whole = join_models(known)
    places = marker_positions(whole, truth.motion).values
    places = places + options.marker_noise * random.standard_normal(places.shape)
    time = truth.motion.time
    gain = np.exp(options.emg_gain * random.standard_normal(len(whole.muscles)))
    envelope = gain * truth.activations.values
    envelope = np.clip(
        envelope + options.emg_noise * random.standard_normal(envelope.shape), 0.0, 1.0
    )
    sites = pair_sites(builds)
    feet = {i: body for i, body in enumerate(truth.wrenches.bodies) if body in FEET}
    plates = {
        part: truth.wrenches.columns([i for i, body in feet.items() if body.startswith(part)])
        for part in fighter.PARTS
    }
    return VirtualPair(
        options=options,
        models=FrozenMap(dict(known)),
        model=whole,
        markers=Markers(time, whole.marker_names, places),
        emg=Emg(time, whole.muscle_names, envelope),
        plates=FrozenMap(plates),
        sites=sites,
        touching=_touching(truth, known, sites),
        builds=FrozenMap(dict(builds)),
        truth=truth,
    )


def pair_sites(builds: Mapping[str, fighter.Build], directed: bool = False) -> tuple[Site, ...]:
    """Return the sites of contact: heels and toes of the four feet, and the two grips.

    With `directed`, grips can only be pulled, straight ahead of tori's trunk, the lapel within 45
    degrees and the sleeve within 27; else force may pass them any way.
    """
    sites = []
    for foot in FEET:
        part, _, side = foot.split("_")
        corners = {name: builds[part].size * at for name, at in fighter.sole_points(side).items()}
        for end in ("heel", "toe"):
            points = np.array([at for name, at in corners.items() if name.startswith(end)])
            sites.append(Site(f"{foot}_{end}", foot, points, group=foot))
    lapel = Cone(direction=None)
    sleeve = Cone(direction=None)
    if directed:
        lapel = Cone(np.array([1.0, 0.0, 0.0]), "tori_torso", friction=1.0)
        sleeve = Cone(np.array([1.0, 0.0, 0.0]), "tori_torso", friction=0.5)
    fist = (builds["tori"].size * np.array(fighter.GRIP))[None]
    sites.append(
        Site(name="lapel", body="tori_forearm_r", points=fist, cone=lapel, against="uke_torso")
    )
    sites.append(
        Site(
            name="sleeve", body="tori_forearm_l", points=fist, cone=sleeve, against="uke_forearm_r"
        )
    )
    return tuple(sites)


def _touching(truth: PairTruth, models: Mapping[str, Model], sites: tuple[Site, ...]) -> Series:
    values = np.ones((len(truth.motion), len(sites)))
    for index, site in enumerate(sites):
        if site.group in FEET:
            model = models[site.group.partition("_")[0]]
            weight = model.mass * float(np.linalg.norm(model.gravity))
            values[:, index] = truth.forces[site.group][:, 1] > LOADED * weight
    return Series(truth.motion.time, tuple(site.name for site in sites), values)
