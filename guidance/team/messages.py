"""The messages of a team and their transport.

A message is JSON: the state of a vehicle, a report of an evader, or the assignment.

The last part of a key is the vehicle that sends it, so a router can bind keys to certificates. A message names the
same vehicle. Whatever does not match is refused; the board counts it.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Annotated, Final, Literal, Protocol

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from guidance.config import Name
from guidance.frames import Amsl
from guidance.vehicle import FASTEST_M_S, HIGHEST_M

STATE = "state"
_EVADER = "evader"
ROLES = "roles"
"""First parts of the keys `state/VEHICLE`, `evader/EVADER/VEHICLE` and `roles/VEHICLE`."""

MOST_BYTES: Final = 8192
_MOST_QUOTES: Final = 1500
"""A message of the largest team has fewer. An error names every unknown key, and each has two."""

_MOST_CLOCK_S: Final = 1e10
_MOST: Final = 32
"""Most vehicles, and most evaders, of a team."""

Names = Annotated[tuple[Name, ...], Field(max_length=_MOST, strict=False)]
Count = Annotated[int, Field(ge=0, lt=2**53)]
_Speed = Annotated[float, Field(gt=0.0, lt=FASTEST_M_S)]
_Part = Annotated[float, Field(gt=-FASTEST_M_S, lt=FASTEST_M_S)]
Velocity = Annotated[tuple[_Part, _Part, _Part], Field(strict=False)]


class RefusedMessage(ValueError):  # noqa: N818 -- a verdict, counted and never shown as an error
    """A message that does not match its schema."""


class TeamMessage(BaseModel):
    """Common to all messages: `epoch` is drawn at the start of the sender, `seq` counts its messages of a kind."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    version: Literal[1] = Field(1, description="Of this schema")
    vehicle: Name = Field(description="The sender")
    epoch: Count = Field(description="Drawn at random when the sender starts")
    seq: Count = Field(description="Number of this message in its epoch")

    @property
    def key(self) -> str:
        """Its key without the prefix."""
        return f"{STATE}/{self.vehicle}"


class Placed(TeamMessage):
    """A message with a place."""

    latitude_deg: float = Field(gt=-90.0, lt=90.0, description="WGS-84 latitude, degrees")
    longitude_deg: float = Field(ge=-180.0, le=180.0, description="WGS-84 longitude, degrees")
    altitude_amsl_m: float = Field(
        gt=-HIGHEST_M, lt=HIGHEST_M, description="Above mean sea level, metres"
    )
    sent_s: float = Field(
        gt=-_MOST_CLOCK_S,
        lt=_MOST_CLOCK_S,
        description="When it was true, seconds of the sender's steady clock",
    )

    @property
    def place(self) -> tuple[float, float, Amsl]:
        """Latitude and longitude in degrees, and the altitude."""
        return self.latitude_deg, self.longitude_deg, Amsl(self.altitude_amsl_m)


class StateMessage(Placed):
    """The state of a vehicle, 10 times per second."""

    model_config = ConfigDict(title="guidance.TeamState")

    velocity_ned_m_s: Velocity = Field(description="North, east, down, m/s")
    state: str = Field(max_length=_MOST, description="State of its flight, for people")
    part: Literal["out", "ready", "playing"] = Field(
        description="Whether it can be engaged, or plays"
    )
    airborne: bool = Field(description="Whether mates must stay away from it")
    speed_m_s: _Speed = Field(description="Horizontal speed in the game")
    climb_m_s: _Speed = Field(description="Climb rate in the game")
    descent_m_s: _Speed = Field(description="Descent rate in the game")
    evader: Name | None = Field(None, description="The evader that it plays against")
    value: float | None = Field(
        None, ge=0.0, description="Value of its own game: s in PE, m in TAD; null without one"
    )
    term: Count = Field(0, description="The latest term that it has heard of")
    over: Names = Field(
        (), description="Evaders that it captured, or that arrived: they are out of play"
    )


class EvaderMessage(Placed):
    """A report of an evader as the sender received it, for mates that do not hear the evader."""

    model_config = ConfigDict(title="guidance.TeamEvader")

    evader: Name = Field(description="The evader")
    velocity_ned_m_s: Velocity | None = Field(
        None, description="North, east, down, m/s; null if unknown"
    )
    source: str = Field(max_length=120, description="Who reported it to the sender")

    @property
    def key(self) -> str:
        """Its key without the prefix."""
        return f"{_EVADER}/{self.evader}/{self.vehicle}"


class VehicleRole(BaseModel):
    """The evader of a vehicle, and how far above the game's disc it stays: vehicles at one evader are stacked."""

    model_config = TeamMessage.model_config

    vehicle: Name
    evader: Name
    above_m: float = Field(ge=0.0, le=500.0)


class Promise(BaseModel):
    """A capture that the team guarantees, and who guarantees it now.

    The value is seconds from the message on (PE) or metres (TAD). It is changed only with a cause.
    """

    model_config = TeamMessage.model_config

    evader: Name
    value: FiniteFloat | None = Field(description="null: promised earlier, and lost for the cause")
    first: Name | None
    second: Name | None
    cause: str = Field("", max_length=60, description="Why it is worse than it was promised first")

    @property
    def standing(self) -> str:
        """Its standing: kept, at risk (no vehicle guarantees it now, or it was lowered), or lost."""
        if self.value is None:
            return "lost"
        return "at risk" if self.first is None or self.cause else "kept"

    def words(self, unit: str) -> str:
        """Return the promise and its state: "24.1 m promised, at risk"; without a unit "24.1 promised"."""
        if self.value is None:
            return f"promise lost: {self.cause}"
        risk = "" if self.standing == "kept" else f", at risk{self.cause and f' ({self.cause})'}"
        return f"{self.value:.1f}{unit and f' {unit}'} promised{risk}"

    def verdict(self, value: float, achieved: float, unit: str, *, captured: bool) -> str:
        """Say in the end whether it was kept: by a capture with a loss of a tenth at most.

        Args:
            value: The promise at engagement.
            achieved: Distance of the captured evader from its target (TAD), or time of capture (PE).
            unit: "m" in TAD, "s" in PE.
            captured: Whether the evader was captured.
        """
        if self.value is None or not captured:
            return f"broken: {self.cause or 'no cause known'}"
        if unit == "s":
            word = "kept" if achieved <= 1.1 * value else "late"
        else:
            word = "kept" if achieved >= 0.9 * value else "broken"
        return f"{word}: {achieved:.1f} of {value:.1f} {unit}"


class RolesMessage(TeamMessage):
    """The assignment of a coordinator, twice per second and at events."""

    model_config = ConfigDict(title="guidance.TeamRoles")

    term: Count = Field(description="Number of the coordinator's election; a later one wins")
    roles: tuple[VehicleRole, ...] = Field(max_length=_MOST, strict=False)
    promises: tuple[Promise, ...] = Field(
        (), max_length=_MOST, strict=False, description="All that were ever given"
    )

    @property
    def key(self) -> str:
        """Its key without the prefix."""
        return f"{ROLES}/{self.vehicle}"

    @property
    def words(self) -> str:
        """The assignment for people; values are metres in TAD and seconds in PE."""
        roles = []
        for role in self.roles:
            above = f" ({role.above_m:g} m above)" if role.above_m else ""
            roles.append(f"{role.vehicle} → {role.evader}{above}")
        assigned = ", ".join(roles) or "no evader in play"
        promises = [f"{promise.evader}: {promise.words('')}" for promise in self.promises]
        coordinator = f"coordinator {self.vehicle}, term {self.term}"
        return "; ".join((assigned, *promises, coordinator))


MESSAGE_KINDS: Final[Mapping[str, type[TeamMessage]]] = {
    STATE: StateMessage,
    _EVADER: EvaderMessage,
    ROLES: RolesMessage,
}


def write_message(message: TeamMessage) -> bytes:
    """Return a message as JSON."""
    return message.model_dump_json().encode()


def read_message(kind: str, payload: bytes) -> TeamMessage:
    """Read a message.

    Args:
        kind: The first part of its key.
        payload: Untrusted bytes.

    Raises:
        RefusedMessage: With the reason in one word.
    """
    if kind not in MESSAGE_KINDS:
        raise RefusedMessage("kind")
    if len(payload) > MOST_BYTES:
        raise RefusedMessage("size")
    if payload.count(b'"') > _MOST_QUOTES:
        raise RefusedMessage("schema")
    try:
        return MESSAGE_KINDS[kind].model_validate_json(payload)
    except ValidationError as error:
        raise RefusedMessage("schema") from error


Arrived = tuple[float, str, bytes]
"""A message: its arrival on our clock, its key from the kind on (`state/alpha`), and its bytes."""

DELAY_S: Final = 0.02
"""Delay of the messages between the vehicles of a team in virtual time."""


class Transport(Protocol):
    """One vehicle's connection to its team. No method blocks or raises."""

    def publish(self, key: str, payload: bytes) -> None:
        """Send to all mates; messages may be lost."""

    def receive(self) -> Sequence[Arrived]:
        """Return the other senders' messages since the last call, oldest first. The queue is bounded."""

    def present(self) -> Collection[str] | None:
        """Return the names of the vehicles with a liveliness token; None if it has no tokens."""

    def close(self) -> None:
        """Leave the team. May be called twice."""


class MemoryTransport:
    """`Transport` between the vehicles of one process, in virtual time; each message takes `DELAY_S`.

    Args:
        name: The vehicle's.
        ends: The transports of all vehicles, by name; this one is added.
        clock: Returns the time, s.
    """

    def __init__(
        self, name: str, ends: dict[str, "MemoryTransport"], clock: Callable[[], float]
    ) -> None:
        self.name = name
        self._ends = ends
        self._clock = clock
        self.waiting: list[Arrived] = []
        ends[name] = self

    def publish(self, key: str, payload: bytes) -> None:
        """Send to all mates."""
        for end in self._ends.values():
            if end is not self:
                end.waiting.append((self._clock() + DELAY_S, key, payload))

    def receive(self) -> Sequence[Arrived]:
        """Return the messages that have arrived by now."""
        now_s = self._clock()
        arrived = sorted(message for message in self.waiting if message[0] <= now_s)
        self.waiting = [message for message in self.waiting if message[0] > now_s]
        return arrived

    def present(self) -> None:
        """Return None: it has no tokens."""

    def close(self) -> None:
        """Leave the team."""
        self._ends.pop(self.name, None)
