"""Runners with one mistake each."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
from verlet_code import VerletRunner

from openprc.hooks.protocols import Modelled
from openprc.schema.dihedral import dihedral_angles


class Restless(VerletRunner):
    def start(self, x, v):
        return x, v + 1e-12 * np.random.default_rng().standard_normal(v.shape) * [1.0, 0.0, 0.0]


class Deaf(VerletRunner):
    def tell(self, progress, fraction):
        pass


class Swallowing(VerletRunner):
    def tell(self, progress, fraction):
        with contextlib.suppress(KeyboardInterrupt):
            progress(fraction, "running")


class Counting:
    """An experiment with another number of frames."""

    def __init__(self, experiment):
        self.experiment = experiment
        self.n_frames = int(experiment.duration / experiment.save_interval) + 1

    def __getattr__(self, name):
        return getattr(self.experiment, name)


class Truncating(VerletRunner):
    def run(self, experiment, writer, *, seed, progress):
        super().run(Counting(experiment), writer, seed=seed, progress=progress)


class Stepped(VerletRunner):
    def start(self, x, v):
        return x + self.experiment.dt * (v + ~self.body.fixed[:, None] * [1.0, 0.0, 0.0]), v


class Delayed(VerletRunner):
    def recorded(self, signal, time):
        return super().recorded(signal, max(0.0, time - self.experiment.save_interval))


class Massless(VerletRunner):
    def declare(self, writer):
        class Hiding:
            def __getattr__(self, name):
                return getattr(writer, name)

            def declare_nodes(self, *given, mass, **more):
                writer.declare_nodes(*given, **more)

        super().declare(Hiding())


class Printing(VerletRunner):
    def declare(self, writer):
        super().declare(writer)
        print("verlet: running")
        with Path("verlet.log").open("a") as stream:
            stream.write("running\n")


class Dragless(VerletRunner):
    def slowing(self, v):
        return 0.0 * v


class Ruthless(VerletRunner):
    def run(self, experiment, writer, *, seed, progress):
        self.supports = lambda experiment: []
        super().run(experiment, writer, seed=seed, progress=progress)


class Lettered(VerletRunner):
    def models(self, experiment):
        return Modelled(leaves_out="cables")


class Untyped(VerletRunner):
    def models(self, experiment):
        return ["cables"]


class Weaker(VerletRunner):
    def gravity(self):
        return super().gravity() * (9.5 / 9.81)


class Stiffer(VerletRunner):
    def stiffness(self):
        return 1.05 * super().stiffness()


class Undamped(VerletRunner):
    def dashpot(self):
        return 0.0 * super().dashpot()


class Selfish(VerletRunner):
    def pull(self, total, i, j, pull):
        np.subtract.at(total, j, pull)


class Rounded(VerletRunner):
    def relaxed(self):
        return np.round(super().relaxed(), 3)


class Softened(VerletRunner):
    def supports(self, experiment):
        return [item for item in super().supports(experiment) if item.path != "rigid bars"]

    def stiffness(self):
        return np.where(self.body.bars.rigid, 10.0, 1.0) * super().stiffness()


class Linearised(VerletRunner):
    def add_bars(self, total, x, v):
        i, j = self.pairs.T
        first = self.body.positions[j] - self.body.positions[i]
        unit = first / np.linalg.norm(first, axis=1)[:, None]
        stretch = ((x[j] - x[i]) * unit).sum(axis=1) - self.relaxed()
        rate = ((v[j] - v[i]) * unit).sum(axis=1)
        tension = self.stiffness() * stretch + self.dashpot() * rate
        self.pull(total, i, j, tension[:, None] * unit)


class Averaged(VerletRunner):
    def masses(self):
        return np.full(self.body.n_nodes, self.body.masses.mean())


class Creased(VerletRunner):
    def hinge_stiffness(self):
        rest = dihedral_angles(self.body.positions[None], self.body.hinges.indices)[0]
        return np.where(rest == self.body.hinges.rest_angle, 1.0, 0.5) * super().hinge_stiffness()


class Bent(VerletRunner):
    def bend_stiffness(self):
        return 2.0 * super().bend_stiffness()


class Sticky(VerletRunner):
    def slowing(self, v):
        return super().slowing(v) + 0.003 * self.masses()[:, None] * v


class Amnesic(VerletRunner):
    """Stores where the force of this instant would hold the body in balance."""

    def append(self, writer, time, x, v):
        if len(self.body.masses) > 8:
            still = self.body.positions.copy()
            for name, signal in self.driving().items():
                still[-1, 1] += 0.1 * self.recorded(signal, time)[0] * (name != "")
            x = still
        super().append(writer, time, x, v)
