"""`guidance sweep` and `guidance compare`: one scenario played with many values, its report, and comparisons."""

import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from guidance.cli.arguments import AsJson, CommandGroup, completed
from guidance.extras import require_extras


class _FileFirst(CommandGroup):
    """Makes `guidance sweep FILE` run `guidance sweep run FILE`, and prints the help of both."""

    def format_help(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - click's
        """Print the help of `guidance sweep FILE`, then that of the other commands."""
        command = self.commands["run"]
        command.format_help(
            command.context_class(command, info_name=ctx.info_name, parent=ctx.parent), formatter
        )
        super().format_help(ctx, formatter)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - click's context
        if args and args[0] not in {*self.commands, "--help"}:
            args = ["run", *args]
        return super().parse_args(ctx, args)


sweep = typer.Typer(
    cls=_FileFirst,
    rich_markup_mode="markdown",
    help="Play a scenario with many values of its keys: `guidance sweep FILE`, then `guidance sweep report FOLDER`.",
)


@sweep.command()
def run(
    file: Annotated[
        str,
        typer.Argument(
            help="A sweep file, or one of the package: policies, barrier, flown, circles, teams."
        ),
    ],
    way: Annotated[
        str | None,
        typer.Option(
            "--as",
            help="maths (point masses) or fast (mocked flights).",
            autocompletion=completed("maths", "fast"),
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes.", show_default="one per processor")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="A Dask scheduler: tcp://HOST:PORT or tls://HOST:PORT.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the rows.", show_default="sweeps/FILE-WAY")
    ] = None,
    chunk: Annotated[
        int | None, typer.Option(min=1, help="Rows in one file.", show_default="4,096 or fewer")
    ] = None,
) -> None:
    """Play every row of a sweep and write the rows as Parquet, chunk by chunk.

    To continue after an interruption, even by kill -9, run the same command: existing chunks are kept. The rows do not
    depend on the number of workers. A row whose values allow no game is written with the reason. `--as` replaces the
    file's `as`. A file has 4,096 games (512 of teams, one flight), or fewer so that each worker has four chunks.

    `--scheduler` uses a Dask cluster instead of processes (extra `cluster`). For tls://HOST:PORT, Dask's configuration
    has the certificate (distributed.comm.tls). Without TLS, anyone who can reach the scheduler can run code on its
    workers.

    A sweep file names a scenario and any of its keys:

        scenario = "pe"
        as = "maths"
        seeds = 1000
        policies = [{ pursuer = ["optimal", "pure_pursuit"], evader = "optimal" }]

        [grid]
        "evader.speed_m_s" = { from = 1.0, to = 2.5, count = 7 }
        "wind.velocity_m_s" = [[0.0, 0.0], [0.5, 0.0]]

        [random]
        "evader.position_m" = { disc = 40, about_m = [0.0, 50.0] }
        "pursuer.position_m[2]" = { uniform = [10.0, 60.0] }

    Distributions: uniform, log_uniform, normal, choice, disc, annulus. Keys and units are those of the scenario.

    Sweeps of the package: `policies` (ways to pursue, random states), `barrier` (winner and regret near the barrier),
    `flown` (flights of the mock with a noisy sensor), `circles` (flights after evaders that circle), `teams` (one to
    six pursuers against six evaders).

    - `guidance sweep policies`: a sweep of the package
    - `guidance sweep policies --as fast --workers 2 --out flown`: the same with flights of the mock
    - `python -c "import pyarrow.parquet as pq; print(pq.read_table('sweeps/policies-maths/rows'))"`: the rows
    """
    require_extras("guidance sweep", "sim")
    from guidance.sweeps.running import run_sweep  # noqa: PLC0415 - pyarrow takes a moment

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        typer.echo(
            str(
                run_sweep(file, way=way, workers=workers, scheduler=scheduler, out=out, chunk=chunk)
            )
        )
    except KeyboardInterrupt as interruption:
        words = str(interruption)
        if not words:
            words = "interrupted before anything was computed"
        typer.echo(words, err=True)
        raise typer.Exit(128 + signal.SIGINT) from None


@sweep.command()
def report(
    folder: Annotated[Path, typer.Argument(help="The folder of a sweep; it may be incomplete.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report.", show_default="FOLDER/report")
    ] = None,
    worst: Annotated[
        int, typer.Option(min=0, help="Worst games of each pair of policies, as scenario files.")
    ] = 3,
    as_json: AsJson = False,
) -> None:
    """Report captures and regret for each pair of policies and each swept value.

    Regret is the pursuer's loss against the game's value. With one key on the grid, the report is a curve: captures,
    mean regret, and its median with the spread from 5 % to 95 % of the games, for each value. With two keys it is a
    map. 95 % intervals (Wilson's, Student's t) are given for random draws only. Reasons of invalid rows are listed.

    Writes report.json, pictures as PNG and PDF, and the worst games as scenario files for `guidance scenario run`.
    """
    require_extras("guidance sweep report", "sim", "plot")
    from guidance.sweeps.report import write_sweep_report  # noqa: PLC0415 - matplotlib takes a second

    for path in write_sweep_report(
        folder, folder / "report" if out is None else out, worst=worst, as_json=as_json
    ):
        typer.echo(str(path), err=as_json)


def compare(
    a: Annotated[
        Path,
        typer.Argument(metavar="A", help="The folder of a run or a sweep, or an outcome.json."),
    ],
    b: Annotated[Path, typer.Argument(metavar="B", help="Another of the same kind.")],
    column: Annotated[
        str, typer.Option("--by", help="Sweeps: the column whose rows are listed.")
    ] = "game_time_s",
    rows: Annotated[int, typer.Option(min=0, help="Sweeps: number of rows to list.")] = 10,
    as_json: AsJson = False,
) -> None:
    """Compare two outcomes or two sweeps; differences are B minus A.

    Outcomes, as `guidance scenario run FILE --out FOLDER` writes them, are compared column by column. Sweeps are
    compared by the share of captures and the means of all columns, with 95 % intervals of the differences, and by the
    rows that differ most. If both vary the same values, rows with equal values and seeds are paired (Student's t of
    the paired differences); otherwise the samples are independent (Welch's t).

    - `guidance compare maths flown`: one scenario, played as maths and flown
    - `guidance compare sweeps/flown-maths sweeps/flown-fast`: the same for a sweep
    - `guidance compare old new --by regret --rows 20`: two versions of a policy
    """
    require_extras("guidance compare", "sim")
    from guidance.sweeps.compare import compare_paths  # noqa: PLC0415 - pyarrow takes a moment

    compare_paths(a, b, column=column, rows=rows, as_json=as_json)
