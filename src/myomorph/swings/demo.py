"""Example study of [S]: six virtual shoulders as a laboratory would hand them over.

Their truth is stored beside them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.spatial import Transform
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.progress import progress
from myomorph.swings.simulate import laboratory
from myomorph.swings.simulate.limb import BaseLoad, specimen_mjcf
from myomorph.swings.simulate.shoulder import (
    BASE,
    FIRST,
    FURTHER,
    PLATE,
    Setup,
    VirtualSpecimen,
    arm_model,
    virtual_specimen,
)
from myomorph.swings.viscosity.cohort import SPECIMENS
from myomorph.swings.viscosity.study.plan import read_viscosity_plan
from myomorph.swings.viscosity.study.run import run_viscosity
from myomorph.swings.viscosity.trust.moment_arms import OFFSET

STUDY = "shoulder.toml"
RECORDINGS = "recordings"
SECONDS = 10.0
TRIALS = 3
# The specimen that is handed over raw: C3D of a plate whose place is wrong, pushes of a rod on it,
# and a CT.
WHOLE = 1
WORKERS = 2
SCAPULA = 0.25
# Mass of the bone on the plate [kg]; center of what stays on it [m].
LOADED = (-0.05, -0.03, -0.06)
# `arm_sensitivity.OFFSET` as small as the muscles, which are scaled by 0.09 to 0.20 [m].
ARM_OFFSET = 0.0014


def run_shoulder_demo(out: Path, said: Callable[[Outcome], None]) -> list[Outcome]:
    """Write the example study into a folder's `RECORDINGS` and identify it.

    Tables and `report.html` are written.
    """
    return run_viscosity(read_viscosity_plan(write_shoulder_study(out / RECORDINGS)), out, said)


@read_only
@dataclass(frozen=True, kw_only=True)
class ShoulderStudyOptions:
    """Options of the virtual specimens' recordings.

    Attributes
    ----------
    seconds : length of each release [s]
    trials : number of releases of each condition
    raw : those that come as C3D files of a plate that lies elsewhere, with pushes of a rod and a CT
    full_size : muscles of the model's size, with the viscosity that gives the total one of the
        table
    modelled : bones of the model out of those of a raw specimen, as in `write_scans`
    """

    seconds: float = SECONDS
    trials: int = TRIALS
    raw: Sequence[int] = (WHOLE,)
    full_size: bool = False
    modelled: Callable[[Array], Array] | None = None


def write_shoulder_study(
    folder: Path,
    numbers: Sequence[int] = tuple(range(1, len(SPECIMENS) + 1)),
    options: ShoulderStudyOptions | None = None,
) -> Path:
    """Swing the virtual specimens in MuJoCo and write models, markers, forces and the study file.

    Parameters
    ----------
    folder : made where it does not exist
    numbers : of the specimens, 1 to 6
    options : length, number and kind of the recordings; see `ShoulderStudyOptions`

    Returns
    -------
    path of the study file

    Raises
    ------
    BadData : `myo-sim` is not installed, or there is no such specimen

    Examples
    --------
    >>> from pathlib import Path
    >>> import myomorph as mm
    >>> short = mm.viscosity.ShoulderStudyOptions(seconds=3.0, trials=1, raw=())
    >>> study = mm.write_shoulder_study(Path("virtual"), (3,), short)
    >>> study.name
    'shoulder.toml'
    """
    options = options or ShoulderStudyOptions()
    folder.mkdir(parents=True, exist_ok=True)
    arm_model()
    with progress("simulation", len(numbers), "specimens") as advance:

        def made(number: int) -> str:
            specimen = virtual_specimen(
                number,
                seconds=options.seconds,
                trials=options.trials,
                setup=Setup(full_size=options.full_size, loads=base_loads(number)),
            )
            table = _write_specimen(specimen, folder, number in options.raw, options.modelled)
            advance(1.0)
            return table

        # MuJoCo runs outside Python's lock.
        with ThreadPoolExecutor(WORKERS) as pool:
            tables = list(pool.map(made, numbers))
    text = "\n".join([_head(options, laboratory.Noise()), *tables])
    (folder / STUDY).write_text(text, encoding="utf-8")
    return folder / STUDY


def base_loads(number: int) -> tuple[BaseLoad, BaseLoad]:
    """Return the loads on the base of a specimen.

    They are its scapula, and the muscles that were weighed but do not swing by [S] table II.
    """
    row = SPECIMENS[number - 1]
    stays = row.measured_muscle_mass - row.estimated_muscle_mass
    return BaseLoad(SCAPULA, LOADED), BaseLoad(SCAPULA + stays, LOADED)


def _write_specimen(
    made: VirtualSpecimen, folder: Path, raw: bool, modelled: Callable[[Array], Array] | None
) -> str:
    """Write a specimen's files; its table of the study file."""
    number = made.published.name
    place = folder / f"specimen_{number}"
    place.mkdir(exist_ok=True)
    (place / "model.xml").write_text(specimen_mjcf(made.specimen), encoding="utf-8")
    trials = (*made.without.trials, *made.intact.trials)
    if raw:
        ending = "c3d"
        more = _write_laboratory(made, trials, place, modelled)
    else:
        ending = "trc"
        more = ""
        for trial in trials:
            laboratory.write_recording(trial, place / trial.name.replace(" ", "_"))
    bones = ", ".join(f'"{bone}"' for bone in FURTHER)
    return f"""[[specimen]]
name = "{number}"
model = "{place.name}/model.xml"
base = "{BASE}"
first_body = "{FIRST}"
bones = [{bones}]
removed = ["{place.name}/without_*.{ending}"]
intact = ["{place.name}/with_*.{ending}"]
{more}measured_muscle_mass = {made.published.measured_muscle_mass}
base_mass = {{ removed = {SCAPULA}, \
intact = [{SCAPULA}, {SCAPULA + made.published.measured_muscle_mass:.3f}] }}
truth = {{ {_pairs(truth_of(made))} }}
paper = {{ {_pairs(made.published.values)} }}
"""


def _write_laboratory(
    made: VirtualSpecimen,
    trials: Sequence[laboratory.VirtualTrial],
    place: Path,
    modelled: Callable[[Array], Array] | None,
) -> str:
    """Write a specimen's swings as C3D, a rod's pushes and a CT.

    The plate lies elsewhere than the C3D files state.
    """
    random = np.random.default_rng(int(made.published.name))
    center = made.specimen.stand.apply(made.specimen.center)
    plate = laboratory.VirtualPlate(Transform(np.eye(3), center + PLATE), random)
    for trial in trials:
        laboratory.write_swing_c3d(trial, plate, place / f"{trial.name.replace(' ', '_')}.c3d")
    laboratory.write_rod(plate, made.noise, random, place / "rod.c3d")
    names = ", ".join(f'"{name}"' for name in laboratory.ROD)
    tip = next(iter(laboratory.ROD.values()))
    return (
        f"ct = {laboratory.write_scans(made.specimen, place, random, modelled)}\n"
        f'plate = {{ placements = ["{place.name}/rod.c3d"], markers = [{names}], axis = [{names}],'
        f" tip = {tip} }}\n"
    )


def truth_of(made: VirtualSpecimen) -> dict[str, float]:
    """Return the true values of a virtual specimen, by the names of `cohort.QUANTITIES`."""
    return {
        "mass_muscles_removed": made.without.mass,
        "com_muscles_removed": made.without.com,
        "first_moment_muscles_removed": made.without.mass * made.without.com,
        "joint_viscosity": made.joint_viscosity,
        "mass_intact": made.intact.mass,
        "com_intact": made.intact.com,
        "first_moment_intact": made.intact.mass * made.intact.com,
        "total_viscosity": made.intact.viscosity,
        "muscle_viscosity": made.muscle_viscosity,
        "estimated_muscle_mass": made.intact.mass - made.without.mass,
    }


def _pairs(values: dict[str, float]) -> str:
    return ", ".join(f"{name} = {value!r}" for name, value in values.items())


def _head(made: ShoulderStudyOptions, noise: laboratory.Noise) -> str:
    lines = [
        (
            "Everything: six virtual arms (bones and muscles of MyoArm, package myo-sim) with the"
            " masses, mass centers and viscosities of the paper's tables I and II, released"
            f" {made.trials} times for {made.seconds:g} s without muscles and as often with them,"
            " in MuJoCo; nobody was measured."
        ),
        (
            f"Standard deviations of the white noise: markers {1000 * noise.marker:g} mm, forces"
            f" {noise.force:g} N, moments {noise.force * noise.lever:g} N m about the plate's"
            " origin; the clocks of plate and markers are up to 40 ms and 50 millionths apart."
        ),
        (
            f"The base carries {SCAPULA:g} kg of bone, which was weighed, and with muscles what the"
            " table weighs of them but does not see swing, which was not: masses with muscles are"
            " ranges."
        ),
    ]
    if made.raw:
        numbers = ", ".join(f"{number:02d}" for number in made.raw)
        lines.append(
            f"Raw is specimen {numbers}: C3D of a plate that"
            " lies up to 1.5 degrees and 8 mm an axis off its place in the file, pushes of a rod"
            " with two markers on it, and a CT of bones and clusters with 0.2 mm of noise and"
            " points picked 0.5 mm off."
        )
    options = ""
    if not made.full_size:
        lines += [
            (
                "The tables' viscosities cannot all hold with muscles of full size: they imply"
                " moment arms of 2 to 4 mm. Each specimen's muscles are therefore scaled about the"
                " joint's center, by 0.1 to 0.2, until the total viscosity over the true swing is"
                " that of table II."
            ),
            (
                f"Errors of attachments are scaled likewise: {1000 * ARM_OFFSET:g} mm stands for"
                f" {1000 * OFFSET:.1f} mm."
            ),
        ]
        options = f"\n[options.moment_arms]\noffset = {ARM_OFFSET}\n"
    quoted = ",\n".join(f'  "{line}"' for line in lines)
    return f'[study]\nname = "Six virtual shoulders"\nsimulated = [\n{quoted},\n]\n{options}'
