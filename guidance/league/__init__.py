"""A league of policies with a known optimum: environments for training, and games that judge the policies.

Environments, which need the extra `league` (Gymnasium, PettingZoo):
    PursuitVectorEnv: many games of one scenario as one batch, one side against a named opponent.
    PursuitEnv: one such game.
    PursuitParallelEnv: both sides of a game, or all players of two teams, as PettingZoo's agents.

If Gymnasium is installed, importing this package registers the id "Pursuit-v0". `gymnasium.make("Pursuit-v0")` and
`gymnasium.make_vec("Pursuit-v0", num_envs=64)` take the environments' arguments; the default scenario is "pe".

`guidance.strategies.own` has the columns of observations and actions. A policy is a function of observations (n, k)
that returns actions (n, a); the same function plays in `guidance league run`, in scenarios and in flight.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Final

from guidance.extras import require_extras

if TYPE_CHECKING:
    from guidance.league.gymnasium_envs import PursuitEnv as PursuitEnv
    from guidance.league.gymnasium_envs import PursuitVectorEnv as PursuitVectorEnv
    from guidance.league.parallel_env import PursuitParallelEnv as PursuitParallelEnv

_ENVIRONMENTS: Final = {
    "PursuitEnv": "gymnasium_envs",
    "PursuitParallelEnv": "parallel_env",
    "PursuitVectorEnv": "gymnasium_envs",
}
"""Every environment, and its module."""


def __getattr__(name: str) -> Any:  # noqa: ANN401 - any of the environments
    """Import an environment when it is used first, because its libraries are optional.

    Raises:
        ConfigError: If they are not installed.
    """
    if name not in _ENVIRONMENTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    require_extras(f"guidance.league.{name}", "league")
    return getattr(import_module(f"{__name__}.{_ENVIRONMENTS[name]}"), name)


if find_spec("gymnasium") is not None:
    import gymnasium

    gymnasium.register(
        "Pursuit-v0",
        "guidance.league:PursuitEnv",
        vector_entry_point="guidance.league:PursuitVectorEnv",
        kwargs={"scenario": "pe"},
    )
