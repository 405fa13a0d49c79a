"""Generates reference pages of the site from the code.

MkDocs calls `on_files` with the pages in `docs/`; this hook adds the generated ones.
"""

import importlib
import inspect
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from guidance.cli.program import app as guidance_app
from guidance.cli.vehicle_setup import schema_of
from guidance.control import Limiter
from guidance.cycle import Violation
from guidance.flight import ORDERS, Event, State
from guidance.flight.freshness import AGES
from guidance.flight.table import FINAL, SETPOINT_STATES, TRANSITIONS
from guidance.links.zenoh.ros_types import ODOMETRY_TYPE, POSE_STAMPED
from guidance.log.broadcast import broadcast_key
from guidance.log.entries import CYCLE, EVENT, REPORT
from guidance.log.ros import TOPICS, topic_name
from guidance.session.observe.metrics import Metrics
from guidance.session.orders.control_client import control_key
from guidance.session.orders.words import WORDS
from guidance.sim.outcome import Outcome
from guidance.sim.teams import TeamOutcome
from sitl_mock.cli import app as mock_app

ROOT = Path(__file__).parents[1]
UNITS = {
    "_m_s2": "m/s²", "_m_s3": "m/s³", "_m_s": "m/s", "_deg_s": "°/s", "_hz": "Hz", "_deg": "°", "_rad": "rad",
    "_ne_m": "m", "_m": "m", "_mb": "MB", "_s": "s",
}  # fmt: skip
API = (
    "guidance.game", "guidance.game.team", "guidance.strategies", "guidance.strategies.own", "guidance.league",
    "guidance.sim.scenario", "guidance.sim.maths",
    "guidance.sim.outcome", "guidance.log", "guidance.links", "guidance.links.port", "guidance.cycle.certificate",
    "guidance.errors", "sitl_mock", "sitl_mock.pytest_plugin",
)  # fmt: skip
SOURCES = {
    "guidance/game/__init__.py": "reference/api.md",
    "guidance/flight/table.py": "reference/states-events.md",
    "guidance/cycle/monitor.py": "reference/alarms.md",
    "guidance/sim/scenario.py": "reference/scenario-file.md",
}
"""Pages that links to a file of the code lead to on the site. In the repository they lead to the code."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages, and the README's pictures."""
    for uri, write in PAGES.items():
        files.append(File.generated(config, uri, content=write()))
    for picture in sorted((ROOT / ".readme").glob("*.png")):
        files.append(File.generated(config, f"pictures/{picture.name}", abs_src_path=str(picture)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Fill in the tables of the flight, and point links out of `docs` into the site."""
    for mark, write in TABLES.items():
        markdown = markdown.replace(mark, write())
    return site_links(markdown, page.file.src_uri)


def site_links(markdown: str, uri: str) -> str:
    """Return a page's text with links to pictures, pages of `SOURCES`, and plain text for other files of the code."""
    here = (ROOT / "docs" / uri).parent

    def led(link: re.Match[str]) -> str:
        target = os.path.normpath(here / link[2])
        path = os.path.relpath(target, ROOT)
        if path.startswith("docs/"):
            return link[0]
        path = (
            f"pictures/{Path(path).name}" if path.startswith(".readme/") else SOURCES.get(path, "")
        )
        return f"[{link[1]}]({os.path.relpath(ROOT / 'docs' / path, here)})" if path else link[1]

    return re.sub(r"\[([^\]]*)\]\((?!\w+:)([^)#]+)\)", led, markdown)


def commands() -> str:
    """List every command of both programs with its arguments and options."""
    parts = ["# Commands\n"]
    for program, app in (("guidance", guidance_app), ("sitl-mock", mock_app)):
        command = typer.main.get_command(app)
        parts += [f"## {program}\n", f"{_help(command)}\n"]
        parts += list(_subcommands(program, command))
    return "\n".join(parts)


def _subcommands(path: str, group: Any) -> Iterator[str]:  # noqa: ANN401 - click's own classes
    for name, command in sorted(group.commands.items()):
        if command.hidden:
            continue
        yield f"### {path} {name}\n"
        yield f"{_help(command)}\n"
        rows = [
            _option(parameter)
            for parameter in command.params
            if not getattr(parameter, "hidden", False)
        ]
        if rows:
            yield table(
                ("argument or option", "default", "meaning"),
                [row for row in rows if row[0] != "`--help`"],
            )
        if hasattr(command, "commands"):
            yield from _subcommands(f"{path} {name}", command)


def _help(command: Any) -> str:  # noqa: ANN401
    return inspect.cleandoc(command.help or "").replace("\b\n", "").replace("\f", "")


def _option(parameter: Any) -> tuple[str, ...]:  # noqa: ANN401
    if parameter.param_type_name == "argument":
        name = parameter.metavar or parameter.name.upper()
        return (
            f"`{name}`",
            "" if parameter.required else _said(parameter.default),
            getattr(parameter, "help", "") or "",
        )
    names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
    return (names, _said(parameter.default), parameter.help or "")


def _said(value: object) -> str:
    return "" if value is None or callable(value) or value is False or value == () else f"`{value}`"


def file_page(kind: str, words: str) -> Callable[[], str]:
    """Make the page of a kind of file from its JSON Schema."""

    def page() -> str:
        schema = schema_of(kind)
        parts = [
            f"# {kind.capitalize()} file\n",
            f"{words} Unknown keys are refused. `guidance schema {kind}` prints the JSON Schema, for editors that "
            "complete and check TOML by it.\n",
        ]
        roots = (
            [schema] if "properties" in schema else [_met(one, schema) for one in schema["anyOf"]]
        )
        for root in roots:
            parts.append(f"## {root.get('title', kind)}\n")
            parts += _section("", root, schema, set())
        return "\n".join(parts)

    return page


def _section(
    path: str, section: Mapping[str, Any], schema: Mapping[str, Any], told: set[str]
) -> Iterator[str]:
    """Yield a table of a section's keys, then its subsections."""
    if path:
        yield f"### `{path}`\n"
    yield inspect.cleandoc(section.get("description", "")) + "\n"
    required = set(section.get("required", ()))
    tables = {key: (_met(spec, schema), spec) for key, spec in section["properties"].items()}
    keys = [
        _key(key, spec, required)
        for key, spec in section["properties"].items()
        if not _is_table(tables[key][0])
    ]
    if keys:
        yield table(("key", "unit", "allowed", "default", "meaning"), keys)
    for key, (inside, spec) in tables.items():
        if not _is_table(inside):
            continue
        inner = f"{path.strip('[]')}.{key}".lstrip(".")
        if inside["title"] in told:
            yield f"### `[{inner}]`\n\nThe keys of {inside['title']}, as above.\n"
            continue
        told.add(inside["title"])
        many = spec.get("type") == "array"
        yield from _section(f"[[{inner}]]" if many else f"[{inner}]", inside, schema, told)


def _is_table(spec: Mapping[str, Any]) -> bool:
    return "properties" in spec and spec.get("title") != "Range"


def _met(spec: Mapping[str, Any], schema: Mapping[str, Any]) -> Mapping[str, Any]:
    """Follow a reference, also if it is optional or in a list."""
    if spec.get("type") == "array" and "items" in spec:
        return _met(spec["items"], schema)
    for one in (spec, *spec.get("anyOf", ()), *spec.get("allOf", ())):
        if "$ref" in one:
            found: Mapping[str, Any] = schema["$defs"][one["$ref"].rpartition("/")[2]]
            return found
    return spec


def _key(key: str, spec: Mapping[str, Any], required: Iterable[str]) -> tuple[str, ...]:
    unit = next((unit for ending, unit in UNITS.items() if key.endswith(ending)), "")
    default = "needed" if key in required else _toml(spec.get("default"))
    return (f"`{key}`", unit, _allowed(spec), default, spec.get("description", ""))


def _allowed(spec: Mapping[str, Any]) -> str:
    if "$ref" in spec:
        name = spec["$ref"].rpartition("/")[2]
        return "{ min, max }" if name == "Range" else f"table {name}"
    named = spec.get("enum", [spec["const"]] if "const" in spec else ())
    if named:
        return ", ".join(f"`{value}`" for value in named)
    if "anyOf" in spec:
        return " or ".join(
            dict.fromkeys(_allowed(one) for one in spec["anyOf"] if one.get("type") != "null")
        )
    if spec.get("type") == "array":
        inner = spec.get("items") or next(iter(spec.get("prefixItems", [])), {})
        count = f"{spec['maxItems']} × " if "maxItems" in spec else "list of "
        return count + _allowed(inner) if inner else "list"
    pattern = f"text as `{spec['pattern']}`" if "pattern" in spec else ""
    return pattern or _range(spec) or str(spec.get("type", "any"))


def _range(spec: Mapping[str, Any]) -> str:
    low = f"from {_figures(spec['minimum'])}" if "minimum" in spec else ""
    low = f"above {_figures(spec['exclusiveMinimum'])}" if "exclusiveMinimum" in spec else low
    high = f"to {_figures(spec['maximum'])}" if "maximum" in spec else ""
    high = f"below {_figures(spec['exclusiveMaximum'])}" if "exclusiveMaximum" in spec else high
    return " ".join(part for part in (low, high) if part)


def _figures(number: float) -> str:
    return str(int(number)) if number == int(number) else f"{number:g}"


def _toml(value: object) -> str:
    if value is None or isinstance(value, dict):
        return ""
    return (
        f"`{str(value).lower()}`" if isinstance(value, bool) else f"`{value!r}`".replace("'", '"')
    )


def states_events() -> str:
    """Draw the flight's transition table."""
    meant = comments(State) | comments(Event)
    rows = [
        (
            f"**{state}**",
            meant.get(state.name, ""),
            "yes" if state in SETPOINT_STATES else "",
            "yes" if state in FINAL else "",
        )
        for state in State
    ]
    parts = [
        "# States and events\n",
        "This is the transition table in `guidance/flight/table.py`. A pair that is not in it changes nothing.\n",
        "## States\n",
        table(("state", "meaning", "setpoints go out", "final"), rows),
        "## Transitions\n",
    ]
    parts.append(table(("event", "from", "to"), ways(Event)))
    return "\n".join(parts)


def failures() -> str:
    """List the transitions that end the game or the flight without an order."""
    ended = {
        State.PAUSED,
        State.HOLDING,
        State.RETURNING,
        State.LANDING,
        State.YIELDED,
        State.FAILED,
    }
    return table(
        ("what happens", "where the flight stands", "where it leads"),
        [
            row
            for row in ways(one for one in Event if not _ordered(one))
            if row[2] in map(str, ended)
        ],
    )


def ages() -> str:
    """List every value that a safety rule reads, and what happens when it is old."""
    return table(("value", "message", "on the ground", "in flight"), AGES)


TABLES: Mapping[str, Callable[[], str]] = {
    "<!-- the flight's table -->": failures,
    "<!-- the table of ages -->": ages,
}
"""Tables of pages in `docs` that are read from the code, by their place."""


def _ordered(event: Event) -> bool:
    return event in ORDERS or event.name.endswith("_ARMED")


def ways(events: Iterable[Event]) -> Iterator[tuple[str, str, str]]:
    """Yield each event with its source states and its target state."""
    for event in events:
        leads: dict[State, list[str]] = {}
        for (state, happened), then in TRANSITIONS.items():
            if happened is event:
                leads.setdefault(then, []).append(str(state))
        for then, states in leads.items():
            yield str(event), ", ".join(states), f"{then}"


def comments(kind: type) -> dict[str, str]:
    """Return the comments behind the members of an enumeration, by name."""
    return dict(re.findall(r"^\s+(\w+) = [^#\n]*# (.*)$", inspect.getsource(kind), re.MULTILINE))


def alarms() -> str:
    """List the monitor's alarms and the limits that may change a command."""
    monitored = inspect.getmodule(Violation)
    return "\n".join((
        "# Alarms and limits\n", "## Alarms\n", f"{inspect.getdoc(monitored)}\n",
        table(("name", "alarm"), [(f"`{one.name}`", str(one)) for one in Violation]),
        "## Limits\n", "Limits that may change a command, in order:\n",
        table(("limit",), [(str(one),) for one in Limiter]),
    ))  # fmt: skip


def metrics() -> str:
    """List the metrics of a vehicle."""
    rows = [
        (f"`{family.name}`", family.type, family.documentation)
        for family in sorted(Metrics("uav1").registry.collect(), key=lambda family: family.name)
    ]
    words = "With `metrics.port` set, Prometheus reads these on 127.0.0.1. Each has the label `vehicle`.\n"
    return "\n".join(("# Metrics\n", words, table(("name", "type", "meaning"), rows)))


def zenoh_keys() -> str:
    """List every Zenoh key that is published, queried or subscribed to."""
    orders = [
        (f"`{control_key('NAME', word)}`", "asked", "an order; its answer is JSON")
        for word in WORDS
    ]
    live = [
        (f"`{broadcast_key('NAME', what)}`", "published", "JSON, as in a record")
        for what in ("cycle", "event")
    ]
    mavlink = [
        (
            "`NAMESPACE/mavlink_raw/in`",
            "published",
            "MAVLink frames to the vehicle of a zenoh:// URL",
        ),
        ("`NAMESPACE/mavlink_raw/out`", "listened to", "MAVLink frames from it"),
        (
            "the key of `evader.url`",
            "listened to",
            f"reports: JSON (config/zenoh), `{POSE_STAMPED}` or `{ODOMETRY_TYPE}`",
        ),
    ]
    ros = [
        (
            f"`DOMAIN{topic_name('NAME', topic)}/TYPE/HASH`",
            "published",
            f"`{topic.type_name}` at `ros.endpoint`, with `[ros]`",
        )
        for topic in TOPICS
    ]
    ros.append(("`DOMAIN/NAME/ORDER/TYPE/HASH`", "asked", "`std_srvs/Trigger`, with `ros.orders`"))
    ros.append(("`@ros2_lv/DOMAIN/…`", "published", "liveliness tokens of the ROS graph"))
    words = "The session for orders is on loopback and requires the token (`control.token_file`).\n"
    return "\n".join(
        ("# Zenoh keys\n", words, table(("key", "how", "what"), [*orders, *live, *mavlink, *ros]))
    )


def record() -> str:
    """List the channels of an MCAP record, and the fields of the JSON channels."""
    parts = [
        "# Record\n",
        "One MCAP file per flight. Each link also has a channel of raw MAVLink frames. Vehicles, fence and stand-off "
        "are also recorded as Foxglove's message types.\n",
    ]
    for codec in (CYCLE, EVENT, REPORT):
        rows = [(f"`{name}`", str(spec.get("type", ""))) for name, spec in _fields(codec.schema)]
        parts += [
            f"## `{codec.topic}`\n",
            f"Type `{codec.title}`.\n",
            table(("field", "type"), rows),
        ]
    return "\n".join(parts)


def _fields(schema: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    for name, spec in schema.get("properties", {}).items():
        yield path + name, spec
        if spec.get("type") == "object" and path.count(".") < 1:
            yield from _fields(spec, f"{path}{name}.")


def outcome() -> str:
    """Explain every column of an outcome, from the documentation of the two rows."""
    words = (
        "`guidance scenario run`, `fly` and `sweep` describe every run by one row with these columns, the same for "
        "mathematics, mock and vehicle. `guidance compare` compares them. A number that there is none of is NaN, in "
        "JSON null. Units are in the names.\n"
    )
    parts = ["# Outcome\n", words]
    for title, row in (("One vehicle", Outcome), ("A team: one row for each evader", TeamOutcome)):
        columns = attributes(row)
        unexplained = set(row._fields) - set(columns)
        if unexplained:
            raise ValueError(f"{row.__name__}: columns without a text: {sorted(unexplained)}")
        parts.append(f"## {title}\n")
        parts.append(
            table(("column", "meaning"), [(f"`{name}`", columns[name]) for name in row._fields])
        )
    return "\n".join(parts)


def attributes(kind: type) -> dict[str, str]:
    """Return the texts of the attributes in a docstring, by name."""
    section = inspect.getdoc(kind).partition("Attributes:\n")[2]
    found = re.findall(r"^    (\w+): ((?:.|\n(?!    \w+: ))*)", section, re.MULTILINE)
    return {name: " ".join(text.split()) for name, text in found}


def api() -> str:
    """List the public packages."""
    rows = [(f"[`{name}`](api/{name}.md)", _summary(name)) for name in API]
    words = "A package offers the names in its `__init__`; other names may change at any time.\n"
    return "\n".join(("# Python API\n", words, table(("module", "content"), rows)))


def _summary(name: str) -> str:
    """Return the first sentence of a module's docstring."""
    return (
        (inspect.getdoc(importlib.import_module(name)) or "")
        .partition("\n\n")[0]
        .replace("\n", " ")
    )


def module_page(name: str) -> Callable[[], str]:
    """Make the page of a module."""
    return lambda: f"# {name}\n\n::: {name}\n    options:\n      show_root_heading: false\n"


def table(headings: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table."""
    headings = tuple(headings)
    cells = ([cell.replace("|", "\\|").replace("\n", " ") for cell in row] for row in rows)
    lines = [f"| {' | '.join(row)} |" for row in (headings, ["---"] * len(headings), *cells)]
    return "\n".join(lines) + "\n"


PAGES: Mapping[str, Callable[[], str]] = {
    "reference/commands.md": commands,
    "reference/vehicle-file.md": file_page(
        "vehicle", "Links, evader, game and limits of a vehicle."
    ),
    "reference/scenario-file.md": file_page(
        "scenario", "Two players or two teams, a game, and the expected result."
    ),
    "reference/sweep-file.md": file_page("sweep", "A scenario, and what is varied in it."),
    "reference/states-events.md": states_events,
    "reference/alarms.md": alarms,
    "reference/metrics.md": metrics,
    "reference/zenoh.md": zenoh_keys,
    "reference/record.md": record,
    "reference/outcome.md": outcome,
    "reference/api.md": api,
    **{f"reference/api/{name}.md": module_page(name) for name in API},
}
