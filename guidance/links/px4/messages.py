"""PX4's messages over Zenoh: their fields, the hashes of their types, and their bytes.

PX4's Zenoh module publishes its internal messages as ROS 2 topics, by the conventions of rmw_zenoh. Every message has a
fixed length, so its CDR is a C structure with the alignment of each number, after four bytes of encapsulation. PX4
sends padding after it, and silently drops messages longer than its own structure and those four bytes.

A hash names a type with all its fields. PX4 v1.17 has the hashes below. A message of another version has another hash
and is refused by name, because its fields may have another meaning.

Sources: PX4 v1.17, `msg/` and `src/modules/zenoh/`; the CDR of the OMG's DDSI-RTPS; REP 2016 for the hashes.
"""

import re
import struct
from collections import namedtuple
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

ENCAPSULATION: Final = b"\x00\x01\x00\x00"
"""CDR version 1, little-endian."""

_MARGIN_BYTES: Final = 24
"""PX4 sends its own structure's size and this many more bytes."""

_CODES: Final = {
    "bool": "?",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}

TopicFields = Any
"""A decoded message: a tuple with its fields' names. Arrays of numbers are `velocity_0` and so on, of bytes `bytes`."""


class _Member(NamedTuple):
    name: str
    code: str
    bytes: int
    alignment: int


_TABLES: Final[Mapping[str, tuple[str, str]]] = {
    "Event": (
        "4964812eb982e8d7855e07632a5b462b0beeb3a19e116913506b339eb1c876a9",
        "uint64 timestamp, uint32 id, uint16 event_sequence, uint8[25] arguments, uint8 log_levels",
    ),
    "RegisterExtComponentRequest": (
        "dc16364abd320fd4faa00f7cb9fe239f324a7c0f9e2d71f9ed6083afe3b5de2b",
        "uint64 timestamp, uint64 request_id, uint8[25] name, uint16 px4_ros2_api_version, "
        "bool register_arming_check, bool register_mode, bool register_mode_executor, "
        "bool enable_replace_internal_mode, uint8 replace_internal_mode, bool activate_mode_immediately",
    ),
    "RegisterExtComponentReply": (
        "cc8fe5e12b0cc58c2c976a5bcdfac5af3fa39f1b0b74c8073285dcbe6e62ed90",
        "uint64 timestamp, uint64 request_id, uint8[25] name, uint16 px4_ros2_api_version, "
        "bool success, int8 arming_check_id, int8 mode_id, int8 mode_executor_id",
    ),
    "UnregisterExtComponent": (
        "93b673ec972cd7ee9dfb325f4dd7dbf7b3eb990af94b3a6467fc9278827ba099",
        "uint64 timestamp, uint8[25] name, int8 arming_check_id, int8 mode_id, int8 mode_executor_id",
    ),
    "ArmingCheckRequest": (
        "e4d6be7c8f4d5e08cd19e344ba59a76295dbcf71a6a29ed9efd44d6ea588a5eb",
        "uint64 timestamp, uint8 request_id, uint32 valid_registrations_mask",
    ),
    "ArmingCheckReply": (
        "bbab73fbc7dedd6d2e4c40d2c14ee23f8e563fdf5e82d26d843842bfa358b07c",
        "uint64 timestamp, uint8 request_id, uint8 registration_id, uint8 health_component_index, "
        "bool health_component_is_present, bool health_component_warning, bool health_component_error, "
        "bool can_arm_and_run, uint8 num_events, Event[5] events, bool mode_req_angular_velocity, "
        "bool mode_req_attitude, bool mode_req_local_alt, bool mode_req_local_position, "
        "bool mode_req_local_position_relaxed, bool mode_req_global_position, "
        "bool mode_req_global_position_relaxed, bool mode_req_mission, bool mode_req_home_position, "
        "bool mode_req_prevent_arming, bool mode_req_manual_control",
    ),
    "VehicleStatus": (
        "828bddbb7d4c2aa6ad93757955f6893be1ec5d8f11885ec7715bcdd76b5226c9",
        "uint64 timestamp, uint64 armed_time, uint64 takeoff_time, uint8 arming_state, "
        "uint8 latest_arming_reason, uint8 latest_disarming_reason, uint64 nav_state_timestamp, "
        "uint8 nav_state_user_intention, uint8 nav_state, uint8 executor_in_charge, "
        "uint32 valid_nav_states_mask, uint32 can_set_nav_states_mask, uint16 failure_detector_status, "
        "uint8 hil_state, uint8 vehicle_type, bool failsafe, bool failsafe_and_user_took_over, "
        "uint8 failsafe_defer_state, bool gcs_connection_lost, uint8 gcs_connection_lost_counter, "
        "bool high_latency_data_link_lost, bool is_vtol, bool is_vtol_tailsitter, "
        "bool in_transition_mode, bool in_transition_to_fw, uint8 system_type, uint8 system_id, "
        "uint8 component_id, bool safety_button_available, bool safety_off, bool power_input_valid, "
        "bool usb_connected, bool open_drone_id_system_present, bool open_drone_id_system_healthy, "
        "bool parachute_system_present, bool parachute_system_healthy, bool rc_calibration_in_progress, "
        "bool calibration_enabled, bool pre_flight_checks_pass",
    ),
    "ModeCompleted": (
        "9b2bbfcc9a544dd64c8e534a342c6b4567c8486c376e724453d0f4b86f3ee21d",
        "uint64 timestamp, uint8 result, uint8 nav_state",
    ),
    "VehicleCommand": (
        "1f0ab537807e2e20e04826633ea2c52e5431bea8eb0187152ff23bd07f1dd30b",
        "uint64 timestamp, float32 param1, float32 param2, float32 param3, float32 param4, "
        "float64 param5, float64 param6, float32 param7, uint32 command, uint8 target_system, "
        "uint8 target_component, uint8 source_system, uint16 source_component, uint8 confirmation, "
        "bool from_external",
    ),
    "VehicleCommandAck": (
        "36038d69f9db90980fb8fe154f27f22dffed0c35e530b32413cf0456aa8a29e2",
        "uint64 timestamp, uint32 command, uint8 result, uint8 result_param1, int32 result_param2, "
        "uint8 target_system, uint16 target_component, bool from_external",
    ),
    "TrajectorySetpoint": (
        "9a7deb0cb7db5e52b441169a284b90188c4efdf06b302d55cb1db33ca0358c1a",
        "uint64 timestamp, float32[3] position, float32[3] velocity, float32[3] acceleration, "
        "float32[3] jerk, float32 yaw, float32 yawspeed",
    ),
    "VehicleLocalPosition": (
        "690ad535169297241c696494adbd98bbdc45566645026fe7963513a29a1bf144",
        "uint64 timestamp, uint64 timestamp_sample, bool xy_valid, bool z_valid, bool v_xy_valid, "
        "bool v_z_valid, float32 x, float32 y, float32 z, float32[2] delta_xy, uint8 xy_reset_counter, "
        "float32 delta_z, uint8 z_reset_counter, float32 vx, float32 vy, float32 vz, float32 z_deriv, "
        "float32[2] delta_vxy, uint8 vxy_reset_counter, float32 delta_vz, uint8 vz_reset_counter, "
        "float32 ax, float32 ay, float32 az, float32 heading, float32 heading_var, "
        "float32 unaided_heading, float32 delta_heading, uint8 heading_reset_counter, "
        "bool heading_good_for_control, float32 tilt_var, bool xy_global, bool z_global, "
        "uint64 ref_timestamp, float64 ref_lat, float64 ref_lon, float32 ref_alt, bool dist_bottom_valid, "
        "float32 dist_bottom, float32 dist_bottom_var, float32 delta_dist_bottom, "
        "uint8 dist_bottom_reset_counter, uint8 dist_bottom_sensor_bitfield, float32 eph, float32 epv, "
        "float32 evh, float32 evv, bool dead_reckoning, float32 vxy_max, float32 vz_max, "
        "float32 hagl_min, float32 hagl_max_z, float32 hagl_max_xy",
    ),
    "VehicleGlobalPosition": (
        "cf9a06f6a8c328f7200984e3aabc0fb76fde3b1fa693baff68ebaf162d2fdc60",
        "uint64 timestamp, uint64 timestamp_sample, float64 lat, float64 lon, float32 alt, "
        "float32 alt_ellipsoid, bool lat_lon_valid, bool alt_valid, float32 delta_alt, "
        "float32 delta_terrain, uint8 lat_lon_reset_counter, uint8 alt_reset_counter, "
        "uint8 terrain_reset_counter, float32 eph, float32 epv, float32 terrain_alt, "
        "bool terrain_alt_valid, bool dead_reckoning",
    ),
    "BatteryStatus": (
        "92fd1f3af4149312736945b5a3537b61e5268fca090d27abbb3b8ba243a5df8e",
        "uint64 timestamp, bool connected, float32 voltage_v, float32 current_a, "
        "float32 current_average_a, float32 discharged_mah, float32 remaining, float32 scale, "
        "float32 time_remaining_s, float32 temperature, uint8 cell_count, uint8 source, uint8 priority, "
        "uint16 capacity, uint16 cycle_count, uint16 average_time_to_empty, uint16 manufacture_date, "
        "uint16 state_of_health, uint16 max_error, uint8 id, uint16 interface_error, "
        "float32[14] voltage_cell_v, float32 max_cell_voltage_delta, bool is_powering_off, "
        "bool is_required, uint8 warning, uint16 faults, float32 full_charge_capacity_wh, "
        "float32 remaining_capacity_wh, uint16 over_discharge_count, float32 nominal_voltage, "
        "float32 internal_resistance_estimate, float32 ocv_estimate, float32 ocv_estimate_filtered, "
        "float32 volt_based_soc_estimate, float32 voltage_prediction, float32 prediction_error, "
        "float32 estimation_covariance_norm",
    ),
    "VehicleLandDetected": (
        "ced22fc1699e2a3746a1fa86aa4b5463b42f5b9c97e7913063365a04d8324901",
        "uint64 timestamp, bool freefall, bool ground_contact, bool maybe_landed, bool landed, "
        "bool in_ground_effect, bool in_descend, bool has_low_throttle, bool vertical_movement, "
        "bool horizontal_movement, bool rotational_movement, bool close_to_ground_or_skipped_check, "
        "bool at_rest",
    ),
}
"""By name: the hash of the type, and the fields in order. PX4's text of characters is an array of bytes."""

_ARRAY: Final = re.compile(r"(\w+)\[(\d+)\]")


def _members(fields: str) -> Iterator[_Member]:
    """Yield all numbers of a message in order; a message within it yields its own."""
    for field in fields.split(", "):
        kind, name = field.split(" ")
        array = _ARRAY.fullmatch(kind)
        count = 1
        if array is not None:
            kind = array[1]
            count = int(array[2])
        if kind in _TABLES:
            for index in range(count):
                for member in _members(_TABLES[kind][1]):
                    yield member._replace(name=f"{name}_{index}_{member.name}")
        elif kind == "uint8" and array is not None:
            yield _Member(name, f"{count}s", count, 1)
        else:
            size = struct.calcsize("<" + _CODES[kind])
            for index in range(count):
                numbered = name if array is None else f"{name}_{index}"
                yield _Member(numbered, _CODES[kind], size, size)


class MessageType:
    """A type of message.

    Attributes:
        name: In PX4, as VehicleStatus.
        fields: Types and names of the fields, as in the tables.
        hash: By REP 2016, with its prefix.
        type_name: In keys: `px4_msgs::msg::dds_::VehicleStatus_`.
        most_bytes: The longest payload that PX4 sends.
    """

    def __init__(self, name: str) -> None:
        digits, fields = _TABLES[name]
        members = list(_members(fields))
        layout = "<"
        length = 0
        for member in members:
            gap = -length % member.alignment
            layout += f"{gap}x{member.code}"
            length += gap + member.bytes
        self._struct = struct.Struct(layout)
        make: Any = namedtuple
        record = make(name, [member.name for member in members])
        self._record = record
        self._empty = record(*(b"" if member.code.endswith("s") else 0 for member in members))
        # PX4 sorts the fields by size: its structure has padding at the end only
        own_bytes = sum(member.bytes for member in members)
        own_bytes += -own_bytes % 8
        self.name = name
        self.fields = fields
        self.hash = f"RIHS01_{digits}"
        self.type_name = f"px4_msgs::msg::dds_::{name}_"
        self.most_bytes = own_bytes + len(ENCAPSULATION) + _MARGIN_BYTES

    def key(self, domain_id: int, topic: str) -> str:
        """Return the key of a topic, as `fmu/out/vehicle_status`, in a ROS domain."""
        return f"{domain_id}/{topic}/{self.type_name}/{self.hash}"

    def encode(self, **values: float | bytes) -> bytes:
        """Return a message; fields that are not given are 0.

        Raises:
            ValueError: If there is no such field, or a number does not fit.
        """
        try:
            return ENCAPSULATION + self._struct.pack(*self._empty._replace(**values))
        except (struct.error, OverflowError) as error:
            raise ValueError(f"{self.name}: {error}") from error

    def decode(self, data: bytes) -> TopicFields:
        """Read a message.

        Raises:
            ValueError: If the bytes are not one: another encapsulation, too few bytes, or more than PX4 sends.
        """
        least = self._struct.size + len(ENCAPSULATION)
        if not least <= len(data) <= self.most_bytes:
            raise ValueError(f"{self.name}: {len(data)} bytes, not {least} to {self.most_bytes}")
        if data[: len(ENCAPSULATION)] != ENCAPSULATION:
            raise ValueError(f"{self.name}: an unknown encapsulation")
        return self._record._make(self._struct.unpack_from(data, len(ENCAPSULATION)))


TYPES: Final[Mapping[str, MessageType]] = {name: MessageType(name) for name in _TABLES}
"""All types, by name."""


def name_bytes(name: str) -> bytes:
    """Return a name as PX4's 25 bytes of text.

    Raises:
        ValueError: If it is empty, longer than 24 bytes or has other than printable ASCII characters.
    """
    encoded = name.encode("ascii", "replace")
    if not 0 < len(encoded) <= 24 or not name.isascii() or not name.isprintable():
        raise ValueError("must have 1 to 24 printable ASCII characters; PX4 keeps 24")
    return encoded.ljust(25, b"\0")


FROM_PX4: Final[Mapping[str, str]] = {
    "register_ext_component_reply": "RegisterExtComponentReply",
    "arming_check_request": "ArmingCheckRequest",
    "mode_completed": "ModeCompleted",
    "vehicle_status": "VehicleStatus",
    "vehicle_command_ack": "VehicleCommandAck",
    "vehicle_local_position": "VehicleLocalPosition",
    "vehicle_global_position": "VehicleGlobalPosition",
    "vehicle_land_detected": "VehicleLandDetected",
    "battery_status": "BatteryStatus",
}
"""The topics below fmu/out that a link reads, and their types."""

TO_PX4: Final[Mapping[str, str]] = {
    "register_ext_component_request": "RegisterExtComponentRequest",
    "unregister_ext_component": "UnregisterExtComponent",
    "arming_check_reply": "ArmingCheckReply",
    "mode_completed": "ModeCompleted",
    "trajectory_setpoint": "TrajectorySetpoint",
    "vehicle_command": "VehicleCommand",
    "vehicle_command_mode_executor": "VehicleCommand",
}
"""The topics below fmu/in that a link writes, and their types."""
