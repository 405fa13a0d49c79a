"""Vehicle files whose link is a flight mode of PX4."""

import pytest

from guidance.autopilots import PX4, Mode
from guidance.config import parse_document
from guidance.errors import ConfigError
from guidance.links.port import parse
from guidance.session.plan import plan_of
from guidance.session.vehicle_file import Config
from tests.harness.vehicle import document

URL = "zenoh+tcp://127.0.0.1:7447"
MAVLINK = "udpin://127.0.0.1:14540"
REPORTS = "udpin://127.0.0.1:14541"


def config(evader=REPORTS, **vehicle):
    given = document()
    given["vehicle"] = {"autopilot": "px4", "link": "zenoh", "url": URL, **vehicle}
    given["evader"] = {**given["evader"], "url": evader}
    if evader is None:
        del given["evader"]["url"]
    return parse_document(Config, given, source="file.toml")


def test_a_flight_by_a_mode_has_that_mode_as_its_guided_mode():
    settings = plan_of(config(parameters=MAVLINK, mode_name="Hunt")).flight
    assert settings.autopilot.guided_is_ours
    assert settings.autopilot.mode_title(Mode.GUIDED) == "Hunt"
    assert settings.autopilot.custom_modes[Mode.GUIDED] != PX4.custom_modes[Mode.GUIDED]


def test_what_only_offboard_reads_is_not_judged():
    offboard = {rule.name for rule in PX4.versions[0].rules}
    mode = {rule.name for rule in PX4.as_mode.versions[0].rules}
    assert offboard - mode == {"COM_OF_LOSS_T", "COM_OBL_RC_ACT", "COM_RC_OVERRIDE"}
    assert mode <= offboard
    assert PX4.as_mode.loss_times == {}


@pytest.mark.parametrize(
    ("vehicle", "words"),
    [
        ({"url": MAVLINK}, 'link = "zenoh" needs zenoh+tcp:// or zenoh+tls://'),
        ({"link": "mavsdk"}, 'link = "mavsdk" needs another URL'),
        ({"autopilot": "arducopter"}, 'link = "zenoh" is for px4'),
        ({"parameters": URL}, "must be a MAVLink URL"),
        ({"mode_name": "x" * 25}, "1 to 24 printable ASCII characters"),
        ({"mode_name": "Jäger"}, "1 to 24 printable ASCII characters"),
        ({"url": f"{URL}/uav1"}, "ZENOH_DOMAIN_ID, 0 to 232"),
        ({"url": f"{URL}/233"}, "ZENOH_DOMAIN_ID, 0 to 232"),
        ({"announce": True}, "needs vehicle.parameters"),
    ],
)
def test_a_wrong_file_is_refused_with_key_and_what_is_allowed(vehicle, words):
    with pytest.raises(ConfigError) as refused:
        config(**vehicle)
    assert "vehicle." in str(refused.value)
    assert words in str(refused.value)


def test_parameters_belong_to_the_mode_only():
    with pytest.raises(ConfigError, match=r"vehicle\.parameters: not allowed"):
        config(link="pymavlink", url=MAVLINK, parameters=MAVLINK)


def test_reports_on_the_vehicles_link_need_its_mavlink():
    with pytest.raises(ConfigError, match=r"evader\.url: missing"):
        config(evader=None)
    assert config(evader=None, parameters=MAVLINK).vehicle.mavlink_url == MAVLINK


def test_a_url_names_the_router_and_the_domain():
    assert parse(URL)[1:] == ("127.0.0.1", 7447, "0")
    assert parse("zenoh+tls://10.0.0.1:7447/7").namespace == "7"
    assert parse(URL).on_loopback
