"""PX4's flight log: a ULog of the topics of `topics.py`, of texts and of parameters.

As PX4's simulation does with its default SDLOG_MODE = 1, it begins at the boot and ends at disarming; the next one
begins at arming. A client may also stream a log of its own (`protocols.log_stream`).
"""

from __future__ import annotations

import struct
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final

from sitl_mock.logs import ulog
from sitl_mock.logs.parameters import LoggedParameters
from sitl_mock.protocols import ParamKind
from sitl_mock.px4.topics import LOGGED, STEP_MS
from sitl_mock.telemetry.px4 import is_logged

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sitl_mock.logs import LogBook
    from sitl_mock.telemetry import Report

_STEP_S: Final = STEP_MS * 1e-3
_PERIOD: Final = 20
"""Steps until the topics repeat."""
_DUE: Final = tuple(
    tuple(
        (source.topic.pack, source.build) for source in LOGGED.values() if step % source.every == 0
    )
    for step in range(_PERIOD)
)
"""Packing and builder of the topics of each step."""
_ON_CHANGE: Final = (LOGGED["vehicle_status"], LOGGED["vehicle_land_detected"])
"""Topics that PX4 also writes when arming, mode or landing change."""
_RELEASE: Final = 255


class Px4FlightLog:
    """Writes the logs of one boot.

    Args:
        book: The vehicle's logs.
    """

    def __init__(self, book: LogBook) -> None:
        self._book = book
        self._next_s = -1.0
        self._step = 0
        self._armed = False
        self._status: tuple[bool, int, int] | None = None
        self._parameters = LoggedParameters()

    def tick(self, report: Report) -> None:
        """Write what is due; called every 20 ms."""
        state = report.state
        # The log begins or ends at the boot, at arming and at disarming.
        if self._step == 0 or state.armed != self._armed:
            self._armed = state.armed
            if not is_logged(state):
                self._book.end()
            elif self._book.running is None:
                head = b"".join(self.head(report))
                # The date and time, or the next free second.
                began = datetime.fromtimestamp(report.unix_us * 1e-6, UTC)
                while (path := f"/log/{began:%Y-%m-%d}/{began:%H_%M_%S}.ulg") in self._book.files:
                    began += timedelta(seconds=1)
                self._book.begin(path, report.unix_us * 1e-6, head)
        if state.now_s < self._next_s - 1e-9:
            return
        self._next_s = max(self._next_s + _STEP_S, state.now_s)
        if self._book.is_open:
            number = self._step % _PERIOD
            status = (state.armed, report.commander.custom_mode, report.commander.landed_state)
            is_new = status != self._status
            self._status = status
            # None of this step if a huge setpoint overflows a float.
            try:
                messages = [pack(*build(report)) for pack, build in _DUE[number]]
                if is_new:
                    messages += [
                        source.topic.pack(*source.build(report))
                        for source in _ON_CHANGE
                        if number % source.every
                    ]
            except (OverflowError, ValueError, struct.error):
                messages = []
            changed = self._parameters.changed(state.parameters)
            messages += [_parameter(report, name) for name in changed]
            self._write(report, messages)
        self._step += 1

    def say(self, report: Report, severity: int, text: str) -> None:
        """Write a text."""
        if self._book.is_open:
            self._write(report, [ulog.logged_text(report.boot_us, severity, text)])

    def head(self, report: Report) -> list[bytes]:
        """Return the beginning of a log: definitions, parameters and subscriptions, the file's header first."""
        identity = report.flavour.identity(report.state.system_id)
        major, minor, patch = identity.version
        release = major << 24 | minor << 16 | patch << 8 | _RELEASE
        state = report.state
        self._parameters.remember(state.parameters)
        return [
            ulog.header(report.boot_us),
            ulog.flags(),
            ulog.information("char", "ver_sw", identity.commit[::-1].hex()),
            ulog.information("uint32_t", "ver_sw_release", release),
            ulog.information("char", "ver_hw", "PX4_SITL"),
            ulog.information("char", "sys_name", "PX4"),
            ulog.information("uint32_t", "ver_data_format", 2),
            ulog.information("int32_t", "time_ref_utc", 0),
            ulog.information("uint64_t", "boot_time_utc_us", report.unix_us - report.boot_us),
            *(ulog.topic_format(source.topic) for source in LOGGED.values()),
            *(_parameter(report, name) for name in state.parameters.names),
            *(ulog.subscription(source.topic) for source in LOGGED.values()),
        ]

    def _write(self, report: Report, messages: Sequence[bytes]) -> None:
        self._book.add(report.unix_us * 1e-6, b"".join(messages))
        if self._book.listener is not None:
            self._book.listener(messages)


def _parameter(report: Report, name: str) -> bytes:
    parameters = report.state.parameters
    whole = parameters.definitions[name].kind is not ParamKind.REAL32
    return ulog.parameter(name, parameters[name], whole=whole)
