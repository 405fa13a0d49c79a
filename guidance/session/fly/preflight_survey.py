"""Preflight in a daemon: reads the vehicle's parameters and fence on the ground, and judges them twice a second."""

import logging
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Final

from guidance.autopilots import Finding, Verdict, Wants
from guidance.flight import BEFORE_FLIGHT, FINAL, Flight, Inputs
from guidance.links.port import TellsProblem, VehicleLink
from guidance.preflight import PreflightMemory, parameter_names, refusals, rows
from guidance.session.observe.recording import Recording
from guidance.session.orders.answers import missing

PREFLIGHT_EVERY_S: Final = 0.5


class PreflightSurvey:
    """Judges one vehicle before it flies.

    Args:
        link: The vehicle's; it reads parameters and fence.
        recording: Its outputs are judged too, and log why the vehicle is not ready.

    Attributes:
        memory: Parameters and fence as read.
        wants: The accepted values; None judges nothing.
        judges: Whether preflight judges the vehicle before it flies.
        rows: The findings, as last judged.
    """

    def __init__(self, link: VehicleLink, recording: Recording) -> None:
        self._link = link
        self._recording = recording
        self._refused: tuple[str, ...] = ()

    def begin(self, flight: Flight, wants: Wants | None) -> None:
        """Survey the vehicle anew, for another flight."""
        self._flight = flight
        self.wants = wants
        self.judges = wants is not None
        announces = wants is not None and wants.announces
        names = partial(parameter_names, announces=announces)
        self.memory = PreflightMemory(flight.settings.autopilot, names)
        self.rows: tuple[Finding, ...] = ()
        self._judged_s = float("-inf")

    @property
    def barred(self) -> tuple[str, ...]:
        """Names of the rows that preflight refuses; before its first verdict, preflight itself."""
        if not self.judges or not self._applies:
            return ()
        if not self.rows:
            return ("preflight",)
        return refusals(self.rows)

    @property
    def _applies(self) -> bool:
        """True on the ground, and for a vehicle found armed until it has passed once."""
        state = self._flight.state
        in_flight = state not in FINAL | BEFORE_FLIGHT
        return state in BEFORE_FLIGHT or (in_flight and not self._flight.checked)

    def renew(self, fresh_rows: Sequence[Finding]) -> None:
        """Take the findings of parameters that were read again."""
        fresh = {row.name: row for row in fresh_rows}
        self.rows = tuple(fresh.get(row.name, row) for row in self.rows)

    def step(
        self, now_s: float, inputs: Inputs, source_problems: Iterable[str], *, engaging: bool
    ) -> None:
        """Read and judge parameters and fence on the ground, and read them again before the game begins.

        Args:
            now_s: The present.
            inputs: Of this cycle.
            source_problems: Why evaders' sources cannot deliver reports yet, empty where they can.
            engaging: Whether an engage order waits for parameters.
        """
        reading = engaging or self.memory.reading_fence
        if self.wants is None or not (self._applies or reading):
            return
        self.memory.observe(inputs.messages, inputs.reports)
        for request in self.memory.requests(now_s):
            self._link.request(request)
        if not self._applies or now_s - self._judged_s < PREFLIGHT_EVERY_S:
            return
        self._judged_s = now_s
        flight = self._flight
        facts = self.memory.facts(flight.vehicle, now_s, flight.observed.other_beat)
        sources = [
            Finding("evader's source", problem, "answers", Verdict.WARN, "guidance tries again")
            for problem in source_problems
            if problem
        ]
        # Problems of the vehicle's link.
        link_rows = []
        problem = self._link.problem() if isinstance(self._link, TellsProblem) else ""
        if problem:
            link_rows.append(
                Finding("link", problem, "no problem", Verdict.REFUSE, "guidance tries again")
            )
        unsaved = self._link.counters().get("used_unsaved", 0)
        if unsaved:
            words = f"{unsaved} frames were used whose timestamps are not on disk"
            remedy = "after a crash they can be replayed: make $STATE_DIRECTORY or ~/.local/state writable"
            link_rows.append(Finding("signing", words, "on disk", Verdict.WARN, remedy))
        self.rows = (
            *rows(facts, flight.settings.autopilot, self.wants),
            *self._recording.rows(),
            *sources,
            *link_rows,
        )
        refused = refusals(self.rows)
        if refused != self._refused and self.memory.settled(now_s):
            self._refused = refused
            if refused:
                lacking = missing(flight, now_s, self.rows)
                self._recording.say(logging.WARNING, "not ready", missing=lacking)
