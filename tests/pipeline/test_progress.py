"""Bars, plain lines and JSON lines."""

from __future__ import annotations

import io
import json
import time

import pytest

from weft.pipeline import progress
from weft.pipeline.progress import BarReporter, JsonReporter, PlainReporter, duration, reporter


@pytest.fixture
def clock(monkeypatch):
    """Time that passes as the test says."""

    class Clock:
        now = 0.0

    monkeypatch.setattr(progress.time, "monotonic", lambda: Clock.now)
    return Clock


def work_for(seconds, report, clock):
    with report.work("render") as callback:
        for step in range(seconds * 10 + 1):
            clock.now = step / 10
            callback(step / (seconds * 10), f"{step} samples")


def test_work_under_a_second_shows_nothing(clock):
    stream = io.StringIO()
    with PlainReporter(stream).work("render") as callback:
        clock.now = 0.9
        callback(0.9, "")
    assert stream.getvalue() == ""


def test_plain_lines_are_few_and_say_what_is_left(clock):
    stream = io.StringIO()
    work_for(600, PlainReporter(stream), clock)
    lines = stream.getvalue().splitlines()
    assert lines[0] == "render:   0% (1.0 s) 10 samples"
    assert 5 <= len(lines) <= 15
    assert "left) " in lines[-1]


def test_remaining_time_follows_the_pace(clock):
    stream = io.StringIO()
    with PlainReporter(stream).work("render") as callback:
        clock.now = 30.0
        callback(0.25, "")
    assert stream.getvalue() == "render:  25% (30 s, about 1 min 30 s left)\n"


def test_json_lines_parse_and_end_with_all_done(clock):
    stream = io.StringIO()
    report = JsonReporter(stream)
    work_for(10, report, clock)
    report.finished("render", 10.0, "64 samples", ["image.exr"])
    events = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert [event["event"] for event in events[-2:]] == ["progress", "finished"]
    assert events[-2]["fraction"] == 1
    assert len(events) < 60


@pytest.mark.parametrize("reported", [False, True])
def test_a_bar_appears_after_a_second_even_where_nothing_is_reported_yet(monkeypatch, reported):
    monkeypatch.setattr(progress, "SHOW_AFTER_SECONDS", 0.05)
    stream = io.StringIO()
    with BarReporter(stream).work("render") as callback:
        if reported:
            callback(0.5, "32 samples")
        time.sleep(0.4)
    assert "render" in stream.getvalue()
    assert ("50%" in stream.getvalue(), "32 samples" in stream.getvalue()) == (reported, reported)


def test_quick_work_draws_no_bar():
    stream = io.StringIO()
    with BarReporter(stream).work("render") as callback:
        callback(1.0, "done")
    assert "render" not in stream.getvalue()


def test_without_a_terminal_lines_are_plain():
    assert isinstance(reporter("auto", io.StringIO()), PlainReporter)


def test_durations_read_well():
    assert [duration(s) for s in (0.04, 9.96, 12.4, 90, 3725)] == [
        "0.0 s",
        "10.0 s",
        "12 s",
        "1 min 30 s",
        "1 h 02 min",
    ]
