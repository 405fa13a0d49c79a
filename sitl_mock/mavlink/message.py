"""A decoded message, read as one of pymavlink: fields are attributes, and `get_type()` and its like tell the rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sitl_mock.mavlink.signing import BLOCK_LENGTH

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sitl_mock.mavlink.dialect import MessageSpec


_MAGIC_V2: Final = 0xFD
_SIGNED: Final = 0x01
_SEQUENCE_V2: Final = 4
_SEQUENCE_V1: Final = 2
"""Index of the sequence number in a frame; system and component follow it."""


class Message:
    """One message of the wire.

    Args:
        spec: What kind of message it is.
        values: Its fields in the order of the payload.
        frame: All bytes of its frame.
        signed: Its signature is good.
    """

    __slots__ = ("__dict__", "_frame", "_sender_at", "_signed", "_spec")

    def __init__(
        self,
        spec: MessageSpec,
        values: Sequence[Any],
        frame: bytes,
        *,
        signed: bool = False,
    ) -> None:
        self._spec = spec
        self._frame = frame
        self._sender_at = (_SEQUENCE_V2 if frame[0] == _MAGIC_V2 else _SEQUENCE_V1) + 1
        self._signed = signed
        self.__dict__.update(zip(spec.wire_names, values))  # noqa: B905 - a spec unpacks one value for each name

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - fields have any wire type
            """Return a field."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Message) and self._frame == other._frame

    def __hash__(self) -> int:
        return hash(self._frame)

    def __str__(self) -> str:
        fields = ", ".join(f"{name} : {getattr(self, name)}" for name in self._spec.field_names)
        return f"{self._spec.name} {{{fields}}}"

    __repr__ = __str__

    def get_type(self) -> str:
        """Return the message's name."""
        return self._spec.name

    def get_msgId(self) -> int:  # noqa: N802 - as pymavlink's, like all of its kind
        """Return the message's id."""
        return self._spec.message_id

    def get_fieldnames(self) -> list[str]:
        """Return the names of the fields in the order of declaration."""
        return list(self._spec.field_names)

    def get_seq(self) -> int:
        """Return the frame's sequence number."""
        return self._frame[self._sender_at - 1]

    def get_srcSystem(self) -> int:  # noqa: N802
        """Return the sender's system id."""
        return self._frame[self._sender_at]

    def get_srcComponent(self) -> int:  # noqa: N802
        """Return the sender's component id."""
        return self._frame[self._sender_at + 1]

    def get_signed(self) -> bool:
        """Return True if a good signature closes the frame."""
        return self._signed

    def get_link_id(self) -> int | None:
        """Return the link id of the frame's signature; None without one."""
        is_signed = self._frame[0] == _MAGIC_V2 and self._frame[2] & _SIGNED
        return self._frame[-BLOCK_LENGTH] if is_signed else None

    def get_msgbuf(self) -> bytes:
        """Return all bytes of the frame."""
        return self._frame

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name, and the message's name as ``mavpackettype``."""
        fields = {name: getattr(self, name) for name in self._spec.field_names}
        return {"mavpackettype": self._spec.name, **fields}
