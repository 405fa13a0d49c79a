"""Flying a recording again: what others sent goes to a mock vehicle at the recorded times."""

from collections.abc import Iterator
from itertools import groupby

from sitl_mock.compare.tlog import Recording
from sitl_mock.mavlink import Decoder, Message
from sitl_mock.vehicle import MockVehicle
from sitl_mock.world import DEFAULT_HOME, Home

STEP_S = 0.01
BOOTED_S = 60.0
"""How long the mock has been running when the recording begins."""


def fly_recording(recording: Recording, *, seed: int = 0) -> list[tuple[float, Message]]:
    """Return time and message of all that a mock of the same kind sends to the recorded client.

    Rates that were asked for before the recording began are not known, and those a client asks for in it are obeyed.
    """
    vehicle = MockVehicle(
        recording.flavour,
        system_id=recording.system_id,
        home=_home(recording),
        seed=seed,
        links={"recorded": _kind(recording)},
        ready_after_s=0.0,
    )
    vehicle.step(-BOOTED_S)
    vehicle.step(-STEP_S)
    decoder = Decoder()
    said: list[tuple[float, Message]] = []
    for at_s, frames in _steps(recording):
        for frame in vehicle.step(at_s, frames):
            said += [(at_s, message) for message in decoder.feed(frame, whole=True)]
    return said


def _steps(recording: Recording) -> Iterator[tuple[float, list[bytes]]]:
    """Yield every step's time and the frames that came until then."""
    due = {
        number: [frame for _, frame in frames]
        for number, frames in groupby(recording.heard, key=lambda item: round(item[0] / STEP_S))
    }
    for number in range(round(recording.end_s / STEP_S) + 1):
        yield number * STEP_S, due.get(number, [])


def _home(recording: Recording) -> Home:
    for _, message in recording.said:
        if message.get_type() == "HOME_POSITION":
            return Home(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)
    return DEFAULT_HOME


def _kind(recording: Recording) -> str:
    """PX4 streams more to an onboard computer: HIGHRES_IMU shows it."""
    streams = {message.get_type() for _, message in recording.said}
    return "gcs" if recording.flavour == "px4" and "HIGHRES_IMU" not in streams else "onboard"
