"""Twenty meshes by formula, each of which ends in a cloth or in a reason."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cape.cloth.cloth import Cloth, MeshCloth, areas
from cape.cloth.triangle_mesh import edges_of
from cape.meshes.cleaning.clean import clean
from cape.meshes.edges import borders, top_edge
from cape.meshes.reading import read_cloth
from cape.meshes.source import Source
from motions.errors import ValueRangeError
from tests.meshes.mesh_files import box, obj, sheet, tube

Mesh = tuple[np.ndarray, np.ndarray]


def mobius(count: int = 24) -> Mesh:
    """A strip that is turned once before it is closed."""
    angles = 2.0 * np.pi * np.arange(count) / count
    sides = []
    for side in (-0.1, 0.1):
        radii = 0.5 + side * np.cos(angles / 2.0)
        sides.append(np.stack([radii * np.cos(angles), radii * np.sin(angles), side * np.sin(angles / 2.0)], axis=1))
    points = np.concatenate(sides)
    faces = []
    for k in range(count):
        a, b = k, k + count
        c, d = (k + 1, k + 1 + count) if k < count - 1 else (count, 0)
        faces += [[a, b, c], [c, b, d]]
    return points, np.array(faces)


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(points) for points, _ in meshes)])
    return (
        np.concatenate([points for points, _ in meshes]),
        np.concatenate([faces + start for (_, faces), start in zip(meshes, starts, strict=False)]),
    )


def moved(mesh: Mesh, *shift: float, scale: float = 1.0) -> Mesh:
    return scale * mesh[0] + np.array(shift or (0.0, 0.0, 0.0)), mesh[1]


def changed(mesh: Mesh, at: int, value: float) -> Mesh:
    points = mesh[0].copy()
    points[at, 1] = value
    return points, mesh[1]


def flipped(mesh: Mesh, every: int) -> Mesh:
    faces = mesh[1].copy()
    faces[::every] = faces[::every, ::-1]
    return mesh[0], faces


def soup(mesh: Mesh) -> Mesh:
    """Each triangle with vertices of its own."""
    return mesh[0][mesh[1]].reshape(-1, 3), np.arange(mesh[1].size).reshape(-1, 3)


def with_fin(mesh: Mesh) -> Mesh:
    """A third triangle at an edge inside."""
    points, faces = mesh
    return np.concatenate([points, [[0.5, 0.15, -0.15]]]), np.concatenate([faces, [[*faces[7, 1:], len(points)]]])


def with_cap(mesh: Mesh) -> Mesh:
    """A triangle's long side gets a vertex beside its middle: that one's neighbour becomes a flat cap and two more."""
    points, faces = mesh
    a, b, c = faces[0]
    middle = 0.5 * (points[b] + points[c]) + 1e-5 * (points[a] - points[b])
    new = len(points)
    return np.concatenate([points, [middle]]), np.concatenate(
        [faces[1:], [[a, b, new], [a, new, c], [b, c, new][::-1]]]
    )


SHEET, TUBE = sheet(6, 7), tube(12, 5, 0.2, 0.5)
COUNT = len(SHEET[0])
MESHES: dict[str, tuple[Callable[[], Mesh], str | int]] = {
    "open sheet": (lambda: SHEET, COUNT),
    "open tube": (lambda: TUBE, len(TUBE[0])),
    "closed cube": (lambda: box(0.5), 8),
    "one triangle": (lambda: (SHEET[0][[0, 1, 7]], np.array([[0, 1, 2]])), 3),
    "no area at all": (lambda: (SHEET[0][:7], np.array([[0, 1, 2], [2, 3, 4]])), "no triangle with an area"),
    "one triangle without area": (lambda: (SHEET[0], np.vstack([SHEET[1], [[0, 1, 2]]])), COUNT),
    "a triangle with a corner twice": (lambda: (SHEET[0], np.vstack([SHEET[1], [[3, 3, 4]]])), COUNT),
    "duplicated triangles": (lambda: (SHEET[0], np.vstack([SHEET[1], SHEET[1][:5]])), COUNT),
    "duplicated turned round": (lambda: (SHEET[0], np.vstack([SHEET[1], SHEET[1][:, ::-1]])), COUNT),
    "triangle soup": (lambda: soup(SHEET), COUNT),
    "not a number": (
        lambda: changed(SHEET, 9, np.nan),
        "1 vertices of the mesh are not finite or beyond reason, the first",
    ),
    "infinite": (lambda: changed(SHEET, 0, np.inf), "the first is 0"),
    "beyond reason": (lambda: changed(SHEET, 4, 1e30), "not finite or beyond reason"),
    "huge": (lambda: moved(SHEET, scale=1e8), "the mesh reaches"),
    "tiny": (lambda: moved(SHEET, scale=1e-7), "positions are in metres"),
    "two parts": (lambda: joined(SHEET, moved(TUBE, 2.0, 0.0, 0.0)), COUNT + len(TUBE[0])),
    "a button": (lambda: joined(SHEET, moved(box(0.02), 0.05, 0.3, -0.2)), COUNT),
    "some flipped": (lambda: flipped(SHEET, 3), COUNT),
    "a fin": (lambda: with_fin(SHEET), "1 edges of the mesh belong to more than two triangles: 3 at ("),
    "two tubes that share an edge line": (
        lambda: joined(SHEET, (SHEET[0] @ np.diag([1.0, -1.0, 1.0]), SHEET[1]), (SHEET[0][:, [1, 0, 2]], SHEET[1])),
        "belong to more than two triangles",
    ),
    "a flat cap": (lambda: with_cap(SHEET), COUNT + 1),
    "a strip with one side": (mobius, "one side only"),
    "unused vertices": (lambda: (np.vstack([SHEET[0], [[np.nan, 0.0, 0.0]]]), SHEET[1]), COUNT),
}


def cloth_of(source: Source) -> MeshCloth:
    cleaned = clean(source)
    return Cloth.from_mesh(cleaned.positions, cleaned.triangles)


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_ends_in_a_cloth_or_in_a_reason(name):
    make, expected = MESHES[name]
    source = Source(*make())
    if isinstance(expected, str):
        with pytest.raises(ValueRangeError) as caught:
            cloth_of(source)
        assert expected in str(caught.value)
        assert "\n" not in str(caught.value)
        return
    cloth = cloth_of(source)
    assert cloth.vertices == expected
    edges = edges_of(cloth.faces)
    # Turned alike, the two triangles of an edge go along it against each other.
    starts = cloth.faces.ravel()[edges.sides]
    assert (starts[:, 0] != starts[:, 1]).all()


@pytest.mark.parametrize("name", ["triangle soup", "duplicated triangles", "some flipped", "one triangle without area"])
def test_what_was_done_is_told_and_the_surface_is_whole(name):
    cleaned = clean(Source(*MESHES[name][0]()))
    assert cleaned.notes
    assert areas(cleaned.positions[cleaned.triangles]).sum() == pytest.approx(
        areas(SHEET[0][SHEET[1]]).sum(), rel=1e-12
    )
    (border,) = borders(cleaned.triangles)
    assert len(border) == 2 * (6 + 7) - 4


def test_a_cap_is_turned_away_without_a_hole():
    cleaned = clean(Source(*with_cap(SHEET)))
    assert any("slivers" in note for note in cleaned.notes)
    assert areas(cleaned.positions[cleaned.triangles]).sum() == pytest.approx(areas(SHEET[0][SHEET[1]]).sum(), rel=1e-3)
    assert len(borders(cleaned.triangles)) == 1


def test_the_larger_area_keeps_its_outside():
    points, faces = flipped(SHEET, 3)
    cleaned = clean(Source(points, faces))
    corners = cleaned.positions[cleaned.triangles]
    outside = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 0]
    before = SHEET[0][SHEET[1][0]]
    assert np.array_equal(
        np.sign(outside), np.full(len(outside), np.sign(np.cross(before[1] - before[0], before[2] - before[0])[0]))
    )


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_cleaning_twice_changes_nothing_more(seed):
    rng = np.random.default_rng(seed)
    points, faces = soup(SHEET)
    faces = np.vstack([faces, faces[rng.integers(0, len(faces), 4)]])
    turned = rng.random(len(faces)) < 0.3
    faces[turned] = faces[turned, ::-1]
    once = clean(Source(points, faces[rng.permutation(len(faces))]))
    again = clean(once)
    assert again.notes == once.notes
    assert np.array_equal(again.positions, once.positions)
    assert np.array_equal(again.triangles, once.triangles)


def test_the_top_edge_of_a_tube_is_its_upper_ring_and_of_a_sheet_its_upper_row():
    assert top_edge(*TUBE).tolist() == list(range(12))
    assert top_edge(*SHEET).tolist() == list(range(7))
    assert len(top_edge(*box(1.0))) == 0


def test_too_many_vertices_are_refused_with_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setattr("cape.meshes.reading.MOST_CLOTH_VERTICES", 20)
    path = tmp_path / "a.obj"
    path.write_text(obj(*SHEET))
    with pytest.raises(ValueRangeError, match="has 42 vertices, more than 20: remesh it"):
        read_cloth(path)
