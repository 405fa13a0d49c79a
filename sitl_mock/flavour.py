"""What does not change in a vehicle: who it is, its rates, its parameters, its dynamics and its commander."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from sitl_mock.commander import Commander
from sitl_mock.dynamics import Vehicle, Wander
from sitl_mock.modes import ModeTable
from sitl_mock.protocols import (
    Files,
    Identity,
    MissionRules,
    Parameter,
    ParameterRules,
    ParameterStore,
    PlanStore,
    StreamRules,
)
from sitl_mock.protocols.files import FileTree
from sitl_mock.sensors import EXACT, SensorNoise
from sitl_mock.vehicle_state import VehicleState


def no_files(_parameters: ParameterStore, _plans: PlanStore) -> Files:
    """No files: an empty folder."""
    return FileTree({})


@dataclass(frozen=True)
class Flavour:
    """One kind of vehicle.

    Attributes:
        name: As on the command line.
        title: As in the documentation.
        autopilot: MAV_AUTOPILOT.
        vehicle_type: MAV_TYPE.
        modes: The table of modes.
        parameters: Their definitions.
        parameter_rules: How parameters are asked for and set.
        stream_rules: How rates are asked for.
        mission_rules: How plans are uploaded.
        rates_hz: Streams without being asked, by kind of link (onboard, gcs).
        identity: AUTOPILOT_VERSION of a vehicle with a number.
        plant: The dynamics under present parameters.
        commander: Makes a vehicle's commander.
        wander: Size of the estimator's error.
        sensors: Noise of its sensors.
        ground_wander: Size of the estimator's error on the ground; None where it rests.
        ready_s: From boot until it can be armed.
        texts: STATUSTEXT goes out on the links; None: on those that a ground station's heartbeats come by.
        event_of: The event that a text of a severity is sent as, where the flavour has events.
        own_id_only: Protocols that ignore messages to system 0.
        broadcast: Commands that are obeyed when sent to system 0; None for all.
        ground_vehicle: It cannot start in the air.
        fix_type: GPS_FIX_TYPE of a receiver that works.
        files: What a vehicle with these parameters and plans offers over FTP.
    """

    name: str
    title: str
    autopilot: int
    vehicle_type: int
    modes: ModeTable
    parameters: Iterable[Parameter]
    parameter_rules: ParameterRules
    stream_rules: StreamRules
    mission_rules: MissionRules
    rates_hz: Mapping[str, Mapping[str, float]]
    identity: Callable[[int], Identity]
    plant: Callable[[Mapping[str, float]], Vehicle]
    commander: Callable[[VehicleState, PlanStore], Commander]
    wander: Wander
    ready_s: float
    texts: bool | None
    own_id_only: frozenset[str] = frozenset()
    broadcast: frozenset[int] | None = None
    sensors: SensorNoise = EXACT
    ground_wander: Wander | None = None
    event_of: Callable[[int, str], tuple[int, int, bytes] | None] | None = None
    ground_vehicle: bool = False
    fix_type: int = 3
    files: Callable[[ParameterStore, PlanStore], Files] = no_files
