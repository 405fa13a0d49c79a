"""The real-time world: the mock autopilot as a child process, on a Zenoh session pinned to loopback."""

import contextlib
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final

from guidance.errors import ConfigError, LinkError
from guidance.links.mavsdk_link import MavsdkLink
from guidance.links.opening import wait_until_heard
from guidance.links.port import TargetSource, VehicleLink
from guidance.links.pymavlink_link import PymavlinkLink
from guidance.links.tap import Passed, TappedWire
from guidance.links.targets.global_position import GlobalPositionInt
from guidance.links.targets.mavlink_source import MavlinkTarget
from guidance.links.zenoh_session import open_session
from guidance.links.zenoh_wire import ZenohWire
from guidance.scenarios.faulting import check_faults, faults_after, script_toml
from guidance.scenarios.fleet import EVADER, EVADER_ID, PURSUER, PURSUER_ID, fleet_toml
from guidance.scenarios.model import Scenario
from guidance.service.clock import Clock

START_LIMIT_S: Final = 15.0
STOP_LIMIT_S: Final = 2.0
_PORT_IN_USE: Final = 3


class LiveWorld:
    """Both vehicles in a child process, reached over Zenoh.

    Raises:
        ConfigError: If the mock refuses its configuration.
        LinkError: If the mock cannot start (the port is in use, say), or cannot be heard.
    """

    def __init__(self, scenario: Scenario, clock: Clock, *, link: str, port: int) -> None:
        self._clock = clock
        self._scenario = scenario
        self._taps: list[TappedWire] = []
        self._closing = contextlib.ExitStack()
        try:
            folder = Path(self._closing.enter_context(tempfile.TemporaryDirectory(prefix="guidance-")))
            check_faults(scenario)
            self._mock = _MockProcess(folder, scenario, port)
            self._closing.callback(self._mock.stop)
            self.pursuer = self._link(link, PURSUER, PURSUER_ID)
            self.evader = self._link("pymavlink", EVADER, EVADER_ID)
            self.target: TargetSource = MavlinkTarget(self._wire(EVADER), GlobalPositionInt(), system_id=EVADER_ID)
            self._closing.callback(self.target.close)
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
        """Put the faults in place that count from engagement, on a thread of its own: the loop waits for nobody."""
        if faults := list(faults_after(self._scenario, "engaged")):
            threading.Thread(target=_inject, args=(self._mock.endpoint, faults), daemon=True).start()

    def drain(self) -> Sequence[Passed]:
        """All frames that passed since the last call, of one vehicle after the other."""
        return [passed for tap in self._taps for passed in tap.drain()]

    def close(self) -> None:
        """Close the links, then end the child."""
        self._closing.close()

    def _wire(self, name: str) -> ZenohWire:
        return ZenohWire(self._clock.now_s, namespace=name, endpoint=self._mock.endpoint)

    def _link(self, kind: str, name: str, system_id: int) -> VehicleLink:
        now_s = self._clock.now_s
        wire = TappedWire(self._wire(name), now_s, name)
        self._taps.append(wire)
        link: VehicleLink
        if kind == "mavsdk":
            link = MavsdkLink(wire, now_s, system_id=system_id, sleep=time.sleep, who=f"the mock's {name}")
        else:
            heard = PymavlinkLink(wire, now_s, system_id=system_id)
            wait_until_heard(heard, clock=now_s, timeout_s=5.0, sleep=time.sleep, who=f"the mock's {name}")
            link = heard
        self._closing.callback(link.close)
        return link


def _inject(endpoint: str, faults: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
    session = open_session(endpoint)
    try:
        for name, keys in faults:
            for _ in session.get(f"{name}/faults", payload=json.dumps({"do": "inject", **keys})):
                pass  # they were checked before the start
    finally:
        session.close()  # type: ignore[no-untyped-call]


class _MockProcess:
    """The child: started, listened to until it is ready, ended."""

    def __init__(self, folder: Path, scenario: Scenario, port: int) -> None:
        fleet, faults = folder / "fleet.toml", folder / "faults.toml"
        fleet.write_text(fleet_toml(scenario), encoding="utf-8")
        faults.write_text(script_toml(scenario), encoding="utf-8")
        command = [sys.executable, "-m", "sitl_mock", "run", "--json", "--parent-pipe"]
        command += ["--fleet", str(fleet), "--faults", str(faults)]
        self._log = (folder / "mock.log").open("w+b")
        self._port = port
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
                return str(ready["vehicles"][0]["endpoints"][0]).split()[0]
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
