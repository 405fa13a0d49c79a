"""The real MAVSDK client against the protocols, in one process over ``raw://``, with losses."""

import collections
import random
import threading
import time

import pytest
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.events import Events
from mavsdk.plugins.info import Info
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw, MissionRawError
from mavsdk.plugins.param import Param, ParamError

from sitl_mock.parameters import parameters_of
from sitl_mock.vehicle.mock_vehicle import MockVehicle

pytestmark = pytest.mark.slow


class RawLink:
    """A mock vehicle in real time on one side, a MAVSDK instance on the other, some frames lost between them."""

    def __init__(self, flavour, client):
        self.vehicle = MockVehicle(flavour, ready_after_s=0.5)
        self.loss = 0.0
        self._client = client
        self._rng = random.Random(1)
        self._inbox = collections.deque()
        self._stop = threading.Event()
        client.add_any_connection("raw://")
        client.subscribe_raw_bytes_to_be_sent(
            lambda data, *_: self._inbox.append(bytes(getattr(data, "bytes", data)))
        )
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        begin = time.monotonic()
        while not self._stop.wait(0.002):
            came = [self._inbox.popleft() for _ in range(len(self._inbox))]
            frames = self.vehicle.step(
                time.monotonic() - begin, [frame for frame in came if self._passes()]
            )
            for frame in frames:
                if self._passes():
                    self._client.pass_received_raw_bytes(frame)

    def _passes(self):
        return self._rng.random() >= self.loss

    def close(self):
        self._stop.set()
        self._thread.join()


@pytest.fixture(scope="module", params=["px4", "arducopter"])
def flown(request):
    with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as client:
        link = RawLink(request.param, client)
        try:
            yield request.param, link, client.first_autopilot(10.0)
        finally:
            link.close()


def waypoints(count):
    return [
        MissionItem(
            seq=seq, frame=6, command=16, current=int(seq == 0), autocontinue=1, param1=0.0, param2=1.0, param3=0.0,
            param4=float("nan"), x=473_977_420 + seq, y=85_455_940, z=20.0, mission_type=0,
        )
        for seq in range(count)
    ]  # fmt: skip


def test_parameters_are_read_and_set_in_their_types(flown):
    flavour, _, system = flown
    integer, real = (
        ("NAV_RCL_ACT", "COM_OF_LOSS_T") if flavour == "px4" else ("FS_THR_VALUE", "GUID_TIMEOUT")
    )
    param = Param(system)
    param.set_param_int(integer, 3)
    param.set_param_float(real, 1.25)
    assert (param.get_param_int(integer), param.get_param_float(real)) == (3, 1.25)
    param.set_param_int(integer, -1)
    assert param.get_param_int(integer) == -1


def test_a_wrong_type_is_told_at_once(flown):
    flavour, _, system = flown
    param = Param(system)
    begin = time.monotonic()
    with pytest.raises(ParamError, match="WRONG_TYPE"):
        param.get_param_int("COM_OF_LOSS_T" if flavour == "px4" else "GUID_TIMEOUT")
    assert time.monotonic() - begin < 1.0


def test_the_whole_list_comes(flown):
    flavour, _, system = flown
    everything = Param(system).get_all_params()
    table = parameters_of(flavour)
    names = {item.name for item in (*everything.int_params, *everything.float_params)}
    assert names == set(table.first_listed)


def test_the_version_is_that_of_the_autopilot_that_is_imitated(flown):
    flavour, _, system = flown
    version = Info(system).get_version()
    told = (version.flight_sw_major, version.flight_sw_minor, version.flight_sw_patch)
    assert told == ((1, 17, 0) if flavour == "px4" else (4, 5, 7))


def upload(mission, items, attempts=4):
    """MAVSDK gives an upload up after a few unanswered seconds of wall time; a person then presses upload again."""
    for attempt in range(attempts):
        try:
            return mission.upload_mission(items)
        except MissionRawError as error:
            if "TIMEOUT" not in str(error) or attempt == attempts - 1:
                raise
    return None


def test_a_mission_survives_a_tenth_lost_each_way(flown):
    _, link, system = flown
    mission = MissionRaw(system)
    items = waypoints(100)
    link.loss = 0.1
    try:
        upload(mission, items)
    finally:
        link.loss = 0.0
    assert [item.x for item in mission.download_mission()] == [item.x for item in items]


def test_events_and_arming_checks_come_in_words(fleet_of, client_of):
    with fleet_of({"uav1": "px4"}) as fleet, client_of(fleet["uav1"]) as client:
        events = Events(client.system)
        texts = []
        reports = []
        subscribed = events.subscribe_events(lambda event, _: texts.append(event.message))
        events.subscribe_health_and_arming_checks(lambda report, _: reports.append(report))
        client.ready()
        client.wait(
            lambda: reports and reports[-1].current_mode_intention.can_arm_or_run, 10.0, "a report"
        )
        problems = {problem.message for problem in reports[-1].all_problems}
        client.action.arm()
        client.wait(lambda: "Armed by external command" in texts, 5.0, texts)
        events.unsubscribe_events(subscribed)
    assert reports[-1].current_mode_intention.mode_name == "Hold"
    assert "No offboard signal" in problems
