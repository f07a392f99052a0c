"""The report of one run as HTML: verdict, limits, tracking, planner, execution, provenance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import matplotlib as mpl
import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ConfigError
from feedopt_core.motion.certificate import ALLOWED_RATIO
from feedopt_core.units import NS_PER_S
from feedopt_recorder.bags.check_bag import check_run
from feedopt_tools.errors import ReportError
from feedopt_tools.execute.judgement import Judgement, judge_run
from feedopt_tools.report import html_parts as html
from feedopt_tools.views.matplotlib.picture import figure_of
from feedopt_tools.views.matplotlib.style import STYLE, png_of
from feedopt_tools.views.pages import (
    ACTIVE_LIMIT,
    AXIS_LIMITS,
    CONTOUR,
    EVENTS,
    MOTION,
    PLANNER,
    TRACKING,
    Page,
    pages_of,
)
from feedopt_tools.views.signals.limit_use import path_weight_mm
from feedopt_tools.views.signals.scene import RunScene

_EVENTS = 60
_TEXT_CHARACTERS = 60_000
_CAPTIONS = {
    MOTION: "The motion: path by feedrate, feedrate, tracking error and control signal with their limits.",
    ACTIVE_LIMIT: "Which limit binds where: the path by its binding limit, and the utilisation of every limit.",
    AXIS_LIMITS: "Velocity, acceleration and jerk of the axes with their limits.",
    TRACKING: "Tracking error and control signal, simulated and as the machine's model predicts them.",
    CONTOUR: "Programmed, smoothed and actual path, the error exaggerated; contour error and lag along the path.",
    PLANNER: "The planner's windows: committed length, computing time, and lead of the plan over the motion.",
    EVENTS: "Lateness of the set points, line of the program, and events.",
}


def write_report(scene: RunScene, path: Path) -> None:
    """Write the report of a run.

    Raises:
        ReportError: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Open the file first: drawing takes seconds.
        with path.open("w", encoding="utf-8") as file:
            file.write(report_html(scene))
    except OSError as error:
        raise ReportError(f"{path}: cannot be written: {error.strerror}") from error


def report_html(scene: RunScene) -> str:
    """The report as one self-contained HTML page."""
    return html.document(f"{scene.signals.run.title}: report of a run", list(_Report(scene).parts()))


class _Report:
    def __init__(self, scene: RunScene) -> None:
        self.scene = scene
        self.signals = scene.signals
        self.run = scene.signals.run
        self.pages = pages_of(scene)
        self.judgement: Judgement | None = None
        self.not_judged = ""
        try:
            self.judgement = judge_run(self.run)
        except ConfigError as error:
            self.not_judged = str(error)

    def parts(self) -> Iterator[str]:
        yield from self._head()
        yield self._picture(MOTION)
        yield from self._limits()
        yield from self._tracking()
        yield from self._planner()
        yield from self._execution()
        yield from self._provenance()

    def _head(self) -> Iterator[str]:
        run, signals = self.run, self.signals
        began = datetime.fromtimestamp(int(run.setpoints.stamp_ns[0]) / NS_PER_S, tz=UTC)
        machine = run.machine.name if run.machine else "unknown machine"
        yield html.heading(run.title, 1)
        yield html.paragraph(f"on {machine}, {began:%Y-%m-%d %H:%M:%S} UTC, program {run.program_id}", "soft")
        if self.judgement is None:
            yield html.verdict("not judged", "unknown")
            yield html.paragraph(self.not_judged)
        elif self.judgement.holds:
            yield html.verdict("every limit held, nothing is missing", "good")
        else:
            broken = [row for row in self.judgement.audit.rows if row.ratio > ALLOWED_RATIO]
            said = f"{len(broken)} limits broken" if broken else "the recording is not complete"
            yield html.verdict(said, "bad")
        length_mm, time_s = float(signals.s_mm[-1]), run.motion_time_s
        figures = [
            ("motion time", f"{time_s:.3f} s"),
            ("path length", f"{length_mm:.1f} mm"),
            ("mean feedrate", f"{length_mm / max(time_s, 1e-9):.1f} mm/s"),
            ("largest feedrate", f"{signals.top_feed_mm_s:.1f} mm/s"),
        ]
        if self.judgement is not None:
            figures.append(("closest to its limit", f"{100.0 * self.judgement.audit.worst.ratio:.2f} %"))
        if self.scene.contour is not None:
            figures.append(("largest contour error", f"{np.max(np.abs(self.scene.contour.error_um)):.1f} µm"))
        if run.chunks:
            spent_s = sum(chunk.figures.solve_time_s + chunk.figures.audit_time_s for chunk in run.chunks)
            figures.append(("computing for 1 s of motion", f"{spent_s / max(time_s, 1e-9):.3f} s"))
        yield html.cards(figures)

    def _limits(self) -> Iterator[str]:
        yield html.heading("Limits")
        use = self.scene.limit_use
        if use.limits:
            yield self._picture(ACTIVE_LIMIT)
            path_shares = dict(use.shares(path_weight_mm(self.signals)))
            moving = (self.signals.feedrate_mm_s > 0.0).astype(np.float64)
            time_shares = dict(use.shares(moving))
            rows = [
                (
                    limit.label,
                    f"{100.0 * path_shares[limit.label]:.1f} %",
                    f"{100.0 * time_shares[limit.label]:.1f} %",
                    f"{100.0 * float(np.max(use.ratio[:, k])):.2f} %",
                    f"{100.0 * _mean(use.ratio[:, k], moving):.1f} %",
                )
                for k, limit in enumerate(use.limits)
            ]
            rows.append(
                (
                    "none above 95 %",
                    f"{100.0 * path_shares['none']:.1f} %",
                    f"{100.0 * time_shares['none']:.1f} %",
                    "",
                    "",
                )
            )
            yield html.table(("limit", "binds on the path", "binds in time", "largest use", "mean use"), rows)
        if self.judgement is not None:
            audit = self.judgement.audit.rows
            yield html.paragraph("Recomputed from the recorded set points alone, standstill before and after included:")
            yield html.table(
                ("quantity", "axis", "largest", "limit", "ratio", "at s, mm", "at t, s"),
                [
                    (
                        row.quantity.replace("_", " "),
                        row.axis,
                        f"{row.value:.6g}",
                        f"{row.limit:.6g}",
                        f"{row.ratio:.4f}",
                        f"{row.s_mm:.1f}",
                        f"{row.t_s:.3f}",
                    )
                    for row in audit
                ],
                [row.ratio > ALLOWED_RATIO for row in audit],
            )
        yield self._picture(AXIS_LIMITS)

    def _tracking(self) -> Iterator[str]:
        contour = self.scene.contour
        if TRACKING not in self.pages and contour is None:
            return
        yield html.heading("Tracking")
        if self.judgement is not None:
            rows = []
            for row in self.judgement.tracking:
                values = (row.predicted_max_um, row.simulated_max_um, row.predicted_rms_um, row.simulated_rms_um)
                rows.append((row.axis, *(f"{value:.2f}" for value in (row.limit_um, *values))))
            columns = (
                "axis",
                "limit, µm",
                "predicted max, µm",
                "simulated max, µm",
                "predicted rms, µm",
                "simulated rms, µm",
            )
            over = [row.over for row in self.judgement.tracking]
            yield html.table(columns, rows, over)
            if any(over):
                yield html.paragraph("The plan keeps the limit; the machine exceeded it where marked.", "soft")
        if contour is not None:
            both = [("contour error", contour.error_um), ("lag along the path", contour.lag_um)]
            yield html.table(
                ("", "largest, µm", "rms, µm"),
                [(name, f"{np.max(np.abs(v)):.2f}", f"{float(np.sqrt(np.mean(v**2))):.2f}") for name, v in both],
            )
        yield self._picture(TRACKING)
        yield self._picture(CONTOUR)

    def _planner(self) -> Iterator[str]:
        chunks = self.run.chunks
        if not chunks:
            return
        yield html.heading("Planner")
        solve_s = np.array([chunk.figures.solve_time_s for chunk in chunks])
        audit_s = np.array([chunk.figures.audit_time_s for chunk in chunks])
        committed_s = np.array([chunk.t_commit_s - chunk.t_start_s for chunk in chunks])
        share = (solve_s + audit_s) / np.maximum(committed_s, 1e-9)
        solvers = Counter(chunk.figures.solver or "not recorded" for chunk in chunks)
        worst = max(chunks, key=lambda chunk: chunk.certificate.worst_ratio).certificate
        rows = [
            ("method", chunks[0].figures.method),
            ("windows", str(len(chunks))),
            ("solvers", ", ".join(f"{name}: {count}" for name, count in solvers.most_common())),
            ("windows without a plan", str(sum(chunk.figures.fallback for chunk in chunks))),
            ("solving, all windows", f"{np.sum(solve_s):.3f} s"),
            ("auditing, all windows", f"{np.sum(audit_s):.3f} s"),
            ("longest window", f"{1e3 * np.max(solve_s + audit_s):.1f} ms"),
            (
                "computing time / committed motion",
                f"worst {100 * np.max(share):.1f} %, median {100 * np.median(share):.1f} %",
            ),
            ("certificates", f"closest {100 * worst.worst_ratio:.2f} %: {worst.worst_quantity} {worst.worst_axis}"),
        ]
        if self.scene.reserve is not None:
            rows.append(
                ("plan ahead of the motion", f"at least {np.min(self.scene.reserve.ahead_s):.2f} s before its end")
            )
        yield html.pairs(rows)
        yield self._picture(PLANNER)

    def _execution(self) -> Iterator[str]:
        yield html.heading("Interpolator and recorder")
        late_ms = self.signals.lateness_ms
        rows = [
            ("set points", str(len(late_ms))),
            (
                "lateness",
                f"p50 {np.percentile(late_ms, 50):.3f} ms, p99 {np.percentile(late_ms, 99):.3f} ms, "
                f"largest {np.max(late_ms):.3f} ms",
            ),
            ("late by a period or more", str(int(np.sum(late_ms >= 1e3 * self.run.setpoints.period_s)))),
        ]
        if self.judgement is not None:
            rows += [
                ("set points missing", str(self.judgement.punctuality.missing_ticks)),
                ("recorded messages", str(self.judgement.recorded_messages)),
                ("recorder", f"{100.0 * self.judgement.recorder_cpu_ratio:.1f} % of a core"),
            ]
        rows.append(("recording", "complete" if self.run.complete else "cut off: the recorder was killed"))
        yield html.pairs(rows)
        findings = check_run(self.run)
        if findings:
            yield html.table(("where", "what is missing"), [(finding.place, finding.text) for finding in findings])
        yield self._picture(EVENTS)
        events = self.scene.events
        if events:
            shown = events[:_EVENTS]
            yield html.table(
                ("t, s", "s, mm", "level", "source", "what"),
                [(f"{e.t_s:.3f}", f"{e.s_mm:.1f}", e.level.lower(), e.source, e.text) for e in shown],
                [event.level == "ERROR" for event in shown],
            )
            if len(events) > len(shown):
                yield html.paragraph(f"and {len(events) - len(shown)} more", "soft")

    def _provenance(self) -> Iterator[str]:
        yield html.heading("Provenance")
        records = self.run.provenance
        program = records.get("feedopt/program", {})
        rows = [("bag", str(self.run.path))]
        rows += [(key, program[key]) for key in ("name", "sha256", "method") if program.get(key)]
        rows += sorted(records.get("feedopt/versions", {}).items())
        yield html.pairs(rows)
        machine_text = records.get("feedopt/machine", {}).get("yaml", "")
        texts = [("machine file", machine_text or (self.run.machine.yaml_text if self.run.machine else ""))]
        texts += [
            (f"parameters of {name}", text) for name, text in sorted(records.get("feedopt/parameters", {}).items())
        ]
        texts.append(("program", program.get("text", "")))
        for name, text in texts:
            if text:
                cut = "" if len(text) <= _TEXT_CHARACTERS else f"\n... {len(text) - _TEXT_CHARACTERS} characters more"
                yield html.folded(name, text[:_TEXT_CHARACTERS] + cut)

    def _picture(self, page: Page) -> str:
        if page not in self.pages:
            return ""
        with mpl.rc_context(STYLE):
            return html.figure(png_of(figure_of(self.scene, page)), _CAPTIONS[page])


def _mean(values: FloatArray, weight: FloatArray) -> float:
    total = float(np.sum(weight))
    return float(np.sum(values * weight)) / total if total > 0.0 else 0.0
