"""Compare a real autopilot with its mock, case by case, as one client sees both.

    python -m tests.witness --px4 udpin://127.0.0.1:14540
    python -m tests.witness --arducopter tcpout://127.0.0.1:5760 --page
    python -m tests.witness                                       # the mocks alone

Give simulators that have just been started: parameters are set and restored, the vehicle is armed on the ground for
seconds, a PX4 flies a hop of 2.5 m, and both are rebooted at the end. `--page` writes what
was seen into the table of docs/mock.md. The exit code is 1 if a case differs and docs/mock.md's causes do not name it.
"""

import argparse
import json
import sys
import tomllib
from pathlib import Path

from sitl_mock.child import running
from tests.witness.cases import CASES
from tests.witness.client import Client

HERE = Path(__file__).parent
SEEN = HERE / "seen.json"
"""What was seen of the real autopilots, by autopilot and case."""
CAUSES = HERE / "causes.toml"
"""Why a mock differs, by autopilot and case."""
PAGE = HERE.parents[1] / "docs" / "mock.md"
BEGIN = "<!-- the table of tests.witness begins -->\n"
END = "<!-- the table of tests.witness ends -->\n"
AUTOPILOTS = {"px4": "PX4 1.17", "arducopter": "ArduCopter 4.5"}

Observations = dict[str, str]


def observed(url: str, only: str) -> Observations:
    """Play the cases whose title contains a text; return what each saw."""
    observations = {}
    with Client(url) as client:
        client.wait_for_home()
        for title, play in CASES.items():
            if only in title:
                observations[title] = play(client)
                print(f"  {title}: {observations[title]}", flush=True)
    return observations


def observed_of_mock(autopilot: str, only: str) -> Observations:
    """Play the cases on a mock in a child process."""
    print(f"mock of {AUTOPILOTS[autopilot]}", flush=True)
    vehicle = {"name": "uav1", "flavour": autopilot, "ready_after_s": 0.5}
    with running([vehicle], over=["udp"]) as fleet:
        return observed(fleet["uav1"].udp, only)


def causes_of(autopilot: str) -> Observations:
    """Return the known causes of differences by case."""
    return {
        title: str(cause)
        for title, cause in tomllib.loads(CAUSES.read_text(encoding="utf-8"))[autopilot].items()
    }


def judged(autopilot: str, real: Observations, mock: Observations) -> list[str]:
    """Return what is wrong: differences without a cause, and causes without a difference."""
    causes = causes_of(autopilot)
    wrong = []
    for title, seen in mock.items():
        if title not in real:
            wrong.append(f"{autopilot}, {title}: never seen on the real autopilot")
        elif real[title] != seen and title not in causes:
            wrong.append(f"{autopilot}, {title}: real {real[title]!r}, mock {seen!r}")
        elif real[title] == seen and title in causes:
            wrong.append(f"{autopilot}, {title}: equal, but causes.toml has a cause")
    return wrong


def table_of(autopilot: str, real: Observations, mock: Observations) -> str:
    """Return the page's table of one autopilot."""
    causes = causes_of(autopilot)
    lines = [f"| {AUTOPILOTS[autopilot]} | the real one | the mock |", "|---|---|---|"]
    for title in CASES:
        same = real[title] == mock[title]
        answer = "the same" if same else f"{mock[title]}. {causes.get(title, '')}"
        lines.append(f"| {title} | {real[title]} | {answer} |")
    return "\n".join(lines) + "\n"


def write_page(tables: list[str]) -> None:
    """Replace the tables on the mock's page."""
    page = PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(
        before + BEGIN + "\n" + "\n".join(tables) + "\n" + END + after, encoding="utf-8"
    )


def main() -> int:
    """Play the cases; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--px4", metavar="URL", help="a PX4 simulator")
    parser.add_argument("--arducopter", metavar="URL", help="an ArduCopter simulator")
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose title contains it")
    parser.add_argument("--page", action="store_true", help="write the tables of docs/mock.md")
    arguments = parser.parse_args()
    if arguments.page and arguments.only:
        parser.error("--page writes all cases: leave out --only")
    seen: dict[str, Observations] = json.loads(SEEN.read_text(encoding="utf-8"))
    wrong = []
    tables = []
    for autopilot, title in AUTOPILOTS.items():
        url = getattr(arguments, autopilot)
        if url is not None:
            print(f"real {title} at {url}", flush=True)
            seen.setdefault(autopilot, {}).update(observed(url, arguments.only))
            SEEN.write_text(json.dumps(seen, indent=1) + "\n", encoding="utf-8")
        mock = observed_of_mock(autopilot, arguments.only)
        wrong += judged(autopilot, seen.get(autopilot, {}), mock)
        if arguments.page:
            tables.append(table_of(autopilot, seen[autopilot], mock))
    if tables:
        write_page(tables)
    print("\n".join(wrong) if wrong else "every difference has a cause")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
