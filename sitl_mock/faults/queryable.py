"""Faults over Zenoh while a fleet runs: a query to `<vehicle>/faults` lists, injects or clears.

    {"do": "list"}                                        every fault that waits or acts
    {"do": "kinds"}                                       every kind there is, with its keys
    {"do": "inject", "kind": "loss", "probability": 0.3}  the keys of a fault in a script; at_s counts from now
    {"do": "clear", "number": 3}                          one fault, or all without a number

as JSON in the query's payload, or as its parameters: `uav1/faults?do=inject;kind=loss;probability=0.3`. The reply is
JSON; a wrong request is answered by an error reply `{"error": "..."}`.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

import zenoh

from sitl_mock.errors import ConfigError
from sitl_mock.faults.script import KINDS
from sitl_mock.tables import REQUIRED

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sitl_mock.faults.faulted import Faulted

_REQUESTS: Final = ("list", "kinds", "inject", "clear")
_LIST_KEYS: Final = frozenset({"messages", "fields", "commands"})


def answer(faulted: Faulted, request: Mapping[str, Any]) -> Any:  # noqa: ANN401 - JSON
    """Return the answer to a request.

    Raises:
        ConfigError: The request is wrong; the message has the key, its value and the allowed ones.
    """
    values = dict(request)
    do = values.pop("do", "list")
    if do not in _REQUESTS:
        raise ConfigError(f"do = {do!r}: allowed are {', '.join(_REQUESTS)}")
    if do == "inject":
        return {"number": faulted.inject(values)}
    allowed = ("number",) if do == "clear" else ()
    unknown = sorted(values.keys() - set(allowed))
    if unknown:
        raise ConfigError(
            f"{unknown[0]} = {values[unknown[0]]!r}: allowed are {', '.join(('do', *allowed))}"
        )
    if do == "list":
        return list(faulted.faults())
    if do == "clear":
        before = len(faulted.faults())
        faulted.clear(values.get("number"))
        return {"cleared": 1 if "number" in values else before}
    return {
        name: {
            "group": str(kind.group),
            "meaning": kind.meaning,
            "options": {key: option.meaning for key, option in kind.options.items()},
            "required": [key for key, option in kind.options.items() if option.default is REQUIRED],
        }
        for name, kind in KINDS.items()
    }


def declare(session: zenoh.Session, vehicles: Mapping[str, Faulted]) -> None:
    """Answer queries for every vehicle until the session is closed."""
    for name, faulted in vehicles.items():
        session.declare_queryable(f"{name}/faults", _answerer(faulted, f"{name}/faults"))


def read_request(parameters: str, payload: bytes | None) -> dict[str, Any]:
    """Return the keys of a request, from JSON or from the selector's parameters.

    Raises:
        ConfigError: It is neither.
    """
    if payload:
        try:
            values = json.loads(payload)
        except ValueError as error:
            raise ConfigError(f"payload is no JSON: {error}") from None
        if not isinstance(values, dict):
            raise ConfigError(f"payload = {values!r}: allowed is a JSON object")
        return values
    request: dict[str, Any] = {}
    for pair in filter(None, parameters.split(";")):
        key, _, text = pair.partition("=")
        try:
            request[key] = json.loads(text)
        except ValueError:
            request[key] = text.split(",") if key in _LIST_KEYS else text
    return request


def _answerer(faulted: Faulted, key: str) -> Callable[[zenoh.Query], None]:
    def take(query: zenoh.Query) -> None:
        encoding = zenoh.Encoding.APPLICATION_JSON
        try:
            payload = None if query.payload is None else bytes(query.payload)
            reply = answer(faulted, read_request(str(query.parameters), payload))
        except ConfigError as error:
            query.reply_err(json.dumps({"error": str(error)}), encoding=encoding)
        else:
            query.reply(key, json.dumps(reply), encoding=encoding)

    return take
