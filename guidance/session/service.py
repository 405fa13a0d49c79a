"""`guidance run`: open everything, run, and close everything again."""

import contextlib
import json
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

from guidance.clock import MonotonicClock
from guidance.config import find
from guidance.errors import ConfigError
from guidance.log.broadcast import Broadcast
from guidance.log.entries import FLIGHT_OVER
from guidance.session.answers import startup_answers
from guidance.session.daemon import Daemon, Equipment
from guidance.session.flight_files import daemon_recording, flight_metadata
from guidance.session.log import Log
from guidance.session.loop import Signals, run
from guidance.session.metrics import Metrics, MetricsServer
from guidance.session.orders import ORDER_OF, Mailbox
from guidance.session.plan import FlightPlan, plan_of
from guidance.session.process import Notifier, claim
from guidance.session.vehicle_file import Config, load_vehicle
from guidance.session.vehicle_world import EVADER, open_all, open_control

_FIXED: Final = ("name", "vehicle", "evader", "control", "zenoh", "log", "metrics", "record")
"""Sections that are opened at the start: a change of these needs a restart."""


def run_vehicle(name: str, on_config: Callable[[Config], None] = lambda _: None) -> None:
    """Run the daemon of a configuration until it is ended.

    Args:
        name: A path, or of a vehicle file that comes along.
        on_config: Called with the configuration before anything is opened.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    path = find(name, "vehicles")
    config = load_vehicle(path)
    plan = plan_of(config)
    on_config(config)
    clock, mailbox, metrics = MonotonicClock(), Mailbox(), Metrics(config.name)
    signals = Signals(ORDER_OF[config.flight.on_terminate], lambda: reload(path, config))
    with signals.installed(), contextlib.ExitStack() as closing:
        log = closing.enter_context(contextlib.closing(Log(config.log.format, config.log.level)))
        notifier = closing.enter_context(contextlib.closing(Notifier.from_environment(os.environ, os.getpid())))
        wanted = config.vehicle
        waiting_for = f"a HEARTBEAT of system {wanted.system_id}, component {wanted.component_id} at {wanted.url}"
        mailbox.meanwhile(startup_answers(config.name, waiting_for, wanted.connect_timeout_s, clock))
        control = closing.enter_context(contextlib.closing(open_control(config, mailbox)))
        if config.metrics.port is not None:
            closing.enter_context(contextlib.closing(MetricsServer(metrics, config.metrics.port)))
        log.say(
            logging.INFO,
            "waiting for a HEARTBEAT",
            name=config.name,
            url=wanted.url,
            system=wanted.system_id,
            component=wanted.component_id,
            at_most_s=wanted.connect_timeout_s,
        )
        world = open_all(config, clock, tapped=config.record.folder is not None)
        closing.callback(world.close)
        metadata = flight_metadata(None, config, clock)
        record = closing.enter_context(daemon_recording(config, metadata, log))
        broadcast = closing.enter_context(contextlib.closing(Broadcast(config.name, control.session, metadata)))
        used = Equipment(
            mailbox=mailbox,
            log=log,
            metrics=metrics,
            notifier=notifier,
            record=record,
            broadcast=broadcast,
            record_required=config.record.required,
            live=log.show,
        )
        daemon = Daemon(config.name, plan, world.links[config.name], world.evaders[config.name][EVADER], used)
        notifier.ready()
        log.say(
            logging.INFO,
            "running",
            name=config.name,
            control=config.control.endpoint,
            autopilot=plan.flight.autopilot.name,
            scheduling=claim(),
        )
        mailbox.meanwhile(None)
        run([daemon], world, clock, signals=signals)
        broadcast.event(clock.now_s(), FLIGHT_OVER, json.dumps({"ended": f"the daemon ended; {daemon.flight.state}"}))
        log.say(logging.INFO, "ended", state=daemon.flight.state, mode=daemon.flight.mode_name)


def reload(path: Path, before: Config) -> FlightPlan:
    """Read the configuration again.

    Raises:
        ConfigError: If it is wrong, or a section has changed that was opened at the start.
    """
    after = load_vehicle(path)
    changed = [key for key in _FIXED if getattr(after, key) != getattr(before, key)]
    if changed:
        raise ConfigError(f"{path}: {', '.join(changed)} changed: end the daemon and start it again for that")
    return plan_of(after)
