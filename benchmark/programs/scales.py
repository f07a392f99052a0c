"""The same part in millimetres, in inches and a thousand times as large, to compare their plans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmark.programs.own import circle_diamond_square
from benchmark.programs.planned import Motion, plan_segments

from feedopt_core.machine.machine_file import Machine
from feedopt_core.pipeline.survey import survey_program
from feedopt_core.planner.stream_planner import PlannerParameters

_SIZE_MM = 40.0
_FEED_MM_MIN = 6000.0
_INCH_MM = 25.4
_LARGE = 1000.0


def run_scales(
    folder: Path, machine: Machine, parameters: PlannerParameters, tolerance_mm: float
) -> Sequence[tuple[str, float, int, Motion]]:
    """Circle, diamond and square in each scale: name, length over scale, segments, motion."""
    found = list[tuple[str, float, int, Motion]]()
    for name, unit, scale in (
        ("mm, G21", 1.0, 1.0),
        ("inches, G20", _INCH_MM, 1.0),
        ("1000 times as large", 1.0, _LARGE),
    ):
        path = folder / f"scale_{len(found)}.ngc"
        text = circle_diamond_square(scale * _SIZE_MM, unit, scale * _FEED_MM_MIN)
        path.write_text(text, encoding="utf-8")
        segments = survey_program(path, 2, scale * tolerance_mm).segments
        own = replace(parameters, knot_spacing_mm=scale * parameters.knot_spacing_mm)
        motion = plan_segments(segments, scaled(machine, scale), own)
        found.append((name, sum(segment.length_mm for segment in segments) / scale, len(segments), motion))
    return found


def scaled(machine: Machine, scale: float) -> Machine:
    """A machine with all limits multiplied by ``scale``; only for machines without drive model and tracking."""
    return replace(
        machine,
        feed_limit_mm_s=scale * machine.feed_limit_mm_s,
        velocity_limit_mm_s=tuple(scale * limit for limit in machine.velocity_limit_mm_s),
        acceleration_limit_mm_s2=tuple(scale * limit for limit in machine.acceleration_limit_mm_s2),
        jerk_limit_mm_s3=tuple(scale * limit for limit in machine.jerk_limit_mm_s3),
    )
