"""The public names: each exists and documents what it takes and gives.

Its example runs as it is printed.
"""

from __future__ import annotations

import dataclasses
import doctest
import importlib
import inspect
import re
from dataclasses import is_dataclass

import pytest
from docs_build.examples import DOCS
from docs_build.face import (
    TABLE,
    first_sentence,
    names_of,
    namespaces,
    public,
    table,
    types_in_fields,
    types_in_signature,
)

import myomorph as mm

FACE = public()
FUNCTIONS = [name for name, value in FACE.items() if inspect.isfunction(value)]
CLASSES = [name for name, value in FACE.items() if inspect.isclass(value)]
DEFINITIONS = {(value.__module__, value.__qualname__) for value in FACE.values()}
LONG = {
    "mm.write_shoulder_study",
    "mm.viscosity.identify_specimen",
    "mm.viscosity.read_estimates",
    "mm.viscosity.read_swings",
    "mm.viscosity.run_viscosity",
}
"""Their examples swing a virtual limb in MuJoCo."""
MAX_NAMES = {"mm": 140, "mm.model": 30}
MAX_NAMES_INSIDE = 20
"""A namespace is to be read on one screen. The top has about forty functions, each with its options
and its result; `mm.model` has a class for each kind of part that a file of OpenSim's may hold.
"""


def sections(text: str) -> dict[str, str]:
    """Return the parts of a docstring by their headings."""
    parts = re.split(r"^(\w+)\n-{3,}\n", inspect.cleandoc(text), flags=re.MULTILINE)
    return {"Summary": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def described(section: str) -> set[str]:
    """Names that a list of parameters or attributes describes."""
    heads = re.findall(r"^([\w, *]+?) :", section, flags=re.MULTILINE)
    return {name.strip(" *") for head in heads for name in head.split(",")}


@pytest.mark.parametrize("space", namespaces())
def test_a_namespace_is_short(space):
    names = names_of(namespaces()[space])
    assert 5 <= len(names) <= MAX_NAMES.get(space, MAX_NAMES_INSIDE)


def test_all_that_is_public_is_a_function_or_a_class_and_has_one_name():
    assert len(FUNCTIONS) + len(CLASSES) == len(FACE)
    assert len(DEFINITIONS) == len(FACE)


def signature_types():
    """Classes of the package in signatures of public functions, and where each is named."""
    return {
        definition: f"{name}({parameter})"
        for name in FUNCTIONS
        for parameter, definitions in types_in_signature(FACE[name]).items()
        for definition in definitions
    }


def test_types_of_public_functions_are_public():
    assert {
        definition: where
        for definition, where in signature_types().items()
        if definition not in DEFINITIONS
    } == {}


def test_types_in_the_fields_of_what_public_functions_take_and_give_are_public():
    private = {
        f"{name}.{field}": definition
        for module, name in signature_types()
        for field, definitions in types_in_fields(
            getattr(importlib.import_module(module), name)
        ).items()
        for definition in definitions
        if definition not in DEFINITIONS
    }
    assert private == {}


def test_types_are_found_behind_type_checking_unions_containers_and_aliases():
    assert ("myomorph.core.tension.terms.term", "Term") in types_in_signature(mm.solve_tension)[
        "terms"
    ]
    assert ("myomorph.lab.store.outcome", "Outcome") in types_in_signature(mm.run_study)["report"]
    assert types_in_signature(mm.read_sto)["return"] == {("myomorph.core.model.series", "Table")}
    assert "paths" not in types_in_fields(mm.MuscleKinematics)


@pytest.mark.parametrize("name", FACE)
def test_every_name_has_a_line(name):
    line = first_sentence(FACE[name])
    assert 10 < len(line) < 200
    space = name.rpartition(".")[0]
    assert f"| `{name}` | " in table(space)


def test_the_page_on_python_has_every_namespace():
    page = (DOCS / "python.md").read_text(encoding="utf-8")
    assert TABLE.findall(page) == list(namespaces())


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_describe_every_parameter(name):
    function = FACE[name]
    parts = sections(function.__doc__)
    assert described(parts.get("Parameters", "")) == set(inspect.signature(function).parameters)
    assert parts.get("Returns", "").strip() or inspect.signature(function).return_annotation in (
        None,
        "None",
    )
    assert "Raises" in parts


@pytest.mark.parametrize("name", CLASSES)
def test_classes_describe_their_fields(name):
    kind = FACE[name]
    assert (kind.__doc__ or "").strip()
    if not issubclass(kind, Exception) and "Attributes" in sections(kind.__doc__):
        inherited = (
            {field.name for field in dataclasses.fields(kind.__mro__[1])}
            if is_dataclass(kind.__mro__[1])
            else set()
        )
        wanted = (
            {field.name for field in dataclasses.fields(kind)} - inherited
            if is_dataclass(kind)
            else set()
        )
        assert wanted - {"stored"} <= described(sections(kind.__doc__)["Attributes"])


@pytest.fixture(scope="session")
def worked_example(tmp_path_factory):
    """Make a folder with the files of the example and, in `results`, the results of its steps."""
    folder = tmp_path_factory.mktemp("example")
    files = mm.example_files(folder)
    (folder / "study.toml").write_text(
        f'[study]\nname = "reaching"\n[[subject]]\nname = "s01"\nmodel = "{files.model.name}"\nmass'
        f' = 4.0\ntrials = ["{files.markers.name}"]\nsteps = ["ik", "id", "muscles", "tension"]\n',
        encoding="utf-8",
    )
    mm.run_study(mm.read_plan(folder / "study.toml"), folder / "results")
    return folder


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.long if name in LONG else ()) for name in FUNCTIONS],
)
def test_examples_run(name, worked_example, monkeypatch):
    monkeypatch.chdir(worked_example)
    tests = doctest.DocTestFinder(recurse=False).find(FACE[name], name, globs={})
    lines = [example.source for test in tests for example in test.examples]
    assert lines, f"{name} has no example"
    assert [line for line in lines if re.search(r"(from|import) myomorph(?! as mm)", line)] == []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    for test in tests:
        runner.run(test)
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
    datasets = [
        result.to_xarray(),
        *(one.to_xarray() for one in (*values, muscles) if one is not None),
    ]
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
    elbow = result.fit.to_pandas()["coordinate_value", "elbow_flexion"]
    assert (elbow == result.fit.motion["elbow_flexion"]).all()
    tension = result.tension.to_xarray()
    flexor = result.tension.muscles.index("flexor")
    assert (
        tension["muscle_force"].sel(muscle="flexor") == result.tension.muscle_force[:, flexor]
    ).all()
    assert len(result.tension.to_pandas()) == len(result.tension)


def test_muscle_kinematics_become_a_dataset(worked_example):
    pytest.importorskip("xarray")
    model = mm.read_model(worked_example / "arm.osim")
    motion = mm.read_motion(worked_example / "reach.mot", model)
    found = mm.muscle_kinematics(model, motion, velocities=False)
    dataset = found.to_xarray()
    assert set(dataset) == {"muscle_length", "moment_arm"}
    arm = dataset["moment_arm"].sel(muscle="flexor", coordinate="elbow_flexion")
    assert (arm == found.moment_arm_of("flexor", "elbow_flexion")).all()
    assert (found.to_pandas()["muscle_length", "flexor", ""] == found.muscle_length[:, 0]).all()


def test_a_folder_without_results_is_named(tmp_path):
    with pytest.raises(mm.BadFile, match="holds no results"):
        mm.load(tmp_path)
    with pytest.raises(mm.BadFile, match="does not exist"):
        mm.load(tmp_path / "absent")
