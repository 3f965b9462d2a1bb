"""The package runs on every system.

Nothing that only POSIX has, no encoding of the machine's, no fork.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

import myomorph

SOURCE = Path(myomorph.__file__).parent
ROOT = Path(__file__).resolve().parents[1]
FILES = sorted(SOURCE.rglob("*.py"))

ONLY_POSIX = {
    "os": {
        "fork",
        "forkpty",
        "kill",
        "killpg",
        "getuid",
        "geteuid",
        "getgid",
        "setsid",
        "mkfifo",
        "uname",
        "wait",
        "nice",
        "getpgid",
        "statvfs",
        "sched_getaffinity",
        "getloadavg",
        "chown",
        "rename",
        "system",
    },
    "signal": {
        "SIGKILL",
        "SIGHUP",
        "SIGALRM",
        "SIGUSR1",
        "SIGUSR2",
        "SIGCHLD",
        "alarm",
        "setitimer",
        "pause",
    },
    "socket": {"AF_UNIX"},
    "time": {"tzset"},
}
"""Names that Windows lacks, or that do something else there: `os.rename` fails where the target
exists.
"""

MODULES = {
    "fcntl",
    "resource",
    "pwd",
    "grp",
    "termios",
    "tty",
    "pty",
    "syslog",
    "posix",
    "curses",
    "readline",
}
TEXTUAL = {"open", "read_text", "write_text", "fdopen", "TextIOWrapper", "NamedTemporaryFile"}
STARTED = {"Process", "Pool", "Pipe", "Queue", "Event", "Lock", "Manager", "SimpleQueue"}
PROGRAMS = {"run", "Popen", "check_call", "check_output"}
FOLDERS = ("/tmp", "/dev/", "/proc/", "/usr/", "/etc/", "/home/", "~/", "C:\\")


def findings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and matter of all that is not portable."""
    guarded = _inside(tree, _is_guard)
    known = _inside(tree, lambda node: isinstance(node, ast.If) and _asks(node.test))
    words = _inside(
        tree, lambda node: isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    )
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom) and node not in guarded:
            yield from _import(node)
        if isinstance(node, ast.Attribute) and node not in known:
            yield from _attribute(node)
        if isinstance(node, ast.Call):
            yield from _call(node)
        if isinstance(node, ast.Constant) and node not in words:
            yield from _constant(node)
        if isinstance(node, ast.JoinedStr):
            yield from _joined(node)


def _inside(tree: ast.AST, chosen: Callable[[ast.AST], bool]) -> set[ast.AST]:
    """All nodes inside those chosen; of a `try`, those of its body."""
    found = set()
    for node in ast.walk(tree):
        if chosen(node):
            parts = node.body if isinstance(node, ast.Try) else [node]
            found |= {inner for part in parts for inner in ast.walk(part)}
    return found


def _is_guard(node: ast.AST) -> bool:
    return isinstance(node, ast.Try) and any(_catches_import(one) for one in node.handlers)


def _import(node: ast.Import | ast.ImportFrom) -> Iterator[tuple[int, str]]:
    if isinstance(node, ast.Import):
        names = [one.name for one in node.names]
    else:
        names = [node.module or ""]
    for name in names:
        if name.split(".")[0] in MODULES:
            yield (
                node.lineno,
                f"import of {name}, which not every system has, outside try/except ImportError",
            )


def _attribute(node: ast.Attribute) -> Iterator[tuple[int, str]]:
    if not isinstance(node.value, ast.Name):
        return
    if node.attr in ONLY_POSIX.get(node.value.id, ()):
        yield node.lineno, f"{node.value.id}.{node.attr} is POSIX's"
    if node.value.id in ("multiprocessing", "mp") and node.attr in STARTED:
        yield (
            node.lineno,
            f"multiprocessing.{node.attr} starts as the system likes: take get_context('spawn')",
        )


def _constant(node: ast.Constant) -> Iterator[tuple[int, str]]:
    if not isinstance(node.value, str):
        return
    if node.value.startswith(FOLDERS):
        yield node.lineno, f"the path {node.value!r} is of one system"
    if any(sign in node.value for sign in ("%-d", "%-m", "%-H", "%-I", "%s.%f")):
        yield node.lineno, f"strftime {node.value!r} is glibc's"


def _call(node: ast.Call) -> Iterator[tuple[int, str]]:
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    given = {one.arg for one in node.keywords}
    owner = _owner(node.func)
    if name in TEXTUAL and owner not in ("webbrowser", "wave", "Image", "zipfile"):
        yield from _opened(node, name, owner)
    if name == "get_context":
        method = node.args[0] if node.args else None
        if not (isinstance(method, ast.Constant) and method.value == "spawn"):
            yield node.lineno, "get_context() without 'spawn'"
    if name == "ProcessPoolExecutor" and "mp_context" not in given:
        yield node.lineno, "ProcessPoolExecutor without mp_context forks on some systems"
    if {"preexec_fn", "start_new_session", "process_group"} & given:
        yield node.lineno, "a child's session is POSIX's"
    if name in PROGRAMS and owner == "subprocess" and "shell" in given:
        yield node.lineno, "a shell is another one elsewhere"


def _owner(function: ast.expr) -> str:
    """Name of what a method is called of, "" where that has none."""
    if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
        return function.value.id
    return ""


def _opened(node: ast.Call, name: str, owner: str) -> Iterator[tuple[int, str]]:
    """Files opened as text without an encoding."""
    given = {one.arg: one.value for one in node.keywords}
    if name == "open" and (owner == "os" or not _opens_file(node, owner)):
        return
    mode = given.get("mode") or _mode_by_place(node, name)
    binary = isinstance(mode, ast.Constant) and "b" in str(mode.value)
    # The first positional argument of read_text, and the second of write_text, is the encoding.
    stated = "encoding" in given or len(node.args) > {"read_text": 0, "write_text": 1}.get(name, 99)
    if not binary and not stated and not (name == "NamedTemporaryFile" and mode is None):
        yield node.lineno, f"{name}() without encoding takes the machine's"


def _mode_by_place(node: ast.Call, name: str) -> ast.expr | None:
    """Argument that is the mode where it has no keyword: the first of a path's `open`."""
    if name == "open" and isinstance(node.func, ast.Attribute):
        return node.args[0] if node.args else None
    return node.args[1] if name in ("open", "fdopen") and len(node.args) > 1 else None


def _opens_file(node: ast.Call, owner: str) -> bool:
    """Whether `open` is that of a file.

    Other things than files are opened, too: a model that waits to be made, an input of a trial, ...
    """
    if not isinstance(node.func, ast.Attribute):
        return True
    given = {one.arg: one.value for one in node.keywords}
    mode = given.get("mode") or (node.args[0] if node.args else None)
    no_mode = isinstance(mode, ast.expr) and not isinstance(mode, ast.Constant)
    bare = not (node.args or given)
    return not (no_mode or bare) or owner.endswith(("path", "file", "name"))


def _joined(node: ast.JoinedStr) -> Iterator[tuple[int, str]]:
    """Paths put together as texts, as f"{folder}/name"."""
    for before, after in zip(node.values, node.values[1:], strict=False):
        if isinstance(before, ast.FormattedValue) and isinstance(after, ast.Constant):
            held = before.value
            name = held.attr if isinstance(held, ast.Attribute) else getattr(held, "id", "")
            if str(after.value).startswith("/") and name.lower() in (
                "folder",
                "out",
                "parent",
                "directory",
            ):
                yield node.lineno, f"{name}/... as a text: join paths with pathlib"


def _catches_import(handler: ast.ExceptHandler) -> bool:
    names = (
        [one.id for one in ast.walk(handler.type) if isinstance(one, ast.Name)]
        if handler.type
        else []
    )
    return "ImportError" in names or "ModuleNotFoundError" in names


def _asks(test: ast.expr) -> bool:
    """Whether a condition asks which system it is."""
    return any(
        (
            isinstance(one, ast.Attribute)
            and one.attr in ("name", "platform")
            and getattr(one.value, "id", "") in ("os", "sys")
        )
        or (isinstance(one, ast.Call) and getattr(one.func, "id", "") == "hasattr")
        for one in ast.walk(test)
    )


@pytest.mark.parametrize("room", sorted({one.relative_to(SOURCE).parts[0] for one in FILES}))
def test_nothing_of_one_system_alone(room: str) -> None:
    files = [one for one in FILES if one.relative_to(SOURCE).parts[0] == room]
    found = [
        f"{file.relative_to(SOURCE)}:{line}: {matter}"
        for file in files
        for line, matter in findings(ast.parse(file.read_text(encoding="utf-8")))
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    "text",
    [
        "import fcntl",
        "import os\nos.fork()",
        "import signal\nx = signal.SIGKILL",
        "open('a')",
        "from pathlib import Path\nPath('a').read_text()",
        "from pathlib import Path\nPath('a').open('w')",
        "import multiprocessing\nmultiprocessing.Pool()",
        "from multiprocessing import get_context\nget_context('fork')",
        "from concurrent.futures import ProcessPoolExecutor\nProcessPoolExecutor()",
        "import tempfile\nfolder = '/tmp/x'",
        "when.strftime('%-d')",
        "folder = 'a'\nname = f'{folder}/b'",
        "import os\nos.rename('a', 'b')",
        "import subprocess\nsubprocess.run('ls', shell=True)",
    ],
)
def test_the_search_finds_what_it_looks_for(text: str) -> None:
    assert list(findings(ast.parse(text)))


@pytest.mark.parametrize(
    "text",
    [
        "try:\n    import fcntl\nexcept ImportError:\n    fcntl = None",
        "import os\nif hasattr(os, 'fork'):\n    os.fork()",
        "open('a', 'rb')",
        "from pathlib import Path\nPath('a').read_text('utf-8')",
        "from pathlib import Path\nPath('a').open('wb')",
        "from multiprocessing import get_context\nget_context('spawn').Process()",
        '"""Not in /tmp."""',
        "import os\nos.replace('a', 'b')",
    ],
)
def test_the_search_lets_the_rest_pass(text: str) -> None:
    assert not list(findings(ast.parse(text)))


def test_the_runners_do_what_the_readme_says():
    """Three systems, the Pythons that the package names, and the commands for users.

    The commands are the same to the letter.
    """
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))[
        "jobs"
    ]
    matrix = jobs["readme"]["strategy"]["matrix"]
    assert [one.split("-")[0] for one in matrix["os"]] == ["ubuntu", "windows", "macos"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    named = [
        one.rpartition(" ")[2] for one in project["classifiers"] if re.search(r":: 3\.\d+$", one)
    ]
    assert matrix["python"] == named
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    commands = re.findall(r"^(?:python -m pip .*|myomorph demo)$", readme, re.MULTILINE)
    contributing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    commands += re.findall(r"(?<=`)python -m pytest [^`]* -m long(?=`)", contributing)
    ran = [step["run"] for step in jobs["readme"]["steps"] if "run" in step]
    assert [line for run in ran for line in run.splitlines()] == commands
    assert len(commands) == 4
    assert jobs["everything"]["steps"][-1]["run"] == ".ci/run"
