"""The main chain as on another system.

Spawned processes, cp1252, open files that stay, and an odd path. All of it on Linux at once, in
child processes that `tests/elsewhere/sitecustomize.py` changes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.core.io.c3d.write import write_c3d
from myomorph.core.io.sto import read_sto
from myomorph.core.io.trc import read_trc
from myomorph.show.demo.arm import example_files

ELSEWHERE = Path(__file__).with_name("elsewhere")
FOLDER = "für alle\\Ärzte 1"
STUDY = """
[study]
name = "Größe"
[[subject]]
name = "s 01 é"
model = "arm.osim"
trials = ["reach?.trc"]
steps = ["ik", "id", "muscles", "report"]
"""
COMMANDS = """
import json, sys
from myomorph.lab.cli import main
if __name__ == "__main__":
    for line in json.load(sys.stdin):
        status = main(line)
        sys.stdout.flush()
        if status:
            sys.exit(status)
"""

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="imitates on Linux what differs elsewhere"
)


@pytest.fixture
def there(tmp_path: Path) -> SimpleNamespace:
    """Files of the arm in a folder with a blank, a backslash and an umlaut in its name."""
    home = tmp_path / FOLDER
    home.mkdir()
    return example_files(home)


@pytest.fixture
def elsewhere(there: SimpleNamespace) -> Callable[..., subprocess.CompletedProcess[bytes]]:
    """Return a function that runs command lines one after the other in one child process."""

    def run(*lines: list[object]) -> subprocess.CompletedProcess[bytes]:
        environment = {
            **{
                key: value
                for key, value in os.environ.items()
                if not key.startswith(("LC_", "LANG"))
            },
            "PYTHONPATH": os.pathsep.join([str(ELSEWHERE), *sys.path[1:]]),
            "LC_ALL": "C.UTF-8",
            "PYTHONUTF8": "0",
            "PYTHONIOENCODING": "cp1252:replace",
            "HOLDER": str(os.getpid()),
        }
        given = json.dumps([[str(one) for one in line] for line in lines])
        # The signs of the terminal are cp1252; those of the test's own list are plain.
        return subprocess.run(
            [sys.executable, "-c", COMMANDS],
            input=given.encode("ascii"),
            cwd=there.folder,
            env=environment,
            capture_output=True,
            check=False,
        )

    return run


def test_it_is_another_system(elsewhere, there):
    """What the test is about is really so in the child."""
    program = (
        "import multiprocessing, os, importlib.util\n"
        "from pathlib import Path\n"
        "Path('é').write_text('é')\n"
        "with open('é') as held:\n"
        "    try:\n"
        "        os.replace('arm.osim', 'é')\n"
        "    except PermissionError as error:\n"
        "        print(error.filename2, Path('é').read_bytes())\n"
        "print(multiprocessing.get_start_method(), sys.stdout.encoding)\n"
        "print(importlib.util.find_spec('fcntl'), hasattr(os, 'fork'))\n"
    )
    environment = {
        **os.environ,
        "PYTHONPATH": str(ELSEWHERE),
        "PYTHONUTF8": "0",
        "PYTHONIOENCODING": "cp1252",
    }
    ended = subprocess.run(
        [sys.executable, "-c", "import sys\n" + program],
        cwd=there.folder,
        env=environment,
        capture_output=True,
        check=False,
    )
    assert ended.stdout.decode("cp1252").split() == [
        "é",
        r"b'\xe9'",
        "spawn",
        "cp1252",
        "None",
        "False",
    ], ended.stderr


@pytest.mark.long
def test_the_main_chain(elsewhere, there):
    home = there.folder
    write_c3d(home / "été.c3d", read_trc(there.markers).markers)
    (home / "reach1.trc").write_bytes(there.markers.read_bytes())
    (home / "reach2.trc").write_bytes(there.markers.read_bytes())
    (home / "study.toml").write_text(STUDY, encoding="utf-8")
    motion = home / "gefunden ü.mot"
    model = there.model
    chain: list[list[object]] = [
        ["info", model],
        ["info", home / "été.c3d"],
        ["ik", "--model", model, "--markers", home / "été.c3d", "--out", motion],
        [
            "id",
            "--model",
            model,
            "--motion",
            motion,
            "--loads",
            there.loads,
            "--out",
            home / "Momente.sto",
        ],
        [
            "tension",
            "--model",
            model,
            "--motion",
            motion,
            "--loads",
            there.loads,
            "--out",
            home / "tension",
        ],
        ["report", home / "tension"],
        ["run", home / "study.toml", "--workers", "2", "--out", home / "résultats"],
    ]
    for _ in range(2):
        # The second time, all results are there already and are replaced.
        ended = elsewhere(*chain)
        assert ended.returncode == 0, ended.stderr.decode("cp1252")
    found = read_sto(motion)
    known = read_sto(there.motion)
    for name in known.names:
        np.testing.assert_allclose(np.deg2rad(found[name]), known[name], atol=1e-4)
    assert (home / "tension" / "report.html").is_file()
    assert len(list((home / "résultats").rglob("report.html"))) == 2
    assert (home / "résultats" / "study.html").is_file()


def test_a_result_that_is_open_elsewhere_stays_and_is_named(elsewhere, there):
    """Somebody looks at the result in a program that locks it, as Excel does."""
    motion = there.folder / "gefunden.mot"
    line = ["ik", "--model", there.model, "--markers", there.markers, "--out", motion]
    assert elsewhere(line).returncode == 0
    before = motion.read_bytes()
    with motion.open("rb"):
        ended = elsewhere([*line, "--time", "0", "0.3"])
    told = ended.stderr.decode("cp1252").strip()
    assert (ended.returncode, told.count("\n")) == (2, 0), told
    assert "gefunden.mot: Access is denied" in told
    assert motion.read_bytes() == before
    assert not list(there.folder.glob(".*"))
    assert elsewhere([*line, "--time", "0", "0.3"]).returncode == 0
    assert len(read_sto(motion)) == 31
