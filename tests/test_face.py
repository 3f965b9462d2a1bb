"""The public names: each is there, says what it takes and gives, and its example runs as it is printed."""

from __future__ import annotations

import doctest
import inspect
import re

import pytest

import myomorph as mm
from myomorph.demo.arm import example_files

NAMES = sorted(mm.__all__)
FUNCTIONS = [name for name in NAMES if inspect.isfunction(getattr(mm, name))]
CLASSES = [name for name in NAMES if inspect.isclass(getattr(mm, name))]


def sections(text: str) -> dict[str, str]:
    """The parts of a docstring by their headings."""
    parts = re.split(r"^(\w+)\n-{3,}\n", inspect.cleandoc(text), flags=re.MULTILINE)
    return {"Summary": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def described(section: str) -> set[str]:
    """Names that a list of parameters or attributes describes."""
    heads = re.findall(r"^([\w, *]+?) :", section, flags=re.MULTILINE)
    return {name.strip(" *") for head in heads for name in head.split(",")}


def test_the_list_is_short():
    assert 35 <= len(NAMES) <= 56
    assert len(FUNCTIONS) + len(CLASSES) == len(NAMES)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_describe_every_parameter(name):
    function = getattr(mm, name)
    parts = sections(function.__doc__)
    assert described(parts.get("Parameters", "")) == set(inspect.signature(function).parameters)
    assert parts.get("Returns", "").strip() or inspect.signature(function).return_annotation in (None, "None")
    assert "Raises" in parts


@pytest.mark.parametrize("name", CLASSES)
def test_classes_describe_their_fields(name):
    kind = getattr(mm, name)
    assert (kind.__doc__ or "").strip()
    if not issubclass(kind, Exception) and "Attributes" in sections(kind.__doc__):
        wanted = set(getattr(kind, "__dataclass_fields__", {})) - set(
            getattr(kind.__mro__[1], "__dataclass_fields__", {})
        )
        assert wanted - {"stored"} <= described(sections(kind.__doc__)["Attributes"])


@pytest.fixture(scope="session")
def worked_example(tmp_path_factory):
    """A folder with the files of the example and, in `results`, what the steps made of them."""
    folder = tmp_path_factory.mktemp("example")
    files = example_files(folder)
    (folder / "study.toml").write_text(
        f'[study]\nname = "reaching"\n[[subject]]\nname = "s01"\nmodel = "{files.model.name}"\nmass = 4.0\n'
        f'trials = ["{files.markers.name}"]\nsteps = ["ik", "id", "muscles", "tension"]\n',
        encoding="utf-8",
    )
    mm.run_study(mm.read_plan(folder / "study.toml"), folder / "results")
    return folder


@pytest.mark.parametrize("name", FUNCTIONS)
def test_examples_run(name, worked_example, monkeypatch):
    monkeypatch.chdir(worked_example)
    function = getattr(mm, name)
    tests = doctest.DocTestFinder(recurse=False).find(function, name, globs={})
    assert any(one.examples for one in tests), f"{name} has no example"
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    for one in tests:
        runner.run(one)
    assert runner.failures == 0


def test_results_are_given_back(worked_example):
    (result,) = mm.load(worked_example / "results").values()
    assert result.facts["trial"] == "reach"
    assert result.fit.motion.names == ("shoulder_flexion", "elbow_flexion")
    assert len(result.torques) == len(result.motion) == len(result.tension) == 61
    assert set(result.provenance) == {"ik", "id", "muscles", "tension"}


def test_results_become_datasets(worked_example):
    pytest.importorskip("xarray")
    (result,) = mm.load(worked_example / "results").values()
    dataset = result.to_xarray()
    assert dataset["moment_arm"].shape[0] == 61
    frame = result.to_pandas()
    assert len(frame) == 61
    torques = frame.xs("elbow_flexion", axis=1, level=1)
    assert any((torques[name] == result.torques["elbow_flexion"]).all() for name in torques)


def test_every_variable_has_its_unit_and_the_mass_is_a_number(worked_example):
    xarray = pytest.importorskip("xarray")
    (result,) = mm.load(worked_example / "results").values()
    values = (result.fit, result.motion, result.torques, result.tension, result.markers)
    muscles = mm.muscle_kinematics(mm.read_model(worked_example / "arm.osim"), result.motion)
    datasets = [result.to_xarray(), *(one.to_xarray() for one in (*values, muscles) if one is not None)]
    assert len(datasets) >= 6
    for dataset in datasets:
        numbers = {name: one for name, one in dataset.variables.items() if one.dtype.kind in "fib"}
        assert {name for name, one in numbers.items() if not one.attrs.get("units")} == set()
    assert datasets[0].attrs["mass"] == 4.0
    assert isinstance(float(datasets[0].attrs["mass"]), float)
    assert not isinstance(datasets[0].attrs["mass"], str)
    assert datasets[0].attrs["mass_unit"] == "kg"
    with xarray.open_dataset(result.path) as opened:
        assert opened.attrs["mass"] + 1.0 == 5.0


def test_values_of_the_steps_become_datasets(worked_example):
    pytest.importorskip("xarray")
    (result,) = mm.load(worked_example / "results").values()
    fit = result.fit.to_xarray()
    assert fit["marker_error"].dims == ("time", "marker")
    assert fit["marker_error"].attrs["units"] == "m"
    elbow = result.fit.to_pandas()["coordinates", "elbow_flexion"]
    assert (elbow == result.fit.motion["elbow_flexion"]).all()
    tension = result.tension.to_xarray()
    flexor = result.tension.muscles.index("flexor")
    assert (tension["muscle_force"].sel(muscle="flexor") == result.tension.forces[:, flexor]).all()
    assert len(result.tension.to_pandas()) == len(result.tension)


def test_muscle_kinematics_become_a_dataset(worked_example):
    pytest.importorskip("xarray")
    model = mm.read_model(worked_example / "arm.osim")
    motion = mm.read_motion(worked_example / "reach.mot", model)
    found = mm.muscle_kinematics(model, motion, velocities=False)
    dataset = found.to_xarray()
    assert set(dataset) == {"length", "moment_arm"}
    arm = dataset["moment_arm"].sel(muscle="flexor", coordinate="elbow_flexion")
    assert (arm == found.moment_arm("flexor", "elbow_flexion")).all()
    assert (found.to_pandas()["length", "flexor", ""] == found.lengths[:, 0]).all()


def test_a_folder_without_results_is_named(tmp_path):
    with pytest.raises(mm.BadFile, match="holds no results"):
        mm.load(tmp_path)
    with pytest.raises(mm.BadFile, match="does not exist"):
        mm.load(tmp_path / "absent")
