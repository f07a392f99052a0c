"""Figures of a run as a short Markdown table."""

from __future__ import annotations

import json

import numpy as np

from feedopt_recorder.bags.check_bag import check_run
from feedopt_recorder.bags.run_data import RunData
from feedopt_tools.views.signals.limit_use import path_weight_mm
from feedopt_tools.views.signals.scene import RunScene
from feedopt_tools.views.signals.signals import RunSignals

_FINDINGS = 4
_LEAST_SHARE = 0.01


def summary_markdown(scene: RunScene) -> str:
    """The first figures of a run: motion time, closest limit, tracking, gaps of the recording."""
    signals, run = scene.signals, scene.signals.run
    rows = [
        ("motion time", f"{run.motion_time_s:.3f} s"),
        ("path length", f"{signals.s_mm[-1]:.1f} mm"),
        ("feedrate", f"up to {signals.top_feed_mm_s:.1f} mm/s"),
    ]
    if run.machine is not None:
        rows.insert(0, ("machine", run.machine.name))
    rows += _closest_limits(signals)
    rows += _binding_limits(scene)
    if scene.contour is not None:
        rows.append(("contour error", f"up to {float(np.max(np.abs(scene.contour.error_um))):.2f} µm"))
    rows.append(("colours of the path", "blue 0, red the figure above the path"))
    if scene.programmed.remark:
        rows.append(("programmed path", scene.programmed.remark))
    if run.chunks:
        worst = max(run.chunks, key=lambda chunk: chunk.certificate.worst_ratio).certificate
        axis = f" of {worst.worst_axis}" if worst.worst_axis else ""
        solve_s = sum(chunk.figures.solve_time_s for chunk in run.chunks)
        rows += [
            ("plan", f"{run.chunks[0].figures.method}, {len(run.chunks)} chunks, solved in {solve_s:.2f} s"),
            (
                "certificate",
                f"{100 * worst.worst_ratio:.2f} % of {worst.worst_quantity}{axis} at {worst.worst_s_mm:.1f} mm",
            ),
        ]
    rows.append(("lateness", f"99 % below {np.percentile(signals.lateness_ms, 99):.2f} ms"))
    findings = check_run(run)
    if (share := recorder_share(run)) is not None:
        rows.append(("recorder", f"{100.0 * share:.1f} % of a core"))
    if not run.complete:
        rows.append(("recording", "cut off: the recorder was killed"))
    else:
        rows.append(("recording", "complete" if not findings else f"{len(findings)} findings"))
    lines = ["| | |", "|---|---|", *(f"| {name} | {text} |" for name, text in rows)]
    lines += [f"- {finding.place}: {finding.text}" for finding in findings[:_FINDINGS]]
    return "\n".join(lines)


def recorder_share(run: RunData) -> float | None:
    """Share of a core used by the recorder, from the bag; None if not recorded."""
    try:
        return float(json.loads(run.provenance["feedopt/recorder"]["summary"])["cpu_share_ratio"])
    except (KeyError, ValueError, TypeError):
        return None


def _binding_limits(scene: RunScene) -> list[tuple[str, str]]:
    """Shares of the path on which each limit binds."""
    shares = scene.limit_use.shares(path_weight_mm(scene.signals))
    parts = [f"{label} {100.0 * share:.0f} %" for label, share in shares if share >= _LEAST_SHARE]
    return [("binds on the path", ", ".join(parts))] if parts else []


def _closest_limits(signals: RunSignals) -> list[tuple[str, str]]:
    rows = []
    for key in ("tracking_error", "control_signal"):
        quantity = signals.quantities[key]
        if quantity.measured is None:
            continue
        peaks = np.max(np.abs(quantity.measured), axis=0)
        name, unit = quantity.title.split(", ")
        parts = []
        for axis, peak in enumerate(peaks):
            limit = f" of {quantity.limit_of(axis):.3g}" if np.isfinite(quantity.limit_of(axis)) else ""
            parts.append(f"{signals.run.axis_names[axis]} {peak:.2f}{limit} {unit}")
        rows.append((f"peak {name}", ", ".join(parts)))
    return rows
