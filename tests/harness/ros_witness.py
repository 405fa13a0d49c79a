"""Compares ROS messages of a flight with its record. It computes what they must hold without `guidance.log.ros`.

Positions in `map` are compared with the certificate's, which are in the game frame.
"""

import math
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d
import pytest

from guidance.log import cycles_of
from guidance.messages import Attitude, GlobalPosition, LocalPosition

NAME = "pursuer"


def stamp_ns(header: Any) -> int:
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def vector(part: Any) -> tuple[float, float, float]:
    return (part.x, part.y, part.z)


class Witness:
    """The cycles of a record by their time.

    Args:
        path: The record.
        started_ns: Unix time of the zero of its clock.
        name: The vehicle's name in ROS.
    """

    def __init__(self, path: Path, started_ns: int = 0, name: str = NAME) -> None:
        self.name = name
        self.cycles: dict[int, Any] = {}
        self.heard: dict[int, dict[type, Any]] = {}
        self.alarms: dict[int, int] = {}
        self.compared = Counter[str]()
        latest: dict[type, Any] = {}
        alarms = 0
        for entry in cycles_of(path):
            latest = latest | {type(message): message for message in entry.inputs.messages}
            alarms += entry.alarm is not None
            time_ns = started_ns + round(entry.now_s * 1e9)
            self.cycles[time_ns] = entry
            self.heard[time_ns] = latest
            self.alarms[time_ns] = alarms
        self._times = np.array(list(self.cycles))

    def at(self, time_ns: int) -> int:
        """Return the time of the cycle that has this stamp, to a microsecond."""
        nearest = int(self._times[np.abs(self._times - time_ns).argmin()])
        assert abs(nearest - time_ns) < 1000
        return nearest

    def compare(self, messages: Iterable[tuple[str, Any]]) -> Counter[str]:
        """Compare messages with their topics; return how many of each topic were."""
        checks = {
            f"/{self.name}/odometry": self.odometry,
            f"/{self.name}/evader/odometry": self.evader,
            f"/{self.name}/setpoint": self.setpoint,
            f"/{self.name}/markers": self.markers,
            f"/{self.name}/path": self.path,
            "/tf": self.transforms,
            "/diagnostics": self.diagnostics,
        }
        for topic, message in messages:
            checks[topic](message)
            self.compared[topic] += 1
        return self.compared

    def odometry(self, message: Any) -> None:
        assert message.header.frame_id == "map"
        assert message.child_frame_id == f"{self.name}/base_link"
        time_ns = self.at(stamp_ns(message.header))
        certificate = self.cycles[time_ns].certificate
        heard = self.heard[time_ns]
        if certificate is not None:
            place_m = vector(message.pose.pose.position)
            assert place_m == pytest.approx(certificate.pursuer_game_m, abs=1e-6)
        turn = message.pose.pose.orientation
        yaw_rad = 2.0 * math.atan2(turn.z, turn.w)
        nose_ned_rad = heard[Attitude].yaw_rad
        assert math.sin(yaw_rad) == pytest.approx(math.cos(nose_ned_rad), abs=1e-9)
        assert math.cos(yaw_rad) == pytest.approx(math.sin(nose_ned_rad), abs=1e-9)
        forward, left, up = vector(message.twist.twist.linear)
        north, east, down = heard[LocalPosition].velocity_ned_m_s
        flown = complex(forward, left) * complex(math.cos(yaw_rad), math.sin(yaw_rad))
        assert (flown.real, flown.imag, up) == pytest.approx((east, north, -down), abs=1e-6)

    def evader(self, message: Any) -> None:
        assert message.header.frame_id == "map"
        assert message.child_frame_id == f"{self.name}/evader"
        certificate = self.cycles[self.at(stamp_ns(message.header))].certificate
        if certificate is not None:
            place_m = vector(message.pose.pose.position)
            assert place_m == pytest.approx(certificate.evader_game_m, abs=1e-6)

    def setpoint(self, message: Any) -> None:
        assert message.header.frame_id == "map"
        setpoint = self.cycles[self.at(stamp_ns(message.header))].setpoint
        north, east, down = setpoint.velocity_ned_m_s
        assert vector(message.twist.linear) == pytest.approx((east, north, -down), abs=1e-6)

    def markers(self, message: Any) -> None:
        by_name = {marker.ns: marker for marker in message.markers}
        disc = by_name[f"{self.name}/standoff"]
        assert disc.header.frame_id == "map"
        certificate = self.cycles[self.at(stamp_ns(disc.header))].certificate
        evader_m = certificate.evader_game_m
        pursuer_m = certificate.pursuer_game_m
        corners = np.array([vector(point) for point in disc.points])
        assert corners[0] == pytest.approx(corners[-1])
        radius_m = np.hypot(*(corners[:, :2] - evader_m[:2]).T)
        gap_m = math.dist(pursuer_m[:2], evader_m[:2]) - radius_m
        assert gap_m == pytest.approx(certificate.gap_m, abs=1e-6)
        assert pursuer_m[2] - corners[:, 2] == pytest.approx(certificate.height_gap_m, abs=1e-6)
        if certificate.no_game:
            assert set(by_name) == {f"{self.name}/standoff"}
            return
        meeting = by_name[f"{self.name}/meeting_point"].pose.position
        assert vector(meeting) == pytest.approx(certificate.meeting_point_game_m, abs=1e-6)
        isochron = by_name.get(f"{self.name}/isochron")
        if isochron is None:
            return
        self.compared["isochron"] += 1
        curve = np.array([vector(point) for point in isochron.points])
        step_m = np.linalg.norm(np.diff(curve, axis=0), axis=-1).max()
        apart_m = np.hypot(*(curve[:, :2] - certificate.meeting_point_game_m[:2]).T).min()
        assert apart_m <= step_m

    def path(self, message: Any) -> None:
        for pose in message.poses:
            assert pose.header.frame_id == message.header.frame_id == "map"
            certificate = self.cycles[self.at(stamp_ns(pose.header))].certificate
            if certificate is not None:
                place_m = vector(pose.pose.position)
                assert place_m == pytest.approx(certificate.pursuer_game_m, abs=1e-6)

    def transforms(self, message: Any) -> None:
        moves = {frame.child_frame_id: frame for frame in message.transforms}
        time_ns = self.at(stamp_ns(message.transforms[0].header))
        entry = self.cycles[time_ns]
        odom = moves[f"{self.name}/odom"]
        base = moves[f"{self.name}/base_link"]
        assert (odom.header.frame_id, base.header.frame_id) == ("map", f"{self.name}/odom")
        if entry.certificate is not None:
            place_m = np.add(vector(odom.transform.translation), vector(base.transform.translation))
            assert place_m == pytest.approx(entry.certificate.pursuer_game_m, abs=1e-6)
        earth = moves.get("map")
        if earth is not None:
            self._earth(earth, odom, base, self.heard[time_ns][GlobalPosition])

    def _earth(self, earth: Any, odom: Any, base: Any, reported: GlobalPosition) -> None:
        """The vehicle's place on Earth through all frames is the one that it reports."""
        assert earth.header.frame_id == "earth"
        turn = earth.transform.rotation
        axis = np.array([turn.x, turn.y, turn.z])
        place_m = np.add(vector(odom.transform.translation), vector(base.transform.translation))
        crossed = np.cross(axis, place_m)
        turned_m = place_m + 2.0 * (turn.w * crossed + np.cross(axis, crossed))
        latitude_deg, longitude_deg, height_m = pymap3d.ecef2geodetic(
            *(turned_m + vector(earth.transform.translation))
        )
        east_north_up_m = pymap3d.geodetic2enu(
            latitude_deg,
            longitude_deg,
            height_m,
            reported.latitude_deg,
            reported.longitude_deg,
            reported.altitude_amsl_m,
        )
        # Autopilots take the Earth for a sphere: up to 0.5 % of the distance; the two reports differ in time
        assert np.linalg.norm(east_north_up_m) < 0.5 + 0.01 * np.linalg.norm(place_m)

    def diagnostics(self, message: Any) -> None:
        time_ns = self.at(stamp_ns(message.header))
        entry = self.cycles[time_ns]
        flight, game, alarms = message.status
        assert [part.name for part in message.status] == [
            f"{self.name}: flight",
            f"{self.name}: certificate",
            f"{self.name}: alarms",
        ]
        assert flight.message == str(entry.state)
        values = {pair.key: pair.value for pair in game.values}
        assert bool(values) == (entry.certificate is not None)
        if entry.certificate is not None:
            assert float(values["value"]) == pytest.approx(
                entry.certificate.value, abs=1e-3, nan_ok=True
            )
            assert values["captured"] == str(entry.certificate.captured).lower()
        counted = {pair.key: pair.value for pair in alarms.values}
        assert int(counted["count"]) == self.alarms[time_ns]
        if entry.alarm is not None:
            assert alarms.message == entry.alarm.words
            assert alarms.level in {1, b"\x01"}
