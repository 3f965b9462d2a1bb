"""A page on this machine is for whoever has its address: no other page, host or program."""

from __future__ import annotations

import urllib.error
import urllib.request

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from myomorph.lab.viewer.page_guard import COOKIE, PageGuard
from myomorph.lab.viewer.web_page import Page, escaped

PORT = 8080
HERE = f"127.0.0.1:{PORT}"


@pytest.fixture(scope="module")
def page():
    pytest.importorskip("viser")
    opened = Page(None, "test")
    yield opened
    opened.close()


@pytest.mark.parametrize(
    ("query", "headers", "reason"),
    [
        (True, {"Host": HERE}, ""),
        (True, {"Host": f"localhost:{PORT}", "Origin": f"http://localhost:{PORT}"}, ""),
        (False, {"Host": HERE}, "token"),
        (True, {"Host": f"evil.example:{PORT}"}, "host"),
        (True, {"Host": "127.0.0.1"}, "host"),
        (True, {"Host": HERE, "Origin": "http://evil.example"}, "page"),
        (True, {"Host": HERE, "Origin": "null"}, "page"),
        (True, {"Host": HERE, "Origin": f"http://127.0.0.1:{PORT + 1}"}, "page"),
        (True, {}, "host"),
    ],
)
def test_who_is_let_in(query, headers, reason):
    guard = PageGuard()
    path = f"/?token={guard.token}" if query else "/?token=x"
    assert reason in guard.refusal(path, headers)
    assert bool(reason) == bool(guard.refusal(path, headers))


def test_a_cookie_of_the_same_port_stands_for_the_token():
    guard = PageGuard()
    cookie = f"a=b; {COOKIE}_{PORT}={guard.token}"
    assert guard.refusal("/", {"Host": HERE, "Cookie": cookie}) == ""
    assert guard.refusal("/", {"Host": "127.0.0.1:8081", "Cookie": cookie}) != ""
    assert guard.refusal("/", {"Host": HERE, "Cookie": f"{COOKIE}_{PORT}=x"}) != ""


def test_the_page_needs_its_token(page):
    with urllib.request.urlopen(page.address, timeout=10) as answer:
        assert b"<html" in answer.read()
        assert "HttpOnly; SameSite=Strict" in answer.headers["Set-Cookie"]
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(f"http://127.0.0.1:{page.port}/", timeout=10)


def test_the_socket_takes_no_other_page(page):
    address = page.address.replace("http:", "ws:")
    own = f"http://127.0.0.1:{page.port}"
    with connect(address, origin=own, subprotocols=["viser-v1.1.1"]) as opened:
        assert opened.protocol is not None
    with pytest.raises(InvalidStatus):
        connect(address, origin="http://evil.example")
    with pytest.raises(InvalidStatus):
        connect(f"ws://127.0.0.1:{page.port}/", origin=own)


def test_names_are_no_markup():
    written = escaped("<iframe src='javascript:x'> [a](b) `c` | d\ne")
    assert "<" not in written
    assert "\n" not in written
    assert written.count("\\") == written.count("`") + 5
