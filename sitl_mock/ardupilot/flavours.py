"""The ArduPilot flavours, and the packed files of parameters and plans that ground stations fetch.

Formats: ``AP_Filesystem_Param`` (0x671B, with defaults 0x671C) and ``AP_Filesystem_Mission`` (0x763D) of ArduPilot 4.5.
``@SYS`` lists and has what it lists and has in ArduPilot's own simulation.
"""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final

from sitl_mock.ardupilot.commander import ArduPilot
from sitl_mock.ardupilot.copter import COPTER
from sitl_mock.ardupilot.flight_log import ArduPilotFlightLog
from sitl_mock.ardupilot.modes import COPTER_MODES, ROVER_MODES
from sitl_mock.ardupilot.rover import ROVER
from sitl_mock.dynamics import ARDUCOPTER_TRAVEL, ArduGains, Rover, Vehicle, arducopter_quadrotor
from sitl_mock.parameters import parameters_of
from sitl_mock.protocols import (
    ARDUPILOT_HZ,
    ARDUPILOT_LOG_RULES,
    ARDUPILOT_MISSION_RULES,
    ARDUPILOT_PARAMETER_RULES,
    ARDUPILOT_STREAM_RULES,
    QUIET_HZ,
    Entry,
    FileTree,
    FtpError,
    ParamKind,
    PlanKind,
    PlanStore,
    Storage,
    ardupilot_identity,
)
from sitl_mock.vehicle.estimator import ARDUPILOT_WANDER
from sitl_mock.vehicle.flavour import Flavour
from sitl_mock.vehicle.sensors import ARDUPILOT_SENSORS
from sitl_mock.vehicle.state import ARDUPILOT_PACK

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sitl_mock.protocols import ParameterStore
    from sitl_mock.vehicle.state import VehicleState

_PARAMETERS = 0x671B
_WITH_DEFAULTS = 0x671C
_HAS_DEFAULT = 0x10
_ITEMS = 0x763D
_EEPROM_BYTES: Final = 16384
_LISTED_BYTES: Final = 100_000
_SYS: Final = (
    *(
        Entry(name, _LISTED_BYTES)
        for name in (
            "threads.txt",
            "tasks.txt",
            "dma.txt",
            "memory.txt",
            "uarts.txt",
            "timers.txt",
            "can_log.txt",
            "can0_stats.txt",
            "can1_stats.txt",
            "crash_dump.bin",
        )
    ),
    Entry("storage.bin", _EEPROM_BYTES),
)
"""What ``@SYS`` lists; in the simulation only tasks.txt and storage.bin can be read."""
_TYPES: Final = {
    ParamKind.INT8: (1, "<b"),
    ParamKind.INT16: (2, "<h"),
    ParamKind.INT32: (3, "<i"),
    ParamKind.REAL32: (4, "<f"),
}
_ITEM: Final = struct.Struct("<ffffiifHHBBBBBB")
_IS_A_FOLDER: Final = 21  # EISDIR: ArduPilot unlinks a folder as it does a file
_NAMES: Final = {
    PlanKind.MISSION: "mission.dat",
    PlanKind.FENCE: "fence.dat",
    PlanKind.RALLY: "rally.dat",
}


def ardupilot_files(parameters: ParameterStore, plans: PlanStore, storage: Storage) -> FileTree:
    """Return the files of one vehicle."""
    hidden: dict[str, Callable[[str], bytes]] = {
        "@PARAM/param.pck": partial(packed_parameters, parameters),
        "@SYS/tasks.txt": lambda _query: b"TasksV2\n",
        "@SYS/storage.bin": lambda _query: bytes(_EEPROM_BYTES),
    }
    for kind, name in _NAMES.items():
        hidden[f"@MISSION/{name}"] = partial(packed_plan, plans, kind)
    return FileTree(
        {},
        frozenset({"/terrain"}),
        hidden,
        {"@SYS": _SYS},
        unopened=FtpError.FILE_NOT_FOUND,
        full_folder=_IS_A_FOLDER,
        storage=storage,
    )


def packed_parameters(parameters: ParameterStore, query: str = "") -> bytes:
    """Return the content of ``@PARAM/param.pck``: the parameters, with common name prefixes packed.

    Args:
        parameters: The vehicle's parameters.
        query: ``start=10&count=5`` for a part, ``withdefaults=1`` for the defaults of those that differ from them.
    """
    options = dict(part.partition("=")[::2] for part in query.split("&"))
    start = _whole(options.get("start"))
    count = _whole(options.get("count"))
    names = parameters.names[start : start + count if count else None]
    with_defaults = options.get("withdefaults") == "1"
    magic = _WITH_DEFAULTS if with_defaults else _PARAMETERS
    packed = [struct.pack("<HHH", magic, len(names), len(parameters.names))]
    last = ""
    for name in names:
        kind, form = _TYPES[parameters.definitions[name].kind]
        # Letters shared with the last name are not repeated; at least one letter is sent.
        common = 0
        while common < min(len(name) - 1, 15) and name[common] == last[common : common + 1]:
            common += 1
        suffix = name[common:].encode()
        values = [parameters[name]]
        if with_defaults and parameters[name] != parameters.default_of(name):
            kind |= _HAS_DEFAULT
            values.append(parameters.default_of(name))
        packed.append(bytes((kind, len(suffix) - 1 << 4 | common)) + suffix)
        packed += [struct.pack(form, value) for value in values]
        last = name
    return b"".join(packed)


def _whole(text: str | None) -> int:
    return int(text) if text is not None and text.isdecimal() else 0


def packed_plan(plans: PlanStore, kind: PlanKind, _query: str = "") -> bytes:
    """Return the content of ``@MISSION/mission.dat`` for a plan: a header and MISSION_ITEM_INT payloads."""
    items = plans.plans[kind].items
    packed = [struct.pack("<HHHHH", _ITEMS, kind, 0, 0, len(items))]
    for item in items:
        p1 = item.param1
        p2 = item.param2
        p3 = item.param3
        p4 = item.param4
        ids = (item.seq, item.command, 0, 0, item.frame, item.current, item.autocontinue, kind)
        packed.append(_ITEM.pack(p1, p2, p3, p4, item.x, item.y, item.z, *ids))
    return b"".join(packed)


_GAINS: Final = {
    "xy_p_1_s": "PSC_POSXY_P",
    "z_p_1_s": "PSC_POSZ_P",
    "xy_vel_p_1_s": "PSC_VELXY_P",
    "xy_vel_i_1_s2": "PSC_VELXY_I",
    "xy_vel_d": "PSC_VELXY_D",
    "z_vel_p_1_s": "PSC_VELZ_P",
    "jerk_m_s3": "PSC_JERK_XY",
    "jerk_z_m_s3": "PSC_JERK_Z",
}


def copter_plant(parameters: Mapping[str, float]) -> Vehicle:
    """The quadrotor; its own motions keep the WPNAV_* speeds, GUIDED only the accelerations (measured)."""
    travel = replace(
        ARDUCOPTER_TRAVEL,
        speed_m_s=float(parameters["WPNAV_SPEED"]) * 0.01,
        climb_m_s=float(parameters["WPNAV_SPEED_UP"]) * 0.01,
        sink_m_s=float(parameters["WPNAV_SPEED_DN"]) * 0.01,
        accel_m_s2=float(parameters["WPNAV_ACCEL"]) * 0.01,
        accel_z_m_s2=float(parameters["WPNAV_ACCEL_Z"]) * 0.01,
    )
    lean_deg = float(parameters["PSC_ANGLE_MAX"])
    if lean_deg == 0.0:
        lean_deg = float(parameters["ANGLE_MAX"]) * 0.01
    gains = ArduGains(
        accel_m_s2=travel.accel_m_s2,
        accel_z_m_s2=travel.accel_z_m_s2,
        lean_max_rad=math.radians(lean_deg),
        yaw_rate_max_rad_s=math.radians(float(parameters["ATC_SLEW_YAW"]) * 0.01),
        **{name: float(parameters[parameter]) for name, parameter in _GAINS.items()},
    )
    return arducopter_quadrotor(gains, travel)


_ROVER_ACCEL_M_S2: Final = 2.0
_ROVER_TURN_RATE_DEG_S: Final = 90.0


def rover_plant(parameters: Mapping[str, float]) -> Vehicle:
    """The rover; GUIDED velocities may exceed CRUISE_SPEED."""
    accel_m_s2 = float(parameters["ATC_ACCEL_MAX"])
    if accel_m_s2 == 0.0:
        accel_m_s2 = _ROVER_ACCEL_M_S2
    turn_rate_deg_s = float(parameters["ATC_STR_RAT_MAX"])
    if turn_rate_deg_s == 0.0:
        turn_rate_deg_s = _ROVER_TURN_RATE_DEG_S
    return Rover(accel_m_s2=accel_m_s2, turn_rate_max_rad_s=math.radians(turn_rate_deg_s))


def copter_commander(state: VehicleState, plans: PlanStore) -> ArduPilot:
    """An ArduCopter."""
    return ArduPilot(state, plans, COPTER)


def rover_commander(state: VehicleState, plans: PlanStore) -> ArduPilot:
    """A Rover."""
    return ArduPilot(state, plans, ROVER)


_RATES: Final = {"onboard": ARDUPILOT_HZ, "gcs": ARDUPILOT_HZ, "quiet": QUIET_HZ}

_WITHHELD: Final = frozenset(
    {
        "AVAILABLE_MODES",
        "PROTOCOL_VERSION",
        "FLIGHT_INFORMATION",
        "STORAGE_INFORMATION",
        "HIGHRES_IMU",
        "ALTITUDE",
        "CURRENT_MODE",
        "ESTIMATOR_STATUS",
        "ODOMETRY",
        "PING",
    }
)
"""Messages that ArduPilot 4.5.7 does not know; a request of one fails."""

_TRUSTED_LINKS: Final = frozenset({0})
"""ArduPilot's first link is meant for a USB cable, and takes every frame."""

ARDUCOPTER: Final = Flavour(
    name="arducopter",
    title="ArduCopter 4.5 quadrotor",
    autopilot=3,
    vehicle_type=2,
    modes=COPTER_MODES,
    parameters=parameters_of("arducopter"),
    parameter_rules=ARDUPILOT_PARAMETER_RULES,
    stream_rules=ARDUPILOT_STREAM_RULES,
    mission_rules=ARDUPILOT_MISSION_RULES,
    log_rules=ARDUPILOT_LOG_RULES,
    rates_hz=_RATES,
    identity=ardupilot_identity,
    plant=copter_plant,
    commander=copter_commander,
    recorder=ArduPilotFlightLog,
    wander=ARDUPILOT_WANDER,
    ready_s=39.0,
    texts=True,
    fix_type=6,
    pack=ARDUPILOT_PACK,
    sensors=ARDUPILOT_SENSORS,
    files=ardupilot_files,
    withheld=_WITHHELD,
    trusted_links=_TRUSTED_LINKS,
)

ROVER_FLAVOUR: Final = Flavour(
    name="rover",
    title="ArduPilot Rover 4.5",
    autopilot=3,
    vehicle_type=10,
    modes=ROVER_MODES,
    parameters=parameters_of("rover"),
    parameter_rules=ARDUPILOT_PARAMETER_RULES,
    stream_rules=ARDUPILOT_STREAM_RULES,
    mission_rules=ARDUPILOT_MISSION_RULES,
    log_rules=ARDUPILOT_LOG_RULES,
    rates_hz=_RATES,
    identity=ardupilot_identity,
    plant=rover_plant,
    commander=rover_commander,
    recorder=ArduPilotFlightLog,
    wander=ARDUPILOT_WANDER,
    ready_s=20.0,
    texts=True,
    fix_type=6,
    pack=ARDUPILOT_PACK,
    sensors=ARDUPILOT_SENSORS,
    files=ardupilot_files,
    withheld=_WITHHELD,
    trusted_links=_TRUSTED_LINKS,
    ground_vehicle=True,
)
