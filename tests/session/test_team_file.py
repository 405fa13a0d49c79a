"""The section [team] of a vehicle file: mates, the other evaders, and what is refused."""

import json

import pytest

from guidance.config import parse_document
from guidance.errors import ConfigError
from guidance.session.flight_files import recorded_settings
from guidance.session.plan import plan_of
from guidance.session.vehicle_file import Config
from tests.harness.vehicle import document

ROVER2 = {
    "kind": "global_position",
    "url": "udpin://127.0.0.1:14542",
    "system_id": 3,
    "speed_m_s": 2.0,
}
TEAM = {
    "name": "north",
    "mates": ["uav2", "uav3"],
    "evader": "rover1",
    "evaders": {"rover2": ROVER2},
}


def config(**more):
    return parse_document(Config, document(team=TEAM | more), source="uav1.toml")


def test_a_team_has_evaders_by_name_with_their_own_speeds():
    read = config(separation_m=12.0)
    assert list(read.evaders) == ["rover1", "rover2"]
    settings = plan_of(read).flight
    assert settings.evaders == {"rover1": 3.0, "rover2": 2.0}
    assert (settings.team.separation_m, settings.team.separation_height_m) == (12.0, 3.0)


def test_a_record_of_a_vehicle_of_a_team_replays_with_its_separation():
    read = config(separation_m=12.0)
    again = recorded_settings({"config": json.dumps(read.model_dump(mode="json"))})
    assert again.team.separation_m == 12.0
    assert again.evaders == plan_of(read).flight.evaders


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"mates": ["uav1"]}, "must be other names than 'uav1'"),
        ({"mates": []}, "team.mates"),
        ({"evader": "rover2"}, "is \\[evader\\] already"),
        ({"evaders": {"rover2": ROVER2 | {"speed_m_s": 7.0}}}, "must be below game.speed_m_s = 6"),
        (
            {
                "evaders": {
                    "rover2": {"kind": "adsb", "speed_m_s": 2.0, "system_id": 3, "icao_address": 5}
                }
            },
            "url: miss",
        ),
        ({"name": "no/slash"}, "team.name"),
    ],
)
def test_a_wrong_team_is_refused(more, words):
    with pytest.raises(ConfigError, match=words):
        config(**more)
