"""MuJoCo with its Runge-Kutta integrator: a body on three slides a node, a tendon a bar."""

from __future__ import annotations

import mujoco
import numpy as np
from engine_scenes import Scene

from peers.serving import NotExpressible, Run, serve

#: 10,000 nodes end in "could not allocate memory".
MOST_NODES = 2000


def model_source(scene: Scene) -> str:
    """Return the scene in MuJoCo's XML, numbers to the last bit."""
    world, tendons = [], []
    for i, (x, y, z) in enumerate(scene.positions.tolist()):
        if scene.fixed[i]:
            world.append(f'<site name="n{i}" pos="{x!r} {y!r} {z!r}"/>')
            continue
        slides = "".join(
            f'<joint type="slide" axis="{axis}" damping="{float(scene.drag[i])!r}"/>'
            for axis in ("1 0 0", "0 1 0", "0 0 1")
        )
        inertia = f'<inertial pos="0 0 0" mass="{float(scene.masses[i])!r}" diaginertia="1 1 1"/>'
        world.append(f'<body pos="{x!r} {y!r} {z!r}">{slides}{inertia}<site name="n{i}"/></body>')
    rows = zip(
        scene.bars.tolist(),
        scene.stiffness.tolist(),
        scene.rest_length.tolist(),
        scene.damping.tolist(),
        strict=True,
    )
    for (i, j), stiffness, length, damping in rows:
        tendons.append(
            f'<spatial stiffness="{stiffness!r}" springlength="{length!r}" damping="{damping!r}">'
            f'<site site="n{i}"/><site site="n{j}"/></spatial>'
        )
    return (
        f'<mujoco><option timestep="{scene.dt!r}" gravity="0 0 0" integrator="RK4"'
        ' jacobian="sparse"><flag contact="disable" constraint="disable"/></option>'
        f"<worldbody>{''.join(world)}</worldbody><tendon>{''.join(tendons)}</tendon></mujoco>"
    )


def prepare(scene: Scene) -> Run:
    """Return a function that runs n steps."""
    if len(scene.hinges):
        raise NotExpressible("no element resists a dihedral angle")
    if len(scene.positions) > MOST_NODES:
        raise NotExpressible(
            f"not tried beyond {MOST_NODES} nodes: its work space would not fit into memory"
        )
    model = mujoco.MjModel.from_xml_string(model_source(scene))
    data = mujoco.MjData(model)

    def run(n_steps: int) -> np.ndarray:
        mujoco.mj_resetData(model, data)
        mujoco.mj_step(model, data, nstep=n_steps)
        positions = scene.positions.copy()
        positions[~scene.fixed] += data.qpos.reshape(-1, 3)
        return positions

    return run


if __name__ == "__main__":
    serve(prepare)
