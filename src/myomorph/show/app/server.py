"""The server of the page, for this machine only."""

from __future__ import annotations

import json
import os
import socket
import socketserver
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from functools import cache
from html import escape
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.lab.cli.failures import failure_of
from myomorph.show.app.access import LOOPBACK, Access
from myomorph.show.app.desk import Desk
from myomorph.show.app.paths import WINDOWS, inside, roots, subfolders, typed_path
from myomorph.show.app.words import in_page_words

MAX_MESSAGE = 4 << 20  # Of what the page says, files apart [bytes].
QUIET = 60.0  # How long a connection may say nothing [s].
CHUNK = 1 << 20

OWN_PAGE = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'"
    " data:; form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)
"""What the page itself may do: nothing from elsewhere, no script but its own."""
REFUSED_PAGE = (
    "default-src 'none'; style-src 'unsafe-inline'; form-action 'none'; base-uri 'none';"
    " frame-ancestors 'none'"
)
"""What the page for whoever has no key may do."""
RESULT_PAGE = (
    "sandbox allow-scripts allow-downloads allow-popups allow-popups-to-escape-sandbox;"
    " default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
    " blob:; media-src data: blob:; form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)
"""What pages of results may do, which show names out of files of strangers: nothing here."""
TEXT = "text/plain; charset=utf-8"
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".csv": "text/csv; charset=utf-8",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".pdf": "application/pdf",
} | dict.fromkeys((".sto", ".mot", ".toml", ".log", ".txt", ".xml", ".osim"), TEXT)
BINARY = "application/octet-stream"


@cache
def page_file(name: str) -> bytes:
    """File of the page; the style is that of reports, and what the page adds."""
    home = files("myomorph.show.app") / "templates"
    if name == "app.css":
        report = files("myomorph.lab.report") / "templates"
        parts = [report / "report.css", report / "answer.css", home / name]
        return b"\n".join(part.read_bytes() for part in parts)
    return (home / name).read_bytes()


class AppServer(ThreadingHTTPServer):
    """The page's server.

    Parameters
    ----------
    desk : what the page is about
    port : None for any free one
    """

    daemon_threads = True
    # On Windows another program could take a port that may be used again.
    allow_reuse_address = not WINDOWS

    def __init__(self, desk: Desk, port: int | None = None) -> None:
        self.desk = desk
        self.ended = threading.Event()
        super().__init__((LOOPBACK, port or 0), AppHandler)
        self.access = Access(port=self.server_address[1])

    def server_bind(self) -> None:
        """Bind without asking for this machine's name, which may take long."""
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        socketserver.TCPServer.server_bind(self)
        self.server_name = LOOPBACK
        self.server_port = self.server_address[1]

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: a browser that goes away is no error."""


class AppHandler(BaseHTTPRequestHandler):
    """Answers one connection."""

    protocol_version = "HTTP/1.1"
    server_version = "Myomorph"
    sys_version = ""
    timeout = QUIET
    server: AppServer

    def do_GET(self) -> None:
        """Send the page, its state, a list of folders, or a file of results."""
        self._answer(self._get)

    def do_POST(self) -> None:
        """Take what the page wants."""
        self._answer(self._post)

    def do_PUT(self) -> None:
        """Take a file."""
        self._answer(self._put)

    def _answer(self, act: Callable[[], None]) -> None:
        try:
            refusal = self._refusal()
            if refusal:
                self.close_connection = True
                self._send_refusal(refusal)
                return
            act()
        except ConnectionError:
            self.close_connection = True
        except Exception as error:
            self.close_connection = True
            failure = failure_of(error)
            known = isinstance(error, MyomorphError | OSError)
            status = HTTPStatus.BAD_REQUEST if known else HTTPStatus.INTERNAL_SERVER_ERROR
            self._send_json({"error": in_page_words(failure.text)}, status)

    def _refusal(self) -> str:
        headers = self.headers
        if len(headers.get_all("Host", [])) != 1:
            return "a request must name one host"
        return self.server.access.refusal(
            self.command, self.path, headers["Host"], headers.get("Origin")
        )

    @property
    def _parts(self) -> tuple[str, Mapping[str, list[str]]]:
        """Path below the token, and the query."""
        address = urlsplit(self.path)
        _, _, rest = address.path.lstrip("/").partition("/")
        return unquote(rest), parse_qs(address.query, keep_blank_values=True)

    def _get(self) -> None:
        path, query = self._parts
        if path in ("", "app.css", "app.js"):
            name = path or "app.html"
            self._send(page_file(name), KINDS[Path(name).suffix], OWN_PAGE)
        elif path == "state":
            self._send_json(self.server.desk.state())
        elif path == "folders":
            self._send_json(listed_folders((query.get("path") or [""])[0]))
        elif path.startswith("results/"):
            self._send_file(inside(self.server.desk.results, path.removeprefix("results/")))
        else:
            self._send_json({"error": f"there is no '{path}' here"}, HTTPStatus.NOT_FOUND)

    def _post(self) -> None:
        path, _ = self._parts
        said = self._message()
        desk = self.server.desk
        acts: dict[str, Callable[[], object]] = {
            "drop": lambda: desk.begin_drop(*_files_of(said)),
            "look": lambda: self._look(said),
            "compute": lambda: desk.compute(said),
            "cancel": desk.cancel,
            "again": desk.start_over,
            "change": desk.change,
            "show": lambda: show_folder(desk.results),
            "quit": self.server.ended.set,
        }
        if path not in acts:
            self._send_json({"error": f"there is no '{path}' here"}, HTTPStatus.NOT_FOUND)
            return
        acts[path]()
        self._send_json(desk.state())

    def _look(self, said: Mapping[str, Any]) -> None:
        path = str(said.get("path") or "")
        if path:
            self.server.desk.look_at(path)
        else:
            self.server.desk.look_at_drop()

    def _put(self) -> None:
        path, query = self._parts
        if path != "drop":
            raise BadData(f"there is no '{path}' here")
        relative = (query.get("path") or [""])[0]
        self.server.desk.receive(relative, self.rfile, self._length())  # type: ignore[arg-type]
        self._send_json({})

    def _length(self) -> int:
        text = self.headers.get("Content-Length", "")
        if not text.isdigit() or self.headers.get("Transfer-Encoding"):
            raise BadData("a message must state its length")
        return int(text)

    def _message(self) -> dict[str, Any]:
        length = self._length()
        if length > MAX_MESSAGE:
            raise BadData(f"a message of {length} bytes is too long")
        try:
            said = json.loads(self.rfile.read(length) or b"{}")
        except (ValueError, RecursionError):
            raise BadData("a message is not JSON: reload the page") from None
        if not isinstance(said, dict):
            raise BadData("a message is not a table: reload the page")
        return said

    def _send_json(self, values: Mapping[str, Any], status: HTTPStatus = HTTPStatus.OK) -> None:
        self._send(json.dumps(values).encode(), KINDS[".json"], OWN_PAGE, status)

    def _send_refusal(self, refusal: str) -> None:
        """Refuse whoever opens an address with a page, and programs with a message."""
        if self.command == "GET" and "text/html" in self.headers.get("Accept", ""):
            page = page_file("refused.html").replace(b"{reason}", escape(refusal).encode())
            self._send(page, KINDS[".html"], REFUSED_PAGE, HTTPStatus.FORBIDDEN)
        else:
            self._send_json({"error": refusal}, HTTPStatus.FORBIDDEN)

    def _send(
        self, body: bytes, kind: str, policy: str, status: HTTPStatus = HTTPStatus.OK
    ) -> None:
        self._send_head(kind, len(body), policy, status)
        self.wfile.write(body)

    def _send_file(self, path: Path) -> None:
        kind = KINDS.get(path.suffix.lower(), BINARY)
        with path.open("rb") as stream:
            self._send_head(kind, path.stat().st_size, RESULT_PAGE, HTTPStatus.OK)
            while piece := stream.read(CHUNK):
                self.wfile.write(piece)

    def _send_head(self, kind: str, length: int, policy: str, status: HTTPStatus) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(length))
        self.send_header("Content-Security-Policy", policy)
        self.send_header("X-Content-Type-Options", "nosniff")
        # Links of a report to papers do not take the token along.
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("Cache-Control", "no-store")
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing: addresses hold the token."""


def _files_of(said: Mapping[str, Any]) -> tuple[list[str], list[int]]:
    """Paths and sizes of files that will come [bytes]."""
    given = said.get("files")
    if not isinstance(given, list):
        raise BadData("nothing was dropped that holds a recording")
    try:
        return [str(entry["path"]) for entry in given], [int(entry["size"]) for entry in given]
    except (KeyError, TypeError, ValueError):
        raise BadData("the list of files is damaged: drop them again") from None


def listed_folders(text: str) -> dict[str, Any]:
    """Folders in a folder, by name; without one, folders to begin with.

    Parameters
    ----------
    text : path of the folder, "" for none
    """
    if not text:
        places = [{"name": str(path), "path": str(path)} for path in dict.fromkeys(roots())]
        return {"path": "", "parent": "", "folders": places}
    folder = Path(typed_path(text))
    names = subfolders(folder)
    return {
        "path": str(folder),
        "parent": str(folder.parent) if folder.parent != folder else "",
        "folders": [{"name": name, "path": str(folder / name)} for name in names],
    }


def show_folder(folder: Path) -> None:
    """Open a folder in the file manager; that there is none stops nothing."""
    if sys.platform == "win32":
        os.startfile(folder)
        return
    program = "open" if sys.platform == "darwin" else "xdg-open"
    try:
        subprocess.Popen(
            [program, str(folder)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
    except OSError as error:
        raise BadData(
            f"{folder}: this computer has no program to show it ({error.strerror or error})"
        ) from None
