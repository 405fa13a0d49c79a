"""`sitl-mock versions`: the versions of the flavours, and what differs between two of them."""

from typing import Annotated

import typer


def versions(
    first: Annotated[str, typer.Argument(help="A version, as px4@1.17; none: list all.")] = "",
    second: Annotated[str, typer.Argument(help="Another version of it, as px4@1.18.")] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """List versions, or what differs between two versions: parameters, commands, modes, messages and streams.

    `sitl-mock versions px4@1.17 px4@1.18`

    Only the first version of a flavour has recorded data. A later one differs from it as its release notes and sources
    say; its dynamics, texts and timing are those of the recorded one.
    """
    import json  # noqa: PLC0415 - not needed for `--help`

    from sitl_mock.versions import NAMES, specs_of  # noqa: PLC0415 - as above

    if not first:
        for name in NAMES:
            recorded, *later = specs_of(name)
            typer.echo("\n".join((f"{recorded:<16} recorded, the default", *later)))
        return
    from sitl_mock.differences import differences_of  # noqa: PLC0415 - as above

    other = second
    if not other:
        name = first.partition("@")[0]
        other = first if name not in NAMES else specs_of(name)[0]
    differences = differences_of(first, other)
    if as_json:
        typer.echo(
            json.dumps(
                [difference._asdict() for difference in differences], indent=1, ensure_ascii=False
            )
        )
        return
    typer.echo(f"{len(differences)} differences of {first} and {other}")
    for difference in differences:
        note = f"  ({difference.note})" if difference.note else ""
        typer.echo(
            f"{difference.subject:<12} {_or_none(difference.first):<34} {_or_none(difference.second)}{note}"
        )


def _or_none(text: str) -> str:
    return text if text else "-"
