"""Exports: ONNX Runtime computes what PyTorch computes, with operators that every engine has, and says all in words."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

import tvae
from commands import refused
from toys import ACTIONS, OBSERVATIONS, noise, untrained
from tvae.cli import main
from tvae.envs import zombie_dynamics
from tvae.envs.zombie import ZombieAttackVectorEnv, success
from tvae.export import parity
from tvae.export.bundle import Export, export_onnx, graphs
from tvae.export.compact import compact_json
from tvae.export.draws import category, normal, von_mises
from tvae.export.engines import ENGINES
from tvae.export.manifest import named_styles
from tvae.export.parity import Arrays, Session, carried, differences, draw, in_torch, open_session
from tvae.export.policy import PolicyStep
from tvae.export.ports import Graph
from tvae.export.sheet import ExportError
from tvae.export.writing import write_onnx
from tvae.generate.closed_loop import LatentPolicy
from tvae.model.decoding import Fixed, most_likely
from tvae.rollouts import rollout
from tvae.spaces import Angular, Binary, Categorical, Continuous, Space

EXAMPLE = Path(__file__).parent.parent / "examples" / "act_with_onnx_runtime.py"
HEADING = Space((Angular("heading"),))
GRID = Space((Categorical("x", (1, 2, 3)), Continuous("speed"), Categorical("y", (0, 1, 2, 3, 5))))
CONFIGURATIONS: dict[str, dict[str, Any]] = {
    "every kind": {},
    "mixtures": {"action_components": 3, "state_components": 2, "window": 4},
    "window 1": {"window": 1, "action_components": 2},
    "no latent": {"latent_features": 0, "window": 2},
    "no events": {"events": False, "dynamics": True, "stop": False},
    "as in the paper": {"reactive": False, "events": False, "encode_actions": False, "window": 3},
    "plain, all of the past": {"reactive": False, "latent_features": 0},
    "numbers": {"action_space": Space((Continuous("force"), Continuous("lift"))), "window": 1},
    "a direction": {"action_space": HEADING, "observation_space": HEADING, "window": 5},
    "a choice": {"action_space": Space((Categorical("move", ("a", "b", "c")),)), "action_components": 2},
    "a place on a grid": {"observation_space": GRID, "horizon": 3},
    "a lone choice": {"action_space": Space((Categorical("move", ("a", "b", "c")), Binary("jump")))},
}


def model_of(name: str) -> tvae.TrajectoryVAE:
    arguments = dict(CONFIGURATIONS[name])
    spaces = {
        "observation_space": arguments.pop("observation_space", OBSERVATIONS),
        "action_space": arguments.pop("action_space", ACTIONS),
    }
    return untrained(noise([5, 8, 3, 12], **spaces), **arguments)


@pytest.fixture(scope="module", params=CONFIGURATIONS)
def exported(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[tvae.TrajectoryVAE, Export]:
    model = model_of(request.param)
    return model, export_onnx(model, tmp_path_factory.mktemp("exports") / "model")


@pytest.fixture(scope="module")
def computed(exported: tuple[tvae.TrajectoryVAE, Export]) -> list[tuple[Graph, Session, Session, Session]]:
    """Each graph in ONNX Runtime, in PyTorch, and there in double precision."""
    model, export = exported
    return [
        (
            graph,
            open_session(export.directory / f"{graph.name}.onnx"),
            in_torch(graph),
            in_torch(deepcopy(graph).double()),
        )
        for graph in graphs(model)
    ]


def test_onnx_runtime_computes_what_pytorch_computes(exported: tuple[tvae.TrajectoryVAE, Export]) -> None:
    model, export = exported
    names = [written.graph.name for written in export.files]
    assert names == ["policy_step", "state_decoder", *(["encoder"] if model.latent_features else [])]
    assert export.largest_difference <= parity.TOLERANCE
    assert sorted(path.name for path in export.directory.iterdir()) == sorted(
        ["manifest.json", *(f"{name}.onnx" for name in names)]
    )


@settings(max_examples=6)
@given(batch=st.integers(1, 9), time=st.integers(1, 17), seed=st.integers(0, 2**31), certain=st.booleans())
def test_any_batch_and_any_length(
    exported: tuple[tvae.TrajectoryVAE, Export],
    computed: list[tuple[Graph, Session, Session, Session]],
    batch: int,
    time: int,
    seed: int,
    certain: bool,
) -> None:
    rng = np.random.default_rng(seed)
    for graph, *ways in computed:
        inputs = {port.name: draw(exported[0], port, rng, batch, time) for port in graph.inputs}
        if "most_likely" in inputs:
            inputs["most_likely"] += certain
        left, right, exact = (run(inputs) for run in ways)
        for port in graph.outputs:
            allowed = parity.TOLERANCE + 10 * differences(port, right[port.name], exact[port.name])
            assert (differences(port, left[port.name], right[port.name]) <= allowed).all(), port.name


def test_the_step_is_what_a_bot_does(exported: tuple[tvae.TrajectoryVAE, Export]) -> None:
    """The most likely actions of `LatentPolicy`, which knows nothing of this step, over more steps than the window."""
    model, export = exported
    rng = np.random.default_rng(1)
    step = PolicyStep(model)
    run = open_session(export.directory / "policy_step.onnx")
    z = rng.normal(size=(6, model.latent_features)).astype(np.float32)
    bot = LatentPolicy(model, Fixed(z.astype(np.float64)), choice=most_likely)
    bot.reset(6, seed=0)
    given_ = {port.name: draw(model, port, rng, 6, 1) for port in step.inputs}
    given_ |= {"most_likely": np.ones(1, dtype=np.float32)} | ({"z": z} if model.latent_features else {})
    for _ in range(9):
        given_["observation"] = draw(model, step.inputs[0], rng, 6, 1)
        found = run(given_)
        acted = bot.act(given_["observation"].astype(np.float64))
        assert differences(step.outputs[0], found["action"], acted.astype(np.float32)).max() < 1e-4
        given_ |= carried(found)


def test_a_positive_signal_may_reach_zero(tmp_path: Path) -> None:
    walks = noise([5, 8, 3, 12], observation_space=Space((Continuous("range"), Continuous("x"))))
    walks = replace(walks, observations=np.abs(walks.observations) * [1.0, -1.0] + [0.5, 0.0])
    model = untrained(walks)
    assert (model.perception.log_scale > 0).tolist() == [True, False]
    export_onnx(model, tmp_path / "model")
    step, run = PolicyStep(model), open_session(tmp_path / "model" / "policy_step.onnx")
    given_ = {port.name: draw(model, port, np.random.default_rng(0), 4, 1) for port in step.inputs}
    given_["observation"] = np.array([[0.0, -1.0], [-9.0, -1.0], [1e-9, -1.0], [0.6, -1.0]], dtype=np.float32)
    for name, values in in_torch(step)(given_).items():
        np.testing.assert_allclose(run(given_)[name], values, atol=1e-5)


def test_every_engine_has_every_operator(exported: tuple[tvae.TrajectoryVAE, Export]) -> None:
    _, export = exported
    import onnx

    for written in export.files:
        model = onnx.load(export.directory / f"{written.graph.name}.onnx")
        used = {node.op_type for node in model.graph.node}
        assert used == set(written.operators)
        for engine in ENGINES:
            assert used <= engine.operators, engine.name
        assert {(opset.domain, opset.version) for opset in model.opset_import} == {("", 15)}
        assert all(opset.version <= engine.opset for opset in model.opset_import for engine in ENGINES)
        assert not any(node.doc_string or node.metadata_props for node in model.graph.node)


@pytest.mark.parametrize("name", ["zombie", "circle", "navigation"])
def test_a_step_has_few_operators(name: str, tmp_path: Path) -> None:
    """Each costs an engine about half a microsecond, whatever it computes."""
    import onnx

    write_onnx(PolicyStep(tvae.TrajectoryVAE.from_pretrained(name)).eval(), tmp_path / "step.onnx")
    assert len(onnx.load(tmp_path / "step.onnx").graph.node) <= 115


def test_the_manifest_says_what_the_files_are(exported: tuple[tvae.TrajectoryVAE, Export]) -> None:
    model, export = exported
    import onnxruntime

    told = json.loads((export.directory / "manifest.json").read_text())
    for name, graph in told["graphs"].items():
        session = onnxruntime.InferenceSession(export.directory / graph["file"])
        for side, ports in (("inputs", session.get_inputs()), ("outputs", session.get_outputs())):
            assert [(port["name"], port["shape"]) for port in graph[side]] == [(p.name, p.shape) for p in ports], name
    assert [column["name"] for column in told["action"]] == list(model.action_space.names)
    assert [column["kind"] for column in told["observation"]] == [
        entry["kind"] for entry in model.observation_space.to_json()
    ]
    step = told["graphs"]["policy_step"]
    size = next(port["shape"][1] for port in step["inputs"] if port["name"] == "memory")
    ends = [field["first_column"] + int(np.prod(field["shape"])) for field in step["memory"]]
    assert [field["first_column"] for field in step["memory"]] == [0, *ends[:-1]]
    assert ends[-1] == size
    assert len(step["noise"]) == next(port["shape"][1] for port in step["inputs"] if port["name"] == "noise")
    assert told["policy"]["window"] == model.bot_window


def test_draws_have_the_laws_that_they_are_named_after() -> None:
    rng = np.random.default_rng(0)
    first, second = torch.from_numpy(rng.random((2, 40_000), dtype=np.float32))
    assert stats.kstest(normal(first, second).numpy(), "norm").pvalue > 1e-3
    even = (torch.arange(20_000) + 0.5) / 20_000
    for k in (1e-4, 0.3, 2.0, 50.0, 2500.0):
        drawn = von_mises(even, torch.full_like(even, k)).double().numpy()
        assert (np.diff(drawn) >= 0).all()
        assert np.abs(stats.vonmises(k).cdf(drawn) - even.double().numpy()).max() < 1e-3, k
    shares = np.bincount(category(first, torch.tensor([0.2, 0.0, 0.5, 0.3])).numpy(), minlength=4) / len(first)
    assert np.abs(shares - [0.2, 0.0, 0.5, 0.3]).max() < 0.01


class Noisy:
    """Bots of z that act by an exported step, in ONNX Runtime or PyTorch, with noise that depends on the seed alone."""

    def __init__(self, step: PolicyStep, run: Session, style: tvae.evaluate.styles.Style) -> None:
        self.step, self.run, self.style = step, run, style

    def reset(self, num_episodes: int, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        z = self.style.sample(num_episodes, self.rng).astype(np.float32)
        sizes = {port.name: port.shape[-1] for port in self.step.inputs}
        memory = np.zeros((num_episodes, int(sizes["memory"])), dtype=np.float32)
        self.given: Arrays = {"z": z, "memory": memory, "most_likely": np.zeros(1, dtype=np.float32)}

    def act(self, observations: np.ndarray) -> np.ndarray:
        self.given["observation"] = observations.astype(np.float32)
        self.given["noise"] = self.rng.random((len(observations), len(self.step.noise)), dtype=np.float32)
        found = self.run(self.given)
        self.given |= carried(found)
        return found["action"].astype(np.float64)


@pytest.fixture(scope="module")
def zombie(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("exports") / "zombie"
    main(["export", "zombie", "--out", str(out)])
    return out


def test_bots_succeed_without_pytorch_as_with_it(zombie: Path) -> None:
    model = tvae.TrajectoryVAE.from_pretrained("zombie")
    step = PolicyStep(model).eval()
    told = json.loads((zombie / "manifest.json").read_text())
    for style in tvae.Playstyles.from_pretrained("zombie").styles:
        name = told["styles"][style.index]["name"]
        reached = {}
        for way, run in {"onnx": open_session(zombie / "policy_step.onnx"), "torch": in_torch(step)}.items():
            reached[way] = success(rollout(ZombieAttackVectorEnv(300), Noisy(step, run, style), 300, seed=4))[name]
        assert (reached["onnx"] == reached["torch"]).mean() > 0.98
        usual = rollout(ZombieAttackVectorEnv(300), LatentPolicy(model, style), 300, seed=4)
        assert abs(reached["onnx"].mean() - success(usual)[name].mean()) < 0.04
        assert reached["onnx"].mean() > 0.9


def test_the_example_acts_without_pytorch(zombie: Path) -> None:
    spec = importlib.util.spec_from_file_location("example", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    assert example.play(zombie, "attack", 40) > 0.85
    code = f"import sys; sys.path.insert(0, {str(EXAMPLE.parent)!r})\n"
    code += "import pathlib, act_with_onnx_runtime as example\n"
    code += f"print(example.play(pathlib.Path({str(zombie)!r}), 'avoid', 3), 'torch' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert said.split()[1] == "False"


def test_the_manifest_tells_of_styles(zombie: Path) -> None:
    told = json.loads((zombie / "manifest.json").read_text())
    assert {style["name"] for style in told["styles"]} == {"attack", "avoid"}
    assert sum(style["frequency"] for style in told["styles"]) == pytest.approx(1)
    for style, found in zip(told["styles"], tvae.Playstyles.from_pretrained("zombie").styles, strict=True):
        assert style["words"]
        assert style["z"]["representative"] in style["z"]["members"]["means"]
        assert style["z"]["mean"] == found.mean.tolist()
    assert told["parity"]["largest_difference"].keys() == told["graphs"].keys()
    assert max(told["parity"]["largest_difference"].values()) <= told["parity"]["tolerance"] == 1e-5
    assert {"name", "version"} == set().union(*(engine.keys() for engine in told["engines"]))


def test_the_manifest_can_be_read_by_people(zombie: Path) -> None:
    lines = (zombie / "manifest.json").read_text().splitlines()
    assert len(lines) < 300
    long = [line for line in lines if len(line) > 120]
    numbers = [line for line in long if re.match(r' *"(means|deviations)": \[\[', line)]
    assert len(numbers) == 2 * 2
    sentences = [line for line in long if line not in numbers]
    assert all(line.count('"') == 2 or re.match(r' *"how_to_draw": "', line) for line in sentences)


@settings(max_examples=50)
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
        lambda inner: st.lists(inner, max_size=30) | st.dictionaries(st.text(max_size=40), inner, max_size=5),
        max_leaves=60,
    )
)
def test_short_json_says_the_same(data: Any) -> None:
    assert json.loads(compact_json(data)) == data


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_json_has_no_infinity(number: float) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        compact_json({"means": [[number]] * 100})


def test_what_is_there_is_replaced_only_on_demand(
    zombie: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (zombie / "manifest.json").read_bytes()
    assert "exists already" in refused(capsys, "export", "circle", "--out", str(zombie))
    assert (zombie / "manifest.json").read_bytes() == before
    (tmp_path / "letters.txt").write_text("dear")
    assert "is no export" in refused(capsys, "export", "zombie", "--out", str(tmp_path), "--force")
    assert (tmp_path / "letters.txt").read_text() == "dear"
    assert "there is no model" in refused(capsys, "export", "chess", "--out", str(tmp_path / "new"))
    main(["export", "zombie", "--out", str(zombie), "--force"])
    assert (zombie / "manifest.json").read_bytes() == before


def test_a_model_without_styles_is_exported_too(tmp_path: Path) -> None:
    model_of("window 1").save(tmp_path / "model")
    main(["export", str(tmp_path / "model"), "--out", str(tmp_path / "out")])
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["styles"] == []


def test_without_the_extra_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    assert "pip install 'tvae[export]'" in refused(capsys, "export", "zombie", "--out", str(tmp_path / "out"))
    assert list(tmp_path.iterdir()) == []


def test_a_graph_that_differs_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tvae.export.recurrence.lstm_once", lambda take, give, candidate: take)
    with pytest.raises(ExportError, match="differs between ONNX Runtime and PyTorch"):
        export_onnx(model_of("window 1"), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_styles_without_a_label_have_a_name() -> None:
    found = tvae.Playstyles.from_pretrained("zombie").styles
    assert [style.name for style in named_styles(found, {}, {})] == ["style 0", "style 1"]


def test_numbers_that_round_to_one_give_what_the_largest_below_one_gives() -> None:
    """Hosts that draw in double precision and store in single may pass a 1."""
    one, below = torch.ones(1), torch.full((1,), 1 - 2.0**-24)
    assert normal(one, torch.zeros(1)) == normal(below, torch.zeros(1))
    padded = torch.tensor([[0.2, 0.3, 0.5, 0.0, 0.0], [0.7, 0.2, 0.1, 0.0, 0.0]])
    assert category(torch.ones(2), padded / padded.sum(-1, keepdim=True)).tolist() == [2, 2]


def test_a_graph_stays_finite_at_one(tmp_path: Path) -> None:
    model = model_of("numbers")
    export_onnx(model, tmp_path / "model")
    step = PolicyStep(model)
    inputs = {port.name: draw(model, port, np.random.default_rng(0), 3, 1) for port in step.inputs}
    inputs["noise"] = np.ones_like(inputs["noise"])
    found = open_session(tmp_path / "model" / "policy_step.onnx")(inputs)
    assert np.isfinite(found["action"]).all()


def test_another_manifest_is_left_alone(tmp_path: Path) -> None:
    """A web page has a file of that name too."""
    (tmp_path / "manifest.json").write_text('{"name": "a page"}', encoding="utf-8")
    (tmp_path / "index.html").write_text("kept", encoding="utf-8")
    with pytest.raises(FileExistsError, match="is no export"):
        export_onnx(model_of("window 1"), tmp_path, overwrite=True)
    assert (tmp_path / "index.html").read_text(encoding="utf-8") == "kept"


def test_the_page_in_a_browser_has_the_numbers_of_the_task() -> None:
    """`scripts/browser_success.py` compares the worlds step by step; this needs no browser."""
    page = EXAMPLE.parent / "browser"
    told = dict(re.findall(r"^export const ([A-Z_]+) = (.+);$", (page / "zombie.js").read_text(), flags=re.MULTILINE))
    task = zombie_dynamics.ZombieAttack()
    known = vars(zombie_dynamics) | {"START_LOW": task.start_low, "START_HIGH": task.start_high}
    assert len(told) == 9
    for name, value in told.items():
        assert np.array_equal(json.loads(value), known[name]), name
    for file in ("index.html", "page.js", "episodes.js", "bot.js"):
        for script in re.findall(r"""["'](?:\./)?(\w+\.js)["']""", (page / file).read_text()):
            assert (page / script).exists(), f"{file}: {script}"
