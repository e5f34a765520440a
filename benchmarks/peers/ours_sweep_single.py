"""This package's ensembles in float32, displacements from the start."""

from openprc.demlat.compiled.scene_packing import WIDTH
from peers.ours_sweep import THREADS, sweep
from peers.serving import serve

if __name__ == "__main__":
    serve(sweep("float32"), threads=THREADS, scenes=THREADS * WIDTH["float32"])
