"""`guidance sweep` and `compare`: a scenario played a million times over, its report, and two of them side by side."""

import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from guidance.cli.arguments import CommandGroup
from guidance.extras import require


class _FileFirst(CommandGroup):
    """`guidance sweep FILE` is `guidance sweep run FILE`, and its help is that of both."""

    def format_help(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - click's
        """Print the help of `guidance sweep FILE`, then the other commands."""
        command = self.commands["run"]
        command.format_help(command.context_class(command, info_name=ctx.info_name, parent=ctx.parent), formatter)
        super().format_help(ctx, formatter)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - click's context
        if args and args[0] not in {*self.commands, "--help"}:
            args = ["run", *args]
        return super().parse_args(ctx, args)


sweep = typer.Typer(
    cls=_FileFirst,
    rich_markup_mode="markdown",
    help="Play a scenario many times with its keys varied: `guidance sweep FILE`, then `guidance sweep report FOLDER`.",
)


@sweep.command()
def run(
    file: Annotated[str, typer.Argument(help="A sweep file, or the name of one that comes along: policies, barrier.")],
    way: Annotated[
        str | None, typer.Option("--as", help="maths (point masses) or fast (mocked flights), in place of the file's.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine.", show_default="one a processor")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Address of a Dask cluster in place of them (extra `cluster`), tcp://HOST:PORT: who reaches it runs "
            "code on its workers. With tls://HOST:PORT only who has a certificate does; ours is the one of Dask's "
            "configuration (distributed.comm.tls)."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the rows.", show_default="sweeps/FILE-WAY")] = None,
    chunk: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Rows written at a time.",
            show_default="about 10 s of work, and four chunks a worker at least; a flight each with --as fast",
        ),
    ] = None,
) -> None:
    """Play every row of a sweep and write the rows as Parquet, chunk by chunk.

    What was interrupted, even by kill -9, goes on with the same command: chunks that are there are not computed again.
    The rows are the same on any number of workers. A row whose values allow no game is kept, with its reason.

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

    Distributions: uniform, log_uniform, normal, choice, disc, annulus. Every key as in the scenario, with its unit.

    - `guidance sweep policies`: one that comes along
    - `guidance sweep policies --as fast --workers 2 --out flown`: the same, flown by the mock
    - `python -c "import pyarrow.parquet as pq; print(pq.read_table('sweeps/policies-maths/rows'))"`: the rows
    """
    require("guidance sweep", "sim")
    from guidance.sweeps.running import checked_way, run_sweep  # noqa: PLC0415 - pyarrow takes a moment

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        path = run_sweep(file, way=checked_way(way), workers=workers, scheduler=scheduler, out=out, chunk=chunk)
    except KeyboardInterrupt as interruption:
        typer.echo(str(interruption) or "interrupted before anything was computed", err=True)
        raise typer.Exit(128 + signal.SIGINT) from None
    typer.echo(str(path))


@sweep.command()
def report(
    folder: Annotated[Path, typer.Argument(help="The folder that guidance sweep wrote; it need not be complete.")],
    out: Annotated[Path | None, typer.Option(help="Folder for the report.", show_default="FOLDER/report")] = None,
    worst: Annotated[int, typer.Option(min=0, help="Worst cases of each pair of policies, as scenario files.")] = 3,
    as_json: Annotated[bool, typer.Option("--json", help="Print what report.json holds.")] = False,
) -> None:
    """Tell what came out: who captures how often, how much is lost against the game's value, and where it was worst.

    For every pair of policies: how the games ended, the probability of capture with its 95 % interval (Wilson's), the
    regret's mean with its 95 % interval (Student's t) and its quantiles. Writes report.json, pictures as PNG and PDF,
    and the worst cases as scenario files, ready for `guidance fly` and `guidance scenario run`.
    """
    require("guidance sweep report", "sim", "plot")
    from guidance.sweeps.report import write_report  # noqa: PLC0415 - matplotlib takes a second

    for path in write_report(folder, folder / "report" if out is None else out, worst=worst, as_json=as_json):
        typer.echo(str(path), err=as_json)


def compare(
    a: Annotated[Path, typer.Argument(metavar="A", help="An outcome (JSON), or a sweep's folder.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="The same, to hold against it.")],
    column: Annotated[
        str, typer.Option("--by", help="Column whose largest differences are listed (sweeps only).")
    ] = "achieved",
    rows: Annotated[int, typer.Option(min=0, help="How many of the largest differences are listed.")] = 10,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Hold two outcomes, or two sweeps, against each other; differences are B minus A.

    Two outcomes, as `guidance scenario run FILE --json` prints them: column by column. Two sweeps: the means of all
    columns and the probability of capture, with 95 % intervals of their differences, and the rows that differ most.
    Rows pair where both sweeps have the same values and seeds in them, and the intervals are then those of the paired
    differences; else the two are taken as independent.

    - `guidance compare maths.json flown.json`: the same scenario, in mathematics and flown
    - `guidance compare sweeps/flown-maths sweeps/flown-fast`: the same for a sweep
    - `guidance compare old new --by regret --rows 20`: two versions of a policy
    """
    require("guidance compare", "sim")
    from guidance.sweeps.compare import compare_paths  # noqa: PLC0415 - pyarrow takes a moment

    compare_paths(a, b, column=column, rows=rows, as_json=as_json)
