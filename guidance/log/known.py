"""What a record says of a value: JSON, in which an unknown is left out.

JSON has no NaN, and viewers of records know no nullable type: they want `"type": "number"` or nothing. So a field that
is not known (None, NaN, infinite) is left out of its object. In an array, which must keep its places, it is null.
"""

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any


def known(value: Any) -> Any:  # noqa: ANN401 - any value of a row
    """Turn a value into what JSON can hold: named tuples by field, without what is not known."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "_asdict"):
        return _known_of(value._asdict().items())
    if isinstance(value, Mapping):
        return _known_of(value.items())
    if isinstance(value, (list, tuple)):
        return [known(item) for item in value]
    return value


def in_bytes(row: Any) -> bytes:  # noqa: ANN401
    """Lay a row out as JSON."""
    return json.dumps(known(row), separators=(",", ":"), allow_nan=False).encode()


def _known_of(items: Iterable[tuple[Any, Any]]) -> dict[str, Any]:
    return {str(name): said for name, item in items if (said := known(item)) is not None}
