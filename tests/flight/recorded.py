"""What two real autopilots said of their frames in a whole chase, as typed messages: see tests/data/README.md."""

import csv
from pathlib import Path
from types import SimpleNamespace

from guidance.links.mavlink.codec import DECODERS

_DATA = Path(__file__).parents[1] / "data"
_FIELDS = {
    "HEARTBEAT": ("custom_mode", "base_mode", "system_status"),
    "HOME_POSITION": ("latitude", "longitude", "altitude", "x", "y", "z"),
    "GPS_GLOBAL_ORIGIN": ("latitude", "longitude", "altitude"),
    "LOCAL_POSITION_NED": ("time_boot_ms", "x", "y", "z", "vx", "vy", "vz"),
    "GLOBAL_POSITION_INT": ("time_boot_ms", "lat", "lon", "alt", "relative_alt"),
    "ODOMETRY": ("reset_counter",),
    "EXTENDED_SYS_STATE": ("landed_state",),
}
_INTEGERS = set().union(*_FIELDS.values()) - set("xyz") - {"vx", "vy", "vz"}


def messages(autopilot, number):
    """All messages in order; `number` is what its HEARTBEAT calls itself."""
    with (_DATA / f"{autopilot}_frame.csv").open(newline="") as lines:
        rows = csv.reader(lines)
        next(rows)
        for at_s, name, *values in rows:
            fields = {"autopilot": number, "type": 2, "vx": 0, "vy": 0, "vz": 0}
            for key, value in zip(_FIELDS[name], values, strict=True):
                fields[key] = int(value) if key in _INTEGERS else float(value)
            yield DECODERS[name](SimpleNamespace(**fields), float(at_s))
