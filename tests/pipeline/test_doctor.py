"""The doctor answers whatever is missing or broken."""

from __future__ import annotations

import json

import pytest

from weft.pipeline import doctor
from weft.pipeline.doctor import Finding, _lines, _probe_apart, examine, print_probe


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("raise ImportError('No module named warp')", "ended with code 1: ImportError: No module named warp"),
        ("import os; os.kill(os.getpid(), 11)", "ended with code -11"),
        ("print('noise')", "ended with code 0: no message"),
        ("import time; time.sleep(30)", "no answer within 1.0 s"),
    ],
)
def test_a_probe_that_fails_crashes_or_hangs_is_a_finding_with_a_cure(monkeypatch, code, expected):
    monkeypatch.setattr(doctor, "PROBE", code)
    monkeypatch.setattr(doctor, "PROBE_SECONDS", 1.0)
    finding = _probe_apart("warp")
    assert not finding.good
    assert expected in finding.found
    assert finding.cure == "pip install warp-lang"


def test_what_a_library_raises_is_reported(monkeypatch, capsys):
    def broken():
        raise RuntimeError("no driver")

    monkeypatch.setitem(doctor.PROBES, "opengl", broken)
    print_probe("opengl")
    answer = json.loads(capsys.readouterr().out)
    assert (answer["good"], answer["found"]) == (False, "RuntimeError: no driver")


@pytest.mark.parametrize(
    ("version", "good"), [("3.4.13", False), ("3.4.14", True), ("3.5.0", True), ("3.4.2", False)]
)
def test_versions_of_openexr_with_known_holes_are_named(monkeypatch, version, good):
    import OpenEXR

    monkeypatch.setattr(OpenEXR, "__version__", version)
    found = doctor._probe_openexr()
    assert found[0] == good
    assert good or "known holes; need 3.4.14" in found[1]


def test_a_missing_library_is_named(monkeypatch):
    monkeypatch.setattr(doctor, "LIBRARIES", ("numpy", "no-such-thing"))
    finding = doctor.library_findings()[0]
    assert not finding.good
    assert finding.cure == "pip install no-such-thing"


def test_the_exit_code_tells_whether_rendering_is_possible(monkeypatch, capsys):
    monkeypatch.setattr(
        doctor, "_probe_apart", lambda name: Finding(name, name != "openvdb", "x", "y", doctor.NEEDED[name])
    )
    assert examine() == 0
    assert "missing openvdb" in capsys.readouterr().out
    monkeypatch.setattr(
        doctor, "_probe_apart", lambda name: Finding(name, name != "opengl", "x", "y", doctor.NEEDED[name])
    )
    assert examine(as_json=True) == 2
    assert json.loads(capsys.readouterr().out)["opengl"]["cure"] == "y"


def test_a_cure_stands_below_what_is_missing():
    assert _lines(Finding("opengl", False, "no driver", "apt install it")) == [
        "MISSING opengl     no driver",
        "                   -> apt install it",
    ]


def test_extras_are_listed_and_not_needed(monkeypatch):
    monkeypatch.setattr(doctor, "library_versions", lambda names: dict.fromkeys(names, "not installed"))
    found = {finding.name: finding for finding in doctor.library_findings()}
    for name, extra in (("xatlas", "weft[garments]"), ("usd-core", "weft[usd]")):
        assert not found[name].good
        assert not found[name].needed
        assert extra in found[name].cure
