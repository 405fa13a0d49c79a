"""Messages of the mock's dialect that pymavlink lacks, as the classes that pymavlink would have."""

import struct
from typing import Any, Final

from pymavlink.dialects.v20 import all as dialect

from sitl_mock.mavlink import SPEC_BY_ID, MessageSpec


def _message_class(spec: MessageSpec) -> type[Any]:
    declared = {field.name: field for field in spec.wire_fields}

    def __init__(self: Any, *values: Any) -> None:  # noqa: N807 - as pymavlink's
        dialect.MAVLink_message.__init__(self, spec.message_id, spec.name)
        self._fieldnames = list(spec.field_names)
        for name, value in zip(spec.field_names, values, strict=True):
            if isinstance(value, bytes):
                text = value.split(b"\0", 1)[0].decode("ascii", errors="replace")
                setattr(self, name, text)
            else:
                setattr(self, name, value)

    layout = "<" + "".join(field.format for field in spec.wire_fields)
    return type(
        f"MAVLink_{spec.name.lower()}_message",
        (dialect.MAVLink_message,),
        {
            "__init__": __init__,
            "id": spec.message_id,
            "msgname": spec.name,
            "fieldnames": list(spec.field_names),
            "ordered_fieldnames": [field.name for field in spec.wire_fields],
            "fieldtypes": [declared[name].kind for name in spec.field_names],
            "orders": [list(declared).index(name) for name in spec.field_names],
            "lengths": [field.length or 1 for field in spec.wire_fields],
            "array_lengths": [field.length for field in spec.wire_fields],
            "crc_extra": spec.crc_extra[0],
            "unpacker": struct.Struct(layout),
        },
    )


NEWER: Final = {
    message_id: _message_class(spec)
    for message_id, spec in SPEC_BY_ID.items()
    if message_id not in dialect.mavlink_map
}
"""By id."""
