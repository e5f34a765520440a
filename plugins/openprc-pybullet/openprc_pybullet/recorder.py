"""The recorder: attaches to a scene whose loop a user's own script runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from openprc.errors import ConfigError, UnsupportedScene
from openprc.schema import TrajectoryWriter
from openprc_pybullet.recorded_bodies import (
    MAXIMAL,
    NODE_CHOICES,
    SOFT,
    BodyTree,
    NodeChoice,
    RigidPart,
    describe_body,
)
from openprc_pybullet.recorded_client import Connection, connect_to
from openprc_pybullet.recorded_contacts import CONTACT_CHOICES, ContactChoice, ContactPart
from openprc_pybullet.recorded_signals import read_signals_option
from openprc_pybullet.recorded_soft import SoftBody, SoftPart, read_soft_option, refuse_hollow
from openprc_pybullet.recorder_session import Session


class Recorder:
    """Records bodies, soft bodies, contacts and commands of a PyBullet scene."""

    def attach(
        self,
        simulator: Any,
        writer: TrajectoryWriter,
        *,
        bodies: Iterable[int] | None = None,
        nodes: NodeChoice = "com",
        soft: Mapping[int, Any] | None = None,
        contacts: bool | ContactChoice = False,
        signals: Mapping[str, Any] | None = None,
        joints: bool = True,
        every: int = 1,
        t0: float = 0.0,
        variable_dt: bool = False,
        limit: float | None = 1e4,
    ) -> Session:
        """Look at the scene and return the session whose ``step`` or ``record`` is called.

        Parameters
        ----------
        simulator : the module pybullet, a BulletClient, or the id of a client
        writer : TrajectoryWriter
        bodies : ids, optional
            Which bodies; all that move or have joints when left out.
        nodes : {"com", "frame"}
            Centres of mass of base and links, or their URDF link frames (the joints).
        soft : mapping of id to the path of its .obj, None, or {"mesh": path, "mass": kg}
            What PyBullet does not tell of soft bodies: faces and mass.
        contacts : bool or {"bodies", "links"}
            Whether contacts become channels, summed for each body (True) or link.
        signals : mapping of name to value, optional
            What the script commands; see `openprc_pybullet.recorded_signals.SignalSpec`.
        joints : bool
            Whether joint positions, velocities and motor torques become channels.
        every : int
            Keep each `every`-th step, beside the first frame.
        t0 : float [s]
            Time of the first frame.
        variable_dt : bool
            Ask for the time step in every step, because the script changes it.
        limit : float, or None
            How many sizes of the scene a node may go from where it began.

        Raises
        ------
        ConfigError
            When an option is wrong, a body is not there, or the client is not connected.
        UnsupportedScene
            When the server runs in real time, nothing moves, or a soft body has no mesh.
        MissingDependency
            When PyBullet cannot be imported.
        """
        _check_choice("nodes", nodes, NODE_CHOICES)
        if not isinstance(contacts, bool):
            _check_choice("contacts", contacts, CONTACT_CHOICES)
        if isinstance(every, bool) or not isinstance(every, int) or every < 1:
            raise _wrong("every", every, "a whole number of steps, 1 or more")
        if limit is not None and not limit > 0:
            raise _wrong("limit", limit, "a positive number, or None for no bounds")
        if not abs(t0) < float("inf"):
            raise _wrong("t0", t0, "a time in s")
        told = read_soft_option(soft)
        specs = read_signals_option(signals)
        connection = connect_to(simulator)
        session = Session(
            connection, writer, specs, every=every, t0=float(t0), variable_dt=variable_dt,
            limit=limit,
        )  # fmt: skip
        trees = _choose(connection, writer, bodies, told)
        rigid = [
            RigidPart(connection, tree, nodes=nodes, joints=joints)
            for tree in trees
            if tree.kind != SOFT
        ]
        parts: list[Any] = [*rigid]
        for tree in trees:
            if tree.kind == SOFT:
                parts.append(SoftPart(connection, tree.body, told.get(tree.body, SoftBody())))
        if contacts:
            if not rigid:
                raise ConfigError(
                    "contacts of soft bodies were asked for",
                    expected="a rigid body: PyBullet tells contacts of those only",
                    fix="leave contacts out, or name the rigid body with bodies",
                    key="contacts",
                )
            parts.append(
                ContactPart(
                    connection,
                    [owner for part in rigid for owner in part.nodes.owners],
                    labels=[label for part in rigid for label in part.nodes.labels],
                    by="bodies" if contacts is True else contacts,
                )
            )
        for note in _remarks(rigid, trees, told, nodes=nodes):
            writer.note(note)
        for body in told.values():
            if body.mesh is not None:
                writer.add_source(body.mesh, role="mesh")
        session.take_parts(parts, [tree.body for tree in trees])
        return session


def _choose(
    connection: Connection,
    writer: TrajectoryWriter,
    bodies: Iterable[int] | None,
    soft: Mapping[int, SoftBody],
) -> list[BodyTree]:
    if not isinstance(bodies, Iterable | None):
        raise _wrong("bodies", bodies, "a list of ids")
    present = connection.body_ids()
    trees = {body: describe_body(connection, body) for body in present}
    for body, tree in trees.items():
        if tree.kind == SOFT:  # recorded or not: it would crash the process
            refuse_hollow(connection, body)
    wanted = None if bodies is None else [*bodies, *soft]
    for body in soft if wanted is None else wanted:
        if isinstance(body, bool) or body not in trees:
            raise ConfigError(
                f"there is no body {body!r}",
                expected=f"some of {', '.join(map(str, present)) or 'none: the scene is empty'}",
                fix="load the scene before recording, and name bodies by the ids that loading "
                "returned",
                key="bodies",
            )
    for body in soft:
        if trees[body].kind != SOFT:
            raise ConfigError(
                f"body {body} ({trees[body].name}) is not soft",
                expected="ids of soft bodies",
                fix="leave it out of soft",
                key="soft",
            )
    if wanted is not None:
        chosen = [trees[body] for body in dict.fromkeys(wanted)]
    else:
        chosen = [tree for tree in trees.values() if tree.moves or tree.kind == SOFT]
        dropped = [f"{t.body} ({t.name})" for t in trees.values() if t not in chosen]
        if dropped:
            writer.note(
                f"left out bodies {', '.join(dropped)}, which have no mass and no joints; name "
                "them with bodies to have them too"
            )
    if not chosen:
        raise UnsupportedScene(
            "nothing in this scene moves" if present else "the scene is empty",
            expected="a body with mass or joints",
            fix="load it before recording, or name what to record with bodies",
            key="bodies",
        )
    return chosen


def _remarks(
    rigid: list[RigidPart],
    trees: list[BodyTree],
    soft: Mapping[int, SoftBody],
    *,
    nodes: NodeChoice,
) -> list[str]:
    found = []
    if rigid:
        found.append(
            "velocities are those of PyBullet's semi-implicit steps, x_n = x_(n-1) + v_n dt: read "
            "as a leapfrog, v_n belongs to half a step before its frame"
        )
    if any(part.tree.links for part in rigid):
        found.append(
            "bars join every link to its parent; rest_length is their length in the first frame"
        )
    if nodes == "frame" and rigid:
        found.append("nodes are the origins of the URDF link frames; masses sit elsewhere")
    for tree in trees:
        if tree.kind == MAXIMAL:
            found.append(
                f"body {tree.body} is in maximal coordinates: PyBullet tells its base only"
            )
        elif tree.kind == SOFT:
            told = soft.get(tree.body, SoftBody())
            if told.mesh is None:
                found.append(f"no faces of soft body {tree.body}: no mesh file was named")
            found.append(f"no velocities of soft body {tree.body}: PyBullet does not tell them")
        many = [link.joint for link in tree.links if link.joint_type in (2, 3)]
        if many:
            found.append(
                f"joints {', '.join(many)} of body {tree.body} turn in several ways and have no "
                "channel; the links that they carry are recorded"
            )
    return found


def _check_choice(name: str, value: object, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise _wrong(name, value, "one of " + ", ".join(choices))


def _wrong(name: str, value: object, expected: str) -> ConfigError:
    return ConfigError(f"{name} is {value!r}", expected=expected, fix="correct it", key=name)
