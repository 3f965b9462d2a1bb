"""The morphed mouse: its fibers and forces against an anatomist's.

Its behavior on recordings of mice is measured too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

import myomorph as mm
from benchmarks.mouse_morphed import (
    JOINTS,
    NOSE,
    Followed,
    followed,
    lengths_of,
    on_one_paw,
    recordings,
    stride_units,
    whole_animal,
    whole_mouse,
    with_arms,
)
from benchmarks.species_cases import MAN, MOUSE, from_man, man, mouse, sized_architecture
from myomorph.bones.morph.morphed import Architecture
from myomorph.bones.morph.species.counterparts import MuscleHomology
from myomorph.bones.morph.species.own_postures import fitted_to_postures
from myomorph.bones.study.species_morphing import read_species
from myomorph.core.model.paths import Muscle
from myomorph.core.model.sides import split_side
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.lab.analysis.groups import Animal, CurveDifference, Group, compare_groups
from truths.mouse_hindlimb import FILE, mouse_hindlimb_model
from truths.mouse_motion import clip_fits, part_of, rms
from truths.mouse_recordings import KEYPOINTS, with_keypoints

Row = dict[str, object]
Pairs = tuple[MuscleHomology, ...]


def _there(folder: Path) -> bool:
    return all((folder / one).is_file() for one in (FILE, MAN, MOUSE))


def _pairs(table: Mapping[str, Architecture]) -> Pairs:
    pairs = read_species("human-mouse").muscles
    return tuple(one for one in pairs if all(name in table for name in one.sources))


def measure_architecture(folder: Path) -> Iterator[Row]:
    """Compare forces and fibers, by their source, with the anatomist's table in its own size."""
    if not _there(folder):
        return
    source = man(folder)
    target = mouse(folder)
    truth = mouse_hindlimb_model(folder / FILE)
    table = read_species("human-mouse")
    first = table.architecture[0]
    every = sized_architecture(source, target)
    ways: dict[str, Mapping[str, Architecture]] = {
        "mouse's table (the anatomist's own: it must agree)": every,
        "rats' tables alone": sized_architecture(source, target, only="rat"),
    }
    held: dict[str, Architecture] = {}
    for pair in _pairs(every):
        out = tuple(row.name for row in first.rows if set(row.sources) & set(pair.sources))
        left = sized_architecture(source, target, leave_out=out)
        held |= {name: left[name] for name in pair.sources}
    ways["each muscle left out: rats at the mouse's level"] = held
    for how, found in ways.items():
        yield {"fibers and forces from": how, **_against(found, _pairs(found), truth)}


def _against(found: Mapping[str, Architecture], pairs: Pairs, truth: mm.Model) -> Row:
    """Compare force and fiber length with the anatomist's.

    The row has ranks, medians and ranges of their ratios, and how often intervals hold.
    """
    theirs = {one.name: one for one in truth.muscles}
    forces = np.array(
        [
            (
                sum(found[n].force for n in one.sources),
                sum(theirs[n].max_isometric_force for n in one.targets),
            )
            for one in pairs
        ]
    )
    fibers = np.array(
        [
            (
                np.mean([found[n].fiber for n in one.sources]),
                np.mean([theirs[n].optimal_fiber_length for n in one.targets]),
            )
            for one in pairs
        ]
    )
    row: Row = {"muscles": len(pairs)}
    for what, values, key in (
        ("force", forces, "force_interval"),
        ("fiber", fibers, "fiber_interval"),
    ):
        ratio = values[:, 0] / values[:, 1]
        row[f"{what}, rank correlation"] = float(spearmanr(*values.T).statistic)
        row[f"{what}, ratio: median (minimum to maximum)"] = (
            f"{np.median(ratio):.2f} ({ratio.min():.2f} to {ratio.max():.2f})"
        )
        limits = np.array([getattr(found[one.sources[0]], key) for one in pairs])
        level = ratio / np.median(ratio)
        holds = (1.0 / level >= limits[:, 0]) & (1.0 / level <= limits[:, 1])
        row[f"{what}, in its 90 % interval [%]"] = (
            100.0 * float(holds.mean()) if np.isfinite(limits).all() else float("nan")
        )
    return row


def measure_follows(folder: Path) -> Iterator[Row]:
    """Marker errors, strides and muscle lengths of the morphed mouse on each recording."""
    if not _there(folder):
        return
    for path in recordings(folder):
        one = followed(folder, path)
        free = rms(one.fit, one.knees)
        row: Row = {
            "recording": one.name,
            "frames": int(one.seen.sum()),
            "size": one.calibration.size,
            "all markers [mm]": 1e3 * rms(one.fit),
            "without knees [mm]": 1e3 * free,
            "without knees [% of body length]": 100.0 * free / one.body,
            "largest [mm]": 1e3 * float(np.nanmax(one.fit.largest)),
            "not converged": int((~one.fit.converged & one.seen).sum()),
        }
        found = None if one.name == "treadmill" else lengths_of(one)
        if found is not None:
            row["strides"] = sum(len(own) for own in found.strides.values())
            for muscle in ("vaslat", "gasmed", "tibant"):
                own = [each.excursion for each in found.ranges if each.muscle[:-2] == muscle]
                row[f"{muscle}, excursion [fiber lengths]"] = (
                    float(np.mean(own)) if own else float("nan")
                )
        yield row


def measure_postures(folder: Path) -> Iterator[Row]:
    """Fibers of the morphed mouse on each recording, before and after they follow the others'."""
    if not _there(folder):
        return
    every = {one.name: one for one in (followed(folder, path) for path in recordings(folder))}
    for name, one in every.items():
        others = [part_of(other.fit.motion, posed(other)) for other in every.values()]
        del others[list(every).index(name)]
        base = replace(from_man(folder, "SSD"), model=one.model)
        fitted = fitted_to_postures(base, others).model
        motion = part_of(one.fit.motion, posed(one))
        given = working_fibers(one.model, motion)
        follow = working_fibers(fitted, motion)
        early = part_of(motion, np.arange(len(motion) // 2))
        late = part_of(motion, np.arange(len(motion) // 2, len(motion)))
        own = working_fibers(fitted_to_postures(base, [early]).model, late)
        changed = [
            before.optimal_fiber_length != after.optimal_fiber_length
            for before, after in zip(one.model.muscles, fitted.muscles, strict=True)
        ]
        yield {
            "recording": name,
            "frames": len(motion),
            "muscles on the other side's bones": sum(astray(m) for m in one.model.muscles),
            "outside 0.5 to 1.5 fibers, tables' [%]": given.outside,
            "tables': shortest, longest": f"{given.shortest:.2f}, {given.longest:.2f}",
            "following the other recordings [%]": follow.outside,
            "so: shortest, longest": f"{follow.shortest:.2f}, {follow.longest:.2f}",
            "later frames, tables' [%]": working_fibers(one.model, late).outside,
            "following its own earlier frames [%]": own.outside,
            "muscles whose fibers changed": sum(changed),
            "longest muscle": follow.muscle,
        }


class WorkingFibers(NamedTuple):
    """Normalized fiber lengths over frames and muscles: share outside 0.5 to 1.5 [%], extremes."""

    outside: float
    shortest: float
    longest: float
    muscle: str


def working_fibers(model: mm.Model, motion: mm.Motion) -> WorkingFibers:
    """How far the fibers of all muscles are from where they pull, by a rigid tendon."""
    lengths = mm.muscle_kinematics(model, motion, moment_arms=False, velocities=False)
    fibers = np.stack(
        [
            (lengths.muscle_length[:, column] - muscle.tendon_slack_length)
            / (muscle.optimal_fiber_length * np.cos(muscle.pennation_at_optimal))
            for column, muscle in enumerate(model.muscles)
        ],
        axis=1,
    )
    return WorkingFibers(
        outside=100.0 * float(((fibers < 0.5) | (fibers > 1.5)).mean()),
        shortest=float(fibers.min()),
        longest=float(fibers.max()),
        muscle=model.muscle_names[int(fibers.max(axis=0).argmax())],
    )


def posed(one: Followed) -> NDArray[np.int64]:
    """Find the frames that have a pose and a marker.

    Parameters
    ----------
    one : a recording on the calibrated mouse

    Returns
    -------
    numbers of the frames
    """
    known = np.isfinite(one.fit.motion.values).all(axis=1)
    return np.flatnonzero(known & one.seen)


def astray(muscle: Muscle) -> bool:
    """Whether a muscle lies on a bone of another side than its name's."""
    sides = {split_side(point.body)[1] for point in muscle.path.points} - {""}
    return sides != {split_side(muscle.name)[1]}


def measure_tension(folder: Path) -> Iterator[Row]:
    """Measure what a paw that bears the plate's force requires of the muscles."""
    if not _there(folder):
        return
    for path in recordings(folder):
        one = followed(folder, path)
        if not one.trial.plates:
            continue
        found = on_one_paw(one)
        if found is None:
            yield {"recording": one.name, "paw": "none alone"}
            continue
        shares = found.shares()
        strongest = int(np.argmax(found.tension.muscle_force.max(axis=0)))
        yield {
            "recording": one.name,
            "paw": "right" if found.side == "R" else "left",
            "frames": len(found.motion),
            **{
                f"{joint.lower()} [N mm]": (
                    1e3 * float(np.abs(found.torques[found.coordinate(joint)]).max())
                )
                for joint in JOINTS
            },
            "reserves [% of torque]": 100.0 * found.share(),
            **{f"{joint.lower()} [%]": 100.0 * shares[joint] for joint in JOINTS},
            "strongest": (
                f"{found.tension.muscles[strongest]}:"
                f" {found.tension.muscle_force[:, strongest].max():.2g} N"
            ),
            "fully active (fiber length)": ", ".join(found.full(one.model)),
        }


def measure_reserves(folder: Path) -> Iterator[Row]:
    """Yield a row for each joint of the recordings whose reserves are large.

    It has what the muscles lack there, muscle by muscle.
    """
    if not _there(folder):
        return
    for path in recordings(folder):
        one = followed(folder, path)
        found = on_one_paw(one)
        if found is None or found.share() < LARGE:
            continue
        toes = on_one_paw(one, at_toes=True)
        assert toes is not None
        worst = found.worst
        full = found.moments(one.model)
        free = mm.inverse_dynamics(one.model, found.motion)
        active = found.tension.activation[worst]
        for joint, moments in zip(JOINTS, full.T, strict=True):
            name = found.coordinate(joint)
            torque = float(found.torques[name][worst])
            reserve = float(
                found.tension.actuator_force[
                    worst, found.tension.reserve_names.index(f"reserve_{name}")
                ]
            )
            way = moments * np.sign(torque)
            pulling = [k for k in np.argsort(-way) if way[k] > 0.05 * way.max()]
            against = float(np.minimum(way, 0.0) @ active)
            yield {
                "recording": one.name,
                "joint": joint.lower(),
                "torque [N mm]": 1e3 * torque,
                "without the plate's force [N mm]": 1e3 * float(free[name][worst]),
                "acceleration [rad/s²]": float(found.acceleration(joint)[worst]),
                "reserve [N mm]": 1e3 * reserve,
                "muscles could, fully active [N mm]": (
                    1e3 * float(np.maximum(way, 0.0).sum()) * np.sign(torque)
                ),
                "of it taken by others' pull against it [N mm]": 1e3 * against * np.sign(torque),
                "muscles that pull this way: moment fully active [N mm], activation": ", ".join(
                    f"{one.model.muscles[k].name} {1e3 * way[k]:.2f}, {active[k]:.2f}"
                    for k in pulling[:8]
                ),
                "reserves, all frames [% of torque]": 100.0 * found.shares()[joint],
                "were the force at the toes' joint: torque [N mm]": (
                    1e3 * float(toes.torques[name][worst])
                ),
                "reserves then [% of torque]": 100.0 * toes.shares()[joint],
            }


LARGE = 0.1
"""Reserves over torques above which they are asked after."""


def measure_groups(folder: Path) -> Iterator[Row]:
    """Compare real strides in two groups.

    The groups are of two animals, of one animal's earlier and later strides, or of two sessions.
    """
    if not _there(folder):
        return
    each = {
        one.name: stride_units(one)
        for path in recordings(folder)
        if (one := followed(folder, path)).trial.plates
    }
    first_name, second_name = TWO_MICE
    first = each[first_name]
    second = each[second_name]
    half = len(first) // 2
    yield _difference(
        f"{TWO_MICE[0]} and {TWO_MICE[1]}, by strides",
        Group("first", first),
        Group("second", second),
    )
    yield _difference(
        f"{TWO_MICE[0]}, earlier and later strides",
        Group("earlier", first[:half]),
        Group("later", first[half:]),
    )
    sessions: dict[str, list[Animal]] = {}
    for name, strides in each.items():
        sessions.setdefault(name.split("_", 1)[1], []).append(whole_animal(name, strides))
    (one, animals), (other, others) = sorted(sessions.items())
    yield _difference(
        f"sessions of {one} and {other}, by animals",
        Group(one, tuple(animals)),
        Group(other, tuple(others)),
    )


TWO_MICE = ("1R_12_01_26", "none_12_01_26")
"""Of one session, with enough strides each."""


def _regions(curve: CurveDifference) -> str:
    return "; ".join(f"{start:.0f} to {stop:.0f}" for start, stop in curve.regions)


def _difference(what: str, first: Group, second: Group) -> Row:
    found = compare_groups(first, second)
    scalars = [one for one in found.scalars if one.holm < found.options.alpha]
    curves = [one for one in found.curves if one.regions]
    return {
        "groups": what,
        "units": f"{len(first.animals)}, {len(second.animals)}",
        "smallest possible p": found.floor,
        "parameters": len(found.scalars),
        "that differ (Hedges' g)": (
            ", ".join(f"{one.name} ({one.g:.1f})" for one in scalars) or "none"
        ),
        "curves": len(found.curves),
        "that differ, at [% of stride]": (
            ", ".join(f"{one.name} ({_regions(one)})" for one in curves) or "none"
        ),
        "notes": "; ".join(found.notes),
    }


LEG = ("vaslat", "bflh", "gasmed", "tibant")
ARM = ("TRIlong", "TRIlat", "BIClong", "BRA")
"""Muscles whose lengths over keypoints are told, of both sides."""


def measure_keypoints(folder: Path) -> Iterator[Row]:
    """Fit the morphed mouse to clips of keypoints: errors, and what its muscles do."""
    if not _there(folder) or not (folder / KEYPOINTS).is_file():
        return
    generic = with_keypoints(with_arms(folder, whole_mouse(folder)))
    for number, one in enumerate(clip_fits(folder, generic)):
        row: Row = {
            "clip": number + 1,
            "frames": one.frames,
            "placed [mm]": 1e3 * one.placed,
            "placed [% of body length]": 100.0 * one.placed / (NOSE * one.size),
            "another clip [mm]": 1e3 * one.other,
        }
        standing = dict(zip(one.model.muscle_names, default_path_lengths(one.model), strict=True))
        found = mm.muscle_kinematics(
            one.model, one.fit.motion, moment_arms=False, velocities=False
        ).muscle_length
        finite = np.isfinite(found).all(axis=1)
        row["frames with all muscle lengths"] = int(finite.sum())
        for both in (
            *((f"{one}_r", f"{one}_l") for one in LEG),
            *((one, f"{one}_l") for one in ARM),
        ):
            own = [
                found[finite, one.model.muscle_names.index(name)] / standing[name] for name in both
            ]
            row[f"{both[0].removesuffix('_r')}, minimum and maximum [% of standing]"] = (
                f"{100 * np.min(own):.0f} to {100 * np.max(own):.0f}"
            )
        yield row


TOES = {"edl_r": ("EDL", 3), "fdl_r": ("FDL", 3), "ehl_r": ("EHL", 5), "fhl_r": ("FDL", 5)}
"""Muscles of the toes: the anatomist's, and the ray of the skeleton, which counts from the outer
side.
"""


def measure_toes(folder: Path) -> Iterator[Row]:
    """Moment arms of the toes' muscles about the joint of their own ray and about the ankle."""
    if not _there(folder):
        return
    model = from_man(folder, "SSD").model
    truth = mouse_hindlimb_model(folder / FILE)
    for name, (theirs, ray) in TOES.items():
        own = _arms(model, name, f"mouse__RBPhalange{ray}_flexion")
        yield {
            "of man": name,
            "of the mouse": theirs,
            "on": ", ".join(
                dict.fromkeys(
                    p.body[7:] for p in model.muscle(name).path.points if "Tibia" not in p.body
                )
            ),
            "toe, minimum and maximum [mm]": f"{1e3 * own.min():.2f} to {1e3 * own.max():.2f}",
            "the anatomist's [mm]": f"{1e3 * _arms(truth, theirs, 'MTP_flexion_r').mean():.2f}",
            "ankle [mm]": 1e3 * float(_arms(model, name, "mouse__RAnkle_flexion").mean()),
            "the anatomist's at the ankle [mm]": (
                1e3 * float(_arms(truth, theirs, "Ankle_flexion_r").mean())
            ),
        }


def _arms(model: mm.Model, muscle: str, coordinate: str, count: int = 9) -> np.ndarray:
    """(count,) moment arms over a coordinate's range [m]; positive lifts the toes or the foot."""
    low, high = model.coordinate(coordinate).range
    motion = mm.Motion(
        np.arange(count, dtype=np.float64), (coordinate,), np.linspace(low, high, count)[:, None]
    )
    found = mm.muscle_kinematics(model, motion, velocities=False)
    arms: np.ndarray = found.moment_arm[
        :, model.muscle_names.index(muscle), model.coordinate_names.index(coordinate)
    ]
    return arms
