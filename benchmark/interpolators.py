"""Feed fluctuation of interpolators on the fan contour of the NURBS thesis, 50 mm/s at 1 kHz (its section 3.4).

Run: ``./feedopt bench interpolators [--feed MM_S]``. The contour is fitted to the points of its appendix A with the
factors it prints, 17 cubic segments, closed. Every interpolator computes the set points of one lap at constant feed.
The feedrate is the central difference of the positions, as in eq. 3.44. The benchmark has no pass or fail.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from benchmark.curves.nurbs_fit import divide_points, fit_nurbs, knot_span_ratios
from benchmark.curves.parameter_maps import (
    NaturalMap,
    ParameterMap,
    PredictorCorrectorMap,
    TaylorMap,
    feed_correction_map,
)
from rich.console import Console
from rich.table import Table

from feedopt_core.arrays import FloatArray
from feedopt_core.config_files import find_config
from feedopt_core.geometry.arc_length import ArcLengthMap, map_arc_length
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.programs.points_csv import read_points

PERIOD_S = 0.001
INTERVALS = 5
FACTORS_BY_HAND = {3: 1.0, 5: 0.4, 6: 2.0, 9: 0.4, 11: 1.0, 12: 1.5, 15: 4.0}
"""Joints whose factors the thesis sets by hand, from 0; the other factors are ratios of knot spans."""


@dataclass(frozen=True)
class FeedRow:
    """One interpolator over one lap.

    Attributes:
        name: name of the interpolator.
        least_ratio, greatest_ratio, rms_ratio: ratio of feedrate to commanded feed, minus 1.
        pieces: smallest and largest number of polynomials per segment; None without polynomials.
        set_up_s: time to make the maps of all segments.
        point_s: time per set point, for whole segments at once.
        single_s: time for a single set point; None for recursive interpolators, which need the previous set point.
    """

    name: str
    least_ratio: float
    greatest_ratio: float
    rms_ratio: float
    pieces: tuple[int, int] | None
    set_up_s: float
    point_s: float
    single_s: float | None


def main(argv: list[str]) -> int:
    """Command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="feedopt bench interpolators", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--feed", type=float, default=50.0, metavar="MM_S", help="commanded feed, mm/s")
    arguments = parser.parse_args(argv)
    if not 0.0 < arguments.feed < float("inf"):
        parser.error("--feed must be above zero")
    curves = fan_curves()
    lengths = [map_arc_length(curve.evaluate, curve.joints).length_mm for curve in curves]
    makers: dict[str, Callable[[NurbsCurve, float], ParameterMap]] = {
        "natural (equal du)": NaturalMap,
        "Taylor, 1st order": lambda curve, _: TaylorMap(curve, 1),
        "Taylor, 2nd order": lambda curve, _: TaylorMap(curve, 2),
        "RK2 predictor-corrector": lambda curve, _: PredictorCorrectorMap(curve),
        "feed correction, as published": lambda curve, _: feed_correction_map(curve),
        "feedopt (geometry/arc_length.py)": lambda curve, _: map_arc_length(curve.evaluate, curve.joints),
    }
    rows = [measure(name, make, curves, lengths, arguments.feed) for name, make in makers.items()]
    out = Console(width=None if sys.stdout.isatty() else 150)
    out.print(table_of(rows))
    ticks = int(sum(lengths) / (arguments.feed * PERIOD_S))
    out.print(f"{len(curves)} segments, {sum(lengths):.3f} mm, {arguments.feed:g} mm/s, {ticks} set points, 1 kHz")
    return 0


def fan_curves() -> tuple[NurbsCurve, ...]:
    """The contour of appendix A; its control points agree with the printed ones to 0.001 mm."""
    contour = find_config("programs", "fan_contour", ".csv")
    points = read_points(contour.read_text(encoding="utf-8").splitlines(), contour.name).points_mm
    factors = knot_span_ratios(divide_points(points, INTERVALS))
    for joint, factor in FACTORS_BY_HAND.items():
        factors[joint] = factor
    return fit_nurbs(points, INTERVALS, factors).curves


def measure(
    name: str,
    make: Callable[[NurbsCurve, float], ParameterMap],
    curves: tuple[NurbsCurve, ...],
    lengths: list[float],
    feed_mm_s: float,
) -> FeedRow:
    """One lap at constant feed with one interpolator."""
    began = time.perf_counter()
    maps = [make(curve, length) for curve, length in zip(curves, lengths, strict=True)]
    set_up_s = time.perf_counter() - began
    step_mm = feed_mm_s * PERIOD_S
    positions, placing_s, starts = [], 0.0, np.concatenate([[0.0], np.cumsum(lengths)])
    for curve, parameter_map, start, stop in zip(curves, maps, starts[:-1], starts[1:], strict=True):
        ticks = np.arange(np.ceil(start / step_mm), np.ceil(stop / step_mm))
        began = time.perf_counter()
        u = parameter_map.parameter(ticks * step_mm - start)
        placing_s += time.perf_counter() - began
        positions.append(curve.evaluate(u)[0])
    every = np.concatenate(positions)
    ratio = feedrates_mm_s(every) / feed_mm_s - 1.0
    fitted = [len(each.coefficients) for each in maps if isinstance(each, ArcLengthMap)]
    recursive = isinstance(maps[0], TaylorMap | PredictorCorrectorMap)
    return FeedRow(
        name,
        least_ratio=float(np.min(ratio)),
        greatest_ratio=float(np.max(ratio)),
        rms_ratio=float(np.sqrt(np.mean(ratio**2))),
        pieces=(min(fitted), max(fitted)) if fitted else None,
        set_up_s=set_up_s,
        point_s=placing_s / len(every),
        single_s=None if recursive else _single_point_s(maps[0], lengths[0]),
    )


def feedrates_mm_s(positions_mm: FloatArray) -> FloatArray:
    """Feedrates as central differences of the positions, shape (n - 2,)."""
    return np.asarray(np.linalg.norm(positions_mm[2:] - positions_mm[:-2], axis=1) / (2.0 * PERIOD_S))


def table_of(rows: list[FeedRow]) -> Table:
    """The figures as a table."""
    table = Table(
        "interpolator", "feed, lowest", "highest", "rms", "polynomials", "set-up, ms", "in blocks", "one by one"
    )
    for row in rows:
        table.add_row(
            row.name,
            f"{100.0 * row.least_ratio:+.4f} %",
            f"{100.0 * row.greatest_ratio:+.4f} %",
            f"{100.0 * row.rms_ratio:.4f} %",
            f"{row.pieces[0]} to {row.pieces[1]}" if row.pieces else "-",
            f"{1e3 * row.set_up_s:.1f}",
            "-" if row.single_s is None else f"{1e6 * row.point_s:.2f} us",
            f"{1e6 * (row.point_s if row.single_s is None else row.single_s):.1f} us",
        )
    return table


def _single_point_s(parameter_map: ParameterMap, length_mm: float, count: int = 200) -> float:
    """Time for a single set point, mean of several."""
    places = np.linspace(0.0, length_mm, count)[:, None]
    began = time.perf_counter()
    for s_mm in places:
        parameter_map.parameter(s_mm)
    return (time.perf_counter() - began) / count


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
