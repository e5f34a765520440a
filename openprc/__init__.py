"""OpenPRC: one file, one plugin contract and one pipeline for physical reservoir computing.

Importing this package imports nothing heavy; reach for the sub-packages by name::

    from openprc.schema import Trajectory
    from openprc.demlat import SimulationSetup
"""

__version__ = "1.0.0.dev0"
