"""Fly a log's commands in stepped time, with a whole mock vehicle over MAVLink or with the dynamics alone."""

from pathlib import Path

import numpy as np

from sitl_mock.calibrate.comparison import Samples
from sitl_mock.calibrate.step_log import FlavourName, StepLog
from sitl_mock.dynamics import CALM, Kind, Setpoint, Vehicle, arducopter_quadrotor, px4_quadrotor
from sitl_mock.errors import MockError
from sitl_mock.mavlink import Decoder, Encoder
from sitl_mock.vector import Vector
from sitl_mock.vehicle.mock_vehicle import MockVehicle

_FAR_BELOW_M = 1e6


def replay(log: StepLog, vehicle: Vehicle) -> Samples:
    """Return the velocities reported by the dynamics under the log's commands, shape (rows, 3), m/s.

    The mock starts in hover trim at the log's first position and velocity, its nose to the north as the logs have it
    (mask 2503, yaw 0). The ground is put far below: the log's origin says nothing about it.
    """
    north, east, down = log.position_ned_m[0].tolist()
    motion = vehicle.initial(Vector((north, east, down)), 0.0, flying=True)
    north, east, down = log.velocity_ned_m_s[0].tolist()
    velocity_m_s = Vector((north, east, down))
    motion = motion._replace(body=motion.body._replace(velocity_ned_m_s=velocity_m_s))
    around = CALM._replace(ground_down_m=_FAR_BELOW_M)
    setpoint = Setpoint(Kind.BRAKE)
    answers = []
    commands = log.command_ned_m_s.tolist()
    now_s = float(log.time_s[0])
    for row, at_s in enumerate(log.time_s.tolist()):
        changes_s = min(max(float(log.command_from_s[row]), now_s), at_s)
        if changes_s > now_s:
            motion = vehicle.step(motion, setpoint, around, changes_s - now_s)
        if setpoint.velocity_ned_m_s != tuple(commands[row]):
            north, east, down = commands[row]
            velocity_m_s = Vector((north, east, down))
            setpoint = Setpoint(Kind.STREAM, velocity_ned_m_s=velocity_m_s, yaw_rad=0.0)
        if at_s > changes_s:
            motion = vehicle.step(motion, setpoint, around, at_s - changes_s)
        now_s = at_s
        answers.append(vehicle.estimate(motion.body, around).velocity_ned_m_s)
    return np.array(answers)


def vehicle_of(flavour: FlavourName) -> Vehicle:
    """Return the calibrated copter of a flavour."""
    return px4_quadrotor() if flavour is FlavourName.PX4 else arducopter_quadrotor()


def guess(path: Path, log: StepLog) -> tuple[FlavourName, str]:
    """Return the flavour from the file's name, otherwise the better fit, and which of the two it was."""
    name = path.name.lower()
    if "px4" in name:
        return FlavourName.PX4, "the file's name"
    if "ardu" in name or "copter" in name:
        return FlavourName.ARDUCOPTER, "the file's name"
    misfit = {
        flavour: float(np.mean((replay(log, vehicle_of(flavour)) - log.velocity_ned_m_s) ** 2))
        for flavour in FlavourName
    }
    return min(FlavourName, key=misfit.__getitem__), "the better fit"


_STEP_S = 0.02
_VELOCITY_AND_YAW = 2503
_LOCAL_NED = 1
_ROOM_M = 20.0
CLIMB_S = 600.0
_SETTLE_S = 30.0
_RUN_UP_S = 5.0
"""Time in which it reaches the log's first velocity."""
_HEARTBEAT_EVERY = 50

_SET_MODE = 176
_ARM = 400
_TAKE_OFF = 22
_SET_MESSAGE_INTERVAL = 511
_REQUEST_OF = 32


class _Client:
    """A companion on the vehicle's first link: one setpoint per step, one heartbeat per second."""

    def __init__(self, flavour: FlavourName) -> None:
        self.vehicle = MockVehicle(flavour.value, noise=False, ready_after_s=0.0)
        self.now_s = 0.0
        self.down_m = 0.0
        self.heard: list[tuple[float, float, float, float]] = []
        self._steps = 0
        self._encoder = Encoder(255, 190)
        self._decoder = Decoder()

    def step(
        self, velocity: tuple[float, float, float] | None, *commands: tuple[float, ...]
    ) -> None:
        """Advance by one step with the messages to send."""
        self._steps += 1
        self.now_s = self._steps * _STEP_S
        pack = self._encoder.pack
        frames = [
            pack("COMMAND_LONG", 1, 1, int(c[0]), 0, *c[1:], *[0.0] * (8 - len(c)))
            for c in commands
        ]
        if velocity is not None:
            still = (0.0,) * 5
            frames.append(
                pack(
                    "SET_POSITION_TARGET_LOCAL_NED",
                    *(
                        round(self.now_s * 1000.0),
                        1,
                        1,
                        _LOCAL_NED,
                        _VELOCITY_AND_YAW,
                        0.0,
                        0.0,
                        0.0,
                        *velocity,
                    ),
                    *still,
                )
            )
        if self._steps % _HEARTBEAT_EVERY == 0:
            frames.append(pack("HEARTBEAT", 18, 8, 0, 0, 4, 3))
        for frame in self.vehicle.step(self.now_s, frames):
            for message in self._decoder.feed(frame):
                if message.get_type() == "LOCAL_POSITION_NED":
                    self.down_m = message.z
                    self.heard.append(
                        (message.time_boot_ms * 1e-3, message.vx, message.vy, message.vz)
                    )


def fly_log(log: StepLog, flavour: FlavourName) -> Samples:
    """Return the velocities reported by a whole mock vehicle at the log's times, shape (rows, 3), m/s.

    The vehicle takes off high enough for every descent of the log, hovers until its integrators rest, reaches the log's
    first velocity, and is then sent the log's commands at 50 Hz. Its estimator's noise is off.

    Raises:
        MockError: The vehicle did not get into the air.
    """
    client = _Client(flavour)
    down_m = log.position_ned_m[:, 2]
    north, east, down = log.velocity_ned_m_s[0].tolist()
    height_m = float(down_m.max() - down_m[0]) + max(down, 0.0) * _RUN_UP_S + _ROOM_M
    if flavour is FlavourName.PX4:
        up = (0.0, 0.0, -3.0)
        top_down_m = -height_m
        for _ in range(50):
            client.step(up)
        client.step(up, (_SET_MODE, 1, 6))
        client.step(up, (_ARM, 1))
    else:
        up = None
        top_down_m = 1.0 - height_m
        client.step(up, (_SET_MESSAGE_INTERVAL, _REQUEST_OF, 33_333))
        client.step(up, (_SET_MODE, 1, 4))
        client.step(up, (_ARM, 1))
        client.step(up, (_TAKE_OFF, 0, 0, 0, 0, 0, 0, height_m))
    while client.down_m > top_down_m:
        client.step(up)
        if client.now_s > CLIMB_S:
            vehicle = client.vehicle
            msg = f"the mock did not take off: mode {vehicle.mode}, armed {vehicle.armed}"
            raise MockError(msg)
    for _ in range(round(_SETTLE_S / _STEP_S)):
        client.step((0.0, 0.0, 0.0))
    for _ in range(round(_RUN_UP_S / _STEP_S)):
        client.step((north, east, down))
    client.heard.clear()
    begun_s = client.now_s
    commands = [(n, e, d) for n, e, d in log.command_ned_m_s.tolist()]
    begins_s = log.command_from_s - log.time_s[0]
    end_s = float(log.time_s[-1] - log.time_s[0])
    while client.now_s - begun_s < end_s + 2 * _STEP_S:
        row = int(np.searchsorted(begins_s, client.now_s + _STEP_S - begun_s + 1e-9)) - 1
        client.step(commands[max(row, 0)])
    samples = np.array(client.heard)
    since_s = samples[:, 0] - begun_s + log.time_s[0]
    return np.stack(
        [np.interp(log.time_s, since_s, samples[:, 1 + axis]) for axis in range(3)], axis=1
    )
