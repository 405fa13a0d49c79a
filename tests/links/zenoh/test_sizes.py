"""Zenoh messages that would cost seconds or memory are dropped before they are read, and counted."""

import json
import time
from contextlib import closing

import pytest

from guidance.links.evaders.carriers import RefusedReport
from guidance.links.evaders.zenoh import MOST_REPORT_BYTES, open_source, report_of_json
from guidance.links.zenoh.session import MOST_QUERY_BYTES, is_small, open_session
from guidance.links.zenoh.team import MOST_TEAM_MESSAGE_BYTES, ZenohTeam
from guidance.links.zenoh.wire import ZenohWire
from guidance.team.board import Board
from tests.links.peer import until
from tests.links.rigs import clock
from tests.links.zenoh.parties import FRAME, SAID


def test_a_large_report_is_dropped_unread_and_counted(router):
    url = f"zenoh://127.0.0.1:{router.port}/sizes/report"
    with closing(open_source("json", url, clock=clock, frame=FRAME)) as source:
        publisher = router.session.declare_publisher("sizes/report")
        assert until(lambda: publisher.matching_status.matching)
        heard = []
        for payload in (SAID.ljust(MOST_REPORT_BYTES + 1), SAID.ljust(MOST_REPORT_BYTES)):
            publisher.put(payload)
        assert until(lambda: heard.extend(source.receive()) or heard)
        assert len(heard) == 1
        assert source.counters()["oversized"] == 1
        publisher.undeclare()


def test_a_report_of_unknown_keys_costs_no_error_for_each():
    keys = {f"{number:x}": 1 for number in range(400)}
    payload = json.dumps(keys).encode()[:MOST_REPORT_BYTES]
    begun_s = time.process_time()
    for _ in range(200):
        with pytest.raises(RefusedReport):
            report_of_json(payload, 1.0, frame=FRAME, source="x")
    many_s = time.process_time() - begun_s
    begun_s = time.process_time()
    for _ in range(200):
        report_of_json(SAID, 1.0, frame=FRAME, source="x")
    assert many_s < 5.0 * (time.process_time() - begun_s)


def test_a_large_message_of_a_team_or_to_a_vehicle_is_dropped_unread(router):
    endpoint = f"tcp/127.0.0.1:{router.port}"
    session = open_session(endpoint)
    with closing(session), closing(ZenohTeam(clock, session, "sizes", "a", ["b"])) as team:
        publisher = router.session.declare_publisher("guidance/team/sizes/roles/b")
        assert until(lambda: publisher.matching_status.matching)
        for size in (MOST_TEAM_MESSAGE_BYTES + 1, 10):
            publisher.put(bytes(size))
        heard = []
        assert until(lambda: heard.extend(team.receive()) or len(heard) > 1)
        assert [len(payload) for _, _, payload in heard] == [0, 10]
        board = Board("a", ["a", "b"], ["rover1"])
        assert board.hear(*heard[0]) is None
        assert board.counts.total() == 1
        publisher.undeclare()
    with closing(ZenohWire(clock, open_session(endpoint), "sizes")) as wire:
        publisher = router.session.declare_publisher("sizes/mavlink_raw/out")
        assert until(lambda: publisher.matching_status.matching)
        for size in (100_000, 10):
            publisher.put(bytes(size))
        heard = []
        assert until(lambda: heard.extend(wire.receive()) or heard)
        assert [len(data) for _, data in heard] == [10]
        assert wire.counters()["wire_oversized"] == 1
        publisher.undeclare()


def test_a_large_query_is_dropped_unread(router):
    asked = []
    endpoint = f"tcp/127.0.0.1:{router.port}"
    with closing(open_session(endpoint)) as session:
        queryable = router.session.declare_queryable(
            "sizes/question", lambda query: asked.append(is_small(query)) or query.drop()
        )
        for size in (MOST_QUERY_BYTES + 1, 10):
            list(session.get("sizes/question", payload=bytes(size), timeout=1.0))
        list(session.get("sizes/question", attachment=bytes(MOST_QUERY_BYTES + 1), timeout=1.0))
        assert until(lambda: len(asked) == 3)
        assert asked == [False, True, False]
        queryable.undeclare()
