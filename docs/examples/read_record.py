"""Reads a record: the duration of each state, the events, and the promised and actual time of the game.

python docs/examples/read_record.py flights/pe-001/record.mcap
"""

import sys
from collections import Counter
from pathlib import Path

from guidance.flight import State
from guidance.log import cycles_of, events_of, survey_of, title_of

PERIOD_S = 0.02


def main(record: Path) -> dict[str, float]:
    """Print a summary; return the seconds in each state."""
    survey = survey_of(record)
    print(
        f"{title_of(survey.metadata)}: {survey.duration_s:.1f} s, {'whole' if survey.torn is None else survey.torn}"
    )
    cycles = list(cycles_of(record))
    lasted_s = {
        state: count * PERIOD_S
        for state, count in Counter(str(one.state) for one in cycles).items()
    }
    for state, seconds in lasted_s.items():
        print(f"{seconds:8.2f} s  {state}")
    for event in events_of(record):
        print(f"{event.now_s:8.2f} s  {event.event}  {event.detail}".rstrip())
    engaged = [one for one in cycles if one.state is State.ENGAGED and one.certificate is not None]
    if engaged and engaged[0].certificate is not None:
        promised_s, took_s = (
            engaged[0].certificate.time_needed_s,
            engaged[-1].now_s - engaged[0].now_s,
        )
        print(f"promised at engagement {promised_s:.2f} s, flown {took_s:.2f} s")
    return lasted_s


if __name__ == "__main__":
    main(Path(sys.argv[1]))
