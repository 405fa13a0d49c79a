"""The panel's doors: who is let in, from where, what is answered, and what a page that hangs costs the others."""

import json
import re
import socket
import ssl
from types import SimpleNamespace

import pytest
from aiohttp import ClientSession, CookieJar, WSMsgType, WSServerHandshakeError, web
from aiohttp.test_utils import unused_port

from guidance.cli import app
from guidance.errors import ConfigError, GuidanceError, LinkError
from guidance.viz.panel import server as servers
from guidance.viz.panel.access import Access, origin_of, secured
from guidance.viz.panel.server import MOST_UNTAKEN, PanelServer

PATHS = ("/page/main.js", "/page/index.html", "/alive", "/live", "/order", "/nowhere")


class StubHub:
    """Something new at every look, and orders kept."""

    def __init__(self):
        self.ordered, self.vouched, self.number, self.size = [], [], 0, 1

    def listen(self):
        self.number += 1

    def settle(self):
        self.settled = self.number

    def message(self, *, whole=False):
        return json.dumps({"whole": whole, "number": self.number, "filling": "x" * self.size})

    def vouch(self, daemon):
        self.vouched.append(daemon)

    def order(self, daemon, order, by):
        if daemon == "gone":
            raise LinkError("gone: no answer within 4 s")
        self.ordered.append((daemon, order, by))
        return {"accepted": False, "order": order, "reason": "on the ground: order start first"}


@pytest.fixture
async def opened(monkeypatch):
    """Serve a panel on a free port of loopback; everything ends with the test."""
    monkeypatch.setattr(servers, "TOLD_EVERY_S", 0.01)
    monkeypatch.setattr(servers, "WRONG_PASSWORD_S", 0.01)
    closing = []

    async def open_one(*, look=False, security=None, tiles=""):
        port, hub = unused_port(), StubHub()
        access = Access(port, security)
        runner = web.AppRunner(PanelServer(hub, access, look=look, tiles=tiles).application(), shutdown_timeout=0.2)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", port, ssl_context=access.tls).start()
        client = ClientSession(f"{access.scheme}://127.0.0.1:{port}", cookie_jar=CookieJar(unsafe=True))
        closing.append((client, runner))
        return SimpleNamespace(
            hub=hub, access=access, client=client, origin={"Origin": f"{access.scheme}://127.0.0.1:{port}"}
        )

    yield open_one
    for client, runner in closing:
        await client.close()
        await runner.cleanup()


async def let_in(panel):
    async with panel.client.get("/", params={"token": panel.access.token}) as answer:
        assert answer.status == 200
    return panel


async def test_without_the_token_nothing_is_served_and_nothing_ordered(opened):
    panel = await opened()
    for path in PATHS:
        for send in (panel.client.get, panel.client.post):
            async with send(path, headers=panel.origin) as answer:
                assert answer.status == 403, path
                assert await answer.text() == ""
    for token in ("", "wrong", panel.access.token[:-1], panel.access.token + "x", "ü"):
        async with panel.client.get("/", params={"token": token}) as answer:
            assert answer.status == 403
            assert "Not let in" in await answer.text()
            assert not answer.cookies
    assert panel.hub.ordered == []


async def test_the_token_is_exchanged_for_a_cookie_that_scripts_and_other_sites_never_have(opened):
    panel = await opened()
    async with panel.client.get("/", params={"token": panel.access.token}) as answer:
        (cookie,) = answer.cookies.values()
        assert (cookie["httponly"], cookie["samesite"], cookie["path"]) == (True, "Strict", "/")
        assert cookie.value != panel.access.token
        policy = answer.headers["Content-Security-Policy"]
        assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:;")
        assert "http" not in policy
        assert answer.headers["Referrer-Policy"] == "same-origin"
        assert answer.headers["Cache-Control"] == "no-store"
    async with panel.client.get("/page/main.js") as answer:
        assert answer.status == 200
        assert answer.content_type == "text/javascript"
    for name in ("nothing.js", "..%2Fserver.py", "%2Fetc%2Fpasswd", "panel", "x.py"):
        async with panel.client.get(f"/page/{name}") as answer:
            assert answer.status == 404, name


async def test_pages_of_other_sites_and_names_that_lead_here_are_turned_away(opened):
    panel = await let_in(await opened())
    for origin in ({}, {"Origin": "http://evil.example"}, {"Origin": "null"}, {"Origin": "https://127.0.0.1"}):
        async with panel.client.post(
            "/order", json={"daemon": "uav1", "order": "hold", "by": ""}, headers=origin
        ) as answer:
            assert answer.status == 403
        with pytest.raises(WSServerHandshakeError) as refused:
            await panel.client.ws_connect("/live", headers=origin)
        assert refused.value.status == 403
    async with panel.client.get("/alive", headers={"Host": "evil.example:80"}) as answer:
        assert answer.status == 421
    assert panel.hub.ordered == []


async def test_an_order_goes_to_the_daemon_with_who_gave_it_and_its_reason_comes_back(opened):
    panel = await let_in(await opened())
    order = {"daemon": "uav1@x", "order": "engage", "by": "Ana" + 90 * "a"}
    async with panel.client.post("/order", json=order, headers=panel.origin) as answer:
        assert (await answer.json())["reason"] == "on the ground: order start first"
    assert panel.hub.ordered == [("uav1@x", "engage", f"panel, Ana{21 * 'a'} at 127.0.0.1")]
    async with panel.client.post("/order", json={**order, "daemon": "gone"}, headers=panel.origin) as answer:
        assert await answer.json() == {"accepted": False, "order": "engage", "reason": "gone: no answer within 4 s"}
    for body in (b"", b"[]", b"{}", b'{"daemon": 1}', b"x" * 100_000):
        async with panel.client.post("/order", data=body, headers=panel.origin) as answer:
            assert answer.status in {400, 413}


async def test_a_panel_that_only_looks_takes_no_order(opened):
    panel = await let_in(await opened(look=True))
    async with panel.client.get("/alive") as answer:
        assert await answer.json() == {"look": True, "records": False, "tiles": ""}
    order = {"daemon": "uav1", "order": "hold", "by": ""}
    async with panel.client.post("/order", json=order, headers=panel.origin) as answer:
        assert answer.status == 403
        assert (await answer.json())["reason"] == "this panel only looks on (--look)"
    assert panel.hub.ordered == []


@pytest.mark.parametrize(("look", "vouched"), [(False, ["uav1@x"]), (True, [])])
async def test_a_page_gives_an_operators_sign_of_life_unless_it_only_looks(opened, look, vouched):
    panel = await let_in(await opened(look=look))
    socket = await panel.client.ws_connect("/live", headers=panel.origin)
    await socket.send_bytes(b"uav1@x")  # no page says that
    await socket.send_str("uav1@x")
    await socket.close()  # by then it was read
    assert panel.hub.vouched == vouched


async def test_a_tile_server_is_the_one_host_that_pictures_may_come_from(opened):
    panel = await let_in(await opened(tiles="https://tiles.example:8443/{z}/{x}/{y}.png"))
    async with panel.client.get("/alive") as answer:
        assert "img-src 'self' data: https://tiles.example:8443; connect" in answer.headers["Content-Security-Policy"]
    for url in ("tiles.example/{z}/{x}/{y}", "https://a;b/{z}/{x}/{y}", "https://a/{z}/{x}", "ftp://a/{z}{x}{y}"):
        with pytest.raises(ConfigError, match="must be as https"):
            origin_of(url)


async def test_twenty_pages_are_told_everything_and_then_the_same(opened):
    panel = await let_in(await opened())
    sockets = [await panel.client.ws_connect("/live", headers=panel.origin) for _ in range(20)]
    firsts = [await socket.receive_json() for socket in sockets]
    assert all(first["whole"] for first in firsts)
    from_number = max(first["number"] for first in firsts) + 1
    heard = [await told_at(socket, from_number) for socket in sockets]
    assert heard == [heard[0]] * 20
    assert not heard[0]["whole"]
    for one in sockets:
        await one.close()


async def told_at(socket, number):
    while (said := await socket.receive_json(timeout=10.0))["number"] < number:
        pass
    return said


async def test_a_page_that_takes_nothing_is_let_go_and_holds_up_no_other(opened):
    panel = await let_in(await opened())
    panel.hub.size = 500_000  # of so many, no buffer between us holds more than a few
    hanging = await panel.client.ws_connect("/live", headers=panel.origin, max_msg_size=0)
    first = await hanging.receive_json()
    hanging._response.connection.transport.pause_reading()
    other = await panel.client.ws_connect("/live", headers=panel.origin, max_msg_size=0)
    await told_at(other, first["number"] + 2 * MOST_UNTAKEN)
    panel.hub.size = 1
    await told_at(other, first["number"] + 4 * MOST_UNTAKEN)
    hanging._response.connection.transport.resume_reading()
    while (await hanging.receive(timeout=10.0)).type is WSMsgType.TEXT:  # what was under way
        pass
    assert hanging.close_code == 1013
    await other.close()


async def test_elsewhere_than_on_loopback_it_is_tls_and_a_password(opened, certificate):
    files = (certificate / "cert.pem", certificate / "key.pem", certificate / "password")
    panel = await opened(security=secured("0.0.0.0", *files))
    trusting = ssl.create_default_context(cafile=certificate / "cert.pem")

    async def post(password, origin):
        form = {"password": password}
        return await panel.client.post("/login", data=form, headers=origin, ssl=trusting, allow_redirects=False)

    async with panel.client.get("/", params={"token": panel.access.token}, ssl=trusting) as answer:
        assert answer.status == 403 or "Password" in await answer.text()  # the token opens nothing here
        assert not answer.cookies
    for password, origin in (("wrong", panel.origin), ("", panel.origin), ("correct horse battery", {})):
        answer = await post(password, origin)
        assert answer.status == 403
        assert ('role="alert">That was not' in await answer.text()) is bool(origin)
        assert not answer.cookies
    answer = await post("correct horse battery", panel.origin)
    assert answer.status == 303
    (cookie,) = answer.cookies.values()
    assert cookie["secure"]
    async with panel.client.get("/alive", ssl=trusting) as answer:
        assert answer.status == 200


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--port", "70000"], 2, "--port 70000: allowed is 0 (pick a free one) to 65535"),
        (["--host", "192.0.2.1"], 2, "--host 192.0.2.1: who reaches the page commands the vehicle."),
        (["--tiles", "tiles.example"], 2, "--tiles tiles.example: must be as https://"),
        (["--port", "IN_USE"], 3, "choose another, or port 0 for a free one"),
    ],
)
def test_what_cannot_be_served_is_said_before_anything_is_opened(options, code, words):
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        pytest.raises(GuidanceError, match=re.escape(words)) as refused,
    ):
        app(
            ["panel", *(str(taken.getsockname()[1]) if one == "IN_USE" else one for one in options)],
            standalone_mode=False,
        )
    assert refused.value.exit_code == code


def test_what_is_missing_for_that_is_said(certificate, tmp_path):
    cert, key, password = (certificate / name for name in ("cert.pem", "key.pem", "password"))
    for host in ("127.0.0.1", "localhost", "::1", "127.0.0.9"):
        assert secured(host, None, None, None) is None
    for host, given in (
        ("0.0.0.0", (None, None, None)),
        ("192.168.1.7", (cert, key, None)),
        ("127.0.0.1", (cert, None, None)),
    ):
        with pytest.raises(ConfigError, match="--certificate, --key and --password-file, all three"):
            secured(host, *given)
    with pytest.raises(ConfigError, match="cannot be used"):
        secured("0.0.0.0", password, key, password)
    weak = tmp_path / "weak"
    weak.write_text("short\n")
    with pytest.raises(ConfigError, match="others can read it; chmod 600"):
        secured("0.0.0.0", cert, key, weak)
    weak.chmod(0o600)
    with pytest.raises(ConfigError, match="has 5 characters; give at least 12"):
        secured("0.0.0.0", cert, key, weak)
    with pytest.raises(ConfigError, match="cannot be read"):
        secured("0.0.0.0", cert, key, tmp_path / "nothing")
