"""Every reader of files from other programs: how it is called.

Also the whole files that fuzzing begins with.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from binary_seeds import SEEDS, binary_seeds

from myomorph.bones.study.species_morphing import read_species
from myomorph.core.io.channels import read_channels
from myomorph.core.io.contact_events import read_events
from myomorph.core.io.formats import CHANNELS, MODELS, TRIALS
from myomorph.core.io.inertial.read import SENSORS
from myomorph.core.io.keypoints import read_keypoint_names
from myomorph.core.io.labels import read_labels
from myomorph.core.io.landmarks import read_body_landmarks, read_landmark_pairs
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.mesh import read_mesh
from myomorph.core.io.mjcf.compile import check_files
from myomorph.core.io.osim.actuators import read_actuators
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.setup_parts import read_ik_tasks, read_marker_set
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.sto import read_sto
from myomorph.core.io.wav import read_wav
from myomorph.core.model.model import Model
from myomorph.exchange.opensim.tool_setups import read_setup
from myomorph.lab.info.inspect import inspect
from myomorph.lab.store.results import read_result
from myomorph.lab.store.toml_file import refuse
from myomorph.lab.study.inputs.contact_file import read_contacts, read_stairs
from myomorph.lab.study.inputs.reading import read_motion, read_recording
from myomorph.lab.study.plan.measures import read_measures
from myomorph.lab.study.plan.plan import read_plan
from myomorph.swings.viscosity.study.calibration import read_picks
from myomorph.swings.viscosity.study.plan import read_viscosity_plan

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

    @property
    def file_name(self) -> str:
        """Of a wrong file, which has the ending."""
        return f"zz wrong{self.ending}"

    def seeds(self, data: Path | None = None) -> list[bytes]:
        """Whole files: ours, and small real ones of the folder `data`."""
        found = [(SEEDS / name).read_bytes() for name in self.files] + list(
            binary_seeds().get(self.ending, ())
        )
        if data is not None and self.recorded:
            real = sorted(
                one for one in data.glob(self.recorded) if 0 < one.stat().st_size < LARGEST_SEED
            )
            found += [one.read_bytes() for one in real[:: max(len(real) // 12, 1)]]
        return found


@cache
def arm() -> Model:
    """Return the model that the seeds refer to."""
    return read_osim(SEEDS / "arm.osim")


def _written_again(path: Path) -> Any:
    """Read a model, describe it, and write it."""
    inspect(path)
    return write_osim(read_osim(path), path.with_name("written again.osim"))


def _measures(path: Path) -> Any:
    """Read a table of measures; its problems have the names of a study."""
    problems: list[str] = []
    read = read_measures(path, problems, [])
    refuse(path, problems)
    return read


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


FORMATS = (*MODELS, *TRIALS, *CHANNELS, *SENSORS)
"""Kinds of files by the product's own tables: each is tried, whoever adds it."""
SEEDS_OF = {
    "OpenSim model": ("arm.osim",),
    "MuJoCo model": ("arm_mujoco.xml",),
    "TRC markers": ("walk.trc",),
    "BIDS motion": ("bids_motion.tsv",),
    "OpenSim orientations": ("orientations.sto",),
    "Xsens MVN": ("sensors.mvnx",),
    "Xsens MT Manager": ("xsens.txt",),
    "Movella DOT, APDM or Delsys": (
        "dot.csv",
        "apdm.csv",
        "apdm_older.csv",
        "delsys_sensors.csv",
    ),
}
"""Files of text that fuzzing begins with; binary ones are made."""
RECORDED = {
    ".osim": "*/*.osim",
    ".xml": "mouse*/*.xml",
    ".trc": "**/*.trc",
    ".c3d": "**/*.c3d",
    ".mvnx": "**/*.mvnx",
}
WITH_FILES_BESIDE = {"BIDS motion": partial(_as_motion, "motion.tsv")}
GUARDED = (".h5", ".hdf5", ".xml", ".mjcf")
"""Endings of files that a process of their own reads first."""


def of_formats() -> Iterator[Reader]:
    """Each kind of file of the product's tables, by each of its endings."""
    for kind in FORMATS:
        for ending in kind.endings:
            yield Reader(
                name=f"{kind.name}, {ending}",
                ending=ending,
                read=WITH_FILES_BESIDE.get(kind.name, kind.read),
                files=SEEDS_OF.get(kind.name, ()),
                recorded=RECORDED.get(ending, ""),
                guarded=ending in GUARDED,
            )


READERS = (
    *of_formats(),
    Reader(
        name="OSIM, described and written",
        ending=".osim",
        read=_written_again,
        files=("arm.osim",),
        recorded="*/*.osim",
    ),
    Reader(
        name="MJCF before it is compiled",
        ending=".xml",
        read=check_files,
        files=("arm_mujoco.xml",),
        recorded="mouse*/*.xml",
    ),
    Reader(
        name="STO, MOT",
        ending=".sto",
        read=read_sto,
        files=("data.sto", "forces.mot"),
        recorded="**/*.[sm][to][ot]",
    ),
    Reader(
        name="MOT as coordinates",
        ending=".mot",
        read=lambda path: read_motion(path, arm()),
        files=("motion.mot",),
    ),
    *(
        Reader(
            name=f"BIDS {name}",
            ending=f".{name[-4:].strip('.')}",
            read=partial(_as_motion, name),
            files=(f"bids_{name}",),
        )
        for name in MOTION[1:]
    ),
    Reader(name="C3D", ending=".c3d", read=read_recording, files=(), recorded="**/*.c3d"),
    Reader(
        name="channels, CSV",
        ending=".csv",
        read=read_channels,
        files=("cells.csv", "channels.csv", "delsys.csv"),
    ),
    Reader(
        name="touches, CSV", ending=".csv", read=lambda path: read_events(path, 100.0), files=TABLES
    ),
    Reader(
        name="landmarks, CSV",
        ending=".csv",
        read=read_body_landmarks,
        files=("landmarks.csv", "landmarks_semicolons.csv"),
    ),
    Reader(
        name="landmarks, FCSV", ending=".fcsv", read=read_body_landmarks, files=("landmarks.fcsv",)
    ),
    Reader(name="landmarks, JSON", ending=".json", read=read_body_landmarks, files=LANDMARKS),
    Reader(
        name="landmarks, XML",
        ending=".xml",
        read=read_body_landmarks,
        files=("markers.xml", "arm.osim"),
    ),
    Reader(
        name="pairs of landmarks, CSV",
        ending=".csv",
        read=read_landmark_pairs,
        files=("pairs.csv",),
    ),
    Reader(
        name="landmarks of a skin, CSV",
        ending=".csv",
        read=read_body_landmarks,
        files=("skin.csv",),
    ),
    Reader(name="picked points, CSV", ending=".csv", read=read_picks, files=("picks.csv",)),
    Reader(
        name="measures, CSV",
        ending=".csv",
        read=_measures,
        files=("measures.csv", "people.csv"),
    ),
    Reader(
        name="names of keypoints, JSON",
        ending=".json",
        read=read_keypoint_names,
        files=("names.json",),
    ),
    Reader(
        name="names of keypoints, YAML",
        ending=".yaml",
        read=read_keypoint_names,
        files=("names.yaml", "names_stac.yaml"),
    ),
    Reader(name="labels, CSV", ending=".csv", read=read_labels, files=("labels.csv",)),
    Reader(name="labels, TOML", ending=".toml", read=read_labels, files=("labels.toml",)),
    Reader("WAV", ".wav", read_wav),
    Reader(name="OBJ", ending=".obj", read=read_mesh, files=("bone.obj",), recorded="**/*.obj"),
    Reader(name="STL", ending=".stl", read=read_mesh, files=("bone.stl",), recorded="**/*.stl"),
    Reader(name="PLY", ending=".ply", read=read_mesh, files=("bone.ply",), recorded="**/*.ply"),
    Reader(name="VTP", ending=".vtp", read=read_mesh, files=("bone.vtp",), recorded="**/*.vtp"),
    Reader(name="study, TOML", ending=".toml", read=read_plan, files=STUDIES),
    Reader(
        name="contacts, TOML",
        ending=".toml",
        read=lambda path: read_contacts(path, arm()),
        files=("contacts.toml",),
    ),
    Reader(
        name="stairs, TOML",
        ending=".toml",
        read=lambda path: read_stairs(path, arm()),
        files=("stairs.toml",),
    ),
    Reader(
        name="specimens, TOML", ending=".toml", read=read_viscosity_plan, files=("specimens.toml",)
    ),
    Reader(name="species, TOML", ending=".toml", read=read_species, files=("species.toml",)),
    Reader(
        name="tool setups",
        ending=".xml",
        read=read_setup,
        files=SETUPS,
        recorded="**/*[Ss]etup*.xml",
    ),
    Reader(
        name="tasks",
        ending=".xml",
        read=read_ik_tasks,
        files=("tasks.xml",),
        recorded="**/*Tasks*.xml",
    ),
    Reader(
        name="external loads",
        ending=".xml",
        read=read_external_loads,
        files=("loads.xml",),
        recorded="**/*xternal*.xml",
    ),
    Reader(
        name="actuators",
        ending=".xml",
        read=read_actuators,
        files=("actuators.xml",),
        recorded="**/*Actuators*.xml",
    ),
    Reader(
        name="marker sets",
        ending=".xml",
        read=lambda path: read_marker_set(path, arm()),
        files=("markers.xml",),
        recorded="**/*MarkerSet*.xml",
    ),
    Reader("results, NetCDF", ".nc", read_result, guarded=True),
)


def reader(name: str) -> Reader:
    """Return the reader of a kind of file."""
    return next(one for one in READERS if one.name == name)


def recordings() -> Path | None:
    """Return the folder of real files that `MYOMORPH_DATA` names, where there is one."""
    told = os.environ.get("MYOMORPH_DATA")
    return Path(told) if told and Path(told).is_dir() else None
