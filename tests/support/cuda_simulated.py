"""Run scenes on numba's CUDA simulator, in a process of its own: ``cuda_simulated.py OUT.npz``.

The simulator is chosen by NUMBA_ENABLE_CUDASIM before numba is imported. It runs kernels as
Python, one thread of the device at a time, so scenes are small and blocks have few threads.
"""

import sys
from dataclasses import replace

import numpy as np
from backend_scenes import scene_of_every_law, scene_of_linear_laws, scene_with_printed_damping

from openprc.demlat import BarHingeModel
from openprc.demlat.backends.cuda_run import CudaRun
from openprc.errors import Diverged


def frames_of(run):
    blocks = [[np.array(column) for column in block] for _, block in run.blocks()]
    return [np.concatenate(column) for column in zip(*blocks, strict=True)]


def main(out):
    laws, printed, linear = (
        scene_of_every_law(),
        scene_with_printed_damping(),
        scene_of_linear_laws(),
    )
    results = {
        "laws forces": CudaRun(laws).forces(),
        "printed forces": CudaRun(printed).forces(),
        "message": "nothing",
    }
    runs = {
        "laws": CudaRun(laws, one_block=False),
        "laws again": CudaRun(laws, one_block=False),
        "laws in one block": CudaRun(laws, one_block=True, threads=3),
        "printed": CudaRun(printed, one_block=False),
        "linear": CudaRun(linear, one_block=False),
    }
    for name, run in runs.items():
        for number, column in enumerate(frames_of(run)):
            results[f"{name} {number}"] = column
    short = replace(linear, duration=linear.save_interval)
    model = BarHingeModel(short, backend="cuda")
    results["from the model"] = np.concatenate([block.x.copy() for _, block in model.blocks()])
    results["remarks"] = "\n".join(model.remarks())
    try:
        frames_of(
            CudaRun(replace(linear, dt=1.0, save_interval=1.0, duration=20.0), one_block=False)
        )
    except Diverged as error:
        results["message"] = str(error)
    np.savez(out, **results)


if __name__ == "__main__":
    main(sys.argv[1])
