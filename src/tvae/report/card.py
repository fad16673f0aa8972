"""The model card of a run: a Markdown page beside a published model."""

from __future__ import annotations

from dataclasses import dataclass

from jinja2 import Environment, PackageLoader, StrictUndefined

from tvae.evaluate.words import explanation
from tvae.report.markdown import escaped, fenced
from tvae.report.tables import number, percent


@dataclass(frozen=True)
class CardStyle:
    """A style in words."""

    name: str
    """With its number, `style 0`, which sentences refer to."""
    weight: float
    """Its share of the demonstrations."""
    sentences: tuple[str, ...]
    """What sets it apart."""


@dataclass(frozen=True)
class Measurement:
    """A number, of one style's bot or of the whole model, and what it means."""

    metric: str
    value: float
    meaning: str
    style: str = ""
    interval: tuple[float, float] | None = None
    """The 95 % confidence interval."""


@dataclass(frozen=True)
class Trial:
    """Where the bots were tried."""

    environment: str
    episodes: int


@dataclass(frozen=True)
class CardContent:
    """All that a card says."""

    title: str
    repository: str
    """Where the model is published, as `owner/name`."""
    verdict: str
    styles: tuple[CardStyle, ...]
    labelled: bool
    """Whether styles are called by labels of the data."""
    num_episodes: int
    num_steps: int
    held_out: float
    """Share of the episodes."""
    signals: tuple[tuple[str, str], ...]
    """Column and kind of each."""
    measurements: tuple[Measurement, ...]
    test: Trial | None
    warnings: tuple[str, ...]
    """Of the training."""
    command: str
    version: str
    """Of tvae."""
    seed: int
    environment: str | None
    """A call of `gymnasium.make`, as Python."""
    license: str | None

    @property
    def usage(self) -> str:
        """Python that makes a bot of the first style."""
        repository = repr(self.repository)
        lines = [
            "import tvae",
            "",
            f"model = tvae.TrajectoryVAE.from_pretrained({repository})",
            f"playstyles = tvae.Playstyles.from_pretrained({repository})",
        ]
        if self.environment is None:
            lines += [
                "agent = tvae.Agent(model, playstyles.styles[0])",
                "action = agent.act(observation)  # both are dictionaries, by the names of the signals",
            ]
        else:
            lines = ["import gymnasium", *lines, f"env = {self.environment}"]
            lines += [
                "agent = tvae.Agent(model, playstyles.styles[0], env)",
                "observation, _ = env.reset()",
                "action = agent.act(observation)",
            ]
        return "\n".join(lines)


def card_page(content: CardContent) -> str:
    """The card in Markdown, all text from data escaped; the same content gives the same page."""
    environment = Environment(
        loader=PackageLoader("tvae", "report"),
        undefined=StrictUndefined,
        finalize=escaped,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "percent": percent}
    return environment.get_template("card.md").render(
        card=content,
        fenced=fenced,
        explanation=explanation(sentence for style in content.styles for sentence in style.sentences),
    )
