"""A flavour (kind of vehicle) as constant data, the interfaces of its parts, and what its telemetry reads."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from sitl_mock.dynamics import Setpoint, Vehicle, Wander
from sitl_mock.dynamics.shaping import Reference
from sitl_mock.logs import LogBook
from sitl_mock.mavlink import Message
from sitl_mock.missions.flight import MissionFlight
from sitl_mock.protocols import (
    Command,
    CommandAnswer,
    EventLog,
    FileTree,
    Identity,
    LogRules,
    MissionRules,
    Parameter,
    ParameterRules,
    ParameterStore,
    PlanItem,
    PlanStore,
    Reply,
    Storage,
    StreamRules,
)
from sitl_mock.vehicle.modes import Available, ModeTable
from sitl_mock.vehicle.sensors import EXACT, SensorNoise
from sitl_mock.vehicle.state import PX4_PACK, Pack, VehicleState
from sitl_mock.world import Home


class Commander(Protocol):
    """Decisions of one flavour for one vehicle.

    It has no clock: every call gives the time. Its state is in itself and in the vehicle's state.

    * `tick` is called every 20 ms and returns the setpoint.
    * `execute` handles the flavour's commands (not those of streams, parameters or transfers).
    * `offer` takes setpoint messages; invalid ones are dropped.
    * `switch` is the pilot's mode switch.
    """

    mission: MissionFlight

    @property
    def mode(self) -> str:
        """Name of the mode that is flown."""
        ...

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode."""
        ...

    @property
    def intended_mode(self) -> int:
        """CURRENT_MODE.intended_custom_mode."""
        ...

    @property
    def base_mode(self) -> int:
        """HEARTBEAT.base_mode."""
        ...

    @property
    def system_status(self) -> int:
        """HEARTBEAT.system_status."""
        ...

    @property
    def landed_state(self) -> int:
        """EXTENDED_SYS_STATE.landed_state."""
        ...

    @property
    def ready_to_arm(self) -> bool:
        """The PREARM bit of SYS_STATUS."""
        ...

    @property
    def available_modes(self) -> Sequence[Available]:
        """The modes of AVAILABLE_MODES."""
        ...

    def tick(self, now_s: float) -> Setpoint:
        """Return the present setpoint."""
        ...

    def execute(self, now_s: float, command: Command) -> Sequence[CommandAnswer]:
        """Execute or refuse a command."""
        ...

    def answered(self, command: Command, answers: Sequence[CommandAnswer], /) -> None:
        """Take note of the answers to a command, also to those that its link handles."""
        ...

    def set_mode(self, now_s: float, /, base_mode: int, custom_mode: int) -> None:
        """Take a SET_MODE message, which has no answer."""
        ...

    def offer(self, now_s: float, message: Any) -> None:  # noqa: ANN401 - pymavlink has no types
        """Take a setpoint."""
        ...

    def guide(self, now_s: float, /, item: PlanItem) -> bool:
        """Fly to a single mission item (current 2 or 3); returns whether it does. PX4 never does."""
        ...

    def switch(self, now_s: float, /, mode: str) -> None:
        """Take the pilot's mode."""
        ...


class FlightRecorder(Protocol):
    """Writes the flight logs of one boot.

    * `tick` is called every 20 ms.
    * `say` takes each text of the vehicle.
    """

    def tick(self, report: "Report") -> None:
        """Write what is due."""
        ...

    def say(self, report: "Report", severity: int, text: str) -> None:
        """Write a text."""
        ...

    def head(self, report: "Report") -> Sequence[bytes]:
        """Return the beginning of a log, message by message; empty if the flavour streams none."""
        ...


class AnyLink(Protocol):
    """What a vehicle asks of each link, of MAVLink or not.

    Attributes:
        to_forward: Received messages that the other links have not passed on yet.
    """

    to_forward: list[Message]

    def is_due(self, now_s: float, /) -> bool:
        """True if there is something to send."""
        ...

    def receive(self, now_s: float, data: bytes, /) -> list[bytes]:
        """Take what has come; return the frames that answer it."""
        ...

    def send(self, now_s: float, tick: int, /) -> list[bytes]:
        """Return the frames that are due by now."""
        ...

    def passed_on(self, messages: Sequence[Message], /) -> list[bytes]:
        """Return the frames of those messages from other links that are for somebody on this one."""
        ...

    def pack(self, replies: Sequence[Reply], /) -> list[bytes]:
        """Return the frames of some MAVLink messages; none on a link without MAVLink."""
        ...

    def say(self, now_s: float, texts: Sequence[Reply], /) -> list[bytes]:
        """Return the frames of texts."""
        ...

    def clients(self, now_s: float, /) -> list[tuple[int, int]]:
        """Return (system id, component id) of the senders of the last seconds."""
        ...

    def counts(self) -> dict[str, int]:
        """Return how much was taken and dropped."""
        ...


def no_files(_parameters: ParameterStore, _plans: PlanStore, storage: Storage) -> FileTree:
    """Return a file tree with nothing but what clients write."""
    return FileTree({}, storage=storage)


@dataclass(frozen=True)
class Flavour:
    """One kind of vehicle.

    Attributes:
        name: As on the command line.
        title: As in the documentation.
        autopilot: MAV_AUTOPILOT.
        vehicle_type: MAV_TYPE.
        modes: The table of modes.
        parameters: Their definitions.
        parameter_rules: Rules of the parameter protocol.
        stream_rules: Rules for changing stream rates.
        mission_rules: Rules of the mission protocol.
        log_rules: Rules of the log protocol.
        rates_hz: Default streams by kind of link (onboard, gcs, quiet).
        identity: AUTOPILOT_VERSION of a vehicle with a number.
        plant: The dynamics under present parameters.
        commander: Makes a vehicle's commander.
        recorder: Makes what writes a vehicle's logs.
        wander: Size of the estimator's error.
        sensors: Noise of its sensors.
        ground_wander: Size of the estimator's error on the ground; None where it rests.
        pack: Its battery.
        ready_s: From boot until it can be armed.
        texts: Whether links send STATUSTEXT; None: only links with a ground station's heartbeats.
        text_as_sent: A text as it is sent; None: as it is.
        event_of: The event for a severity and a text, in a flavour with events.
        own_id_only: Protocols that ignore messages to system 0.
        broadcast: Commands accepted when sent to system 0; None for all.
        ground_vehicle: It cannot start in the air.
        fix_type: GPS_FIX_TYPE of a receiver that works.
        files: The FTP files of a vehicle with these parameters, plans and files of clients.
        metadata: URI and checksum of the file that COMPONENT_METADATA names, for these parameters; None without one.
        version: As on the command line behind @.
        refused_commands: Commands that this version no longer has.
        more_commands: Commands that this version has beyond the one with recorded data.
        withheld: Messages of the mock that this version cannot send, also on request.
        streams_log: A client can have a log streamed.
        shell: Answers a line that is typed into the shell; None if it has no shell over MAVLink.
        takes_keys: A client can set the key of MAVLink signing (SETUP_SIGNING).
        topics: Makes the link that carries an `Autopilot`'s own topics (kind `links.TOPICS`); None if it has none.
        trusted_links: Ids of links that take unsigned and wrongly signed frames after a client has set a key.
    """

    name: str
    title: str
    autopilot: int
    vehicle_type: int
    modes: ModeTable
    parameters: Iterable[Parameter]
    parameter_rules: ParameterRules
    stream_rules: StreamRules
    mission_rules: MissionRules
    log_rules: LogRules
    rates_hz: Mapping[str, Mapping[str, float]]
    identity: Callable[[int], Identity]
    plant: Callable[[Mapping[str, float]], Vehicle]
    commander: Callable[[VehicleState, PlanStore], Commander]
    recorder: Callable[[LogBook], FlightRecorder]
    wander: Wander
    ready_s: float
    texts: bool | None
    own_id_only: frozenset[str] = frozenset()
    broadcast: frozenset[int] | None = None
    sensors: SensorNoise = EXACT
    pack: Pack = PX4_PACK
    ground_wander: Wander | None = None
    text_as_sent: Callable[[str], str] | None = None
    event_of: Callable[[int, str], tuple[int, int, bytes] | None] | None = None
    ground_vehicle: bool = False
    fix_type: int = 3
    files: Callable[[ParameterStore, PlanStore, Storage], FileTree] = no_files
    metadata: Callable[[ParameterStore], tuple[str, int]] | None = None
    version: str = ""
    refused_commands: frozenset[int] = frozenset()
    more_commands: frozenset[int] = frozenset()
    withheld: frozenset[str] = frozenset()
    streams_log: bool = False
    shell: Callable[["Report", str], str] | None = None
    takes_keys: bool = True
    trusted_links: frozenset[int] = frozenset()
    topics: Callable[[Any], AnyLink] | None = None

    @property
    def spec(self) -> str:
        """Name and version, as on the command line."""
        return f"{self.name}@{self.version}"


@dataclass(slots=True)
class Report:
    """One vehicle at one time; each vehicle has one and updates its times.

    Attributes:
        flavour: Constant data.
        state: Shared state.
        commander: The flavour's state.
        setpoint: The present setpoint.
        events: Events sent so far.
        boot_ms: Time since boot in wire format (32 bits).
        boot_us: The same in microseconds, not wrapped.
        epoch_us: Time of the autopilot's clock since 1970 at time 0.
        place: Estimated place on Earth.
        sequence: Counter of PING.
        reference: Returns the controller's reference motion, or None.
    """

    flavour: Flavour
    state: VehicleState
    commander: Commander
    setpoint: Setpoint
    events: EventLog
    epoch_us: int
    reference: Callable[[], Reference | None]
    boot_ms: int = 0
    boot_us: int = 0
    sequence: int = 0

    @property
    def standard_modes(self) -> dict[int, int]:
        """MAV_STANDARD_MODE by custom_mode."""
        return {mode.number: mode.standard for mode in self.flavour.modes.available()}

    @property
    def unix_us(self) -> int:
        """Time of the autopilot's clock since 1970, in microseconds."""
        return self.epoch_us + int(self.state.now_s * 1e6)

    @property
    def place(self) -> Home:
        """Estimated place on Earth."""
        return self.state.frame.to_geodetic(*self.state.position_m)

    @property
    def relative_m(self) -> float:
        """Estimated height above home."""
        home = self.state.home_m
        return (home[2] if home is not None else 0.0) - self.state.position_m[2]
