"""ROS 2 messages without ROS: CDR, names and hashes of their types, by the package `rosbags` (extra `ros`).

The definitions are those of ROS 2 Jazzy. `rosbags` is imported at the first use only.
"""

from functools import cache
from typing import Any, Final

from guidance.extras import require_extras

EXTRA: Final = "ros"

POSE_STAMPED: Final = "geometry_msgs/msg/PoseStamped"
TWIST_STAMPED: Final = "geometry_msgs/msg/TwistStamped"
ODOMETRY_TYPE: Final = "nav_msgs/msg/Odometry"
PATH_TYPE: Final = "nav_msgs/msg/Path"
MARKERS_TYPE: Final = "visualization_msgs/msg/MarkerArray"
TRANSFORMS_TYPE: Final = "tf2_msgs/msg/TFMessage"
DIAGNOSTICS_TYPE: Final = "diagnostic_msgs/msg/DiagnosticArray"

TRIGGER: Final = "std_srvs/srv/Trigger"
TRIGGER_RESPONSE: Final = "std_srvs/srv/msg/Trigger_Response"
TRIGGER_HASH: Final = "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
"""Hash of the service's type; `rosbags` computes those of messages only."""

RosValue = Any
"""A message: an object with the fields of its type. Vectors of numbers are arrays."""


def prepare(what: str, *type_names: str) -> None:
    """Check that `rosbags` is installed, and load it and these types, so that no cycle waits for that.

    Args:
        what: The key or command that needs it.
        type_names: Types of messages.

    Raises:
        ConfigError: If it is not installed; the message says how to install it.
    """
    require_extras(what, EXTRA)
    for name in type_names:
        types().get_msgdef(name)


@cache
def types() -> Any:  # noqa: ANN401 - of an extra
    """Return all message types, as a `rosbags.typesys.store.Typestore`."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - extra

    store = get_typestore(Stores.ROS2_JAZZY)
    response = get_types_from_msg("bool success\nstring message\n", "std_srvs/srv/Trigger_Response")
    store.register(response)
    return store


def encode_cdr(message: RosValue) -> bytes:
    """Return a message in plain CDR, little-endian, with four bytes of encapsulation."""
    data = types().serialize_cdr(message, message.__msgtype__, little_endian=True)
    return bytes(data)


def decode_cdr(data: bytes, type_name: str) -> RosValue:
    """Read a message in plain CDR version 1, of either byte order.

    Raises:
        ValueError: If the bytes are not one.
    """
    from rosbags.serde import SerdeError  # noqa: PLC0415 - as above

    try:
        return types().deserialize_cdr(data, type_name)
    except SerdeError as error:
        raise ValueError(f"not a {type_name}: {error}") from error


def dds_name(type_name: str) -> str:
    """Return the name of a type in DDS: `nav_msgs::msg::dds_::Odometry_` for `nav_msgs/msg/Odometry`."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def hash_of(type_name: str) -> str:
    """Return the hash of a message's or service's type by REP 2016: `RIHS01_` and 64 hexadecimal digits."""
    if type_name == TRIGGER:
        return TRIGGER_HASH
    return str(types().hash_rihs01(type_name))
