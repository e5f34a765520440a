"""All stable states of a body that random starts lead to."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.statics.congruence import allowed_motions
from openprc.demlat.statics.equilibrium import Equilibrium, find_equilibrium
from openprc.demlat.statics.inertia import stability
from openprc.errors import ConfigError, NotConverged

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from openprc.demlat.statics.assembly import StaticProblem

    Reals = NDArray[np.float64]

Progress = Callable[[int, int, int], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class StableState:
    """One state, however often it was found.

    Attributes
    ----------
    equilibrium : Equilibrium
        As it was found first.
    starts : tuple of int
        The starts that led here; the share of them hints at the size of the basin.
    reach : float [m]
        Largest root mean square distance of those starts, a lower bound of the basin's extent.
    """

    equilibrium: Equilibrium
    starts: tuple[int, ...]
    reach: float

    @property
    def positions(self) -> Reals:
        """Positions: (N, 3) [m]."""
        return self.equilibrium.positions

    @property
    def energy(self) -> float:
        """Potential energy [J]."""
        return self.equilibrium.energy

    @property
    def count(self) -> int:
        """How many starts led here."""
        return len(self.starts)


@dataclass(frozen=True, kw_only=True, eq=False)
class StableStates:
    """What a search found.

    Attributes
    ----------
    states : tuple of StableState
        By ascending energy.
    n_starts : int
    failures : mapping of start to message
        Starts that reached no equilibrium.
    """

    states: tuple[StableState, ...]
    n_starts: int
    failures: dict[int, str]

    def __len__(self) -> int:
        """Return the number of different states."""
        return len(self.states)

    def __iter__(self) -> Iterator[StableState]:
        """Iterate by ascending energy."""
        return iter(self.states)

    def __getitem__(self, index: int) -> StableState:
        """Return one state; 0 has the lowest energy."""
        return self.states[index]

    def to_json(self, *, indent: int | None = None) -> str:
        """Return everything as JSON; lengths in m, energies in J, forces in N."""
        states: list[dict[str, Any]] = [
            {
                "energy": state.energy,
                "residual": state.equilibrium.residual,
                "stability": state.equilibrium.stability.kind,
                "lowest_eigenvalues": state.equilibrium.stability.eigenvalues.tolist(),
                "count": state.count,
                "starts": list(state.starts),
                "reach": state.reach,
                "positions": state.positions.tolist(),
            }
            for state in self.states
        ]
        failures = [
            {"start": start, "message": message} for start, message in self.failures.items()
        ]
        content = {"n_starts": self.n_starts, "states": states, "failures": failures}
        return json.dumps(content, indent=indent)


def find_stable_states(
    problem: StaticProblem,
    *,
    rng: np.random.Generator | None = None,
    n_starts: int = 64,
    amplitude: float | None = None,
    soft_modes: int = 0,
    starts: ArrayLike | None = None,
    tolerance: float = 1e-10,
    force_tolerance: float = 0.0,
    max_iterations: int = 500,
    same_within: float = 1e-5,
    progress: Progress | None = None,
) -> StableStates:
    """Search minima of the energy from many starts and remove duplicates.

    Two states are the same when a rigid motion that neither supports nor loads oppose brings
    them together; mirror images are different. The positions of the problem are start 0.

    Parameters
    ----------
    problem : StaticProblem
    rng : numpy.random.Generator, optional
        Needed unless `starts` are given.
    n_starts : int
    amplitude : float [m], optional
        Root mean square displacement of a node of a random start; a quarter of the median bar
        length unless given.
    soft_modes : int
        0: every node is displaced on its own. Otherwise starts are random sums of that many of
        the softest directions of the stiffness, which lead further in stiff bodies.
    starts : (S, N, 3) [m], optional
        Starts of your own, instead of random ones.
    tolerance, force_tolerance, max_iterations
        As for `find_equilibrium`.
    same_within : float
        Two states are one within this root mean square distance, relative to the size of the
        body.
    progress : callable, optional
        Called with (starts done, starts in all, states so far) after every start.

    Raises
    ------
    ConfigError
        When neither `starts` nor `rng` are given, or an argument is out of range.

    Examples
    --------
    A shallow arch of two bars is at rest above its supports and below them:

    >>> import numpy as np
    >>> from openprc.demlat.geometry_builder import GeometryBuilder
    >>> from openprc.demlat.statics import StaticProblem, find_stable_states
    >>> build = GeometryBuilder()
    >>> left = build.add_node([-1.0, 0.0, 0.0], fixed=True)
    >>> apex = build.add_node([0.0, 0.0, 0.3])
    >>> right = build.add_node([1.0, 0.0, 0.0], fixed=True)
    >>> bars = [build.add_bar(end, apex, stiffness=100.0) for end in (left, right)]
    >>> held = np.zeros((3, 3), dtype=bool)
    >>> held[apex, 1] = True
    >>> problem = StaticProblem(geometry=build.geometry(), held=held)
    >>> states = find_stable_states(problem, rng=np.random.default_rng(0), n_starts=16)
    >>> print(sorted(f"{state.positions[apex, 2]:.3f} m" for state in states))
    ['-0.300 m', '0.300 m']
    """
    begins = _starts(problem, rng, n_starts, amplitude, soft_modes, starts)
    motions = allowed_motions(problem)
    size = float(np.ptp(problem.positions, axis=0).max()) or 1.0
    found: list[tuple[Equilibrium, list[int], list[float]]] = []
    failures: dict[int, str] = {}
    for number, begin in enumerate(begins):
        try:
            reached = find_equilibrium(
                problem,
                begin,
                tolerance=tolerance,
                force_tolerance=force_tolerance,
                max_iterations=max_iterations,
            )
        except NotConverged as error:
            failures[number] = error.found
        else:
            way = motions.distance(begin, reached.positions)
            for state, members, reaches in found:
                if motions.distance(reached.positions, state.positions) <= same_within * size:
                    members.append(number)
                    reaches.append(way)
                    break
            else:
                found.append((reached, [number], [way]))
        if progress is not None:
            progress(number + 1, len(begins), len(found))
    states = [
        StableState(equilibrium=state, starts=tuple(members), reach=max(reaches))
        for state, members, reaches in found
    ]
    states.sort(key=lambda state: state.energy)
    return StableStates(states=tuple(states), n_starts=len(begins), failures=failures)


def _starts(
    problem: StaticProblem,
    rng: np.random.Generator | None,
    n_starts: int,
    amplitude: float | None,
    soft_modes: int,
    given: ArrayLike | None,
) -> Reals:
    home = problem.place(problem.positions)
    if given is not None:
        own = np.array(given, dtype="f8")
        if own.ndim != 3 or own.shape[1:] != home.shape or not len(own):
            raise ConfigError(
                f"shape {own.shape}",
                expected=f"(S, {home.shape[0]}, 3) with at least one start",
                key="starts",
            )
        return np.stack([problem.place(start) for start in own])
    if rng is None:
        raise ConfigError(
            "no random generator",
            expected="a numpy.random.Generator, or starts",
            fix="pass rng=np.random.default_rng(seed)",
            key="rng",
        )
    if n_starts < 1:
        raise ConfigError(f"{n_starts} starts", expected="at least one", key="n_starts")
    reach = 0.25 * problem.length_scale if amplitude is None else amplitude
    if not (np.isfinite(reach) and reach > 0):
        raise ConfigError(f"amplitude {reach}", expected="a length above 0 m", key="amplitude")
    shape = (n_starts, *home.shape)
    if soft_modes > 0:
        directions = stability(problem, home, n=soft_modes).directions[:soft_modes]
        weights = rng.standard_normal((n_starts, len(directions)))
        # A unit vector over all nodes has a root mean square of 1 / sqrt(N).
        weights *= np.sqrt(len(home) / len(directions))
        moves = np.einsum("sm,mna->sna", weights, directions)
    else:
        moves = rng.standard_normal(shape) / np.sqrt(3.0)
    moves *= reach
    moves[0] = 0.0
    moves[:, problem.held] = 0.0
    displaced: Reals = home + moves
    return displaced
