"""Checks of a passive law on swings of known truth.

They are which law acted, what a held-out swing shows, and what wrong moment arms do.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import myomorph as mm
from myomorph.core.model.paths import PathPoint
from myomorph.swings.simulate.laboratory import (
    Instruments,
    measured_markers,
    measured_wrench,
    simulate,
)
from myomorph.swings.simulate.shoulder import Setup, virtual_specimen
from myomorph.swings.viscosity.identification.identify import (
    SpecimenViscosity,
    ViscosityOptions,
    identify_specimen,
)
from myomorph.swings.viscosity.specimen.model import Specimen
from myomorph.swings.viscosity.swings.motion import lengthening, limb_motion
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.tracking.track import track
from myomorph.swings.viscosity.tracking.tracked import swing_recordings
from myomorph.swings.viscosity.trust.cutoff import choose_cutoff, scan_cutoffs
from myomorph.swings.viscosity.trust.models import PassiveComparison, compare_passive_laws
from myomorph.swings.viscosity.trust.moment_arms import (
    OFFSET,
    MomentArmOptions,
    MomentArmSpread,
    moment_arm_sensitivity,
)
from truths.mechanical_joint import (
    BASE_MARKERS,
    CENTER,
    LIMB_MARKERS,
    PLATE,
    STEP,
    JointExperiment,
    VirtualJoint,
    mechanical_joint,
)

Row = dict[str, object]


class Resistance(NamedTuple):
    """What a virtual joint does against its motion; all axes alike."""

    kind: Literal["hinge", "ball"]
    viscosity: float
    stiffness: float = 0.0
    coulomb: float = 0.0
    quadratic: float = 0.0


JOINTS = (
    Resistance("hinge", 0.05),
    Resistance("ball", 0.05),
    Resistance("hinge", 0.05, stiffness=2.0),
    Resistance("ball", 0.05, stiffness=2.0),
    Resistance("hinge", 0.03, coulomb=0.03),
    Resistance("hinge", 0.03, quadratic=0.03),
    Resistance("hinge", 0.03, stiffness=1.0, coulomb=0.02),
)
SPECIMENS = range(1, 7)
CUTOFF = 7.0
"""Of the attachments' section [Hz]."""
WORKERS = 2


def measure_laws() -> Iterator[Row]:
    """Choose laws of joints with springs, dry friction and drag, seen with noise.

    The rows have what is chosen, and d with and without.
    """
    for seed, truth in enumerate(JOINTS):
        compared = compare_passive_laws(rubbing_joint(truth, seed).swings(8.0))
        alone = compared.fits[0]
        chosen = compared.chosen
        parts = {
            "stiffness": truth.stiffness,
            "coulomb": truth.coulomb,
            "quadratic": truth.quadratic,
        }
        others = [f"{name} {value:g}" for name, value in parts.items() if value]
        found = [
            f"{name} {one.value:.3g} ({one.low:.3g} to {one.high:.3g})"
            for name, one in chosen.coefficients.items()
            if not name.startswith("rest")
        ]
        yield {
            "joint": truth.kind,
            "truth": ", ".join([f"viscosity {truth.viscosity:g}", *others]),
            "chosen, with 95 % intervals": ", ".join(found),
            "viscosity alone": alone.coefficients["viscosity"].value,
            "its BIC above the best": float(alone.bic),
            "held-out angle, viscosity alone, chosen [deg]": _degrees(compared),
            "held-out force, viscosity alone, chosen [N]": (
                f"{alone.force_error:.3f}, {chosen.force_error:.3f}"
            ),
        }


def measure_specimens() -> Iterator[Row]:
    """Measure the six virtual specimens.

    The rows have laws chosen, held-out swings, d_M under wrong moment arms, and change with the
    cutoff.
    """
    with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
        yield from pool.imap(specimen_row, SPECIMENS)


def specimen_row(number: int) -> Row:
    """One specimen, through markers, plate and clocks."""
    made = virtual_specimen(number)
    tracked = [track(made.specimen, one.swing_trials()) for one in (made.without, made.intact)]
    cutoff = choose_cutoff(tracked).cutoff
    without, intact = tracked
    without = swing_recordings(without, cutoff)
    intact = swing_recordings(intact, cutoff)
    found = identify_specimen(f"{number}", without, intact, options=ViscosityOptions(draws=2))
    assert found.without is not None
    assert found.intact is not None
    laws = [compare_passive_laws(one) for one in (without, intact)]
    arms = moment_arm_sensitivity(intact, found.intact.parameters, found.without.viscosity.value)
    one, each, *_ = arms
    low, _, high = each.quantiles()
    scan = scan_cutoffs(
        lambda at: swing_recordings(tracked[0], at, muscles=False),
        (0.75 * cutoff, cutoff, 1.5 * cutoff),
    )
    return {
        "specimen": number,
        "cutoff [Hz]": cutoff,
        "mass, COM, d_J change from 0.75 to 1.5 of it [%]": ", ".join(
            f"{100 * x:.2f}" for x in np.abs(scan[[0, 2]] / scan[1] - 1.0).max(axis=0)
        ),
        "law without, with muscles": f"{laws[0].chosen.name}; {laws[1].chosen.name}",
        "held-out angle, viscosity alone, chosen [deg]": "; ".join(_degrees(law) for law in laws),
        "d_M, truth [N s/m]": f"{each.exact:.0f}, {made.muscle_viscosity:.0f}",
        "SD of d_M, each muscle's arms off by 10 % [%]": 100.0 * each.sd,
        "95 % of d_M so [N s/m]": f"{low:.0f} to {high:.0f}",
        "SD of d_M, all arms off by one 10 % [%]": 100.0 * one.sd,
    }


def measure_attachments() -> Iterator[Row]:
    """Move attachments of a specimen with muscles of full size on their bones.

    Offsets of its moment arms are tried instead.
    """
    made = virtual_specimen(1, trials=2, seconds=8.0, setup=Setup(full_size=True))
    tracked = [track(made.specimen, one.swing_trials()) for one in (made.without, made.intact)]
    without, intact = [swing_recordings(one, CUTOFF) for one in tracked]
    found = identify_specimen("1", without, intact, options=ViscosityOptions(draws=2))
    specimen = tracked[1].specimen
    motions = [mm.differentiate(one.motion, CUTOFF) for one in tracked[1].trials]
    random = np.random.default_rng(0)
    for size in (2e-3, 4e-3, OFFSET):
        values = []
        changes = []
        for _ in range(24):
            moved = _moved(specimen, size, random)
            arms = [
                lengthening(moved, motion, limb_motion(specimen, motion).slopes)
                for motion in motions
            ]
            changes += [(b - a.lengthening)[a.used] for a, b in zip(intact, arms, strict=True)]
            values.append(_exact(intact, arms, found))
        change = float(np.sqrt(np.mean([np.square(one).mean() for one in changes])))
        offset = _sensitivity(intact, found, MomentArmOptions(offset=size))[-1]
        yield {
            "attachments moved by, a component, SD [mm]": 1e3 * size,
            "moment arms change by, RMS [mm]": 1e3 * change,
            "SD of d_M [%]": 100.0 * float(np.std(values)) / offset.exact,
            "mean of d_M off [%]": 100.0 * (float(np.mean(values)) / offset.exact - 1.0),
            "by constant offsets of the arms: SD, mean off [%]": (
                f"{100 * offset.sd:.1f}, {100 * offset.bias:+.1f}"
            ),
        }


def _exact(
    intact: Sequence[SwingRecording], arms: Sequence[np.ndarray], found: SpecimenViscosity
) -> float:
    """Return d_M with other moment arms (frames, strands, axes) of each swing."""
    other = [replace(a, lengthening=np.nan_to_num(b)) for a, b in zip(intact, arms, strict=True)]
    return _sensitivity(other, found, MomentArmOptions(draws=2, offset=0.0))[0].exact


def _sensitivity(
    intact: Sequence[SwingRecording], found: SpecimenViscosity, options: MomentArmOptions
) -> Sequence[MomentArmSpread]:
    """Return how errors of moment arms change d_M, with the identified masses and joint."""
    assert found.without is not None
    assert found.intact is not None
    joint = found.without.viscosity.value
    return moment_arm_sensitivity(intact, found.intact.parameters, joint, options)


def _moved(specimen: Specimen, size: float, random: np.random.Generator) -> Specimen:
    """Return the specimen with every muscle's points moved on each bone.

    All points of one muscle on one bone move alike.
    """
    muscles = {one.name: one for one in specimen.model.muscles}
    for strands in specimen.muscles.values():
        shifts = {body: size * random.standard_normal(3) for body in specimen.model.body_names}
        for strand in strands:
            path = muscles[strand].path
            points = [
                (
                    replace(one, location=one.location + shifts[one.body])
                    if isinstance(one, PathPoint)
                    else one
                )
                for one in path.points
            ]
            muscles[strand] = replace(muscles[strand], path=replace(path, points=tuple(points)))
    kept = tuple(muscles[one.name] for one in specimen.model.muscles)
    return replace(specimen, model=replace(specimen.model, muscles=kept))


def rubbing_joint(truth: Resistance, seed: int) -> VirtualJoint:
    """Return a virtual joint with MuJoCo's dry friction and quadratic damping.

    It has damper and spring besides.
    """
    joint = mechanical_joint(
        truth.kind, truth.viscosity, truth.stiffness, seed, experiment=JointExperiment(seconds=20.0)
    )
    compiled = mujoco.MjModel.from_xml_string(joint.mjcf)
    compiled.dof_frictionloss[:] = truth.coulomb
    compiled.dof_dampingpoly[:, 0] = truth.quadratic
    random = np.random.default_rng(seed)
    base = {name: CENTER + place for name, place in BASE_MARKERS.items()}
    trials = []
    for one in joint.trials:
        rates = one.exact.rates[0]
        turn = Rotation.from_matrix(one.exact.rotations[0])
        angle = (
            turn.as_quat(scalar_first=True)
            if truth.kind == "ball"
            else joint.truth.directions @ turn.as_rotvec()
        )
        exact = simulate(
            compiled, angle, joint.truth.directions @ rates, float(one.exact.time[-1]), STEP
        )
        instruments = Instruments(joint.noise, random)
        markers = measured_markers(exact, CENTER, base, LIMB_MARKERS, instruments)
        wrench = measured_wrench(exact, CENTER, PLATE, "base", instruments)
        trials.append(replace(one, markers=markers, wrenches=wrench, exact=exact))
    return replace(joint, trials=tuple(trials))


def _degrees(compared: PassiveComparison) -> str:
    return ", ".join(
        f"{np.rad2deg(one.angle_error):.2f}" for one in (compared.fits[0], compared.chosen)
    )
