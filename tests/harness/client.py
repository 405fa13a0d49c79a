"""A stepped flight: one mock vehicle, one client, and a clock that the test advances."""

import copy
import math
from collections import Counter

from sitl_mock import MockVehicle
from sitl_mock.mavlink import SPEC_BY_ID, Decoder, Encoder
from sitl_mock.mavlink.dialect import spec_of
from tests.harness.copies import Flown

STEP_S = 0.02
UNUSED = {"px4": math.nan, "arducopter": 0.0, "rover": 0.0}
GUIDED = {"px4": (1, 6), "arducopter": (1, 4), "rover": (1, 15)}


class Flight:
    """One vehicle, and the frames that client 1/195 received from it."""

    def __init__(self, flavour, *, spec="", dt_s=STEP_S, source=(1, 195), **settings):
        settings.setdefault("ready_after_s", 0.5)
        settings.setdefault("noise", False)
        self.flavour = flavour
        self.vehicle = MockVehicle(spec if spec else flavour, **settings)
        self.dt_s = dt_s
        self.now_s = 0.0
        self.steps = 0
        self.encoder = Encoder(*source)
        self.decoder = Decoder()
        self.frames = []
        self._times = []
        self._messages = []
        self._hear(self.vehicle.step(0.0))

    def __deepcopy__(self, memo):
        """Copy all but the frames and messages themselves, which never change."""
        for heard in (self.frames, self._times, self._messages):
            memo[id(heard)] = list(heard)
        memo[id(self)] = twin = copy.copy(self)
        vars(twin).update(copy.deepcopy(vars(self), memo))
        return twin

    def _hear(self, frames):
        self.frames += frames
        self._times += [self.now_s] * len(frames)
        self._messages += [None] * len(frames)

    def _message(self, index):
        """Return a message; frames are decoded on first use, because tests read only a few."""
        if self._messages[index] is None:
            (self._messages[index],) = self.decoder.feed(self.frames[index], whole=True)
        return self._messages[index]

    def _of(self, name):
        """Yield the indices of the messages of a name, the latest first."""
        number = spec_of(name).id_bytes
        frames = self.frames
        return (index for index in reversed(range(len(frames))) if frames[index][7:10] == number)

    @property
    def heard(self):
        """Every message with its time of arrival."""
        return [(self._times[index], self._message(index)) for index in range(len(self.frames))]

    def send(self, *message):
        """Send one message now."""
        self._hear(self.vehicle.step(self.now_s, [self.encoder.pack(*message)]))

    def run(self, seconds, stream=None, every_s=None):
        """Advance the clock and send the message `stream` every `every_s` (at each step if None)."""
        steps = round(seconds / self.dt_s)
        period = 1 if every_s is None else round(every_s / self.dt_s)
        for index in range(steps):
            self.steps += 1
            self.now_s = round(self.steps * self.dt_s, 9)
            frames = (
                [self.encoder.pack(*stream)] if stream is not None and index % period == 0 else []
            )
            self._hear(self.vehicle.step(self.now_s, frames))
        return self

    def until(self, condition, within_s, stream=None):
        """Advance the clock until a condition holds; return the time it took, s."""
        start_s = self.now_s
        while not condition():
            assert self.now_s - start_s < within_s, (
                f"not within {within_s} s; mode {self.vehicle.mode}"
            )
            self.run(self.dt_s, stream)
        return self.now_s - start_s

    def command(self, number, *params, wait_s=0.1, target=(1, 1)):
        """Send a COMMAND_LONG; return the results of all its ACKs."""
        before = len(self.frames)
        fill = [UNUSED[self.flavour]] * (7 - len(params))
        self.send("COMMAND_LONG", *target, number, 0, *params, *fill)
        self.run(wait_s)
        return self._results(before, number)

    def command_int(self, number, frame, *params, x=0, y=0, z=0.0):
        """Send a COMMAND_INT; return the results of all its ACKs."""
        before = len(self.frames)
        fill = [UNUSED[self.flavour]] * (4 - len(params))
        self.send("COMMAND_INT", 1, 1, frame, number, 0, 0, *params, *fill, x, y, z)
        self.run(0.1)
        return self._results(before, number)

    def _results(self, before, number):
        """Return the results of a command's ACKs after the first `before` frames."""
        acks = [self._message(index) for index in self._of("COMMAND_ACK") if index >= before]
        return [ack.result for ack in reversed(acks) if ack.command == number]

    def last(self, name):
        """The last message of a name."""
        return next((self._message(index) for index in self._of(name)), None)

    def all(self, name, since_s=0.0):
        """Return all messages of a name since a time, with their times of arrival."""
        came = [
            (self._times[index], self._message(index))
            for index in self._of(name)
            if self._times[index] >= since_s
        ]
        return came[::-1]

    def counts(self, since_s=0.0):
        """Return the number of messages after a time, by name."""
        numbers = Counter(
            frame[7:10]
            for at_s, frame in zip(self._times, self.frames, strict=True)
            if at_s > since_s
        )
        return {
            SPEC_BY_ID[int.from_bytes(number, "little")].name: count
            for number, count in numbers.items()
        }

    def change(self, **parameters):
        """Set parameters in flight."""
        for name, value in parameters.items():
            self.vehicle.autopilot.parameters.set(name, value)
        return self

    def texts(self):
        """Return all STATUSTEXTs, with chunks joined and without PX4's tab."""
        whole = []
        for _, message in self.all("STATUSTEXT"):
            if message.chunk_seq:
                whole[-1] += message.text
            else:
                whole.append(message.text)
        return [text.removesuffix("\t") for text in whole]

    @property
    def mode(self):
        return self.vehicle.mode

    @property
    def position(self):
        return self.vehicle.truth.position_ned_m

    @property
    def velocity(self):
        return self.vehicle.truth.velocity_ned_m_s

    @property
    def height(self):
        return -self.vehicle.truth.position_ned_m[2]

    def guided(self):
        return self.command(176, *GUIDED[self.flavour])

    def airborne(self, height=20.0):
        """Arm, take off and wait for the height."""
        self.until(lambda: self.vehicle.autopilot.commander.ready_to_arm, 60.0)
        if self.flavour == "arducopter":
            assert self.guided() == [0]
        assert self.command(400, 1.0)[-1] == 0
        self.run(0.5)
        amsl = self.vehicle.autopilot.frame.origin.alt_amsl_m if self.flavour == "px4" else 0.0
        fill = [UNUSED[self.flavour]] * 6
        assert self.command(22, *fill, amsl + height) == [0]
        self.until(lambda: self.height > height - 0.6, 60.0)
        self.run(4.0)
        return self

    def offboard(self, stream):
        """Stream and enter OFFBOARD or GUIDED."""
        self.run(0.3, stream)
        assert self.guided()[-1] == 0
        self.run(0.1, stream)
        return self


def velocity(north, east, down, *, mask=2503, frame=1, target=(1, 1), yaw=0.0):
    """A SET_POSITION_TARGET_LOCAL_NED as MAVSDK sends velocities."""
    return (
        "SET_POSITION_TARGET_LOCAL_NED",
        0,
        *target,
        frame,
        mask,
        0,
        0,
        0,
        north,
        east,
        down,
        0,
        0,
        0,
        yaw,
        0,
    )


class Fly:
    """``fly("px4", ...)`` starts a vehicle; ``fly.airborne("px4", height=10.0, ...)`` returns one in the air.

    Each take-off is flown once; tests continue from copies.
    """

    def __init__(self):
        self._flown = Flown()

    def __call__(self, flavour, **settings):
        return Flight(flavour, **settings)

    def airborne(self, flavour, height=20.0, **settings):
        key = (flavour, height, repr(sorted(settings.items())))
        return self._flown(key, lambda: Flight(flavour, **settings).airborne(height))
