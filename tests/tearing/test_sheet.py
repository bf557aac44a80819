"""Cells that split along edges: no vertex joins two fans, no cell is lost, edges are counted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cape
from cape.run.tearing.sheet import Sheet
from cape.run.tearing.sheets import sheet_of, triangles_of
from motions.errors import ValueRangeError
from tests.tearing.to_tear import fans, mesh_of

GRID = cape.Cloth.rectangle(width=0.25, height=0.3, spacing=0.05)
CLOTHS = {"grid": GRID, "mesh": mesh_of(GRID, jitter=0.01)}


def whole(cloth: cape.Cloth) -> Sheet:
    return sheet_of(cloth, np.zeros(cloth.vertices, bool))


def edges_of(sheet: Sheet) -> np.ndarray:
    sides = np.stack([sheet.cells, np.roll(sheet.cells, -1, axis=1)], axis=2).reshape(-1, 2)
    return np.unique(np.sort(sides, axis=1), axis=0)


@pytest.mark.parametrize("kind", CLOTHS)
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_no_vertex_joins_two_fans_whatever_parts(kind, data):
    cloth = CLOTHS[kind]
    sheet = whole(cloth)
    for _ in range(4):
        edges = edges_of(sheet)
        chosen = data.draw(st.sets(st.integers(0, len(edges) - 1), max_size=12))
        before = sheet
        sheet, copies = sheet.split([tuple(edges[k].tolist()) for k in sorted(chosen)])
        assert fans(triangles_of(cloth, sheet)).max() == 1
        assert np.array_equal(sheet.parents[sheet.cells], whole(cloth).cells)
        assert len(edges_of(sheet)) - len(edges_of(before)) == sheet.tears - before.tears
        assert np.array_equal(sheet.parents[before.vertices :], before.parents[copies])
        for vertex, cells in enumerate(sheet.around):
            assert list(cells) == np.flatnonzero((sheet.cells == vertex).any(axis=1)).tolist()


def test_an_edge_within_parts_nothing_and_two_in_line_do():
    sheet = whole(GRID)
    columns = GRID.columns
    middle = 3 * columns + 2
    same, copies = sheet.split([(middle, middle + 1)])
    assert same is sheet
    assert len(copies) == 0
    slit, copies = sheet.split([(middle - 1, middle), (middle, middle + 1)])
    assert copies.tolist() == [middle]
    assert slit.tears == 2
    # From a border inwards one edge does, and splits the vertex at the border alone.
    notch, copies = sheet.split([(3 * columns, 3 * columns + 1)])
    assert copies.tolist() == [3 * columns]
    assert notch.tears == 1


def test_a_cut_leaves_a_slit_and_a_closed_one_a_piece_of_its_own():
    slit = cape.cut(GRID, along=[[0.0, 0.15], [0.15, 0.15]])
    assert slit.vertices == GRID.vertices + 3
    assert fans(slit.triangles).max() == 1
    assert slit.masses().sum() == pytest.approx(GRID.masses().sum(), rel=1e-12)
    assert slit.regions["left"].tolist() == [*GRID.regions["left"].tolist(), GRID.vertices]
    square = [[0.05, 0.05], [0.15, 0.05], [0.15, 0.2], [0.05, 0.2], [0.05, 0.05]]
    hole = cape.cut(GRID, along=square)
    assert hole.vertices == GRID.vertices + 10
    # In space as in the pattern: it starts below the origin, to the wearer's right.
    again = cape.cut(GRID, along=[[0.0, -u, -v] for u, v in square])
    assert np.array_equal(again.faces, hole.faces)


@pytest.mark.parametrize(
    ("along", "why"),
    [
        ([[0.0, 0.1]], "at least two points"),
        ([[0.0, 0.1], [0.0, np.nan]], "finite"),
        ([[0.1, 0.1], [0.11, 0.1]], "shorter than an edge"),
        ([[0.1, 0.1], [0.15, 0.1]], "nothing parts"),
    ],
)
def test_cuts_that_are_none(along, why):
    with pytest.raises(ValueRangeError, match=why):
        cape.cut(GRID, along=along)


@pytest.mark.parametrize("values", [{}, {"strain": 0.0}, {"force": -1.0}, {"strain": np.nan}, {"force": np.inf}])
def test_tearing_needs_a_positive_number(values):
    with pytest.raises(ValueRangeError, match="part"):
        cape.Tearing(**values)


def test_what_chooses_solvers_does_not_tear():
    holds = [cape.attach(GRID, "rod", "top")]
    tearing = cape.Tearing(strain=0.1)
    with pytest.raises(ValueRangeError, match="name a solver"):
        cape.AutoSimulation(cape.Scene(GRID, holds, tearing=tearing), cape.Auto())
