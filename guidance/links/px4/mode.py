"""A flight mode of PX4 that another program flies: registration, arming checks and executor, without I/O.

The program registers a mode by name. PX4 keeps a number for the name, shows it on ground stations, and lets a pilot
choose it by switch. About three times a second PX4 asks whether the mode may be armed in and entered; without answers
it calls the mode unresponsive, refuses it, and leaves it in flight. A mode can have an executor, which is in charge
from the moment that the mode is chosen until a person chooses another one. PX4 v1.17 takes an executor's commands over
Zenoh whether it is in charge or not, so their sender must not fight a pilot.

`FlightMode` maps PX4's messages to the messages to send back. It has no clock; times are arguments. It has no lock
either: a caller with several threads needs one.

Source: PX4 v1.17, `src/modules/commander/ModeManagement.cpp` and `HealthAndArmingChecks/checks/externalChecks.cpp`.
"""

import math
from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Any, Final, NamedTuple

from guidance.links.px4.messages import TopicFields, name_bytes
from guidance.messages import Timesync

FIRST_MODE: Final = 23
LAST_MODE: Final = 30
"""NAVIGATION_STATE_EXTERNAL1 to 8."""

HOLD: Final = 4
TAKEOFF: Final = 17
"""NAVIGATION_STATE of Hold and Takeoff."""

ARMED: Final = 2
"""ARMING_STATE."""

SET_NAV_STATE: Final = 100001
"""PX4's own command: choose a mode by its NAVIGATION_STATE."""

READINESS_STALE_S: Final = 1.0
"""Readiness that is older counts as not ready: the judging program has stopped."""

REGISTER_EVERY_S: Final = 1.0
ASK_EVERY_S: Final = 1.0
"""Period of questions for PX4's clock, on the ground."""

LOST_AFTER_S: Final = 3.0
"""A mode that PX4 has not listed for this time is registered again."""

_API_VERSION: Final = 1
_EXECUTOR_COMPONENT: Final = 1000
_OWN_COMPONENT: Final = 195
_NOBODY: Final = -1
_REBOOT_US: Final = 1_000_000
_ERROR: Final = 0x33
"""Log levels of an event: error, outside and inside."""


class Check(StrEnum):
    """Reason why the mode cannot be entered, as the name of an event that ground stations show in words.

    PX4's events have no free text. These are events of PX4 itself, whose words come nearest.
    """

    SETUP = "check_system_arm_auth_failed"  # Arm authorization denied
    FENCE = "check_gf_violation_custom_gf"  # Geofence violation: approaching or outside geofence
    EVADER = "check_modes_mission"  # No valid mission available
    POSITION = "check_modes_local_pos"  # Navigation error: No valid position estimate
    HOME = "check_modes_home_position"  # Home position not set
    BATTERY = "check_battery_low"  # Low battery
    BUSY = "check_modes_cannot_takeoff"  # Mode not suitable for arming
    SILENT = "check_external_modes_unresponsive"  # Mode is unresponsive

    @property
    def event_id(self) -> int:
        """The number of the event: component 1, and 24 bits of the FNV-1a hash of its name."""
        value = 0x811C9DC5
        for character in self.value.encode():
            value = (value ^ character) * 0x01000193 & 0xFFFFFFFF
        return 1 << 24 | value & 0xFFFFFF


MOST_CHECKS: Final = 5
"""Events in one answer."""


class Readiness(NamedTuple):
    """True if the mode may be entered.

    Attributes:
        judged_s: When that was judged.
        checks: Those that bar the mode; empty without any.
    """

    judged_s: float
    checks: Sequence[Check] = ()


class Registration(NamedTuple):
    """The numbers that PX4 gave."""

    mode_id: int
    arming_check_id: int
    executor_id: int


class Outgoing(NamedTuple):
    """A message to PX4: a topic of `px4_messages.TO_PX4`, and the fields that are not 0."""

    topic: str
    values: dict[str, Any]


class FlightMode:
    """One mode of one vehicle.

    Args:
        name: In ground stations, 24 characters at most.
        draw: Draws a number of 63 bits for each request, to recognize answers to others.

    Attributes:
        registration: The numbers that PX4 gave; None until it did.
        status: PX4's last VehicleStatus.
        readiness: The last judgement.

    Raises:
        ValueError: If PX4 cannot keep the name.
    """

    def __init__(self, name: str, draw: Callable[[], int]) -> None:
        self.name = name
        self._name = name_bytes(name)
        self._draw = draw
        self._request_id = 0
        self._register_s = -math.inf
        self._question_id = 0
        self._asked_s = -math.inf
        self._unlisted_since_s = math.inf
        self._check_id: int | None = None
        self.registration: Registration | None = None
        self._is_refused = False
        self._impossible = ""
        self.status: TopicFields | None = None
        self.readiness = Readiness(-math.inf, (Check.SILENT,))

    @property
    def refused(self) -> str:
        """Why PX4 did not register the mode, in words; empty if it did, or has not answered."""
        if not self._is_refused:
            return self._impossible
        if self.armed:
            return "modes are registered on the ground only: disarm, or set COM_MODE_ARM_CHK"
        return "all eight modes are taken: end another program's mode, or restart PX4"

    @property
    def entered(self) -> bool:
        """True if the vehicle flies in this mode now."""
        if self.registration is None or self.status is None:
            return False
        return bool(self.status.nav_state == self.registration.mode_id)

    @property
    def in_charge(self) -> bool:
        """True if PX4 takes commands from our executor."""
        if self.registration is None or self.status is None:
            return False
        return bool(self.status.executor_in_charge == self.registration.executor_id)

    @property
    def armed(self) -> bool:
        """True if the vehicle is armed; False before the first VehicleStatus."""
        return self.status is not None and bool(self.status.arming_state == ARMED)

    def due(self, now_s: float) -> list[Outgoing]:
        """Return the messages due now: the registration until it is answered, and a question for PX4's clock."""
        outgoing = []
        if self.registration is None and now_s - self._register_s >= REGISTER_EVERY_S:
            self._register_s = now_s
            self._request_id = self._draw()
            values = {"register_arming_check": 1, "register_mode": 1, "register_mode_executor": 1}
            outgoing.append(self._request(self._request_id, values))
        elif (
            self.registration is not None
            and not self.armed
            and now_s - self._asked_s >= ASK_EVERY_S
        ):
            # An executor without a mode is refused, and the answer has PX4's time
            self._asked_s = now_s
            self._question_id = self._draw()
            outgoing.append(self._request(self._question_id, {"register_mode_executor": 1}))
        return outgoing

    def _request(self, request_id: int, values: dict[str, int]) -> Outgoing:
        about = {
            "request_id": request_id,
            "name": self._name,
            "px4_ros2_api_version": _API_VERSION,
        }
        return Outgoing("register_ext_component_request", {**about, **values})

    def hear(self, topic: str, fields: TopicFields, received_s: float) -> list[Outgoing]:
        """Take a message of PX4, and return the answers, which are due at once."""
        match topic:
            case "vehicle_status":
                before = self.status
                self.status = fields
                if before is not None and fields.timestamp + _REBOOT_US < before.timestamp:
                    self._begin_again()
                return []
            case "register_ext_component_reply":
                return self._take_reply(fields)
            case "arming_check_request":
                return self._take_request(fields, received_s)
            case "mode_completed" if fields.nav_state == TAKEOFF and self.in_charge:
                # After a take-off, PX4 leaves the next mode to the executor in charge
                if self.status is not None and self.status.nav_state == TAKEOFF:
                    return [self.command(SET_NAV_STATE, HOLD)]
        return []

    def clock_answer(self, fields: TopicFields, received_s: float) -> Timesync | None:
        """Return PX4's time in its answer to our last request or question; None for an answer to another one."""
        asked_s = {self._request_id: self._register_s, self._question_id: self._asked_s}.get(
            fields.request_id, -math.inf
        )
        if not math.isfinite(asked_s) or fields.name != self._name:
            return None
        return Timesync(
            received_s, remote_ns=fields.timestamp * 1000, local_ns=round(asked_s * 1e9)
        )

    def _begin_again(self) -> None:
        self.registration = None
        self._check_id = None
        self._register_s = -math.inf
        self._unlisted_since_s = math.inf

    def _take_reply(self, reply: TopicFields) -> list[Outgoing]:
        if reply.request_id != self._request_id or reply.name != self._name:
            return []
        if self.registration is not None:
            return []
        if not reply.success:
            self._is_refused = True
            return []
        # PX4 has defaults for the mode's controllers, which follow a velocity. They are not configured: v1.17 takes
        # config_control_setpoints for the state of the whole vehicle, and one sent in flight would stop the motors.
        numbers = Registration(reply.mode_id, reply.arming_check_id, reply.mode_executor_id)
        if not FIRST_MODE <= numbers.mode_id <= LAST_MODE or min(numbers) < 0:
            self._impossible = f"PX4 gave impossible numbers: {numbers}"
            return []
        self._is_refused = False
        self.registration = numbers
        self._unlisted_since_s = math.inf
        return []

    def judge(self, readiness: Readiness) -> list[Outgoing]:
        """Take a new judgement; if it differs from the last one, return another answer to PX4's last arming check.

        PX4 keeps the last answer to its last request, so a change does not wait for the next one.
        """
        changed = tuple(readiness.checks) != tuple(self.readiness.checks)
        self.readiness = readiness
        if not changed or self.registration is None or self._check_id is None:
            return []
        return [self._answer(self._check_id, self.registration, readiness.judged_s)]

    def _take_request(self, request: TopicFields, received_s: float) -> list[Outgoing]:
        """Answer an arming check, and see whether PX4 still has the mode."""
        numbers = self.registration
        if numbers is None:
            return []
        self._check_id = request.request_id
        if request.valid_registrations_mask >> numbers.arming_check_id & 1:
            self._unlisted_since_s = math.inf
        else:
            self._unlisted_since_s = min(self._unlisted_since_s, received_s)
            if received_s - self._unlisted_since_s > LOST_AFTER_S and not self.armed:
                gone = self.farewell()
                self._begin_again()
                return gone
        return [self._answer(request.request_id, numbers, received_s)]

    def _answer(self, check_id: int, numbers: Registration, now_s: float) -> Outgoing:
        """Return the answer to an arming check by the last judgement; an old one means not ready."""
        checks = tuple(self.readiness.checks)
        if now_s - self.readiness.judged_s > READINESS_STALE_S:
            checks = (Check.SILENT,)
        events = {}
        for index, check in enumerate(checks[:MOST_CHECKS]):
            events[f"events_{index}_id"] = check.event_id
            events[f"events_{index}_log_levels"] = _ERROR
        required = ("angular_velocity", "attitude", "local_alt", "local_position", "home_position")
        values = {
            "request_id": check_id,
            "registration_id": numbers.arming_check_id,
            "can_arm_and_run": not checks,
            "num_events": min(len(checks), MOST_CHECKS),
            **events,
            **{f"mode_req_{name}": 1 for name in required},
        }
        return Outgoing("arming_check_reply", values)

    def command(self, number: int, *params: float) -> Outgoing:
        """Return a command: the executor's if it is in charge, else as of a person at a ground station."""
        system_id = 1 if self.status is None else self.status.system_id
        values: dict[str, Any] = {
            f"param{index}": value for index, value in enumerate(params, start=1)
        }
        values |= {
            "command": number,
            "target_system": system_id,
            "target_component": 1 if self.status is None else self.status.component_id,
            "source_system": system_id,
            "from_external": 1,
        }
        if self.in_charge and self.registration is not None:
            values["source_component"] = _EXECUTOR_COMPONENT + self.registration.executor_id
            return Outgoing("vehicle_command_mode_executor", values)
        values["source_component"] = _OWN_COMPONENT
        return Outgoing("vehicle_command", values)

    def enter(self) -> Outgoing | None:
        """Return the command to choose this mode; None before it is registered."""
        if self.registration is None:
            return None
        return self.command(SET_NAV_STATE, self.registration.mode_id)

    def completed(self) -> list[Outgoing]:
        """Return the message that the mode has done its work; none while another mode flies."""
        if not self.entered or self.registration is None:
            return []
        return [Outgoing("mode_completed", {"nav_state": self.registration.mode_id})]

    def farewell(self) -> list[Outgoing]:
        """Return the message that takes the mode off PX4's list."""
        if self.registration is None:
            return []
        numbers = self.registration
        values = {
            "name": self._name,
            "arming_check_id": numbers.arming_check_id,
            "mode_id": numbers.mode_id,
            "mode_executor_id": numbers.executor_id,
        }
        return [Outgoing("unregister_ext_component", values)]
