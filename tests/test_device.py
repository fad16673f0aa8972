"""Where tensors live and randomness comes from."""

import numpy as np
import pytest
import torch
from torch.fx.experimental import _config as config

from toys import ACTIONS, OBSERVATIONS, noise, untrained
from tvae.data.batches import TrajectoryBatch
from tvae.device import DeviceError, reseed, resolve_device, seeded
from tvae.fitting.fit import fit
from tvae.model.elbo import elbo
from tvae.model.windows import whole


@pytest.fixture
def cpu_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)


@pytest.mark.parametrize("name", ["gpu", "", "CPU", "cpu:0", "cuda:", "cuda:x", "cuda:-1", "mps:1", "cuda:0:1"])
def test_unknown_names_are_refused(name: str):
    with pytest.raises(DeviceError, match="device must be auto, cpu, cuda, cuda:N or mps, got"):
        resolve_device(name)


def test_a_device_of_torch_is_one():
    assert resolve_device(torch.device("cpu")) == torch.device("cpu")


def test_a_seed_may_be_a_whole_number_of_numpy():
    drawn = []
    for seed in (5, np.int64(5), np.uint32(5)):
        reseed(seed, torch.device("cpu"))
        drawn.append(torch.rand(()).item())
    assert len(set(drawn)) == 1


@pytest.mark.usefixtures("cpu_only")
@pytest.mark.parametrize("name", ["cuda", "cuda:0", "cuda:7", "mps"])
def test_absent_devices_are_refused(name: str):
    with pytest.raises(DeviceError, match=f"device '{name}' is not there; this machine and this torch have: cpu"):
        resolve_device(name)
    with pytest.raises(DeviceError, match="is not there"):
        fit(noise([3, 3]), device=name)


@pytest.mark.usefixtures("cpu_only")
def test_the_best_of_a_plain_machine_is_the_cpu():
    assert resolve_device("auto") == resolve_device("cpu") == torch.device("cpu")


def test_the_best_of_another_machine(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    assert resolve_device("auto") == torch.device("cuda")
    assert resolve_device("cuda:1") == torch.device("cuda:1")
    with pytest.raises(DeviceError, match="device 'cuda:2' is not there"):
        resolve_device("cuda:2")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: True)
    assert resolve_device("auto") == resolve_device("mps") == torch.device("mps")


def test_randomness_inside_depends_on_the_seed_and_outside_on_nothing():
    cpu = torch.device("cpu")
    reseed(1, cpu)
    expected = [torch.rand(()) for _ in range(3)]
    reseed(1, cpu)
    found = []
    for _ in range(3):
        found.append(torch.rand(()))
        with seeded(7, cpu):
            inside = torch.rand(2)
    assert found == expected
    with seeded(7, cpu):
        assert torch.equal(torch.rand(2), inside)
    with seeded(8, cpu):
        assert not torch.equal(torch.rand(2), inside)


@config.patch(meta_nonzero_assume_all_nonzero=True)
@pytest.mark.parametrize(
    "arguments", [{}, {"stop": True, "action_components": 2, "prior_components": 3, "dynamics": True}], ids=str
)
def test_a_step_happens_where_the_weights_are(arguments: dict):
    """On torch's device without memory, where any tensor from elsewhere is an error, and all that is asked is true."""
    meta = torch.device("meta")
    model = untrained(noise([3, 5]), **arguments).to(meta)
    assert {tensor.device for tensor in (*model.parameters(), *model.buffers())} == {meta}
    observations, actions = (torch.zeros(2, 5, space.num_columns, device=meta) for space in (OBSERVATIONS, ACTIONS))
    lengths = torch.ones(2, dtype=torch.int64, device=meta)
    batch = TrajectoryBatch(
        observations, observations, actions, lengths, torch.ones(2, 5, dtype=torch.bool, device=meta)
    )
    terms = elbo(model, batch, policy=whole(batch), state=whole(batch))
    terms.value().mean().backward()
    assert {value.device for value in (terms.policy, terms.state, terms.stop, terms.kl)} == {meta}
    assert {parameter.grad.device for parameter in model.parameters()} == {meta}
    assert model.prior.sample(3).device == meta
    states = model.observation_normalizer.features(observations)
    inputs = model.state_decoder_inputs(states, model.action_normalizer.values(actions))
    law, log_odds, _ = model.state_decoder(inputs, observations, model.prior.sample(2))
    assert law.mode().device == log_odds.device == meta
