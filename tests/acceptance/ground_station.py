"""Ground stations beside guidance on an autopilot's links: what they hear, and what their orders do.

One asks what QGroundControl asks, and gives orders; MAVProxy listens on another link and orders HOLD; MAVSDK is last.
They need an autopilot that forwards between its links. Before mocks a relay does that.
"""

import contextlib
import math
import os
import secrets
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import contextmanager
from pathlib import Path

import tomlkit
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.info import Info
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from guidance.links.mavlink.frames import ticks
from guidance.links.mavlink.ground_link import COMPONENT_ID, address_of
from guidance.links.opening import open_wire
from guidance.links.port import parse
from guidance.session.observe.ground_station import DENIED, ORDERS_BY_COMMAND, RESULT_ACCEPTED
from sitl_mock.child import free_udp_port
from tests.acceptance.flying import GUIDANCE, Line
from tests.acceptance.qgroundcontrol import Handshake
from tests.acceptance.relay import wait
from tests.sitl_mock.flights.mavproxy import Proxy

FLIGHT = "a ground station"
SIGNED_FLIGHT = "a ground station, signed"
HEIGHT_M = 8.0
AWAY_M = 40.0
READY_WITHIN_S = 120.0
FLOWN_WITHIN_S = 60.0
HEARD_BEFORE_S = 2.5
"""A station's signed HEARTBEATs come before its first order: the disk has a bound on its timestamps then."""

QGC = (255, 190)
HOLD, _, LAND, START, ENGAGE = ORDERS_BY_COMMAND
_METRES_PER_DEGREE = 111_320.0
_ASK_FOR_POSITIONS = mavlink.MAVLink_command_long_message(
    1, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, 33, 250_000, 0, 0, 0, 0, 0
)
_CHANGES = ("ready", "standing by", "engaged", "held by operator", "lands by operator")
_ASK_FOR_AIRCRAFT = mavlink.MAVLink_command_long_message(
    1, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, mavlink.MAVLINK_MSG_ID_ADSB_VEHICLE, 200_000, 0, 0, 0, 0, 0
)  # fmt: skip

_KEPT = frozenset({
    "AUTOPILOT_VERSION", "AVAILABLE_MODES", "COMMAND_ACK", "FILE_TRANSFER_PROTOCOL", "HOME_POSITION",
    "MISSION_COUNT", "MISSION_ITEM_INT", "PARAM_VALUE",
})  # fmt: skip
"""Messages that answer QGroundControl's questions."""

_METADATA = "UNKNOWN_397"
"""COMPONENT_METADATA, which pymavlink does not know."""


class Station:
    """A ground station of pymavlink, with a thread: it sends HEARTBEATs and keeps what it hears of guidance.

    Args:
        url: The link.
    """

    def __init__(self, url: str) -> None:
        self._wire = mavutil.mavlink_connection(_of_pymavlink(url), dialect="all")
        self._mavlink = mavlink.MAVLink(None, *QGC)
        self._lock = threading.Lock()
        self.heard: list[mavlink.MAVLink_message] = []
        self.raw: list[bytes] = []
        self.components: set[int] = set()
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

    def sign_with(self, key: bytes | None) -> None:
        """Sign what is sent from now on; None signs nothing."""
        signing = self._mavlink.signing
        signing.sign_outgoing = key is not None
        if key is not None and signing.secret_key != key:
            signing.secret_key = key
            signing.timestamp = ticks(time.time())

    def _run(self) -> None:
        beat_s = -math.inf
        while not self._over.wait(0.005):
            if time.monotonic() - beat_s >= 1.0:
                beat_s = time.monotonic()
                self.say(mavlink.MAVLink_heartbeat_message(6, 8, 192, 0, 4, 3))
                if self.place is None:
                    self.say(_ASK_FOR_POSITIONS)
            while (message := self._wire.recv_msg()) is not None:
                self._hear(time.monotonic(), message)

    def _hear(self, at_s: float, message: mavlink.MAVLink_message) -> None:
        name = message.get_type()
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if name in _KEPT:
            self.heard.append(message)
        elif name == _METADATA:
            self.raw.append(bytes(message.get_msgbuf()))
        if name == "HEARTBEAT" and sender[0] == 1:
            self.components.add(sender[1])
        if sender[1] == COMPONENT_ID:
            self._hear_guidance(at_s, name, message)
        elif name == "HEARTBEAT" and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
            self.autopilots[sender] += 1
            self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        elif name == "GLOBAL_POSITION_INT" and sender[0] == 1:
            self.place = (message.lat / 1e7, message.lon / 1e7, message.alt / 1e3)
        if name == "ADSB_VEHICLE" and message.ICAO_address == address_of(""):
            self.shown.append(message)

    def _hear_guidance(self, at_s: float, name: str, message: mavlink.MAVLink_message) -> None:
        if name == "HEARTBEAT":
            self.beats_s.append(at_s)
        elif name == "STATUSTEXT":
            self.texts.append(message.text)
        elif name == "COMMAND_ACK":
            self.answers.append((message.command, message.result))

    def say(self, message: mavlink.MAVLink_message) -> None:
        """Send a message."""
        with self._lock:
            self._wire.write(bytes(message.pack(self._mavlink)))
            self._mavlink.seq = (self._mavlink.seq + 1) % 256

    def set_up_signing(self, key: bytes | None) -> None:
        """Give the autopilot a key, and sign with it; None takes it away."""
        known = bytes(32) if key is None else key
        began = 0 if key is None else ticks(time.time())
        self.say(mavlink.MAVLink_setup_signing_message(1, 1, list(known), began))
        time.sleep(0.5)
        self.sign_with(key)

    def ask_for_aircraft(self) -> None:
        """Have ArduPilot show the aircraft that it knows: it does not forward ADSB_VEHICLE."""
        self.say(mavlink.MAVLink_param_set_message(1, 1, b"ADSB_TYPE", 1.0, 2))
        time.sleep(0.2)
        self.say(_ASK_FOR_AIRCRAFT)

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
        self.port = port
        self.place = place
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        sender = mavlink.MAVLink(None, 2, 1)
        began_s = time.monotonic()
        latitude_deg, longitude_deg, altitude_m = self.place
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
def guided(autopilot: str, url: str, evader_port: int, folder: Path, key_file: Path | None = None):
    """Run `guidance run` for a vehicle; yield a function that gives orders with `guidance ctl`."""
    folder.mkdir(parents=True, exist_ok=True)
    vehicle = {"autopilot": autopilot, "url": url, "link": "mavsdk", "announce": True}
    if key_file is not None:
        vehicle |= {"link": "pymavlink", "signing_key_file": str(key_file)}
    document = {
        "name": "uav1",
        "vehicle": vehicle,
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
    environment = {
        **os.environ,
        "XDG_RUNTIME_DIR": str(folder),
        "STATE_DIRECTORY": str(folder),
        "PYTHONUNBUFFERED": "1",
    }

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


class _Told:
    """The lines of one flight's table."""

    def __init__(self, autopilot: str, flight: str, link: str) -> None:
        self._begin = (autopilot, flight, link)
        self.lines: list[Line] = []

    def __call__(self, wanted: str, got: object, *, held: bool) -> None:
        self.lines.append(Line(*self._begin, wanted, str(got), held))


@contextmanager
def _beside(autopilot: str, station_url: str, tell: _Told):
    """Open a ground station and an evader; yield them, or None if the vehicle does not tell where it is."""
    station = Station(station_url)
    with contextlib.closing(station):
        if not wait(lambda: station.place is not None, READY_WITHIN_S):
            tell("a position", "none", held=False)
            yield None
            return
        if autopilot == "arducopter":
            station.ask_for_aircraft()
        latitude_deg, longitude_deg, altitude_m = station.place
        north = (latitude_deg + AWAY_M / _METRES_PER_DEGREE, longitude_deg, altitude_m)
        port = free_udp_port({"evader": "px4"})
        with contextlib.closing(Evader(port, north)) as evader:
            yield station, evader


def fly(autopilot: str, vehicle_url: str, station_urls: Sequence[str], folder: Path) -> list[Line]:
    """Fly once with ground stations beside; return the lines of the table.

    Args:
        autopilot: Its name.
        vehicle_url: Guidance's link.
        station_urls: A link for QGroundControl's questions and orders, and possibly one for MAVProxy.
        folder: For logs.
    """
    tell = _Told(autopilot, FLIGHT, "mavsdk")
    station_url, *others = station_urls
    with _beside(autopilot, station_url, tell) as opened, contextlib.ExitStack() as stack:
        if opened is None:
            return tell.lines
        station, evader = opened
        questions = Handshake(station, ardupilot=autopilot == "arducopter")
        alone = questions.run()
        proxy = None
        if others:
            folder.mkdir(parents=True, exist_ok=True)
            proxy = stack.enter_context(contextlib.closing(_proxy(others[0], folder)))
            _show_all_components(proxy)
        with guided(autopilot, vehicle_url, evader.port, folder) as ctl:
            ready = station.hears("ready", READY_WITHIN_S)
            tell("it hears that guidance is ready", station.texts[-1:], held=ready)
            _judge_answers(alone, questions.run(), tell)
            result = station.order(START)
            tell("START without signing: denied", result, held=result == DENIED)
            ctl("start")
            station.hears("standing by", FLOWN_WITHIN_S)
            ctl("engage")
            station.hears("engaged", 10.0)
            _order_hold(station, proxy, tell)
            station.hears("held by operator", 5.0)
            result = station.order(LAND)
            tell("LAND accepted", result, held=result == RESULT_ACCEPTED)
            down = wait(lambda: not station.armed, FLOWN_WITHIN_S)
            tell("landed and disarmed", "disarmed" if down else "armed", held=down)
            _judge(station, evader.place, tell)
            if proxy is not None:
                _judge_proxy(proxy, folder, tell)
            station.close()
            _judge_by_mavsdk(station_url, tell)
    return tell.lines


def fly_signed(autopilot: str, vehicle_url: str, station_url: str, folder: Path) -> list[Line]:
    """Fly once over signed links: the ground station starts and engages; return the lines of the table.

    The autopilot gets a key, which is taken away in the end.
    """
    tell = _Told(autopilot, SIGNED_FLIGHT, "pymavlink")
    with _beside(autopilot, station_url, tell) as opened:
        if opened is None:
            return tell.lines
        station, evader = opened
        key = secrets.token_bytes(32)
        folder.mkdir(parents=True, exist_ok=True)
        key_file = folder / "signing.key"
        key_file.touch(mode=0o600)
        key_file.write_text(key.hex(), encoding="utf-8")
        station.set_up_signing(key)
        try:
            with guided(autopilot, vehicle_url, evader.port, folder, key_file) as ctl:
                _order_signed(station, key, tell)
                ctl("land")
                wait(lambda: not station.armed, FLOWN_WITHIN_S)
        finally:
            station.sign_with(key)
            station.set_up_signing(None)
    return tell.lines


def _order_signed(station: Station, key: bytes, tell: _Told) -> None:
    ready = station.hears("ready", READY_WITHIN_S)
    tell("it hears that guidance is ready", station.texts[-1:], held=ready)
    time.sleep(HEARD_BEFORE_S)
    station.sign_with(None)
    result = station.order(START, within_s=2.0)
    tell("START unsigned: no answer", result, held=result is None)
    station.sign_with(key)
    result = station.order(START)
    tell("START signed: accepted", result, held=result == RESULT_ACCEPTED)
    up = station.hears("standing by", FLOWN_WITHIN_S)
    tell("standing by", station.texts[-1:], held=up)
    result = station.order(ENGAGE)
    tell("ENGAGE signed: accepted", result, held=result == RESULT_ACCEPTED)
    engaged = station.hears("engaged", 10.0)
    tell("engaged", station.texts[-1:], held=engaged)
    result = station.order(HOLD)
    tell("HOLD signed: accepted", result, held=result == RESULT_ACCEPTED)
    held = station.hears("held by operator", 5.0)
    tell("held by operator", station.texts[-1:], held=held)
    result = station.order(LAND)
    tell("LAND signed: accepted", result, held=result == RESULT_ACCEPTED)
    down = wait(lambda: not station.armed, FLOWN_WITHIN_S)
    tell("landed and disarmed", "disarmed" if down else "armed", held=down)


def _proxy(url: str, folder: Path) -> Proxy:
    """Start MAVProxy on a link."""
    return Proxy(0, folder, "cmdlong,message,mode,param", master=_of_pymavlink(url))


def _of_pymavlink(url: str) -> str:
    """Return a URL as pymavlink writes it."""
    link = parse(url)
    kind = {"tcpout": "tcp"}.get(link.scheme, link.scheme)
    return f"{kind}:{link.host}:{link.port}"


def _show_all_components(proxy: Proxy) -> None:
    """Wait until MAVProxy has found the autopilot, and have it show the texts of other components too."""
    wait(lambda: any("online system" in line for line in proxy.heard_all()), 20.0)
    proxy.say("set target_component 0")


def _order_hold(station: Station, proxy: Proxy | None, tell: _Told) -> None:
    """Order HOLD with MAVProxy, or else with the station."""
    if proxy is None:
        result = station.order(HOLD)
        tell("HOLD accepted", result, held=result == RESULT_ACCEPTED)
        return
    proxy.say(f"message COMMAND_LONG 1 {COMPONENT_ID} {HOLD} 0 0 0 0 0 0 0 0")
    held = station.hears("held by operator", 5.0)
    tell("HOLD by MAVProxy", station.texts[-1:], held=held)


def _judge_answers(alone: dict[str, object], beside: dict[str, object], tell: _Told) -> None:
    """Compare what QGroundControl is answered without guidance and beside it: only our component comes to it."""
    read, count = str(alone["parameters"]).split(",")[0].split(" of ")
    complete = read == count != "0" and None not in {
        alone[question] for question in ("version", "mission", "fence", "rally", "home", "interval")
    }
    words = ", ".join(f"{question} {answer}" for question, answer in alone.items())
    tell("QGroundControl's questions are answered", words, held=complete)
    ours = f"gimbal of {COMPONENT_ID}"
    changed = {
        question: answer
        for question, answer in beside.items()
        if question in alone and alone[question] != answer
    }
    got = f"{ours}: {beside.get(ours)}; others {changed}"
    held = not changed and beside.get(ours) == mavlink.MAV_RESULT_UNSUPPORTED
    tell("beside guidance they are answered as without it", got, held=held)


def _judge(station: Station, evader_deg: tuple[float, float, float], tell: _Told) -> None:
    """Judge what the ground station has heard until now."""
    counted = _counted(station.texts)
    tell("each change of the state once", counted, held=set(counted.values()) == {1})
    rate_hz = (len(station.beats_s) - 1) / max(station.beats_s[-1] - station.beats_s[0], 1e-9)
    tell("HEARTBEATs at 1 Hz", f"{rate_hz:.2f} Hz", held=0.9 <= rate_hz <= 1.1)
    tell("one autopilot", dict(station.autopilots), held=len(station.autopilots) == 1)
    off_m = math.inf
    if station.shown:
        shown = station.shown[-1]
        off_m = _METRES_PER_DEGREE * max(
            abs(shown.lat / 1e7 - evader_deg[0]), abs(shown.lon / 1e7 - evader_deg[1])
        )
    tell("the evader on the map within 2 m", f"{off_m:.1f} m", held=off_m <= 2.0)


def _counted(texts: Sequence[str]) -> dict[str, int]:
    return {
        change: sum(text.startswith(f"guidance: {change}") for text in texts) for change in _CHANGES
    }


def _judge_proxy(proxy: Proxy, folder: Path, tell: _Told) -> None:
    """Judge what MAVProxy has shown, and what its log holds: one vehicle, and each text of guidance once."""
    proxy.close()
    shown = [line for line in proxy.heard_all() if "guidance: " in line]
    tell("MAVProxy shows guidance's texts", shown[-3:], held=any("engaged" in x for x in shown))
    online = [line for line in proxy.heard if "online system" in line]
    tell("MAVProxy finds one vehicle", online, held=len(online) == 1 and online[0].endswith("1"))
    texts = []
    log = mavutil.mavlink_connection(str(folder / "flight.tlog"), dialect="all")
    while (message := log.recv_match(type="STATUSTEXT")) is not None:
        if message.get_srcComponent() == COMPONENT_ID:
            texts.append(message.text)
    log.close()
    counted = _counted(texts)
    tell("MAVProxy's log has each change once", counted, held=set(counted.values()) == {1})


def _judge_by_mavsdk(url: str, tell: _Told) -> None:
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
        tell("MAVSDK's system.info finds the autopilot", words, held=held)
        info.destroy()
