"""The largest age of each value that a safety rule reads, and the consequence of a larger one.

The rules take their limits from here, and `AGES` is the table of docs/explanation/when-things-fail.md. An age counts
from the measurement (`VehicleState.age_s`) or, where a message has no stamp of its own, from its arrival.
"""

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

from guidance import messages
from guidance.boot_clock import LATE_TELEMETRY_S, OFFSET_DRIFT
from guidance.messages import Attitude, Heartbeat, Home, LandedState, LocalPosition, SystemStatus
from guidance.vehicle import VehicleState

HEARTBEAT_LIMIT_S: Final = 3.0
TELEMETRY_LIMIT_S: Final = 1.0

STATUS_LIMIT_S: Final = 3.0
"""SYS_STATUS comes twice a second: its pre-arm check and charge bar an order when it is older."""

CHARGE_LIMIT_S: Final = 10.0
"""A charge that was known and is older than this in flight is unknown, and the vehicle returns or lands. No pack loses
more than a few percent in this time, and a link that loses half of all frames still delivers one of twenty."""

HEIGHT_ERROR_LIMIT_S: Final = 5.0
MAP_LIMIT_S: Final = 2.0
PLACE_LIMIT_S: Final = 10.0
"""Home and origin are requested again every two seconds until a flight is accepted."""


class Needed(NamedTuple):
    """The largest age of a message for an order to start or to engage, and advice where it is older."""

    limit_s: float
    advice: str


NEEDED: Final[Mapping[type[messages.Message], Needed]] = {
    Heartbeat: Needed(HEARTBEAT_LIMIT_S, "check the vehicle's power and the link"),
    LocalPosition: Needed(
        TELEMETRY_LIMIT_S,
        "wait for the estimator's position; check that LOCAL_POSITION_NED is streamed",
    ),
    Attitude: Needed(TELEMETRY_LIMIT_S, "check that ATTITUDE is streamed"),
    LandedState: Needed(2.0 * TELEMETRY_LIMIT_S, "check that EXTENDED_SYS_STATE is streamed"),
    Home: Needed(PLACE_LIMIT_S, "wait for a position fix: home is set with it"),
    SystemStatus: Needed(STATUS_LIMIT_S, "check that SYS_STATUS is streamed"),
}
"""Messages that an order to start needs."""

_PREFLIGHT: Final[Mapping[type[messages.Message], float]] = {
    **{kind: needed.limit_s for kind, needed in NEEDED.items()},
    messages.GlobalPosition: MAP_LIMIT_S,
    messages.Origin: PLACE_LIMIT_S,
}


def known(vehicle: VehicleState, now_s: float) -> VehicleState:
    """Return a vehicle's state without messages that are too old for preflight."""
    fixed = {Home, messages.Origin} if vehicle.home_fixed else set()
    latest = {
        kind: message
        for kind, message in vehicle.latest.copy().items()
        if kind in fixed or vehicle.age_s(kind, now_s) <= _PREFLIGHT.get(kind, math.inf)
    }
    return vehicle._replace(latest=latest)


MATE_SILENT_S: Final = 0.5
"""A mate that is silent for longer is somewhere in a disc that grows with its top speed."""

HOLD_S: Final = 2.0
"""A mate nearby that is silent for longer pauses the game."""

FORGOTTEN_S: Final = 10.0
"""A mate that is silent for longer is left out."""


class Age(NamedTuple):
    """One row of the table: a value, its message, and what happens on the ground and in flight when it is old."""

    value: str
    message: str
    before: str
    in_flight: str


AGES: Final = (
    Age(
        "mode, armed or not",
        "HEARTBEAT",
        f"{HEARTBEAT_LIMIT_S:g} s: not ready",
        f"{HEARTBEAT_LIMIT_S:g} s: *yielded*; while standing by *out of contact*",
    ),
    Age(
        "position, velocity",
        "LOCAL_POSITION_NED",
        f"{TELEMETRY_LIMIT_S:g} s: not ready",
        f"{TELEMETRY_LIMIT_S:g} s: *yielded*; while standing by *out of contact*. No setpoint uses an older one",
    ),
    Age(
        "delay of the telemetry",
        "TIMESYNC",
        f"grows by {1e3 * OFFSET_DRIFT:g} ms for every second without an answer; over {LATE_TELEMETRY_S:g} s not ready",
        f"the same; over {LATE_TELEMETRY_S:g} s the autopilot's hold",
    ),
    Age(
        "heading",
        "ATTITUDE",
        f"{TELEMETRY_LIMIT_S:g} s: not ready, not engaged",
        "read once, as the game begins",
    ),
    Age(
        "on the ground or not",
        "EXTENDED_SYS_STATE",
        f"{2.0 * TELEMETRY_LIMIT_S:g} s: not ready",
        f"{2.0 * TELEMETRY_LIMIT_S:g} s: counts as in the air; no take-off is requested",
    ),
    Age(
        "the autopilot's own pre-arm check",
        "SYS_STATUS",
        f"{STATUS_LIMIT_S:g} s: not ready, not armed",
        "not read",
    ),
    Age(
        "charge",
        "SYS_STATUS",
        f"{STATUS_LIMIT_S:g} s: not ready, not engaged",
        f"{CHARGE_LIMIT_S:g} s after the last known charge: return, and land in the climb. "
        "A charge that was never known is not waited for",
    ),
    Age(
        "home",
        "HOME_POSITION",
        f"{PLACE_LIMIT_S:g} s: not ready",
        "fixed when the flight is accepted; a later one is reported and not used",
    ),
    Age(
        "origin of the local frame",
        "GPS_GLOBAL_ORIGIN",
        f"{PLACE_LIMIT_S:g} s: preflight refuses",
        "stays; another one is accepted if GLOBAL_POSITION_INT agrees with it",
    ),
    Age(
        "place on the map",
        "GLOBAL_POSITION_INT",
        f"{MAP_LIMIT_S:g} s: preflight refuses",
        "1 s: not compared with a moved origin, which is then believed",
    ),
    Age(
        "error of the height",
        "ESTIMATOR_STATUS",
        "not read",
        f"{HEIGHT_ERROR_LIMIT_S:g} s: counts as the largest one that is allowed for. "
        "One that was never known counts as none",
    ),
    Age(
        "the setpoint that the autopilot flies",
        "POSITION_TARGET_LOCAL_NED",
        "preflight warns below 1 Hz",
        "without it another program is noticed by its mode change only",
    ),
    Age(
        "the autopilot's wait for setpoints, its other parameters and its uploaded fence",
        "PARAM_VALUE, MISSION_ITEM_INT",
        "preflight refuses what was never read",
        "read again for every order to engage; without an answer not engaged",
    ),
    Age(
        "the evader",
        "its reports",
        "`evader.timeout_s`: not engaged",
        "`evader.timeout_s`: *paused*, then the autopilot's hold",
    ),
    Age(
        "a mate of the team",
        "its states",
        "not read",
        f"{MATE_SILENT_S:g} s: it may be anywhere that it can have reached; {HOLD_S:g} s and nearby: *paused*; "
        f"{FORGOTTEN_S:g} s: left out",
    ),
    Age(
        "another aircraft, in a team",
        "ADSB_VEHICLE",
        "not read",
        f"{MATE_SILENT_S:g} s: it may be anywhere that it can have reached; {FORGOTTEN_S:g} s: left out",
    ),
    Age(
        "the operator",
        "orders, `alive`, an open page",
        "not read",
        "`flight.operator_timeout_s`: the autopilot's hold, then return",
    ),
)
"""Every value that a safety rule reads."""
