"""The morphed mouse: its fibers and forces against an anatomist's, and what it does on recordings of mice."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from benchmarks.mouse_hindlimb import FILE, mouse_hindlimb_model
from benchmarks.mouse_morphed import JOINTS, followed, lengths_of, on_one_paw, recordings
from benchmarks.mouse_motion import rms
from benchmarks.species_cases import MAN, MOUSE, from_man, man, mouse, sized_architecture
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.morph.morphed import Architecture
from myomorph.morph.species.counterparts import MuscleHomology
from myomorph.muscles.path import muscle_kinematics
from myomorph.study.subject.species_morphing import read_species

Row = dict[str, object]
Pairs = tuple[MuscleHomology, ...]


def _there(folder: Path) -> bool:
    return all((folder / one).is_file() for one in (FILE, MAN, MOUSE))


def _pairs(table: Mapping[str, Architecture]) -> Pairs:
    pairs = read_species("human-mouse").muscles
    return tuple(one for one in pairs if all(name in table for name in one.sources))


def measure_architecture(folder: Path) -> Iterator[Row]:
    """Forces and fibers by what they come from, against the anatomist's table in its own size."""
    if not _there(folder):
        return
    source, target, truth = man(folder), mouse(folder), mouse_hindlimb_model(folder / FILE)
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


def _against(found: Mapping[str, Architecture], pairs: Pairs, truth: Model) -> Row:
    """Ranks, medians and ranges of force and fiber length over the anatomist's, and how often intervals hold."""
    theirs = {one.name: one for one in truth.muscles}
    forces = np.array(
        [
            (sum(found[n].force for n in one.sources), sum(theirs[n].max_isometric_force for n in one.targets))
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
    for what, values, key in (("force", forces, "force_interval"), ("fiber", fibers, "fiber_interval")):
        ratio = values[:, 0] / values[:, 1]
        row[f"{what}, rank correlation"] = float(spearmanr(*values.T).statistic)
        row[f"{what}, ratio: median (least to most)"] = (
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
                row[f"{muscle}, excursion [fiber lengths]"] = float(np.mean(own)) if own else float("nan")
        yield row


def measure_tension(folder: Path) -> Iterator[Row]:
    """What a paw that bears the plate's force asks of the muscles."""
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
        strongest = int(np.argmax(found.tension.forces.max(axis=0)))
        yield {
            "recording": one.name,
            "paw": "right" if found.side == "R" else "left",
            "frames": len(found.motion),
            **{
                f"{joint.lower()} [N mm]": 1e3 * float(np.abs(found.torques[found.coordinate(joint)]).max())
                for joint in JOINTS
            },
            "reserves [% of torque]": 100.0 * found.share(),
            **{f"{joint.lower()} [%]": 100.0 * shares[joint] for joint in JOINTS},
            "strongest": f"{found.tension.muscles[strongest]}: {found.tension.forces[:, strongest].max():.2g} N",
            "fully active (fiber length)": ", ".join(found.full(one.model)),
        }


TOES = {"edl_r": ("EDL", 3), "fdl_r": ("FDL", 3), "ehl_r": ("EHL", 5), "fhl_r": ("FDL", 5)}
"""Muscles of the toes: the anatomist's, and the ray of the skeleton, which counts from the outer side."""


def measure_toes(folder: Path) -> Iterator[Row]:
    """Moment arms of the toes' muscles about the joint of their own ray and about the ankle."""
    if not _there(folder):
        return
    model, truth = from_man(folder, "SSD").model, mouse_hindlimb_model(folder / FILE)
    for name, (theirs, ray) in TOES.items():
        own = _arms(model, name, f"mouse__RBPhalange{ray}_flexion")
        yield {
            "of man": name,
            "of the mouse": theirs,
            "on": ", ".join(dict.fromkeys(p.body[7:] for p in model.muscle(name).path.points if "Tibia" not in p.body)),
            "toe, least and greatest [mm]": f"{1e3 * own.min():.2f} to {1e3 * own.max():.2f}",
            "the anatomist's [mm]": f"{1e3 * _arms(truth, theirs, 'MTP_flexion_r').mean():.2f}",
            "ankle [mm]": 1e3 * float(_arms(model, name, "mouse__RAnkle_flexion").mean()),
            "the anatomist's at the ankle [mm]": 1e3 * float(_arms(truth, theirs, "Ankle_flexion_r").mean()),
        }


def _arms(model: Model, muscle: str, coordinate: str, count: int = 9) -> np.ndarray:
    """(count,) moment arms over a coordinate's range [m]; positive lifts the toes or the foot."""
    low, high = model.coordinate(coordinate).range
    motion = Motion(np.arange(count, dtype=np.float64), (coordinate,), np.linspace(low, high, count)[:, None])
    found = muscle_kinematics(model, motion, velocities=False)
    arms: np.ndarray = found.moment_arms[:, model.muscle_names.index(muscle), model.coordinate_names.index(coordinate)]
    return arms
