"""The links and the record of a flight."""

from collections.abc import Sequence
from typing import NamedTuple

from guidance.clock import Timing
from guidance.flight import Authority, Event, Flight, Inputs, Outputs
from guidance.links.port import EvaderSource, VehicleLink
from guidance.log.entries import BEGUN, cycle_entry
from guidance.log.writer import Record

HEARTBEAT_S = 1.0


class Stopped(NamedTuple):
    """When and why the record stopped. The flight goes on."""

    now_s: float
    reason: str


class LinkedFlight:
    """A flight's links and its record: what a cycle reads, and what it sends and records."""

    def __init__(self, flight: Flight, link: VehicleLink, evader: EvaderSource, recorder: Record | None) -> None:
        self.flight = flight
        self._link = link
        self._evader = evader
        self._recorder = recorder
        self._heartbeat_s = float("-inf")
        self.setpoints_sent = 0
        self.inputs = Inputs(float("-inf"))
        self.record_stopped: Stopped | None = None
        self._begun = False

    def read(
        self,
        now_s: float,
        orders: Sequence[Event] = (),
        refusals: Sequence[str] = (),
        *,
        alive: bool = False,
        mission: Sequence[Event] = (),
    ) -> Inputs:
        """Read everything that one cycle sees, and send our HEARTBEAT once a second.

        Args:
            now_s: The present.
            orders: Orders of people since the last cycle.
            refusals: Names of what preflight refuses.
            alive: Whether a person gave a sign of life since the last cycle.
            mission: Orders of a mission.
        """
        self.inputs = Inputs(
            now_s, self._link.receive(), self._evader.receive(), orders, refusals, alive or None, mission
        )
        if now_s - self._heartbeat_s >= HEARTBEAT_S:
            self._heartbeat_s = now_s
            self._link.send_heartbeat()
        return self.inputs

    def write(self, outputs: Outputs, timing: Timing | None = None) -> None:
        """Send the flight's outputs for the last inputs, and record both.

        Args:
            outputs: Of the flight.
            timing: How late the cycle is, for the record.
        """
        # The setpoint first: everything else can wait a millisecond.
        if outputs.setpoint is not None:
            self._link.send_setpoint(outputs.setpoint)
            self.setpoints_sent += 1
        for request in outputs.requests:
            self._link.request(request)
        if self._recorder is not None:
            self._keep(self._recorder, self.inputs, outputs, timing)
            if self.record_stopped is None and self._recorder.failed is not None:
                self.record_stopped = Stopped(self.inputs.now_s, self._recorder.failed)

    def _keep(self, recorder: Record, inputs: Inputs, outputs: Outputs, timing: Timing | None) -> None:
        if not self._begun:
            self._begun = True
            recorder.event(inputs.now_s, BEGUN)
        recorder.cycle(cycle_entry(inputs, outputs, timing))
        for happening in outputs.happenings:
            detail = f"{happening.before} -> {happening.after}"
            if happening.by is not Authority.FLIGHT:
                detail += f": by {happening.by}"
            elif happening.detail:
                detail += f": {happening.detail}"
            recorder.event(happening.now_s, str(happening.event), detail)
        if outputs.alarm is not None:
            recorder.event(inputs.now_s, str(outputs.alarm.violation), outputs.alarm.by)
