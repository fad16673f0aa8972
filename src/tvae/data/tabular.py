"""Demonstrations as tables, in Parquet and CSV files: one row a step.

| column          | holds                                                                           |
|-----------------|---------------------------------------------------------------------------------|
| `episode`       | which episode: integers or text                                                 |
| `step`          | 0, 1, 2, ... within the episode                                                 |
| `observation.*` | what was seen before the action                                                 |
| `action.*`      | what was done; all empty in the row of the observation after the last action    |
| any other       | a fact about the episode where it never changes within one, else about the step |

`reward`, `terminated` and `truncated` are always about the step, `label` and `group` facts like any other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from tvae.data.columns import KindError, decode, kinds_by_column
from tvae.data.demonstrations import Demonstrations
from tvae.data.preparation import AS_RECORDED, Preparation
from tvae.data.ragged import blocks, ranges
from tvae.data.table_files import METADATA_KEY, found_schema, has_tabs, is_csv_name, is_parquet_name, schema_path
from tvae.data.table_rows import Examined, examine
from tvae.data.table_schema import ACTION, OBSERVATION, TableSchema
from tvae.data.tables import DataSource, open_table, title
from tvae.data.trajectory import DataError
from tvae.files import appearing
from tvae.spaces import FloatArray, IntArray, Space

_BLOCK_STEPS = 1 << 20


def read_table(
    source: DataSource,
    *,
    angular: Sequence[str] = (),
    continuous: Sequence[str] = (),
    categorical: Sequence[str] = (),
    binary: Sequence[str] = (),
    preparation: Preparation = AS_RECORDED,
    observation_space: Space | None = None,
    action_space: Space | None = None,
) -> Demonstrations:
    """Demonstrations from whatever `open_table` reads, such as a `.parquet`, `.csv` or `.csv.gz` file.

    The kind of a column follows from the schema in a file that we wrote, else from its type. `angular`,
    `continuous`, `categorical` and `binary` name columns, such as `observation.heading`, that are of another kind.
    A given space, such as a model's, says what all observations or actions are; other columns or categories
    than its own are refused. `preparation` says which column is what, and what becomes of missing values, uneven
    steps and players.

    Raises `DataError` with file, episode, step and column for the first problem; `validate` finds all.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "walks.csv"
    >>> _ = path.write_text("episode,step,observation.x,action.go\\n7,0,0.0,left\\n7,1,-1.0,\\n")
    >>> walks = read_table(path)
    >>> walks.action_space.signals, walks[0].has_final_observation
    ((Categorical(name='go', categories=('left',)),), True)
    """
    raw = open_table(source, preparation)
    if raw is None:
        raise DataError(f"{title(source)}: no table, but a directory or an id")
    examined = examine(
        raw,
        kinds=kinds_by_column(angular, continuous, categorical, binary),
        preparation=preparation,
        observation_space=observation_space,
        action_space=action_space,
    )
    return whole(examined, title(source))


def whole(examined: Examined, where: str) -> Demonstrations:
    """What a table holds; raises `DataError` with `where` it is and the first problem, if there is one."""
    if examined.demonstrations is None:
        more = len(examined.issues) - 1
        others = f" (and {more} other kind{'s' if more > 1 else ''} of problem)" if more else ""
        raise DataError(f"{where}: {examined.issues[0]}{others}; `tvae data validate` says what mends it")
    return examined.demonstrations


def write_parquet(demonstrations: Demonstrations, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a Parquet file that `read_table` reads back without loss. It appears only when whole.

    Raises `FileExistsError` where it exists and `overwrite` is False, and `DataError` for names that a table
    cannot hold.

    >>> import tempfile
    >>> from tvae.data.trajectory import Trajectory
    >>> from tvae.spaces import Angular
    >>> walk = Trajectory(np.zeros((4, 1)), np.ones((3, 1)), attributes={"label": "east"})
    >>> space = Space((Angular("heading"),))
    >>> path = Path(tempfile.mkdtemp()) / "walks.parquet"
    >>> write_parquet(Demonstrations.from_trajectories([walk], space, space), path)
    >>> read_table(path)[0].attributes
    {'episode': 0, 'label': 'east'}
    """
    path = Path(path)
    if not is_parquet_name(path):
        raise DataError(f"{path}: the name of a Parquet file needs to end with .parquet")
    schema, tables = _tables(demonstrations)
    with appearing(path, overwrite=overwrite) as partial:
        columns = next(tables)
        kept = columns.schema.with_metadata({METADATA_KEY: schema.to_text().encode()})
        with pq.ParquetWriter(partial, kept, compression="zstd") as writer:
            writer.write_table(columns.cast(kept))
            for columns in tables:
                writer.write_table(columns.cast(kept))


def write_csv(demonstrations: Demonstrations, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a CSV file and, beside it, `NAME.csv.schema.json` with what its text cannot say.

    The name ends with `.csv` or, for tabs between columns, `.tsv`, and with `.gz` behind it for a compressed one.
    Together they are read back without loss. Raises as `write_parquet` does.
    """
    path = Path(path)
    if not is_csv_name(path):
        raise DataError(f"{path}: the name of a CSV file needs to end with .csv, .csv.gz, .tsv or .tsv.gz")
    schema, tables = _tables(demonstrations)
    form = pa_csv.WriteOptions(delimiter="\t" if has_tabs(path) else ",")
    compression = "gzip" if path.name.lower().endswith(".gz") else None
    older = found_schema(path) if overwrite and path.is_file() else None
    with (
        appearing(path, overwrite=overwrite) as partial,
        appearing(schema_path(path), overwrite=overwrite) as partial_schema,
    ):
        partial_schema.write_text(schema.to_text(), encoding="utf-8")
        columns = next(tables)
        with (
            pa.output_stream(partial, compression=compression) as stream,
            pa_csv.CSVWriter(stream, columns.schema, write_options=form) as writer,
        ):
            writer.write_table(columns)
            for columns in tables:
                writer.write_table(columns)
    if older is not None and older != schema_path(path):
        older.unlink()


def _tables(demonstrations: Demonstrations) -> tuple[TableSchema, Iterator[pa.Table]]:
    """The schema and, a bounded number of rows at a time, the tables."""
    if len(demonstrations) == 0:
        raise DataError("a table needs at least one episode, got none")
    if "episode" not in demonstrations.attributes:
        demonstrations = demonstrations.with_attributes({"episode": np.arange(len(demonstrations))})
    _check_names(demonstrations)
    parts = blocks(demonstrations.lengths, _BLOCK_STEPS)
    first = _table(demonstrations[:1])
    schema = TableSchema(
        observation_space=demonstrations.observation_space,
        action_space=demonstrations.action_space,
        steps=tuple(demonstrations.steps),
        attributes=tuple(name for name in demonstrations.attributes if name != "episode"),
        types={field.name: str(field.type) for field in first.schema},
        num_rows=demonstrations.num_steps + int(demonstrations.final_observed.sum()),
    )
    return schema, (_table(demonstrations[part]) for part in parts)


def _check_names(demonstrations: Demonstrations) -> None:
    episodes = demonstrations.attributes["episode"]
    unique, counts = np.unique(episodes, return_counts=True)
    if episodes.dtype.kind not in "iuU":
        raise DataError(f"attribute 'episode' needs integers or text, got {episodes.dtype}")
    if len(unique) < len(episodes):
        raise DataError(f"attribute 'episode' needs different values, got {unique[counts > 1][0]!r} twice")
    names = [*demonstrations.steps, *demonstrations.attributes]
    for name in names:
        if name == "step" or name.startswith((OBSERVATION, ACTION)) or names.count(name) > 1:
            raise DataError(f"a table cannot hold the fact {name!r}: another column has this name")
        values = demonstrations.steps.get(name, demonstrations.attributes.get(name))
        if values is None or values.dtype.kind not in "biufU":
            raise DataError(f"a table cannot hold the fact {name!r}: it is no number, boolean or text")


def _table(part: Demonstrations) -> pa.Table:
    """All rows of some episodes: one an action, and one for each observed end."""
    counts = part.lengths + part.final_observed
    member = np.repeat(np.arange(len(part)), counts)
    step = ranges(np.zeros_like(counts), counts)
    acting = step < part.lengths[member]
    action_rows = ranges(part.action_starts, part.lengths)
    action_of_row = pa.array(np.cumsum(acting) - 1, mask=~acting)
    columns: dict[str, Any] = {
        "episode": _facts(part.attributes["episode"]).take(pa.array(member)),
        "step": pa.array(step),
        **_signals(
            OBSERVATION, part.observation_space, part.observations, ranges(part.observation_starts, counts)
        ),
    }
    for name, values in _signals(ACTION, part.action_space, part.actions, action_rows).items():
        columns[name] = values.take(action_of_row)
    for name, values in part.steps.items():
        columns[name] = _facts(values[action_rows]).take(action_of_row)
    for name, values in part.attributes.items():
        if name != "episode":
            columns[name] = _facts(values).take(pa.array(member))
    return pa.table(columns)


def _signals(prefix: str, space: Space, flat: FloatArray, rows: IntArray) -> dict[str, pa.Array]:
    raw = flat[rows]
    columns = {}
    for index, signal in enumerate(space.signals):
        try:
            columns[prefix + signal.name] = decode(signal, np.ascontiguousarray(raw[:, index]))
        except KindError as error:
            raise DataError(f"column {prefix}{signal.name}: {error}") from None
    return columns


def _facts(values: NDArray[Any]) -> pa.Array:
    half = values.dtype == np.float16
    return pa.array(values.astype(np.float32) if half else np.asarray(values))
