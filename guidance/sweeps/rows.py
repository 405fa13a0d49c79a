"""Rows of a plan: their scenarios, played or flown, as the bytes of a Parquet file."""

import contextlib
import gc
import hashlib
import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow import parquet
from pydantic import ValidationError

from guidance.clock import VirtualClock
from guidance.config import Section, as_toml, explain, find, parse_document
from guidance.errors import ConfigError, GuidanceError
from guidance.log.writer import PACKAGE, versions_of
from guidance.sim.maths import play_scenarios
from guidance.sim.outcome import Outcome, outcome_of
from guidance.sim.scenario import PURSUER, Scenario
from guidance.sim.scenario_file import load_any
from guidance.sim.teams import TeamOutcome, TeamScenario, play_teams
from guidance.sweeps.axes import Axis
from guidance.sweeps.plan import SWEEP_FOLDER, Cases, Pair, Plan, policy_in
from guidance.toml_files import read

DETERMINING: Final = (PACKAGE, "numpy", "pyarrow")
"""Packages that determine the rows."""

_COURSE_KEYS: Final = {"waypoints": "waypoints_m", "recorded": "track"}


def bases_of(plan: Plan, source: str = "") -> list[dict[str, Any]]:
    """Return the document of each pair of policies. Sections without a swept key are validated already.

    Raises:
        ConfigError: If one is wrong; `source` names the sweep.
    """
    swept = {str(axis.path[0]) for axis in plan.axes}
    bases = []
    for pair in plan.pairs:
        document = _with_policies(plan.scenario, pair)
        named_source = f"{source}: policies {pair.pursuer} and {pair.evader}"
        base = dict(parse_document(plan.model, document, source=named_source))
        for name in swept & base.keys():
            base[name] = document[name]
        bases.append(base)
    return bases


def scenarios_of(plan: Plan, cases: Cases) -> Iterator[Scenario | TeamScenario | str]:
    """Yield the scenario of every row, or the reason why it is invalid.

    Sections with a swept key, and all checks between sections, are validated for every row.
    """
    bases = bases_of(plan)
    drawn: list[tuple[Any, ...]] = [()] * len(cases.row)
    if cases.values:
        drawn = list(zip(*cases.values, strict=True))
    pairs = cases.pair.tolist()
    seeds = cases.seed.tolist()
    for pair, seed, values in zip(pairs, seeds, drawn, strict=True):
        document = _with_values(bases[pair], plan.axes, values)
        try:
            yield plan.model.model_validate({**document, "seed": seed})
        except ValidationError as error:
            yield "; ".join(explain(plan.model, fault) for fault in error.errors())


def scenario_of(plan: Plan, row: int) -> Scenario | TeamScenario | str:
    """Return the scenario of a row, or the reason why it is invalid."""
    rows = np.array([row], dtype=np.int64)
    return next(scenarios_of(plan, plan.cases(rows)))


def _with_policies(scenario: Mapping[str, Any], pair: Pair) -> dict[str, Any]:
    """Return a scenario's document with other policies; a course stays with its own policy."""
    document = dict(scenario)
    for player, policy in pair._asdict().items():
        section = document[player]
        if not isinstance(section, list):
            others = {key for of, key in _COURSE_KEYS.items() if policy != of}
            own_keys = {name: part for name, part in section.items() if name not in others}
            document[player] = {**own_keys, "policy": policy}
        elif policy != policy_in(section):
            document[player] = [{**group, "policy": policy} for group in section]
    return document


def _with_values(
    document: dict[str, Any], axes: Sequence[Axis], values: Sequence[Any]
) -> dict[str, Any]:
    """Return a copy of a document with one value of every axis."""
    for axis, value in zip(axes, values, strict=True):
        for path, part in axis.settings(value):
            document = _with_value(document, path, part)
    return document


def _with_value(node: Any, path: Sequence[str | int], value: Any) -> Any:  # noqa: ANN401 - any part of a document
    """Return a copy of a part of a document with a value at a path."""
    if not path:
        return value
    head = path[0]
    inner_path = path[1:]
    if isinstance(head, int):
        if not isinstance(node, (list, tuple)) or head >= len(node):
            raise LookupError(head)
        changed = _with_value(node[head], inner_path, value)
        return [*node[:head], changed, *node[head + 1 :]]
    if node:
        section = node
    else:
        section = {}
    return {**section, head: _with_value(section.get(head), inner_path, value)}


def planned(name: str, way: str | None = None) -> Plan:
    """Read a sweep by path, or by the name of one that comes with the package.

    Unknown policies and keys, and values outside a key's range, are refused. Rules between keys, as the speed ratio,
    are checked row by row: such a row is invalid.

    Args:
        name: Of the sweep; a scenario beside its file is preferred.
        way: Overrides the file's.

    Raises:
        ConfigError: If there is none, or its scenario is wrong; or one line for each fault, with the key, the value and
            the allowed values.
    """
    path = find(name, SWEEP_FOLDER)
    text, document = read(path)
    if way is not None:
        document["as"] = way
    scenario = document.get("scenario")
    if isinstance(scenario, str):
        beside = path.parent / scenario
        _, loaded = load_any(str(beside) if beside.is_file() else scenario)
        document["scenario"] = loaded.model_dump(mode="json")
    elif scenario is not None:
        raise ConfigError(
            f"{path}: scenario = {as_toml(scenario)}: must be a scenario's name or path"
        )
    plan = parse_document(Plan, document, source=str(path), text=text)
    base = _with_policies(plan.scenario, plan.pairs[0])
    faults: list[str] = []
    for axis in plan.axes:
        for value in axis.extremes:
            faults.extend(_faults(plan.model, base, axis, value))
    if faults:
        lines = [f"  {fault}" for fault in dict.fromkeys(faults)]
        raise ConfigError("\n".join([f"{name}:", *lines]))
    bases_of(plan, name)
    return plan


def _faults(model: type[Section], base: dict[str, Any], axis: Axis, value: Any) -> Iterator[str]:  # noqa: ANN401 - any value of a key
    try:
        model.model_validate(_with_values(base, (axis,), (value,)))
    except LookupError as error:
        yield f"{axis.key}: the scenario has no element {error.args[0]} there"
    except ValidationError as error:
        for fault in error.errors():
            if fault["loc"][: len(axis.path)] == axis.path:
                yield explain(model, fault)


def refuse_without_games(plan: Plan) -> None:
    """Refuse a sweep if all of a sample of its rows are invalid.

    Raises:
        ConfigError: With the most common reason.
    """
    spread = np.unique(np.linspace(0, plan.rows - 1, 1000).round().astype(np.int64))
    scenarios = list(scenarios_of(plan, plan.cases(spread)))
    reasons = Counter(reason for reason in scenarios if isinstance(reason, str))
    if reasons.total() == len(scenarios):
        reason, count = reasons.most_common(1)[0]
        raise ConfigError(
            f"all {len(scenarios)} rows of a sample are invalid; reason of {count} of them:\n  {reason}"
        )


class ChunkMade(NamedTuple):
    """The content of a chunk, and the code of the process that computed it."""

    content: bytes
    code: Mapping[str, str]


def made(plan: Plan, rows: range) -> ChunkMade:
    """Compute a chunk in a process that may have other code than the one that collects the rows.

    Raises:
        GuidanceError: As `computed`.
    """
    return ChunkMade(computed(plan, rows), code_here())


@cache
def code_here() -> Mapping[str, str]:
    """Return the versions of the packages that determine the rows, and a digest of this package's own source."""
    source = hashlib.sha256()
    root = Path(__file__).parents[1]
    for file in sorted(root.rglob("*.py")):
        source.update(str(file.relative_to(root)).encode())
        source.update(file.read_bytes())
    return versions_of(DETERMINING) | {"source": source.hexdigest()[:12]}


def computed(plan: Plan, rows: range) -> bytes:
    """Play rows and return the bytes of their Parquet file, which depend on the arguments only.

    Raises:
        GuidanceError: If a flight fails for a reason other than its row.
    """
    sink = BytesIO()
    # All objects live until the end of the chunk; visiting them takes a fifth of the time
    with uncollected():
        parquet.write_table(table_of_rows(plan, rows), sink, compression="zstd")
    return sink.getvalue()


@contextlib.contextmanager
def uncollected() -> Iterator[None]:
    """Switch garbage collection off."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def table_of_rows(plan: Plan, rows: range) -> pa.Table:
    """Play rows and return their table."""
    cases = plan.cases(np.arange(rows.start, rows.stop, dtype=np.int64))
    scenarios = list(scenarios_of(plan, cases))
    valid: list[Any] = [scenario for scenario in scenarios if not isinstance(scenario, str)]
    # The outcomes of each game: one, or of teams one for every evader.
    outcomes_played: Iterator[Sequence[Any]]
    if plan.teams:
        outcomes_played = iter(play_teams(valid))
    else:
        played = play_scenarios(valid) if plan.way == "maths" else map(flown, valid)
        outcomes_played = ([outcome] for outcome in played)
    outcomes: list[Sequence[Any]] = []
    for row, scenario in enumerate(scenarios):
        if isinstance(scenario, str):
            pair = plan.pairs[cases.pair[row]]
            kind = TeamOutcome if plan.teams else Outcome
            outcomes.append(
                [
                    kind(
                        plan.scenario["title"],
                        plan.way,
                        plan.scenario["game"],
                        pursuer_policy=pair.pursuer,
                        evader_policy=pair.evader,
                        seed=int(cases.seed[row]),
                        reason=scenario,
                    )
                ]
            )
        else:
            outcomes.append(next(outcomes_played))
    return as_table(plan, cases, outcomes)


def as_table(plan: Plan, cases: Cases, outcomes: Sequence[Sequence[Any]]) -> pa.Table:
    """Return the table of cases and the outcomes of each: one, or of teams one for every evader."""
    swept = [pa.array(cases.row)]
    for axis, values in zip(plan.axes, cases.values, strict=True):
        swept.extend(axis.cells(values))
    counts = [len(rows) for rows in outcomes]
    places = pa.array(np.repeat(np.arange(len(outcomes)), counts))
    columns = zip(*itertools.chain.from_iterable(outcomes), strict=True)
    fields = list(plan.schema)[len(swept) :]
    cells = [pa.array(column, field.type) for column, field in zip(columns, fields, strict=True)]
    repeated = [column.take(places) for column in swept]
    return pa.Table.from_arrays([*repeated, *cells], schema=plan.schema)


def flown(scenario: Scenario) -> Outcome:
    """Fly a scenario against the mock in virtual time, in this process and without a record."""
    from guidance.session.fly.mission import Mission  # noqa: PLC0415 - flights only: imports the mock
    from guidance.session.fly.result import outcome_of_flight  # noqa: PLC0415
    from guidance.sim.stepped import SteppedWorld  # noqa: PLC0415

    clock = VirtualClock()
    try:
        with contextlib.closing(SteppedWorld(scenario, clock)) as world:
            result = Mission(scenario, world, clock).fly()
            return outcome_of_flight(result.vehicles[PURSUER], "fast")
    except GuidanceError as error:
        return outcome_of(scenario, "fast", end="failed", reason=str(error))
