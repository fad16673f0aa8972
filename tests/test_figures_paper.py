"""The figures of the paper show what they are given: each test reads the artists back."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle
from matplotlib.text import Text

from tvae.data.trajectory import Trajectory
from tvae.figures.architecture import architecture
from tvae.figures.canvas import SMALL_TEXT_SIZE, save
from tvae.figures.horizon import horizon
from tvae.figures.interpolation import interpolation
from tvae.figures.outcomes import REACHED, Outcomes, StyleOutcomes, outcomes
from tvae.figures.palette import INK, PAPER, STYLE_COLOURS, STYLE_MARKERS
from tvae.figures.panels import Band, Landmark, draw_band, limits, number, typical
from tvae.figures.reconstructions import reconstructions
from tvae.figures.windows import WindowedBot, windows
from tvae.figures.zombie_reconstructions import zombie_reconstructions

GOALS = [Landmark("goal", 90.0, 50.0, 10.0), Landmark("goal", -90.0, 50.0, 10.0), Landmark("start", 0.0, 0.0, 2.0)]
LENGTHS = [1, 2, 3, 5, 8, 10, 15, 20, 30]


def _paths(num_episodes=6, scale=1.0):
    angles = np.linspace(0.2, 2.9, num_episodes)
    return [scale * np.arange(20)[:, None] * np.array([[np.cos(a), np.sin(a)]]) for a in angles]


def _reconstructions(num_features=2, landmarks=()):
    means = np.random.default_rng(0).normal(size=(6, num_features))
    names = ["a", "$b", "c_1"]
    return reconstructions(
        _paths(), _paths(scale=2), _paths(scale=3), np.arange(6) % 3, means, names, landmarks=landmarks
    )


def _grid():
    return np.stack(np.meshgrid(np.linspace(-2, 2, 4), np.linspace(1.5, -1.5, 4)), axis=2)


def _cells(grid, repeats=1):
    return [[[np.array([[0.0, 0.0], z]) * (k + 1) for k in range(repeats)] for z in row] for row in grid]


def _interpolation(landmarks=()):
    nearest = np.repeat([[0, 0, 1, 1], [0, 0, 1, 1], [-1, -1, 2, 2], [-1, -1, 2, 2]], 1, axis=0)
    return interpolation(_grid(), _cells(_grid()), _cells(_grid(), 3), nearest, ["a", "b", "c"], landmarks=landmarks)


def _episode(shift=0.0):
    observations = np.array([[7.07, np.pi / 4, 2.0, 0.0], [6.57, np.pi / 4, 1.0, 0.0], [6.07, np.pi / 4, 0.9, 0.0]])
    return Trajectory(observations + shift, np.array([[0.0, 0.8], [1.0, 0.8]]))


def _zombies(num_examples=3):
    rows = [[[_episode(0.1 * row) for _ in range(num_examples)] for _ in range(2)] for row in range(3)]
    return zombie_reconstructions(*rows, ["attack", "avoid"])


def _outcomes(**changes):
    fields = {
        "attacked": np.array([True, True, True, False]),
        "zombie_dead": np.array([True, True, False, False]),
        "closest_goal": np.array([0.1, 0.2, 0.3, 2.0]),
        "closest_zombie": np.array([0.4, 0.6, 0.8, 1.7]),
    }
    return Outcomes(**{**fields, **changes})


def _two_styles():
    shown = _outcomes(attacked=np.ones(4, dtype=bool), closest_goal=np.full(4, 0.15))
    distances = {"attacked": 0.25, "closest_goal": 0.531}
    return outcomes(
        [StyleOutcomes("attack", _outcomes(), shown, distances), StyleOutcomes("avoid", shown, shown, distances)]
    )


def _band(low=0.1, high=0.9, count=9):
    mean = np.linspace(low, high, count)
    return Band(mean, mean - 0.05, mean + 0.05)


def _windows(**choices):
    curves = {"trained on whole episodes": _band(0.1), "trained on windows": _band(0.5)}
    bots = [WindowedBot("hand-written", "attack", 2, 1.0)]
    return windows(LENGTHS, {"attack": curves, "avoid": curves}, bots=bots, **choices)


def _horizon(**choices):
    return horizon({"T-VAE": _band(0.2, count=30), "cloning": _band(0.5, count=20)}, y="distance", **choices)


FIGURES = {
    "reconstructions": lambda: _reconstructions(landmarks=GOALS),
    "reconstructions of six features": lambda: _reconstructions(6),
    "reconstructions of one feature": lambda: _reconstructions(1),
    "interpolation": lambda: _interpolation(GOALS),
    "zombie reconstructions": _zombies,
    "outcomes": _two_styles,
    "windows": _windows,
    "horizon": _horizon,
    "logarithmic horizon": lambda: _horizon(logarithmic=True),
    "architecture": architecture,
}


def _legend(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def _titles(figure: Figure) -> list[str]:
    return [axes.get_title(loc="left") for axes in figure.axes]


class TestEveryFigure:
    @pytest.mark.parametrize("name", FIGURES)
    def test_is_kept_as_pixels_and_as_vectors(self, name, tmp_path: Path):
        save(FIGURES[name](), tmp_path / "figure-1")
        assert (tmp_path / "figure-1.png").read_bytes().startswith(b"\x89PNG")
        assert b"<svg" in (tmp_path / "figure-1.svg").read_bytes()[:1000]

    @pytest.mark.parametrize("name", FIGURES)
    def test_is_as_wide_as_a_column_and_its_text_is_legible_and_inside(self, name):
        figure = FIGURES[name]()
        assert figure.get_figwidth() in {3.4, 7.0}
        figure.draw_without_rendering()
        sizes = [text.get_fontsize() for text in figure.findobj(Text) if text.get_text()]
        assert min(sizes) >= SMALL_TEXT_SIZE
        drawn = figure.get_tightbbox()
        assert min(drawn.x0, drawn.y0) >= 0
        assert drawn.x1 <= figure.get_figwidth()
        assert drawn.y1 <= figure.get_figheight()

    @pytest.mark.parametrize("name", FIGURES)
    def test_the_legend_and_the_titles_keep_apart(self, name):
        figure = FIGURES[name]()
        figure.draw_without_rendering()
        legend = figure.legends[0].get_window_extent()
        panels = [axes for axes in figure.axes if axes.axison]
        assert all(axes.get_tightbbox().y1 <= legend.y0 + 0.5 for axes in panels)
        assert legend.x1 <= figure.bbox.width


class TestPanels:
    def test_numbers_have_a_true_minus(self):
        assert [number(value) for value in (-2.0, 0.66, -0.04)] == ["−2.0", "0.7", "0.0"]

    def test_limits_hold_landmarks_and_are_not_wider_than_said(self):
        x, y = limits([np.zeros((1, 2))], [Landmark("goal", 10.0, 0.0, 1.0)], widest=2.0)
        assert x == pytest.approx((-0.55, 11.55))
        assert x[1] - x[0] == pytest.approx(2 * (y[1] - y[0]))
        with pytest.raises(ValueError, match="at least one path"):
            limits([])

    def test_the_typical_path_is_in_the_middle(self):
        assert typical([np.full((4, 2), height) for height in (9.0, 0.0, 4.0)]) == 2

    def test_a_band_has_one_length(self):
        with pytest.raises(ValueError, match="over \\(3,\\)"):
            draw_band(Figure().add_subplot(), np.arange(3.0), _band(count=4), colour=INK, line="-")


class TestReconstructions:
    def test_three_panels_of_one_scale_show_every_path_in_the_colour_of_its_type(self):
        figure = _reconstructions()
        planes = figure.axes[:3]
        assert len({(axes.get_xlim(), axes.get_ylim(), axes.get_aspect()) for axes in planes}) == 1
        for scale, axes in zip((1, 2, 3), planes, strict=True):
            (lines,) = axes.collections
            assert np.array_equal(lines.get_segments(), _paths(scale=scale))
            assert [to_hex(colour) for colour in lines.get_colors()] == [STYLE_COLOURS[e % 3] for e in range(6)]
            assert [line.get_marker() for line in axes.lines] == list(STYLE_MARKERS[:3])
        reach = np.concatenate(_paths(scale=3))
        assert planes[0].get_xlim()[1] > reach[:, 0].max()
        assert planes[0].get_ylim()[1] > reach[:, 1].max()

    def test_names_stand_above_to_the_letter_and_landmarks_once(self):
        assert _titles(_reconstructions()) == [
            "(a) ground truth",
            "(b) state decoder",
            "(c) policy decoder",
            "(d) latent space",
        ]
        figure = _reconstructions(landmarks=GOALS)
        assert _legend(figure) == ["a", "$b", "c_1", "goal", "start"]
        assert not any(text.get_parse_math() for text in figure.legends[0].get_texts())
        circles = [patch for patch in figure.axes[0].patches if isinstance(patch, Circle)]
        assert [(circle.center, circle.radius) for circle in circles] == [
            ((mark.x, mark.y), mark.radius) for mark in GOALS
        ]

    def test_the_latent_space_has_the_means_by_type(self):
        means = np.random.default_rng(0).normal(size=(6, 2))
        axes = _reconstructions().axes[3]
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("$z_0$", "$z_1$")
        assert [line.get_xydata().tolist() for line in axes.lines] == [means[k::3].tolist() for k in range(3)]
        assert "(" in _reconstructions(6).axes[3].get_xlabel().splitlines()[1]
        assert _reconstructions(1).axes[3].get_yticks().size == 0

    def test_other_numbers_of_episodes_are_an_error(self):
        with pytest.raises(ValueError, match=r"\[6, 5, 6, 6, 6\]"):
            reconstructions(_paths(), _paths(5), _paths(), np.zeros(6, dtype=np.int64), np.zeros((6, 2)), ["a"])


class TestInterpolation:
    def test_cells_show_their_paths_in_the_look_of_their_style(self):
        state, policy = _interpolation().axes
        for block, repeats in ((state, 1), (policy, 3)):
            cells = block.child_axes
            assert len(cells) == 16
            assert len({(axes.get_xlim(), axes.get_ylim()) for axes in cells}) == 1
            lines = [line for axes in cells for line in axes.lines if len(line.get_xydata()) == 2]
            assert len(lines) == 16 * repeats
            assert np.array_equal(lines[0].get_xydata(), [[0.0, 0.0], [-2.0, 1.5]])
            for index, colour in ((0, STYLE_COLOURS[0]), (2, STYLE_COLOURS[1]), (8, INK), (15, STYLE_COLOURS[2])):
                assert {to_hex(line.get_color()) for line in cells[index].lines} == {colour}
            assert cells[2].lines[-1].get_marker() == STYLE_MARKERS[1]
            assert len(cells[8].lines) == repeats

    def test_high_z_1_is_on_top_and_high_z_0_on_the_right(self):
        figure = _interpolation()
        figure.draw_without_rendering()
        block = figure.axes[0]
        assert [text.get_text() for text in block.get_xticklabels()] == ["−2.0", "−0.7", "0.7", "2.0"]
        assert [text.get_text() for text in block.get_yticklabels()] == ["−1.5", "−0.5", "0.5", "1.5"]
        first, last = (block.child_axes[index].get_window_extent() for index in (0, 15))
        assert first.x0 < last.x0
        assert first.y0 > last.y0
        assert block.child_axes[0].get_window_extent().width == pytest.approx(block.bbox.width / 4)

    def test_the_mixed_region_is_in_the_legend_only_where_there_is_one(self):
        assert _legend(_interpolation()) == ["a", "b", "c", "between the styles"]
        nearest = np.ones((4, 4), dtype=np.int64)
        figure = interpolation(_grid(), _cells(_grid()), _cells(_grid()), nearest, ["a", "b"])
        assert _legend(figure) == ["b"]

    def test_what_is_no_grid_is_an_error(self):
        crooked, nearest = _grid(), np.zeros((4, 4), dtype=np.int64)
        crooked[1, 2, 0] += 0.5
        for grid, cells, message in (
            (crooked, _cells(_grid()), "one z_0 in each column"),
            (_grid(), _cells(_grid())[:3], "4 rows of 4 cells"),
            (_grid()[:3], _cells(_grid()), r"\(3, 4, 2\) and \(4, 4\)"),
        ):
            with pytest.raises(ValueError, match=message):
                interpolation(grid, cells, cells, nearest, ["a"])


class TestZombieReconstructions:
    def test_styles_stand_side_by_side_with_a_row_for_each_decoder(self):
        figure = _zombies()
        assert len(figure.axes) == 18
        assert len({(axes.get_xlim(), axes.get_ylim()) for axes in figure.axes}) == 1
        assert [title for title in _titles(figure) if title] == ["attack", "avoid"]
        rows = [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel()]
        assert rows == ["(a) ground truth", "(b) state decoder", "(c) policy decoder"]
        colours = [
            next(line.get_color() for line in axes.lines if line.get_label() == "agent") for axes in figure.axes[:6]
        ]
        assert colours == [STYLE_COLOURS[0]] * 3 + [STYLE_COLOURS[1]] * 3
        places = [axes.get_position() for axes in figure.axes]
        assert places[0].x0 == pytest.approx(places[12].x0)
        assert places[0].y0 > places[6].y0 > places[12].y0

    def test_other_numbers_of_examples_are_an_error(self):
        three, two = [[_episode()] * 3] * 2, [[_episode()] * 2] * 2
        with pytest.raises(ValueError, match=r"\[3, 3\], \[2, 2\]"):
            zombie_reconstructions(three, two, three, ["attack", "avoid"])
        with pytest.raises(ValueError, match="as many examples"):
            zombie_reconstructions([], [], [], [])


class TestOutcomes:
    def test_shares_are_bars_of_the_bots_within_the_outlines_of_the_demonstrations(self):
        figure = _two_styles()
        assert len(figure.axes) == 8
        bars = [patch for patch in figure.axes[0].patches if isinstance(patch, Rectangle)]
        assert [bar.get_height() for bar in bars] == [0.25, 0.75, 0.0, 1.0]
        assert [bar.get_fill() for bar in bars] == [True, True, False, False]
        assert to_hex(bars[0].get_facecolor()) == STYLE_COLOURS[0]
        assert to_hex(figure.axes[4].patches[0].get_facecolor()) == STYLE_COLOURS[1]

    def test_histograms_count_every_episode_and_have_an_edge_at_the_goal(self):
        axes = _two_styles().axes[2]
        for steps in axes.patches[:2]:
            values, edges, _ = steps.get_data()
            assert values.sum() == pytest.approx(1)
            assert np.isclose(edges, REACHED).any()
        assert axes.lines[0].get_xdata() == [REACHED, REACHED]
        assert axes.lines[0].get_linestyle() == "--"

    def test_the_range_of_the_demonstrations_is_shaded(self):
        axes = _two_styles().axes[3]
        span = axes.patches[-1].get_extents().transformed(axes.transData.inverted())
        low, high = np.percentile(_outcomes().closest_zombie, [2.5, 97.5])
        assert (span.x0, span.x1) == pytest.approx((low, high))
        assert "demonstrated, 2.5 to 97.5 percentile" in _legend(_two_styles())

    def test_distances_are_those_that_were_measured(self):
        texts = [[text.get_text() for text in axes.texts] for axes in _two_styles().axes]
        assert texts == [["$W_1$ = 0.25"], [], ["$W_1$ = 0.53"], []] * 2

    def test_what_does_not_fit_is_an_error(self):
        with pytest.raises(ValueError, match="at least one episode"):
            _outcomes(attacked=np.ones(3, dtype=bool))
        with pytest.raises(ValueError, match="nothing"):
            outcomes([StyleOutcomes("attack", _outcomes(), _outcomes(), {"nothing": 1.0})])
        with pytest.raises(ValueError, match="at least one style"):
            outcomes([])


class TestWindows:
    def test_each_style_has_a_panel_with_both_curves_at_even_distances(self):
        figure = _windows()
        assert _titles(figure) == ["(a) attack", "(b) avoid"]
        for style, axes in enumerate(figure.axes):
            assert [text.get_text() for text in axes.get_xticklabels()] == [str(length) for length in LENGTHS]
            whole, windowed = axes.lines[:2]
            assert np.array_equal(whole.get_xydata(), np.stack([np.arange(9), _band(0.1).mean], 1))
            assert np.array_equal(windowed.get_ydata(), _band(0.5).mean)
            assert whole.get_linestyle() != windowed.get_linestyle()
            assert {whole.get_color(), windowed.get_color()} == {STYLE_COLOURS[style]}
            assert len(axes.collections) == 2

    def test_the_hand_written_bot_is_a_star_in_its_panel(self):
        attack, avoid = _windows().axes
        assert attack.lines[2].get_marker() == "*"
        assert attack.lines[2].get_xydata().tolist() == [[1.0, 1.0]]
        assert len(avoid.lines) == 2
        assert _legend(_windows()) == ["trained on whole episodes", "trained on windows", "hand-written"]

    def test_what_cannot_be_shown_is_an_error(self):
        curves = {"attack": {"one": _band()}}
        with pytest.raises(ValueError, match="same curves"):
            windows(LENGTHS, {**curves, "avoid": {"other": _band()}})
        with pytest.raises(ValueError, match="a window among"):
            windows(LENGTHS, curves, bots=[WindowedBot("bot", "attack", 4, 1.0)])
        with pytest.raises(ValueError, match="over \\(8,\\)"):
            windows(LENGTHS[:8], curves)


class TestHorizon:
    def test_methods_start_at_the_first_step_and_look_different(self):
        axes = _horizon().axes[0]
        ours, cloning = axes.lines
        assert np.array_equal(ours.get_xydata(), np.stack([np.arange(1, 31), _band(0.2, count=30).mean], 1))
        assert len(cloning.get_xdata()) == 20
        assert (ours.get_color(), ours.is_dashed()) == (STYLE_COLOURS[0], False)
        assert (cloning.get_color(), cloning.is_dashed()) == (STYLE_COLOURS[1], True)
        assert axes.get_ylim()[0] == 0
        assert _legend(_horizon()) == ["T-VAE", "cloning"]

    def test_a_logarithmic_axis_may_begin_with_an_error_of_zero(self):
        zero = Band(np.array([0.0, 1.0, 10.0]), np.array([0.0, 0.5, 9.0]), np.array([0.0, 2.0, 11.0]))
        figure = horizon({"T-VAE": zero}, y="distance", logarithmic=True)
        figure.draw_without_rendering()
        assert figure.axes[0].get_yscale() == "log"

    def test_no_method_and_too_many_are_errors(self):
        for count in (0, 7):
            with pytest.raises(ValueError, match=f"got {count}"):
                horizon({str(index): _band() for index in range(count)}, y="distance")


class TestArchitecture:
    def test_names_every_part(self):
        texts = [text.get_text() for text in architecture().axes[0].texts]
        for part in ("LSTM", "mean over the valid steps", "environment", "state decoder", "policy decoder", "KL"):
            assert part in texts
        assert texts.count("LSTM") == 5

    def test_words_stay_inside_their_boxes_and_boxes_do_not_overlap(self):
        figure = architecture()
        figure.draw_without_rendering()
        (axes,) = figure.axes
        patches = [patch for patch in axes.patches if isinstance(patch, FancyBboxPatch)]
        boxes = [patch.get_window_extent() for patch in patches if to_rgba(patch.get_facecolor())[3] > 0]
        assert len(boxes) == 17
        for index, box in enumerate(boxes):
            assert not any(box.overlaps(other) for other in boxes[:index])
            inside = [text for text in axes.texts if box.contains(*_middle(text))]
            assert len(inside) == 1
            words = inside[0].get_window_extent()
            assert box.x0 < words.x0
            assert words.x1 < box.x1

    def test_only_what_happens_at_test_time_is_dashed(self):
        axes = architecture().axes[0]
        dashed = {line.get_color() for line in axes.lines if line.is_dashed()}
        assert dashed - {STYLE_COLOURS[0]} == {line.get_color() for line in axes.lines if _dotted(line)}
        assert sum(line.is_dashed() and not _dotted(line) for line in axes.lines) == 4
        assert PAPER not in dashed


def _middle(text: Text) -> tuple[float, float]:
    box = text.get_window_extent()
    return (box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2


def _dotted(line) -> bool:
    return line.is_dashed() and line.get_color() != STYLE_COLOURS[0]
