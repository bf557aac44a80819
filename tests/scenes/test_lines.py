"""On which line what stands in a TOML text is."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cape.cli.scenes.lines import Lines

TEXT = '''# a comment [
clip = "walk"  # another ]
wind = [
  -3.0,  # from the front
  0.0, 0.0]
"q#[" = """
[no]
end = 1
"""
deep.er = {u = 1, v = [1, 2]}

[fabrics.velvet]
density = 1
[fabrics."x y"]
bend = [1, 2]
[[collider]]
name = "a"
[[collider]]
name = 'b # ['
[collider.sub]
k = 2
[[collider.inner]]
k = 3
[[collider.inner]]
k = 4
'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("clip",), 2),
        (("wind",), 3),
        (("wind", 2), 3),
        (("q#[",), 6),
        (("deep", "er", "v", 1), 10),
        (("fabrics",), 12),
        (("fabrics", "velvet", "density"), 13),
        (("fabrics", "x y"), 14),
        (("collider",), 16),
        (("collider", 0, "name"), 17),
        (("collider", 1), 18),
        (("collider", 1, "name"), 19),
        (("collider", 1, "sub", "k"), 21),
        (("collider", 1, "inner", 0, "k"), 23),
        (("collider", 1, "inner", 1, "k"), 25),
        (("collider", 1, "inner", 1, "nothing"), 24),
        (("nothing",), 1),
    ],
)
def test_each_key_has_its_line(path, line):
    assert Lines(TEXT)[path] == line


@pytest.mark.parametrize(
    ("text", "line", "word"),
    [
        ("a = 1\nb = = 2\n", 2, "Invalid value"),
        ('a = 1\nb = "open\n', 2, "Illegal character"),
        ("a = 1\nb = [1,\n", 3, "at the end"),
        ("a = 1\n\nb = " + "9" * 5000, 3, "digits"),
        ("a = 1\n\n\nb = " + "[" * 50_000 + "\n", 4, "deep"),
    ],
    ids=["a value", "a text", "an end", "a number", "brackets"],
)
def test_what_is_no_toml_has_its_line(text, line, word):
    with pytest.raises((ValueError, RecursionError)) as caught:
        tomllib.loads(text)
    found, told = Lines(text).broken(caught.value)
    assert found == line
    assert word in told


NAMES = st.text(min_size=1, max_size=8)
VALUES = st.one_of(st.integers(), st.booleans(), st.text(max_size=20), st.lists(st.integers(), max_size=3))


@given(st.dictionaries(NAMES, VALUES, min_size=1, max_size=6), st.integers(0, 3))
def test_any_keys_and_values_have_their_lines(content, blank):
    from skeleton.robot.solid_files import quoted

    lines, expected = [], {}
    for key, value in content.items():
        lines += ["# # [ \" '''"] * blank
        expected[key] = len(lines) + 1
        lines.append(f"{quoted(key)} = {quoted(value) if isinstance(value, str) else str(value).lower()}")
    text = "\n".join(lines)
    assert tomllib.loads(text) == content
    assert {key: Lines(text)[(key,)] for key in content} == expected
