"""What `guidance run` does: open everything, run, and close everything again."""

import contextlib
import logging
import os
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

from guidance.clock import MonotonicClock
from guidance.config import find
from guidance.errors import ConfigError
from guidance.links.wires.zenoh_access import NO_CREDENTIALS, credentials_of
from guidance.log.broadcast import Broadcast
from guidance.log.provenance import versions
from guidance.log.record import BackgroundRecorder, NullRecorder
from guidance.log.writer import Recorder, started_utc
from guidance.session.answers import StartupResponder
from guidance.session.control_bus import ControlBus
from guidance.session.daemon import Daemon
from guidance.session.log import Log
from guidance.session.loop import Signals, run
from guidance.session.metrics import Metrics, MetricsServer
from guidance.session.orders import ORDER_OF, Mailbox
from guidance.session.process import Notifier, claim
from guidance.session.spec import FlightPlan, plan_of
from guidance.session.vehicle_file import Config, load_vehicle
from guidance.session.vehicle_world import open_all

_FIXED: Final = ("name", "vehicle", "evader", "control", "zenoh", "log", "metrics", "record")
"""Sections that are opened at the start: a change of these needs a restart."""


def run_vehicle(name: str, on_config: Callable[[Config], None] = lambda _: None) -> None:
    """Run the daemon of a configuration until it is ended.

    Args:
        name: A path, or of a vehicle file that comes along.
        on_config: Is told of the configuration before anything is opened.

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
        log = Log(config.log.format, config.log.level)
        closing.callback(log.close)
        notifier = Notifier.from_environment(os.environ, os.getpid())
        closing.callback(notifier.close)
        mailbox.meanwhile(StartupResponder(config, clock).answer)
        control = ControlBus(
            config.name,
            mailbox,
            endpoint=config.control.endpoint,
            host=config.control.host,
            token_file=config.control.token_file,
            credentials=credentials_of(config.zenoh) if config.control.by_tls else NO_CREDENTIALS,
        )
        closing.callback(control.close)
        if config.metrics.port is not None:
            closing.callback(MetricsServer(metrics, config.metrics.port).close)
        wanted = config.vehicle
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
        metadata = _metadata(config, clock)
        record = closing.enter_context(_recording(config, metadata, log))
        broadcast = Broadcast(config.name, control.session, metadata)
        closing.callback(broadcast.close)
        daemon = Daemon(
            config.name,
            plan,
            world.link,
            world.evader_source,
            mailbox=mailbox,
            log=log,
            metrics=metrics,
            notifier=notifier,
            record=record,
            broadcast=broadcast,
            record_required=config.record.required,
            live=log.show,
        )
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
        run(daemon, world, clock, signals=signals, record=record)
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


def _metadata(config: Config, clock: MonotonicClock) -> dict[str, str]:
    return {"config": config.model_dump_json(), **versions(), "started_utc": started_utc(clock.now_s())}


@contextlib.contextmanager
def _recording(
    config: Config, metadata: Mapping[str, str], log: Log
) -> Iterator[BackgroundRecorder | NullRecorder | None]:
    """Open the record. Of one that cannot be written preflight says so; a vehicle in flight is served without."""
    if config.record.folder is None:
        yield None
        return
    stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
    path = config.record.folder / f"{config.name}-{stamp}-{os.getpid()}.mcap"
    recorder: BackgroundRecorder | NullRecorder
    try:
        rotate_bytes = round(config.record.rotate_mb * 1e6)
        written = Recorder(path, metadata, rotate_s=config.record.rotate_s, rotate_bytes=rotate_bytes)
        recorder = BackgroundRecorder(written)
    except OSError as error:
        where = f"record.folder = {str(config.record.folder)!r}"
        recorder = NullRecorder(f"{where}: cannot be written ({error.strerror})")
    try:
        yield recorder
    finally:
        recorder.close()
        if recorder.failed is not None or recorder.dropped:
            log.say(logging.WARNING, "the record is incomplete", failed=recorder.failed, dropped=recorder.dropped)
