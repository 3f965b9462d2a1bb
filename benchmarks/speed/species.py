"""A whole human leg to a mouse, from files to files: seconds by part and peak memory; five minutes are allowed."""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks.species_cases import BONES, MAN, MOUSE, man, mouse
from benchmarks.speed.timing import clocked
from data_collection import data_folder
from myomorph.morph.registration.smooth import MatchOptions
from myomorph.morph.species.maps import species_bones, species_morph
from myomorph.study.subject.morphing import MorphSettings, write_morphed
from myomorph.study.subject.species_morphing import SpeciesFiles, read_species, species_files

ALLOWED = 300.0


def run() -> list[dict[str, object]]:
    """A row for the maps of the bones, one for bones and muscles, one for the whole way from files to files."""
    data, table = data_folder(), read_species("human-mouse")
    source, target = man(data), mouse(data)
    given = source.model, source.surfaces, target.model, target.surfaces, table
    # Kernels compile first, with the few features of landmarks.
    species_morph(*given, match=MatchOptions(features="landmarks"))
    parts = {
        "maps of five bones": lambda: species_bones(*given),
        "and 40 muscles": lambda: species_morph(*given),
        "from files to model, tables and report": lambda: _files(data),
    }
    return [
        {
            "what": name,
            "seconds": taken.seconds,
            "CPU seconds": taken.cpu,
            "of the 5 min allowed": taken.seconds / ALLOWED,
            "peak [MB]": taken.before + taken.peak,
        }
        for name, taken in ((name, clocked(work)) for name, work in parts.items())
    ]


def _files(data: Path) -> None:
    files = SpeciesFiles(data / MAN, data / MOUSE, geometry=data / BONES)
    morphed, bones = species_files(files, MorphSettings())
    with tempfile.TemporaryDirectory() as folder:
        write_morphed(morphed, Path(folder) / "mouse.osim", bones=bones)
