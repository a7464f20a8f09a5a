"""Every value of a TOML file is given the line it stands on."""

from __future__ import annotations

import tomllib

from hypothesis import given, settings
from hypothesis import strategies as st

from weft.pipeline.toml_source import _LineScan, leaves, read_toml

AWKWARD = '''\
# a comment with = and [brackets]
title = "a # b \\" = [c]"          # line 2

"quoted key" . inner = 'single # "'   # line 4
text = """
two lines \\""" = 3
"""                                # text stands on line 5
raw = \'\'\'
[not.a.table]
\'\'\'
numbers = [
  1, # one
  2,
  [3,
   4], { deep = [5,
   6] },
]
when = 1979-05-27 07:32:32Z
[[light]]
power = 1
[light.sky]
turbidity = 2
[[light]]
power = 3
[[light.lobe]]
width = 1
[[light.lobe]]
width = 2
[a . "b.c"]
d.e.f = true
inline = { x = 1, y = { z = [ { w = 2 } ] } }
'''


def test_awkward_text(tmp_path):
    (tmp_path / "awkward.toml").write_text(AWKWARD)
    document = read_toml(tmp_path / "awkward.toml")
    line = {path: origin.line for path, origin in document.origins.items()}
    expected = {
        ("title",): 2,
        ("quoted key", "inner"): 4,
        ("text",): 5,
        ("raw",): 8,
        ("numbers",): 11,
        ("numbers", 0): 12,
        ("numbers", 1): 13,
        ("numbers", 2, 0): 14,
        ("numbers", 2, 1): 15,
        ("numbers", 3, "deep", 0): 15,
        ("numbers", 3, "deep", 1): 16,
        ("when",): 18,
        ("light",): 19,
        ("light", 0): 19,
        ("light", 0, "sky", "turbidity"): 22,
        ("light", 1, "power"): 24,
        ("light", 1, "lobe", 0): 25,
        ("light", 1, "lobe", 1, "width"): 28,
        ("a", "b.c"): 29,
        ("a", "b.c", "d", "e", "f"): 30,
        ("a", "b.c", "inline", "y", "z", 0, "w"): 31,
    }
    assert {path: line.get(path) for path in expected} == expected


NAMES = st.sampled_from(["a", "b", "key", '"quo.ted"', "'x y'"])
SCALARS = st.sampled_from(
    ["1", "-0.5e3", "true", '"s"', '"# [x]\\""', "'lit\\'", '"""\nm""" ', "1979-05-27", "'''a\n'b'''"]
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3).map(lambda items: "[ # c\n" + ",\n".join(items) + "]"),
        st.lists(inner.filter(lambda v: "\n" not in v), max_size=2).map(
            lambda items: "{" + ", ".join(f"k{i} = {v}" for i, v in enumerate(items)) + "}"
        ),
    ),
    max_leaves=6,
)


@settings(deadline=None, derandomize=True)
@given(st.lists(st.tuples(NAMES, VALUES), max_size=6), st.lists(st.tuples(NAMES, st.booleans()), max_size=4))
def test_every_leaf_of_any_valid_file_gets_a_line_in_it(pairs, tables):
    text = "".join(f"{name} = {value}\n" for name, value in pairs)
    text += "".join(f"[[{n}]]\nz = 1\n" if array else f"[{n}]\nz = 1\n" for n, array in tables)
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    lines = _LineScan(text).lines
    line_count = len(text.split("\n"))
    for path, _ in leaves(table):
        assert 1 <= lines[path] <= line_count
