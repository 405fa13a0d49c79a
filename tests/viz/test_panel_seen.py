"""The data of a page: snapshots, severity levels, and which messages contain what."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from guidance.clock import VirtualClock
from guidance.config import find
from guidance.errors import LinkError
from guidance.flight import State
from guidance.frames import Enu
from guidance.game import Ball, Game, StandOff, solve
from guidance.log import cycles_of, metadata_of, scan
from guidance.log.broadcast import FoundFlight
from guidance.log.entries import BEGUN, CYCLE, EVENT, FLIGHT_OVER, RELOADED, Item
from guidance.log.scene import isochron_at
from guidance.messages import Heartbeat
from guidance.session.flight_files import recorded_settings
from guidance.session.orders.replies import read_reply
from guidance.session.vehicle_file import load_vehicle
from guidance.viz.panel.hub import (
    FAULT_SHOWN_S,
    HISTORY_S,
    MAX_DAEMONS,
    MAX_EVENTS,
    Hub,
    News,
    Unreadable,
)
from guidance.viz.panel.snapshot import (
    HISTORY,
    Level,
    SnapshotFold,
    history_row,
    level_of,
    reach_of,
)


def folded(path, until=lambda row: False):
    """Read a record up to the first cycle that meets a condition."""
    fold = SnapshotFold(metadata_of(path), "test")
    for item in scan(path):
        entry = fold.take(item)
        if item.topic == CYCLE.topic and until(entry):
            break
    return fold


def beside(curve, place):
    """Return the distance of a point from a closed curve, m."""
    curve = np.array(curve)
    place = np.array(place[:2])
    begun = curve[:-1]
    along = np.diff(curve, axis=0)
    share = np.clip(((place - begun) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    return np.linalg.norm(begun + share[:, None] * along - place, axis=1).min()


def found(name, metadata, *heard):
    """Return the news of a daemon's flight."""
    return News(name, 100.0, FoundFlight(name, metadata, heard))


class StubBus:
    """A bus that delivers what the test gives it."""

    endpoint = "tcp/127.0.0.1:1"
    reason = ""

    def __init__(self):
        self.waiting = []
        self.ordered = []
        self.vouched = []
        self.forgotten = []

    def news(self):
        taken = self.waiting
        self.waiting = []
        return taken

    def order(self, name, order, by, team=""):
        self.ordered.append((name, order, by, team))
        return [{"accepted": True, "order": order, "name": name}]

    def note_operator(self, name):
        self.vouched.append(name)

    def forget(self, name):
        self.forgotten.append(name)

    def close(self):
        pass


@pytest.fixture(scope="module")
def cycles(record):
    """Return the recorded cycles, as they are broadcast."""
    return [item for item in scan(record) if item.topic == CYCLE.topic]


@pytest.fixture
def told(record):
    """A hub with one daemon, a function that adds news, and one that reads the messages for pages."""
    bus = StubBus()
    clock = VirtualClock(100.0)
    hub = Hub([bus], clock)

    def tell(*news):
        bus.waiting += news
        hub.receive()

    def read(*, whole=False):
        return json.loads(hub.message(whole=whole))

    tell(found("uav1", metadata_of(record)))
    return SimpleNamespace(hub=hub, bus=bus, clock=clock, tell=tell, read=read)


def test_a_snapshot_of_the_chase_equals_the_record(record):
    """Catches a value on the page that differs from the record."""
    fold = folded(record, lambda row: row.state is State.ENGAGED and row.certificate is not None)
    row = next(
        row
        for row in cycles_of(record)
        if row.state is State.ENGAGED and row.certificate is not None
    )
    seen = fold.snapshot()
    scene = fold.scene
    json.dumps([seen, scene], allow_nan=False)
    assert seen["state_words"] == "engaged"
    assert (seen["state"], seen["mode"], seen["armed"], seen["streaming"]) == (
        "engaged",
        "OFFBOARD",
        True,
        True,
    )
    game = seen["game"]
    certificate = row.certificate
    assert game["value"] == certificate.value
    assert game["time_needed_s"] == certificate.time_needed_s
    assert game["meeting_m"] == pytest.approx(certificate.meeting_point_game_m, abs=0.006)
    # The certificate is for the next cycle
    assert seen["pursuer_m"] == pytest.approx(certificate.pursuer_game_m, abs=0.2)
    assert game["reach"] == "yes"
    # Both players reach each point of the isochron at the same time, so none is farther than the evader can run.
    run_m = 1.001 * max(
        math.dist(place, certificate.evader_game_m[:2]) for place in game["isochron_m"]
    )
    assert math.dist(game["meeting_m"][:2], certificate.evader_game_m[:2]) <= run_m
    assert beside(game["isochron_m"], game["meeting_m"]) < 0.3  # the curve is a polygon
    assert len(scene["fence_m"][0]) > 3
    assert (seen["gap_m"], seen["height_gap_m"]) == (certificate.gap_m, certificate.height_gap_m)
    earlier = folded(
        record, lambda row: row.state is State.POSITIONING
    ).snapshot()  # the disc exists before the game
    assert earlier["gap_m"] == pytest.approx(
        math.dist(earlier["pursuer_m"][:2], earlier["evader_m"][:2]) - 3.0, abs=0.02
    )
    home = scene["home_m"]
    reach = [math.dist(corner, home[:2]) for corner in scene["fence_m"][0]]
    assert max(reach) - min(reach) < 0.2
    assert len(history_row(seen)) == len(HISTORY)


def test_the_meeting_point_lies_on_the_isochron_of_the_played_game(record):
    settings = recorded_settings(metadata_of(record)).cycle
    played = [row.certificate for row in cycles_of(record) if row.certificate is not None]
    slowest = min(played, key=lambda one: one.speed_ratio)
    # The bound of the estimated speed and the age of the estimate count.
    assert (
        settings.game.pursuer.horizontal_m_s / slowest.speed_ratio
        > 1.02 * settings.game.evader_speed_m_s
    )
    for one in (slowest, *played[:: len(played) // 12]):
        assert beside(isochron_at(settings, one, 721), one.meeting_point_game_m) < 0.01
    # Also with an evader on a hill, and with a moving target.
    for standoff, target, drift in (
        (StandOff(3.0, 2.0), None, (0.0, 0.0)),
        (StandOff(), Enu((90.0, 5.0, 4.0)), (0.4, -0.3)),
    ):
        game = Game(Ball(6.0), 3.1, standoff=standoff, target_velocity_m_s=drift)
        other = replace(settings, game=game, target_game_m=target)
        place = (0.0, 0.0, 30.0), (20.0, 8.0, 4.0)
        there = solve(
            game, *map(np.array, place), None if target is None else np.array(target)
        ).meeting_point_m
        ratio = 6.0 / 3.1
        one = played[0]._replace(
            pursuer_game_m=Enu(place[0]),
            evader_game_m=Enu(place[1]),
            speed_ratio=ratio,
            evader_age_s=0.0,
        )
        assert beside(isochron_at(other, one, 721), there) < 0.02


def test_unknown_values_are_null_before_the_first_message(record):
    fold = SnapshotFold(metadata_of(record), "test")
    assert fold.snapshot() is None
    assert fold.scene["fence_m"] == []
    first = folded(record, lambda _: True).snapshot()
    assert first["game"] is None
    assert first["battery"] is None
    assert first["levels"]["battery"] == "unknown"
    assert first["levels"]["evader"] == "warning"


@pytest.mark.parametrize(
    ("level", "wanted"),
    [
        (level_of(0.4, 0.5, 1.0), Level.OK),
        (level_of(0.6, 0.5, 1.0), Level.CAUTION),
        (level_of(1.1, 0.5, 1.0), Level.WARNING),
        (level_of(math.inf, 0.5, 1.0), Level.WARNING),
        (level_of(math.nan, 0.5, 1.0), Level.UNKNOWN),
        (level_of(0.19, 0.3, 0.2), Level.WARNING),
        (level_of(0.25, 0.3, 0.2), Level.CAUTION),
        (level_of(0.9, 0.3, 0.2), Level.OK),
        (level_of(math.nan, 0.3, 0.2), Level.UNKNOWN),
    ],
)
def test_levels_follow_the_limits_of_the_flight(level, wanted):
    assert level is wanted


def test_the_page_says_whether_the_vehicle_can_reach_the_evader(record):
    one = next(row.certificate for row in cycles_of(record) if row.certificate is not None)
    for winner, vehicle, no_game, reach in (
        (1, 1, False, "yes"), (1, 0, False, "uncertain"), (-1, -1, False, "no"), (1, 1, True, "too fast"),
        (1, None, False, "yes"),
    ):  # fmt: skip
        assert (
            reach_of(one._replace(winner=winner, vehicle_winner=vehicle, no_game=no_game)) == reach
        )


def test_the_vehicles_own_data_are_shown_with_their_levels(record):
    seen = folded(
        record, lambda row: row.state is State.ENGAGED and row.certificate is not None
    ).snapshot()
    assert seen["gps"]["fix"] >= 3
    assert seen["gps"]["satellites"] > 5
    assert seen["voltage_v"] > 10.0
    assert seen["link"] > 0.8
    first_armed = next(
        row.now_s
        for row in cycles_of(record)
        for message in row.inputs.messages
        if isinstance(message, Heartbeat) and message.armed
    )
    assert seen["flight_s"] == pytest.approx(seen["now_s"] - first_armed, abs=0.01)
    assert [seen["levels"][name] for name in ("gps", "link", "reach", "state")] == ["ok"] * 4
    assert folded(record).snapshot()["flight_s"] is None  # landed and disarmed


def test_a_new_page_gets_everything_and_then_only_changes(told, record):
    items = [item for item in scan(record) if item.topic in {CYCLE.topic, EVENT.topic}]
    told.tell(
        *(News("uav1", 100.0, item) for item in items), News("uav1", 100.0, {"state": "landed"})
    )
    (everything,) = told.read(whole=True)["daemons"]
    assert everything["snapshot"]["state"] == "landed"
    assert everything["status"] == {"state": "landed"}
    assert len(everything["events"]) <= MAX_EVENTS
    rows = everything["history"]["rows"]
    assert rows[-1][0] - rows[0][0] > 20.0
    (first,) = told.read()["daemons"]
    assert {"scene", "status", "snapshot", "events", "history"} <= first.keys()
    (again,) = told.read()["daemons"]
    assert again.keys() == {"key", "name", "endpoint", "silent_s", "contact", "over", "fault"}
    # A daemon that starts or restarts while pages are open is sent in full.
    told.tell(
        found("uav1", metadata_of(record), items[-1]), found("uav2", metadata_of(record), items[-1])
    )
    for one in told.read()["daemons"]:
        assert one["history"] == {"columns": list(HISTORY), "rows": []}


def test_events_before_a_page_opened_are_sent_once(told):
    event = {"now_s": 2.0, "event": "checks passed", "detail": "checking -> ready"}
    told.tell(News("uav1", 100.0, Item(0.0, EVENT.topic, "json", json.dumps(event).encode())))
    told.hub.message()  # no page is open
    (everything,) = told.read(whole=True)["daemons"]
    assert everything["events"] == [event]
    assert "events" not in told.read()["daemons"][0]


def test_the_end_of_a_flight_is_shown_until_the_next_flight(told, record):
    closing = {
        "ended": "captured; landed",
        "record": "/flights/pe-001/record.mcap",
        "replay": "pe-001/record.mcap",
    }
    for event, detail, over in (
        (FLIGHT_OVER, json.dumps(closing), closing),
        (
            FLIGHT_OVER,
            json.dumps({"ended": "the daemon ended; ready"}),
            {"ended": "the daemon ended; ready", "record": "", "replay": ""},
        ),
        (FLIGHT_OVER, "no JSON", {"ended": "the daemon ended; ready", "record": "", "replay": ""}),
        (BEGUN, "", None),
    ):
        data = {"now_s": 2.0, "event": event, "detail": detail}
        told.tell(News("uav1", 100.0, Item(0.0, EVENT.topic, "json", json.dumps(data).encode())))
        assert told.read()["daemons"][0]["over"] == over
    told.tell(found("uav1", metadata_of(record)))
    assert told.read()["daemons"][0]["over"] is None


def test_the_history_is_limited_to_five_minutes(told, cycles):
    """Catches a page whose memory grows with the flight."""
    last = cycles[-1]
    row = json.loads(last.data)
    for number in range(3000):
        data = json.dumps({**row, "now_s": row["now_s"] + 0.25 * number}).encode()
        told.tell(News("uav1", 100.0, Item(0.0, CYCLE.topic, "json", data)))
    rows = told.read(whole=True)["daemons"][0]["history"]["rows"]
    assert len(rows) <= HISTORY_S / 0.25
    assert rows[-1][0] - rows[0][0] <= HISTORY_S
    # A restarted daemon has a new clock, so the old history is dropped.
    told.tell(News("uav1", 100.0, last))
    assert len(told.read(whole=True)["daemons"][0]["history"]["rows"]) == 1


def test_a_silent_daemon_is_shown_as_lost(told, cycles):
    last = cycles[-1]
    told.tell(News("uav1", 100.0, last))
    for after_s, contact in ((0.5, "ok"), (1.5, "caution"), (2.5, "warning")):
        told.clock.sleep_until(100.0 + after_s)
        # The loop hangs, the bus answers
        told.tell(News("uav1", 100.0 + after_s, {"state": "ready"}))
        assert told.read()["daemons"][0]["contact"] == contact


def test_unreadable_messages_are_ignored_and_daemons_are_bounded(told):
    for data in (b"", b"{", b"[]", b'{"now_s": 1}', b'{"now_s": "x", "event": 3}'):
        for topic in (CYCLE.topic, EVENT.topic):
            told.tell(News("uav1", 100.0, Item(0.0, topic, "json", data)))
    told.tell(found("odd", {"config": "no JSON"}), News("odd", 100.0, {"state": "waiting"}))
    told.tell(*(News(f"uav{number}", 100.0, {}) for number in range(2 * MAX_DAEMONS)))
    daemons = told.read(whole=True)["daemons"]
    assert len(daemons) == MAX_DAEMONS >= 50
    assert daemons[0].keys() >= {"scene", "status"}
    assert daemons[0]["snapshot"] is None
    assert daemons[1]["status"] == {"state": "waiting"}


def test_vehicles_that_are_not_shown_are_counted_and_an_order_to_one_says_why(told):
    told.tell(*(News(f"uav{number}", 100.0, {}) for number in range(1, MAX_DAEMONS + 1)))
    assert told.read()["left_out"] == 0
    told.tell(*(News(f"more{number}", 100.0, {}) for number in (1, 2, 2)))
    assert told.read()["left_out"] == 2
    reason = f"there are {MAX_DAEMONS} already: use guidance ctl"
    with pytest.raises(LinkError, match=reason):
        told.hub.order(f"more1@{told.bus.endpoint}", "hold", "me")
    with pytest.raises(LinkError, match="is known"):
        told.hub.order(f"none@{told.bus.endpoint}", "hold", "me")


DEEP = "[" * 100_000
BAD_EVENT = {"now_s": 2.0, "event": FLIGHT_OVER, "detail": DEEP}


@pytest.mark.parametrize(
    "bad",
    [
        {"state": "ready", "battery": math.nan},
        {"state": "ready", "battery": math.inf},
        Item(0.0, EVENT.topic, "json", json.dumps(BAD_EVENT).encode()),
        Item(0.0, CYCLE.topic, "json", DEEP.encode()),
        Item(0.0, EVENT.topic, "json", b"\xff"),
        Unreadable("its flight"),
        read_reply(b"5", "uav1", "status"),
        read_reply(DEEP.encode(), "uav1", "status"),
        FoundFlight("uav1", {"config": DEEP}, ()),
    ],
)
def test_what_one_daemon_sends_wrong_is_its_fault_and_the_others_are_shown(
    told, record, cycles, bad
):
    told.tell(found("uav2", metadata_of(record)), News("uav2", 100.0, cycles[50]))
    told.read()
    told.tell(News("uav1", 100.0, bad), News("uav2", 100.0, cycles[51]))
    for whole in (False, True):
        uav1, uav2 = told.read(whole=whole)["daemons"]
        assert "cannot be" in uav1["fault"]
        assert uav2["fault"] == ""
        assert uav2["snapshot"]["now_s"] == pytest.approx(json.loads(cycles[51].data)["now_s"])
    told.clock.sleep_until(100.0 + FAULT_SHOWN_S + 1.0)
    told.tell(News("uav1", 100.0, {"state": "ready"}))
    assert told.read()["daemons"][0]["fault"] == ""


def test_a_reloaded_configuration_changes_the_scene(told):
    document = load_vehicle(find("px4", "vehicles")).model_dump(mode="json")
    document["limits"]["ceiling_m"] = 44.0
    event = {"now_s": 2.0, "event": RELOADED, "detail": json.dumps(document)}
    told.tell(News("uav1", 100.0, Item(0.0, EVENT.topic, "json", json.dumps(event).encode())))
    (daemon,) = told.read(whole=True)["daemons"]
    assert daemon["scene"]["ceiling_m"] == 44.0
    assert daemon["events"] == [{"now_s": 2.0, "event": RELOADED, "detail": ""}]


def test_signs_of_life_go_to_the_watched_daemon_and_their_age_is_shown(told):
    (daemon,) = told.read(whole=True)["daemons"]
    told.hub.note_operator(daemon["key"])
    told.hub.note_operator("uav9@nowhere")
    assert told.bus.vouched == ["uav1"]
    for silence_s, level in ((0.2, "ok"), (6.0, "caution"), (11.0, "warning")):
        told.tell(
            News("uav1", 100.0, {"operator_silence_s": silence_s, "operator_timeout_s": 10.0})
        )
        seen = told.read()["daemons"][0]["operator"]
        assert seen == {"level": level, "silence_s": silence_s, "limit_s": 10.0}
    told.tell(News("uav1", 100.0, {"operator_silence_s": 0.2, "operator_timeout_s": None}))
    assert told.read()["daemons"][0]["operator"] is None


def test_orders_go_to_the_chosen_daemon(told):
    (daemon,) = told.read(whole=True)["daemons"]
    assert told.hub.order(daemon["key"], "hold", "panel, Ana")[0]["accepted"]
    assert told.bus.ordered == [("uav1", "hold", "panel, Ana", "")]
    told.tell(News("uav1", 100.0, {"team": "north", "vehicles": ["uav1", "uav2"]}))
    told.hub.order(daemon["key"], "hold", "panel, Ana", team=True)
    assert told.bus.ordered[1:] == [("uav1", "hold", "panel, Ana", "north")]
    with pytest.raises(LinkError, match="no daemon 'uav9' is known"):
        told.hub.order("uav9", "hold", "")
