"""What a daemon answers before its loop runs: it waits for the vehicle, and says for what and how long."""

from guidance.clock import Clock
from guidance.session.daemon import STATUS, WORDS
from guidance.session.orders import Answer
from guidance.session.vehicle_file import Config


class Waiting:
    """Answers every order while the wire is opened and the vehicle's first HEARTBEAT is waited for."""

    def __init__(self, config: Config, clock: Clock) -> None:
        vehicle = config.vehicle
        self._name = config.name
        self._for = f"a HEARTBEAT of system {vehicle.system_id}, component {vehicle.component_id} at {vehicle.url}"
        self._limit_s = vehicle.connect_timeout_s
        self._clock = clock
        self._since_s = clock.now_s()

    def answer(self, order: str) -> Answer:
        """Status is told; every other order has to wait for the vehicle."""
        waited_s = round(self._clock.now_s() - self._since_s, 1)
        shown = {
            "order": order,
            "name": self._name,
            "state": "waiting",
            "waiting_for": self._for,
            "waited_s": waited_s,
            "connect_timeout_s": self._limit_s,
        }
        if order == STATUS:
            return {"accepted": True, **shown}
        if order not in WORDS:
            return {"accepted": False, **shown, "reason": f"order = {order!r}: allowed are {', '.join(WORDS)}"}
        return {"accepted": False, **shown, "reason": f"waiting for {self._for}, {waited_s:g} s so far"}
