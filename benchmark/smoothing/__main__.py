"""Designs of the curve that replaces a run of short moves, compared by the resulting motion time.

Run: ``./feedopt bench smoothing [--chords MM ...] [--decimals N] [--designs NAME ...]``. The run is the fan contour's
smooth curve, sampled in chords; planned by method lp on machine case_a and compared with the smooth curve itself. The
first run installs the packages of requirements/bench.txt.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from benchmark.peer_packages import install_missing
from benchmark.smoothing.designs import DESIGNS, Design, deviation_mm
from rich.console import Console
from rich.table import Table

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.setpoints import audit_setpoints
from feedopt_core.config_files import find_config
from feedopt_core.errors import FeedoptError
from feedopt_core.geometry.arc_length import map_arc_length
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.geometry.segments import NurbsSegment, Segment, SegmentPlace
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine, load_machine
from feedopt_core.pipeline.plan_program import interpolate
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner
from feedopt_core.programs.points_csv import read_points
from feedopt_core.smoothing.cubic_spline import interpolate_points

_TOLERANCE_MM = 0.01


def main(argv: list[str]) -> int:
    """Command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="feedopt bench smoothing", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--chords", type=float, nargs="+", default=[0.1], metavar="MM", help="lengths of chords")
    parser.add_argument("--decimals", type=int, default=4, help="decimals the points are programmed with")
    names = [design.name for design in DESIGNS]
    parser.add_argument("--designs", nargs="+", default=names, choices=names, metavar="NAME", help=", ".join(names))
    arguments = parser.parse_args(argv)
    install_missing("osqp")
    machine = load_machine("case_a")
    smooth = fan_contour()
    table = Table("chords", "design", "spans", "smoothing", "worst deviation", "motion time", "set points", box=None)
    time_s, ratio = planned(smooth.segments, machine)
    table.add_row("-", "the smooth curve itself", "88", "-", "-", f"{time_s:.3f} s", f"{ratio:.5f}")
    for chord_mm in arguments.chords:
        points_mm = np.round(sampled(smooth, chord_mm), arguments.decimals)
        for design in (design for design in DESIGNS if design.name in arguments.designs):
            table.add_row(f"{chord_mm:g} mm", design.name, *row_of(design, points_mm, machine))
    Console(width=140).print(table)
    return 0


def row_of(design: Design, points_mm: FloatArray, machine: Machine) -> tuple[str, ...]:
    """Figures of one design: spans, time to smooth, deviation, motion time, worst ratio to a limit at 1 kHz."""
    design.curves(points_mm[:200], _TOLERANCE_MM)
    began = time.process_time()
    try:
        curves = design.curves(points_mm, _TOLERANCE_MM)
        smoothing_s = time.process_time() - began
        figures = (
            str(sum(len(curve.joints) - 1 for curve in curves)),
            f"{1e6 * smoothing_s / len(points_mm):.1f} us/line",
            f"{1e3 * deviation_mm(curves, points_mm):.1f} um",
        )
    except (FeedoptError, ValueError) as error:
        return "-", "-", str(error)[:60], "-", "-"
    try:
        time_s, ratio = planned(segments_of(curves), machine)
    except FeedoptError as error:
        return *figures, f"no plan: {str(error)[:40]}", "-"
    return *figures, f"{time_s:.3f} s", f"{ratio:.5f}"


def fan_contour() -> Toolpath:
    """The smooth curve: the C2 spline through the points of the fan contour."""
    path: Path = find_config("programs", "fan_contour", ".csv")
    with path.open(encoding="utf-8") as file:
        points_mm = read_points(file, str(path)).points_mm
    toolpath = Toolpath()
    for segment in interpolate_points(points_mm, list(range(1, len(points_mm) + 1))):
        toolpath.append(segment)
    return toolpath


def sampled(toolpath: Toolpath, chord_mm: float) -> FloatArray:
    """Points on a path, equal arc lengths apart."""
    return toolpath.evaluate(np.linspace(0.0, toolpath.end_mm, round(toolpath.end_mm / chord_mm) + 1)).r_mm


def segments_of(curves: Iterable[NurbsCurve]) -> list[Segment]:
    """Curves in a row as the segments of a program."""
    segments, s_mm = list[Segment](), 0.0
    every = list(curves)
    for index, curve in enumerate(every):
        place = SegmentPlace(index + 1, index + 1, s_mm, last=index == len(every) - 1)
        segments.append(NurbsSegment(place, curve, map_arc_length(curve.evaluate, curve.joints)))
        s_mm += segments[-1].length_mm
    return segments


def planned(segments: Sequence[Segment], machine: Machine) -> tuple[float, float]:
    """Motion time and the worst ratio of a set point to its limit."""
    planner, toolpath, chunks = StreamPlanner(machine, PlannerParameters()), Toolpath(), []
    for segment in segments:
        toolpath.append(segment)
        planner.add_segment(segment)
        while (chunk := planner.next_chunk()) is not None:
            chunks.append(chunk)
            planner.discard_before(chunk.s_start_mm)
    setpoints = interpolate(toolpath, chunks, machine)
    period_s = machine.period_s
    audit = audit_setpoints(setpoints.position_mm, setpoints.s_mm, period_s, machine)
    return planner.committed_t_s, audit.worst.ratio


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
