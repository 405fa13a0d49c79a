"""Flies one acceptance case: starts the service as a user does and checks the results that pass through the relay."""

import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from typer.testing import CliRunner

from guidance.autopilots import Mode
from guidance.control.limits import CATCH_UP_RATIO
from guidance.session.flight_files import RECORD
from tests.acceptance.cases import Case, toml
from tests.acceptance.promised import farthest_m, promises
from tests.acceptance.relay import Relay, wait

GUIDANCE = Path(sys.executable).parent / "guidance"
ENGAGED_WITHIN_S = 150.0
FLOWN_WITHIN_S = 420.0
MEDDLED_AFTER_S = 3.0
YIELDED_WITHIN_S = 2.5
SILENT_WITHIN_S = 1.0
ENGAGED_AFTER_ORDER_S = 1.7
HELD_S = 30.0
KEPT_S = 5.0
MODE_WITHIN_S = 3.0
LEFT_WITHIN_S = 3.0
LANDED_WITHIN_S = 120.0
STOPPED_WITHIN_S = 8.0
_STILL_M_S = 0.6
_UNSAFE = {"px4": ("GF_MAX_VER_DIST", 0.0), "arducopter": ("GUID_TIMEOUT", 5.0)}
"""A parameter and a value that preflight refuses, by autopilot."""


class Line(NamedTuple):
    """One line of the table; `held` is None if the machine was too busy to tell."""

    autopilot: str
    flight: str
    link: str
    wanted: str
    got: str
    held: bool | None


@dataclass
class Flown:
    """A flight's process, its printed lines with their times, and its outcome row."""

    process: subprocess.Popen[str]
    folder: Path
    environment: dict[str, str]
    speed_m_s: float
    said: list[tuple[float, str]] = field(default_factory=list)

    def read(self) -> None:
        """Store the printed lines; runs in its own thread."""
        if self.process.stdout is not None:
            for line in self.process.stdout:
                self.said.append((time.monotonic(), line.rstrip()))

    def at_s(self, words: str) -> float | None:
        """Return the time of the first line that ends with these words, ignoring a reason after a colon."""
        return next(
            (at_s for at_s, line in self.said if line.partition(": ")[0].endswith(words)), None
        )

    def order(self, word: str) -> bool:
        """Give an order as an operator does; return whether it was accepted."""
        told = [line.split()[-1] for _, line in self.said if line.startswith("orders ")]
        endpoint = ("--endpoint", told[-1]) if told else ()
        command = [GUIDANCE, "ctl", word, *endpoint]
        done = subprocess.run(
            [*map(str, command)],
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=20,
            check=False,
        )
        self.said.append((time.monotonic(), f"ctl {word}: {(done.stdout + done.stderr).strip()}"))
        return done.returncode == 0

    def row(self) -> dict[str, object]:
        """Return the outcome row; empty if there is none."""
        return outcome(self.folder, self.speed_m_s)

    def last_words(self) -> str:
        """Return the last printed lines."""
        return " ".join(line.strip() for _, line in self.said[-2:])[-160:]


def outcome(folder: Path, speed_m_s: float) -> dict[str, object]:
    """Return a flight's outcome row with what its record shows of the promises; empty if there is none."""
    path = folder / "outcome.json"
    if not path.is_file():
        return {}
    limit_m_s = CATCH_UP_RATIO * speed_m_s
    return json.loads(path.read_text()) | promises(
        folder / RECORD, speed_m_s=speed_m_s, limit_m_s=limit_m_s
    )


def guidance_here(words: Sequence[str]) -> str:
    """Run the command `guidance` in this process; return what it printed, or its error."""
    from guidance.cli.program import app

    done = CliRunner().invoke(app, words)
    return done.output if done.exception is None else f"{done.output}{done.exception}"


def fly_in_virtual_time(
    case: Case, autopilot: str, folder: Path, process: Executor, *, drawn: bool
) -> list[Line]:
    """Fly one case in virtual time; return its lines of the table.

    Args:
        case: The case.
        autopilot: Of the mock.
        folder: For its files.
        process: Runs the command in a process that keeps what it has imported.
        drawn: Whether a picture is drawn, which takes two seconds.
    """
    pursuer = {**case.scenario["pursuer"], "autopilot": autopilot}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scenario.toml").write_text(
        toml({**case.scenario, "pursuer": pursuer}), encoding="utf-8"
    )
    way = ("fly", "--fast") if drawn else ("scenario", "run", "--as", "fast")
    words = [*way, str(folder / "scenario.toml"), "--out", str(folder)]
    said = process.submit(guidance_here, words).result(FLOWN_WITHIN_S)
    row = outcome(folder, pursuer["speed_m_s"])
    if not row:
        return [
            Line(
                autopilot,
                case.name,
                "virtual time",
                "a flight",
                said[-160:],
                held=False,
            )
        ]
    got = [(one.words, one.got(row), one.held(one.got(row))) for one in case.wanted]
    if case.fence_m is not None:
        out_m = farthest_m(folder / RECORD)
        got.append((_within(case.fence_m), f"{out_m:.1f} m", out_m <= case.fence_m))
    return [
        Line(autopilot, case.name, "virtual time", words, _words(value), held)
        for words, value, held in got
    ]


@contextmanager
def started(case: Case, relay: Relay, folder: Path, *, end: str) -> Iterator[Flown]:
    """Start `guidance fly` on a case; kill it when the block ends."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "outcome.json").unlink(missing_ok=True)  # of an earlier run into the same folder
    (folder / "scenario.toml").write_text(toml(case.scenario), encoding="utf-8")
    command = [
        GUIDANCE,
        "fly",
        folder / "scenario.toml",
        *relay.options,
        *(() if relay.mode_url else ("--link", case.link)),
    ]
    # Each flight has its own folder for token and socket: vehicles in other network namespaces use the same endpoint.
    (folder / "runtime").mkdir(exist_ok=True)
    runtime = {"XDG_RUNTIME_DIR": str(folder / "runtime")}
    environment = {**os.environ, **runtime, "COLUMNS": "200", "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(
        [*map(str, command), "--end", end, "--out", str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environment,
    )
    flown = Flown(process, folder, environment, case.scenario["pursuer"]["speed_m_s"])
    reader = threading.Thread(target=flown.read, daemon=True)
    reader.start()
    try:
        yield flown
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()
        reader.join(5.0)
        (folder / "said.txt").write_text(
            "\n".join(line for _, line in flown.said) + "\n", encoding="utf-8"
        )


def fly(case: Case, relay: Relay, folder: Path, *, end: str) -> list[Line]:
    """Fly one case; return its lines of the table."""

    def line(wanted: str, got: object, *, held: bool) -> Line:
        link = case.link if relay.mode_url is None else "zenoh"
        return Line(relay.profile.name, case.name, link, wanted, _words(got), held)

    if case.meddling == "refuse":
        return _refused(case, relay, folder, line)
    with started(case, relay, folder, end=end) as flown:
        if case.meddling:
            engaged = wait(
                lambda: flown.at_s("engaged") is not None or _over(flown), ENGAGED_WITHIN_S
            )
            if not engaged or flown.at_s("engaged") is None:
                return [line("engaged", flown.last_words(), held=False)]
            time.sleep(MEDDLED_AFTER_S)
            return list(MEDDLING[case.meddling](case, relay, flown, line))
        wait(lambda: _over(flown), FLOWN_WITHIN_S)
    row = flown.row()
    if not row:
        return [line("a flight", flown.last_words(), held=False)]
    lines = [line(one.words, one.got(row), held=one.held(one.got(row))) for one in case.wanted]
    if case.prompt:
        ordered_s = flown.at_s("standing by")
        engaged_s = flown.at_s("engaged")
        took_s = math.inf if ordered_s is None or engaged_s is None else engaged_s - ordered_s
        words = f"engaged ≤ {ENGAGED_AFTER_ORDER_S:g} s after the order"
        lines.append(line(words, f"{took_s:.2f} s", held=took_s <= ENGAGED_AFTER_ORDER_S))
    if case.fence_m is not None:
        out_m = _farthest_m(relay, flown)
        lines.append(
            line(
                _within(case.fence_m),
                f"{out_m:.1f} m",
                held=out_m <= case.fence_m,
            )
        )
    down = bool(relay.seen.beats) and not relay.armed
    lines.append(line("disarmed at the end", "disarmed" if down else "armed", held=down))
    return lines


def _over(flown: Flown) -> bool:
    return flown.process.poll() is not None


def _pilot(case, relay, flown, line):
    at_s = time.monotonic()
    relay.switch(Mode.HOLD)
    wait(lambda: flown.at_s("yielded") is not None or _over(flown), YIELDED_WITHIN_S + 2.0)
    yielded_s = flown.at_s("yielded")
    wait(lambda: _over(flown), 20.0)
    row = flown.row()
    took_s = math.inf if yielded_s is None else yielded_s - at_s
    yield line(
        f"yielded within {YIELDED_WITHIN_S:g} s", f"{took_s:.1f} s", held=took_s <= YIELDED_WITHIN_S
    )
    after = sum(setpoint > (yielded_s or at_s) + 0.1 for setpoint in relay.seen.setpoints_s)
    yield line("silent from then on", f"{after} setpoints", held=after == 0)
    mode = relay.mode()
    last_s = max(relay.seen.setpoints_s, default=at_s) - at_s
    yield line(
        f"silent ≤ {SILENT_WITHIN_S:g} s after the switch",
        f"{last_s:.2f} s",
        held=last_s <= SILENT_WITHIN_S,
    )
    yield line("the pilot's mode stays", str(mode), held=mode is Mode.HOLD)
    for one in case.wanted:
        yield line(one.words, one.got(row), held=one.held(one.got(row)))


def _held(case, relay, flown, line):
    """Order HOLD during the game, then LAND. Neither the mission nor a time limit may end the hold."""
    accepted = flown.order("hold")
    at_s = time.monotonic()
    yield line("HOLD accepted", "accepted" if accepted else flown.last_words(), held=accepted)
    held = wait(lambda: relay.mode() is Mode.HOLD, MODE_WITHIN_S)
    yield line(f"in its hold within {MODE_WITHIN_S:g} s", str(relay.mode()), held=held)
    silent_s = time.monotonic()
    left = wait(
        lambda: relay.mode() is not Mode.HOLD or _over(flown), at_s + HELD_S - time.monotonic()
    )
    kept_s = time.monotonic() - at_s
    yield line(f"held for {HELD_S:g} s", f"{relay.mode()} after {kept_s:.1f} s", held=not left)
    after = sum(setpoint > silent_s + 0.5 for setpoint in relay.seen.setpoints_s)
    yield line("silent while held", f"{after} setpoints", held=after == 0)
    said = any("held by operator" in words for _, words in flown.said)
    yield line("the terminal says so", "held by operator" if said else "not said", held=said)
    yield from _landed(relay, flown, line)


def _interrupted(case, relay, flown, line):
    """Interrupt LAND and RETURN with HOLD, and LAND with RETURN, as if a person stood below the vehicle."""
    for order, mode, kept_s in (
        ("land", Mode.LAND, 1.0),
        ("hold", Mode.HOLD, KEPT_S),
        ("return", Mode.RETURN, 1.0),
        ("hold", Mode.HOLD, KEPT_S),
        ("land", Mode.LAND, 1.0),
        ("return", Mode.RETURN, 1.0),
    ):
        before = relay.mode()
        accepted = flown.order(order)
        there = accepted and wait(lambda mode=mode: relay.mode() is mode, MODE_WITHIN_S)
        kept = there and not wait(lambda mode=mode: relay.mode() is not mode, kept_s)
        got = f"{relay.mode()}" if accepted else flown.last_words()
        yield line(f"{order.upper()} in {before}, kept {kept_s:g} s", got, held=kept)
    yield from _landed(relay, flown, line)


def _landed(relay, flown, line):
    accepted = flown.order("land")
    yield line("LAND accepted", "accepted" if accepted else flown.last_words(), held=accepted)
    down = wait(lambda: not relay.armed, LANDED_WITHIN_S)
    yield line("landed and disarmed", "disarmed" if down else "armed", held=down)
    wait(lambda: _over(flown), 20.0)


def _killed(case, relay, flown, line):
    flown.process.send_signal(signal.SIGKILL)
    at_s = time.monotonic()
    if relay.profile.name == "px4":
        wait(lambda: relay.mode() is not Mode.GUIDED, LEFT_WITHIN_S + 1.0)
        took_s = time.monotonic() - at_s
        left = relay.mode() is not Mode.GUIDED
        got = f"{relay.mode()} after {took_s:.1f} s"
        yield line(
            f"PX4 leaves {'OFFBOARD' if relay.mode_url is None else 'the mode'} within {LEFT_WITHIN_S:g} s",
            got,
            held=left and took_s <= LEFT_WITHIN_S,
        )
    else:

        def still() -> bool:
            return relay.seen.positions[-1][2] < _STILL_M_S

        fast_m_s = relay.seen.positions[-1][2]
        stopped = wait(still, STOPPED_WITHIN_S)
        took_s = time.monotonic() - at_s
        got = f"from {fast_m_s:.1f} m/s to a stop in {took_s:.1f} s, in {relay.mode()}"
        yield line(f"ArduCopter stops within {STOPPED_WITHIN_S:g} s", got, held=stopped)
    last_s = max(relay.seen.setpoints_s, default=-math.inf)
    late_s = last_s - at_s
    yield line("no setpoint after", f"last {max(0.0, late_s):.2f} s after", held=late_s < 0.1)


MEDDLING = {"pilot": _pilot, "kill": _killed, "hold": _held, "interrupt": _interrupted}


def _refused(case, relay, folder, line):
    name, unsafe = _UNSAFE[relay.profile.name]
    before = relay.set(name, unsafe)
    if before is None:
        return [line("a parameter can be set", f"{name} not answered", held=False)]
    try:
        with started(case, relay, folder, end="land") as flown:
            wait(lambda: _over(flown), 60.0)
            code = flown.process.poll()
            words = " ".join(text for _, text in flown.said)
    finally:
        relay.set(name, before)
    armed = any(armed for _, _, armed in relay.seen.beats)
    return [
        line("exit code 4", code, held=code == 4),
        line(
            f"refused for {name}",
            "named" if name in words else flown.last_words(),
            held=name in words,
        ),
        line(
            "what to do is said",
            "guidance check" if "--apply" in words else "",
            held="--apply" in words,
        ),
        line("nothing armed", "armed" if armed else "disarmed", held=not armed),
        line("no setpoint", f"{len(relay.seen.setpoints_s)}", held=not relay.seen.setpoints_s),
    ]


def _within(fence_m: float) -> str:
    return f"within the fence of {fence_m:g} m"


def _farthest_m(relay: Relay, flown: Flown) -> float:
    """Return the largest horizontal distance from the first position until the game was over, m."""
    begin = relay.seen.positions[0][1]
    over_s = next(
        (at_s for at_s, text in flown.said if text.endswith(("returning", "landing"))), math.inf
    )
    return max(
        math.dist(place[:2], begin[:2]) for at_s, place, _ in relay.seen.positions if at_s < over_s
    )


def _words(got: object) -> str:
    return f"{got:.3f}" if isinstance(got, float) else str(got)
