"""The real-time world: the mock autopilot as a child process, over Zenoh or UDP on loopback."""

import contextlib
import json
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final

import tomli_w

from guidance.clock import Clock
from guidance.errors import ConfigError, LinkError
from guidance.links.evaders.mavlink import GlobalPositionInt, MavlinkEvader
from guidance.links.opening import link_over, open_wire
from guidance.links.port import EvaderSource, VehicleLink, Wire
from guidance.links.wires.shared import Passed, TappedWire, share
from guidance.links.wires.zenoh import ZenohWire, open_session
from guidance.sim.evader import EvaderPilot
from guidance.sim.mock_files import check_faults, faults_after, fleet, script
from guidance.sim.players import evader_settings
from guidance.sim.scenario import EVADER, EVADER_ID, PURSUER, PURSUER_ID, Scenario
from sitl_mock.serving import udp_ports

ZENOH, UDP = "zenoh", "udp"
OVER: Final = (ZENOH, UDP)
"""What the vehicles can be reached over."""

START_LIMIT_S: Final = 15.0
_ANSWER_LIMIT_S: Final = 2.0
STOP_LIMIT_S: Final = 2.0
_PORT_IN_USE: Final = 3
_ATTEMPTS: Final = 20


class LiveWorld:
    """Both vehicles in a child process, reached over Zenoh or UDP.

    Raises:
        ConfigError: If the mock refuses its configuration.
        LinkError: If the mock cannot start (the port is in use, say), or cannot be heard.
    """

    real_time: Final = True

    def __init__(self, scenario: Scenario, clock: Clock, *, link: str, port: int, over: str = ZENOH) -> None:
        self._clock = clock
        self._scenario = scenario
        self._taps: list[TappedWire] = []
        self._closing = contextlib.ExitStack()
        try:
            folder = Path(self._closing.enter_context(tempfile.TemporaryDirectory(prefix="guidance-")))
            check_faults(scenario)
            self._mock = MockProcess(folder, scenario, over, port)
            self._closing.callback(self._mock.stop)
            commands, reports = self._wires(EVADER)
            self.link = self._open_link(link, self._wire(PURSUER), PURSUER, PURSUER_ID)
            rover = self._open_link("pymavlink", commands, EVADER, EVADER_ID)
            self.player = EvaderPilot(rover, evader_settings(scenario))
            self.evader_source: EvaderSource = MavlinkEvader(reports, GlobalPositionInt(), system_id=EVADER_ID)
            self._closing.callback(self.evader_source.close)
        except BaseException:
            self.close()
            raise

    def advance(self) -> None:
        """See that the mock lives: time moves by itself.

        Raises:
            LinkError: If it has ended.
        """
        self._mock.check()

    def engage(self) -> None:
        """Put the faults in place that count from engagement."""
        if faults := list(faults_after(self._scenario, "engaged")):
            self._mock.inject(faults)

    def drain(self) -> Sequence[Passed]:
        """All frames that passed since the last call, of one vehicle after the other."""
        return [passed for tap in self._taps for passed in tap.drain()]

    def close(self) -> None:
        """Close the links, then end the child."""
        self._closing.close()

    def _wire(self, name: str) -> Wire:
        if name in self._mock.udp:
            return open_wire(f"udpin://127.0.0.1:{self._mock.udp[name]}", clock=self._clock.now_s)
        return ZenohWire(self._clock.now_s, namespace=name, endpoint=self._mock.endpoint)

    def _wires(self, name: str) -> tuple[Wire, Wire]:
        """Two for one vehicle; a UDP port can be had once only."""
        if name in self._mock.udp:
            one, other = share(self._wire(name), 2)
            return one, other
        return self._wire(name), self._wire(name)

    def _open_link(self, kind: str, bare: Wire, name: str, system_id: int) -> VehicleLink:
        now_s = self._clock.now_s
        wire = TappedWire(bare, now_s, name)
        self._taps.append(wire)
        link = link_over(wire, kind, system_id=system_id, clock=now_s, who=f"the mock's {name}", timeout_s=5.0)
        self._closing.callback(link.close)
        return link


class MockProcess:
    """The child. Its Zenoh session is there over UDP too: faults are injected by it.

    Args:
        folder: For its files.
        scenario: What it flies.
        over: One of `OVER`.
        port: Of the Zenoh session, or the first of the UDP ports; 0 picks what is free.

    Raises:
        ConfigError: If the mock refuses its configuration.
        LinkError: If it does not come up.
    """

    def __init__(self, folder: Path, scenario: Scenario, over: str, port: int) -> None:
        for name, document in (("fleet", fleet(scenario)), ("faults", script(scenario))):
            (folder / f"{name}.toml").write_text(tomli_w.dumps(document), encoding="utf-8")
        command = [sys.executable, "-m", "sitl_mock", "run", "--json", "--parent-pipe"]
        command += ["--fleet", str(folder / "fleet.toml"), "--faults", str(folder / "faults.toml")]
        self._log = (folder / "mock.log").open("w+b")
        flavours = {PURSUER: scenario.pursuer.autopilot, EVADER: "rover"}
        self.udp: Mapping[str, int] = {}
        if over == UDP:
            first = port or free_udp_port(flavours)
            self.udp = {name: told for name, (_, told) in udp_ports(first, flavours).items()}
            command += ["--udp", str(first)]
            port = 0
        self._child = subprocess.Popen(
            [*command, "--zenoh", f"tcp/127.0.0.1:{port}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            start_new_session=True,  # Ctrl-C is for us: the child is ended by closing its standard input
        )
        self._lines: SimpleQueue[bytes] = SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()
        try:
            self.endpoint = self._wait_until_ready()
        except BaseException:
            self.stop()
            raise

    def check(self) -> None:
        """Raise LinkError if the child has ended."""
        code = self._child.poll()
        if code is not None:
            raise LinkError(
                f"the mock autopilot ended in flight (exit code {code}): {self._last_words()}; "
                "the record holds everything until then"
            )

    def inject(self, faults: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
        """Put faults in place, on a thread of its own: the loop waits for nobody."""
        threading.Thread(target=_inject, args=(self.endpoint, list(faults))).start()

    def stop(self) -> None:
        """End the child: politely, then not."""
        if self._child.stdin is not None:
            with contextlib.suppress(OSError):
                self._child.stdin.close()
        try:
            self._child.wait(STOP_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        if self._child.stdout is not None:
            self._child.stdout.close()
        self._log.close()

    def _read(self) -> None:
        stdout = self._child.stdout
        if stdout is not None:
            with contextlib.suppress(ValueError, OSError):  # closed under the reader at the end
                for line in stdout:
                    self._lines.put(line)

    def _wait_until_ready(self) -> str:
        deadline_s = time.monotonic() + START_LIMIT_S
        while time.monotonic() < deadline_s:
            with contextlib.suppress(Empty):
                ready = json.loads(self._lines.get(timeout=0.05))
                places = [str(place) for place in ready["vehicles"][0]["endpoints"]]
                return next(place.split()[0] for place in places if "mavlink_raw" in place)
            code = self._child.poll()
            if code is not None:
                raise self._refusal(code)
        raise LinkError(f"the mock autopilot was not ready within {START_LIMIT_S:g} s: {self._last_words()}")

    def _refusal(self, code: int) -> ConfigError | LinkError:
        words = self._last_words()
        if code == _PORT_IN_USE:
            return LinkError(f"{words}; choose another with --port, or --port 0 for a free one")
        return ConfigError(f"the mock autopilot did not start (exit code {code}): {words}")

    def _last_words(self) -> str:
        self._log.flush()
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("error: ") if lines else "it said nothing"


def free_udp_port(flavours: Mapping[str, str]) -> int:
    """Return a first port with which every vehicle's ports, its own and its client's, are free now.

    Raises:
        LinkError: If none is found.
    """
    for _ in range(_ATTEMPTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            first = min(int(probe.getsockname()[1]), 60_000)
        ports = {port for pair in udp_ports(first, flavours).values() for port in pair if port}
        if all(_is_free(port) for port in ports):
            return first
    raise LinkError("no free UDP ports on 127.0.0.1; choose the first with --port")


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def _inject(endpoint: str, faults: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
    session = open_session(endpoint)
    try:
        for name, keys in faults:
            for _ in session.get(
                f"{name}/faults", payload=json.dumps({"do": "inject", **keys}), timeout=_ANSWER_LIMIT_S
            ):
                pass  # they were checked before the start
    finally:
        session.close()  # type: ignore[no-untyped-call]
