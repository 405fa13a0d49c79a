"""A vehicle and its client, and a client for protocol pieces; the clock moves by hand."""

from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import all as dialect

from sitl_mock.mavlink import Decoder, Encoder
from sitl_mock.protocols import LatePiece
from tests.harness.client import Fly, velocity


class Wire:
    """One protocol piece of vehicle 1/1 on one side, and pymavlink on the other: it packs and parses for a client."""

    def __init__(self, piece, client=(255, 190)):
        self.piece = piece
        self.now_s = 0.0
        self.sent = 0
        self._to_vehicle = Decoder()
        self._from_vehicle = Encoder(1, 1)
        nowhere = SimpleNamespace(write=lambda _: None)
        self._client = dialect.MAVLink(nowhere, *client)
        self._parser = dialect.MAVLink(nowhere, *client)

    def send(self, name, *values):
        """Send a message of the dialect, by name, and return the vehicle's immediate answers."""
        message = getattr(dialect, f"MAVLink_{name.lower()}_message")(*values)
        return self.read(self.piece.handle(self.now_s, self.as_received(message)))

    def as_received(self, message):
        """A message as the vehicle's decoder makes it from the bytes of pymavlink."""
        frame = message.pack(self._client)
        self._client.seq = (self._client.seq + 1) % 256
        (received,) = self._to_vehicle.feed(frame, whole=True)
        return received

    def wait(self, seconds, step_s=0.01):
        """Move the clock and return the messages received meanwhile."""
        came = []
        for _ in range(round(seconds / step_s)):
            self.now_s += step_s
            if isinstance(self.piece, LatePiece):
                came += self.read(self.piece.advance(self.now_s))
        return came

    def read(self, replies):
        """Pack replies as the vehicle does and parse them as a client does."""
        messages = []
        for reply in replies:
            frame = self._from_vehicle.pack(*reply)
            message = self._parser.decode(bytearray(frame))
            assert message.get_type() == reply[0]
            messages.append(message)
            self.sent += 1
        return messages


@pytest.fixture
def wire():
    """``wire(piece)`` puts a piece on one end of a wire and a pymavlink client on the other."""
    return Wire


@pytest.fixture(scope="session")
def fly():
    """See `Fly`."""
    return Fly()


@pytest.fixture(scope="session")
def ned_velocity():
    """A velocity setpoint."""
    return velocity
