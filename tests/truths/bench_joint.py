"""Files of a mechanical joint on a bench, as a laboratory hands them over.

The joint hangs from a fixture on the plate. The plate was set to zero before the fixture was
mounted, and the fixture alone was recorded (`tare`).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from myomorph.core.io.sto import write_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Wrenches
from myomorph.swings.simulate.laboratory import Noise, VirtualTrial, loads_table, write_recording
from truths.mechanical_joint import FREE, GRAVITY, PLATE, VirtualJoint

FIXTURE = 2.5
"""Mass of the fixture [kg]."""
PLACE = np.array([0.05, 0.02, -0.1])
"""Of its mass center, from the plate's origin [m]."""
REST = 2500
"""Samples of the fixture alone."""
STUDY = """[study]
name = "bench"
[[specimen]]
name = "01"
model = "joint.xml"
base = "base"
first_body = "limb"
joint = "{kind}"
removed = ["swing*.trc"]
tare = "tare.mot"
{more}"""


def write_bench(joint: VirtualJoint, folder: Path, seed: int = 0, more: str = "") -> Path:
    """Write the recordings of a joint, the fixture's own, its model and a study file.

    Parameters
    ----------
    joint : that was swung
    folder : that is made
    seed : of the noise on the fixture's recording
    more : further lines of the study file

    Returns
    -------
    the study file
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "joint.xml").write_text(joint.mjcf.replace("<!--free-->", FREE))
    for number, trial in enumerate(joint.trials, 1):
        write_recording(_on_fixture(trial), folder / f"swing{number}.trc")
    tare = _fixture(joint.trials[0].wrenches, joint.noise, np.random.default_rng(seed))
    write_sto(loads_table(tare), folder / "tare.mot")
    study = folder / "study.toml"
    study.write_text(STUDY.format(kind=joint.truth.kind, more=more))
    return study


def _weight() -> tuple[Array, Array]:
    """(3,) force of the plate on the fixture [N] and its moment about the plate's origin [N m]."""
    force = -FIXTURE * GRAVITY
    return force, np.cross(PLACE, force)


def _on_fixture(trial: VirtualTrial) -> VirtualTrial:
    """Add the fixture to what the plate measures in a trial."""
    force, moment = _weight()
    wrenches = trial.wrenches
    carried = replace(wrenches, forces=wrenches.forces + force, torques=wrenches.torques + moment)
    return replace(trial, wrenches=carried)


def _fixture(wrenches: Wrenches, noise: Noise, random: np.random.Generator) -> Wrenches:
    """Make the recording of the fixture at rest."""
    force, moment = _weight()
    white = random.standard_normal((2, REST, 1, 3))
    return replace(
        wrenches,
        time=wrenches.time[:REST] - wrenches.time[0],
        forces=force + noise.force * white[0],
        points=np.broadcast_to(PLATE, (REST, 1, 3)),
        torques=moment + noise.force * noise.lever * white[1],
    )
