"""The rows of preflight that are not parameters: on both sides of each limit, and in words."""

import math
from dataclasses import replace
from functools import partial

import pytest

from guidance.autopilots import ARDUCOPTER, AUTOPILOTS, PX4, Verdict
from guidance.autopilots.rules import Quantity
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.messages import (
    Attitude,
    AutopilotVersion,
    EvaderReport,
    FenceCount,
    GlobalPosition,
    Heartbeat,
    Home,
    LocalPosition,
    Odometry,
    Origin,
    Parameter,
    ParameterRequest,
    PositionTarget,
    SystemStatus,
)
from guidance.preflight import (
    Facts,
    PreflightMemory,
    advice,
    another_autopilot,
    changes,
    engage_rows,
    parameter_names,
    quantities_read,
    refusals,
    rows,
)
from guidance.preflight.fence import READ_AGAIN_S, Area, Uploaded
from guidance.vehicle import VehicleState, observe
from tests.preflight.test_telemetry import FRAME, ORIGIN, REST, evader_at, vehicle_at
from tests.preflight.wants import wants_of

WANTS = wants_of(battery_needed=0.35, fence_polygon_ne_m=((-9.0, -9.0), (9.0, -9.0), (0.0, 9.0)))
BOTH = (PX4, ARDUCOPTER)
PASS = Verdict.PASS
WARN = Verdict.WARN
REFUSE = Verdict.REFUSE


def judged(vehicle=None, *, autopilot=PX4, wants=WANTS, **facts):
    vehicle = VehicleState() if vehicle is None else vehicle
    return {row.name: row for row in rows(Facts(vehicle=vehicle, **facts), autopilot, wants)}


def said(row):
    return row.value, row.wanted, row.verdict


def firmware(*numbers):
    return AutopilotVersion(0.0, *numbers)


FOREIGN = wants_of(fence_polygon_ne_m=((1.0, 1.0), (9.0, 1.0), (1.0, 9.0)))
HERE = (ORIGIN.latitude_deg, ORIGIN.longitude_deg)


@pytest.mark.parametrize("wants", [WANTS, FOREIGN])
@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize(
    "vehicle",
    [
        VehicleState(),
        observe(VehicleState(), [ORIGIN]),
        observe(VehicleState(), [Home(0.0, *HERE, 488.0, Ned(REST))]),
        observe(VehicleState(), [ORIGIN, Home(0.0, *HERE, 488.0, Ned(REST))]),
        vehicle_at(),
        vehicle_at(home_ned_m=(5000.0, 0.0, 0.0), home_told_m=(0.0, 0.0, -600.0)),
        vehicle_at(height_error_m=47.0, home_error_m=-20.0),
        observe(vehicle_at(), [SystemStatus(0.0, 0, 0, 0.1)]),
    ],
)
def test_every_row_is_in_words_and_has_advice_where_it_does_not_pass(vehicle, autopilot, wants):
    for evader_amsl_m in (None, 488.0, 900.0):
        for version in (None, firmware(1, 17, 2), firmware(99, 0, 0)):
            facts = {"evader": evader_at(evader_amsl_m), "version": version}
            for row in judged(vehicle, autopilot=autopilot, wants=wants, **facts).values():
                assert all(isinstance(words, str) for words in row)
                assert row.verdict in Verdict
                assert row.name
                assert row.value
                assert row.wanted
                assert (row.advice == "") is (row.verdict is PASS)


def test_home_has_to_be_in_our_fence():
    assert said(judged()["home in our fence"]) == ("inside", "inside", PASS)
    assert said(judged(wants=FOREIGN)["home in our fence"]) == ("outside", "inside", REFUSE)


@pytest.mark.parametrize(
    ("messages", "missing"),
    [
        ([], "GPS_GLOBAL_ORIGIN and HOME_POSITION heard"),
        ([ORIGIN], "HOME_POSITION heard"),
        ([Home(0.0, *HERE, 488.0, Ned(REST))], "GPS_GLOBAL_ORIGIN heard"),
    ],
)
def test_a_frame_without_an_origin_or_a_home_is_refused_by_what_is_missing(messages, missing):
    row = judged(observe(VehicleState(), messages))["local frame"]
    assert said(row) == ("unknown", missing, REFUSE)


GROUNDED = observe(VehicleState(), [ORIGIN, Home(0.0, *HERE, 488.0, Ned(REST))])
ON_MAP = GlobalPosition(0.0, 1.0, *HERE, 488.0, 0.0, Ned(REST))


@pytest.mark.parametrize("message", [ON_MAP, LocalPosition(0.0, 1.0, Ned(REST), Ned(REST))])
def test_a_position_is_needed_on_the_map_and_in_the_frame(message):
    row = judged(observe(GROUNDED, [message]))["position"]
    assert row.value == "unknown"
    assert row.verdict is REFUSE
    assert row.wanted == "GLOBAL_POSITION_INT and LOCAL_POSITION_NED heard"


@pytest.mark.parametrize(
    ("changes", "name", "value", "limit", "verdict"),
    [
        ({"home_ned_m": (999.0, 0.0, 0.0)}, "frame origin", "999.0 m from home", 1000, PASS),
        ({"home_ned_m": (1001.0, 0.0, 0.0)}, "frame origin", "1001.0 m from home", 1000, REFUSE),
        ({"home_ned_m": (0.0, 9.0, 2000.0)}, "frame origin", "9.0 m from home", 1000, PASS),
        ({"home_told_m": (0.0, 0.0, 4.9)}, "home in the frame", "4.9 m apart", 5, PASS),
        ({"home_told_m": (0.0, 0.0, -5.1)}, "home in the frame", "5.1 m apart", 5, REFUSE),
        ({"height_error_m": 4.9}, "local = global", "4.9 m apart", 5, PASS),
        ({"height_error_m": -5.1}, "local = global", "5.1 m apart", 5, REFUSE),
        ({"home_error_m": 2.9}, "datum of home", "2.9 m apart", 3, PASS),
        ({"home_error_m": -3.1}, "datum of home", "3.1 m apart", 3, REFUSE),
    ],
)
def test_places_that_disagree_are_refused_with_the_distance(changes, name, value, limit, verdict):
    row = judged(vehicle_at(**changes))[name]
    assert said(row) == (value, f"at most {limit} m", verdict)


@pytest.mark.parametrize("told", BOTH)
@pytest.mark.parametrize("autopilot", BOTH)
def test_a_place_is_compared_by_the_autopilots_own_projection(told, autopilot):
    place = (9000.0, 9000.0, 0.0)
    frame = LocalFrame(69.0, 18.0, Amsl(488.0), projection=told.projection)
    latitude, longitude, _ = frame.wgs84_from_ned(Ned(place))
    vehicle = observe(
        VehicleState(),
        [
            Origin(0.0, 69.0, 18.0, 488.0),
            Home(0.0, 69.0, 18.0, 488.0, Ned(REST)),
            LocalPosition(0.0, 1.0, Ned(place), Ned(REST)),
            GlobalPosition(0.0, 1.0, latitude, longitude, 488.0, 0.0, Ned(REST)),
        ],
    )
    row = judged(vehicle, autopilot=autopilot)["local = global"]
    assert (row.verdict is PASS) is (autopilot is told), row


@pytest.mark.parametrize(
    ("evader_amsl_m", "value", "wanted", "verdict"),
    [
        (None, "not heard", "within 30 m of home", WARN),
        (518.0, "30.0 m from home's", "at most 30 m", PASS),
        (518.1, "30.1 m from home's", "at most 30 m", REFUSE),
        (457.9, "30.1 m from home's", "at most 30 m", REFUSE),
    ],
)
def test_the_evaders_height_is_near_homes(evader_amsl_m, value, wanted, verdict):
    row = judged(
        observe(GROUNDED, [ON_MAP, LocalPosition(0.0, 1.0, Ned(REST), Ned(REST))]),
        evader=evader_at(evader_amsl_m),
    )
    assert said(row["evader's altitude"]) == (value, wanted, verdict)


@pytest.mark.parametrize(
    ("messages", "value", "verdict"),
    [
        ([], "unknown", REFUSE),
        ([SystemStatus(0.0, 0, 0, math.nan)], "unknown", REFUSE),
        ([SystemStatus(0.0, 0, 0, 0.35)], "35%", PASS),
        ([SystemStatus(0.0, 0, 0, 0.3)], "30%", REFUSE),
    ],
)
def test_the_charge_covers_the_reserve_or_is_refused(messages, value, verdict):
    vehicle = observe(VehicleState(), messages)
    row = judged(vehicle)["battery reserve"]
    wanted = "at least 35%, to fly home from the edge of the fence"
    assert said(row) == (value, wanted, verdict)
    assert "battery reserve" not in judged(vehicle, wants=FOREIGN)


@pytest.mark.parametrize(
    ("name", "kind", "least_hz", "verdict"),
    [
        ("LOCAL_POSITION_NED", LocalPosition, 10.0, REFUSE),
        ("ATTITUDE", Attitude, 4.0, REFUSE),
        ("GLOBAL_POSITION_INT", GlobalPosition, 1.0, WARN),
        ("ODOMETRY", Odometry, 5.0, WARN),
        ("POSITION_TARGET_LOCAL_NED", PositionTarget, 1.0, WARN),
    ],
)
def test_a_stream_has_a_least_rate(name, kind, least_hz, verdict):
    assert judged(rates_hz={kind: least_hz})[name].verdict is PASS
    row = judged(rates_hz={kind: least_hz - 0.1})[name]
    assert row.value == f"{least_hz - 0.1:.1f} Hz"
    assert row.wanted.startswith(f"at least {least_hz:g} Hz (")
    assert row.wanted.endswith(" requested)")
    assert row.verdict is verdict


def test_a_stream_that_is_not_requested_is_not_judged_and_the_others_are():
    requested = dict(list(PX4.streams_hz.items()))
    for number in PX4.streams_hz:
        fewer = replace(PX4, streams_hz={n: hz for n, hz in requested.items() if n != number})
        left_out = set(judged()) - set(judged(autopilot=fewer))
        assert len(left_out) <= 1
        assert set(judged(autopilot=fewer)) <= set(judged())


@pytest.mark.parametrize("autopilot", AUTOPILOTS.values())
def test_the_version_is_known_or_is_judged_as_the_next_known_one(autopilot):
    oldest = autopilot.versions[0]
    newest = autopilot.versions[-1]
    range_of = f"{oldest.words} to {newest.words}"

    def row(*numbers):
        version = firmware(*numbers) if numbers else None
        return judged(autopilot=autopilot, version=version)["autopilot version"]

    assert said(row()) == ("not read", range_of, REFUSE)
    for version in (oldest, newest):
        assert said(row(*version.number, 3)) == (f"{version.words}.3", range_of, PASS)
    major, minor = newest.number
    assert said(row(major, minor + 1, 0)) == (f"{major}.{minor + 1}.0", range_of, WARN)
    assert f"newer than {newest.words}" in row(major, minor + 1, 0).advice
    major, minor = oldest.number
    assert said(row(major, minor - 1, 9)) == (f"{major}.{minor - 1}.9", range_of, WARN)
    assert f"older than {oldest.words}" in row(major, minor - 1, 9).advice


@pytest.mark.parametrize("autopilot", AUTOPILOTS.values())
@pytest.mark.parametrize("announces", [True, False])
def test_each_version_is_judged_and_mended_by_its_own_parameters(autopilot, announces):
    wants = wants_of(announces=announces)
    for version in autopilot.versions:
        rules = [rule for rule in version.rules if announces or not rule.of_announced]
        names = [rule.name for rule in rules]
        heard = firmware(*version.number, 0)
        names_of = partial(parameter_names, announces=announces)
        assert names_of(version) == tuple(names)
        needed = [rule.name for rule in rules if rule.needed]
        assert names_of(version, only_needed=True) == tuple(needed)
        facts = Facts(version=heard)
        every_name = {rule.name for rule in version.rules}
        judged_names = [row.name for row in rows(facts, autopilot, wants)]
        assert [name for name in judged_names if name in every_name] == names
        asked = [row.name for row in engage_rows(facts, autopilot, wants)]
        assert asked == [*needed, "uploaded fence"]
        wrong = Facts(dict.fromkeys(every_name, -1.0), version=heard)
        mended = {change.name for change in changes(wrong, autopilot, wants, advised=True)}
        assert mended <= set(names)
        renamed = set(names) - set(parameter_names(autopilot.versions[0]))
        assert mended & (renamed or set(names))
        memory = PreflightMemory(autopilot, names_of)
        memory.observe([firmware(*version.number, 0)], [])
        assert memory.version is version
        assert memory.missing == (f"{len(names)} of {len(names)} parameters", "uploaded fence")


def test_a_quantity_is_in_its_own_unit():
    read = quantities_read({"RTL_ALT": 1500.0}, ARDUCOPTER.versions[0], Uploaded())
    assert read == {Quantity.RETURN_HEIGHT: 15.0}
    read = quantities_read({}, PX4.versions[0], Uploaded(areas=()))
    assert read == {Quantity.UPLOADED_INCLUSION: 0.0}


def beat(at_s, autopilot, vehicle_type=None):
    return Heartbeat(
        at_s, 0, armed=False, system_status=3, autopilot=autopilot, vehicle_type=vehicle_type
    )


@pytest.mark.parametrize(
    ("other", "value", "advice_words"),
    [
        (beat(9.0, 8, 6), "unknown (MAV_AUTOPILOT 8), ", "another system's HEARTBEAT?"),
        (beat(9.0, 12, 1), "px4 (MAV_AUTOPILOT 12), fixed wing (MAV_TYPE 1)", "a fixed wing"),
        (beat(9.0, 3, 2), "arducopter (MAV_AUTOPILOT 3), ", 'vehicle.autopilot = "arducopter"'),
    ],
)
def test_another_autopilot_is_refused_by_name_while_ours_is_silent(other, value, advice_words):
    row = another_autopilot(Facts(other_beat=other), PX4)
    assert row.name == "autopilot"
    assert row.value.startswith(value)
    assert row.wanted == "px4 (12) in a vehicle that it may fly"
    assert row.verdict is REFUSE
    assert advice_words in row.advice
    assert rows(Facts(other_beat=other), PX4, WANTS) == (row,)
    for last_s, refused in ((5.9, True), (6.0, False), (8.9, False)):
        vehicle = observe(VehicleState(), [beat(last_s, 12, 2)])
        facts = Facts(vehicle=vehicle, other_beat=other)
        assert (another_autopilot(facts, PX4) == row) is refused
    assert another_autopilot(Facts(), PX4) is None


def test_before_an_engagement_an_unanswered_parameter_refuses_and_an_unread_fence_too():
    parameters = {"COM_OF_LOSS_T": 9.0, "GF_ACTION": 2.0, "GF_MAX_HOR_DIST": 250.0}
    vehicle = observe(VehicleState(), [ORIGIN, Home(0.0, *HERE, 488.0, Ned(REST))])
    facts = Facts(parameters, vehicle=vehicle, uploaded=Uploaded(areas=()))
    asked = {row.name: row for row in engage_rows(facts, PX4, WANTS)}
    assert asked["uploaded fence"].verdict is PASS
    assert asked["GF_MAX_HOR_DIST"].verdict is PASS
    assert asked["COM_OF_LOSS_T"].value == "9 s"
    assert asked["COM_OF_LOSS_T"].verdict is REFUSE
    unanswered = asked["COM_OBL_RC_ACT"]
    assert said(unanswered) == ("not answered", "a value", REFUSE)
    assert unanswered.advice == "check the link"
    unread = engage_rows(facts, PX4, WANTS, unread_fence="not read again")[-1]
    assert (unread.name, unread.value, unread.verdict) == (
        "uploaded fence",
        "not read again",
        REFUSE,
    )
    tight = Area(inclusion=True, corners_deg=HERE_SQUARE)
    small = engage_rows(facts._replace(uploaded=Uploaded((tight,))), PX4, WANTS)[-1]
    assert "acts inside our fence" in small.advice


def about(size_m):
    corners = ((-size_m, -size_m), (-size_m, size_m), (size_m, size_m), (size_m, -size_m))
    return tuple(FRAME.wgs84_from_ned(Ned((*corner, 0.0)))[:2] for corner in corners)


HERE_SQUARE = about(5.0)


def test_a_fence_in_degrees_is_judged_in_metres_before_an_engagement_and_for_changes():
    wants = wants_of(fence_radius_m=None, fence_polygon_deg=about(80.0))
    vehicle = observe(VehicleState(), [ORIGIN, Home(0.0, *HERE, 488.0, Ned(REST))])
    facts = Facts(
        {"GF_MAX_HOR_DIST": 110.0, "GF_ACTION": 2.0}, vehicle=vehicle, uploaded=Uploaded(())
    )
    asked = {row.name: row for row in engage_rows(facts, PX4, wants)}
    assert asked["GF_MAX_HOR_DIST"].wanted.startswith("at least 113.137 m")
    (change,) = changes(facts._replace(parameter_types={"GF_MAX_HOR_DIST": 6}), PX4, wants)
    assert change.why.startswith("at least 113.137 m")
    assert change.request.param_type == 6


def test_refusals_are_listed_with_their_fix():
    refused = judged()["local frame"]
    passed = judged()["home in our fence"]
    assert refusals([passed, refused]) == ("local frame",)
    assert advice([passed]) == ""
    words = (
        "local frame is unknown, expected GPS_GLOBAL_ORIGIN and HOME_POSITION heard "
        "(wait for a position fix)"
    )
    assert advice([passed, refused, refused]) == f"{words}; {words}"


def heard(*names):
    """A memory that has begun to read at 1 s."""
    memory = PreflightMemory(PX4, lambda _: names)
    memory.observe([beat(1.0, 12, 2)], [])
    memory.requests(1.0)
    return memory


def test_everything_is_settled_when_it_is_read_or_after_two_rounds():
    memory = heard("A")
    assert not PreflightMemory(PX4).settled(1e9)
    assert not memory.settled(1.0)
    assert not memory.settled(11.0)
    assert memory.settled(11.1)
    assert memory.reading_fence
    assert not memory.fence_known
    memory.observe([firmware(1, 17, 0), Parameter(2.0, "A", 1.0)], [])
    assert memory.complete
    assert not memory.settled(2.0)
    assert memory.missing == ("uploaded fence",)
    memory.observe([FenceCount(2.0, 0)], [])
    memory.requests(2.0)
    assert memory.settled(2.0)
    assert not memory.reading_fence
    unread = heard("A")
    unread.observe([FenceCount(2.0, 0)], [])
    unread.requests(2.0)
    assert unread.fence_known
    assert not unread.settled(2.0)
    assert unread.missing == ("AUTOPILOT_VERSION", "1 of 1 parameters")


def test_a_fence_counts_as_read_since_its_download_began():
    memory = heard()
    memory.observe([FenceCount(2.0, 0)], [])
    assert not memory.fence_read_since(1.0)
    memory.requests(3.0)
    assert memory.fence_read_since(1.0)
    assert not memory.fence_read_since(1.1)
    memory.read_fence_again()
    assert memory.reading_fence
    assert memory.fence_progress == "not read again: no answer"
    assert not memory.fence_read_since(1.0 + READ_AGAIN_S)


def test_what_is_to_be_read_again_is_asked_for_at_once_and_the_rest_is_kept():
    memory = heard("A", "B")
    memory.observe([firmware(1, 17, 0), Parameter(2.0, "A", 1.0), Parameter(2.0, "B", 2.0)], [])
    assert memory.complete
    memory.read_again(["A", "C"])
    assert not memory.complete
    assert memory.requests(2.1) == (ParameterRequest("A"),)
    assert memory.requests(2.2) == ()
    memory.read_again([])
    assert memory.requests(2.3) == (ParameterRequest("A"),)


def test_requests_are_repeated_every_five_seconds():
    memory = heard("A")
    memory.observe([firmware(1, 17, 0)], [])
    assert ParameterRequest("A") in memory.requests(2.0)
    assert ParameterRequest("A") not in memory.requests(6.9)
    assert ParameterRequest("A") in memory.requests(7.0)


def test_before_the_version_is_known_parameters_wait_five_seconds():
    memory = PreflightMemory(PX4, lambda _: ("A",))
    memory.observe([beat(100.0, 12, 2)], [])
    assert ParameterRequest("A") not in memory.requests(100.0)
    assert ParameterRequest("A") not in memory.requests(104.9)
    assert ParameterRequest("A") in memory.requests(105.0)


def test_facts_are_all_that_was_heard():
    memory = PreflightMemory(PX4, lambda _: ("A", "B"))
    assert memory.facts(VehicleState(), 0.0) == Facts()
    other = beat(3.0, 8, 6)
    vehicle = observe(VehicleState(), [ORIGIN])
    said_by_vehicle = [
        other,
        beat(3.0, 12, 2),
        Parameter(3.0, "A", 1.0, 6),
        Parameter(3.0, "B", 2.0),
        Attitude(1.0, 0.0, 0.0),
        Attitude(2.0, 0.0, 0.0),
        firmware(1, 17, 0),
    ]
    report = EvaderReport(0.0, 0.0, "t", 47.0, 8.0, 490.0, Ned(REST), 0.0, 0.0)
    memory.observe(said_by_vehicle, [report])
    facts = memory.facts(vehicle, 3.0, other)
    assert facts.parameters == {"A": 1.0, "B": 2.0}
    assert facts.parameter_types == {"A": 6}
    assert facts.vehicle == vehicle
    assert facts.other_beat is other
    assert facts.version == firmware(1, 17, 0)
    assert facts.evader is report
    assert facts.rates_hz[Heartbeat] == 0.5
    assert facts.rates_hz[Attitude] == 1.0
    assert memory.facts(vehicle, 3.1).rates_hz[Attitude] == 0.5
    assert memory.facts(vehicle, 5.1).rates_hz[Attitude] == 0.0


def test_what_is_kept_of_a_flood_is_bounded():
    memory = heard()
    memory.observe([Attitude(0.001 * number, 0.0, 0.0) for number in range(2000)], [])
    assert memory.facts(VehicleState(), 2.0).rates_hz[Attitude] == 256.0
