"""Discovery on clouds whose number of styles is known, and what its records promise."""

import json
import time

import numpy as np
import pytest

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.evaluate.encoding import Posteriors, encode
from tvae.evaluate.playstyles import discover, find_playstyles, join, label_agreement, match
from tvae.evaluate.styles import Playstyles
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import Continuous, Space


def posteriors_of(points, scale=0.3, width=None, seed=0):
    """Posteriors with these means and about this scale, with inactive features up to `width`."""
    rng = np.random.default_rng(seed)
    count, used = points.shape
    idle = (width or used) - used
    means = np.concatenate([points, 0.03 * rng.standard_normal((count, idle))], axis=1)
    scales = np.concatenate([np.full(points.shape, scale), np.full((count, idle), 0.99)], axis=1)
    return Posteriors(means, scales * np.exp(0.1 * rng.standard_normal(scales.shape)))


def blobs(shares, count, distance, width, seed=0):
    """Spherical clusters of standard deviation 1, each at least `distance` from the others, and their labels."""
    rng = np.random.default_rng(seed)
    labels = np.repeat(np.arange(len(shares)), [round(share * count) for share in shares])
    while True:
        middles = np.arange(len(shares))[:, None] * 1.0 if width == 1 else rng.standard_normal((len(shares), width))
        apart = np.linalg.norm(middles[:, None] - middles, axis=-1)[np.triu_indices(len(shares), 1)]
        if width == 1 or apart.min() > 0.35 * np.median(apart):
            break
    return distance * (middles / apart.min())[labels] + rng.standard_normal((len(labels), width)), labels


def circle(count, seed=0, arc=2 * np.pi, noise=0.2):
    rng = np.random.default_rng(seed)
    angle, radius = rng.uniform(0, arc, count), 2 + noise * rng.standard_normal(count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def disc(count, seed=0):
    rng = np.random.default_rng(seed)
    angle, radius = rng.uniform(0, 2 * np.pi, count), 2 * np.sqrt(rng.random(count))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def gaussian(count, seed=0):
    return np.random.default_rng(seed).standard_normal((count, 2))


def heavy_tailed(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((count, 2)) / np.sqrt(rng.chisquare(3, (count, 1)) / 3)


def skewed(count, seed=0):
    return np.random.default_rng(seed).exponential(1, (count, 2))


def rod(count, seed=0):
    rng = np.random.default_rng(seed)
    flat = np.stack([rng.uniform(-4, 4, count), 0.3 * rng.standard_normal(count)], axis=1)
    return flat @ np.array([[0.8, 0.6], [-0.6, 0.8]])


def banana(count, seed=0):
    return circle(count, seed, arc=np.pi, noise=0.25)


@pytest.mark.parametrize("cloud", [gaussian, disc, heavy_tailed, skewed, rod, banana], ids=lambda f: f.__name__)
@pytest.mark.parametrize("count", [250, 1_000])
def test_one_cluster_of_any_shape_is_one_style(cloud, count):
    found = find_playstyles(posteriors_of(cloud(count), width=4))
    assert len(found) == 1
    assert found.verdict.startswith("one style")


def test_a_ring_is_one_style():
    assert len(find_playstyles(posteriors_of(circle(2_000), width=3))) == 1


@pytest.mark.parametrize(("number", "width"), [(2, 1), (2, 8), (3, 2), (5, 4), (8, 4), (8, 8)])
def test_clear_clusters_are_found_whatever_their_number_and_the_latents_width(number, width):
    points, labels = blobs([1 / number] * number, 100 * number, 6, width)
    found = find_playstyles(posteriors_of(points, width=max(width, 6) if width > 1 else 1))
    assert len(found) == number
    assert label_agreement(found.assignment, labels) > 0.97


def test_few_episodes_are_enough_for_clear_clusters():
    points, labels = blobs([0.5, 0.5], 50, 8, 2)
    assert label_agreement(find_playstyles(posteriors_of(points, width=4)).assignment, labels) == 1


@pytest.mark.parametrize("seed", range(4))
def test_eighty_episodes_are_enough_where_clusters_touch(seed):
    points, labels = blobs([0.5, 0.5], 80, 4, 5, seed)
    found = find_playstyles(posteriors_of(points, width=8, seed=seed), seed=seed)
    assert label_agreement(found.assignment, labels) > 0.8


@pytest.mark.parametrize("cloud", [gaussian, disc, heavy_tailed, skewed, rod], ids=lambda f: f.__name__)
@pytest.mark.parametrize("seed", range(3))
def test_few_episodes_of_one_cluster_are_one_style(cloud, seed):
    assert len(find_playstyles(posteriors_of(cloud(80, seed), width=4, seed=seed), seed=seed)) == 1


def test_rare_styles_are_found_and_the_most_frequent_comes_first():
    points, labels = blobs([0.05, 0.6, 0.3, 0.05], 1_000, 7, 3)
    found = find_playstyles(posteriors_of(points, width=4))
    assert label_agreement(found.assignment, labels) > 0.97
    assert [style.weight for style in found.styles] == pytest.approx([0.6, 0.3, 0.05, 0.05], abs=0.01)
    assert [style.name for style in found.styles] == ["style 0", "style 1", "style 2", "style 3"]


def test_overlap_decides_by_degrees():
    near, far = (blobs([0.5, 0.5], 1_000, distance, 2)[0] for distance in (2, 4))
    assert len(find_playstyles(posteriors_of(near, width=4))) == 1
    assert len(find_playstyles(posteriors_of(far, width=4))) == 2


def test_clusters_of_other_shapes_than_blobs():
    rng = np.random.default_rng(0)
    ring_and_blob = np.concatenate([circle(500), 0.4 * rng.standard_normal((500, 2))])
    side = np.arange(1_000) % 2
    rods = np.stack([rng.uniform(-5, 5, 1_000), 0.4 * rng.standard_normal(1_000) + 2.5 * side], axis=1)
    heavy = heavy_tailed(1_000) + np.stack([8.0 * side, 0.0 * side], axis=1)
    for points, labels in ((ring_and_blob, np.repeat([0, 1], 500)), (rods, side), (heavy, side)):
        found = find_playstyles(posteriors_of(points, scale=0.1, width=3))
        assert len(found) == 2
        assert label_agreement(found.assignment, labels) > 0.85


def pair_of_means(scale, count=400):
    rng = np.random.default_rng(0)
    labels = np.arange(count) % 2
    points = np.stack([2.0 * labels - 1, 0.0 * labels], axis=1) + 0.05 * rng.standard_normal((count, 2))
    return posteriors_of(points, scale=scale, width=4), labels


@pytest.mark.parametrize("scale", [0.01, 0.5, 1.0])
def test_posteriors_that_a_sample_tells_apart_are_styles(scale):
    posteriors, labels = pair_of_means(scale)
    found = find_playstyles(posteriors)
    assert label_agreement(found.assignment, labels) == 1
    if scale == 1.0:  # a sample is on its own side with probability Phi(1) = 0.84
        assert np.diag(found.confusion) == pytest.approx([0.84, 0.84], abs=0.05)


def test_posteriors_that_a_sample_does_not_tell_apart_are_no_styles():
    found = find_playstyles(pair_of_means(2.5)[0])  # wrong with probability Phi(-0.4) = 0.34
    assert len(found) == 1
    assert found.verdict.startswith("not distinguishable: the posterior means form 2 clusters")


def test_a_collapsed_latent_is_called_so():
    rng = np.random.default_rng(0)
    found = find_playstyles(Posteriors(0.01 * rng.standard_normal((500, 3)), np.ones((500, 3))))
    assert found.verdict.startswith("not distinguishable: the latent has collapsed")
    assert (found.assignment == 0).all()
    assert (found.probability == 1).all()
    assert found.styles[0].sample(7, rng).shape == (7, 3)


def test_a_model_without_a_latent_has_nothing_to_tell():
    found = find_playstyles(Posteriors(np.zeros((20, 0)), np.ones((20, 0))))
    assert found.verdict.startswith("not distinguishable")
    assert found.styles[0].sample(3, np.random.default_rng(0)).shape == (3, 0)
    again = Playstyles.from_json(json.loads(json.dumps(found.to_json())))
    assert again.styles[0].sample(3, np.random.default_rng(0)).shape == (3, 0)


def test_identical_episodes_are_one_style():
    assert len(find_playstyles(Posteriors(np.full((50, 2), 1.5), np.full((50, 2), 0.1)))) == 1


def test_repeated_means_do_not_make_a_mixture_diverge():
    means = np.repeat([[-1.0, 0.0], [1.0, 0.0]], 40, axis=0)
    found = find_playstyles(Posteriors(means, np.full((80, 2), 0.1)))
    assert label_agreement(found.assignment, np.repeat([0, 1], 40)) == 1


def test_styles_do_not_depend_on_units_or_on_the_order_of_episodes():
    points, labels = blobs([0.7, 0.3], 300, 6, 2)
    posteriors = posteriors_of(points)
    units, order = np.array([1e-3, 1e4]), np.random.default_rng(1).permutation(300)
    scaled = find_playstyles(Posteriors(posteriors.means * units, posteriors.scales * units))
    shuffled = find_playstyles(posteriors.select(order))
    assert label_agreement(scaled.assignment, labels) > 0.97
    assert label_agreement(shuffled.assignment, labels[order]) > 0.97


def test_the_same_seed_finds_the_same():
    posteriors = posteriors_of(blobs([0.5, 0.5], 300, 5, 2)[0])
    assert find_playstyles(posteriors, seed=3).to_json() == find_playstyles(posteriors, seed=3).to_json()


def test_ten_thousand_episodes_take_seconds():
    points, labels = blobs([0.2] * 5, 10_000, 6, 4)
    posteriors = posteriors_of(points, width=8)
    started = time.process_time()
    found = find_playstyles(posteriors)
    assert time.process_time() - started < 5
    assert label_agreement(found.assignment, labels) > 0.97


def test_a_style_describes_and_samples_its_aggregated_posterior():
    posteriors = posteriors_of(blobs([0.6, 0.4], 1_000, 8, 2)[0], scale=0.5)
    found = find_playstyles(posteriors)
    rng = np.random.default_rng(0)
    for style in found.styles:
        own = posteriors.select(np.flatnonzero(found.assignment == style.index))
        expected = np.cov(own.means.T, ddof=0) + np.diag((own.scales**2).mean(0))
        assert style.mean == pytest.approx(own.means.mean(0))
        assert style.covariance == pytest.approx(expected)
        drawn = style.sample(20_000, rng)
        assert drawn.mean(0) == pytest.approx(style.mean, abs=0.15)
        assert np.cov(drawn.T) == pytest.approx(expected, abs=0.25)
        assert len(style.prototypes) == 5
        assert (found.assignment[list(style.prototypes)] == style.index).all()
        nearest = np.linalg.norm(posteriors.means[style.prototypes[0]] - style.mean)
        assert nearest < 0.5
        assert len(style.members) <= 500


def test_a_bent_style_is_sampled_along_its_bend():
    style = find_playstyles(posteriors_of(circle(1_000, arc=1.5 * np.pi), scale=0.1)).styles[0]
    assert abs(np.linalg.norm(style.sample(2_000, np.random.default_rng(0)), axis=1) - 2).max() < 1.3


def test_json_keeps_everything_and_new_sessions_are_assigned():
    points, _ = blobs([0.5, 0.3, 0.2], 500, 7, 3)
    posteriors = posteriors_of(points, width=5)
    found = find_playstyles(posteriors)
    again = Playstyles.from_json(json.loads(json.dumps(found.to_json())))
    assert again.to_json() == found.to_json()
    assignment, probability = again.assign(posteriors)
    assert (assignment == found.assignment).all()
    assert probability == pytest.approx(found.probability)
    fresh = posteriors_of(blobs([0.5, 0.3, 0.2], 200, 7, 3)[0], width=5, seed=9)
    assert label_agreement(again.assign(fresh)[0], np.repeat([0, 1, 2], [100, 60, 40])) > 0.95
    assert ((probability > 1 / 3) & (probability <= 1)).all()


def test_other_files_are_refused():
    with pytest.raises(ValueError, match="needs format tvae-playstyles"):
        Playstyles.from_json({"format": "something else"})


def test_encoding_keeps_the_order_and_the_batch_changes_nothing():
    x, dx = Space((Continuous("x"),)), Space((Continuous("dx"),))
    rng = np.random.default_rng(0)
    walks = [Trajectory(rng.standard_normal((t + 1, 1)), rng.standard_normal((t, 1))) for t in (9, 2, 5, 7, 3)]
    demonstrations = Demonstrations.from_trajectories(walks, x, dx)
    model = TrajectoryVAE(x, dx, hidden_features=8, dropout=0.5)
    model.train()
    together, alone = encode(model, demonstrations), encode(model, demonstrations, batch_size=1)
    assert model.training
    assert together.means == pytest.approx(alone.means, abs=1e-5)
    assert together.scales == pytest.approx(alone.scales, abs=1e-5)
    second = encode(model, demonstrations.select([1]))
    assert together.means[1] == pytest.approx(second.means[0], abs=1e-5)
    assert discover(model, demonstrations).verdict.startswith("not distinguishable: 5 episodes are too few")


def test_posteriors_are_checked_where_they_are_made():
    with pytest.raises(ValueError, match="one shape"):
        Posteriors(np.zeros((2, 1)), np.ones((2, 2)))
    with pytest.raises(ValueError, match="above 0"):
        Posteriors(np.zeros((2, 1)), np.zeros((2, 1)))
    with pytest.raises(ValueError, match="finite"):
        Posteriors(np.full((2, 1), np.nan), np.ones((2, 1)))


def test_a_style_is_matched_to_the_label_of_the_majority():
    assignment, labels = np.array([0, 0, 0, 1, 1]), np.array(["avoid", "avoid", "attack", "attack", "attack"])
    assert match(assignment, labels) == {0: "avoid", 1: "attack"}
    assert label_agreement(assignment, labels) < 1


def test_joined_styles_share_their_parts():
    random = np.random.default_rng(0)
    middles = np.repeat([[-4.0, 0.0], [0.0, 0.0], [4.0, 0.0], [0.0, 5.0]], (80, 60, 40, 20), axis=0)
    posteriors = Posteriors(middles + 0.3 * random.normal(size=(200, 2)), np.full((200, 2), 0.3))
    found = find_playstyles(posteriors)
    assert len(found) == 4
    both = join(found, posteriors, [[1, 2]])
    assert both.parts == ((1, 2), (0,), (3,))
    assert [style.weight for style in both.styles] == pytest.approx([0.5, 0.4, 0.1])
    assert both.assignment.tolist() == [1] * 80 + [0] * 100 + [2] * 20
    assert both.confusion.sum(1) == pytest.approx(np.ones(3))
    drawn = both.styles[0].sample(4_000, random)
    assert drawn.mean(0) == pytest.approx(posteriors.means[80:180].mean(0), abs=0.1)
    assert (drawn[:, 0] > 2).mean() == pytest.approx(0.4, abs=0.03)
    assert len(both.styles[0].components) == sum(len(found.styles[part].components) for part in (1, 2))
    asked = Posteriors(np.array([[0.1, 0.1], [4.1, 0.0], [-4.0, 0.2]]), np.full((3, 2), 0.3))
    assert both.assign(asked)[0].tolist() == [0, 0, 1]
    assert set(both.styles[0].prototypes) <= set(range(80, 180))
    again = Playstyles.from_json(json.loads(json.dumps(both.to_json())))
    assert again.parts == both.parts
    everything = join(found, posteriors, [[3, 0, 1, 2]])
    assert everything.parts == ((0, 1, 2, 3),)
    assert everything.verdict == "one style, joined from 4."
    for groups in ([[0, 4]], [[0, 1], [1, 2]], [[-1, 0]]):
        with pytest.raises(ValueError, match="groups must name styles 0 to 3, each once at most"):
            join(found, posteriors, groups)


def test_playstyles_of_before_were_not_joined():
    data = Playstyles.from_pretrained("navigation").to_json()
    del data["parts"]
    assert Playstyles.from_json(data).parts == ((0,), (1,), (2,))


def test_what_a_notebook_shows_of_them_is_short():
    noise = 0.1 * np.random.default_rng(0).normal(size=(100, 2))
    means = np.repeat([[-1.0, 0.0], [1.0, 0.0]], [60, 40], axis=0) + noise
    found = find_playstyles(Posteriors(means, np.full((100, 2), 0.2)))
    assert repr(found) == f"<Playstyles: {found.verdict}>"
    assert repr(found.styles[0]).startswith("<Style 0: 60 % of the episodes, z around (-")
