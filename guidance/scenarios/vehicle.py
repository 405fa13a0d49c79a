"""`guidance scenario run FILE --as vehicle`: a scenario flown by a real vehicle, against a real target."""

import contextlib
import os
from pathlib import Path
from typing import NoReturn

from rich.console import Console

from guidance.config import find
from guidance.errors import ConfigError
from guidance.scenarios.command import next_folder, recording
from guidance.scenarios.flown import outcome_of_flight
from guidance.scenarios.impaired import ImpairedTarget
from guidance.scenarios.model import Scenario
from guidance.scenarios.outcome import Outcome
from guidance.scenarios.supervisor import Supervisor
from guidance.scenarios.vehicle_settings import vehicle_config, vehicle_flight
from guidance.service.bus import ControlBus
from guidance.service.clock import MonotonicClock
from guidance.service.daemon import Daemon, Plan
from guidance.service.leaving import ORDER_OF
from guidance.service.log import Log
from guidance.service.loop import Signals, run
from guidance.service.mailbox import Mailbox
from guidance.service.metrics import Metrics
from guidance.service.notify import Notifier
from guidance.service.opening import open_all
from guidance.service.plan_fence import load_vehicle
from guidance.service.record import started_utc, versions
from guidance.service.settings import wants
from guidance.service.tidying import Tidying


def fly_vehicle(scenario: Scenario, config: Path, console: Console, *, out: Path | None, engage: bool) -> Outcome:
    """Fly a scenario with the vehicle of a configuration file; the evader is whatever its target source reports.

    Preflight must pass. Without `engage` a person has to order `guidance ctl start` and `guidance ctl engage`. Ctrl-C
    hands the vehicle over as the file says (flight.on_terminate).

    Raises:
        ConfigError: If a file is wrong, or the two contradict each other.
        FlightError: If preflight refuses, or the start is outside of the fence.
        LinkError: If vehicle or target cannot be reached.
    """
    own = load_vehicle(find(str(config), "vehicles"))
    merged, flight = vehicle_config(scenario, own), vehicle_flight(scenario, own)
    plan = Plan(flight=flight, wants=wants(merged), document=merged.model_dump_json())
    folder = out if out is not None else next_folder(Path("flights"), own.name)
    if scenario.fault:
        console.print("faults are a mock's: the vehicle flies without them")
    clock, mailbox, metrics, signals, tidying = MonotonicClock(), Mailbox(), Metrics(own.name), Signals(), Tidying()
    signals.install()
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
        record = closing.enter_context(recording(folder / "record.mcap", metadata, real_time=True))
        console.print(f"record   {folder / 'record.mcap'}", soft_wrap=True, highlight=False)
        if not engage:
            console.print("waiting for a person: `guidance ctl start`, then `guidance ctl engage`")
        target = ImpairedTarget(opened.target, scenario.sensor, scenario.seed, clock.now_s)
        notifier = Notifier.from_environment(os.environ, os.getpid())
        closing.callback(notifier.close)
        daemon = Daemon(
            own.name,
            plan,
            opened.link,
            target,
            mailbox=mailbox,
            log=log,
            metrics=metrics,
            notifier=notifier,
            record=record,
        )
        on_terminate = ORDER_OF[own.flight.on_terminate]
        supervisor = Supervisor(scenario, daemon, mailbox, target, engage=engage, on_terminate=on_terminate)
        closing.callback(tidying.end)
        run(
            daemon,
            clock,
            signals=signals,
            metrics=metrics,
            on_terminate=on_terminate,
            load=_kept,
            drain=opened.drain,
            record=record,
            tidying=tidying,
            watch=supervisor.watch,
        )
    return outcome_of_flight(supervisor.result, "vehicle")


def _kept() -> NoReturn:
    raise ConfigError("a scenario is flown: end it and begin again to fly another configuration")
