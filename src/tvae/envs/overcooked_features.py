"""What is seen of a state of Overcooked: categories only, and the same ones in every kitchen.

| signals                             | categories                                                                 |
|-------------------------------------|----------------------------------------------------------------------------|
| `layout`                            | which of the five `LAYOUTS`                                                |
| `x_0`, `y_0` (and `_1`: the other)  | where player 0 stands, in cells from the top left corner, which is (0, 0)  |
| `facing_0`                          | `DIRECTIONS`                                                               |
| `held_0`                            | `HELD`                                                                     |
| `pot_0`, `pot_1`                    | `POT`; pots in reading order                                               |
| `onions`, `dishes`, `soups`         | whether any lies on a counter                                              |
| `front_0`                           | `FRONT`: what an interaction would meet                                    |
| `north_0`, `south_0`, ...           | whether the next cell there is free to walk to                             |
| `onion_way_0`, `dish_way_0`, ...    | `WAYS`: the key that begins the shortest way to the nearest one            |

The signals from `front_0` on are the surroundings. In one kitchen all but the places of things on counters follows
from the other signals. They are what kitchens have in common, and spare a policy the geometry; but a state decoder
has to predict them as well, so that one event counts again and again: in people's games in the ring 4.2 signals
change a step with them, 1.1 without.

A way leads to the nearest onion (or dish) in a dispenser or on a counter, to the nearest soup on a counter or ready
in a pot, to the nearest pot, and to the nearest serving counter, as if the other player were not there. Players who
are there already are told the key that turns them to it.

Categories rather than numbers, because a Gaussian for a number that repeats exactly has no finite best width.
The choice of features follows `featurize_state` of Carroll et al. 2019 (arXiv 1910.05789) in spirit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
from gymnasium import spaces as gym

from tvae.spaces import Categorical, IntArray

Cell: TypeAlias = tuple[int, int]
"""(x, y) of a cell; x grows to the east, y to the south."""

LAYOUTS = (
    "asymmetric_advantages",
    "coordination_ring",
    "counter_circuit_o_1order",
    "cramped_room",
    "forced_coordination",
)
DIRECTIONS = ("north", "south", "east", "west")
HELD = ("nothing", "onion", "dish", "soup")
POT = ("absent", "empty", "1 onion", "2 onions", "15-19 steps to go", "8-14 steps", "1-7 steps", "ready")
FRONT = (
    "floor",
    "the other player",
    "empty counter",
    "onion",
    "dish",
    "soup",
    "onion dispenser",
    "dish dispenser",
    "pot",
    "serving counter",
)
WAYS = (*DIRECTIONS, "none")
GOALS = ("onion", "dish", "soup", "pot", "serving")

_OFFSETS: tuple[Cell, ...] = ((0, -1), (0, 1), (1, 0), (-1, 0))
_FACING = {offset: index for index, offset in enumerate(_OFFSETS)}
_MOST_POTS = 2
_COLUMNS, _ROWS = tuple(range(1, 8)), tuple(range(1, 4))
"""Walkable cells of all `LAYOUTS` lie at 1 <= x <= 7, 1 <= y <= 3."""
_FRONT_OF_TERRAIN = {" ": 0, "X": 2, "O": 6, "D": 7, "P": 8, "S": 9}
_STATION = {"onion": "O", "dish": "D", "pot": "P", "serving": "S"}
_NOWHERE = (1 << 30, WAYS.index("none"))


def signals(*, surroundings: bool) -> Iterator[Categorical]:
    """The signals of an observation, in order, with what their categories mean."""
    yield Categorical("layout", LAYOUTS)
    for player in range(2):
        yield Categorical(f"x_{player}", _COLUMNS)
        yield Categorical(f"y_{player}", _ROWS)
        yield Categorical(f"facing_{player}", DIRECTIONS)
        yield Categorical(f"held_{player}", HELD)
    for pot in range(_MOST_POTS):
        yield Categorical(f"pot_{pot}", POT)
    for thing in ("onions", "dishes", "soups"):
        yield Categorical(thing, ("none about", "some about"))
    if surroundings:
        for player in range(2):
            yield Categorical(f"front_{player}", FRONT)
            for direction in DIRECTIONS:
                yield Categorical(f"{direction}_{player}", ("blocked", "free"))
            for goal in GOALS:
                yield Categorical(f"{goal}_way_{player}", WAYS)


def _first(signal: Categorical) -> int:
    """The raw value of its first category."""
    first = signal.categories[0]
    return first if isinstance(first, int) else 0


class Features:
    """Observations of the states of one kitchen.

    `terrain` are its rows as the simulator writes them: X counter, O onions, D dishes, P pot, S serving counter,
    a blank floor.

    >>> ring = Features("coordination_ring", ("XXXPX", "X   P", "D X X", "O   X", "XOSXX"))
    >>> len(ring.names), int(ring.space.nvec.sum())
    (34, 149)
    """

    def __init__(self, layout: str, terrain: Sequence[str], *, surroundings: bool = True) -> None:
        seen = tuple(signals(surroundings=surroundings))
        self.names = tuple(signal.name for signal in seen)
        self.space = gym.MultiDiscrete(
            [len(signal.categories) for signal in seen], start=[_first(signal) for signal in seen]
        )
        self._layout = LAYOUTS.index(layout)
        self._surroundings = surroundings
        self._terrain = {(x, y): kind for y, row in enumerate(terrain) for x, kind in enumerate(row)}
        self._pots = self._cells("P")
        self._ways = {cell: self._ways_to(cell) for cell, kind in self._terrain.items() if kind != " "}
        self._stations = {
            goal: {cell: self._nearest(cell, self._cells(kind)) for cell in self._cells(" ")}
            for goal, kind in _STATION.items()
        }

    def _cells(self, kind: str) -> tuple[Cell, ...]:
        return tuple(cell for cell, here in self._terrain.items() if here == kind)

    def _ways_to(self, goal: Cell) -> dict[Cell, tuple[int, int]]:
        """From each walkable cell that leads to a cell beside `goal`: the number of moves, and the first key."""
        ways: dict[Cell, tuple[int, int]] = {}
        queue = deque([(goal, -1)])
        while queue:
            (x, y), moves = queue.popleft()
            for key, (dx, dy) in enumerate(_OFFSETS):
                cell = (x - dx, y - dy)
                if self._terrain.get(cell) == " " and cell not in ways:
                    ways[cell] = (moves + 1, key)
                    queue.append((cell, moves + 1))
        return ways

    def _nearest(self, start: Cell, goals: Iterable[Cell]) -> tuple[int, int]:
        return min((self._ways[goal].get(start, _NOWHERE) for goal in goals), default=_NOWHERE)

    def observe(self, state: Any) -> IntArray:
        """The observation of a simulator's `OvercookedState`, a value of `space`."""
        lying: dict[str, list[Cell]] = {"onion": [], "dish": [], "soup": []}
        for cell, thing in state.objects.items():
            if cell not in self._pots:
                lying[thing.name].append(cell)
        values = [self._layout]
        for player in state.players:
            held = 0 if player.held_object is None else HELD.index(player.held_object.name)
            values += (*player.position, _FACING[player.orientation], held)
        pots = [_pot(state.objects.get(cell)) for cell in self._pots]
        values += pots + [POT.index("absent")] * (_MOST_POTS - len(pots))
        values += [bool(cells) for cells in lying.values()]
        if self._surroundings:
            ready = [cell for cell, pot in zip(self._pots, pots, strict=True) if pot == POT.index("ready")]
            lying["soup"] = lying["soup"] + ready
            for player, other in (state.players, state.players[::-1]):
                values += self._around(player, other.position, state.objects)
                values += self._leads(player.position, lying)
        return np.array(values, dtype=np.int64)

    def _around(self, player: Any, other: Cell, objects: Any) -> list[int]:
        (x, y), facing = player.position, _FACING[player.orientation]
        neighbours = [(x + dx, y + dy) for dx, dy in _OFFSETS]
        ahead = neighbours[facing]
        terrain = self._terrain[ahead]
        if ahead == other:
            front = FRONT.index("the other player")
        elif terrain == "X" and ahead in objects:
            front = FRONT.index(objects[ahead].name)
        else:
            front = _FRONT_OF_TERRAIN[terrain]
        return [front, *(self._terrain[cell] == " " and cell != other for cell in neighbours)]

    def _leads(self, position: Cell, lying: dict[str, list[Cell]]) -> list[int]:
        leads = []
        for goal in GOALS:
            way = self._stations[goal][position] if goal in _STATION else _NOWHERE
            if lying.get(goal):
                way = min(way, self._nearest(position, lying[goal]))
            leads.append(way[1])
        return leads


def _pot(soup: Any) -> int:
    """The category of a pot, from the soup in it."""
    if soup is None:
        return POT.index("empty")
    if soup.is_idle:
        return POT.index("empty") + len(soup.ingredients)
    return POT.index("ready") - min(3, -(-soup.cook_time_remaining // 7))
