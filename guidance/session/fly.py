"""A scenario flown in whichever world, from connecting to the end."""

import time
from collections.abc import Callable

from guidance.clock import Clock
from guidance.log.writer import Record
from guidance.session.daemon import Daemon
from guidance.session.log import SILENT, Logger
from guidance.session.loop import Signals, World, run
from guidance.session.mission import MOCKED, Mission, MissionPolicy, Progress
from guidance.session.orders import Mailbox
from guidance.session.plan import FlightPlan, plan_of
from guidance.session.process import Notifier
from guidance.session.result import FlightResult
from guidance.sim.scenario import PURSUER, Scenario
from guidance.sim.sensor import SensedEvader


def fly(
    scenario: Scenario,
    world: World,
    clock: Clock,
    record: Record | None = None,
    show: Callable[[Progress], None] = lambda _: None,
    *,
    plan: FlightPlan | None = None,
    policy: MissionPolicy = MOCKED,
    name: str = PURSUER,
    mailbox: Mailbox | None = None,
    log: Logger = SILENT,
    notifier: Notifier | None = None,
    signals: Signals | None = None,
    broadcast: Record | None = None,
) -> FlightResult:
    """Fly a scenario to its end.

    Args:
        scenario: The scenario.
        world: The vehicle and the evader; the caller closes it.
        clock: The world's time.
        record: Of the flight.
        show: Called in every cycle.
        plan: The flight plan; the scenario's own by default.
        policy: Which orders the mission may give, and how the vehicle is handed over.
        name: The vehicle's.
        mailbox: Orders of people.
        log: The daemon's.
        notifier: For signs of life to systemd.
        signals: Of the operating system; None leaves them to the process.
        broadcast: Record for onlookers.

    Raises:
        ConfigError: If the scenario names what does not exist.
        FlightError: If the vehicle may not fly, or does not get ready.
        LinkError: If the world ends before the flight does.
    """
    heard = SensedEvader(world.evader_source, scenario.sensor, scenario.seed, clock.now_s)
    plan = plan_of(scenario=scenario) if plan is None else plan
    daemon = Daemon(
        name, plan, world.link, heard, mailbox=mailbox, log=log, notifier=notifier, record=record, broadcast=broadcast
    )
    mission = Mission(scenario, daemon, world, heard, policy, show=show)
    begun_s = time.perf_counter()
    run(daemon, world, clock, mission=mission, signals=signals, record=record)
    if world.player is not None:
        world.player.stop()
    mission.result.interrupted = not mission.left
    mission.result.wall_s = time.perf_counter() - begun_s
    return mission.result
