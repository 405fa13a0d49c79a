"""The page by keyboard, on a phone and for screen readers: a panel whose hub says what the test says, in Chromium.

Without a browser, nothing is checked here; `test_panel_page` checks the structure of the page.
"""

import asyncio
import contextlib
import json
import math
import re
import socket
import threading
from types import SimpleNamespace

import pytest

from guidance.clock import MonotonicClock
from guidance.log import metadata_of, scan
from guidance.log.broadcast import FoundFlight
from guidance.log.entries import CYCLE, Item
from guidance.viz.panel.access import Access
from guidance.viz.panel.hub import Hub, News
from guidance.viz.panel.server import PanelServer

pytestmark = pytest.mark.slow

BEGUN = 400
"""Cycles of the record before those of a test: both players are where they are known."""

PHONE = {"width": 390, "height": 844}
STATUS = {
    "accepted": True,
    "order": "status",
    "after_capture": "hold",
    "refused_orders": {},
    "to_do": [],
}


class StagedBus:
    """A bus that delivers what the test gives it, and notes the orders."""

    endpoint = "tcp/127.0.0.1:1"
    reason = "no daemon yet"

    def __init__(self):
        self.waiting = []
        self.ordered = []

    def news(self):
        return [self.waiting.pop(0) for _ in range(len(self.waiting))]

    def order(self, name, order, by, team=""):
        self.ordered.append(order)
        return [{"accepted": True, "order": order, "name": name}]

    def note_operator(self, name):
        pass

    def forget(self, name):
        pass

    def close(self):
        pass


@pytest.fixture
def stage(record):
    """A panel in a thread; `tell` gives it cycles of a record, with another state if one is named."""
    bus = StagedBus()
    clock = MonotonicClock()
    hub = Hub([bus], clock)
    listening = socket.create_server(("127.0.0.1", 0))
    urls = []
    access = Access("127.0.0.1", listening.getsockname()[1], None, clock, urls.append)
    server = PanelServer(hub, access, look=False, records=None, tiles="")
    loop = asyncio.new_event_loop()
    ended = asyncio.Event()
    begun = threading.Event()

    async def serve():
        async with server.serving(listening):
            begun.set()
            await ended.wait()

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()))
    thread.start()
    begun.wait()
    cycles = [json.loads(item.data) for item in scan(record) if item.topic == CYCLE.topic]

    def begin(name="uav1"):
        bus.waiting.append(News(name, clock.now_s(), FoundFlight(name, metadata_of(record), ())))
        bus.waiting += [
            News(name, clock.now_s(), Item(0.0, CYCLE.topic, "json", json.dumps(cycle).encode()))
            for cycle in cycles[:BEGUN]
        ]

    def tell(number, state, name="uav1", **status):
        cycle = {**cycles[BEGUN + number], "state": state}
        words = {"state": state, **STATUS, **status}
        data = json.dumps(cycle).encode()
        bus.waiting += [
            News(name, clock.now_s(), Item(0.0, CYCLE.topic, "json", data)),
            News(name, clock.now_s(), words),
        ]

    staged = SimpleNamespace(bus=bus, begin=begin, tell=tell, cycles=cycles, server=server)
    staged.url = lambda: urls[-1].split()[1]
    yield staged
    loop.call_soon_threadsafe(ended.set)
    thread.join()
    loop.close()
    listening.close()


def opened(browser, stage, size=None):
    page = browser.new_page()
    page.set_viewport_size(size or {"width": 1024, "height": 768})
    page.goto(stage.url())
    page.locator("#banner", has_text="no daemon yet").wait_for()
    return page


def test_before_a_daemon_exists_no_order_looks_usable(browser, stage):
    if browser is None:
        return
    page = opened(browser, stage)
    assert page.locator("#buttons button:visible").count() == 4
    assert page.locator("#buttons button:visible:enabled").count() == 0
    assert not page.locator("[data-order=hold-all]").is_visible()
    assert "No daemon yet" in page.locator("[data-order=land]").get_attribute("title")


def test_typed_text_orders_nothing_and_a_key_held_for_a_second_does(browser, stage):
    if browser is None:
        return
    page = opened(browser, stage)
    stage.begin()
    stage.tell(50, "holding")
    page.locator("[data-order=land]:enabled").wait_for()
    page.keyboard.type("Hello Will, hold all. LLLL hhhh", delay=30)
    page.keyboard.down("h")
    page.keyboard.down("x")  # another key: it is text
    page.wait_for_timeout(1200)
    page.keyboard.up("x")
    page.keyboard.up("h")
    page.locator("#answer", has_text="not given. Keep it pressed for one second").wait_for()
    assert stage.bus.ordered == []
    page.keyboard.down("h")
    page.wait_for_timeout(1200)
    page.keyboard.up("h")
    page.locator("#answer", has_text="HOLD: accepted").wait_for()
    assert stage.bus.ordered == ["hold"]
    page.locator("#by").focus()
    page.keyboard.down("l")
    page.wait_for_timeout(1200)
    page.keyboard.up("l")
    assert stage.bus.ordered == ["hold"]


def test_on_a_phone_every_order_is_on_the_screen_and_under_the_finger(browser, stage):
    if browser is None:
        return
    page = opened(browser, stage, PHONE)
    team = {"team": "north", "vehicles": ["uav1", "uav2"]}
    for name in ("uav1", "uav2"):
        stage.begin(name)
        stage.tell(50, "holding", name, **team)
    page.locator("[data-order=engage]").wait_for()
    page.locator("[data-order=hold-all]:visible").wait_for()
    hit = """button => {
      const { left, top, width, height } = button.getBoundingClientRect();
      const places = [[0.5, 0.5], [0.1, 0.1], [0.9, 0.9]].map(([x, y]) => [left + x * width, top + y * height]);
      return places.every(([x, y]) => document.elementFromPoint(x, y)?.closest("button") === button);
    }"""
    for order in ("engage", "hold-all", "hold", "land", "return", "abort"):
        button = page.locator(f"[data-order={order}]")
        for scroll in (0, 300, 10_000):
            page.evaluate("y => window.scrollTo(0, y)", scroll)
            assert button.evaluate(hit), (order, scroll)
    # What is scrolled into view is above the bar
    for element in ("#whom button", "#events", "canvas[data-chart=age]"):
        page.evaluate("() => window.scrollTo(0, 0)")
        page.locator(element).last.evaluate("one => one.scrollIntoView({ block: 'end' })")
        bottom = page.locator(element).last.bounding_box()
        bar = page.locator("#buttons").bounding_box()
        assert bottom["y"] + bottom["height"] <= bar["y"] + 1.0


def test_live_regions_change_with_the_state_only(browser, stage):
    if browser is None:
        return
    page = opened(browser, stage)
    stage.begin()
    stage.tell(100, "holding")
    page.locator("#state", has_text=re.compile("holding", re.IGNORECASE)).wait_for()
    page.evaluate("""() => {
      window.changes = [];
      const watch = new MutationObserver((changes) => window.changes.push(...changes.map((one) => one.target.id)));
      for (const region of document.querySelectorAll("[aria-live], [role=alert]")) {
        watch.observe(region, { childList: true, subtree: true, characterData: true, attributes: true });
      }
    }""")
    for number in range(101, 141):
        stage.tell(number, "holding")
        drawn = (
            f"() => panel.daemon.snapshot.now_s >= {stage.cycles[BEGUN + number]['now_s'] - 1e-3}"
        )
        page.wait_for_function(drawn)
    page.wait_for_timeout(100)
    assert page.evaluate("() => window.changes") == []
    stage.tell(141, "landing")
    page.locator("#state", has_text=re.compile("landing", re.IGNORECASE)).wait_for()
    assert set(page.evaluate("() => window.changes")) == {"state"}
    # Of silence too: the seconds count beside the live region
    page.locator("#banner", has_text="Silent for 3 s").wait_for()
    page.evaluate("() => { window.changes = []; }")
    page.locator("#banner", has_text="Silent for 4 s").wait_for()
    assert page.evaluate("() => window.changes") == []


def test_pictures_and_buttons_have_names_and_keys_move_the_pictures(browser, stage):
    if browser is None:
        return
    page = opened(browser, stage)
    stage.begin()
    stage.tell(100, "holding")
    page.locator("[data-order=engage]").wait_for()
    page.locator("canvas[data-chart=age][aria-label]").wait_for()
    assert page.locator("h1").all_inner_texts() == ["Guidance: operator's page"]
    unnamed = """() => [...document.querySelectorAll("canvas, button, input, nav, section")]
      .filter((one) => !one.ariaLabel && !/\\w/.test(one.textContent) && !one.labels?.length)
      .map((one) => one.id || one.outerHTML)"""
    assert page.evaluate(unnamed) == ["play"]  # hidden, of a replay
    for name in ("Zoom in", "Zoom out"):
        assert page.get_by_role("button", name=name, exact=True).is_visible()
    page.locator("#plan").focus()
    seen = "() => { const { centre, scale } = panel.pictures.plan; return [...centre, scale]; }"
    east_m, north_m, scale = page.evaluate(seen)
    for key in ("ArrowRight", "ArrowUp", "ArrowUp"):
        page.keyboard.press(key)
    moved = page.evaluate(seen)
    assert moved == [pytest.approx(east_m + 40 / scale), pytest.approx(north_m + 80 / scale), scale]
    page.keyboard.press("+")
    assert page.evaluate(seen)[2] > scale
    page.keyboard.press("0")
    assert math.dist(page.evaluate(seen), (east_m, north_m, scale)) < 0.1
    page.locator("#show-space").click()
    turn = page.evaluate("() => panel.pictures.space.turn")
    page.locator("#space").focus()
    page.keyboard.press("ArrowLeft")
    assert page.evaluate("() => panel.pictures.space.turn") != turn
    assert stage.bus.ordered == []


def test_on_station_with_a_hold_after_capture_the_page_does_not_say_at_the_disc(browser, stage):
    if browser is None:
        return
    page = opened(browser, stage)
    stage.begin()
    stage.tell(100, "on station")
    page.locator(
        "#next", has_text="It reached the stand-off disc and hovers where it did"
    ).wait_for()


def test_the_fault_of_one_vehicle_is_named_and_the_others_can_be_chosen(browser, stage):
    if browser is None:
        return
    page = opened(browser, stage)
    for name in ("uav1", "uav2"):
        stage.begin(name)
        stage.tell(100, "holding", name)
    page.locator("#daemons button", has_text="uav2 · holding").wait_for()
    stage.tell(101, "holding", "uav1", battery=math.nan)
    page.locator("#daemons button", has_text="uav1 · – · ■ bad data").wait_for()
    page.locator(
        "#banner", has_text="uav1: a cycle or event of its flight cannot be read"
    ).wait_for()
    page.locator("#daemons button", has_text="uav2").click()
    stage.tell(102, "holding", "uav2")
    page.locator("[data-order=hold]:enabled").wait_for()
    page.locator("[data-order=hold]").click()
    page.locator("#answer", has_text="uav2 · HOLD: accepted").wait_for()
    assert browser.said == []


def test_behind_a_proxy_that_changes_the_address_a_banner_says_why_nothing_comes(browser, stage):
    if browser is None:
        return
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as front:
        threading.Thread(target=relay_with_host_of, args=(front, stage), daemon=True).start()
        own, _, query = stage.url().partition("/?")
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{front.getsockname()[1]}/?{query}")
        page.locator(
            "#banner", has_text="it was opened by another address than the panel's"
        ).wait_for()
        assert page.locator("#buttons button:visible:enabled").count() == 0
        assert own


def relay_with_host_of(front, stage):
    """A reverse proxy without settings: it names the panel's own host to the panel."""
    host = stage.url().split("/")[2]
    behind = host.split(":")
    with contextlib.suppress(OSError):
        while True:
            outer, _ = front.accept()
            threading.Thread(target=pass_on, args=(outer, behind, host), daemon=True).start()


def pass_on(outer, behind, host):
    with contextlib.suppress(OSError), outer:
        head = b""
        while b"\r\n\r\n" not in head:
            head += outer.recv(65536) or b"\r\n\r\n"
        head = re.sub(rb"Host: [^\r]*", b"Host: " + host.encode(), head)
        head = re.sub(rb"Connection: keep-alive", b"Connection: close", head)
        with socket.create_connection((behind[0], int(behind[1]))) as inner:
            inner.sendall(head)
            while piece := inner.recv(65536):
                outer.sendall(piece)
