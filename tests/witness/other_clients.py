"""Programs of other people on a vehicle: their examples, tests and tools, one case each.

A program runs in a process of its own while the witness leaves the link to it. What comes from the package index is
installed when it is first needed, into environments beside this one's packages. What does not is named by options of
the witness: MAVSDK's examples and its integration tests by their folders, mavlink-router by its program. A case whose
program is missing is not played.
"""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pymavlink.dialects.v20 import all as dialect

from sitl_mock.child import free_udp_port
from tests.sitl_mock.flights.mavproxy import Proxy
from tests.witness.cases import (
    FENCE,
    INJECT_FAILURE,
    INT32,
    MISSION,
    RALLY,
    Case,
    bits_as_float,
    cleared,
)
from tests.witness.client import Client, address_of

PROGRAMS = Path(__file__).with_name("programs")
INSTALLED = Path(sys.prefix) / "witness"
"""Folder of the environments of other people's clients."""
PACKAGES = {
    "dronekit": ("dronekit==2.9.2", "future"),  # dronekit imports future without naming it
    "mavsdk3": ("mavsdk>=3.17,<4",),
}
"""What each environment installs."""
INSTALL_S = 300.0
EXCEPTION = re.compile(r"[\w.]+(Error|Exception)\b")
"""The line of a traceback that names the exception; a library's log may follow it."""


class NotPlayedError(Exception):
    """Raised by a case whose program is not on this computer."""


@dataclass(frozen=True)
class Programs:
    """What is not installed by itself.

    Attributes:
        examples_3: Folder of MAVSDK-Python's examples.
        examples_4: Folder of the Python examples of MAVSDK 4.
        tests_3: Checkout of MAVSDK v3.14.0 with its integration tests built.
        router: mavlink-routerd.
    """

    examples_3: Path | None = None
    examples_4: Path | None = None
    tests_3: Path | None = None
    router: Path | None = None


Play = Callable[..., str]
"""Plays a program on a client's vehicle: ``play(client, programs=programs)``."""


def interpreter(name: str) -> Path:
    """Return the Python of an environment; install it if it is missing."""
    folder = INSTALLED / name
    complete = folder / "complete"
    python = folder / "bin" / "python"
    if not complete.exists():
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        pip = (str(python), "-m", "pip", "install", "-q")
        done = subprocess.run(
            [*pip, *PACKAGES[name]], check=False, timeout=INSTALL_S, capture_output=True, text=True
        )
        if done.returncode != 0:
            raise NotPlayedError(f"pip cannot install {', '.join(PACKAGES[name])}")
        complete.touch()
    return python


def printed(
    command: list[str],
    folder: Path,
    within_s: float,
    environment: Mapping[str, str] = os.environ,
) -> tuple[str, str]:
    """Run a program; return what it printed, and how it ended: ``ended``, its exception, or that it did not end."""
    child = subprocess.Popen(
        command,
        cwd=folder,
        env=dict(environment),
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        output, errors = child.communicate(timeout=within_s)
        is_late = False
    except subprocess.TimeoutExpired:
        is_late = True
    with contextlib.suppress(ProcessLookupError):  # MAVSDK 3 may leave its server
        os.killpg(child.pid, signal.SIGKILL)
    if is_late:
        output, _ = child.communicate()
        return output, "did not end"
    if child.returncode == 0:
        return output, "ended"
    reasons = [line for line in errors.splitlines() if EXCEPTION.match(line)]
    return output, reasons[-1] if reasons else f"exit code {child.returncode}"


# -- dronekit ----------------------------------------------------------------------------------------------------------

DRONEKIT_TESTS = (
    "test_state.test_state",
    "test_simpledemo.test_mode",
    "test_simpledemo.test_parameter",
    "test_earlyattrs.test_battery_none",
    "test_locations.test_timeout",
    "test_locations.test_location_notify",
    "test_vehicleclass.test_timeout",
    "test_capability_and_version.test_115",
    "test_channels.test_timeout",
    "test_parameters.test_parameters",
    "test_parameters.test_iterating",
    "test_waypoints.test_empty_clear",
    "test_waypoints.test_227",
    "test_waypoints.test_parameter",
    "test_115.test_115",
    "test_110.test_110",
    "test_goto.test_goto",
    "test_sensor_calibration.test_gyro_calibration",
    "test_sensor_calibration.test_barometer_calibration",
)
"""Tests of the suite that a vehicle can influence and that leave it able to fly."""
DRONEKIT_S = 600.0


def dronekit_suite(client: Client, programs: Programs) -> str:
    """Play dronekit's suite, which is written for ArduCopter."""
    if client.autopilot != dialect.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return "not played: the suite is for ArduCopter"
    python = interpreter("dronekit")
    program = str(PROGRAMS / "dronekit_suite.py")
    with client.lent() as url:
        output, ended = printed(
            [str(python), program, address_of(url), *DRONEKIT_TESTS], PROGRAMS, DRONEKIT_S
        )
    outcomes = [line for line in output.splitlines() if line.startswith("test_")]
    failed = [line for line in outcomes if not line.endswith(": passed")]
    return (
        f"{ended}; {len(outcomes) - len(failed)} of {len(DRONEKIT_TESTS)} pass; {', '.join(failed)}"
    )


# -- MAVSDK ------------------------------------------------------------------------------------------------------------

EXAMPLE_S = 90.0
ENDLESS_S = 12.0
LONGEST_S = {
    "mission.py": 180.0,
    "do_orbit.py": 90.0,
    "geofence.py": 30.0,
    "goto.py": 35.0,
    "manual_control.py": 30.0,
    "logfile_download.py": 150.0,
    "ftp_download_file.py": ENDLESS_S,
    "winch.py": ENDLESS_S,
    "highres_imu.py": ENDLESS_S,
    "mavlink_direct_receive.py": ENDLESS_S,
    "transponder.py": ENDLESS_S,
    "telemetry_flight_mode.py": ENDLESS_S,
    "telemetry_is_armed_is_in_air.py": ENDLESS_S,
    "telemetry_status_text.py": ENDLESS_S,
}
"""Longest time of an example; ArduCopter never answers geofence.py, and most of the others never end."""


def example(client: Client, programs: Programs, *, version: int, name: str) -> str:
    """Run an example of MAVSDK; return how it ended and the kinds of lines that it printed, numbers as 0."""
    folder = programs.examples_3 if version == 3 else programs.examples_4
    if folder is None:
        raise NotPlayedError(f"--mavsdk{version}-examples is missing")
    python = str(interpreter("mavsdk3")) if version == 3 else sys.executable
    path = folder / name
    if (version, name) == (3, "telemetry.py"):
        within_s = ENDLESS_S
    else:
        within_s = LONGEST_S.get(name, EXAMPLE_S)
    command = [python, "-u", str(PROGRAMS / "mavsdk_example.py"), str(path)]
    with client.lent() as url, tempfile.TemporaryDirectory() as scratch:
        for plan in folder.glob("*.plan"):
            shutil.copy(plan, scratch)
        output, ended = printed([*command, url], Path(scratch), within_s)
    for kind in (MISSION, FENCE, RALLY):
        cleared(client, kind)
    if name == "failure_injection.py":
        heal(client)
    source = path.read_text(encoding="utf-8")
    lines = [printable(line) for line in output.splitlines() if printable(line)]
    of_the_script = [line for line in lines if line in source]
    of_the_vehicle = {
        without_numbers(line)
        for line in lines
        if line not in source and not any(text in line for text in RACING)
    }
    if ended != "ended" and of_the_script:
        ended = f"{without_numbers(ended)} after {of_the_script[-1]!r}"
    return "; ".join([ended, *sorted(of_the_vehicle)])


def heal(client: Client) -> None:
    """Let a PX4's GPS work again, which failure_injection.py leaves off, and wait for its position."""
    if client.autopilot != dialect.MAV_AUTOPILOT_PX4:
        return
    client.set_parameter("SYS_FAILURE_EN", bits_as_float(1), INT32)
    client.gather("HEARTBEAT", 1.0)
    client.command(INJECT_FAILURE, dialect.FAILURE_UNIT_SENSOR_GPS, dialect.FAILURE_TYPE_OK)
    client.arm()
    client.command(400, 0)


def printable(line: str) -> str:
    """Return a line without control characters, which MAVSDK prints of an empty hash."""
    return "".join(letter for letter in line if letter.isprintable()).strip()


def without_numbers(text: str) -> str:
    """Return a text with every number and hash as 0."""
    without_hashes = re.sub(r"\b(0x)?[0-9a-f]{8,}\b", "0", text)
    zeros = re.sub(r"-?[0-9]+(\.[0-9]+)?(e-?[0-9]+)?", "0", without_hashes)
    return re.sub(r"0[0 ]*0", "0", zeros).strip()


RACING = ("Landing at current position", "[logger]", "Mission progress")
"""Texts that come while a script ends or an upload is refused, or that are about the log on the simulator's disk."""
EXAMPLES_3 = (
    "logfile_download.py",
    "firmware_version.py",
    "ftp_download_file.py",
    "winch.py",
    "tune.py",
    "rtcm.py",
    "transponder.py",
    "highres_imu.py",
    "telemetry.py",
    "telemetry_flight_mode.py",
    "telemetry_is_armed_is_in_air.py",
    "telemetry_status_text.py",
    "mavlink_direct_receive.py",
    "mavlink_direct_send.py",
    "send_status_message.py",
    "mission_import.py",
    "geofence.py",
    "mission_raw.py",
    "takeoff_and_land.py",
    "telemetry_takeoff_and_land.py",
    "goto.py",
    "offboard_attitude.py",
    "offboard_position_ned.py",
    "offboard_velocity_body.py",
    "offboard_velocity_ned.py",
    "offboard_position_velocity_ned.py",
    "follow_me_example.py",
    "mission.py",
    "do_orbit.py",
    "manual_control.py",
    "failure_injection.py",
)
EXAMPLES_4 = ("takeoff_and_land.py", "telemetry.py", "mission.py")

TEST_PROGRAM = Path("build/src/integration_tests/integration_tests_runner")
TEST_URL = "MAVSDK_TEST_URL"
"""Environment variable with the URL that the tests connect to."""
TEST_S = 240.0
LIMITED = ("sh", "-c", 'ulimit -v 4000000 && exec "$@"', "sh")
"""Runs a program with at most 4 GB of memory, so that a test which wants more ends alone."""

TRIES = 3
"""How often a failing test is played: on a busy computer some of them lose a race with either autopilot."""
FAILURE = re.compile(r"(\w+\.\w+:\d+): Failure\n")
"""A failed assertion of a test: its file and line."""


def integration_test(client: Client, programs: Programs, *, name: str) -> str:
    """Play an integration test of MAVSDK 3; return whether it passes, and otherwise where it fails."""
    if programs.tests_3 is None:
        raise NotPlayedError(
            "--mavsdk3-tests is missing: MAVSDK v3.14.0 with its integration tests"
        )
    is_px4 = client.autopilot == dialect.MAV_AUTOPILOT_PX4
    if name.startswith("AP" if is_px4 else "PX4"):
        return f"not played: the test is for {'ArduPilot' if is_px4 else 'PX4'}"
    for _ in range(TRIES):
        outcome = outcome_of_test(client, programs.tests_3, name)
        if outcome in {"passes", "skips itself", "did not end"}:
            break
    return outcome


def outcome_of_test(client: Client, checkout: Path, name: str) -> str:
    """Play an integration test once."""
    command = [*LIMITED, str(checkout / TEST_PROGRAM), f"--gtest_filter=*.{name}"]
    with client.lent() as url, tempfile.TemporaryDirectory() as scratch:
        (Path(scratch) / "src").symlink_to(checkout / "src")  # a test reads a plan from it
        output, ended = printed(command, Path(scratch), TEST_S, {**os.environ, TEST_URL: url})
    cleared(client, MISSION)
    cleared(client, FENCE)
    failures = sorted(set(FAILURE.findall(output)))
    if "[  SKIPPED ]" in output:
        return "skips itself"
    if ended == "ended":
        return "passes"
    return f"fails at {', '.join(failures)}" if failures else ended


INTEGRATION_TESTS = (
    "SystemConnectionAsync",
    "SystemMultipleComponents",
    "PX4Info",
    "PX4ParamSad",
    "PX4ParamHappy",
    "APParam",
    "GetAllParams",
    "PX4MavlinkPassthrough",
    "PX4TelemetryAsync",
    "PX4TelemetrySync",
    "TelemetryHealth",
    "TelemetryGpsOrigin",
    "TelemetryFlightModes",
    "CalibrationGyro",
    "CalibrationGyroCancelled",
    "CalibrationGyroWithTelemetry",
    "LogFiles",
    "LogFilesDownloadFailsIfPathIsDirectory",
    "LogFilesDownloadFailsIfFileAlreadyExists",
    "PX4MissionTransferLossy",
    "PX4MissionUploadCancellation",
    "PX4MissionDownloadCancellation",
    "PX4MissionRawMissionChanged",
    "PX4GeofenceInclusion",
    "PX4ActionGoto",
    "PX4ActionHold",
    "ActionHoverAsync",
    "PX4ActionHoverSyncHigher",
    "PX4ActionHoverSyncLower",
    "PX4ActionHoverSyncDefault",
    "APMActionHoverSyncHigher",
    "APMActionHoverSyncLower",
    "APMActionHoverSyncDefault",
    "ActionTakeoffAndKill",
    "OffboardVelocityNED",
    "OffboardVelocityBody",
    "OffboardPositionNED",
    "PX4OffboardAccelerationNED",
    "PX4FollowMeOneLocation",
    "PX4FollowMeMultiLocationWithConfig",
    "MissionTakeoffAndLand",
    "PX4MissionAddWaypointsAndFly",
    "PX4MissionChangeSpeed",
    "PX4MissionRawImportAndFly",
    "APMissionRawImportAndFly",
    "PX4MissionSetCurrent",
    "PX4MissionWithRTLHigh",
    "PX4MissionWithRTLLow",
    "PX4MissionWithRTLHigherAnyway",
)
"""The tests that need neither a camera, a gimbal, a person nor a second vehicle. The take-off height is last set to
PX4's own."""


# -- MAVProxy ----------------------------------------------------------------------------------------------------------

DIALOG = (
    ("", r"(Detected vehicle) 1:1"),
    ("", r"(Received) \d+ parameters"),
    ("param show SYS_FAILURE_EN", r"(SYS_FAILURE_EN +\S+)"),
    ("param show GUID_TIMEOUT", r"(GUID_TIMEOUT +\S+)"),
    ("wp list", r"(Requesting \d+ waypoints)"),
    ("fence list", r"(Requesting \d+ fence items)"),
    ("long MAV_CMD_SET_MESSAGE_INTERVAL 33 200000 0 0 0 0 0", r"(SET_MESSAGE_INTERVAL: \w+)"),
    ("mode LOITER", r"(DO_SET_MODE: \w+)"),
    ("arm throttle", r"(COMPONENT_ARM_DISARM: \w+)"),
    ("disarm", r"(COMPONENT_ARM_DISARM: \w+)"),
)
"""Lines that are typed, and the answers."""


def mavproxy(client: Client, programs: Programs) -> str:
    """Play a dialog with MAVProxy: parameters, plans, an interval, a mode, arming and disarming."""
    heard = []
    with client.lent() as url, tempfile.TemporaryDirectory() as scratch:
        proxy = Proxy(0, scratch, "cmdlong,param,arm,mode,wp,fence", master=address_of(url))
        try:
            for typed, pattern in DIALOG:
                if typed:
                    proxy.say(typed)
                heard.append(proxy.hear(pattern, 30.0 if not typed else 4.0) or "nothing")
        finally:
            proxy.close()
    return "; ".join(heard)


# -- pymavlink ---------------------------------------------------------------------------------------------------------


def mavutil_calls(client: Client, programs: Programs) -> str:
    """Call what pymavlink's mavutil offers for a vehicle."""
    link = client.link
    modes = link.mode_mapping()
    link.set_mode("LOITER")
    client.gather("HEARTBEAT", 2.0)
    shown = [f"{len(modes)} modes, {link.flightmode}"]
    for act in (link.arducopter_arm, link.arducopter_disarm):
        act()
        client.gather("HEARTBEAT", 2.0)
        shown.append("armed" if link.motors_armed() else "disarmed")
    link.param_fetch_all()
    listed = client.gather("PARAM_VALUE", 20.0)
    indices = {
        message.param_index for message in listed if message.param_index < message.param_count
    }
    shown.append(f"all parameters: {len(indices) == listed[0].param_count}")
    link.waypoint_request_list_send()
    number = client.wait("MISSION_COUNT")
    shown.append("no answer" if number is None else f"{number.count} items")
    client.send.mission_ack_send(client.system, 1, 0)
    client.bring_down()
    return ", ".join(shown)


# -- mavlink-router ----------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def routed(router: Path, url: str) -> Iterator[tuple[str, str]]:
    """Start mavlink-router between an autopilot and two stations; yield the URLs of these."""
    ports = [free_udp_port({"uav1": "px4"}) for _ in range(2)]
    scheme, _, place = url.partition("://")
    vehicle = ["-p", place] if scheme == "tcpout" else [place]
    stations = [option for port in ports for option in ("-e", f"127.0.0.1:{port}")]
    child = subprocess.Popen(
        [str(router), "-t", "0", *stations, *vehicle],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield (f"udpin://127.0.0.1:{ports[0]}", f"udpin://127.0.0.1:{ports[1]}")
    finally:
        child.terminate()
        child.wait(5.0)


def by_router(client: Client, programs: Programs) -> str:
    """Two stations behind mavlink-router: who hears HEARTBEAT, answers to commands, parameters and PING."""
    if programs.router is None:
        raise NotPlayedError("--router is missing: the program mavlink-routerd")
    with (
        client.lent() as url,
        routed(programs.router, url) as (first_url, second_url),
        Client(first_url) as first,
        Client(second_url, station=254) as second,
    ):
        second.gather("HEARTBEAT", 2.0)
        shown = [f"HEARTBEAT {heard_by(first, second, 'HEARTBEAT', lambda: None)}"]
        shown.append(f"ACK {heard_by(first, second, 'COMMAND_ACK', lambda: ask(first))}")
        shown.append(f"PARAM_VALUE {heard_by(first, second, 'PARAM_VALUE', lambda: read(first))}")
        shown.append(f"PING {heard_by(first, second, 'PING', lambda: ping(first))}")
    return ", ".join(shown)


def ask(station: Client) -> None:
    """Ask for AUTOPILOT_VERSION by a command."""
    station.send.command_long_send(station.system, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)


def read(station: Client) -> None:
    """Read the first parameter."""
    station.send.param_request_read_send(station.system, 1, b"", 0)


def ping(station: Client) -> None:
    """Send a PING to everybody."""
    station.send.ping_send(int(time.time() * 1e6), 1, 0, 0)


def heard_by(first: Client, second: Client, name: str, send: Callable[[], None]) -> str:
    """Let the first station send; return which stations heard a message within some seconds."""
    first.drain()
    second.drain()
    send()
    heard = [
        label
        for label, station in (("first", first), ("second", second))
        if station.wait(name, seconds=2.0) is not None
    ]
    return " and ".join(heard) or "nobody"


# -- all ---------------------------------------------------------------------------------------------------------------

_PLAYS: dict[str, Play] = {
    "pymavlink's mavutil: modes, arming, disarming, all parameters, the mission": mavutil_calls,
    "MAVProxy: a dialog": mavproxy,
    "mavlink-router between the autopilot and two stations": by_router,
    **{f"MAVSDK 3, {name}": partial(example, version=3, name=name) for name in EXAMPLES_3},
    **{f"MAVSDK 4, {name}": partial(example, version=4, name=name) for name in EXAMPLES_4},
    **{
        f"MAVSDK 3, integration test {name}": partial(integration_test, name=name)
        for name in INTEGRATION_TESTS
    },
    "dronekit's suite": dronekit_suite,
}


def cases_of(programs: Programs) -> dict[str, Case]:
    """Return the cases by title."""
    return {title: partial(play, programs=programs) for title, play in _PLAYS.items()}
