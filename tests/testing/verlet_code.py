"""A plain runner in NumPy: velocity Verlet for springs, hinges, bends, gravity and drag.

Every step is a method of its own, so that a fault replaces one and leaves the others right.
"""

from __future__ import annotations

import numpy as np

from openprc.hooks.protocols import Modelled
from openprc.hooks.running import refuse_unsupported
from openprc.schema import Finding
from openprc.schema.bend_angle import bend_angles
from openprc.schema.dihedral import dihedral_angles
from openprc.testing.simulations import commanded


class VerletRunner:
    def supports(self, experiment):
        body = experiment.geometry
        wrong = {
            "rigid bars": bool(body.bars.rigid.any() or body.hinges.rigid.any()),
            "bars of another law": bool((body.bars.law != "linear").any()),
            "prescribed motion": any(a.type != "force" for a in experiment.actuators),
            "contact": experiment.collision.enabled,
            "damped hinges": bool(body.hinges.damping.any() or body.bends.damping.any()),
        }
        return [
            Finding("V-1", "error", what, f"{what} in the scene", "a scene without", "leave it out")
            for what, there in wrong.items()
            if there
        ]

    def models(self, experiment):
        cables = bool((experiment.geometry.bars.law == "cable").any())
        return Modelled(leaves_out=("cables: a law that is refused",) if cables else ())

    def run(self, experiment, writer, *, seed, progress):
        refuse_unsupported(self.supports(experiment), producer="verlet")
        self.experiment, self.body = experiment, experiment.geometry
        self.pairs = self.body.bars.indices
        self.drag = experiment.drag
        self.declare(writer)
        x, v = self.start(self.body.positions.copy(), self.body.velocities.copy())
        h = experiment.dt
        self.append(writer, self.instant(0), x, v)
        force = self.force(x, v, 0.0)
        step = 0
        for frame in range(1, experiment.n_frames):
            for _ in range(experiment.steps_per_frame):
                half = v + 0.5 * h * self.acceleration(force)
                x = x + h * half
                step += 1
                # Forces that depend on the velocity: one correction makes them second order.
                force = self.force(x, half + 0.5 * h * self.acceleration(force), step * h)
                v = half + 0.5 * h * self.acceleration(force)
            self.append(writer, self.instant(frame), x, v)
            self.tell(progress, frame / (experiment.n_frames - 1))

    def start(self, x, v):
        return x, v

    def instant(self, frame):
        return frame * self.experiment.save_interval

    def tell(self, progress, fraction):
        progress(fraction, "running")

    def declare(self, writer):
        body = self.body
        writer.declare_nodes(
            body.n_nodes, 3, unit="m", velocities=True, mass=body.masses, fixed=body.fixed
        )
        if len(self.pairs):
            writer.declare_elements("bars", self.pairs, series={"length": "m"})
        for name, signal in self.driving().items():
            given = {}
            if signal.sequence is not None:
                given = {"sequence": signal.sequence, "hold": signal.hold, "start": 0.0}
            columns = ["value"] if signal.values.shape[1] == 1 else list("xyz")
            writer.declare_input(name, columns, quantity="force", unit="N", **given)

    def driving(self):
        names = dict.fromkeys(actuator.signal for actuator in self.experiment.actuators)
        return {name: self.experiment.signals[name] for name in names}

    def append(self, writer, time, x, v):
        content = {}
        if len(self.pairs):
            content["elements"] = {("bars", "length"): self.lengths(x)}
        drives = {name: self.recorded(signal, time) for name, signal in self.driving().items()}
        writer.append(time, positions=x, velocities=v, inputs=drives, **content)

    def lengths(self, x):
        i, j = self.pairs.T
        return np.linalg.norm(x[j] - x[i], axis=1)

    def recorded(self, signal, time):
        return commanded(signal, np.array([time]))[0]

    # --- forces --------------------------------------------------------------------------------

    def acceleration(self, force):
        masses = self.masses()
        return np.where(self.body.fixed[:, None], 0.0, force / masses[:, None])

    def masses(self):
        return self.body.masses

    def force(self, x, v, time):
        total = self.gravity() - self.slowing(v)
        if len(self.pairs):
            self.add_bars(total, x, v)
        if len(self.body.bends):
            self.add_bends(total, x)
        if len(self.body.hinges):
            self.add_hinges(total, x)
        for actuator in self.experiment.actuators:
            value = commanded(self.experiment.signals[actuator.signal], np.array([time]))[0]
            total[actuator.node] += np.where(actuator.axes, value, 0.0)
        return total

    def gravity(self):
        return self.masses()[:, None] * np.array(self.experiment.gravity)

    def slowing(self, v):
        return self.drag[:, None] * v

    def add_bars(self, total, x, v):
        i, j = self.pairs.T
        arm = x[j] - x[i]
        length = np.sqrt((arm * arm).sum(axis=1))
        unit = arm / length[:, None]
        rate = ((v[j] - v[i]) * unit).sum(axis=1)
        tension = self.stiffness() * (length - self.relaxed()) + self.dashpot() * rate
        pull = tension[:, None] * unit
        self.pull(total, i, j, pull)

    def pull(self, total, i, j, pull):
        np.add.at(total, i, pull)
        np.subtract.at(total, j, pull)

    def stiffness(self):
        return self.body.bars.stiffness

    def relaxed(self):
        return self.body.bars.relaxed_length

    def dashpot(self):
        return self.body.bars.damping

    def bend_stiffness(self):
        return self.body.bends.stiffness

    def hinge_stiffness(self):
        return self.body.hinges.stiffness

    def add_bends(self, total, x):
        bends = self.body.bends
        angle = bend_angles(x[None], bends.indices)[0]
        a, b, c = bends.indices.T
        u, w = x[a] - x[b], x[c] - x[b]
        normal = np.cross(u, w)
        size = np.linalg.norm(normal, axis=1, keepdims=True)
        # Straight: the direction in which it bends is not defined, and neither is needed.
        normal = np.divide(normal, size, out=np.zeros_like(normal), where=size > 1e-14)
        torque = (self.bend_stiffness() * (angle - bends.rest_angle))[:, None]
        # The angle grows where an arm turns away from the other one.
        at_a = -torque * np.cross(u, normal) / (u * u).sum(axis=1, keepdims=True)
        at_c = torque * np.cross(w, normal) / (w * w).sum(axis=1, keepdims=True)
        np.add.at(total, a, at_a)
        np.add.at(total, c, at_c)
        np.add.at(total, b, -(at_a + at_c))

    def add_hinges(self, total, x):
        hinges = self.body.hinges
        angle = dihedral_angles(x[None], hinges.indices)[0]
        j, k, i, l = hinges.indices.T  # noqa: E741
        ij, kj, kl = x[i] - x[j], x[k] - x[j], x[k] - x[l]
        m, n = np.cross(ij, kj), np.cross(kj, kl)
        size = np.sqrt((kj * kj).sum(axis=1, keepdims=True))
        at_i = size * m / (m * m).sum(axis=1, keepdims=True)
        at_l = -size * n / (n * n).sum(axis=1, keepdims=True)
        p = (ij * kj).sum(axis=1, keepdims=True) / size**2
        q = (kl * kj).sum(axis=1, keepdims=True) / size**2
        torque = (self.hinge_stiffness() * (angle - hinges.rest_angle))[:, None]
        for node, gradient in (
            (i, at_i), (l, at_l),
            (j, (p - 1.0) * at_i - q * at_l), (k, (q - 1.0) * at_l - p * at_i),
        ):  # fmt: skip
            np.add.at(total, node, -torque * gradient)
