"""Demonstrations from wherever they are, and to wherever they shall go."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from tvae.data.columns import kinds_by_column
from tvae.data.demonstrations import HEADER_NAME, Demonstrations
from tvae.data.lerobot_source import INFO_PATH
from tvae.data.minari_source import find_minari, is_minari_id, minari_root, read_minari
from tvae.data.minari_target import write_minari
from tvae.data.preparation import AS_RECORDED, Preparation
from tvae.data.raw_table import RawTable
from tvae.data.reinterpretation import check_degrees, told, with_kinds
from tvae.data.table_files import CSV_SUFFIXES, PARQUET_SUFFIXES, is_csv_name, is_parquet_name
from tvae.data.table_rows import Decided, examine
from tvae.data.tables import DataSource, open_directory, open_table, title
from tvae.data.tabular import whole, write_csv, write_parquet
from tvae.data.trajectory import DataError
from tvae.spaces import Signal, Space

MINARI_PREFIX = "minari:"
DIRECTORY_SUFFIX = ".tvae"
_NO_TABLE = "only a table can be prepared, by its columns, players, times or missing values"


def load_demonstrations(
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
    """Demonstrations from a file, many files, a directory, a table in memory or a Minari id.

    | source                                         | read by                              |
    |------------------------------------------------|--------------------------------------|
    | file `.parquet`, `.csv`, `.tsv`, `.csv.gz`     | `read_table`                         |
    | pattern such as `day-*/*.csv`, list of files   | `read_table_files`                   |
    | directory with such files in it or below it    | `read_table_files`                   |
    | table of pandas, polars, Arrow and others      | `read_table`, by Arrow's C stream    |
    | file `.hdf5`, `.h5` in robomimic's layout      | `read_robomimic`                     |
    | directory of a LeRobot data set, version 3     | `read_lerobot`                       |
    | directory that `Demonstrations.write` made     | `Demonstrations.open`, memory-mapped |
    | directory of a Minari data set                 | `read_minari`                        |
    | `namespace/name-v0`, `minari:` and one of both | `read_minari`                        |

    NumPy and PyTorch arrays: `tvae.data.arrays.from_arrays`.

    `angular`, `continuous`, `categorical` and `binary` name columns, such as `observation.heading` or `heading`, that
    are of another kind than the source suggests. `preparation` says which columns of a table are read, what they are,
    and what becomes of missing values, uneven steps and several players. Given spaces, such as a model's, must fit; a
    table is read by their names and categories.

    Raises `DataError`, which says what was tried, where and what is wrong.

    >>> import pyarrow as pa
    >>> rows = {"episode": [0, 0], "step": [0, 1], "observation.x": [0.5, 1.5], "action.heading": [3.1, -3.1]}
    >>> load_demonstrations(pa.table(rows), angular=["action.heading"]).action_space.signals
    (Angular(name='heading', recorded_in_degrees=False),)
    """
    kinds = kinds_by_column(angular, continuous, categorical, binary)
    return read_source(
        source, kinds, preparation, observation_space=observation_space, action_space=action_space
    )[0]


def read_source(
    source: DataSource,
    kinds: Mapping[str, type[Signal]],
    preparation: Preparation,
    *,
    observation_space: Space | None = None,
    action_space: Space | None = None,
) -> tuple[Demonstrations, Decided]:
    """What `load_demonstrations` gives, and who decided what each column is. Raises `DataError` likewise."""
    raw = open_any_table(source, preparation)
    if raw is not None:
        examined = examine(
            raw, kinds=kinds, preparation=preparation, observation_space=observation_space, action_space=action_space
        )
        return whole(examined, title(source)), examined.decided
    assert isinstance(source, str | Path)
    if preparation != replace(AS_RECORDED, degrees=preparation.degrees, columns=preparation.columns):
        raise DataError(f"{source}: {_NO_TABLE}")
    demonstrations = _read(source, preparation.columns)
    try:
        if observation_space is None and action_space is None:
            check_degrees(demonstrations, preparation.degrees)
        decided = Decided(by_user=frozenset(told(demonstrations, kinds, preparation.degrees)[0]))
        demonstrations = with_kinds(demonstrations, kinds, preparation.degrees)
        check_spaces(demonstrations, observation_space, action_space)
    except DataError as error:
        raise DataError(f"{source}: {error}") from None
    return demonstrations, decided


def open_any_table(source: DataSource, preparation: Preparation) -> RawTable | None:
    """The rows of a source; None where it is demonstrations that need no table, or nothing at all.

    Raises `DataError` if it should be a table and cannot be read.
    """
    raw = open_table(source, preparation)
    if raw is not None or not isinstance(source, str | Path) or not Path(source).is_dir() or _is_episodes(source):
        return raw
    return open_directory(source, preparation)


def _is_episodes(directory: str | Path) -> bool:
    return (Path(directory) / HEADER_NAME).is_file() or find_minari(str(directory)) is not None


def _read(source: str | Path, columns: Sequence[str]) -> Demonstrations:
    text, path = str(source), Path(source)
    if text.startswith(MINARI_PREFIX):
        return read_minari(text.removeprefix(MINARI_PREFIX), columns)
    if (path / HEADER_NAME).is_file():
        if columns:
            raise DataError(f"{source}: {_NO_TABLE}")
        return Demonstrations.open(path)
    if find_minari(text) is not None:
        return read_minari(text, columns)
    if path.is_dir():
        raise DataError(
            f"{source}: a directory without {HEADER_NAME} (of demonstrations), without metadata.json or "
            f"data/metadata.json (of a Minari data set), without {INFO_PATH} (of a LeRobot data set) and without "
            "Parquet and CSV files"
        )
    where = f"no Minari data set of this id under {minari_root()}; `minari download {text}` fetches one"
    tried = where if is_minari_id(text) else "no Minari id either, which looks like namespace/name-v0"
    raise DataError(f"{source}: no such file, no such directory, and {tried}")


def check_spaces(
    demonstrations: Demonstrations, observation_space: Space | None, action_space: Space | None
) -> None:
    """Raise `DataError` with what was needed and what came where demonstrations have other signals than these.

    >>> from tvae.data.arrays import from_arrays
    >>> from tvae.spaces import Angular
    >>> walk = from_arrays([[[0.0], [1.0]]], [[[1.0]]])
    >>> check_spaces(walk, None, Space((Angular("heading"),)))  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    tvae.data.trajectory.DataError: actions differ from what is expected: signal 0 is angular ('heading') against ...
    """
    for what, wanted, got in (
        ("observations", observation_space, demonstrations.observation_space),
        ("actions", action_space, demonstrations.action_space),
    ):
        differences = [] if wanted is None else wanted.differences(got)
        if differences:
            raise DataError(f"{what} differ from what is expected: {'; '.join(differences)}")


def save_demonstrations(
    demonstrations: Demonstrations, target: str | Path, *, overwrite: bool = False, environment: str | None = None
) -> None:
    """Write demonstrations in the form that the target's name says.

    A Minari data set also keeps `environment`, the id of a Gymnasium environment, and can recover it.

    | target                     | written                                   |
    |----------------------------|-------------------------------------------|
    | `NAME.parquet`             | Parquet file                              |
    | `NAME.csv`, `NAME.csv.gz`  | CSV file and `NAME.csv.schema.json`       |
    | `NAME.tsv`, `NAME.tsv.gz`  | the same with tabs between columns        |
    | `NAME.tvae`                | directory that is opened memory-mapped    |
    | `minari:namespace/name-v0` | Minari data set under Minari's root       |
    | `minari:DIRECTORY`         | Minari data set in a directory of its own |

    All are read back without loss. Raises `FileExistsError` where the target exists and `overwrite` is False,
    and `DataError` for any other name.

    >>> import tempfile
    >>> from tvae.data.arrays import from_arrays
    >>> target = Path(tempfile.mkdtemp()) / "walks.tvae"
    >>> save_demonstrations(from_arrays([[[0.0], [1.0]]], [[[1.0]]]), target)
    >>> load_demonstrations(target)[0].observations.tolist()
    [[0.0], [1.0]]
    """
    text, path = str(target), Path(target)
    if text.startswith(MINARI_PREFIX):
        rest = text.removeprefix(MINARI_PREFIX)
        where = rest if is_minari_id(rest) else Path(rest)
        write_minari(demonstrations, where, overwrite=overwrite, environment=environment)
    elif is_parquet_name(path):
        write_parquet(demonstrations, path, overwrite=overwrite)
    elif is_csv_name(path):
        write_csv(demonstrations, path, overwrite=overwrite)
    elif path.suffix == DIRECTORY_SUFFIX:
        demonstrations.write(path, overwrite=overwrite)
    else:
        names = ", ".join((*PARQUET_SUFFIXES, *CSV_SUFFIXES, DIRECTORY_SUFFIX))
        raise DataError(f"{target}: the name needs to end with {names}, or to begin with {MINARI_PREFIX}")
