"""A network in virtual time with delay, jitter, loss and cuts."""

import random

from guidance.team import MemoryTransport


class LossyNetwork:
    """Connects the vehicles of one process; those that are `cut` neither send nor hear."""

    def __init__(self, clock, *, delay_s=0.0, jitter_s=0.0, loss=0.0, seed=0):
        self.clock = clock
        self.delay_s = delay_s
        self.jitter_s = jitter_s
        self.loss = loss
        self.draw = random.Random(seed)
        self.ends = {}
        self.cut = set()

    def join(self, name):
        return LossyTransport(name, self)

    def send(self, sender, key, payload):
        for name, end in self.ends.items():
            if name != sender and not {name, sender} & self.cut and self.draw.random() >= self.loss:
                end.waiting.append(
                    (self.clock() + self.delay_s + self.jitter_s * self.draw.random(), key, payload)
                )

    def leave(self, name):
        self.ends.pop(name, None)


class LossyTransport(MemoryTransport):
    """One end of a `LossyNetwork`."""

    def __init__(self, name, network):
        super().__init__(name, network.ends, network.clock)
        self.network = network

    def publish(self, key, payload):
        self.network.send(self.name, key, payload)
