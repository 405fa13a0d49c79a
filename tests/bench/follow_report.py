"""Tables and picture of the chases in docs/data/follow.json, which `tests.bench.bench_follow` flew.

`python -m tests.bench.follow_report` prints the tables of docs/explanation/follow.md.
`python -m tests.bench.follow_report --picture .readme/follow.png` draws the picture anew. `--join FILE FILE` writes
docs/data/follow.json from results of several runs.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from guidance.viz.figures import figure_of, legend_below, save
from tests.bench.bench_follow import COURSES, MODES, RATES_HZ, Chase, document_text

ROOT: Final = Path(__file__).parents[2]
DATA: Final = ROOT / "docs" / "data" / "follow.json"
NAMES: Final[Mapping[str, str]] = {"px4": "PX4", "arducopter": "ArduCopter"}
FOLLOW: Final[Mapping[str, str]] = {"px4": "PX4's follow-me", "arducopter": "ArduCopter's FOLLOW"}
MODE_NAMES: Final[Mapping[str, str]] = {
    "optimal": "this service",
    "pure_pursuit": "pure pursuit",
    "proportional_navigation": "proportional navigation",
    "frpn": "FRPN",
}
CIRCLE_M: Final = 3.0
WITHIN_M: Final = CIRCLE_M - 1.0
"""Radius of the space about the leader that the service's limiter keeps free, up to 1 m below the disc."""

Row = Mapping[str, Any]
Flights = Mapping[str, Mapping[str, Row]]
"""Rows by autopilot and by the name of the chase."""

_SERVICE: Final = {"color": "#b3261e", "linewidth": 2.0}
_FOLLOW: Final = {"color": "#0b5fa5", "linewidth": 1.6, "linestyle": "--"}
_FACTORY: Final = {"color": "#7a7a7a", "linewidth": 1.2, "linestyle": ":"}


def flights(path: Path = DATA) -> Flights:
    """Return the rows of a file of results."""
    rows: Flights = json.loads(path.read_text(encoding="utf-8"))["autopilots"]
    return rows


def glance_table(flown: Flights) -> str:
    """Return the chases at a glance: time to the circle over the value and closest distance, for both vehicles."""
    lines = [
        "| from 57 m away, leader at 10 Hz | PX4's follow-me | this service on PX4 "
        "| ArduCopter's FOLLOW | this service on ArduCopter |",
        "|---|---|---|---|---|",
    ]
    chases = {
        "6 m/s against 3, straight away": Chase("follow"),
        "8 m/s against 4, straight away": Chase("follow", 8.0, 4.0),
        "6 against 3, turning every 4 s": Chase("follow", course="turning"),
        "6 against 3, stopping after 10 s": Chase("follow", course="stopping"),
        "6 against 3, straight away, reports 0.5 s late": Chase("follow", delay_s=0.5),
        "6 against 3, straight away, leader at 1 Hz": Chase("follow", rate_hz=1.0),
        "6 against 3, turning, leader at 1 Hz": Chase("follow", course="turning", rate_hz=1.0),
    }
    for words, chase in chases.items():
        cells = [_ratio(row) for row in _compared(flown, chase)]
        if all(cell == "–" for cell in cells):
            continue
        lines.append(f"| {words} | {' | '.join(cells)} |")
    turning = _compared(flown, chases["6 against 3, turning every 4 s"])
    slowly = _compared(flown, chases["6 against 3, turning, leader at 1 Hz"])
    straight = _compared(flown, chases["6 m/s against 3, straight away"])
    farthest = {
        "turning: then off the circle by up to": map(_worst, turning),
        "turning, leader at 1 Hz: then off the circle by up to": map(_worst, slowly),
        "straight: closest to the leader, circle 3 m": map(_closest, straight),
        "turning: closest to the leader": map(_closest, turning),
    }
    for words, cells in farthest.items():
        lines.append(f"| {words} | {' | '.join(cells)} |")
    return "\n".join(lines)


def gains_table(flown: Flights) -> str:
    """Return the time to the circle over the value: the range of the flights at all rates, course by course."""
    columns = {
        "PX4's follow-me": ("px4", Chase("follow")),
        "this service on PX4": ("px4", Chase("optimal")),
        "ArduCopter's FOLLOW as delivered": (
            "arducopter",
            Chase("follow", variant="default gain"),
        ),
        "ArduCopter's FOLLOW, `FOLL_POS_P` 1.0": ("arducopter", Chase("follow")),
        "this service on ArduCopter": ("arducopter", Chase("optimal")),
    }
    lines = [f"| leader | {' | '.join(columns)} |", f"|---{'|---' * len(columns)}|"]
    leaders = {
        "straight away": Chase("follow"),
        "turning every 4 s": Chase("follow", course="turning"),
        "stopping after 10 s": Chase("follow", course="stopping"),
        "straight away, reports 0.5 s late": Chase("follow", delay_s=0.5),
    }
    for words, leader in leaders.items():
        cells = []
        for autopilot, flyer in columns.values():
            same = leader._replace(mode=flyer.mode, variant=flyer.variant)
            keys = [same._replace(rate_hz=rate_hz).key for rate_hz in RATES_HZ]
            rows = flown.get(autopilot, {})
            cells.append(_range([rows[key] for key in keys if key in rows]))
        lines.append(f"| {words} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _range(rows: Sequence[Row]) -> str:
    """Return the least and the largest ratio, and how many flights never reached the circle."""
    ratios = sorted(row["ratio"] for row in rows if row["ratio"] is not None)
    if not ratios:
        return "never" if rows else "not flown"
    words = " to ".join(dict.fromkeys(f"{ratio:.2f}" for ratio in (ratios[0], ratios[-1])))
    missed = len(rows) - len(ratios)
    return words if missed == 0 else f"{words}, {missed} of {len(rows)} never"


def _compared(flown: Flights, chase: Chase) -> list[Row | None]:
    """Return the rows of follow mode and service, of each autopilot."""
    rows = []
    for autopilot in NAMES:
        rows.extend(
            flown.get(autopilot, {}).get(chase._replace(mode=mode).key)
            for mode in ("follow", "optimal")
        )
    return rows


def _ratio(row: Row | None) -> str:
    if row is None:
        return "–"
    return "never" if row["ratio"] is None else f"{row['ratio']:.2f}"


def _worst(row: Row | None) -> str:
    return "–" if row is None or row["worst_m"] is None else f"{row['worst_m']:.1f} m"


def _closest(row: Row | None) -> str:
    """Return the least horizontal distance, and the height above the leader then."""
    if row is None:
        return "–"
    distance_m = row["distance_m"]
    height_m = row["height_m"][distance_m.index(min(distance_m))]
    return f"{row['closest_m']:.1f} m, {height_m:.1f} m up"


def _overshoot(row: Row) -> str:
    return "–" if row["overshoot_m"] is None else f"{row['overshoot_m']:.1f} m"


def page_table(flown: Flights, autopilot: str) -> str:
    """Return every chase that a vehicle flew: one line a chase."""
    lines = [
        "| chase | mode | time / value | overshoot | closest | worst after |",
        "|---|---|---|---|---|---|",
    ]
    rows = flown.get(autopilot, {})
    for chase in _order():
        row = rows.get(chase.key)
        if row is None:
            continue
        words = chase.key.partition(", ")[2]
        cells = [words, _mode(autopilot, chase), _ratio(row), _overshoot(row)]
        cells += [_closest(row), _worst(row)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def standoff_table(flown: Flights) -> str:
    """Return how often vehicles came over the middle of the disc, and how low they were there."""
    lines = [
        f"| | flights | within {WITHIN_M:g} m of the leader, horizontally | lowest height above it there |",
        "|---|---|---|---|",
    ]
    for autopilot, name in NAMES.items():
        for mode in MODES:
            rows = [row for row in flown.get(autopilot, {}).values() if row["mode"] == mode]
            heights_m = [height_m for row in rows if (height_m := _lowest_m(row)) is not None]
            lowest = f"{min(heights_m):.1f} m" if heights_m else "–"
            words = FOLLOW[autopilot] if mode == "follow" else f"{MODE_NAMES[mode]} on {name}"
            lines.append(f"| {words} | {len(rows)} | {len(heights_m)} | {lowest} |")
    return "\n".join(lines)


def _lowest_m(row: Row) -> float | None:
    """Return the lowest height within `WITHIN_M` of the leader, m, if the vehicle came there."""
    track = zip(row["distance_m"], row["height_m"], strict=True)
    return min((height_m for distance_m, height_m in track if distance_m < WITHIN_M), default=None)


def _mode(autopilot: str, chase: Chase) -> str:
    return FOLLOW[autopilot] if chase.mode == "follow" else MODE_NAMES[chase.mode]


def _order() -> list[Chase]:
    """Return all chases, those of one course and rate together."""
    kinds = [Chase("follow", u, v) for u, v in ((6.0, 3.0), (8.0, 4.0))]
    for rate_hz in RATES_HZ:
        kinds += [Chase("follow", course=course, rate_hz=rate_hz) for course in COURSES]
        kinds.append(Chase("follow", rate_hz=rate_hz, delay_s=0.5))
    variants = ("quick estimate", "medium gain", "default gain")
    chases = []
    for kind in dict.fromkeys(kinds):
        chases += [kind._replace(variant=name) for name in variants]
        chases += [kind._replace(mode=mode) for mode in MODES]
    return chases


def draw(flown: Flights, path: Path) -> None:
    """Draw the distance from the leader over time: a column for each autopilot, a row for each course."""
    courses = {"straight": "runs straight away", "turning": "turns every 4 s"}
    figure = figure_of(10.0, 6.4)
    panels = figure.subplots(len(courses), len(NAMES), sharex=True, sharey=True)
    for line, (course, words) in zip(panels, courses.items(), strict=True):
        for panel, autopilot in zip(line, NAMES, strict=True):
            _draw_panel(panel, flown.get(autopilot, {}), course)
            panel.set_title(f"{NAMES[autopilot]}: leader {words}", fontsize=10)
    for panel in panels[:, 0]:
        panel.set_ylabel("distance from the leader, m")
    for panel in panels[-1]:
        panel.set_xlabel("time since the leader ran, s")
    figure.suptitle("6 m/s after 3 m/s, reports at 10 Hz, simulated real autopilots", fontsize=11)
    legend_below(figure, *panels.ravel(), columns=4)
    save(figure, path)


def _draw_panel(panel: Any, rows: Mapping[str, Row], course: str) -> None:
    chase = Chase("follow", course=course)
    drawn = {
        "the autopilot's follow mode, default gain": (
            chase._replace(variant="default gain"),
            _FACTORY,
        ),
        "the autopilot's follow mode": (chase, _FOLLOW),
        "this service": (chase._replace(mode="optimal"), _SERVICE),
    }
    for name, (which, style) in drawn.items():
        row = rows.get(which.key)
        if row is None:
            continue
        times_s = [row["every_s"] * number for number in range(len(row["distance_m"]))]
        panel.plot(times_s, row["distance_m"], label=name, **style)
    service = rows.get(chase._replace(mode="optimal").key)
    if course == "straight" and service is not None:
        panel.axvline(service["value_s"], color="0.35", linewidth=0.9, linestyle="-.")
        panel.annotate(
            "the game's value", (service["value_s"] + 0.6, 80.0), fontsize=8, color="0.25"
        )
    panel.axhspan(0.0, CIRCLE_M, color="#2e7d32", alpha=0.15, label="inside the circle of 3 m")
    panel.set(ylim=(0.0, 92.0), xlim=(0.0, 60.0))
    panel.grid(visible=True, linewidth=0.3)


def join(paths: Sequence[Path]) -> None:
    """Write the file of results from those of several runs; of a chase in two of them the later counts."""
    autopilots: dict[str, dict[str, Row]] = {}
    for path in paths:
        for autopilot, rows in flights(path).items():
            autopilots.setdefault(autopilot, {}).update(rows)
    DATA.write_text(document_text({"autopilots": autopilots}), encoding="utf-8")


def main() -> None:
    """Print the tables, or draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--picture", type=Path, help="draw it into this file")
    parser.add_argument("--join", type=Path, nargs="+", metavar="FILE", help="results to join")
    arguments = parser.parse_args()
    if arguments.join is not None:
        join(arguments.join)
    flown = flights()
    print(gains_table(flown))
    print(f"\n{glance_table(flown)}")
    for autopilot in NAMES:
        print(f"\n{NAMES[autopilot]}\n\n{page_table(flown, autopilot)}")
    print(f"\n{standoff_table(flown)}")
    if arguments.picture is not None:
        draw(flown, arguments.picture)


if __name__ == "__main__":
    main()
