"""`guidance run`: open everything, run, and close everything again."""

import contextlib
import json
import logging
import os
import secrets
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from guidance.clock import Clock, MonotonicClock
from guidance.errors import ConfigError
from guidance.links.zenoh_team import ZenohTeam
from guidance.log.broadcast import Broadcast
from guidance.log.entries import FLIGHT_OVER
from guidance.session.answers import startup_answers
from guidance.session.control_bus import ControlBus
from guidance.session.daemon import Daemon, Equipment
from guidance.session.flight_files import daemon_recording, flight_metadata
from guidance.session.log import Log
from guidance.session.loop import Signals, run
from guidance.session.metrics import Metrics, MetricsServer
from guidance.session.orders import ORDER_OF, Mailbox
from guidance.session.plan import FlightPlan, plan_of
from guidance.session.process import Notifier, claim
from guidance.session.vehicle_file import Config, load_vehicle
from guidance.session.vehicle_world import VehicleWorld, open_all, open_control
from guidance.team import Member

_FIXED: Final = ("name", "vehicle", "evader", "control", "zenoh", "log", "metrics", "record", "team")
"""Sections that are opened at the start: a change of these needs a restart."""


@contextlib.contextmanager
def opened_vehicle(
    config: Config, clock: Clock, *, tapped: bool
) -> Iterator[tuple[VehicleWorld, ControlBus, Equipment]]:
    """Open all that a vehicle file names, and wait until the vehicle was heard; orders are answered meanwhile.

    Args:
        config: The vehicle file.
        clock: The process's.
        tapped: Whether raw frames are passed on.

    Yields:
        Its world, where its orders arrive, and a daemon's equipment with mailbox, log and notifier.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    mailbox, wanted = Mailbox(), config.vehicle
    with contextlib.ExitStack() as closing:
        log = closing.enter_context(contextlib.closing(Log(config.log.format, config.log.level)))
        notifier = closing.enter_context(contextlib.closing(Notifier.from_environment(os.environ, os.getpid())))
        waiting_for = f"a HEARTBEAT of system {wanted.system_id}, component {wanted.component_id} at {wanted.url}"
        mailbox.meanwhile(startup_answers(config.name, waiting_for, wanted.connect_timeout_s, clock))
        control = closing.enter_context(contextlib.closing(open_control(config, mailbox)))
        fields = {"url": wanted.url, "system": wanted.system_id, "component": wanted.component_id}
        log.say(logging.INFO, "waiting for a HEARTBEAT", name=config.name, **fields, at_most_s=wanted.connect_timeout_s)
        world = closing.enter_context(contextlib.closing(open_all(config, clock, tapped=tapped)))
        yield world, control, Equipment(mailbox=mailbox, log=log, notifier=notifier)


def run_vehicle(path: Path, config: Config) -> None:
    """Run the daemon of a vehicle file until it is ended.

    Args:
        path: Of the file, which SIGHUP reads again.
        config: Its content.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    plan = plan_of(config)
    clock, metrics = MonotonicClock(), Metrics(config.name)
    signals = Signals(ORDER_OF[config.flight.on_terminate], lambda: reload(path, config))
    with signals.installed(), contextlib.ExitStack() as closing:
        if config.metrics.port is not None:
            closing.enter_context(contextlib.closing(MetricsServer(metrics, config.metrics.port)))
        tapped = config.record.folder is not None
        world, control, used = closing.enter_context(opened_vehicle(config, clock, tapped=tapped))
        metadata = flight_metadata(None, config, clock)
        record = closing.enter_context(daemon_recording(config, metadata, used.log))
        broadcast = closing.enter_context(contextlib.closing(Broadcast(config.name, control.session, metadata)))
        used = replace(used, metrics=metrics, record=record, broadcast=broadcast, live=used.log.show)
        used = replace(used, record_required=config.record.required, team=_member(config, control, clock, closing))
        daemon = Daemon(config.name, plan, world.links[config.name], world.evaders[config.name], used)
        used.notifier.ready()
        started = {"name": config.name, "control": config.control.endpoint, "autopilot": plan.flight.autopilot.name}
        used.log.say(logging.INFO, "running", **started, scheduling=claim())
        used.mailbox.meanwhile(None)
        run([daemon], world, clock, signals=signals)
        broadcast.event(clock.now_s(), FLIGHT_OVER, json.dumps({"ended": f"the daemon ended; {daemon.flight.state}"}))
        used.log.say(logging.INFO, "ended", state=daemon.flight.state, mode=daemon.flight.mode_name)


def _member(config: Config, control: ControlBus, clock: Clock, closing: contextlib.ExitStack) -> Member | None:
    """Join the team of a vehicle file, if it has one."""
    if config.team is None:
        return None
    team, mates = config.team, config.team.mates
    transport = ZenohTeam(clock.now_s, control.session, team.name, config.name, mates)
    closing.callback(transport.close)
    return Member(
        config.name,
        mates,
        list(config.evaders),
        transport,
        epoch=secrets.randbits(48),
        separation_height_m=team.separation_height_m,
    )


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
