"""The columns of tables of outcomes, with Arrow's types."""

from typing import Any, Final

import pyarrow as pa

from guidance.sim.outcome import Outcome
from guidance.sim.team_maths import TeamOutcome

_KINDS: Final[dict[Any, pa.DataType]] = {str: pa.string(), int: pa.int64(), float: pa.float64()}


def _schema(row: type) -> pa.Schema:
    words = pa.list_(pa.string())
    return pa.schema([(name, _KINDS.get(kind, words)) for name, kind in row.__annotations__.items()])


SCHEMA: Final = _schema(Outcome)
TEAM_SCHEMA: Final = _schema(TeamOutcome)
