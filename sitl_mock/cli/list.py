"""`sitl-mock list` and `sitl-mock modes`: lists (flavours, faults, ...) and tables of modes."""

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Iterator


class Subject(StrEnum):
    """Subjects of `sitl-mock list`."""

    FLAVOURS = "flavours"
    FAULTS = "faults"
    CONDITIONS = "conditions"
    PARAMETERS = "parameters"
    STREAMS = "streams"


def list_(
    subject: Annotated[
        Subject | None, typer.Argument(help="What to list; default: flavours and faults.")
    ] = None,
    flavour: Annotated[str, typer.Option(help="Flavour of the parameters or streams.")] = "px4",
) -> None:
    """List flavours, faults, conditions, or a flavour's parameters or streams."""
    subjects = [Subject.FLAVOURS, Subject.FAULTS]
    if subject is not None:
        subjects = [subject]
    typer.echo("\n\n".join("\n".join(_lines(subject, flavour)) for subject in subjects))


def _lines(subject: Subject, flavour: str) -> "Iterator[str]":
    from sitl_mock.faults import KINDS, Group  # noqa: PLC0415 - not needed for `--help`
    from sitl_mock.flavours import NAMES, flavour_named  # noqa: PLC0415 - as above
    from sitl_mock.telemetry import builders_of  # noqa: PLC0415 - as above
    from sitl_mock.vehicle.conditions import CONDITIONS  # noqa: PLC0415 - as above

    match subject:
        case Subject.FLAVOURS:
            yield "flavours (--vehicles flavour:name)"
            for name in NAMES:
                each = flavour_named(name)
                yield f"  {name:<12} {each.title}; can be armed {each.ready_s:g} s after boot"
        case Subject.FAULTS:
            for group in Group:
                yield f"{group} faults (sitl-mock run --faults FILE, queries to <vehicle>/faults)"
                of_group = {name: kind for name, kind in KINDS.items() if kind.group is group}
                for name, kind in of_group.items():
                    keys = ", ".join(kind.options)
                    yield f"  {name:<20} {kind.meaning}" + (f" [{keys}]" if keys else "")
        case Subject.CONDITIONS:
            yield "conditions (MockVehicle.inject, fault scripts)"
            for name, condition in CONDITIONS.items():
                rest = " (once)" if condition.event else f"; neutral {condition.rest!r}"
                yield f"  {name:<18} {condition.meaning}{rest}"
        case Subject.PARAMETERS:
            each = flavour_named(flavour)
            yield f"parameters of {each.title}"
            for parameter in sorted(each.parameters):
                unit = f" {parameter.unit}" if parameter.unit else ""
                yield f"  {parameter.name:<16} {parameter.default:g}{unit}  {parameter.meaning}"
        case Subject.STREAMS:
            each = flavour_named(flavour)
            rates = each.rates_hz.values()
            links = ", ".join(each.rates_hz)
            yield f"streams of {flavour}: Hz on {links} links by default; 0: only on request"
            for name in sorted(builders_of(each.name).keys() - each.withheld):
                yield f"  {name:<28} {'  '.join(f'{kind.get(name, 0):>5g}' for kind in rates)}"


def modes(
    flavour: Annotated[str, typer.Option(help="px4, arducopter or rover; default: all.")] = "",
) -> None:
    """Print modes, their numbers and needs, and automatic mode changes, as Markdown."""
    from sitl_mock.flavours import NAMES, flavour_named  # noqa: PLC0415 - not needed for `--help`

    tables = [flavour_named(name).modes for name in ([flavour] if flavour else NAMES)]
    typer.echo("\n\n".join("\n".join(table.markdown()) for table in tables))
