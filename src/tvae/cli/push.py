"""`tvae push`."""

from __future__ import annotations

from pathlib import Path

from tvae.cli.options import CONSOLE, Flag, Run
from tvae.experiments.publishing import publish, write_folder
from tvae.experiments.using import open_run


def push(
    run: Run,
    repo: str,
    *,
    license: str | None = None,
    private: Flag = False,
    dry_run: Path | None = None,
) -> None:
    """Publish the model, the styles and a model card of a run on the Hugging Face Hub.

    Needs the extra `hub`, and a token as `hf auth login` keeps it. The card holds the command that made the run, with
    the paths in it, and the styles hold the probability of each session; look at --dry-run before you publish.

    Parameters
    ----------
    repo
        The repository, as owner/name; it is made if there is none.
    license
        Under which others may use it, such as mit or cc-by-4.0; without it, the card says that none is stated.
    private
        Only those whom you let see it can.
    dry_run
        A new directory that gets what would be published, instead of publishing it.
    """
    opened = open_run(run, "cpu")
    if dry_run is None:
        CONSOLE.print(publish(opened, repo, license=license, private=private), markup=False, highlight=False)
    else:
        write_folder(opened, dry_run, repo, license=license)
        CONSOLE.print(f"nothing published; what would be is in {dry_run}", markup=False, highlight=False)
