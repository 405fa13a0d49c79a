"""PX4's external modes: what programs beside it register, and whether their modes may run. No I/O.

A program registers an arming check, with it a mode, and with that a mode executor, which may arm and change modes. PX4
then asks three times a second whether arming and the mode are possible. A program that stays silent is unresponsive:
its mode cannot run. A mode keeps its number by the hash of its name in COM_MODEn_HASH.

`take` queues a message from outside, `update` handles what has come, and `out` has the messages to publish. The control
mode and the overrides of a mode are missing, because PX4 v1.17's Zenoh does not deliver them (`topic_link`).
Source: ``ModeManagement.cpp`` and ``externalChecks.cpp`` of PX4 v1.17, and measurements on it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sitl_mock.px4.events import Event, event_id, fnv1a
from sitl_mock.px4.messages import message_type
from sitl_mock.px4.modes import NAV_STATES
from sitl_mock.vehicle.modes import Need

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sitl_mock.protocols import ParameterStore

EXTERNAL: Final = tuple(f"EXTERNAL{index}" for index in range(1, 9))
STATE_OF: Final = {name: state for name, (state, _) in NAV_STATES.items()}
NAME_OF: Final = {state: name for name, state in STATE_OF.items()}
FIRST_STATE: Final = STATE_OF[EXTERNAL[0]]
CHECKS_MOST: Final = 8
EXECUTORS_MOST: Final = 5
NOBODY: Final = 0
"""The executor in charge is the autopilot itself."""
EXECUTOR_COMPONENT: Final = 1000
"""Source component of an executor's commands, plus its id."""
ASKED_EVERY_S: Final = 0.3
ANSWERED_WITHIN_S: Final = 0.05
_SLACK_S: Final = 1e-6
_MISSES: Final = 3
_MISSES_AT_FIRST: Final = 10
"""A program may still be connecting when it is asked for the first time."""
_RELAPSES: Final = 3
"""A program that was unresponsive more often stays so."""
_API_VERSION: Final = 1
_NONE: Final = -1
_HANDLED_AT_ONCE: Final = 5
_QUEUED: Final = {
    "register_ext_component_request": 2,
    "unregister_ext_component": 1,
}
"""Messages that PX4 keeps until its commander reads them; of more, the oldest are lost."""
_REQUIREMENTS: Final = {
    "mode_req_local_alt": Need.ALTITUDE,
    "mode_req_local_position": Need.LOCAL_POSITION,
    "mode_req_local_position_relaxed": Need.LOCAL_POSITION,
    "mode_req_global_position": Need.GLOBAL_POSITION,
    "mode_req_global_position_relaxed": Need.GLOBAL_POSITION,
    "mode_req_mission": Need.MISSION,
    "mode_req_home_position": Need.HOME,
    "mode_req_manual_control": Need.PILOT,
}
"""Requirements of an arming check's reply; angular velocity and attitude are always known here."""
_EVERY_MODE: Final = 0xFFFFFFFF
_SYSTEM: Final = 20
"""Bit of the health component "system"."""
_ERROR: Final = 0x33
_CRITICAL: Final = 0x22


@dataclass(slots=True)
class ArmingCheck:
    """A registered arming check.

    Attributes:
        state: Number of its mode, -1 for none.
        replaces: Number of the internal mode that its mode replaces, -1 for none.
        heard: It has replied.
        misses: Requests since the last reply.
        unresponsive: It does not reply.
        relapses: How often it became unresponsive.
    """

    state: int
    replaces: int
    heard: bool = False
    misses: int = 0
    unresponsive: bool = False
    relapses: int = 0


@dataclass(slots=True)
class ExternalMode:
    """A registered mode.

    Attributes:
        name: Its name for people.
        replaces: Number of the internal mode that it replaces, -1 for none.
        check: Number of its arming check.
        executor: Number of the executor that owns it, -1 for none.
        fallback_reported: PX4 has reported that the internal mode is flown instead.
    """

    name: str
    replaces: int
    check: int = _NONE
    executor: int = _NONE
    fallback_reported: bool = False


class ArmingVerdict(NamedTuple):
    """What the arming checks say now.

    Attributes:
        needs: Needs of modes that differ from PX4's own table.
        unarmable: Modes in which arming is not possible.
        holds_all: A check without a mode forbids arming in every mode.
        reasons: The events that tell why.
    """

    needs: Mapping[str, frozenset[Need]]
    unarmable: frozenset[str]
    holds_all: bool
    reasons: tuple[Event, ...]


_UNREGISTERED: Final = frozenset({Need.REGISTRATION})


@dataclass(slots=True)
class ExternalModes:
    """Registered modes, checks and executors of one vehicle.

    Attributes:
        out: Messages to publish: topic and fields.
        modes: Modes by number.
        checks: Arming checks by number.
        executors: The number of the mode that each executor owns, by the executor's number.
        failsafe_acts: A failsafe flies; no executor is in charge then.
        revision: Counts changes of the modes.
    """

    parameters: ParameterStore
    out: deque[tuple[str, dict[str, Any]]] = field(default_factory=lambda: deque(maxlen=64))
    modes: dict[int, ExternalMode] = field(default_factory=dict)
    checks: dict[int, ArmingCheck] = field(default_factory=dict)
    executors: dict[int, int] = field(default_factory=dict)
    failsafe_acts: bool = False
    revision: int = 0
    _in_charge: int = NOBODY
    _queues: dict[str, deque[Any]] = field(
        default_factory=lambda: {name: deque(maxlen=most) for name, most in _QUEUED.items()}
    )
    _replies: dict[int, Any] = field(default_factory=dict)
    _request: int = 0
    _asked_s: float = -math.inf
    _replied: set[int] = field(default_factory=set)
    _counted: bool = False

    # Messages

    def take(self, topic: str, message: Any) -> None:  # noqa: ANN401 - a record
        """Take the reply to an arming check now, and keep every other message until the next `update`."""
        if topic == "arming_check_reply":
            # A reply to an older request does not count.
            check = self.checks.get(message.registration_id)
            if check is not None and message.request_id == self._request:
                self._replied.add(message.registration_id)
                check.misses = 0
                check.heard = True
                if check.relapses <= _RELAPSES:
                    check.unresponsive = False
                self._replies[message.registration_id] = message
        else:
            self._queues[topic].append(message)

    def update(self, now_s: float, *, armed: bool, intended: str) -> str | None:
        """Handle what has come, and ask for arming checks when it is time.

        Args:
            now_s: Present time.
            armed: Whether the vehicle is armed.
            intended: The intended mode, or the one that replaces it.

        Returns:
            The mode to change to, or None.
        """
        wanted = None
        if self.checks:
            self._count_misses(now_s)
            if now_s > self._asked_s + ASKED_EVERY_S + _SLACK_S:
                self._asked_s = now_s
                self._replied.clear()
                self._counted = False
                self._request = (self._request + 1) & 0xFF
                mask = sum(
                    1 << number for number, check in self.checks.items() if not check.unresponsive
                )
                request = {"request_id": self._request, "valid_registrations_mask": mask}
                self.out.append(("arming_check_request", request))
        requests = self._queues["register_ext_component_request"]
        if armed and not self.parameters["COM_MODE_ARM_CHK"]:
            if requests:
                request = requests.popleft()
                self._answer(request, arming_check_id=0, mode_id=0, mode_executor_id=0)
        else:
            # Modes that do not respond are forgotten, except the intended one.
            for state, mode in list(self.modes.items()):
                if self._is_silent(mode) and NAME_OF[state] != intended:
                    del self.checks[mode.check]
                    self._remove_executor(mode.executor)
                    del self.modes[state]
                    self.revision += 1
            for _ in range(_HANDLED_AT_ONCE):
                if wanted is None and requests:
                    wanted = self._register(requests.popleft())
            gone = self._queues["unregister_ext_component"]
            if wanted is None and gone:
                wanted = self._unregister(gone.popleft(), intended)
        return wanted

    # Reading

    def label(self, mode: str) -> str | None:
        """Return the name for people of a registered mode."""
        registered = self.modes.get(STATE_OF[mode])
        return None if registered is None else registered.name

    @property
    def in_charge(self) -> int:
        """Number of the executor in charge, 0 for none."""
        return NOBODY if self.failsafe_acts else self._in_charge

    def internal(self, mode: str) -> str:
        """Return the mode that a replacing mode replaces, or the mode itself: that is what a pilot intends."""
        registered = self.modes.get(STATE_OF[mode])
        if registered is None or registered.replaces == _NONE:
            return mode
        return NAME_OF.get(registered.replaces, mode)

    def flown(self, mode: str) -> str:
        """Return the mode that replaces an internal one and responds, or the mode itself."""
        for state, registered in self.modes.items():
            if registered.replaces == STATE_OF[mode]:
                return mode if self._is_silent(registered) else NAME_OF[state]
        return mode

    def fallbacks(self, mode: str) -> Iterator[Event]:
        """Yield, once, the event that an internal mode is flown because its replacement does not respond."""
        for registered in self.modes.values():
            silent = registered.replaces == STATE_OF[mode] and self._is_silent(registered)
            if silent and not registered.fallback_reported:
                registered.fallback_reported = True
                yield Event(event_id("commander_mode_fallback_internal"), _CRITICAL, bytes(40))

    def verdict(self, intended: str) -> ArmingVerdict:
        """Return what the checks say about every mode.

        Args:
            intended: The intended mode, or the one that replaces it.
        """
        needs = {
            name: frozenset[Need]() if state in self.modes else _UNREGISTERED
            for name, state in ((name, STATE_OF[name]) for name in EXTERNAL)
        }
        unarmable = {name for name, needed in needs.items() if needed}
        reasons: list[Event] = []
        if STATE_OF[intended] >= FIRST_STATE and STATE_OF[intended] not in self.modes:
            reasons.append(_arming_event("unavailable", _ERROR, 1 << STATE_OF[intended]))
        holds_all = False
        silent = 0
        for number in self.checks:
            reply = self._replies[number]
            # As in PX4: until a check has replied, its slot has an empty reply, which counts for check 0, or an old one
            check = self.checks.get(reply.registration_id)
            if check is None:
                continue
            struck = {NAME_OF[state] for state in (check.state, check.replaces) if state in NAME_OF}
            if check.unresponsive:
                silent |= 1 << check.state
                needs[NAME_OF[check.state]] |= _UNREGISTERED
                continue
            required = {need for name, need in _REQUIREMENTS.items() if getattr(reply, name)}
            if not reply.can_arm_and_run:
                required |= _UNREGISTERED
            needs |= dict.fromkeys(struck, frozenset(required))
            if not reply.can_arm_and_run or reply.mode_req_prevent_arming:
                unarmable |= struck
            holds_all = holds_all or not (reply.can_arm_and_run or struck)
            bits = sum(1 << STATE_OF[name] for name in struck) if struck else _EVERY_MODE
            # PX4 puts the modes into the first argument of a reply's events.
            for event in reply.events[: reply.num_events]:
                arguments = bits.to_bytes(4, "little") + bytes(event.arguments[4:])
                reasons.append(Event(event.id, event.log_levels, arguments.ljust(40, b"\0")))
        if silent:
            reasons.append(_arming_event("unresponsive", _CRITICAL, silent))
        return ArmingVerdict(needs, frozenset(unarmable), holds_all, tuple(reasons))

    def required(self, internal: Mapping[str, int]) -> list[int]:
        """Return what every mode needs, as FailsafeFlags has it: bits by mode for each requirement.

        Args:
            internal: The bits of PX4's own modes, in the order of the message.
        """
        bits = dict(internal)
        for state in range(FIRST_STATE, FIRST_STATE + len(EXTERNAL)):
            if state not in self.modes:
                bits["mode_req_other"] |= 1 << state
        for number in self.checks:
            reply = self._replies[number]
            check = self.checks.get(reply.registration_id)
            if check is None or check.state == _NONE:
                continue
            if check.unresponsive:
                bits["mode_req_other"] |= 1 << check.state
                continue
            if not reply.can_arm_and_run:
                bits["mode_req_other"] |= 1 << check.state
            for name in bits:
                wanted = getattr(reply, name, False)
                if wanted:
                    bits[name] |= 1 << check.state
                if check.replaces != _NONE and hasattr(reply, name):
                    bits[name] &= ~(1 << check.replaces)
                    bits[name] |= int(wanted) << check.replaces
        return list(bits.values())

    def charge(self, mode: str, *, by_user: bool) -> None:
        """Note a new intention: a mode's executor takes charge, and a user's other choice ends that."""
        registered = self.modes.get(STATE_OF[mode])
        if registered is not None and registered.executor != _NONE:
            self._in_charge = registered.executor
        elif by_user:
            self._in_charge = NOBODY

    def after_disarming(self, stored: str) -> str:
        """Return the mode after disarming: that of the executor in charge; Hold if it does not respond."""
        owned = self.executors.get(self._in_charge)
        mode = stored if owned is None else NAME_OF[owned]
        registered = self.modes.get(STATE_OF[mode])
        if registered is not None and self._is_silent(registered):
            mode = "HOLD"
        self.charge(mode, by_user=True)
        return mode

    # Arming checks

    def _count_misses(self, now_s: float) -> None:
        if self._counted or now_s <= self._asked_s + ANSWERED_WITHIN_S + _SLACK_S:
            return
        missing = [number for number in self.checks if number not in self._replied]
        if not missing:
            return
        self._counted = True
        for number in missing:
            check = self.checks[number]
            if check.unresponsive:
                continue
            check.misses += 1
            if check.misses <= (_MISSES if check.heard else _MISSES_AT_FIRST):
                continue
            if check.state == _NONE:
                del self.checks[number]
            else:
                check.unresponsive = True
                check.relapses += 1

    def _is_silent(self, mode: ExternalMode) -> bool:
        check = self.checks.get(mode.check)
        return check is not None and check.unresponsive

    # Registration

    def _register(self, request: Any) -> str | None:  # noqa: ANN401 - a record
        """Register what a request wants, or refuse all of it; return the mode to change to."""
        with_mode = request.register_mode
        with_check = request.register_arming_check
        with_executor = request.register_mode_executor
        replaces = request.replace_internal_mode if request.enable_replace_internal_mode else _NONE
        taken = {mode.replaces for mode in self.modes.values()} - {_NONE}
        refused = (
            (with_executor and not with_mode)
            or (with_mode and not with_check)
            or (with_check and len(self.checks) >= CHECKS_MOST)
            or (with_mode and (len(self.modes) >= len(EXTERNAL) or replaces in taken))
            or (with_executor and len(self.executors) >= EXECUTORS_MOST)
        )
        if refused:
            self._answer(request, arming_check_id=_NONE, mode_id=_NONE, mode_executor_id=_NONE)
            return None
        check = state = executor = _NONE
        if with_mode:
            state = FIRST_STATE + self._place(_text(request.name))
            self.modes[state] = ExternalMode(_text(request.name), replaces)
        if with_executor:
            executor = _free(self.executors, first=1)
            self.executors[executor] = state
            self.modes[state].executor = executor
        if with_check:
            check = _free(self.checks)
            self.checks[check] = ArmingCheck(state, replaces)
            self._replies.setdefault(check, _NO_REPLY)
            if with_mode:
                self.modes[state].check = check
        self.revision += 1
        self._answer(
            request,
            arming_check_id=check,
            mode_id=state,
            mode_executor_id=executor,
            success=True,
        )
        at_once = with_executor and with_mode and request.activate_mode_immediately
        return NAME_OF[state] if at_once else None

    def _answer(self, request: Any, **values: Any) -> None:  # noqa: ANN401 - as above
        reply = {
            "request_id": request.request_id,
            "name": request.name,
            "px4_ros2_api_version": _API_VERSION,
            **values,
        }
        self.out.append(("register_ext_component_reply", reply))

    def _place(self, name: str) -> int:
        """Return the place of a mode, the one that it had before, and keep the hash of its name there."""
        wanted = fnv1a(name)
        wanted -= (wanted & 1 << 31) << 1
        if wanted == 0:
            wanted = 1
        hashes = [int(self.parameters[f"COM_MODE{place}_HASH"]) for place in range(len(EXTERNAL))]
        free = [place for place in range(len(EXTERNAL)) if FIRST_STATE + place not in self.modes]
        unused = [place for place in free if hashes[place] == 0]
        if wanted in hashes:
            place = len(hashes) - 1 - hashes[::-1].index(wanted)
            if place in free:
                return place
            if unused:
                return unused[0]
            wanted = 0
        chosen = unused[0] if unused else free[0]
        self.parameters.set(f"COM_MODE{chosen}_HASH", wanted)
        return chosen

    def _unregister(self, request: Any, intended: str) -> str | None:  # noqa: ANN401 - as above
        check = self.checks.get(request.arming_check_id)
        if check is not None and check.state == request.mode_id:
            del self.checks[request.arming_check_id]
        mode = self.modes.get(request.mode_id)
        if mode is not None and mode.name == _text(request.name):
            del self.modes[request.mode_id]
            self._remove_executor(request.mode_executor_id)
            self.revision += 1
        return "HOLD" if STATE_OF[intended] == request.mode_id else None

    def _remove_executor(self, number: int) -> None:
        if self.executors.pop(number, None) is not None and self._in_charge == number:
            self._in_charge = NOBODY


def _free(taken: Mapping[int, Any], first: int = 0) -> int:
    number = first
    while number in taken:
        number += 1
    return number


def _text(name: tuple[int, ...]) -> str:
    """Return the text in a fixed field, whose last byte PX4 clears."""
    return bytes(name[:-1]).split(b"\0")[0].decode(errors="replace")


def _arming_event(name: str, levels: int, modes: int) -> Event:
    """Return PX4's own event about modes, with its arguments: the modes and the health component."""
    arguments = modes.to_bytes(4, "little") + bytes((_SYSTEM,))
    return Event(event_id(f"check_external_modes_{name}"), levels, arguments.ljust(40, b"\0"))


_NO_REPLY: Final = message_type("ArmingCheckReply").read(message_type("ArmingCheckReply").encoded())
