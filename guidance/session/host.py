"""`guidance doctor`: checks of the computer before a flight, one row each with advice.

It changes nothing: ports are bound and released, real-time scheduling is tried and given back.
"""

import contextlib
import ctypes
import os
import platform
import shutil
import socket
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from serial.tools import list_ports

from guidance.autopilots import Finding, Verdict
from guidance.extras import EXTRAS, how_to_add
from guidance.links.port import parse
from guidance.session.control_socket import token_path
from guidance.session.loop import PERIOD_S, PRIORITY
from guidance.session.vehicle_file import Config, Control

CYCLES: Final = 50
"""Cycles of the timing check: one second."""

LATE_S: Final = 0.005
"""A later start of a cycle is reported."""

FLIGHT_BYTES: Final = 240_000_000
"""An hour's record: 3.8 MB a minute (tests/bench/bench_endurance.py), rounded up."""

WARN: Final = Verdict.WARN
_TIME_ERROR: Final = 5
_DEFAULT_URLS: Final = ("udpin://127.0.0.1:14540", "udpin://127.0.0.1:14541")


def examine(config: Config | None = None) -> Sequence[Finding]:
    """Look at this computer, for the vehicle of a file or for one at the usual ports.

    Args:
        config: The vehicle's file.
    """
    folder = Path.cwd() if config is None or config.record.folder is None else config.record.folder
    system = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    there = [extra for extra in EXTRAS if how_to_add(extra) is None]
    absent = ",".join(extra for extra in EXTRAS if extra not in there)
    lacking = f"pip install 'pursuit-guidance[{absent}]'" if absent else ""
    return (
        Finding.of(sys.platform == "linux", "software", system, "Linux, Python 3.11 or later", "fly on Linux", WARN),
        _calendar(),
        _cadence(),
        _scheduling(),
        *_urls(config),
        _control(Control() if config is None else config.control),
        *_serial_ports(config),
        *_record_folder(folder),
        Finding("extras", ", ".join(there) or "none", "as you like", Verdict.PASS, lacking),
    )


def _calendar() -> Finding:
    """Whether a time service keeps the system clock: signing and the evader's time stamps need the date."""
    try:
        kept = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(1024)) != _TIME_ERROR
    except (AttributeError, OSError):
        return Finding("calendar", "not known", "synchronized", WARN, "see that a time service runs")
    advice = "timedatectl set-ntp true, or the time from GPS"
    return Finding.of(kept, "calendar", "synchronized" if kept else "not synchronized", "synchronized", advice, WARN)


def _cadence() -> Finding:
    """Largest delay of a wake-up under the present load."""
    worst_s, due_s = 0.0, time.monotonic()
    for _ in range(CYCLES):
        due_s += PERIOD_S
        time.sleep(max(0.0, due_s - time.monotonic()))
        worst_s = max(worst_s, time.monotonic() - due_s)
    found = f"{1e3 * worst_s:.1f} ms late at worst in {CYCLES} cycles"
    advice = "end what else runs, or allow real-time scheduling (the next row)"
    return Finding.of(worst_s <= LATE_S, "cadence", found, f"at most {1e3 * LATE_S:g} ms", advice, WARN)


def _scheduling() -> Finding:
    name, wanted = "scheduling", f"realtime {PRIORITY}"
    if not hasattr(os, "sched_setscheduler"):
        return Finding(name, "none on this system", wanted, WARN, "fly on Linux")
    policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    except PermissionError:
        return Finding(name, "not permitted", wanted, WARN, "CPUSchedulingPolicy=rr, or rtprio in limits.conf")
    os.sched_setscheduler(0, policy, parameter)
    return Finding(name, "permitted", wanted, Verdict.PASS)


def _urls(config: Config | None) -> Iterator[Finding]:
    usual = [("usual", url) for url in _DEFAULT_URLS]
    own = [] if config is None else [("vehicle.url", config.vehicle.url), ("evader.url", config.evader.url)]
    for key, url in own or usual:
        endpoint = None if url is None else parse(url)
        if endpoint is not None and endpoint.scheme in {"udpin", "tcpin"}:
            kind = socket.SOCK_DGRAM if endpoint.scheme == "udpin" else socket.SOCK_STREAM
            yield _port(f"{key} {url}", endpoint.host, endpoint.port, kind, "end what listens there, or take another")


def _control(control: Control) -> Finding:
    path = control.token_file or token_path(control.endpoint)
    folder = next(part for part in (path, *path.parents) if part.exists())
    if not os.access(folder, os.W_OK):
        advice = f"the token goes to {path}: set control.token_file, or run as who owns {folder}"
        return Finding("orders", f"{folder} is not writable", "a folder for the token", Verdict.REFUSE, advice)
    host, _, port = control.endpoint.partition("/")[2].rpartition(":")
    if not (control.host and port.isdigit()):
        return Finding("orders", control.endpoint, "a folder for the token", Verdict.PASS)
    advice = "a daemon runs already? guidance ctl status says; else set control.endpoint"
    return _port(f"orders {control.endpoint}", host.strip("[]"), int(port), socket.SOCK_STREAM, advice)


def _port(name: str, host: str, port: int, kind: socket.SocketKind, advice: str) -> Finding:
    found = "free"
    with contextlib.closing(socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, kind)) as probe:
        if kind == socket.SOCK_STREAM:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            found = str(error.strerror)
    return Finding.of(found == "free", name, found, "free", advice)


def _serial_ports(config: Config | None) -> Iterator[Finding]:
    wanted, advice = "readable and writable", "usermod -aG dialout USER, and log in again"
    own = parse(config.vehicle.url) if config is not None else None
    device = own.host if own is not None and own.scheme == "serial" else ""
    if device and not Path(device).exists():
        yield Finding(device, "not there", wanted, Verdict.REFUSE, "plug it in; ls /dev/serial/by-id lists what is")
    for port in sorted(one.device for one in list_ports.comports()):
        good, bad = os.access(port, os.R_OK | os.W_OK), Verdict.REFUSE if port == device else WARN
        yield Finding.of(good, port, wanted if good else "no rights", wanted, advice, bad)


def _record_folder(folder: Path) -> Iterator[Finding]:
    there = next(part for part in (folder, *folder.absolute().parents) if part.exists())
    good = there.is_dir() and os.access(there, os.W_OK | os.X_OK)
    found = f"{folder.absolute()}: {'writable' if good else 'not writable'}"
    yield Finding.of(good, "record folder", found, "writable", "set record.folder, or change the rights")
    free, wanted = shutil.disk_usage(there).free, f"{FLIGHT_BYTES / 1e6:g} MB for an hour"
    advice = "make room: a full disk ends the record, never the flight"
    yield Finding.of(free >= FLIGHT_BYTES, "disk", f"{free / 1e9:.1f} GB free", wanted, advice, WARN)
