"""Command lines that are read without cyclopts mean what it takes them to mean."""

from __future__ import annotations

import random

import pytest

from weft.pipeline.cli import WrongCommandLine, _command
from weft.pipeline.commands import plain, stages

WORDS = (
    *("job.toml", "job.toml", "other.toml", "--force", "--resume", "--no-force", "--force=true", "-f", "-"),
    *("--set", "render.seed=1", "--set=render.seed=2", "--set", "fibers.preset=silk1", "--output", "out"),
    *("-o", "--output=out", "--progress", "plain", "--progress=json", "--progress=loud", "", "--", "--help"),
    *("--samples", "4", "--frame", "3", "--crop=1"),
)


@pytest.fixture
def asked(monkeypatch):
    """Stages that were asked for, with all that was said of them."""
    calls = []
    for module in (plain, stages):
        monkeypatch.setattr(
            module,
            "run_stage",
            lambda *given, **named: calls.append((*given[:2], list(given[2]), *given[3:], named)),
        )
    return calls


def meaning(asked, monkeypatch, line, *, plainly):
    asked.clear()
    with monkeypatch.context() as patch:
        if not plainly:
            patch.setattr("weft.pipeline.cli.plain_stage", lambda arguments: None)
        try:
            _command(line)()
        except WrongCommandLine as error:
            return str(error)
    return [(*call[:-1], {"frame": None} | call[-1]) for call in asked]


@pytest.mark.parametrize("name", plain.STAGES)
def test_plain_lines_mean_the_same(name, asked, monkeypatch, capsys):
    """Of 60 lines of up to five words, those that are plain; at least one in ten must be."""
    chance, plain_count = random.Random(plain.STAGES.index(name)), 0
    for _ in range(60):
        line = [name, "job.toml", *chance.choices(WORDS, k=chance.randrange(5))]
        if plain.plain_stage(line) is None:
            continue
        plain_count += 1
        assert meaning(asked, monkeypatch, line, plainly=True) == meaning(
            asked, monkeypatch, line, plainly=False
        )
    assert plain_count >= 6


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["--force"],
        ["a.toml", "b.toml"],
        ["a.toml", "--sett", "x=1"],
        ["a.toml", "--set"],
        ["a.toml", "--set", "--force"],
        ["a.toml", "--progress", "loud"],
        ["a.toml", "--output", "x", "-o", "y"],
        ["a.toml", "--samples", "4"],
        ["--help"],
    ],
)
def test_all_other_lines_are_left_to_cyclopts(words):
    assert plain.plain_stage(["render", *words]) is None


def test_of_other_commands_no_line_is_plain():
    assert plain.plain_stage(["run", "job.toml"]) is None
    assert plain.plain_stage([]) is None
