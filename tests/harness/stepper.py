"""A client over UDP that owns the time of a mock in lockstep: blocking sockets and MAVLink frames, no clock."""

import hashlib
import math
import socket

from pymavlink.dialects.v20 import all as dialect

from sitl_mock.transports.lockstep import STEP


class Stepper:
    """A client without a clock of its own."""

    def __init__(self, vehicle):
        self.wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.wire.settimeout(10.0)
        # Connected: else it also receives what other programs send to a port that was theirs before.
        self.wire.connect(("127.0.0.1", vehicle.udp_listens))
        self.mavlink = dialect.MAVLink(None, 255, 190)
        self.mavlink.robust_parsing = True
        self.number = 0
        self.digest = hashlib.sha256()
        self.last = {}

    def step(self, length_s, *messages):
        """Send messages and the next step; read until its answer."""
        self.number += 1
        ask = dialect.MAVLink_command_long_message(
            1, 1, STEP, 0, length_s, self.number, 0, 0, 0, 0, 0
        )
        for message in (*messages, ask):
            self.wire.send(message.pack(self.mavlink))
        while True:
            data = self.wire.recv(2048)
            self.digest.update(data)
            for message in self.mavlink.parse_buffer(data):
                self.last[message.get_type()] = message
                if message.get_type() == "COMMAND_ACK" and message.command == STEP:
                    return


def long(command, *params):
    fill = [0.0] * (7 - len(params))
    return dialect.MAVLink_command_long_message(1, 1, command, 0, *params, *fill)


def take_off(vehicle):
    """Take off to 8 m in lockstep; return the digest of all that came, and the height."""
    client = Stepper(vehicle)
    client.step(1.0)
    nan = math.nan
    client.step(0.1, long(22, 0, 0, 0, nan, nan, nan, 496.0))
    client.step(0.1, long(400, 1))
    for _ in range(30):
        client.step(0.5)
    client.wire.close()
    return client.digest.hexdigest(), -client.last["LOCAL_POSITION_NED"].z
