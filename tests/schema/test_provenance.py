"""What a file says about the command that made it."""

import pytest

from openprc.schema.provenance import typed_command


@pytest.mark.parametrize(
    ("word", "stored"),
    [
        ("import", "import"),
        ("/data/somebody/run.mat", "run.mat"),
        ("../data/run.mat", "run.mat"),
        ("~/runs/export/", "export"),
        ("urdf=/models/arm.urdf", "urdf=arm.urdf"),
        ("urdf=1=/models/arm.urdf", "urdf=1=arm.urdf"),
        ("/a folder/with spaces/run.mat", "run.mat"),
        ("a/b.csv,c/d.csv", "d.csv"),
        (r"C:\runs\run.mat", "run.mat"),
        ("--unit=N/m", "--unit=N/m"),
        ("unit=mm/s", "unit=mm/s"),
        ("--hold", "--hold"),
    ],
)
def test_no_folder_is_stored(word, stored):
    assert typed_command(["openprc", word]) == f"openprc {stored}"
