"""Files of a release agree with each other: metadata, recipe, citation, archive, workflow."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import yaml

import myomorph

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CONDA = {"mujoco": "mujoco-python", "clarabel": "clarabel"}
"""Packages that conda-forge calls otherwise."""


def recipe() -> dict:
    text = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    return yaml.safe_load(text)


def test_the_recipe_needs_what_the_package_needs():
    wanted = {CONDA.get(name, name) + " " + rest for name, rest in requirements()}
    assert set(recipe()["requirements"]["run"]) == wanted | {f"python {PROJECT['requires-python']}"}


def requirements() -> list[tuple[str, str]]:
    """Names of the dependencies and what their versions have to be."""
    found = [re.fullmatch(r"([\w-]+)(>=.*)", one) for one in PROJECT["dependencies"]]
    return [(match[1], match[2]) for match in found if match]


def test_the_recipe_has_the_programs_and_the_version():
    made = recipe()
    declared = PROJECT["scripts"] | PROJECT["gui-scripts"]
    programs = [f"{name} = {place}" for name, place in declared.items()]
    assert made["build"]["python"]["entry_points"] == programs
    assert made["context"]["version"] == myomorph.__version__
    assert made["about"]["summary"] == PROJECT["description"]


def test_the_archive_and_the_citation_say_the_same():
    archive = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert archive["title"] == citation["title"]
    assert archive["keywords"] == citation["keywords"]
    assert archive["license"] == citation["license"].lower()
    assert [one["name"] for one in archive["creators"]] == [
        one["name"] for one in citation["authors"]
    ]


def test_a_release_is_published_without_a_password():
    path = ROOT / ".github" / "workflows" / "publish.yml"
    jobs = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"]
    assert jobs["publish"]["permissions"] == {"id-token": "write"}
    assert "secrets" not in path.read_text(encoding="utf-8")
    commands = "\n".join(step.get("run", "") for step in jobs["build"]["steps"])
    for part in ("SOURCE_DATE_EPOCH", "python -m build", "twine check --strict"):
        assert part in commands


def test_every_extra_for_users_is_explained():
    page = (ROOT / "docs" / "getting-started.md").read_text(encoding="utf-8")
    rows = set(re.findall(r"^\| `(\w+)` \|", page.split("| extra |")[1], re.MULTILINE))
    for_developers = {"oracles", "docs", "test", "release", "mutants", "lint"}
    assert set(PROJECT["optional-dependencies"]) - for_developers <= rows


def test_there_are_at_most_sixteen_dependencies():
    assert len(requirements()) == len(PROJECT["dependencies"]) <= 16


def test_actions_are_pinned_by_commit():
    """A tag can be moved, a commit cannot."""
    for path in (ROOT / ".github" / "workflows").glob("*.yml"):
        for used in re.findall(r"uses: (\S+)", path.read_text(encoding="utf-8")):
            assert re.fullmatch(r"[\w.-]+/[\w.-]+@[0-9a-f]{40}", used), used


def test_files_of_a_release_are_attested_and_dependencies_are_audited():
    workflows = ROOT / ".github" / "workflows"
    jobs = yaml.safe_load((workflows / "publish.yml").read_text(encoding="utf-8"))["jobs"]
    assert jobs["publish"]["steps"][-1]["with"] == {"attestations": True}
    checks = yaml.safe_load((workflows / "ci.yml").read_text(encoding="utf-8"))["jobs"]
    assert "pip_audit" in checks["audit"]["steps"][-1]["run"]
    assert (ROOT / "SECURITY.md").exists()


def test_what_private_parts_are_taken_from_has_an_upper_bound():
    """The cache of machine code subclasses classes that Numba does not promise to keep."""
    private = re.compile(r"^from (\w+)\.(?:core|misc)\b", re.MULTILINE)
    source = ROOT / "src" / "myomorph"
    taken = {
        package
        for path in source.rglob("*.py")
        for package in private.findall(path.read_text(encoding="utf-8"))
        if package != "myomorph"
    }
    assert taken == {"numba"}
    assert all("<" in rest for name, rest in requirements() if name in taken)
