"""Whole flights with MAVProxy's commands, for a real ArduCopter and for the mock: the commands and their times."""

import math
import time

HOME = (-35.363262, 149.165237, 584.0)
M_PER_DEG = 111_319.49

_GUIDED = [(0.0, "mode GUIDED"), (2.0, "arm throttle"), (4.0, "takeoff 10")]
_RELATIVE = 3
_WAYPOINT = 16
_TAKEOFF = 22
_RETURN = 20


def place(north_m, east_m):
    lat = HOME[0] + north_m / M_PER_DEG
    return lat, HOME[1] + east_m / M_PER_DEG / math.cos(math.radians(HOME[0]))


def plan(*items):
    """A waypoint file: command, frame, param1, north, east, height of each."""
    lines = ["QGC WPL 110"]
    for seq, (command, frame, param1, north, east, height) in enumerate(items):
        lat, lon = place(north, east)
        row = (
            seq,
            int(seq == 0),
            frame,
            command,
            param1,
            0,
            0,
            0,
            f"{lat:.7f}",
            f"{lon:.7f}",
            height,
            1,
        )
        lines.append("\t".join(str(each) for each in row))
    return "\n".join(lines) + "\n"


FILES = {
    "mission.txt": plan(
        (_WAYPOINT, 0, 0, 0.0, 0.0, HOME[2]),
        (_TAKEOFF, _RELATIVE, 0, 0.0, 0.0, 10.0),
        (_WAYPOINT, _RELATIVE, 0, 30.0, 0.0, 10.0),
        (_WAYPOINT, _RELATIVE, 2, 30.0, 20.0, 15.0),
        (_WAYPOINT, _RELATIVE, 0, 0.0, 20.0, 10.0),
        (_RETURN, 0, 0, 0.0, 0.0, 0.0),
    ),
    "fence.txt": plan(
        *(
            (5001, 0, 4, n, e, 0)
            for n, e in ((25.0, 25.0), (25.0, -25.0), (-25.0, -25.0), (-25.0, 25.0))
        )
    ),
    "rally.txt": plan((5100, _RELATIVE, 0, 40.0, 20.0, 12.0)),
}

FLIGHTS = {
    "takeoff_and_land": [*_GUIDED, (18.0, "mode LAND"), (45.0, "")],
    "velocity": [
        *_GUIDED,
        *((18.0 + n, "velocity 3 0 0") for n in range(6)),
        *((24.0 + n, "velocity 0 2 -1") for n in range(4)),
        (36.0, "position 10 0 2"),
        (48.0, "velocity -2 0 0"),
        (58.0, ""),
    ],
    "setyaw": [
        *_GUIDED,
        (18.0, "setyaw 90 20 0"),
        (26.0, "setyaw 45 30 1"),
        (32.0, "velocity 2 0 0"),
        (33.0, "velocity 2 0 0"),
        (34.0, "velocity 2 0 0"),
        (42.0, "setyaw 270 0 0"),
        (50.0, ""),
    ],
    "circle": [
        *_GUIDED,
        (17.0, "rc 3 1500"),
        (18.0, "mode CIRCLE"),
        (48.0, "mode BRAKE"),
        (55.0, ""),
    ],
    "mission": [
        (0.0, "wp load mission.txt"),
        (3.0, "wp list"),
        (6.0, "mode GUIDED"),
        (7.0, "arm throttle"),
        (9.0, "mode AUTO"),
        (10.0, "rc 3 1500"),
        (85.0, ""),
    ],
    "fence": [
        (0.0, "fence load fence.txt"),
        (3.0, "param set AVOID_ENABLE 0"),
        (4.0, "param set FENCE_TYPE 4"),
        (5.0, "fence enable"),
        (6.0, "mode GUIDED"),
        (8.0, "arm throttle"),
        (10.0, "takeoff 10"),
        *((24.0 + n, "velocity 5 0 0") for n in range(6)),
        (75.0, ""),
    ],
    "avoidance": [
        (0.0, "fence load fence.txt"),
        (4.0, "param set FENCE_TYPE 4"),
        (5.0, "fence enable"),
        (6.0, "mode GUIDED"),
        (8.0, "arm throttle"),
        (10.0, "takeoff 10"),
        *((24.0 + n, "velocity 5 0 0") for n in range(10)),
        (40.0, ""),
    ],
    "rally": [
        (0.0, "rally load rally.txt"),
        (3.0, "mode GUIDED"),
        (5.0, "arm throttle"),
        (7.0, "takeoff 10"),
        *((20.0 + n, "velocity 5 0 0") for n in range(4)),
        (30.0, "mode RTL"),
        (80.0, ""),
    ],
}
"""Commands by seconds since MAVProxy has received the vehicle's parameters; the last one ends the flight."""


def fly(proxy, folder, name):
    """Fly one of them."""
    for file, text in FILES.items():
        (folder / file).write_text(text)
    proxy.expect("Detected vehicle 1:1", 20.0)
    proxy.expect("Received", 60.0)
    begun_s = time.monotonic()
    for at_s, command in FLIGHTS[name]:
        time.sleep(max(0.0, begun_s + at_s - time.monotonic()))
        if command:
            proxy.say(command)
