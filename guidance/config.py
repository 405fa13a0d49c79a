"""Configuration files: checks TOML documents against models. Errors give line, key, value and the allowed values."""

import difflib
import re
import tomllib
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Self, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import CoreSchema, ErrorDetails

from guidance.errors import ConfigError
from guidance.registry import Registry
from guidance.toml_files import read

MOST_LETTERS: Final = 60
"""Longer values are cut in messages."""

MOST_FAULTS: Final = 20
"""Further faults of a file are only counted in its message."""

_TOKEN = re.compile(r'''"""|\'{3}|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|\\.|[\[\]{}]|#.*''')
"""Tokens that decide whether a TOML statement continues in the next line; texts and comments hide brackets."""

_LONG_QUOTES: Final = ('"""', "'''")
_DEEPER: Final = {"[": 1, "{": 1, "]": -1, "}": -1}

_PART = r"""(?:[\w-]+|"(?:\\.|[^"\\\n])*"|'[^'\n]*')"""
_KEY_PART = re.compile(_PART)
_PAIR = re.compile(rf"\s*({_PART}(?:\s*\.\s*{_PART})*)\s*=")
_HEADER = re.compile(rf"\s*(\[\[?)\s*({_PART}(?:\s*\.\s*{_PART})*)\s*\]")

Location = Sequence[str | int]

RENAMED: Final[Mapping[str, str]] = {
    "envelope": "limits",
    "target": "evader",
    "game.guarded": "game.target",
    "preflight.target_height_limit_m": "preflight.evader_height_limit_m",
}
"""Keys of vehicle and scenario files that were renamed after version 0.1: old -> new."""

RENAMED_EVENTS: Final[Mapping[str, str]] = {
    "target lost": "evader lost",
    "target too fast for this vehicle": "evader too fast for this vehicle",
}
"""Events in scenario files that were renamed after version 0.1: old -> new."""

Latitude = Annotated[float, Field(ge=-85.0, le=85.0)]
Longitude = Annotated[float, Field(ge=-180.0, le=180.0)]
AltitudeAmsl = Annotated[float, Field(ge=-500.0, le=9000.0)]


def lines_of(text: str, locations: Sequence[Location]) -> list[int | None]:
    """Return the line (from 1) of each key, or of the nearest table above it; None where neither is in the text.

    Reads the statements once, for any number of locations, and keeps only the lines of these.

    Args:
        text: A valid TOML document.
        locations: Names of a key's tables and of the key; numbers are array indices.
    """
    first_lines: dict[tuple[str | int, ...], int | None] = {}
    for location in locations:
        for count in range(1, len(location) + 1):
            first_lines[tuple(location[:count])] = None
    for number, path in _statements(text):
        for count in range(1, len(path) + 1):
            above = path[:count]
            if above not in first_lines:
                break
            if first_lines[above] is None:
                first_lines[above] = number
    nearest: list[int | None] = []
    for location in locations:
        upwards = (first_lines[tuple(location[:count])] for count in range(len(location), 0, -1))
        nearest.append(next((line for line in upwards if line is not None), None))
    return nearest


def _statements(text: str) -> Iterator[tuple[int, tuple[str | int, ...]]]:
    """Yield the line and the location of each table's header and of each key with its value."""
    table: tuple[str | int, ...] = ()
    array_sizes: dict[tuple[str | int, ...], int] = {}
    lines = text.splitlines(keepends=True)
    for start in _statement_starts(lines):
        line = lines[start]
        if header := _HEADER.match(line):
            # A table inside an array of tables belongs to its last element.
            table = ()
            for part in _parts(header[2]):
                if table in array_sizes:
                    table = (*table, array_sizes[table] - 1)
                table = (*table, part)
            if header[1] == "[[":
                count = array_sizes.get(table, 0)
                array_sizes[table] = count + 1
                table = (*table, count)
            elif table in array_sizes:
                table = (*table, array_sizes[table] - 1)
            yield start + 1, table
        elif pair := _PAIR.match(line):
            yield start + 1, (*table, *_parts(pair[1]))


def _parts(key: str) -> list[str]:
    return [
        tomllib.loads(f"part = {part}")["part"] if part[0] in "\"'" else part
        for part in _KEY_PART.findall(key)
    ]


def _statement_starts(lines: Sequence[str]) -> Iterator[int]:
    """Yield the index of each line that begins a statement; arrays and texts may have many lines."""
    depth = 0
    quotes = ""
    for number, line in enumerate(lines):
        if depth <= 0 and not quotes:
            yield number
        for token in _TOKEN.findall(line):
            if token == quotes:
                quotes = ""
            elif not quotes and token in _LONG_QUOTES:
                quotes = token
            elif not quotes:
                depth += _DEEPER.get(token, 0)


def as_toml(value: Any) -> str:  # noqa: ANN401 - any value of a document
    """Format a value as TOML, cut to `MOST_LETTERS`."""
    text = _written(value)
    return text if len(text) <= MOST_LETTERS else f"{text[: MOST_LETTERS - 1]}…"


def _written(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return (
            "{ " + ", ".join(f"{key} = {_written(part)}" for key, part in value.items()) + " }"
            if value
            else "{}"
        )
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_written, value)) + "]"
    return repr(value)


def _make_strict(schema: Any) -> None:  # noqa: ANN401 - any part of a core schema
    if isinstance(schema, dict):
        if schema.get("type") in {"float", "int", "bool"}:
            schema["strict"] = True
        schema = list(schema.values())
    if isinstance(schema, list | tuple):
        for part in schema:
            _make_strict(part)


SystemId = Annotated[int, Field(ge=1, le=255)]
"""A MAVLink system or component id."""

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")]
"""A name of a vehicle, an evader or a team, which is a part of Zenoh keys."""


class Section(BaseModel):
    """Base of all sections: frozen, no unknown keys, finite numbers, no text or boolean for a number."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: type[BaseModel], handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Make all numbers and booleans strict; pydantic's own strict mode would refuse arrays and paths too."""
        schema = handler(source)
        _make_strict(schema)
        return schema

    def _faults(self) -> Iterator[str]:
        """Yield faults of values that are allowed one by one. The first is reported, and ends the check."""
        yield from ()

    @model_validator(mode="after")
    def _refuse_faults(self) -> Self:
        for fault in self._faults():
            raise ValueError(fault)
        return self


class Extended(Section):
    """A section to which installed packages add keys."""

    @classmethod
    @abstractmethod
    def further_keys(cls, document: Mapping[str, object]) -> type[Section] | None:
        """Return the model of the keys that this document has beyond those of this class; None if there are none.

        Raises:
            ConfigError: If the package that has them cannot be imported.
        """

    @classmethod
    @abstractmethod
    def further_names(cls) -> Iterable[str]:
        """Return the names of all keys that packages add, for messages."""

    @model_validator(mode="wrap")
    @classmethod
    def _with_further_keys(
        cls,
        document: Any,  # noqa: ANN401 - whatever a file holds
        handler: ModelWrapValidatorHandler[Self],
    ) -> Self:
        further = cls.further_keys(document) if isinstance(document, Mapping) else None
        if further is None or issubclass(cls, further):
            return handler(document)
        extended: Self = _joined(cls, further).model_validate(document)
        return extended


@cache
def _joined(section: Any, further: type[Section]) -> Any:  # noqa: ANN401 - a class made here has no type of its own
    """Return a section with the keys and the checks of both."""

    def _faults(self: Section) -> Iterator[str]:
        yield from section._faults(self)  # noqa: SLF001 - of its base
        yield from further._faults(self)  # noqa: SLF001

    body = {"_faults": _faults, "__module__": __name__}
    return type(section)(section.__name__, (further, section), body)


def _add_keys_of_kinds(schema: dict[str, Any], model: type[BaseModel]) -> None:
    if issubclass(model, KindSection):
        for own in model.own_sections(model.kinds.importable().values()):
            schema["properties"] = {
                **own.model_json_schema()["properties"],
                **schema["properties"],
            }


class KindSection(Extended):
    """A section with a key that names a kind, which may have a `section` with further keys of its own.

    Attributes:
        kinds: Where the kinds are found.
        kind_key: The key that names one.
    """

    kinds: ClassVar[Registry[Any]]
    kind_key: ClassVar[str]

    model_config = ConfigDict(json_schema_extra=_add_keys_of_kinds)

    @classmethod
    def further_keys(cls, document: Mapping[str, object]) -> type[Section] | None:
        """Return the keys of the kind."""
        name = document.get(cls.kind_key, cls.model_fields[cls.kind_key].default)
        if not isinstance(name, str) or not cls.kinds.knows(name):
            return None
        section: type[Section] | None = cls.kinds.named(name).section
        return section

    @classmethod
    def further_names(cls) -> list[str]:
        """Return the keys of the kinds that are in use."""
        return [key for own in cls.own_sections(cls.kinds.values()) for key in own.model_fields]

    @staticmethod
    def own_sections(kinds: Iterable[Any]) -> list[type[Section]]:
        """Return the sections of those kinds that have one."""
        return [kind.section for kind in kinds if kind.section is not None]


def faults_of(what: str, make: Callable[[], object]) -> Iterator[str]:
    """Yield why `make` refuses the values of a section, after the words for them."""
    try:
        make()
    except ConfigError as error:
        yield f"{what}: {error}"


Model = TypeVar("Model", bound=Section)


def load(model: type[Model], path: Path) -> Model:
    """Read a TOML file into `model`.

    Raises:
        ConfigError: If the file cannot be read, is not TOML, or a key is unknown, missing or out of range. The message
            has one line for each fault, with the key, the value and the allowed values.
    """
    text, document = read(path)
    return parse_document(model, document, source=str(path), text=text)


def parse_document(
    model: type[Model], document: dict[str, Any], *, source: str, text: str = ""
) -> Model:
    """Check a parsed document.

    Args:
        model: The model it must match.
        document: Plain values.
        source: Name of the document, for the message.
        text: Its TOML text, for line numbers in the message.

    Raises:
        ConfigError: As `load`.
    """
    try:
        return model.model_validate(document)
    except ValidationError as error:
        errors = error.errors()
        listed = errors[:MOST_FAULTS]
        # The message of a check over several keys begins with the key at fault.
        locations: list[Location] = []
        for fault in listed:
            location: Location = fault["loc"]
            named = re.match(r"(?:Value error, )?([a-z_]+(?:\.[a-z_]+)+)(?: =|:)", fault["msg"])
            if named is not None and named[1].split(".")[: len(location)] == [*location]:
                location = named[1].split(".")
            locations.append(location)
        lines = lines_of(text, locations)
        faults = []
        for fault, line in zip(listed, lines, strict=True):
            where = "" if line is None else f"line {line}: "
            faults.append(f"  {where}{explain(model, fault)}")
        if len(errors) > MOST_FAULTS:
            faults.append(f"  and {len(errors) - MOST_FAULTS} more faults")
        raise ConfigError(f"{source}:\n" + "\n".join(faults)) from error


def explain(model: type[BaseModel], fault: ErrorDetails) -> str:
    """Describe one of pydantic's errors in a line: the key, its value and the allowed values."""
    location = [str(part) for part in fault["loc"]]
    key = ".".join(location)
    if fault["type"] == "extra_forbidden":
        if key in RENAMED:
            return f"{key}: was renamed to {RENAMED[key]}"
        # The keys allowed there, following optional sections and tables.
        section: type[BaseModel] | None = model
        for part in location[:-1]:
            field = section.model_fields.get(part) if section else None
            section = _model_in(field.annotation) if field else section
        names = set[str]()
        if section is not None:
            names = {field.alias or name for name, field in section.model_fields.items()}
            if issubclass(section, Extended):
                names.update(section.further_names())
        allowed = sorted(names)
        near = difflib.get_close_matches(location[-1], allowed, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"allowed here: {', '.join(allowed)}"
        if location[-1] in allowed:
            hint = "it belongs to another kind"
        return f"{key}: unknown key; {hint}"
    if fault["type"] == "missing":
        if isinstance(fault["loc"][-1], int):
            array = ".".join(location[:-1])
            least = fault["loc"][-1] + 1
            return f"{array} = {as_toml(fault['input'])}: must have {least} values or more"
        return f"{key}: missing; it has no default"
    message = fault["msg"].removeprefix("Value error, ")
    if not key or message.startswith(f"{key}."):
        return message
    # State the requirement on the value, instead of pydantic's message.
    size = r"^(?:tuple|list) should have at (most|least) (\d+) items? after validation, not \d+$"
    message = re.sub(size, r"must have \2 values at \1", message[0].lower() + message[1:])
    words = re.sub(r"^input should be ", "must be ", message)
    return f"{key} = {as_toml(fault['input'])}: {words}"


def _model_in(annotation: Any) -> type[BaseModel] | None:  # noqa: ANN401 - a type annotation can be any object
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_model_in, getattr(annotation, "__args__", ()))), None)


def config_folder() -> Path:
    """Return the folder of the bundled configuration files, in the wheel or in the checkout."""
    package = Path(__file__).parent
    installed = package / "_config"
    return installed if installed.is_dir() else package.parent / "config"


def find(name: str | Path, folder: str) -> Path:
    """Find a configuration file by path, or by name among the bundled files.

    Raises:
        ConfigError: If there is none; the message lists the bundled names.
    """
    shipped = config_folder()
    # The checkout's spelling works in an installed wheel too
    bundled = shipped / str(name).removeprefix("config/")
    for candidate in (
        Path(name),
        bundled,
        shipped / folder / name,
        shipped / folder / f"{name}.toml",
    ):
        if candidate.is_file():
            return candidate
    bundled_names = sorted(path.stem for path in (shipped / folder).glob("*.toml"))
    near = difflib.get_close_matches(Path(name).stem, bundled_names, n=1)
    hint = f"did you mean {near[0]!r}? Give" if near else "give"
    raise ConfigError(
        f"no {folder.removesuffix('s')} {str(name)!r}: {hint} a path, or one of: {', '.join(bundled_names)}"
    )
