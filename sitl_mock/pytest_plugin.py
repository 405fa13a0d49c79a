"""pytest fixtures: a mock vehicle or a fleet for any test suite; loaded by pytest once the package is installed.

    def test_my_client_arms(mock_vehicle):
        vehicle = mock_vehicle("px4", ready_after_s=1.0)           # a child process in real time
        client = connect(vehicle.udp)                              # udpin://127.0.0.1:<a free port>
        ...                                                        # or vehicle.zenoh and vehicle.namespace

    def test_my_loop(mock_vehicle):
        vehicle = mock_vehicle.stepped("px4", ready_after_s=0.5)   # in process, moved by your clock
        frames = vehicle.step(0.02, [my_frame])

    def test_two(mock_fleet):
        fleet = mock_fleet({"uav1": "px4", "evader": "rover"}, ready_after_s=1.0)
        connect(fleet["uav1"].udp)

    @pytest.mark.mock_versions("px4", "arducopter")                # every version of these flavours; default: of all
    def test_my_client_arms_every_version(mock_vehicle, mock_flavour):
        vehicle = mock_vehicle(mock_flavour, ready_after_s=1.0)    # px4@1.17, px4@1.18, arducopter@4.5, ...

Ports are picked free and names are namespaces of a session of their own, so suites can run beside each other.
Everything ends with the test, also when it fails; the children end by themselves when pytest is killed. Nothing but
this file is imported before a fixture is used. A mock that several tests share: `sitl_mock.child.running` in a fixture
of any scope.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from sitl_mock.child import Over, RunningFleet, RunningVehicle
    from sitl_mock.faults import Faulted


def pytest_configure(config: pytest.Config) -> None:
    """Describe the marker."""
    config.addinivalue_line(
        "markers",
        "mock_versions(*flavours): run with `mock_flavour` as every version of these flavours (default: of all)",
    )


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Give `mock_flavour` the versions that the marker names."""
    if "mock_flavour" not in metafunc.fixturenames:
        return
    from sitl_mock.versions import NAMES, SPECS, specs_of  # noqa: PLC0415 - only on use

    marker = metafunc.definition.get_closest_marker("mock_versions")
    flavours = marker.args if marker is not None and marker.args else NAMES
    unknown = [name for name in flavours if name not in SPECS]
    if unknown:
        raise pytest.UsageError(f"mock_versions({unknown[0]!r}): allowed are {', '.join(SPECS)}")
    specs = list[str]()
    for name in flavours:
        if name in NAMES:
            specs += specs_of(name)
        else:
            specs.append(name)
    metafunc.parametrize("mock_flavour", specs)


class MockVehicles:
    """Makes vehicles and ends them with the test."""

    def __init__(self, stack: contextlib.ExitStack) -> None:
        self._stack = stack

    def __call__(
        self,
        flavour: str = "px4",
        name: str = "uav1",
        *,
        over: Sequence[Over] = ("udp", "zenoh"),
        faults: Mapping[str, Any] | None = None,
        seed: int = 0,
        speed: float = 1.0,
        lockstep: bool = False,
        **settings: Any,  # noqa: ANN401 - keys of a fleet file
    ) -> RunningVehicle:
        """Start a vehicle in real time.

        Args:
            flavour: px4, arducopter or rover, also with a version as px4@1.18.
            name: Its name and Zenoh namespace.
            over: udp, zenoh or both.
            faults: What shall go wrong: the tables of a faults file.
            seed: Of all randomness.
            speed: Seconds of the vehicle per real second.
            lockstep: Time advances only when a client asks for it (docs/mock.md).
            settings: Other keys of a vehicle in a fleet file: ready_after_s, parameters, start_ned_m, noise, ...

        Returns:
            Addresses of the vehicle.

        Raises:
            ConfigError: A key is unknown or wrong.
        """
        from sitl_mock.child import running  # noqa: PLC0415 - only on use

        table = {"name": name, "flavour": flavour, **settings}
        fleet = running(
            [table], over=over, faults=faults, seed=seed, speed=speed, lockstep=lockstep
        )
        return self._stack.enter_context(fleet)[name]

    def stepped(
        self,
        flavour: str = "px4",
        name: str = "uav1",
        *,
        faults: Mapping[str, Any] | None = None,
        **settings: Any,  # noqa: ANN401 - arguments of MockVehicle
    ) -> Faulted:
        """Make a vehicle in this process, moved by `step(now_s, frames_in)`.

        Args:
            flavour: px4, arducopter or rover.
            name: Its name, for the faults.
            faults: What shall go wrong: the tables of a faults file.
            settings: Other arguments of `sitl_mock.MockVehicle`.

        Returns:
            The vehicle; `.vehicle` is the `MockVehicle` inside, with its true motion and mode.

        Raises:
            ConfigError: A key is unknown or wrong.
        """
        from sitl_mock import MockVehicle  # noqa: PLC0415 - as above
        from sitl_mock.faults import Faulted, parse_script  # noqa: PLC0415 - as above

        script = parse_script({} if faults is None else faults)
        return Faulted(MockVehicle(flavour, **settings), name, script)


@pytest.fixture
def mock_vehicle() -> Iterator[MockVehicles]:
    """Make mock vehicles: `mock_vehicle("px4")` in real time, `mock_vehicle.stepped("px4")` by your clock."""
    with contextlib.ExitStack() as stack:
        yield MockVehicles(stack)


@pytest.fixture
def mock_fleet() -> Iterator[Callable[..., RunningFleet]]:
    """Make fleets: `mock_fleet({"uav1": "px4", "evader": "rover"})`, or `mock_fleet(20)` PX4s uav1 to uav20.

    `mock_fleet(["px4", "rover"])` names them uav1 and uav2.

    Keyword arguments: over, faults, seed, speed and lockstep as for `mock_vehicle`; all others are keys of every
    vehicle. Where vehicles differ, give their tables:
    `mock_fleet([{"name": "uav1", "flavour": "px4", "start_ned_m": [9, 0, 0]}])`.
    """
    with contextlib.ExitStack() as stack:

        def start(
            vehicles: int | dict[str, str] | Sequence[str | Mapping[str, Any]] = 2,
            *,
            over: Sequence[Over] = ("udp", "zenoh"),
            faults: Mapping[str, Any] | None = None,
            seed: int = 0,
            speed: float = 1.0,
            lockstep: bool = False,
            **common: Any,  # noqa: ANN401 - keys of a fleet file
        ) -> RunningFleet:
            from sitl_mock.child import running  # noqa: PLC0415 - only on use

            tables = [{**common, **table} for table in fleet_tables(vehicles)]
            fleet = running(
                tables, over=over, faults=faults, seed=seed, speed=speed, lockstep=lockstep
            )
            return stack.enter_context(fleet)

        yield start


def fleet_tables(
    vehicles: int | dict[str, str] | Sequence[str | Mapping[str, Any]],
) -> Sequence[Mapping[str, Any]]:
    """Return the tables of a fleet: so many PX4 vehicles, or flavours by name, or a list of flavours and tables."""
    if isinstance(vehicles, int):
        return [{"name": f"uav{number}", "flavour": "px4"} for number in range(1, vehicles + 1)]
    if isinstance(vehicles, dict):
        return [{"name": name, "flavour": flavour} for name, flavour in vehicles.items()]
    tables: list[Mapping[str, Any]] = []
    for number, vehicle in enumerate(vehicles, 1):
        if isinstance(vehicle, str):
            tables.append({"name": f"uav{number}", "flavour": vehicle})
        else:
            tables.append(vehicle)
    return tables
