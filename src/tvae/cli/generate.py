"""`tvae generate`."""

from __future__ import annotations

from pathlib import Path

from tvae.cli.options import CONSOLE, Count, Device, Flag, Force, Run, Seed, Styles, choice_of
from tvae.data.sources import save_demonstrations
from tvae.experiments.targets import check_demonstrations
from tvae.experiments.using import imagine_style, open_run


def generate(
    run: Run,
    *,
    out: Path,
    style: Styles = ("0",),
    episodes: Count = 100,
    window: Count | None = None,
    most_likely: Flag = False,
    temperature: float | None = None,
    seed: Seed = 0,
    device: Device = "auto",
    force: Force = False,
) -> None:
    """Imagine episodes of a style: states by the state decoder, actions by the policy decoder, no environment.

    Parameters
    ----------
    out
        Where to write them: a .parquet or .csv file, a .tvae directory, or minari:ID.
    window
        Rolling window: the most past states that the decoders remember; by default as in training.
    most_likely
        Always take the most likely state and action instead of drawing them.
    temperature
        T > 0: draw from p^(1/T) instead of p. Below 1 nearer to the most likely and less varied, 1 as learnt.
    """
    check_demonstrations(out, overwrite=force)
    opened = open_run(run, device)
    choice = choice_of(most_likely=most_likely, temperature=temperature)
    found = imagine_style(opened, style, episodes, choice=choice, window=window, seed=seed)
    save_demonstrations(found, out, overwrite=force)
    CONSOLE.print(f"{len(found)} episodes, {found.num_steps} steps: {out}", markup=False)
