"""What a flight has heard: its vehicle, the mode it is in, where it is to its fences, who else flies it, the evader.

Read once a cycle, before anything is decided. Whatever the rest of the flight asks about the present is found here, and
is reckoned once.
"""

from collections.abc import Sequence
from dataclasses import replace

from guidance.autopilots import Mode
from guidance.control import Envelope, FenceGeometry, measure_fence
from guidance.flight.echo import Echo
from guidance.flight.inputs_outputs import Inputs
from guidance.flight.settings import FlightSettings
from guidance.flight.tracking import NOWHERE, Tracking, polygon_about_home
from guidance.frames import GameFrame, LocalFrame, Vector, difference
from guidance.messages import Heartbeat, LocalPosition, Message
from guidance.vehicle import VehicleState, observe


class Heard:
    """Everything heard so far, and what it comes to in this cycle.

    Attributes:
        vehicle: As last heard.
        tracking: The evader, home, the local frame and the game's.
        echo: Whether the autopilot's setpoints are ours.
        messages: Of this cycle.
        beats: The HEARTBEATs among them.
        mode: What the last HEARTBEAT shows.
        foreign: Whether another source commands the vehicle, and a HEARTBEAT came since that shows no pilot's mode.
        local: The last LOCAL_POSITION_NED.
        position_ned_m: Where the vehicle is, in the local frame as it is believed.
        moved_ned_m: By how much that frame moved under the vehicle in this cycle.
        cycle: The settings of a guidance cycle, with heights and fences about home.
        fence: Where the vehicle is to its fences.
        start_ned_m: Where the autopilot flies to before standing by, if that is configured.
    """

    def __init__(self, settings: FlightSettings) -> None:
        self._settings = settings
        self._home_in: tuple[Vector, LocalFrame] | None = None
        self._game_frame: GameFrame | None = None
        self._taken_up_ned_m = NOWHERE
        self._jumps = (NOWHERE, NOWHERE)
        self.vehicle = VehicleState()
        self.tracking = Tracking(settings.cycle, settings.autopilot)
        self.echo = Echo()
        self.messages: Sequence[Message] = ()
        self.beats: Sequence[Heartbeat] = ()
        self.mode: Mode | None = None
        self.foreign = False
        self.local: LocalPosition | None = None
        self.position_ned_m: Vector | None = None
        self.moved_ned_m = NOWHERE
        self.cycle = settings.cycle
        self.fence: FenceGeometry | None = None
        self.start_ned_m: Vector | None = None

    def vehicle_says(self, messages: Sequence[Message]) -> None:
        """Take in what the vehicle says, and no more."""
        self.messages = messages
        self.vehicle = observe(self.vehicle, messages)
        self.beats = [one for one in messages if isinstance(one, Heartbeat)]
        if self.beats:
            self.mode = self._settings.autopilot.mode_of(self.beats[-1].custom_mode)

    def take_in(self, inputs: Inputs, *, in_flight: bool) -> None:
        """Take in what one cycle heard.

        Args:
            inputs: Of the cycle.
            in_flight: Whether the evader's jumps are bounded by the way that it can have gone.
        """
        self.vehicle_says(inputs.messages)
        self.tracking.observe(self.vehicle, inputs.reports, in_flight=in_flight)
        strange = self.echo.foreign
        self.echo.hear(inputs.messages, guided=self.mode is Mode.GUIDED)
        # A pilot's takeover shows as strange setpoints before a HEARTBEAT tells of it: the next one must not.
        self.foreign = strange and self.echo.foreign and bool(self.beats)
        self._place()

    def _place(self) -> None:
        """Put vehicle, fences and start where they are in the local frame as it is believed now."""
        tracking, held_back_ned_m = self.tracking, self.tracking.held_back_ned_m
        self.moved_ned_m = NOWHERE
        jumps = self.vehicle.jumped_ned_m, held_back_ned_m
        if jumps != self._jumps:
            self._jumps, taken_up_ned_m = jumps, difference(*jumps)
            self.moved_ned_m = difference(taken_up_ned_m, self._taken_up_ned_m)
            self._taken_up_ned_m = taken_up_ned_m
        home_ned_m, frame = tracking.home_ned_m, tracking.local_frame
        if home_ned_m is not None and frame is not None and (home_ned_m, frame) != self._home_in:
            self._home_in = home_ned_m, frame
            self.cycle = replace(self.cycle, envelope=self._about(home_ned_m, frame))
        if tracking.game_frame is not self._game_frame and self._settings.start_game_m is not None:
            self._game_frame = tracking.game_frame
            if tracking.game_frame is not None:
                self.start_ned_m = tracking.game_frame.position_to_ned(self._settings.start_game_m)
        self.local = self.vehicle.last(LocalPosition)
        if self.local is not None:
            self.position_ned_m = self.local.position_ned_m
            if held_back_ned_m != NOWHERE:
                self.position_ned_m = difference(self.position_ned_m, held_back_ned_m)
            self.fence = measure_fence(self.position_ned_m, self.cycle.envelope)

    def _about(self, home_ned_m: Vector, frame: LocalFrame) -> Envelope:
        """Heights and fences count from home, which need not be the origin of the local frame."""
        envelope, corners_deg = self.cycle.envelope, self._settings.fence_corners_deg
        if corners_deg is not None:
            envelope = replace(envelope, fence_polygon=polygon_about_home(corners_deg, home_ned_m, frame))
        return replace(envelope, home_ned_m=home_ned_m)
