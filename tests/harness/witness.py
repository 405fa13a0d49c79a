"""An output of a flight from outside the package."""

import json

from guidance.flight import State
from guidance.log.entries import BEGUN
from guidance.log.sink import Sink


class Witness(Sink):
    """Keeps all that it is told."""

    def __init__(self, order):
        self.order = order
        self.told = []
        self.closed = False

    def begin(self, identity):
        self.told.append(("begin", identity))

    def cycle(self, entry):
        self.told.append(("cycle", entry))

    def event(self, now_s, event, detail=""):
        self.told.append(("event", event))

    def report(self, report):
        self.told.append(("report", report.outputs))

    def over(self, now_s, detail):
        self.told.append(("over", json.loads(detail)["ended"]))

    def close(self):
        self.closed = True

    def of(self, kind):
        return [content for told, content in self.told if told == kind]

    def saw_the_whole(self, result):
        """Judge what it was told of a flight."""
        assert self.of("begin")[0].settings.cycle == result.cycle
        # A vehicle that has landed goes on with its cycles until the others have, too
        assert len(self.of("cycle")) == len(self.of("report")) >= result.cycles > 0
        assert self.of("event")[0] == BEGUN
        assert {State.ENGAGED, result.ended} <= {entry.state for entry in self.of("cycle")}
        assert self.of("over") == [self.told[-1][1]]
        assert self.closed
