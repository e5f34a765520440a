"""How large a time step the explicit schemes can take, estimated before the run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.planning.step_limits import (
    RK4_UNDAMPED,
    largest_step,
    rk4_growth,
    rk4_loss,
)
from openprc.demlat.planning.tangent_operators import Culprit, TangentOperators
from openprc.schema.geometry import Bars

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

#: Products with the stiffness; after 20 the highest frequency of lattices and folded sheets is
#: at most 0.2 % too low.
PRODUCTS = 24
#: Products with the damping, where bars or hinges have any.
DAMPING_PRODUCTS = 12
#: From this many coordinates on half as many products have to do, kept in single precision:
#: the highest frequency is then up to 1 % too low, which `MARGIN` makes up for.
LARGE = 100_000
#: The highest frequency is taken for this much higher, unless its residual says it is exact.
MARGIN = 1.02
#: Share of the limit that is recommended, by kind of stability: a body stiffens as it deforms.
RECOMMENDED = {"rk4": 0.85, "verlet": 0.8, "pefrl": 0.8}
#: Share of the limit up to which rk4 hardly damps the fastest mode (1.3 % of its energy in a
#: radian), which nothing else may damp.
ACCURATE = 0.35

#: Step times frequency at which rk4 takes a hundredth of a mode's energy in a period.
QUIET_PHASE = 0.65

Verdict = Literal["fine", "dissipative", "marginal", "unstable"]
Operator = Callable[["Reals"], "Reals"]


@dataclass(frozen=True, kw_only=True)
class StepLimit:
    """The largest stable step of a scheme on a body as it lies at t = 0, and what it means.

    Attributes
    ----------
    scheme : str
        Name of the integrator.
    limit : float [s]
        Infinity for schemes that choose their step, and where nothing is stiff or damped.
    omega : float [rad/s]
        Highest angular frequency.
    zeta : float
        Damping ratio of that mode; 0 without stiffness.
    culprit : Culprit or None
        What holds most of the mode that sets the limit.
    recommended : float [s]
        At most this share of the limit: `RECOMMENDED`; for rk4 also so small that the scheme
        takes no more out of the fastest mode than its own damping does, or than at
        `ACCURATE` of the limit.
    damped : bool
        Whether anything but the scheme takes energy.
    """

    scheme: str
    limit: float
    omega: float
    zeta: float
    culprit: Culprit | None
    recommended: float
    damped: bool

    @property
    def setter(self) -> str:
        """Name of what sets the limit."""
        return "nothing" if self.culprit is None else self.culprit.text

    def loss(self, dt: float) -> float:
        """Return the share of its energy that rk4 takes from the fastest mode in a period."""
        return rk4_loss(self.omega * dt) if self.omega * dt > 0 else 0.0

    def verdict(self, dt: float) -> Verdict:
        """Judge a step.

        "unstable" above the limit; "marginal" above the share of it that is recommended at
        most; "dissipative" where rk4 damps the fastest mode more than the body does, and
        noticeably; else "fine".
        """
        kind = _kind(self.scheme)
        if kind == "none" or not dt > ACCURATE * self.limit:
            return "fine"
        if dt > RECOMMENDED[kind] * self.limit:
            return "unstable" if dt > self.limit else "marginal"
        phase = self.omega * dt
        if kind != "rk4" or phase == 0.0:
            return "fine"
        lost = -float(np.log(abs(rk4_growth(np.array(1j * phase)))))
        return "dissipative" if lost > self.zeta * phase else "fine"

    def remark(self, dt: float) -> str:
        """Say what a user of that step should know; empty when it is fine."""
        verdict = self.verdict(dt)
        if verdict == "fine":
            return ""
        at = f"dt = {dt:g} s is {dt / self.limit:.2f} of {self.limit:.3g} s, the stability limit"
        if verdict == "unstable":
            return f"{at} of {self.scheme} that {self.setter} sets at the start: expect divergence"
        if verdict == "marginal":
            return f"{at} that {self.setter} sets at the start: deformation may lower it"
        return (
            f"{at}: rk4 itself takes {self.loss(dt):.2g} of the energy of the fastest mode"
            f" ({self.omega:.3g} rad/s) in a period, and less than 0.01 with a step of"
            f" {QUIET_PHASE / self.omega:.3g} s or smaller"
        )


_KNOWN: WeakKeyDictionary[Experiment, StepLimit] = WeakKeyDictionary()


def step_limit(experiment: Experiment) -> StepLimit:
    """Estimate the largest stable step of the experiment's integrator.

    Lanczos on the mass-weighted tangent stiffness and, where there is any, on the damping;
    the quadratic eigenvalue problem of both, projected on the vectors that this gives, has the
    modes that bound a step. Exact when there are hardly more coordinates than products, else
    on the safe side by at most `MARGIN`. The body is taken as it lies at t = 0: a large
    rotation leaves the limit, a large deformation may lower it. Contact does not enter.

    Parameters
    ----------
    experiment : Experiment
        One that has been checked and whose integrator exists.

    References
    ----------
    Lanczos 1950, doi:10.6028/jres.045.026; quadratic eigenvalue problems: Tisseur & Meerbergen
    2001, doi:10.1137/S0036144500381988.
    """
    if experiment not in _KNOWN:
        _KNOWN[experiment] = _estimate(experiment)
    return _KNOWN[experiment]


def is_surely_sound(experiment: Experiment) -> bool:
    """Whether `dt` is stable, and accurate for the fastest mode, by bounds that cost little.

    Most experiments pass, so that sweeps over thousands of them need no eigenvalues.
    """
    kind = _kind(experiment.integrator)
    if kind == "none":
        return True
    if experiment.integrator == "respa":
        experiment = _without_bars(experiment)
    body = TangentOperators(experiment)
    omega, rate = np.sqrt(body.stiffness_bound()), body.damping_bound()
    if kind == "verlet":
        share = RECOMMENDED["verlet"]
        return bool((experiment.dt * omega) ** 2 + 4.0 * experiment.dt * rate < 4.0 * share**2)
    # No eigenvalue of y'' + C y' + K y = 0 is larger; the half-disc is stable for rk4, and for
    # the other schemes with a margin.
    largest = 0.5 * rate + np.sqrt(0.25 * rate**2 + omega**2)
    return bool(experiment.dt * largest < ACCURATE * RK4_UNDAMPED)


def stable_step(experiment: Experiment) -> float:
    """Return `StepLimit.limit` of an experiment [s]."""
    return step_limit(experiment).limit


def _estimate(experiment: Experiment) -> StepLimit:
    name = experiment.integrator
    kind = _kind(name)
    if name == "respa":
        experiment = _without_bars(experiment)
    body = TangentOperators(experiment)
    space = _Projections(body)
    # A fixed generator, so that a run's remarks are reproducible.
    rng = np.random.default_rng(0)
    share = 2 if body.n_free >= LARGE else 1
    springs = dashpots = space.extend(body.stiffness, PRODUCTS // share, rng)
    if body.damped:
        dashpots = space.extend(body.damping, DAMPING_PRODUCTS // share, rng)
    stiffness, damping = space.project(springs)
    squares, modes = np.linalg.eigh(stiffness)
    square = max(float(squares[-1]), 0.0) if len(squares) else 0.0
    margin = _margin(square, springs.residual, body)
    omega = margin * np.sqrt(square)
    zeta = 0.0
    if omega > 0.0:
        zeta = float(modes[:, -1] @ damping @ modes[:, -1] / (2.0 * np.sqrt(square)))
    if kind == "none" or not space.size:
        highest = body.culprit(space.combined(modes[:, -1]), omega) if omega > 0.0 else None
        return StepLimit(
            scheme=name,
            limit=float("inf"),
            omega=float(omega),
            zeta=zeta,
            culprit=highest,
            # The first step of a scheme that chooses the others; an implicit one takes any.
            recommended=1.0 / float(omega)
            if omega > 0.0 and INTEGRATORS[name].step == "adaptive"
            else float("inf"),
            damped=body.damped or body.drag > 0.0,
        )
    binding = largest_step(kind, stiffness, damping)
    if body.damped and dashpots.largest > np.sqrt(square):
        margin = max(margin, min(MARGIN, 1.0 + dashpots.residual / dashpots.largest))
    limit = binding.step / margin
    finite = np.isfinite(limit)
    return StepLimit(
        scheme=name,
        limit=float(limit),
        omega=float(omega),
        zeta=zeta,
        culprit=body.culprit(space.combined(binding.mode), binding.rate) if finite else None,
        recommended=_recommended(kind, float(limit), float(omega), zeta),
        damped=body.damped or body.drag > 0.0,
    )


def _kind(name: str) -> str:
    # The outer loop of respa is Verlet's, and the bars choose their steps in the inner one.
    return "verlet" if name == "respa" else INTEGRATORS[name].stability


def _without_bars(experiment: Experiment) -> Experiment:
    return replace(experiment, geometry=replace(experiment.geometry, bars=Bars()))


def _recommended(kind: str, limit: float, omega: float, zeta: float) -> float:
    most = RECOMMENDED[kind] * limit
    if kind != "rk4" or omega == 0.0:
        return most
    # rk4 damps like zeta_num = phase^5 / 144 while the phase h omega is well below the limit.
    phase: float = max((144.0 * zeta) ** 0.2, ACCURATE * RK4_UNDAMPED)
    return min(most, phase / omega)


def _margin(square: float, residual: float, body: TangentOperators) -> float:
    """Return by how much the highest frequency may be above its estimate."""
    if square <= 0.0:
        return 1.0
    # There is an eigenvalue within the residual of the estimate (Parlett, The Symmetric
    # Eigenvalue Problem, theorem 4.5.1, doi:10.1137/1.9781611971163).
    exact = np.sqrt(1.0 + residual / square)
    bound = np.sqrt(body.stiffness_bound() / square)
    return float(max(1.0, min(MARGIN, bound) if exact > 1.001 else exact))


class _Chain(NamedTuple):
    """What one Krylov space says.

    Attributes
    ----------
    matrix : (m, m)
        The operator, projected on the vectors that were added.
    largest, residual : float
        Its largest eigenvalue, and within which distance the operator has one.
    """

    matrix: Reals
    largest: float
    residual: float


class _Projections:
    """An orthonormal basis that grows, with a body's stiffness and damping projected on it.

    `np.einsum` instead of a matrix product throughout: products of this shape gain nothing from
    several threads, and lose a lot when another process has the cores.
    """

    def __init__(self, body: TangentOperators) -> None:
        self.body = body
        most = min(body.n_free, PRODUCTS + (DAMPING_PRODUCTS if body.damped else 0))
        single = body.n_free >= LARGE
        self.vectors = np.zeros((most, body.n_free), dtype="f4" if single else "f8")
        self.size = 0

    @property
    def basis(self) -> Reals:
        return self.vectors[: self.size]

    def parts(self, vector: Reals) -> Reals:
        """Return the components of a vector: (size,)."""
        parts: Reals = np.einsum("mi,i->m", self.basis, vector)
        return parts

    def combined(self, coefficients: NDArray[Any]) -> NDArray[Any]:
        """Return the vector that has these components: (n_free,), complex allowed."""
        vector: NDArray[Any] = np.einsum("mi,m->i", self.basis, coefficients)
        return vector

    def add(self, vector: Reals) -> bool:
        """Add the part of `vector` that is new; return whether there was any."""
        if self.size == len(self.vectors):
            return False
        for _ in range(2):  # once loses digits when the vector nearly lies in the space
            vector = vector - self.combined(self.parts(vector))
        norm = _norm(vector)
        if norm == 0.0:
            return False
        self.vectors[self.size] = vector / norm
        self.size += 1
        return True

    def extend(self, operator: Operator, products: int, rng: np.random.Generator) -> _Chain:
        """Add Krylov vectors of a symmetric operator.

        When the Krylov space is exhausted a random vector starts another, so that a small
        body gets a complete basis.
        """
        start, diagonal, coupling = self.size, [], [0.0]
        norm = 0.0
        going = self.add(rng.standard_normal(self.body.n_free))
        while going:
            vector = self.vectors[self.size - 1].astype("f8")
            image = operator(vector)
            diagonal.append(float(np.einsum("i,i", vector, image)))
            rest = image - self.combined(self.parts(image))
            norm = _norm(rest)
            if norm <= 1e-10 * _norm(image):
                norm, rest = 0.0, rng.standard_normal(self.body.n_free)
            coupling.append(norm)
            going = self.size - start < products and self.add(rest)
        inner = coupling[1 : len(diagonal)]
        matrix = np.diag(diagonal) + np.diag(inner, 1) + np.diag(inner, -1)
        if not diagonal:
            return _Chain(np.zeros((0, 0)), 0.0, 0.0)
        values, vectors = np.linalg.eigh(matrix)
        complete = self.size == self.body.n_free
        residual = 0.0 if complete else norm * float(abs(vectors[-1, -1]))
        return _Chain(matrix, float(values[-1]), residual)

    def project(self, springs: _Chain) -> tuple[Reals, Reals]:
        """Return stiffness [1/s2] and damping [1/s] on the basis: (size, size) each.

        Parameters
        ----------
        springs : _Chain
            Of the stiffness; without dashpots there is nothing else in the basis.
        """
        damping = self.body.drag * np.eye(self.size)
        if not self.body.damped:
            return springs.matrix, damping
        known = len(springs.matrix)
        stiffness = np.zeros_like(damping)
        stiffness[:known, :known] = springs.matrix
        for column, vector in enumerate(self.basis):
            if column >= known:
                stiffness[:, column] = self.parts(self.body.stiffness(vector))
                stiffness[column, :known] = stiffness[:known, column]
            damping[:, column] += self.parts(self.body.damping(vector))
        return 0.5 * (stiffness + stiffness.T), damping


def _norm(vector: Reals) -> float:
    return float(np.sqrt(np.einsum("i,i", vector, vector)))
