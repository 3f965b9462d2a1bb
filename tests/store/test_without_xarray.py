"""Commands and results without xarray, h5netcdf and pandas, which only an extra brings."""

import ast
import subprocess
import sys
from pathlib import Path

import myomorph
from myomorph.show.demo.arm import ExampleFiles

EXTRA = ("xarray", "h5netcdf", "pandas")
PROGRAM = """
import sys
for name in sys.argv[1].split():
    sys.modules[name] = None
from pathlib import Path
import myomorph as mm
from myomorph.lab.cli import main
from myomorph.core.model.errors import MissingPackage
model, markers, folder = sys.argv[2:]
out = str(Path(folder) / "walk" / "coordinates.mot")
Path(out).parent.mkdir()
assert main(["ik", "--model", model, "--markers", markers, "--out", out]) == 0
walk = str(Path(folder) / "walk")
assert main(["tension", "--model", model, "--motion", out, "--out", walk]) == 0
assert main(["report", walk]) == 0
result = next(one for one in mm.load(Path(folder) / "walk").values() if one.tension is not None)
print(len(result.tension), *result.tension.muscles)
for value in (result, result.motion, result.tension):
    for name in ("to_xarray", "to_pandas"):
        try:
            getattr(value, name)()
        except MissingPackage as error:
            assert "\\n" not in str(error)
            print(error)
"""


def test_what_users_do_works_without_them(arm: ExampleFiles, tmp_path: Path) -> None:
    arguments = [" ".join(EXTRA), str(arm.model), str(arm.markers), str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *arguments], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert any(line.split()[0] == "61" for line in lines if line)
    refused = [line for line in lines if "myomorph[xarray]" in line]
    assert len(refused) == 6
    assert all("pip install" in line for line in refused)
    assert (tmp_path / "walk" / "report.html").is_file()


def test_nothing_imports_them_but_for_types() -> None:
    for path in Path(myomorph.__file__).parent.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        typing = {
            node
            for block in ast.walk(tree)
            if isinstance(block, ast.If) and getattr(block.test, "id", "") == "TYPE_CHECKING"
            for node in ast.walk(block)
        }
        names = [
            alias.name if isinstance(node, ast.Import) else node.module or ""
            for node in ast.walk(tree)
            if isinstance(node, ast.Import | ast.ImportFrom) and node not in typing
            for alias in node.names
        ]
        assert not {name.split(".")[0] for name in names} & set(EXTRA), path
