"""Put models of a reproduction into the package, one of each task: python scripts/ship_pretrained.py [results]."""

import sys
from pathlib import Path

from tvae.experiments.reproduction.cells import Cell, Effort
from tvae.experiments.reproduction.studies import STUDIES
from tvae.experiments.run_directory import read_json
from tvae.experiments.shipping import ship
from tvae.pretrained import ROOT

FIGURES = {
    "navigation": ("end_distance", "end_distance_demonstrations", "decoder_consistency"),
    "circle": ("radial_error", "turn_completed", "decoder_consistency"),
    "zombie": ("success", "success_most_likely", "attacks_per_episode", "decoder_consistency"),
}
SEEDS = {"navigation": 1, "circle": 0, "zombie": 0}
"""The first seed of each task that has as many styles as demonstrators."""
ENVIRONMENTS = {"navigation": "Navigation", "circle": "Circle", "zombie": "ZombieAttack"}

CARD = """# tvae: {title}

A Trajectory VAE, {parameters:,} parameters, trained on {episodes:,} scripted demonstrations of the task
`tvae/{env}-v0` ({labels}; the model never saw these labels). It found {styles} styles.

```python
import gymnasium
import tvae

model = tvae.TrajectoryVAE.from_pretrained("{task}")
playstyles = tvae.Playstyles.from_pretrained("{task}")
env = gymnasium.make("tvae/{env}-v0")
agent = tvae.Agent(model, playstyles.styles[0], env)
```

Style by style: {names}.

Measured as `docs/paper.md` says, over 1,000 fresh episodes of each bot with sampled actions:

| | |
|---|---|
{rows}

It is the model of seed {seed} of `tvae reproduce {task}` at commit {commit}, and meant for trying things out and
for the examples of the docs. MIT licence.
"""


def rows(metrics: dict, names: tuple[str, ...]) -> str:
    """Lines of the card's table."""
    lines = []
    for name in names:
        values = metrics[name] if isinstance(metrics[name], dict) else {"": metrics[name]}
        lines += [f"| {name}{f'.{key}' if key else ''} | {value:.3f} |" for key, value in values.items()]
    return "\n".join(lines)


def main(results: Path) -> None:
    """Ship every task."""
    for task, study in STUDIES.items():
        seed = SEEDS[task]
        directory = results / "cells" / task / "default" / f"seed-{seed}"
        cell = Cell(task, "default", seed, directory, Effort())
        if not cell.is_finished():
            sys.exit(f"{directory} is not finished; run tvae reproduce {task}")
        subject, metrics = cell.subject(), read_json(cell.metrics)
        findings = subject.findings
        card = CARD.format(
            title=study.title,
            task=task,
            seed=seed,
            env=ENVIRONMENTS[task],
            parameters=sum(parameter.numel() for parameter in subject.model.parameters()),
            episodes=len(subject.demonstrations),
            labels=", ".join(sorted(set(subject.demonstrations.attribute("label").tolist()))),
            styles=len(subject.playstyles),
            names=", ".join(f"`styles[{index}]` is {name}" for index, name in sorted(findings.labels.items())),
            rows=rows(metrics, FIGURES[task]),
            commit=metrics["commit"],
        )
        ship(subject.model, findings, ROOT / task, card, overwrite=True)
        print(f"{task}: {ROOT / task}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "results"))
