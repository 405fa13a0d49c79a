"""A ground station beside guidance on an autopilot's links: what it hears, and what its orders do.

`python -m tests.acceptance.ground_station AUTOPILOT --vehicle URL --station URL` flies it on a running autopilot that
forwards between its links: IT IS ARMED AND FLOWN. The acceptance step flies it on mocks, whose relay forwards.
"""

import argparse
import math
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import contextmanager
from pathlib import Path

import tomlkit
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.info import Info
from pymavlink.dialects.v20 import common as mavlink

from guidance.links.frames import Frame, FrameReader
from guidance.links.ground_link import COMPONENT_ID, address_of
from guidance.links.opening import open_wire
from guidance.links.port import Wire
from guidance.session.observe.ground_station import ACCEPTED, DENIED, ORDERS
from sitl_mock.child import free_udp_port
from tests.acceptance.flying import GUIDANCE, Line
from tests.acceptance.relay import wait

FLIGHT = "a ground station"
HEIGHT_M = 8.0
AWAY_M = 40.0
READY_WITHIN_S = 120.0
FLOWN_WITHIN_S = 60.0
QGC = (255, 190)
HOLD, _, LAND, START, _ = ORDERS
_METRES_PER_DEGREE = 111_320.0
_ASK_FOR_POSITIONS = mavlink.MAVLink_command_long_message(
    1, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, 33, 250_000, 0, 0, 0, 0, 0
)
_CHANGES = ("ready", "standing by", "engaged", "held by operator", "lands by operator")


class Station:
    """A ground station on a link, with a thread: it sends HEARTBEATs and keeps what it hears of guidance."""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self._mavlink = mavlink.MAVLink(None, *QGC)
        self._reader = FrameReader()
        self._over = threading.Event()
        self.beats_s: list[float] = []
        self.texts: list[str] = []
        self.shown: list[mavlink.MAVLink_adsb_vehicle_message] = []
        self.answers: list[tuple[int, int]] = []
        self.autopilots: Counter[tuple[int, int]] = Counter()
        self.place: tuple[float, float, float] | None = None
        self.armed = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        beat_s = -math.inf
        while not self._over.wait(0.01):
            if time.monotonic() - beat_s >= 1.0:
                beat_s = time.monotonic()
                self.say(mavlink.MAVLink_heartbeat_message(6, 8, 192, 0, 4, 3))
                if self.place is None:
                    self.say(_ASK_FOR_POSITIONS)
            for at_s, data in self._wire.receive():
                for frame in self._reader.read(data, stream=self._wire.stream):
                    self._hear(at_s, frame)

    def _hear(self, at_s: float, frame: Frame) -> None:
        name = frame.name
        fields = frame.fields
        if frame.component_id == COMPONENT_ID:
            if name == "HEARTBEAT":
                self.beats_s.append(at_s)
            elif name == "STATUSTEXT":
                self.texts.append(fields.text)
            elif name == "COMMAND_ACK":
                self.answers.append((fields.command, fields.result))
        elif name == "HEARTBEAT" and fields.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
            self.autopilots[frame.system_id, frame.component_id] += 1
            self.armed = bool(fields.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        elif name == "GLOBAL_POSITION_INT" and frame.system_id == 1:
            self.place = (fields.lat / 1e7, fields.lon / 1e7, fields.alt / 1e3)
        if name == "ADSB_VEHICLE" and fields.ICAO_address == address_of(""):
            self.shown.append(fields)

    def say(self, message: mavlink.MAVLink_message) -> None:
        """Send a message."""
        self._wire.send(bytes(message.pack(self._mavlink)))
        self._mavlink.seq = (self._mavlink.seq + 1) % 256

    def order(self, command: int, *, within_s: float = 5.0) -> int | None:
        """Send a command to guidance as QGroundControl does; return the result, None without an answer."""
        before = len(self.answers)
        self.say(
            mavlink.MAVLink_command_long_message(1, COMPONENT_ID, command, 0, 0, 0, 0, 0, 0, 0, 0)
        )
        wait(lambda: len(self.answers) > before, within_s)
        return next((result for sent, result in self.answers[before:] if sent == command), None)

    def hears(self, words: str, within_s: float) -> bool:
        """Wait for a text that begins with these words behind `guidance: `."""
        return wait(
            lambda: any(text.startswith(f"guidance: {words}") for text in self.texts), within_s
        )

    def close(self) -> None:
        """Leave the link; may be called twice."""
        self._over.set()
        self._thread.join()
        self._wire.close()


class Evader:
    """A rover of system 2 that stands still; its reports go to a port on loopback."""

    def __init__(self, port: int, place: tuple[float, float, float]) -> None:
        self._wire = open_wire(f"udpout://127.0.0.1:{port}", clock=time.monotonic)
        self._place = place
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        sender = mavlink.MAVLink(None, 2, 1)
        began_s = time.monotonic()
        latitude_deg, longitude_deg, altitude_m = self._place
        while not self._over.wait(0.05):
            message = mavlink.MAVLink_global_position_int_message(
                round((time.monotonic() - began_s) * 1e3),
                round(latitude_deg * 1e7),
                round(longitude_deg * 1e7),
                round(altitude_m * 1e3),
                0, 0, 0, 0, 0xFFFF,
            )  # fmt: skip
            self._wire.send(bytes(message.pack(sender)))
            sender.seq = (sender.seq + 1) % 256

    def close(self) -> None:
        """End."""
        self._over.set()
        self._thread.join()
        self._wire.close()


@contextmanager
def guided(autopilot: str, url: str, evader_port: int, folder: Path):
    """Run `guidance run` for a vehicle; yield a function that gives orders with `guidance ctl`."""
    folder.mkdir(parents=True, exist_ok=True)
    document = {
        "name": "uav1",
        "vehicle": {"autopilot": autopilot, "url": url, "link": "mavsdk", "announce": True},
        "evader": {
            "kind": "global_position",
            "url": f"udpin://127.0.0.1:{evader_port}",
            "system_id": 2,
        },
        "game": {
            "speed_set": "cylinder",
            "speed_m_s": 4.0,
            "climb_m_s": 1.0,
            "descent_m_s": 1.0,
            "evader_speed_m_s": 2.0,
            "standoff_radius_m": 5.0,
            "standoff_height_m": 5.0,
        },
        "limits": {"floor_m": 3.0, "ceiling_m": 60.0, "fence_radius_m": 100.0},
        "flight": {"takeoff_height_m": HEIGHT_M, "on_terminate": "land"},
        "control": {"endpoint": f"tcp/127.0.0.1:{free_udp_port({'uav1': 'px4'})}"},
        "ground_station": {"orders_from": [QGC[0]]},
    }
    path = folder / "vehicle.toml"
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder), "PYTHONUNBUFFERED": "1"}

    def guidance(*words: object) -> bool:
        done = subprocess.run(
            [str(GUIDANCE), *map(str, words)],
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        with (folder / "orders.log").open("a", encoding="utf-8") as log:
            log.write(f"{words}: {done.returncode}\n{done.stdout}{done.stderr}\n")
        return done.returncode == 0

    wait(lambda: guidance("check", path, "--apply", "--yes"), READY_WITHIN_S)
    with (folder / "guidance.log").open("wb") as log:
        process = subprocess.Popen(
            [str(GUIDANCE), "run", str(path)], env=environment, stdout=log, stderr=log
        )
        try:
            endpoint = document["control"]["endpoint"]
            yield lambda word: guidance("ctl", word, "--endpoint", endpoint, "--name", "uav1")
        finally:
            process.terminate()
            try:
                process.wait(30.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def fly(autopilot: str, vehicle_url: str, station_url: str, folder: Path) -> list[Line]:
    """Fly once with a ground station beside; return the lines of the table."""
    lines = []

    def line(wanted: str, got: object, *, held: bool) -> None:
        lines.append(Line(autopilot, FLIGHT, "mavsdk", wanted, str(got), held))

    station = Station(open_wire(station_url, clock=time.monotonic))
    evader_port = free_udp_port({"evader": "px4"})
    evader = None
    try:
        if not wait(lambda: station.place is not None, READY_WITHIN_S):
            line("a position", "none", held=False)
            return lines
        latitude_deg, longitude_deg, altitude_m = station.place
        north = (latitude_deg + AWAY_M / _METRES_PER_DEGREE, longitude_deg, altitude_m)
        evader = Evader(evader_port, north)
        with guided(autopilot, vehicle_url, evader_port, folder) as ctl:
            ready = station.hears("ready", READY_WITHIN_S)
            line("it hears that guidance is ready", station.texts[-1:], held=ready)
            result = station.order(START)
            line("START without signing: denied", result, held=result == DENIED)
            ctl("start")
            station.hears("standing by", FLOWN_WITHIN_S)
            ctl("engage")
            station.hears("engaged", 10.0)
            result = station.order(HOLD)
            line("HOLD accepted", result, held=result == ACCEPTED)
            station.hears("held by operator", 5.0)
            result = station.order(LAND)
            line("LAND accepted", result, held=result == ACCEPTED)
            down = wait(lambda: not station.armed, FLOWN_WITHIN_S)
            line("landed and disarmed", "disarmed" if down else "armed", held=down)
            _judge(station, north, line)
            station.close()
            _judge_by_mavsdk(station_url, line)
    finally:
        station.close()
        if evader is not None:
            evader.close()
    return lines


def _judge(station: Station, evader_deg: tuple[float, float, float], line) -> None:
    """Judge what the ground station has heard until now."""
    counted = {
        change: sum(text.startswith(f"guidance: {change}") for text in station.texts)
        for change in _CHANGES
    }
    line("each change of the state once", counted, held=set(counted.values()) == {1})
    rate_hz = (len(station.beats_s) - 1) / max(station.beats_s[-1] - station.beats_s[0], 1e-9)
    line("HEARTBEATs at 1 Hz", f"{rate_hz:.2f} Hz", held=0.9 <= rate_hz <= 1.1)
    line("one autopilot", dict(station.autopilots), held=len(station.autopilots) == 1)
    off_m = math.inf
    if station.shown:
        shown = station.shown[-1]
        off_m = _METRES_PER_DEGREE * max(
            abs(shown.lat / 1e7 - evader_deg[0]), abs(shown.lon / 1e7 - evader_deg[1])
        )
    line("the evader on the map within 2 m", f"{off_m:.1f} m", held=off_m <= 2.0)


def _judge_by_mavsdk(url: str, line) -> None:
    """MAVSDK in the ground station's place finds the autopilot beside guidance."""
    with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as client:
        client.add_any_connection(url)
        system = client.first_autopilot(20.0)
        info = Info(system)
        versions = []

        def told() -> bool:
            try:
                versions.append(info.get_version().flight_sw_major)
            except Exception:  # not known yet
                return False
            return True

        held = wait(told, 10.0)
        words = f"component {sorted(system.component_ids())}, version {versions[-1:]}"
        line("MAVSDK's system.info finds the autopilot", words, held=held)
        info.destroy()


def main(arguments: list[str]) -> int:
    """Fly on a running autopilot; return 0 if everything held."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("autopilot", choices=("px4", "arducopter"))
    parser.add_argument("--vehicle", required=True, help="IT IS ARMED AND FLOWN")
    parser.add_argument("--station", required=True, help="another link of it")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="ground-station-") as folder:
        lines = fly(given.autopilot, given.vehicle, given.station, Path(folder))
        for line in lines:
            print("ok" if line.held else "NO", line.wanted, line.got, sep=" | ")
        if not all(line.held for line in lines):
            for path in sorted(Path(folder).glob("*.log")):
                print(path.name, path.read_text(errors="replace")[-3000:], sep="\n")
    return 0 if all(line.held for line in lines) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
