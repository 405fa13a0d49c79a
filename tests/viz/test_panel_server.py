"""The panel's server: access, orders, and pages that read slowly."""

import asyncio
import contextlib
import json
import re
import socket
import ssl
from types import SimpleNamespace

import pytest
from aiohttp import ClientSession, CookieJar, WSMsgType, WSServerHandshakeError, web
from aiohttp.test_utils import TestServer
from multidict import CIMultiDict
from yarl import URL

from guidance.cli.program import app
from guidance.clock import VirtualClock
from guidance.errors import ConfigError, GuidanceError, LinkError
from guidance.viz.panel import access as accesses
from guidance.viz.panel import server as servers
from guidance.viz.panel.access import (
    LOGIN_DEADLINE_S,
    PASSWORD_INTERVAL_S,
    Access,
    map_of,
    remote_access,
)
from guidance.viz.panel.server import MAX_QUEUED, PanelServer

PATHS = ("", "page/main.js", "page/index.html", "alive", "live", "order", "records", "nowhere")
PASSWORD = "correct horse battery"


class StubHub:
    """A hub with a new message each time; keeps the orders."""

    def __init__(self):
        self.ordered = []
        self.vouched = []
        self.number = 0
        self.size = 1

    def receive(self):
        self.number += 1

    def message(self, *, whole=False):
        return json.dumps({"whole": whole, "number": self.number, "filling": "x" * self.size})

    def note_operator(self, daemon):
        self.vouched.append(daemon)

    def order(self, daemon, order, by, *, team=False):
        if daemon == "gone":
            raise LinkError("gone: no answer within 4 s")
        self.ordered.append((daemon, order, by, team))
        return [{"accepted": False, "order": order, "reason": "on the ground: order start first"}]


@pytest.fixture
async def opened(monkeypatch):
    """Serve a panel on a free port of loopback until the test ends."""
    monkeypatch.setattr(servers, "SEND_INTERVAL_S", 0.01)
    async with contextlib.AsyncExitStack() as closing:

        async def open_one(*, look=False, security=None, tiles=""):
            listening = closing.enter_context(socket.create_server(("127.0.0.1", 0)))
            port = listening.getsockname()[1]
            hub = StubHub()
            clock = VirtualClock()
            printed = []
            access = Access("127.0.0.1", port, security, clock, printed.append)
            server = PanelServer(hub, access, look=look, records=None, tiles=str(tiles))
            await closing.enter_async_context(server.serving(listening))
            origin = f"{access.scheme}://127.0.0.1:{port}"
            client = ClientSession(f"{origin}{access.path}", cookie_jar=CookieJar(unsafe=True))
            await closing.enter_async_context(client)
            return SimpleNamespace(
                hub=hub,
                access=access,
                client=client,
                clock=clock,
                printed=printed,
                port=port,
                door=f"{origin}/",
                origin={"Origin": origin},
            )

        yield open_one


async def let_in(panel):
    async with panel.client.get(panel.door, params={"token": panel.access.token}) as answer:
        assert answer.status == 200
        assert answer.url.path == panel.access.path
    return panel


async def test_without_the_token_nothing_is_served_or_ordered(opened):
    panel = await opened()
    for path in PATHS:
        for send in (panel.client.get, panel.client.post):
            async with send(path, headers=panel.origin) as answer:
                assert answer.status == 403, path
                assert await answer.text() == ""
    for token in ("", "wrong", panel.access.token[:-1], panel.access.token + "x", "ü"):
        async with panel.client.get(panel.door, params={"token": token}) as answer:
            assert answer.status == 403
            assert "Not let in" in await answer.text()
            assert not answer.cookies
    async with panel.client.get("", headers={"Accept": "text/html,*/*"}) as answer:
        assert answer.status == 403
        assert "Not let in" in await answer.text()  # a person is told what to do
    assert panel.hub.ordered == []


async def test_the_token_gives_a_cookie_for_a_secret_path_hidden_from_scripts(opened):
    panel = await opened()
    enter = panel.client.get(
        panel.door, params={"token": panel.access.token}, allow_redirects=False
    )
    async with enter as answer:
        assert not answer.cookies
        ticket = URL(panel.door).join(URL(answer.headers["Location"]))
    async with panel.client.get(ticket, allow_redirects=False) as answer:
        (cookie,) = answer.cookies.values()
        # Without a path, the browser takes the folder of the address that it asked for. Servers on other ports of the
        # host get the cookie only below this path, which they do not know.
        assert (cookie["httponly"], cookie["samesite"], cookie["path"]) == (True, "Lax", "")
        assert ticket.parent.path + "/" == panel.access.path
        assert len(panel.access.path) > 20
        assert cookie.value not in panel.access.path
    async with ClientSession() as stranger, stranger.get(ticket) as answer:
        assert answer.status == 403  # it worked once
    async with panel.client.get("") as answer:
        policy = answer.headers["Content-Security-Policy"]
        assert policy.startswith(
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:;"
        )
        assert "http" not in policy
        assert answer.headers["Referrer-Policy"] == "same-origin"
        assert answer.headers["Cache-Control"] == "no-store"
    async with panel.client.get("page/main.js") as answer:
        assert answer.status == 200
        assert answer.content_type.endswith("/javascript")
    for name in ("nothing.js", "..%2Fserver.py", "%2Fetc%2Fpasswd", "panel", "x.py"):
        async with panel.client.get(f"page/{name}") as answer:
            assert answer.status == 404, name


async def test_any_bytes_of_a_request_are_refused_in_order(opened):
    panel = await opened()
    for head in (
        b"GET /x/ HTTP/1.1\r\nHost: %b\r\nCookie: guidance-panel-%d=\xff\xfe",
        b"GET /?token=\xff HTTP/1.1\r\nHost: %b\r\nX-Port: %d",
        b"GET /?token=%%ff%%c3%%28 HTTP/1.1\r\nHost: %b\r\nX-Port: %d",
    ):
        reader, writer = await asyncio.open_connection("127.0.0.1", panel.port)
        host = b"127.0.0.1:%d" % panel.port
        writer.write(head % (host, panel.port) + b"\r\nConnection: close\r\n\r\n")
        status = (await reader.readline()).split()[1]
        assert status in {b"400", b"403"}, head
        writer.close()


async def test_a_person_at_another_address_than_the_panels_is_told_so(opened):
    panel = await opened()
    for path in ("", "x/y/"):
        headers = {"Host": "proxy.example", "Accept": "text/html"}
        async with panel.client.get(f"{panel.door}{path}", headers=headers) as answer:
            assert answer.status == 421
            text = await answer.text()
            assert "Not the panel's address" in text
            style = re.search(r'href="([^"]*door\.css)"', text)[1]
        headers["Accept"] = "text/css"
        async with panel.client.get(answer.url.join(URL(style)), headers=headers) as answer:
            assert answer.status == 200
    await let_in(panel)
    origin = panel.origin["Origin"]
    for said, here in ((origin, True), ("http://proxy.example", False), ("", False)):
        async with panel.client.get("alive", params={"origin": said}) as answer:
            assert (await answer.json())["here"] is here


async def test_below_a_path_of_a_reverse_proxy_the_password_opens_the_page(opened, certificate):
    """All addresses are relative, and the cookie gets the path that the browser asked for."""
    files = (certificate / "cert.pem", certificate / "key.pem", certificate / "password")
    panel = await opened(security=remote_access("0.0.0.0", *files))
    trusting = ssl.create_default_context(cafile=certificate / "cert.pem")

    async def passed_on(request):
        headers = {
            name: request.headers[name] for name in ("Cookie", "Origin") if name in request.headers
        }
        headers["Host"] = request.host
        url = f"{panel.door}{request.match_info['rest']}"
        sent = stranger.request(
            request.method,
            URL(url).with_query(request.query),
            data=await request.read(),
            headers=headers | {"Content-Type": request.content_type},
            ssl=trusting,
            allow_redirects=False,
        )
        async with sent as answer:
            kept = [
                (name, value)
                for name, value in answer.headers.items()
                if name in {"Location", "Set-Cookie"}
            ]
            return web.Response(
                status=answer.status, body=await answer.read(), headers=CIMultiDict(kept)
            )

    proxy = web.Application()
    proxy.router.add_route("*", "/ops/{rest:.*}", passed_on)
    async with ClientSession() as stranger, TestServer(proxy) as server:
        jar = CookieJar(unsafe=True, treat_as_secure_origin=server.make_url("/").origin())
        async with ClientSession(cookie_jar=jar) as browser:
            door = server.make_url("/ops/")
            async with browser.get(door) as answer:
                text = await answer.text()
            action = re.search(r'action="([^"]*)"', text)[1]
            style = re.search(r'href="([^"]*door\.css)"', text)[1]
            async with browser.get(door.join(URL(style))) as answer:
                assert answer.status == 200
            origin = {"Origin": f"https://{door.host}:{door.port}"}
            login = browser.post(
                door.join(URL(action)), data={"password": PASSWORD}, headers=origin
            )
            async with login as answer:
                assert answer.status == 200
                assert answer.url.path == f"/ops{panel.access.path}"
                assert "page/main.js" in await answer.text()
            async with browser.get(answer.url.join(URL("alive"))) as answer:
                assert answer.status == 200


async def test_requests_from_other_sites_and_for_other_hosts_are_refused(opened):
    panel = await let_in(await opened())
    for origin in (
        {},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "https://127.0.0.1"},
    ):
        async with panel.client.post(
            "order", json={"daemon": "uav1", "order": "hold", "by": ""}, headers=origin
        ) as answer:
            assert answer.status == 403
        with pytest.raises(WSServerHandshakeError) as refused:
            await panel.client.ws_connect("live", headers=origin)
        assert refused.value.status == 403
    async with panel.client.get("alive", headers={"Host": "evil.example:80"}) as answer:
        assert answer.status == 421
    assert panel.hub.ordered == []


async def test_an_order_reaches_the_daemon_with_its_author_and_returns_the_reason(opened):
    panel = await let_in(await opened())
    order = {"daemon": "uav1@x", "order": "engage", "by": "Ana" + 90 * "a"}
    async with panel.client.post("order", json=order, headers=panel.origin) as answer:
        assert (await answer.json())[0]["reason"] == "on the ground: order start first"
    assert panel.hub.ordered == [("uav1@x", "engage", f"panel, Ana{21 * 'a'} at 127.0.0.1", False)]
    async with panel.client.post(
        "order", json={**order, "daemon": "gone"}, headers=panel.origin
    ) as answer:
        assert (await answer.json())[0]["reason"] == "gone: no answer within 4 s"
    for body in (
        b"",
        b"[]",
        b"{}",
        b'{"daemon": 1}',
        b"[[[[",
        b"[" * 4000,
        b"\xff",
        b"x" * 100_000,
    ):
        async with panel.client.post("order", data=body, headers=panel.origin) as answer:
            assert answer.status in {400, 413}


async def test_a_panel_with_look_takes_no_order(opened):
    panel = await let_in(await opened(look=True))
    async with panel.client.get("alive") as answer:
        about = {"look": True, "records": False, "tiles": "", "here": False}
        assert await answer.json() == about
    order = {"daemon": "uav1", "order": "hold", "by": ""}
    async with panel.client.post("order", json=order, headers=panel.origin) as answer:
        assert answer.status == 403
        assert (await answer.json())[0]["reason"] == "this panel takes no orders (--look)"
    assert panel.hub.ordered == []


@pytest.mark.parametrize(("look", "vouched"), [(False, ["uav1@x"]), (True, [])])
async def test_a_page_sends_the_operators_sign_of_life_unless_it_takes_no_orders(
    opened, look, vouched
):
    panel = await let_in(await opened(look=look))
    socket = await panel.client.ws_connect("live", headers=panel.origin)
    await socket.send_bytes(b"uav1@x")  # pages send text only
    await socket.send_str("uav1@x")
    await socket.close()  # then it has been read
    assert panel.hub.vouched == vouched


async def test_the_tile_server_is_the_only_other_host_for_images(opened):
    panel = await let_in(await opened(tiles="https://tiles.example:8443/{z}/{x}/{y}.png"))
    async with panel.client.get("alive") as answer:
        assert (
            "img-src 'self' data: https://tiles.example:8443; connect"
            in answer.headers["Content-Security-Policy"]
        )
    for url in (
        "tiles.example/{z}/{x}/{y}",
        "https://a;b/{z}/{x}/{y}",
        "https://a/{z}/{x}",
        "ftp://a/{z}{x}{y}",
    ):
        with pytest.raises(ConfigError, match="must be a folder, or like https"):
            map_of(url)


async def test_map_tiles_come_from_the_local_folder_by_default(opened, tmp_path, monkeypatch):
    (tmp_path / "3" / "4").mkdir(parents=True)
    (tmp_path / "3" / "4" / "2.png").write_bytes(b"a tile")
    (tmp_path / "secret.png").write_bytes(b"no tile")
    panel = await let_in(await opened(tiles=tmp_path))
    async with panel.client.get("alive") as answer:
        assert (await answer.json())["tiles"] == "tiles/{z}/{x}/{y}.png"
        assert "img-src 'self' data:; connect" in answer.headers["Content-Security-Policy"]
    for path, status in (
        ("3/4/2", 200),
        ("3/4/1", 404),
        ("3/4/..%2F..%2Fsecret", 404),
        ("a/b/c", 404),
    ):
        async with panel.client.get(f"tiles/{path}.png") as answer:
            assert answer.status == status
    elsewhere = tmp_path.parent / "elsewhere.png"
    elsewhere.write_bytes(b"no tile")
    (tmp_path / "3" / "4" / "5.png").symlink_to(elsewhere)
    (tmp_path / "3" / "5").symlink_to(tmp_path.parent)
    (tmp_path / "3" / "4" / "6.png").symlink_to(tmp_path / "3" / "4" / "2.png")
    for path, status in (("3/4/5", 404), ("3/4/6", 200)):
        async with panel.client.get(f"tiles/{path}.png") as answer:
            assert answer.status == status, path
    monkeypatch.chdir(tmp_path)
    other = await let_in(await opened(tiles="tiles"))
    async with other.client.get("alive") as answer:
        assert (await answer.json())["tiles"] == ""


def test_the_environment_names_the_map_of_every_panel(monkeypatch):
    """The pages beside `fly` and `run` are child processes, which inherit it."""
    monkeypatch.setenv("GUIDANCE_TILES", "no-folder.example")
    with pytest.raises(ConfigError, match=r"--tiles no-folder\.example: must be a folder"):
        app(["panel", "--port", "0"], standalone_mode=False)


async def test_twenty_pages_get_a_snapshot_and_then_the_same_changes(opened):
    panel = await let_in(await opened())
    sockets = [await panel.client.ws_connect("live", headers=panel.origin) for _ in range(20)]
    firsts = [await socket.receive_json() for socket in sockets]
    assert all(first["whole"] for first in firsts)
    from_number = max(first["number"] for first in firsts) + 1
    received = [await message_from(socket, from_number) for socket in sockets]
    assert received == [received[0]] * 20
    assert not received[0]["whole"]
    for one in sockets:
        await one.close()


async def message_from(socket, number):
    while (message := await socket.receive_json(timeout=10.0))["number"] < number:
        pass
    return message


async def test_a_page_that_reads_nothing_is_closed_and_delays_no_other(opened):
    panel = await let_in(await opened())
    panel.hub.size = 500_000  # socket buffers hold only a few of these
    hanging = await panel.client.ws_connect("live", headers=panel.origin, max_msg_size=0)
    first = await hanging.receive_json()
    hanging._response.connection.transport.pause_reading()
    other = await panel.client.ws_connect("live", headers=panel.origin, max_msg_size=0)
    await message_from(other, first["number"] + 2 * MAX_QUEUED)
    panel.hub.size = 1
    await message_from(other, first["number"] + 4 * MAX_QUEUED)
    hanging._response.connection.transport.resume_reading()
    while (await hanging.receive(timeout=10.0)).type is WSMsgType.TEXT:  # what the buffers held
        pass
    assert hanging.close_code == 1013
    await other.close()


async def test_hosts_other_than_loopback_need_tls_and_a_password(opened, certificate):
    files = (certificate / "cert.pem", certificate / "key.pem", certificate / "password")
    panel = await opened(security=remote_access("0.0.0.0", *files))
    trusting = ssl.create_default_context(cafile=certificate / "cert.pem")

    async def post(password, origin):
        form = {"password": password}
        return await panel.client.post(
            f"{panel.door}login", data=form, headers=origin, ssl=trusting, allow_redirects=False
        )

    async with panel.client.get(
        panel.door, params={"token": panel.access.token}, ssl=trusting
    ) as answer:
        assert "Password" in await answer.text()  # no token opens it
        assert not answer.cookies
    for password, origin in (("wrong", panel.origin), ("", panel.origin), (PASSWORD, {})):
        answer = await post(password, origin)
        assert answer.status == 403
        assert ('role="alert">That was not' in await answer.text()) is bool(origin)
        assert not answer.cookies
        panel.clock.sleep_until(panel.clock.now_s() + PASSWORD_INTERVAL_S)
    answer = await post(PASSWORD, panel.origin)
    assert answer.status == 303
    ticket = URL(panel.door).join(URL(answer.headers["Location"]))
    panel.client.cookie_jar.clear()
    async with panel.client.get(ticket, ssl=trusting, allow_redirects=False) as answer:
        (cookie,) = answer.cookies.values()
        assert cookie["secure"]
    async with panel.client.get("alive", ssl=trusting) as answer:
        assert answer.status == 200


async def test_wrong_passwords_delay_the_answers_to_their_address_and_the_right_one_gets_in(
    opened, certificate, monkeypatch
):
    files = (certificate / "cert.pem", certificate / "key.pem", certificate / "password")
    panel = await opened(security=remote_access("0.0.0.0", *files))
    trusting = ssl.create_default_context(cafile=certificate / "cert.pem")
    pauses_s = []

    async def paused(seconds):
        pauses_s.append(seconds)

    panel.access.pause = paused

    async def post(password):
        form = {"password": password}
        url = f"{panel.door}login"
        async with panel.client.post(
            url, data=form, headers=panel.origin, ssl=trusting, allow_redirects=False
        ) as one:
            return one.status

    assert await asyncio.gather(*(post("wrong") for _ in range(30))) == 30 * [403]
    # Right or wrong: who closes the connection early learns nothing
    assert pauses_s == 29 * [PASSWORD_INTERVAL_S]
    assert await post(PASSWORD) == 303
    assert len(pauses_s) == 30
    monkeypatch.setattr(web.Request, "remote", "192.0.2.7")
    assert await post(PASSWORD) == 303
    monkeypatch.undo()
    panel.clock.sleep_until(PASSWORD_INTERVAL_S)
    assert await post(PASSWORD) == 303
    assert len(pauses_s) == 30


def test_the_password_throttle_counts_ipv6_by_network_and_forgets_the_oldest():
    clock = VirtualClock()
    throttle = Access("127.0.0.1", 8088, None, clock, print)
    throttle.note_wrong("2001:db8::1")
    assert throttle.is_late("2001:db8::2%eth0")
    assert not throttle.is_late("2001:db8:0:1::1")
    for number in range(2000):
        throttle.note_wrong(f"10.0.{number // 256}.{number % 256}")
    assert throttle.is_late("10.0.7.0")
    assert not throttle.is_late("10.0.0.0")  # the table is bounded
    clock.sleep_until(PASSWORD_INTERVAL_S)
    assert not throttle.is_late("10.0.7.0")


async def status_of(url):
    """What a browser that has no cookie is answered there."""
    async with ClientSession() as stranger, stranger.get(url, allow_redirects=False) as answer:
        return answer.status


async def test_the_url_is_printed_once_and_works_once_so_no_log_keeps_a_login(opened):
    panel = await opened()
    (printed,) = panel.printed
    url = printed.split()[1]
    assert await status_of(url) == 303
    assert await status_of(url) == 403
    assert panel.printed == [printed]


async def test_only_an_open_page_shows_a_url_for_another_browser_and_each_replaces_the_last(opened):
    panel = await opened()
    assert await status_of(f"{panel.door[:-1]}{panel.access.path}invite") == 403
    await let_in(panel)
    urls = []
    for _ in range(2):
        async with panel.client.get("invite") as answer:
            urls.append((await answer.text()).split()[-1])
    assert [await status_of(url) for url in (*urls, urls[1])] == [403, 303, 403]
    assert len(panel.printed) == 1


async def test_a_connection_that_does_not_log_in_is_closed_at_the_deadline(opened):
    panel = await let_in(await opened())
    page = await panel.client.ws_connect("live", headers=panel.origin)
    slow, writer = await asyncio.open_connection("127.0.0.1", panel.port)
    writer.write(b"GET / HTTP/1.1\r\n")
    await writer.drain()
    async with panel.client.get("alive"):
        pass  # the slow one was accepted before
    panel.clock.sleep_until(LOGIN_DEADLINE_S)
    assert await asyncio.wait_for(slow.read(), 10.0) == b""
    number = (await page.receive_json())["number"]
    await message_from(page, number + 3)  # the page stays connected
    await page.close()
    writer.close()


async def test_idle_connections_are_capped_and_keep_no_page_out(opened, monkeypatch, certificate):
    monkeypatch.setattr(accesses, "MAX_OPEN_CONNECTIONS", 8)
    files = (certificate / "cert.pem", certificate / "key.pem", certificate / "password")
    # Over TLS, an idle one is in the handshake
    for security in (
        None,
        remote_access("0.0.0.0", *files),
    ):
        panel = await opened(security=security)
        idle = [await asyncio.open_connection("127.0.0.1", panel.port) for _ in range(30)]
        tls = ssl.create_default_context(cafile=certificate / "cert.pem") if security else True
        async with panel.client.get(panel.door, ssl=tls) as answer:
            assert answer.status in {200, 403}
        assert await asyncio.wait_for(idle[0][0].read(), 10.0) == b""
        for _, writer in idle:
            writer.close()


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (
            ["--host", "192.0.2.1"],
            2,
            "--host 192.0.2.1: anyone who reaches the page can command the vehicle.",
        ),
        (
            ["--tiles", "tiles.example"],
            2,
            "--tiles tiles.example: must be a folder, or like https://",
        ),
        (["--port", "IN_USE"], 3, "choose another, or port 0 for a free one"),
    ],
)
def test_bad_addresses_are_reported_before_the_panel_starts(options, code, words):
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        pytest.raises(GuidanceError, match=re.escape(words)) as refused,
    ):
        app(
            [
                "panel",
                *(
                    str(taken.getsockname()[1]) if option == "IN_USE" else option
                    for option in options
                ),
            ],
            standalone_mode=False,
        )
    assert refused.value.exit_code == code


def test_missing_or_weak_tls_and_password_files_are_named(certificate, tmp_path):
    cert, key, password = (certificate / name for name in ("cert.pem", "key.pem", "password"))
    for host in ("127.0.0.1", "localhost", "::1", "127.0.0.9"):
        assert remote_access(host, None, None, None) is None
    for host, given in (
        ("0.0.0.0", (None, None, None)),
        ("192.168.1.7", (cert, key, None)),
        ("127.0.0.1", (cert, None, None)),
    ):
        with pytest.raises(
            ConfigError, match="--certificate, --key and --password-file, all three"
        ):
            remote_access(host, *given)
    with pytest.raises(ConfigError, match="cannot be used"):
        remote_access("0.0.0.0", password, key, password)
    weak = tmp_path / "weak"
    weak.write_text("short\n")
    with pytest.raises(ConfigError, match="others may read it; chmod 600"):
        remote_access("0.0.0.0", cert, key, weak)
    weak.chmod(0o600)
    with pytest.raises(ConfigError, match="has 5 characters; give at least 12"):
        remote_access("0.0.0.0", cert, key, weak)
    with pytest.raises(ConfigError, match="cannot be read"):
        remote_access("0.0.0.0", cert, key, tmp_path / "nothing")
