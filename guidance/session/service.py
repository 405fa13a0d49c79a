"""`guidance run`: open everything, run, and close everything again."""

import json
import logging
import os
import secrets
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Final

from guidance.clock import Clock, MonotonicClock
from guidance.errors import ConfigError
from guidance.links.world import World
from guidance.links.zenoh_team import ZenohTeam
from guidance.links.zenoh_wire import Session
from guidance.log.broadcast import Broadcast
from guidance.log.entries import FLIGHT_OVER
from guidance.session.daemon import Daemon, Equipment
from guidance.session.flight_files import daemon_recording, flight_metadata
from guidance.session.log import Log
from guidance.session.loop import Signals, run
from guidance.session.metrics import Metrics, MetricsServer
from guidance.session.orders import ORDER_OF, Mailbox, startup_answers
from guidance.session.plan import FlightPlan, plan_of
from guidance.session.process import Notifier, claim
from guidance.session.vehicle_file import Config, load_vehicle
from guidance.session.vehicle_world import open_all, open_control
from guidance.team import Member

_FIXED: Final = ("name", "vehicle", "evader", "control", "zenoh", "log", "metrics", "record", "team")
"""Sections that are opened at the start: a change of these needs a restart."""


@contextmanager
def opened_equipment(mailbox: Mailbox, config: Config) -> Iterator[Equipment]:
    """Open the log according to a vehicle file, and signs of life to systemd."""
    with (
        closing(Log(config.log.format, config.log.level)) as log,
        closing(Notifier(os.environ, os.getpid())) as notifier,
    ):
        yield Equipment(mailbox=mailbox, log=log, notifier=notifier)


@contextmanager
def opened_vehicle(config: Config, clock: Clock, *, tapped: bool) -> Iterator[tuple[World, Session, Equipment]]:
    """Open all that a vehicle file names, and wait until the vehicle was heard; orders are answered meanwhile.

    Args:
        config: The vehicle file.
        clock: The process's.
        tapped: Whether raw frames are passed on.

    Yields:
        Its world, the Zenoh session of its orders, and a daemon's equipment with mailbox, log and notifier.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    mailbox, wanted, limit_s = Mailbox(), config.vehicle, config.vehicle.connect_timeout_s
    mailbox.meanwhile = startup_answers(config.name, wanted.awaited, limit_s, clock)
    with opened_equipment(mailbox, config) as used, open_control(config, mailbox) as session:
        fields = {"url": wanted.url, "system": wanted.system_id, "component": wanted.component_id}
        used.log.say(logging.INFO, "waiting for a HEARTBEAT", name=config.name, **fields, at_most_s=limit_s)
        with closing(open_all(config, clock, tapped=tapped)) as world:
            yield world, session, used


def run_vehicle(path: Path, config: Config) -> None:
    """Run the daemon of a vehicle file until it is ended.

    Args:
        path: Of the file, which SIGHUP reads again.
        config: Its content.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    plan, clock, metrics = plan_of(config), MonotonicClock(), Metrics(config.name)
    signals = Signals(ORDER_OF[config.flight.on_terminate], lambda: reload(path, config))
    with (
        signals.installed(),
        nullcontext() if config.metrics.port is None else closing(MetricsServer(metrics, config.metrics.port)),
        opened_vehicle(config, clock, tapped=config.record.folder is not None) as (world, session, opened),
        daemon_recording(config, flight_metadata(None, config, clock), opened.log) as record,
        closing(Broadcast(config.name, session, flight_metadata(None, config, clock))) as broadcast,
        _member(config, session, clock) as team,
    ):
        name, required = config.name, config.record.required
        used = replace(opened, metrics=metrics, record=record, broadcast=broadcast, record_required=required, team=team)
        daemon = Daemon(name, plan, world.links[name], world.evaders[name], used)
        used.notifier.ready()
        started = {"name": name, "control": config.control.endpoint, "autopilot": plan.flight.autopilot.name}
        used.log.say(logging.INFO, "running", **started, scheduling=claim())
        used.mailbox.meanwhile = None
        run([daemon], world, clock, signals=signals)
        broadcast.event(clock.now_s(), FLIGHT_OVER, json.dumps({"ended": f"the daemon ended; {daemon.flight.state}"}))
        used.log.say(logging.INFO, "ended", state=daemon.flight.state, mode=daemon.flight.mode_name)


@contextmanager
def _member(config: Config, session: Session, clock: Clock) -> Iterator[Member | None]:
    """Join the team of a vehicle file, if it has one."""
    if config.team is None:
        yield None
        return
    team, mates, epoch = config.team, config.team.mates, secrets.randbits(48)
    with closing(ZenohTeam(clock.now_s, session, team.name, config.name, mates)) as transport:
        evaders, above_m = list(config.evaders), team.separation_height_m
        yield Member(config.name, mates, evaders, transport, epoch=epoch, separation_height_m=above_m)


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
