"""PX4's topics over Zenoh as one more link of a vehicle, without I/O.

A frame of this link is a topic's name, a zero byte, and the payload. `TopicLink` has the interface of `links.Link`.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Any, Final, cast

from sitl_mock.protocols import Command
from sitl_mock.px4.messages import message_type
from sitl_mock.px4.topics import SOURCES, position_setpoint_triplet
from sitl_mock.vector import Vector
from sitl_mock.vehicle.pilot import Sticks

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sitl_mock.mavlink import Message
    from sitl_mock.protocols import Reply
    from sitl_mock.px4.commander import Px4
    from sitl_mock.px4.topics import Source, Values
    from sitl_mock.telemetry import Report
    from sitl_mock.vehicle.autopilot import Autopilot

_END: Final = b"\0"
PUBLISHED: Final[Mapping[str, str]] = {
    "airspeed_validated": "AirspeedValidated",
    "arming_check_request": "ArmingCheckRequest",
    "battery_status": "BatteryStatus",
    "collision_constraints": "CollisionConstraints",
    "estimator_status_flags": "EstimatorStatusFlags",
    "failsafe_flags": "FailsafeFlags",
    "manual_control_setpoint": "ManualControlSetpoint",
    "mode_completed": "ModeCompleted",
    "position_setpoint_triplet": "PositionSetpointTriplet",
    "register_ext_component_reply": "RegisterExtComponentReply",
    "sensor_combined": "SensorCombined",
    "timesync_status": "TimesyncStatus",
    "vehicle_attitude": "VehicleAttitude",
    "vehicle_command_ack": "VehicleCommandAck",
    "vehicle_control_mode": "VehicleControlMode",
    "vehicle_global_position": "VehicleGlobalPosition",
    "vehicle_gps_position": "SensorGps",
    "vehicle_land_detected": "VehicleLandDetected",
    "vehicle_local_position": "VehicleLocalPosition",
    "vehicle_odometry": "VehicleOdometry",
    "vehicle_status": "VehicleStatus",
}
"""Topics that PX4 publishes below ``/fmu/out``, and their messages (``dds_topics.yaml``)."""
SUBSCRIBED: Final[Mapping[str, str]] = {
    "actuator_motors": "ActuatorMotors",
    "actuator_servos": "ActuatorServos",
    "arming_check_reply": "ArmingCheckReply",
    "aux_global_position": "VehicleGlobalPosition",
    "config_control_setpoints": "VehicleControlMode",
    "config_overrides_request": "ConfigOverrides",
    "distance_sensor": "DistanceSensor",
    "goto_setpoint": "GotoSetpoint",
    "manual_control_input": "ManualControlSetpoint",
    "mode_completed": "ModeCompleted",
    "obstacle_distance": "ObstacleDistance",
    "offboard_control_mode": "OffboardControlMode",
    "onboard_computer_status": "OnboardComputerStatus",
    "register_ext_component_request": "RegisterExtComponentRequest",
    "sensor_optical_flow": "SensorOpticalFlow",
    "telemetry_status": "TelemetryStatus",
    "trajectory_setpoint": "TrajectorySetpoint",
    "unregister_ext_component": "UnregisterExtComponent",
    "vehicle_attitude_setpoint": "VehicleAttitudeSetpoint",
    "vehicle_command": "VehicleCommand",
    "vehicle_command_mode_executor": "VehicleCommand",
    "vehicle_mocap_odometry": "VehicleOdometry",
    "vehicle_rates_setpoint": "VehicleRatesSetpoint",
    "vehicle_thrust_setpoint": "VehicleThrustSetpoint",
    "vehicle_torque_setpoint": "VehicleTorqueSetpoint",
    "vehicle_visual_odometry": "VehicleOdometry",
}
"""Topics that PX4 takes below ``/fmu/in``; those that `_obey` does not name are checked and have no effect.

PX4 v1.17 finds its own topic by the type of the message, not by the name (``zenoh status`` shows it). So the control
mode that a program asks for becomes the vehicle's own for a moment, an executor's commands are taken from anybody, and
overrides are lost.
"""
_ON_CHANGE: Final = ("vehicle_control_mode", "vehicle_status", "vehicle_land_detected")
"""Topics that PX4 also publishes at once when something but the time in them changes."""
_GOALS_US: Final = 48_000
_PAUSE_US: Final = 1e5
"""After a longer pause a topic begins anew instead of catching up."""


def frame_of(topic: str, payload: bytes) -> bytes:
    """Return the frame of one sample."""
    return topic.encode() + _END + payload


def sample_of(frame: bytes) -> tuple[str, bytes]:
    """Return topic and payload of a frame; bytes that are no frame have a topic that nobody knows."""
    topic, _, payload = frame.partition(_END)
    return topic.decode(errors="replace"), payload


class _Stream:
    """A topic that is published regularly."""

    __slots__ = ("_at_us", "_every_us", "_said", "_source", "_stamps", "name")

    def __init__(self, name: str, source: Source) -> None:
        self.name = name
        self._source = source
        self._every_us = 1e6 / source.hz
        self._at_us = -math.inf
        self._said: Values = ()
        second = source.message.fields[1].name
        self._stamps = 2 if second == "timestamp_sample" else 1

    def changed(self, report: Report) -> list[bytes]:
        """Return a sample if it is due or if it says something new."""
        values = self._source.build(report)
        said = values[self._stamps :]
        if said == self._said and report.boot_us < self._at_us:
            return []
        self._said = said
        self._at_us = report.boot_us + self._every_us
        if self.name == "vehicle_control_mode":
            cast("Px4", report.commander).external_control = None
        return [self._sample(values)]

    def due(self, report: Report) -> list[bytes]:
        """Return the samples that are due, each with its own time: a topic may be faster than the vehicle's ticks."""
        now_us = report.boot_us
        if now_us < self._at_us:
            return []
        if now_us > self._at_us + _PAUSE_US:
            self._at_us = now_us
        values = self._source.build(report)[self._stamps :]
        samples = []
        while self._at_us <= now_us:
            samples.append(self._sample((*(int(self._at_us),) * self._stamps, *values)))
            self._at_us += self._every_us
        return samples

    def _sample(self, values: Values) -> bytes:
        message = self._source.message
        return frame_of(self.name, message.encode(message.from_log_order(values)))


class TopicLink:
    """PX4's module ``zenoh`` of one vehicle.

    Args:
        autopilot: A vehicle whose commander is PX4's.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        self.to_forward: list[Message] = []
        self._autopilot = autopilot
        self._streams = [
            _Stream(name, source)
            for name, source in SOURCES.items()
            if source.hz and name in PUBLISHED
        ]
        self._counts: Counter[str] = Counter(samples=0, unknown_topic=0, wrong_size=0)
        self._goals_of = ""
        self._goals_us = -math.inf

    def counts(self) -> dict[str, int]:
        """Return the numbers of samples taken and dropped."""
        return dict(self._counts)

    def clients(self, _now_s: float) -> list[tuple[int, int]]:
        """Programs over Zenoh have no MAVLink ids."""
        return []

    def is_due(self, _now_s: float) -> bool:
        """True: there is something to publish at every tick."""
        return True

    def passed_on(self, _messages: Sequence[Message]) -> list[bytes]:
        """Return nothing, as `pack`."""
        return []

    def pack(self, _replies: Sequence[Reply]) -> list[bytes]:
        """Return nothing: MAVLink's messages are no topics."""
        return []

    def say(self, _now_s: float, _texts: Sequence[Reply]) -> list[bytes]:
        """Return nothing: texts are no topics."""
        return []

    # In

    def receive(self, now_s: float, frame: bytes) -> list[bytes]:
        """Take a sample; return the samples that answer it at once."""
        topic, payload = sample_of(frame)
        name = SUBSCRIBED.get(topic)
        if name is None:
            self._counts["unknown_topic"] += 1
            return []
        message = message_type(name).decode(payload)
        if message is None:
            self._counts["wrong_size"] += 1
            return []
        self._counts["samples"] += 1
        commander = cast("Px4", self._autopilot.commander)
        return self._answers() if _obey(commander, now_s, topic, message) else []

    def _answers(self) -> list[bytes]:
        """Return what the commander has to say, as samples."""
        out = cast("Px4", self._autopilot.commander).external.out
        now_us = self._autopilot.report.boot_us
        samples = []
        while out:
            topic, values = out.popleft()
            message = message_type(PUBLISHED[topic])
            samples.append(frame_of(topic, message.encoded(**{**values, "timestamp": now_us})))
        return samples

    # Out

    def send(self, _now_s: float, _tick: int) -> list[bytes]:
        """Return the samples that are due."""
        samples = self._answers()
        if self._autopilot.conditions.telemetry_frozen:
            return samples
        report = self._autopilot.report
        state = report.state
        has_sticks = state.pilot.fresh(state.now_s, float(state.parameters["COM_RC_LOSS_T"]))
        for stream in self._streams:
            if stream.name in _ON_CHANGE:
                samples += stream.changed(report)
            elif has_sticks or stream.name != "manual_control_setpoint":
                samples += stream.due(report)
        # The navigator's setpoints: 20 times a second while disarmed, in flight when a mode begins.
        mode = report.commander.mode
        is_due = not state.armed and report.boot_us >= self._goals_us
        if mode != self._goals_of or is_due:
            self._goals_of = mode
            self._goals_us = report.boot_us + _GOALS_US
            payload = message_type("PositionSetpointTriplet").encode(
                position_setpoint_triplet(report)
            )
            samples.append(frame_of("position_setpoint_triplet", payload))
        return samples


def _obey(px4: Px4, now_s: float, topic: str, message: Any) -> bool:  # noqa: ANN401 - a record
    """Do what a sample asks for; False if its topic has no effect."""
    match topic:
        case "arming_check_reply" | "register_ext_component_request" | "unregister_ext_component":
            px4.external.take(topic, message)
        case "config_control_setpoints":
            # VehicleControlMode is in force until PX4 publishes its own again.
            px4.external_control = message
            px4.external.out.append(("vehicle_control_mode", message._asdict()))
        case "goto_setpoint":
            # It must be cut to 44 bytes, since PX4 drops a whole one.
            if all(map(math.isfinite, message.position)):
                yaw_rad = message.heading if message.flag_control_heading else math.nan
                has_speed = message.flag_set_max_horizontal_speed
                speed_m_s = message.max_horizontal_speed if has_speed else math.nan
                px4.go_to(Vector(message.position), yaw_rad, speed_m_s)
        case "manual_control_input":
            sticks = (message.roll, message.pitch, message.throttle, message.yaw)
            if message.valid and all(abs(stick) <= 1.0 for stick in sticks):
                px4.state.pilot.hear(now_s, Sticks(*sticks))
        case "mode_completed":
            # Programs hear each other's, since in and out are one topic inside PX4.
            values = {"result": message.result, "nav_state": message.nav_state}
            px4.external.out.append(("mode_completed", values))
        case "offboard_control_mode":
            px4.stream_s = now_s
        case "trajectory_setpoint":
            px4.take_trajectory(message)
        case "vehicle_command" | "vehicle_command_mode_executor":
            params = tuple(getattr(message, f"param{index}") for index in range(1, 8))
            source = (message.source_system, message.source_component)
            command = Command(message.command, params, 0, False, source, message.confirmation)
            is_for_px4 = message.target_component in {0, 1}
            if message.target_system in {0, px4.state.system_id} and is_for_px4:
                px4.execute_topic(now_s, command)
        case _:
            return False
    return True
