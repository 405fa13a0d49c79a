"""Whose time it is: `--speed` scales it, `--lockstep` gives it to the client."""

import contextlib
import multiprocessing
import socket
import time
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import all as dialect
from typer.testing import CliRunner

from sitl_mock import MockVehicle
from sitl_mock.cli import app
from sitl_mock.errors import ConfigError
from sitl_mock.faults import Faulted, FaultScript
from sitl_mock.mavlink import Decoder, Encoder
from sitl_mock.px4.messages import message_type
from sitl_mock.px4.topic_link import PUBLISHED, SUBSCRIBED, frame_of, sample_of
from sitl_mock.serving.serve import Pace
from sitl_mock.transports import Arrival
from sitl_mock.transports.lockstep import STEP, Lockstep, frames_of
from sitl_mock.transports.loop import Loop
from sitl_mock.vehicle.link import TOPICS
from tests.harness.stepper import Stepper, long, take_off

ACCEPTED = 0
DENIED = 2


class Wire:
    """An endpoint in memory."""

    def __init__(self):
        self.dropped = 0
        self.arrivals = []
        self.sent = []

    def filenos(self):
        return [0]

    def receive(self):
        arrivals = self.arrivals
        self.arrivals = []
        return arrivals

    def send(self, vehicle, link, frames):
        self.sent += [(vehicle, frame) for frame in frames]

    def describe(self):
        return {}

    def close(self):
        pass


class Client:
    """A client of a fleet in lockstep: it sends frames, and reads what came until the answer."""

    def __init__(self, *names, **more):
        vehicles = {
            name: Faulted(
                MockVehicle("px4", ready_after_s=0.5, system_id=number, **more), name, FaultScript()
            )
            for number, name in enumerate(names, start=1)
        }
        self.vehicles = {name: faulted.vehicle for name, faulted in vehicles.items()}
        self.wire = Wire()
        self.lockstep = Lockstep(vehicles, [self.wire])
        self.encoder = Encoder(255, 190)
        self.decoder = Decoder()
        self.number = 0

    def send(self, *frames, name="uav1"):
        """Send frames in one datagram; return the messages that came."""
        self.wire.sent.clear()
        self.wire.arrivals.append(Arrival(name, "onboard", b"".join(frames)))
        self.lockstep.cycle()
        return [
            message
            for _, frame in self.wire.sent
            for message in self.decoder.feed(frame, whole=True)
        ]

    def step_frame(self, length_s, number, target=1):
        return self.encoder.pack("COMMAND_LONG", target, 1, STEP, 0, length_s, number, *[0.0] * 5)

    def step(self, length_s, *frames, name="uav1", target=1):
        self.number += 1
        return self.send(*frames, self.step_frame(length_s, self.number, target), name=name)


def boot_ms(messages):
    return [m.time_boot_ms for m in messages if m.get_type() == "ATTITUDE"]


def test_time_stands_still_without_a_step():
    client = Client("uav1")
    beat = client.encoder.pack("HEARTBEAT", 6, 8, 0, 0, 4, 3)
    for _ in range(5):
        assert boot_ms(client.send(beat)) == []
    assert client.vehicles["uav1"].autopilot.state.now_s == 0.0


def test_a_step_advances_by_its_length_and_is_answered_last():
    client = Client("uav1")
    messages = client.step(0.5)
    assert messages[-1].get_type() == "COMMAND_ACK"
    assert (messages[-1].command, messages[-1].result) == (STEP, ACCEPTED)
    assert messages[-1].result_param2 == 1
    assert (messages[-1].target_system, messages[-1].target_component) == (255, 190)
    assert boot_ms(messages)[-1] == pytest.approx(500, abs=1)
    assert boot_ms(client.step(0.25))[-1] == pytest.approx(750, abs=1)


class TestTopics:
    """PX4's topics beside MAVLink."""

    @pytest.fixture
    def client(self):
        return Client("uav1", links={"onboard": "onboard", "topics": TOPICS})

    def sent(self, client, topic):
        kind = message_type(PUBLISHED[topic])
        samples = [sample_of(frame) for _, frame in client.wire.sent]
        return [kind.read(payload) for name, payload in samples if name == topic]

    def take(self, client, topic, **values):
        kind = message_type(SUBSCRIBED[topic])
        data = frame_of(topic, kind.encoded(**values)[: 4 + kind.size])
        client.wire.arrivals.append(Arrival("uav1", "topics", data))
        client.lockstep.cycle()

    def test_a_step_sends_the_samples_of_its_time(self, client):
        client.step(0.5)
        stamps_us = [one.timestamp for one in self.sent(client, "vehicle_local_position")]
        assert len(stamps_us) == pytest.approx(0.5 * 125, abs=2)
        assert stamps_us[-1] == pytest.approx(500_000, abs=8000)
        client.step(0.25)
        assert self.sent(client, "vehicle_local_position")[0].timestamp > stamps_us[-1]

    def test_a_sample_between_steps_is_answered_by_the_next_one(self, client):
        client.step(0.5)
        wish = {"register_mode": 1, "register_arming_check": 1, "px4_ros2_api_version": 1}
        self.take(client, "register_ext_component_request", request_id=7, **wish)
        assert client.vehicles["uav1"].autopilot.state.now_s == pytest.approx(0.5)
        client.step(0.1)
        (reply,) = self.sent(client, "register_ext_component_reply")
        assert (reply.request_id, reply.success) == (7, True)
        assert 500_000 < reply.timestamp <= 600_000

    def test_a_program_over_topics_does_not_end_the_greeting_of_clients(self, client):
        self.take(client, "vehicle_command", command=16)
        client.wire.sent.clear()
        client.lockstep.say_hello()
        assert client.wire.sent
        client.step(0.5)
        client.wire.sent.clear()
        client.lockstep.say_hello()
        assert client.wire.sent == []


def test_a_repeated_step_is_answered_and_not_flown_again():
    client = Client("uav1")
    frame = client.step_frame(0.5, 7)
    first = client.send(frame)
    again = client.send(frame)
    assert [m.get_type() for m in again] == ["COMMAND_ACK"]
    assert again[0].result_param2 == first[-1].result_param2 == 7
    assert client.vehicles["uav1"].autopilot.state.now_s == pytest.approx(0.5)


def test_frames_before_a_step_count_before_it_and_those_behind_it_after():
    client = Client("uav1")
    client.step(1.0)
    arm = client.encoder.pack("COMMAND_LONG", 1, 1, 400, 0, 1.0, *[0.0] * 6)
    number = client.number = client.number + 1
    client.send(client.step_frame(0.5, number), arm)
    state = client.vehicles["uav1"].autopilot.state
    assert state.armed_s == pytest.approx(1.5)


@pytest.mark.parametrize("length_s", [0.0, -1.0, 1.5, float("nan"), float("inf")])
def test_a_step_of_no_length_is_denied(length_s):
    client = Client("uav1")
    answer = client.step(length_s)[-1]
    assert (answer.command, answer.result) == (STEP, DENIED)
    assert client.vehicles["uav1"].autopilot.state.now_s == 0.0


def test_vehicles_have_a_time_each_and_a_step_for_another_one_is_ignored():
    client = Client("uav1", "uav2")
    client.step(0.5, name="uav2", target=2)
    client.step(0.5, name="uav1", target=2)
    times = [vehicle.autopilot.state.now_s for vehicle in client.vehicles.values()]
    assert times == pytest.approx([0.0, 0.5])


def numberless(frame):
    """A frame without its sequence number and checksum."""
    return frame[:4] + frame[5:-2]


def test_the_steps_length_does_not_change_what_is_sent():
    small = Client("uav1")
    large = Client("uav1")
    each = [bytes(m.get_msgbuf()) for _ in range(100) for m in small.step(0.02)[:-1]]
    whole = [bytes(m.get_msgbuf()) for _ in range(2) for m in large.step(1.0)[:-1]]
    assert list(map(numberless, each)) == list(map(numberless, whole))


def test_the_first_frames_are_repeated_until_somebody_speaks():
    client = Client("uav1")
    client.lockstep.say_hello()
    first = list(client.wire.sent)
    (message,) = client.decoder.feed(first[0][1], whole=True)
    assert message.get_type() == "HEARTBEAT"
    client.wire.sent.clear()
    client.lockstep.say_hello()
    assert client.wire.sent == first
    client.step(0.1)
    client.wire.sent.clear()
    client.lockstep.say_hello()
    assert client.wire.sent == []


def test_bytes_that_are_no_frames_are_the_decoders_business():
    client = Client("uav1")
    assert list(frames_of(b"junk")) == [b"junk"]
    client.send(b"junk")
    assert client.vehicles["uav1"].counters()["onboard"]["garbage_bytes"] == 4


class Clock:
    now_s = 0.0

    def __call__(self):
        return self.now_s


@pytest.mark.parametrize("speed", [1.0, 5.0, 0.5])
def test_the_loop_wakes_for_every_tick_of_faster_time(speed):
    clock = Clock()
    loop = Loop({"uav1": MockVehicle("px4")}, [Wire()], clock, speed)
    loop.cycle()
    assert loop.wait_s() == pytest.approx(0.01 / speed, abs=2e-5)


def test_a_pause_of_the_process_is_left_out_at_any_speed():
    clock = Clock()
    vehicle = MockVehicle("px4")
    loop = Loop({"uav1": vehicle}, [Wire()], clock, 10.0)
    loop.cycle()
    clock.now_s = 9.0  # 0.9 s of real time
    loop.cycle()
    assert vehicle.autopilot.state.now_s == pytest.approx(9.0, abs=0.02)
    clock.now_s = 29.0  # 2 s of real time
    loop.cycle()
    assert vehicle.autopilot.state.now_s == pytest.approx(9.01, abs=0.02)


def test_the_clock_of_a_pace_runs_at_its_speed():
    pace = Pace(speed=10.0)
    began_s = pace.clock()
    real_s = time.monotonic()
    while time.monotonic() - real_s < 0.02:
        pass
    assert pace.clock() - began_s >= 0.2


def test_speed_and_lockstep_exclude_each_other():
    result = CliRunner().invoke(app, ["run", "--udp", "14540", "--lockstep", "--speed", "5"])
    assert isinstance(result.exception, ConfigError)


def test_what_others_send_to_a_clients_port_is_no_answer_of_the_vehicle():
    with contextlib.ExitStack() as closing:
        vehicle = closing.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        stranger = closing.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        vehicle.bind(("127.0.0.1", 0))
        client = Stepper(SimpleNamespace(udp_listens=vehicle.getsockname()[1]))
        closing.callback(client.wire.close)
        stranger.sendto(b"stray", client.wire.getsockname())
        vehicle.sendto(b"answer", client.wire.getsockname())
        assert client.wire.recv(2048) == b"answer"


def flown(make):
    """Take off in lockstep, in a process of its own."""
    return take_off(make("px4", ready_after_s=0.5, lockstep=True, over=("udp",)))


def busy(stop):
    while not stop.is_set():
        sum(range(1000))


@pytest.mark.slow
def test_in_lockstep_the_bytes_do_not_depend_on_the_load(mock_vehicle):
    digest, height_m = flown(mock_vehicle)
    assert height_m == pytest.approx(8.0, abs=1.0)
    stop = multiprocessing.Event()
    burners = [multiprocessing.Process(target=busy, args=(stop,), daemon=True) for _ in range(4)]
    for burner in burners:
        burner.start()
    try:
        assert flown(mock_vehicle) == (digest, height_m)
    finally:
        stop.set()
        for burner in burners:
            burner.join()


@pytest.mark.slow
def test_a_take_off_at_5_times_the_speed_takes_a_fifth(mock_vehicle):
    vehicle = mock_vehicle("px4", ready_after_s=0.5, speed=5.0, over=("udp",))
    wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    wire.settimeout(5.0)
    client = dialect.MAVLink(None, 255, 190)
    client.robust_parsing = True
    address = ("127.0.0.1", vehicle.udp_listens)
    nan = float("nan")
    times = []
    height_m = 0.0
    sent = 0
    real_s = time.monotonic()
    while height_m < 7.0 and time.monotonic() - real_s < 15.0:
        if time.monotonic() - real_s > 0.3 * (sent + 1) and sent < 4:
            command = long(400, 1) if sent % 2 else long(22, 0, 0, 0, nan, nan, nan, 496.0)
            wire.sendto(command.pack(client), address)
            sent += 1
        elif not times:
            wire.sendto(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(client), address)
        for message in client.parse_buffer(wire.recv(2048)) or []:
            if message.get_type() == "LOCAL_POSITION_NED":
                times.append((time.monotonic(), message.time_boot_ms * 1e-3))
                height_m = -message.z
    wire.close()
    assert height_m >= 7.0
    real_0_s, own_0_s = times[0]
    real_1_s, own_1_s = times[-1]
    assert (own_1_s - own_0_s) / (real_1_s - real_0_s) == pytest.approx(5.0, rel=0.1)
