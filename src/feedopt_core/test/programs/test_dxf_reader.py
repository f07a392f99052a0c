"""DXF drawings: geometry of every entity in closed form, joining, order, units, and what is refused."""

from __future__ import annotations

import io
import itertools
import math

import ezdxf
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.programs.contours import move_ends
from feedopt_core.programs.dxf import read_dxf
from feedopt_core.programs.moves import ArcMove, LineMoves, NurbsMove


def drawing(units: int = 4):
    document = ezdxf.new()
    document.header["$INSUNITS"] = units
    return document, document.modelspace()


def text_of(document):
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue()


def moves_of(document, **options):
    return list(read_dxf(text_of(document), "part.dxf", **options))


def placed(move, count: int = 60):
    """Points along a move, ends included."""
    t = np.linspace(0.0, 1.0, count)
    if isinstance(move, LineMoves):
        return np.concatenate([move.start_mm[None, :], move.points_mm])
    if isinstance(move, ArcMove):
        radius = move.start_mm - move.center_mm
        angle = (move.sweep_rad * t)[:, None]
        return (
            move.center_mm + radius * np.cos(angle) + np.cross(move.normal, radius) * np.sin(angle)
            + move.normal * move.rise_mm * t[:, None]
        )  # fmt: skip
    curve = NurbsCurve.from_control_net(move.degree, move.knots, move.control_points_mm, move.weights)
    return curve.evaluate(move.knots[0] + (move.knots[-1] - move.knots[0]) * t)[0]


def assert_without_gaps(moves):
    """Each move starts exactly where the one before ended, and the parts lead from end to end."""
    for before, after in itertools.pairwise(moves):
        assert np.array_equal(move_ends(before)[1], move_ends(after)[0])
    for move in moves:
        points = placed(move)
        assert points[0] == pytest.approx(move_ends(move)[0], abs=1e-9)
        assert points[-1] == pytest.approx(move_ends(move)[1], abs=1e-9)


def test_line_in_inches():
    document, space = drawing(units=1)
    space.add_line((0, 0), (1, 2))
    (move,) = moves_of(document, feed_mm_s=12.0)
    assert move.points_mm[0] == pytest.approx([25.4, 50.8, 0])
    assert move.feed_mm_s == pytest.approx([12.0])
    assert not move.rapid


def test_feed_is_the_machines_own_where_none_is_given():
    document, space = drawing()
    space.add_line((0, 0), (1, 2))
    assert moves_of(document)[0].feed_mm_s[0] == math.inf


def test_arc_and_circle_lie_on_their_circle():
    document, space = drawing()
    space.add_arc((5, 6), 3, 350, 80)
    space.add_circle((30, 0), 4)
    arc, _, circle = moves_of(document)
    assert arc.sweep_rad == pytest.approx(math.radians(90))
    assert np.linalg.norm(placed(arc) - [5, 6, 0], axis=1) == pytest.approx(np.full(60, 3.0))
    assert circle.sweep_rad == pytest.approx(2 * math.pi)
    assert np.array_equal(circle.start_mm, circle.end_mm)


def test_extruded_arc_is_mirrored():
    """An extrusion of -z mirrors x: the arc turns clockwise seen from above."""
    document, space = drawing()
    space.add_arc((5, 0), 2, 0, 90, dxfattribs={"extrusion": (0, 0, -1)})
    (arc,) = moves_of(document)
    assert {tuple(np.round(end, 9)) for end in (arc.start_mm, arc.end_mm)} == {(-7, 0, 0), (-5, 2, 0)}
    assert np.linalg.norm(placed(arc) - [-5, 0, 0], axis=1) == pytest.approx(np.full(60, 2.0))


@pytest.mark.parametrize("bulge", [1.0, -1.0, 0.3, -0.3])
def test_bulge_is_the_tangent_of_a_quarter_of_the_angle(bulge):
    document, space = drawing()
    space.add_lwpolyline([(0, 0, bulge), (10, 0, 0), (10, 10, 0)], format="xyb")
    arc, line = moves_of(document)
    assert_without_gaps([arc, line])
    assert arc.start_mm == pytest.approx([0, 0, 0], abs=1e-12)
    assert arc.sweep_rad == pytest.approx(4 * math.atan(abs(bulge)))
    # A positive bulge lies to the right of the chord, for a chord along x below it, by bulge times half the chord.
    lowest = placed(arc, 61)[30]
    assert lowest == pytest.approx([5, -5 * bulge, 0], abs=1e-9)
    assert line.points_mm[-1] == pytest.approx([10, 10, 0])


def test_closed_polyline_of_two_bulges_is_a_circle():
    document, space = drawing()
    space.add_lwpolyline([(0, 0, 1), (10, 0, 1)], format="xyb", close=True)
    moves = moves_of(document)
    assert_without_gaps([*moves, moves[0]])
    assert all(np.linalg.norm(placed(move) - [5, 0, 0], axis=1) == pytest.approx(np.full(60, 5.0)) for move in moves)
    assert sum(move.sweep_rad * move.normal[2] for move in moves) == pytest.approx(2 * math.pi)


def test_polyline_in_space():
    document, space = drawing()
    space.add_polyline3d([(0, 0, 0), (1, 0, 2), (1, 5, 3)])
    moves = moves_of(document)
    assert_without_gaps(moves)
    assert np.concatenate([move.points_mm for move in moves]) == pytest.approx(np.array([[1, 0, 2], [1, 5, 3]]))


def test_ellipse_is_exact():
    document, space = drawing()
    space.add_ellipse((1, 2), major_axis=(10, 0), ratio=0.4)
    (move,) = moves_of(document)
    x, y, _ = (placed(move, 200) - [1, 2, 0]).T
    assert (x / 10) ** 2 + (y / 4) ** 2 == pytest.approx(np.ones(200))


def test_elliptic_arc_has_its_ends():
    document, space = drawing()
    space.add_ellipse((0, 0), major_axis=(0, 10), ratio=0.5, start_param=0.0, end_param=math.pi / 2)
    (move,) = moves_of(document)
    assert {tuple(np.round(end, 9)) for end in move_ends(move)} == {(0, 10, 0), (-5, 0, 0)}


def test_spline_keeps_its_control_net():
    document, space = drawing()
    points = [(0, 0, 0), (1, 5, 1), (4, 5, 0), (6, 0, 2), (9, 1, 0)]
    space.add_rational_spline(points, [1, 2, 1, 0.5, 1])
    (move,) = moves_of(document)
    assert isinstance(move, NurbsMove)
    assert move.control_points_mm == pytest.approx(np.array(points))
    assert move.weights == pytest.approx([1, 2, 1, 0.5, 1])


def test_spline_without_clamped_knots_is_the_same_curve():
    document, space = drawing()
    points = np.array([(0, 0, 0), (1, 5, 0), (4, 5, 0), (6, 0, 0), (9, 1, 0), (9, 9, 0)], dtype=float)
    spline = space.add_spline(degree=3)
    spline.control_points = points
    spline.knots = np.arange(10.0)
    (move,) = moves_of(document)
    # A uniform cubic B-spline starts at (P0 + 4 P1 + P2) / 6.
    assert move.control_points_mm[0] == pytest.approx((points[0] + 4 * points[1] + points[2]) / 6)
    assert move.knots[0] == 3.0 and move.knots[-1] == 6.0
    middle = NurbsCurve.from_control_net(3, move.knots, move.control_points_mm, move.weights).evaluate(np.array([4.0]))[
        0
    ]
    assert middle[0] == pytest.approx((points[1] + 4 * points[2] + points[3]) / 6)


def test_loose_entities_join_to_one_contour():
    """A slot out of two lines and two arcs, drawn in no order and some of them backwards."""
    document, space = drawing()
    space.add_line((0, 0), (20, 0))
    space.add_arc((0, 5), 5, 90, 270)
    space.add_line((0, 10), (20, 10.0002))
    space.add_arc((20, 5), 5, 270, 90)
    moves = moves_of(document)
    assert len(moves) == 4
    assert_without_gaps([*moves, moves[0]])
    assert sum(move.sweep_rad * move.normal[2] for move in moves if isinstance(move, ArcMove)) == pytest.approx(
        2 * math.pi
    )


def test_chain_is_not_cut_where_a_middle_piece_comes_first():
    document, space = drawing()
    for start, end in (((10, 0), (20, 5)), ((30, 0), (20, 5)), ((0, 0), (10, 0))):
        space.add_line(start, end)
    moves = moves_of(document)
    assert len(moves) == 3
    assert not any(move.rapid for move in moves)
    assert_without_gaps(moves)


def test_layers_in_their_order_and_nearest_end_within():
    document, space = drawing()
    document.layers.add("first")
    document.layers.add("second")
    space.add_line((1, 0), (2, 0), dxfattribs={"layer": "second"})
    space.add_line((100, 0), (90, 0), dxfattribs={"layer": "first"})
    space.add_line((50, 0), (10, 0), dxfattribs={"layer": "first"})
    moves = moves_of(document)
    assert [move.rapid for move in moves] == [False, True, False, True, False]
    ends = [move.points_mm[-1][0] for move in moves]
    # From x = 0: 10 to 50 backwards, 90 to 100 backwards, then the other layer from its nearer end.
    assert ends == pytest.approx([50, 90, 100, 2, 1])
    assert_without_gaps(moves)


def test_hidden_layers_and_entities_are_left_out():
    document, space = drawing()
    document.layers.add("frozen").freeze()
    document.layers.add("off").off()
    space.add_line((0, 0), (1, 0))
    for layer in ("frozen", "off"):
        space.add_text("note", dxfattribs={"layer": layer})
    space.add_circle((5, 5), 1, dxfattribs={"invisible": 1})
    assert len(moves_of(document)) == 1


def test_dots_make_no_move():
    document, space = drawing()
    space.add_line((3, 3), (3, 3))
    space.add_lwpolyline([(0, 0), (0, 0), (1, 0)])
    (move,) = moves_of(document)
    assert move.points_mm == pytest.approx(np.array([[1, 0, 0]]))


def text_entity(space):
    return space.add_text("hello")


def block_reference(space):
    return space.add_blockref("none", (0, 0))


def flat_circle(space):
    return space.add_circle((0, 0), 0)


def far_line(space):
    return space.add_line((0, 0), (1e12, 0))


def zero_weight(space):
    return space.add_rational_spline([(0, 0), (1, 5), (4, 5), (6, 0)], [1, 0, 1, 1])


def mesh(space):
    return space.add_polyface()


def high_degree(space):
    return space.add_open_spline([(i, i * i) for i in range(14)], degree=12)


@pytest.mark.parametrize(
    ("add", "said"),
    [
        (text_entity, "not supported; there are: LINE"),
        (block_reference, "not supported"),
        (flat_circle, "radius of 0"),
        (far_line, "further than"),
        (zero_weight, "weight 2 is 0"),
        (mesh, "mesh"),
        (high_degree, "degree 12"),
    ],
)
def test_refused_by_type_and_handle(add, said):
    document, space = drawing()
    entity = add(space)
    with pytest.raises(ToolpathError, match=said) as caught:
        moves_of(document)
    assert f"{entity.dxftype()} #{entity.dxf.handle}" in caught.value.message
    assert caught.value.source == "part.dxf"


def test_unknown_unit_is_refused():
    document, space = drawing(units=20)
    space.add_line((0, 0), (1, 0))
    with pytest.raises(ToolpathError, match="INSUNITS"):
        moves_of(document)


def test_empty_drawing_is_refused():
    with pytest.raises(ToolpathError, match="nothing to follow"):
        moves_of(drawing()[0])


def test_file_that_is_not_there(tmp_path):
    with pytest.raises(ToolpathError, match="cannot be read"):
        list(read_dxf(tmp_path / "missing.dxf", "missing.dxf"))


def test_drawing_from_a_file(tmp_path):
    document, space = drawing()
    space.add_line((0, 0), (1, 0))
    document.saveas(tmp_path / "part.dxf")
    assert len(list(read_dxf(tmp_path / "part.dxf", "part.dxf"))) == 1


def _small_text():
    document, space = drawing()
    space.add_lwpolyline([(0, 0, 0.5), (10, 0, 0), (10, 10, -1)], format="xyb", close=True)
    space.add_ellipse((1, 2), major_axis=(10, 0), ratio=0.4)
    space.add_rational_spline([(0, 0), (1, 5), (4, 5), (6, 0)], [1, 2, 1, 1])
    space.add_arc((0, 0), 3, 10, 50)
    text = text_of(document)
    return text, text.index("ENTITIES")


TEXT, ENTITIES_AT = _small_text()
values = st.sampled_from(["", "0", "-1", "nan", "inf", "1e999", "LINE", "SPLINE", "70", "\x00", "999999999999"])


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 130), values), min_size=1, max_size=3), st.none() | st.integers(0, 800))
def test_damaged_drawings_are_moves_or_a_toolpath_error(changes, cut):
    lines = TEXT[ENTITIES_AT:].split("\n")
    for place, value in changes:
        lines[place % len(lines)] = value
    tail = "\n".join(lines)
    text = TEXT[:ENTITIES_AT] + (tail if cut is None else tail[:cut])
    try:
        moves = list(read_dxf(text, "damaged.dxf"))
    except ToolpathError:
        return
    for move in moves:
        assert all(np.all(np.isfinite(end)) for end in move_ends(move))


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=200))
def test_text_that_is_no_drawing(text):
    with pytest.raises(ToolpathError):
        list(read_dxf(text, "none.dxf"))
