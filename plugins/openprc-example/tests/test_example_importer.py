"""The CSV importer: values, meanings of columns, gaps, and errors by their words."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from openprc_example import openprc_exporters, openprc_features, openprc_producers, samples
from openprc_example.importer import CsvImporter

from openprc.errors import ConfigError, SchemaError, UnitError, UnreadableFile
from openprc.schema import Provenance, Trajectory, TrajectoryWriter

DEFAULTS = {option.name: option.default for option in openprc_producers()[0].options}


def convert(path, out, **options):
    with TrajectoryWriter(out, provenance=Provenance("csv"), on_failure="discard") as writer:
        CsvImporter().import_run(path, writer, options={**DEFAULTS, **options})
    return Trajectory(out)


@pytest.fixture
def read(tmp_path):
    """Return a function that imports a text."""

    def read(text, *, name="run.csv", **options):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return convert(path, tmp_path / "run.h5", **options)

    return read


# --- the records ---


def test_entry_module_is_light():
    code = (
        "import sys, openprc_example;"
        "heavy = {'scipy', 'pandas', 'openprc_example.importer'} & set(sys.modules);"
        "sys.exit(str(heavy) if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("records", [openprc_producers, openprc_exporters, openprc_features])
def test_records_name_code_that_exists(records):
    for record in records():
        module, _, attribute = record.load.partition(":")
        __import__(module)
        assert callable(getattr(sys.modules[module], attribute))


# --- values ---


def test_sample_equals_the_closed_form(tmp_path):
    sample = samples.write_sample(tmp_path)
    before = sample.path.read_bytes()
    with convert(sample.path, tmp_path / "run.h5", **sample.options) as run:
        np.testing.assert_array_equal(run.positions(), samples.positions())
        np.testing.assert_array_equal(run.time, samples.times())
        np.testing.assert_array_equal(run.channel("angle"), samples.angles())
        assert (run.position_unit, run.dims, run.dt) == ("mm", 2, samples.DT)
        drive = run.input("u")
        np.testing.assert_array_equal(drive.value[:, 0], samples.symbols_at_frames())
        np.testing.assert_array_equal(drive.sequence, samples.symbols())
        assert (drive.hold, drive.start, drive.unit) == (samples.HOLD, 0.0, "1")
        assert run.channel_columns("angle") == tuple(f"arm{n}" for n in range(6))
    assert sample.path.read_bytes() == before


def test_sample_solves_its_equation_of_motion():
    # Central differences of the closed form, away from the jumps of the drive.
    theta, h = samples.angles(), samples.DT
    w = 2 * np.pi * np.geomspace(0.6, 4.0, samples.N_ARMS)
    zeta = np.linspace(0.3, 0.1, samples.N_ARMS)
    u = samples.symbols_at_frames()
    inside = [i for i in range(1, len(theta) - 1) if u[i - 1] == u[i]]
    speed = (theta[2:] - theta[:-2])[np.array(inside) - 1] / (2 * h)
    acceleration = (theta[2:] - 2 * theta[1:-1] + theta[:-2])[np.array(inside) - 1] / h**2
    force = w**2 * (0.5 * u[inside][:, None] - theta[inside]) - 2 * zeta * w * speed
    slow = slice(0, 3)  # h^2 w^2 / 12 is below 1 % for these
    scale = np.abs(force).max(axis=0)
    assert (np.abs(acceleration - force).max(axis=0) / scale)[slow].max() < 0.02


# --- columns ---


def test_three_dimensions_ids_and_channels(read):
    text = (
        "time [ms],x3 [m],y3 [m],z3 [m],x7 [m],y7 [m],z7 [m],"
        "gauge/left [mV],gauge/right [mV],note\n"
        "0,1,2,3,4,5,6,7,8,9\n"
        "2,1.5,2,3,4,5,6,7,8,\n"
    )
    with read(text) as run:
        np.testing.assert_array_equal(run.positions()[1], [[1.5, 2, 3], [4, 5, 6]])
        np.testing.assert_array_equal(run.node("id"), [3, 7])
        assert (run.time_unit, run.dt) == ("ms", 2.0)
        np.testing.assert_array_equal(run.channel("gauge", unit="V")[0], [7e-3, 8e-3])
        np.testing.assert_array_equal(run.channel("note")[:, 0], [9, np.nan])
        assert run.inputs == ()


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_delimiters_comments_quotes_and_a_byte_order_mark(read, delimiter):
    text = '\ufeff# made by hand\n"t","x","y"\n0,1,2\n\n# pause\n1,3,4\n'
    with read(text.replace(",", delimiter), unit="mm") as run:
        np.testing.assert_array_equal(run.positions(), [[[1, 2]], [[3, 4]]])


def test_header_of_savetxt(tmp_path):
    path = tmp_path / "run.csv"
    table = np.random.default_rng(0).normal(size=(5, 3))
    table[:, 0] = np.arange(5)
    np.savetxt(path, table, delimiter=",", header="t,x0,y0", fmt="%.18e")
    assert CsvImporter().sniff(path) == 0.7
    with convert(path, tmp_path / "run.h5", unit="m") as run:
        np.testing.assert_array_equal(run.positions()[:, 0], table[:, 1:])


def test_output_called_y_is_a_channel(read):
    with read("Time (s),u (V),y (mm)\n0,1,2\n1,3,4\n") as run:
        assert (run.dims, run.channels, run.inputs) == (0, ("y",), ("u",))
        assert run.input().unit == "V"
        np.testing.assert_array_equal(run.channel("y", unit="m")[:, 0], [2e-3, 4e-3])


def test_states_without_places_are_channels(read):
    with read("t,x0,x1\n0,1,2\n1,3,4\n") as run:
        assert run.dims == 0
        assert run.channels == ("x0", "x1")


def test_names_that_the_contract_does_not_allow(read):
    with read("t,F(x) [N],(y)\n0,1,2\n1,3,4\n") as run:
        assert run.channels == ("F_x_", "_y_")
        assert run.channel_columns("F_x_") == ("F(x)",)


def test_inputs_by_name_and_by_option(read):
    with read("t,x,y,u0 [V],u1 [V],motor [A]\n0,1,2,3,4,5\n1,1,2,3,4,6\n", unit="m",
              input=("motor",)) as run:  # fmt: skip
        assert run.inputs == ("motor", "u")
        assert run.input("u").columns == ("u0", "u1")
        assert run.input("u").unit == "V"
        np.testing.assert_array_equal(run.input("motor").value[:, 0], [5, 6])


def test_pseudo_time(read):
    with read("t [1],x,y\n1,0,0\n2,0,1\n", unit="m") as run:
        assert run.time_kind == "pseudo"


def test_pixels_are_an_image(tmp_path, read):
    with read("t,x [px],y [px]\n0,1,2\n1,1,2\n") as run:
        assert run.position_unit == "px"


# --- time ---


def test_dt_without_a_time_column(read):
    with read("x,y\n0,0\n1,1\n2,2\n", unit="m", dt=0.1) as run:
        np.testing.assert_array_equal(run.time, np.arange(3) * 0.1)


def test_dt_replaces_rounded_times(read):
    rows = "".join(f"{i / 30:.3f},{i},0\n" for i in range(20))
    with read("t,x,y\n" + rows, unit="m", dt=1 / 30) as run:
        np.testing.assert_allclose(run.time, np.arange(20) / 30, rtol=1e-15)
        assert run.uniform
        assert "differ by up to 0.000333" in run.provenance["notes"][0]


# --- gaps ---


def test_gaps_become_the_mask(read):
    text = "t,x0,y0,x1,y1\n0,1,2,3,4\n1,,nan,3,4\n2,1,2,NA,4\n"
    with read(text, unit="m") as run:
        np.testing.assert_array_equal(run.observed(), [[1, 1], [0, 1], [1, 0]])
        assert np.isnan(run.positions()[2, 1]).all()
        assert "1 places have some coordinates only" in run.provenance["notes"][0]


def test_marks_of_filled_in_points(read):
    with read("t,x0,y0,seen0\n0,1,2,1\n1,1,2,2\n2,,,0\n3,5,5,0\n", unit="m") as run:
        np.testing.assert_array_equal(run.observed()[:, 0], [1, 2, 0, 0])
        assert np.isnan(run.positions()[3]).all()


# --- symbols ---


def test_last_symbol_that_was_not_held_in_full_is_left_out(read):
    rows = "".join(f"{0.1 * i},0,0,{i // 3}\n" for i in range(8))
    with read("t,x,y,u\n" + rows, unit="m", hold=0.3) as run:
        np.testing.assert_array_equal(run.input().sequence[:, 0], [0, 1])


@pytest.mark.parametrize(
    ("hold", "words"),
    [
        (0.2, "changes at t = 0.3"),
        (0.05, "have no row at all"),
        (0.0, "hold is 0.0"),
    ],
)
def test_wrong_hold(read, hold, words):
    rows = "".join(f"{0.1 * i:.1f},0,0,{i // 3}\n" for i in range(9))
    with pytest.raises(ConfigError, match=words):
        read("t,x,y,u\n" + rows, unit="m", hold=hold)


# --- errors ---


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,x,y\n0,1,2\n1,a,2\n", r"line 3, column 'x': 'a' is not a finite number"),
        ("t;x;y\n0;1;2\n1;0,5;2\n", r"line 3, column 'x': '0,5' .* \(decimal comma\)"),
        ("t,x,y\n0,1,inf\n", r"line 2, column 'y': 'inf'"),
        ("t,x,y\n0,1,1e999\n", r"line 2, column 'y': '1e999'"),
        ("t,x,y\n0,1,2\n1,2\n", r"line 3: 2 cells in a table of 3 columns"),
        ("t,x,y\n0,1,2\n0,1,2\n", r"line 3, column 't': time is 0.0 after 0.0"),
        ("t,x,y\n0,1,2\n,1,2\n", r"line 3, column 't': time is nan"),
        ("t,x,y,u\n0,1,2,3\n1,1,2,\n", r"line 3, column 'u': the input is missing"),
        ("t,x,x\n0,1,2\n", r"line 1: column 3 is called 'x', as is an earlier one"),
        ("t,,y\n0,1,2\n", r"line 1: column 2 is called ''"),
        ("t,x0,y0,x1\n0,1,2,3\n", "node 1 has no column y1"),
        ("t,x0,y0,z0,x1,y1\n0,1,2,3,4,5\n", "node 1 has no column z1"),
        ("t,x0 [m],y0 [mm]\n0,1,2\n", "the coordinates have several units: m, mm"),
        ("t,a/b [V],a/c [A]\n0,1,2\n", "'a/c' is in 'A', the columns before it in 'V'"),
        ("t,x0,y0,seen1\n0,1,2,1\n", "seen1 belongs to no node"),
        ("t,x0,y0,seen0\n0,1,2,5\n", r"line 2, column 'seen0': the mark is 5.0"),
        ("t,x0,y0,seen0\n0,,,1\n", r"line 2, column 'seen0': the mark is 1.0"),
        ("t,x,y\n", "there is a header but no row of numbers"),
        ("0,1,2\n1,2,3\n", "no header line was found"),
        ("only prose here\n", "no header line was found"),
        ("", "empty"),
        ("t,x,y\n0,1,\0\n", "zero bytes"),
    ],
)
def test_damaged_tables_are_named(read, tmp_path, text, words):
    with pytest.raises(UnreadableFile, match=words):
        read(text, unit=None if "[" in text else "m")
    assert not (tmp_path / "run.h5").exists()


def test_text_that_is_not_utf8(tmp_path):
    path = tmp_path / "run.csv"
    path.write_bytes("t,Größe\n0,1\n".encode("latin-1"))
    with pytest.raises(UnreadableFile, match="byte 4 is not UTF-8"):
        convert(path, tmp_path / "run.h5")


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("t,x,y\n0,1,2\n", {}, "nothing says which unit"),
        ("t,x [m],y [m]\n0,1,2\n", {"unit": "mm"}, "the option says 'mm' and the header says 'm'"),
        ("x,y\n0,1\n", {"unit": "m"}, "no column t or time"),
        ("x,y\n0,1\n", {"unit": "m", "dt": -1.0}, "dt is -1.0"),
        ("t,x,y\n0,1,2\n", {"unit": "m", "input": ("v",)}, "there is no column 'v'"),
        (
            "t,x,y\n0,1,2\n",
            {"unit": "m", "hold": 1.0},
            "a hold is given and the table has no input",
        ),
    ],
)
def test_wrong_options_are_named(read, text, options, words):
    with pytest.raises(ConfigError, match=words):
        read(text, **options)


def test_dt_that_contradicts_the_times(read):
    with pytest.raises(UnreadableFile, match=r"line 3, column 't': time is 1.0, and 0.9"):
        read("t,x,y\n0,1,2\n1,1,2\n2,1,2\n", unit="m", dt=0.9)


def test_unknown_units(read):
    with pytest.raises(UnitError, match="unknown unit 'inch'"):
        read("t,x [inch],y [inch]\n0,1,2\n")
    with pytest.raises(SchemaError, match="a unit of time"):
        read("t [mm],a\n0,1\n")


# --- sniffing ---


@pytest.mark.parametrize(
    ("name", "content", "sureness"),
    [
        ("a.csv", "t,x0,y0\n0,1,2\n", 0.7),
        ("a.txt", "time;u\n0;1\n", 0.7),
        ("a.tsv", "t\tforce [N]\n0\t1\n", 0.7),
        ("a.csv", "t,x,y,z,qx,qy,qz,qw\n0,1,2,3,0,0,0,1\n", 0.3),
        ("a.csv", "x,y\n1,2\n", 0.3),
        ("a.csv", "t,x,y\n", 0.3),
        ("a.csv", "t,x,y\nzero,1,2\n", 0.3),
        ("a.csv", "", 0.3),
        ("a.csv", "prose, and nothing else\n", 0.3),
        ("a.txt", "prose, and nothing else\n", 0.0),
        ("a.csv", "\0\0\0", 0.0),
        ("a.h5", "\x89HDF\r\n\x1a\n\0\0", 0.0),
    ],
)
def test_sureness(tmp_path, name, content, sureness):
    path = tmp_path / name
    path.write_text(content, encoding="utf-8")
    assert CsvImporter().sniff(path) == sureness


def test_sureness_of_other_things(tmp_path):
    assert CsvImporter().sniff(tmp_path) == 0.0
    assert CsvImporter().sniff(tmp_path / "none.csv") == 0.0
    noise = tmp_path / "noise.csv"
    noise.write_bytes(np.random.default_rng(0).bytes(4096))
    assert CsvImporter().sniff(noise) == 0.0
    assert CsvImporter().sniff(samples.write_sample(tmp_path).path) == 0.7
