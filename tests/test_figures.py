"""Figures show what they are given: each test reads the artists back."""

import base64
import io
import subprocess
import sys
import xml.etree.ElementTree as ET
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.patches import Circle

from tvae.data.arrays import from_arrays
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.figures.canvas import new_figure, plain_axes, save
from tvae.figures.curves import training_curves
from tvae.figures.lanes import Scales
from tvae.figures.latent import latent_plane, latent_space
from tvae.figures.markup import to_markup
from tvae.figures.overcooked import draw_overcooked
from tvae.figures.overview import draw_overview
from tvae.figures.palette import ALERT, INK, STYLE_COLOURS, style_colour, style_marker
from tvae.figures.trajectories import draw_path, draw_trajectory, grid, planes, share_limits
from tvae.figures.zombie import draw_zombie, zombie_paths
from tvae.spaces import Angular, Binary, Categorical, Continuous, Space
from tvae.train.checkpoint import Record
from tvae.train.terms import Terms

PLACE = Space((Continuous("x"), Continuous("y")))
BUTTON = Space((Binary("jump"),))


def _axes():
    return new_figure(2, 2).add_subplot()


def _walk(length=6, scale=1.0):
    actions = np.zeros((length - 1, 1))
    actions[2] = 1
    return Trajectory(scale * np.cumsum(np.ones((length, 2)), 0), actions)


def _texts(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text"))]


def _records(count, *, stop=0.0, betas=(1.0,), first_state=-100.0):
    return [
        Record(
            100 * index,
            betas[index % len(betas)],
            Terms(-30.0 + index, first_state if index == 0 else -10.0 + index, stop, 3.0),
            Terms(-31.0 + index, -11.0 + index, stop, 2.5),
        )
        for index in range(count)
    ]


def test_importing_the_package_imports_no_matplotlib():
    program = "import sys, tvae; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_no_two_of_the_first_styles_look_alike():
    looks = [(style_colour(style), style_marker(style)) for style in range(42)]
    assert len(set(looks)) == 42


class TestLatentSpace:
    def test_two_dimensions_are_shown_as_they_are(self):
        means = np.random.default_rng(0).normal(size=(30, 2))
        assignment = np.arange(30) % 3
        figure = latent_space(means, assignment, ["a", "b", "c"])
        (axes,) = figure.axes
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("z_0", "z_1")
        assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a (10)", "b (10)", "c (10)"]
        for style, line in enumerate(axes.lines):
            assert np.array_equal(line.get_xydata(), means[assignment == style])
            assert line.get_markerfacecolor() == STYLE_COLOURS[style]

    def test_more_dimensions_are_shown_by_principal_components(self):
        rng = np.random.default_rng(1)
        means = rng.normal(size=(200, 4)) * [10.0, 3.0, 0.1, 0.1]
        plane = latent_plane(means, np.zeros(200, dtype=np.int64))
        variances = np.linalg.eigvalsh(np.cov(means.T))[::-1]
        assert np.allclose(np.var(plane.points, axis=0, ddof=1), variances[:2])
        assert f"first principal component of z ({variances[0] / variances.sum():.0%}"[:-1] in plane.axis_names[0]
        assert plane.axis_names[1].startswith("second principal component of z")

    def test_identical_means_are_no_division_by_zero(self):
        plane = latent_plane(np.ones((5, 3)), np.zeros(5, dtype=np.int64))
        assert np.array_equal(plane.points, np.zeros((5, 2)))

    def test_one_dimension_is_a_strip_with_a_row_a_style(self):
        means = np.array([[0.0], [1.0], [2.0], [2.0]])
        figure = latent_space(means, np.array([0, 1, 1, 1]), ["a", "b"])
        points = latent_plane(means, np.array([0, 1, 1, 1])).points
        assert np.array_equal(points[:, 0], means[:, 0])
        assert points[0, 1] > points[1:, 1].max()
        assert points[2, 1] != points[3, 1]
        assert figure.axes[0].get_yticks().size == 0

    def test_posterior_width_is_an_ellipse_of_one_standard_deviation(self):
        means = np.array([[0.0, 0.0], [3.0, 1.0]])
        figure = latent_space(means, np.array([0, 1]), ["a", "b"], deviations=np.array([[0.5, 0.2], [0.1, 0.1]]))
        (ellipses,) = (c for c in figure.axes[0].collections if isinstance(c, EllipseCollection))
        assert sorted([ellipses.get_widths()[0], ellipses.get_heights()[0]]) == pytest.approx([0.4, 1.0])
        assert np.array_equal(ellipses.get_offsets(), means)

    def test_without_a_latent_there_is_nothing_to_show(self):
        with pytest.raises(ValueError, match=r"shape \(4, 0\)"):
            latent_space(np.zeros((4, 0)), np.zeros(4, dtype=np.int64), ["a"])

    def test_names_are_shown_to_the_letter(self):
        figure = latent_space(np.zeros((2, 2)), np.array([0, 0]), ["$x^2$ is 5$"])
        to_markup(figure, "latent space")
        assert "$x^2$ is 5$ (2)" in to_markup(figure, "latent space")


class TestTrainingCurves:
    def test_terms_stand_apart_with_training_and_held_out(self):
        records = _records(5, stop=-2.0, betas=(1.0, 2.0))
        figure = training_curves(records)
        titles = [axes.get_title(loc="left").split(":")[0] for axes in figure.axes]
        assert titles == ["Policy", "State", "Stop", "KL", "beta"]
        training, held_out = figure.axes[0].lines
        assert training.get_ydata().tolist() == [r.training.policy for r in records]
        assert held_out.get_ydata().tolist() == [r.held_out.policy for r in records]
        assert [line.get_label() for line in figure.axes[0].lines] == ["training", "held out"]
        assert figure.axes[4].lines[0].get_ydata().tolist() == [r.beta for r in records]

    def test_unused_stop_and_constant_beta_get_no_panel(self):
        figure = training_curves(_records(5))
        assert [axes.get_title(loc="left").split(":")[0] for axes in figure.axes] == [
            "Policy",
            "State",
            "KL, with beta = 1",
        ]

    def test_a_wild_start_does_not_flatten_the_rest_and_is_said(self):
        figure = training_curves(_records(30, first_state=-1e6))
        assert figure.axes[1].get_ylim()[0] > -20
        assert [text.get_text() for text in figure.axes[1].texts] == ["starts off the scale"]
        assert not figure.axes[0].texts

    def test_a_single_record_is_visible(self):
        assert training_curves(_records(1)).axes[0].lines[0].get_marker() == "o"

    def test_no_record_is_an_error(self):
        with pytest.raises(ValueError, match="at least one record"):
            training_curves([])


class TestTrajectories:
    @pytest.mark.parametrize(
        ("names", "found"),
        [
            (["x", "y"], [("", 0, 1)]),
            (["agent_y", "agent_x", "angle"], [("agent", 1, 0)]),
            (
                ["player_0.x", "player_0.y", "player_1.x", "player_1.y"],
                [("player_0", 0, 1), ("player_1", 2, 3)],
            ),
            (["x_of_goal", "y_of_goal"], [("of_goal", 0, 1)]),
            (["velocity_x", "velocity_y"], []),
            (["agent_x", "goal_y"], []),
            (["box", "boy", "max"], []),
        ],
    )
    def test_places_are_found_by_name(self, names, found):
        space = Space(tuple(Continuous(name) for name in names))
        assert [(p.name, p.x, p.y) for p in planes(space)] == found

    def test_angles_and_words_are_no_places(self):
        assert planes(Space((Angular("x"), Angular("y")))) == ()
        assert planes(Space((Categorical("x", ("left", "right")), Continuous("y")))) == ()

    def test_a_path_is_drawn_with_the_steps_of_the_button(self):
        axes = _axes()
        walk = _walk()
        draw_trajectory(axes, walk, PLACE, BUTTON, "#0072b2")
        lines = {line.get_label(): line for line in axes.lines}
        path = next(line for line in axes.lines if len(line.get_xdata()) == 6)
        assert np.array_equal(path.get_xydata(), walk.observations)
        assert to_hex(path.get_color()) == "#0072b2"
        assert lines["start"].get_xydata().tolist() == [[1, 1]]
        assert lines["end"].get_xydata().tolist() == [[6, 6]]
        assert lines["jump"].get_xydata().tolist() == [[3, 3]]

    def test_an_integer_category_is_a_coordinate_by_its_value(self):
        cell = Space((Categorical("x", (5, 7, 9)), Categorical("y", (1, 2, 3))))
        axes = _axes()
        draw_trajectory(axes, Trajectory(np.array([[0.0, 0.0], [2.0, 1.0]]), np.zeros((1, 1))), cell, BUTTON, INK)
        assert axes.lines[0].get_xydata().tolist() == [[5, 1], [9, 2]]

    def test_without_a_plane_the_signals_that_vary_get_a_lane(self):
        space = Space((Continuous("speed"), Continuous("mass"), Angular("bearing"), Categorical("gear", ("a", "b"))))
        bearing = np.array([3.0, 3.1, -3.1, -3.0, -2.9])
        rows = np.stack([np.arange(5.0), np.ones(5), bearing, np.array([0.0, 0, 1, 1, 0])], 1)
        axes = _axes()
        draw_trajectory(axes, Trajectory(rows, np.array([[0.0], [1], [0], [1]])), space, BUTTON, INK)
        assert [text.get_text() for text in axes.texts] == ["speed", "0 to 4", "bearing", "gear", "jump"]
        assert axes.lines[3].get_xdata().tolist() == [1, 3]
        assert np.isnan(axes.lines[1].get_ydata()).tolist() == [False, False, True, False, False]

    def test_each_signal_has_the_scale_of_all_episodes(self):
        """Two signals of very different size; what stands still in one episode has its lane there, too."""
        space = Space((Continuous("$speed$"), Continuous("x" * 40), Categorical("seats", (2, 4, 9))))
        wide = Trajectory(np.array([[0.0, 1e6, 0], [10, 3e6, 2]]), np.zeros((1, 1)))
        still = Trajectory(np.array([[5.0, 2e6, 1], [5, 2e6, 1]]), np.zeros((1, 1)))
        scales = Scales.of(Demonstrations.from_trajectories([wide, still], space, BUTTON))
        assert scales.observations.tolist() == [[0, 10], [1e6, 3e6], [0, 2]]
        axes = _axes()
        draw_trajectory(axes, still, space, BUTTON, INK, scales)
        said = [text.get_text() for text in axes.texts]
        assert said == ["$speed$", "0 to 10", "x" * 23 + "…", "1e+06 to 3e+06", "seats", "2 to 9"]
        np.testing.assert_allclose([line.get_ydata()[0] for line in axes.lines], [0.3, -0.7, -2 + 0.6 * 2 / 7])

    def test_long_episodes_are_thinned_and_still_ones_said(self):
        space = Space((Continuous("speed"),))
        axes = _axes()
        draw_trajectory(axes, Trajectory(np.arange(10_000.0)[:, None], np.zeros((10_000, 1))), space, BUTTON, INK)
        assert len(axes.lines[0].get_xdata()) <= 150
        axes = _axes()
        draw_trajectory(axes, Trajectory(np.ones((3, 1)), np.zeros((3, 1))), space, BUTTON, INK)
        assert axes.texts[0].get_text() == "nothing varies"

    def test_a_grid_has_one_scale_and_frames_what_is_flagged(self):
        draw = partial(draw_trajectory, observation_space=PLACE, action_space=BUTTON, colour=INK)
        flagged = np.array([False, True, False])
        figure = grid([_walk(scale=s) for s in (1, 2, 3)], draw, ["$1", "2", "3"], flagged=flagged, num_columns=2)
        assert len(figure.axes) == 3
        assert len({(axes.get_xlim(), axes.get_ylim()) for axes in figure.axes}) == 1
        assert figure.axes[0].get_xlim()[0] < 1
        assert figure.axes[0].get_xlim()[1] > 18
        assert [axes.spines["top"].get_visible() for axes in figure.axes] == flagged.tolist()
        assert [axes.get_title() for axes in figure.axes] == ["$1", "2", "3"]
        assert figure.axes[1].title.get_color() == ALERT

    def test_limits_that_someone_chose_stay(self):
        chosen, free, inverted = (_axes() for _ in range(3))
        for axes in (chosen, free, inverted):
            draw_path(axes, np.array([[0.0, 0.0], [4.0, 2.0]]), INK)
        chosen.set_xlim(-50, 50)
        inverted.invert_yaxis()
        share_limits([chosen, free, inverted])
        assert chosen.get_xlim() == (-50, 50)
        assert free.get_xlim() == pytest.approx((-0.16, 4.16))
        assert inverted.get_ylim() == pytest.approx((2.08, -0.08))

    def test_an_empty_grid_is_an_error(self):
        with pytest.raises(ValueError, match="at least one trajectory"):
            grid([], draw_zombie)


class TestZombie:
    def test_places_come_back_from_distances_and_bearings(self):
        rng = np.random.default_rng(0)
        agent, zombie = rng.uniform(0, 5, (9, 2)), rng.uniform(-2, 5, (9, 2))
        columns = []
        for way in (5 - agent, zombie - agent):
            columns += [np.hypot(*way.T), np.arctan2(way[:, 1], way[:, 0])]
        found = zombie_paths(np.stack(columns, 1))
        assert np.allclose(found[0], agent)
        assert np.allclose(found[1], zombie)

    def test_the_picture_shows_goal_range_paths_and_attacks(self):
        axes = _axes()
        observations = np.array([[7.07, np.pi / 4, 2.0, 0.0], [6.57, np.pi / 4, 1.0, 0.0], [6.07, np.pi / 4, 0.9, 0.0]])
        draw_zombie(axes, Trajectory(observations, np.array([[0.0, 0.8], [1.0, 0.8]])))
        agent, zombie = zombie_paths(observations)
        goal, reach = (patch for patch in axes.patches if isinstance(patch, Circle))
        assert (goal.center, goal.radius) == ((5, 5), 0.5)
        assert reach.center == pytest.approx(tuple(zombie[-1]))
        assert reach.radius == 1
        lines = {line.get_label(): line for line in axes.lines}
        assert np.array_equal(lines["agent"].get_xydata(), agent)
        assert np.array_equal(lines["zombie"].get_xydata(), zombie)
        assert np.array_equal(lines["attack"].get_xydata(), agent[1:2])

    def test_without_an_attack_there_is_no_mark(self):
        axes = _axes()
        draw_zombie(axes, Trajectory(np.ones((2, 4)), np.zeros((2, 2))))
        assert "attack" not in [line.get_label() for line in axes.lines]


class TestSaving:
    def test_writes_both_files_the_same_every_time(self, tmp_path: Path):
        for name in ("one", "two"):
            figure = latent_space(np.arange(8.0).reshape(4, 2), np.array([0, 0, 1, 1]), ["a", "b"])
            save(figure, tmp_path / name / "world_0.2")
        assert sorted(p.name for p in (tmp_path / "one").iterdir()) == ["world_0.2.png", "world_0.2.svg"]
        for suffix in ("png", "svg"):
            first, second = ((tmp_path / name / f"world_0.2.{suffix}").read_bytes() for name in ("one", "two"))
            assert first == second
        assert (tmp_path / "one" / "world_0.2.png").read_bytes().startswith(b"\x89PNG")


class TestMarkup:
    def test_is_well_formed_escaped_and_in_the_colours_of_the_page(self):
        figure = new_figure(2, 1)
        axes = plain_axes(figure.add_subplot(), title="<b> & $", x="time")
        axes.plot([0, 1], [0, 1], color=STYLE_COLOURS[1], linestyle="--", alpha=0.5)
        axes.plot([0.5], [0.5], "o", color=INK)
        root = ET.fromstring(to_markup(figure, 'a "label" <i>'))
        assert root.get("aria-label") == 'a "label" <i>'
        assert root.get("viewBox") == "0 0 144 72"
        assert "<b> & $" in [text.text for text in root.iter("text")]
        styles = [path.get("style") for path in root.iter("path")]
        line = next(style for style in styles if f"stroke:var(--style-1,{STYLE_COLOURS[1]})" in style)
        assert "stroke-opacity:0.5" in line
        assert "stroke-dasharray" in line
        assert any(style.startswith("fill:var(--ink") for style in styles)
        assert not [element for element in root.iter() if element.get("id")]

    def test_what_matplotlib_has_no_font_for_is_left_to_the_page(self):
        figure = new_figure(1, 1)
        figure.text(0.5, 0.5, "体力", color=INK)
        assert "体力" in to_markup(figure, "")

    def test_coordinates_are_points_from_the_top_left(self):
        figure = Figure((1, 1))
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        axes.set(xlim=(0, 1), ylim=(0, 1))
        axes.plot([0, 1], [0, 0.5])
        (path,) = ET.fromstring(to_markup(figure, "")).iter("path")
        assert path.get("d") == "M0,72L72,36"

    def test_lines_are_cut_where_their_axes_end(self):
        figure = Figure((1, 1))
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        axes.set(xlim=(0, 1), ylim=(0, 1))
        axes.plot([0, 1], [0.5, 1000])
        (path,) = ET.fromstring(to_markup(figure, "")).iter("path")
        heights = [float(pair.split(",")[1]) for pair in path.get("d")[1:].split("L")]
        assert min(heights) >= -2

    def test_only_the_named_artists_are_drawn(self):
        figure = new_figure(1, 1)
        axes = figure.add_subplot()
        first, second = axes.plot([0, 1], [0, 1], [0, 1], [1, 0])
        assert len(list(ET.fromstring(to_markup(figure, "", [first])).iter("path"))) == 1
        assert len(list(ET.fromstring(to_markup(figure, "", [first, second])).iter("path"))) == 2
        assert len(list(ET.fromstring(to_markup(figure, "", [])).iter("path"))) == 0

    def test_an_image_is_embedded_upright(self):
        figure = Figure((1, 1))
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        axes.imshow(np.array([[0.0, 0.0], [1.0, 1.0]]), cmap="gray")
        (image,) = ET.fromstring(to_markup(figure, "")).iter("image")
        assert (image.get("width"), image.get("y")) == ("72", "0")
        kind, data = image.get("href").split(",")
        assert kind == "data:image/png;base64"
        pixels = imread(io.BytesIO(base64.b64decode(data)))
        assert pixels[5, 5, 0] == 0
        assert pixels[-5, 5, 0] == 1


def test_overcooked_laps_and_soups_are_drawn() -> None:
    turns = np.linspace(0, 4 * np.pi, 81)
    places = {"info.x_0": 2 + np.cos(turns), "info.y_0": 2 + np.sin(turns)}
    places |= {"info.x_1": 2 + np.cos(-turns), "info.y_1": 2 + np.sin(-turns)}
    reward = np.where(np.arange(81) == 40, 20.0, 0.0)
    game = Trajectory(np.zeros((81, 1)), np.zeros((81, 1)), {**places, "reward": reward})
    axes = new_figure(2, 2).add_subplot()
    draw_overcooked(axes, game)
    drawn = {line.get_label(): line.get_xydata() for line in axes.lines}
    np.testing.assert_allclose(drawn["laps of player 0"][-1], (80, 2))
    np.testing.assert_allclose(drawn["laps of player 1"][-1], (80, -2))
    np.testing.assert_allclose(drawn["soup"], [(40, 0)])


def test_an_overview_shows_lengths_signals_and_episodes() -> None:
    names = ("x", "$y$", "heading", "room")
    space = Space((Continuous("x"), Continuous("$y$"), Angular("heading"), Categorical("room", ("$hall$", "attic"))))
    kept = from_arrays(
        [np.tile([0.5, 1.5, 9.0, 1.0], (length, 1)) for length in range(2, 12)],
        [np.arange(length) % 2 == 0 for length in range(2, 12)],
        observation_space=space,
    )
    figure = draw_overview(kept)
    panels = {axes.get_title(loc="left"): axes for axes in figure.axes}
    signals = [*(f"observation\n{name}" for name in names), "action\n0"]
    episodes = [f"episode {index}" for index in (0, 3, 6, 9)]
    assert list(panels) == ["steps of 10 episodes", *signals, *episodes]
    assert sum(bar.get_height() for bar in panels["steps of 10 episodes"].patches) == 10
    assert sum(bar.get_height() for bar in panels["observation\nheading"].patches) == sum(range(2, 12))
    assert [label.get_text() for label in panels["observation\nroom"].get_yticklabels()] == ["attic", "$hall$"]
    assert [bar.get_width() for bar in panels["observation\nroom"].patches] == [1, 0]
    assert len(draw_overview(kept, most_signals=1).axes) == 2 + 4
