"""What the user's script commanded, frame by frame, as the inputs of the file.

The input of a frame is the command that acts from that instant on: the one given with the step
that begins there. A symbol that is held from 0.1 s on so stands at 0.1 s and in the frames that
follow. After the last step nothing was commanded any more; the last frame keeps the command of
the frame before it.
"""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError
from openprc.schema import TrajectoryWriter

#: The value comes with every ``session.step(name=value)``.
GIVEN = "given"
#: Slack, in symbols, within which a time counts as the beginning of the next one.
_SLACK = 1e-6
_KEYS = ("value", "unit", "quantity", "columns", "targets", "sequence", "hold", "start")


@dataclass(frozen=True, slots=True)
class SignalSpec:
    """One input.

    Parameters
    ----------
    value : "given", callable, or array
        ``"given"``: comes with ``step(name=value)``. A function without arguments is asked in
        every step, one of time is evaluated at every frame, and row k of an array is the
        command of step k.
    unit, quantity : str
    columns : names of the C columns; the name of the signal, numbered when C > 1
    targets : names of what it acts on
    sequence : (K, C), hold : float [s], start : float [s], optional
        The symbols behind the values: symbol k acts from ``start + k hold`` on. Without
        `value` the values are computed from them.
    """

    name: str
    value: Any = GIVEN
    unit: str = "arb"
    quantity: str = "command"
    columns: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()
    sequence: NDArray[np.float64] | None = None
    hold: float | None = None
    start: float = 0.0


def read_signals_option(given: Mapping[str, Any] | None) -> tuple[SignalSpec, ...]:
    """Read the option ``signals``: a mapping of names to values or to mappings of `_KEYS`.

    Raises
    ------
    ConfigError
        When a key is unknown or a value is of no use.
    """
    if not isinstance(given, Mapping | None):
        raise ConfigError(
            f"signals is a {type(given).__name__}",
            expected="a mapping of names to functions, arrays or mappings",
            fix='signals={"u": lambda: torque}, or session.step(u=torque)',
            key="signals",
        )
    return tuple(_spec(str(name), value) for name, value in (given or {}).items())


def _spec(name: str, given: Any) -> SignalSpec:
    told = dict(given) if isinstance(given, Mapping) else {"value": given}
    for key in told:
        if key not in _KEYS:
            near = difflib.get_close_matches(str(key), _KEYS, n=1)
            raise _wrong(
                name, f"has no {key!r}", "some of " + ", ".join(_KEYS),
                f"did you mean {near[0]!r}?" if near else "leave it out",
            )  # fmt: skip
    sequence = told.get("sequence")
    if (sequence is None) != (told.get("hold") is None):
        raise _wrong(name, "names one of sequence and hold", "both or neither", "add the other")
    value: Any = told.get("value", GIVEN if sequence is None else _Held)
    if sequence is not None:
        symbols = _rows(name, sequence)
        hold, start = float(told["hold"]), float(told.get("start", 0.0))
        if not (0 < hold < np.inf and np.isfinite(start)):
            raise _wrong(name, f"hold {hold}, start {start}", "seconds, hold above 0", "correct it")
        if value is _Held:
            value = _Held(name, symbols, hold, start)
        told.update(sequence=symbols, hold=hold, start=start)
    if not (callable(value) or value is None or (isinstance(value, str) and value == GIVEN)):
        value = _rows(name, value)
    columns, targets = told.pop("columns", ()), told.pop("targets", ())
    told["columns"] = (columns,) if isinstance(columns, str) else tuple(columns)
    told["targets"] = (targets,) if isinstance(targets, str) else tuple(targets)
    return SignalSpec(name, **{**told, "value": GIVEN if value is None else value})


def _rows(name: str, values: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(values)
    if array.dtype.kind not in "fiub" or array.ndim not in (1, 2) or array.size == 0:
        raise _wrong(
            name,
            f"is {array.dtype} of shape {array.shape}",
            "a function, or numbers (K,) or (K, C), one row a step",
            "a constant is an array of one number for each step, or a lambda: number",
        )
    table = array.astype("f8").reshape(len(array), -1)
    if not np.isfinite(table).all():
        raise _wrong(name, "holds NaN or infinite numbers", "finite numbers", "correct it")
    return table


class _Held:
    """Symbols as a function of time."""

    def __init__(self, name: str, symbols: NDArray[np.float64], hold: float, start: float) -> None:
        self._name, self._symbols, self._hold, self._start = name, symbols, hold, start

    def __call__(self, t: float) -> NDArray[np.float64]:
        # The end of a symbol, n dt, is rounded; it belongs to the next one.
        k = int(np.floor((t - self._start) / self._hold + _SLACK))
        # The last frame may stand at the very end of the last symbol.
        if k == len(self._symbols) and t - self._start <= (k + _SLACK) * self._hold:
            k -= 1
        if not 0 <= k < len(self._symbols):
            stop = self._start + len(self._symbols) * self._hold
            raise _wrong(
                self._name,
                f"has no symbol at {t:.9g} s",
                f"a frame between {self._start:.9g} and {stop:.9g} s",
                'give the values themselves, with value: "given" or a function, beside sequence',
            )
        row: NDArray[np.float64] = self._symbols[k]
        return row


@dataclass
class Signals:
    """Takes the commands of every step and makes a row of each frame."""

    specs: tuple[SignalSpec, ...]
    rows: list[tuple[float, ...]] = field(default_factory=list)
    #: Columns of every signal, known after the first row.
    widths: list[int] = field(default_factory=list)
    changed_between: bool = False
    _last: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        self._readers = [_reader(spec) for spec in self.specs]
        self._given = {spec.name for spec in self.specs if isinstance(spec.value, str)}

    def command(self, given: Mapping[str, Any], *, frame_waits: bool, t: float, step: int) -> None:
        """Take the commands of the step that begins at `t`, the `step`-th from 0.

        Parameters
        ----------
        given : mapping
            What came with ``step`` or ``record``.
        frame_waits : bool
            Whether this step is the first after a saved frame.

        Raises
        ------
        ConfigError
            When a signal is missing or not known, or its value is no finite number.
        """
        if given.keys() != self._given:
            self._refuse(given)
        row = self._row(given, t, step)
        if frame_waits:
            self.rows.append(row)
        elif row != self._last:
            self.changed_between = True
        self._last = row

    def finish(self, *, t: float, step: int, ask: bool) -> bool:
        """Complete the last frame, at `t`; return whether a command had to be kept.

        With `ask` functions of time and arrays are read on; a script that failed is not asked.

        Raises
        ------
        ConfigError
            When there is nothing to keep, because no step was made.
        """
        row: list[float] = []
        widths, kept = [], False
        old = iter(_split(self._last, self.widths)) if self._last is not None else None
        for spec, read in zip(self.specs, self._readers, strict=True):
            numbers = next(old) if old is not None else None
            goes_on = isinstance(spec.value, np.ndarray) and step < len(spec.value)
            if ask and (goes_on or _is_function_of_time(spec.value)):
                numbers = self._numbers(spec, read({}, t, step))
            elif numbers is None:
                raise _wrong(
                    spec.name, "has no value: no step was made", "a step", "step before the end"
                )
            else:
                kept = True
            widths.append(len(numbers))
            row += numbers
        self.widths = self.widths or widths
        self.rows.append(tuple(row))
        return kept

    def _row(self, given: Mapping[str, Any], t: float, step: int) -> tuple[float, ...]:
        row: list[float] = []
        widths = []
        for spec, read in zip(self.specs, self._readers, strict=True):
            numbers = self._numbers(spec, read(given, t, step))
            widths.append(len(numbers))
            row += numbers
        if not self.widths:
            self.widths = widths
        elif widths != self.widths:
            k = next(i for i, width in enumerate(widths) if width != self.widths[i])
            raise _wrong(
                self.specs[k].name, f"has {widths[k]} values at {t:.9g} s",
                f"{self.widths[k]}, as before", "always give the same number of values",
            )  # fmt: skip
        return tuple(row)

    @staticmethod
    def _numbers(spec: SignalSpec, value: Any) -> Sequence[float]:
        if isinstance(value, float | int) and value - value == 0:  # the common case, and finite
            return (float(value),)
        array = np.asarray(value)
        if array.dtype.kind not in "fiub" or array.ndim > 1 or not np.isfinite(array).all():
            raise _wrong(
                spec.name, f"is {value!r}", "a finite number, or several", "correct the script"
            )
        numbers: list[float] = array.astype("f8").reshape(-1).tolist()
        return numbers

    def _refuse(self, given: Mapping[str, Any]) -> None:
        missing = sorted(self._given - given.keys())
        if missing:
            raise _wrong(
                missing[0], "was not given with this step", "a value in every step",
                f"call step({missing[0]}=...)",
            )  # fmt: skip
        stray = min(given.keys() - self._given)
        known = ", ".join(sorted(self._given)) or "none"
        raise _wrong(
            stray, "was given with this step, and is no signal that steps give",
            f"one of: {known}", "give it in the first step already, or name it in signals",
        )  # fmt: skip

    def declare(self, writer: TrajectoryWriter) -> None:
        """Declare the inputs; the first row must be known."""
        for spec, width in zip(self.specs, self.widths, strict=True):
            numbered = [f"{spec.name}{i}" for i in range(width)] if width > 1 else [spec.name]
            columns = spec.columns or numbered
            if len(columns) != width:
                raise _wrong(
                    spec.name, f"has {width} values", f"one for each of {', '.join(columns)}",
                    "correct columns",
                )  # fmt: skip
            writer.declare_input(
                spec.name,
                columns,
                quantity=spec.quantity,
                unit=spec.unit,
                targets=spec.targets,
                sequence=spec.sequence,
                hold=spec.hold,
                start=spec.start,
            )

    def take(self, n_rows: int) -> dict[str, NDArray[np.float64]]:
        """Return the inputs of the first `n_rows` frames that wait, and forget them."""
        table = np.array(self.rows[:n_rows], dtype="f8").reshape(n_rows, -1)
        del self.rows[:n_rows]
        stops = np.cumsum([0, *self.widths])
        return {spec.name: table[:, stops[i] : stops[i + 1]] for i, spec in enumerate(self.specs)}


def _reader(spec: SignalSpec) -> Callable[[Mapping[str, Any], float, int], Any]:
    value = spec.value
    if isinstance(value, np.ndarray):

        def row(_given: Mapping[str, Any], t: float, step: int) -> Any:
            if step >= len(value):
                raise _wrong(
                    spec.name, f"has {len(value)} rows, and step {step} begins at {t:.9g} s",
                    "a row for every step", "give a longer array",
                )  # fmt: skip
            return value[step]

        return row
    if _is_function_of_time(value):
        return lambda _given, t, _step: value(t)
    if callable(value):
        return lambda _given, _t, _step: value()
    return lambda given, _t, _step: given[spec.name]


def _is_function_of_time(value: Any) -> bool:
    """Whether a callable takes the time; one that takes nothing is asked when a step is made."""
    if not callable(value):
        return False
    try:
        inspect.signature(value).bind()
    except TypeError:
        return True
    except ValueError:  # of compiled functions, which numpy's are: they take an argument
        return True
    return False


def _split(row: Sequence[float], widths: Sequence[int]) -> list[Sequence[float]]:
    stops = np.cumsum([0, *widths])
    return [row[a:b] for a, b in pairwise(stops)]


def _wrong(name: str, found: str, expected: str, fix: str) -> ConfigError:
    return ConfigError(f"the signal {name!r} {found}", expected=expected, fix=fix, key=name)
