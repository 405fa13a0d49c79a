"""Policies that a user writes: functions from observations to actions, the same in a batch and in flight.

A policy is a function of observations (n, k) that returns actions (n, a); n is 1 in flight. Its name is where it is:
`module:function`, or `path/to/file.py:function`. It may take parameters by name, after the observations:
`file.py:function(lead_rad=0.1)`, in files also `{ name = "file.py:function", lead_rad = 0.1 }`. The code is the user's
own and runs with the user's rights: no check here restricts it. It is imported when it is first played or when
a command loads it, never when a file that names it is only read, shown or replayed.

Observations of the pursuer, in m and m/s in the game frame (x east, y north, z up):

| columns | quantity |
|---|---|
| 0, 1, 2 | centre of the stand-off disc about the evader, as the pursuer knows it, relative to the pursuer |
| 3, 4 | velocity of the evader, as the pursuer knows it |
| 5, 6, 7 | velocity over the ground that the pursuer asked for last |
| 8, 9 | TAD only: position of the target relative to the pursuer |

Observations of the evader, which sees the pursuer exactly:

| columns | quantity |
|---|---|
| 0, 1, 2 | position of the pursuer relative to the centre of the stand-off disc about the evader |
| 3, 4, 5 | velocity over the ground of the pursuer |
| 6, 7 | velocity that the evader asked for last |
| 8, 9 | TAD only: position of the target relative to the evader |

Actions are shares of the speeds through the air, from −1 to 1: of the pursuer (x, y, z), of the evader (x, y). Those of
x and y are of the horizontal speed, that of z is of the climb or, if it is negative, of the descent. A velocity beyond
the speed set is brought into it: a Ball's is shortened as a whole, a Cylinder's level part by itself. A policy that
raises, or whose answer is not finite, has no answer: its game is over as failed, whichever side it plays.
"""

import ast
import functools
import importlib
import importlib.util
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from pydantic import WithJsonSchema

from guidance.errors import ConfigError
from guidance.game import Game
from guidance.game.arrays import FloatArray, Real
from guidance.game.speed_sets import bounded

Choose: TypeAlias = Callable[[FloatArray], Any]
"""A policy: observations (n, k) to actions (n, a)."""

PURSUER_COLUMNS: Final = 8
TARGET_COLUMNS: Final = 2
"""Columns of an observation, of either player, and those that TAD adds."""

PURSUER_SHARES: Final = 3
EVADER_SHARES: Final = 2
"""Columns of an action."""

LARGEST_SHARE: Final = 1e100
"""Larger shares count as this one, because their squares would not be finite."""

_WORD: Final = "[A-Za-z_][A-Za-z0-9_]*"
FORM: Final = rf"^([^:\0]+\.py|{_WORD}(\.{_WORD})*):{_WORD}(\({_WORD}=[^()\0]+\))?$"
"""Regular expression of a policy's name, with its parameters if it has any."""

_FORM: Final = re.compile(FORM)
_FORM_WORDS: Final = "module:function or path/to/file.py:function, with parameters as (name=value)"

_LOADED: Final[dict[str, Choose]] = {}
"""Every policy that was registered or imported, by its name."""


Answer: TypeAlias = tuple[float, ...] | str
"""A policy's action in one state, or why it has none."""

Ask: TypeAlias = Callable[[FloatArray], Answer]
"""Asks a policy in flight: an observation (1, k) to its answer. It may also refuse because the policy is too slow."""


class PolicyError(Exception):
    """A policy raised, or its answer is no action; the message says which."""


def is_own(name: str) -> bool:
    """Return whether a policy's name has the form of a user's policy."""
    return name in _LOADED or _FORM.fullmatch(name) is not None


def register_policy(name: str, choose: Choose) -> None:
    """Give a policy a name, under which scenarios and commands play it.

    Raises:
        ConfigError: If the name has not the form `module:function`, or there is no function.
    """
    if _FORM.fullmatch(name) is None:
        raise ConfigError(f"policy = {name!r}: must be {_FORM_WORDS}")
    if not callable(choose):
        raise ConfigError(f"policy = {name!r}: {choose!r} is no function of observations")
    _LOADED[name] = choose


def forget() -> None:
    """Forget all policies: the next use of a name imports its file again, as after a change of it."""
    _LOADED.clear()


def as_one_text(policy: object) -> object:
    """Return a policy that a file gives as a table, `{ name = "file.py:function", lead_rad = 0.1 }`, as one text.

    A validator of pydantic; any other value is returned as it is.

    Raises:
        ValueError: If the table has no name, or a parameter is no number, text, true or false.
    """
    if not isinstance(policy, Mapping):
        return policy
    name = policy.get("name")
    if not isinstance(name, str):
        raise ValueError("a table needs the key name, such as file.py:function")  # noqa: TRY004 - for pydantic
    parameters = {key: value for key, value in policy.items() if key != "name"}
    for key, value in parameters.items():
        if not isinstance(value, (bool, int, float, str)):
            raise ValueError(f"{key} = {value!r}: must be a number, a text or a truth value")  # noqa: TRY004
    if not parameters:
        return name
    listed = ", ".join(f"{key}={value!r}" for key, value in parameters.items())
    return f"{name}({listed})"


def policy_schema(names: Sequence[str]) -> WithJsonSchema:
    """Return the JSON schema of a policy: one of the names, or a user's as text or as a table with parameters."""
    parameter = {"type": ["number", "string", "boolean"]}
    table = {
        "type": "object",
        "properties": {"name": {"type": "string", "pattern": FORM}},
        "required": ["name"],
        "additionalProperties": parameter,
    }
    built_in = {"type": "string", "enum": [*names]}
    return WithJsonSchema({"anyOf": [built_in, {"type": "string", "pattern": FORM}, table]})


def load_policy(name: str) -> Choose:
    """Return a policy by its name; import its file or its module the first time. A file's path is as of the shell.

    Raises:
        ConfigError: If the name has another form, there is no such file, module or function, or the function does not
            take the parameters.
    """
    if name in _LOADED:
        return _LOADED[name]
    if _FORM.fullmatch(name) is None:
        raise ConfigError(f"policy = {name!r}: must be {_FORM_WORDS}")
    function_name, bracket, listed = name.partition("(")
    choose = _LOADED.get(function_name)
    if choose is None:
        source, _, function = function_name.rpartition(":")
        path = Path(source)
        is_file = source.endswith(".py")
        if is_file and not path.is_file():
            raise ConfigError(f"policy = {name!r}: there is no file {path} in {Path.cwd()}")
        try:
            module = _run_file(path) if is_file else importlib.import_module(source)
        except Exception as error:
            raise ConfigError(
                f"policy = {name!r}: {source} cannot be imported: {type(error).__name__}: {error}"
            ) from error
        choose = getattr(module, function, None)
        if choose is None or not callable(choose):
            functions = [key for key, value in vars(module).items() if callable(value)]
            allowed = ", ".join(key for key in functions if not key.startswith("_"))
            raise ConfigError(
                f"policy = {name!r}: {source} has no function {function}; it has: {allowed}"
            )
    if bracket:
        listed = listed.removesuffix(")")
        try:
            call = ast.parse(f"f({listed})", mode="eval").body
            keywords = call.keywords if isinstance(call, ast.Call) and not call.args else ()
            parameters = {str(one.arg): ast.literal_eval(one.value) for one in keywords}
        except (SyntaxError, ValueError) as error:
            raise ConfigError(
                f"policy = {name!r}: parameters must be name=value, with commas between: {listed}"
            ) from error
        try:
            signature = inspect.signature(choose)
            signature.bind(None, **parameters)
        except TypeError as error:
            _, *others = signature.parameters
            allowed = ", ".join(others) or "none"
            raise ConfigError(
                f"policy = {name!r}: {error}; its parameters are: {allowed}"
            ) from error
        choose = functools.partial(choose, **parameters)
    _LOADED[name] = choose
    return choose


def _run_file(path: Path) -> Any:  # noqa: ANN401 - a module has no type of its own
    spec = importlib.util.spec_from_file_location(f"own_policy_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ImportError("it is no Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def require_fit(name: str, observation: FloatArray, shares: int) -> None:
    """Load a policy and ask it once, before anything is played.

    Args:
        name: The policy's.
        observation: Some observations of the game, (n, k).
        shares: Columns of an action.

    Raises:
        ConfigError: If it is unknown, declares another observation space, or its answer is no action.
    """
    choose = load_policy(name)
    shape = getattr(getattr(choose, "observation_space", None), "shape", None)
    needed = observation.shape[1:]
    if shape is not None and tuple(shape) != needed:
        raise ConfigError(
            f"policy = {name!r}: its observation_space has shape {tuple(shape)}; this game's observations have "
            f"{needed}: play it in a game of the kind and for the side that it was trained for"
        )
    try:
        action = action_of(name, choose, observation, shares)
    except PolicyError as error:
        raise ConfigError(f"policy = {name!r}: {error}") from error
    if not np.isfinite(action).all():
        raise ConfigError(f"policy = {name!r}: it answers {action[0].tolist()}; must be finite")


def answer_of(name: str, choose: Choose, observation: FloatArray) -> Answer:
    """Ask a policy of the pursuer in one state, (1, k); returns an error of the policy as text.

    A number that is not finite is NaN, as in the record, so that a replay fails with the same words.
    """
    try:
        action = action_of(name, choose, observation, PURSUER_SHARES)
    except PolicyError as error:
        return str(error)
    finite_action = np.where(np.isfinite(action[0]), action[0], np.nan)
    return tuple(finite_action.tolist())


def observe_pursuit(
    game: Game,
    pursuer_m: FloatArray,
    evader_m: FloatArray,
    evader_m_s: FloatArray,
    last_m_s: FloatArray,
    target_m: FloatArray | None,
) -> FloatArray:
    """Return the pursuer's observations, (n, 8), or (n, 10) with a target.

    Args:
        game: Height of the disc.
        pursuer_m: (n, 3).
        evader_m: As the pursuer knows it, (n, 3).
        evader_m_s: As the pursuer knows it, (n, 3).
        last_m_s: Velocity over the ground that the player asked for last, (n, 3).
        target_m: (n, 3), or None in PE.
    """
    observations = _blank(len(pursuer_m), target_m)
    _fill(observations, 0, evader_m - pursuer_m)
    observations[:, 2] += game.standoff.height_m
    _fill(observations, 3, evader_m_s[:, :2])
    _fill(observations, 5, last_m_s)
    if target_m is not None:
        _fill(observations, 8, target_m[:, :2] - pursuer_m[:, :2])
    return observations


def observe_evasion(
    game: Game,
    pursuer_m: FloatArray,
    evader_m: FloatArray,
    pursuer_m_s: FloatArray,
    last_m_s: FloatArray,
    target_m: FloatArray | None,
) -> FloatArray:
    """Return the evader's observations, (n, 8), or (n, 10) with a target; arguments as of `observe_pursuit`."""
    observations = _blank(len(pursuer_m), target_m)
    _fill(observations, 0, pursuer_m - evader_m)
    observations[:, 2] -= game.standoff.height_m
    _fill(observations, 3, pursuer_m_s)
    _fill(observations, 6, last_m_s[:, :2])
    if target_m is not None:
        _fill(observations, 8, target_m[:, :2] - evader_m[:, :2])
    return observations


def _blank(rows: int, target_m: FloatArray | None) -> FloatArray:
    columns = PURSUER_COLUMNS + (0 if target_m is None else TARGET_COLUMNS)
    return np.empty((rows, columns))


def _fill(observations: FloatArray, first: int, columns: FloatArray) -> None:
    """Write columns (n, k) into observations. One by one, because NumPy takes six times as long for short rows."""
    for number in range(columns.shape[1]):
        observations[:, first + number] = columns[:, number]


def shares_of(action: FloatArray) -> FloatArray:
    """Return the shares of an action, small enough to be squared; NaN stays NaN."""
    return np.clip(np.asarray(action, dtype=np.float64), -LARGEST_SHARE, LARGEST_SHARE)


def pursuer_velocity(game: Game, action: FloatArray) -> FloatArray:
    """Return the velocity over the ground, (n, 3), m/s, of a pursuer's action (n, 3); NaN stays NaN."""
    speeds = game.pursuer
    level_m_s = _speed_rows(speeds.horizontal_m_s)
    shares = shares_of(action)
    share = shares[:, 2]
    commanded_m_s = shares * level_m_s[:, None]
    commanded_m_s[:, 2] = share * np.where(share > 0.0, speeds.climb_m_s, speeds.descent_m_s)
    velocity = speeds.flyable(commanded_m_s)
    if not game.calm:
        velocity[:, 0] += game.wind_m_s[0]
        velocity[:, 1] += game.wind_m_s[1]
    return velocity


def evader_velocity(game: Game, action: FloatArray) -> FloatArray:
    """Return the velocity, (n, 3), m/s, of an evader's action (n, 2)."""
    velocity = np.zeros((len(action), 3))
    speed_m_s = _speed_rows(game.evader_speed_m_s)
    _fill(velocity, 0, shares_of(action) * speed_m_s[:, None])
    return bounded(velocity, speed_m_s)


def _speed_rows(speed_m_s: Real) -> FloatArray:
    return np.atleast_1d(np.asarray(speed_m_s, dtype=np.float64))


def asked_pursuit(
    name: str,
    game: Game,
    pursuer_m: FloatArray,
    evader_m: FloatArray,
    target_m: FloatArray | None,
    evader_m_s: FloatArray,
    last_m_s: FloatArray | None,
) -> FloatArray:
    """Return the velocities of a user's policy, (n, 3), m/s; NaN where it has no answer."""
    last = np.zeros_like(pursuer_m) if last_m_s is None else last_m_s
    observation = observe_pursuit(game, pursuer_m, evader_m, evader_m_s, last, target_m)
    try:
        action = action_of(name, load_policy(name), observation, PURSUER_SHARES)
    except PolicyError:
        return np.full(pursuer_m.shape, np.nan)
    velocity = pursuer_velocity(game, action)
    velocity[~np.isfinite(action).all(axis=1)] = np.nan
    return velocity


def asked_evasion(
    name: str,
    game: Game,
    pursuer_m: FloatArray,
    evader_m: FloatArray,
    target_m: FloatArray | None,
    pursuer_m_s: FloatArray | None,
    last_m_s: FloatArray | None,
) -> FloatArray:
    """Return the velocities of a user's policy, (..., 3), m/s; NaN where it has no answer."""
    if evader_m.ndim == 1:  # one state, in flight
        velocity_m_s = None if pursuer_m_s is None else pursuer_m_s[None]
        last = None if last_m_s is None else last_m_s[None]
        goal = None if target_m is None else target_m[None]
        rows = asked_evasion(name, game, pursuer_m[None], evader_m[None], goal, velocity_m_s, last)
        return np.asarray(rows[0])
    still = np.zeros_like(evader_m)
    velocity_m_s = still if pursuer_m_s is None else pursuer_m_s
    last = still if last_m_s is None else last_m_s
    observation = observe_evasion(game, pursuer_m, evader_m, velocity_m_s, last, target_m)
    try:
        action = action_of(name, load_policy(name), observation, EVADER_SHARES)
    except PolicyError:
        return np.full(evader_m.shape, np.nan)
    velocity = evader_velocity(game, action)
    velocity[~np.isfinite(action).all(axis=1)] = np.nan
    return velocity


def action_of(name: str, choose: Choose, observation: FloatArray, shares: int) -> FloatArray:
    """Ask a policy; its answer may have rows that are not finite.

    Args:
        name: The policy's.
        choose: The policy.
        observation: (n, k).
        shares: Columns of an action.

    Raises:
        PolicyError: If it raises, or does not return n real actions.
    """
    try:
        answer = np.asarray(choose(observation))
    except Exception as error:
        raise PolicyError(f"{name} raised {type(error).__name__}: {error}") from error
    needed = (len(observation), shares)
    if answer.dtype.kind not in "fiu" or answer.shape != needed:
        raise PolicyError(
            f"{name} answers shape {answer.shape} of {answer.dtype} to observations of shape {observation.shape}; "
            f"must be real numbers of shape {needed}, shares of the speed from −1 to 1"
        )
    return answer.astype(np.float64)
