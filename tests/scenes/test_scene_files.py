"""Scene files: what they may hold, what is told of mistakes, and that they are read as they were written."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import skeleton
from cape import FABRICS, dress
from cape.cli.scenes.file import LARGEST, SceneFile, read_scene, scene_of
from cape.cli.scenes.keys import KINDS, keys
from cape.cli.scenes.tables import ATTACHMENT_KEYS, FABRIC_KEYS, TABLES
from cape.cli.scenes.writing import EXAMPLES, RUNS, TABLES_TOLD, commented, save, text_of
from motions.errors import FileError, UserError
from tests.support.scenes import walking

HERE = Path("scenes") / "hero.toml"


def read(text: str) -> SceneFile:
    return scene_of(text.encode(), HERE)


def test_each_option_of_replay_has_a_key():
    import typer

    from cape.cli.app import app

    command = typer.main.get_command(app).get_command(None, "replay")  # pyright: ignore[reportAttributeAccessIssue]
    options = {param.name for param in command.params if param.name not in ("scene", "help")}
    assert {key.parameter for key in keys().values()} == options
    for key in keys().values():
        param = next(param for param in command.params if param.name == key.parameter)
        assert key.name == "clip" or f"--{key.name}" in param.opts
        assert key.kind in KINDS
        assert key.help
    assert not set(keys()) & set(TABLES)
    assert set(EXAMPLES) <= set(keys())


MISTAKES = {
    "a key that there is not": ("gutss = 0.3", "did you mean 'gusts'"),
    "a table that there is not": ("[weather]", "available: clip"),
    "a text that is a number": ("clip = 3", "clip is a text, not 3"),
    "a number that is a text": ('spacing = "wide"', "spacing is a number, not 'wide'"),
    "a number that is true": ("gusts = true", "gusts is a number, not true"),
    "a number that is none": ("spacing = nan", "spacing is a number, not nan"),
    "a number that is too large": ("height = 1e10", "height is a number"),
    "a whole number that is none": ("substeps = 1.5", "substeps is a whole number, not 1.5"),
    "a truth that is none": ("loop = 1", "loop is true or false, not 1"),
    "two numbers of three": ("wind = [1, 2]", "wind is a list of 3 numbers, not [1, 2]"),
    "a path that is a number": ("wind-file = 1", "wind-file is a path, as a text"),
    "a list with a number": ('attach = ["a=b", 3]', "attach is a list of texts"),
    "an unknown garment": ('garment = "shoulder_cap"', "did you mean 'shoulder_cape'"),
    "an unknown fabric": ('fabric = "denm"', "did you mean 'denim'"),
    "an unknown solver": ('solver = "magic"', "available: euler"),
    "an unknown layer": ('layers = "cape,hat"', "no layers named 'hat'"),
    "an unknown way at cuts": ('cuts = "tear"', "carry"),
    "no TOML": ("clip = = 3", "no TOML: Invalid value"),
    "a key twice": ('clip = "walk"\nclip = "run"', "Cannot overwrite"),
    "fabrics that are none": ("fabrics = 3", "tables [fabrics.NAME]"),
    "a fabric that is none": ("[fabrics]\nv = 3", "v is a table"),
    "a fabric's key": ("[fabrics.v]\nweight = 3", "no key named 'weight'"),
    "a fabric's value": ('[fabrics.v]\ndensity = "light"', "density is a number"),
    "a fabric's three numbers": ("[fabrics.v]\nstretch = [1.0, 2.0, 3.0]", "one for warp"),
    "a fabric out of range": ("[fabrics.v]\nbend = 1e-5\ndensity = -1", "density must be positive"),
    "an unknown base": ('[fabrics.v]\nbase = "steel"', "denim"),
    "an attachment's key": ('[[attachment]]\nbone = "chest"\nregon = "top"', "did you mean 'region'"),
    "an attachment's value": ('[[attachment]]\nbone = "chest"\nvertices = [0.5]', "a list of whole numbers"),
    "an attachment's points": ('[[attachment]]\nbone = "chest"\nalong = [[1, 2]]', "each a list of 3 numbers"),
    "an attachment without a bone": ("[[attachment]]\nwithin = 0.1", "lacks its bone"),
    "an attachment of both": ('[[attachment]]\nbone = "a"\nbones = {a = 1}', "not both"),
    "attachments that are none": ("attachment = 3", "tables [[attachment]]"),
    "a collider of no shape": ('[[collider]]\nname = "x"\nkind = "capsul"', "tapered_capsule"),
    "a collider that lacks something": ('[[collider]]\nname = "x"\nkind = "sphere"', "center, radius"),
    "colliders of one name": (
        '[[collider]]\nname = "x"\nkind = "plane"\npoint = [0, 0, 0]\nnormal = [0, 0, 1]\n' * 2,
        "a collider named 'x' already",
    ),
    "a collider that is none": ("collider = [3]", "collider is a table"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_mistake_is_told_with_its_line_and_what_was_expected(case):
    text, told = MISTAKES[case]
    before = "# first\n\n"
    with pytest.raises(FileError) as caught:
        read(before + text)
    # What is wrong stands at the end; a collider is told by the line on which it begins.
    last = text.splitlines()[: 1 if case == "a collider of no shape" else None]
    line = 3 if "lacks" in case or "without" in case or "of both" in case else 2 + len(last)
    line = line - 4 if case == "colliders of one name" else line
    assert str(caught.value).startswith(f"{HERE}, line {line}: ")
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_no_text_has_a_line():
    with pytest.raises(FileError, match="line 3: no text in UTF-8"):
        scene_of(b'clip = "walk"\n\n\xff = 1', HERE)


def test_a_file_that_is_too_large_or_none_is_refused(tmp_path):
    (tmp_path / "large.toml").write_bytes(b"#" * (LARGEST + 1))
    with pytest.raises(FileError, match=r"0\.3 at most"):
        read_scene(tmp_path / "large.toml")
    with pytest.raises(FileError, match="directory"):
        read_scene(tmp_path)


@pytest.mark.parametrize("text", ["a" + ".a" * 100_000 + " = 1", "[a" + " . 'b'" * 30_000 + "]"])
def test_a_key_of_many_parts_is_refused_at_once(text):
    with pytest.raises(FileError, match="line 2: no TOML: nested too deeply"):
        read("\n" + text)


def test_a_number_of_thousands_of_digits_is_told_in_plain_words():
    with pytest.raises(FileError, match=r"line 2: no TOML: a number of more than 4300 digits$"):
        read("\nspacing = " + "1" * 5000)


FRAGMENTS = st.sampled_from(
    [*"[]{}=\"'#,.\n ", "[[", "]]", '"""', "\n[", "[[collider]]\n", "[fabrics.v]\n", "[[attachment]]\n", "name", "bone",
     "kind", *keys(), "1", "-1e400", "nan", "true", '"walk"', '"sphere"', "1979-05-27", "\\u0000", "\r\n", "\ud7ff"]
)  # fmt: skip
VALUES = st.recursive(
    st.one_of(st.integers(), st.floats(), st.booleans(), st.text(max_size=6)),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=2),
    max_leaves=6,
)


def toml(value: object) -> str:
    from cape.cli.scenes.writing import _value

    return _value(value)


LINES = st.builds(lambda key, value: f"{key} = {toml(value)}\n", st.sampled_from([*keys(), *TABLES]), VALUES)


@given(st.one_of(st.text(), st.lists(FRAGMENTS, max_size=30).map("".join), st.lists(LINES, max_size=3).map("".join)))
def test_any_text_is_a_scene_or_a_mistake_in_one_line(text):
    told, scene = "", SceneFile(HERE)
    try:
        scene = scene_of(text.encode("utf-8", "replace"), HERE)
    except UserError as error:
        told = str(error)
    if not told:
        assert set(scene.options) <= set(keys())
        return
    line = re.match(rf"{HERE}, line (\d+): \S", told)
    assert line is not None
    assert len(told.splitlines()) == 1
    assert 1 <= int(line[1]) <= text.count("\n") + 1


def an_option(name: str) -> st.SearchStrategy:
    key = keys()[name]
    one = {
        str: st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8),
        Path: st.sampled_from(["a", "b/c.csv", "../d", "/e"]).map(Path),
        float: st.floats(-1e9, 1e9),
        int: st.integers(-(10**9), 10**9),
        bool: st.booleans(),
    }[key.kind]
    if key.one_of is not None:
        one = st.sampled_from(sorted(key.one_of.names()))
    if key.file is not None:
        one = st.sampled_from(["walk 2s, run"] if key.file.script else ["walk", "g1", "a.bvh", "sub/b.toml", "../c.x"])
    if key.count is not None:
        one = st.lists(one, min_size=max(key.count, 0), max_size=key.count if key.count > 0 else 3)
    return one


SCENES = st.lists(st.sampled_from(sorted(keys())), unique=True, max_size=8).flatmap(
    lambda names: st.builds(
        SceneFile,
        st.just(Path("hero.toml")),
        st.fixed_dictionaries({name: an_option(name) for name in names}),
        st.dictionaries(
            st.text(min_size=1, max_size=5),
            st.fixed_dictionaries({"base": st.sampled_from(sorted(FABRICS)), "density": st.floats(0.01, 1.0)}),
            max_size=2,
        ),
        st.just(({"bone": "chest", "vertices": [0, 3], "stiffness": 20.0}, {"bones": {"a b": 0.5}, "within": 0.25})),
        st.just(({"name": "é\n", "kind": "sphere", "center": [0.0, 1.0, 0.5], "radius": 0.1},)),
    )
)


@given(SCENES)
def test_a_scene_is_read_as_it_was_written(scene):
    again = scene_of(text_of(scene, scene.path).encode(), scene.path)
    # Paths are the same files, whatever they are called.
    assert {k: as_path(v) for k, v in again.options.items()} == {k: as_path(v) for k, v in scene.options.items()}
    assert (again.fabrics, again.attachments, again.colliders) == (scene.fabrics, scene.attachments, scene.colliders)
    assert text_of(again, scene.path) == text_of(scene, scene.path)


def as_path(value: object) -> object:
    if isinstance(value, list):
        return list(map(as_path, value))
    return str(value).removeprefix("./") if isinstance(value, str | Path) else value


def test_paths_are_from_the_files_folder_also_in_a_file_elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in ("here", "there"):
        Path(folder).mkdir()
    Path("here/one.toml").write_text(
        'clip = "a.bvh"\nskeleton = "package://g1/g1.urdf"\nhitboxes = "body"\noutput = "out"\n'
        'script = "walk 2s, b.bvh 1s"\npackages = ["p", "/q"]\n'
    )
    one = read_scene("here/one.toml")
    assert one.options == {
        "clip": "here/a.bvh",
        "skeleton": "package://g1/g1.urdf",
        "hitboxes": "body",
        "output": Path("here/out"),
        "script": "walk 2s, here/b.bvh 1s",
        "packages": [Path("here/p"), Path("/q")],
    }
    save(one, "there/two.toml")
    two = read_scene("there/two.toml")
    assert two.options["clip"] == "there/../here/a.bvh"
    assert two.options["output"] == Path("there/../here/out")
    assert two.options["packages"] == [Path("there/../here/p"), Path("/q")]
    assert two.options["script"] == "walk 2s, there/../here/b.bvh 1s"
    assert two.options["hitboxes"] == "body"


def test_what_is_written_commented_is_read_and_so_is_each_comment():
    text = commented(HERE, {})
    assert read(text).options == {**RUNS}
    for key in keys():
        options = text.removesuffix(TABLES_TOLD)
        alone = re.findall(rf"^#?({re.escape(key)} = .*)$", options, flags=re.MULTILINE)
        assert len(alone) == 1
        assert list(read(alone[0]).options) == [key]
    tables = read(re.sub(r"^#(?! )", "", TABLES_TOLD, flags=re.MULTILINE))
    assert len(tables.attachments) == len(tables.colliders) == len(tables.fabrics) == 1
    assert tables.tables.fabrics["velvet"] == replace(
        FABRICS["worsted"], density=0.3, stretch=(2500.0, 2000.0), bend=2e-5
    )


def test_what_is_asked_for_is_written():
    asked = {"script": "idle 1s, run", "wind": (1.0, 0.0, 0.5), "self-contact": False}
    assert read(commented(Path("hero.toml"), asked)).options == {**asked, "wind": [1.0, 0.0, 0.5]}
    assert set(ATTACHMENT_KEYS) > {"bone", "region"}
    assert "density" in FABRIC_KEYS


@pytest.fixture(scope="module")
def body() -> tuple[skeleton.Skeleton, skeleton.BoneTrack]:
    return walking(0.1)


def test_attachments_take_their_vertices_over_from_the_garments_own(body):
    who, track = body
    own = dress(who, track, garment="back_cape", spacing=0.08)
    top = own.cloth.region("top")
    tables = read(f'[[attachment]]\nbone = "head"\nvertices = [{top[0]}, {top[-1] + 3}]\nstiffness = 5.0\n').tables
    scene = tables.added_to(own, track)
    added = scene.attachments[-1]
    assert added.bone == "head"
    assert added.stiffness is not None
    assert added.stiffness.tolist() == [5.0, 5.0]
    held = np.concatenate([one.vertices for one in scene.attachments])
    assert len(held) == len(set(held.tolist()))
    assert set(held.tolist()) == {*np.concatenate([one.vertices for one in own.attachments]).tolist(), top[-1] + 3}
    for before, after in zip(own.attachments, scene.attachments, strict=False):
        kept = np.isin(before.vertices, after.vertices)
        for name in ("points", "weights", "stiffness"):
            if getattr(before, name) is not None:
                assert np.array_equal(getattr(before, name)[kept], getattr(after, name))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('[[attachment]]\nbone = "chest"\nregion = "nope"', "no cloth region"),
        ('[[attachment]]\nbone = "tail"\nregion = "top"', "no bone"),
        ('[[attachment]]\nbone = "chest"\nvertices = [99999]', "99999"),
        ('[[attachment]]\nbone = "chest"\nregion = "top"\nstiffness = -1.0', "stiffness"),
    ],
)
def test_an_attachment_that_does_not_fit_is_told_with_its_line(text, told, body):
    who, track = body
    scene = dress(who, track, garment="back_cape", spacing=0.08)
    with pytest.raises(FileError, match=f"line 2: .*{told}"):
        read("\n" + text).tables.added_to(scene, track)


def test_a_collider_on_a_bone_that_is_not_there_is_told_with_its_line(body):
    tables = read('\n[[collider]]\nname = "x"\nkind = "sphere"\ncenter = [0, 0, 0]\nradius = 1\nbone = "tail"').tables
    with pytest.raises(FileError, match="line 2: no bone named 'tail'"):
        tables.require_bones(body[1])


@pytest.mark.parametrize(
    ("text", "error", "line"),
    [
        ("seed = 1\nspacing = -1", "spacing must be positive, not -1", 2),
        ('seed = 1\nclip = "no.bvh"', "can't read scenes/no.bvh: no such file", 2),
        ('seed = 1\nattach = ["tail=Hips"]', "no role named 'tail'; available: chest", 2),
        ("wind = [0, 0, 0]\ngusts = 0.1", "gusts are a share of the wind", 2),
        ("seed = 1", "no more memory", None),
    ],
)
def test_an_error_of_the_run_is_told_with_the_line_of_its_key(text, error, line):
    scene = read(text)
    with pytest.raises(UserError) as caught, scene.telling():
        raise UserError(error)
    assert str(caught.value) == (error if line is None else f"{HERE}, line {line}: {error}")
    if line is not None:
        with pytest.raises(UserError) as caught, scene.telling(overridden=scene.options):
            raise UserError(error)
        assert str(caught.value) == error
