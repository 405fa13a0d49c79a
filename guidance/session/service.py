"""From a vehicle file to an open link and evader sources, and `guidance run`: open everything, run, and close it again.

Importing this imports every wire library.
"""

import json
import logging
import os
import secrets
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, Final

from guidance.autopilots import Mode
from guidance.clock import MonotonicClock
from guidance.errors import ConfigError
from guidance.links.zenoh.team import ZenohTeam
from guidance.log.writer import Record, Recorder
from guidance.session.flight_files import flight_metadata
from guidance.session.fly.daemon import Daemon, Equipment
from guidance.session.fly.loop import Signals, claim, run
from guidance.session.fly.own_policy import asked_in_flight, require_pursuer
from guidance.session.observe.metrics import Metrics, MetricsServer
from guidance.session.observe.outputs import OutputOrder, open_outputs
from guidance.session.open.links import open_vehicle
from guidance.session.orders.mailbox import ORDER_OF
from guidance.session.plan import FlightPlan, plan_of
from guidance.session.vehicle_file import Config, load_vehicle
from guidance.team import Member

_FIXED: Final = (
    "name",
    "vehicle",
    "evader",
    "control",
    "zenoh",
    "log",
    "metrics",
    "record",
    "ros",
    "ground_station",
    "team",
)
"""Sections that are opened at the start: a change of these needs a restart."""


_COMES_DOWN: Final = frozenset({Mode.LAND, Mode.RETURN})
_TO_LAND: Final = "land it by radio or ground station, or run guidance again and order land"


def run_vehicle(path: Path, config: Config) -> bool:
    """Run the daemon of a vehicle file until it is ended; return whether Ctrl-C ended it.

    Args:
        path: Of the file, which SIGHUP reads again.
        config: Its content.

    Raises:
        GuidanceError: For everything that the user can fix.
    """
    plan = plan_of(config)
    require_pursuer(config.game.policy, with_target=config.game.target is not None)
    clock = MonotonicClock()
    metrics = Metrics(config.name)
    with ExitStack() as stack:
        hand_over = ORDER_OF[config.flight.on_terminate]
        signals = stack.enter_context(Signals(hand_over, lambda: reload(path, config)).installed())
        if config.metrics.port is not None:
            stack.enter_context(closing(MetricsServer(metrics, config.metrics.port)))
        world, session, equipment = open_vehicle(
            config, clock, stack, tapped=config.record.folder is not None
        )
        metadata = flight_metadata(None, config, clock)
        daemons = list[Daemon]()
        stack.callback(
            _say_ended, equipment, daemons
        )  # the last line: everything opened later closes first
        equipment.record_required = config.record.required
        equipment.record = stack.enter_context(daemon_recording(config, metadata, equipment))
        order = OutputOrder(
            vehicle=config.name,
            metadata=metadata,
            clock=clock,
            link=world.links[config.name],
            mailbox=equipment.mailbox,
            config=config,
            bus=session,
            ground_link=world.ground_links.get(config.name),
        )
        equipment.sinks += (metrics, *open_outputs(order, stack))
        if (team := config.team) is None:
            equipment.team = None
        else:
            transport = stack.enter_context(
                closing(ZenohTeam(clock.now_s, session, team.name, config.name, team.mates))
            )
            evaders = list(config.evaders)
            epoch = secrets.randbits(48)
            above_m = team.separation_height_m
            equipment.team = Member(
                config.name,
                team.mates,
                evaders,
                transport,
                epoch=epoch,
                separation_height_m=above_m,
            )
        equipment.ask = asked_in_flight(config.game.policy, clock, real_time=True)
        daemon = Daemon(
            config.name, plan, world.links[config.name], world.evaders[config.name], equipment
        )
        daemons.append(daemon)
        started = {
            "name": config.name,
            "control": config.control.endpoint,
            "autopilot": plan.flight.autopilot.name,
        }
        equipment.say(logging.INFO, "running", **started, scheduling=claim())
        run([daemon], world, clock, signals=signals)
        ended = {"ended": f"the daemon ended; {daemon.flight.state}"}
        daemon.recording.over(clock.now_s(), json.dumps(ended))
    return signals.interrupted


def _say_ended(equipment: Equipment, daemons: Sequence[Daemon]) -> None:
    """Log how the daemon leaves its vehicle; there is none if it was not heard."""
    for daemon in daemons:
        flight = daemon.flight
        fields: dict[str, Any] = {"state": flight.state, "mode": flight.mode_name}
        level = logging.INFO
        if flight.vehicle.armed and flight.mode_name in _COMES_DOWN:
            fields["vehicle"] = f"armed; its autopilot brings it down ({flight.mode_title})"
        elif flight.vehicle.armed:
            level = logging.WARNING
            fields["vehicle"] = f"STILL ARMED in {flight.mode_title}: {_TO_LAND}"
        equipment.say(level, "ended", **fields)


@contextmanager
def daemon_recording(
    config: Config, metadata: Mapping[str, str], equipment: Equipment
) -> Iterator[Record | None]:
    """Open the daemon's record. Preflight reports an unwritable one; a flight continues without it."""
    if config.record.folder is None:
        yield None
        return
    section = config.record
    stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
    path = config.record.folder / f"{config.name}-{stamp}-{os.getpid()}.mcap"
    size = round(section.rotate_mb * 1e6)
    try:
        recorder: Record = Recorder(
            path, metadata, threaded=True, rotate_s=section.rotate_s, rotate_bytes=size
        )
    except OSError as error:
        recorder = Record(
            f"record.folder = {str(section.folder)!r}: cannot be written ({error.strerror})"
        )
    try:
        yield recorder
    finally:
        recorder.close()
        if recorder.failed is not None or recorder.dropped:
            equipment.say(
                logging.WARNING,
                "the record is incomplete",
                failed=recorder.failed,
                dropped=recorder.dropped,
            )


def reload(path: Path, before: Config) -> FlightPlan:
    """Read the configuration again.

    Raises:
        ConfigError: If it is wrong, or a section has changed that was opened at the start.
    """
    after = load_vehicle(path)
    if changed := [key for key in _FIXED if getattr(after, key) != getattr(before, key)]:
        raise ConfigError(
            f"{path}: {', '.join(changed)} changed: end the daemon and start it again for that"
        )
    return plan_of(after)
