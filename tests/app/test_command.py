"""`myomorph app` as a program."""

from __future__ import annotations

import http.client
import json
import subprocess
import sys
from urllib.parse import urlsplit

import pytest


@pytest.mark.parametrize(
    "program",
    [
        "from myomorph.lab.cli import main; sys.exit(main(['app', '--no-browser', *sys.argv[1:]]))",
        # From an icon, where there is no terminal.
        "import webbrowser; webbrowser.open = lambda address: None;"
        " from myomorph.show.app import command;"
        " sys.argv = sys.argv[:1]; sys.exit(command.main())",
    ],
    ids=["command", "icon"],
)
def test_it_prints_its_address_serves_and_ends(program, tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", f"import sys; {program}", "--out", str(tmp_path / "Müller")],
        stdout=subprocess.PIPE,
        text=True,
        encoding="utf-8",
    )
    try:
        assert process.stdout is not None
        address = urlsplit(process.stdout.readline().split()[0])
        connection = http.client.HTTPConnection(address.netloc, timeout=60)
        connection.request("GET", f"{address.path}state")
        state = json.loads(connection.getresponse().read())
        assert state["phase"] == "start"
        origin = {"Origin": f"http://{address.netloc}"}
        connection.request("POST", f"{address.path}quit", "{}", origin)
        assert connection.getresponse().status == 200
        assert process.wait(60) == 0
    finally:
        process.kill()


def test_a_port_that_is_none(command):
    told = command("app", "--no-browser", "--port", 70000)
    assert told.status == 2
    assert told.err == "error: port 70000: expected 1 to 65535\n"


def test_a_folder_that_is_not_there(command, tmp_path):
    told = command("app", "--no-browser", tmp_path / "nothing")
    assert told.status == 2
    assert "nothing: does not exist; give a folder of recordings" in told.err
