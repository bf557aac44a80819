"""What holds for every registered shape: a new one is covered by the line that registers it.

What a shape says of itself is held against the rest of it: its distance for the solvers against that for measuring,
both against its support function, and that against points on its surface. References that share nothing with the shapes
are in tests/test_distance.py.
"""

# Coal lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false, reportAttributeAccessIssue=false

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import cape
from cape import record
from cape.report.shown.page import PENETRATION
from cape.results.penetration import crossings, penetration
from motions import quaternions
from motions.errors import FileError, UnknownNameError, ValueRangeError
from skeleton import Hitboxes, Skeleton, add_to_geometry_model, load_hitboxes
from skeleton.placed_solids import as_capsules
from skeleton.shapes import (
    SHAPES,
    Bounded,
    FloatArray,
    Layout,
    Shape,
    TaperedCapsule,
    balls_of,
    require_known,
    shape_named,
    word_of,
)
from skeleton.shapes.outlines import EllipsoidOutline, MeshOutline, Outline
from skeleton.solid_measures import signed_distance, volume
from tests.support.scenes import grid_cloth
from tests.support.takes import take_of

ROUNDING = 1e-12  # m, of lengths up to 5 m
# Where one sphere of a tapered capsule nearly holds the other, its axis is nearly parallel to the surface's normal: the
# root of a double's last digit.
TAPERED = 1e-7
THROUGH = 2000
"""Directions and points that stand for all."""

every_word = pytest.mark.parametrize("word", SHAPES)
bounded_words = [word for word, shape in SHAPES.items() if issubclass(shape, Bounded)]
every_bounded = pytest.mark.parametrize("word", bounded_words)

numbers = st.floats(-1.0, 1.0).map(lambda x: round(x, 9))
sizes = st.floats(0.02, 0.5)
turns = st.tuples(*(numbers,) * 4).filter(lambda q: np.linalg.norm(q) > 0.1).map(np.array).map(quaternions.normalize)
slow = settings(deadline=None, max_examples=40)


@st.composite
def solids(draw: st.DrawFn, word: str, bone: str | None = "bone") -> Any:
    """A solid of a registered shape, by what its fields are called; where that makes no sense, none."""
    shape, values = SHAPES[word], {}
    for key, size in shape.numbers.items():
        if key == "rotation_wxyz":
            values[key] = draw(turns)
        elif size:
            each = sizes if "radi" in key or "size" in key else numbers
            values[key] = np.array(draw(st.tuples(*(each,) * size)))
        else:
            values[key] = draw(sizes)
    try:
        return shape(name="solid", bone=bone, **values)
    except ValueRangeError:
        assume(False)


@cache
def directions() -> FloatArray:
    """Unit vectors, the axes among them, shape (N, 3)."""
    vectors = np.random.default_rng(0).standard_normal((THROUGH, 3))
    vectors = np.concatenate([vectors, np.eye(3), -np.eye(3)])
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def nearest(solid: Shape, point: FloatArray) -> tuple[float, FloatArray]:
    """Distance of a point in the bone's frame and normal there, as the solvers have them."""
    distances, normals = nearest_to_each(solid, point[None])
    return float(distances[0]), normals[0]


def nearest_to_each(solid: Shape, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances of points (N, 3) and normals there, as `nearest` has them, shapes (N,) and (N, 3)."""
    layout = solid.layout()
    sizes = (*layout.sizes, 0.0, 0.0, 0.0, 0.0)[:4]
    own = (points - layout.origin) @ layout.rotation
    found = np.array([type(solid).nearest(x, y, z, *sizes) for x, y, z in own.tolist()])
    return found[:, 0], found[:, 1:] @ layout.rotation.T


def on_surface(solid: Shape, seed: int = 1, count: int = 300) -> tuple[FloatArray, FloatArray]:
    """Points on a solid's surface, led there from random places around it, and normals there, shape (N, 3) each."""
    places = 1.5 * np.random.default_rng(seed).standard_normal((count, 3))
    distances, normals = nearest_to_each(solid, places)
    return places - distances[:, None] * normals, normals


# -- what a shape is --


@every_word
def test_a_shape_has_its_fields_by_keyword_and_a_default_for_each(word: str):
    shape: Any = SHAPES[word]
    names = {field.name for field in fields(shape)}
    assert names == {"name", "bone", "friction", "thickness", *shape.numbers}
    assert set(shape.optional) <= set(shape.numbers)
    assert shape_named(word) is shape
    assert word.replace("_", " ") == shape.kind()
    if word == "capsule":  # whose fields have an order instead
        return
    solid = shape()
    assert (solid.bone, solid.friction, solid.thickness) == (None, None, None)
    assert solid.name == shape.kind()
    assert word_of(solid) == word
    with pytest.raises(TypeError):
        shape("by place")
    for key, size in shape.numbers.items():
        if size:
            assert not getattr(solid, key).flags.writeable
            with pytest.raises(ValueRangeError, match=f"{shape.kind()} '.*': {key} must be {size} finite numbers"):
                shape(**{key: np.full(size, np.nan)})
            with pytest.raises(ValueRangeError, match=f"{key} must be {size} finite numbers"):
                shape(**{key: np.ones(size + 1)})
        else:
            for wrong in (-1.0, 0.0, np.nan, np.inf):
                with pytest.raises(ValueRangeError, match=f"{shape.kind()} '.*'.*must be positive"):
                    shape(**{key: wrong})
    for key in ("friction", "thickness"):
        with pytest.raises(ValueRangeError, match=f"{key} must be zero or more, not -1"):
            shape(**{key: -1})
    assert shape(friction=0.5, thickness=0.01).friction == 0.5


def test_a_cylinder_has_a_length_and_an_ellipsoid_radii_and_a_turn():
    with pytest.raises(ValueRangeError, match="cylinder 'c': start and end must be apart"):
        cape.Cylinder(name="c", start=np.ones(3), end=np.ones(3))
    with pytest.raises(ValueRangeError, match="ellipsoid 'e': radii must be positive"):
        cape.Ellipsoid(name="e", radii=np.array([0.1, 0.0, 0.1]))
    with pytest.raises(ValueRangeError, match="ellipsoid 'e': rotation_wxyz must be of unit length"):
        cape.Ellipsoid(name="e", rotation_wxyz=np.ones(4))


@every_word
@slow
@given(data=st.data())
def test_kind_and_size_are_told(word: str, data: st.DataObject):
    assert data.draw(solids(word)).describe().startswith(word.replace("_", " "))


# -- distances --


@every_word
@slow
@given(data=st.data(), point=st.tuples(numbers, numbers, numbers).map(np.array))
def test_solvers_and_measures_know_the_same_distance(word: str, data: st.DataObject, point: FloatArray):
    solid = data.draw(solids(word))
    tolerance = TAPERED if word == "tapered_capsule" else 2 * ROUNDING
    for place in (point, 3.0 * point, solid.layout().origin):
        distance, normal = nearest(solid, place)
        assert distance == pytest.approx(signed_distance(solid, place[None])[0], abs=tolerance)
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-9)


@every_bounded
@slow
@given(data=st.data(), point=st.tuples(numbers, numbers, numbers).map(np.array))
def test_the_distance_is_the_most_by_which_a_plane_parts_point_and_solid(word: str, data, point: FloatArray):
    # For every convex solid the signed distance is the largest n p - support(n) of all unit vectors n, inside as well.
    solid = data.draw(solids(word))
    tolerance = TAPERED if word == "tapered_capsule" else 10 * ROUNDING
    distance, normal = nearest(solid, point)
    assert (directions() @ point - solid.support(directions())).max() <= distance + tolerance
    assert normal @ point - solid.support(normal[None])[0] == pytest.approx(distance, abs=tolerance)


@every_word
@slow
@given(data=st.data(), point=st.tuples(numbers, numbers, numbers).map(np.array))
def test_the_normal_is_the_slope_of_the_distance(word: str, data: st.DataObject, point: FloatArray):
    solid, step = data.draw(solids(word)), 1e-6
    _, normal = nearest(solid, point)
    ahead, behind = (
        signed_distance(solid, point + sign * step * np.eye(3)) - signed_distance(solid, point[None])
        for sign in (1.0, -1.0)
    )
    # A convex function lies above its tangents, at a kink as well; where it has none within a step, its slope is that.
    slack = 2 * TAPERED * step if word == "tapered_capsule" else 10 * ROUNDING
    assert (ahead >= step * normal - max(slack, 10 * ROUNDING)).all()
    assert (behind >= -step * normal - max(slack, 10 * ROUNDING)).all()
    smooth = ahead + behind < step * step / 0.05
    np.testing.assert_allclose(((ahead - behind) / (2 * step))[smooth], normal[smooth], atol=step / 0.05 + 1e-5)


@every_word
@slow
@given(data=st.data())
def test_the_sign_tells_inside_from_outside(word: str, data: st.DataObject):
    solid = data.draw(solids(word))
    points, normals = on_surface(solid, count=60)
    np.testing.assert_allclose(signed_distance(solid, points), 0.0, atol=TAPERED)
    np.testing.assert_allclose(signed_distance(solid, points + 0.1 * normals), 0.1, atol=TAPERED)
    assert (signed_distance(solid, (points + points[::-1]) / 2.0) <= TAPERED).all()
    if isinstance(solid, Bounded):
        assert signed_distance(solid, points.mean(axis=0)[None])[0] < 0.0


# -- extents --


@every_bounded
@slow
@given(data=st.data(), position=st.tuples(numbers, numbers, numbers).map(np.array), turn=turns)
def test_extents_hold_the_surface_closely(word: str, data: st.DataObject, position: FloatArray, turn: FloatArray):
    solid = data.draw(solids(word))
    points, normals = on_surface(solid)
    # Where the surface has a normal, the solid goes as far along that as the surface there.
    reached = np.einsum("ij,ij->i", points, normals)
    np.testing.assert_allclose(solid.support(normals), reached, atol=TAPERED)
    assert (points @ directions().T <= solid.support(directions()) + TAPERED).all()

    low, high = solid.bounds()
    assert (low <= points + TAPERED).all()
    assert (points <= high + TAPERED).all()
    # The box touches the solid: on each of its faces the distance from it has its least.
    for side, axis in ((low, -np.eye(3)), (high, np.eye(3))):
        np.testing.assert_allclose(solid.support(axis), np.diag(axis) * side, atol=ROUNDING)

    centers, radii = balls_of(solid)
    held = (directions() @ centers.T + radii).max(axis=1)
    assert (solid.support(directions()) <= held + ROUNDING).all()

    lowest = solid.lowest(position[None], turn[None])[0]
    assert (quaternions.rotate(turn, points) + position)[:, 2].min() >= lowest - TAPERED
    down = quaternions.rotate(quaternions.conjugate(turn), np.array([0.0, 0.0, -1.0]))
    assert lowest == pytest.approx(position[2] - solid.support(down[None])[0], abs=10 * ROUNDING)


@every_bounded
@settings(deadline=None, max_examples=15)
@given(data=st.data(), seed=st.integers(0, 2**31))
def test_the_volume_is_the_share_of_the_box_around_it(word: str, data: st.DataObject, seed: int):
    solid, count = data.draw(solids(word)), 20_000
    low, high = solid.bounds()
    points = np.random.default_rng(seed).uniform(low, high, (count, 3))
    share = float((signed_distance(solid, points) < 0.0).mean())
    expected = volume(solid) / float(np.prod(high - low))
    # Five standard deviations, and a dozen points.
    assert share == pytest.approx(expected, abs=5.0 * math.sqrt(expected * (1.0 - min(expected, 1.0)) / count) + 6e-4)


@every_bounded
@slow
@given(data=st.data(), share=st.floats(0.05, 0.95))
def test_a_core_is_deep_inside(word: str, data: st.DataObject, share: float):
    solid = data.draw(solids(word))
    core, inner = solid.core(share), solid.layout().core
    if isinstance(solid, TaperedCapsule):  # whose smaller sphere has a core, too, if it is in the larger one
        inner = min(solid.start_radius, solid.end_radius)
    assert core is not None
    assert type(core) is type(solid)
    points, _ = on_surface(core, count=60)
    assert (signed_distance(solid, points) <= -(1.0 - share) * inner + TAPERED).all()


@every_word
@slow
@given(data=st.data(), thickness=st.floats(0.001, 0.1))
def test_a_grown_solid_is_about_as_much_larger(word: str, data: st.DataObject, thickness: float):
    solid = data.draw(solids(word))
    points, _ = on_surface(solid.grown(thickness), count=60)
    off = signed_distance(solid, points)
    # Sharp edges stay sharp and stick out by up to the root of 3; the axes of an ellipsoid alone grow by all of it.
    assert (off > 0.0).all()
    assert (off <= math.sqrt(3.0) * thickness + TAPERED).all()
    assert (solid.name, solid.bone) == (solid.grown(thickness).name, solid.grown(thickness).bone)


def test_side_and_ends_of_a_grown_cylinder_and_the_axes_of_a_grown_ellipsoid_are_as_far_out():
    can = cape.Cylinder(start=np.array([0.1, 0, 0]), end=np.array([0.1, 0, 0.4]), radius=0.2)
    on = np.array([[0.1, 0.2, 0.2], [0.1, 0, 0], [0.2, 0, 0.4]])
    out = np.array([[0, 1, 0], [0, 0, -1], [0, 0, 1.0]])
    np.testing.assert_allclose(signed_distance(can.grown(0.05), on + 0.05 * out), 0.0, atol=ROUNDING)
    egg = cape.Ellipsoid(radii=np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(signed_distance(egg.grown(0.05), np.diag(egg.radii + 0.05)), 0.0, atol=ROUNDING)
    points, normals = on_surface(egg)
    assert (signed_distance(egg.grown(0.05), points + 0.05 * normals) >= -ROUNDING).all()


@every_word
@slow
@given(data=st.data())
def test_a_limb_of_any_shape_has_a_capsule_as_long(word: str, data: st.DataObject):
    solid = data.draw(solids(word))
    capsules = as_capsules([solid])
    if word in ("box", "plane"):
        assert capsules == []
    else:
        (capsule,) = capsules
        assert (capsule.name, capsule.bone) == (solid.name, solid.bone)
        assert signed_distance(solid, ((capsule.start + capsule.end) / 2.0)[None])[0] < 0.0
    if word in ("cylinder", "ellipsoid"):
        (capsule,) = capsules
        axis = capsule.end - capsule.start
        if np.linalg.norm(axis) > 1e-6:
            ends = np.stack([axis, -axis]) / np.linalg.norm(axis)
            np.testing.assert_allclose(capsule.support(ends), solid.support(ends), atol=1e-9)


# -- other forms --


@every_word
@slow
@given(
    data=st.data(),
    name=st.text(st.characters(codec="utf-8")),
    friction=st.none() | st.floats(0.0, 2.0),
    thickness=st.none() | st.floats(0.0, 0.1),
)
def test_what_a_file_holds_is_what_was_written(word: str, data, tmp_path_factory, name, friction, thickness):
    path = tmp_path_factory.getbasetemp() / f"{word}.toml"
    bone = data.draw(st.none() | st.just("neck"))
    drawn = data.draw(solids(word, bone))
    values = {key: getattr(drawn, key) for key in drawn.numbers}
    solid = SHAPES[word](name=name, bone=bone, friction=friction, thickness=thickness, **values)
    Hitboxes("robot", (solid,)).save(path)
    (back,) = load_hitboxes(path).solids
    assert type(back) is type(solid)
    for field in fields(solid):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(solid, field.name))
    assert f"#   {word}: {', '.join(solid.numbers)}" in path.read_text()


@every_word
@slow
@given(data=st.data())
def test_the_outline_lies_on_the_surface(word: str, data: st.DataObject):
    solid = data.draw(solids(word))
    outline = solid.outline()
    assert isinstance(outline, Outline)
    if isinstance(outline, MeshOutline):
        vertices, normals = (
            quaternions.rotate(outline.rotation_wxyz, v.astype(float)) for v in (outline.vertices, outline.normals)
        )
        vertices = vertices + outline.origin
        np.testing.assert_allclose(signed_distance(solid, vertices), 0.0, atol=1e-6)  # in single precision
        np.testing.assert_allclose(signed_distance(solid, vertices + 0.1 * normals), 0.1, atol=1e-6)
        middle = quaternions.rotate(outline.rotation_wxyz, outline.middle) + outline.origin
        assert signed_distance(solid, middle[None])[0] < 0.0
    if isinstance(outline, EllipsoidOutline):
        tips = quaternions.rotate(outline.rotation_wxyz, np.diag(outline.half_sizes)) + outline.center
        np.testing.assert_allclose(signed_distance(solid, tips), 0.0, atol=10 * ROUNDING)


@every_word
@settings(deadline=None, max_examples=15)
@given(data=st.data(), place=st.tuples(numbers, numbers, numbers).map(np.array))
def test_coal_measures_the_same_distance(word: str, data: st.DataObject, place: FloatArray):
    import coal

    solid = data.draw(solids(word))
    place = 3.0 * place
    expected = signed_distance(solid, place[None])[0]
    assume(expected > 0.1)
    geometry, rotation, center = solid.collision_geometry()
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    at, there = coal.Transform3s(quaternions.to_matrix(rotation), np.array(center)), coal.Transform3s()
    there.setTranslation(place)
    distance = coal.distance(geometry, at, coal.Sphere(0.05), there, request, result) + 0.05
    # By an iteration to 1e-6 m; a tapered capsule is a polyhedron around it, up to 0.5 % of its larger radius.
    slack = 0.005 * 0.5 if word == "tapered_capsule" else 0.0
    assert expected - slack - 1e-5 <= distance <= expected + 1e-5


@pytest.fixture(scope="module")
def draped() -> cape.Take:
    """A sheet that falls onto a standing cylinder and an ellipsoid side by side, so that it meets their edges too."""
    sheet = cape.Cloth.rectangle(
        width=0.8, height=0.5, spacing=0.025, origin=(-0.4, -0.25, 0.36), right=(1, 0, 0), down=(0, 1, 0)
    )
    colliders = [
        cape.Cylinder(start=np.array([-0.2, 0.0, 0.0]), end=np.array([-0.2, 0.0, 0.35]), radius=0.1),
        cape.Ellipsoid(center=np.array([0.2, 0.0, 0.2]), radii=np.array([0.12, 0.2, 0.15])),
        cape.Cylinder(name="far", start=np.full(3, 9.0), end=np.full(3, 9.5)),
        cape.Ellipsoid(name="farther", center=np.full(3, 12.0)),
    ]
    scene = cape.Scene(sheet, [], colliders)
    simulation = cape.Simulation(scene)
    simulation.start({})
    places = [simulation.positions.copy()]
    for _ in range(40):
        simulation.step({}, 1 / 60)
        places.append(simulation.positions.copy())
    return take_of(np.array(places), sheet.triangles, colliders)


def test_cloth_lies_on_a_cylinder_and_an_ellipsoid(draped: cape.Take):
    deep = penetration(draped, frames=np.arange(0, 41, 4))
    assert deep.vertices.depth.max() < PENETRATION
    assert deep.faces.depth.max() < PENETRATION
    assert crossings(draped).sum() == 0
    # It has met both, with many of its vertices.
    points = draped.positions.astype(float)
    near = [signed_distance(solid, points.reshape(-1, 3)).reshape(points.shape[:2]) for solid in draped.colliders]
    met = [int((distances < 1.2 * draped.thickness).any(axis=0).sum()) for distances in near]
    assert met[0] > 20
    assert met[1] > 20
    assert met[2:] == [0, 0]


# -- what is no registered shape --


@dataclass(frozen=True, eq=False, kw_only=True)
class Slab(Shape):
    """What lies between two planes: a shape that nothing outside of this class knows."""

    name: str = "slab"
    middle: FloatArray
    half_height: float

    numbers: ClassVar[Mapping[str, int]] = {"middle": 3, "half_height": 0}

    @staticmethod
    def nearest(x, y, z, half_height, _f, _g, _h):
        return abs(z) - half_height, 0.0, 0.0, math.copysign(1.0, z)

    def _check(self) -> None:
        self._require(self.half_height > 0.0, "half_height must be positive", self.half_height)

    def describe(self) -> str:
        return f"slab of {2000 * self.half_height:.0f} mm"

    def layout(self) -> Layout:
        return Layout(self.middle, np.eye(3), (self.half_height,), self.half_height, math.inf)

    def distances(self, points: FloatArray) -> FloatArray:
        return np.abs(points[:, 2] - self.middle[2]) - self.half_height

    def volume(self) -> float:
        return math.inf

    def grown(self, thickness: float) -> "Slab":
        return Slab(name=self.name, middle=self.middle, half_height=self.half_height + thickness)

    def core(self, share: float) -> "Slab":
        return Slab(name=self.name, middle=self.middle, half_height=share * self.half_height)

    def outline(self) -> EllipsoidOutline:
        return EllipsoidOutline(self.middle, np.array([5.0, 5.0, self.half_height]), np.array([1.0, 0.0, 0.0, 0.0]))

    def collision_geometry(self) -> Any:
        raise NotImplementedError


SLAB = Slab(middle=np.array([0.0, 0.0, 0.2]), half_height=0.1)
STRIP = grid_cloth([0, 0.1, 0.2], [0, 0.1], cape.Fabric())
UNKNOWN = "no shape named 'Slab'; available: capsule, tapered_capsule, sphere, box, plane, cylinder, ellipsoid"


UP = np.array([0.0, 0.0, 1.0])


def strip_take() -> cape.Take:
    return take_of(np.stack([STRIP.positions, STRIP.positions + UP]), STRIP.triangles, [SLAB])


@pytest.mark.parametrize(
    "use",
    [
        lambda _: word_of(SLAB),
        lambda _: require_known([cape.Sphere(), SLAB]),
        lambda _: cape.Scene(STRIP, [], [SLAB]),
        lambda _: signed_distance(SLAB, np.zeros((1, 3))),
        lambda _: volume(SLAB),
        lambda _: as_capsules([SLAB]),
        lambda _: penetration(strip_take()),
        lambda _: crossings(strip_take()),
        lambda folder: strip_take().save(folder / "slab.rrd"),
        lambda folder: record.save_hitboxes(strip_take().bones, [SLAB], folder / "slab.rrd", name="slab"),
        lambda folder: Hitboxes("robot", (SLAB,)).save(folder / "slab.toml"),
        lambda _: add_to_geometry_model([SLAB], Skeleton.from_urdf("simple_humanoid")),
    ],
    ids=[
        "by word", "among others", "a scene", "distances", "volume", "a motion's check", "penetration", "crossings",
        "a recording", "hitboxes alone in a recording", "a file", "Pinocchio",
    ],
)  # fmt: skip
def test_a_class_that_is_not_registered_is_refused_everywhere(use: Any, tmp_path: Path):
    with pytest.raises(UnknownNameError) as caught:
        use(tmp_path)
    assert str(caught.value) == UNKNOWN
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_shape_at_all_is_refused_alike():
    with pytest.raises(UnknownNameError, match="no shape named 'str'; available: capsule"):
        cape.Scene(STRIP, [], ["sphere"])  # pyright: ignore[reportArgumentType]


def test_a_word_that_means_no_shape_is_refused(tmp_path: Path):
    with pytest.raises(UnknownNameError, match=UNKNOWN.replace("Slab", "slab")):
        shape_named("slab")
    (tmp_path / "slab.toml").write_text('[[solid]]\nname = "s"\nkind = "slab"\n')
    with pytest.raises(FileError, match=r"slab.toml: solid 1 \('s'\): " + UNKNOWN.replace("Slab", "slab")):
        load_hitboxes(tmp_path / "slab.toml")


def test_a_line_in_the_registry_is_all_that_a_new_shape_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(SHAPES, "slab", Slab)
    Hitboxes("robot", (SLAB,)).save(tmp_path / "slab.toml")
    (back,) = load_hitboxes(tmp_path / "slab.toml").solids
    assert isinstance(back, Slab)
    assert (back.middle.tolist(), back.half_height) == ([0.0, 0.0, 0.2], 0.1)
    (tmp_path / "half.toml").write_text('[[solid]]\nname = "s"\nkind = "slab"\nmiddle = [0, 0, 1]\n')
    with pytest.raises(FileError, match="lacks half_height; a slab has middle, half_height"):
        load_hitboxes(tmp_path / "half.toml")

    assert signed_distance(back, np.array([[3.0, 4.0, 0.25], [0.0, 0.0, 1.0]])).tolist() == pytest.approx([-0.05, 0.7])
    assert nearest(back, np.array([0.0, 0.0, 1.0]))[0] == pytest.approx(0.7)
    assert penetration(strip_take()).vertices.depth.tolist() == pytest.approx([0.0, 0.0])
    inside = take_of(STRIP.positions + (0.15 - STRIP.positions[:, 2].mean()) * UP, STRIP.triangles, [SLAB])
    assert penetration(inside).vertices.depth[0] > 0.05
    assert as_capsules([SLAB]) == []

    strip_take().save(tmp_path / "slab.rrd")
    from tests.record.test_record import Recording

    recording = Recording(tmp_path / "slab.rrd")
    (half,) = recording.array("/world/colliders/slab", "Ellipsoids3D:half_sizes", static=True)
    np.testing.assert_allclose(half, [[5.0, 5.0, 0.1]], rtol=1e-6)
    (half,) = recording.array("/world/shells/slab", "Ellipsoids3D:half_sizes", static=True)
    np.testing.assert_allclose(half, [[5.0, 5.0, 0.105]], rtol=1e-6)

    simulation = cape.Simulation(cape.Scene(STRIP.moved(UP), [], [SLAB], thickness=0.01))
    for _ in range(60):
        simulation.step({}, 1 / 60)
    # It has fallen by half a metre and more onto the slab, whose top is at 0.3 m.
    assert 0.3 < simulation.positions[:, 2].min() < 0.32
