"""Compare a real autopilot with its mock, case by case, as one client sees both.

    python -m tests.witness --px4 udpin://127.0.0.1:14540
    python -m tests.witness --arducopter tcpout://127.0.0.1:5760 --page
    python -m tests.witness                                       # the mocks alone

Give simulators that have just been started at 47.397742, 8.545594, 488 m, where the examples of MAVSDK fly: parameters
are set and restored, other people's programs fly, and both are rebooted at the end. Both autopilots are played at the
same time, each before its mock. `--page` writes what was seen into the tables of docs/mock.md. The exit code is 1 if a
case differs and docs/mock.md's causes do not name it. A case whose program is not on this computer is not played:

    --mavsdk3-examples FOLDER    examples of a checkout of github.com/mavlink/MAVSDK-Python
    --mavsdk4-examples FOLDER    py/mavsdk/examples of a checkout of github.com/mavlink/MAVSDK
    --router PROGRAM             mavlink-routerd
"""

import argparse
import json
import shutil
import sys
import threading
import tomllib
import traceback
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from sitl_mock.child import running
from tests.witness import cases, other_clients
from tests.witness.cases import Case
from tests.witness.client import Client
from tests.witness.other_clients import NotPlayedError, Programs

HERE = Path(__file__).parent
SEEN = HERE / "seen.json"
"""What was seen of the real autopilots, by autopilot and case."""
CAUSES = HERE / "causes.toml"
"""Why a mock differs, by autopilot and case."""
PAGE = HERE.parents[1] / "docs" / "mock.md"
BEGIN = "<!-- the table of tests.witness begins -->\n"
END = "<!-- the table of tests.witness ends -->\n"
AUTOPILOTS = {"px4": "PX4 1.17", "arducopter": "ArduCopter 4.5"}

_ROUTER = shutil.which("mavlink-routerd")
ROUTER = None if _ROUTER is None else Path(_ROUTER)
"""mavlink-router, if it is installed."""

Observations = dict[str, str]
_writing = threading.Lock()


def chosen(programs: Programs, only: str) -> dict[str, Case]:
    """Return the cases whose title contains a text, in the order of the page."""
    every = {**cases.CASES, **other_clients.cases_of(programs), **cases.LAST}
    return {title: play for title, play in every.items() if only in title}


def observed(label: str, url: str, plays: Mapping[str, Case]) -> Observations:
    """Play cases; return what each saw, without those whose program is missing."""
    observations = {}
    with Client(url) as client:
        client.wait_for_home()
        for title, play in plays.items():
            try:
                observations[title] = play(client)
            except NotPlayedError as missing:
                print(f"{label}, {title}: not played, {missing}", flush=True)
            except Exception as error:  # the other cases are worth their time
                traceback.print_exc()
                observations[title] = f"the witness failed: {type(error).__name__}: {error}"
            else:
                print(f"{label}, {title}: {observations[title]}", flush=True)
    return observations


def observed_of_mock(autopilot: str, plays: Mapping[str, Case]) -> Observations:
    """Play the cases on a mock in a child process."""
    vehicle = {"name": "uav1", "flavour": autopilot, "ready_after_s": 0.5}
    with running([vehicle], over=["udp"]) as fleet:
        return observed(f"mock {AUTOPILOTS[autopilot]}", fleet["uav1"].udp, plays)


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


def table_of(autopilot: str, titles: Iterable[str], real: Observations, mock: Observations) -> str:
    """Return the page's table of one autopilot."""
    causes = causes_of(autopilot)
    lines = [f"| {AUTOPILOTS[autopilot]} | the real one | the mock |", "|---|---|---|"]
    for title in titles:
        if title not in real or title not in mock:
            continue
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


def compared(
    autopilot: str, url: str | None, plays: Mapping[str, Case]
) -> tuple[Observations, Observations]:
    """Play the cases on the real autopilot, if there is a URL, and on its mock; return what was seen of both."""
    if url is not None:
        remember(autopilot, observed(f"real {AUTOPILOTS[autopilot]}", url, plays))
    mock = observed_of_mock(autopilot, plays)
    return json.loads(SEEN.read_text(encoding="utf-8")).get(autopilot, {}), mock


def remember(autopilot: str, observations: Observations) -> None:
    """Write what was seen of a real autopilot into the file."""
    with _writing:
        seen: dict[str, Observations] = json.loads(SEEN.read_text(encoding="utf-8"))
        seen.setdefault(autopilot, {}).update(observations)
        SEEN.write_text(json.dumps(seen, indent=1) + "\n", encoding="utf-8")


def main() -> int:
    """Play the cases; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--px4", metavar="URL", help="a PX4 simulator")
    parser.add_argument("--arducopter", metavar="URL", help="an ArduCopter simulator")
    parser.add_argument("--mavsdk3-examples", type=Path, metavar="FOLDER")
    parser.add_argument("--mavsdk4-examples", type=Path, metavar="FOLDER")
    parser.add_argument("--router", type=Path, metavar="PROGRAM", default=ROUTER)
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose title contains it")
    parser.add_argument("--page", action="store_true", help="write the tables of docs/mock.md")
    arguments = parser.parse_args()
    if arguments.page and arguments.only:
        parser.error("--page writes all cases: leave out --only")
    programs = Programs(
        examples_3=arguments.mavsdk3_examples,
        examples_4=arguments.mavsdk4_examples,
        router=arguments.router,
    )
    plays = chosen(programs, arguments.only)
    with ThreadPoolExecutor(len(AUTOPILOTS)) as pool:
        played = [
            pool.submit(compared, autopilot, getattr(arguments, autopilot), plays)
            for autopilot in AUTOPILOTS
        ]
    wrong = []
    tables = []
    for autopilot, future in zip(AUTOPILOTS, played, strict=True):
        real, mock = future.result()
        wrong += judged(autopilot, real, mock)
        if arguments.page:
            wrong += [f"{autopilot}, {title}: not played" for title in plays if title not in mock]
            tables.append(table_of(autopilot, plays, real, mock))
    if tables:
        write_page(tables)
    print("\n".join(wrong) if wrong else "every difference has a cause")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
