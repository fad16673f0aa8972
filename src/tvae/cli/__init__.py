"""The command line: `tvae VERB`. Each verb is a module of its own, loaded when it is called; none holds logic."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import gymnasium
from cyclopts import App, Parameter
from cyclopts.config import Json, Toml, Yaml

from tvae import __version__
from tvae.errors import TvaeError

app = App(
    name="tvae",
    version=__version__,
    help="Find the playstyles hidden in recorded demonstrations, and imitate each of them.",
    result_action="return_value",
)
app.command("tvae.cli.demo:demo", name="demo", help="Run a whole example: styles, a bot for each, a page to look at.")
app.command("tvae.cli.fit:fit", name="fit", help="Train on demonstrations; find and describe their styles.")
app.command("tvae.cli.styles:styles", name="styles", help="Say in words which styles a run found; label sessions.")
app.command("tvae.cli.generate:generate", name="generate", help="Imagine episodes of a style, without environment.")
app.command("tvae.cli.rollout:rollout", name="rollout", help="Let the bot of a style act in an environment.")
app.command("tvae.cli.evaluate:evaluate", name="evaluate", help="Measure a run: likelihood, styles, bots.")
app.command("tvae.cli.report:report", name="report", help="Write the page of a run anew.")

data = App(name="data", help="Look at demonstrations, check them, convert them.")
data.command("tvae.cli.data:info", name="info", help="Show what is in a data set.")
data.command("tvae.cli.data:validate", name="validate", help="List everything that is wrong with a table.")
data.command("tvae.cli.data:convert", name="convert", help="Write a data set in another format.")
data.command("tvae.cli.data:make", name="make", help="Write the demonstrations of one of our tasks.")
app.command(data)

_FORMATS: dict[str, type[Yaml | Json | Toml]] = {".yaml": Yaml, ".yml": Yaml, ".json": Json, ".toml": Toml}


@app.meta.default
def _with_config(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    config: Annotated[Path | None, Parameter(help="YAML, TOML or JSON file with options of the command.")] = None,
) -> None:
    if config is not None:
        if config.suffix not in _FORMATS:
            raise TvaeError(f"--config needs a file that ends in {', '.join(_FORMATS)}, got {config}")
        app.config = _FORMATS[config.suffix](config, must_exist=True, use_commands_as_keys=False)
    app(tokens)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; what the user can mend is said in one line, with exit status 2."""
    os.environ.setdefault("GOMP_SPINCOUNT", "2000")  # threads that wait must not slow other processes down
    try:
        app.meta(arguments)
    except (TvaeError, gymnasium.error.Error, FileNotFoundError, FileExistsError) as error:
        print(f"tvae: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("tvae: stopped; a fit goes on with --resume", file=sys.stderr)
        sys.exit(130)
