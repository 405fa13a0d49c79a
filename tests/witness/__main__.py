"""Compare a real autopilot with its mock, case by case, as one client sees both.

    python -m tests.witness --px4 udpin://127.0.0.1:14540
    python -m tests.witness --arducopter tcpout://127.0.0.1:5760 --page
    python -m tests.witness --zenoh-only --px4 udpin://127.0.0.1:14540 --px4-zenoh tcp/127.0.0.1:7447
    python -m tests.witness                                       # the mocks alone

Give simulators that have just been started at 47.397742, 8.545594, 488 m, where the examples of MAVSDK fly: parameters
are set and restored, other people's programs fly, and both are rebooted at the end. The autopilots and their mocks are
played at the same time. seen.json keeps what was seen last, and `--page` writes it into the tables of docs/mock.md. The
exit code is 1 if a case differs and causes.toml does not name it. A case whose program is not on this computer is not
played:

    --px4-zenoh ENDPOINT         the Zenoh router of that PX4 (see the limits in docs/how-to/px4-flight-mode.md)
    --mavsdk3-examples FOLDER    examples of a checkout of github.com/mavlink/MAVSDK-Python
    --mavsdk4-examples FOLDER    py/mavsdk/examples of a checkout of github.com/mavlink/MAVSDK
    --mavsdk3-tests FOLDER       a checkout of github.com/mavlink/MAVSDK with its integration tests, see docs/mock.md
    --router PROGRAM             mavlink-routerd
"""

import argparse
import shutil
import sys
import threading
import traceback
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from sitl_mock.child import running
from sitl_mock.transports.zenoh_session import free_port
from tests.witness import cases, other_clients, page, topic_cases
from tests.witness.cases import Case
from tests.witness.client import Client
from tests.witness.other_clients import NotPlayedError, Programs
from tests.witness.topic_cases import TopicCase
from tests.witness.topics import Topics

_ROUTER = shutil.which("mavlink-routerd")
ROUTER = None if _ROUTER is None else Path(_ROUTER)
"""mavlink-router, if it is installed."""

CaseT = TypeVar("CaseT")
TOPICS = "px4_zenoh"
_writing = threading.Lock()


def all_cases(programs: Programs) -> dict[str, Case]:
    """Return the cases in the order of the page."""
    return {**cases.CASES, **other_clients.cases_of(programs), **cases.LAST}


def remember(autopilot: str, kind: str, title: str, words: str) -> None:
    """Print an observation and keep it in the file at once, so that a run that is ended loses only its last case."""
    name = page.AUTOPILOTS[autopilot]
    print(f"{kind} {name}, {title}: {words}", flush=True)
    with _writing:
        page.remember(autopilot, kind, {title: words})


def play_cases(autopilot: str, kind: str, url: str, plays: Mapping[str, Case]) -> None:
    """Play cases and remember what each saw, without those whose program is missing."""
    with Client(url) as client:
        client.wait_for_home()
        client.wait_for_position()
        for title, play in plays.items():
            try:
                words = play(client)
            except NotPlayedError as missing:
                print(
                    f"{kind} {page.AUTOPILOTS[autopilot]}, {title}: not played, {missing}",
                    flush=True,
                )
                continue
            except Exception as error:  # the other cases are worth their time
                traceback.print_exc()
                words = f"the witness failed: {type(error).__name__}: {error}"
            remember(autopilot, kind, title, words)


def play_topic_cases(kind: str, url: str, topics: Topics, plays: Mapping[str, TopicCase]) -> None:
    """Play the cases of PX4's topics and remember what each saw."""
    with Client(url) as client:
        client.wait_for_home()
        topics.wait("vehicle_status", lambda status: status.pre_flight_checks_pass, seconds=60.0)
        for title, play in plays.items():
            try:
                words = play(client, topics)
            except Exception as error:  # as above
                traceback.print_exc()
                words = f"the witness failed: {type(error).__name__}: {error}"
            remember(TOPICS, kind, title, words)


def play_topics(url: str | None, router: str | None, plays: Mapping[str, TopicCase]) -> None:
    """Play the cases of PX4's topics on the real PX4, if there is a router, or on its mock."""
    if router is not None and url is not None:
        with Topics(router) as topics:
            play_topic_cases("real", url, topics, plays)
        return
    router = f"tcp/127.0.0.1:{free_port()}"
    vehicle = {"name": "uav1", "flavour": "px4", "ready_after_s": 0.5}
    with (
        Topics(router, "router") as topics,
        running([vehicle], over=["udp"], px4_zenoh=router) as fleet,
    ):
        play_topic_cases("mock", fleet["uav1"].udp, topics, plays)


def play_all(autopilot: str, url: str | None, plays: Mapping[str, Case]) -> None:
    """Play the cases on the real autopilot, if there is a URL, or on its mock in a child process."""
    if url is not None:
        play_cases(autopilot, "real", url, plays)
        return
    vehicle = {"name": "uav1", "flavour": autopilot, "ready_after_s": 0.5}
    with running([vehicle], over=["udp"]) as fleet:
        play_cases(autopilot, "mock", fleet["uav1"].udp, plays)


def chosen(every: Mapping[str, CaseT], texts: Sequence[str]) -> dict[str, CaseT]:
    """Return the cases whose title contains one of the texts."""
    return {title: play for title, play in every.items() if any(text in title for text in texts)}


def main() -> int:
    """Play the cases; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--px4", metavar="URL", help="a PX4 simulator")
    parser.add_argument("--px4-zenoh", metavar="ENDPOINT", help="the Zenoh router of that PX4")
    parser.add_argument("--zenoh-only", action="store_true", help="only PX4's topics over Zenoh")
    parser.add_argument("--arducopter", metavar="URL", help="an ArduCopter simulator")
    parser.add_argument("--mavsdk3-examples", type=Path, metavar="FOLDER")
    parser.add_argument("--mavsdk4-examples", type=Path, metavar="FOLDER")
    parser.add_argument("--mavsdk3-tests", type=Path, metavar="FOLDER")
    parser.add_argument("--router", type=Path, metavar="PROGRAM", default=ROUTER)
    parser.add_argument(
        "--only", action="append", metavar="TEXT", help="cases whose title contains it"
    )
    parser.add_argument("--page", action="store_true", help="write the tables of docs/mock.md")
    arguments = parser.parse_args()
    programs = Programs(
        examples_3=arguments.mavsdk3_examples,
        examples_4=arguments.mavsdk4_examples,
        tests_3=arguments.mavsdk3_tests,
        router=arguments.router,
    )
    texts = arguments.only or [""]
    every = all_cases(programs)
    plays = chosen(every, texts)
    topic_plays = chosen(topic_cases.CASES, texts)
    urls = {"px4": arguments.px4, "arducopter": arguments.arducopter}
    if arguments.zenoh_only:
        plays = {}
    with ThreadPoolExecutor(2 * len(urls)) as pool:
        running_plays = [pool.submit(play_all, name, None, plays) for name in urls]
        running_plays += [
            pool.submit(play_all, name, url, plays) for name, url in urls.items() if url is not None
        ]
    with ThreadPoolExecutor(2) as pool:  # afterwards, since one client may have PX4's port
        running_plays.append(pool.submit(play_topics, None, None, topic_plays))
        if arguments.px4_zenoh is not None:
            running_plays.append(
                pool.submit(play_topics, arguments.px4, arguments.px4_zenoh, topic_plays)
            )
    for played in running_plays:
        played.result()
    wrong = [words for name in urls for words in page.judged(name, plays)]
    wrong += page.judged(TOPICS, topic_plays)
    if arguments.page:
        page.write({**dict.fromkeys(urls, every), TOPICS: topic_cases.CASES})
    print("\n".join(wrong) if wrong else "every difference has a cause")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
