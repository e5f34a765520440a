"""The records, the sample, and the code of the README."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from openprc_meshio import openprc_exporters, openprc_producers, samples

README = Path(__file__).parents[1] / "README.md"


def test_entry_module_is_light():
    code = (
        "import sys, openprc_meshio;"
        "heavy = {'meshio', 'meshlane', 'vtk', 'rich', 'openprc_meshio.importer'}"
        " & set(sys.modules); sys.exit(str(heavy) if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True)
    assert done.returncode == 0, done.stderr


def test_exporting_and_reading_xdmf_import_no_reader_of_meshes(tmp_path):
    code = (
        "import sys; from pathlib import Path\n"
        "from openprc.hooks import export_file, import_file\n"
        "from openprc_meshio.samples import write_sample\n"
        "sample = write_sample(Path('.'))\n"
        "import_file(sample.path, 'run.h5', as_name='meshio', options=sample.options)\n"
        "export_file('run.h5', 'run.xdmf'); export_file('run.h5', 'run.vtkhdf')\n"
        "sys.exit(str({'meshio', 'meshlane', 'vtk'} & set(sys.modules) or '') or 0)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], check=False, capture_output=True, cwd=tmp_path
    )
    assert (done.returncode, done.stdout) == (0, b""), done.stderr


@pytest.mark.parametrize("records", [openprc_producers, openprc_exporters])
def test_records_name_code_that_exists(records):
    for record in records():
        module, _, attribute = record.load.partition(":")
        assert callable(getattr(import_module(module), attribute))


def test_sample_equals_the_closed_form(tmp_path, load):
    sample = samples.write_sample(tmp_path)
    before = sample.path.read_bytes()
    run = load(sample.path, **sample.options).run
    np.testing.assert_array_equal(run.positions(), samples.positions())
    np.testing.assert_array_equal(run.time, samples.times())
    np.testing.assert_array_equal(run.indices("faces"), samples.triangles())
    np.testing.assert_array_equal(run.node("rest"), samples.rest())
    assert (run.position_unit, run.dt) == ("mm", samples.DT)
    assert sample.path.read_bytes() == before


def test_sample_solves_its_equation_of_motion():
    """Within a symbol the distance to the target shrinks by exp(-w dt) from step to step."""
    z, drive = samples.deflection(), samples.symbols()[:, 0]
    rate = np.geomspace(40.0, 2.0, samples.N_COLUMNS)
    for k in (0, 17, len(drive) - 1):
        rows = z[samples.STEPS_PER_SYMBOL * k : samples.STEPS_PER_SYMBOL * (k + 1) + 1]
        far = rows - samples.AMPLITUDE * drive[k]
        np.testing.assert_allclose(far[-1], far[0] * np.exp(-rate * samples.HOLD), rtol=1e-9,
                                   atol=1e-12)  # fmt: skip


def test_every_option_stands_in_the_readme():
    text = README.read_text(encoding="utf-8")
    for spec in (*openprc_producers(), *openprc_exporters()):
        for option in spec.options:
            assert f"`{option.name}`" in text, option.name


def test_code_of_the_readme_runs(tmp_path, monkeypatch):
    blocks = re.findall(r"```python( viewers)?\n(.*?)```", README.read_text("utf-8"), flags=re.S)
    assert [bool(marked) for marked, _ in blocks] == [False, False, True]
    monkeypatch.chdir(tmp_path)
    scope: dict[str, object] = {"__name__": "readme"}
    for marked, block in blocks:
        if marked and find_spec("pyvista") is None:
            pytest.skip("pyvista is not installed: the picture of the README is not drawn")
        exec(compile(block, "README.md", "exec"), scope)
    # A picture of nothing would be of one colour.
    picture = import_module("matplotlib.image").imread(tmp_path / "sheet.png")
    assert len(np.unique(picture.reshape(-1, picture.shape[-1]), axis=0)) > 100
