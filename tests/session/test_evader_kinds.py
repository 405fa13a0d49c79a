"""A kind of evader source that is registered from outside the package: one module and its test."""

import json
import math

import pytest

from guidance.errors import ConfigError
from guidance.flight import State
from guidance.frames import Ned
from guidance.links.evaders.kinds import (
    EVADER_KINDS,
    EvaderKind,
    SourceOrder,
)
from guidance.messages import EvaderReport
from guidance.session.vehicle_file import Config
from tests.session.conftest import HERE

URL = "udpout://127.0.0.1:9"


class Buoy:
    """Stands 30 m north of home, and reports that ten times a second."""

    def __init__(self, order):
        self.order = order
        self.next_s = 0.0
        self.reports = 0

    def receive(self):
        now_s = self.order.clock()
        if now_s < self.next_s:
            return ()
        self.next_s = now_s + 0.1
        self.reports += 1
        place = (HERE.lat_deg + 30.0 / 111_195.0, HERE.lon_deg, HERE.alt_amsl_m)
        return [EvaderReport(now_s, math.nan, self.order.url, *place, Ned((0.0, 0.0, 0.0)))]

    def counters(self):
        return {"reports": self.reports}

    def close(self):
        """Nothing is open."""


@pytest.fixture
def buoy():
    kind = EvaderKind(
        name="buoy",
        message="a place that does not move",
        transport="other",
        needs={"url": "needs the address of the buoy"},
        open=Buoy,
    )
    EVADER_KINDS.add(kind.name, kind)
    yield kind
    del EVADER_KINDS["buoy"]


def opened(url):
    return lambda clock: EVADER_KINDS.named("buoy").open(
        SourceOrder("buoy", url, clock.now_s, None)
    )


def test_a_registered_kind_is_known_to_vehicle_files_with_what_it_needs(buoy, base):
    section = {"kind": "buoy", "url": URL, "system_id": None}
    one = base(evader=section, source=opened(URL))
    assert one.config.evader.kind == "buoy"
    assert "buoy" in json.dumps(Config.model_json_schema())
    with pytest.raises(ConfigError, match=r'evader\.url: missing; kind = "buoy" needs the address'):
        base(evader=section | {"url": None}, source=opened(URL))
    with pytest.raises(ConfigError, match=r"evader\.system_id: not allowed; kind = .buoy."):
        base(evader=section | {"system_id": 2}, source=opened(URL))


@pytest.mark.flight
def test_a_registered_kind_is_pursued(buoy, base):
    section = {"kind": "buoy", "url": URL, "system_id": None}
    one = base(evader=section, source=opened(URL)).engaged()
    one.until(State.ON_STATION)
    assert one.evader.reports > 100


def test_a_second_kind_of_the_same_name_is_refused(buoy):
    other = EvaderKind(name="buoy", message="another", transport="other", needs={}, open=Buoy)
    with pytest.raises(ConfigError, match="'buoy': another one has this name"):
        EVADER_KINDS.add(other.name, other)


def test_a_kind_that_is_not_registered_is_refused_with_those_that_are():
    with pytest.raises(ConfigError, match="allowed are follow_target, global_position"):
        EVADER_KINDS.named("radar")
