"""Back ends beside the compiled CPU kernels: CUDA and JAX, and which of them is used.

Neither numba's CUDA target nor JAX is imported before a back end is chosen.
"""

from __future__ import annotations

from openprc.demlat.backends.choose import Choice, choose_backend, refusals
from openprc.demlat.backends.rollout import jax_rollout

__all__ = ["Choice", "choose_backend", "jax_rollout", "refusals"]
