"""`guidance league`: a policy against the optimum and against the built-in policies, on common random states."""

import json
from pathlib import Path
from typing import Annotated

import typer

from guidance.cli.arguments import AsJson, CommandGroup, completed, completed_scenario
from guidance.extras import require_extras
from guidance.screen import console, counted, headed

league = typer.Typer(
    cls=CommandGroup,
    rich_markup_mode="markdown",
    help="Play a policy against the optimum and the built-in policies: `guidance league run policy.py:choose`.",
)


@league.callback()
def _root() -> None:
    """Keep `run` a command of its own."""


@league.command()
def run(
    policy: Annotated[
        str,
        typer.Argument(help="path/to/file.py:function, module:function, or a built-in policy."),
    ],
    games: Annotated[int, typer.Option(min=1, help="Random states; each pair plays all.")] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="Of the states and the intervals.")] = 0,
    scenario: Annotated[
        str,
        typer.Option(
            help="A scenario file, or a name of `guidance scenario list`.",
            autocompletion=completed_scenario,
        ),
    ] = "pe",
    side: Annotated[
        str,
        typer.Option(
            help="Side of the policy: pursuer or evader.",
            autocompletion=completed("pursuer", "evader"),
        ),
    ] = "pursuer",
    out: Annotated[
        Path | None,
        typer.Option(help="New folder: league.json, a picture, the worst states as scenarios."),
    ] = None,
    worst: Annotated[
        int, typer.Option(min=0, help="With --out: worst states against each opponent.")
    ] = 3,
    as_json: AsJson = False,
) -> None:
    """Play a policy, and beside it the built-in policies, against the optimum and each built-in policy.

    A policy is a Python function of observations (n, 8), in TAD (n, 10), that returns actions (n, 3), of an evader
    (n, 2): shares of the speed from -1 to 1 (`python -c "help('guidance.strategies.own')"`). **The file is run as your
    own code**, with your rights: nothing keeps it from your files or your network. Read a stranger's file first.

    Regret is what a player loses against the game's exact value, s in PE, m in TAD; it is negative where the opponent
    lost more. The intervals in brackets hold with 95 % (bootstrap). States, games and intervals depend on the seed
    only, so a second run prints the same. A policy that raises or returns NaN loses its game as failed.
    A failed or undecided game also costs the remaining value, and no less than a lost game.

    `--out` writes the table as JSON, a picture (extra `plot`) and the worst states of the policy as scenarios, which
    `guidance scenario show`, `guidance scenario run` and `guidance fly` take.

    With a scenario of teams the captures are compared: of the policy, of the plays `optimal` and `captures` that keep
    promises, and of the rules `nearest`, `hungarian` and `lead`. Seeds scatter the players. A policy is then a function
    of the observations of `PursuitParallelEnv`, one row for each pursuer.

    - `guidance league run policy.py:choose --games 10000 --seed 7`
    - `guidance league run policy.py:choose --scenario tad --out league`: another game, with a picture
    - `guidance league run policy.py:flee --side evader`: the other side
    - `guidance league run captures --scenario teams_breakthrough --games 200`: rules of teams
    """
    from guidance.league import contest as contests  # noqa: PLC0415 - slow imports
    from guidance.league import results, team_contest  # noqa: PLC0415
    from guidance.sim.scenario import WIND_WORDS  # noqa: PLC0415
    from guidance.sim.scenario_file import load_any  # noqa: PLC0415
    from guidance.sim.teams import TeamScenario  # noqa: PLC0415

    if out is not None:
        require_extras(f"--out {out}", "plot")
        results.require_new(out)
    path, played_scenario = load_any(scenario)
    if isinstance(played_scenario, TeamScenario):
        teams = team_contest.team_contest_of(played_scenario, policy, side, games, seed)
        target = console(stderr=as_json)
        target.print(headed(played_scenario.title, f"  ({path.name}, {games} games, seed {seed})"))
        pairs = len(teams.players) * len(teams.opponents)
        rows = list(counted(team_contest.play_all_teams(teams), "playing", pairs))
        text = json.dumps(team_contest.team_document_of(teams, rows), indent=1) + "\n"
        team_contest.print_team_table(target, teams, rows)
        if out is not None:
            target.print(str(results.write_table(out, text)), soft_wrap=True, markup=False)
        if as_json:
            typer.echo(text, nl=False)
        return
    contest = contests.contest_of(played_scenario, policy, side, games, seed)
    target = console(stderr=as_json)
    target.print(headed(played_scenario.title, f"  ({path.name}, {games} games, seed {seed})"))
    if any(contest.scenario.wind.velocity_m_s):
        target.print(f"wind     {WIND_WORDS}", style="yellow", soft_wrap=True)
    total = len(contest.players) * len(contest.opponents)
    played = list(counted(contests.play_all(contest), "playing", total))
    text = json.dumps(results.document_of(contest, played), indent=1) + "\n"
    results.print_table(target, contest, played)
    if out is not None:
        for written in results.write_results(contest, played, out, text, worst):
            target.print(str(written), soft_wrap=True, markup=False)
    if as_json:
        typer.echo(text, nl=False)
