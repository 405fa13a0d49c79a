"""The sensor's reports; a flight that used a sensor replays bit for bit."""

import functools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.config import parse_document
from guidance.estimation import Observer, add_report, predict
from guidance.estimation.measurement import TrackSettings
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.log import compare
from guidance.messages import EvaderReport
from guidance.session.flight_files import recorded_settings
from guidance.session.fly.result import outcome_of_flight
from guidance.sim.scenario import Scenario, Sensor
from guidance.sim.sensor import Noise, SensedEvader, first_knowledge, receive_reports
from tests.harness.examples import drawn
from tests.harness.flights import Played, flown

HERE = LocalFrame(47.397742, 8.545594, Amsl(488.0))
PERIOD_S = 0.1


@functools.cache
def driven_to(at_s):
    latitude_deg, longitude_deg, _ = HERE.wgs84_from_ned(Ned((2.0 * at_s, 5.0, 0.0)))
    return latitude_deg, longitude_deg


class Source:
    """An evader that drives north at 2 m/s and reports ten times a second on a clock 50 s ahead."""

    def __init__(self):
        self.now_s = 0.0
        self.due = 0
        self.closed = False

    def receive(self):
        reports = []
        while self.due * PERIOD_S <= self.now_s + 1e-9:
            at_s = self.due * PERIOD_S
            report = EvaderReport(
                at_s,
                at_s + 50.0,
                "test",
                *driven_to(at_s),
                488.0,
                (2.0, 0.0, 0.0),
                math.nan,
                math.nan,
            )
            reports.append(report)
            self.due += 1
        return reports

    def counters(self):
        return {"reports": self.due}

    def close(self):
        self.closed = True


def heard(sensor, *, seconds=20.0, seed=3, engaged_s=0.0):
    """All reports that arrive, with the number of their cycle (20 ms)."""
    source = Source()
    now = [0.0]
    evader = SensedEvader(source, sensor, seed, lambda: now[0])
    came = []
    for cycle in range(round(seconds / 0.02)):
        now[0] = source.now_s = 0.02 * cycle
        if now[0] >= engaged_s:
            evader.engage(now[0])
        came += [(now[0], report) for report in evader.receive()]
    return came, evader


def places(came):
    return np.array(
        [
            HERE.ned_from_wgs84(r.latitude_deg, r.longitude_deg, Amsl(r.altitude_amsl_m))
            for _, r in came
        ]
    )


def test_a_perfect_sensor_and_a_game_that_has_not_begun_change_nothing():
    source = Source()
    source.now_s = 20.0
    everything = source.receive()
    assert [report for _, report in heard(Sensor(), seconds=20.02)[0]] == everything
    poor = Sensor(rate_hz=1.0, latency_s=1.0, position_noise_m=3.0, dropout=0.5)
    assert [report for _, report in heard(poor, seconds=20.02, engaged_s=99.0)[0]] == everything


def test_the_rate_counts_from_engagement_and_the_others_are_withheld():
    came, evader = heard(Sensor(rate_hz=1.0), engaged_s=2.3)
    after = [report.received_s for _, report in came if report.received_s >= 2.3 - 1e-9]
    assert after == pytest.approx([2.3 + k for k in range(18)])
    assert evader.counters() == {"reports": 200, "withheld": 177 - 18, "lost": 0}


def test_a_late_report_arrives_late_and_its_age_is_known():
    came, _ = heard(Sensor(latency_s=0.5))
    for now_s, report in came:
        assert report.received_s - (report.sent_s - 50.0) == pytest.approx(0.5)
        assert -1e-9 <= now_s - report.received_s < 0.02 + 1e-9
    observer = Observer()
    track = TrackSettings(declared_speed_m_s=2.0)
    for _, report in came:
        observer = add_report(observer, report, HERE, track)
    now_s, last = came[-1]
    seen = predict(observer.track.estimate, Ned((0.0, 0.0, 0.0)), now_s, track)
    assert seen.age_s == pytest.approx(0.5 + now_s - last.received_s, abs=1e-6)
    assert seen.position_ned_m[0] == pytest.approx(2.0 * now_s, abs=0.05)


def test_nothing_arrives_in_an_outage_after_engagement():
    came, _ = heard(Sensor(outages_s=((1.0, 3.0), (6.0, 7.5))), engaged_s=2.0)
    arrivals = np.array([report.received_s for _, report in came]) - 2.0
    inside = ((arrivals >= 1.0) & (arrivals < 3.0)) | ((arrivals >= 6.0) & (arrivals < 7.5))
    assert not inside.any()
    assert len(came) == 200 - 20 - 15


@settings(max_examples=drawn(6), deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.1, 0.3, 0.6]))
def test_the_share_of_lost_reports_is_the_dropout(seed, dropout):
    """Catches a dropout that loses another share of the reports."""
    came, evader = heard(Sensor(dropout=dropout), seconds=100.0, seed=seed)
    spread = math.sqrt(1000 * dropout * (1.0 - dropout))
    assert abs(evader.counters()["lost"] - 1000 * dropout) < 5.0 * spread
    assert len(came) + evader.counters()["lost"] == 1000


def test_noise_has_the_spread_asked_for_and_is_said_to_have_it():
    """Catches noise of another spread than the scenario says, or with a bias."""
    came, _ = heard(Sensor(position_noise_m=2.0, velocity_noise_m_s=0.5), seconds=100.0)
    true_north = np.array([2.0 * (report.sent_s - 50.0) for _, report in came])
    off = places(came)[:, :2] - np.stack([true_north, np.full_like(true_north, 5.0)], axis=-1)
    velocities = np.array([report.velocity_ned_m_s for _, report in came]) - (2.0, 0.0, 0.0)
    assert off.std(axis=0) == pytest.approx([2.0, 2.0], rel=0.1)
    assert np.abs(off.mean(axis=0)).max() < 0.2
    assert abs(np.corrcoef(off.T)[0, 1]) < 0.1
    assert velocities[:, :2].std(axis=0) == pytest.approx([0.5, 0.5], rel=0.1)
    assert not velocities[:, 2].any()
    assert came[0][1].position_sd_m > 2.0
    assert came[0][1].velocity_sd_m_s > 0.5


def test_the_same_seed_is_the_same_noise_and_another_is_another():
    sensor = Sensor(rate_hz=5.0, position_noise_m=1.0, dropout=0.2)
    first, again, other = (heard(sensor, seed=seed)[0] for seed in (1, 1, 2))
    assert first == again
    assert first != other


def test_mathematics_hears_the_same_reports_of_the_same_seed():
    """Catches reports of mathematics that differ from those in flight."""
    sensor = Sensor(
        rate_hz=2.0,
        position_noise_m=1.5,
        velocity_noise_m_s=0.3,
        dropout=0.4,
        outages_s=((4.0, 6.0),),
    )
    noise = Noise(np.array([3]), 1.5, 0.3, 0.4)
    known_of = first_knowledge(sensor, np.array([[5.0, 0.0, 0.0]]))
    told = []
    for cycle in range(1000):
        now = np.array([0.02 * cycle])
        before = known_of.measured_s[0]
        east_north = np.array([[5.0, 2.0 * now[0], 0.0]])
        receive_reports(sensor, noise, known_of, now, east_north, np.array([[0.0, 2.0, 0.0]]))
        if known_of.measured_s[0] != before or (cycle == 0 and known_of.position_m[0, 0] != 5.0):
            told.append([*known_of.position_m[0, :2], *known_of.velocity_m_s[0, :2]])
    came = heard(sensor, seed=3)[0]
    in_flight = [
        [place[1], place[0], report.velocity_ned_m_s[1], report.velocity_ned_m_s[0]]
        for place, (_, report) in zip(places(came), came, strict=True)
    ]
    assert len(told) == len(in_flight) > 10
    np.testing.assert_allclose(told, in_flight, atol=1e-5)  # metres by way of degrees


def test_closing_closes_the_source():
    source = Source()
    SensedEvader(source, Sensor(), 0, lambda: 0.0).close()
    assert source.closed


@pytest.mark.flight
@pytest.mark.usefixtures("soon_up_and_down")
@pytest.mark.parametrize(
    ("pursuer", "evader"),
    [
        (
            {"policy": "lead_pursuit"},
            {"policy": "recorded", "track": [(0, 0, 0, 0), (4, 6, 2, 0), (9, 6, 9, 0)]},
        ),
        pytest.param(
            {"policy": "proportional_navigation", "autopilot": "arducopter"},
            {"policy": "random_turns"},
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_flight_with_a_sensor_replays_bit_for_bit(pursuer, evader, tmp_path):
    chase = parse_document(
        Scenario,
        {
            "title": "a poor view",
            "game": "pe",
            "seed": 5,
            "time_limit_s": 8.0,
            "pursuer": {
                "position_m": (0, 0, 4.5),
                "speed_m_s": 3.0,
                "takeoff_height_m": 3.0,
                **pursuer,
            },
            "evader": {"position_m": (2.0, 14.0), "speed_m_s": 1.5, **evader},
            "standoff": {"height_m": 3.0},
            "limits": {"floor_m": 1.5},
            "sensor": {"rate_hz": 4.0, "latency_s": 0.3, "position_noise_m": 0.5, "dropout": 0.2},
        },
        source="test",
    )
    path = tmp_path / "record.mcap"
    outcome = outcome_of_flight(flown(chase, path, mission=Played), "fast")
    assert outcome.end in {"captured", "time_up"}
    assert outcome.game_time_s > 2.0
    comparison, _ = compare(path, recorded_settings)
    assert comparison.setpoints > 100
    assert comparison.differing == 0
