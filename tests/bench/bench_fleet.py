"""Lost frames and processor time of many mocked vehicles over UDP: `python -m tests.bench.bench_fleet --vehicles 200`.

One client listens to every vehicle of a `sitl-mock run` and counts the gaps in their sequence numbers. Run it on an
idle machine: a client that is starved loses datagrams by itself.
"""

import argparse
import contextlib
import selectors
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

FIRST_PORT = 20_000
BUFFER_BYTES = 4 << 20
STARTS_WITHIN_S = 60.0


class Listener:
    """Counts the frames of every vehicle and the gaps between them."""

    def __init__(self, vehicles: int) -> None:
        self.frames = 0
        self.lost = 0
        self.sequences: dict[int, int] = {}
        self._selector = selectors.DefaultSelector()
        self._stack = contextlib.ExitStack()
        for vehicle in range(vehicles):
            client = self._stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            client.bind(("127.0.0.1", FIRST_PORT + vehicle))
            client.setblocking(False)
            self._selector.register(client, selectors.EVENT_READ, vehicle)

    def __enter__(self) -> "Listener":
        return self

    def __exit__(self, *_: object) -> None:
        self._selector.close()
        self._stack.close()

    def listen(self) -> None:
        """Wait for data and count them."""
        for key, _ in self._selector.select(0.1):
            with contextlib.suppress(BlockingIOError):
                while True:
                    self._count(key.data, key.fileobj.recv(65536))  # type: ignore[union-attr]  # a socket

    def _count(self, vehicle: int, datagram: bytes) -> None:
        for sequence in sequences_of(datagram):
            before = self.sequences.get(vehicle)
            if before is not None:
                self.lost += (sequence - before - 1) % 256
            self.sequences[vehicle] = sequence
            self.frames += 1


def sequences_of(datagram: bytes) -> Iterator[int]:
    """Yield the sequence number of each MAVLink 2 frame of a datagram."""
    at = 0
    while at < len(datagram):
        yield datagram[at + 4]
        at += 12 + datagram[at + 1]


def processor_s(process: int) -> float:
    """Return the processor time that a process has used."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / 100.0


def main() -> int:
    """Print the result; return 1 if a frame was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=30.0)
    arguments = parser.parse_args()
    command = shutil.which("sitl-mock", path=str(Path(sys.executable).parent)) or "sitl-mock"
    fleet = [command, "run", "--vehicles", str(arguments.vehicles), "--udp", str(FIRST_PORT)]
    with (
        Listener(arguments.vehicles) as listener,
        subprocess.Popen(fleet, stdout=subprocess.DEVNULL) as mock,
    ):
        try:
            return measured(listener, mock.pid, arguments.vehicles, arguments.seconds)
        finally:
            mock.terminate()


def measured(listener: Listener, mock: int, vehicles: int, seconds: float) -> int:
    """Listen and print the result; return the exit code."""
    started_s = time.monotonic()
    while len(listener.sequences) < vehicles:
        listener.listen()
        if time.monotonic() - started_s > STARTS_WITHIN_S:
            print(f"only {len(listener.sequences)} of {vehicles} vehicles were heard")
            return 1
    first_s = time.monotonic()
    frames_before = listener.frames
    processor_before_s = processor_s(mock)
    while time.monotonic() - first_s < seconds:
        listener.listen()
    lasted_s = time.monotonic() - first_s
    rate_hz = (listener.frames - frames_before) / lasted_s
    share = (processor_s(mock) - processor_before_s) / lasted_s
    print(
        f"{vehicles} vehicles, {lasted_s:.0f} s: {rate_hz:,.0f} frames/s ({rate_hz / vehicles:.0f} a vehicle), "
        f"{listener.lost} lost, {share:.2f} of a core"
    )
    return 1 if listener.lost else 0


if __name__ == "__main__":
    sys.exit(main())
