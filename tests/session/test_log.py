"""The service's log: lines for people or JSON, and none that the loop waits for."""

import logging
import threading

from guidance.flight import State
from guidance.session.observe.log import MOST_LINES_WAITING, Log


def test_json_lines_carry_the_fields_as_they_are(text_log):
    stream, rows = text_log
    log = Log("json", "info", stream)
    fields = {"state": State.RETURNING, "left": 0.19, "unknown": float("nan")}
    log.say(logging.WARNING, "battery low", fields)
    log.say(logging.DEBUG, "not written", {})
    log.close()
    (row,) = rows()
    assert row.pop("time") > 1.7e9
    assert row == {
        "level": "warning",
        "message": "battery low",
        "state": "returning",
        "left": 0.19,
        "unknown": None,
    }


def test_console_lines_are_for_people(text_log):
    stream, _ = text_log
    log = Log("console", "debug", stream)
    log.say(logging.INFO, "armed", {"state": State.CLIMBING})
    log.say(logging.ERROR, "gone", {})
    log.close()
    first, second = stream.getvalue().splitlines()
    assert first[8:] == " armed  state=climbing"
    assert second[8:] == " ERROR gone"


class StandingStill:
    """A terminal that blocks writes until `go` is set."""

    def __init__(self):
        self.go = threading.Event()

    def write(self, _):
        self.go.wait(10.0)

    def flush(self):
        pass

    def isatty(self):
        return True


def test_a_terminal_that_stands_still_costs_lines_and_never_the_loop(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    stream = StandingStill()
    log = Log("console", "info", stream)
    for _ in range(MOST_LINES_WAITING + 50):
        log.say(logging.INFO, "on and on", {})
        log.show("on and on")
    assert log.dropped >= 49
    stream.go.set()
    log.close()


def test_a_console_line_stays_one_line_whatever_a_field_says(text_log):
    stream, _ = text_log
    log = Log("console", "debug", stream)
    log.say(logging.INFO, "refused", {"reason": "\x1b[2J\n12:00:00 armed\u202e"})
    log.close()
    (line,) = stream.getvalue().splitlines()
    assert line.endswith("refused  reason=\\x1b[2J\\n12:00:00 armed\\u202e")
