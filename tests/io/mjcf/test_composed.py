"""Models of `myo-sim` by name, where a file's path may stand."""

from __future__ import annotations

from pathlib import Path

import pytest

from myomorph.core.io.formats import is_composed, read_model
from myomorph.core.model.errors import BadFile
from myomorph.lab.store.results import file_source

pytest.importorskip("myo_sim")


def test_a_models_name_stands_for_its_file():
    model = read_model(Path("myo-sim:myoarm"))
    assert model.name == "myoarm"
    assert {"humerus_r", "radius_r"} <= set(model.body_names)
    assert "BRA" in model.muscle_names
    # Bones are found beside the model.
    mesh = model.body("humerus_r").meshes[0]
    assert (Path(model.source).parent / mesh.file).is_file() or Path(mesh.file).is_file()


def test_its_source_is_the_packages_version():
    one = file_source("model", Path("myo-sim:myoarm"))
    assert one.name == "myo-sim:myoarm"
    assert one == file_source("model", "myo-sim:myoarm")
    assert one.sha256 != file_source("model", "myo-sim:myolegs").sha256


def test_an_unknown_model_names_those_there_are():
    with pytest.raises(BadFile, match="myofullbody"):
        read_model("myo-sim:nobody")
    assert not is_composed("myoarm.xml")


def test_grams_that_turn_as_trunks_do_are_warned_of():
    warning, fibers = read_model("myo-sim:myoarm").warnings
    assert "'clavphant_r'" in warning
    assert "1 kg m^2 at 0.001 kg" in warning
    assert "the fibers of 6 of 63 muscles would be longer than the muscles" in fibers
    (of_legs,) = read_model("myo-sim:myolegs").warnings
    assert "the fibers of 2 of 80 muscles" in of_legs
