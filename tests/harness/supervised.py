"""A daemon whose orders a mission gives, as in `guidance fly` and `scenario run`, in virtual time."""

from collections.abc import Sequence
from typing import Any

from guidance.clock import Clock
from guidance.flight import Event, Outputs
from guidance.links.world import World
from guidance.session.fly.daemon import Equipment
from guidance.session.fly.mission import Mission, MissionPolicy
from guidance.session.observe.log import Log
from guidance.session.orders.mailbox import Mailbox
from guidance.session.plan import FlightPlan
from guidance.sim.scenario import PURSUER, Scenario
from tests.harness.sortie import Sortie


class Supervised(Sortie):
    """The daemon and its mission.

    Args:
        clock: Of the world; waiting for it moves it.
        world: Where it flies.
        plan: Plan of the flight.
        scenario: Scenario of the mission.
        policy: Orders of the mission.
        more: Other arguments of the mission.
    """

    def __init__(
        self,
        clock: Clock,
        world: World,
        *,
        plan: FlightPlan,
        scenario: Scenario,
        policy: MissionPolicy,
        **more: Any,
    ) -> None:
        self.mailbox = Mailbox()
        self.log = Log("json", "error")
        used = {PURSUER: Equipment(mailbox=self.mailbox, sinks=[self.log])}
        self.mission = Mission(
            scenario, world, clock, plans={PURSUER: plan}, equipment=used, policy=policy, **more
        )
        (self.daemon,) = self.mission.daemons
        self.result = self.mission.result.vehicles[PURSUER]
        super().__init__(clock, self.daemon, world)

    @property
    def finished(self) -> bool:
        """Whether the daemon has ended."""
        return self.daemon.finished

    def act(self, _orders: Sequence[Event]) -> Outputs:
        """See `Sortie`."""
        self.mission.before(self.now_s)
        outputs = self.daemon.step(self.now_s)
        self.mission.after(self.now_s)
        return outputs

    def close(self) -> None:
        """End it; may be called once."""
        super().close()
        self.log.close()
