"""Clips whose motion is known exactly: patterns, motions and light in closed form.

They test the tracker, and they plan an experiment: what accuracy a pattern, a lens and a
light will allow can be tried before anything is built.

>>> from openprc.vision.synth import cases
>>> clip = cases.case("affine", noise=2.0, n_frames=3, shape=(60, 80))
>>> clip.frame(2).shape
(60, 80)
"""

from openprc.vision.synth.clip import Scene
from openprc.vision.synth.cramer_rao import cramer_rao
from openprc.vision.synth.motions import affine, fold, rotation, standing_wave, translation
from openprc.vision.synth.photometry import Occluder, Photometry
from openprc.vision.synth.textures import miura, speckle

__all__ = [
    "Occluder",
    "Photometry",
    "Scene",
    "affine",
    "cramer_rao",
    "fold",
    "miura",
    "rotation",
    "speckle",
    "standing_wave",
    "translation",
]
