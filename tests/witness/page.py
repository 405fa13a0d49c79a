"""What was seen of the autopilots and their mocks, why they differ, and the tables of docs/mock.md."""

import json
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path

HERE = Path(__file__).parent
SEEN = HERE / "seen.json"
"""What was seen last, by autopilot, case, and ``real`` or ``mock``."""
CAUSES = HERE / "causes.toml"
"""Why a mock differs, by autopilot and case."""
PAGE = HERE.parents[1] / "docs" / "mock.md"
BEGIN = "<!-- the table of tests.witness begins -->\n"
END = "<!-- the table of tests.witness ends -->\n"
NOT_PLAYED = "not played"
"""What a cell says of a case that was never seen."""
AUTOPILOTS = {
    "px4": "PX4 1.17",
    "arducopter": "ArduCopter 4.5",
    "px4_zenoh": "PX4 1.17 over Zenoh",
}

Seen = dict[str, dict[str, dict[str, str]]]


def read() -> Seen:
    """Return what was seen."""
    seen: Seen = json.loads(SEEN.read_text(encoding="utf-8"))
    return seen


def remember(autopilot: str, kind: str, observations: Mapping[str, str]) -> None:
    """Write what was seen of an autopilot, real or mock, into the file."""
    seen = read()
    for title, words in observations.items():
        seen.setdefault(autopilot, {}).setdefault(title, {})[kind] = words
    SEEN.write_text(json.dumps(seen, indent=1) + "\n", encoding="utf-8")


def causes_of(autopilot: str) -> dict[str, str]:
    """Return the known causes of differences by case."""
    causes = tomllib.loads(CAUSES.read_text(encoding="utf-8"))[autopilot]
    return {title: str(cause) for title, cause in causes.items()}


def judged(autopilot: str, titles: Iterable[str]) -> list[str]:
    """Return what is wrong: differences without a cause, causes without a difference, and what was not seen."""
    causes = causes_of(autopilot)
    cells = read().get(autopilot, {})
    wrong = []
    for title in titles:
        cell = cells.get(title, {})
        if len(cell) < 2:
            wrong.append(f"{autopilot}, {title}: not seen on both")
        elif cell["real"] != cell["mock"] and title not in causes:
            wrong.append(f"{autopilot}, {title}: real {cell['real']!r}, mock {cell['mock']!r}")
        elif cell["real"] == cell["mock"] and title in causes:
            wrong.append(f"{autopilot}, {title}: equal, but causes.toml has a cause")
    return wrong


def tables(titles: Mapping[str, Iterable[str]]) -> str:
    """Return the tables of the page, for the titles of each autopilot's cases."""
    return "\n".join(table_of(autopilot, titles[autopilot]) for autopilot in AUTOPILOTS)


def table_of(autopilot: str, titles: Iterable[str]) -> str:
    """Return the table of one autopilot."""
    causes = causes_of(autopilot)
    cells = read().get(autopilot, {})
    lines = [f"| {AUTOPILOTS[autopilot]} | the real one | the mock |", "|---|---|---|"]
    lines += [row(title, cells.get(title, {}), causes.get(title, "")) for title in titles]
    return "\n".join(lines) + "\n"


def row(title: str, cell: Mapping[str, str], cause: str) -> str:
    """Return the line of a case."""
    real = cell.get("real", NOT_PLAYED)
    mock = cell.get("mock", NOT_PLAYED)
    answer = "the same" if real == mock else f"{mock}. {cause}"
    return f"| {title} | {in_a_cell(real)} | {in_a_cell(answer)} |"


def in_a_cell(words: str) -> str:
    """Return words as a cell of a table."""
    return words.replace("|", "\\|").replace("<", "&lt;")


def write(titles: Mapping[str, Iterable[str]]) -> None:
    """Replace the tables on the page."""
    page = PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n{tables(titles)}\n{END}{after}", encoding="utf-8")
