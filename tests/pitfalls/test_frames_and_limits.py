"""Pitfalls 10, 11, 13, 14, 15, 16, 17, 19, 25: frames, datums, heading, height, masks and bounds of what is sent."""

import dataclasses
import math

import pytest

from guidance.flight import Event, State
from guidance.messages import GlobalPosition, LocalPosition
from guidance.session.plan import plan_of
from sitl_mock.world import Home
from tests.harness.sortie import SHORT

pytestmark = pytest.mark.flight


VELOCITY_ONLY = {3527, 2503, 3079, 2055}
EVERY_AXIS_OF_POSITION = 0b111
EVERY_AXIS_OF_VELOCITY = 0b111000


def with_evader_at(scenario, x, y):
    return scenario.model_copy(
        update={"evader": scenario.evader.model_copy(update={"position_m": (x, y)})}
    )


@pytest.mark.parametrize(
    ("autopilot", "bearing", "offset"),
    [("px4", "east", (30.0, 0.0)), ("arducopter", "south", (0.0, -30.0))],
)
def test_10_the_velocity_points_at_the_evader_whatever_the_heading(
    sortie, autopilot, bearing, offset
):
    x, y, _ = SHORT.pursuer.position_m
    flight = sortie.engaged(
        autopilot, scenario=with_evader_at(SHORT, x + offset[0], y + offset[1])
    ).run(3.0)
    north, east, _ = flight.setpoints[-1].velocity
    along, across = (east, north) if bearing == "east" else (-north, east)
    assert along > 1.5
    assert abs(across) < 0.6
    assert flight.setpoints[-1].message.coordinate_frame == 1  # LOCAL_NED


def test_11_an_estimator_origin_that_is_not_home_changes_nothing(sortie, monkeypatch):
    moved = sortie("px4")
    site = SHORT.site
    elsewhere = Home(
        site.latitude_deg + 0.0027, site.longitude_deg - 0.004, site.altitude_amsl_m - 600.0
    )
    rebuild(moved, monkeypatch, origin=elsewhere)
    moved.engaged()
    local = moved.flight.vehicle.latest.get(LocalPosition)
    assert local.position_ned_m[2] < -600.0
    moved.until(State.ON_STATION, limit_s=30.0)
    heights = [
        output.certificate.pursuer_game_m[2]
        for output in moved.outputs
        if output.certificate is not None
    ]
    assert min(heights) > 4.0


def rebuild(flight, monkeypatch, **options):
    """Put another mock in the place of the pursuer's, before anything has flown."""
    from sitl_mock import MockVehicle

    site = flight.scenario.site
    x, y, _ = flight.scenario.pursuer.position_m
    mock = MockVehicle(
        flight.scenario.pursuer.autopilot,
        system_id=1,
        home=Home(site.latitude_deg, site.longitude_deg, site.altitude_amsl_m),
        start_ned=(y - 2.0, x, 0.0),
        ready_after_s=3.0,
        **options,
    )
    monkeypatch.setattr(flight.world.faulted["pursuer"], "step", mock.step)
    flight.mock = mock


@pytest.mark.parametrize(("autopilot", "ground_amsl_m"), [("px4", 200.0), ("arducopter", -20.0)])
def test_13_heights_are_above_the_evaders_plane_wherever_sea_level_is(
    sortie, autopilot, ground_amsl_m
):
    site = SHORT.site.model_copy(update={"altitude_amsl_m": ground_amsl_m})
    flight = sortie.engaged(autopilot, scenario=SHORT.model_copy(update={"site": site}))
    heard = flight.flight.vehicle.latest.get(GlobalPosition)
    assert heard.altitude_amsl_m == pytest.approx(ground_amsl_m + 12.0, abs=2.0)
    flight.until(State.ON_STATION, limit_s=30.0)
    truth = -flight.mock.truth.position_ned_m[2]
    assert truth == pytest.approx(5.0, abs=1.2)


@pytest.mark.parametrize(("autopilot", "yaw_deg"), [("px4", 90.0), ("arducopter", -135.0)])
def test_14_the_heading_at_engagement_is_held(sortie, autopilot, yaw_deg, monkeypatch):
    flight = sortie(autopilot)
    rebuild(flight, monkeypatch, yaw_deg=yaw_deg)
    flight.standing_by()
    heading = flight.flight.vehicle.yaw_rad
    flight.cycle(Event.ENGAGE)
    flight.until(State.ENGAGED).run(2.0)
    yaws = [sent.message.yaw for sent in flight.setpoints]
    assert all(math.isfinite(yaw) for yaw in yaws)
    drift = [abs(math.remainder(yaw - heading, math.tau)) for yaw in yaws]
    assert max(drift) < math.radians(3.0)
    assert not any(sent.message.type_mask & 0x400 for sent in flight.setpoints)


@pytest.mark.long
def test_15_a_hover_of_five_minutes_keeps_its_height(sortie, autopilot):
    flight = sortie.on_station(autopilot).run(5.0)
    start_m = flight.flight.vehicle.latest.get(LocalPosition).position_ned_m[2]
    worst_m = 0.0
    for _ in range(300):
        flight.run(1.0)
        worst_m = max(
            worst_m,
            abs(flight.flight.vehicle.latest.get(LocalPosition).position_ned_m[2] - start_m),
        )
    assert flight.state is State.ON_STATION
    assert worst_m <= 0.5


@pytest.mark.parametrize("autopilot", ["px4", pytest.param("arducopter", marks=pytest.mark.long)])
def test_16_masks_never_mix_a_position_into_velocities_by_accident(sortie, autopilot):
    flight = sortie.engaged(autopilot).run(5.0)
    masks = {sent.message.type_mask for sent in flight.setpoints}
    assert masks <= VELOCITY_ONLY
    for sent in flight.setpoints:
        assert sent.message.type_mask & EVERY_AXIS_OF_POSITION == EVERY_AXIS_OF_POSITION
        assert sent.message.type_mask & EVERY_AXIS_OF_VELOCITY == 0
        assert (sent.message.target_system, sent.message.target_component) == (1, 1)


@pytest.mark.parametrize("far_m", [1e3, 1e5])
def test_17_no_evader_however_far_yields_a_setpoint_beyond_the_envelope(
    sortie, autopilot, far_m, monkeypatch
):
    flight = sortie.engaged(autopilot)
    source = flight.world.evaders["pursuer"]["evader"]
    real = source.receive

    def thrown():
        return [
            report._replace(latitude_deg=report.latitude_deg + far_m / 111e3) for report in real()
        ]

    monkeypatch.setattr(source, "receive", thrown)
    flight.run(4.0)
    envelope = flight.flight.settings.cycle.envelope
    for sent in flight.setpoints:
        north, east, down = sent.velocity
        assert math.isfinite(north + east + down)
        assert math.hypot(north, east) <= envelope.speed_m_s + 1e-5
        assert -envelope.climb_m_s - 1e-5 <= down <= envelope.descent_m_s + 1e-5


@pytest.mark.parametrize("autopilot", ["px4", pytest.param("arducopter", marks=pytest.mark.long)])
def test_19_engaging_far_off_does_not_step_the_setpoint(sortie, autopilot):
    flight = sortie.standing_by(autopilot, scenario=with_evader_at(SHORT, 8.0, 200.0))
    flight.cycle(Event.ENGAGE)
    flight.until(State.ENGAGED).run(4.0)
    envelope = flight.flight.settings.cycle.envelope
    for a, b in zip(flight.setpoints[:-1], flight.setpoints[1:], strict=True):
        dt_s = b.now_s - a.now_s
        change = [after - before for after, before in zip(b.velocity, a.velocity, strict=True)]
        assert math.hypot(*change[:2]) <= envelope.acceleration_m_s2 * dt_s + 1e-5
        assert abs(change[2]) <= envelope.vertical_acceleration_m_s2 * dt_s + 1e-5
    north, east, down = flight.setpoints[0].velocity
    assert math.hypot(north, east, down) < 0.5


@pytest.mark.parametrize("autopilot", ["px4", pytest.param("arducopter", marks=pytest.mark.long)])
def test_25_an_evader_beyond_the_fence_is_pursued_only_to_the_fence(sortie, autopilot):
    far = with_evader_at(SHORT, 8.0, 60.0)
    far = far.model_copy(
        update={"pursuer": far.pursuer.model_copy(update={"autopilot": autopilot})}
    )
    settings = plan_of(scenario=far).flight
    envelope = dataclasses.replace(settings.cycle.envelope, fence_radius_m=30.0)
    fenced = settings.model_copy(
        update={"cycle": dataclasses.replace(settings.cycle, envelope=envelope)}
    )
    flight = sortie(autopilot, scenario=far, settings=fenced).engaged().run(15.0)
    position = flight.mock.truth.position_ned_m
    assert math.hypot(*position[:2]) <= 30.0
    assert math.hypot(*position[:2]) >= 24.0
    assert Event.FENCE not in flight.events
