"""A take in a notebook: the one beside this file runs, and its last cell holds a viewer."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.processes import python

NOTEBOOK = Path(__file__).with_name("walk.ipynb")


@pytest.mark.extra
def test_the_notebook_runs_and_shows_a_viewer(tmp_path: Path):
    for needed in ("nbconvert", "ipykernel", "rerun_notebook"):
        pytest.importorskip(needed, reason="pip install 'cape[notebook]'")
    run = [sys.executable, "-m", "nbconvert", "--to", "notebook", "--execute", "--output-dir", str(tmp_path)]
    subprocess.run([*run, str(NOTEBOOK)], check=True, timeout=600, capture_output=True)
    cells = json.loads((tmp_path / NOTEBOOK.name).read_text())["cells"]
    computed, shown = (cell["outputs"] for cell in cells if cell["cell_type"] == "code")
    assert "largest stretch" in "".join(computed[0]["text"])
    kinds = {kind for output in shown for kind in output.get("data", {})}
    assert "application/vnd.jupyter.widget-view+json" in kinds


def test_outside_of_a_notebook_it_says_so():
    script = (
        "import cape\nfrom cape.scene.standard_scenes import swing\n"
        "standard = swing(spacing=0.2, seconds=0.1)\n"
        "take = cape.simulate(standard.scene, standard.track)\n"
        "try:\n    take.show()\nexcept cape.UserError as error:\n    print(error)\n"
    )
    assert "cape[notebook]" in python(script)
