"""`guidance schema`: the keys of every file, as JSON Schema."""

import json
from collections.abc import Callable
from typing import Annotated, Any

import typer


def schema(
    kind: Annotated[str, typer.Argument(help="vehicle, scenario or sweep.")],
) -> None:
    """Print the JSON Schema of a file, for editors that complete and check TOML by it (Even Better TOML, Taplo).

    Every key has its meaning, its range and, where names are allowed, the names; its unit is the end of its name.

    - `guidance schema vehicle > vehicle.schema.json`
    """
    from guidance.errors import ConfigError  # noqa: PLC0415

    if kind not in KINDS:
        raise ConfigError(f"{kind}: allowed are {', '.join(KINDS)}")
    typer.echo(json.dumps(KINDS[kind](), indent=2))


def _vehicle() -> dict[str, Any]:
    from guidance.session.vehicle_file import Config  # noqa: PLC0415 - pydantic takes a moment

    return _titled("Vehicle", Config.model_json_schema())


def _scenario() -> dict[str, Any]:
    from guidance.sim.files import json_schema  # noqa: PLC0415 - as above

    return json_schema()


def _sweep() -> dict[str, Any]:
    from guidance.extras import require  # noqa: PLC0415

    require("schema sweep", "sim")
    from guidance.sweeps.model import Sweep  # noqa: PLC0415 - as above

    return _titled("Sweep", Sweep.model_json_schema())


def _titled(title: str, content: dict[str, Any]) -> dict[str, Any]:
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **content, "title": title}


KINDS: dict[str, Callable[[], dict[str, Any]]] = {"vehicle": _vehicle, "scenario": _scenario, "sweep": _sweep}
