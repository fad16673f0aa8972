"""The Hugging Face Hub, without a network: what is read, what is written, and what a card says."""

from __future__ import annotations

import json
import shutil
import sys
from inspect import signature
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import huggingface_hub
import numpy as np
import pytest
from huggingface_hub.errors import HfHubHTTPError
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt

import tvae
from commands import call, refused
from toys import noise, untrained
from tvae.config import ModelConfig, RunConfig
from tvae.errors import ModelError
from tvae.evaluate.encoding import Posteriors
from tvae.evaluate.playstyles import find_playstyles
from tvae.experiments.arenas import Arena
from tvae.experiments.findings import Findings
from tvae.experiments.fitting import About, begin
from tvae.experiments.run_directory import RunDirectory, write_json
from tvae.experiments.source import Source
from tvae.hub import FILES, HubError
from tvae.pretrained import pretrained_directory
from tvae.report.markdown import escaped, fenced
from tvae.spaces import Angular, Continuous, Space

REPO = "owner/walks"
EVIL = "a|b <script>alert(1)</script> [x](http://x.y) `c` ---"
METRICS = {
    "train_seconds": 3.0,
    "active_units": 2,
    "playstyles": {"num_found": 2, "verdict": "2 styles", "ari": None},
    "nats_per_trajectory": {"held_out": {"policy": -3.25, "state": 1.0, "stop": 0.0, "kl": 0.75}},
    "held_out_likelihood": {"with_latent": 8.0, "difference": {"mean": 1.5, "ci95": [0.5, 2.5]}},
    "warnings": [f"collapsed\n\n# {EVIL}"],
    "test_environment": "tvae/ZombieAttack-v0",
    "test_episodes": 20,
    "success": {EVIL: 0.9, "avoid": 1.0},
    "jumps": {EVIL: 3.0, "avoid": 2.0},
    "ci95": {"success": {EVIL: [0.7, 0.95], "avoid": [0.8, 1.0]}, "jumps": {EVIL: [2, 4], "avoid": [1, 3]}},
}


def write_run(path: Path, arena: Arena | None) -> Path:
    """A finished run whose names, labels and words are nasty."""
    demonstrations = noise(
        [4, 5, 6] * 3, observation_space=Space((Continuous(EVIL),)), action_space=Space((Angular("h*e*ading"),))
    )
    config = RunConfig(ModelConfig(hidden_features=8, prior_components=1), seed=7)
    run = RunDirectory.create(path, force=False)
    begin(run, demonstrations, About(config, Source("/secret/z.csv"), arena, "walks", ("/x/tvae", "fit", "```\n# a")))
    untrained(demonstrations, prior_components=1, action_components=2, window=4).save_weights(run.model)
    random = np.random.default_rng(0)
    means = np.repeat([[-4.0, 0.0], [4.0, 0.0]], [210, 90], axis=0) + 0.5 * random.standard_normal((300, 2))
    playstyles = find_playstyles(Posteriors(means, np.full((300, 2), 0.3)))
    findings = Findings(playstyles, {0: EVIL, 1: "avoid"}, {0: (EVIL, "slow"), 1: ("1. goes",)})
    write_json(run.playstyles, findings.to_json())
    write_json(run.metrics, METRICS)
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    arena = Arena("tvae/ZombieAttack-v0", {"speed": "x```"}, episodes=20)
    return write_run(tmp_path_factory.mktemp("runs") / "walks", arena)


class FakeHub:
    """The calls of the library that are used, on a directory instead of a server."""

    def __init__(self, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.root = root
        self.private: dict[str, bool] = {}
        self.asked: list[dict[str, object]] = []
        monkeypatch.setattr(huggingface_hub, "HfApi", lambda: self)
        monkeypatch.setattr(huggingface_hub, "snapshot_download", self.snapshot_download)

    def create_repo(self, repo_id: str, *, private: bool | None, exist_ok: bool) -> str:
        assert exist_ok
        self.private.setdefault(repo_id, bool(private))
        (self.root / repo_id).mkdir(parents=True, exist_ok=True)
        return f"https://huggingface.co/{repo_id}"

    def model_info(self, repo_id: str) -> SimpleNamespace:
        return SimpleNamespace(private=self.private[repo_id])

    def upload_folder(
        self, *, repo_id: str, folder_path: Path, commit_message: str, allow_patterns: list, delete_patterns: list
    ) -> None:
        assert commit_message
        for name in delete_patterns:
            (self.root / repo_id / name).unlink(missing_ok=True)
        for path in Path(folder_path).iterdir():
            if path.name in allow_patterns:
                shutil.copy(path, self.root / repo_id)

    def snapshot_download(self, repo_id: str, **options: object) -> str:
        self.asked.append(options)
        return str(self.root / repo_id)


@pytest.fixture
def hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeHub:
    return FakeHub(tmp_path / "hub", monkeypatch)


def test_the_library_has_the_calls_of_the_fake() -> None:
    for name in ("create_repo", "model_info", "upload_folder"):
        theirs = signature(getattr(huggingface_hub.HfApi, name)).parameters
        assert set(signature(getattr(FakeHub, name)).parameters) <= set(theirs)


def names(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.iterdir())


def same(one: tvae.TrajectoryVAE, other: tvae.TrajectoryVAE) -> bool:
    theirs = other.state_dict()
    return all(tensor.equal(theirs[name]) for name, tensor in one.state_dict().items())


def test_a_published_run_comes_back(run: Path, hub: FakeHub, capsys: pytest.CaptureFixture[str]) -> None:
    call("push", run, REPO, "--private")
    assert f"https://huggingface.co/{REPO}" in capsys.readouterr().out
    assert hub.private == {REPO: True}
    assert names(hub.root / REPO) == sorted(["README.md", *FILES])
    model = tvae.TrajectoryVAE.from_pretrained(REPO, revision="main")
    assert same(model, tvae.TrajectoryVAE.load(run))
    assert tvae.Playstyles.from_pretrained(REPO).verdict == tvae.Playstyles.load(run).verdict
    assert hub.asked[0] == {"revision": "main", "allow_patterns": list(FILES)}
    assert hub.asked[1]["revision"] is None
    for path in (hub.root / REPO).iterdir():
        assert b"/secret" not in path.read_bytes()


def test_a_model_alone_leaves_no_other_styles_and_keeps_a_card(run: Path, hub: FakeHub) -> None:
    call("push", run, REPO)
    model = tvae.TrajectoryVAE.load(run)
    assert model.push_to_hub(REPO) == f"https://huggingface.co/{REPO}"
    assert names(hub.root / REPO) == ["README.md", "config.json", "model.safetensors"]
    assert "# walks" in (hub.root / REPO / "README.md").read_text()
    model.push_to_hub(REPO, card="größer")
    assert (hub.root / REPO / "README.md").read_text(encoding="utf-8") == "größer"
    with pytest.raises(ModelError, match=r"has no playstyles.json"):
        tvae.Playstyles.from_pretrained(REPO)


def test_what_is_public_is_not_taken_for_private(run: Path, hub: FakeHub, capsys: pytest.CaptureFixture[str]) -> None:
    hub.create_repo(REPO, private=False, exist_ok=True)
    assert "is public already" in refused(capsys, "push", run, REPO, "--private")
    assert names(hub.root / REPO) == []


def test_a_dry_run_writes_the_folder_alone(
    run: Path, tmp_path: Path, hub: FakeHub, capsys: pytest.CaptureFixture[str]
) -> None:
    call("push", run, REPO, "--dry-run", tmp_path / "folder")
    assert names(tmp_path / "folder") == sorted(["README.md", *FILES])
    assert names(tmp_path) == ["folder"]
    assert "exists already" in refused(capsys, "push", run, REPO, "--dry-run", tmp_path / "folder")
    said = refused(capsys, "push", run, "walks\n```", "--dry-run", tmp_path / "other")
    assert "a repository is called owner/name" in said
    assert names(tmp_path) == ["folder"]


def test_a_run_that_did_not_end_is_not_published(
    run: Path, hub: FakeHub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(run, tmp_path / "run")
    (tmp_path / "run" / "metrics.json").unlink()
    assert "did not get that far" in refused(capsys, "push", tmp_path / "run", REPO)
    assert hub.private == {}


def test_the_library_reads_a_snapshot_that_is_there(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The real library, offline, on a cache as it keeps it."""
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path))
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    commit = "0" * 40
    repository = tmp_path / "models--owner--walks"
    call("push", run, REPO, "--dry-run", repository / "snapshots" / commit)
    (repository / "refs").mkdir()
    (repository / "refs" / "main").write_text(commit)
    assert same(tvae.TrajectoryVAE.from_pretrained(REPO), tvae.TrajectoryVAE.load(run))
    assert pretrained_directory(REPO, commit) == repository / "snapshots" / commit
    with pytest.raises(HubError, match=r"no directory 'owner/swims', and it cannot be read from the Hugging Face Hub"):
        tvae.TrajectoryVAE.from_pretrained("owner/swims")


def fails(error: Exception) -> object:
    def call(*arguments: object, **options: object) -> None:
        raise error

    return call


@pytest.mark.parametrize(
    "error", [OSError("no\nroute"), ValueError("no\nroute"), HfHubHTTPError.__bases__[0]("no\nroute")], ids=repr
)
def test_trouble_is_said_in_a_line(
    run: Path, hub: FakeHub, monkeypatch: pytest.MonkeyPatch, error: Exception, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(huggingface_hub, "snapshot_download", fails(error))
    with pytest.raises(HubError, match=r"'owner/swims', and it cannot be read .*: no route$"):
        tvae.TrajectoryVAE.from_pretrained("owner/swims")
    monkeypatch.setattr(FakeHub, "upload_folder", fails(error))
    assert "cannot be written to the Hugging Face Hub: no route" in refused(capsys, "push", run, REPO)


def test_without_the_library_it_says_what_to_install(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    model = tvae.TrajectoryVAE.load(run)
    for use in (lambda: tvae.TrajectoryVAE.from_pretrained(REPO), lambda: model.push_to_hub(REPO)):
        with pytest.raises(HubError, match=r"pip install 'tvae\[hub\]'"):
            use()


def test_a_directory_comes_first_and_a_path_is_never_a_repository(
    run: Path, hub: FakeHub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(run, REPO)
    assert pretrained_directory(REPO) == Path(REPO)
    with pytest.raises(ModelError, match="only a repository of the Hugging Face Hub has revisions"):
        tvae.TrajectoryVAE.from_pretrained(REPO, revision="main")
    with pytest.raises(ModelError, match="only a repository"):
        tvae.TrajectoryVAE.from_pretrained("zombie", revision="main")
    with pytest.raises(ModelError, match="there is no model 'owner/swims'"):
        tvae.TrajectoryVAE.from_pretrained(Path("owner/swims"))
    assert hub.asked == []


# The card


@pytest.fixture(scope="module")
def card(run: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("card") / "folder"
    call("push", run, REPO, "--license", "cc-by-4.0", "--dry-run", folder)
    return (folder / "README.md").read_text(encoding="utf-8")


def test_the_metadata_of_a_card_are_those_of_the_hub(card: str) -> None:
    data = huggingface_hub.ModelCard(card).data
    assert (data.library_name, data.license, data.model_name) == ("tvae", "cc-by-4.0", "walks")
    found = {(result.metric_type, result.metric_name): result for result in data.eval_results}
    assert found["success", f"success, {EVIL}"].metric_value == 0.9
    assert found["success", "success, avoid"].dataset_name == "tvae/ZombieAttack-v0"
    assert found["held_out_likelihood.difference", "held_out_likelihood.difference"].metric_value == 1.5
    assert ("playstyles.ari", "playstyles.ari") not in found


def tokens(card: str) -> list[tuple[str, str]]:
    """Kind and text of each piece of the page, as CommonMark has it."""
    page = MarkdownIt("commonmark").enable("table").parse(huggingface_hub.ModelCard(card).text)
    return [(token.type, token.content) for block in page for token in (block, *(block.children or ()))]


def test_a_card_shows_text_from_data_as_text(card: str) -> None:
    found = tokens(card)
    kinds = {kind for kind, _ in found}
    assert not kinds & {"html_inline", "html_block", "link_open", "code_inline", "em_open", "strong_open", "hr"}
    texts = [text for kind, text in found if kind == "text"]
    assert texts.count(EVIL) == 2  # in two rows of measurements
    assert texts.count(f"{EVIL} (style 0)") == 1
    assert f"observation.{EVIL}" in texts
    assert "1. goes" in texts
    assert f"collapsed # {EVIL}" in texts
    headings = [text for (kind, _), (_, text) in pairwise(found) if kind == "heading_open"]
    assert headings == ["walks", "Styles", "Data", "Measurements", "How it was made", "Use", "Licence"]
    assert sum(kind == "tr_open" for kind, _ in found) == 3 + 3 + 13


def test_a_card_says_what_there_is_to_know(card: str) -> None:
    texts = [text for kind, text in tokens(card) if kind == "text"]
    for text in ("9 episodes, 45 steps; 10 % of the episodes were held out.", "70 %", "angular", "0.7 to 0.95"):
        assert text in texts
    assert "mean over test episodes, as the environment measures it" in texts
    blocks = [text for kind, text in tokens(card) if kind == "fence"]
    assert blocks[0] == "tvae fit '```\n# a'\n"
    assert "gymnasium.make('tvae/ZombieAttack-v0', speed='x```')" in blocks[1]
    compile(blocks[1], "card", "exec")
    assert "cc-by-4.0" in texts


def test_a_card_without_licence_and_environment(tmp_path: Path) -> None:
    run = write_run(tmp_path / "walks", None)
    write_json(run / "metrics.json", {"active_units": 2})
    call("push", run, REPO, "--dry-run", tmp_path / "folder")
    page = huggingface_hub.ModelCard((tmp_path / "folder" / "README.md").read_text(encoding="utf-8"))
    assert page.data.license is None
    assert "None is stated." in page.text
    assert "gymnasium" not in page.text
    assert "fresh episodes" not in page.text
    assert [result.metric_type for result in page.data.eval_results] == ["active_units"]
    assert json.loads((tmp_path / "folder" / "config.json").read_text()).keys() == {
        "format", "schema_version", "observation_space", "action_space", "arguments"
    }  # fmt: skip


@given(st.text(st.characters(exclude_categories=["C"])).filter(str.strip))
def test_text_is_shown_as_it_is(text: str) -> None:
    wanted = " ".join(text.split())
    for page in (f"- {escaped(text)}", f"# {escaped(text)}", f"| a |\n|---|\n| {escaped(text)} |"):
        inline = [token for token in MarkdownIt("commonmark").enable("table").parse(page) if token.type == "inline"]
        assert [(child.type, child.content) for child in inline[-1].children or []] == [("text", wanted)]


@given(st.text(st.sampled_from("`~\n a")))
def test_code_stays_in_its_block(text: str) -> None:
    blocks = MarkdownIt("commonmark").parse(fenced(text))
    assert [(block.type, block.content) for block in blocks] == [("fence", text + "\n")]
