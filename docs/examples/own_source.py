"""Your own source of evader reports, in ten lines: JSON on a Zenoh key. Below it, the reader that a vehicle file opens.

    python docs/examples/own_source.py

The vehicle file says:  [evader]  kind = "json"  url = "zenoh://127.0.0.1:7447/evader/report"
"""

import json
import socket
import time

import zenoh

from guidance.clock import MonotonicClock
from guidance.frames import Amsl, LocalFrame
from guidance.links.evaders.zenoh import open_source
from guidance.messages import EvaderReport


def publish(session: zenoh.Session, key: str, *, count: int, rate_hz: float) -> None:
    """Report an evader that runs north at 3 m/s. A source needs no more than this."""
    publisher = session.declare_publisher(key, encoding=zenoh.Encoding.APPLICATION_JSON)
    for k in range(count):
        report = {
            "sent_s": time.monotonic(),
            "latitude_deg": 47.397742 + 3.0 * k / rate_hz / 111_195.0,
            "longitude_deg": 8.545594,
            "altitude_m": 488.0,
            "altitude_datum": "amsl",
            "velocity_ned_m_s": [3.0, 0.0, 0.0],
        }
        publisher.put(json.dumps(report))
        time.sleep(1.0 / rate_hz)


def free_port() -> int:
    """Return a free TCP port of loopback."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def main(count: int = 5, rate_hz: float = 20.0) -> list[EvaderReport]:
    """Publish on a local router, and read the reports like the daemon."""
    port = free_port()
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        source = open_source(
            "json",
            f"zenoh://127.0.0.1:{port}/evader/report",
            clock=MonotonicClock().now_s,
            frame=LocalFrame(47.397742, 8.545594, Amsl(488.0)),
        )
        try:
            time.sleep(0.3)  # until the subscription has reached the publisher
            publish(session, "evader/report", count=count, rate_hz=rate_hz)
            reports = list(source.receive())
            print(
                f"{len(reports)} reports read, the last at {reports[-1].latitude_deg:.6f}°; {dict(source.counters())}"
            )
            return reports
        finally:
            source.close()


if __name__ == "__main__":
    main()
