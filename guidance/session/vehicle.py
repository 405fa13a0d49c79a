"""A scenario flown by a vehicle that is not ours: the daemon of `guidance run`, supervised for one flight."""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, NoReturn

from rich.console import Console

from guidance.clock import MonotonicClock
from guidance.config import find
from guidance.errors import ConfigError
from guidance.flight import Event
from guidance.log.writer import started_utc, versions
from guidance.session.control_bus import ControlBus
from guidance.session.daemon import Daemon
from guidance.session.flown import outcome_of_flight
from guidance.session.fly import FlightResult, Progress
from guidance.session.gc_scheduler import GcScheduler
from guidance.session.handover import ORDER_OF
from guidance.session.log import Log
from guidance.session.loop import Signals, run
from guidance.session.metrics import Metrics
from guidance.session.notify import Notifier
from guidance.session.opening import Opened, open_all
from guidance.session.orders import Mailbox
from guidance.session.plan_fence import load_vehicle
from guidance.session.recording import RECORD, next_folder, recording
from guidance.session.spec import FlightPlan, plan_of
from guidance.session.supervisor import Supervisor
from guidance.session.vehicle_file import Config
from guidance.sim.evader_here import EvaderPlayer
from guidance.sim.outcome import Outcome
from guidance.sim.scenario import Scenario
from guidance.sim.sensed_evader import SensedEvader


class Reached(NamedTuple):
    """A vehicle and its evader as they were opened, and what is flown by there."""

    own: Config
    plan: FlightPlan
    opened: Opened
    clock: MonotonicClock


class Conduct(NamedTuple):
    """How a run is conducted; see `Supervisor`. Without an evader of ours the evader is somebody else's."""

    engage: bool
    on_terminate: Event
    evader: EvaderPlayer | None = None
    end_with: Event | None = None
    show: Callable[[Progress], None] = lambda _: None


def fly_vehicle(scenario: Scenario, config: Path, console: Console, *, out: Path | None, engage: bool) -> Outcome:
    """Fly a scenario with the vehicle of a configuration file; the evader is whatever its evader source reports.

    Preflight must pass. Without `engage` a person has to order `guidance ctl start` and `guidance ctl engage`. Ctrl-C
    hands the vehicle over as the file says (flight.on_terminate).

    Raises:
        ConfigError: If a file is wrong, or the two contradict each other.
        FlightError: If preflight refuses, or the start is outside of the fence.
        LinkError: If vehicle or evader cannot be reached.
    """
    own = load_vehicle(find(str(config), "vehicles"))
    plan = plan_of(own, scenario)
    folder = out if out is not None else next_folder(Path("flights"), own.name)
    if scenario.fault:
        console.print("faults are a mock's: the vehicle flies without them")
    clock, mailbox, signals = MonotonicClock(), Mailbox(), Signals()
    signals.install()
    with contextlib.ExitStack() as closing:
        control = ControlBus(
            own.name,
            mailbox,
            endpoint=own.control.endpoint,
            host=own.control.host,
            token_file=own.control.token_file,
        )
        closing.callback(control.close)
        opened = open_all(own, clock, tapped=True)
        closing.callback(opened.close)
        console.print(f"record   {folder / RECORD}", soft_wrap=True, highlight=False)
        if not engage:
            console.print("waiting for a person: `guidance ctl start`, then `guidance ctl engage`")
        conduct = Conduct(engage, ORDER_OF[own.flight.on_terminate])
        reached = Reached(own, plan, opened, clock)
        result = conducted(scenario, reached, conduct, folder, mailbox, signals)
    return outcome_of_flight(result, "vehicle")


def conducted(
    scenario: Scenario, reached: Reached, conduct: Conduct, folder: Path, mailbox: Mailbox, signals: Signals
) -> FlightResult:
    """Fly with what was opened, until the run is over or a signal ends it; the record is in the folder.

    Raises:
        FlightError: As the supervisor.
    """
    own, plan, opened, clock = reached
    metrics, tidying = Metrics(own.name), GcScheduler()
    metadata = {
        "scenario": scenario.model_dump_json(exclude_unset=True),
        "config": own.model_dump_json(),
        "seed": str(scenario.seed),
        **versions(),
        "started_utc": started_utc(clock.now_s()),
    }
    with contextlib.ExitStack() as closing:
        log = Log(own.log.format, own.log.level)
        closing.callback(log.close)
        record = closing.enter_context(recording(folder / RECORD, metadata, real_time=True))
        heard = SensedEvader(opened.evader, scenario.sensor, scenario.seed, clock.now_s)
        notifier = Notifier.from_environment(os.environ, os.getpid())
        closing.callback(notifier.close)
        daemon = Daemon(
            own.name,
            plan,
            opened.link,
            heard,
            mailbox=mailbox,
            log=log,
            metrics=metrics,
            notifier=notifier,
            record=record,
        )
        supervisor = Supervisor(scenario, daemon, mailbox, heard, **conduct._asdict())
        closing.callback(tidying.end)
        run(
            daemon,
            clock,
            signals=signals,
            metrics=metrics,
            on_terminate=conduct.on_terminate,
            load=_kept,
            drain=opened.drain,
            record=record,
            tidying=tidying,
            watch=supervisor.watch,
        )
    supervisor.result.interrupted = not supervisor.left
    return supervisor.result


def _kept() -> NoReturn:
    raise ConfigError("a scenario is flown: end it and begin again to fly another configuration")
