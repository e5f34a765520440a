"""The pair of Dormand and Prince of order 5 with an error estimate of order 4.

Steps are chosen; between them there is a continuous solution of order 4 that needs no further
stages. Sources: Dormand & Prince 1980, doi:10.1016/0771-050X(80)90013-3; the continuous
solution as by Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, sec. II.6,
doi:10.1007/978-3-540-78862-1.
"""

from __future__ import annotations

from openprc.demlat.integrators import Settings
from openprc.demlat.integrators.adaptive import Adaptive
from openprc.demlat.integrators.embedded import Tableau
from openprc.demlat.models.barhinge.tables import Body

ROWS = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
ERROR = ((71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40),)
DENSE = (
    (
        -12715105075 / 11282082432,
        0.0,
        87487479700 / 32700410799,
        -10690763975 / 1880347072,
        701980252875 / 199316789632,
        -1453857185 / 822651844,
        69997945 / 29380423,
    ),
)
TABLE = Tableau.of(order=5, rows=ROWS, error=ERROR, error_order=5, dense=DENSE, stages=6)


class RK45:
    """Where the registry finds the pair."""

    @staticmethod
    def for_body(body: Body, settings: Settings) -> Adaptive:
        """Return work arrays for `body`."""
        return Adaptive.of(TABLE, body, settings)
