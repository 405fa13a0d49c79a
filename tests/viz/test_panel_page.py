"""The panel in a real browser: a whole flight by its buttons, and lost connections.

Without a browser, only the structure of the page is checked.
"""

import contextlib
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

import guidance.viz.panel
from guidance.config import parse_document
from guidance.session.open.mock import MockOptions
from guidance.session.recorded_flight import fly_recorded
from guidance.sim.scenario_file import load_any
from guidance.sim.teams import TeamScenario
from sitl_mock.child import running
from tests.harness.flights import LID_M, LOW_M, low_team
from tests.harness.vehicle import FENCED, mocked, write_file

PAGE = Path(guidance.viz.panel.__file__).parent / "page"
GUIDANCE = Path(sys.executable).parent / "guidance"
QUICK = {
    **FENCED,
    "COM_SPOOLUP_TIME": 0.2,
    "MPC_TKO_RAMP_T": 0.5,
    "MPC_TKO_SPEED": 4.0,
    "MPC_LAND_SPEED": 1.5,
    "COM_DISARM_LAND": 0.3,
}
LIMIT_MS = 90_000
NEWS = """seconds => {
  const { feed, daemon: { scene, status, snapshot } } = panel;
  panel.chosen = "grown";
  const begun_s = feed.daemons.get("grown")?.snapshot.now_s ?? 0;
  const plain = { key: "grown", name: "grown", endpoint: "", silent_s: 0, contact: "ok", scene, status };
  const history = { rows: [], columns: feed.daemons.values().next().value.columns };
  for (let news = 1; news <= 10 * seconds; news++) {
    const now_s = begun_s + 0.1 * news;
    const said = { ...plain, snapshot: { ...snapshot, now_s }, events: [{ now_s, event: "tick", detail: `${news}` }] };
    if (!begun_s && news === 1) said.history = history;
    feed.take({ whole: false, buses: [], daemons: [said] });
    if (news % 50 === 0) panel.draw();
  }
}"""


@pytest.fixture
def parts(tmp_path):
    """A mock, and functions that start a daemon for it and a panel; all end with the test."""
    with contextlib.ExitStack() as closing:

        def start(*command, to=signal.SIGKILL):
            child = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
            closing.callback(child.stdout.close)
            closing.callback(child.wait)
            closing.callback(child.send_signal, to)
            closing.callback(child.stdin.close)
            return child

        vehicles = [
            mocked("uav1", parameters=QUICK),
            mocked("evader", "rover", start_ned_m=[14.0, 6.0, 0.0]),
        ]
        vehicle, control = write_file(
            tmp_path,
            closing.enter_context(running(vehicles, over=["zenoh"])),
            game={"standoff_height_m": 2.5},
            limits={"floor_m": 2.0},
            flight={"takeoff_height_m": 3.0, "operator_timeout_s": 8.0},
            log={"level": "error"},
        )

        def daemon(*options):
            return start(GUIDANCE, "run", vehicle, *options)

        def panel(*options):
            child = start(
                GUIDANCE,
                "panel",
                "--endpoint",
                control,
                "--port",
                "0",
                "--records",
                tmp_path,
                *options,
            )
            return child, child.stdout.readline().split()[1]

        yield SimpleNamespace(control=control, daemon=daemon, panel=panel)


def hold_down(page, order):
    """Press a button for its required time."""
    button = page.locator(f"[data-order={order}]")
    button.scroll_into_view_if_needed()
    box = button.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.wait_for_timeout(1100)
    page.mouse.up()


def hold_key(page, key):
    page.keyboard.down(key)
    page.wait_for_timeout(1100)
    page.keyboard.up(key)


def answered(page, words):
    page.locator("#answer", has_text=words).wait_for()


def stands(page, state):
    page.locator("#state", has_text=re.compile(f"^{state}$", re.IGNORECASE)).wait_for()


def test_the_page_is_whole_without_a_browser():
    texts = (PAGE / "texts.js").read_text("utf-8")
    scripts = {path.name: path.read_text("utf-8") for path in PAGE.glob("*.js")}
    for name, script in scripts.items():
        for imported, source in re.findall(r"import \{([^}]*)\} from \"\./([\w.]+)\"", script):
            for one in (word.strip() for word in imported.split(",") if word.strip()):
                assert re.search(
                    rf"export (async )?(class|function|const) {one}\b|export const \[.*\b{one}\b",
                    scripts[source],
                )
        for key in re.findall(r"TEXTS\.(\w+)", script):
            assert re.search(rf"\b{key}:", texts), f"{name}: TEXTS.{key}"
    for path in PAGE.iterdir():
        assert "://" not in path.read_text("utf-8"), f"{path.name} names a host"
    html = (PAGE / "index.html").read_text("utf-8")
    assert all((PAGE / name).is_file() for name in re.findall(r'"page/([\w.]+)"', html))
    ids = re.findall(r' id="([\w-]+)"', html)
    assert len(ids) == len(set(ids))


def low_guard_in(folder):
    """Write the scenario teams_guard, flown low, which shortens take-off."""
    text = load_any("teams_guard")[0].read_text("utf-8")
    text = re.sub(r", 12\.0\]", f", {LOW_M}]", text)
    text = text.replace("takeoff_height_m = 12.0", f"takeoff_height_m = {LOW_M}")
    path = folder / "low_guard.toml"
    path.write_text(text.replace("height_m = 8.0", f"height_m = {LID_M}"), "utf-8")
    return path


@pytest.mark.slow
def test_a_team_is_on_one_page_and_one_button_holds_all(browser, tmp_path):
    if browser is None:
        print("no chromium here: the page was checked for its structure only")
        return
    command = [GUIDANCE, "fly", low_guard_in(tmp_path), "--out", tmp_path / "guard"]
    with contextlib.ExitStack() as closing:
        flight = closing.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        closing.callback(flight.send_signal, signal.SIGINT)
        url = next(line.split()[1] for line in flight.stdout if line.startswith("panel"))
        page = browser.new_page()
        page.set_viewport_size({"width": 390, "height": 844})
        page.goto(url)
        vehicles = page.locator("#daemons button", has_text=re.compile("engaged → rover[12]$"))
        vehicles.nth(2).wait_for()
        assert page.locator("#promises .lamp", has_text="m promised").count() == 2
        page.locator("#whom button", has_text="ALL 3").click()
        assert (
            page.locator("#next", has_text="uav1, uav2, uav3: Flies to the stand-off disc").count()
            == 1
        )
        page.locator("[data-order=hold-all]").click()
        answered(page, "ALL 3 · HOLD: accepted")
        page.locator("#daemons button", has_text="holding").nth(2).wait_for()
        hold_down(page, "engage")
        answered(page, "ALL 3 · ENGAGE: accepted")
        vehicles.nth(2).wait_for()
        assert browser.said == []


@pytest.mark.slow
@pytest.mark.usefixtures("soon_up_and_down")
def test_the_replay_of_a_team_flight_shows_all_vehicles(browser, parts, tmp_path):
    if browser is None:
        print("no chromium here: the page was checked for its structure only")
        return
    document = low_team("teams_guard").model_dump(mode="json")
    document["pursuer"] = document["pursuer"][:2]
    document["evader"] = [{**document["evader"][0], "position_m": [30.0, 6.0]}]
    scenario = parse_document(TeamScenario, document, source="two")
    fly_recorded(scenario, tmp_path / "guard", MockOptions(fast=True))
    page = browser.new_page()
    page.goto(parts.panel()[1])
    page.goto(f"{page.url}replay?record=guard/uav2/record.mcap")
    page.locator("#slider").wait_for()
    page.locator("#moment").focus()
    page.keyboard.press("End")
    page.locator("#daemons button", has_text=re.compile("landed → rover1$")).nth(1).wait_for()
    players = "() => panel.pictures.plan.team.map(one => [one.name, one.snapshot.against, one.rows.length > 100])"
    assert page.evaluate(players) == [
        ["uav1", "rover1", True],
        ["uav2", "rover1", True],
    ]
    assert page.evaluate("() => panel.pictures.plan.daemon.name") == "uav2"
    page.locator("#daemons button", has_text="uav1").click()
    page.locator("#events", has_text="team assignment: uav1 → rover1").wait_for()
    assert inked(page, "plan") > 0.002
    page.locator("#show-space").click()
    assert inked(page, "space") > 0.002
    assert browser.said == []


@pytest.mark.slow
def test_a_whole_flight_by_buttons_and_lost_connections_are_shown(parts, browser, certificate):
    """One long test, because browser, mock, daemon and panel take long to start."""
    if browser is None:
        print("no chromium here: the page was checked for its structure only")
        return
    panel, url = parts.panel()
    page = browser.new_page()
    page.goto(url)
    assert "token" not in page.url
    page.locator("#banner", has_text=parts.control).wait_for()
    daemon = parts.daemon()
    a_wrong_token_opens_nothing(browser, url)  # while the daemon starts
    several_pages_see_it(browser, page, next_address(page))
    assert not page.locator("#banner").is_visible()
    from_start_to_landed(browser, page)
    a_page_out_of_view_is_no_operator(page)
    ten_minutes_leave_nothing_behind(browser, page)
    assert browser.said == []
    assert {re.match(r"\w+://[^/]+/", one)[0].replace("ws:", "http:") for one in browser.asked} == {
        url.partition("?")[0]
    }
    daemon.kill()
    daemon.wait()
    page.locator("#records-button").click()  # the records load meanwhile
    page.locator("#banner", has_text="NO CONTACT WITH THE DAEMON").wait_for()
    assert "old" in page.locator("body").get_attribute("class")
    daemon = parts.daemon("--panel")  # it has another token
    its_record_is_listed_and_replayed(browser, page)
    page.locator("#banner").wait_for(state="hidden")
    page.locator("[data-order=start]").wait_for()
    a_password_opens_it_over_tls(browser, parts, certificate)
    its_own_panel_ends_with_it(browser, daemon)
    a_panel_that_hangs_or_dies_is_said_to(panel, page)


def next_address(page):
    """Read the address for another browser, as the open page shows it."""
    with page.expect_popup() as shown:
        page.locator("#invite").click()
    words = shown.value.locator("body").inner_text()
    shown.value.close()
    return words.split()[-1]


def a_wrong_token_opens_nothing(browser, url):
    stranger = browser.new_page()
    for one in (url, url[:-1] + ("a" if url[-1] != "a" else "b")):  # used, wrong
        assert stranger.goto(one).status == 403
        assert "Not let in" in stranger.content()
    stranger.close()
    browser.said.clear()  # the browser logs the 403


def several_pages_see_it(browser, page, url):
    # Small pages that share one process, to save processor time; twenty are those of `test_panel_server`.
    with browser.browser.new_context(viewport={"width": 160, "height": 120}) as others:
        others.new_page().goto(url)
        others.pages[0].evaluate(
            "() => { for (let number = 0; number < 4; number++) window.open(location.href); }"
        )
        while len(others.pages) < 5:
            page.wait_for_timeout(20)
        for one in (page, *others.pages):
            stands(one, "ready")


def from_start_to_landed(browser, page):
    page.bring_to_front()
    page.locator("#by").fill("Ana")
    page.locator("#state").click()  # keys are orders outside text fields
    page.keyboard.type("Hello Will", delay=20)
    answered(page, "LAND: not given. Keep it pressed for one second")
    hold_key(page, "h")
    answered(page, "HOLD refused: there is no flight to end: the vehicle is not armed")
    page.locator("[data-order=start]").click()
    answered(page, "START: not given. Keep it pressed for one second")
    stands(page, "ready")
    hold_down(page, "start")
    answered(page, "START: accepted")
    other = browser.new_page()
    other.goto(page.url)
    page.bring_to_front()
    page.locator("[data-order=engage]").focus()
    page.keyboard.down("Enter")  # the same as a press
    page.wait_for_timeout(1100)
    page.keyboard.up("Enter")
    answered(page, "ENGAGE: accepted")
    page.locator("[data-name=reach]", has_text="yes, in ").wait_for()
    stands(page, "on station")
    stands(other, "on station")
    hold_key(page, "l")
    answered(page, "LAND: accepted")
    other.locator("#events", has_text="land by panel, Ana at 127.0.0.1: accepted").wait_for()
    page.locator("#show-space").click()
    assert inked(page, "space") > 0.002
    page.locator("#show-plan").click()
    assert min(inked(page, name) for name in ("plan", "profile")) > 0.002
    column = page.evaluate("() => panel.daemon.columns.indexOf('speed_m_s.flown')")
    # The charts show it
    assert page.evaluate(f"() => Math.max(...panel.daemon.rows.map(row => row[{column}]))") > 1.0
    stands(page, "landed")
    stands(other, "landed")
    page.locator("#buttons button:disabled").nth(3).wait_for()  # all are disabled
    assert "the flight is over" in page.locator("[data-order=hold]").get_attribute("title")
    other.close()


def a_page_out_of_view_is_no_operator(page):
    seen = page.locator("[data-name=operator]")
    seen.get_by_text(re.compile(r"^0\.\d s of 8 s$")).wait_for()
    page.evaluate(
        "() => { Object.defineProperty(document, 'visibilityState', {value: 'hidden', configurable: true}); }"
    )
    seen.get_by_text(re.compile(r"^[2-7]\.\d s of 8 s$")).wait_for()
    page.evaluate("() => { delete document.visibilityState; }")
    seen.get_by_text(re.compile(r"^0\.\d s of 8 s$")).wait_for()


def ten_minutes_leave_nothing_behind(browser, page):
    """Minutes of messages, as fast as possible. After four minutes, which fill the history, memory must not grow."""
    session = browser.new_cdp_session(page)
    session.send("Performance.enable")
    session.send("HeapProfiler.enable")

    def held(seconds):
        page.evaluate(NEWS, seconds)
        page.wait_for_timeout(100)  # pending frames
        session.send("HeapProfiler.collectGarbage")
        metrics = {
            one["name"]: one["value"] for one in session.send("Performance.getMetrics")["metrics"]
        }
        return (
            metrics["JSHeapUsedSize"] / 1e6,
            metrics["Nodes"],
            page.evaluate("() => panel.daemon.rows.length"),
        )

    held(250)
    # The smallest of three, because recent messages may not be collected yet.
    before, after = (min(held(60) for _ in range(3)) for _ in range(2))
    assert before[2] == after[2] <= 1201
    assert after[1] < before[1] + 50  # elements
    # MB; two thousand messages are more, and what leaks grows again
    if after[0] >= before[0] + 0.2:
        assert min(held(60) for _ in range(3))[0] < after[0] + 0.2
    page.evaluate(
        "() => { panel.feed.daemons.delete('grown'); panel.chosen = null; panel.draw(); }"
    )


def its_record_is_listed_and_replayed(browser, page):
    page.locator("dialog td", has_text="captured, ended landed").wait_for()
    with browser.expect_page() as opened:
        page.locator("dialog a", has_text="Replay").last.click()
    replay = opened.value
    replay.locator("#slider").wait_for()
    replay.locator("#moment").focus()
    replay.keyboard.press("End")
    stands(replay, "landed")
    assert not replay.locator("#buttons").is_visible()
    replay.close()
    page.keyboard.press("Escape")


def a_password_opens_it_over_tls(browser, parts, certificate):
    pair = "--certificate", certificate / "cert.pem", "--key", certificate / "key.pem"
    panel, url = parts.panel("--look", *pair, "--password-file", certificate / "password")
    with browser.browser.new_context(ignore_https_errors=True) as context:
        page = context.new_page()
        page.goto(url)
        page.locator("input").fill("not the password")
        page.locator("button").click()
        page.get_by_text("That was not the password").wait_for()
        page.wait_for_timeout(1_100.0)  # the panel makes this address wait for a second
        page.locator("input").fill("correct horse battery")
        page.locator("button").click()
        page.locator("#next", has_text="It waits for START").wait_for()
        assert page.locator("[data-order]").count() == 0
    panel.kill()


def its_own_panel_ends_with_it(browser, daemon):
    line = next(line for line in daemon.stdout if line.startswith("panel "))
    page = browser.new_page()
    page.goto(line.split()[1])
    stands(page, "ready")
    (panel,) = psutil.Process(daemon.pid).children()
    page.close()
    daemon.send_signal(signal.SIGTERM)
    assert daemon.wait(20.0) == 0
    assert not panel.is_running()


def a_panel_that_hangs_or_dies_is_said_to(panel, page):
    panel.send_signal(signal.SIGSTOP)
    page.locator("#banner", has_text="NO CONTACT WITH THE PANEL").wait_for()
    panel.send_signal(signal.SIGCONT)  # the daemon has ended in order, which is no emergency
    page.locator("#banner", has_text="NO CONTACT WITH THE PANEL").wait_for(state="hidden")
    panel.kill()
    panel.wait()
    page.locator("#banner", has_text="NO CONTACT WITH THE PANEL").wait_for()
    hold_key(page, "h")
    answered(page, "HOLD: no answer from the panel")


def inked(page, name):
    """Return the share of a canvas that is drawn on."""
    script = """name => {
      const canvas = document.getElementById(name);
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      let drawn = 0;
      for (let at = 3; at < data.length; at += 4) drawn += data[at] > 128;
      return (4 * drawn) / data.length;
    }"""
    return page.evaluate(script, name)
