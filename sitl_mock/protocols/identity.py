"""The vehicle's identity: AUTOPILOT_VERSION with true capability bits.

AVAILABLE_MODES (435) lists the modes.
Source: https://mavlink.io/en/services/standard_modes.html
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sitl_mock.protocols.session import Reply

FIRMWARE_RELEASE: Final = 255  # FIRMWARE_VERSION_TYPE_OFFICIAL


class Capability(IntFlag):
    """MAV_PROTOCOL_CAPABILITY."""

    MISSION_FLOAT = 1
    PARAM_FLOAT = 2
    MISSION_INT = 4
    COMMAND_INT = 8
    PARAM_ENCODE_BYTEWISE = 16
    FTP = 32
    SET_ATTITUDE_TARGET = 64
    SET_POSITION_TARGET_LOCAL_NED = 128
    SET_POSITION_TARGET_GLOBAL_INT = 256
    TERRAIN = 512
    FLIGHT_TERMINATION = 2048
    COMPASS_CALIBRATION = 4096
    MAVLINK2 = 8192
    MISSION_FENCE = 16384
    MISSION_RALLY = 32768


_SHARED: Final = (
    Capability.MISSION_FLOAT
    | Capability.MISSION_INT
    | Capability.COMMAND_INT
    | Capability.SET_ATTITUDE_TARGET
    | Capability.SET_POSITION_TARGET_LOCAL_NED
    | Capability.FLIGHT_TERMINATION
    | Capability.MAVLINK2
    | Capability.MISSION_FENCE
    | Capability.MISSION_RALLY
    | Capability.FTP
)
PX4_CAPABILITIES: Final = (
    _SHARED | Capability.PARAM_FLOAT | Capability.PARAM_ENCODE_BYTEWISE | Capability.FTP
)
"""PX4 accepts SET_POSITION_TARGET_GLOBAL_INT but lacks its bit."""
ARDUPILOT_CAPABILITIES: Final = (
    _SHARED
    | Capability.SET_POSITION_TARGET_GLOBAL_INT
    | Capability.PARAM_FLOAT
    | Capability.TERRAIN
    | Capability.COMPASS_CALIBRATION
)


@dataclass(frozen=True, slots=True)
class Identity:
    """Contents of AUTOPILOT_VERSION.

    Attributes:
        capabilities: What the mock supports.
        version: (major, minor, patch) of the imitated autopilot.
        os_version: (major, minor, patch) of its operating system.
        commit: Up to eight bytes of its commit.
        uid: Number of the vehicle, different for each of a fleet.
        board: board_version.
        uid2: Whether uid2 carries the number too.
    """

    capabilities: Capability
    version: tuple[int, int, int]
    os_version: tuple[int, int, int] = (0, 0, 0)
    commit: bytes = b""
    uid: int = 1
    board: int = 0
    uid2: bool = True

    def autopilot_version(self) -> Reply:
        """Return AUTOPILOT_VERSION."""
        flight = _packed(self.version)
        custom = self.commit[:8].ljust(8, b"\0")
        uid2 = self.uid.to_bytes(18, "little") if self.uid2 else bytes(18)
        return (
            "AUTOPILOT_VERSION",
            int(self.capabilities),
            flight,
            flight,
            _packed(self.os_version),
            self.board,
            custom,
            custom,
            bytes(8),
            0,
            0,
            self.uid & 0xFFFF_FFFF_FFFF_FFFF,
            uid2,
        )


def _packed(version: tuple[int, int, int]) -> int:
    major, minor, patch = version
    return major << 24 | minor << 16 | patch << 8 | FIRMWARE_RELEASE


_PX4_COMMIT: Final = bytes.fromhex("000000c4d12af1d6")
"""The release's commit in wire order, last byte first."""
_PX4_SIMULATED: Final = 5_283_920_058_631_409_231
"""The uid of every simulated PX4; a fleet counts from it, so that its vehicles differ."""


def px4_identity(uid: int) -> Identity:
    """Return the identity of a PX4 v1.17.0."""
    number = _PX4_SIMULATED + uid - 1
    return Identity(
        PX4_CAPABILITIES, (1, 17, 0), (6, 8, 0), _PX4_COMMIT, number, board=1, uid2=False
    )


def ardupilot_identity(uid: int) -> Identity:
    """Return the identity of an ArduPilot 4.5.7."""
    return Identity(ARDUPILOT_CAPABILITIES, (4, 5, 7), uid=uid)


ALL_MODES: Final = 0


def available_modes(modes: Sequence[tuple[int, int, int, str]], index: int) -> list[Reply]:
    """Return AVAILABLE_MODES for one mode (from 1) or all (0); empty if out of range.

    Args:
        modes: custom_mode, standard_mode, properties and name of each.
        index: Which one.
    """
    return [
        ("AVAILABLE_MODES", len(modes), number, standard, custom_mode, properties, name)
        for number, (custom_mode, standard, properties, name) in enumerate(modes, start=1)
        if index in {ALL_MODES, number}
    ]
