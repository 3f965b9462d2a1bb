"""Who may open a page on this machine: whoever has its address with the token.

Other pages of a browser and other users of the machine reach the port too. A request must name this
machine as its host, come from the page itself where it states an origin, and bring the token: in
the address at first, in a cookie afterwards.
"""

from __future__ import annotations

import hmac
import http
import inspect
import re
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import parse_qs, urlsplit

from myomorph.core.model.errors import MyomorphError

HOSTS = ("localhost", "127.0.0.1", "[::1]")
COOKIE = "myomorph"
REFUSED = b"Open the address that the terminal shows, with its token.\n"


class PageGuard:
    """A token, and what it lets in.

    Attributes
    ----------
    token : that an address has to bring
    """

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(18)
        self.stands = False

    def address(self, port: int) -> str:
        """Return the address that opens the page."""
        return f"http://127.0.0.1:{port}/?token={self.token}"

    def refusal(self, path: str, headers: Mapping[str, str]) -> str:
        """Return why a request is refused, "" where it is let in.

        Parameters
        ----------
        path : that is requested, with what follows a question mark
        headers : of the request
        """
        host = headers.get("Host", "")
        name, _, port = host.rpartition(":")
        if name not in HOSTS or not port.isdigit():
            return "another host is named"
        origin = headers.get("Origin")
        if origin is not None and origin.lower() != f"http://{host}":
            return "another page asks"
        brought = (*parse_qs(urlsplit(path).query).get("token", ()), *_cookies(headers, port))
        fits = any(hmac.compare_digest(token.encode(), self.token.encode()) for token in brought)
        return "" if fits else "the token is missing"

    def start(self, serve: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap the function that starts a server: each request is looked at first."""

        def guarded(*positional: Any, process_request: Any = None, **named: Any) -> Any:
            async def look(connection: Any, request: Any) -> Any:
                if self.refusal(request.path, request.headers):
                    return connection.respond(http.HTTPStatus.FORBIDDEN, REFUSED.decode())
                answer = None
                if process_request is not None:
                    answer = process_request(connection, request)
                if inspect.isawaitable(answer):
                    answer = await answer
                if answer is not None:
                    port = request.headers["Host"].rpartition(":")[2]
                    kept = f"{COOKIE}_{port}={self.token}; HttpOnly; SameSite=Strict; Path=/"
                    answer.headers["Set-Cookie"] = kept
                    answer.headers["Referrer-Policy"] = "no-referrer"
                    # A page of another port is of the same site, so that cookies go along.
                    answer.headers["Content-Security-Policy"] = "frame-ancestors 'none'"
                return answer

            self.stands = True
            return serve(*positional, process_request=look, **named)

        return guarded

    @contextmanager
    def over_servers(self) -> Iterator[None]:
        """Guard each server that is started within the block.

        Raises
        ------
        MyomorphError : none was started in a way that can be guarded
        """
        import websockets.asyncio.server as server

        serve = server.serve
        server.serve = self.start(serve)  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            server.serve = serve  # type: ignore[misc]
        if not self.stands:
            raise MyomorphError(
                "this version of the package 'viser' starts its page in another way, without a"
                " guard: pip install 'viser<2'"
            )


def _cookies(headers: Mapping[str, str], port: str) -> list[str]:
    """List the tokens that a request's cookies bring for a port."""
    pattern = rf"(?:^|;\s*){COOKIE}_{port}=([\w-]+)"
    return re.findall(pattern, headers.get("Cookie", ""))
