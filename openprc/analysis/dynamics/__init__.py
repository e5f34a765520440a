"""Dynamics of a driven body: consistency, Lyapunov exponents, echo-state time."""

from openprc.analysis.dynamics.echo_state import (
    MemoryTime,
    ReplicaTest,
    memory_time,
    replica_test,
)
from openprc.analysis.dynamics.lyapunov import (
    LyapunovExponents,
    lyapunov_exponent,
    lyapunov_spectrum,
)
from openprc.analysis.dynamics.recorded import (
    Replicas,
    consistency_of_files,
    convergence_of_files,
    read_replicas,
)
from openprc.analysis.dynamics.replica_consistency import Consistency, consistency
from openprc.analysis.dynamics.replica_convergence import Convergence, convergence

__all__ = [
    "Consistency",
    "Convergence",
    "LyapunovExponents",
    "MemoryTime",
    "ReplicaTest",
    "Replicas",
    "consistency",
    "consistency_of_files",
    "convergence",
    "convergence_of_files",
    "lyapunov_exponent",
    "lyapunov_spectrum",
    "memory_time",
    "read_replicas",
    "replica_test",
]
