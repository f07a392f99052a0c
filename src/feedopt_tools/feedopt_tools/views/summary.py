"""The figures of a run in a few lines of Markdown."""

from __future__ import annotations

import numpy as np

from feedopt_tools.bags.check_bag import check_run
from feedopt_tools.views.signals import RunSignals

_FINDINGS = 4


def summary_markdown(signals: RunSignals) -> str:
    """What an engineer wants to know first: how long, how close to which limit, how well followed, what is missing."""
    run = signals.run
    rows = [
        ("motion time", f"{run.motion_time_s:.3f} s"),
        ("path length", f"{signals.s_mm[-1]:.1f} mm"),
        ("feedrate", f"up to {signals.top_feed_mm_s:.1f} mm/s (red), standstill is blue"),
    ]
    if run.machine is not None:
        rows.insert(0, ("machine", run.machine.name))
    rows += _closest_limits(signals)
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
    rows.append(("recording", "complete" if not findings else f"{len(findings)} findings"))
    lines = ["| | |", "|---|---|", *(f"| {name} | {text} |" for name, text in rows)]
    lines += [f"- {finding.place}: {finding.text}" for finding in findings[:_FINDINGS]]
    return "\n".join(lines)


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
            limit = f" of {quantity.limit[axis]:.3g}" if quantity.limit else ""
            parts.append(f"{signals.run.axis_names[axis]} {peak:.2f}{limit} {unit}")
        rows.append((f"peak {name}", ", ".join(parts)))
    return rows
