"""Whether the bots of `examples/browser` do in a browser what they do in PyTorch.

    pip install ".[browser]"
    npm install --prefix examples/browser
    python scripts/browser_success.py

It opens the page in headless Chromium with a fresh export of the shipped zombie model; `chromium` and `chromedriver`
must be on the path. First the world of the page takes the same actions as that of the package: all that is seen and
known of both must be equal. Then each style plays episodes in the page and in PyTorch. Both success rates are printed
with 95 % intervals (Wilson), and so is that of their difference (Newcombe), in which 0 must lie.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from math import hypot
from pathlib import Path
from tempfile import TemporaryDirectory
from time import sleep

import numpy as np
from rich.console import Console
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webdriver import WebDriver
from selenium.webdriver.support.wait import WebDriverWait

import tvae
from tvae.envs.zombie import ZombieAttackVectorEnv, success
from tvae.envs.zombie_dynamics import ZombieAttack
from tvae.experiments.exporting import export
from tvae.generate.closed_loop import LatentPolicy
from tvae.model.decoding import most_likely, sampled
from tvae.report.tables import Measured, share
from tvae.rollouts import rollout

PAGE = Path(__file__).parent.parent / "examples" / "browser"
TRACES = """
const [zombies, actions] = arguments, { traced } = await import("/episodes.js");
return zombies.map((zombie, at) => traced(zombie, actions[at]));
"""
SUCCESSES = """
const [name, count, seed, mostLikely] = arguments;
const { Bot, uniform } = await import("/bot.js"), { successes } = await import("/episodes.js");
const bot = await Bot.load("exports/zombie"), style = bot.styles.find((style) => style.name === name);
return successes(bot, style, count, uniform(seed), mostLikely);
"""


class Quiet(SimpleHTTPRequestHandler):
    """Serves files and says nothing."""

    def log_message(self, format: str, *args: object) -> None:
        """Nothing."""


@contextmanager
def served(directory: Path) -> Iterator[str]:
    """The address of a server of a directory's files, on this machine alone."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(directory)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/index.html"
    finally:
        server.shutdown()
        server.server_close()


@contextmanager
def browser() -> Iterator[WebDriver]:
    """Headless Chromium."""
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver is None:
        sys.exit("needs chromium and chromedriver on the path (Debian: packages chromium and chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=760,1000"):
        options.add_argument(argument)
    opened = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    opened.set_script_timeout(600)
    try:
        yield opened
    finally:
        opened.quit()


def largest_difference(page: WebDriver, episodes: int = 200) -> float:
    """Between the two worlds, over all that is seen and known after each of random actions."""
    task, rng = ZombieAttack(), np.random.default_rng(0)
    state = task.start(episodes, rng)
    towards = task.observe(state)[:, [1, 3]][np.arange(episodes), rng.integers(0, 2, episodes)]  # the goal, the zombie
    actions = np.stack(
        [
            rng.integers(0, 2, (episodes, task.num_steps)),
            towards[:, None] + rng.normal(0, 0.3, (episodes, task.num_steps)),
        ],
        axis=-1,
    )
    theirs = np.array(page.execute_script(TRACES, state.zombie.tolist(), actions.tolist()))
    ours = []
    for step in range(task.num_steps):
        state = task.step(state, actions[:, step])
        over = task.terminated(state) | (state.time >= task.num_steps)
        known = (state.alive, state.attacks, state.closest_zombie, state.closest_goal, over)
        ours.append(np.column_stack([task.observe(state), *known]))
    print(
        f"world: {episodes} episodes of {task.num_steps} random actions, {np.mean(~state.alive):.0%} of the zombies "
        f"dead, {np.mean(state.closest_zombie < 1):.0%} of the agents caught"
    )
    return float(np.abs(theirs - np.stack(ours, axis=1)).max())


def told(rate: Measured) -> str:
    """A rate and its interval in percent."""
    low, high = rate.interval
    return f"{rate.mean:.1%} [{low:.1%}, {high:.1%}]"


def difference(one: Measured, other: Measured) -> tuple[float, float]:
    """Newcombe's interval of the difference of two shares."""
    (low, high), (other_low, other_high) = one.interval, other.interval
    apart = one.mean - other.mean
    return (
        apart - hypot(one.mean - low, other_high - other.mean),
        apart + hypot(high - one.mean, other.mean - other_low),
    )


def main() -> None:
    """Compare worlds and success rates; the exit status is 1 where they differ."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=1000, help="of each style, in the page and in PyTorch")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--screenshot", type=Path, help="a PNG of the page after some seconds of play")
    options = parser.parse_args()
    if not (PAGE / "node_modules" / "onnxruntime-web").is_dir():
        sys.exit("ONNX Runtime Web is not installed: npm install --prefix examples/browser")
    model, playstyles = tvae.TrajectoryVAE.from_pretrained("zombie"), tvae.Playstyles.from_pretrained("zombie")
    agree = True
    with TemporaryDirectory() as made, browser() as page:
        site = Path(made)
        for file in [*PAGE.glob("*.html"), *PAGE.glob("*.js")]:
            shutil.copy(file, site)
        (site / "node_modules").symlink_to(PAGE / "node_modules")
        export("zombie", site / "exports" / "zombie", force=False, console=Console(quiet=True))
        with served(site) as address:
            page.get(f"{address}?seed={options.seed}")
            WebDriverWait(page, 60).until(lambda shown: shown.find_element(By.ID, "play").is_enabled())
            apart = largest_difference(page)
            print(f"the worlds differ by at most {apart:.1e}")
            agree &= apart < 1e-9
            names = [option.text for option in page.find_elements(By.CSS_SELECTOR, "#style option")]
            for certain, choice in ((False, sampled), (True, most_likely)):
                for style, name in zip(playstyles.styles, names, strict=True):
                    well = page.execute_script(SUCCESSES, name, options.episodes, options.seed, certain)
                    there = share(well, options.episodes)
                    played = rollout(
                        ZombieAttackVectorEnv(min(1000, options.episodes)),
                        LatentPolicy(model, style, choice=choice),
                        options.episodes,
                        seed=options.seed,
                    )
                    here = share(int(success(played)[name].sum()), options.episodes)
                    low, high = difference(there, here)
                    agree &= low <= 0 <= high
                    print(
                        f"{name}, {'most likely' if certain else 'drawn'} actions: browser {told(there)}, "
                        f"PyTorch {told(here)}, difference [{100 * low:+.1f}, {100 * high:+.1f}] points"
                    )
            if options.screenshot:
                sleep(6)
                page.save_screenshot(str(options.screenshot))
            shown = page.find_element(By.ID, "error").text
            if shown:
                sys.exit(f"the page says: {shown}")
    print("they agree" if agree else "they DIFFER")
    sys.exit(not agree)


if __name__ == "__main__":
    main()
