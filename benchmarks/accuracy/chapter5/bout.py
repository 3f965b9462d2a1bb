"""Two simulated fighters as a laboratory records them: a file of markers and of raw EMG each, and grips of any way."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

import myomorph as mm
from benchmarks.accuracy.chapter5.results import at_times, compared, ran
from benchmarks.accuracy.chapter5.scenes import site
from benchmarks.errors import rms, rms_of_vectors
from myomorph.io.mjcf.compile import silent_mujoco
from myomorph.io.mjcf.read import model_from_mujoco
from myomorph.model.join import join_models
from myomorph.simulate.bout import FEET, GRIPS
from myomorph.simulate.fighter import PARTS, fighter_text
from myomorph.simulate.pair import PairOptions, VirtualPair, pair_sites, virtual_pair
from truths.laboratory_files import write_markers, write_raw_emg
from truths.performer import with_marker_tuple

Row = dict[str, object]
CUTOFF = 6.0  # Of the true forces that results are compared with [Hz].
LATER = 0.2  # So much later uke's recording begins [s].
STUDY = '[study]\nname = "judo"\n'
SUBJECT = """
[[subject]]
name = "{part}"
model = "{part}.xml"
mass = {mass}
trials = [{{name = "bout", markers = "{part}.trc", emg = "{part}_emg.sto"}}]
steps = ["calibrate", "ik"]
"""
TOGETHER = """
[[together]]
name = "judo"
trials = {tori = "bout", uke = "bout"}
contacts = "grips.toml"
"""


@cache
def judo() -> tuple[VirtualPair, Path]:
    """A bout, and what `myomorph run` makes of its files."""
    pair, folder = virtual_pair(PairOptions("sway", 1), CUTOFF), Path(tempfile.mkdtemp(prefix="chapter5_"))
    texts = [STUDY]
    for seed, part in enumerate(PARTS, 61):
        text = with_marker_tuple(fighter_text(part, pair.builds[part]))
        (folder / f"{part}.xml").write_text(text)
        with silent_mujoco():
            model = model_from_mujoco(mujoco.MjModel.from_xml_string(text), marker_sites="marker_.*")
        motion, start = pair.truth.motion, LATER if part == "uke" else 0.0
        columns = [motion.names.index(f"{part}_{name}") for name in model.coordinate_names]
        frames = motion.time >= start
        own = mm.Motion(motion.time[frames], model.coordinate_names, motion.values[frames][:, columns])
        write_markers(model, own, folder / f"{part}.trc", seed)
        write_raw_emg(of_part(pair.truth.activations, part), folder / f"{part}_emg.sto", seed + 2)
        texts.append(SUBJECT.format(part=part, mass=round(model.mass, 1)))
    grips = [
        site(one.name, one.body, one.points, f'against = "{one.against}"\ndirection = "any"\nintervals = "always"')
        for one in pair_sites(pair.builds)
        if one.name in GRIPS
    ]
    (folder / "grips.toml").write_text("".join(grips))
    (folder / "study.toml").write_text("".join([*texts, TOGETHER]))
    return pair, ran(folder / "study.toml") / "judo"


def of_part(series: mm.Series, part: str) -> mm.Series:
    """Columns of one fighter, under the names of its own model."""
    names = [name for name in series.names if name.startswith(f"{part}_")]
    values = np.stack([series[name] for name in names], axis=1)
    return mm.Series(series.time, tuple(name.removeprefix(f"{part}_") for name in names), values)


def measure_judo() -> Iterator[Row]:
    """The force of each foot and grip; torques and activations of both."""
    pair, home = judo()
    truth = pair.truth
    motion = mm.differentiate(truth.motion, CUTOFF)
    torques = mm.inverse_dynamics(join_models(truth.models), motion, truth.wrenches)
    hinges = [name for name in torques.names if "_pelvis_" not in name]
    rest = compared(home, torques, hinges, truth.activations)
    groups = mm.read_sto(home / "contact_groups.sto")
    for name in (*FEET, *GRIPS):
        true = truth.forces[name]
        estimate = np.stack([at_times(groups, f"{name}_f{axis}", truth.forces.time) for axis in "xyz"], axis=1)
        inside = np.isfinite(estimate).all(axis=1)
        miss = (estimate - true)[inside]
        row: Row = {"contact": name, "true, RMS [N]": rms_of_vectors(true), "error, RMS [N]": rms_of_vectors(miss)}
        for axis, column in (("vertical", 1), ("fore-aft", 0), ("lateral", 2)):
            row[f"{axis}, RMS error [N]"] = rms(miss[:, column])
        yield row | (rest if name == FEET[0] else {})
