"""`guidance check`: preflight alone, and setting the parameters that it requires, on the ground only."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

from guidance import messages
from guidance.autopilots import Finding, Verdict
from guidance.clock import Clock, MonotonicClock
from guidance.errors import FlightError
from guidance.links.world import World
from guidance.preflight import COUNTED_S, ParameterChange, another_autopilot, changes, single
from guidance.session.daemon import Daemon
from guidance.session.loop import PERIOD_S
from guidance.session.plan import FlightPlan, plan_of
from guidance.session.service import open_all
from guidance.session.vehicle_file import Config

SURVEY_LIMIT_S: Final = 20.0
SET_WITHIN_S: Final = 5.0
"""Time limit for an autopilot to confirm a parameter; PX4 takes 20 ms."""

_FRESH_S: Final = 2.5
_HEARD: Final = {
    messages.Home: "HOME_POSITION",
    messages.Origin: "GPS_GLOBAL_ORIGIN",
    messages.GlobalPosition: "GLOBAL_POSITION_INT",
    messages.LocalPosition: "LOCAL_POSITION_NED",
}
"""Messages needed before anything is judged, by their MAVLink names."""


class Applied(NamedTuple):
    """A parameter that was set: the value read back (None without an answer), and whether it is the requested one."""

    name: str
    read_back: float | None
    done: bool


class Checkup:
    """Reads, judges and sets the parameters of one vehicle on the ground. It neither arms nor changes the mode."""

    def __init__(self, name: str, plan: FlightPlan, world: World, clock: Clock) -> None:
        self._plan, self._link, self._clock, self._due_s = plan, world.links[name], clock, clock.now_s()
        self._daemon = Daemon(name, plan, self._link, world.evaders[name])

    def rows(self, limit_s: float = SURVEY_LIMIT_S, told: Callable[[str], None] = lambda _: None) -> Sequence[Finding]:
        """Wait for all inputs, and return preflight's rows and the flight's own checks.

        Args:
            limit_s: For so long at most; a vehicle that is not the configured autopilot is refused at once.
            told: Called with the names of missing inputs.
        """
        daemon, clock, flight = self._daemon, self._clock, self._plan.flight
        begun_s = complete_s = clock.now_s()
        while clock.now_s() - begun_s < limit_s:
            self._step()
            facts = daemon.survey.facts(daemon.flight.vehicle, clock.now_s())
            if (other := another_autopilot(facts, flight.autopilot)) is not None:
                return (other,)
            vehicle, (read, wanted) = daemon.flight.vehicle, daemon.survey.read
            missing = [name for kind, name in _HEARD.items() if vehicle.latest.get(kind) is None]
            missing += [f"{wanted - read} of {wanted} parameters"] if read < wanted else []
            told(lacking := ", ".join(missing))
            if lacking:
                complete_s = clock.now_s()
            elif clock.now_s() - complete_s > COUNTED_S + 1.0:
                break
        # The flight's own checks may still pass later, so none is a refusal here.
        readiness = (
            Finding.of(verdict is Verdict.PASS, f"ready: {name}", found, "before start", "", Verdict.WARN)
            for name, found, _, verdict, _ in daemon.flight.checks(clock.now_s())
        )
        return (*daemon.rows, *readiness)

    def changes(self, *, advised: bool) -> Sequence[ParameterChange]:
        """Return the parameters to set, from the values read."""
        wants, facts = self._plan.wants, self._daemon.survey.facts(self._daemon.flight.vehicle, self._clock.now_s())
        return () if wants is None else changes(facts, self._plan.flight.autopilot, wants, advised=advised)

    def apply(self, wanted: Sequence[ParameterChange]) -> Iterator[Applied]:
        """Set parameters one after another, read each back, and yield what came of it.

        Raises:
            FlightError: If the vehicle is armed, in the air, or does not say that it is neither; what was set by then
                stays set.
        """
        for change in wanted:
            vehicle, now_s = self._daemon.flight.vehicle, self._clock.now_s()
            if vehicle.armed:
                raise FlightError("the vehicle is armed: parameters are set on the ground only, disarmed")
            if vehicle.age_s(messages.Heartbeat, now_s) > _FRESH_S or vehicle.latest.get(messages.LandedState) is None:
                raise FlightError("the vehicle does not say whether it is on the ground: no parameter is set")
            if not vehicle.on_ground:
                raise FlightError("the vehicle is in the air: parameters are set on the ground only")
            self._link.request(change.request)
            self._read(change.name)  # the announcement after setting is not proof: read the value
            self._link.request(messages.ParameterRequest(change.name))
            value = self._read(change.name)
            yield Applied(change.name, value, value is not None and single(value) == change.request.value)

    def _read(self, name: str) -> float | None:
        until_s = self._clock.now_s() + SET_WITHIN_S
        while self._clock.now_s() < until_s:
            self._step()
            for message in self._daemon.inputs.messages:
                if isinstance(message, messages.Parameter) and message.name == name:
                    return message.value
        return None

    def _step(self) -> None:
        self._clock.sleep_until(self._due_s)
        now_s = self._clock.now_s()
        self._due_s = max(self._due_s + PERIOD_S, now_s)
        self._daemon.step(now_s)


@contextlib.contextmanager
def checkup_of(config: Config) -> Iterator[Checkup]:
    """Open the vehicle of a configuration.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    plan, clock = plan_of(config), MonotonicClock()
    with contextlib.closing(open_all(config, clock, tapped=False)) as world:
        yield Checkup(config.name, plan, world, clock)
