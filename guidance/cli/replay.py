"""`guidance replay`: a recorded flight through the present code."""

import json
import math
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from guidance.log import Comparison, ReplayedCycle
    from guidance.log.replay import Apart


def replay(
    file: Annotated[Path, typer.Argument(help="A record.mcap that a flight wrote.")],
    changes: Annotated[
        list[str] | None,
        typer.Option("--with", help="KEY=VALUE: what another setting would have commanded; may be repeated."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="CSV with both velocities of every cycle.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the counts as JSON.")] = False,
) -> None:
    """Feed the recorded inputs through the present code and compare the setpoints bit for bit.

    Exits with 1 and shows the first difference with its inputs if there is one. With `--with`, shows how far what
    another setting would have commanded lies from what was; the motion of both vehicles stays as recorded.

    - `guidance replay flights/pe-001/record.mcap`: has the code changed what it commands?
    - `guidance replay record.mcap --with policy=pure_pursuit`: another policy at the same moments
    - `guidance replay record.mcap --with pursuer.speed_m_s=4.0 --out both.csv`
    """
    from guidance.log import making_sense_of  # noqa: PLC0415 - numpy takes its time
    from guidance.log.replay import compare_into  # noqa: PLC0415
    from guidance.session.recorded import changes_of, recorded_settings  # noqa: PLC0415

    wanted = changes_of(changes or [])
    with making_sense_of(file):
        comparison, survey = compare_into(file, partial(recorded_settings, changes=wanted), out, what_if=bool(wanted))
    if survey.torn is not None:
        typer.echo(f"the record is torn ({survey.torn}): read up to {survey.last_s or 0.0:.2f} s", err=True)
    if survey.missing:
        typer.echo(f"{survey.missing} messages are missing in between: the file is damaged", err=True)
    if as_json:
        typer.echo(json.dumps(_counted(comparison, what_if=bool(wanted)), indent=2))
        raise typer.Exit(1 if comparison.first is not None and not wanted else 0)
    if out is not None:
        typer.echo(f"both velocities: {out}")
    typer.echo(f"{comparison.cycles} cycles, {comparison.setpoints} setpoints recorded")
    if wanted:
        typer.echo(f"{comparison.differing} cycles differ")
        typer.echo(_apart("wanted by the policy", comparison.wanted))
        typer.echo(_apart("commanded", comparison.commanded))
        return
    if comparison.first is not None:
        typer.echo(f"{comparison.differing} cycles differ; the first:")
        typer.echo(_shown(comparison.first))
        raise typer.Exit(1)
    typer.echo("every setpoint, state and request came back bit for bit")


def _counted(comparison: "Comparison", *, what_if: bool) -> dict[str, Any]:
    counts = {name: getattr(comparison, name) for name in ("cycles", "setpoints", "differing")}
    if not what_if:
        return counts
    return counts | {name: asdict(getattr(comparison, name)) for name in ("wanted", "commanded")}


def _apart(what: str, apart: "Apart") -> str:
    count = max(1, apart.cycles)
    return (
        f"{what} over {apart.cycles} cycles: {apart.speed_sum_m_s / count:.2f} m/s apart on average, "
        f"{apart.speed_most_m_s:.2f} at most; {math.degrees(apart.angle_sum_rad / count):.1f}° on average, "
        f"{math.degrees(apart.angle_most_rad):.1f}° at most"
    )


def _shown(step: "ReplayedCycle") -> str:
    from guidance.log.entries import CYCLE, cycle_entry  # noqa: PLC0415

    recorded, present = CYCLE.plain(step.row), CYCLE.plain(cycle_entry(step.row.flight_inputs, step.outputs))
    lines = [f"at {step.row.now_s:.6f} s, in state {step.row.state}:"]
    for name in step.differing:
        lines += [f"  {name}", f"    recorded  {json.dumps(recorded.get(name))}"]
        lines.append(f"    now       {json.dumps(present.get(name))}")
    lines.append("  inputs")
    for name, value in recorded["inputs"].items():
        lines += [f"    {name}  {json.dumps(one)}" for one in value]
    return "\n".join(lines)
