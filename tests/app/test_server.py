"""The page's server: what it answers, and what it refuses."""

from __future__ import annotations

import http.client
import json
import threading
from urllib.parse import quote

import pytest

from myomorph.show.app.desk import Desk
from myomorph.show.app.server import AppServer


class Client:
    def __init__(self, server):
        self.server = server
        self.host = f"127.0.0.1:{server.server_port}"
        self.headers = {"Origin": f"http://{self.host}"}

    def ask(self, method, path, body=None, token=None, **headers):
        connection = http.client.HTTPConnection(self.host, timeout=30)
        token = self.server.access.token if token is None else token
        connection.request(method, f"/{token}/{path}", body, self.headers | headers)
        answer = connection.getresponse()
        data = answer.read()
        connection.close()
        return answer, data

    def json(self, method, path, said=None):
        body = None if said is None else json.dumps(said)
        answer, data = self.ask(method, path, body)
        return answer.status, json.loads(data)


@pytest.fixture
def client(tmp_path):
    desk = Desk(tmp_path / "Documents")
    server = AppServer(desk)
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    yield Client(server)
    server.shutdown()
    desk.cancel()
    server.server_close()


def test_it_listens_on_this_machine_only(client):
    assert client.server.server_address[0] == "127.0.0.1"


def test_the_page_runs_no_script_but_its_own(client):
    answer, page = client.ask("GET", "")
    assert answer.status == 200
    assert b"Drop your recordings here" in page
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert answer.headers["Referrer-Policy"] == "no-referrer"
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert answer.headers["Cache-Control"] == "no-store"


def test_nothing_is_fetched_from_elsewhere(client):
    for name in ("", "app.css", "app.js"):
        _, text = client.ask("GET", name)
        assert b"https://" not in text
        assert b"http://" not in text


def test_it_looks_like_the_report(client):
    _, style = client.ask("GET", "app.css")
    assert b"--usable:" in style
    assert b"--paper:" in style


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:80"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
    ],
)
@pytest.mark.parametrize("method", ["GET", "POST", "PUT"])
def test_others_are_refused(client, headers, method):
    answer, data = client.ask(method, "state", "{}", **headers)
    assert answer.status == 403
    assert "home" not in json.loads(data)


def test_a_wrong_key_is_refused(client):
    for token in ("", "x", client.server.access.token[:-1]):
        answer, _ = client.ask("GET", "state", token=token)
        assert answer.status == 403


@pytest.mark.parametrize("token", ["", "x", "<script>alert(1)</script>"])
def test_whoever_opens_a_wrong_address_reads_what_to_do(client, token):
    accept = "text/html,application/xhtml+xml,*/*;q=0.8"
    answer, page = client.ask("GET", "", token=quote(token), Accept=accept)
    text = page.decode()
    assert answer.status == 403
    assert answer.headers["Content-Type"].startswith("text/html")
    assert "script" not in answer.headers["Content-Security-Policy"]
    assert "does not have the key of the page" in text
    assert "type <code>myomorph app</code> again" in text
    assert client.server.access.token not in text
    assert "<script" not in text
    assert "{reason}" not in text


def test_the_state_begins_with_nothing(client):
    status, state = client.json("GET", "state")
    assert status == 200
    assert state["phase"] == "start"
    assert ".c3d" in state["endings"]


def test_files_are_dropped_into_a_folder_of_their_own(client, tmp_path):
    files = [{"path": "S 01 Müller/walk 1.c3d", "size": 5}]
    status, state = client.json("POST", "drop", {"files": files})
    assert (status, state["phase"]) == (200, "receiving")
    answer, _ = client.ask("PUT", f"drop?path={quote('Läufe/walk 1.c3d')}", b"hello")
    assert answer.status == 200
    path = tmp_path / "Documents" / "S 01 Müller" / "Läufe" / "walk 1.c3d"
    assert path.read_bytes() == b"hello"


@pytest.mark.parametrize("name", ["../x.c3d", "..\\x.c3d", "/x.c3d", "C:\\x.c3d", "film.mp4", ""])
def test_names_that_lead_elsewhere_are_refused(client, tmp_path, name):
    client.json("POST", "drop", {"files": [{"path": "walk.c3d", "size": 5}]})
    answer, data = client.ask("PUT", f"drop?path={quote(name)}", b"hello")
    assert answer.status == 400
    assert json.loads(data)["error"]
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_file_that_nobody_announced_is_refused(client):
    answer, data = client.ask("PUT", "drop?path=walk.c3d", b"hello")
    assert answer.status == 400
    assert "drop them again" in json.loads(data)["error"]


@pytest.mark.parametrize(
    "said", [{}, {"files": []}, {"files": "x"}, {"files": [{"path": "a"}]}, {"files": [1]}]
)
def test_a_list_of_files_that_is_none(client, said):
    status, answer = client.json("POST", "drop", said)
    assert status == 400
    assert answer["error"]


def test_too_much_is_refused_before_it_comes(client):
    files = [{"path": "walk.c3d", "size": 1 << 40}]
    status, answer = client.json("POST", "drop", {"files": files})
    assert status == 400
    assert "name their folder" in answer["error"]


@pytest.mark.parametrize("body", ["no json", "[1]", '"x"', "[" * 100_000])
def test_messages_that_are_none(client, body):
    answer, data = client.ask("POST", "look", body)
    assert answer.status == 400
    assert "reload the page" in json.loads(data)["error"]


def test_a_message_that_is_too_long_or_says_no_length(client):
    answer, _ = client.ask("POST", "look", None, **{"Content-Length": str(1 << 30)})
    assert answer.status == 400
    answer, _ = client.ask("POST", "look", None, **{"Content-Length": "-1"})
    assert answer.status == 400


def test_mistakes_are_told_in_sentences(client, tmp_path):
    for path, expected in (
        ("walks", "is not a full path"),
        (str(tmp_path / "nothing"), "does not exist; give a folder of recordings"),
    ):
        status, answer = client.json("POST", "look", {"path": path})
        assert status == 400
        assert expected in answer["error"]
    status, answer = client.json("POST", "compute", {})
    assert (status, answer["error"]) == (
        400,
        "no recordings yet: drop some first",
    )


def test_folders_are_listed(client, tmp_path):
    (tmp_path / "S 01").mkdir()
    status, told = client.json("GET", f"folders?path={quote(str(tmp_path))}")
    assert status == 200
    assert {"name": "S 01", "path": str(tmp_path / "S 01")} in told["folders"]
    assert told["parent"] == str(tmp_path.parent)
    status, told = client.json("GET", "folders?path=")
    assert status == 200
    assert told["folders"]


def test_results_are_shown_without_rights(client, tmp_path):
    out = tmp_path / "out"
    (out / "walk 1").mkdir(parents=True)
    (out / "walk 1" / "report.html").write_text("<p>x</p>")
    (out / "study.toml").write_text("a = 1")
    (tmp_path / "secret.txt").write_text("x")
    answer, _ = client.ask("GET", "results/study.toml")
    assert answer.status == 400, "there is no run yet"
    client.server.desk._out = str(out)
    client.server.desk._done = {"open": ""}
    answer, page = client.ask("GET", "results/walk%201/report.html")
    assert (answer.status, page) == (200, b"<p>x</p>")
    policy = answer.headers["Content-Security-Policy"]
    assert policy.startswith("sandbox ")
    assert "allow-same-origin" not in policy
    assert "connect-src" not in policy
    answer, _ = client.ask("GET", "results/study.toml")
    assert answer.headers["Content-Type"].startswith("text/plain")
    for path in ("../secret.txt", "..%2fsecret.txt", "walk%201/..%2f..%2fsecret.txt", ""):
        answer, data = client.ask("GET", f"results/{path}")
        assert answer.status == 400
        assert b"is no" in data


def test_what_is_not_there(client):
    assert client.json("GET", "nothing")[0] == 404
    assert client.json("POST", "nothing", {})[0] == 404


def test_the_page_ends_the_program(client):
    assert client.json("POST", "quit", {})[0] == 200
    assert client.server.ended.wait(1.0)
