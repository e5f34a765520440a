"""The importer: recognises what PyBullet and its users write, and hands it to its reader."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from openprc.errors import UnreadableFile
from openprc.schema import TrajectoryWriter, safety
from openprc_pybullet import refusals, sniffing, state_log
from openprc_pybullet.contact_log import import_contact_log
from openprc_pybullet.robot_log import import_robot_log
from openprc_pybullet.sensor_log import import_sensor_log
from openprc_pybullet.settings import Settings
from openprc_pybullet.user_csv import peek_header, read_poses
from openprc_pybullet.user_pickle import stack_steps
from openprc_pybullet.user_run import select_run, write_run


class Importer:
    """Imports state logs, and npz, pickle and CSV files of poses."""

    def sniff(self, path: Path) -> float:
        """Say how sure this importer is that it can read, or explain, `path`."""
        return sniffing.sniff(Path(path))

    def import_run(
        self, path: Path, writer: TrajectoryWriter, *, options: Mapping[str, Any]
    ) -> None:
        """Write the run found at `path` into `writer`.

        Raises
        ------
        NotATrajectory
            For snapshots, command logs, profiles and saved worlds, with the reason.
        UnreadableFile
            When it is none of the formats, or damaged.
        UntrustedPickle
            For a pickle, unless ``options["trust"]``.
        MissingDependency
            When link positions are asked for (``urdf``) and PyBullet is not installed.
        OpenPRCError
            For everything else that is wrong with the content, see the readers.
        """
        path = safety.check_readable(path)
        settings = Settings.from_options(options)
        head = refusals.read_head(path)
        refused = refusals.recognise(head)
        if refused is not None:
            raise refusals.refuse(refused, path)
        csv = peek_header(path)
        if head.startswith(b"PK\x03\x04"):
            run = select_run(safety.load_npz(path), path=path, settings=settings)
            write_run(run, writer, settings=settings)
        elif state_log.looks_like_log(path):
            _import_log(path, writer, settings)
        elif head[:1] == b"\x80" or (csv is None and safety.preview_pickle(path) is not None):
            arrays = stack_steps(safety.load_pickle(path, trust=settings.trust), path)
            write_run(select_run(arrays, path=path, settings=settings), writer, settings=settings)
        elif csv is not None:
            _import_csv(path, writer, settings)
        else:
            raise UnreadableFile(
                f"this is none of the files that PyBullet or its users write: it begins with "
                f"{head[:16]!r}",
                expected="a state log, or an .npz, pickle or CSV file of poses",
                fix="record with startStateLogging(STATE_LOGGING_GENERIC_ROBOT, ...), or save "
                "numpy.savez(file, t=times, positions=positions)",
                file=path,
            )


def _import_log(path: Path, writer: TrajectoryWriter, settings: Settings) -> None:
    log = state_log.read_state_log(path)
    family = log.header.family
    if family == "robot":
        import_robot_log(log, writer, path=path, settings=settings)
    elif family == "contacts" and log.records.size:
        import_contact_log(log, writer, path=path, settings=settings)
    else:
        import_sensor_log(log, writer, path=path, settings=settings)


def _import_csv(path: Path, writer: TrajectoryWriter, settings: Settings) -> None:
    poses = read_poses(path, time_key=settings.time_key, without_time=settings.dt is not None)
    run = select_run(poses.arrays, path=path, settings=settings, half_digit=poses.half_digit)
    labels = poses.labels if len(poses.labels or ()) == run.positions.shape[1] else None
    write_run(run, writer, settings=settings, labels=labels)
