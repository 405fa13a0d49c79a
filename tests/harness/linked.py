"""A flight with its links and no daemon: one call a cycle."""

from collections.abc import Sequence

from guidance.clock import Timing
from guidance.flight import Event, Outputs
from guidance.session.linked_flight import LinkedFlight


class FlownByHand(LinkedFlight):
    """A flight whose orders come from the test."""

    def run(self, now_s: float, orders: Sequence[Event] = (), timing: Timing | None = None) -> Outputs:
        """Run one cycle."""
        outputs = self.flight.step(self.read(now_s, orders))
        self.write(outputs, timing)
        return outputs
