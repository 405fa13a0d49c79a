"""A daemon whose orders a mission gives, as in `guidance fly` and `scenario run`, in virtual time."""

from collections.abc import Callable
from typing import Any

from guidance.clock import Clock
from guidance.flight import State
from guidance.links.port import EvaderSource
from guidance.session.daemon import Daemon
from guidance.session.log import Log
from guidance.session.loop import PERIOD_S, World
from guidance.session.metrics import Metrics
from guidance.session.mission import Conduct, Mission
from guidance.session.orders import Mailbox
from guidance.session.process import Notifier
from guidance.session.spec import FlightPlan
from guidance.sim.scenario import Scenario


class Supervised:
    """The daemon, its mission and their time.

    Args:
        clock: Of the world; waiting for it moves it.
        world: Where it flies.
        heard: The evader's reports as the daemon hears them.
        plan: What is flown.
        scenario: What the mission plays.
        conduct: What the mission orders.
        more: Of the mission.
    """

    def __init__(
        self,
        clock: Clock,
        world: World,
        heard: EvaderSource,
        *,
        plan: FlightPlan,
        scenario: Scenario,
        conduct: Conduct,
        **more: Any,
    ) -> None:
        self.clock, self.world = clock, world
        self.mailbox, self.log = Mailbox(), Log("json", "error")
        self.daemon = Daemon(
            "pursuer",
            plan,
            world.link,
            heard,
            mailbox=self.mailbox,
            log=self.log,
            metrics=Metrics("pursuer"),
            notifier=Notifier(None, None),
        )
        self.mission = Mission(scenario, self.daemon, world, heard, conduct, **more)

    @property
    def state(self) -> State:
        """Of the flight."""
        return self.daemon.flight.state

    def run(self, limit_s: float = 300.0, until: Callable[[], bool] = lambda: False) -> "Supervised":
        """Go on until the end, a limit, or what is waited for."""
        end_s = self.clock.now_s() + limit_s
        while not self.daemon.finished and self.clock.now_s() < end_s and not until():
            self.clock.sleep_until(self.clock.now_s() + PERIOD_S)
            self.world.advance()
            self.mission.before(self.clock.now_s())
            self.daemon.step(self.clock.now_s())
            self.mission.after(self.clock.now_s())
        return self

    def close(self) -> None:
        """End it; may be called once."""
        self.world.close()
        self.log.close()
