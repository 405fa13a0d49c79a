"""An order to a team by a TLS router: processor time and time of `guidance ctl`, from its start to its end.

    python -m tests.bench.bench_order [--orders 10]

Three mocks, each with a `guidance run` of its own; the daemons meet by a router with the shipped access control. They
stay on the ground, so that each answers `hold` with a refusal.
"""

import argparse
import datetime
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import tomlkit

from guidance.config import config_folder
from guidance.errors import LinkError
from guidance.links.zenoh.access import read_credentials
from guidance.links.zenoh.keys import make_keys
from guidance.links.zenoh.session import Session, open_router
from guidance.session.orders.control_client import join_session, order_team
from sitl_mock.child import RunningFleet, running
from tests.acceptance.relay import wait
from tests.harness.vehicle import FENCED, document, mocked
from tests.links.rigs import free_port

GUIDANCE = Path(sys.executable).parent / "guidance"
NAMES = ("uav1", "uav2", "uav3")
WITHIN_S = 60.0


def vehicle_file(folder: Path, fleet: RunningFleet, name: str, endpoint: str) -> Path:
    """Write the file of one daemon."""
    path = folder / f"{name}.toml"
    written = document(
        name=name,
        vehicle={"url": fleet[name].udp, "system_id": fleet[name].system_id},
        evader={"url": f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"},
        control={"endpoint": endpoint, "host": False},
        zenoh={
            "tls_ca_file": "keys/ca.pem",
            "tls_certificate_file": f"keys/{name}-guidance.pem",
            "tls_key_file": f"keys/{name}-guidance.key",
        },
        record={"folder": str(folder)},
        team={
            "name": "north",
            "mates": [mate for mate in NAMES if mate != name],
            "evader": "rover",
        },
    )
    path.write_text(tomlkit.dumps(written), encoding="utf-8")
    return path


def all_are_there(session: Session) -> bool:
    """Return whether every daemon has reached its vehicle."""
    try:
        answers = order_team(session, "status", "north", NAMES, timeout_s=1.0)
    except LinkError:
        return False
    return all("heartbeat_age_s" in answer for answer in answers)


def ordered(command: Sequence[str]) -> tuple[float, float]:
    """Give an order; return processor time and time, s."""
    started_s = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    reply = process.stdout.read().decode()
    _, _, spent = os.wait4(process.pid, 0)
    took_s = time.perf_counter() - started_s
    answered = [line.partition(": hold")[0] for line in reply.splitlines()]
    if answered != list(NAMES) or "not heard" in reply:
        sys.exit(f"not all answered: {reply}")
    return spent.ru_utime + spent.ru_stime, took_s


def measure(orders: int, folder: Path) -> None:
    """Start everything, give the orders, and print what they took."""
    now = datetime.datetime.now(datetime.UTC)
    parties = [*(f"{name}-guidance" for name in NAMES), "operator"]
    make_keys(folder / "keys", parties, ["127.0.0.1"], (now, now + datetime.timedelta(days=1)))
    endpoint = f"tls/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    with ExitStack() as stack:
        vehicles = [
            mocked(name, system_id=number, parameters=FENCED)
            for number, name in enumerate(NAMES, start=1)
        ]
        fleet = stack.enter_context(running(vehicles, over=["udp"]))
        settings = config_folder() / "zenoh" / "team.json5"
        stack.enter_context(open_router(settings, folder / "keys", endpoint))
        for name in NAMES:
            command = [str(GUIDANCE), "run", str(vehicle_file(folder, fleet, name, endpoint))]
            log = stack.enter_context((folder / f"{name}.log").open("w", encoding="utf-8"))
            daemon = stack.enter_context(subprocess.Popen(command, stdout=log, stderr=log))
            stack.callback(daemon.terminate)
        operator = folder / "keys" / "operator.toml"
        session = stack.enter_context(join_session(endpoint, None, read_credentials(operator)))
        if not wait(lambda: all_are_there(session), WITHIN_S):
            sys.exit("the daemons did not start")
        by_router = ["--endpoint", endpoint, "--zenoh", str(operator)]
        command = [str(GUIDANCE), "ctl", "hold", "--team", "north", *by_router]
        took = [ordered(command) for _ in range(orders)]
    processor_s, whole_s = (sorted(times) for times in zip(*took, strict=True))
    for kind, times in (("processor time", processor_s), ("from start to end", whole_s)):
        middle = statistics.median(times)
        print(f"{kind:18} median {middle:.3f} s, least {times[0]:.3f}, most {times[-1]:.3f} s")


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--orders", type=int, default=10)
    with tempfile.TemporaryDirectory() as folder:
        measure(parser.parse_args().orders, Path(folder))


if __name__ == "__main__":
    main()
