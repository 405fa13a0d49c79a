"""MAVLink frames: values to bytes, bytes to messages, signatures. Nothing of pymavlink's is used."""

from sitl_mock.mavlink.decoder import MAX_FRAME, Counts, Decoder
from sitl_mock.mavlink.dialect import (
    SPEC_BY_ID,
    SPEC_BY_NAME,
    EncodeError,
    FieldValue,
    MessageSpec,
    spec_of,
)
from sitl_mock.mavlink.encoder import Encoder
from sitl_mock.mavlink.message import Message
from sitl_mock.mavlink.signing import Signing, Verdict

__all__ = [
    "MAX_FRAME",
    "SPEC_BY_ID",
    "SPEC_BY_NAME",
    "Counts",
    "Decoder",
    "EncodeError",
    "Encoder",
    "FieldValue",
    "Message",
    "MessageSpec",
    "Signing",
    "Verdict",
    "spec_of",
]
