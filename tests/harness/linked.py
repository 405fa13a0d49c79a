"""A flight with its links and no daemon: one call a cycle."""

from collections.abc import Sequence

from guidance.clock import Timing
from guidance.flight import Event, Flight, Inputs, Outputs
from guidance.links.port import EvaderSource, VehicleLink
from guidance.log.writer import Record
from guidance.session.fly.daemon import HEARTBEAT_EVERY_S
from guidance.session.observe.recording import Recording


class FlownByHand:
    """A flight whose orders come from the test."""

    def __init__(
        self, flight: Flight, link: VehicleLink, evader: EvaderSource, record: Record | None
    ) -> None:
        self.flight = flight
        self._link = link
        self._evader = evader
        self._recording = Recording("pursuer", record)
        self._heartbeat_s = float("-inf")

    def run(
        self, now_s: float, orders: Sequence[Event] = (), timing: Timing | None = None
    ) -> Outputs:
        """Run one cycle."""
        inputs = Inputs(self._link.receive(), self._evader.receive(), orders)
        if now_s - self._heartbeat_s >= HEARTBEAT_EVERY_S:
            self._heartbeat_s = now_s
            self._link.send_heartbeat()
        outputs = self.flight.step(now_s, inputs)
        if outputs.setpoint is not None:
            self._link.send_setpoint(outputs.setpoint)
        for request in outputs.requests:
            self._link.request(request)
        self._recording.cycle(now_s, inputs, outputs, timing)
        return outputs
