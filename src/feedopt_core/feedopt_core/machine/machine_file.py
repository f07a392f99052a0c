"""Machine files: axes, limits and the identified drive model.

No limit has a default. A limit of velocity, acceleration or jerk may be absent where another limit in the file bounds
the motion. It is then infinity, and nothing is checked against it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.config_files import find_config, find_section, parse_yaml, read_text
from feedopt_core.errors import ConfigError
from feedopt_core.schema import build, parameter

COORDINATES = ("x", "y", "z")
DEFAULT_PERIOD_S = 0.001
"""Time between set points if the machine file does not give it."""
_SECTION = ("/**", "ros__parameters", "machine")


def _per_axis(doc: str, unit: str, **rule: Any) -> Any:
    return parameter(doc, unit=unit, per_axis=True, **rule)


@dataclass(frozen=True)
class DriveModel:
    """Identified control signal ``u = inertia a + viscous v + offset + coulomb sign(v)``, V (thesis section 3.6.1).

    One entry an axis; ``v, a`` are the axis' own velocity and acceleration.
    """

    inertia_volts_s2_mm: tuple[float, ...] = _per_axis("Inertia.", "V/(mm/s^2)", at_least=0.0)
    viscous_volts_s_mm: tuple[float, ...] = _per_axis("Viscous friction.", "V/(mm/s)", at_least=0.0)
    offset_volts: tuple[float, ...] = _per_axis("Constant load: gravity, amplifier offset.", "V")
    coulomb_volts: tuple[float, ...] = _per_axis("Coulomb friction.", "V", at_least=0.0)


@dataclass(frozen=True)
class TrackingModel:
    """Identified quasi-static tracking error ``e = kv v + ka a + kj j``, mm (thesis section 3.6.1)."""

    tracking_kv_s: tuple[float, ...] = _per_axis("Tracking error for each mm/s of velocity.", "s")
    tracking_ka_s2: tuple[float, ...] = _per_axis("Tracking error for each mm/s^2 of acceleration.", "s^2")
    tracking_kj_s3: tuple[float, ...] = _per_axis("Tracking error for each mm/s^3 of jerk.", "s^3")


@dataclass(frozen=True)
class Machine:
    """Axes and limits of a machine; every tuple has one entry an axis.

    ``axis_map`` holds the rows of the axis map K: axis position = K tool position, both in mm.
    The limits of velocity, acceleration and jerk are infinity where the file gives none.
    ``control_limit_volts`` comes with ``drive`` and ``tracking_error_limit_mm`` with ``tracking``; both are None where
    the file gives no such model. ``tracking_error_reserve_mm`` is the part of the tracking error limit that a plan
    leaves to the servo: for what the quasi-static model leaves out, such as changes of jerk, friction reversals and
    encoder counts (docs/decisions/0014). ``period_s`` is the time between two set points: one for the whole graph.
    """

    name: str
    yaml_text: str
    axis_names: tuple[str, ...]
    axis_map: tuple[tuple[float, ...], ...]
    feed_limit_mm_s: float
    velocity_limit_mm_s: tuple[float, ...]
    acceleration_limit_mm_s2: tuple[float, ...]
    jerk_limit_mm_s3: tuple[float, ...]
    control_limit_volts: tuple[float, ...] | None = None
    drive: DriveModel | None = None
    tracking_error_limit_mm: tuple[float, ...] | None = None
    tracking_error_reserve_mm: tuple[float, ...] | None = None
    tracking: TrackingModel | None = None
    period_s: float = DEFAULT_PERIOD_S

    @property
    def planned_tracking_error_mm(self) -> tuple[float, ...] | None:
        """Tracking error by the model that a plan may use: the limit minus the reserve; None without a limit."""
        if self.tracking_error_limit_mm is None or self.tracking_error_reserve_mm is None:
            return self.tracking_error_limit_mm
        rows = zip(self.tracking_error_limit_mm, self.tracking_error_reserve_mm, strict=True)
        return tuple(limit - reserve for limit, reserve in rows)

    @property
    def dimensions(self) -> int:
        """Number of tool coordinates the axes span: 2 (x, y) or 3 (x, y, z)."""
        return len(self.axis_map[0])

    def axis_matrix(self) -> FloatArray:
        """Axis map K, shape (n_axes, dimensions). A gantry repeats a row; the motors of an H-bot mix x and y."""
        return np.array(self.axis_map)

    def tool_matrix(self) -> FloatArray:
        """Tool position = this matrix times axis position, shape (dimensions, n_axes).

        Axes that follow the same coordinate are averaged (least squares).
        """
        return np.asarray(np.linalg.pinv(self.axis_matrix()), dtype=np.float64)


def machine_path(name_or_path: str) -> Path:
    """File of a machine given by path or by its name in ``config/machines``. Raises ConfigError."""
    return find_config("machines", name_or_path)


def load_machine(name_or_path: str) -> Machine:
    """Read and check a machine file.

    Raises:
        ConfigError: no such file, not YAML, a missing, unknown or impossible key; names file, key and axis.
    """
    path = machine_path(name_or_path)
    return parse_machine(read_text(path), str(path))


def parse_machine(text: str, source: str) -> Machine:
    """Machine from the text of its file; ``source`` names it in errors. Raises ConfigError."""
    section = build(_MachineSection, find_section(parse_yaml(text, source), _SECTION, source), source)
    drive, tracking, unlimited = section.drive, section.tracking, (math.inf,) * len(section.axis_names)
    return Machine(
        name=section.name,
        yaml_text=text,
        axis_names=section.axis_names,
        axis_map=section.rows(),
        feed_limit_mm_s=section.feed_limit_mm_s,
        velocity_limit_mm_s=section.velocity_limit_mm_s or unlimited,
        acceleration_limit_mm_s2=section.acceleration_limit_mm_s2 or unlimited,
        jerk_limit_mm_s3=section.jerk_limit_mm_s3 or unlimited,
        control_limit_volts=drive.control_limit_volts if drive else None,
        drive=drive.model() if drive else None,
        tracking_error_limit_mm=tracking.tracking_error_limit_mm if tracking else None,
        tracking_error_reserve_mm=tracking.tracking_error_reserve_mm if tracking else None,
        tracking=tracking.model() if tracking else None,
        period_s=section.period_s,
    )


@dataclass(frozen=True, kw_only=True)
class _LimitedDrive(DriveModel):
    """A drive model is given with its limit or not at all."""

    control_limit_volts: tuple[float, ...] = _per_axis("Largest control signal.", "V", above=0.0)

    def model(self) -> DriveModel:
        return DriveModel(self.inertia_volts_s2_mm, self.viscous_volts_s_mm, self.offset_volts, self.coulomb_volts)


@dataclass(frozen=True, kw_only=True)
class _LimitedTracking(TrackingModel):
    """A tracking model is given with its limit or not at all."""

    tracking_error_limit_mm: tuple[float, ...] = _per_axis("Largest tracking error.", "mm", above=0.0)
    tracking_error_reserve_mm: tuple[float, ...] | None = _per_axis(
        "Part of the limit that a plan leaves to the servo.", "mm", at_least=0.0, default=None
    )

    def model(self) -> TrackingModel:
        return TrackingModel(self.tracking_kv_s, self.tracking_ka_s2, self.tracking_kj_s3)


@dataclass(frozen=True, kw_only=True)
class _MachineSection:
    """Parameters of a machine file."""

    name: str = parameter("Name of the machine.")
    source: str = parameter("Where its figures come from.", default="")
    axis_names: tuple[str, ...] = parameter("Names of the axes.", names=True)
    coordinate: tuple[str, ...] | None = parameter(
        "Tool coordinate that each axis follows.", per_axis=True, choices=COORDINATES, default=None
    )
    axis_map: tuple[tuple[float, ...], ...] | None = parameter(
        "Row of the axis map for each axis: factors of x, y (, z).", per_axis=True, default=None
    )
    feed_limit_mm_s: float = parameter("Largest feedrate along the path.", unit="mm/s", above=0.0)
    velocity_limit_mm_s: tuple[float, ...] | None = _per_axis("Largest velocity.", "mm/s", above=0.0, default=None)
    acceleration_limit_mm_s2: tuple[float, ...] | None = _per_axis(
        "Largest acceleration.", "mm/s^2", above=0.0, default=None
    )
    jerk_limit_mm_s3: tuple[float, ...] | None = _per_axis("Largest jerk.", "mm/s^3", above=0.0, default=None)
    period_s: float = parameter(
        "Time between set points.", default=DEFAULT_PERIOD_S, unit="s", at_least=1e-4, at_most=0.1
    )
    drive: _LimitedDrive | None = parameter("Drive model of every axis.", default=None)
    tracking: _LimitedTracking | None = parameter("Tracking model of every axis.", default=None)

    def __post_init__(self) -> None:
        self._refuse_impossible_map()
        self._refuse_unbounded()
        if self.tracking and self.tracking.tracking_error_reserve_mm:
            limits, reserves = self.tracking.tracking_error_limit_mm, self.tracking.tracking_error_reserve_mm
            for name, limit_mm, reserve_mm in zip(self.axis_names, limits, reserves, strict=True):
                if reserve_mm >= limit_mm:
                    raise ConfigError(
                        f"tracking_error_reserve_mm of axis {name} is {reserve_mm:g} mm, which leaves nothing of its "
                        f"tracking_error_limit_mm, {limit_mm:g} mm, to the plan"
                    )

    def rows(self) -> tuple[tuple[float, ...], ...]:
        """Rows of the axis map, from the coordinates where these are given."""
        if self.coordinate is None:
            return self.axis_map or ()
        followed = [COORDINATES.index(letter) for letter in self.coordinate]
        return tuple(tuple(float(i == index) for i in range(max(*followed, 1) + 1)) for index in followed)

    def _refuse_impossible_map(self) -> None:
        if (self.coordinate is None) == (self.axis_map is None):
            raise ConfigError("give either coordinate or axis_map, one entry an axis")
        rows = self.rows()
        for name, row in zip(self.axis_names, rows, strict=True):
            if len(row) not in (2, 3) or len(row) != len(rows[0]):
                raise ConfigError(
                    f"axis_map of axis {name} is {list(row)!r}, must be 2 or 3 factors of x, y (, z), as many in "
                    "every row"
                )
        matrix = np.array(rows)
        missing = [COORDINATES[i] for i in range(matrix.shape[1]) if not np.any(matrix[:, i])]
        if missing:
            raise ConfigError(f"no axis follows coordinate {missing[0]}")
        if np.linalg.matrix_rank(matrix) < matrix.shape[1]:
            raise ConfigError("axis_map has dependent rows: the tool can move while every axis stands still")

    def _refuse_unbounded(self) -> None:
        """Velocity is bounded by the feed limit at least; acceleration and jerk need a limit or a model."""
        free = (0.0,) * len(self.axis_names)
        inertia = self.drive.inertia_volts_s2_mm if self.drive else free
        ka = self.tracking.tracking_ka_s2 if self.tracking else free
        kj = self.tracking.tracking_kj_s3 if self.tracking else free
        for i, name in enumerate(self.axis_names):
            if self.acceleration_limit_mm_s2 is None and inertia[i] <= 0.0 and ka[i] <= 0.0:
                raise ConfigError(
                    f"nothing bounds the acceleration of axis {name}: give acceleration_limit_mm_s2, "
                    "or a model with inertia_volts_s2_mm or tracking_ka_s2 above zero"
                )
            if self.jerk_limit_mm_s3 is None and kj[i] <= 0.0:
                raise ConfigError(
                    f"nothing bounds the jerk of axis {name}: give jerk_limit_mm_s3, or a tracking "
                    "model with tracking_kj_s3 above zero"
                )
