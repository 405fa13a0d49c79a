"""What is asked of the vehicle in each state; asked again until its effect is seen."""

from guidance.autopilots import GPS_GLOBAL_ORIGIN, HOME_POSITION, Mode
from guidance.flight.settings import EngageOn, FlightSettings
from guidance.flight.table import State
from guidance.frames import Amsl
from guidance.messages import Home, Request
from guidance.vehicle import VehicleState

_MODE_OF_STATE = {
    State.ENTERING: Mode.GUIDED,
    State.HOLDING: Mode.HOLD,
    State.RETURNING: Mode.RETURN,
    State.LANDING: Mode.LAND,
}


def requests_in(
    state: State,
    settings: FlightSettings,
    vehicle: VehicleState,
    mode: Mode | None,
    start: tuple[float, float, Amsl] | None,
) -> tuple[Request, ...]:
    """Return the requests of a state; none where its effect is there already.

    Args:
        state: Where the flight stands.
        settings: Of the flight.
        vehicle: As last heard.
        mode: What HEARTBEAT shows.
        start: Latitude and longitude in degrees and altitude of the place to stand by at, if there is one.
    """
    profile = settings.autopilot
    match state:
        case State.CHECKING:
            origin = profile.request_message(GPS_GLOBAL_ORIGIN)
            return (*profile.stream_requests(), profile.request_message(HOME_POSITION), origin)
        case State.ARMING:
            return (profile.set_mode(profile.arming_mode), profile.arm())
        case State.CLIMBING:
            return _takeoff(settings, vehicle)
        case State.POSITIONING if start is not None:
            latitude_deg, longitude_deg, altitude = start
            return (
                profile.reposition(
                    latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude.metres
                ),
            )
        case _:
            return _mode_request(state, settings, mode)


def _mode_request(state: State, settings: FlightSettings, mode: Mode | None) -> tuple[Request, ...]:
    wanted = _MODE_OF_STATE.get(state)
    if state is State.STANDING_BY and settings.engage_on is EngageOn.PILOT_MODE and mode is Mode.HOLD:
        # A PX4 that lost its setpoints goes back to OFFBOARD by itself when they return; asked to hold, it does not.
        wanted = Mode.HOLD
    elif mode is wanted:
        return ()
    return () if wanted is None else (settings.autopilot.set_mode(wanted),)


def _takeoff(settings: FlightSettings, vehicle: VehicleState) -> tuple[Request, ...]:
    home = vehicle.last(Home)
    if home is None or not vehicle.on_ground:
        return ()
    return (settings.autopilot.takeoff(height_m=settings.takeoff_height_m, home_amsl_m=home.altitude_amsl_m),)
