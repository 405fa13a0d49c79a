"""Vehicle files: refused files and their messages, and the result of accepted files."""

import json
import math
from pathlib import Path

import pytest

from guidance.config import config_folder, find, load, parse_document
from guidance.errors import ConfigError
from guidance.flight import EngageOn, State
from guidance.flight.settings import AfterCapture
from guidance.game import Ball, Cylinder
from guidance.messages import Datum
from guidance.session.plan import plan_of
from guidance.session.service import reload
from guidance.session.vehicle_file import Config, load_vehicle

TRIANGLE = [[47.397, 8.545], [47.399, 8.545], [47.399, 8.548]]
ZENOH = "zenoh://127.0.0.1:7447/uav1"
FRAME = {"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_amsl_m": 488.0}


@pytest.fixture
def read(vehicle_document):
    return lambda **sections: parse_document(
        Config, vehicle_document(**sections), source="file.toml"
    )


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"nmae": "uav1"}, "nmae: unknown key; did you mean 'name'?"),
        ({"name": "two words"}, "name = 'two words'"),
        ({"vehicle": {"autopilot": "betaflight"}}, "vehicle.autopilot = 'betaflight': must be one of px4, arducopter"),
        ({"vehicle": {"link": "pigeon"}}, "vehicle.link = 'pigeon': must be one of mavsdk, pymavlink, zenoh"),
        ({"vehicle": {"url": "udp://:14540"}}, "vehicle.url = 'udp://:14540': udp:// does not say who calls"),
        ({"vehicle": {"url": "udpin://:14540"}}, "vehicle.url = 'udpin://:14540': a host and a port are needed"),
        ({"vehicle": {"url": "ttyACM0"}}, "vehicle.url = 'ttyACM0': allowed are udpin://host:port, "),
        ({"evader": {"url": "tcp://h:1"}}, "evader.url = 'tcp://h:1': tcp:// does not say who calls whom"),
        (
            {"evader": {"kind": "json", "url": "udpin://127.0.0.1:14560"}},
            "evader.url = 'udpin://127.0.0.1:14560': kind = \"json\" arrives over Zenoh: must be zenoh://host:port/key",
        ),
        ({"evader": {"kind": "ros_pose", "url": "zenoh://127.0.0.1:7447"}}, "must be zenoh://host:port/key"),
        ({"vehicle": {"system_id": 0}}, "vehicle.system_id = 0: must be greater than or equal to 1"),
        ({"vehicle": {"speed": 5.0}}, "vehicle.speed: unknown key; allowed here: announce, autopilot"),
        ({"vehicle": {"link": "mavsdk", "signing_key_file": "key"}}, 'link = "mavsdk" does not sign; use "pymavlink"'),
        ({"vehicle": {"connect_timeout_s": 0.0}}, "vehicle.connect_timeout_s = 0.0"),
        ({"evader": {"kind": "radar"}}, "evader.kind = 'radar'"),
        ({"evader": {"system_id": None}}, "evader.system_id: missing"),
        ({"evader": {"kind": "json", "url": None}}, "evader.url: missing"),
        ({"evader": {"kind": "ros_pose", "url": ZENOH}}, "evader.frame: missing"),
        ({"evader": {"kind": "adsb"}}, "evader.icao_address: missing"),
        ({"evader": {"frame": {"undulation_m": 47.5}}}, "evader.frame.undulation_m = 47.5: not allowed"),
        (
            {"evader": {"kind": "follow_target", "altitude_datum": "ellipsoid"}},
            "evader.frame.undulation_m: missing",
        ),
        ({"evader": {"kind": "open_drone_id"}}, "evader.frame.undulation_m: missing"),
        ({"evader": {"frame": FRAME}}, "evader.frame.altitude_amsl_m: not allowed"),
        ({"evader": {"icao_address": 5}}, "evader.icao_address: not allowed"),
        ({"evader": {"frame_id": "map"}}, "evader.frame_id: not allowed"),
        ({"evader": {"kind": "json", "url": ZENOH}}, "evader.system_id: not allowed"),
        (
            {"preflight": {"evader_height_limit_m": 8.0}, "game": {"standoff_height_m": 8.0}},
            "preflight.evader_height_limit_m = 8: must be below game.standoff_height_m = 8",
        ),
        ({"evader": {"timeout_s": 0.0}}, "evader.timeout_s = 0.0"),
        ({"evader": {"kind": "json", "url": ZENOH, "request_rate_hz": 5.0}}, "evader.request_rate_hz: not allowed"),
        ({"evader": {"id_or_mac": "xyz"}}, "evader.id_or_mac = 'xyz'"),
        ({"game": {"speed_m_s": 3.0}}, "a slower pursuer is another game"),
        ({"game": {"speed_m_s": math.inf}}, "game.speed_m_s = inf: must be a finite number"),
        ({"game": {"speed_set": "cube"}}, "game.speed_set = 'cube'"),
        ({"game": {"kind": "tad"}}, "game.target: missing"),
        ({"game": {"target": {"latitude_deg": 47.0, "longitude_deg": 8.0}}}, 'not allowed with kind = "pe"'),
        ({"game": {"kind": "tad", "target": {"latitude_deg": 97.0, "longitude_deg": 8.0}}}, "latitude_deg = 97.0"),
        ({"game": {"standoff_height_m": 2.0}}, "game.standoff_height_m = 2: allowed is limits.floor_m = 3"),
        ({"limits": {"floor_m": 60.0}}, "limits.floor_m = 60: must be below limits.ceiling_m"),
        ({"limits": {"fence_radius_m": None}}, "every flight needs a fence"),
        ({"limits": {"fence_polygon_deg": [[47.0, 8.0], [47.001, 8.0]]}}, "fence_polygon has 2 corners"),
        ({"limits": {"fence_polygon_deg": []}}, "limits.fence_polygon_deg has 0 corners"),
        ({"limits": {"fence_polygon_deg": [[47.0, 8.0], [47.0, 8.0], [47.001, 8.0]]}}, "is shorter than 0.01 m"),
        ({"limits": {"fence_polygon_deg": [[47.0, 8.0], [47.1, 8.5], [8.0, 47.0]]}}, "and longitude exchanged?"),
        ({"limits": {"fence_polygon_deg": [[147.0, 8.0], [47.0, 8.0], [47.1, 8.0]]}}, "fence_polygon_deg.0.0 = 147.0"),
        ({"limits": {"fence_polygon_deg": TRIANGLE, "fence_plan_file": "a"}}, "fence_plan_file: only one polygon"),
        ({"flight": {"takeoff_height_m": 90.0}}, "flight.takeoff_height_m = 90"),
        ({"flight": {"takeoff_height_m": 3.0}}, "must be 1 m above limits.floor_m = 3 at least"),
        ({"flight": {"reserve": {"endurance_s": 0.0}}}, "flight.reserve.endurance_s = 0.0"),
        ({"flight": {"reserve": {"endurance_s": 600.0, "wind_m_s": 6.0}}}, "cannot fly home against the wind"),
        ({"flight": {"after_capture": "celebrate"}}, "flight.after_capture = 'celebrate'"),
        ({"flight": {"engage_on": "boot"}}, "flight.engage_on = 'boot'"),
        ({"flight": {"on_terminate": "fall"}}, "flight.on_terminate = 'fall'"),
        ({"flight": {"longest_chase_s": 0.0}}, "flight.longest_chase_s = 0.0"),
        ({"flight": {"battery_minimum": 20.0}}, "flight.battery_minimum = 20.0"),
        ({"preflight": {"loss_time_limit_s": 60.0}}, "preflight.loss_time_limit_s = 60.0"),
        ({"control": {"endpoint": "tcp/0.0.0.0:7448"}}, "must be on loopback"),
        ({"control": {"endpoint": "tcp/192.168.1.9:7448"}}, "whoever can reach it commands the vehicle"),
        ({"metrics": {"port": 70000}}, "metrics.port = 70000"),
        ({"log": {"format": "xml"}}, "log.format = 'xml'"),
        ({"target": {"kind": "global_position", "system_id": 2}}, "target: was renamed to evader"),
        ({"game": {"guarded": {"latitude_deg": 47.0, "longitude_deg": 8.0}}}, "was renamed to game.target"),
        ({"preflight": {"target_height_limit_m": 9.0}}, "was renamed to preflight.evader_height_limit_m"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_refused_with_key_value_and_what_is_allowed(read, sections, words):
    with pytest.raises(ConfigError) as refused:
        read(**sections)
    assert words in str(refused.value)
    assert str(refused.value).startswith("file.toml:\n")


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"game": {"policy": "hope"}}, "game.policy = 'hope': must be one of"),
        ({"limits": {"fence_polygon_ne_m": [[0, 0], [9, 9]]}}, "fence_polygon has 2 corners"),
        ({"limits": {"fence_margin_m": 100.0}}, "fence_margin_m = 100.0"),
    ],
)
def test_what_only_the_core_can_judge_is_refused_as_well(read, sections, words):
    with pytest.raises(ConfigError, match=words.replace("(", r"\(")):
        plan_of(read(**sections))


@pytest.mark.parametrize(
    "endpoint", ["tcp/127.0.0.1:7448", "tcp/[::1]:7448", "unixsock-stream//run/guidance.sock"]
)
def test_loopback_endpoints_are_allowed(read, endpoint):
    assert read(control={"endpoint": endpoint}).control.endpoint == endpoint


@pytest.mark.parametrize("name", ["px4", "arducopter"])
def test_the_vehicle_files_that_come_along_can_be_flown(name):
    config = load(Config, find(name, "vehicles"))
    settings = plan_of(config).flight
    assert settings.autopilot.name == name == config.name
    assert isinstance(settings.cycle.game.pursuer, Cylinder)
    assert settings.engage_on is EngageOn.COMMAND
    assert config.preflight.fence_required
    assert (
        find(f"config/vehicles/{name}.toml", "vehicles").resolve()
        == find(name, "vehicles").resolve()
    )


def test_every_vehicle_file_is_tested():
    assert {path.stem for path in (config_folder() / "vehicles").glob("*.toml")} == {
        "px4",
        "arducopter",
    }


def test_defaults_are_the_safe_ones(read):
    config = read()
    assert config.preflight.fence_required
    assert config.control.endpoint.startswith("tcp/127.0.0.1:")
    assert (config.flight.engage_on, config.flight.after_capture, config.flight.on_terminate) == (
        "command", "hold", "hold",
    )  # fmt: skip
    assert config.metrics.port is None
    assert config.game.speed_set == "cylinder"


def test_the_limits_follow_the_game_and_bind_outside_of_it(read):
    config = read(game={"climb_m_s": 2.5, "descent_m_s": 1.2})
    envelope = plan_of(config).flight.cycle.envelope
    assert envelope.speed_m_s == pytest.approx(1.1 * config.game.speed_m_s)
    assert (envelope.climb_m_s, envelope.descent_m_s) == pytest.approx((2.75, 1.32))
    assert envelope.stand_off.radius_m < config.game.standoff_radius_m
    assert envelope.stand_off.height_m < config.game.standoff_height_m
    assert plan_of(config).wants.limit_speeds.speed_m_s == envelope.speed_m_s


def test_speed_limits_are_keys_of_their_own_and_the_games_speeds_stay(read):
    config = read(
        game={"speed_m_s": 6.0, "descent_m_s": 1.5}, limits={"speed_m_s": 6.0, "descent_m_s": 1.5}
    )
    envelope = plan_of(config).flight.cycle.envelope
    speeds = plan_of(config).flight.cycle.game.pursuer
    assert (
        (envelope.speed_m_s, envelope.descent_m_s)
        == (6.0, 1.5)
        == (speeds.horizontal_m_s, speeds.descent_m_s)
    )
    assert envelope.climb_m_s == pytest.approx(1.1 * speeds.climb_m_s)


@pytest.mark.parametrize("key", ["speed_m_s", "climb_m_s", "descent_m_s"])
def test_a_speed_limit_below_the_games_speed_names_both_keys(read, key):
    with pytest.raises(ConfigError, match=rf"limits.{key} = 0.5: must be at least game.{key} = "):
        read(limits={key: 0.5})


def test_a_target_polygon_in_degrees_has_its_zero_in_the_middle_of_the_corners(read):
    corners = [[47.0, 8.0], [47.0, 8.001], [47.001, 8.001], [47.001, 8.0]]
    target = {"polygon_deg": corners, "radius_m": 2.0}
    cycle = plan_of(read(game={"kind": "tad", "target": target})).flight.cycle
    assert cycle.site[:2] == pytest.approx((47.0005, 8.0005))
    extent = cycle.game.target_extent
    assert extent.radius_m == 2.0
    assert sorted(round(y) for _, y in extent.corners_m) == [-56, -56, 56, 56]
    assert sorted(round(x) for x, _ in extent.corners_m) == [-38, -38, 38, 38]


def test_the_target_is_the_zero_of_the_game(read):
    place = {"latitude_deg": 47.4, "longitude_deg": 8.55, "altitude_amsl_m": 480.0}
    ball = {"speed_set": "ball", "climb_m_s": 6.0, "descent_m_s": 6.0}
    cycle = plan_of(read(game={"kind": "tad", "target": place, **ball})).flight.cycle
    assert cycle.target_game_m == (0.0, 0.0, 0.0)
    assert cycle.site[:2] == (47.4, 8.55)
    assert cycle.game.pursuer == Ball(6.0)


def test_a_daemon_waits_for_its_vehicle_as_long_as_it_takes(read):
    limits_s = plan_of(read()).flight.limits_s
    assert State.CONNECTING not in limits_s
    assert State.CHECKING not in limits_s
    assert limits_s[State.ARMING] > 0.0


@pytest.mark.parametrize("choice", AfterCapture)
def test_what_follows_a_capture_is_configured(read, choice):
    assert plan_of(read(flight={"after_capture": str(choice)})).flight.after_capture is choice


def test_a_chase_may_last_for_ever_unless_the_file_says_otherwise(read):
    assert plan_of(read()).flight.longest_chase_s is None
    assert plan_of(read(flight={"longest_chase_s": 120.0})).flight.longest_chase_s == 120.0


def test_a_polygon_alone_fences_as_far_as_its_farthest_corner(read):
    square = [[-30.0, -40.0], [-30.0, 40.0], [30.0, 40.0], [30.0, -40.0]]
    config = read(limits={"fence_radius_m": None, "fence_polygon_ne_m": square})
    assert config.limits.reach_m == pytest.approx(50.0)
    assert plan_of(config).wants.limits.reach_m == pytest.approx(50.0)
    envelope = plan_of(config).flight.cycle.envelope
    assert envelope.fence_radius_m is None
    assert envelope.fence_polygon.contains((0.0, 39.0))
    assert not envelope.fence_polygon.contains((0.0, 41.0))


def test_a_polygon_by_degrees_is_about_home_and_its_reach_is_known_with_it(read):
    config = read(limits={"fence_radius_m": None, "fence_polygon_deg": TRIANGLE})
    assert config.limits.reach_m == math.inf
    assert plan_of(config).flight.cycle.envelope.fence_polygon is None
    assert plan_of(config).flight.limits.fence_polygon_deg == tuple(map(tuple, TRIANGLE))
    assert plan_of(config).wants.limits.fence_polygon_deg == tuple(map(tuple, TRIANGLE))


CIRCLE_OF_NONE = {"circle": {"center": TRIANGLE[0], "radius": 0}, "inclusion": True}


def drawn(polygons=((True, TRIANGLE),), circles=()):
    """A plan as QGroundControl saves it."""
    fence = {
        "circles": list(circles),
        "polygons": [
            {"inclusion": inclusion, "polygon": corners, "version": 1}
            for inclusion, corners in polygons
        ],
        "version": 2,
    }
    return {"fileType": "Plan", "geoFence": fence, "mission": {"items": []}, "version": 1}


def vehicle_with_plan(tmp_path, text):
    path = tmp_path / "vehicle.toml"
    limits = '[limits]\nfence_plan_file = "field.plan"\n'
    path.write_text(find("px4", "vehicles").read_text().replace("[limits]\n", limits))
    if text is not None:
        (tmp_path / "field.plan").write_text(text)
    return path


def test_the_fence_of_a_plan_takes_the_place_of_its_name(tmp_path):
    path = vehicle_with_plan(tmp_path, json.dumps(drawn()))
    config = load_vehicle(path)
    assert config.limits.fence_plan_file is None
    assert config.limits.fence_polygon_deg == tuple(map(tuple, TRIANGLE))
    assert reload(path, config).flight.limits.fence_polygon_deg == tuple(map(tuple, TRIANGLE))
    assert load_vehicle(find("px4", "vehicles")) == load(Config, find("px4", "vehicles"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "cannot be read (No such file or directory)"),
        ("[]", "has no geoFence"),
        ('{"geoFence": null}', "has no geoFence"),
        (json.dumps(drawn(polygons=())), "0 polygons"),
        (
            json.dumps(drawn(polygons=[(True, TRIANGLE)] * 2)),
            "2 polygons (0 of them not for inclusion)",
        ),
        (
            json.dumps(drawn(polygons=[(False, TRIANGLE)])),
            "1 polygons (1 of them not for inclusion)",
        ),
        (json.dumps(drawn(polygons=[(True, [[47.0]])])), "not a list of latitude and longitude"),
        (json.dumps(drawn(polygons=[(True, None)])), "not a list of latitude and longitude"),
        (json.dumps(drawn(polygons=[(True, [[10**400, 8.5]])])), "int too large"),
        (json.dumps(drawn(circles=[CIRCLE_OF_NONE])), "1 circles (radius 0); must be exactly one"),
        (json.dumps(drawn(circles=[CIRCLE_OF_NONE] * 9999)), "(radius 0, 0, 0, 0, 0, …)"),
        (json.dumps(drawn() | {"geoFence": {"polygons": [5]}}), "1 of them not for inclusion"),
        (json.dumps(drawn() | {"geoFence": {"polygons": 5}}), "must be lists"),
        ("[" * 100_000, "not JSON"),
        (json.dumps(drawn(polygons=[(True, TRIANGLE[:2])])), "fence_polygon has 2 corners"),
        (
            json.dumps(drawn(polygons=[(True, [TRIANGLE[0]] * 3)])),
            "fence_polygon_deg has 0 corners",
        ),
    ],
)
def test_a_plan_without_one_inclusion_polygon_is_refused_with_the_key(tmp_path, text, words):
    with pytest.raises(ConfigError) as refused:
        load_vehicle(vehicle_with_plan(tmp_path, text))
    assert words in str(refused.value)
    assert "limits.fence_plan_file" in str(refused.value) or "limits.fence_polygon_deg" in str(
        refused.value
    )


@pytest.mark.parametrize(
    "plan",
    [
        drawn(polygons=[(True, [*TRIANGLE, TRIANGLE[0]])]),
        drawn(polygons=[(True, [TRIANGLE[0], *TRIANGLE])]),
        drawn(polygons=[(True, [TRIANGLE[0], TRIANGLE[1], TRIANGLE[1], TRIANGLE[2]])]),
        drawn(polygons=[(True, [[*corner, 0] for corner in TRIANGLE])]),
        {"fileType": "Plan", "geoFence": {"polygon": TRIANGLE, "version": 1}, "version": 1},
    ],
    ids=["closed ring", "first corner twice", "a corner twice", "with heights", "version 1"],
)
def test_plans_as_ground_stations_write_them_are_loaded(tmp_path, plan):
    path = vehicle_with_plan(
        tmp_path, "\ufeff" + json.dumps(plan)
    )  # a plan without this mark is loaded above
    assert sorted(load_vehicle(path).limits.fence_polygon_deg) == sorted(map(tuple, TRIANGLE))


def test_a_plan_may_hold_the_target(tmp_path):
    path = tmp_path / "vehicle.toml"
    text = find("px4", "vehicles").read_text().replace('kind = "pe"', 'kind = "tad"')
    path.write_text(text + '\n[game.target]\npolygon_plan_file = "zone.plan"\n')
    (tmp_path / "zone.plan").write_text(json.dumps(drawn()))
    target = load_vehicle(path).game.target
    assert target.polygon_deg == tuple(map(tuple, TRIANGLE))
    assert target.polygon_plan_file is None
    (tmp_path / "zone.plan").write_text("{")
    with pytest.raises(ConfigError, match=r"game\.target\.polygon_plan_file"):
        load_vehicle(path)


def test_sources_of_evaders_need_what_they_need_and_no_more(read):
    assert read(evader={"kind": "json", "url": ZENOH, "system_id": None}).evader.kind == "json"
    posing = {"kind": "ros_pose", "url": ZENOH, "system_id": None, "frame": FRAME}
    assert read(evader=posing).evader.frame.undulation_m is None
    assert read(evader=posing | {"frame_id": "odom"}).evader.frame_id == "odom"
    below = {"altitude_datum": "ellipsoid", "frame": {"undulation_m": 47.5}}
    assert read(evader={"kind": "follow_target", **below}).evader.datum is Datum.ELLIPSOID
    drone = {"kind": "open_drone_id", "frame": {"undulation_m": 47.5}}
    assert read(evader=drone).evader.datum is Datum.ELLIPSOID
    assert (
        read(evader={"kind": "open_drone_id", "altitude_datum": "amsl"}).evader.datum is Datum.AMSL
    )
    assert read(evader={"url": None}).evader.url is None
    assert (
        read(evader={"url": None}, vehicle={"link": "mavsdk", "url": ZENOH}).vehicle.link
        == "mavsdk"
    )
    assert read(vehicle={"signing_key_file": "key"}).vehicle.signing_key_file == Path("key")


@pytest.fixture
def px4_file(tmp_path):
    path = tmp_path / "vehicle.toml"
    path.write_text(find("px4", "vehicles").read_text())
    return path


def test_a_file_read_again_may_change_the_flight_and_not_the_links(px4_file):
    before = load(Config, px4_file)
    text = px4_file.read_text()
    px4_file.write_text(text.replace("takeoff_height_m = 15.0", "takeoff_height_m = 20.0"))
    assert reload(px4_file, before).flight.takeoff_height_m == 20.0
    px4_file.write_text(text.replace("14540", "14550").replace('name = "px4"', 'name = "other"'))
    with pytest.raises(
        ConfigError, match="name, vehicle changed: end the daemon and start it again for that"
    ):
        reload(px4_file, before)


def test_a_ball_that_the_vehicle_does_not_fly_is_refused_with_what_to_do(read):
    with pytest.raises(
        ConfigError, match=r'game\.speed_set = "ball": its game climbs .* = 6, but'
    ) as told:
        plan_of(read(game={"speed_set": "ball"}))
    assert 'Use "cylinder", or raise both to 6' in str(told.value)


def test_a_moving_target_is_refused_for_a_team(read):
    team = {"name": "north", "mates": ["uav2"], "evader": "rover1"}
    target = {"latitude_deg": 47.0, "longitude_deg": 8.0}
    game = {"kind": "tad", "target": target, "target_velocity_m_s": [0.5, 0.0]}
    with pytest.raises(
        ConfigError, match=r"game\.target_velocity_m_s = .*: must be zero with \[team\]"
    ):
        read(game=game, team=team)
