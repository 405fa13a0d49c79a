"""Configuration files: TOML in, checked models out. A wrong key, unit or range stops the start and says so.

What is wrong is said with its line, and values as people write them.
"""

import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from guidance.errors import ConfigError

MOST_LETTERS: Final = 60
"""A longer value is cut: its key says which one is meant."""

_HEADING: Final = re.compile(r"^\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$")
_NAME: Final = r"""(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')"""
_KEY: Final = re.compile(rf"^\s*({_NAME}(?:\s*\.\s*{_NAME})*)\s*=")
_PART: Final = re.compile(_NAME)

Location = Sequence[str | int]

RENAMED: Final[Mapping[str, str]] = {
    "envelope": "limits",
    "target": "evader",
    "game.guarded": "game.target",
    "preflight.target_height_limit_m": "preflight.evader_height_limit_m",
}
"""Keys of vehicle and scenario files that had another name in version 0.1: old -> new."""

RENAMED_EVENTS: Final[Mapping[str, str]] = {
    "target lost": "evader lost",
    "target too fast for this vehicle": "evader too fast for this vehicle",
}
"""Events in scenario files, likewise."""

Latitude = Annotated[float, Field(ge=-85.0, le=85.0)]
Longitude = Annotated[float, Field(ge=-180.0, le=180.0)]
Altitude = Annotated[float, Field(ge=-500.0, le=9000.0)]


def line_of(text: str, location: Location) -> int | None:
    """Return the line, counted from 1, on which a key or what holds it begins; None where it is not found.

    Args:
        text: A TOML document.
        location: The names of the key's tables and its own; numbers count in arrays.
    """
    wanted = [str(part) for part in location]
    best: tuple[int, int] | None = None
    for number, path in _keys(text):
        if wanted[: len(path)] == path and (best is None or len(path) > best[0]):
            best = len(path), number
    return None if best is None else best[1]


def _keys(text: str) -> list[tuple[int, list[str]]]:
    """Return every heading and key with its line; what is inside an inline table or a long text is not looked into."""
    found: list[tuple[int, list[str]]] = []
    table: list[str] = []
    counts: dict[tuple[str, ...], int] = {}
    quoted = ""
    for number, line in enumerate(text.splitlines(), 1):
        if quoted:
            quoted = "" if quoted in line else quoted
            continue
        heading, key = _HEADING.match(line), _KEY.match(line)
        if heading is not None and key is None:
            table = _parts(heading[2])
            if heading[1] == "[[":
                place = tuple(table)
                counts[place] = counts.get(place, -1) + 1
                table = [*table, str(counts[place])]
            found.append((number, table))
        elif key is not None:
            found.append((number, [*table, *_parts(key[1])]))
            quoted = next((mark for mark in ('"""', "'''") if line.count(mark) % 2), "")
    return found


def _parts(text: str) -> list[str]:
    return [part.strip("\"'") for part in _PART.findall(text)]


def as_toml(value: Any) -> str:  # noqa: ANN401 - any value of a document
    """Return a value as it would be written in TOML, cut where it is long."""
    text = _written(value)
    return text if len(text) <= MOST_LETTERS else f"{text[: MOST_LETTERS - 1]}…"


def _written(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_written(part)}" for key, part in value.items()) + " }" if value else "{}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_written, value)) + "]"
    return repr(value)


class Section(BaseModel):
    """Base of every section: frozen, unknown keys refused, numbers finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


Model = TypeVar("Model", bound=Section)


def load(model: type[Model], path: Path) -> Model:
    """Read a TOML file into `model`.

    Raises:
        ConfigError: If the file cannot be read, is no TOML, or a key is unknown, missing or out of range. The message
            has one line a fault, each with the key, the value and what is allowed.
    """
    text = read_text(path)
    return parse(model, read_toml(text, path), source=str(path), text=text)


def read_text(path: Path) -> str:
    """Read a configuration file's text.

    Raises:
        ConfigError: If it cannot be read, or is no text.
    """
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error


def read_toml(text: str, path: Path) -> dict[str, Any]:
    """Read the text of a configuration file.

    Raises:
        ConfigError: If it is no TOML; the message says on which line.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error


def parse(model: type[Model], document: dict[str, Any], *, source: str, text: str = "") -> Model:
    """Check a document that has been read already.

    Args:
        model: What it should be.
        document: Plain values.
        source: Named in the message.
        text: The document as it was written, for the lines in the message.

    Raises:
        ConfigError: As `load`.
    """
    try:
        return model.model_validate(document)
    except ValidationError as error:
        faults = "\n".join(
            f"  {_line(text, _place(dict(fault)))}{explain(model, dict(fault))}" for fault in error.errors()
        )
        raise ConfigError(f"{source}:\n{faults}") from error


def _place(fault: dict[str, Any]) -> Location:
    """Return where a fault is; one of several keys together begins with the name of that which it blames."""
    named = re.match(r"(?:Value error, )?([a-z_]+(?:\.[a-z_]+)+)(?: =|:)", str(fault["msg"]))
    return named[1].split(".") if named and not fault["loc"] else tuple(fault["loc"])


def _line(text: str, location: Location) -> str:
    line = line_of(text, location) if text else None
    return "" if line is None else f"line {line}: "


def explain(model: type[BaseModel], fault: dict[str, Any]) -> str:
    """Say in one line what pydantic found wrong with a document: the key, its value and what is allowed."""
    location = [str(part) for part in fault["loc"]]
    key = ".".join(location)
    if fault["type"] == "extra_forbidden":
        if key in RENAMED:
            return f"{key}: is named {RENAMED[key]} now"
        known = sorted(_section_at(model, location[:-1]))
        near = difflib.get_close_matches(location[-1], known, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"known here: {', '.join(known)}"
        return f"{key}: unknown key; {hint}"
    if fault["type"] == "missing":
        if isinstance(fault["loc"][-1], int):
            array, least = ".".join(location[:-1]), fault["loc"][-1] + 1
            return f"{array} = {as_toml(fault['input'])}: must have {least} values or more"
        return f"{key}: missing; it has no default"
    message = str(fault["msg"]).removeprefix("Value error, ")
    if not key:
        return message
    return f"{key} = {as_toml(fault['input'])}: {_plain_words(message)}"


def _plain_words(message: str) -> str:
    """Put pydantic's words as ours: what a value must be."""
    message = message[0].lower() + message[1:]
    size = re.fullmatch(r"(?:tuple|list) should have at (most|least) (\d+) items? after validation, not \d+", message)
    if size is not None:
        return f"must have {size[2]} values at {size[1]}"
    message = re.sub(r", unable to parse string as an? \w+$", "", message)
    return re.sub(r"^input should be ", "must be ", message)


def _section_at(model: type[BaseModel], location: list[str]) -> set[str]:
    """Name the keys known at a place in the document, following optional sections and tables."""
    section: type[BaseModel] | None = model
    for part in location:
        field = section.model_fields.get(part) if section else None
        section = _model_in(field.annotation) if field else section
    return {field.alias or name for name, field in section.model_fields.items()} if section else set()


def _model_in(annotation: Any) -> type[BaseModel] | None:  # noqa: ANN401 - a type annotation can be any object
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_model_in, getattr(annotation, "__args__", ()))), None)


def config_folder() -> Path:
    """Return the folder of the configuration that comes with the package: in the wheel, or in the checkout."""
    package = Path(__file__).parent
    installed = package / "_config"
    return installed if installed.is_dir() else package.parent / "config"


def find(name: str, folder: str) -> Path:
    """Find a configuration file: as a path, or by its name in the folder that comes with the package.

    Raises:
        ConfigError: If there is none; the message lists those that come with the package.
    """
    shipped = config_folder()
    for candidate in (Path(name), shipped / name, shipped / folder / name, shipped / folder / f"{name}.toml"):
        if candidate.is_file():
            return candidate
    # `config/scenarios/pe.toml` is how the checkout spells it; an installed wheel has it elsewhere.
    if name.startswith("config/") and (shipped / name.removeprefix("config/")).is_file():
        return shipped / name.removeprefix("config/")
    known = sorted(path.stem for path in (shipped / folder).glob("*.toml"))
    raise ConfigError(f"no {folder.removesuffix('s')} {name!r}: give a path, or one of: {', '.join(known)}")
