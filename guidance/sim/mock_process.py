"""The mock autopilot as a child process: started, listened to until it is ready, told of faults, ended."""

import contextlib
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final

from guidance.errors import ConfigError, LinkError
from guidance.links.wires.zenoh import open_session
from guidance.sim.faulting import script_toml
from guidance.sim.fleet import EVADER, PURSUER, fleet_toml
from guidance.sim.scenario import Scenario
from sitl_mock.serving import udp_ports

ZENOH, UDP = "zenoh", "udp"
OVER: Final = (ZENOH, UDP)
"""What the vehicles can be reached over."""

START_LIMIT_S: Final = 15.0
STOP_LIMIT_S: Final = 2.0
_PORT_IN_USE: Final = 3
_ATTEMPTS: Final = 20


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
        fleet, faults = folder / "fleet.toml", folder / "faults.toml"
        fleet.write_text(fleet_toml(scenario), encoding="utf-8")
        faults.write_text(script_toml(scenario), encoding="utf-8")
        command = [sys.executable, "-m", "sitl_mock", "run", "--json", "--parent-pipe"]
        command += ["--fleet", str(fleet), "--faults", str(faults)]
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
        threading.Thread(target=_inject, args=(self.endpoint, list(faults)), daemon=True).start()

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
            for _ in session.get(f"{name}/faults", payload=json.dumps({"do": "inject", **keys})):
                pass  # they were checked before the start
    finally:
        session.close()  # type: ignore[no-untyped-call]
