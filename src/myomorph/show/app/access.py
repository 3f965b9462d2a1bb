"""Who may speak to the page's server: this machine's browser, by an address that nobody guesses."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field

LOOPBACK = "127.0.0.1"  # Nobody else in the network reaches it.
NAMES = (LOOPBACK, "localhost")
TOKEN_BYTES = 24
ONLY_READS = ("GET", "HEAD")
ASK = "open the address that 'myomorph app' printed"


@dataclass(frozen=True, kw_only=True)
class Access:
    """What requests must have.

    Attributes
    ----------
    port : of the server
    token : first part of every path
    """

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES), repr=False)

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://{LOOPBACK}:{self.port}/{self.token}/"

    @property
    def hosts(self) -> tuple[str, ...]:
        """Names under which a browser of this machine calls the server."""
        return tuple(f"{name}:{self.port}" for name in NAMES)

    def refusal(self, method: str, path: str, host: str, origin: str | None) -> str:
        """Say why a request is refused, "" where it is not.

        A page of the internet whose name leads to this machine sends its own name as host, and one
        that sends a request here from elsewhere its own origin.

        Parameters
        ----------
        method : of HTTP
        path : asked for, which begins with the token
        host, origin : headers, "" and None where they are missing
        """
        if host.lower() not in self.hosts:
            return f"this page is for this machine only: {ASK}"
        if not secrets.compare_digest(first_part(path).encode(), self.token.encode()):
            return f"this address does not have the key of the page: {ASK}"
        if origin is None:
            return "" if method in ONLY_READS else "a change must come from the page itself"
        if origin.lower() not in {f"http://{name}" for name in self.hosts}:
            return "a change must come from the page itself"
        return ""


def first_part(path: str) -> str:
    """First part of a path, without slashes."""
    return path.lstrip("/").partition("/")[0].partition("?")[0]
