import copy
import tomllib
from pathlib import Path

import pytest

from guidance.config import config_folder, parse_document
from guidance.errors import ConfigError
from guidance.game import Ball, Cylinder
from guidance.session.plan import plan_of, settings_of
from guidance.sim.batch import game, site, stack
from guidance.sim.evader_pilot import EvaderPilot
from guidance.sim.outcome import distances_of
from guidance.sim.scenario import Scenario, Target
from guidance.sim.scenario_file import has_teams, load_document, load_scenario

SHORT = tomllib.loads((Path(__file__).parents[1] / "data" / "short_chase.toml").read_text())


def changed(**sections):
    document = copy.deepcopy(SHORT)
    for name, values in sections.items():
        if isinstance(values, dict):
            document.setdefault(name, {}).update(values)
        else:
            document[name] = values
    return document


def refused(**sections):
    with pytest.raises(ConfigError) as caught:
        parse_document(Scenario, changed(**sections), source="a.toml")
    return str(caught.value)


def for_two(path):
    return not has_teams(load_document(path)[1])


@pytest.mark.parametrize(
    "path",
    list(filter(for_two, sorted((config_folder() / "scenarios").glob("*.toml")))),
    ids=lambda path: path.stem,
)
def test_every_shipped_scenario_of_two_can_be_flown_as_it_is(path):
    _, scenario = load_scenario(path.stem)
    plan_of(scenario=scenario)
    EvaderPilot(None, scenario)


def test_the_default_scenario_is_the_papers_pe_case_at_one_scale():
    _, scenario = load_scenario("pe")
    x, y, z = scenario.pursuer.position_m
    assert (x / 8.00, y / 1.42, z / 9.41) == pytest.approx((5.0, 5.0, 5.0))
    assert scenario.evader.position_m == pytest.approx((5 * 7.92, 5 * 9.60))
    assert scenario.pursuer.speed_m_s / scenario.evader.speed_m_s == 2.0


def test_the_tad_scenario_is_the_papers_at_one_scale():
    _, scenario = load_scenario("tad")
    assert scenario.pursuer.position_m == pytest.approx((5 * 6.97, 5 * 5.83, 5 * 9.15))
    assert scenario.evader.position_m == pytest.approx((5 * 9.80, 5 * 0.33))
    assert scenario.target.position_m == (0.0, 0.0)


@pytest.mark.parametrize("speed", [1.5, 1.0])
def test_a_pursuer_that_is_not_faster_is_another_game(speed):
    message = refused(pursuer={"speed_m_s": speed})
    assert "must be above 1" in message
    assert f"{speed:g} / 1.5" in message


def test_an_evader_above_the_stand_off_height_is_refused():
    message = refused(evader={"height_m": 5.0})
    assert "evader.height_m = 5: must be below standoff.height_m = 5" in message


def test_a_fault_of_keys_that_go_together_has_the_line_of_the_one_that_is_blamed(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(
        'title = "A policy that there is none of"\ngame = "pe"\n'
        "evader = { position_m = [10, 30], speed_m_s = 3 }\n"
        'pursuer = { position_m = [0, 0, 20], speed_m_s = 6, policy = "optimum" }\n'
    )
    with pytest.raises(
        ConfigError, match=r"line 4: pursuer.policy = 'optimum': allowed are optimal, "
    ):
        load_scenario(path)


def test_a_target_may_be_a_convex_polygon_about_its_place():
    square = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]
    _, tad = load_scenario("tad")
    shaped = tad.model_copy(
        update={"target": Target(position_m=(1.0, 2.0), polygon_m=square, radius_m=1.0)}
    )
    assert distances_of(shaped, (0.0, 0.0, 9.0), (3.0, 12.0))[
        "evader_to_target_m"
    ] == pytest.approx(5.0)
    dented = {"position_m": [0.0, 0.0], "polygon_m": [*square, [2.0, 1.0]]}
    assert "target.polygon_m" in refused(game="tad", target=dented)
    assert "(2, 1) is no corner" in refused(game="tad", target=dented)


def test_tad_needs_a_target_and_pe_refuses_one():
    assert "target.position_m: missing" in refused(game="tad")
    assert "target: not allowed" in refused(target={"position_m": [0.0, 0.0]})


def test_a_start_outside_of_the_fence_or_below_the_stand_off_is_refused():
    assert "fence_radius_m" in refused(evader={"position_m": [0.0, 400.0]})
    assert "height 4 m; allowed is standoff.height_m = 5" in refused(
        pursuer={"position_m": [0.0, 0.0, 4.0]}
    )


def test_a_floor_above_the_stand_off_is_refused():
    assert "limits.floor_m = 6" in refused(limits={"floor_m": 6.0})


def test_speed_limits_are_a_tenth_above_the_game_unless_given_and_never_below_it():
    speeds = {"speed_m_s": 5.0, "climb_m_s": 2.0, "descent_m_s": 1.0}
    limits = parse_document(Scenario, changed(pursuer=speeds), source="a.toml").speed_limits
    assert limits == pytest.approx((5.5, 2.2, 1.1))
    given = plan_of(
        scenario=parse_document(
            Scenario, changed(pursuer=speeds, limits={"speed_m_s": 5.0}), source="a.toml"
        )
    )
    assert given.flight.cycle.envelope.speed_m_s == 5.0
    assert "limits.climb_m_s = 1.5: must be at least pursuer.climb_m_s = 2" in refused(
        pursuer=speeds, limits={"climb_m_s": 1.5}
    )


@pytest.mark.parametrize("player", ["pursuer", "evader"])
def test_an_unknown_policy_lists_the_catalogue(player):
    message = refused(**{player: {"policy": "magic"}})
    assert f"{player}.policy = 'magic': allowed are optimal" in message
    assert ("proportional_navigation" in message) == (player == "pursuer")


def test_a_raised_evader_raises_the_games_plane_and_lowers_the_disc_above_it():
    scenario = parse_document(Scenario, changed(evader={"height_m": 1.5}), source="a.toml")
    assert site(scenario)[2].metres == pytest.approx(scenario.site.altitude_amsl_m + 1.5)
    assert game(scenario).standoff.height_m == pytest.approx(3.5)
    assert plan_of(scenario=scenario).flight.start_game_m == pytest.approx((8.0, 3.0, 10.5))


def test_a_flight_plays_the_vehicles_own_speed_set_and_mathematics_the_ball():
    scenario = parse_document(Scenario, changed(), source="a.toml")
    assert stack([scenario]).game.pursuer == Ball(3.0)
    flown = plan_of(scenario=scenario).flight.cycle.game
    assert flown.pursuer == Cylinder(3.0, 3.0, 1.5)
    assert game(scenario).pursuer == flown.pursuer


def test_a_ball_is_flown_only_where_the_vehicle_climbs_and_descends_as_fast():
    slow = parse_document(Scenario, changed(pursuer={"speed_set": "ball"}), source="a.toml")
    with pytest.raises(ConfigError, match=r'pursuer\.speed_set = "ball": its game climbs and desc'):
        plan_of(scenario=slow)
    fast = changed(pursuer={"speed_set": "ball", "climb_m_s": 3.0, "descent_m_s": 3.0})
    plan = plan_of(scenario=parse_document(Scenario, fast, source="a.toml"))
    assert plan.flight.cycle.game.pursuer == Ball(3.0)
    assert settings_of(None, slow, None).cycle.game.pursuer == Ball(3.0)  # an old record replays
