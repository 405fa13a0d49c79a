"""A vehicle's file for tests; and a mock of the vehicle and its evader in a process of their own, over Zenoh."""

import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from sitl_mock.child import RunningFleet

SOON_UP_AND_DOWN = {
    "COM_SPOOLUP_TIME": 0.2,
    "MPC_TKO_RAMP_T": 0.5,
    "MPC_TKO_SPEED": 4.0,
    "MPC_LAND_SPEED": 1.5,
    "MPC_LAND_CRWL": 1.5,
    "COM_DISARM_LAND": 0.3,
}
"""Parameters of a PX4 that shorten take-off and landing, for tests of what lies between."""

FENCED = {"GF_MAX_HOR_DIST": 120.0, "GF_MAX_VER_DIST": 70.0, **SOON_UP_AND_DOWN}
"""Parameters of a PX4 that preflight finds nothing wrong with."""

DOCUMENT: Mapping[str, Any] = {
    "name": "uav1",
    "vehicle": {"autopilot": "px4", "url": "udpin://127.0.0.1:14540"},
    "evader": {"kind": "global_position", "url": "udpin://127.0.0.1:14541", "system_id": 2},
    "game": {
        "speed_m_s": 6.0,
        "evader_speed_m_s": 3.0,
        "standoff_radius_m": 6.0,
        "standoff_height_m": 5.0,
    },
    "limits": {"floor_m": 3.0, "ceiling_m": 60.0, "fence_radius_m": 100.0},
    "flight": {"takeoff_height_m": 5.0},
}


def document(**sections: Any) -> dict[str, Any]:
    """Return a whole configuration; sections given replace keys of the default ones."""
    return _merged(DOCUMENT, sections)


def mocked(name: str, flavour: str = "px4", **more: Any) -> dict[str, Any]:
    """Return a vehicle of a fleet that is soon ready; an evader is a rover with system id 2."""
    return {
        "name": name,
        "flavour": flavour,
        "system_id": 2 if flavour == "rover" else 1,
        "ready_after_s": 0.5,
        **more,
    }


def write_file(
    folder: Path, fleet: RunningFleet, name: str = "uav1", **sections: Any
) -> tuple[Path, str]:
    """Write the file of a vehicle of a fleet, whose `evader` is its evader.

    Args:
        folder: For the file, and for records.
        fleet: It runs, over Zenoh.
        name: The vehicle's; one that is not in the fleet is never heard.
        sections: They replace keys of the default ones.

    Returns:
        The file, and the endpoint that the daemon takes its orders at.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        control = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    at = fleet["evader"].zenoh.removeprefix("tcp/")
    here = document(
        name=name,
        vehicle={"url": f"zenoh://{at}/{name}"},
        evader={"url": f"zenoh://{at}/evader", "request_rate_hz": 20.0},
        flight={"on_terminate": "land"},
        control={"endpoint": control},
        record={"folder": str(folder)},
    )
    path = folder / f"{name}.toml"
    path.write_text(tomlkit.dumps(_merged(here, sections)), encoding="utf-8")
    return path, control


def _merged(base: Mapping[str, Any], sections: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for name, keys in sections.items():
        merged[name] = {**merged.get(name, {}), **keys} if isinstance(keys, dict) else keys
    return merged
