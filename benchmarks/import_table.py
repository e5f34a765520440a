"""What becomes of real files of other programs: who reads them, and how far from the truth.

    python benchmarks/import_table.py --data FOLDER [--json FILE]

The folder holds third-party runs (merlin, pyelastica, pybullet, upstream), as the tests use them
where they are present. Truth is read from the files by other means than the importers: scipy for
MAT files, NumPy and pickle for arrays, what a live simulator said for logs, closed forms, and the
balance of forces of every saved state for MERLIN. A refused file is listed with its reason.
"""

from __future__ import annotations

import argparse
import json
import pickle
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.io import loadmat

from openprc.errors import OpenPRCError
from openprc.hooks import import_file
from openprc.schema import Trajectory

Truth = Callable[[Trajectory, Path], tuple[str, float]]


@dataclass
class File:
    """A file, how it is imported, and what it is held against."""

    path: str
    truth: Truth | None = None
    options: dict[str, Any] = field(default_factory=dict)
    trust: bool = False
    label: str = ""


# --- MERLIN -------------------------------------------------------------------------------------


def merlin_positions(run: Trajectory, path: Path) -> tuple[str, float]:
    """Rest state first, then node plus displacement, column by column."""
    mat = loadmat(path, mat_dtype=True)
    u = mat["U_his"] if "U_his" in mat else mat["Uhis"]
    node = mat["truss"][0, 0]["Node"]
    moved = node + u.T.reshape(-1, len(node), 3)
    wanted = np.concatenate([node[None], moved])
    return "node + displacement", float(np.abs(run.positions() - wanted).max())


def same_as(other: str) -> Truth:
    """Hold a repacked file against the positions of the original."""

    def compare(run: Trajectory, path: Path) -> tuple[str, float]:
        return f"truss of {other}", merlin_positions(run, path.parent / other)[1]

    return compare


def obj_frames(run: Trajectory, path: Path) -> tuple[str, float]:
    mat = loadmat(path.parent / "merlin2_gmiura_n5b8_disp.mat", mat_dtype=True)
    node = mat["truss"][0, 0]["Node"]
    moved = node + mat["Uhis"].T.reshape(-1, len(node), 3)
    states = np.concatenate([node[None], moved])
    steps = [int(file.stem.split("_")[1]) for file in sorted(path.glob("*.obj"))]
    return "MAT file of the run", float(np.abs(run.positions() - states[steps]).max())


# --- PyElastica ---------------------------------------------------------------------------------


def axial(run: Trajectory, path: Path) -> tuple[str, float]:
    """A rod of L = 1 m, radius 25 mm and E = 10 kPa under F = 1 N settles at F L / (A E - F)."""
    del path
    wanted = 1.0 / (np.pi * 0.025**2 * 1e4 - 1.0)
    stretch = float(run.positions()[-1, -1].max()) - 1.0
    return "F L / (A E - F), relative", abs(stretch / wanted - 1.0)


def stacked(key: str) -> Truth:
    """Hold positions against the array of the file, transposed."""

    def compare(run: Trajectory, path: Path) -> tuple[str, float]:
        wanted = np.load(path)[key].transpose(0, 2, 1)
        return "array of the file", float(np.abs(run.positions() - wanted).max())

    return compare


def two_rods(run: Trajectory, path: Path) -> tuple[str, float]:
    arrays = np.load(path)
    parts = [arrays[f"{kind}_position"].transpose(0, 2, 1) for kind in ("shearable", "unshearable")]
    wanted = np.concatenate(parts, axis=1)
    return "arrays of the file", float(np.abs(run.positions() - wanted).max())


def callbacks(run: Trajectory, path: Path) -> tuple[str, float]:
    """Hold positions against a pickled dict of lists, one sample an instant."""
    with path.open("rb") as stream:
        kept = pickle.load(stream)
    times = np.array(kept["time"], dtype=float)
    samples = [np.asarray(sample).T for sample in kept["position"]]
    rows = [int(np.flatnonzero(times == time)[-1]) for time in run.time]
    wanted = np.array([samples[row] for row in rows])
    return "pickled samples", float(np.abs(run.positions() - wanted).max())


def chunks(run: Trajectory, path: Path) -> tuple[str, float]:
    files = [np.load(file) for file in sorted(path.glob("*.npz"))]
    wanted = np.concatenate([file["position"] for file in files]).transpose(0, 2, 1)
    return "arrays of the chunks", float(np.abs(run.positions() - wanted).max())


# --- PyBullet -----------------------------------------------------------------------------------


def kuka(run: Trajectory, path: Path) -> tuple[str, float]:
    truth = np.load(path.with_name("kuka_ik_circle_truth.npz"))
    links = np.abs(run.positions()[:, 1:] - truth["link_com_pos"][1:]).max()
    base = np.abs(run.positions()[:, 0] - truth["base_pos"][1:]).max()
    return "live links and base", float(max(links, base))


def chain(run: Trajectory, path: Path) -> tuple[str, float]:
    truth = np.load(path.with_name("pendulum5_chain_truth.npz"))
    return "live links", float(np.abs(run.positions()[:, 1:] - truth["pos"][1:]).max())


def robot(run: Trajectory, path: Path) -> tuple[str, float]:
    truth = np.load(path.with_name("r2d2_drive_truth_every4.npz"))
    rows = np.rint(truth["t"][1:] * 240).astype(int) - 1
    found = run.positions()[rows]
    links = np.abs(found[:, 1:16] - truth["r2d2_link_com_pos"][1:]).max()
    cube = np.abs(found[:, 16] - truth["cube_base_pos"][1:]).max()
    return "live links and cube", float(max(links, cube))


def robot_bases(run: Trajectory, path: Path) -> tuple[str, float]:
    truth = np.load(path.with_name("r2d2_drive_truth_every4.npz"))
    rows = np.rint(truth["t"][1:] * 240).astype(int) - 1
    found = run.positions()[rows, 0]
    return "live base", float(np.abs(found - truth["r2d2_base_pos"][1:]).max())


def robot_csv(run: Trajectory, path: Path) -> tuple[str, float]:
    truth = np.load(path.with_name("r2d2_drive_truth_every4.npz"))
    found = run.positions()[::4, 0]
    return "live base (6 decimals)", float(np.abs(found - truth["r2d2_base_pos"]).max())


def user_steps(run: Trajectory, path: Path) -> tuple[str, float]:
    with path.open("rb") as stream:
        steps = pickle.load(stream)
    wanted = np.array([step["links"] for step in steps], dtype=float)
    return "pickled links", float(np.abs(run.positions() - wanted).max())


def cloth(run: Trajectory, path: Path) -> tuple[str, float]:
    return "vertices", float(np.abs(run.positions() - np.load(path)["vertices"]).max())


def plain_array(key: str) -> Truth:
    def compare(run: Trajectory, path: Path) -> tuple[str, float]:
        wanted = np.load(path)[key]
        return f"array {key}", float(np.abs(run.positions() - wanted).max())

    return compare


# --- older package ------------------------------------------------------------------------------


def stored(run: Trajectory, path: Path) -> tuple[str, float]:
    file_path = path / "output" / "simulation.h5" if path.is_dir() else path
    with h5py.File(file_path, "r") as file:
        wanted = file["time_series/nodes/positions"][()].astype("f8")
    return "stored positions", float(np.abs(run.positions() - wanted[:, :, : run.dims]).max())


def tracked(run: Trajectory, path: Path) -> tuple[str, float]:
    with h5py.File(path, "r") as file:
        key = "trajectories" if "trajectories" in file else "time_series/nodes/positions"
        wanted = file[key][()].astype("f8")[:, :, : run.dims]
    gaps = np.isnan(run.positions()) & np.isnan(wanted)
    return "stored positions", float(np.abs(np.where(gaps, 0, run.positions() - wanted)).max())


FILES = [
    *(
        File(f"merlin/{name}", merlin_positions, {"verify": "true"})
        for name in (
            "merlin1_kresling_folding.mat", "merlin1_miura_bending.mat",
            "merlin1_miura_bistable.mat", "merlin1_miura_folding.mat",
            "merlin1_miura_folding_min_v7layout_synthetic.mat",
            "merlin2_gmiura_n5b8_disp.mat", "merlin2_kresling_n4b5_disp.mat",
            "merlin2_polygon_n5b8_force.mat", "merlin2_simplefold_n4b5_disp.mat",
            "merlin2_waterbomb_n5b8_disp.mat",
        )
    ),
    File("merlin/merlin2_kresling_n4b5_disp_octave.h5", same_as("merlin2_kresling_n4b5_disp.mat"),
         {"verify": "true"}),
    File("merlin/merlin2_kresling_n4b5_disp_v73layout_synthetic.mat",
         same_as("merlin2_kresling_n4b5_disp.mat"), {"verify": "true"}),
    File("merlin/gmiura_obj", obj_frames),
    File("merlin/sibling_simfast_OrigamiUhis.mat"),
    File("pyelastica/axial_stretching_full.npz", axial),
    File("pyelastica/axial_stretching_full.npz", stacked("position")),
    File("pyelastica/axial_stretching_data.dat", trust=True),
    File("pyelastica/butterfly_data.dat", callbacks, trust=True),
    File("pyelastica/flexible_swinging_pendulum.dat", callbacks, trust=True),
    File("pyelastica/continuum_snake.dat", callbacks, trust=True),
    File("pyelastica/snake_export", chunks),
    File("pyelastica/timoshenko_two_rods.npz", two_rods),
    File("pyelastica/timoshenko_shearable_rod.dat", trust=True),
    File("pyelastica/timoshenko_unshearable_DIVERGED.npz"),
    File("pybullet/kuka_ik_circle.log", kuka, {"urdf": ("1=kuka_iiwa/model.urdf",)}),
    File("pybullet/pendulum5_chain.log", chain, {"urdf": ("CHAIN",)}),
    File("pybullet/r2d2_drive_all.log", robot, {"urdf": ("1=r2d2.urdf", "2=cube.urdf")}),
    File("pybullet/r2d2_drive_all.log", robot_bases, label="without models"),
    File("pybullet/r2d2_drive_contacts.log"),
    File("pybullet/r2d2_base.csv", robot_csv),
    File("pybullet/r2d2_drive_truth_every4.npz", plain_array("r2d2_link_com_pos"),
         {"position_key": "r2d2_link_com_pos"}),
    File("pybullet/kuka_ik_circle_truth.npz", plain_array("link_com_pos")),
    File("pybullet/pendulum5_chain_truth.npz", plain_array("pos")),
    File("pybullet/laikago_replay.log", None, {"urdf": ("laikago/laikago_toes.urdf",)}),
    File("pybullet/laikago_replay_user.pkl", user_steps, trust=True),
    File("pybullet/minitaur_8motor.bin"),
    File("pybullet/minitaur_generic_dof16.log"),
    File("pybullet/minitaur_generic_default_dof12_OVERFLOW.log"),
    File("pybullet/cloth_drop.npz", cloth),
    File("pybullet/cloth_generic.log"),
    File("pybullet/kuka_block_grasp_vr_2017.bin"),
    File("pybullet/cubes_t100.bullet"),
    File("pybullet/cubes_t100_poses.csv"),
    File("pybullet/cubes_t100_saveWorld.py.txt"),
    File("upstream/lattice_3x3_gen0", stored),
    File("upstream/lattice_4x4_gen0", stored),
    File("upstream/lab/experiment.h5", tracked),
    File("upstream/lab/tracking_data.h5", tracked),
    File("upstream/metrics_ga.h5"),
    File("upstream/yoshimura"),
]  # fmt: skip


def chain_urdf(path: Path, *, links: int = 5, length: float = 0.2, mass: float = 0.1) -> Path:
    """Write the model of the pendulum chain: point masses below massless links, turning about y."""
    nothing = '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    parts = [f'<robot name="chain"><link name="base"><inertial><mass value="0"/>{nothing}']
    for n in range(links):
        parts.append(
            f'<link name="bob{n}"><inertial><origin xyz="0 0 -{length}"/><mass value="{mass}"/>'
            f'{nothing}<joint name="joint{n}" type="continuous">'
            f'<parent link="{f"bob{n - 1}" if n else "base"}"/><child link="bob{n}"/>'
            f'<origin xyz="0 0 {-length if n else 0.0}"/><axis xyz="0 1 0"/></joint>'
        )
    path.write_text("".join([*parts, "</robot>"]))
    return path


def measure(file: File, data: Path, scratch: Path) -> dict[str, Any]:
    """Import one file and compare."""
    source = data / file.path
    options = dict(file.options)
    if options.get("urdf") == ("CHAIN",):
        options["urdf"] = (str(chain_urdf(scratch / "chain.urdf")),)
    row: dict[str, Any] = {"file": " ".join(filter(None, (file.path, file.label)))}
    out = scratch / "out.h5"
    try:
        run = import_file(source, out, options=options, trust=file.trust, overwrite=True)
    except OpenPRCError as error:
        return row | {"refused": f"{type(error).__name__}: {error.found}"}
    row |= {
        "as": run.producer, "nodes": run.n_nodes, "frames": run.n_frames,
        "channels": run.n_channels, "time": run.time_kind,
    }  # fmt: skip
    residual = next((note for note in run.notes if "residual" in note), "")
    if residual:
        row["balance of forces"] = residual
    if file.truth is not None:
        with Trajectory(out) as found:
            row["held against"], row["largest deviation"] = file.truth(found, source)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of third-party runs")
    parser.add_argument("--json", type=Path, help="write the figures here")
    arguments = parser.parse_args()
    console = Console()
    with tempfile.TemporaryDirectory() as name:
        rows = [measure(file, arguments.data, Path(name)) for file in FILES]
    table = Table(title="files of other programs")
    for head in ("file", "as", "nodes", "frames", "channels", "held against", "deviation"):
        table.add_column(head, overflow="fold")
    for row in rows:
        if "refused" in row:
            table.add_row(row["file"], "refused", "", "", "", row["refused"], "")
            continue
        deviation = row.get("largest deviation")
        held = row.get("held against", "")
        if "balance of forces" in row:
            held = f"{held}; {row['balance of forces']}"
        table.add_row(
            row["file"], row["as"], *(str(row[k]) for k in ("nodes", "frames", "channels")), held,
            "" if deviation is None else f"{deviation:.2g}",
        )  # fmt: skip
    console.print(table)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
