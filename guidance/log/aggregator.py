"""Reads the flights of one source cycle by cycle: the numbers of each cycle, and the places of both players."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from guidance.cycle import Certificate
from guidance.flight import BEFORE_FLIGHT, FlightSettings
from guidance.flight.tracking import Tracking
from guidance.frames import Amsl, Enu, Ned
from guidance.game.arrays import FloatArray
from guidance.log.entries import BEGINNINGS, CONFIG, RELOADED, CycleEntry, EventEntry, Item
from guidance.log.reader import row_of
from guidance.log.scene import fence_edges
from guidance.messages import Home, LocalPosition, Timesync
from guidance.vehicle import VehicleState, observe

SettingsOf = Callable[[Mapping[str, str]], FlightSettings]
"""Makes a flight's settings from a record's metadata (`guidance.session.flight_files.recorded_settings`)."""

_UNKNOWN: Final = Ned((math.nan, math.nan, math.nan))
_NOWHERE: Final = Enu((math.nan, math.nan, math.nan))


class Cycle(NamedTuple):
    """Numbers of one cycle: positions in the game frame (m), velocities NED (m/s), ages and times (s)."""

    now_s: float
    pursuer_m: Enu = _NOWHERE
    evader_m: Enu = _NOWHERE
    flown_ned_m_s: Ned = _UNKNOWN
    commanded_ned_m_s: Ned = _UNKNOWN
    desired_ned_m_s: Ned = _UNKNOWN
    gap_m: float = math.nan
    height_gap_m: float = math.nan
    value: float = math.nan
    meeting_time_s: float = math.nan
    time_needed_s: float = math.nan
    assured_distance_m: float = math.nan
    telemetry_age_s: float = math.nan
    evader_age_s: float = math.nan
    round_trip_s: float = math.nan
    late_s: float = math.nan
    worked_s: float = math.nan


_OF_THE_GAME: Final = tuple(name for name in Cycle._fields if name in Certificate._fields)
"""Numbers that the certificate has under the same name."""


class Aggregator:
    """Reads the flights of one source, and tracks both players over their cycles as the flight did.

    Args:
        settings_of: Makes settings from metadata.
        metadata: Of the first flight.
        source: Name for error messages.

    Attributes:
        settings: Of the present flight.
        cycle: Numbers of the last cycle.
        playing: In a team, the vehicle's evader.
        evaders_m: Last place of each evader in the game frame, by name; "" is the only one of a vehicle without a team.
        vehicle: Last known state of the vehicle.
        home_m: Home in the game frame; None until known.
        envelope: The limits of the flight. A fence given in degrees is included once home is known.

    Raises:
        ConfigError: If the metadata has no settings.
    """

    def __init__(self, settings_of: SettingsOf, metadata: Mapping[str, str], source: str) -> None:
        self._settings_of = settings_of
        self._source = Path(source)
        self.settings = settings_of(metadata)
        self._begin()

    def _begin(self) -> None:
        self._tracking = Tracking(self.settings)
        self.vehicle = VehicleState()
        self.cycle = Cycle(math.nan)
        self.envelope = self.settings.cycle.envelope
        self._evader_m = _NOWHERE
        self._report_s = math.nan
        self.playing: str | None = None
        self.evaders_m = dict[str, Enu]()
        self._home_ned_m: Ned | None = None
        self.home_m: Enu | None = None

    @property
    def fence_m(self) -> list[FloatArray]:
        """The fence's closed edges, (n, 3) each, at the height of home; none until home is known."""
        if self.home_m is None:
            return []
        return fence_edges(self.envelope, self.home_m)

    def take(self, item: Item) -> EventEntry | CycleEntry | None:
        """Take the next item and return it decoded; items other than cycles and events are ignored.

        Raises:
            ConfigError: If it cannot be decoded.
        """
        row = row_of(item, self._source)
        if isinstance(row, CycleEntry):
            self.cycle = self._numbers(row)
        elif row is not None:
            if row.event == RELOADED:
                self.settings = self._settings_of({CONFIG: row.detail})
                row = row._replace(detail="")
            if row.event in BEGINNINGS:
                self._begin()
        return row

    def _numbers(self, row: CycleEntry) -> Cycle:
        inputs = row.inputs
        self.vehicle = observe(self.vehicle, inputs.messages)
        # As the flight itself does
        if row.state not in BEFORE_FLIGHT and self.vehicle.latest.get(Home) is not None:
            self.vehicle = self.vehicle._replace(home_fixed=True)
        self._tracking.observe(self.vehicle, ())
        self.playing = self.playing if inputs.role is None else inputs.role.evader
        frame = self._tracking.game_frame
        local_frame = self._tracking.local_frame
        for report in inputs.reports:
            plays = self.playing in {None, report.evader}
            self._report_s = report.received_s if plays else self._report_s
            if local_frame is not None and frame is not None:
                amsl = Amsl(report.altitude_amsl_m)
                evader_game_m = frame.position_from_ned(
                    local_frame.ned_from_wgs84(report.latitude_deg, report.longitude_deg, amsl)
                )
                self._evader_m = evader_game_m if plays else self._evader_m
                name = "" if report.evader is None else report.evader
                self.evaders_m[name] = evader_game_m
        # Home, and a fence in degrees about it, move with the frame.
        home_ned_m = self._tracking.home_ned_m
        if home_ned_m is not None and frame is not None and local_frame is not None:
            if home_ned_m != self._home_ned_m:
                self.home_m = frame.position_from_ned(home_ned_m)
                limits = self.settings.limits
                self.envelope = limits.about_home(self.envelope, home_ned_m, local_frame)
            self._home_ned_m = home_ned_m
        local = self.vehicle.latest.get(LocalPosition)
        setpoint = row.setpoint
        certificate = row.certificate
        columns: dict[str, Any] = {
            "evader_m": self._evader_m,
            "evader_age_s": row.now_s - self._report_s,
        }
        trips = [
            message.received_s - message.local_ns * 1e-9
            for message in inputs.messages
            if isinstance(message, Timesync)
        ]
        columns["round_trip_s"] = next((trip for trip in trips if 0.0 <= trip < 10.0), math.nan)
        if row.timing is not None:
            columns |= row.timing._asdict()
        if local is not None:
            columns |= {
                "flown_ned_m_s": local.velocity_ned_m_s,
                "telemetry_age_s": self.vehicle.age_s(LocalPosition, row.now_s),
            }
            columns["pursuer_m"] = (
                _UNKNOWN if frame is None else frame.position_from_ned(local.position_ned_m)
            )
        if setpoint is not None:
            columns["commanded_ned_m_s"] = setpoint.velocity_ned_m_s
        if certificate is not None:
            columns |= {name: getattr(certificate, name) for name in _OF_THE_GAME}
            columns["evader_m"] = certificate.evader_game_m
        return Cycle(row.now_s, **columns)
