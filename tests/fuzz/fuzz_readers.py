"""Every reader of files that somebody else wrote: how it is called, and the whole files that fuzzing begins with."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from binary_seeds import SEEDS, binary_seeds

from myomorph.io.bids.recording import read_emg
from myomorph.io.channels import read_channels
from myomorph.io.contact_events import read_events
from myomorph.io.keypoints import read_keypoint_names, read_keypoints
from myomorph.io.landmarks import read_body_landmarks, read_landmark_pairs
from myomorph.io.loads import read_external_loads
from myomorph.io.mesh import read_mesh
from myomorph.io.mjcf.compile import check_files
from myomorph.io.mjcf.read import read_mjcf
from myomorph.io.osim.actuators import read_actuators
from myomorph.io.osim.read import read_osim
from myomorph.io.osim.setup_parts import read_ik_tasks, read_marker_set
from myomorph.io.osim.tool_setups import read_setup
from myomorph.io.osim.write import write_osim
from myomorph.io.qualisys_mat import read_qualisys_mat
from myomorph.io.sto import read_sto
from myomorph.io.trc import read_trc
from myomorph.io.wav import read_wav
from myomorph.model.model import Model
from myomorph.store.results import read_result
from myomorph.study.info.inspect import inspect
from myomorph.study.inputs.contact_file import read_contacts, read_stairs
from myomorph.study.inputs.reading import read_motion, read_recording
from myomorph.study.plan.measures import read_measures
from myomorph.study.plan.plan import read_plan
from myomorph.study.subject.species_morphing import read_species
from myomorph.viscosity.study.calibration import read_picks
from myomorph.viscosity.study.plan import read_viscosity_plan

LARGEST_SEED = 40_000
"""Bytes of recordings that are taken as seeds: larger ones make few inputs a second."""


@dataclass(frozen=True)
class Reader:
    """A reader under test.

    Attributes
    ----------
    name : of the kind of file
    ending : that the file must have
    read : takes the path
    files : seeds among `seeds`; binary ones are made
    recorded : pattern of real files, where there are any
    guarded : it starts a process for each file, so that few inputs a second are tried
    """

    name: str
    ending: str
    read: Callable[[Path], Any]
    files: tuple[str, ...] = ()
    recorded: str = ""
    guarded: bool = False

    def seeds(self, data: Path | None = None) -> list[bytes]:
        """Whole files: ours, and small real ones of the folder `data`."""
        found = [(SEEDS / name).read_bytes() for name in self.files] + list(binary_seeds().get(self.ending, ()))
        if data is not None and self.recorded:
            real = sorted(one for one in data.glob(self.recorded) if 0 < one.stat().st_size < LARGEST_SEED)
            found += [one.read_bytes() for one in real[:: max(len(real) // 12, 1)]]
        return found


@cache
def arm() -> Model:
    """The model that the seeds speak of."""
    return read_osim(SEEDS / "arm.osim")


def _written_again(path: Path) -> Any:
    """A model that is read, told of, and written."""
    inspect(path)
    return write_osim(read_osim(path), path.with_name("written again.osim"))


STUDIES = ("study.toml", "study_tables.toml", "study_laboratory.toml")
TABLES = ("taps.csv", "taps_frames.csv", "taps_spans.csv")
SETUPS = ("setup_ik.xml", "setup_id.xml", "setup_analyze.xml", "setup_scale.xml")
LANDMARKS = ("landmarks.json", "landmarks_bodies.json", "landmarks_slicer.json")

MOTION = ("motion.tsv", "channels.tsv", "motion.json", "events.tsv")
"""Files of one recording of BIDS."""


def _as_motion(part: str, path: Path) -> Any:
    """Read a motion file of BIDS of whose files one part is another."""
    with tempfile.TemporaryDirectory() as folder:
        stem = Path(folder) / "sub-1_task-walk_tracksys-a"
        for name in MOTION:
            source = path if name == part else SEEDS / f"bids_{name}"
            stem.with_name(f"{stem.name}_{name}").write_bytes(source.read_bytes())
        return read_recording(stem.with_name(f"{stem.name}_motion.tsv"))


READERS = (
    Reader("OSIM", ".osim", read_osim, ("arm.osim",), "*/*.osim"),
    Reader("OSIM, described and written", ".osim", _written_again, ("arm.osim",), "*/*.osim"),
    Reader("MJCF", ".xml", read_mjcf, ("arm_mujoco.xml",), "mouse*/*.xml", guarded=True),
    Reader("MJCF before it is compiled", ".xml", check_files, ("arm_mujoco.xml",), "mouse*/*.xml"),
    Reader("TRC", ".trc", read_trc, ("walk.trc",), "**/*.trc"),
    Reader("STO, MOT", ".sto", read_sto, ("data.sto", "forces.mot"), "**/*.[sm][to][ot]"),
    Reader("MOT as coordinates", ".mot", lambda path: read_motion(path, arm()), ("motion.mot",)),
    *(
        Reader(f"BIDS {name}", f".{name[-4:].strip('.')}", partial(_as_motion, name), (f"bids_{name}",))
        for name in MOTION
    ),
    Reader("EMG, BDF", ".bdf", read_emg),
    Reader("C3D", ".c3d", read_recording, (), "**/*.c3d"),
    Reader("channels, CSV", ".csv", read_channels, ("cells.csv", "channels.csv")),
    Reader("touches, CSV", ".csv", lambda path: read_events(path, 100.0), TABLES),
    Reader("landmarks, CSV", ".csv", read_body_landmarks, ("landmarks.csv", "landmarks_semicolons.csv")),
    Reader("landmarks, FCSV", ".fcsv", read_body_landmarks, ("landmarks.fcsv",)),
    Reader("landmarks, JSON", ".json", read_body_landmarks, LANDMARKS),
    Reader("landmarks, XML", ".xml", read_body_landmarks, ("markers.xml", "arm.osim")),
    Reader("pairs of landmarks, CSV", ".csv", read_landmark_pairs, ("pairs.csv",)),
    Reader("landmarks of a skin, CSV", ".csv", read_body_landmarks, ("skin.csv",)),
    Reader("picked points, CSV", ".csv", read_picks, ("picks.csv",)),
    Reader("measures, CSV", ".csv", lambda path: read_measures(path, [], []), ("measures.csv", "people.csv")),
    Reader("names of keypoints, JSON", ".json", read_keypoint_names, ("names.json",)),
    Reader("names of keypoints, YAML", ".yaml", read_keypoint_names, ("names.yaml", "names_stac.yaml")),
    Reader("keypoints, HDF5", ".h5", read_keypoints, guarded=True),
    Reader("Qualisys, MAT", ".mat", read_qualisys_mat),
    Reader("WAV", ".wav", read_wav),
    Reader("OBJ", ".obj", read_mesh, ("bone.obj",), "**/*.obj"),
    Reader("STL", ".stl", read_mesh, ("bone.stl",), "**/*.stl"),
    Reader("PLY", ".ply", read_mesh, ("bone.ply",), "**/*.ply"),
    Reader("VTP", ".vtp", read_mesh, ("bone.vtp",), "**/*.vtp"),
    Reader("study, TOML", ".toml", read_plan, STUDIES),
    Reader("contacts, TOML", ".toml", lambda path: read_contacts(path, arm()), ("contacts.toml",)),
    Reader("stairs, TOML", ".toml", lambda path: read_stairs(path, arm()), ("stairs.toml",)),
    Reader("specimens, TOML", ".toml", read_viscosity_plan, ("specimens.toml",)),
    Reader("species, TOML", ".toml", read_species, ("species.toml",)),
    Reader("tool setups", ".xml", read_setup, SETUPS, "**/*[Ss]etup*.xml"),
    Reader("tasks", ".xml", read_ik_tasks, ("tasks.xml",), "**/*Tasks*.xml"),
    Reader("external loads", ".xml", read_external_loads, ("loads.xml",), "**/*xternal*.xml"),
    Reader("actuators", ".xml", read_actuators, ("actuators.xml",), "**/*Actuators*.xml"),
    Reader("marker sets", ".xml", lambda path: read_marker_set(path, arm()), ("markers.xml",), "**/*MarkerSet*.xml"),
    Reader("results, NetCDF", ".nc", read_result),
)


def reader(name: str) -> Reader:
    """The reader of a kind of file."""
    return next(one for one in READERS if one.name == name)


def recordings() -> Path | None:
    """The folder of real files that `MYOMORPH_DATA` names, where there is one."""
    told = os.environ.get("MYOMORPH_DATA")
    return Path(told) if told and Path(told).is_dir() else None
