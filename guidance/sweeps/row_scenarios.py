"""From rows of a plan to checked scenarios, or to the reason why a row allows no game."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from guidance.config import explain, parse
from guidance.errors import ConfigError
from guidance.game import EVADER_POLICIES, PURSUER_POLICIES
from guidance.sim.scenario import Scenario
from guidance.sim.teams import TeamScenario
from guidance.strategies import EVADER_STRATEGIES, PURSUER_STRATEGIES
from guidance.sweeps.axes import Axis, placed
from guidance.sweeps.plan import Cases, Plan, policy_in
from guidance.sweeps.sweep_file import Pair

_OF_A_COURSE = {"waypoints": "waypoints_m", "recorded": "track"}


Model = type[Scenario] | type[TeamScenario]


def model_of(plan: Plan) -> Model:
    """Return what the rows of a plan are checked by."""
    return TeamScenario if plan.teams else Scenario


class Scenarios:
    """Makes the scenarios of a plan's rows.

    A row's sections that nothing is swept in were checked before and are shared; the swept ones, and all that is
    checked between sections, are checked for every row.
    """

    def __init__(self, plan: Plan) -> None:
        self._model = model_of(plan)
        swept = {str(axis.key.path[0]) for axis in plan.axes}
        self._fixed: list[dict[str, Any]] = []
        self._varied: list[dict[str, Any]] = []
        for pair in plan.pairs:
            document = with_policies(plan.scenario, pair)
            base = parse(self._model, document, source=f"policies {pair.pursuer} and {pair.evader}")
            self._fixed.append({name: getattr(base, name) for name in self._model.model_fields if name not in swept})
            # Any values: every row sets its own. What they are set in is there from now on, and no longer None.
            some = [axis.extremes()[0] for axis in plan.axes]
            self._varied.append(with_values({name: document[name] for name in swept}, plan.axes, some))
        self._paths = [[key.path for key, _ in axis.settings(axis.extremes()[0])] for axis in plan.axes]
        inside = {path[:depth] for paths in self._paths for path in paths for depth in range(1, len(path))}
        self._copied = sorted(inside, key=len)

    def of(self, cases: Cases) -> Iterator[Scenario | TeamScenario | str]:
        """Yield the scenario of every row, or why it is none."""
        fixed, varied = self._fixed, self._varied
        drawn = list(zip(*cases.values, strict=True)) if cases.values else [()] * len(cases.row)
        for pair, seed, values in zip(cases.pair.tolist(), cases.seed.tolist(), drawn, strict=True):
            document = {**fixed[pair], **varied[pair], "seed": seed}
            for path in self._copied:
                node = _at(document, path[:-1])
                node[path[-1]] = node[path[-1]].copy()
            for paths, value in zip(self._paths, values, strict=True):
                for path, part in zip(paths, [value] if len(paths) == 1 else value, strict=True):
                    _at(document, path[:-1])[path[-1]] = part
            try:
                yield self._model.model_validate(document)
            except ValidationError as error:
                yield "; ".join(explain(self._model, dict(fault)) for fault in error.errors())


def _at(node: Any, path: Sequence[str | int]) -> Any:  # noqa: ANN401 - any part of a document
    for part in path:
        node = node[part]
    return node


def with_policies(scenario: Mapping[str, Any], pair: Pair) -> dict[str, Any]:
    """Return a scenario's document with other policies; a course stays with the policy that follows it."""
    document = dict(scenario)
    for player, policy in pair._asdict().items():
        if isinstance(document[player], list):
            if policy != policy_in(document[player]):
                document[player] = [{**group, "policy": policy} for group in document[player]]
            continue
        section = {**document[player], "policy": policy}
        for of, key in _OF_A_COURSE.items():
            if policy != of:
                section.pop(key, None)
        document[player] = section
    return document


def with_values(document: dict[str, Any], axes: Sequence[Axis], values: Sequence[Any]) -> dict[str, Any]:
    """Return a document with a value of every axis; what is not swept is shared with the one that is given."""
    for axis, value in zip(axes, values, strict=True):
        for key, part in axis.settings(value):
            document = placed(document, key.path, part)
    return document


def check(plan: Plan, source: str) -> None:
    """Refuse a sweep with a key that no row could have, or values out of a key's range, before anything runs.

    What only concerns keys together, as the ratio of the speeds, is left to the rows.

    Raises:
        ConfigError: One line a fault, each with the key, the value and what is allowed.
    """
    _check_names(plan, source)
    base, model = with_policies(plan.scenario, plan.pairs[0]), model_of(plan)
    faults = [fault for axis in plan.axes for value in axis.extremes() for fault in _faults(model, base, axis, value)]
    if faults:
        raise ConfigError(f"{source}:\n" + "\n".join(f"  {fault}" for fault in dict.fromkeys(faults)))
    Scenarios(plan)


def _check_names(plan: Plan, source: str) -> None:
    known: dict[str, Collection[str]] = {"pursuer": PURSUER_STRATEGIES, "evader": EVADER_STRATEGIES}
    if plan.teams:
        known = {"pursuer": PURSUER_POLICIES, "evader": EVADER_POLICIES}
    for pair in plan.pairs:
        for player, policy in pair._asdict().items():
            if policy not in known[player] and policy != policy_in(plan.scenario[player]):
                raise ConfigError(f"{source}: policies.{player} = {policy!r}: allowed are {', '.join(known[player])}")


def _faults(model: Model, base: dict[str, Any], axis: Axis, value: Any) -> Iterator[str]:  # noqa: ANN401 - any value of a key
    try:
        document = with_values(base, (axis,), (value,))
        model.model_validate(document)
    except LookupError as error:
        yield f"{axis.key.text}: the scenario has no element {error.args[0]} there"
    except ValidationError as error:
        for fault in error.errors():
            if fault["loc"][: len(axis.key.path)] == axis.key.path:
                yield explain(model, dict(fault))
