"""config.json: every mistake is named, in the user's own words, all at once."""

import copy
import json

import pytest

from openprc.errors import ConfigError, SchemaTooNew, UnreadableFile
from openprc.schema.config import load_config, parse_config
from openprc.schema.config_sections import Config
from openprc.schema.experiment import whole_multiple

GOOD = {
    "openprc_config": "1.0",
    "simulation": {"duration": 1.0, "dt": 0.001, "save_interval": 0.01, "integrator": "rk4"},
    "physics": {"gravity": -9.81, "damping": 0.5, "enable_collision": False},
    "actuators": [
        {"node": 3, "signal": "u", "type": "force", "axes": [True, False, False]},
        {"node": 4, "signal": "u", "type": "position"},
    ],
    "export": {"overwrite": True},
}
OLD = {
    "simulation": {"duration": 30.0, "dt_base": 0.001, "dt_save": 0.01},
    "global_physics": {"gravity": -9.8, "global_damping": 0.5},
    "material": {"damping_coefficient": 0.5},
    "actuators": [
        {"node_idx": 0, "signal_name": "s", "type": "position", "dof": [1, 0, 1]},
        {"node_id": 1, "signal": "s", "type": "force"},
    ],
}


def changed(data, path, value):
    """A copy of `data` with one field set, or removed when `value` is ``...``."""
    data = copy.deepcopy(data)
    node = data
    for key in path[:-1]:
        node = node[key]
    if value is ...:
        del node[path[-1]]
    else:
        node[path[-1]] = value
    return data


def write(tmp_path, data):
    path = tmp_path / "config.json"
    path.write_text(data if isinstance(data, str) else json.dumps(data), encoding="utf-8")
    return path


def test_a_good_file_is_read(tmp_path):
    config, legacy = load_config(write(tmp_path, GOOD))
    assert not legacy
    assert config.simulation.dt == 0.001
    assert config.physics.gravity_vector() == (0.0, 0.0, -9.81)
    assert config.actuators[0].axes == (True, False, False)
    assert config.actuators[1].axes == (True, True, True)
    assert config.export.overwrite


def test_sections_have_stated_defaults():
    config = parse_config({"openprc_config": "1.0", "simulation": GOOD["simulation"]})
    assert config.physics.gravity_vector() == (0.0, 0.0, 0.0)
    assert config.physics.damping == 0.0
    assert config.actuators == ()


def test_gravity_may_be_a_vector():
    config = parse_config(changed(GOOD, ["physics", "gravity"], [1, 0.5, -9.81]))
    assert config.physics.gravity_vector() == (1.0, 0.5, -9.81)


def test_a_byte_order_mark_is_no_obstacle(tmp_path):
    path = tmp_path / "config.json"
    path.write_text(json.dumps(GOOD), encoding="utf-8-sig")
    assert load_config(path)[0].simulation.duration == 1.0


MISTAKES = [
    (["simulation", "dt"], -0.001, r"simulation\.dt: found -0\.001", "greater than 0"),
    (["simulation", "dt"], 0, r"simulation\.dt: found 0", "greater than 0"),
    (["simulation", "dt"], "0.001", r"simulation\.dt: found '0\.001'", "valid number"),
    (["simulation", "dt"], True, r"simulation\.dt: found True", "valid number"),
    (["simulation", "dt"], ..., r"simulation\.dt: the key is missing", "time step of the"),
    (["simulation"], ..., r"simulation: the key is missing", ""),
    (["openprc_config"], "one", r"openprc_config: found 'one'", "MAJOR.MINOR"),
    (["openprc_config"], ..., r"openprc_config: the key is missing", ""),
    (
        ["simulation", "save_interval"],
        0.0105,
        r"simulation\.save_interval: 0\.0105 s is 10\.5 times",
        "multiple, such as 0.01 s",
    ),
    (
        ["simulation", "save_interval"],
        0.0001,
        r"simulation\.save_interval: 0\.0001 s is 0\.1 times",
        "0.001 s",
    ),
    (
        ["simulation", "duration"],
        1.005,
        r"simulation\.duration: 1\.005 s is 100\.5 times",
        "multiple",
    ),
    (
        ["simulation", "durration"],
        1,
        r"simulation\.durration: unknown key",
        "did you mean 'duration'",
    ),
    (
        ["simulation", "zzz"],
        1,
        r"simulation\.zzz: unknown key",
        "known here: accuracy, duration, dt",
    ),
    (["phisics"], {}, r"phisics: unknown key", "did you mean 'physics'"),
    (["physics", "gravity"], [0, 1], r"physics\.gravity: found \[0, 1\]|physics\.gravity", ""),
    (["physics", "gravity"], "down", r"physics\.gravity: found 'down'", "along z when one number"),
    (["physics", "damping"], -1, r"physics\.damping: found -1", "0"),
    (["physics", "collision_restitution"], 1.5, r"physics\.collision_restitution: found 1\.5", ""),
    (["actuators", 0, "node"], -1, r"actuators\[0\]\.node: found -1", "index of the driven node"),
    (["actuators", 0, "node"], 1.5, r"actuators\[0\]\.node: found 1\.5", "integer"),
    (
        ["actuators", 1, "type"],
        "banana",
        r"actuators\[1\]\.type: found 'banana'",
        "'position', 'force' or 'velocity'",
    ),
    (["actuators", 0, "axes"], [1, 0, 0], r"actuators\[0\]\.axes", "boolean"),
    (["actuators", 0, "axes"], [True, False], r"actuators\[0\]\.axes", "which of x, y, z"),
    (
        ["actuators", 0, "axes"],
        [False] * 3,
        r"actuators\[0\]\.axes: no axis is enabled",
        "at least one",
    ),
    (
        ["actuators", 0, "sginal"],
        "u",
        r"actuators\[0\]\.sginal: unknown key",
        "did you mean 'signal'",
    ),
    (["actuators"], {}, r"actuators: found \{\}", ""),
    (["export", "overwrite"], "yes", r"export\.overwrite: found 'yes'", "boolean"),
]


@pytest.mark.parametrize(("path", "value", "found", "hint"), MISTAKES)
def test_a_mistake_is_named_with_its_field(tmp_path, path, value, found, hint):
    file = write(tmp_path, changed(GOOD, path, value))
    with pytest.raises(ConfigError, match=found) as caught:
        load_config(file)
    assert hint in str(caught.value)
    assert caught.value.file == str(file)
    assert caught.value.key


def test_all_mistakes_come_together(tmp_path):
    data = changed(GOOD, ["simulation", "dt"], -1)
    data = changed(data, ["actuators", 1, "type"], "banana")
    data = changed(data, ["physics", "gravty"], 0)
    with pytest.raises(ConfigError, match="3 mistakes") as caught:
        load_config(write(tmp_path, data))
    for key in ("simulation.dt", "actuators[1].type", "physics.gravty"):
        assert key in caught.value.key
        assert f"- {key}: " in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"simulation": {"dt": 0.1,}}', r"invalid JSON at line 1, column \d+"),
        ('{\n  "a": 1\n  "b": 2\n}', "invalid JSON at line 3, column 3"),
        ('{"dt": NaN}', "the number NaN"),
        ('{"dt": -Infinity}', "the number -Infinity"),
        ('{"dt": 1, "dt": 2}', "the key 'dt' appears twice"),
        ("[1, 2]", "holds a JSON list"),
        ("[" * 100_000, "nested too deeply|invalid JSON"),
    ],
)
def test_what_is_not_a_json_object_is_refused(tmp_path, text, words):
    with pytest.raises(ConfigError, match=words) as caught:
        load_config(write(tmp_path, text))
    assert caught.value.file.endswith("config.json")


def test_huge_numbers_do_not_become_infinity(tmp_path):
    text = json.dumps(GOOD).replace("0.001", "1e999")
    with pytest.raises(ConfigError, match=r"simulation\.dt: found inf"):
        load_config(write(tmp_path, text))


def test_bytes_that_are_not_text_are_refused(tmp_path):
    path = tmp_path / "config.json"
    path.write_bytes(b'{"a": "\xff"}')
    with pytest.raises(ConfigError, match="byte 7 is not UTF-8"):
        load_config(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(UnreadableFile, match="does not exist"):
        load_config(tmp_path / "config.json")


def test_a_newer_layout_is_refused_and_a_newer_minor_is_not(tmp_path):
    with pytest.raises(SchemaTooNew, match=r"version 2\.0"):
        load_config(write(tmp_path, changed(GOOD, ["openprc_config"], "2.0")))
    assert parse_config(changed(GOOD, ["openprc_config"], "1.7")).openprc_config == "1.7"


def test_the_json_schema_describes_every_field():
    schema = Config.model_json_schema()
    for section in ("SimulationSection", "PhysicsSection", "ActuatorSection", "ExportSection"):
        for name, field in schema["$defs"][section]["properties"].items():
            assert field.get("description"), f"{section}.{name}"


# --- the older layout ----------------------------------------------------------------------


def test_the_older_layout_means_the_same(tmp_path):
    config, legacy = load_config(write(tmp_path, OLD))
    assert legacy
    assert config.simulation.dt == 0.001
    assert config.simulation.save_interval == 0.01
    assert config.physics.damping == 0.5
    assert config.physics.gravity == -9.8
    assert [entry.node for entry in config.actuators] == [0, 1]
    assert config.actuators[0].axes == (True, False, True)
    assert config.actuators[1].signal == "s"


OLD_MISTAKES = [
    (["simulation", "dt_base"], -1, r"simulation\.dt_base: found -1"),
    (["simulation", "dt_base"], ..., r"simulation\.dt_base: the key is missing"),
    (
        ["simulation", "dt_savee"],
        1,
        r"simulation\.dt_savee: unknown key[\s\S]*did you mean 'dt_save'",
    ),
    (["global_physics", "gravity"], ..., r"global_physics\.gravity: the key is missing"),
    (["global_physics", "global_dampin"], 1, r"global_physics\.global_dampin: unknown key"),
    (["global_physics", "global_damping"], -2, r"global_physics\.global_damping: found -2"),
    (["actuators", 0, "node_idx"], "zero", r"actuators\[0\]\.node_idx: found 'zero'"),
    (["actuators", 0, "signal_name"], ..., r"actuators\[0\]\.signal_name: the key is missing"),
    (["actuators", 0, "dof"], [1, 1], r"actuators\[0\]\.dof"),
    (["actuators", 0, "dof"], [1, 2, 1], r"actuators\[0\]\.dof"),
    (["actuators", 0, "typ"], "force", r"actuators\[0\]\.typ: unknown key"),
    (["actuators", 0], 7, r"actuators\[0\]: found 7"),
    (["simulation", "dt"], 0.5, r"simulation\.dt: gives 'dt' again"),
    (["simulation", "dt_save"], 0.0105, r"simulation\.dt_save: 0\.0105 s is 10\.5 times"),
    (["extra"], 1, r"extra: unknown key"),
]


@pytest.mark.parametrize(("path", "value", "words"), OLD_MISTAKES)
def test_mistakes_in_the_older_layout_have_its_names(tmp_path, path, value, words):
    with pytest.raises(ConfigError, match=words):
        load_config(write(tmp_path, changed(OLD, path, value)))


# --- whole multiples -----------------------------------------------------------------------


def test_every_decimal_multiple_is_recognised():
    # int(total / part) is wrong for hundreds of these.
    wrong = 0
    for digits in (1, 2, 3, 4):
        part = 10.0**-digits
        for count in range(1, 500):
            total = float(f"{count * part:.{digits}f}")
            assert whole_multiple(total, part) == count
            wrong += int(total / part) != count
    assert wrong > 50


@pytest.mark.parametrize(("total", "part"), [(1.0, 0.3), (1e-3, 1.0001e-4), (1.0, 1e-320)])
def test_what_is_no_multiple_is_not_rounded(total, part):
    assert whole_multiple(total, part) is None
