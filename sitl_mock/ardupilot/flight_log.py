"""ArduPilot's flight log: a DataFlash file with the records that the mock has values for.

As ArduPilot 4.5.7 does: the log begins at arming and goes on for 15 s after disarming. The next arming continues it,
unless LOG_FILE_DSRMROT is 1, which begins a new one. LOG_DISARMED = 1 also logs before arming.
"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, Final, cast

from sitl_mock.dynamics import Kind as SetpointKind
from sitl_mock.logs.dataflash import FMT, RecordKind
from sitl_mock.logs.parameters import LoggedParameters

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sitl_mock.ardupilot.commander import ArduPilot
    from sitl_mock.logs import LogBook
    from sitl_mock.telemetry import Report

_STEP_S: Final = 0.1
_LINGER_S: Final = 15.0
_GPS_STEPS: Final = 2
_BY_COMMAND: Final = 2
_DISARMED_EVENT: Final = 11
_ARMED_EVENT: Final = 10
_FLYING = "flying"
_MAYBE_LANDED = "maybe landed"
_LANDED = "landed"
_MAYBE_LANDED_S: Final = 0.2
_LANDED_S: Final = 1.0
_EVENTS_OF_LANDING: Final[Mapping[tuple[str, str], tuple[int, ...]]] = {
    (_LANDED, _FLYING): (15, 28),  # AUTO_ARMED, NOT_LANDED
    (_FLYING, _MAYBE_LANDED): (17,),  # LAND_COMPLETE_MAYBE
    (_FLYING, _LANDED): (17, 18),
    (_MAYBE_LANDED, _LANDED): (18,),  # LAND_COMPLETE
}
_POSITION_TARGET: Final = 3
_VELOCITY_TARGET: Final = 4
_WEEK_S: Final = 604_800
_GPS_EPOCH_S: Final = 315_964_800 - 18

PARM: Final = RecordKind(32, "PARM", "QNff", "TimeUS,Name,Value,Default")
MSG: Final = RecordKind(59, "MSG", "QZ", "TimeUS,Message")
MODE: Final = RecordKind(118, "MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn")
EV: Final = RecordKind(181, "EV", "QB", "TimeUS,Id")
ARM: Final = RecordKind(186, "ARM", "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method")
ORGN: Final = RecordKind(71, "ORGN", "QBLLe", "TimeUS,Type,Lat,Lng,Alt")
ATT: Final = RecordKind(
    70, "ATT", "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"
)
POS: Final = RecordKind(72, "POS", "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt")
XKF1: Final = RecordKind(
    44,
    "XKF1",
    "QBccCfffffffccce",
    "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH",
)
BAT: Final = RecordKind(
    86, "BAT", "QBfffffcfBBB", "TimeUS,Inst,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res,RemPct,H,SH"
)
GPS: Final = RecordKind(
    90,
    "GPS",
    "QBBIHBcLLeffffB",
    "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U",
)
GUIP: Final = RecordKind(
    8, "GUIP", "QBfffbffffff", "TimeUS,Type,pX,pY,pZ,Terrain,vX,vY,vZ,aX,aY,aZ"
)
_AXES: Final = tuple(
    RecordKind(
        number,
        f"PSC{axis}",
        "Qffffffff",
        f"TimeUS,TP{axis},P{axis},DV{axis},TV{axis},V{axis},DA{axis},TA{axis},A{axis}",
    )
    for number, axis in enumerate("NED", start=188)
)
"""Position control along north, east and down: target and estimate of position, velocity and acceleration."""
_KINDS: Final = (FMT, PARM, MSG, MODE, EV, ARM, ORGN, ATT, POS, XKF1, BAT, GPS, GUIP, *_AXES)


class ArduPilotFlightLog:
    """Writes the logs of one boot.

    Args:
        book: The vehicle's logs.
    """

    def __init__(self, book: LogBook) -> None:
        self._book = book
        self._next_s = -1.0
        self._step = 0
        self._armed = False
        self._disarmed_s = -math.inf
        self._landing = _LANDED
        self._mode = -1
        self._parameters = LoggedParameters()

    def tick(self, report: Report) -> None:
        """Write what is due; called every 20 ms."""
        state = report.state
        if state.armed != self._armed:
            self._armed = state.armed
            now_us = report.boot_us
            if state.armed:
                self._decide(report)
                self._write(report, ARM.pack(now_us, 1, 1, 0, 1) + EV.pack(now_us, _ARMED_EVENT))
            else:
                self._disarmed_s = state.now_s
                method = cast("ArduPilot", report.commander).disarmed_by
                self._write(report, ARM.pack(now_us, 0, 0, 0, method))
                self._write(report, EV.pack(now_us, _DISARMED_EVENT))
                if state.parameters.get("LOG_FILE_DSRMROT", 0) == 1:
                    self._disarmed_s = -math.inf
                    self._book.end()
        landing = _landing_of(report)
        if landing != self._landing:
            events = _EVENTS_OF_LANDING.get((self._landing, landing), ())
            self._landing = landing
            if self._writes(report):
                self._write(report, b"".join(EV.pack(report.boot_us, event) for event in events))
        if state.now_s < self._next_s - 1e-9:
            return
        self._next_s = max(self._next_s + _STEP_S, state.now_s)
        self._decide(report)
        if self._writes(report):
            state = report.state
            now_us = report.boot_us
            records = []
            mode = report.commander.custom_mode
            if mode != self._mode:
                self._mode = mode
                records.append(MODE.pack(now_us, mode, mode, _BY_COMMAND))
            changed = self._parameters.changed(state.parameters)
            records += [_parameter(report, name) for name in changed]
            # The motion; not when a huge setpoint overflows a float.
            try:
                motion = _motion(report)
                if self._step % _GPS_STEPS == 0:
                    motion.append(_receiver(report))
                if report.setpoint.kind is SetpointKind.STREAM:
                    motion.append(_target(report))
                records += motion
            except (OverflowError, ValueError, struct.error):
                pass
            self._write(report, b"".join(records))
        self._step += 1

    def say(self, report: Report, severity: int, text: str) -> None:  # noqa: ARG002 - PX4's has one
        """Write a text."""
        if self._writes(report):
            self._decide(report)
            self._write(report, MSG.pack(report.boot_us, text.encode()))

    def head(self, report: Report) -> Sequence[bytes]:  # noqa: ARG002 - PX4's has one
        """Return nothing: no client can have this log streamed."""
        return ()

    def _writes(self, report: Report) -> bool:
        """True while armed, for some seconds after it, or always with LOG_DISARMED."""
        state = report.state
        if not int(state.parameters["LOG_BACKEND_TYPE"]) & 1:
            return False
        lingers = state.now_s - self._disarmed_s < _LINGER_S
        return state.armed or lingers or state.parameters.get("LOG_DISARMED", 0) == 1

    def _decide(self, report: Report) -> None:
        if self._book.running is None and self._writes(report):
            # A log begins with the kinds of records, the parameters, the version, and the places of origin and home.
            numbers = [int(log.path[-12:-4]) for log in self._book.logs]
            number = max(numbers, default=0) + 1
            state = report.state
            major, minor, patch = report.flavour.identity(state.system_id).version
            title = report.flavour.title.split(maxsplit=1)[0]
            now_us = report.boot_us
            self._parameters.remember(state.parameters)
            head = [kind.definition for kind in _KINDS]
            head += [_parameter(report, name) for name in state.parameters.names]
            head.append(MSG.pack(now_us, f"{title} V{major}.{minor}.{patch}".encode()))
            if state.home_m is not None:
                head.append(ORGN.pack(now_us, 0, *state.frame.origin))
                head.append(ORGN.pack(now_us, 1, *state.frame.to_geodetic(*state.home_m)))
            self._mode = -1
            self._book.begin(f"/logs/{number:08}.BIN", report.unix_us * 1e-6, b"".join(head))

    def _write(self, report: Report, records: bytes) -> None:
        self._book.add(report.unix_us * 1e-6, records)


def _landing_of(report: Report) -> str:
    """Return what a copter's land detector says; a rover never leaves the ground."""
    state = report.state
    if report.flavour.ground_vehicle or not state.armed or not state.flew:
        return _LANDED
    if not state.on_ground or state.standing_s < _MAYBE_LANDED_S:
        return _FLYING
    return _LANDED if state.standing_s >= _LANDED_S else _MAYBE_LANDED


def _parameter(report: Report, name: str) -> bytes:
    parameters = report.state.parameters
    default = parameters.definitions[name].default
    return PARM.pack(report.boot_us, name.encode(), parameters[name], default)


def _motion(report: Report) -> list[bytes]:
    """Return attitude, position, estimate, battery, and position control along each axis."""
    state = report.state
    now_us = report.boot_us
    roll, pitch, yaw, _, _, _ = state.attitude
    roll_deg = math.degrees(roll)
    pitch_deg = math.degrees(pitch)
    yaw_deg = math.degrees(yaw) % 360.0
    battery = state.battery
    voltage_v = battery.voltage_v
    records = [
        ATT.pack(now_us, roll_deg, roll_deg, pitch_deg, pitch_deg, yaw_deg, yaw_deg, 0.0, 0.0, 3),
        POS.pack(now_us, *report.place, report.relative_m, -state.position_m[2]),
        XKF1.pack(
            *(now_us, 0, roll_deg, pitch_deg, yaw_deg),
            *(*state.velocity_m_s, state.velocity_m_s[2]),
            *(*state.position_m, 0.0, 0.0, 0.0, state.frame.origin.alt_amsl_m),
        ),
        BAT.pack(
            *(now_us, 0, voltage_v, voltage_v, battery.current_a, battery.consumed_mah),
            *(battery.consumed_mah * voltage_v * 1e-3, 0.0, 0.0, round(battery.remaining * 100.0)),
            *(1, 0),
        ),
    ]
    setpoint = report.setpoint
    acceleration_m_s2 = state.body.acceleration_ned_m_s2
    for axis, kind in enumerate(_AXES):
        place_m = _or(setpoint.position_ned_m[axis], state.position_m[axis])
        speed_m_s = _or(setpoint.velocity_ned_m_s[axis], 0.0)
        push_m_s2 = _or(setpoint.acceleration_ned_m_s2[axis], acceleration_m_s2[axis])
        records.append(
            kind.pack(
                *(now_us, place_m, state.position_m[axis], speed_m_s, speed_m_s),
                *(state.velocity_m_s[axis], push_m_s2, push_m_s2, acceleration_m_s2[axis]),
            )
        )
    return records


def _receiver(report: Report) -> bytes:
    state = report.state
    fix = state.sensors.fix
    lat, lon, alt = state.frame.to_geodetic(*fix.position_m)
    north, east, down = fix.velocity_m_s
    since_s = report.unix_us * 1e-6 - _GPS_EPOCH_S
    course_deg = math.degrees(math.atan2(east, north)) % 360.0
    works = state.estimator.gps_ok
    return GPS.pack(
        *(report.boot_us, 0, report.flavour.fix_type if works else 0),
        *(int(since_s % _WEEK_S * 1000.0), int(since_s // _WEEK_S), 10 if works else 0, 1.21),
        *(lat, lon, alt, math.hypot(north, east), course_deg, down, 0.0, 1),
    )


def _target(report: Report) -> bytes:
    """The streamed target in centimetres, up positive, as ArduCopter logs it; axes that are left free are 0."""
    setpoint = report.setpoint
    placed = not math.isnan(setpoint.position_ned_m[0])
    kind = _POSITION_TARGET if placed else _VELOCITY_TARGET
    columns = []
    for north, east, down in (
        setpoint.position_ned_m,
        setpoint.velocity_ned_m_s,
        setpoint.acceleration_ned_m_s2,
    ):
        columns += [_or(north, 0.0) * 100.0, _or(east, 0.0) * 100.0, _or(-down, 0.0) * 100.0]
    return GUIP.pack(report.boot_us, kind, *columns[:3], 0, *columns[3:])


def _or(value: float, otherwise: float) -> float:
    return otherwise if math.isnan(value) else value
