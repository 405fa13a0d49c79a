"""Draws each flight from a seed and a number: geometry, autopilot, game, wind and faults.

Every flight is short: it is low and near its start, and it ends in the autopilot's hold mode when the game is over.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from random import Random
from typing import Any

from guidance.config import parse_document
from guidance.sim.scenario import Scenario
from tests.faults.disturbances import DISTURBANCES, Disturbance

Keys = dict[str, Any]

GAME_S = 9.0
SHARED = 5
"""Number of flights with the same game; the flight to its start is flown once and copied."""

AUTOPILOTS = ("px4", "arducopter")
FASTEST_BALL_M_S = 4.0
"""PX4 descends no faster (MPC_Z_VEL_MAX_DN), so a faster vehicle has no ball for its speed set."""

PILOT_MODES = {
    "px4": ("POSCTL", "ALTCTL", "STABILIZED"),
    "arducopter": ("LOITER", "ALT_HOLD", "STABILIZE"),
}
POLICIES = ("optimal", "optimal", "optimal", "random_turns", "pure_evade", "waypoints")
MOTION = ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "ATTITUDE")
SAID = (
    *MOTION,
    "HOME_POSITION",
    "GPS_GLOBAL_ORIGIN",
    "SYS_STATUS",
    "HEARTBEAT",
    "EXTENDED_SYS_STATE",
)


@dataclass(frozen=True)
class Stall:
    """The loop stops for `for_s`, `at_s` after engagement."""

    at_s: float
    for_s: float


@dataclass(frozen=True)
class Case:
    """One flight.

    Attributes:
        seed: Seed of the run.
        number: Number of the flight in the run.
        scenario: The scenario, with the faults of its vehicles.
        corners_m: Corners of a polygon fence, (north, east) from home.
        stalls: Stalls of the loop.
        disturbances: What people and other programs do. Such a flight starts on the ground.
    """

    seed: int
    number: int
    scenario: Scenario
    corners_m: tuple[tuple[float, float], ...] | None = None
    stalls: tuple[Stall, ...] = ()
    disturbances: tuple[Disturbance, ...] = ()

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the faults; those of the evader's link have a prefix."""
        stalled = ("loop_stall",) if self.stalls else ()
        disturbed = dict.fromkeys(one.kind for one in self.disturbances)
        faults = (_named(fault.kind, fault.vehicle) for fault in self.scenario.fault)
        return (*faults, *stalled, *disturbed)

    @property
    def game(self) -> Scenario:
        """The scenario up to engagement: without the faults whose times count from engagement."""
        early = [fault for fault in self.scenario.fault if fault.after != "engaged"]
        return self.scenario.model_copy(update={"fault": early})

    @property
    def again(self) -> str:
        """The command that repeats this flight."""
        return f"python -m tests faults --seed {self.seed} --only {self.number}"


def _named(kind: str, vehicle: str) -> str:
    return kind if vehicle == "pursuer" or kind.startswith("evader_") else f"evader's {kind}"


@dataclass
class Draw:
    """Random draws for the fault tables below."""

    random: Random
    autopilot: str
    limits: Mapping[str, float] = field(default_factory=dict)

    def between(self, low: float, high: float, digits: int = 2) -> float:
        return round(self.random.uniform(low, high), digits)

    def chance(self, share: float) -> bool:
        return self.random.random() < share

    def one(self, *of: Any) -> Any:
        return self.random.choice(of)

    def vector(self, low: float, high: float, *, down: float = 0.0) -> Keys:
        """Draw a horizontal vector of size `low` to `high`, and a vertical part of at most `down` times that size."""
        size = self.between(low, high)
        bearing = self.random.uniform(-math.pi, math.pi)
        vertical = size * self.random.uniform(-down, down)
        parts = (size * math.cos(bearing), size * math.sin(bearing), vertical)
        return dict(zip(("north", "east", "down"), (round(part, 2) for part in parts), strict=True))


def _shares(draw: Draw, low: float = 0.05, high: float = 0.6) -> Keys:
    return {"probability": draw.between(low, high)}


def _early_or_late(draw: Draw, keys: Keys) -> Keys:
    return {**draw.one({}, {"after": "start", "at_s": 0.0}), **keys}


def _bad_fields(draw: Draw) -> Keys:
    messages = draw.random.sample(SAID, draw.one(1, 1, 2))
    value = draw.one("nan", "inf", "zero", "int_max", "int_min")
    return {
        "messages": messages,
        "value": value,
        **_shares(draw, 0.02, 1.0),
        "for_s": draw.between(0.3, 4.0),
    }


def _evaders_bad_fields(draw: Draw) -> Keys:
    value = draw.one("zero", "int_max", "int_min")
    return {"messages": ["GLOBAL_POSITION_INT"], "value": value, **_shares(draw, 0.02, 1.0)}


def _delay(draw: Draw) -> Keys:
    """Draw a link that is late: for a while, from before the flight on, or ever later."""
    if draw.chance(0.3):
        both = {"jitter_s": draw.between(0.0, 0.3), "direction": draw.one("in", "out")}
        return {"delay_s": draw.between(0.02, 0.5), "for_s": draw.between(1.0, 6.0), **both}
    late = {"delay_s": draw.between(0.1, 3.0), "direction": draw.one("out", "out", "both")}
    if draw.chance(0.4):
        return {**late, "after": "start", "at_s": 0.0}
    return {**late, "grows_s": draw.between(0.5, 15.0)}


def _for(low: float, high: float) -> Callable[[Draw], Keys]:
    return lambda draw: {"for_s": draw.between(low, high)}


def _nothing(_draw: Draw) -> Keys:
    return {}


PURSUER_FAULTS: Mapping[str, Callable[[Draw], Keys]] = {
    "loss": lambda draw: {**_shares(draw), "direction": draw.one("in", "out", "both"), "for_s": draw.between(0.5, 8.0)},
    "burst_loss": lambda draw: {
        "good_s": draw.between(0.2, 2.0), "lost_s": draw.between(0.05, 0.8), "direction": draw.one("in", "out", "both"),
    },
    "duplicate": lambda draw: {**_shares(draw), "copies": draw.one(1, 3), "late_s": draw.between(0.0, 1.0)},
    "reorder": lambda draw: {**_shares(draw), "by_s": draw.between(0.02, 0.5)},
    "delay": _delay,
    "corrupt": lambda draw: {**_shares(draw, 0.02, 0.5), "bits": draw.one(1, 2, 3)},
    "ack_lost": lambda draw: _early_or_late(draw, _shares(draw, 0.3, 1.0)),
    "ack_late": lambda draw: _early_or_late(draw, {"delay_s": draw.between(0.2, 3.0)}),
    "ack_wrong": lambda draw: _early_or_late(draw, {"result": draw.one(1, 2, 4, 5)}),
    "ack_in_progress": lambda draw: _early_or_late(draw, {}),
    "ack_foreign": lambda draw: _early_or_late(draw, {}),
    "heartbeat_gap": lambda draw: {"gap_s": draw.between(1.0, 5.0)},
    "v1_frames": _nothing,
    "signed_frames": _nothing,
    "router_restart": _for(0.2, 3.0),
    "bad_fields": _bad_fields,
    "latlon_zero": _for(0.2, 5.0),
    "param_echo": lambda draw: {"parameter": "MAV_SYS_ID" if draw.autopilot == "px4" else "SYSID_THISMAV", "value": 9},
    "time_reset": _nothing,
    "time_wrap": lambda draw: {"before_s": draw.between(0.5, 5.0)},
    "foreign_heartbeat": lambda draw: {"component": draw.one(2, 100, 191)},
    "sysid_clash": lambda draw: {"north_m": draw.between(-100.0, 100.0), "for_s": draw.between(0.5, 5.0)},
    "statustext": _nothing,
    "telemetry_freeze": _for(0.3, 4.0),
    "silence": _for(0.3, 4.0),
    "pilot_mode": lambda draw: {"mode": draw.one(*PILOT_MODES[draw.autopilot])},
    "pilot_sticks": lambda draw: {"roll": draw.between(-1, 1), "pitch": draw.between(-1, 1), "for_s": 1.0},
    "rc_loss": _for(0.5, 5.0),
    "gcs_loss": _nothing,
    "arm_refused": lambda draw: {"after": "start", "at_s": 0.0, "for_s": draw.between(2.0, 10.0)},
    "offboard_refused": _for(0.5, 5.0),
    "ekf_jump": lambda draw: draw.vector(0.5, 8.0, down=0.4),
    "ekf_yaw_jump": lambda draw: {"by_deg": draw.between(-180.0, 180.0)},
    "gps_loss": _for(0.5, 8.0),
    "estimator_invalid": _for(0.5, 4.0),
    "eph_growth": lambda draw: {"rate_m_s": draw.between(0.5, 8.0)},
    "fence_breach": _nothing,
    "battery_low": _nothing,
    "battery_critical": _nothing,
    "wind_gust": lambda draw: {**draw.vector(2.0, 10.0, down=0.1), "for_s": draw.between(0.5, 5.0)},
    "gusts": lambda draw: {"sd_m_s": draw.between(0.5, 3.0)},
    "push": lambda draw: draw.vector(0.5, 3.0, down=0.3),
    "velocity_truncation": lambda draw: {
        "horizontal_m_s": draw.between(1.0, 6.0), "up_m_s": draw.between(0.3, 2.0), "down_m_s": draw.between(0.3, 2.0),
    },
    "reboot": _nothing,
    "home_jump": lambda draw: {
        **draw.vector(0.5, 30.0, down=0.3), "wander_m": draw.between(0.0, 3.0), **draw.one({}, {"after": "start"}),
    },
    "origin_jump": lambda draw: draw.vector(0.3, 30.0, down=0.3),
    "origin_move": lambda draw: {**draw.vector(0.3, 30.0, down=0.3), "told": draw.one("yes", "no")},
    "velocity_lie": lambda draw: {**draw.vector(0.2, 1.5, down=0.4), "for_s": draw.between(0.5, 8.0)},
    "second_source": lambda draw: {**draw.vector(0.5, 4.0, down=0.2), "rate_hz": draw.between(2.0, 30.0)},
    "gps_drift": lambda draw: {**draw.vector(0.05, 0.5), "for_s": draw.between(3.0, 15.0)},
    "barometer_drift": lambda draw: {"down_m_s": draw.between(-0.3, 0.3), "for_s": draw.between(3.0, 15.0)},
    "thrust_loss": lambda draw: {"share": draw.between(0.4, 0.95), "for_s": draw.between(0.3, 4.0)},
    "position_forger": lambda draw: {
        **draw.vector(0.5, 30.0, down=0.2), "ahead_s": draw.between(0.0, 1.0), "probability": draw.between(0.1, 1.0),
    },
}  # fmt: skip
"""Faults of the vehicle and its link, each with the draw of its keys. Times count from engagement."""

EVADER_FAULTS: Mapping[str, Callable[[Draw], Keys]] = {
    "evader_slow": lambda draw: {"period_s": draw.between(0.1, 1.4)},
    "evader_duplicates": lambda draw: {**_shares(draw), "late_s": draw.between(0.0, 1.0)},
    "evader_out_of_order": lambda draw: {**_shares(draw), "by_s": draw.between(0.02, 0.6)},
    "evader_late": lambda draw: {
        "delay_s": draw.between(0.05, 1.0),
        "jitter_s": draw.between(0.0, 0.5),
    },
    "evader_clock": lambda draw: {
        "offset_s": draw.between(-60.0, 60.0),
        "drift_ppm": draw.between(-500.0, 500.0),
    },
    "evader_stale": lambda draw: {
        "as": draw.one("repeats", "silence"),
        "for_s": draw.between(0.5, 6.0),
    },
    "evader_jump": lambda draw: {
        **draw.vector(0.5, 15.0, down=0.2),
        "for_s": draw.between(0.2, 6.0),
    },
    "burst_loss": lambda draw: {"good_s": draw.between(0.2, 2.0), "lost_s": draw.between(0.1, 2.0)},
    "velocity_lie": lambda draw: {**draw.vector(0.3, 4.0), "for_s": draw.between(0.5, 8.0)},
    "evader_forger": lambda draw: {
        **draw.vector(0.0, 30.0),
        "rate_hz": draw.between(20.0, 500.0),
        "clock_s": draw.one(0.0, 0.0, 100.0),
        "north_m_s": draw.between(-60.0, 60.0),
        "east_m_s": draw.between(-60.0, 60.0),
        "component": 66,  # has an address of its own in tests.harness.pinned_wire
    },
    "loss": lambda draw: {**_shares(draw, 0.1, 0.9), "for_s": draw.between(1.0, 8.0)},
    "corrupt": lambda draw: {**_shares(draw, 0.05, 0.9), "for_s": draw.between(1.0, 8.0)},
    "bad_fields": _evaders_bad_fields,
    "latlon_zero": _for(0.2, 5.0),
    "time_reset": _nothing,
}
"""The same for the evader."""

LOOP_STALL = "loop_stall"
KINDS = (
    *PURSUER_FAULTS,
    *(_named(kind, "evader") for kind in EVADER_FAULTS),
    LOOP_STALL,
    *DISTURBANCES,
)


def draw_case(seed: int, number: int) -> Case:
    """Draw flight `number` of the run `seed`. The first fault and the autopilot cycle through all kinds.

    About `SHARED` flights of each autopilot have the same geometry, game and wind.
    """
    turn, place = divmod(number, len(KINDS))
    autopilot = AUTOPILOTS[(turn + place) % len(AUTOPILOTS)]
    played = number // (len(AUTOPILOTS) * SHARED)
    draw = Draw(Random(f"game {seed} {autopilot} {played}"), autopilot)
    document = _game(draw, autopilot)
    document["seed"] = played
    corners = _corners(draw, document) if draw.chance(0.3) else None
    draw = Draw(Random(f"faults {seed} {number}"), autopilot)
    first = (place + seed) % len(KINDS)
    more = draw.random.choices((0, 1, 2), (5, 3, 2))[0]
    kinds = (KINDS[first], *draw.random.sample(KINDS, more))
    stalls = tuple(
        Stall(draw.between(0.5, 6.0), draw.between(0.05, 0.8 if draw.chance(0.7) else 3.0))
        for kind in kinds
        if kind == LOOP_STALL
    )
    kinds = dict.fromkeys(kinds)
    faults = [kind for kind in kinds if kind != LOOP_STALL and kind not in DISTURBANCES]
    document["fault"] = [_fault(draw, kind) for kind in faults]
    disturbances = tuple(
        disturbance
        for kind in kinds
        if kind in DISTURBANCES
        for disturbance in DISTURBANCES[kind](draw.random, autopilot)
    )
    scenario = parse_document(Scenario, document, source=f"flight {number}")
    return Case(seed, number, scenario, corners, stalls, disturbances)


def _fault(draw: Draw, named: str) -> Keys:
    evaders = named.startswith("evader")
    kind = named.removeprefix("evader's ")
    keys = (EVADER_FAULTS if evaders else PURSUER_FAULTS)[kind](draw)
    return {
        "kind": kind,
        "vehicle": "evader" if evaders else "pursuer",
        "at_s": draw.between(0.2, 6.0),
        **keys,
    }


def _game(draw: Draw, autopilot: str) -> Keys:
    radius_m = draw.between(2.0, 5.0)
    height_m = draw.between(3.0, 5.0)
    start_m = draw.between(height_m + 0.5, height_m + 3.5)
    bearing = draw.random.uniform(-math.pi, math.pi)
    away_m = draw.between(radius_m + 6.0, 35.0)
    evader = (round(away_m * math.sin(bearing), 2), round(away_m * math.cos(bearing), 2))
    speed_m_s = draw.between(3.0, 7.0)
    evader_m_s = round(speed_m_s * draw.between(0.2, 0.6), 2)
    policy = draw.one(*POLICIES)
    speed_set = draw.one("ball", "cylinder")
    if speed_m_s > FASTEST_BALL_M_S:
        speed_set = "cylinder"
    pursuer = {
        "position_m": (0.0, 0.0, start_m),
        "speed_m_s": speed_m_s,
        "speed_set": speed_set,
        "autopilot": autopilot,
        "takeoff_height_m": max(2.0, round(start_m - 0.8, 2)),
    }
    if pursuer["speed_set"] == "ball":  # a vehicle that flies it climbs and descends as fast
        pursuer["climb_m_s"] = speed_m_s
        pursuer["descent_m_s"] = speed_m_s
    document: Keys = {
        "title": "faults",
        "game": "pe",
        "pursuer": pursuer,
        "evader": {"position_m": evader, "speed_m_s": evader_m_s, "policy": policy},
        "standoff": {"radius_m": radius_m, "height_m": height_m},
        "limits": {
            "floor_m": draw.between(1.5, min(height_m - 0.3, start_m - 1.2)),
            "ceiling_m": round(start_m + draw.between(1.5, 10.0), 2),
            "fence_radius_m": max(12.0, round(math.hypot(*evader) + draw.between(2.5, 25.0), 1)),
        },
        "time_limit_s": GAME_S,
        "hold_s": 1.0,
    }
    if policy == "waypoints":  # to and fro: towards the pursuer, past it, and away
        document["evader"]["waypoints_m"] = [
            (draw.between(-15.0, 15.0), draw.between(-15.0, 15.0)) for _ in range(draw.one(1, 2, 3))
        ]
    if draw.chance(0.35):
        document["game"] = "tad"
        aim = draw.random.uniform(-math.pi, math.pi)
        far = draw.between(5.0, 30.0)
        place = (
            round(evader[0] + far * math.sin(aim), 2),
            round(evader[1] + far * math.cos(aim), 2),
        )
        document["target"] = {"position_m": place}
    if draw.chance(0.4):
        wind = draw.vector(0.3, 0.9 * (speed_m_s - evader_m_s) if draw.chance(0.5) else 1.5)
        size = min(
            1.0, 0.9 * (speed_m_s - evader_m_s) / max(0.01, math.hypot(wind["north"], wind["east"]))
        )
        document["wind"] = {
            "velocity_m_s": (round(size * wind["east"], 2), round(size * wind["north"], 2))
        }
    return document


def _corners(draw: Draw, document: Keys) -> tuple[tuple[float, float], ...]:
    """Draw a rotated rectangle around home that contains the start, with room to brake."""
    turned = draw.random.uniform(0.0, math.pi)
    sides = [draw.between(9.0, document["limits"]["fence_radius_m"]) for _ in range(4)]
    points = (
        (sides[0], sides[1]),
        (sides[0], -sides[2]),
        (-sides[3], -sides[2]),
        (-sides[3], sides[1]),
    )
    cosine = math.cos(turned)
    sine = math.sin(turned)
    return tuple(
        (round(a * cosine - b * sine, 2), round(a * sine + b * cosine, 2)) for a, b in points
    )
