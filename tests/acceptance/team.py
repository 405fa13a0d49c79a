"""`python -m tests acceptance --team URL URL URL`: a team of three on running autopilots, each with its own daemon.

Every vehicle is flown by a `guidance run` of its own. The daemons talk over a Zenoh router with the shipped access
control and a certificate for each, and a person orders them by `guidance ctl --team`. Two rovers are simulated here and
report to every vehicle. The vehicles' homes must be at the places in `docs/acceptance.md`.
"""

import datetime
import math
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from itertools import combinations
from pathlib import Path
from typing import Any, Final, NamedTuple

import tomlkit

from guidance.autopilots import Mode
from guidance.clock import MonotonicClock
from guidance.config import config_folder
from guidance.frames import Amsl, Enu, LocalFrame
from guidance.links.wires.udp import UdpWire
from guidance.links.zenoh.access import read_credentials
from guidance.links.zenoh.keys import make_keys
from guidance.links.zenoh.session import open_router, open_session
from guidance.links.zenoh.team import ZenohTeam
from guidance.sim.scenario import EVADER_ID
from guidance.sim.scenario_file import load_any
from guidance.sim.stepped import EvaderHere
from guidance.sim.team_flight import pursuits_of_team
from guidance.sim.teams import TeamScenario
from guidance.team.messages import RefusedMessage, RolesMessage, StateMessage, read_message
from sitl_mock.child import free_udp_port
from tests.acceptance.flying import GUIDANCE, Line
from tests.acceptance.relay import LASTING, SET_UP, Relay, wait

NAMES: Final = ("uav1", "uav2", "uav3")
READY_WITHIN_S = 150.0
UP_WITHIN_S = 150.0
PLAYED_WITHIN_S = 40.0
DOWN_WITHIN_S = 200.0
MEDDLED_AFTER_S: Final = 1.5
GUARD: Final = load_any("teams_guard")[1]


class Case(NamedTuple):
    """One flight of the team: the second rover's start and speed, what happens 1.5 s after engaging, and to whom."""

    name: str
    rover2: tuple[float, float] = GUARD.evader[1].position_m
    rover2_m_s: float = 3.0
    meddling: str = ""
    promised: int = 2


CASES: Final = (
    Case("3v2 TAD won"),
    Case("3v2, one evader cannot be stopped", (4.0, -9.0), 5.0, promised=1),
    Case("coordinator killed", meddling="killed"),
    Case("a pilot takes one vehicle", meddling="pilot"),
    Case("HOLD ALL", meddling="hold"),
)


class FanOut:
    """A wire that sends to several wires and receives from all of them."""

    def __init__(self, wires: Sequence[UdpWire]) -> None:
        self._wires = wires

    def send(self, frame: bytes) -> None:
        """Send to all."""
        for wire in self._wires:
            wire.send(frame)

    def receive(self) -> list[tuple[float, bytes]]:
        """Return what arrived anywhere."""
        return [packet for wire in self._wires for packet in wire.receive()]

    def close(self) -> None:
        """Close all."""
        for wire in self._wires:
            wire.close()


class Field:
    """The rovers, and the team as its messages show it.

    Attributes:
        states: The last state of each vehicle, with its arrival.
        roles: All assignments with their arrivals.
        least_m: Least horizontal distance of two flying vehicles at less than the vertical separation.
        over: Evaders out of play, and when the first vehicle said so.
        captured: The captured ones, and by whom.
    """

    def __init__(
        self, scenario: TeamScenario, ports: dict[str, dict[str, int]], team: ZenohTeam
    ) -> None:
        self.states: dict[str, tuple[float, StateMessage]] = {}
        self.roles: list[tuple[float, RolesMessage]] = []
        self.least_m = math.inf
        self.over = dict[str, float]()
        self.captured = dict[str, str]()
        self._team = team
        clock = MonotonicClock()
        site = scenario.flight.site
        self._frame = LocalFrame(site.latitude_deg, site.longitude_deg, Amsl(site.altitude_amsl_m))
        chased = {
            pursuit.evader: pursuit.scenario for pursuit in reversed(pursuits_of_team(scenario))
        }
        self._radios = {
            name: FanOut([UdpWire(clock.now_s, "127.0.0.1", ports[name][to]) for to in NAMES])
            for name in chased
        }
        self._rovers = {
            name: EvaderHere(chased[name], clock, radio) for name, radio in self._radios.items()
        }
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.wait(0.02):
            self._hear()
            playing = any(state.part == "playing" for _, state in self.states.values())
            places = [self.place(state) for _, state in self.states.values()]
            for name, rover in self._rovers.items():
                rover.step(time.monotonic(), places, playing=playing and name not in self.over)

    def place(self, state: StateMessage) -> Enu:
        """Return a vehicle's place: x east, y north, z up."""
        north, east, down = self._frame.ned_from_wgs84(
            state.latitude_deg, state.longitude_deg, Amsl(state.altitude_amsl_m)
        )
        return Enu((east, north, -down))

    def _hear(self) -> None:
        for arrived_s, key, payload in self._team.receive():
            try:
                message = read_message(key.partition("/")[0], payload)
            except RefusedMessage:
                continue
            if isinstance(message, RolesMessage):
                self.roles.append((arrived_s, message))
            elif isinstance(message, StateMessage):
                self.states[message.vehicle] = arrived_s, message
                for name in message.over:
                    self.over.setdefault(name, arrived_s)
                if message.state == "on station" and message.evader is not None:
                    self.captured.setdefault(message.evader, message.vehicle)
                self._measure(arrived_s)

    def _measure(self, now_s: float) -> None:
        flying = [
            self.place(one)
            for at_s, one in self.states.values()
            if one.airborne and now_s - at_s < 0.15
        ]
        for one, other in combinations(flying, 2):
            if abs(one[2] - other[2]) < GUARD.flight.separation_height_m:
                self.least_m = min(self.least_m, math.dist(one[:2], other[:2]))

    def close(self) -> None:
        """End the rovers."""
        self._ended.set()
        self._thread.join()
        for radio in self._radios.values():
            radio.close()


def vehicle_file(
    name: str, relay: Relay, case: Case, ports: dict[str, dict[str, int]], port: int, folder: Path
) -> dict[str, Any]:
    """Return the vehicle file of one of the team."""
    first, second = ("rover2", "rover1") if name == "uav2" else ("rover1", "rover2")
    speeds = {"rover1": 3.0, "rover2": case.rover2_m_s}
    heard = {
        rover: {
            "kind": "global_position",
            "url": f"udpin://127.0.0.1:{ports[rover][name]}",
            "system_id": EVADER_ID,
        }
        for rover in (first, second)
    }
    site = GUARD.flight.site
    standoff = GUARD.flight.standoff
    return {
        "name": name,
        "vehicle": {
            "autopilot": relay.profile.name,
            "system_id": relay.found.system_id,
            "component_id": relay.found.component_id,
            **(
                {"url": relay.client_url}
                if relay.mode_url is None
                else {"link": "zenoh", "url": relay.mode_url, "parameters": relay.client_url}
            ),
        },
        "evader": heard[first],
        "game": {
            "kind": "tad",
            "speed_m_s": 6.0,
            "climb_m_s": 1.5,
            "descent_m_s": 1.0,
            "evader_speed_m_s": speeds[first],
            "standoff_radius_m": standoff.radius_m,
            "standoff_height_m": standoff.height_m,
            "tolerance_m": standoff.tolerance_m,
            "target": {"latitude_deg": site.latitude_deg, "longitude_deg": site.longitude_deg},
        },
        "limits": {"floor_m": 3.0, "ceiling_m": 120.0, "fence_radius_m": 300.0},
        "flight": {"takeoff_height_m": GUARD.flight.takeoff_height_m, "on_terminate": "return"},
        "control": {"endpoint": f"tls/127.0.0.1:{port}", "host": False},
        "zenoh": {
            "tls_ca_file": "keys/ca.pem",
            "tls_certificate_file": f"keys/{name}-guidance.pem",
            "tls_key_file": f"keys/{name}-guidance.key",
        },
        "log": {"format": "json"},
        "record": {"folder": str(folder / name)},
        "team": {
            "name": "north",
            "mates": [mate for mate in NAMES if mate != name],
            "evader": first,
            "evaders": {second: heard[second] | {"speed_m_s": speeds[second]}},
            "separation_m": GUARD.flight.separation_m,
            "separation_height_m": GUARD.flight.separation_height_m,
        },
    }


class Team:
    """Three daemons, the router between them, and a person who orders them."""

    def __init__(
        self, case: Case, relays: dict[str, Relay], folder: Path, closing_: ExitStack
    ) -> None:
        self.case = case
        self.relays = relays
        self._folder = folder
        now = datetime.datetime.now(datetime.UTC)
        parties = [*(f"{name}-guidance" for name in NAMES), "operator"]
        make_keys(folder / "keys", parties, ["127.0.0.1"], (now, now + datetime.timedelta(days=1)))
        port = free_udp_port({"uav1": "px4"})
        self._endpoint = f"tls/127.0.0.1:{port}"
        closing_.enter_context(
            open_router(config_folder() / "zenoh" / "team.json5", folder / "keys", self._endpoint)
        )
        ports = {
            rover: {name: free_udp_port({"uav1": "px4"}) for name in NAMES}
            for rover in ("rover1", "rover2")
        }
        for name in NAMES:
            document = vehicle_file(name, relays[name], case, ports, port, folder.absolute())
            (folder / f"{name}.toml").write_text(tomlkit.dumps(document), encoding="utf-8")
        credentials = read_credentials(folder / "keys" / "uav1-guidance.toml")
        session = closing_.enter_context(open_session(self._endpoint, credentials=credentials))
        told = closing_.enter_context(closing(_Listener(session)))
        document = GUARD.model_dump(mode="json")
        document["evader"][1] |= {"position_m": case.rover2, "speed_m_s": case.rover2_m_s}
        self.field = closing_.enter_context(closing(Field(TeamScenario(**document), ports, told)))
        self.daemons: dict[str, subprocess.Popen[bytes]] = {}
        for name in NAMES:
            self.run(name)
        closing_.callback(self._end)

    def run(self, name: str) -> None:
        """Start a daemon."""
        with (self._folder / f"{name}.log").open("ab") as log:
            command = [str(GUIDANCE), "run", str(self._folder / f"{name}.toml")]
            self.daemons[name] = subprocess.Popen(command, stdout=log, stderr=log)

    def _end(self) -> None:
        for daemon in self.daemons.values():
            daemon.send_signal(signal.SIGTERM)
        for daemon in self.daemons.values():
            try:
                daemon.wait(20.0)
            except subprocess.TimeoutExpired:
                daemon.kill()

    def order(self, word: str, *names: str) -> dict[str, dict[str, Any]]:
        """Give an order to the team, or to some of it; return the answers by name."""
        keys = self._folder / "keys" / "operator.toml"
        command = [
            GUIDANCE,
            "ctl",
            word,
            "--team",
            "north",
            "--endpoint",
            self._endpoint,
            "--zenoh",
            keys,
        ]
        command += ["--name", ",".join(names)] if names else []
        done = subprocess.run(
            [*map(str, command)], capture_output=True, text=True, timeout=30, check=False
        )
        found = [line.partition(": ") for line in done.stdout.splitlines()]
        with (self._folder / "orders.log").open("a", encoding="utf-8") as log:
            log.write(f"{time.monotonic():.2f} {word}: {done.stdout} {done.stderr}\n")
        return {
            name: {"accepted": f"{word} accepted" in said, "reason": said}
            for name, _, said in found
        }

    def accepted(self, word: str) -> bool:
        """Give an order; return whether all accepted it."""
        answers = self.order(word)
        return bool(answers) and all(answer["accepted"] for answer in answers.values())

    def state(self, name: str) -> str:
        """Return the state that a vehicle published last."""
        return self.field.states[name][1].state if name in self.field.states else ""


class _Listener(ZenohTeam):
    """Hears the team without being one of it: the test's session may not announce itself as a vehicle."""

    def __init__(self, session: Any) -> None:
        super().__init__(time.monotonic, session, "north", "nobody", ())


def fly(case: Case, relays: dict[str, Relay], folder: Path) -> Iterator[Line]:
    """Fly one case; yield its lines."""
    kinds = "+".join(relays[name].profile.name for name in NAMES)
    link = "pymavlink" if relays[NAMES[0]].mode_url is None else "zenoh"

    def line(wanted: str, got: object, held: bool) -> Line:
        return Line(kinds, case.name, link, wanted, str(got), held=held)

    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        team = Team(case, relays, folder, stack)
        field = team.field
        began_s = time.monotonic()
        if not _repeat(lambda: team.accepted("start"), READY_WITHIN_S):
            yield line(
                "all start",
                {name: one.get("reason") for name, one in team.order("start").items()},
                held=False,
            )
            return
        if not wait(lambda: all(team.state(name) == "standing by" for name in NAMES), UP_WITHIN_S):
            yield line("all stand by", [team.state(name) for name in NAMES], held=False)
            return
        time.sleep(1.0)
        offered = field.roles[-1][1].promises if field.roles else ()
        promised = {one.evader for one in offered if one.value is not None}
        yield line(
            f"{case.promised} promised before",
            ", ".join(sorted(promised)),
            len(promised) == case.promised,
        )
        engaged = _repeat(lambda: team.accepted("engage"), 10.0)
        yield line(
            "all engage",
            {name: team.state(name) for name in NAMES} if not engaged else "all",
            engaged,
        )
        if not engaged:
            return
        engaged_s = time.monotonic()
        able = list(NAMES)
        if case.meddling:
            time.sleep(MEDDLED_AFTER_S)
            yield from _MEDDLERS[case.meddling](team, line, able)
        if case.meddling != "hold":
            wait(lambda: set(field.captured) >= promised, PLAYED_WITHIN_S)
            ends = [
                f"{name} {f'captured by {field.captured[name]}' if name in field.captured else 'arrived'} "
                f"after {at_s - engaged_s:.1f} s"
                for name, at_s in sorted(field.over.items())
            ]
            kept = set(field.captured) >= promised
            yield line("promised captures kept", ", ".join(ends), kept)
            broken = [
                one
                for _, roles in field.roles
                for one in roles.promises
                if one.value is None and not one.cause
            ]
            yield line("no promise lost without a cause", len(broken), not broken)
        least = "never at one height" if math.isinf(field.least_m) else f"{field.least_m:.1f} m"
        wanted_m = GUARD.flight.separation_m
        yield line(f"{wanted_m:g} m apart, or in height", least, field.least_m > wanted_m - 1.0)
        time.sleep(2.0)
        team.order("return")
        down = [relay.bring_down(within_s=DOWN_WITHIN_S) for relay in relays.values()]
        yield line(
            "all down", f"{sum(down)} of 3, {time.monotonic() - began_s:.0f} s in all", all(down)
        )


def _killed(team: Team, line: Callable[..., Line], able: list[str]) -> Iterator[Line]:
    field = team.field
    leader = field.roles[-1][1].vehicle
    before = {
        promise.evader for promise in field.roles[-1][1].promises if promise.value is not None
    }
    team.daemons[leader].kill()
    killed_s = time.monotonic()
    able.remove(leader)
    wait(lambda: field.roles[-1][1].vehicle != leader, 3.0)
    taken_s, roles = next(
        ((at_s, one) for at_s, one in field.roles if one.vehicle != leader and at_s > killed_s),
        (math.inf, None),
    )
    yield line(
        "the next one coordinates within 2 s",
        f"{leader} killed, {'nobody' if roles is None else roles.vehicle} after {taken_s - killed_s:.2f} s",
        taken_s - killed_s < 2.0,
    )
    there = set() if roles is None else {promise.evader for promise in roles.promises}
    yield line("with the same promises", ", ".join(sorted(there)), there >= before)
    relay = team.relays[leader]
    wait(lambda: relay.mode() is not Mode.GUIDED, 6.0)
    yield line(
        "its vehicle is held by the autopilot", f"{relay.mode()}", relay.mode() is not Mode.GUIDED
    )


def _pilot(team: Team, line: Callable[..., Line], able: list[str]) -> Iterator[Line]:
    field = team.field
    taken = next(role.vehicle for role in field.roles[-1][1].roles)
    relay = team.relays[taken]
    taken_s = time.monotonic()
    able.remove(taken)
    relay.switch(Mode.HOLD)
    yielded = wait(lambda: team.state(taken) == "yielded", 3.0)
    yield line(
        "its guidance yields",
        f"{taken} is {team.state(taken)} after {time.monotonic() - taken_s:.1f} s",
        yielded,
    )
    rematched = wait(lambda: all(role.vehicle != taken for role in field.roles[-1][1].roles), 2.0)
    rest = {role.vehicle: role.evader for role in field.roles[-1][1].roles}
    yield line("the rest are matched again", rest, rematched)
    last_s = relay.seen.setpoints_s[-1] - taken_s
    yield line("no setpoint 1 s after the switch", f"last one {last_s:+.2f} s", last_s < 1.0)


def _hold(team: Team, line: Callable[..., Line], _able: list[str]) -> Iterator[Line]:
    asked_s = time.monotonic()
    answers = team.order("hold")
    held_s = time.monotonic() - asked_s
    words = f"{sum(answer['accepted'] for answer in answers.values())} of 3 in {held_s:.2f} s"
    yield line(
        "one reply for each, all accepted",
        words,
        len(answers) == 3 and all(answer["accepted"] for answer in answers.values()),
    )
    held = wait(lambda: all(relay.mode() is Mode.HOLD for relay in team.relays.values()), 4.0)
    yield line(
        "all in the autopilot's hold", f"{time.monotonic() - asked_s:.1f} s after the order", held
    )
    time.sleep(5.0)
    still = max(relay.seen.positions[-1][2] for relay in team.relays.values())
    yield line("they stay there", f"{still:.1f} m/s", still < 0.6)


_MEDDLERS: Final = {"killed": _killed, "pilot": _pilot, "hold": _hold}


def _repeat(done: Callable[[], bool], within_s: float) -> bool:
    """Try every two seconds; return whether it was done in time."""
    until_s = time.monotonic() + within_s
    while not done():
        if time.monotonic() > until_s:
            return False
        time.sleep(2.0)
    return True


@contextmanager
def relays_to(urls: Sequence[str], mode_urls: Sequence[str | None]) -> Iterator[dict[str, Relay]]:
    """Open a relay to each vehicle."""
    with ExitStack() as stack:
        yield {
            name: stack.enter_context(
                closing(Relay(url, free_udp_port({"uav1": "px4"}), mode_url=mode_url))
            )
            for name, url, mode_url in zip(NAMES, urls, mode_urls, strict=True)
        }


def fly_all(
    urls: Sequence[str],
    mode_urls: Sequence[str | None],
    folder: Path,
    tell: Callable[[Line], None],
    only: str,
) -> None:
    """Fly all cases one after another, on the same vehicles; as modes of PX4 where there are URLs of its Zenoh."""
    for number, case in enumerate(one for one in CASES if only in one.name):
        with relays_to(urls, mode_urls) as relays:
            for relay in relays.values():
                for parameter in SET_UP[relay.profile.name].items():
                    relay.set(*parameter)
                if relay.profile.name == "arducopter":
                    relay.set(*LASTING)
            for line in fly(case, relays, folder / f"{number + 1:02d}"):
                tell(line)
