"""A record as a table, one row a cycle: CSV for spreadsheets, Parquet for pandas."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
from pyarrow import csv, parquet

from guidance.log.columns import SCHEMA, LastHeard
from guidance.log.reader import cycles_of

_ROWS_AT_ONCE: Final = 4096


def write_csv(path: Path, out: Path) -> int:
    """Write a CSV; return how many rows. NaN and null are empty cells.

    Raises:
        ConfigError: If the record cannot be read.
        OSError: If `out` cannot be written.
    """
    with csv.CSVWriter(out, SCHEMA) as writer:
        return _write(path, writer)


def write_parquet(path: Path, out: Path) -> int:
    """Write a Parquet file; return how many rows.

    Raises:
        ConfigError: If the record cannot be read.
        OSError: If `out` cannot be written.
    """
    with parquet.ParquetWriter(out, SCHEMA) as writer:
        return _write(path, writer)


def _write(path: Path, writer: Any) -> int:  # noqa: ANN401 - either of pyarrow's writers
    count = 0
    for batch in _batches(path):
        writer.write_batch(batch)
        count += batch.num_rows
    return count


def _batches(path: Path) -> Iterator[pa.RecordBatch]:
    heard = LastHeard()
    rows = (heard.flat(row) for row in cycles_of(path))
    while some := list(islice(rows, _ROWS_AT_ONCE)):
        yield pa.RecordBatch.from_pylist(some, schema=SCHEMA)
