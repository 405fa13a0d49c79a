"""Checks the replies of daemons. They come from a wire, and one vehicle's bad reply must not hide the others.

A reply is a JSON object of bounded size and depth. Its numbers are finite, and each field that a display uses has its
type. Anything else becomes a refusal in the name of the vehicle that sent it, so that the client sees whose fault it
is. The name comes from the key of the reply, which a router's access control checks, never from its body.
"""

import json
import math
import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

from guidance.texts import printable

Reply = Mapping[str, Any]

MAX_REPLY_BYTES: Final = 1 << 18
"""A status of a team of thirty has 20 kB."""

MAX_DEPTH: Final = 8
"""Nesting of a reply. A status has five levels."""

MAX_ITEMS: Final = 256
"""Longest list or object in a reply."""

LARGEST_INTEGER: Final = 2**53
"""JSON has integers of any length; this one is the largest that every reader keeps exactly."""

BAD_REPLY: Final = "bad reply"
"""The state in place of a reply that cannot be read."""

_NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,32}")
"""As in a vehicle file."""

NAME_RULE: Final = "a name has up to 32 letters, digits, - and _"

_Check = Callable[[object], bool]


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_flag(value: object) -> bool:
    return isinstance(value, bool)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_none_or(check: _Check, value: object) -> bool:
    return value is None or check(value)


def _is_list(check: _Check, value: object) -> bool:
    return isinstance(value, list) and all(map(check, value))


def _is_vector(value: object) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(map(_MAYBE_NUMBER, value))


def _is_texts_by_name(value: object) -> bool:
    return isinstance(value, dict) and all(map(_is_text, value.values()))


def _is_record(needed: Mapping[str, _Check], optional: Mapping[str, _Check], value: object) -> bool:
    """Check the fields of an object. More fields are allowed: a newer daemon may have some."""
    if not isinstance(value, dict) or not needed.keys() <= value.keys():
        return False
    checks = {**needed, **optional}
    return all(checks[name](part) for name, part in value.items() if name in checks)


_MAYBE_TEXT: Final = partial(_is_none_or, _is_text)
_MAYBE_NUMBER: Final = partial(_is_none_or, _is_number)
_LIST_OF_TEXTS: Final = partial(_is_list, _is_text)
_TO_DO: Final = partial(
    _is_record, dict.fromkeys(("name", "found", "wanted", "verdict", "advice"), _is_text), {}
)
_PROMISE: Final = partial(
    _is_record,
    {"evader": _is_text, "standing": _is_text, "words": _is_text},
    {"first": _MAYBE_TEXT, "second": _MAYBE_TEXT},
)
_ASSIGNMENT: Final = partial(
    _is_record,
    {
        "evader": _is_text,
        "coordinator": _is_text,
        "over": _LIST_OF_TEXTS,
        "promises": partial(_is_list, _PROMISE),
    },
    {},
)
_GAME: Final = partial(
    _is_record,
    {"winner": _is_text},
    {
        "vehicle_winner": _is_text,
        "active_limits": _LIST_OF_TEXTS,
        "value": _MAYBE_NUMBER,
        "gap_m": _MAYBE_NUMBER,
        "time_needed_s": _MAYBE_NUMBER,
        "reachable_speed_m_s": _MAYBE_NUMBER,
    },
)
_TEXTS: Final = (
    "order",
    "state",
    "mode",
    "autopilot_mode",
    "next",
    "recording",
    "reason",
    "team",
    "after_capture",
)
_NUMBERS: Final = (
    "heartbeat_age_s", "position_age_s", "evader_silence_s", "operator_silence_s", "operator_timeout_s", "battery",
    "height_m", "range_m", "waited_s", "connect_timeout_s",
)  # fmt: skip
_FIELDS: Final[Mapping[str, _Check]] = {
    **dict.fromkeys(_TEXTS, _is_text),
    **dict.fromkeys(_NUMBERS, _MAYBE_NUMBER),
    "waiting_for": _is_text,
    "value_unit": _is_text,
    "accepted": _is_flag,
    "armed": _is_flag,
    "streaming": _is_flag,
    "position_ned_m": _is_vector,
    "velocity_ned_m_s": _is_vector,
    "vehicles": _LIST_OF_TEXTS,
    "refused_orders": _is_texts_by_name,
    "to_do": partial(_is_list, _TO_DO),
    "certificate": partial(_is_none_or, _GAME),
    "assignment": _ASSIGNMENT,
}
"""Every field that `guidance ctl` or the page uses, and its type."""

_TOGETHER: Final = (
    ("waiting_for", ("waited_s", "connect_timeout_s")),
    ("height_m", ("position_ned_m", "velocity_ned_m_s")),
    ("certificate", ("range_m", "value_unit")),
)
"""Fields that are shown together: a reply with the first has the others."""


def read_reply(data: bytes, name: str, order: str) -> Reply:
    """Read a daemon's reply to an order or a query; a bad one becomes a refusal with the reason.

    Args:
        data: The reply, from a wire.
        name: The vehicle's, from the key of the reply.
        order: The order or query.

    Returns:
        At least `name`, `order` and `accepted`. Texts have no control characters.
    """
    if len(data) > MAX_REPLY_BYTES:
        return bad_reply(name, order, f"{len(data)} bytes; at most {MAX_REPLY_BYTES} are read")
    try:
        reply = _cleaned(json.loads(data), 0)
        if isinstance(reply, dict):
            _check(reply, order)
    except _UnusableError as error:
        return bad_reply(name, order, str(error))
    except (ValueError, RecursionError):
        return bad_reply(name, order, "it is not JSON")
    if not isinstance(reply, dict):
        return bad_reply(name, order, "it is not a JSON object")
    return {**reply, "name": name, "order": order}


def written(answer: object) -> bytes:
    """Write an answer as JSON for the wire. Numbers that are not finite become null."""
    return json.dumps(_without_nan(answer)).encode()


def bad_reply(name: str, order: str, reason: str) -> Reply:
    """Return a refusal in place of an unusable reply."""
    words = (
        f"its daemon's reply cannot be used ({reason}); check its version, or take over by radio"
    )
    return refused(name, order, BAD_REPLY, words)


def refused(name: str, order: str, state: str, reason: str) -> Reply:
    """Return a refusal in place of a daemon's own."""
    return {"accepted": False, "name": name, "order": order, "state": state, "reason": reason}


def is_bad(answer: Reply) -> bool:
    """True if the answer replaces an unusable reply."""
    return bool(answer.get("state") == BAD_REPLY)


def is_vehicle_name(name: str) -> bool:
    """True if a vehicle may have this name."""
    return _NAME.fullmatch(name) is not None


class _UnusableError(ValueError):
    """Fault of a reply that is JSON."""


def _without_nan(value: Any) -> Any:  # noqa: ANN401 - JSON
    if isinstance(value, Mapping):
        return {name: _without_nan(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _cleaned(value: Any, depth: int) -> Any:  # noqa: ANN401 - JSON
    """Return the value with printable texts.

    Raises:
        _UnusableError: If it is nested too deep, too long, or has a number that is not finite or too large for a float.
    """
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, float) and not math.isfinite(value):
        raise _UnusableError("a number in it is not finite")
    if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        raise _UnusableError(f"an integer in it is larger than {LARGEST_INTEGER}")
    if not isinstance(value, list | dict):
        return value
    if depth >= MAX_DEPTH:
        raise _UnusableError(f"it is nested more than {MAX_DEPTH} deep")
    if len(value) > MAX_ITEMS:
        raise _UnusableError(f"a list in it has {len(value)} items; at most {MAX_ITEMS} are read")
    if isinstance(value, list):
        return [_cleaned(part, depth + 1) for part in value]
    return {printable(key): _cleaned(part, depth + 1) for key, part in value.items()}


def _check(reply: Mapping[str, Any], order: str) -> None:
    """Raise _UnusableError with the name of the first field that is missing or has a wrong type."""
    if "accepted" not in reply:
        raise _UnusableError("accepted is missing")
    if reply.get("order", order) != order:
        raise _UnusableError("it answers another order")
    for field, check in _FIELDS.items():
        if field in reply and not check(reply[field]):
            raise _UnusableError(f"{field} has a wrong type")
    for field, others in _TOGETHER:
        if reply.get(field) is not None and not reply.keys() >= set(others):
            raise _UnusableError(f"{field} without {', '.join(others)}")
