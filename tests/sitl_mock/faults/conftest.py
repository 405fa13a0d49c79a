"""A client by pymavlink beside a stepped vehicle with faults; the clock moves by hand."""

import contextlib
import math
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import all as dialect

from sitl_mock import MockVehicle
from sitl_mock.faults import Faulted, parse_script
from tests.harness.copies import Flown

GUIDED = {"px4": (1.0, 6.0), "arducopter": (1.0, 4.0), "rover": (1.0, 15.0)}


class Rig:
    """One vehicle with faults, and what a client 255/190 has heard from it."""

    def __init__(self, *faults, flavour="px4", seed=1, dt_s=0.02, name="uav1", **settings):
        settings.setdefault("ready_after_s", 0.5)
        settings.setdefault("noise", False)
        script = parse_script({"seed": seed, "fault": list(faults)})
        self.flavour = flavour
        self.faulted = Faulted(MockVehicle(flavour, **settings), name, script)
        self.vehicle = self.faulted.vehicle
        self.dt_s = dt_s
        self.now_s = 0.0
        self.count = 0
        self.frames = []
        self._heard = []
        self._broken = 0
        self._read_frames = 0
        nowhere = SimpleNamespace(write=lambda _: None)
        self.client = dialect.MAVLink(nowhere, 255, 190)
        self.parser = dialect.MAVLink(nowhere, 255, 190)
        self.parser.robust_parsing = True
        self._reader = dialect.MAVLink(nowhere, 255, 190)
        self._hear(self.faulted.step(0.0))

    def _hear(self, frames):
        self.frames += [(self.now_s, frame) for frame in frames]

    @property
    def heard(self):
        """Every message so far, with its time of arrival."""
        self._read_on()
        return self._heard

    @property
    def broken(self):
        """Number of frames that were no messages."""
        self._read_on()
        return self._broken

    def _read_on(self):
        """Frames are read when a test asks for them all; `all` reads those of one name."""
        for at_s, frame in self.frames[self._read_frames :]:
            for message in self._read(frame):
                if message.get_type() == "BAD_DATA":
                    self._broken += 1
                else:
                    self._heard.append((at_s, message))
        self._read_frames = len(self.frames)

    def _read(self, frame):
        """A frame that is whole and true is one message; whatever else comes goes through the parser of streams."""
        if self.parser.buf_len() == 0:
            with contextlib.suppress(dialect.MAVError):
                return [self.parser.decode(bytearray(frame))]
        return self.parser.parse_buffer(frame) or []

    def pack(self, name, *values):
        """A frame of the client."""
        frame = getattr(dialect, f"MAVLink_{name.lower()}_message")(*values).pack(self.client)
        self.client.seq = (self.client.seq + 1) % 256
        return frame

    def change(self, **parameters):
        """Set parameters in flight."""
        for name, value in parameters.items():
            self.vehicle.autopilot.parameters.set(name, value)
        return self

    def inject(self, fault):
        """Let a fault begin; its times count from now."""
        self.faulted.inject(fault)
        return self

    def run(self, seconds, *stream):
        """Move the clock, sending a message at each step if one is given."""
        for _ in range(round(seconds / self.dt_s)):
            self.count += 1
            self.now_s = round(self.count * self.dt_s, 9)
            self._hear(self.faulted.step(self.now_s, [self.pack(*stream)] if stream else []))
        return self

    def send(self, *message):
        """Send one message now."""
        self._hear(self.faulted.step(self.now_s, [self.pack(*message)]))

    def command(self, number, *params, wait_s=0.1):
        """Send a command; return (component, result) of the answers that come within wait_s."""
        since = len(self.frames)
        fill = [math.nan if self.flavour == "px4" else 0.0] * (7 - len(params))
        self.send("COMMAND_LONG", 1, 1, number, 0, *params, *fill)
        self.run(wait_s)
        return [
            (m.get_srcComponent(), m.result)
            for _, m in self._named("COMMAND_ACK", self.frames[since:])
            if m.command == number
        ]

    def all(self, name, since_s=0.0, until_s=math.inf):
        """Messages of a name with their arrival times."""
        return self._named(name, [each for each in self.frames if since_s <= each[0] < until_s])

    def _named(self, name, frames):
        number = getattr(dialect, f"MAVLINK_MSG_ID_{name}")
        of_v2 = number.to_bytes(3, "little")
        found = []
        for at_s, frame in frames:
            if (
                frame[7:10] == of_v2
                if frame[0] == dialect.PROTOCOL_MARKER_V2
                else frame[5] == number
            ):
                with contextlib.suppress(dialect.MAVError):
                    found.append((at_s, self._reader.decode(bytearray(frame))))
        return found

    def airborne(self, height_m=4.0):
        """Arm, take off, hover."""
        self.run(1.5)
        if self.flavour == "arducopter":
            self.command(176, *GUIDED["arducopter"])
        assert (1, 0) in self.command(400, 1.0)
        top_m = self.vehicle.autopilot.frame.origin.alt_amsl_m if self.flavour == "px4" else 0.0
        fill = [math.nan if self.flavour == "px4" else 0.0] * 6
        assert self.command(22, *fill, top_m + height_m)[-1] == (1, 0)
        while -self.vehicle.truth.position_ned_m[2] < height_m - 0.5:
            assert self.now_s < 60.0
            self.run(0.5)
        return self.run(2.0)

    def guided(self, *stream):
        """Stream, and enter OFFBOARD or GUIDED."""
        self.run(0.3, *stream)
        self.command(176, *GUIDED[self.flavour])
        return self.run(0.2, *stream)


def velocity(north, east, down):
    """A velocity setpoint for 1/1."""
    return (
        "SET_POSITION_TARGET_LOCAL_NED",
        0,
        1,
        1,
        1,
        2503,
        0,
        0,
        0,
        north,
        east,
        down,
        0,
        0,
        0,
        0,
        0,
    )


@pytest.fixture
def rig():
    """``rig({"kind": ...}, ...)`` boots a vehicle with faults."""
    return Rig


@pytest.fixture(scope="session")
def aloft():
    """``aloft()`` is a copy of a vehicle that hovers; its take-off was flown once, and `inject` brings the fault."""
    flown = Flown()
    return lambda: flown("aloft", lambda: Rig().airborne(), lambda rig: rig.frames)


@pytest.fixture
def ned_velocity():
    """A velocity setpoint."""
    return velocity
