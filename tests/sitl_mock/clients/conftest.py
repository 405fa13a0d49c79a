"""Real clients beside a mock in a child process: MAVSDK over UDP and over raw:// on Zenoh, in real time."""

import contextlib
import json
import threading
import time

import pytest
import zenoh
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.offboard import Offboard
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import Telemetry

from sitl_mock.child import running
from sitl_mock.transports.zenoh_session import configuration

SWIFT = {
    "px4": {
        "MIS_TAKEOFF_ALT": 4.0,
        "MPC_TKO_SPEED": 3.0,
        "MPC_TKO_RAMP_T": 0.5,
        "COM_SPOOLUP_TIME": 0.2,
        "RTL_RETURN_ALT": 4.0,
        "RTL_DESCEND_ALT": 4.0,
        "MPC_LAND_SPEED": 1.5,
        "MPC_XY_CRUISE": 10.0,
        "MPC_ACC_HOR": 10.0,
        "MPC_JERK_AUTO": 60.0,
        "MPC_XY_P": 1.8,
        "COM_DISARM_LAND": 0.3,
    },
    "arducopter": {"RTL_ALT": 300, "LAND_SPEED": 150, "WPNAV_SPEED": 1000, "PILOT_SPEED_UP": 500},
    "rover": {},
}
"""Parameters that make a flight short."""


class Client:
    """A MAVSDK instance that has found the vehicle, with the plugins most flights use."""

    def __init__(self, vehicle, mavsdk, system):
        self.vehicle = vehicle
        self.mavsdk = mavsdk
        self.system = system
        self.telemetry = Telemetry(system)
        self.action = Action(system)
        self.offboard = Offboard(system)
        self.param = Param(system)

    def wait(self, condition, within_s, what=""):
        """Wait in real time; the seconds it took."""
        begin = time.monotonic()
        while not condition():
            assert time.monotonic() - begin < within_s, what or f"not within {within_s} s"
            time.sleep(0.02)
        return time.monotonic() - begin

    def ready(self, within_s=15.0):
        """Wait until it can be armed."""
        self.wait(
            lambda: self.telemetry.health_all_ok() and self.telemetry.health().is_armable, within_s
        )
        return self

    @property
    def height_m(self):
        return self.telemetry.position().relative_altitude_m


@contextlib.contextmanager
def bridged(mavsdk, vehicle):
    """MAVSDK's raw connection on the vehicle's two keys; the subscriber goes before the instance is destroyed."""
    with zenoh.open(configuration("client", vehicle.zenoh, connect=True)) as session:
        publisher = session.declare_publisher(
            f"{vehicle.namespace}/mavlink_raw/in",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )
        handle = mavsdk.subscribe_raw_bytes_to_be_sent(
            lambda data, *_: publisher.put(bytes(getattr(data, "bytes", data)))
        )
        passing = threading.Lock()
        there = True

        def pass_on(sample):
            with passing:  # one that is under way ends before the instance does
                if there:
                    mavsdk.pass_received_raw_bytes(bytes(sample.payload))

        subscriber = session.declare_subscriber(
            f"{vehicle.namespace}/mavlink_raw/out", pass_on, allowed_origin=zenoh.Locality.REMOTE
        )
        mavsdk.add_any_connection("raw://")
        try:
            yield
        finally:
            with passing:
                there = False
            subscriber.undeclare()
            mavsdk.unsubscribe_raw_bytes_to_be_sent(handle)


@contextlib.contextmanager
def connected(vehicle, over="udp", component=ComponentType.COMPANION_COMPUTER):
    """A client of a vehicle over UDP or Zenoh."""
    with contextlib.ExitStack() as stack:
        mavsdk = stack.enter_context(Mavsdk(Configuration.create_with_component_type(component)))
        if over == "udp":
            mavsdk.add_any_connection(vehicle.udp)
        else:
            stack.enter_context(bridged(mavsdk, vehicle))
        system = mavsdk.first_autopilot(10.0)
        assert system is not None, "no autopilot found within 10 s"
        yield Client(vehicle, mavsdk, system)


@pytest.fixture(scope="session")
def fleet_of():
    """``fleet_of({"uav1": "px4"})``: a context with a running fleet whose flights are short."""

    @contextlib.contextmanager
    def start(vehicles, **more):
        tables = [
            {"name": name, "flavour": flavour, "ready_after_s": 1.0, "parameters": SWIFT[flavour]}
            for name, flavour in vehicles.items()
        ]
        with running(tables, **more) as fleet:
            yield fleet

    return start


@pytest.fixture(scope="session")
def client_of():
    """``client_of(vehicle, "udp" or "zenoh")``: a context with a client of a vehicle."""
    return connected


@pytest.fixture(scope="session")
def bridge_of():
    """``bridge_of(mavsdk, vehicle)``: a context in which raw:// goes over Zenoh."""
    return bridged


@pytest.fixture(scope="session")
def inject():
    """``with inject(vehicle, kind=...)``: a fault while the block runs, put in place over Zenoh."""

    @contextlib.contextmanager
    def struck(vehicle, **fault):
        with zenoh.open(configuration("client", vehicle.zenoh, connect=True)) as session:

            def ask(request):
                (reply,) = list(
                    session.get(f"{vehicle.name}/faults", payload=json.dumps(request), timeout=5.0)
                )
                assert reply.ok is not None, bytes(reply.err.payload)
                time.sleep(0.03)  # it holds from the mock's next cycle
                return json.loads(bytes(reply.ok.payload))

            ask({"do": "inject", **fault})
            try:
                yield
            finally:
                ask({"do": "clear"})

    return struck
