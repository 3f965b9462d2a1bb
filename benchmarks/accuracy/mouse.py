"""Recordings of mice: marker residuals, strides, muscle lengths, plate and tensions.

`validation` tabulates them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.bones.morph.mirror.model import with_other_side
from myomorph.core.contact.plates import first_corner, loaded_samples
from myomorph.core.model.arrays import runs
from myomorph.core.tension.dual import NOT_DETERMINED
from myomorph.core.tension.tension import Tension
from myomorph.lab.analysis.length_analysis import LengthAnalysis
from myomorph.lab.analysis.strides import Strides
from truths.mouse_commands import by_command, by_default
from truths.mouse_hindlimb import FILE, mouse_hindlimb_model
from truths.mouse_motion import (
    Mouse,
    alone,
    clip_fits,
    held_out,
    lengths_of,
    motion_of,
    mouse,
    names,
    part_masses,
    rms,
    strides_of,
)
from truths.mouse_recordings import KEYPOINTS, LOOSE, whole_skeleton

Row = dict[str, object]
JOINTS = ("Hip_flexion", "Knee_extension", "Ankle_flexion")


def recordings(folder: Path) -> tuple[str, ...]:
    """List recordings of markers, where the model for them is there too."""
    return names(folder) if (folder / FILE).is_file() else ()


def measure_markers(folder: Path) -> Iterator[Row]:
    """Marker residuals of every recording on the generic and on the animal's own model."""
    for name in recordings(folder):
        one = mouse(folder, name)
        used = int(one.shown.sum())
        seen = np.isfinite(one.fit.marker_error[one.shown]).mean()
        knees = tuple(LOOSE)
        yield {
            "recording": name,
            "frames": len(one.used),
            "in crossings": used,
            "crossings": len(one.spans),
            "markers seen there [%]": 100.0 * float(seen),
            "size": one.calibration.size,
            "generic [mm]": 1e3 * rms(one.generic),
            "own [mm]": 1e3 * rms(one.fit),
            "without knees [mm]": 1e3 * rms(one.fit, knees),
            "other half [mm]": 1e3 * held_out(folder, name),
            "largest [mm]": 1e3 * float(np.nanmax(one.fit.largest)),
            "not converged": int((~one.fit.converged & one.shown).sum()),
            "frames/s": used / one.seconds,
        }


def measure_keypoints(folder: Path) -> Iterator[Row]:
    """Fit the whole skeleton to clips of keypoints."""
    if not (folder / KEYPOINTS).is_file():
        return
    for k, one in enumerate(clip_fits(folder, whole_skeleton(folder))):
        yield {
            "clip": k + 1,
            "size": one.size,
            "points at first places [mm]": 1e3 * one.first,
            "placed [mm]": 1e3 * one.placed,
            "another clip [mm]": 1e3 * one.other,
            "frames/s": one.frames / one.seconds,
        }


def measure_strides(folder: Path) -> Iterator[Row]:
    """Stride parameters of both hindlimbs, mean and standard deviation."""
    for name in recordings(folder):
        strides = strides_of(folder, name)
        if strides is None or name == "treadmill":
            continue
        for limb in strides.strikes:
            if strides.of(limb):
                yield {"recording": name} | _of_limb(strides, limb)


def _of_limb(strides: Strides, limb: str) -> Row:
    own = strides.of(limb)
    right = limb.endswith("_r")
    # Those of the second limb against the first.
    phases = list(strides.phases.values())[1:2]
    return {
        "limb": "right hind" if right else "left hind",
        "strides": len(own),
        "duration [s]": _spread([one.duration for one in own]),
        "length [mm]": _spread([1e3 * one.length for one in own]),
        "speed [m/s]": _spread([one.speed for one in own]),
        "duty factor": _spread([one.duty for one in own]),
        "width [mm]": _spread([1e3 * one.width for one in own]),
        "left after right": "" if right or not phases else _spread(list(phases[0])),
    }


def _spread(values: list[float]) -> str:
    """Mean ± population standard deviation of what is known."""
    known = np.array([one for one in values if np.isfinite(one)])
    return f"{known.mean():.3g} ± {known.std():.2g}" if len(known) else ""


MUSCLES = ("ILI", "RF", "VL", "BFP_cranial", "SM", "ST", "CF", "TA", "LG", "MG", "SOL")
"""Shown one by one: flexors and extensors of hip, knee and ankle."""


def measure_lengths(folder: Path) -> Iterator[Row]:
    """Summarize what muscles do in a stride, right and left, over all mice on the plate."""
    found = [lengths_of(folder, name) for name in recordings(folder) if name != "treadmill"]
    for muscle in MUSCLES:
        ranges = [
            one for each in found for one in each.ranges if one.muscle.removesuffix("_l") == muscle
        ]
        if not ranges:
            continue
        yield {
            "muscle": muscle,
            "strides": sum(one.strides for one in ranges),
            "shortest [% of standing]": _spread(
                [100.0 * one.shortest / one.standing for one in ranges]
            ),
            "shortest at [% of stride]": _spread([one.shortest_at for one in ranges]),
            "longest [% of standing]": _spread(
                [100.0 * one.longest / one.standing for one in ranges]
            ),
            "longest at [% of stride]": _spread([one.longest_at for one in ranges]),
            "excursion [fiber lengths]": _spread([one.excursion for one in ranges]),
            "fastest shortening [fiber lengths/s]": _spread([one.shortening for one in ranges]),
            "between strides [fiber lengths]": _between_strides(found, muscle),
        }


def _between_strides(found: Sequence[LengthAnalysis], muscle: str) -> float:
    """Return the mean standard deviation between strides of a muscle's length [fiber lengths]."""
    scatter = [
        float(np.nanmean(np.nanstd(each.curves(name), axis=0)))
        / each.fiber[each.muscles.index(name)]
        for each in found
        for name in (muscle, f"{muscle}_l")
        if len(each.curves(name)) > 1
    ]
    return float(np.mean(scatter)) if scatter else float("nan")


def measure_plate(folder: Path) -> Iterator[Row]:
    """Summarize loadings of the plate.

    The rows have what a paw that is alone on it requires of the muscles.
    """
    for name in recordings(folder):
        if name == "treadmill":
            continue
        one = mouse(folder, name)
        found = alone(folder, name)
        plate = one.trial.plates[0]
        pressing = plate.forces[:, 1]
        spells = runs(loaded_samples([plate], 1000.0)[0])
        start, stop = max(spells, key=lambda span: float(pressing[span[0] : span[1]].max()))
        row: Row = {
            "recording": name,
            "on the plate [s]": (stop - start) / 1000.0,
            "mean force [N]": float(pressing[start:stop].mean()),
            "largest force [N]": float(pressing[start:stop].max()),
            **_beside_markers(one),
        }
        if found is not None:
            side = found.side
            knee = f"Knee_extension_{side}"
            tension = found.active
            worst, share = _reserves(found.torques, tension, side)
            stretched = [
                one for one in found.passive.overstretched if one.endswith("_l") == (side == "l")
            ]
            strongest = int(np.argmax(tension.muscle_force.max(axis=0)))
            row |= {
                "paw alone": "right" if side == "r" else "left",
                "frames": len(found.frames),
                "force then [N]": float(found.wrenches.forces[:, 0, 1].max()),
                "center of pressure to toes [mm]": 1e3 * float(np.median(found.beside)),
                **{
                    f"{joint.split('_')[0].lower()} [N mm]": (
                        1e3 * _largest(found.torques[f"{joint}_{side}"])
                    )
                    for joint in JOINTS
                },
                "knee bent [degrees]": float(
                    np.rad2deg(-np.median(motion_of(folder, name)[knee][found.frames]))
                ),
                "strongest muscle": (
                    f"{tension.muscles[strongest]}: "
                    f"{tension.muscle_force[:, strongest].max():.2g} N"
                ),
                "largest reserve [N mm]": worst,
                "reserves [% of torque]": share,
                "with passive forces [% of torque]": _reserves(found.torques, found.passive, side)[
                    1
                ],
                "overstretched": ", ".join(stretched),
                "optimal": f"{int(tension.optimal.sum())} of {len(tension.time)}",
            }
        yield row


def measure_commands(folder: Path) -> Iterator[Row]:
    """Run every recording by one study file.

    The rows have how much of each leg is solved, and what reserves give there.
    """
    if not recordings(folder):
        return
    refused = by_default(folder)
    for name, one in by_command(folder).items():
        tension = one.tension
        posed = ~np.isnan(one.tension.balanced_torque).all(axis=1)
        row: Row = {"recording": name, "frames with a pose": int(posed.sum())}
        for side, word in (("r", "right"), ("l", "left")):
            muscle = tension.muscles.index("SOL" if side == "r" else "SOL_l")
            solved = posed & np.isfinite(tension.muscle_force[:, muscle])
            bodies = [body == f"Foot_{side}" for body in one.wrenches.bodies]
            pushed = (
                np.nan_to_num(one.wrenches.forces[:, bodies, 1]).sum(axis=1)
                > 0.1 * one.model.weight
            )
            torques = mm.Series(tension.time, tension.coordinates, tension.balanced_torque)
            row |= {
                f"{word} leg solved [% of frames]": 100.0 * solved.sum() / posed.sum(),
                f"{word}, loaded and solved": int((solved & pushed).sum()),
                f"{word}, reserves [% of torque]": _reserves(torques, tension, side)[1],
            }
        size = _residual(tension, posed) / one.model.weight
        yield row | {
            "force without a cause at the pelvis, RMS [% of weight]": 100.0 * size,
            "what is printed of residuals": one.residuals,
            "not optimal": int(
                (posed & ~tension.optimal & (tension.status != NOT_DETERMINED)).sum()
            ),
            "first line": one.line,
            "by default": refused[name] or "solved",
        }


def _residual(tension: Tension, posed: np.ndarray) -> float:
    """Root mean square of the force that nothing explains at the root [N].

    Parameters
    ----------
    tension : with residual actuators
    posed : (frames,) that count
    """
    columns = [
        column for column, name in enumerate(tension.reserve_names) if name.startswith("residual_F")
    ]
    forces = tension.actuator_force[posed][:, columns]
    return float(np.sqrt(np.nanmean((forces**2).sum(axis=1))))


def _beside_markers(one: Mouse) -> Row:
    """Return how far the center of pressure is from the markers' middle.

    It is as used, and as the file counts the corners.
    """
    plate = one.trial.plates[0]
    markers = one.trial.markers
    assert markers is not None
    told = first_corner(plate, one.trial.plate_time, markers)
    assert told is not None
    stored = one.trial.plate_recordings[0].corners
    back = next(k for k in range(4) if np.allclose(np.roll(plate.corners, -k, axis=0), stored))
    return {
        "center of pressure to markers [mm]": 1e3 * told.distances[0],
        "with the file's corners [mm]": 1e3 * told.distances[back],
    }


def measure_masses(folder: Path) -> Iterator[Row]:
    """Shares of the skeleton's parts in its mass."""
    if not (folder / KEYPOINTS).is_file():
        return
    masses = part_masses(folder)
    other = (
        with_other_side(mouse_hindlimb_model(folder / FILE)) if (folder / FILE).is_file() else None
    )
    for part, mass in masses.items():
        row: Row = {"part": part, "in the file [%]": 100.0 * mass / sum(masses.values())}
        legs = (
            0.0
            if other is None
            else sum(one.mass for one in other.bodies if one.name[-2:] in ("_r", "_l"))
        )
        told = other is not None and part == "hindlimbs"
        row["an anatomist's table [%]"] = (
            100.0 * legs / other.mass if told and other is not None else ""
        )
        yield row


def _largest(values: np.ndarray) -> float:
    """Return the value of the largest size, with its sign."""
    return float(values[int(np.argmax(np.abs(values)))])


def _reserves(torques: mm.Series, tension: Tension, side: str) -> tuple[float, float]:
    """Return the largest reserve of the leg's joints [N mm], and the size of reserves [%].

    The latter is their root mean square over that of torques.
    """
    joints = [f"{joint}_{side}" for joint in JOINTS]
    given = np.stack(
        [tension.actuator_force[:, tension.reserve_names.index(f"reserve_{one}")] for one in joints]
    )
    asked = np.where(np.isfinite(given), np.stack([torques[one] for one in joints]), np.nan)
    share = float(np.sqrt(np.nanmean(given**2)) / np.sqrt(np.nanmean(asked**2)))
    return 1e3 * float(np.nanmax(np.abs(given))), 100.0 * share
