"""Who may speak to the page's server."""

from __future__ import annotations

import pytest

from myomorph.show.app.access import Access

ACCESS = Access(port=8123, token="secret")
HOST = "127.0.0.1:8123"


def test_the_address_is_this_machine_with_a_key_that_nobody_guesses():
    made = [Access(port=80) for _ in range(3)]
    assert len({access.token for access in made}) == 3
    assert all(len(access.token) >= 32 for access in made)
    assert made[0].address == f"http://127.0.0.1:80/{made[0].token}/"
    assert made[0].token not in repr(made[0])


@pytest.mark.parametrize("host", [HOST, "localhost:8123", "LOCALHOST:8123"])
@pytest.mark.parametrize("path", ["/secret", "/secret/", "/secret/state?a=1", "/secret?x"])
def test_the_page_itself_is_let_in(host, path):
    assert ACCESS.refusal("GET", path, host, None) == ""
    assert ACCESS.refusal("POST", path, host, f"http://{host}") == ""


@pytest.mark.parametrize(
    "host", ["evil.example:8123", "127.0.0.1", "127.0.0.1:9000", "", "127.0.0.1:8123.evil.example"]
)
def test_a_name_that_leads_here_from_elsewhere_is_refused(host):
    """A page of the internet whose name is made to lead to this machine (DNS rebinding)."""
    assert "for this machine only" in ACCESS.refusal("GET", "/secret/", host, None)


@pytest.mark.parametrize("path", ["/", "", "/secre", "/secrets/", "/Secret/", "//x/secret", "/é"])
def test_without_the_key_nothing_is_shown(path):
    assert "the key of the page" in ACCESS.refusal("GET", path, HOST, None)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1:8123", "http://127.0.0.1:9000", ""]
)
@pytest.mark.parametrize("method", ["GET", "POST", "PUT"])
def test_another_page_may_not_speak_here(method, origin):
    """Nor a page of results, whose origin is null."""
    assert ACCESS.refusal(method, "/secret/", HOST, origin)


def test_a_change_without_an_origin_is_refused():
    assert ACCESS.refusal("POST", "/secret/", HOST, None)
    assert ACCESS.refusal("PUT", "/secret/", HOST, None)
