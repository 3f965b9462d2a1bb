"""Public names come from the stub beside a package, and only when they are asked for."""

from __future__ import annotations

import subprocess
import sys

import pytest

import myomorph as mm
from myomorph.lazy_names import lazy_names


def make_package(folder, name: str, stub: str):
    """Write a package with a stub and two modules; returns the path of its `__init__.py`."""
    package = folder / name
    package.mkdir()
    init = package / "__init__.py"
    init.write_text("", encoding="utf-8")
    (package / "__init__.pyi").write_text(stub, encoding="utf-8")
    (package / "shapes.py").write_text("AREA = 2.0\n", encoding="utf-8")
    (package / "lengths.py").write_text("LENGTH = 3.0\n", encoding="utf-8")
    return init


@pytest.fixture
def package(tmp_path, monkeypatch):
    stub = (
        "from . import lengths as lengths\n"
        "from .shapes import AREA as AREA\n"
        "from .shapes import AREA as surface\n"
    )
    init = make_package(tmp_path, "drawn_package", stub)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield lazy_names("drawn_package", str(init))
    for module in [name for name in sys.modules if name.startswith("drawn_package")]:
        del sys.modules[module]


def test_names_modules_and_other_names_for_them(package):
    assert package.names == package.list_names() == ["AREA", "lengths", "surface"]
    __import__("drawn_package")
    assert package.get("AREA") == package.get("surface") == 2.0
    assert package.get("lengths").LENGTH == 3.0


def test_a_module_is_imported_when_its_name_is_first_asked_for(package):
    __import__("drawn_package")
    assert "drawn_package.shapes" not in sys.modules
    package.get("AREA")
    assert "drawn_package.shapes" in sys.modules
    assert "drawn_package.lengths" not in sys.modules


def test_an_unknown_name_is_an_attribute_error(package):
    with pytest.raises(AttributeError, match="'drawn_package' has no attribute 'volume'"):
        package.get("volume")
    with pytest.raises(AttributeError, match="no attribute 'volume'"):
        _ = mm.volume


def test_names_are_listed_without_an_import():
    program = "import sys, myomorph; dir(myomorph); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert not [name for name in done.stdout.split() if name.startswith("myomorph.core")]
