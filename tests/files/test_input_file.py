"""Input files are found beside the config file that names them, and are there."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import BaseModel, ValidationError

from weft.files.input_file import InputFile, OutputPath, TextFromFile


class Config(BaseModel):
    file: InputFile
    result: OutputPath | None = None


def message(value):
    with pytest.raises(ValidationError) as caught:
        Config(file=value)
    return caught.value.errors()[0]["msg"]


def test_text_from_a_config_file_starts_from_its_folder(tmp_path, monkeypatch):
    (tmp_path / "a.bcc").touch()
    monkeypatch.chdir("/")
    config = Config.model_validate(
        {"file": TextFromFile("a.bcc", tmp_path), "result": TextFromFile("r", tmp_path)}
    )
    assert (config.file, config.result) == (tmp_path / "a.bcc", tmp_path / "r")


def test_absolute_and_home_paths_stay(tmp_path, monkeypatch):
    (tmp_path / "a.bcc").touch()
    monkeypatch.setenv("HOME", str(tmp_path))
    for text in (str(tmp_path / "a.bcc"), "~/a.bcc"):
        assert (
            Config.model_validate({"file": TextFromFile(text, Path("/nowhere"))}).file == tmp_path / "a.bcc"
        )


def test_paths_from_python_are_taken_as_they_are(tmp_path, monkeypatch):
    (tmp_path / "a.bcc").touch()
    monkeypatch.chdir(tmp_path)
    assert Config(file=Path("a.bcc")).file == Path("a.bcc")


def test_missing_files_are_refused_with_the_nearest_name(tmp_path):
    (tmp_path / "stockinette.pyp").touch()
    assert message(tmp_path / "stokinette.pyp").endswith("stokinette.pyp; did you mean 'stockinette.pyp'?")
    assert message(tmp_path / "none" / "a.pyp").endswith("; its folder does not exist")
    assert message(tmp_path) == f"{tmp_path} is a folder, not a file"
