"""The port between the shared body of a vehicle and the flavour that decides over it."""

from collections.abc import Sequence
from typing import Any, Protocol

from sitl_mock.dynamics import Setpoint
from sitl_mock.missions import MissionFlight
from sitl_mock.protocols import Command, CommandAnswer, PlanItem


class Commander(Protocol):
    """One flavour's decisions.

    It has no clock: every call names the time, and all that it knows is in itself and in the vehicle's state.

    * `tick` is called every 10 ms and returns what the motors shall do.
    * `execute` answers commands that are the flavour's own (not streams, parameters or transfers).
    * `offer` takes setpoints; whatever is none is dropped.
    * `switch` is the pilot's mode switch: obeyed where the autopilot would.
    """

    mission: MissionFlight

    @property
    def mode(self) -> str:
        """Name of the mode that is flown."""
        ...

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode."""
        ...

    @property
    def intended_mode(self) -> int:
        """CURRENT_MODE.intended_custom_mode."""
        ...

    @property
    def base_mode(self) -> int:
        """HEARTBEAT.base_mode."""
        ...

    @property
    def system_status(self) -> int:
        """HEARTBEAT.system_status."""
        ...

    @property
    def landed_state(self) -> int:
        """EXTENDED_SYS_STATE.landed_state."""
        ...

    @property
    def ready_to_arm(self) -> bool:
        """The PREARM bit of SYS_STATUS."""
        ...

    def tick(self, now_s: float) -> Setpoint:
        """Decide."""
        ...

    def execute(self, now_s: float, command: Command) -> Sequence[CommandAnswer]:
        """Obey or refuse."""
        ...

    def set_mode(self, now_s: float, /, base_mode: int, custom_mode: int) -> None:
        """Take a SET_MODE message, which has no answer of its own."""
        ...

    def offer(self, now_s: float, message: Any) -> None:  # noqa: ANN401 - pymavlink has no types
        """Take a setpoint."""
        ...

    def guide(self, now_s: float, /, item: PlanItem) -> bool:
        """Take a mission item that is an order (current 2 or 3); whether it is obeyed. PX4 knows none."""
        ...

    def switch(self, now_s: float, /, mode: str) -> None:
        """Take the pilot's choice."""
        ...
