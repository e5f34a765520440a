import subprocess
import sys


def test_importing_the_package_is_light():
    code = (
        "import sys, openprc.reservoir; "
        "print([m for m in ('sklearn', 'scipy', 'h5py', 'matplotlib') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
