"""The flight as a node of ROS 2: topics of one vehicle, and services for orders where the vehicle file allows them.

The loop only appends to a bounded queue; entries that do not fit are dropped and counted. A separate thread connects to
the router, follows the flight, and makes and publishes the messages that have subscribers. It reconnects to a lost
router. A message that cannot be sent at once is lost.
"""

import logging
import threading
from collections import deque
from collections.abc import Mapping
from functools import partial
from typing import Final

import zenoh

from guidance.clock import Clock
from guidance.errors import ConfigError, LinkError
from guidance.flight import Event
from guidance.links.zenoh import ros_types
from guidance.links.zenoh.access import credentials_of
from guidance.links.zenoh.credentials import NO_CREDENTIALS, Credentials
from guidance.links.zenoh.rmw import DEPTH, RosNode, RosPublisher, ServiceRequest
from guidance.links.zenoh.session import close_all, is_over, open_session
from guidance.log.entries import CycleEntry, EventEntry
from guidance.log.export import started_unix_s
from guidance.log.ros import (
    MOTION_EVERY_S,
    TOPICS,
    TRANSFORMS,
    RosFlight,
    Topic,
    nanoseconds_of,
    ros_name,
    topic_name,
)
from guidance.log.sink import Sink
from guidance.session.flight_files import recorded_settings
from guidance.session.observe.log import LOGGER_NAME
from guidance.session.orders.control_socket import begin_exchange
from guidance.session.orders.mailbox import MOST_ORDERS, Mailbox
from guidance.session.output_sections import RosSection
from guidance.session.vehicle_file import Config

_NODE: Final = "guidance"
"""Name of the node; its namespace is the vehicle's name."""

ORDER_SERVICES: Final = (Event.HOLD, Event.LAND, Event.RETURN, Event.ENGAGE)
"""Orders that are services, std_srvs/Trigger, under their own words."""

MOST_TOPICS_WAITING: Final = 256
"""Five seconds of cycles; further entries are dropped and counted."""

_EVERY_S: Final = MOTION_EVERY_S
_LOOK_ROUNDS: Final = 6
"""Rounds of the thread between two checks for subscribers."""

RETRY_S: Final = 2.0
_ROUTER_S: Final = 1.0
"""Time limit of one attempt to reach the router."""

_TRANSFORMS_DEPTH: Final = 100
"""As the tf2 library keeps."""


class RosOutput(Sink):
    """The node of one vehicle.

    Args:
        flight: Makes the messages.
        section: Router, domain, and whether there are services.
        credentials: For the router.
        clock: Of the flight.
        started_unix_s: Unix time of the clock's zero.
        mailbox: Where orders go.

    Attributes:
        publishers: Of the topics that are offered.
        wanted: Topics with subscribers.
    """

    def __init__(
        self,
        flight: RosFlight,
        section: RosSection,
        credentials: Credentials,
        clock: Clock,
        started_unix_s: float,
        mailbox: Mailbox,
    ) -> None:
        self._flight = flight
        self._section = section
        self._credentials = credentials
        self._clock = clock
        self._started_unix_s = started_unix_s
        self._mailbox = mailbox
        self._log = logging.getLogger(LOGGER_NAME)
        self._orders = threading.BoundedSemaphore(MOST_ORDERS)
        self._waiting = deque[CycleEntry | EventEntry]()
        self.publishers: dict[Topic, RosPublisher] = {}
        self._by_name: dict[str, RosPublisher] = {}
        self.wanted: set[Topic] = set()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ros")
        self._thread.start()

    def cycle(self, entry: CycleEntry) -> None:
        """Keep a cycle for the thread."""
        self._keep(entry)

    def event(self, now_s: float, event: str, detail: str = "") -> None:
        """Keep an event for the thread."""
        self._keep(EventEntry(now_s, event, detail))

    def close(self) -> None:
        """Publish the waiting entries and leave the ROS graph; may be called twice."""
        self._stop.set()
        self._thread.join()

    @property
    def waiting(self) -> int:
        """Number of entries that are not published yet."""
        return len(self._waiting)

    def _keep(self, entry: CycleEntry | EventEntry) -> None:
        if len(self._waiting) >= MOST_TOPICS_WAITING:
            self.dropped += 1
        else:
            self._waiting.append(entry)

    def _run(self) -> None:
        session = None
        is_logged = False
        while session is None:
            if is_over(self._stop):
                return
            try:
                session = open_session(
                    self._section.endpoint, timeout_s=_ROUTER_S, credentials=self._credentials
                )
            except LinkError as error:
                if not is_logged:
                    is_logged = True
                    self._log.warning("no ROS 2 topics yet, trying again: %s", error)
                if is_over(self._stop, RETRY_S):
                    return
                self._publish()  # the flight is followed from its beginning
        try:
            # Appear in the ROS graph with all topics and services.
            vehicle = self._flight.name
            node = RosNode(session, self._section.domain_id, f"/{vehicle}", _NODE)
            for topic in TOPICS:
                depth = _TRANSFORMS_DEPTH if topic is TRANSFORMS else DEPTH
                name = topic_name(vehicle, topic)
                publisher = node.publisher(name, topic.type_name, depth)
                self._by_name[name] = publisher
                self.publishers[topic] = publisher
            if self._section.orders:
                for order in ORDER_SERVICES:
                    node.service(f"/{vehicle}/{order}", partial(self._hear, order))
            rounds = 0
            stopped = False
            while not stopped:
                # The last entries are published after the end
                stopped = is_over(self._stop, _EVERY_S)
                if rounds % _LOOK_ROUNDS == 0:
                    publishers = self.publishers.items()
                    self.wanted = {topic for topic, publisher in publishers if publisher.watched}
                rounds += 1
                self._publish()
            node.close()
        except zenoh.ZError as error:
            self._log.warning("no more ROS 2 topics: %s", error)
        finally:
            close_all(session.close)

    def _publish(self) -> None:
        """Make and send the messages of all waiting entries, on topics with subscribers."""
        while self._waiting:
            entry = self._waiting.popleft()
            try:
                if isinstance(entry, EventEntry):
                    self._flight.event(entry)
                    continue
                source_ns = nanoseconds_of(self._started_unix_s + entry.now_s)
                for topic, content in self._flight.cycle(entry, self.wanted):
                    self._by_name[topic].put(ros_types.encode_cdr(content), source_ns)
            except (ConfigError, ValueError, TypeError, ArithmeticError):
                self.dropped += 1  # an entry that cannot be a message

    def _hear(self, order: Event, request: ServiceRequest) -> None:
        """Answer on a thread of its own, since the answer waits for the loop."""
        if not begin_exchange(self._orders, self._answer, order, request):
            request.reply(self._now_ns(), success=False, message="too many orders wait already")

    def _answer(self, order: Event, request: ServiceRequest) -> None:
        answer = self._mailbox.answer(order, f"ROS 2 client {request.sender[:8]}")
        accepted = bool(answer["accepted"])
        words = answer.get("state") if accepted else answer.get("reason")
        request.reply(self._now_ns(), success=accepted, message=str(words))

    def _now_ns(self) -> int:
        return nanoseconds_of(self._started_unix_s + self._clock.now_s())


def open_ros(
    vehicle: str,
    metadata: Mapping[str, str],
    clock: Clock,
    mailbox: Mailbox,
    section: RosSection,
    config: Config | None = None,
) -> RosOutput:
    """Open the ROS 2 output of a vehicle.

    Args:
        vehicle: Its name.
        metadata: As in a record.
        clock: Of the flight.
        mailbox: For orders.
        section: Router and domain.
        config: The vehicle file, with mates and certificates; None for a mock.

    Raises:
        ConfigError: If the extra is missing, a certificate is wrong, or a mate has the same name in ROS.
    """
    ros_types.prepare("[ros]", ros_types.TRIGGER_RESPONSE)
    started_s = started_unix_s(metadata)
    flight = RosFlight(vehicle, recorded_settings, metadata, started_s)
    mates: tuple[str, ...] = ()
    if config is not None and config.team is not None:
        mates = config.team.mates
    for mate in mates:
        if ros_name(mate) == flight.name:
            raise ConfigError(
                f"team.mates: {mate!r} is {flight.name!r} in ROS, as {vehicle!r} is: rename one"
            )
    credentials = NO_CREDENTIALS
    if section.by_tls and config is not None:
        credentials = credentials_of(config.zenoh)
    return RosOutput(flight, section, credentials, clock, started_s, mailbox)
