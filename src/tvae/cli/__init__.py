"""The command line: `tvae VERB`. Each verb is a module of its own, loaded when it is called; none holds logic."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import gymnasium
from cyclopts import App, CycloptsError, Parameter
from cyclopts.config import Json, Toml, Yaml

from tvae import __version__
from tvae.errors import TvaeError

app = App(
    name="tvae",
    version=__version__,
    help="Find the playstyles hidden in recorded demonstrations, and imitate each of them.",
    result_action="return_value",
)
data = App(name="data", help="Look at demonstrations, check them, convert them.")
app.command(data)

_VERBS = (
    (app, "demo", "Run a whole example: styles, a bot for each, a page to look at.", "tvae demo pusht"),
    (
        app,
        "fit",
        "Train on demonstrations; find and describe their styles.",
        "tvae fit sessions.csv --out runs/sessions --angular action.heading --env tvae/ZombieAttack-v0",
    ),
    (
        app,
        "styles",
        "Say in words which styles a run found; join or name them; label other sessions.",
        "tvae styles runs/sessions --data new.parquet --out labels.parquet",
    ),
    (
        app,
        "embed",
        "Write one row of numbers per session: z, how sure it is, style.",
        "tvae embed runs/sessions new.parquet --out z.parquet",
    ),
    (
        app,
        "score",
        "Say how likely each step of each session is, and what is unlike the training demonstrations.",
        "tvae score runs/sessions new.parquet --out scores.parquet",
    ),
    (
        app,
        "similar",
        "List the sessions that are played most like a given one.",
        "tvae similar runs/sessions new.parquet session-17 --count 10",
    ),
    (
        app,
        "generate",
        "Imagine episodes of a style, without an environment.",
        "tvae generate runs/zombie --style attack --episodes 50 --out imagined.csv",
    ),
    (
        app,
        "rollout",
        "Let the bot of a style act in an environment.",
        "tvae rollout runs/zombie --style attack --episodes 1000 --out attack.parquet",
    ),
    (app, "evaluate", "Measure a run: likelihood, styles, bots.", "tvae evaluate runs/zombie --episodes 1000"),
    (
        app,
        "export",
        "Write a model as ONNX, with all that an engine needs to know.",
        "tvae export runs/zombie --out exports/zombie",
    ),
    (
        app,
        "push",
        "Publish a run on the Hugging Face Hub, with a model card.",
        "tvae push runs/sessions owner/name --license cc-by-4.0 --dry-run exports/hub",
    ),
    (
        app,
        "reproduce",
        "Reproduce the paper: its tasks, figures and numbers.",
        "tvae reproduce zombie --out results --seeds 5",
    ),
    (
        app,
        "benchmark",
        "Compare methods on the paper's tasks and with real people, side by side.",
        "tvae benchmark --out runs/benchmark --seeds 5 --tasks zombie",
    ),
    (app, "report", "Write the page of a run anew.", "tvae report runs/sessions"),
    (data, "info", "Show what is in a data set.", "tvae data info sessions.parquet --out pictures"),
    (
        data,
        "validate",
        "List everything that is wrong with a table.",
        "tvae data validate 'days/*.csv' --player player --time seconds",
    ),
    (
        data,
        "convert",
        "Write a data set in another format; nothing is lost.",
        "tvae data convert sessions.csv sessions.parquet --angular action.heading",
    ),
    (data, "make", "Write the demonstrations of one of our tasks.", "tvae data make zombie zombie.parquet"),
)
for _group, _verb, _help, _example in _VERBS:
    _module = "data" if _group is data else _verb
    _group.command(f"tvae.cli.{_module}:{_verb}", name=_verb, help=_help, help_epilogue=f"Example: {_example}")

_GROUPS = ("model", "training", "policy")
"""Options that have others below them."""
_FORMATS: dict[str, type[Yaml | Json | Toml]] = {".yaml": Yaml, ".yml": Yaml, ".json": Json, ".toml": Toml}


@app.meta.default
def _with_config(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    config: Annotated[Path | None, Parameter(help="YAML, TOML or JSON file with options of the command.")] = None,
) -> None:
    if config is not None and config.suffix not in _FORMATS:
        raise TvaeError(f"--config needs a file that ends in {', '.join(_FORMATS)}, got {config}")
    app.config = () if config is None else (_read(config),)
    app(tokens)


def _read(config: Path) -> Yaml | Json | Toml:
    found = _FORMATS[config.suffix](config, must_exist=True, use_commands_as_keys=False)
    try:
        whole = found.config
    except CycloptsError as error:
        raise TvaeError(f"{config}: {error}") from error
    options = whole if isinstance(whole, dict) else {}  # what is none, cyclopts refuses
    for group in _GROUPS:
        if not isinstance(options.get(group, {}), dict):
            raise TvaeError(f"{config}: {group} needs options below it, by their names, got {options[group]}")
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; what the user can mend is said in one line, with exit status 2."""
    os.environ.setdefault("GOMP_SPINCOUNT", "2000")  # threads that wait must not slow other processes down
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # no name in the data stops a run, as in a file on Windows
    try:
        app.meta(arguments)
    except (TvaeError, gymnasium.error.Error, OSError) as error:
        print(f"tvae: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("tvae: stopped; a fit goes on with --resume", file=sys.stderr)
        sys.exit(130)
