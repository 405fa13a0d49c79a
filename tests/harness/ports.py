"""UDP ports for mocks."""

import contextlib
import os
import random
import socket


def mock_ports() -> int:
    """A port for `sitl-mock run --udp` or `--gcs`: it, and those that two PX4s use beside it, are free now.

    Each worker of pytest-xdist draws from ports of its own, so that no other test takes one before the mock does.
    """
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:]) % 10
    while True:
        port = 20000 + 1000 * worker + random.randrange(900)
        with contextlib.suppress(OSError), contextlib.ExitStack() as probes:
            for each in (port, port + 1, port + 40, port + 41):
                probe = probes.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                probe.bind(("127.0.0.1", each))
            return port
