"""Limbs whose instruments and models are in error: what is found of them, and how often intervals hold it.

Every limb is simulated by MuJoCo with a part of its mass loose on it, seen by a plate and markers whose errors are
drawn, and identified as a study does, from a model whose joint's center and muscle attachments are off.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import myomorph as mm
from benchmarks.accuracy.viscosity.handling import Clamp, base_load, resting_wrench, slipped, still
from myomorph.model.arrays import Array
from myomorph.model.provenance import Estimate
from myomorph.model.series import Wrenches
from myomorph.simulate.laboratory import Noise, Sampled, measured_markers, measured_wrench, simulate
from myomorph.simulate.limb import BaseLoad, HeldLimb, SoftTissue, fixed_points, swing_mjcf
from myomorph.simulate.shoulder import BASE, FIRST, FURTHER, HELD, PLATE, STEP, arm_specimen, hanging, mounted, released
from myomorph.viscosity.cohort import SPECIMENS, specimen_row
from myomorph.viscosity.identification.base_load import BaseLoad as BaseMass
from myomorph.viscosity.identification.budget import ErrorOptions
from myomorph.viscosity.identification.identify import QUANTITIES_OF, is_narrow
from myomorph.viscosity.specimen.model import Specimen, SwingTrial
from myomorph.viscosity.study.conditions import Prepared, identify_conditions
from myomorph.viscosity.study.plan import SpecimenFiles, StudyOptions
from myomorph.viscosity.tracking.track import track
from myomorph.viscosity.trust.checks import TOO_SMALL, condition_findings
from myomorph.viscosity.trust.moment_arms import MomentArmOptions

Row = dict[str, object]

LIMBS = 100
LEVEL = 0.9
SECONDS, TRIALS = 8.0, 3
EVERY = 4
"""Of the markers' frames and the plate's samples, which are used: 50 and 500 Hz."""
WORKERS = 2
QUANTITIES = {
    "joint_viscosity": "d_J",
    "muscle_viscosity": "d_M",
    "mass_muscles_removed": "mass, muscles removed",
    "mass_intact": "mass, intact",
    "com_muscles_removed": "mass center, muscles removed",
    "com_intact": "mass center, intact",
}
"""What is judged, by the names of `cohort.QUANTITIES`."""
BONES = (BASE, FIRST, *FURTHER)
ARM = 0.02
"""A moment arm of a shoulder muscle [m]."""


@dataclass(frozen=True)
class Faults:
    """What is wrong with instruments and model of one limb; all zero where nothing is.

    Attributes
    ----------
    plate, turn : error of the plate's place [m] and of its axes [rad], (3,) each
    force, moment : relative errors of the gains (3,) each
    clock, drift : of the plate [s], [s/s]
    center : of the joint in the model, along ground's axes while the limb hangs (3,) [m]
    clusters : (2, 3) of base and limb against their bones [m]
    tissue : share of the limb's mass that is loose, muscles removed and intact; 0 for none
    frequency, damping : of the loose mass
    attachments : standard deviation of the places of the model's muscle points, of each muscle on each bone [m]
    loads : at rest on the base, muscles removed and intact [kg]
    tared : whether the plate was recorded with the first of these and without the limb, and the second is stated
    friction : dry, of the joint [N m]
    sway : by which the base turns to and fro [rad]; it then has a load
    slip : of one bone's cluster, in one trial of one condition and all later ones [m]
    """

    plate: Sequence[float] = (0.0, 0.0, 0.0)
    turn: Sequence[float] = (0.0, 0.0, 0.0)
    force: Sequence[float] = (0.0, 0.0, 0.0)
    moment: Sequence[float] = (0.0, 0.0, 0.0)
    clock: float = 0.0
    drift: float = 0.0
    center: Sequence[float] = (0.0, 0.0, 0.0)
    clusters: Sequence[Sequence[float]] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    tissue: tuple[float, float] = (0.0, 0.0)
    frequency: float = 8.0
    damping: float = 0.2
    attachments: float = 0.0
    loads: tuple[float, float] = (0.0, 0.0)
    tared: bool = False
    friction: float = 0.0
    sway: float = 0.0
    slip: float = 0.0


class LimbRun(NamedTuple):
    """One limb, its truth and what was found, by the names of `QUANTITIES`.

    Attributes
    ----------
    laws : chosen of the conditions, muscles removed first
    refused : viscosities that were withheld, and why conditions could not be used
    findings : kind, place and condition of what is named
    slip : condition, trial and bone of a cluster that slips
    """

    seed: int
    truth: dict[str, float]
    found: dict[str, Estimate]
    laws: tuple[str, ...]
    refused: tuple[str, ...]
    findings: tuple[tuple[str, str, str], ...]
    slip: tuple[str, str, str] | None


def random_faults(random: np.random.Generator, scale: float = 1.0) -> Faults:
    """Faults drawn with the standard deviations that `ErrorOptions` assumes by default, times `scale`."""
    sds = ErrorOptions()

    def three(sd: float) -> Array:
        return scale * sd * random.standard_normal(3)

    return Faults(
        three(sds.plate_position),
        three(sds.plate_rotation),
        three(sds.force_gain),
        three(sds.moment_gain),
        random.uniform(-0.03, 0.03),
        random.uniform(-5e-5, 5e-5),
        three(sds.joint_center),
        scale * 5e-4 * random.standard_normal((2, 3)),
        (random.uniform(0.0, 0.05), random.uniform(0.05, 0.15)),
        random.uniform(6.0, 12.0),
        random.uniform(0.1, 0.4),
        scale * MomentArmOptions().offset,
    )


@dataclass(frozen=True, eq=False)
class FaultyLimb:
    """A limb as a laboratory hands it over, and its truth.

    Attributes
    ----------
    known : the specimen out of the laboratory's model
    trials : by condition
    truth : by the names of `QUANTITIES`
    slip : condition, trial and bone of a cluster that slips; None where none does
    """

    known: Specimen
    trials: dict[str, list[SwingTrial]]
    truth: dict[str, float]
    slip: tuple[str, str, str] | None = None


def faulty_limb(seed: int, faults: Faults, damping: float | None) -> FaultyLimb:
    """A limb of one of the six published sizes; viscosities are drawn unless the joint's is given."""
    random = np.random.default_rng(seed)
    row = SPECIMENS[seed % len(SPECIMENS)]
    specimen = arm_specimen()
    specimen = specimen.standing(mounted(specimen.stand, random))
    limb = HeldLimb(specimen, HELD)
    bare = limb.parameters(row.mass_muscles_removed, row.com_muscles_removed)
    whole = limb.with_flesh(bare, row.mass_intact, row.com_intact)
    damping = damping or float(np.exp(random.uniform(np.log(0.03), np.log(0.1))))
    muscle = random.uniform(0.02, 0.06) / (len(specimen.model.muscles) * ARM**2)
    hand, elbow = (limb.poses[specimen.limb[i]].translation for i in (-1, 1))
    starts = [released(random) for _ in range(TRIALS)]
    trials: dict[str, list[SwingTrial]] = {}
    loads = [base_load(limb, mass, random) if mass > 0.0 else None for mass in faults.loads]
    tare = None
    if faults.tared and loads[0] is not None:
        tare = _on_plate(limb, still(resting_wrench(limb, loads[0]), 3.0, STEP), faults, random)
    slip = None
    if faults.slip > 0.0:
        slip = (str(random.choice(["without", "with"])), int(random.integers(TRIALS)), str(random.choice(BONES)))
    for name, parameters, own, share, place, load in (
        ("without", bare, 0.0, faults.tissue[0], 0.8 * hand, loads[0]),
        ("with", whole, muscle, faults.tissue[1], 0.5 * elbow, loads[1]),
    ):
        tissue = None
        if share > 0.0:
            tissue = SoftTissue(tuple(place), share * float(parameters[0]), faults.frequency, faults.damping)
        swings = _swings(limb, parameters, damping, own, tissue, starts, load, faults)
        trials[name] = [
            replace(_measured(limb, *swing, f"{name} {number}", faults, random), tare=tare)
            for number, swing in enumerate(swings, 1)
        ]
        if slip is not None and slip[0] == name:
            exact = [swing[0] for swing in swings]
            trials[name] = _slipping(limb, trials[name], exact, slip[1], slip[2], faults.slip, random)
    known = specimen.centered(
        specimen.center + specimen.stand.rotation.T @ np.array(faults.center) + np.array(faults.clusters[0]),
        specimen.center_in_limb + hanging(limb, whole).T @ np.array(faults.center) + np.array(faults.clusters[1]),
    )
    known = replace(known, model=with_moved_attachments(known.model, faults.attachments, random))
    truth = {"joint_viscosity": damping, "muscle_viscosity": muscle}
    for name, one in (("muscles_removed", bare), ("intact", whole)):
        truth |= {f"mass_{name}": float(one[0]), f"com_{name}": float(np.linalg.norm(one[1:4]) / one[0])}
    named = None if slip is None else (slip[0], f"{slip[0]} {slip[1] + 1}", slip[2])
    return FaultyLimb(known, trials, truth, named)


def with_moved_attachments(model: mm.Model, sd: float, random: np.random.Generator) -> mm.Model:
    """The model whose muscles' points are off, all points of a muscle on one bone alike; paths keep their surfaces."""
    if sd <= 0.0:
        return model
    muscles = []
    for muscle in model.muscles:
        points = fixed_points(muscle)
        off = {body: sd * random.standard_normal(3) for body in dict.fromkeys(point.body for point in points)}
        moved = tuple(replace(point, location=np.add(point.location, off[point.body])) for point in points)
        muscles.append(replace(muscle, path=replace(muscle.path, points=moved)))
    return replace(model, muscles=tuple(muscles))


def _swings(
    limb: HeldLimb,
    parameters: Array,
    damping: float,
    muscle: float,
    tissue: SoftTissue | None,
    starts: Sequence[tuple[Array, Array]],
    load: BaseLoad | None,
    faults: Faults,
) -> list[tuple[Sampled, Clamp | None, Array]]:
    """Every swing, and how the base turns in it (frames, 3, 3)."""
    rest = hanging(limb, parameters)
    loose = np.zeros(0 if tissue is None else 3)
    states = [
        (
            np.append(Rotation.from_rotvec(rest.T @ axis).as_quat(scalar_first=True), loose),
            np.append(rest.T @ rates, loose),
        )
        for axis, rates in starts
    ]
    text = {
        "limb": limb,
        "parameters": parameters,
        "stand": limb.specimen.stand,
        "rest": rest,
        "damping": damping,
        "muscle": muscle,
        "tissue": tissue,
        "load": load,
    }
    if faults.sway > 0.0 and load is not None:
        clamp = Clamp(limb, parameters, load)
        return [(exact, clamp, turns) for exact, turns in clamp.swings(text, states, faults.sway, SECONDS, STEP)]
    compiled = mujoco.MjModel.from_xml_string(swing_mjcf(**text))
    first = compiled.joint("joint").dofadr[0]
    compiled.dof_frictionloss[first : first + 3] = faults.friction
    return [(simulate(compiled, *state, SECONDS, STEP), None, np.zeros(0)) for state in states]


def _measured(
    limb: HeldLimb, exact: Sampled, clamp: Clamp | None, turns: Array, name: str, faults: Faults,
    random: np.random.Generator,
) -> SwingTrial:  # fmt: skip
    """A swing as markers and a plate with faults measure it, every `EVERY`-th sample."""
    specimen = limb.specimen
    noise = Noise(offset=faults.clock, drift=faults.drift)
    center = specimen.center_in_ground
    on_base, on_limb = limb.markers()
    at_base = {marker: center + specimen.stand.rotation @ place for marker, place in on_base.items()}
    markers = measured_markers(exact, center, at_base, on_limb, noise, random)
    if clamp is not None:
        frames = np.searchsorted(exact.time, markers.time - 1e-9)
        markers = clamp.moved(markers, turns[frames], center, len(on_base))
    wrenches = _on_plate(limb, exact, faults, random)
    return SwingTrial(name, replace(markers, time=markers.time[::EVERY], values=markers.values[::EVERY]), wrenches)


def _on_plate(limb: HeldLimb, exact: Sampled, faults: Faults, random: np.random.Generator) -> Wrenches:
    """The wrench of a swing as a plate with faults measures it."""
    center, noise = limb.specimen.center_in_ground, Noise(offset=faults.clock, drift=faults.drift)
    wrenches = measured_wrench(exact, center, center + PLATE, limb.specimen.base, noise, random)
    turn = Rotation.from_rotvec(faults.turn).as_matrix()
    return replace(
        wrenches,
        time=wrenches.time[::EVERY],
        forces=(wrenches.forces * (1.0 + np.array(faults.force)) @ turn.T)[::EVERY],
        torques=(wrenches.torques * (1.0 + np.array(faults.moment)) @ turn.T)[::EVERY],
        points=(wrenches.points + np.array(faults.plate))[::EVERY],
    )


def _slipping(
    limb: HeldLimb, trials: list[SwingTrial], exact: list[Sampled], first: int, bone: str, size: float,
    random: np.random.Generator,
) -> list[SwingTrial]:  # fmt: skip
    """The trials, in which a bone's cluster moves on it in the middle of the trial `first`, and stays there."""
    by = random.standard_normal(3)
    by *= size / np.linalg.norm(by)
    names = {marker.name for marker in limb.specimen.model.markers if marker.body == bone}
    at = random.uniform(0.25, 0.75) * SECONDS
    result = trials[:first]
    for trial, swing in zip(trials[first:], exact[first:], strict=True):
        columns = [column for column, name in enumerate(trial.markers.names) if name in names]
        rotations = swing.rotations[np.searchsorted(swing.time, trial.markers.time - 1e-9)]
        if bone == limb.specimen.base:
            rotations = np.broadcast_to(limb.specimen.stand.rotation, rotations.shape)
        result.append(replace(trial, markers=slipped(trial.markers, columns, rotations, by, at)))
        at = -np.inf
    return result


def limb_run(given: tuple[int, Faults, float | None], level: float = LEVEL) -> LimbRun:
    """A limb, by its seed, its faults and its viscosity if that is not drawn, as a study identifies it."""
    seed = given[0]
    limb = faulty_limb(*given)
    settings: dict[str, dict[str, float]] = {"identification": {"level": level, "seed": seed}}
    if given[1].attachments <= 0.0:
        # Muscles that lie where the model has them: a laboratory that digitized them says so.
        settings["moment_arms"] = {"offset": 0.0}
    options = StudyOptions.of(settings)
    tracked = {}
    for name, trials in limb.trials.items():
        one = track(limb.known, trials, options.tracking)
        tracked[name] = Prepared(one, one.notes)
    load = BaseMass()
    if given[1].tared:
        load = BaseMass((0.0, 0.0), (0.0, 2.0 * (given[1].loads[1] - given[1].loads[0])))
    files = SpecimenFiles(str(seed), Path(), base_load=load)
    result = identify_conditions(limb.known, files, tracked, options)
    refused = [
        QUANTITIES_OF[name][-1]
        for name, one in result.by_swings.conditions.items()
        if any(finding.kind == TOO_SMALL for finding in condition_findings(one))
    ]
    muscles = result.by_swings.muscles
    if muscles is not None and not is_narrow(muscles.common):
        refused.append("muscle_viscosity")
    row = dict(specimen_row(result.found))
    laws = tuple(one.chosen.name for one in result.compared.values())
    found = {name: row[name] for name in limb.truth if name in row}
    findings = [
        (finding.kind, finding.place, name) for name, one in result.conditions.items() for finding in one.findings
    ]
    if any("dry friction" in note for note in result.found.notes):
        findings.append(("dry friction", "joint", "without"))
    return LimbRun(seed, limb.truth, found, laws, (*refused, *result.lost), tuple(findings), limb.slip)


def limb_runs(given: Sequence[tuple[int, Faults, float | None]], level: float = LEVEL) -> list[LimbRun]:
    """Runs on both cores, a process each."""
    with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
        return list(pool.imap(partial(limb_run, level=level), given, chunksize=4))


SYSTEMATIC: dict[str, Faults] = {
    "nothing": Faults(),
    "plate 5 mm off along x": Faults(plate=(0.005, 0.0, 0.0)),
    "plate 5 mm off along y": Faults(plate=(0.0, 0.005, 0.0)),
    "plate 5 mm off upwards": Faults(plate=(0.0, 0.0, 0.005)),
    "plate turned by 1 degree about each axis": Faults(turn=(0.0175, 0.0175, 0.0175)),
    "moment gains +2, -1, +2 %": Faults(moment=(0.02, -0.01, 0.02)),
    "force gains +0.5, -0.5, +0.5 %": Faults(force=(0.005, -0.005, 0.005)),
    "model's joint center 8 mm off": Faults(center=(0.0046, 0.0046, 0.0046)),
    "model's joint center 3 mm off": Faults(center=(0.0, 0.003, 0.0)),
    "clusters 1 mm off their bones": Faults(clusters=((0.001, 0.0, 0.0), (0.0, 0.001, 0.0))),
    "clock 20 ms and 50 millionths off": Faults(clock=0.02, drift=5e-5),
    "3 and 10 % of the mass loose at 8 Hz": Faults(tissue=(0.03, 0.1)),
    "all of these at once": Faults(
        (0.003, -0.003, 0.003),
        (0.005, -0.005, 0.005),
        (0.005, -0.005, 0.005),
        (0.02, -0.01, 0.02),
        0.02,
        5e-5,
        (0.0046, 0.0046, 0.0046),
        ((0.001, 0.0, 0.0), (0.0, 0.001, 0.0)),
        (0.03, 0.1),
    ),
}
"""What may be wrong with one limb; the limb and its releases are the same in every row."""
FIXED, DAMPING = 3, 0.055
"""Seed of that limb, and its viscosity [N m s/rad]."""


def measure_systematic() -> Iterable[Row]:
    """A row a fault: errors of what is found, their intervals, and whether these hold the truth."""
    runs = limb_runs([(FIXED, faults, DAMPING) for faults in SYSTEMATIC.values()])
    for name, one in zip(SYSTEMATIC, runs, strict=True):
        row: Row = {"wrong": name}
        for quantity in ("joint_viscosity", "muscle_viscosity", "mass_muscles_removed", "com_muscles_removed"):
            row[f"{QUANTITIES[quantity]}: error (90 % interval)"] = _told(one, quantity)
        yield row | {"laws chosen": "; ".join(one.laws), "withheld": len(one.refused)}


def _told(one: LimbRun, quantity: str) -> str:
    if quantity not in one.found:
        return "withheld"
    found, truth = one.found[quantity], one.truth[quantity]
    error, low, high = (100.0 * (value / truth - 1.0) for value in (found.value, found.low, found.high))
    return f"{error:+.2f} % ({low:+.2f} to {high:+.2f}{'' if found.holds(truth) else ', misses'})"


def measure_coverage() -> Iterable[Row]:
    """A row a quantity over `LIMBS` limbs with random faults, then what laws were chosen and what was withheld."""
    runs = limb_runs([(seed, random_faults(np.random.default_rng(1000 + seed)), None) for seed in range(LIMBS)])
    for quantity, label in QUANTITIES.items():
        own = [(one.found[quantity], one.truth[quantity]) for one in runs if quantity in one.found]
        errors = np.array([100.0 * (found.value / truth - 1.0) for found, truth in own])
        widths = np.array([50.0 * (found.high - found.low) / truth for found, truth in own])
        held = sum(found.holds(truth) for found, truth in own)
        yield {
            "quantity": label,
            "of limbs": len(own),
            "error RMS": f"{np.sqrt(np.mean(errors**2)):.2f} %",
            "mean": f"{errors.mean():+.2f} %",
            "largest": f"{np.abs(errors).max():.2f} %",
            "median half-width": f"{np.median(widths):.2f} %",
            "90 % intervals that hold": f"{held} ({100.0 * held / max(len(own), 1):.0f} %)",
        }
    plain = {"viscosity", "muscles"}
    wrong = sum(any(set(law.split(" + ")) - plain for law in one.laws) for one in runs)
    refused = sum(bool(one.refused) for one in runs)
    for label, count in (("a law with more than equations 1 to 3 chosen", wrong), ("a viscosity withheld", refused)):
        yield {"quantity": f"{label}: {count} limbs", "of limbs": len(runs)}
