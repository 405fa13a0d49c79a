"""The link to PX4 over Zenoh: real sessions on a router of loopback, and a peer that speaks as PX4 does."""

import itertools
import math
import socket
import threading
import time
from contextlib import closing

import pytest
import zenoh

from guidance.autopilots import PX4, Mode
from guidance.errors import ConfigError, LinkError
from guidance.frames import Ned
from guidance.links.port import parse
from guidance.links.px4.link import open_px4_link
from guidance.links.px4.messages import TYPES
from guidance.links.px4.mode import Check, Readiness
from guidance.links.zenoh.credentials import NO_CREDENTIALS
from guidance.messages import (
    Attitude,
    Command,
    CommandAck,
    GlobalPosition,
    Heartbeat,
    Home,
    LandedState,
    LocalPosition,
    Odometry,
    Origin,
    ParameterRequest,
    Setpoint,
    SystemStatus,
    Timesync,
)
from tests.links.peer import until
from tests.links.px4.peer import HOLD, PURSUIT, Px4Peer, beating, encoded
from tests.links.rigs import Router, free_port, router_config

_domains = itertools.count(1)
FLY = Setpoint(Ned((1.5, -2.25, 0.5)), yaw_rad=0.75)


class Rig:
    def __init__(self, link, peer) -> None:
        self.link = link
        self.peer = peer
        self.received = []

    def hear(self, condition, timeout_s: float = 3.0) -> bool:
        def heard() -> bool:
            self.received += self.link.receive()
            return condition()

        return until(heard, timeout_s=timeout_s)

    def of(self, kind: type) -> list:
        return [message for message in self.received if isinstance(message, kind)]

    def says(self, **status) -> None:
        """Let PX4 say its status, and wait until the link has it."""
        stamp_us = self.peer.now_us
        self.peer.status(timestamp=stamp_us, **status)
        assert self.hear(lambda: self.link.mode.status.timestamp == stamp_us)
        self.received += self.link.receive()

    def flown(self) -> "Rig":
        self.says(nav_state=PURSUIT, arming_state=2, executor_in_charge=1)
        return self


def opened(router, peer, *, mode_name: str = "Pursuit", timeout_s: float = 3.0, **more):
    url = f"zenoh+tcp://127.0.0.1:{router.port}/{peer.domain_id}"
    return open_px4_link(
        parse(url),
        mode_name=mode_name,
        beside=None,
        clock=time.monotonic,
        credentials=NO_CREDENTIALS,
        timeout_s=timeout_s,
        **more,
    )


@pytest.fixture
def peer(router):
    peer = Px4Peer(router.session, next(_domains))
    yield peer
    peer.close()


@pytest.fixture
def rig(router, peer):
    with beating(peer):
        link = opened(router, peer)
    yield Rig(link, peer)
    link.close()


def test_it_registers_the_mode_before_it_is_open(rig):
    assert rig.link.mode.registration == (PURSUIT, 0, 1)


def test_the_status_is_a_heartbeat_of_px4(rig):
    rig.says(nav_state=5, arming_state=2)
    beat = rig.of(Heartbeat)[-1]
    assert PX4.mode_of(beat.custom_mode) is Mode.RETURN
    assert (beat.armed, beat.autopilot, beat.vehicle_type) == (True, 12, 2)


def test_our_mode_is_the_guided_mode_and_offboard_is_another(rig):
    described = PX4.as_mode
    rig.says(nav_state=PURSUIT)
    assert described.mode_of(rig.of(Heartbeat)[-1].custom_mode) is Mode.GUIDED
    for other in (14, PURSUIT + 1):
        rig.says(nav_state=other)
        assert described.mode_of(rig.of(Heartbeat)[-1].custom_mode) is Mode.OTHER


def test_a_position_is_local_position_attitude_origin_and_resets(rig):
    rig.peer.local_position(1500, heading=0.25, xy_reset_counter=3, z_reset_counter=4)
    assert rig.hear(lambda: bool(rig.of(Odometry)))
    (local,) = rig.of(LocalPosition)
    assert local[1:] == (1.5, Ned((1500.5, 2.0, -3.0)), Ned((0.25, 0.5, -0.75)))
    assert rig.of(Attitude)[0].yaw_rad == 0.25
    assert rig.of(Origin)[0][1:] == (47.0, 8.0, 500.0)
    assert rig.of(Odometry)[0].reset_counter == 7


def test_of_the_positions_since_the_last_call_the_newest_comes_stamped_on_arrival(rig):
    before_s = time.monotonic()
    for n in range(50):
        rig.peer.local_position(n)
    # What is sent later arrives later
    rig.peer.say("vehicle_land_detected", landed=True)
    assert rig.hear(lambda: bool(rig.of(LandedState)))
    assert rig.hear(lambda: rig.of(LocalPosition)[-1].time_boot_s == 0.049)
    stamps = [one.received_s for one in rig.of(LocalPosition)]
    assert before_s <= stamps[0]
    assert stamps == sorted(stamps)
    assert stamps[-1] <= time.monotonic()
    looked_s = time.monotonic()
    rig.link.receive()
    rig.peer.local_position(60)
    rig.peer.local_position(61)
    time.sleep(0.2)
    (newest,) = [one for one in rig.link.receive() if isinstance(one, LocalPosition)]
    assert newest.time_boot_s == 0.061
    assert looked_s <= newest.received_s <= time.monotonic() - 0.1


def test_of_a_hundred_battery_messages_the_newest_is_read(rig):
    before = rig.link.counters()["received"]
    for n in range(100):
        rig.peer.say("battery_status", connected=True, remaining=n / 100, voltage_v=15.0)
    # What is sent later arrives later
    rig.peer.say("vehicle_land_detected", landed=True)
    assert rig.hear(lambda: bool(rig.of(LandedState)))
    assert rig.hear(lambda: rig.of(SystemStatus)[-1].battery_remaining == pytest.approx(0.99))
    known = [one for one in rig.of(SystemStatus) if one.voltage_v == 15.0]
    assert len(known) <= 2
    assert rig.link.counters()["received"] - before < 10


@pytest.mark.parametrize("values", [{"xy_valid": False}, {"x": math.nan}, {"vz": math.inf}])
def test_a_position_that_is_not_valid_is_dropped_and_counted(rig, values):
    rig.peer.local_position(1, **values)
    assert rig.hear(lambda: rig.link.counters()["invalid"] == 1)
    rig.peer.local_position(2)
    assert rig.hear(lambda: bool(rig.of(LocalPosition)))
    assert [one.time_boot_s for one in rig.of(LocalPosition)] == [0.002]
    assert rig.link.counters()["invalid"] == 1


def test_home_is_where_the_vehicle_was_last_seen_disarmed(rig):
    peer = rig.peer
    peer.say("vehicle_land_detected", landed=True)
    peer.local_position(1, x=1.0, y=2.0, z=0.5)
    assert rig.hear(lambda: bool(rig.of(LocalPosition)) and bool(rig.of(LandedState)))
    peer.global_position(alt=501.5)
    assert rig.hear(lambda: bool(rig.of(GlobalPosition)))
    home = rig.of(Home)[-1]
    assert home[1:] == (47.0, 8.0, 501.5, Ned((1.0, 2.0, 0.5)))
    assert rig.of(GlobalPosition)[-1].altitude_above_home_m == 0.0
    rig.says(arming_state=2)
    homes = len(rig.of(Home))
    positions = len(rig.of(GlobalPosition))

    def climbed() -> bool:
        peer.global_position(alt=520.0)
        return len(rig.of(GlobalPosition)) > positions

    assert rig.hear(climbed)
    assert rig.of(GlobalPosition)[-1].altitude_above_home_m == pytest.approx(18.5)
    assert len(rig.of(Home)) == homes


def test_the_battery_and_px4s_own_checks_are_its_system_status(rig):
    rig.says(pre_flight_checks_pass=False)
    rig.peer.say("battery_status", connected=True, remaining=0.5, voltage_v=15.0)
    assert rig.hear(lambda: any(one.voltage_v == 15.0 for one in rig.of(SystemStatus)))
    status = rig.of(SystemStatus)[-1]
    assert (status.battery_remaining, status.sensors_health) == (0.5, 0)


def test_an_unknown_charge_is_unknown_and_not_empty(rig):
    rig.peer.say("battery_status", connected=False, remaining=0.0)
    count = len(rig.of(SystemStatus))
    assert rig.hear(lambda: len(rig.of(SystemStatus)) > count)
    assert math.isnan(rig.of(SystemStatus)[-1].battery_remaining)


def test_px4s_clock_is_told_by_its_answer_to_our_question(rig):
    assert rig.hear(lambda: bool(rig.of(Timesync)))
    answer = rig.of(Timesync)[0]
    asked_s = answer.local_ns * 1e-9
    assert asked_s <= answer.received_s <= time.monotonic()
    assert answer.remote_ns == pytest.approx(rig.peer.now_us * 1000, abs=3e9)


def test_arming_checks_are_answered_while_the_loop_stands_still(rig):
    rig.link.tell(Readiness(time.monotonic()))
    asked_s = time.monotonic()
    number = rig.peer.ask()
    # Nobody calls the link meanwhile
    assert until(lambda: bool(rig.peer.of("arming_check_reply")), timeout_s=0.5)
    assert time.monotonic() - asked_s < 0.5
    (reply,) = rig.peer.of("arming_check_reply")
    assert (reply.request_id, reply.registration_id) == (number, 0)
    assert reply.can_arm_and_run
    assert rig.link.counters()["arming_checks_answered"] == 1


def test_what_bars_the_mode_is_told_by_events(rig):
    rig.link.tell(Readiness(time.monotonic(), (Check.EVADER,)))
    rig.peer.ask()
    assert until(lambda: bool(rig.peer.of("arming_check_reply")))
    (reply,) = rig.peer.of("arming_check_reply")
    assert not reply.can_arm_and_run
    assert [event.id for event in reply.events[: reply.num_events]] == [Check.EVADER.event_id]


def test_one_call_is_one_setpoint_and_nothing_follows(rig):
    rig.flown()
    for _ in range(3):
        rig.link.send_setpoint(FLY)
    assert until(lambda: len(rig.peer.of("trajectory_setpoint")) == 3)
    rig.link.receive()
    assert len(rig.peer.of("trajectory_setpoint")) == 3
    sent = rig.peer.of("trajectory_setpoint")[0]
    assert [*sent.velocity] == [1.5, -2.25, 0.5]
    assert sent.yaw == 0.75
    free = (*sent.position, *sent.acceleration, *sent.jerk, sent.yawspeed)
    assert all(math.isnan(part) for part in free)
    assert rig.link.counters()["setpoints_sent"] == 3


def test_an_acceleration_goes_with_it(rig):
    rig.flown().link.send_setpoint(Setpoint(Ned((1.0, 0.0, 0.0)), Ned((0.5, 0.25, 0.0))))
    assert until(lambda: bool(rig.peer.of("trajectory_setpoint")))
    (sent,) = rig.peer.of("trajectory_setpoint")
    assert [*sent.acceleration] == [0.5, 0.25, 0.0]
    assert math.isnan(sent.yaw)


@pytest.mark.parametrize("nav_state", [HOLD, 2, 14, PURSUIT + 1])
def test_outside_the_mode_nothing_is_sent(rig, nav_state):
    rig.flown()
    rig.says(nav_state=nav_state, arming_state=2)
    rig.link.send_setpoint(FLY)
    # What is sent later arrives later
    rig.link.request(PX4.set_mode(Mode.HOLD))
    assert until(lambda: bool(rig.peer.of("vehicle_command")))
    assert rig.peer.of("trajectory_setpoint") == []
    assert rig.link.counters()["setpoints_withheld"] == 1


def test_the_guided_mode_is_asked_for_by_its_number(rig):
    rig.link.request(PX4.as_mode.set_mode(Mode.GUIDED))
    assert until(lambda: bool(rig.peer.of("vehicle_command")))
    (command,) = rig.peer.of("vehicle_command")
    assert (command.command, command.param1) == (100001, PURSUIT)
    assert rig.hear(lambda: bool(rig.of(CommandAck)))


def test_when_guidance_leaves_its_mode_the_mode_is_completed(rig):
    rig.flown().link.request(PX4.set_mode(Mode.RETURN))
    assert until(lambda: bool(rig.peer.of("vehicle_command_mode_executor")))
    assert until(lambda: bool(rig.peer.of("mode_completed")))
    (command,) = rig.peer.of("vehicle_command_mode_executor")
    assert (command.command, command.param2, command.param3) == (176, 4.0, 5.0)
    assert command.source_component == 1001


def test_a_command_that_acts_goes_out_once_even_without_an_answer(rig):
    rig.peer.answers = False
    rig.link.request(PX4.arm())
    assert until(lambda: bool(rig.peer.of("vehicle_command")))
    for _ in range(3):
        rig.link.receive()
    assert len(rig.peer.of("vehicle_command")) == 1


def test_what_this_wire_does_not_carry_is_counted_and_not_guessed(rig):
    rig.link.request(ParameterRequest("COM_RC_OVERRIDE"))
    assert rig.link.counters()["requests_unsupported"] == 1
    rig.link.request(Command(511, (32.0, 20000.0, 0.0, 0.0, 0.0, 0.0, 0.0)))  # PX4 streams anyway
    assert rig.peer.of("vehicle_command") == []


def test_garbage_and_another_version_are_dropped_counted_and_named(rig, router):
    rig.peer.send("vehicle_land_detected", b"\0\1\0\0 too short")
    rig.peer.send("vehicle_land_detected", bytes(5000))
    rig.peer.send("vehicle_land_detected", b"\0\0" + encoded("VehicleLandDetected")[2:])
    kind = TYPES["VehicleLocalPosition"]
    other = kind.key(rig.peer.domain_id, "fmu/out/vehicle_local_position")[:-4] + "0000"
    router.session.put(other, encoded("VehicleLocalPosition"))
    rig.peer.local_position(7)
    assert rig.hear(lambda: bool(rig.of(LocalPosition)))
    assert rig.hear(lambda: rig.link.counters()["invalid"] == 3)
    assert rig.link.counters()["other_version"] == 1
    assert rig.link.other_versions["vehicle_local_position"] == other


def test_closing_takes_the_mode_off_the_list_and_then_there_is_silence(rig):
    rig.flown().link.close()
    rig.link.close()
    assert until(lambda: bool(rig.peer.of("unregister_ext_component")))
    (gone,) = rig.peer.of("unregister_ext_component")
    assert (gone.mode_id, gone.arming_check_id, gone.mode_executor_id) == (PURSUIT, 0, 1)
    before = len(rig.peer.heard)
    rig.link.send_setpoint(FLY)
    rig.link.request(PX4.arm())
    rig.link.send_heartbeat()
    assert rig.link.receive() == []
    assert len(rig.peer.heard) == before


def test_the_same_name_gets_the_same_place_again(router, peer):
    with beating(peer):
        for _ in range(2):
            link = opened(router, peer)
            link.close()
    names = {bytes(request.name) for request in peer.of("register_ext_component_request")}
    assert len(names) == 1


def test_eight_modes_are_an_error_that_says_what_to_do(router, peer):
    peer.free_modes = 0
    with beating(peer), pytest.raises(LinkError, match="refused the mode 'Pursuit': all eight"):
        opened(router, peer)


def test_in_the_air_the_link_opens_without_the_mode(router, peer):
    peer.armed = True
    with beating(peer):
        link = opened(router, peer)
    try:
        assert link.mode.registration is None
        assert until(lambda: bool(link.mode.refused))
        assert "on the ground only" in link.mode.refused
        link.send_setpoint(FLY)
        assert link.counters()["setpoints_withheld"] == 1
    finally:
        link.close()


def test_a_silent_router_is_an_error_that_names_the_module(router, peer):
    with pytest.raises(LinkError, match=r"no VehicleStatus within 0.3 s; .*ZENOH_ENABLE"):
        opened(router, peer, timeout_s=0.3)


def test_another_version_of_the_status_is_named(router, peer):
    key = TYPES["VehicleStatus"].key(peer.domain_id, "fmu/out/vehicle_status")[:-2] + "00"
    stop = threading.Event()

    def say() -> None:
        while not stop.wait(0.02):
            router.session.put(key, encoded("VehicleStatus"))

    thread = threading.Thread(target=say)
    thread.start()
    try:
        with pytest.raises(LinkError, match=r"another version of VehicleStatus .*v1\.17"):
            opened(router, peer, timeout_s=0.5)
    finally:
        stop.set()
        thread.join()


def test_a_registration_that_is_not_answered_is_named(router, peer):
    peer.answers = False
    with beating(peer), pytest.raises(LinkError, match="did not answer the registration"):
        opened(router, peer, timeout_s=0.5)


def test_another_system_id_is_refused(router, peer):
    peer.system_id = 9
    with beating(peer), pytest.raises(LinkError, match=r"system 9, not vehicle\.system_id = 1"):
        opened(router, peer, system_id=1)


def test_a_name_that_px4_cannot_keep_is_refused(router, peer):
    with pytest.raises(ConfigError, match=r"vehicle\.mode_name = .*24 printable ASCII"):
        opened(router, peer, mode_name="x" * 25)


def test_where_no_router_runs_the_link_is_one():
    port = free_port(socket.SOCK_STREAM)
    with pytest.raises(LinkError, match="no VehicleStatus"):  # it listened; nobody came
        open_px4_link(
            parse(f"zenoh+tcp://127.0.0.1:{port}"),
            mode_name="Pursuit",
            beside=None,
            clock=time.monotonic,
            credentials=NO_CREDENTIALS,
            timeout_s=0.2,
        )


def test_after_a_router_restarts_px4_is_heard_and_answered_again():
    """Catches a link that needs a restart of its own, while PX4 itself comes back a second after its router."""
    port = free_port(socket.SOCK_STREAM)
    with (
        zenoh.open(router_config(port)) as session,
        closing(Px4Peer(session)) as peer,
        beating(peer),
    ):
        link = opened(Router(port, session), peer)
    with (
        closing(link),
        zenoh.open(router_config(port)) as session,
        closing(Px4Peer(session)) as peer,
    ):
        before_us = link.mode.status.timestamp
        link.tell(Readiness(math.inf))
        with beating(peer):
            assert until(lambda: link.mode.status.timestamp != before_us, timeout_s=20.0)
        peer.ask()
        assert until(lambda: bool(peer.of("arming_check_reply")))
        assert link.mode.registration == (PURSUIT, 0, 1)


def test_a_setpoint_that_waited_too_long_is_not_sent(router, peer):
    now_s = [time.monotonic()]

    def clock() -> float:
        # The sender looks later than the loop, once the loop has sent
        late = threading.current_thread() is not threading.main_thread()
        return time.monotonic() + (now_s[0] if late else 0.0)

    now_s[0] = 0.0
    url = f"zenoh+tcp://127.0.0.1:{router.port}/{peer.domain_id}"
    with beating(peer):
        link = open_px4_link(
            parse(url),
            mode_name="Pursuit",
            beside=None,
            clock=clock,
            credentials=NO_CREDENTIALS,
            timeout_s=3.0,
        )
    try:
        Rig(link, peer).flown()
        now_s[0] = 0.2
        link.send_setpoint(FLY)
        assert until(lambda: link.counters()["setpoints_late"] == 1)
        assert peer.of("trajectory_setpoint") == []
    finally:
        link.close()
