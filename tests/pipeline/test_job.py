"""Reading jobs: what is merged over what, and one line for each mistake."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from weft.files.errors import InputError
from weft.pipeline import presets
from weft.pipeline.job import load_job


def lines_of(folder, text, *overrides):
    folder.job_path.write_text(text)
    with pytest.raises(InputError) as caught:
        folder.load(*overrides)
    assert caught.value.exit_code == 2
    return str(caught.value).splitlines()


THREAD = '[thread]\nkind = "wool"\nfile = "fleece.txt"\n'


def test_all_mistakes_of_a_file_are_reported_at_once_in_its_order(folder):
    text = (
        '[thread]\nkind = "wool"\nfile = "fleese.txt"\nstrnds = 2\nsize_mm = [1, "a"]\n[cloth]\nweight = -1\n'
    )
    path = folder.job_path
    assert lines_of(folder, text) == [
        f"{path}:3: thread.file: file not found: {folder.path}/fleese.txt; did you mean 'fleece.txt'?",
        f"{path}:4: thread.strnds: unknown key; did you mean 'strands'?",
        f"{path}:5: thread.size_mm[1]: found 'a'; must be a number",
        f"{path}:6: cloth.color: is missing (name of the color)",
        f"{path}:7: cloth.weight: found -1; must be greater than 0",
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[clot]\n", "1: clot: unknown table; did you mean 'cloth'?"),
        ("color = 3\n", "1: color: unknown key; it belongs in [cloth]"),
        (THREAD + "gloss = 1\n", "4: thread.gloss: unknown key; it goes with kind = 'silk'"),
        (
            '[thread]\nkind = "wol"\n',
            "2: thread.kind: found 'wol'; must be 'wool' or 'silk'; did you mean 'wool'?",
        ),
        ("[thread]\ngloss = 1\n", "1: thread.kind: is missing; it says which kind this is"),
        (
            '[thread]\nkind = "silk"\ngloss = "much"\n',
            "3: thread.gloss: found 'much'; must be a number, or 'auto'",
        ),
        (
            '[cloth]\ncolor = "red"\n[[cloth.lights]]\nkind = "lamp"\npower = 1\n'
            '[[cloth.lights]]\nkind = "lamp"\npower = 0\n',
            "8: cloth.lights[1].power: found 0; must be greater than 0",
        ),
        (
            '[cloth]\ncolor = "red"\nlights = [\n { kind = "lamp", power = 1 },\n'
            ' { kind = "sun", file = "x" },\n]\n',
            "5: cloth.lights[1].file: file not found: {folder}/x",
        ),
        ('[cloth]\ncolor = "red"\nweight = nan\n', "3: cloth.weight: found nan; numbers must be finite"),
        ("[cloth]\ncolor = red\n", "2: not valid TOML: invalid value (column 9)"),
        ("[cloth]\n[cloth]\n", "2: not valid TOML: cannot declare ('cloth',) twice (column 7)"),
        ('[cloth]\ncolor = "red', " not valid TOML: unterminated string at the end of the file"),
        (
            '[cloth]\ncolor = "red"\n[cloth.by_type]\na = "b"\n',
            "4: cloth.by_type.a: found 'b'; must be a number",
        ),
        ("cloth = 3\n", "1: cloth: found 3; must be a table"),
        ('[output]\nfolder = "../elsewhere"\n', "2: output.folder: leads to"),
    ],
)
def test_each_mistake_is_one_line_with_its_place(folder, text, expected):
    (line,) = lines_of(folder, text)
    assert line.startswith(f"{folder.job_path}:" + expected.replace("{folder}", str(folder.path)))


def test_a_job_that_is_not_text_or_too_large_is_refused(folder):
    folder.job_path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not UTF-8"):
        folder.load()
    folder.job_path.write_bytes(b"#" * (5 * 2**20))
    with pytest.raises(InputError, match="at most 4 MiB"):
        folder.load()
    folder.job_path.write_text("a = " + "[" * 20000 + "]" * 20000)
    with pytest.raises(InputError, match="nested too deeply"):
        folder.load()
    with pytest.raises(InputError, match="cannot be read: No such file"):
        load_job(folder.path / "none.toml", model=dict)  # type: ignore[arg-type]


def test_including_file_wins_and_paths_start_from_the_file_that_names_them(folder):
    folder.write("shared/threads.toml", '[thread]\nkind = "wool"\nfile = "yarn.txt"\nstrands = 5\n')
    folder.write("shared/yarn.txt", "x")
    folder.job_path.write_text('include = ["shared/threads.toml"]\n[thread]\nstrands = 7\n')
    thread = folder.load().config.thread
    assert (thread.strands, thread.file) == (7, folder.path / "shared/yarn.txt")


def test_later_includes_win_and_another_kind_replaces_the_table(folder):
    folder.write("one.toml", '[thread]\nkind = "wool"\nfile = "fleece.txt"\nstrands = 5\n')
    folder.write("two.toml", '[thread]\nkind = "silk"\n[cloth]\ncolor = "blue"\n')
    folder.job_path.write_text('include = ["one.toml", "two.toml"]\n')
    config = folder.load().config
    assert (config.thread.kind, config.cloth.color) == ("silk", "blue")


def test_mistakes_in_an_included_file_are_placed_there(folder):
    other = folder.write("other.toml", "\n[cloth]\ncolour = 1\n")
    assert lines_of(folder, 'include = ["other.toml"]\n[cloth]\ncolor = "red"\n') == [
        f"{other}:3: cloth.colour: unknown key; did you mean 'color'?"
    ]


def test_include_cycles_and_depth_and_missing_files_are_refused(folder):
    path = folder.job_path
    other = folder.write("other.toml", 'include = ["job.toml"]\n')
    assert lines_of(folder, 'include = ["other.toml"]\n') == [
        f"{other}:1: include: files include each other: {path} -> {other} -> {path}"
    ]
    for depth in range(12):
        folder.write(f"deep{depth}.toml", f'include = ["deep{depth + 1}.toml"]\n')
    (line,) = lines_of(folder, 'include = ["deep0.toml"]\n')
    assert line.endswith("includes go more than 8 files deep")
    assert lines_of(folder, '\ninclude = ["no.toml", 3]\n') == [
        f'{path}:2: include: must be a list of files, as in include = ["cotton.toml"]'
    ]
    assert lines_of(folder, 'include = ["no.toml"]\n') == [
        f"{folder.path}/no.toml: cannot be read: No such file or directory"
    ]


def test_eight_includes_deep_is_fine(folder):
    for depth in range(1, 8):
        folder.write(f"deep{depth}.toml", f'include = ["deep{depth + 1}.toml"]\n')
    folder.write("deep8.toml", '[cloth]\ncolor = "deep"\n')
    folder.job_path.write_text('include = ["deep1.toml"]\n')
    assert folder.load().config.cloth.color == "deep"


def test_a_file_included_twice_is_no_cycle(folder):
    folder.write("base.toml", '[cloth]\ncolor = "red"\n')
    folder.write("left.toml", 'include = ["base.toml"]\n')
    folder.write("right.toml", 'include = ["base.toml"]\n[cloth]\nweight = 2.0\n')
    folder.job_path.write_text('include = ["left.toml", "right.toml"]\n')
    assert folder.load().config.cloth.weight == 2


def test_overrides_win_over_files(folder):
    job = folder.load("thread.strands=9", "cloth.color=deep blue", "thread.size_mm=[3, 4]")
    assert (job.config.thread.strands, job.config.cloth.color) == (9, "deep blue")
    assert job.config.thread.size_mm == (3, 4)


def test_an_override_may_change_one_element_of_an_array(folder):
    folder.job_path.write_text(
        '[cloth]\ncolor = "red"\n[[cloth.lights]]\nkind = "lamp"\npower = 1\n'
        '[[cloth.lights]]\nkind = "lamp"\npower = 2\n'
    )
    lights = folder.load("cloth.lights.1.power=5").config.cloth.lights
    assert [light.power for light in lights] == [1, 5]
    with pytest.raises(
        InputError, match=r"--set cloth\.lights\.2\.power=5: there is no element 2; the array has 2"
    ):
        folder.load("cloth.lights.2.power=5")


def test_mistakes_in_overrides_name_the_option(folder):
    text = folder.job_path.read_text()
    assert lines_of(folder, text, "thread.strands=0", "cloth.colour=red") == [
        "--set thread.strands=0: thread.strands: found 0; must be greater than 0",
        "--set cloth.colour=red: cloth.colour: unknown key; did you mean 'color'?",
    ]
    assert "write it as key.key=value" in lines_of(folder, text, "thread.strands")[0]


def test_paths_in_overrides_start_from_the_working_folder(folder, tmp_path_factory, monkeypatch):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "other.txt").write_text("other")
    monkeypatch.chdir(elsewhere)
    assert folder.load("thread.file=other.txt").config.thread.file == elsewhere / "other.txt"


def test_the_working_folder_changes_nothing_else(folder, tmp_path_factory, monkeypatch):
    jobs = []
    for place in (folder.path, tmp_path_factory.mktemp("elsewhere")):
        monkeypatch.chdir(place)
        jobs.append(load_job(Path(os.path.relpath(folder.job_path, place)), model=type(folder.load().config)))
    assert jobs[0].config == jobs[1].config
    assert jobs[0].output == jobs[1].output == folder.output


def test_output_folder_below_the_job_or_by_command_line_only(folder):
    folder.job_path.write_text('[output]\nfolder = "results/red"\n')
    assert folder.load().output == folder.path / "results/red"
    assert folder.load("output.folder=/tmp/anywhere").output.as_posix() == "/tmp/anywhere"


@pytest.fixture
def some_presets(tmp_path, monkeypatch):
    place = tmp_path / "configs/presets/fibers"
    place.mkdir(parents=True)
    (place / "cotton1.toml").write_text("[thin]\nwidth = 1\nheight = 1\n")
    (place / "cotton2.toml").write_text("count = 2\n")
    monkeypatch.setattr(presets, "CONFIGS", tmp_path / "configs")


def preset_lines(folder, text):
    from pydantic import BaseModel

    class Fibers(BaseModel):
        preset: str | None = None
        count: int
        thin: dict[str, int] = {}
        by_type: dict[str, dict[str, object]] = {}

    class Job(BaseModel):
        fibers: Fibers

    folder.job_path.write_text(text)
    return load_job(folder.job_path, model=Job).config.fibers


def test_a_preset_lies_under_the_keys_of_its_table(folder, some_presets):
    fibers = preset_lines(folder, '[fibers]\npreset = "cotton1"\ncount = 5\nthin.height = 7\n')
    assert (fibers.count, fibers.thin, fibers.preset) == (5, {"width": 1, "height": 7}, "cotton1")


def test_yarn_types_take_presets_of_their_own(folder, some_presets):
    fibers = preset_lines(folder, '[fibers]\npreset = "cotton2"\n[fibers.by_type.weft]\npreset = "cotton1"\n')
    assert fibers.by_type["weft"]["thin"] == {"width": 1, "height": 1}


def test_a_wrong_preset_name_lists_those_there_are_and_nothing_else(folder, some_presets):
    with pytest.raises(InputError) as caught:
        preset_lines(folder, '[fibers]\npreset = "cotton"\n')
    assert str(caught.value).splitlines() == [
        f"{folder.job_path}:2: fibers.preset: there is no fibers preset 'cotton'; did you mean 'cotton2'?"
    ]
    with pytest.raises(InputError, match="; there is: cotton1, cotton2"):
        preset_lines(folder, '[fibers]\npreset = "../../x"\n')


FIT_JOB = '[scattering]\nfit = "fit.json"\n'


def fitted(folder, **changes):
    from weft.fiber_model.scattering.config import LobesConfig
    from weft.fiber_model.scattering.parameter_file import ScatteringParameterFile, save_parameters

    widths = {f"longitudinal_width_{lobe}_deg": 7.25 for lobe in ("r", "tt", "trt")}
    values = {**widths, "azimuthal_width_tt_deg": 31.5, "fresnel_r": 0.04, "fresnel_tt": 0.8, **changes}
    content = ScatteringParameterFile(LobesConfig(**values), {"source": "a test", "method": "none"})
    save_parameters(folder.path / "fit.json", content)


def fit_lines(folder, text):
    from weft.pipeline.config import load

    folder.job_path.write_text(text)
    return load(folder.job_path).config.scattering


def test_a_fit_lies_under_the_keys_of_its_table(folder):
    fitted(folder, color_tt=(0.9, 0.8, 0.7))
    scattering = fit_lines(folder, FIT_JOB + "color_trt = 0.5\n[scattering.by_type.weft]\nfresnel_tt = 0.5\n")
    assert scattering.fit == folder.path / "fit.json"
    assert scattering.color_trt == (0.5, 0.5, 0.5)
    weft = scattering.by_type["weft"]
    assert (weft.fresnel_tt, weft.azimuthal_width_tt_deg, weft.color_tt) == (0.5, 31.5, (0.9, 0.8, 0.7))


def test_yarn_types_take_fits_of_their_own(folder):
    fitted(folder)
    text = '[scattering]\npreset = "reference"\n[scattering.by_type.weft]\nfit = "fit.json"\n'
    assert fit_lines(folder, text).by_type["weft"].longitudinal_width_tt_deg == 7.25


def test_what_is_wrong_with_a_fit_is_said_once(folder):
    fitted(folder)
    for text, message in (
        ('[scattering]\nfit = "fid.json"\n', "file not found: {0}/fid.json; did you mean 'fit.json'?"),
        (
            FIT_JOB + 'preset = "reference"\n',
            "a table takes its values from a preset or from a fit, not both",
        ),
    ):
        with pytest.raises(InputError) as caught:
            fit_lines(folder, text)
        expected = f"{folder.job_path}:2: scattering.fit: {message.format(folder.path)}"
        assert str(caught.value).splitlines() == [expected]
    (folder.path / "fit.json").write_text('{"format": "other"}')
    with pytest.raises(InputError) as caught:
        fit_lines(folder, FIT_JOB)
    assert str(caught.value).startswith(f"{folder.path}/fit.json: holds no fitted scattering parameters")
    assert len(str(caught.value).splitlines()) == 1
