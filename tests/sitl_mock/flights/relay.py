"""A relay between a vehicle and one client on loopback that keeps a .tlog of both directions."""

import selectors
import socket
import struct
import threading
import time
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

from sitl_mock.mavlink import Decoder

LOOPBACK = "127.0.0.1"
_CLOCK_OFFSET_US = int(1.7e15)
"""Added to the monotonic clock: a .tlog's times count from 1970, and only their differences mean something here."""


class Relay:
    """Forwards bytes while the ``with`` block runs.

    Args:
        vehicle: ``udpin://127.0.0.1:14540`` (the vehicle sends there) or ``tcpout://127.0.0.1:5760``.
        client_port: The client's UDP port on loopback.
        tlog: The file that is written.
    """

    def __init__(self, vehicle: str, client_port: int, tlog: Path) -> None:
        url = urlsplit(vehicle)
        self._udp = url.scheme == "udpin"
        self._vehicle_at = None
        if self._udp:
            self._vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._vehicle.bind((LOOPBACK, url.port))
        else:
            self._vehicle = socket.create_connection((LOOPBACK, url.port), timeout=30.0)
        self._client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._client.bind((LOOPBACK, 0))
        self._client_at = (LOOPBACK, client_port)
        self._tlog = tlog.open("wb")
        self._decoders = {"vehicle": Decoder(), "client": Decoder()}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._forward)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        for each in (self._vehicle, self._client, self._tlog):
            each.close()

    def _forward(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._vehicle, selectors.EVENT_READ, self._from_vehicle)
            selector.register(self._client, selectors.EVENT_READ, self._from_client)
            while not self._stop.is_set():
                for key, _ in selector.select(0.1):
                    with suppress(ConnectionRefusedError):  # no client yet
                        key.data()

    def _from_vehicle(self) -> None:
        data, self._vehicle_at = self._vehicle.recvfrom(65536)
        self._keep("vehicle", data)
        self._client.sendto(data, self._client_at)

    def _from_client(self) -> None:
        data = self._client.recv(65536)
        self._keep("client", data)
        if not self._udp:
            self._vehicle.sendall(data)
        elif self._vehicle_at is not None:
            self._vehicle.sendto(data, self._vehicle_at)

    def _keep(self, side: str, data: bytes) -> None:
        at = struct.pack(">Q", _CLOCK_OFFSET_US + time.monotonic_ns() // 1000)
        for message in self._decoders[side].feed(data):
            self._tlog.write(at + bytes(message.get_msgbuf()))
