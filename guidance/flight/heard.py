"""What a flight has heard: its vehicle, the mode it is in, where it is to its fences, who else flies it, the evader.

Read once a cycle, before anything is decided. Whatever the rest of the flight asks about the present is found here, and
is reckoned once.
"""

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from guidance.autopilots import Mode
from guidance.control import Envelope, FenceGeometry, measure_fence
from guidance.flight.inputs_outputs import Inputs
from guidance.flight.settings import FlightSettings
from guidance.flight.tracking import NOWHERE, Tracking, polygon_about_home
from guidance.frames import GameFrame, LocalFrame, Vector, difference
from guidance.messages import Heartbeat, LocalPosition, Message, PositionTarget, Setpoint
from guidance.vehicle import VehicleState, observe

REMEMBERED_S: Final = 1.5
"""Longest time from our sending a setpoint to the autopilot's report of it."""

TOLERANCE_M_S: Final = 0.75
STRANGE_REPORTS: Final = 3
"""So many strange reports within `WINDOW_S` are a second source; one or two are not."""

WINDOW_S: Final = 2.0
APART_S: Final = 0.2
"""Strange reports closer together than this count once: a transient of the autopilot's own shows in several."""

_ROUNDING_S: Final = 1e-6

_LEAST_SHARE: Final = 0.5
"""An autopilot may cut a setpoint to its own speed limits: down to this share of it still counts as ours."""


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
        envelope, corners_deg = self.cycle.envelope, self._settings.limits.fence_polygon_deg
        if corners_deg is not None:
            envelope = replace(envelope, fence_polygon=polygon_about_home(corners_deg, home_ned_m, frame))
        return replace(envelope, home_ned_m=home_ned_m)


class Echo:
    """The memory of what was sent lately and of when reports did not fit it.

    Does the autopilot fly what we sent? POSITION_TARGET_LOCAL_NED shows a second source of setpoints on the vehicle. It
    repeats the setpoint in force, a moment late and perhaps cut to the autopilot's own limits. A velocity that is none
    of those sent lately was sent by somebody else. Between ours such a setpoint is in force for one cycle only, so the
    reports are asked for as often as we send, and strange ones are counted whether or not ours lie between them.
    """

    def __init__(self) -> None:
        self._sent: deque[_Sent] = deque(maxlen=256)
        self._strange_s: deque[float] = deque(maxlen=STRANGE_REPORTS)
        self._begun_s = math.inf

    @property
    def foreign(self) -> bool:
        """True while the autopilot reports setpoints that are not ours."""
        return len(self._strange_s) == STRANGE_REPORTS

    @property
    def suspicious(self) -> bool:
        """True from the first strange report on, until it is too long ago to count."""
        return bool(self._strange_s)

    def silent(self) -> None:
        """We send nothing: whatever the autopilot reports now is its own affair."""
        self._sent.clear()
        self._strange_s.clear()
        self._begun_s = math.inf

    def sent(self, now_s: float, setpoint: Setpoint) -> None:
        """Take note of what goes out."""
        self._begun_s = min(self._begun_s, now_s)
        self._sent.append(_Sent(now_s, setpoint.velocity_ned_m_s))

    def hear(self, messages: Iterable[Message], *, guided: bool) -> None:
        """Compare what the autopilot reports; only in the guided mode is it meant to be ours."""
        for message in messages:
            if not isinstance(message, PositionTarget):
                continue
            if not guided:
                self._strange_s.clear()
                continue
            now_s = message.received_s
            while self._strange_s and now_s - self._strange_s[0] > WINDOW_S + _ROUNDING_S:
                self._strange_s.popleft()
            counted = self._strange_s and now_s - self._strange_s[-1] < APART_S - _ROUNDING_S
            if not counted and now_s - self._begun_s > REMEMBERED_S and not self._is_ours(message):
                self._strange_s.append(now_s)

    def _is_ours(self, message: PositionTarget) -> bool:
        reported = message.velocity_ned_m_s
        if not all(map(math.isfinite, reported)):
            return True  # nothing is said of the velocity
        for sent in reversed(self._sent):  # the latest is nearly always the one
            if message.received_s - sent.now_s > REMEMBERED_S:
                return False
            if _distance(reported, sent.velocity_ned_m_s) <= TOLERANCE_M_S:
                return True
        return False


class _Sent(NamedTuple):
    now_s: float
    velocity_ned_m_s: Vector


def _distance(reported: Vector, sent: Vector) -> float:
    """Distance from what is reported to what was sent, or to the nearest shorter one of the same direction."""
    square = sum(part * part for part in sent)
    along = sum(a * b for a, b in zip(reported, sent, strict=True)) / square if square > 0.0 else 1.0
    share = min(1.0, max(_LEAST_SHARE, along))
    return math.dist(reported, [share * part for part in sent])
