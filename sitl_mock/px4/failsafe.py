"""PX4's failsafes: what is wrong, which parameter says what to do, and until when (`failsafe.cpp`)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final, NamedTuple


class Action(IntEnum):
    """What a failsafe does, in rising severity; the worst of those active is done."""

    NONE = 0
    WARN = 1
    HOLD = 2
    RTL = 3
    LAND = 4
    DISARM = 5
    TERMINATE = 6


MODE_OF: Final[Mapping[Action, str]] = {
    Action.HOLD: "HOLD",
    Action.RTL: "RTL",
    Action.LAND: "LAND",
    Action.TERMINATE: "TERMINATION",
}


class Trigger(NamedTuple):
    """One thing that can go wrong.

    Attributes:
        name: What is wrong.
        parameter: The parameter that chooses the action; empty for a fixed one.
        actions: Parameter value to action.
        deferred: Hold first, for COM_FAIL_ACT_T.
        sticky: The action stays until the mode is changed or the vehicle disarmed, also when the cause is gone.
    """

    name: str
    parameter: str
    actions: Mapping[int, Action]
    deferred: bool
    sticky: bool


_LINK_ACTIONS: Final = {
    0: Action.NONE,
    1: Action.HOLD,
    2: Action.RTL,
    3: Action.LAND,
    5: Action.TERMINATE,
    6: Action.DISARM,
}

TRIGGERS: Final = (
    Trigger("manual control lost", "NAV_RCL_ACT", _LINK_ACTIONS, deferred=True, sticky=True),
    Trigger("ground station lost", "NAV_DLL_ACT", _LINK_ACTIONS, deferred=True, sticky=True),
    Trigger(
        "geofence violated",
        "GF_ACTION",
        {
            0: Action.NONE,
            1: Action.WARN,
            2: Action.HOLD,
            3: Action.RTL,
            4: Action.TERMINATE,
            5: Action.LAND,
        },
        deferred=False,
        sticky=False,
    ),
    Trigger("onboard computer lost", "", {0: Action.WARN}, deferred=False, sticky=False),
    Trigger("battery low", "", {0: Action.WARN}, deferred=False, sticky=True),
    Trigger(
        "battery critical",
        "COM_LOW_BAT_ACT",
        {0: Action.WARN, 2: Action.LAND, 3: Action.RTL},
        deferred=True,
        sticky=True,
    ),
    Trigger(
        "battery emergency",
        "COM_LOW_BAT_ACT",
        {0: Action.WARN, 2: Action.LAND, 3: Action.LAND},
        deferred=True,
        sticky=True,
    ),
)


@dataclass(slots=True)
class Failsafes:
    """Which triggers act, and since when.

    Attributes:
        since_s: Active triggers and the time they came.
        overridden: Triggers that a mode change has answered; they act again when they come anew.
    """

    since_s: dict[str, float] = field(default_factory=dict)
    overridden: set[str] = field(default_factory=set)

    def update(
        self, now_s: float, wrong: frozenset[str], parameters: Mapping[str, int | float]
    ) -> tuple[Action, tuple[str, ...]]:
        """Take what is wrong now; return the action and the names of the triggers that are new."""
        self.overridden &= wrong
        new = []
        worst = Action.NONE
        for trigger in TRIGGERS:
            name = trigger.name
            if name in wrong:
                if name not in self.since_s and name not in self.overridden:
                    self.since_s[name] = now_s
                    new.append(name)
            elif name in self.since_s and not trigger.sticky:
                del self.since_s[name]
            if name in self.since_s:
                worst = max(worst, self._action(trigger, now_s, parameters))
        return worst, tuple(new)

    def answer(self) -> None:
        """A pilot or a client changed the mode: what acts now is over, until it comes anew."""
        self.overridden.update(self.since_s)
        self.since_s.clear()

    def clear(self) -> None:
        """Disarmed: nothing acts."""
        self.since_s.clear()
        self.overridden.clear()

    def _action(self, trigger: Trigger, now_s: float, parameters: Mapping[str, int | float]) -> Action:
        choice = int(parameters[trigger.parameter]) if trigger.parameter else 0
        action = trigger.actions.get(choice, Action.WARN)
        age_s = now_s - self.since_s[trigger.name]
        if trigger.deferred and action > Action.HOLD and age_s < parameters["COM_FAIL_ACT_T"]:
            return Action.HOLD
        return action
