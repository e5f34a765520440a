"""Logs without nodes: contacts, the Minitaur, and containers with columns of their own."""

import struct

import numpy as np
import pytest
from openprc_pybullet.contact_log import sum_over_pairs
from openprc_pybullet.state_log import read_state_log

from openprc.errors import Diverged, MissingData, NotATrajectory, UnsafeFile

MARK = b"\xaa\xbb"
CONTACTS = (
    "stepCount,timeStamp,contactFlag,bodyUniqueIdA,bodyUniqueIdB,linkIndexA,linkIndexB,"
    "positionOnAX,positionOnAY,positionOnAZ,positionOnBX,positionOnBY,positionOnBZ,"
    "contactNormalOnBX,contactNormalOnBY,contactNormalOnBZ,contactDistance,normalForce"
)
LETTERS = "IfIiiiifffffffffff"


def contact(step, a, b, normal, force):
    zero = [0.0] * 6
    return MARK + struct.pack(
        "<" + LETTERS, step, step / 64, 0, a, b, -1, -1, *zero, *normal, 0.0, force
    )


def contact_header():
    return f"{CONTACTS}\n{LETTERS}\n".encode()


def test_forces_of_a_resting_robot_carry_its_weight(pb_import, data):
    run = pb_import(data / "r2d2_drive_contacts.log")
    assert (run.dims, run.n_frames) == (0, 720)
    assert run.channel_columns("contact_force") == ("0-1.x", "0-1.y", "0-1.z")
    normal = run.channel("contact_normal_force", unit="N")[:, 0]
    # 65.24 kg: the sum over the last second is the weight to 1 %.
    assert normal[-240:].mean() == pytest.approx(640.0, rel=0.01)
    np.testing.assert_allclose(run.channel("contact_force")[-240:, 2].mean(), 638.6, rtol=0.01)
    log = read_state_log(data / "r2d2_drive_contacts.log")
    assert run.channel("contact_count").sum() == log.records.size == 6693
    assert normal.sum() == pytest.approx(float(log.records["normalForce"].astype("f8").sum()))
    # It falls from 1 m first: no record, no contact.
    assert not run.channel("contact_count")[:79].any()
    assert run.channel("contact_count")[79] > 0
    assert run.time[0] == pytest.approx(1 / 240)


def test_pairs_and_signs(pb_import, write_log):
    path = write_log(
        contact_header(),
        contact(0, 0, 5, (0, 0, -1), 2.0),  # the normal points from 5 to the ground 0
        contact(0, 0, 5, (0, 0, -1), 3.0),
        contact(2, 5, 0, (0, 0, 1), 4.0),  # the same pair named the other way round
        contact(2, 5, 5, (1, 0, 0), 1.0),  # a body that touches itself
    )
    sums = sum_over_pairs(read_state_log(path))
    np.testing.assert_array_equal(sums.pairs, [[0, 5], [5, 5]])
    run = pb_import(path)
    np.testing.assert_array_equal(run.time, [1 / 64, 2 / 64, 3 / 64])
    np.testing.assert_array_equal(run.channel("contact_count"), [[2, 0], [0, 0], [1, 1]])
    np.testing.assert_array_equal(run.channel("contact_normal_force"), [[5, 0], [0, 0], [4, 1]])
    # Both ways round, the ground pushes body 5 up.
    np.testing.assert_array_equal(run.channel("contact_force"), [[0, 0, 5], [0, 0, 0], [0, 0, 4]])


def test_contact_log_that_blew_up(pb_import, write_log):
    path = write_log(contact_header(), contact(0, 0, 1, (0, 0, 1), np.inf))
    with pytest.raises(Diverged, match="normalForce is inf in record 0"):
        pb_import(path)


def test_counter_that_asks_for_the_moon(pb_import, write_log):
    """The stamps agree with the counter; only the number of frames gives it away."""
    path = write_log(
        contact_header(), *(contact(s, 0, 1, (0, 0, 1), 1.0) for s in (0, 2_000_000_000))
    )
    with pytest.raises(UnsafeFile, match="the last record is of step 2,000,000,000"):
        pb_import(path)


def test_single_contact_step_needs_dt(pb_import, write_log):
    path = write_log(contact_header(), contact(0, 0, 1, (0, 0, 1), 1.0))
    with pytest.raises(MissingData, match="the log holds one step"):
        pb_import(path)
    assert pb_import(path, dt=0.5).time[0] == 0.5


def test_minitaur_counts_or_clock(pb_import, data):
    counted = pb_import(data / "minitaur_8motor.bin")
    assert (counted.time_kind, counted.time_unit, counted.dims) == ("pseudo", "1", 0)
    np.testing.assert_array_equal(counted.time, np.arange(720))
    assert any("dt=" in note for note in counted.notes)
    run = pb_import(data / "minitaur_8motor.bin", dt=1 / 240)
    assert (run.time_kind, run.time_unit) == ("physical", "s")
    np.testing.assert_allclose(run.time, (np.arange(720) + 1) / 240, atol=1e-12)


def test_minitaur_agrees_with_the_generic_log_of_the_run(pb_import, data):
    run = pb_import(data / "minitaur_8motor.bin", dt=1 / 240)
    generic = pb_import(data / "minitaur_generic_dof16.log")
    joints = [10, 8, 14, 12, 2, 0, 6, 4]  # of the motors, in the order of the Minitaur log
    np.testing.assert_array_equal(
        run.channel("motor_angle", unit="rad"), generic.channel("body1.q")[:, joints]
    )
    np.testing.assert_array_equal(
        run.channel("motor_torque", unit="N*m"), generic.channel("body1.t")[:, joints]
    )
    np.testing.assert_array_equal(
        run.channel("forward_velocity", unit="m/s")[:, 0], generic.velocities()[:, 0, 0]
    )
    np.testing.assert_allclose(run.time, generic.time, atol=1e-12)
    assert run.channel("attitude", unit="rad").shape == (720, 3)


def sensors(names, letters, rows):
    body = b"".join(MARK + struct.pack("<" + letters, *row) for row in rows)
    return f"{names}\n{letters}\n".encode() + body


def test_columns_of_their_own(pb_import, write_log):
    path = write_log(sensors("t,volt,amp,on", "fffB", [(0.5 * i, i, -i, 1) for i in range(9)]))
    run = pb_import(path)
    np.testing.assert_array_equal(run.time, np.arange(9) * 0.5)
    assert run.channel_columns("columns") == ("volt", "amp", "on")
    np.testing.assert_array_equal(run.channel("columns")[:, 1], -np.arange(9.0))
    np.testing.assert_allclose(pb_import(path, time_unit="ms").time, np.arange(9) * 5e-4)


def test_time_column_by_name(pb_import, write_log):
    path = write_log(sensors("clock,v", "If", [(10 * i, i) for i in range(5)]))
    with pytest.raises(NotATrajectory, match="no column tells the time; the columns are clock, v"):
        pb_import(path)
    run = pb_import(path, time_key="clock", time_unit="ms")
    np.testing.assert_allclose(run.time, np.arange(5) * 0.01)


def test_hardware_counts_milliseconds_where_the_user_says_so(pb_import, write_log):
    """Real robots write t in ms as a whole number; PyBullet's own logger counts steps there."""
    path = write_log(sensors("t,volt", "If", [(10 * i, i) for i in range(5)]))
    assert pb_import(path).time_kind == "pseudo"
    run = pb_import(path, time_unit="ms")
    assert run.time_kind == "physical"
    np.testing.assert_allclose(run.time, np.arange(5) * 0.01, rtol=0, atol=1e-15)


def test_several_records_an_instant(pb_import, write_log):
    names = "stepCount,timeStamp,controllerId,posX"
    path = write_log(sensors(names, "IfIf", [(i // 2, i // 2, i % 2, 0.0) for i in range(8)]))
    with pytest.raises(NotATrajectory, match="several records share one instant") as error:
        pb_import(path)
    assert "GENERIC_ROBOT" in error.value.fix
