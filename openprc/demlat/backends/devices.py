"""What this machine has: NVIDIA devices with a compiler for them, and JAX."""

from __future__ import annotations

import ctypes
import os
import sys
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec

#: Platforms of JAX that are faster than a CPU.
ACCELERATORS = ("gpu", "cuda", "rocm", "tpu")
#: The attribute came with JAX 0.8.
_JAX_SCOPE = "enable_x64"
_ON_A_CPU = "jax has neither GPU nor TPU here, and on a CPU the compiled kernels are faster"


@dataclass(frozen=True)
class Probe:
    """What was found of a back end.

    Attributes
    ----------
    present : bool
        Whether there is a device (CUDA), or the package (JAX).
    usable : bool
        Whether it can run.
    accelerated : bool
        Whether that is on a device of its own.
    found : str
        In words, for remarks and errors.
    missing : str
        What has to be installed where it is present and not usable.
    """

    present: bool
    usable: bool
    accelerated: bool
    found: str
    missing: str = ""


def n_nvidia_devices() -> int:
    """Return how many devices the NVIDIA driver sees; 0 where there is no driver."""
    name = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"
    try:
        driver = ctypes.CDLL(name)
    except OSError:
        return 0
    count = ctypes.c_int(0)
    if driver.cuInit(0) != 0 or driver.cuDeviceGetCount(ctypes.byref(count)) != 0:
        return 0
    return count.value


def cuda_is_simulated() -> bool:
    """Say whether numba was told to simulate CUDA."""
    return os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("", "0")


def probe_cuda() -> Probe:
    """Return whether there is an NVIDIA device and what compiles for it."""
    if cuda_is_simulated():
        return Probe(True, True, False, "numba simulates CUDA (NUMBA_ENABLE_CUDASIM is set)")
    count = n_nvidia_devices()
    if count == 0:
        return Probe(False, False, False, "no NVIDIA device was found")
    found = f"{count} NVIDIA device{'s' * (count > 1)}"
    try:
        usable = bool(import_module("numba.cuda").is_available())
    except ImportError:
        usable = False
    if not usable:
        return Probe(True, False, False, f"{found}, and nothing that compiles for it",
                     "numba-cuda and the CUDA toolkit's compiler")  # fmt: skip
    return Probe(True, True, True, found)


def probe_jax(*, only_accelerated: bool) -> Probe:
    """Return whether JAX is there and what it computes on.

    Parameters
    ----------
    only_accelerated : bool
        Do not import JAX, which takes a second, where it has no package for a device.
    """
    if find_spec("jax") is None:
        return Probe(False, False, False, "jax is not installed")
    if only_accelerated and not (find_spec("jax_plugins") or find_spec("libtpu")):
        return Probe(True, True, False, _ON_A_CPU)
    try:
        jax = import_module("jax")
    except ImportError as error:
        return Probe(True, False, False, f"jax cannot be imported ({error})", "a working jax")
    if not hasattr(jax, _JAX_SCOPE):
        return Probe(True, False, False, f"jax {jax.__version__}", "jax 0.8 or newer")
    try:
        platform = jax.default_backend()
    except RuntimeError as error:
        return Probe(True, False, False, f"jax does not start ({error})", "a working jax")
    accelerated = platform in ACCELERATORS
    found = f"jax runs on {platform}" if accelerated else _ON_A_CPU
    return Probe(True, True, accelerated, found)
