"""Computes the setpoint of a cycle by playing the game or holding a position, and runs the monitor."""

from functools import partial
from typing import TYPE_CHECKING

from guidance.autopilots import Mode
from guidance.control import Situation
from guidance.cycle import CycleInputs, CycleMemory, EvaderEstimate, hover, play
from guidance.flight.heard import Heard
from guidance.flight.settings import AfterCapture, FlightSettings
from guidance.flight.table import SETPOINT_STATES, State
from guidance.frames import Vector
from guidance.messages import Setpoint
from guidance.monitor import Alarm, MonitorMemory, watch

if TYPE_CHECKING:
    from guidance.certificate import Certificate


class Playing:
    """State of the game between cycles.

    Attributes:
        evader: The evader as estimated for this cycle; None where no setpoint was made.
        certificate: The last one of the present state.
        alarm: This cycle's.
    """

    def __init__(self, settings: FlightSettings) -> None:
        self._settings = settings
        self._watch = partial(
            watch,
            with_target=settings.cycle.target_game_m is not None,
            speed_m_s=settings.cycle.ground_speed_m_s,
            slack_s=settings.guarantee_slack_s,
        )
        self._memory = CycleMemory()
        self._monitor = MonitorMemory()
        self.evader: EvaderEstimate | None = None
        self.certificate: Certificate | None = None
        self.alarm: Alarm | None = None

    def change(self, before: State, after: State) -> None:
        """Enter a state and drop the certificate of the last one."""
        self.certificate = None
        if after not in SETPOINT_STATES or before not in SETPOINT_STATES:
            self._memory, self._monitor = CycleMemory(), self._monitor.anew()
        if after is State.ON_STATION:
            self._monitor = self._monitor.anew()  # the promise is kept: an evader that gets away begins a new one
        if after is State.PAUSED:
            self._monitor = self._monitor.restarted()  # nothing was promised about a pause

    def move(self, by_ned_m: Vector) -> None:
        """Move the remembered positions (of the hover and the drift estimate) with the local frame.

        The vehicle is then held where it is, not sent to where it now believes that it was.
        """
        north_m, east_m, down_m = by_ned_m
        memory = self._memory
        drift, place, height = memory.follow.drift, memory.place, memory.height
        if drift.position_ned_m is not None:
            north, east, down = drift.position_ned_m
            drift = drift._replace(position_ned_m=(north + north_m, east + east_m, down + down_m))
        self._memory = memory._replace(
            follow=memory.follow._replace(drift=drift),
            place=None if place is None else (place[0] + north_m, place[1] + east_m),
            height=None if height is None else height._replace(down_m=height.down_m + down_m),
        )

    def silent(self) -> None:
        """Make no setpoint in this cycle."""
        self.evader = self.alarm = None

    def setpoint(self, heard: Heard, state: State, now_s: float, dt_s: float, *, battery_needed: float) -> Setpoint:
        """Make this cycle's setpoint.

        Args:
            heard: Everything received so far, with a vehicle position.
            state: Where the flight stands.
            now_s: The present.
            dt_s: Since the last cycle.
            battery_needed: The share of the charge that it takes to come home from here, NaN where it is not reckoned.

        Raises:
            ValueError: If the vehicle has not told where it is.
        """
        settings, self.alarm = self._settings, None
        local, position_ned_m = heard.local, heard.position_ned_m
        if local is None or position_ned_m is None:
            raise ValueError("a setpoint needs the vehicle's position")
        if state is State.STANDING_BY:
            # Neutral stream: do not remember a height while the pilot flies.
            self._memory = CycleMemory(limits=self._memory.limits)
        evader = self.evader = heard.tracking.evader(now_s)
        here = Situation(
            position_ned_m,
            local.velocity_ned_m_s,
            heard.vehicle.yaw_rad,
            None if evader is None else evader.position_ned_m,
            None if evader is None else evader.velocity_ned_m_s,
            heard.vehicle.acceleration_ned_m_s2,
        )
        playing = state is State.ENGAGED or (
            state is State.ON_STATION and settings.after_capture is AfterCapture.SHADOW
        )
        played = play if playing and evader is not None else hover
        guided = bool(heard.beats) and heard.mode is Mode.GUIDED
        inputs = CycleInputs(dt_s, here, evader, heard.tracking.game_frame, heard.fence, guided)
        output = played(inputs, heard.cycle, self._memory)
        self._memory = output.memory
        if output.certificate is not None:
            self.certificate = output.certificate._replace(battery_needed=battery_needed)
            if state is State.ENGAGED:
                self._monitor, self.alarm = self._watch(self._monitor, now_s, self.certificate)
        return output.setpoint
