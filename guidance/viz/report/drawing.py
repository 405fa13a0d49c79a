"""What is marked in a report's charts: the moments of its flight, and the part that is worth showing."""

from typing import Any

from guidance.viz.figures import MARK
from guidance.viz.report.story import Story


def mark_moments(axes: list[Any], story: Story) -> None:
    """Draw where the game began and where the disc was reached, named above the first panel."""
    for cycle, name in ((story.engaged, "engaged"), (story.captured, "captured")):
        if cycle is None:
            continue
        now_s = story.cycles[cycle].now_s
        for one in axes:
            one.axvline(now_s, **MARK)
        axes[0].text(now_s, 1.01, name, transform=axes[0].get_xaxis_transform(), ha="center", va="bottom", fontsize=9)


def playing_span(story: Story) -> slice:
    """The cycles from a little before the game to a little after the capture; all, where there was no game."""
    if story.engaged is None:
        return slice(None)
    last = max(number for number, one in enumerate(story.certificates) if one is not None)
    return slice(max(0, story.engaged - 50), min(len(story.cycles), last + 50))
