"""Whole flights in which a forger sends reports as the evader, at ten times the rate, over every carrier.

The forger begins in the middle of the chase and moves the reported position away. The flight must hand the vehicle to
its hold mode soon, and the believed position must stay within the evader's possible motion.
"""

import json
import math
import struct

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.clock import VirtualClock
from guidance.config import parse_document
from guidance.flight import Event, State
from guidance.frames import Amsl, LocalFrame, Ned, game_from_ned
from guidance.links import MemoryWire
from guidance.links.evaders.carriers import FOLLOW_TARGET, carrier_of
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.evaders.zenoh import KEYS
from guidance.session.fly.loop import run
from guidance.session.fly.mission import Mission
from guidance.session.plan import plan_of
from guidance.sim.scenario import Scenario
from guidance.sim.stepped import SteppedWorld

pytestmark = [pytest.mark.flight, pytest.mark.usefixtures("soon_up_and_down")]

DECLARED_M_S = 1.5
OWN_M_S = 4.0
FORGED_AT_S = 2.5
FORGED_FOR_S = 3.0
AWAY_M_S = 130.0
SITE = LocalFrame(47.397742, 8.545594, Amsl(488.0), undulation_m=47.0)


def chase(*faults):
    pursuer = {
        "position_m": (0.0, 0.0, 4.0),
        "speed_m_s": OWN_M_S,
        "takeoff_height_m": 3.5,
        "autopilot": "arducopter",
    }
    document = {
        "title": "forged",
        "game": "pe",
        "pursuer": pursuer,
        "evader": {"position_m": (4.0, 28.0), "speed_m_s": DECLARED_M_S},
        "standoff": {"height_m": 3.0},
        "limits": {"floor_m": 2.0},
        "fault": list(faults),
    }
    return parse_document(Scenario, document, source="forged")


class Around:
    """The mission; it ends when the vehicle holds or the forger's time is over. Records the largest position error."""

    def __init__(self, mission, daemon, world):
        self._mission = mission
        self._daemon = daemon
        self._world = world
        self.engaged_s = self.held_s = None
        self.finished = False
        self.worst_m = 0.0
        self.told = []

    def before(self, now_s):
        self._mission.before(now_s)

    def after(self, now_s, late_s=0.0):
        self._mission.after(now_s, late_s)
        outputs = self._daemon.outputs
        tracking = self._daemon.flight.tracking
        self.told += [transition.event for transition in outputs.transitions]
        if outputs.state is State.ENGAGED and self.engaged_s is None:
            self.engaged_s = now_s
        if self.engaged_s is None:
            return
        evader = tracking.evader(now_s)
        truth = self._world.players["evader"].position_game_m
        believed = tracking.game_frame.position_from_ned(evader.position_ned_m)
        self.worst_m = max(self.worst_m, math.dist(believed[:2], truth[:2]))
        if outputs.state is State.HOLDING and self.held_s is None:
            self.held_s = now_s - self.engaged_s
        self.finished = (
            self.held_s is not None or now_s - self.engaged_s > FORGED_AT_S + FORGED_FOR_S
        )


def flown(scenario, source=None, *, hold=True):
    """Fly a scenario; `source` wraps the mock's evader source and gets the time of engagement and the clock."""
    clock = VirtualClock()
    world = SteppedWorld(scenario, clock)
    if source is not None:
        world.evaders["pursuer"]["evader"] = source(
            world.evaders["pursuer"]["evader"], lambda: around.engaged_s, clock
        )
    plan = plan_of(scenario=scenario)
    object.__setattr__(plan.flight, "hold_on_rival", hold)
    mission = Mission(scenario, world, clock, plans={"pursuer": plan})
    around = Around(mission, mission.daemons[0], world)
    try:
        run(mission.daemons, world, clock, mission=around)
    finally:
        world.close()
    return around


def held_as_it_should(flight):
    # The position may leave the game's limits before the second source is detected.
    assert flight.told[-1] in {Event.RIVAL, Event.NO_GAME}
    assert FORGED_AT_S < flight.held_s <= FORGED_AT_S + 2.0
    # The largest accepted jump, and the distance at our own speed until the forger is noticed.
    assert flight.worst_m < 6.0 + OWN_M_S * (flight.held_s - FORGED_AT_S + 3.0)


@pytest.mark.parametrize(
    ("clock_s", "away_m_s"),
    [(0.0, 3.0), (400.0, AWAY_M_S)],
    ids=["by the evader's clock, slowly", "by a clock of his own"],
)
def test_a_forger_with_the_evaders_system_id(clock_s, away_m_s):
    forger = {"kind": "evader_forger", "vehicle": "evader", "at_s": FORGED_AT_S, "clock_s": clock_s}
    held_as_it_should(flown(chase({**forger, "north_m_s": away_m_s})))


class Relayed:
    """Repeats the evader's reports over another carrier; from `FORGED_AT_S` it adds ten forged ones to each."""

    def __init__(self, source, engaged_s, clock, *, rate_hz, tell):
        self._source = source
        self._engaged_s = engaged_s
        self._clock = clock
        self._period_s = 1.0 / rate_hz
        self._tell = tell
        self._due_s = 0.0
        self._place = None

    def receive(self):
        reports = self._source.receive()
        now_s = self._clock.now_s()
        if not reports or now_s < self._due_s - 1e-9:
            return []
        self._due_s = now_s + self._period_s
        true = reports[-1]
        about = LocalFrame(true.latitude_deg, true.longitude_deg, Amsl(true.altitude_amsl_m))
        told = self._tell(
            (true.latitude_deg, true.longitude_deg, true.altitude_amsl_m),
            true.velocity_ned_m_s,
            now_s,
        )
        since_s = -1.0 if self._engaged_s() is None else now_s - self._engaged_s() - FORGED_AT_S
        for share in range(10) if since_s >= 0.0 else ():
            latitude, longitude, _ = about.wgs84_from_ned(
                Ned((AWAY_M_S * (since_s + 1e-3 * share), 0.0, 0.0))
            )
            told += self._tell(
                (latitude, longitude, true.altitude_amsl_m),
                (30.0, 0.0, 0.0),
                now_s + 1e-4 * (share + 1),
            )
        return told

    def counters(self):
        return self._source.counters()

    def close(self):
        self._source.close()


def over_zenoh(kind):
    _, read = KEYS[kind](SITE, "evader")

    def tell(place, velocity, now_s):
        if kind == "json":
            latitude, longitude, altitude = place
            payload = json.dumps(
                {
                    "sent_s": now_s,
                    "latitude_deg": latitude,
                    "longitude_deg": longitude,
                    "altitude_m": altitude,
                    "altitude_datum": "amsl",
                    "velocity_ned_m_s": velocity,
                }
            ).encode()
        else:
            east, north, up = game_from_ned(SITE.ned_from_wgs84(place[0], place[1], Amsl(place[2])))
            head = (
                struct.pack("<iI", int(now_s), int(now_s % 1.0 * 1e9))
                + struct.pack("<I", 4)
                + b"map\0"
            )
            payload = b"\0\1\0\0" + head + struct.pack("<7d", east, north, up, 0.0, 0.0, 0.0, 1.0)
        return [read(payload, now_s)]

    return tell


def over_mavlink(carrier, message):
    """Use `MavlinkEvader` with two senders that have one system id and separate sequence numbers."""
    ours, theirs = MemoryWire.pair(lambda: 0.0)
    source = MavlinkEvader(ours, carrier, system_id=9)
    senders = [mavlink.MAVLink(None, 9, 1), mavlink.MAVLink(None, 9, 1)]

    def tell(place, velocity, now_s):
        forged = velocity[0] == 30.0
        sender = senders[forged]
        theirs.send(message(place, velocity, now_s).pack(sender))
        sender.seq = (sender.seq + 1) % 256
        return [one._replace(received_s=now_s) for one in source.receive()]

    return tell


def follow_target(place, velocity, now_s):
    lat, lon = (round(part * 1e7) for part in place[:2])
    zero = [0.0] * 4
    return mavlink.MAVLink_follow_target_message(
        round(now_s * 1e3), 3, lat, lon, place[2], velocity, zero[:3], zero, zero[:3], zero[:3], 0
    )


def adsb_vehicle(place, velocity, now_s):
    lat, lon = (round(part * 1e7) for part in place[:2])
    course = round(math.degrees(math.atan2(velocity[1], velocity[0])) % 360.0 * 100)
    speed = round(math.hypot(*velocity[:2]) * 100)
    return mavlink.MAVLink_adsb_vehicle_message(
        0xABCDEF,
        lat,
        lon,
        0,
        round(place[2] * 1e3),
        course,
        speed,
        0,
        b"",
        0,
        0,
        1 | 2 | 4 | 8 | 128,
        0,
    )


CARRIERS = {
    "json": lambda: (20.0, over_zenoh("json")),
    "ros_pose": lambda: (20.0, over_zenoh("ros_pose")),
    "follow_target": lambda: (10.0, over_mavlink(FOLLOW_TARGET, follow_target)),
    "adsb": lambda: (
        4.0,
        over_mavlink(carrier_of("adsb", SITE, icao_address=0xABCDEF), adsb_vehicle),
    ),
}


@pytest.mark.parametrize("carrier", CARRIERS)
def test_a_forger_by_every_other_carrier(carrier):
    rate_hz, tell = CARRIERS[carrier]()
    held_as_it_should(flown(chase(), lambda *given: Relayed(*given, rate_hz=rate_hz, tell=tell)))


def test_where_it_is_only_to_be_told_it_is_told_and_the_chase_goes_on():
    forger = {"kind": "evader_forger", "vehicle": "evader", "at_s": FORGED_AT_S, "north": 40.0}
    flight = flown(chase(forger), hold=False)
    assert flight.told[-1] is Event.RIVAL
    assert flight.held_s is None
    assert flight.worst_m < 6.0
