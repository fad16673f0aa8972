"""Nets over sequences of different lengths, against one plain net per sequence."""

from collections.abc import Callable
from functools import partial

import pytest
import torch
from jaxtyping import TypeCheckError
from torch import Tensor, nn

from tvae.baselines.policies import MemorylessTrunk, MovingTrunk
from tvae.model.encoder import Encoder
from tvae.model.trunks import PlainTrunk, ReactiveTrunk, Trunk
from tvae.nets import PooledBidirectionalLSTM, masked_mean, reverse_within

LENGTHS = torch.tensor([5, 1, 3, 5, 2])


@pytest.fixture
def sequence() -> Tensor:
    return torch.randn(5, 5, 4, generator=torch.Generator().manual_seed(0))


def plain(net: PooledBidirectionalLSTM) -> nn.LSTM:
    """torch's own bidirectional net with the same weights."""
    inputs, hidden = net.forwards.input_size, net.forwards.hidden_size
    result = nn.LSTM(inputs, hidden, batch_first=True, bidirectional=True)
    own = dict(net.forwards.state_dict())
    own |= {f"{name}_reverse": value for name, value in net.backwards.state_dict().items()}
    result.load_state_dict(own)
    return result


def test_bidirectional_is_the_mean_of_torchs_own_on_each_sequence(sequence: Tensor):
    net = PooledBidirectionalLSTM(4, 6)
    reference = plain(net)
    outputs = net(sequence, LENGTHS)
    assert outputs.shape == (5, 12)
    for row, length, output in zip(sequence, LENGTHS, outputs, strict=True):
        expected, _ = reference(row[None, :length])
        torch.testing.assert_close(output, expected[0].mean(0), rtol=1e-5, atol=1e-6)


def test_gradients_of_the_bidirectional_net_are_those_of_each_sequence(sequence: Tensor):
    net = PooledBidirectionalLSTM(4, 6)
    reference = plain(net)
    net(sequence, LENGTHS).square().sum().backward()
    for row, length in zip(sequence, LENGTHS, strict=True):
        reference(row[None, :length])[0].mean(1).square().sum().backward()
    for name, parameter in net.forwards.named_parameters():
        torch.testing.assert_close(parameter.grad, getattr(reference, name).grad, rtol=1e-4, atol=1e-6)
    for name, parameter in net.backwards.named_parameters():
        torch.testing.assert_close(parameter.grad, getattr(reference, f"{name}_reverse").grad, rtol=1e-4, atol=1e-6)


def test_reversed_twice_is_the_same(sequence: Tensor):
    back = reverse_within(sequence, LENGTHS)
    for row, backwards, length in zip(sequence, back, LENGTHS, strict=True):
        assert torch.equal(backwards[:length], row[:length].flip(0))
        assert torch.equal(backwards[length:], row[length:])
    assert torch.equal(reverse_within(back, LENGTHS), sequence)


def test_mean_is_over_the_steps_of_the_mask(sequence: Tensor):
    mask = torch.arange(5) < LENGTHS[:, None]
    expected = torch.stack([row[:length].mean(0) for row, length in zip(sequence, LENGTHS, strict=True)])
    torch.testing.assert_close(masked_mean(sequence, mask), expected)


@pytest.mark.parametrize("kind", [PlainTrunk, ReactiveTrunk])
def test_trunk_fed_step_by_step_is_the_trunk_fed_at_once(sequence: Tensor, kind: type[Trunk]):
    trunk, z = kind(4, 2, 6), torch.randn(5, 2)
    trunk.unit.copy_(torch.tensor([0.5, 1.0, 2.0, 4.0]))
    at_once, last = trunk(sequence, z)
    memory = None
    for step in range(5):
        features, memory = trunk(sequence[:, step : step + 1], z, memory)
        torch.testing.assert_close(features[:, 0], at_once[:, step], rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(memory, last, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    "kind", [PlainTrunk, ReactiveTrunk, partial(ReactiveTrunk, num_done=1), MemorylessTrunk, MovingTrunk], ids=str
)
def test_features_at_places_are_those_of_all_there(sequence: Tensor, kind: Callable[..., Trunk]):
    trunk, z = kind(4, 2, 6), torch.randn(5, 2)
    places = torch.tensor([4, 0, 0]), torch.tensor([1, 3, 0])
    everywhere, last = trunk(sequence, z)
    there, same = trunk(sequence, z, at=places)
    torch.testing.assert_close(there, everywhere[places])
    torch.testing.assert_close(same, last)


def test_a_reactive_trunk_sees_the_last_change_in_its_unit(sequence: Tensor):
    trunk, z = ReactiveTrunk(4, 2, 6), torch.randn(5, 2)
    trunk.unit.fill_(0.5)
    features, _ = trunk(sequence, z)
    assert trunk.by_style is not None
    changes = features[..., -6:-2] / (1 + trunk.by_style(z)[:, None, -4:])
    assert not changes[:, 0].any()
    torch.testing.assert_close(changes[:, 1:], 2 * (sequence[:, 1:] - sequence[:, :-1]))


def test_what_was_done_weighs_features_as_the_latent_does(sequence: Tensor):
    trunk, z = ReactiveTrunk(4, 2, 6, num_done=1), torch.randn(5, 2)
    done = sequence.clone()
    done[..., 3] = 1.0
    features, _ = trunk(done, z)
    assert trunk.by_style is not None
    weights = 1 + trunk.by_style(torch.cat([z, torch.ones(5, 1)], dim=1))
    torch.testing.assert_close(features[..., 6:10], done * weights[:, None, 6:10])
    assert not torch.allclose(weights, 1 + trunk.by_style(torch.cat([z, torch.zeros(5, 1)], dim=1)))


def test_shapes_are_checked_in_tests(sequence: Tensor):
    with pytest.raises(TypeCheckError, match="masked_mean"):
        masked_mean(sequence, torch.ones(5, 4, dtype=torch.bool))


def test_posterior_never_loses_its_width(sequence: Tensor):
    encoder = Encoder(in_features=4, latent_features=2, hidden_features=6)
    with torch.no_grad():
        encoder.parameters_of_law.bias[2:] = torch.tensor([1e4, -1e4])
        law = encoder(sequence, LENGTHS)
    assert law.stddev.isfinite().all()
    assert law.stddev.min() > 1e-4


@pytest.mark.parametrize("part", ["plain", "reactive", "encoder"])
def test_dropout_is_active_in_training_only(sequence: Tensor, part: str):
    nets = {
        "plain": PlainTrunk(4, 2, 6, dropout=0.5),
        "reactive": ReactiveTrunk(4, 2, 6, dropout=0.5),
        "encoder": Encoder(4, 2, 6, dropout=0.5),
    }
    net = nets[part]
    inputs = (sequence, LENGTHS) if part == "encoder" else (sequence, torch.zeros(5, 2))

    def output() -> Tensor:
        result = net(*inputs)
        return result.mean if part == "encoder" else result[0]

    assert not torch.equal(output(), output())
    net.eval()
    assert torch.equal(output(), output())
