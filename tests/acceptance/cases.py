"""The acceptance flights: scenario, link, interference in flight, and the conditions on the result."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

Row = Mapping[str, Any]


class Wanted(NamedTuple):
    """One condition on a flight's outcome row: its description, how to read the value, and whether the value passes."""

    words: str
    got: Callable[[Row], Any]
    held: Callable[[Any], bool]


def column(name: str) -> Callable[[Row], Any]:
    return lambda row: row.get(name)


def ends(word: str) -> Wanted:
    return Wanted(f"end: {word}", column("end"), lambda got: got == word)


def ratio(most: float) -> Wanted:
    return Wanted(
        f"flown/value ≤ {most:g}", column("ratio"), lambda got: got is not None and got <= most
    )


KEEPS_OFF = Wanted(
    "≥ 1.8 m from the evader", column("min_standoff_m"), lambda got: got is not None and got >= 1.8
)
"""The limit is 2 m, a metre inside the disc; positions are known to 0.2 m."""

EARLIER = Wanted("before the value", column("regret"), lambda got: got is not None and got < 0.0)
LOST_AND_FOUND = Wanted(
    "paused, then played on",
    lambda row: [
        event for event in row.get("events", ()) if event in {"evader lost", "all inputs back"}
    ],
    lambda got: got == ["evader lost", "all inputs back"],
)
SPEED_LIMIT = Wanted(
    "≤ 1.03 of limits.speed_m_s", column("overspeed"), lambda got: got is not None and got <= 1.03
)
PROMISE = Wanted(
    "promised time kept within 10 %", column("kept"), lambda got: got is not None and got <= 1.1
)
NOT_LATER = Wanted("no later alarm of the time", column("later"), lambda got: got == 0)
REFUSED = "evader too fast"
AT_FULL_SPEED = "it reached the game's speed"
AT_ITS_SPEED = Wanted(
    "captured at the game's speed or with the speed reported, or refused by name",
    lambda row: f"{row.get('end')}; {_speed_told(row)}",
    lambda got: (
        got.startswith(("captured; this vehicle reaches", f"captured; {AT_FULL_SPEED}"))
        or REFUSED in got
    ),
)


def _speed_told(row: Row) -> str:
    """What the flight reported of its speed. A vehicle that reaches the game's speed has nothing to report."""
    if row.get("reported"):
        return str(row["reported"])
    return AT_FULL_SPEED if row.get("reached", 0.0) >= 1.0 else str(row.get("reason"))


LOST_AS_SOLVED = Wanted(
    "predicted: evader", column("predicted_winner"), lambda got: got == "evader"
)
WON_AS_SOLVED = Wanted(
    "predicted: pursuer", column("predicted_winner"), lambda got: got == "pursuer"
)
WON_BY_VEHICLE = Wanted(
    "the vehicle's verdict: pursuer", column("vehicle_winner"), lambda got: got == "pursuer"
)
LOST_BY_VEHICLE = Wanted(
    "the vehicle's verdict: evader", column("vehicle_winner"), lambda got: got == "evader"
)

HONEST = (KEEPS_OFF, SPEED_LIMIT, PROMISE, NOT_LATER)
"""Conditions of every chase."""


@dataclass(frozen=True)
class Case:
    """One flight.

    `meddling` is the interference in flight: "pilot", "kill", "refuse", "hold" or "interrupt". `fence_m` limits the
    vehicle's distance from home. `prompt` also limits the time from the order to engagement. `autopilots` lists the
    mocks that fly the case when no URL is given; with `virtual` they fly it in virtual time, where no load disturbs it.
    """

    name: str
    link: str
    scenario: Mapping[str, Any]
    wanted: tuple[Wanted, ...] = ()
    meddling: str = ""
    fence_m: float | None = None
    prompt: bool = False
    autopilots: tuple[str, ...] = ("px4", "arducopter")
    virtual: bool = False


def scenario(
    title: str,
    *,
    height_m: float,
    u: float = 6.0,
    v: float = 3.0,
    away_m: float = 60.0,
    **sections: Mapping[str, Any],
) -> dict[str, Any]:
    """Return a scenario: hover at `height_m`, evader `away_m` to the north, R 3 m, h 5 m."""
    document: dict[str, Any] = {
        "title": title,
        "game": "pe",
        "hold_s": 0.5,
        "time_limit_s": 60.0,
        "pursuer": {
            "position_m": [0.0, 0.0, height_m],
            "speed_m_s": u,
            "speed_set": "cylinder",
            "takeoff_height_m": height_m,
        },
        "evader": {"position_m": [0.0, away_m], "speed_m_s": v},
        "standoff": {"radius_m": 3.0, "height_m": 5.0},
    }
    for name, value in sections.items():
        document[name] = (
            {**document[name], **value} if isinstance(document.get(name), dict) else value
        )
    return document


BY_NAME_ONLY: tuple[str, ...] = ()
"""Of a case that the mocks fly with `--all` only, to save time; real autopilots fly every case."""

LOW_M = 7.0
"""Hover height of the cases that do not measure time; a low hover shortens take-off and landing."""


def cases(autopilot: str, *, height_m: float) -> list[Case]:
    """Return all flights of one autopilot; the measured chases begin in a hover at this height."""
    px4 = autopilot == "px4"
    slow, fast = (1.06, 1.16) if px4 else (1.07, 1.19)

    def made(title: str, **more: Any) -> dict[str, Any]:
        return scenario(title, **{"height_m": LOW_M, **more})

    near = {"away_m": 25.0}
    steady = "a chase, u 6 v 3"
    both = [
        Case(
            steady,
            link,
            made(steady, height_m=height_m),
            (ends("captured"), ratio(slow), *HONEST),
            autopilots=flown,
        )
        for link, flown in (("mavsdk", BY_NAME_ONLY), ("pymavlink", ("arducopter",)))
    ]
    going = made("goes on", away_m=80.0)
    # Reaches its speed within 0.5 s; by default the rover needs 1.5 s or more
    sudden = {"acceleration_m_s2": 10.0}
    return [
        *both,
        Case(
            "a chase, u 8 v 4",
            "mavsdk",
            made("a chase, u 8 v 4", u=8.0, v=4.0, height_m=height_m),
            (ends("captured"), ratio(fast), *HONEST),
            autopilots=BY_NAME_ONLY,
        ),
        Case(
            "at full speed at once, u 6 v 3",
            "mavsdk",
            made("at once, u 6 v 3", height_m=height_m, evader=sudden),
            (ends("captured"), ratio(1.03), *HONEST),
            prompt=True,
            autopilots=("px4",),
        ),
        Case(
            "at full speed at once, u 8 v 4",
            "mavsdk",
            made("at once, u 8 v 4", u=8.0, v=4.0, height_m=height_m, evader=sudden),
            (ends("captured"), ratio(1.20 if px4 else 1.12), *HONEST),
            prompt=True,
            autopilots=BY_NAME_ONLY,
        ),
        Case(
            "faster than the vehicle can fly, u 10 v 6",
            "pymavlink",
            made("beyond the vehicle, u 10 v 6", u=10.0, v=6.0, height_m=height_m, evader=sudden),
            (AT_ITS_SPEED, *HONEST),
            autopilots=("px4",),
            virtual=True,
        ),
        Case(
            "an evader that runs at the pursuer",
            "mavsdk",
            made(
                "at the pursuer",
                game="tad",
                target={"position_m": [0.0, 0.0]},
                v=4.0,
                away_m=11.0,
                evader=sudden,
            ),
            (ends("captured"), KEEPS_OFF),
            autopilots=("px4",),
            virtual=True,
        ),
        Case(
            "an evader that stops",
            "pymavlink",
            made(
                "stops", evader={"policy": "waypoints", "waypoints_m": [[6.0, 40.0]]}, away_m=40.0
            ),
            (ends("captured"), EARLIER, KEEPS_OFF),
            autopilots=("px4",),
            virtual=True,
        ),
        Case(
            "an evader that turns",
            "mavsdk",
            made("turns", evader={"policy": "random_turns", "turn_every_s": 2.0}, seed=3, **near),
            (ends("captured"), KEEPS_OFF),
            autopilots=("arducopter",),
            virtual=True,
        ),
        Case(
            "an evader that comes closer",
            "pymavlink",
            made(
                "comes closer",
                evader={"policy": "waypoints", "waypoints_m": [[0.0, -40.0]]},
                away_m=40.0,
            ),
            (ends("captured"), EARLIER, KEEPS_OFF),
            autopilots=("px4",),
            virtual=True,
        ),
        Case(
            "a target defended",
            "pymavlink",
            made("defended", game="tad", target={"position_m": [25.0, 0.0]}, away_m=30.0),
            (ends("captured"), WON_AS_SOLVED, WON_BY_VEHICLE, KEEPS_OFF),
            autopilots=("arducopter",),
            virtual=True,
        ),
        Case(
            "a target that is lost",
            "mavsdk",
            made("lost", game="tad", target={"position_m": [0.0, 48.0]}, away_m=38.0),
            (ends("arrived"), LOST_AS_SOLVED, LOST_BY_VEHICLE),
            autopilots=("px4",),
            virtual=True,
        ),
        Case(
            "reports stop, and come back",
            "mavsdk",
            made("silence", sensor={"outages_s": [[2.0, 6.0]]}, v=2.0, **near),
            (ends("captured"), LOST_AND_FOUND, KEEPS_OFF),
            autopilots=("arducopter",),
            virtual=True,
        ),
        Case(
            "a fence in the way",
            "pymavlink",
            made("fence", limits={"fence_radius_m": 45.0}, time_limit_s=14.0, away_m=30.0),
            (ends("time_up"),),
            fence_m=45.0,
            autopilots=("px4",),
            virtual=True,
        ),
        Case(
            "a pilot's mode switch",
            "pymavlink" if px4 else "mavsdk",
            going,
            (ends("yielded"),),
            meddling="pilot",
            autopilots=("px4",),
        ),
        Case(
            "an order to hold",
            "mavsdk" if px4 else "pymavlink",
            going,
            meddling="hold",
            autopilots=("px4",),
        ),
        Case(
            "orders while landing and returning",
            "pymavlink" if px4 else "mavsdk",
            going,
            meddling="interrupt",
            autopilots=("arducopter",),
        ),
        Case("the service killed (-9)", "mavsdk" if px4 else "pymavlink", going, meddling="kill"),
        Case("a failed preflight", "mavsdk", going, meddling="refuse", autopilots=("arducopter",)),
    ]


def toml(document: Mapping[str, Any]) -> str:
    """Return a scenario as TOML: scalars first, then the sections."""
    plain = [
        f"{key} = {json.dumps(value)}"
        for key, value in document.items()
        if not isinstance(value, Mapping)
    ]
    sections = [
        "\n".join([f"[{key}]", *(f"{name} = {json.dumps(part)}" for name, part in value.items())])
        for key, value in document.items()
        if isinstance(value, Mapping)
    ]
    return "\n\n".join(["\n".join(plain), *sections]) + "\n"
