"""Options that a scene has for a producer reach its run, unless the request says otherwise."""

from __future__ import annotations

from openprc.compare.runs.requests import read_requests, with_scene_options
from openprc.compare.studies import Choices, compare_producers
from openprc.scenes.catalog import build_scene


def test_a_request_keeps_its_own_options():
    plain, own, engine = read_requests("pyelastica,pyelastica:radius=0.01,demlat")
    told, added = with_scene_options([plain, own, engine], "hanging-chain")
    asked = {"section": "constant", "radius": 0.002, "substeps": "auto"}
    assert dict(told[0].options) == asked
    assert dict(told[1].options) == {**asked, "radius": "0.01"}
    assert dict(told[2].options) == {}
    assert added == {
        plain.name: asked,
        own.name: {"section": "constant", "substeps": "auto"},
    }


def test_a_scene_outside_the_library_asks_for_nothing():
    requests = read_requests("pyelastica")
    assert with_scene_options(requests, "my-own") == (requests, {})


def test_a_comparison_runs_with_them_and_says_so(tmp_path):
    scene = build_scene("cantilever", {"n": 4})
    report = compare_producers(
        scene.experiment, read_requests("demlat,pyelastica"), tmp_path,
        scene=scene, choices=Choices(tasks=False, twins=False),
    )  # fmt: skip
    settings = {run.name: dict(run.settings) for run in report.runs}
    assert settings == {"demlat": {}, "pyelastica": {"shear_scale": 100.0, "substeps": "auto"}}
    (note,) = [note for note in report.notes if note.startswith("pyelastica ran with")]
    assert "shear_scale=100.0 substeps=auto" in note
