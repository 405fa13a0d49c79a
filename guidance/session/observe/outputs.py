"""Further outputs of a flight. Each is one module: it opens a sink (`guidance.log.sink`) and registers that.

`OUTPUTS.add` adds one from outside. Its `open` gets everything that a flight has open, and returns None for a vehicle
that does not want it. An output from outside can have a section in vehicle files (`session.vehicle_file.SECTIONS`),
which `order.config.section` returns; without the section it opens nothing.
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from typing import Final, NamedTuple

from guidance.clock import Clock
from guidance.links.mavlink.ground_link import GroundLink
from guidance.links.port import VehicleLink
from guidance.links.px4.link import Px4Link
from guidance.links.zenoh.session import Session
from guidance.log.broadcast import Broadcast
from guidance.log.sink import Sink
from guidance.registry import Registry
from guidance.session.observe.flight_mode import FlightModeOutput
from guidance.session.observe.ground_station import GroundStationOutput
from guidance.session.orders.mailbox import Mailbox
from guidance.session.output_sections import RosSection
from guidance.session.vehicle_file import Config


class OutputOrder(NamedTuple):
    """Arguments for opening an output.

    Attributes:
        vehicle: Its name.
        metadata: As in a record: vehicle file, scenario, versions and, in real time, the start.
        clock: Of the flight.
        link: To the vehicle.
        mailbox: For orders of people.
        config: The vehicle file; None for a mock.
        bus: The Zenoh session of orders and broadcasts; None without one. It is not closed by the output.
        ground_link: To ground stations; None if the vehicle file does not ask for it.
        ros: Where ROS 2 topics are published, in place of the vehicle file's.
    """

    vehicle: str
    metadata: Mapping[str, str]
    clock: Clock
    link: VehicleLink
    mailbox: Mailbox
    config: Config | None = None
    bus: Session | None = None
    ground_link: GroundLink | None = None
    ros: RosSection | None = None


OpenOutput = Callable[[OutputOrder], Sink | None]
"""Opens an output; None if the vehicle file does not ask for it. Raises GuidanceError if the user can fix it."""


def _open_broadcast(order: OutputOrder) -> Sink | None:
    if order.bus is None:
        return None
    return Broadcast(order.vehicle, order.bus, order.metadata)


def _open_ros(order: OutputOrder) -> Sink | None:
    section = order.ros
    if section is None and order.config is not None:
        section = order.config.ros
    if section is None:
        return None
    from guidance.session.observe.ros import open_ros  # noqa: PLC0415 - of an extra

    return open_ros(
        order.vehicle, order.metadata, order.clock, order.mailbox, section, order.config
    )


def _open_ground_station(order: OutputOrder) -> Sink | None:
    if order.config is None or order.ground_link is None:
        return None
    announce = order.config.vehicle.announce
    return GroundStationOutput(order.ground_link, order.mailbox, announce=announce)


def _open_flight_mode(order: OutputOrder) -> Sink | None:
    if not isinstance(order.link, Px4Link):
        return None
    return FlightModeOutput(order.link, order.mailbox)


OUTPUTS: Final[Registry[OpenOutput]] = Registry(
    "output",
    "output",
    "pursuit_guidance.outputs",
    {
        "broadcast": _open_broadcast,
        "ros": _open_ros,
        "ground station": _open_ground_station,
        "flight mode": _open_flight_mode,
    },
)
"""Functions that open outputs, by name. Add one with `OUTPUTS.add`."""


def open_outputs(order: OutputOrder, stack: ExitStack) -> list[Sink]:
    """Open all outputs of a vehicle; the stack closes them.

    Raises:
        GuidanceError: For everything that the user can fix.
    """
    sinks = list[Sink]()
    for open_output in OUTPUTS.importable().values():
        sink = open_output(order)
        if sink is not None:
            sinks.append(stack.enter_context(closing(sink)))
    return sinks
