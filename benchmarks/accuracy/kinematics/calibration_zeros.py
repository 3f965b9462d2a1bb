"""Zero angles of calibrated models against experts'.

Lengths of simulated people of unequal legs are compared too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.kinematics.calibration import GAIT, OPENCAP, RAJAGOPAL, recorded, tracked
from benchmarks.accuracy.kinematics.calibration_static import KNEE, implant_markers, implant_names
from myomorph.body.calibrate.calibration import Calibration
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.io.osim.setup_parts import read_marker_set
from myomorph.core.model.arrays import Array
from myomorph.core.model.scale import scale
from myomorph.core.motion.lengths import Length, factors_of, lengths_of, mirrored_lengths
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

LEG = ("pelvis", "hip", "knee", "ankle", "subtalar", "lumbar")
FRAMES = 100
LONGER = 0.09
"""Right thigh and shank of the simulated people with unequal legs, as a share."""

SKIN = 0.005
"""Root mean square of the skin's motion along each axis [m]."""

SLIDE_TURN = 0.05
"""Root mean square turn of a segment's skin as one piece about each axis [rad]."""

PEOPLE = 8
FEW = 4
SHORT = 60
"""Simulated people in each row of the zero angles, and their frames."""

SIMULATED = ("gait2354 walk", "Rajagopal walk")


@dataclass(frozen=True, eq=False)
class Scaled:
    """A recording and a model of the same person that an expert scaled.

    `chosen`: whether settings were chosen with this recording in view.
    """

    name: str
    generic: mm.Model
    expert: mm.Model
    motion: mm.Markers
    static: mm.Markers
    chosen: bool


def measure_zeros(folder: Path) -> Iterator[dict[str, object]]:
    """Mean angles of both models over the motion, with and without the static trial."""
    for one in scaled(folder):
        for static in (None, one.static):
            found = mm.calibrate(one.generic, [one.motion], mm.CalibrationOptions(static=static))
            yield {
                "recording": one.name,
                "settings chosen on it": one.chosen,
                "static trial": static is not None,
                "markers off, of the usual": found.marker_spread,
                **compared_zeros(found, one.expert, one.motion),
            }


def compared_zeros(found: Calibration, expert: mm.Model, motion: mm.Markers) -> dict[str, object]:
    """Compare angles of pelvis, trunk and legs with the expert's.

    The row has means less the expert's, and how many lie within 5 degrees or the interval.
    """
    rows = np.unique(np.linspace(0, len(motion) - 1, min(FRAMES, len(motion))).astype(int))
    part = mm.Markers(motion.time[rows], motion.names, motion.values[rows])
    names = tuple(
        name
        for name in part.names
        if name in found.model.marker_names and name in expert.marker_names
    )
    ours = tracked(found.model, part, names).motion
    theirs = tracked(expert, part, names).motion
    zeros = {one.coordinate: one for one in found.zero_angles}
    shared = [
        name
        for name in ours.names
        if name in zeros and name in theirs.names and name.startswith(LEG)
    ]
    apart = np.degrees([_mean_difference(ours, theirs, name) for name in shared])
    sd = np.degrees([zeros[name].sd for name in shared])
    inside = np.abs(apart) <= half_width(sd)
    ankle = [i for i, name in enumerate(shared) if name.startswith("ankle")]
    worst = int(np.argmax(np.abs(apart)))
    return {
        "angles": len(shared),
        "difference, RMS [deg]": float(np.sqrt(np.mean(apart**2))),
        "worst": f"{shared[worst]} {apart[worst]:+.1f} (±{half_width(sd[worst]):.1f})",
        "ankles [deg]": ", ".join(f"{apart[i]:+.1f} (±{half_width(sd[i]):.1f})" for i in ankle),
        "in the 90 % interval [%]": 100.0 * float(np.mean(inside)),
        "there or within 5 deg [%]": 100.0 * float(np.mean(inside | (np.abs(apart) <= 5.0))),
    }


def _mean_difference(ours: mm.Motion, theirs: mm.Motion, name: str) -> float:
    apart = ours.values[:, ours.names.index(name)] - theirs.values[:, theirs.names.index(name)]
    return float(np.nanmean((apart + np.pi) % (2.0 * np.pi) - np.pi))


def scaled(folder: Path) -> Iterator[Scaled]:
    """All recordings with an expert's model; data sets that are absent are left out."""
    opencap = folder / OPENCAP
    gait = folder / GAIT
    rajagopal = folder / RAJAGOPAL
    if opencap.is_dir():
        generic = mm.read_model(opencap / "models/unscaled_generic.osim")
        expert = mm.read_model(opencap / "models/manually_scaled.osim")
        static = recorded(opencap / "markers", "static1.trc")
        for name in ("walking1", "STS1", "DJ1"):
            motion = recorded(opencap / "markers", f"{name}.trc")
            yield Scaled(
                name=f"OpenCap {name}",
                generic=generic,
                expert=expert,
                motion=motion,
                static=static,
                chosen=True,
            )
        if (folder / KNEE).is_dir():
            expert = implant_names(mm.read_model(folder / KNEE / "scaled.osim"))
            static = implant_markers(recorded(folder / KNEE, "static.trc"))
            motion = implant_markers(recorded(folder / KNEE, "walk1.trc"))
            yield Scaled(
                name="knee implant walk1",
                generic=generic,
                expert=expert,
                motion=motion,
                static=static,
                chosen=False,
            )
    if gait.is_dir():
        generic = _with_set(
            gait / "experiment/gait2354_simbody.osim",
            gait / "experiment/gait2354_Scale_MarkerSet.xml",
        )
        expert = mm.read_model(gait / "ref_scale/std_subject01_simbody.osim")
        static = recorded(gait / "experiment", "subject01_static.trc")
        motion = recorded(gait / "experiment", "subject01_walk1.trc")
        yield Scaled(
            name="gait2354 walk",
            generic=generic,
            expert=expert,
            motion=motion,
            static=static,
            chosen=True,
        )
    if rajagopal.is_dir():
        generic = _with_set(
            rajagopal / "raw/Rajagopal2016.osim", rajagopal / "raw/markerset_walk_preScale.xml"
        )
        expert = mm.read_model(rajagopal / "subject_walk_scaled.osim")
        motion = recorded(rajagopal, "markers_walk.trc")
        static = recorded(rajagopal / "raw", "static_walk_2.trc")
        yield Scaled(
            name="Rajagopal walk",
            generic=generic,
            expert=expert,
            motion=motion,
            static=static,
            chosen=True,
        )


def _with_set(file: Path, markers: Path) -> mm.Model:
    model = mm.read_model(file)
    return model.with_markers(read_marker_set(markers, model))


def measure_unequal(folder: Path) -> Iterator[dict[str, object]]:
    """Measure thighs and shanks of simulated people with equal and with unequal legs.

    They walk like a recorded person.
    """
    for one in scaled(folder):
        if one.name not in ("OpenCap walking1", "gait2354 walk"):
            continue
        rows = np.unique(np.linspace(0, len(one.motion) - 1, FRAMES).astype(int))
        part = mm.Markers(one.motion.time[rows], one.motion.names, one.motion.values[rows])
        names = tuple(name for name in part.names if name in one.expert.marker_names)
        motion = tracked(one.expert, part, names).motion
        for longer in (0.0, LONGER):
            errors = []
            deviations = []
            warned = 0
            for seed in range(PEOPLE):
                values, markers = walker(one.generic, motion, longer, seed)
                found = mm.calibrate(one.generic, [markers])
                chosen = [
                    i
                    for i, est in enumerate(found.lengths)
                    if est.length.along and est.length.segment.startswith(("femur", "tibia"))
                ]
                extents = np.array([found.lengths[i].length.extent for i in chosen])
                errors.append(
                    1e3 * extents * ([found.lengths[i].factor for i in chosen] - values[chosen])
                )
                deviations.append(1e3 * extents * [found.lengths[i].sd for i in chosen])
                warned += any(side.differs for side in found.sides)
            error = np.array(errors)
            sd = np.array(deviations)
            yield {
                "walk": one.name,
                "right leg longer [%]": 100.0 * longer,
                "people": PEOPLE,
                "thighs and shanks off, RMS [mm]": float(np.sqrt(np.mean(error**2))),
                "largest [mm]": float(np.abs(error).max()),
                "stated SD [mm]": float(sd.mean()),
                "in the 90 % interval [%]": 100.0 * float(np.mean(np.abs(error) <= half_width(sd))),
                "sides reported to differ [%]": 100.0 * warned / PEOPLE,
            }


def walker(
    generic: mm.Model, motion: mm.Motion, longer: float, seed: int
) -> tuple[Array, mm.Markers]:
    """Draw a random person that moves as recorded.

    Lengths vary by 4 % about the size, sides by 0.6 %. Markers lie 12 mm (landmarks 6 mm) off their
    positions along each axis. The skin moves by `SKIN` along each axis with the three lowest
    harmonics of the recording.

    Parameters
    ----------
    generic : model
    motion : recorded
    longer : factor of one leg
    seed : of the person

    Returns
    -------
    Factors of the lengths, and markers
    """
    rng = np.random.default_rng(seed)
    values, person = _person(generic, longer, rng)
    return values, _on_skin(person, motion, rng)


def _person(generic: mm.Model, longer: float, rng: np.random.Generator) -> tuple[Array, mm.Model]:
    lengths = lengths_of(generic)
    values = _factors(lengths, rng, longer)
    person = scale(generic, factors_of(lengths, values))
    return values, person.with_markers(
        tuple(
            replace(
                one, location=one.location + (0.006 if one.fixed else 0.012) * rng.normal(size=3)
            )
            for one in person.markers
        )
    )


def _on_skin(
    person: mm.Model, motion: mm.Motion, rng: np.random.Generator, slides: bool = False
) -> mm.Markers:
    """Return markers while the person moves so.

    With `slides`, all skin of a segment also shifts and rotates as one piece.
    """
    tree = compile_tree(person)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    bodies = np.array([tree.body_index[one.body] for one in person.markers])
    local = np.array([one.location for one in person.markers])
    places = poses.points(bodies, local)
    phase = (
        np.linspace(0.0, 2.0 * np.pi, len(places))
        if len(places) > 1
        else rng.uniform(0.0, 2.0 * np.pi, 1)
    )
    waves = np.column_stack(
        [wave(n * phase) for n in (1, 2, 3) for wave in (np.sin, np.cos)]
    ) * np.sqrt(2.0 / 6.0)
    skin = np.einsum("fk,kmi->fmi", waves, SKIN * rng.normal(size=(6, len(bodies), 3)))
    for body in np.unique(bodies) if slides else ():
        of = bodies == body
        shift = waves @ (SKIN * rng.normal(size=(6, 3)))
        turn = waves @ (SLIDE_TURN * rng.normal(size=(6, 3)))
        skin[:, of] += shift[:, None] + np.cross(
            turn[:, None], (local[of] - local[of].mean(axis=0))[None]
        )
    places = places + np.einsum("fmij,fmj->fmi", poses.rotations[:, bodies], skin)
    return mm.Markers(
        motion.time, person.marker_names, places + 2e-4 * rng.normal(size=places.shape)
    )


def measure_simulated(folder: Path) -> Iterator[dict[str, object]]:
    """Measure zero angles of simulated people whose skin slides as one piece.

    They are calibrated with and without a static trial.
    """
    for one in scaled(folder):
        if one.name not in SIMULATED:
            continue
        walk = expert_motion(one, one.motion, SHORT)
        stand = expert_motion(one, one.static, 1)
        for slides in (False, True):
            drawn = [drawn_walker(one.generic, (walk, stand), seed, slides) for seed in range(FEW)]
            for static in (False, True):
                rows = [_simulated(one.generic, walk, person, static) for person in drawn]
                apart, sd, lengths = map(np.concatenate, zip(*rows, strict=True))
                yield {
                    "walk": one.name,
                    "skin slides as one": slides,
                    "static trial": static,
                    "people": FEW,
                    "angles": len(apart),
                    "difference, RMS [deg]": float(np.sqrt(np.mean(apart**2))),
                    "difference, maximum [deg]": float(np.abs(apart).max()),
                    "stated SD [deg]": float(np.sqrt(np.mean(sd**2))),
                    "in the 90 % interval [%]": 100.0
                    * float(np.mean(np.abs(apart) <= half_width(sd))),
                    "thighs and shanks in theirs [%]": 100.0 * float(np.mean(lengths)),
                }


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnWalker:
    """A simulated person with recordings.

    Attributes
    ----------
    factors : (lengths,) true ones of the generic model's lengths
    person : with markers where they are
    walk, stand : recorded markers
    """

    factors: Array
    person: mm.Model
    walk: mm.Markers
    stand: mm.Markers

    def calibrated(self, generic: mm.Model, static: bool) -> Calibration:
        """Calibrate the generic model.

        The person's bones are the generic ones, stretched: `zero_sd`, by which real ones are
        turned, is left out.
        """
        still = self.stand if static else None
        return mm.calibrate(generic, [self.walk], mm.CalibrationOptions(static=still, zero_sd=1e-9))


def drawn_walker(
    generic: mm.Model, motions: tuple[mm.Motion, mm.Motion], seed: int, slides: bool
) -> DrawnWalker:
    """Draw a person who walks and stands as recorded; if it `slides`, skin also moves as one."""
    rng = np.random.default_rng(seed)
    values, person = _person(generic, 0.0, rng)
    walk_motion, stand_motion = motions
    walk = _on_skin(person, walk_motion, rng, slides)
    stand = _on_skin(person, stand_motion, rng, slides)
    return DrawnWalker(factors=values, person=person, walk=walk, stand=stand)


def zero_errors(found: Calibration, walk: mm.Motion, markers: mm.Markers) -> tuple[Array, Array]:
    """Compare mean angles on the calibrated model with the true ones.

    Parameters
    ----------
    found : of the person who walked so
    walk : true motion
    markers : recorded of it

    Returns
    -------
    (angles,) errors and their stated standard deviations [rad]
    """
    ours = tracked(found.model, markers, found.marker_names).motion
    zeros = {one.coordinate: one.sd for one in found.zero_angles}
    names = [
        name for name in ours.names if name in zeros and name in walk.names and name.startswith(LEG)
    ]
    apart = np.array([_mean_difference(ours, walk, name) for name in names])
    return apart, np.array([zeros[name] for name in names])


def _simulated(
    generic: mm.Model, walk: mm.Motion, drawn: DrawnWalker, static: bool
) -> tuple[Array, Array, Array]:
    """Errors of the mean angles, their SD [deg], and whether lengths lie in their intervals."""
    found = drawn.calibrated(generic, static)
    apart, sd = zero_errors(found, walk, drawn.walk)
    inside = [
        abs(one.factor - value) <= half_width(one.sd)
        for one, value in zip(found.lengths, drawn.factors, strict=True)
        if one.length.along and one.length.segment.startswith(("femur", "tibia"))
    ]
    return np.degrees(apart), np.degrees(sd), np.array(inside)


def expert_motion(one: Scaled, markers: mm.Markers, count: int) -> mm.Motion:
    """Of the expert's model, at evenly chosen frames."""
    rows = np.unique(np.linspace(0, len(markers) - 1, count + 2)[1:-1].astype(int))
    part = mm.Markers(markers.time[rows], markers.names, markers.values[rows])
    return tracked(
        one.expert, part, tuple(name for name in part.names if name in one.expert.marker_names)
    ).motion


def _factors(lengths: tuple[Length, ...], rng: np.random.Generator, longer: float) -> Array:
    size = 1.0 + 0.05 * rng.normal()
    along = {one.segment: size * (1.0 + 0.04 * rng.normal()) for one in lengths if one.along}
    values = np.array(
        [along[one.segment] * (1.0 if one.along else 1.0 + 0.04 * rng.normal()) for one in lengths]
    )
    for right, left in mirrored_lengths(lengths):
        values[left] = values[right] * (1.0 + 0.006 * rng.normal())
    for i, one in enumerate(lengths):
        if one.along and one.segment in ("femur_r", "tibia_r"):
            values[i] *= 1.0 + longer
    return values
